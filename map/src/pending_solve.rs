//! What an item asks to be solved, and the items whose solves are outstanding.
//!
//! A map keeps of each client the last item that asked for a solve, until a solve covers it, so that a server
//! that opens the map again (a restart, an import) continues with it. In lock-step no other item is unsolved;
//! otherwise the solve of the last item covers most of the others. Nothing is solved here.

use super::{Affected, Change, ConstraintKind, EntityId, Map, affected};

/// An item that was accepted and whose solve was not applied.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PendingSolve {
    /// Its sequence.
    pub sequence: i64,
    /// What it asks for.
    pub request: SolveRequest,
}

/// What an item asks to be solved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SolveRequest {
    /// The window around a keyframe that got observations.
    Views(EntityId),
    /// The pose graph, for a loop closure.
    LoopClosure,
    /// The pose graph, for a prior.
    Prior,
    /// What an edit concerns.
    Edited(Affected),
}

/// What `change` asks to be solved, if a client makes it; `map` is the map before it.
pub(super) fn solve_request(map: &Map, change: &Change) -> Option<SolveRequest> {
    if let Change::KeyframeAdded { id, .. } | Change::ObservationsAdded { keyframe: id, .. } =
        change
    {
        Some(SolveRequest::Views(*id))
    } else if let Change::ConstraintAdded { constraint, .. } = change
        && constraint.kind == ConstraintKind::LoopClosure
    {
        Some(SolveRequest::LoopClosure)
    } else if let Change::PriorAdded { .. } = change {
        Some(SolveRequest::Prior)
    } else {
        affected(map, change).map(SolveRequest::Edited)
    }
}
