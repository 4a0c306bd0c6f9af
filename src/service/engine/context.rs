//! What the engine of a map, its parts and the handles of the map share: names, limits, meters, the store, and
//! whether the map takes changes.
//!
//! It knows no part and starts nothing.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, MutexGuard, OnceLock};

use tokio::sync::{Semaphore, watch};

use crate::map::Map;
use crate::service::engine::measured_pairs::MeasuredPairs;
use crate::service::engine::places::Places;
use crate::service::engine::{Account, EngineConfig, EngineError, EngineMeters};
use crate::store::{Durability, Flushed, Store, StoreError};
use crate::sync::Mutex;

/// Whether a map accepts changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapState {
    /// It accepts items and optimizations.
    Open,
    /// Read-only, by request.
    Frozen,
    /// Read-only, because a change hit a bug, the journal failed, or acknowledged events are lost.
    Poisoned,
}

/// A map as its readers see it.
#[derive(Clone, Debug)]
pub struct MapInfo {
    /// Its name.
    pub name: String,
    /// Differs from the uid of a later map with the same name.
    pub uid: String,
    /// The map.
    pub snapshot: Arc<Map>,
    /// Whether it accepts changes.
    pub state: MapState,
    /// Why it accepts none, where that is not by request.
    pub trouble: Option<EngineError>,
    /// What its engine still does by itself.
    pub pending: PendingWork,
}

/// Work that changes a map without another item or call.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PendingWork {
    /// Items, and closures that the server found, that no solve has covered.
    pub unoptimized_items: usize,
    /// Keyframes whose place is to be searched.
    pub place_searches: usize,
    /// Whether places that closures join are compared, or the map is adjusted after closures, or either
    /// is due.
    pub closure_adjustment: bool,
    /// Whether a requested optimization waits or runs.
    pub optimization: bool,
}

impl PendingWork {
    /// Whether there is none.
    pub fn is_settled(&self) -> bool {
        *self == Self::default()
    }
}

/// Whether a map accepts changes, and why it does not.
pub(crate) enum Condition {
    Open,
    /// A change hit a bug.
    Poisoned,
    /// The journal failed or lost events.
    Damaged(EngineError),
}

/// What an engine, its parts and all handles of its map share.
pub(crate) struct MapContext {
    pub(crate) name: String,
    pub(crate) uid: String,
    pub(crate) account: Arc<Account>,
    pub(crate) config: EngineConfig,
    pub(crate) meters: Arc<EngineMeters>,
    pub(crate) condition: Mutex<Condition>,
    /// Whether the map is frozen by request.
    pub(crate) frozen: AtomicBool,
    /// Whether it takes nothing because another map takes its content, or has it.
    pub(crate) moving: AtomicBool,
    /// The store from which watchers read the journal.
    pub(crate) store: Arc<dyn Store>,
    /// Limits how many watchers read journals at once.
    pub(crate) history: Arc<Semaphore>,
    /// What was measured between keyframes.
    pub(crate) pairs: Arc<MeasuredPairs>,
    /// The index of its places.
    pub(crate) places: Arc<Places>,
    /// How far the journal is durable.
    pub(crate) flushed: watch::Receiver<Flushed>,
    /// Why the engine ended.
    pub(crate) ended: OnceLock<EngineError>,
    /// Why the map could not be opened; its content is then unknown.
    pub(crate) unopened: Option<EngineError>,
}

impl MapContext {
    pub(crate) fn condition(&self) -> MutexGuard<'_, Condition> {
        self.condition.lock()
    }

    pub(crate) fn state(&self) -> MapState {
        match *self.condition() {
            Condition::Open => MapState::Open,
            Condition::Poisoned | Condition::Damaged(_) => MapState::Poisoned,
        }
    }

    /// A change hit a bug.
    pub(crate) fn poison(&self) {
        let mut condition = self.condition();
        if let Condition::Open = *condition {
            *condition = Condition::Poisoned;
        }
    }

    /// The journal has failed; the first error stays.
    pub(crate) fn set_damaged(&self, error: &EngineError) {
        let mut condition = self.condition();
        if let Condition::Open | Condition::Poisoned = *condition {
            *condition = Condition::Damaged(error.clone());
        }
    }

    /// Refuses changes to a map that accepts none.
    pub(crate) fn check_open(&self) -> Result<(), EngineError> {
        match &*self.condition() {
            Condition::Open => Ok(()),
            Condition::Poisoned => Err(EngineError::Poisoned { map: self.name.clone() }),
            Condition::Damaged(error) => Err(error.clone()),
        }
    }

    /// Refuses calls while another server may have the map.
    pub(crate) fn check_served(&self) -> Result<(), EngineError> {
        match self.flushed.borrow().lapsed() {
            Some(error) => Err(EngineError::Store(error.clone())),
            None => Ok(()),
        }
    }

    /// Whether the engine has ended because another server has the map.
    pub(crate) fn is_elsewhere(&self) -> bool {
        matches!(self.ended.get(), Some(EngineError::Store(StoreError::OwnedElsewhere { .. })))
    }

    /// Whether items that are acknowledged as durable survive a crash.
    pub(crate) fn is_durable(&self) -> bool {
        self.store.durability() != Durability::Memory
    }
}
