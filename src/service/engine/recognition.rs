//! Searches for known places: what the keyframes of a map show that was there before.
//!
//! A keyframe whose descriptors are new waits in the map until its place was searched. The oldest ones
//! are searched on the pool, one after the other; what is found becomes one event: loop closures,
//! verdicts, reasons. A closure asks for a pose graph as a client's does. The searches that are due are
//! part of the map: a restart continues with them. In lock-step they run when no solve runs or waits, and
//! the next item waits for them. Nothing is cut off by new keyframes: a search holds a snapshot only
//! for a tenth of a second.

use std::sync::Arc;

use covis_solvers::interrupt::Interrupt;

use super::actor::Actor;
use super::handle::Shared;
use super::places::Places;
use super::pool::{Ended, Slot, SolverPool};
use super::{EngineError, Estimate, Fault, Resource};
use crate::loop_closing::{QueryView, excluded, find_loop_closure, not_indexed};
use crate::map::{Change, Constraint, EntityId, Map, PlaceRefusal, PlaceSearch};

/// Keyframes whose places are searched in one task. A search takes 10 to 100 ms, and its closure waits
/// for the last one.
const SEARCHED_AT_ONCE: usize = 4;

/// What the search for the place of a keyframe found.
#[derive(Debug)]
pub(super) struct SearchResult {
    keyframe: EntityId,
    /// The revision that asked for the search.
    asked: i64,
    search: PlaceSearch,
    closure: Option<Constraint>,
}

/// The searches of a map, one task at a time.
pub(super) struct Recognition {
    shared: Arc<Shared>,
    pub(super) work: Slot<Vec<SearchResult>>,
    /// Whether the journal has refused a change and has not moved since.
    waits_for_journal: bool,
    /// Whether a search has panicked: the next would most likely panic too, and none starts until the map is
    /// opened anew.
    is_off: bool,
}

impl Recognition {
    pub(super) fn new(shared: &Arc<Shared>, pool: &Arc<SolverPool>) -> Self {
        let work = Slot::new(pool, &shared.account);
        Self { shared: Arc::clone(shared), work, waits_for_journal: false, is_off: false }
    }

    /// Whether nothing runs or is due.
    pub(super) fn is_idle(&self, map: &Map) -> bool {
        self.work.is_free() && !self.is_due(map)
    }

    /// How many keyframes wait until their places are searched.
    pub(super) fn pending(&self, map: &Map) -> usize {
        let is_on = map.policy().place_recognition && !self.is_off;
        if is_on { map.place_searches().pending.len() } else { 0 }
    }

    fn is_due(&self, map: &Map) -> bool {
        !self.waits_for_journal
            && !self.is_off
            && map.policy().place_recognition
            && !map.place_searches().pending.is_empty()
    }

    /// The journal took a change, or brought some to the disk.
    pub(super) fn changed(&mut self) {
        self.waits_for_journal = false;
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
        let meters = Arc::clone(&self.shared.meters);
        let panics = self.shared.config.injects(Fault::PanicInBackground);
        self.work.start((), Estimate::LONG, Arc::default(), move |cancel| {
            if panics {
                std::panic::panic_any("staged by a test");
            }
            let interrupt = Interrupt::NEVER.or_when(Arc::clone(cancel));
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
    }
}

/// Searches the place of one keyframe.
fn find(
    map: &Map,
    places: &Places,
    (keyframe, asked): (EntityId, i64),
    interrupt: &Interrupt,
) -> SearchResult {
    let refused = |refusal| PlaceSearch { refusal: Some(refusal), ..PlaceSearch::default() };
    let known = map.keyframes().get(&keyframe);
    let (search, closure) = match known.and_then(|known| QueryView::of_keyframe(map, known)) {
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
                        find_loop_closure(map, (keyframe, &view), &candidates, interrupt);
                    search.refusal = places.refusal(keyframe);
                    (search, closure)
                }
            }
        }
    };
    SearchResult { keyframe, asked, search, closure }
}

type Searches = Vec<(EntityId, PlaceSearch)>;
type Closures = Vec<(EntityId, Constraint)>;

/// What was found, as far as the map still asks for it. A place that has left the map is searched again.
fn wanted(map: &Map, found: &[SearchResult]) -> (Searches, Closures) {
    let (mut searches, mut closures) = (Vec::new(), Vec::new());
    for SearchResult { keyframe, asked, search, closure } in found {
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
        let waits = self.ingest.is_lock_step() && !self.solving.is_idle();
        let may_start = self.recognition.work.is_free() && self.recognition.is_due(&self.map);
        if may_start && !waits && self.check_open().is_ok() {
            self.recognition.start(&self.map);
        }
    }

    /// Handles the end of a task.
    pub(super) async fn recognition_ended(&mut self, ((), ended): ((), Ended<Vec<SearchResult>>)) {
        let found = match ended {
            Ended::Made(found) => found,
            Ended::Dropped => return,
            Ended::Panicked { panicked, .. } => {
                self.lost(&panicked);
                self.recognition.is_off = true;
                return;
            }
        };
        let (count, change) = match self.searched(&found).await {
            Ok(Some(change)) => change,
            Ok(None) => return,
            Err(error) => return self.recognition_waits(&error),
        };
        match self.commit(None, change.clone()).await {
            Ok(_) => {}
            // What was found is noted without the closures, which do not fit.
            Err(error @ EngineError::Refused { .. }) if count > 0 => {
                if let Err(error) = self.commit(None, without_closures(change, &error)).await {
                    self.recognition_waits(&error);
                }
                return;
            }
            Err(error) => return self.recognition_waits(&error),
        }
        if count > 0 {
            self.shared.meters.closures_found.add(count);
            self.trigger_own_closures().await;
        }
    }

    /// The change that what was found makes, if there is one. Makes room for its closures as for a
    /// client's, or notes why there is none.
    ///
    /// # Errors
    /// The journal takes nothing just now: the searches stay due.
    async fn searched(
        &mut self,
        found: &[SearchResult],
    ) -> Result<Option<(u64, Change)>, EngineError> {
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

/// The change without its closures, for which there is no room or which are not possible.
fn without_closures(change: Change, error: &EngineError) -> Change {
    let is_refused = matches!(error, EngineError::Refused { .. });
    let name = if is_refused { "not_possible" } else { "no_room" };
    let refusal = PlaceRefusal::new(name, &error.to_string());
    let Change::PlacesSearched { mut searches, .. } = change else { return change };
    for (_, search) in searches.iter_mut().filter(|(_, search)| search.closure.is_some()) {
        (search.closure, search.refusal) = (None, Some(refusal.clone()));
    }
    Change::PlacesSearched { searches, closures: Vec::new() }
}
