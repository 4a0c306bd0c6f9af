//! What a handle asks of the engine: information, streams, watches, solves, and a smaller map. The engine runs it
//! between two items.

use std::sync::Arc;

use tokio::task::JoinHandle;

use super::Actor;
use crate::map::{Change, EntityId, retire_redundant};
use crate::service::engine::error::report_bug;
use crate::service::engine::ingest::OpenedStream;
use crate::service::engine::merged_name::MergedName;
use crate::service::engine::outcome::OptimizeRequest;
use crate::service::engine::watching::OpenedWatch;
use crate::service::engine::{EngineError, MapInfo, Opened, Resource};
use crate::store::StoreError;

impl Actor {
    /// The map as its readers see it.
    pub(crate) fn info(&self) -> MapInfo {
        MapInfo {
            name: self.shared.name.clone(),
            uid: self.shared.uid.clone(),
            snapshot: Arc::clone(&self.map),
            state: self.state(),
            trouble: self.shared.check_open().err(),
            pending: self.pending_work(),
        }
    }

    /// Opens the stream of a client, and fences its older one.
    pub(crate) async fn open_stream(
        &mut self,
        client: String,
        epoch: i64,
        lock_step: bool,
        merged: Option<&MergedName>,
    ) -> Result<OpenedStream, EngineError> {
        let merged = merged.map(|merged| merged.entry_in(&self.map)).transpose()?;
        let name = self.named_here(client, merged);
        let renamed = merged.map(|merged| merged.renamed(&self.map)).unwrap_or_default();
        self.check_open()?;
        let (opening, epoch, reservation) = self.ingest.opening(&self.map, &name, epoch)?;
        while !self.make_room(&opening).await? {}
        if let Some(client) = self.map.client_named(&name) {
            self.ingest.fence(client, &name, epoch);
        }
        if let Err(error) = self.commit(None, opening).await {
            self.ingest.count(&self.map);
            return Err(error);
        }
        let Some(client) = self.map.client_named(&name) else {
            return Err(report_bug("an opened client is not in the map"));
        };
        tracing::debug!(client = name, epoch, "stream opened");
        let next_sequence = self.map.client(client).map_or(1, |c| c.next_sequence);
        let first_open = self.solving.schedule.first_open(client);
        let opened = Opened {
            client,
            next_sequence,
            optimized_sequence: first_open.unwrap_or(next_sequence) - 1,
            epoch,
            revision: self.map.revision(),
            lock_step: lock_step || self.shared.config.lock_step,
        };
        Ok(self.ingest.open(opened, &self.map, renamed, reservation))
    }

    /// Takes constant time: the watcher reads the journal in its own task.
    pub(crate) fn watch(
        &self,
        from_revision: Option<i64>,
        merged: Option<&MergedName>,
    ) -> Result<OpenedWatch, EngineError> {
        // Where clients have other names here, their old ones may be those of others.
        if let Some(merged) = merged.map(|merged| merged.entry_in(&self.map)).transpose()?
            && !merged.renamed(&self.map).is_empty()
        {
            let (map, into) = (merged.name.clone(), self.shared.name.clone());
            return Err(EngineError::MergedAway { map, into });
        }
        let account = &self.shared.account;
        let watcher = account.reserve(Resource::Watchers, 1)?;
        let reservations = [watcher, account.reserve(Resource::Streams, 1)?];
        let newest = self.map.revision();
        if let Some(revision) = from_revision.filter(|&revision| revision > newest) {
            let map = self.shared.name.clone();
            return Err(EngineError::RevisionAhead { map, revision, newest });
        }
        let (log, signal) = self.watching.open(newest);
        let (map, state) = (Arc::clone(&self.map), self.state());
        Ok(OpenedWatch { map, state, log, signal, reservations })
    }

    /// Accepts or refuses a request to optimize the map.
    pub(crate) fn optimize(&mut self, job: OptimizeRequest) {
        match self.check_open() {
            Ok(()) => self.solving.request(job),
            Err(error) => job.answer(Err(error)),
        }
    }

    /// Deletes the map in the store; then the engine ends.
    pub(crate) async fn delete(&mut self) -> Result<(), EngineError> {
        let map = self.shared.name.clone();
        self.shared.store.delete_map(&map).await?;
        self.end_with(match self.is_moving() {
            true => EngineError::Moving { map },
            false => EngineError::MapNotFound { map },
        });
        Ok(())
    }

    /// Removes those of the keyframes that are redundant still, and counts them.
    pub(crate) async fn retire_redundant(
        &mut self,
        keyframes: Vec<EntityId>,
        share: f64,
    ) -> Result<usize, EngineError> {
        self.check_open()?;
        let mut count = 0;
        for keyframe in keyframes {
            let retired = self.attempt(move |map| retire_redundant(map, keyframe, share)).await?;
            if let Some(retired) = retired {
                self.commit(None, Change::KeyframeRetired { retired }).await?;
                self.shared.meters.retired.increment();
                count += 1;
            }
        }
        Ok(count)
    }

    /// Starts to drop the journal before a snapshot of the map as it is.
    pub(crate) fn drop_journal(&self) -> Result<JoinHandle<Result<(), StoreError>>, EngineError> {
        self.check_changeable()?;
        Ok(self.journal.drop_journal(&self.map))
    }
}
