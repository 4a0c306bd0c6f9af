//! Which start a pose graph is solved from.
//!
//! The chordal start leads to the lowest known optimum of every public graph, one or two steps away,
//! and costs less than one step: [`Start::Auto`] leaves it only where the given poses are better
//! still, as in a graph that was solved before. It weighs all closures alike: where some may be
//! false, start from the odometry.

use super::{chordal, odometry, spanning_tree};
use crate::factors::cost;
use crate::geometry::RigidMotion;
use crate::interrupt::Interrupt;
use crate::price::Limits;
use crate::problem::{PoseGraph, SolveError};

/// Where the poses come from that a solve starts with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// The poses as they are.
    Given,
    /// Measurements are composed between consecutive ids, as far as they reach.
    Odometry,
    /// Measurements are composed along a tree, as few as possible to each pose.
    SpanningTree,
    /// Relaxed rotations, then positions.
    Chordal,
    /// The given poses or the chordal start, whichever has the lower cost.
    #[default]
    Auto,
}

/// Brings the poses of `graph` that are not constant to `start`, and its landmarks to where they were
/// measured from a start that was made; returns the start taken, never
/// [`Start::Auto`].
///
/// `has_poses` is whether the graph came with poses: without, [`Start::Auto`] does not look at them,
/// and falls back to the spanning tree where rounding defeats the chordal start. [`Start::Auto`] that
/// is interrupted, or whose chordal start is too expensive, takes the given poses, or the spanning tree
/// where there are none.
///
/// # Errors
/// Those of [`PoseGraph::validate`]; [`SolveError::Singular`] from [`Start::Chordal`];
/// [`SolveError::InvalidOption`] for [`Start::Given`] without poses; beyond the limits
/// [`SolveError::TooExpensive`] and [`SolveError::Interrupted`] from [`Start::Chordal`].
pub fn initialize<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    start: Start,
    has_poses: bool,
    limits: Limits<'_>,
) -> Result<Start, SolveError> {
    match start {
        Start::Given if !has_poses => {
            let reason = "the graph has edges only, a start must be made";
            return Err(SolveError::InvalidOption { field: "init", reason });
        }
        Start::Given => graph.validate()?,
        Start::Odometry => odometry(graph)?,
        Start::SpanningTree => spanning_tree(graph)?,
        Start::Chordal => chordal(graph, limits)?,
        Start::Auto => return automatic(graph, has_poses, limits),
    }
    if start != Start::Given {
        graph.landmarks.place(&graph.poses);
    }
    Ok(start)
}

/// As [`initialize`]; where that takes longer than there is time, the given poses, or the odometry
/// of a graph without poses.
pub(crate) fn initialize_in_time<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    start: Start,
    has_poses: bool,
    limits: Limits<'_>,
) -> Result<Start, SolveError> {
    match initialize(graph, start, has_poses, limits) {
        Err(SolveError::Interrupted) => {
            let at_hand = if has_poses { Start::Given } else { Start::Odometry };
            initialize(graph, at_hand, has_poses, Limits::NONE)
        }
        other => other,
    }
}

fn automatic<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    has_poses: bool,
    limits: Limits<'_>,
) -> Result<Start, SolveError> {
    let is_open = |error: &SolveError| {
        matches!(
            error,
            SolveError::Singular { .. } | SolveError::TooExpensive(_) | SolveError::Interrupted
        )
    };
    let never = Interrupt::NEVER;
    let cost = |graph: &PoseGraph<G, N>| {
        let edges = cost(&graph.edges, &graph.poses, graph.loss, &never);
        edges + graph.cost_of_measured()
    };
    let given = has_poses.then(|| {
        let landmarks = graph.landmarks.positions.clone();
        (cost(graph), (graph.poses.clone(), landmarks))
    });
    let made = chordal(graph, limits).map(|()| graph.landmarks.place(&graph.poses));
    match (made, given) {
        (Ok(()), None) => Ok(Start::Chordal),
        // A cost that is no number never wins.
        (Ok(()), Some((before, _))) if before.is_nan() || before > cost(graph) => {
            Ok(Start::Chordal)
        }
        (Ok(()), Some((_, given))) => {
            (graph.poses, graph.landmarks.positions) = given;
            Ok(Start::Given)
        }
        (Err(error), Some((_, given))) if is_open(&error) => {
            (graph.poses, graph.landmarks.positions) = given;
            Ok(Start::Given)
        }
        (Err(error), None) if is_open(&error) => {
            spanning_tree(graph)?;
            graph.landmarks.place(&graph.poses);
            Ok(Start::SpanningTree)
        }
        (Err(error), _) => Err(error),
    }
}
