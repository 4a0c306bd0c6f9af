//! The maps of a server by name, and the names that are being changed.
//!
//! A creation or a deletion claims its name from its first step to its last. Whoever wants to change
//! the same name waits, so that no two changes of one name meet in the store. A claim that is dropped
//! leaves the name as it was set last: a change that panics cannot leave a name that nobody can use.
//! Nothing here knows the store.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

use super::MapHandle;

/// The maps by name. Clones share it.
#[derive(Clone, Default)]
pub(super) struct Table(Arc<Mutex<BTreeMap<String, Entry>>>);

/// A name that is taken.
struct Entry {
    /// The map that callers find; `None` while it is being created.
    map: Option<MapHandle>,
    /// Closed when the change of the name has ended; `None` where it is not being changed.
    change: Option<watch::Receiver<()>>,
}

impl Table {
    /// The map called `name`; a map that is being deleted is there until its deletion has ended.
    pub(super) fn get(&self, name: &str) -> Option<MapHandle> {
        self.lock().get(name).and_then(|entry| entry.map.clone())
    }

    /// The maps by name.
    pub(super) fn list(&self) -> Vec<MapHandle> {
        self.lock().values().filter_map(|entry| entry.map.clone()).collect()
    }

    /// Adds a map that was found in the store.
    pub(super) fn insert(&self, map: MapHandle) {
        self.lock().insert(map.name().to_owned(), Entry { map: Some(map), change: None });
    }

    /// Claims a name for a change, once no other change of it runs.
    pub(super) async fn claim(&self, name: &str) -> Claim {
        loop {
            let mut running = match self.try_claim(name) {
                Ok(claim) => return claim,
                Err(running) => running,
            };
            // The sender sends nothing: it is dropped at the end of the change.
            let _ended = running.changed().await;
        }
    }

    /// Claims a name, or tells how to wait for the change that runs.
    fn try_claim(&self, name: &str) -> Result<Claim, watch::Receiver<()>> {
        let mut entries = self.lock();
        let map = match entries.get(name) {
            Some(Entry { change: Some(running), .. }) => return Err(running.clone()),
            Some(Entry { map, .. }) => map.clone(),
            None => None,
        };
        let (ended, change) = watch::channel(());
        entries.insert(name.to_owned(), Entry { map: map.clone(), change: Some(change) });
        Ok(Claim { table: self.clone(), name: name.to_owned(), map, _ended: ended })
    }

    /// Resolves when no name is being changed.
    pub(super) async fn idle(&self) {
        loop {
            let running = self.lock().values().find_map(|entry| entry.change.clone());
            let Some(mut running) = running else { return };
            let _ended = running.changed().await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Entry>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A name that one change holds; dropping it ends the change.
pub(super) struct Claim {
    table: Table,
    name: String,
    /// What the name stands for when the change ends.
    map: Option<MapHandle>,
    _ended: watch::Sender<()>,
}

impl Claim {
    /// The name.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// The map that has the name.
    pub(super) fn map(&self) -> Option<&MapHandle> {
        self.map.as_ref()
    }

    /// Says what the name stands for when the change ends; `None` leaves it free.
    pub(super) fn set(&mut self, map: Option<MapHandle>) {
        self.map = map;
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        let mut entries = self.table.lock();
        match self.map.take() {
            Some(map) => {
                entries.insert(self.name.clone(), Entry { map: Some(map), change: None });
            }
            None => {
                entries.remove(&self.name);
            }
        }
    }
}
