//! Start values of a pose graph along a spanning tree of its edges, breadth-first or odometry first.
//!
//! Each pose is its tree neighbor's pose times one measurement: X_j = X_i · Z. The tree is
//! breadth-first, so a pose is as few measurements from a root as the graph allows and little
//! error adds up; loop closures are used as soon as they shorten the way, and a false one enters
//! the start. Where closures are not to be trusted, the tree follows the odometry.
//! It must not look at the start values of poses other than its roots.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::factors::RelativePose;
use crate::geometry::LieGroup;
use crate::problem::{PoseGraph, SolveError};

/// Replaces every pose that is not constant by its value along a breadth-first spanning tree.
///
/// The roots are the constant poses; without one, the pose with the lowest id, which stays where
/// it is. Among edges of poses as near to a root, the one between the nearest ids is used, then the
/// one from the lowest id, then the first: only between parallel edges does their order matter.
///
/// # Errors
/// Those of [`PoseGraph::validate`], among them [`SolveError::Disconnected`].
pub fn spanning_tree<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
) -> Result<(), SolveError> {
    span(graph, |_gap| false)
}

/// Replaces every pose that is not constant by its value along the odometry.
///
/// As [`spanning_tree`], but an edge between ids that are not consecutive is used only to reach what
/// the others do not: no loop closure, true or false, enters the start.
///
/// # Errors
/// As [`spanning_tree`].
pub fn odometry<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
) -> Result<(), SolveError> {
    span(graph, |gap| gap > 1)
}

/// Grows the tree; an edge over a gap of ids that `is_costly` counts before any number of others.
fn span<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    is_costly: impl Fn(u64) -> bool,
) -> Result<(), SolveError> {
    graph.validate()?;
    let edges_of = graph.edges_of_poses();
    let mut reached = vec![false; graph.poses.len()];
    let mut frontier = BinaryHeap::new();
    for root in graph.held() {
        reached[root] = true;
        frontier.extend(ways(graph, root, edges_of.of(root), (0, 0), &is_costly));
    }
    while let Some(Reverse(((costly, depth), _, _, edge, from))) = frontier.pop() {
        let factor = &graph.edges[edge];
        let (to, from_to) = if factor.i == from {
            (factor.j, factor.i_from_j)
        } else {
            (factor.i, factor.i_from_j.inverse())
        };
        if reached[to] {
            continue;
        }
        reached[to] = true;
        graph.poses[to] = graph.poses[from].compose(&from_to);
        frontier.extend(ways(graph, to, edges_of.of(to), (costly, depth), &is_costly));
    }
    Ok(())
}

/// Costly edges on the way to a pose, and all edges on it.
type Way = (usize, usize);

/// A way to a pose, the gap of ids, the id it comes from, the edge, the pose it comes from. The
/// smallest is taken first.
type Candidate = (Way, u64, i64, usize, usize);

/// The ways on from a pose by its edges.
fn ways<G, const N: usize>(
    graph: &PoseGraph<G, N>,
    from: usize,
    edges: &[usize],
    (costly, depth): Way,
    is_costly: &impl Fn(u64) -> bool,
) -> impl Iterator<Item = Reverse<Candidate>> {
    edges.iter().map(move |&edge| {
        let RelativePose { i, j, .. } = graph.edges[edge];
        let gap = graph.ids[i].abs_diff(graph.ids[j]);
        let way = (costly + usize::from(is_costly(gap)), depth + 1);
        Reverse((way, gap, graph.ids[from], edge, from))
    })
}
