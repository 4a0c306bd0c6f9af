//! From catalog, snapshot and stream to a map that this server serves.
//!
//! The owner message comes first: what is read afterwards is all that the stream has, and no other server
//! can add to it. Then the own journal is made to hold the same: what it lacks is appended, and where it
//! does not fit (another server wrote in between, or the stream begins behind its end) it is made anew
//! from the snapshot. What it holds beyond the stream, when everything else is the same, is published: it
//! was accepted here, and nobody has written since. Last the catalog is asked whether the map is still
//! this server's: a server that paused in between lets go of it.
//!
//! The own journal has the uid of the catalog's entry. One of the same name and another uid is of another
//! map, or of one that NATS has lost: it is set aside and never deleted. So is what does not fit a map
//! whose stream was missing once: servers acknowledged events that their own journals alone still have.

use std::sync::Arc;

use super::ReplicatedStore;
use super::catalog::Entry;
use super::map_stream::MapStream;
use super::message::AssembledEvent;
use super::owned::{Owned, Signals, confirm};
use super::publisher::{Begin, Publisher};
use crate::encoding::encode_event;
use crate::files::uid_of;
use crate::{Epoch, Store, StoreError, sequence_of, wait_durable};
use covis_map::Map;

/// Events that are appended to the own journal at once.
const BATCH: usize = 256;

/// What the own journal has to do with the stream.
enum OwnJournal {
    /// It holds the stream's events up to a revision.
    Through(u64),
    /// It holds all of them, and further ones, encoded.
    Beyond(Vec<(u64, Vec<u8>)>),
    /// There is none, it is another map's, or what it holds does not fit.
    Other,
}

impl ReplicatedStore {
    /// Opens a map that the catalog gives to this server. A new one has no stream yet.
    pub(super) async fn take_over(&self, map: &str, is_new: bool) -> Result<Epoch, StoreError> {
        let elsewhere = || StoreError::OwnedElsewhere { map: map.to_owned(), owner: None };
        let me = self.members.me();
        // Where the lease lapses from here on, the catalog is asked once more before anything is served.
        let lease = self.members.lease();
        let lapses = lease.borrow().lapses;
        let known = self.catalog.get(map).await?;
        let known = known.ok_or_else(|| StoreError::UnknownMap { map: map.to_owned() })?;
        if known.entry.owner.as_ref() != Some(me) {
            return Err(elsewhere());
        }
        // A map that was open here is open no more.
        let former = self.maps.lock().remove(map);
        drop(former);
        let uid = &known.entry.uid;
        let known = if is_new || MapStream::exists(&self.context, map, uid).await? {
            known
        } else {
            // Before a stream is made: whoever takes the map over later must know that one was lost.
            tracing::error!(map, "NATS has lost the map's stream");
            let entry = Entry { stream_was_lost: true, ..known.entry.clone() };
            self.catalog.replace(&known, entry).await?.ok_or_else(elsewhere)?
        };
        let stream = MapStream::open(&self.context, map, &known.entry.uid, self.replicas).await?;
        let epoch = stream.fence(me).await?;
        let found = stream.read(epoch).await?.events;
        let last = found.last().map_or(0, |found| sequence_of(found.event.revision));
        let through = known.entry.snapshots.last().copied().unwrap_or(0).max(last);
        let own = self.compare(map, &known.entry, &found, through).await?;
        let beyond = self.mend(map, &known.entry, &found, own).await?;
        let index = found.iter().map(|found| (sequence_of(found.event.revision), found.at));
        let begin = Begin { epoch, through, index: index.collect(), most: self.most };
        let publisher = Publisher::start(map.to_owned(), stream.clone(), begin);
        let waits_for = beyond.last().map(|&(revision, _)| revision);
        publisher.push(beyond);
        let own_epoch = self.local.acquire(map).await?;
        let local = self.local.follow(map).await?;
        // A lapse of the lease does not end this: what was done so far need not be done again.
        let through = waits_for.unwrap_or(through);
        wait_durable(local.clone(), through).await?;
        wait_durable(publisher.progress(), through).await?;
        let mut known = known;
        if !confirm(&self.catalog, &mut known).await? {
            return Err(elsewhere());
        }
        let signals = Signals { local, lease, lapses };
        let owned = Owned::start(stream, publisher, known, self.catalog.clone(), signals);
        self.maps.lock().insert(map.to_owned(), owned);
        tracing::info!(map, epoch, through, "this server serves the map");
        Ok(own_epoch)
    }

    /// Whether the own journal is of the map that the entry is of.
    fn is_of(&self, map: &str, entry: &Entry) -> bool {
        self.local.uid(map).is_ok_and(|uid| uid_of(&entry.uid) == Some(uid))
    }

    /// Compares the own journal with the stream, event by event.
    async fn compare(
        &self,
        map: &str,
        entry: &Entry,
        found: &[AssembledEvent],
        through: u64,
    ) -> Result<OwnJournal, StoreError> {
        match self.local.acquire(map).await {
            Ok(_) => {}
            Err(StoreError::UnknownMap { .. }) => return Ok(OwnJournal::Other),
            Err(error) => return Err(error),
        }
        if self.local.damage(map).await?.iter().any(|damage| damage.lost.is_some()) {
            return Ok(OwnJournal::Other);
        }
        // A stream without events begins behind the newest snapshot, or NATS has lost what it held.
        let begin = found.first().map_or(through, |found| sequence_of(found.event.revision) - 1);
        let last = found.last().map_or(0, |found| sequence_of(found.event.revision));
        let (begin, own) = match self.local.read(map, begin).await {
            // The stream reaches back to the older snapshot, the journal to its newest one.
            Err(StoreError::Truncated { through: dropped, .. }) if dropped < last => {
                (dropped, self.local.read(map, dropped).await?)
            }
            Err(StoreError::Truncated { .. }) => return Ok(OwnJournal::Other),
            own => (begin, own?),
        };
        let is_known = |found: &&AssembledEvent| sequence_of(found.event.revision) <= begin;
        let found = &found[found.iter().take_while(is_known).count()..];
        let mut same = 0;
        if found.is_empty() {
            // No event tells that both are one history.
            if !self.is_of(map, entry) || !self.has_snapshot(map, entry, through).await? {
                return Ok(OwnJournal::Other);
            }
            same = through;
        }
        let mut bytes = Vec::new();
        let mut encoded = own.iter().map(|event| {
            bytes.clear();
            encode_event(event, &mut bytes);
            (sequence_of(event.revision), bytes.clone())
        });
        for found in found {
            match encoded.next() {
                Some((_, bytes)) if bytes == found.encoded => {
                    same = sequence_of(found.event.revision);
                }
                Some(_) => return Ok(OwnJournal::Other),
                None if same == 0 => return Ok(OwnJournal::Other),
                None => return Ok(OwnJournal::Through(same)),
            }
        }
        let beyond: Vec<_> = encoded.collect();
        Ok(if beyond.is_empty() && same == through {
            OwnJournal::Through(same)
        } else {
            OwnJournal::Beyond(beyond)
        })
    }

    /// Whether this server has the snapshot of a revision, as NATS has it; every map is empty at 0.
    async fn has_snapshot(
        &self,
        map: &str,
        entry: &Entry,
        revision: u64,
    ) -> Result<bool, StoreError> {
        if revision == 0 {
            return Ok(true);
        }
        let own = self.local.get_snapshot(map).await?;
        let own = own.filter(|own| sequence_of(own.revision()) == revision);
        let Some(own) = own else { return Ok(false) };
        let shared = self.newest_snapshot(map, entry).await?;
        Ok(shared.is_some_and(|shared| shared == own))
    }

    /// Makes the own journal hold what the stream has; returns what it holds beyond.
    async fn mend(
        &self,
        map: &str,
        entry: &Entry,
        found: &[AssembledEvent],
        own: OwnJournal,
    ) -> Result<Vec<(u64, Vec<u8>)>, StoreError> {
        let from = match own {
            OwnJournal::Beyond(beyond) => return Ok(beyond),
            OwnJournal::Through(through) => through,
            OwnJournal::Other => self.make_anew(map, entry).await?,
        };
        let epoch = self.local.acquire(map).await?;
        let missing = found.iter().filter(|found| sequence_of(found.event.revision) > from);
        let missing: Vec<_> = missing.map(|found| Arc::clone(&found.event)).collect();
        let mut last = from;
        for batch in missing.chunks(BATCH) {
            let reached = self.local.append(map, epoch, last, batch.to_vec()).await?;
            last = reached.sequence;
        }
        Ok(Vec::new())
    }

    /// Makes the own journal anew, with the newest snapshot that opens; returns its revision.
    async fn make_anew(&self, map: &str, entry: &Entry) -> Result<u64, StoreError> {
        let snapshot = self.newest_snapshot(map, entry).await?;
        let revision = snapshot.as_ref().map_or(0, |snapshot| sequence_of(snapshot.revision()));
        match self.make_room(map, entry).await {
            Ok(()) | Err(StoreError::UnknownMap { .. }) => {}
            Err(error) => return Err(error),
        }
        self.local.create(map, uid_of(&entry.uid), snapshot).await?;
        Ok(revision)
    }

    /// Makes room for the map's journal. What the stream lacks was never acknowledged and goes; but
    /// NATS may have lost it, and the journal of another map may be its only one.
    async fn make_room(&self, map: &str, entry: &Entry) -> Result<(), StoreError> {
        if self.syncs && !entry.stream_was_lost && self.is_of(map, entry) {
            return self.local.delete_map(map).await;
        }
        let folder = self.local.set_aside(map).await?;
        let folder = folder.display();
        tracing::warn!(map, %folder, "this server's own files of the map are set aside");
        Ok(())
    }

    async fn newest_snapshot(
        &self,
        map: &str,
        entry: &Entry,
    ) -> Result<Option<Arc<Map>>, StoreError> {
        let mut last = None;
        for &revision in entry.snapshots.iter().rev() {
            match self.snapshots.get(map, &entry.uid, revision).await {
                Ok(snapshot) => return Ok(Some(Arc::new(snapshot))),
                Err(error @ StoreError::Content { .. }) => {
                    tracing::error!(map, %error, "a snapshot does not open");
                    last = Some(error);
                }
                Err(error) => return Err(error),
            }
        }
        last.map_or(Ok(None), Err)
    }
}
