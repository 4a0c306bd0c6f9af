//! The maps of a server by name, and the names that are being changed.
//!
//! A creation or a deletion claims its name from its first step to its last. Another change of the
//! same name waits, so that two changes of one name never run in the store at once. Dropping a
//! claim leaves the name as it was last set, so that a name stays usable after a panic. This module
//! does not use the store.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

use super::MapHandle;

/// The maps by name. Clones share the table.
#[derive(Clone, Default)]
pub(super) struct Table(Arc<Mutex<BTreeMap<String, Entry>>>);

/// A name that is in use.
struct Entry {
    /// The map that callers find; `None` while it is being created.
    map: Option<MapHandle>,
    /// Closed when the change of the name has ended; `None` where it is not being changed.
    change: Option<watch::Receiver<()>>,
}

impl Table {
    /// The map called `name`; a map that is being deleted is found until its deletion has ended.
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
            // The sender sends no value: it is dropped at the end of the change.
            let _ended = running.changed().await;
        }
    }

    /// Claims a name, or returns a receiver that closes when the running change has ended.
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

/// The claim of one change to a name; dropping it ends the change.
pub(super) struct Claim {
    table: Table,
    name: String,
    /// The map that has the name when the change ends.
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

    /// Sets the map that has the name when the change ends; `None` makes the name free.
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
