//! From what a solve moved to the event that is journaled, and to what its report names. Nothing here
//! starts a solve or writes the journal.

use super::actor::Actor;
use super::solve::{HeldKeyframe, Moved};
use super::{EngineError, Fault};
use crate::map::{
    AppliedSolve, Change, ClientIndex, EntityId, Held, Map, Reach, SolveKind, SwitchedOff,
    applied_as_far,
};

impl Actor {
    /// The result of a solve as it is to be journaled.
    ///
    /// # Errors
    /// [`EngineError::Refused`]: it would move what the map's gauge holds. [`EngineError::Bug`]. The map
    /// stays as it is.
    pub(super) async fn result(
        &self,
        moved: Moved,
        kind: SolveKind,
        covered: Vec<(ClientIndex, i64)>,
        costs: (f64, f64),
        reach: Reach,
    ) -> Result<AppliedSolve, EngineError> {
        let panics = self.shared.config.injects(Fault::PanicInResult);
        let solve = move |map: &Map| {
            if panics {
                std::panic::panic_any("staged by a test");
            }
            let solved = moved.solved();
            let solve = applied_as_far(map, solved, kind, covered, costs, reach);
            let kept = map.keeps_gauge(solved.gauge(map), &solve);
            (solve, kept)
        };
        let (solve, kept) = self.attempt(solve).await?;
        match kept {
            Ok(()) => Ok(solve),
            Err(error) => {
                let change = Change::SolveApplied { solve };
                Err(self.refuse(&change, false, error.to_string()))
            }
        }
    }

    /// The keyframes that a window was to move and holds.
    pub(super) fn held(&self, moved: &Moved) -> Vec<HeldKeyframe> {
        let Moved::Bundle(problem) = moved else { return Vec::new() };
        let named = |&(keyframe, reason): &(EntityId, Held)| {
            let client = self.map.client(keyframe.client)?.name.clone();
            Some(HeldKeyframe { client, id: keyframe.id, reason })
        };
        problem.held.iter().filter_map(named).collect()
    }
}

/// The constraints that are switched off, sorted by client name, then id.
pub(super) fn switched_off(map: &Map) -> Vec<(String, i64, SwitchedOff)> {
    let named = map.switched_off().iter().map(|(id, &off)| {
        let client = map.client(id.client).map(|client| client.name.clone());
        (client.unwrap_or_default(), id.id, off)
    });
    let mut named: Vec<_> = named.collect();
    named.sort_unstable_by(|a, b| (&a.0, a.1).cmp(&(&b.0, b.1)));
    named
}
