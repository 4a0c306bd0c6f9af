//! The engine's side of maps that become one, and apart again: it takes nothing while another map takes its
//! content, it takes the content of another map, or makes a map of what came and lets go of it.
//!
//! The order of the steps, and what names lead to, is not known here.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use covis_solvers::geometry::Sim3;
use tokio::sync::watch;

use crate::map::{Change, ClientIndex, Link, Map, MergeError, MergedClient, MergedMap, Usage};
use crate::service::engine::actor::Actor;
use crate::service::engine::{Account, EngineError, MapInfo, Resource};
use crate::store::{Epoch, Flushed, StoreError};

/// A map that has left another one, as the store has made it.
pub(crate) struct SeparatedMap {
    /// The other one, without it.
    pub(crate) map: MapInfo,
    pub(crate) content: Arc<Map>,
    pub(crate) epoch: Epoch,
    pub(crate) flushed: watch::Receiver<Flushed>,
}

/// # Errors
/// [`EngineError::MapLimit`] and its kin where `map` has no room for the content of another one.
pub(crate) fn check_room(
    account: &Arc<Account>,
    map: &Map,
    content: Usage,
) -> Result<(), EngineError> {
    let limits = map.policy().limits.lower(&account.limits().held);
    match limits.exceeded(map.usage(), content) {
        Some(exceeded) => Err(account.exceeded(exceeded)),
        None => Ok(()),
    }
}

impl Actor {
    /// The name in this map of a client that found it by the name of the map `merged`, which became part of it.
    pub(crate) fn named_here(&self, client: String, merged: Option<&MergedMap>) -> String {
        let known = merged.and_then(|merged| merged.clients.iter().find(|c| c.name == client));
        let known = known.and_then(|known| self.map.client(known.index));
        known.map_or(client, |known| known.name.clone())
    }

    /// Ends the streams and takes nothing more: what the map holds now is what the other one takes.
    pub(crate) fn hold(&mut self) -> Result<MapInfo, EngineError> {
        match self.check_changeable() {
            Ok(()) | Err(EngineError::Moving { .. }) => {}
            Err(error) => return Err(error),
        }
        self.shared.moving.store(true, Ordering::Relaxed);
        self.pause(&EngineError::Moving { map: self.shared.name.clone() });
        Ok(self.info())
    }

    /// Takes `source`, the content of the map called `name`.
    pub(crate) async fn join(
        &mut self,
        name: String,
        source: Arc<Map>,
        target_from_source: Sim3,
        renamed: BTreeMap<String, String>,
        mut links: Vec<Link>,
    ) -> Result<MapInfo, EngineError> {
        self.check_open()?;
        let map = name.clone();
        let merge = self.attempt(move |map| {
            links.retain(|link| {
                let held = |map: &Map, id| map.keyframes().contains_key(&id);
                held(map, link.target) && held(&source, link.source)
            });
            map.merge_of((&name, &source), target_from_source, &renamed, &links)
        });
        let cannot = |error: MergeError| EngineError::CannotMerge { map: map.clone(), error };
        let merge = merge.await?.map_err(cannot)?;
        // A robot at work that has sent nothing yet is one of the target's too.
        let is_at_work = |client: &&MergedClient| self.ingest.has_stream(client.index);
        if let Some(known) = merge.clients.iter().find(is_at_work) {
            let client = self.map.client(known.index).map(|client| client.name.clone());
            let client = client.unwrap_or_default();
            return Err(cannot(MergeError::ClientInBoth { client }));
        }
        let (account, usage) = (&self.shared.account, merge.content.usage());
        check_room(account, &self.map, usage)?;
        // One event of this size may fill what the journals of all maps may have waiting.
        let _room = account.reserve(Resource::JournalBytes, usage.bytes)?;
        let clients: Vec<ClientIndex> = merge.clients.iter().map(|client| client.index).collect();
        self.commit(None, Change::MapMerged { merge: Box::new(merge) }).await?;
        for (client, pending) in self.map.pending_solves() {
            if client == ClientIndex::SERVER || clients.contains(&client) {
                self.trigger(client, pending).await;
            }
        }
        Ok(self.info())
    }

    /// Makes a map of what came with a merge, and lets go of it.
    pub(crate) async fn take_out(&mut self, name: String) -> Result<SeparatedMap, EngineError> {
        self.check_open()?;
        let wanted = name.clone();
        let content = self.attempt(move |map| map.taken_out(&wanted)).await?;
        let map = || self.shared.name.clone();
        let content = content.map_err(|error| EngineError::CannotMerge { map: map(), error })?;
        let Some(content) = content.map(Arc::new) else {
            return Err(EngineError::NotMerged { map: map(), source_map: name });
        };
        let merged = self.map.merged_as(&name);
        let clients: Vec<ClientIndex> =
            merged.into_iter().flat_map(|merged| &merged.clients).map(|c| c.index).collect();
        let store = Arc::clone(&self.shared.store);
        let epoch = match store.create_map(&name, Some(Arc::clone(&content))).await {
            // No engine owns it: a failed creation left it and could not be undone.
            Err(StoreError::MapExists { .. }) => {
                store.delete_map(&name).await?;
                store.create_map(&name, Some(Arc::clone(&content))).await?
            }
            epoch => epoch?,
        };
        let flushed = store.follow(&name).await?;
        let moving = EngineError::Moving { map: name.clone() };
        clients.iter().for_each(|&client| self.ingest.end(client, moving.clone()));
        let taken_out = Change::MapTakenOut { name: name.clone(), clients_leave: true };
        if let Err(error) = self.commit(None, taken_out).await {
            if let Err(left) = store.delete_map(&name).await {
                tracing::error!(map = name, %left, "a map that was not taken out is left in the store");
            }
            return Err(error);
        }
        clients.into_iter().for_each(|client| self.solving.schedule.forget(client));
        self.trigger_own_closures().await;
        Ok(SeparatedMap { map: self.info(), content, epoch, flushed })
    }
}
