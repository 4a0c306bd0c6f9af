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

use crate::loop_closing::{QueryView, excluded, find_loop_closure, not_indexed};
use crate::map::{Constraint, EntityId, Map, PlaceSearch};
use crate::service::engine::context::MapContext;
use crate::service::engine::places::Places;
use crate::service::engine::pool::{Slot, SolverPool};
use crate::service::engine::{Estimate, Fault};

/// Keyframes whose places are searched in one task. A search takes 10 to 100 ms, and its closure waits
/// for the last one.
const SEARCHED_AT_ONCE: usize = 4;

/// What the search for the place of a keyframe found.
#[derive(Debug)]
pub(crate) struct SearchResult {
    pub(crate) keyframe: EntityId,
    /// The revision that asked for the search.
    pub(crate) asked: i64,
    pub(crate) search: PlaceSearch,
    pub(crate) closure: Option<Constraint>,
}

/// The searches of a map, one task at a time.
pub(crate) struct Recognition {
    shared: Arc<MapContext>,
    pub(crate) work: Slot<Vec<SearchResult>>,
    /// Whether the journal has refused a change and has not moved since.
    waits_for_journal: bool,
    /// Whether a search has panicked: the next would most likely panic too, and none starts until the map is
    /// opened anew.
    is_off: bool,
}

impl Recognition {
    pub(crate) fn new(shared: &Arc<MapContext>, pool: &Arc<SolverPool>) -> Self {
        let work = Slot::new(pool, &shared.account);
        Self { shared: Arc::clone(shared), work, waits_for_journal: false, is_off: false }
    }

    /// Whether nothing runs or is due.
    pub(crate) fn is_idle(&self, map: &Map) -> bool {
        self.work.is_free() && !self.is_due(map)
    }

    /// How many keyframes wait until their places are searched.
    pub(crate) fn pending(&self, map: &Map) -> usize {
        let is_on = map.policy().place_recognition && !self.is_off;
        if is_on { map.place_searches().pending.len() } else { 0 }
    }

    /// Whether a search is due.
    pub(crate) fn is_due(&self, map: &Map) -> bool {
        !self.waits_for_journal
            && !self.is_off
            && map.policy().place_recognition
            && !map.place_searches().pending.is_empty()
    }

    /// A search has panicked: no other one starts.
    pub(crate) fn turn_off(&mut self) {
        self.is_off = true;
    }

    /// The journal took no change: what was found is searched again once it takes one.
    pub(crate) fn wait_for_journal(&mut self) {
        self.waits_for_journal = true;
    }

    /// The journal took a change, or brought some to the disk.
    pub(crate) fn changed(&mut self) {
        self.waits_for_journal = false;
    }

    /// Starts to search the places of the keyframes that have waited longest.
    pub(crate) fn start(&mut self, map: &Arc<Map>) {
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
                let found = find(&map, &places, keyframe, asked, &interrupt);
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
    keyframe: EntityId,
    asked: i64,
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
                        find_loop_closure(map, keyframe, &view, &candidates, interrupt);
                    search.refusal = places.refusal(keyframe);
                    (search, closure)
                }
            }
        }
    };
    SearchResult { keyframe, asked, search, closure }
}
