//! The ends of searches for places: what was found becomes one event, as far as the map still asks for it.
//! A closure that was found starts a pose graph.

use super::Actor;
use crate::map::{Change, Constraint, EntityId, Map, PlaceRefusal, PlaceSearch};
use crate::service::engine::pool::Ended;
use crate::service::engine::recognition::SearchResult;
use crate::service::engine::{EngineError, Resource};

impl Actor {
    /// Starts the next searches, if some are due and nothing runs that they have to wait for.
    pub(crate) fn start_recognition(&mut self) {
        let waits = self.ingest.is_lock_step() && !self.solving.is_idle();
        let may_start = self.recognition.work.is_free() && self.recognition.is_due(&self.map);
        if may_start && !waits && self.check_open().is_ok() {
            self.recognition.start(&self.map);
        }
    }

    /// Handles the end of a task.
    pub(crate) async fn recognition_ended(&mut self, ((), ended): ((), Ended<Vec<SearchResult>>)) {
        let found = match ended {
            Ended::Made(found) => found,
            Ended::Dropped => return,
            Ended::Panicked { panicked, .. } => {
                self.lost(&panicked);
                self.recognition.turn_off();
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
        tracing::warn!(%error, %map, "the result of a place search waits for the journal");
        self.ingest.count(&self.map);
        self.recognition.wait_for_journal();
    }
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
