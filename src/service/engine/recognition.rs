//! Searches for known places: what the keyframes of a map show that was there before.
//!
//! A keyframe whose descriptors are new waits in the map until its place was searched. The oldest ones
//! are searched on the pool, one after the other; what is found becomes one event: loop closures,
//! verdicts, reasons. A closure asks for a pose graph as a client's does. The searches that are due are
//! part of the map: a restart continues with them. In lock-step they run when no solve runs or waits, and
//! the next item waits for them. Nothing is cut off by new keyframes: a search holds a snapshot only
//! for a tenth of a second.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use covis_solvers::interrupt::Interrupt;

use super::actor::Actor;
use super::handle::Shared;
use super::places::Places;
use super::pool::{SolvePanicked, SolverPool, Started};
use super::{EngineError, Estimate, Resource};
use crate::loop_closing::{View, close, excluded, not_indexed};
use crate::map::{
    Change, ClientIndex, Constraint, EntityId, Map, PendingSolve, PlaceRefusal, PlaceSearch,
    SolveRequest,
};

/// Keyframes whose places are searched in one task. A search takes 10 to 100 ms, and its closure waits
/// for the last one.
const SEARCHED_AT_ONCE: usize = 4;

/// What the search for the place of a keyframe found.
#[derive(Debug)]
pub(super) struct Found {
    keyframe: EntityId,
    /// The revision that asked for the search.
    asked: i64,
    search: PlaceSearch,
    closure: Option<Constraint>,
}

/// The searches of a map, one task at a time.
pub(super) struct Recognition {
    shared: Arc<Shared>,
    pool: Arc<SolverPool>,
    running: Option<Started<Vec<Found>>>,
    /// Whether the journal has refused a change and has not moved since.
    waits_for_journal: bool,
}

impl Recognition {
    pub(super) fn new(shared: &Arc<Shared>, pool: &Arc<SolverPool>) -> Self {
        let (shared, pool) = (Arc::clone(shared), Arc::clone(pool));
        Self { shared, pool, running: None, waits_for_journal: false }
    }

    /// Whether nothing runs or is due.
    pub(super) fn is_idle(&self, map: &Map) -> bool {
        self.running.is_none() && !self.is_due(map)
    }

    fn is_due(&self, map: &Map) -> bool {
        !self.waits_for_journal
            && map.policy().place_recognition
            && !map.place_searches().pending.is_empty()
    }

    /// Whether a task may have to start.
    pub(super) fn may_start(&self, map: &Map) -> bool {
        self.running.is_none() && self.is_due(map)
    }

    /// The journal took a change, or brought some to the disk.
    pub(super) fn changed(&mut self) {
        self.waits_for_journal = false;
    }

    /// Cancels what runs; its result is dropped.
    pub(super) fn cancel(&mut self) {
        if let Some(running) = &mut self.running {
            running.drop_result();
        }
    }

    /// Starts to search the places of the keyframes that have waited longest.
    fn start(&mut self, map: &Arc<Map>) {
        let pending = map.place_searches().pending.iter();
        let mut due: Vec<(i64, EntityId)> = pending.map(|(&id, &asked)| (asked, id)).collect();
        if due.len() > SEARCHED_AT_ONCE {
            due.select_nth_unstable(SEARCHED_AT_ONCE);
            due.truncate(SEARCHED_AT_ONCE);
        }
        due.sort_unstable();
        let (map, places) = (Arc::clone(map), Arc::clone(&self.shared.places));
        let cancel = Arc::<AtomicBool>::default();
        let interrupt = Interrupt::at(None).or_when(Arc::clone(&cancel));
        let meters = Arc::clone(&self.shared.meters);
        let answer = self.pool.start(&self.shared.account, Estimate::LONG, move || {
            // An index that lacks much, as after a restart, is made in several tasks: between two of them
            // other solves have their turns.
            if !places.advance(&map, &interrupt) {
                return Vec::new();
            }
            let search = |(asked, keyframe)| {
                let started = std::time::Instant::now();
                let found = find(&map, &places, (keyframe, asked), &interrupt);
                meters.place_search_ns.observe_time(started.elapsed());
                found
            };
            due.into_iter().take_while(|_| !interrupt.is_due()).map(search).collect()
        });
        self.running = Some(Started::new(cancel, answer));
    }

    /// Resolves when the running task has ended; never if none runs.
    pub(super) async fn ended(&mut self) -> Result<Vec<Found>, SolvePanicked> {
        Started::ended(self.running.as_mut()).await
    }

    /// What the task that has ended found, if it is still wanted.
    fn take_ended(
        &mut self,
        found: Result<Vec<Found>, SolvePanicked>,
    ) -> Result<Vec<Found>, SolvePanicked> {
        let is_stale = self.running.take().is_none_or(|running| running.is_stale());
        let found = found.inspect_err(|_| self.shared.meters.solve_panics.increment())?;
        Ok(if is_stale { Vec::new() } else { found })
    }
}

/// Searches the place of one keyframe.
fn find(
    map: &Map,
    places: &Places,
    (keyframe, asked): (EntityId, i64),
    interrupt: &Interrupt,
) -> Found {
    let refused = |refusal| PlaceSearch { refusal: Some(refusal), ..PlaceSearch::default() };
    let known = map.keyframes().get(&keyframe);
    let (search, closure) = match known.and_then(|known| View::of_keyframe(map, known)) {
        None => (PlaceSearch::default(), None),
        Some(view) => {
            let age = known.map_or(0, |known| known.added_revision);
            let excluded = excluded(map, keyframe);
            let is_later =
                |id| map.keyframes().get(&id).is_some_and(|other| other.added_revision > age);
            let is_excluded = |id| excluded.contains(&id) || is_later(id);
            match places.candidates(map, &view, interrupt, &is_excluded) {
                Err(error) => (refused(not_indexed(&error)), None),
                Ok(candidates) => {
                    let (mut search, closure) =
                        close(map, (keyframe, &view), &candidates, interrupt);
                    search.refusal = places.refusal(keyframe);
                    (search, closure)
                }
            }
        }
    };
    Found { keyframe, asked, search, closure }
}

type Searches = Vec<(EntityId, PlaceSearch)>;
type Closures = Vec<(EntityId, Constraint)>;

/// What was found, as far as the map still asks for it. A place that has left the map is searched again.
fn wanted(map: &Map, found: &[Found]) -> (Searches, Closures) {
    let (mut searches, mut closures) = (Vec::new(), Vec::new());
    for Found { keyframe, asked, search, closure } in found {
        let is_asked = map.place_searches().pending.get(keyframe) == Some(asked);
        let is_held =
            |constraint: &Constraint| map.keyframes().contains_key(&constraint.keyframe_i);
        if !is_asked || !closure.as_ref().is_none_or(is_held) {
            continue;
        }
        let mut search = search.clone();
        if let Some(constraint) = closure {
            let id = EntityId::own(keyframe.client, map.revision() + 1, closures.len());
            search.closure = Some(id);
            closures.push((id, *constraint));
        }
        searches.push((*keyframe, search));
    }
    searches.sort_unstable_by_key(|&(id, _)| id);
    (searches, closures)
}

impl Actor {
    /// Starts the next searches, if some are due and nothing runs that they have to wait for.
    pub(super) fn start_recognition(&mut self) {
        let is_held_back = self.map.is_frozen()
            || !self.closing.is_empty()
            || self.check_changeable().is_err()
            || (self.ingest.is_lock_step() && !self.solving.is_idle());
        if !is_held_back && self.recognition.may_start(&self.map) {
            self.recognition.start(&self.map);
        }
    }

    /// Handles the end of a task.
    pub(super) async fn recognition_ended(&mut self, found: Result<Vec<Found>, SolvePanicked>) {
        let found = match self.recognition.take_ended(found) {
            Ok(found) => found,
            Err(panicked) => {
                self.poison(&panicked.message);
                return;
            }
        };
        let (count, change) = match self.searched(&found).await {
            Ok(Some(change)) => change,
            Ok(None) => return,
            Err(error) => return self.recognition_waits(&error),
        };
        if let Err(error) = self.commit(None, change).await {
            return self.recognition_waits(&error);
        }
        if count > 0 {
            self.shared.meters.closures_found.add(count);
            let pending =
                PendingSolve { sequence: self.map.revision(), request: SolveRequest::LoopClosure };
            self.trigger(ClientIndex::SERVER, pending).await;
        }
    }

    /// The change that what was found makes, if there is one. Makes room for its closures as for a
    /// client's, or notes why there is none.
    ///
    /// # Errors
    /// The journal takes nothing just now: the searches stay due.
    async fn searched(&mut self, found: &[Found]) -> Result<Option<(u64, Change)>, EngineError> {
        loop {
            let (searches, closures) = wanted(&self.map, found);
            if searches.is_empty() {
                return Ok(None);
            }
            let count = closures.len() as u64;
            let change = Change::PlacesSearched { searches, closures };
            // A limit of the map is a reason to refuse a closure, a slow disk is none.
            drop(self.shared.account.reserve(Resource::JournalBytes, 1)?);
            if count == 0 {
                return Ok(Some((0, change)));
            }
            match self.make_room(&change).await {
                Ok(true) => return Ok(Some((count, change))),
                // A keyframe was retired: it may be one of those that are to be joined.
                Ok(false) => {}
                Err(error @ (EngineError::Store(_) | EngineError::Bug { .. })) => {
                    return Err(error);
                }
                Err(full) => return Ok(Some((0, without_closures(change, &full)))),
            }
        }
    }

    /// What was found is searched again once the journal takes a change.
    fn recognition_waits(&mut self, error: &EngineError) {
        let map = &self.shared.name;
        tracing::warn!(%error, %map, "what a search for places found waits for the journal");
        self.ingest.count(&self.map);
        self.recognition.waits_for_journal = true;
    }
}

/// The change without its closures, for which there is no room.
fn without_closures(change: Change, full: &EngineError) -> Change {
    let refusal = PlaceRefusal::new("no_room", &full.to_string());
    let Change::PlacesSearched { mut searches, .. } = change else { return change };
    for (_, search) in searches.iter_mut().filter(|(_, search)| search.closure.is_some()) {
        (search.closure, search.refusal) = (None, Some(refusal.clone()));
    }
    Change::PlacesSearched { searches, closures: Vec::new() }
}
