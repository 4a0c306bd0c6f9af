//! Watching a map: what changed since a reader last looked, however slow it is.
//!
//! The engine keeps one set of touched ids a watcher, not a queue of events; when the reader asks,
//! it gets the set and the newest snapshot, in which the values are read. The memory of a watcher
//! is bounded by the map, and revisions are never skipped, only joined.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use tokio::sync::watch;

use super::handle::Control;
use super::{EngineError, MapHandle, MapState, Reservation};
use crate::map::{Change, ClientIndex, EntityId, Event, Map};
use crate::meter::Held;

/// What events touched. An id that the snapshot does not hold was removed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Touched {
    /// Cameras that are new or changed.
    pub cameras: BTreeSet<EntityId>,
    /// Keyframes that are new, changed or gone.
    pub keyframes: BTreeSet<EntityId>,
    /// Landmarks that are new, changed or gone.
    pub landmarks: BTreeSet<EntityId>,
    /// Constraints and priors that are new, switched off or on, or gone.
    pub constraints: BTreeSet<EntityId>,
    /// Clients that are new or whose keyframes changed.
    pub clients: BTreeSet<ClientIndex>,
}

impl Touched {
    /// Adds what `change` touches; `map` is the map before it.
    pub(super) fn add(&mut self, change: &Change, map: &Map) {
        match change {
            Change::Created { .. } | Change::ItemRepeated | Change::PolicySet { .. } => {}
            Change::ClientOpened { name, .. } => {
                let next = u32::try_from(map.clients().len()).unwrap_or(u32::MAX);
                self.clients.insert(map.client_named(name).unwrap_or(ClientIndex(next)));
            }
            Change::CameraSet { id, .. } => {
                self.cameras.insert(*id);
            }
            Change::KeyframeAdded { id, observations, landmarks, .. } => {
                self.keyframe(*id);
                self.landmarks.extend(landmarks.iter().map(|l| l.id));
                self.landmarks.extend(observations.iter().map(|o| o.landmark));
            }
            Change::LandmarksAdded { landmarks } => {
                self.landmarks.extend(landmarks.iter().map(|l| l.id));
            }
            Change::ObservationsAdded { observations, .. } => {
                self.landmarks.extend(observations.iter().map(|o| o.landmark));
            }
            Change::ConstraintAdded { id, .. }
            | Change::PriorAdded { id, .. }
            | Change::ConstraintRevoked { id } => {
                self.constraints.insert(*id);
            }
            Change::LandmarksTriangulated { positions } => {
                self.landmarks.extend(positions.iter().map(|&(id, _)| id));
            }
            Change::SolveApplied { solve } => {
                solve.poses.iter().for_each(|&(id, _)| self.keyframe(id));
                self.landmarks.extend(solve.landmarks.iter().map(|&(id, _)| id));
                self.cameras.extend(solve.cameras.iter().map(|&(id, _)| id));
                self.constraints.extend(solve.switched_off.iter().map(|&(id, _)| id));
                self.constraints.extend(&solve.switched_on);
            }
            Change::ObservationsRemoved { observations } => {
                self.landmarks.extend(observations.iter().map(|&(_, landmark)| landmark));
            }
            Change::LandmarksFused { kept, absorbed } => {
                self.landmarks.insert(*kept);
                self.landmarks.extend(absorbed);
            }
            Change::LandmarksRemoved { landmarks } => self.landmarks.extend(landmarks),
            Change::KeyframeRemoved { keyframe } => self.removed(*keyframe, map),
            Change::KeyframeRetired { retired } => {
                self.removed(retired.keyframe, map);
                self.landmarks.extend(&retired.landmarks);
                self.constraints.extend(&retired.revoked);
                self.constraints.extend(retired.constraints.iter().map(|&(id, _)| id));
                self.constraints.extend(retired.priors.iter().map(|&(id, _)| id));
            }
        }
    }

    /// A keyframe goes, with its constraints and priors.
    fn removed(&mut self, keyframe: EntityId, map: &Map) {
        self.keyframe(keyframe);
        if let Some(entity) = map.keyframes().get(&keyframe) {
            self.landmarks.extend(entity.observations.iter().map(|o| o.landmark));
        }
        let constraints = map.constraints().iter();
        let gone =
            constraints.filter(|(_, c)| c.keyframe_i == keyframe || c.keyframe_j == keyframe);
        self.constraints.extend(gone.map(|(&id, _)| id));
        let gone = map.priors().iter().filter(|(_, p)| p.keyframe() == keyframe);
        self.constraints.extend(gone.map(|(&id, _)| id));
    }

    fn len(&self) -> usize {
        self.cameras.len()
            + self.keyframes.len()
            + self.landmarks.len()
            + self.constraints.len()
            + self.clients.len()
    }

    fn keyframe(&mut self, id: EntityId) {
        self.keyframes.insert(id);
        self.clients.insert(id.client);
    }

    fn join(&mut self, other: Self) {
        self.cameras.extend(other.cameras);
        self.keyframes.extend(other.keyframes);
        self.landmarks.extend(other.landmarks);
        self.constraints.extend(other.constraints);
        self.clients.extend(other.clients);
    }
}

/// More ids than this and than the map has entities are not kept: the reader gets the full state.
const LEAST_TOUCHED: usize = 10_000;

/// A step of a watched map.
#[derive(Clone, Debug)]
pub struct MapChange {
    /// Whether the reader drops what it holds, because too much was touched to be told: then
    /// `touched` is of no use, and the snapshot is the full state.
    pub reset: bool,
    /// What the reader held.
    pub base_revision: i64,
    /// What it holds after the step.
    pub revision: i64,
    /// Whether the map takes changes.
    pub state: MapState,
    /// What lies between the two.
    pub touched: Touched,
    /// The map at `revision`.
    pub snapshot: Arc<Map>,
}

/// Where the engine leaves a change, so that a canceled [`Watch::next`] loses nothing.
type Slot = Mutex<Option<MapChange>>;

/// A watched map.
#[derive(Debug)]
pub struct Watch {
    /// The full state to begin with; absent when the reader goes on from a revision it holds.
    pub reset: Option<Arc<Map>>,
    /// The revision that the first change starts from.
    pub base_revision: i64,
    /// The map's state at the start.
    pub state: MapState,
    pub(super) handle: MapHandle,
    pub(super) id: u64,
    pub(super) slot: Arc<Slot>,
    pub(super) signal: watch::Receiver<()>,
    /// Taken out of the slot, and not durable yet.
    pub(super) taken: Option<MapChange>,
    pub(super) _place: [Reservation; 2],
    pub(super) _open: Held,
}

impl Watch {
    /// The next step, joined from everything since the last one; waits until there is something.
    /// Canceling loses nothing.
    ///
    /// # Errors
    /// Why watching ended: [`EngineError::MapNotFound`] when the map was deleted,
    /// [`EngineError::ShuttingDown`].
    pub async fn next(&mut self) -> Result<MapChange, EngineError> {
        if let Some(change) = self.told().await? {
            return Ok(change);
        }
        loop {
            self.signal.borrow_and_update();
            let id = self.id;
            self.handle.call(|reply| Control::TakeChange { id, reply }).await?;
            let left = self.slot.lock().unwrap_or_else(PoisonError::into_inner).take();
            self.taken = left;
            if let Some(change) = self.told().await? {
                return Ok(change);
            }
            if self.signal.changed().await.is_err() {
                return Err(self.handle.end_error());
            }
        }
    }
}

impl Watch {
    /// What was taken, once no crash can take it back.
    async fn told(&mut self) -> Result<Option<MapChange>, EngineError> {
        if let Some(change) = &self.taken {
            self.handle.durable(change.revision).await?;
        }
        Ok(self.taken.take())
    }
}

struct Watcher {
    id: u64,
    slot: Weak<Slot>,
    base_revision: i64,
    state: MapState,
    touched: Touched,
    reset: bool,
}

/// The engine's side: all watchers of a map.
pub(super) struct Watchers {
    signal: watch::Sender<()>,
    watchers: Vec<Watcher>,
    next_id: u64,
}

impl Watchers {
    pub(super) fn new() -> Self {
        Self { signal: watch::Sender::new(()), watchers: Vec::new(), next_id: 0 }
    }

    /// Adds a watcher that holds `base_revision`; `missed` are the events since.
    pub(super) fn open(
        &mut self,
        handle: MapHandle,
        map: &Arc<Map>,
        state: MapState,
        missed: Option<&[Arc<Event>]>,
        place: [Reservation; 2],
    ) -> Watch {
        self.next_id += 1;
        let slot = Arc::new(Slot::default());
        let mut touched = Touched::default();
        for event in missed.unwrap_or_default() {
            touched.add(&event.change, map);
        }
        let first = missed.and_then(|events| events.first());
        let base_revision = first.map_or(map.revision(), |event| event.revision - 1);
        self.watchers.push(Watcher {
            id: self.next_id,
            slot: Arc::downgrade(&slot),
            base_revision,
            state,
            touched,
            reset: false,
        });
        let reset = missed.is_none().then(|| Arc::clone(map));
        let (id, signal) = (self.next_id, self.signal.subscribe());
        let _open = handle.shared.meters.watchers.hold();
        let (taken, _place) = (None, place);
        Watch { reset, base_revision, state, handle, id, slot, signal, taken, _place, _open }
    }

    /// Tells the watchers of an event that is about to change `map`.
    pub(super) fn tell(&mut self, change: &Change, map: &Map) {
        self.watchers.retain(|watcher| watcher.slot.strong_count() > 0);
        let most = LEAST_TOUCHED.max(map.keyframes().len() + map.landmarks().len());
        for watcher in self.watchers.iter_mut().filter(|watcher| !watcher.reset) {
            watcher.touched.add(change, map);
            if watcher.touched.len() > most {
                watcher.touched = Touched::default();
                watcher.reset = true;
            }
        }
    }

    /// Wakes the watchers: the map or its state has changed.
    pub(super) fn wake(&self) {
        self.signal.send_replace(());
    }

    /// Leaves in a watcher's slot what changed since it last took something.
    pub(super) fn take(&mut self, id: u64, map: &Arc<Map>, state: MapState) {
        let Some(watcher) = self.watchers.iter_mut().find(|w| w.id == id) else { return };
        let Some(slot) = watcher.slot.upgrade() else { return };
        if watcher.base_revision == map.revision() && watcher.state == state {
            return;
        }
        let mut change = MapChange {
            reset: std::mem::take(&mut watcher.reset),
            base_revision: watcher.base_revision,
            revision: map.revision(),
            state,
            touched: std::mem::take(&mut watcher.touched),
            snapshot: Arc::clone(map),
        };
        (watcher.base_revision, watcher.state) = (map.revision(), state);
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(earlier) = slot.take() {
            change.base_revision = earlier.base_revision;
            change.touched.join(earlier.touched);
            change.reset |= earlier.reset;
        }
        *slot = Some(change);
    }
}
