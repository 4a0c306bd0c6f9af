//! A graph without the poses that only pass odometry on.
//!
//! A pose with two trusted edges and no closure hangs between its neighbors: the two edges in turn are
//! one edge, whose covariance is the sum of theirs. A pose at the end of a branch follows its neighbor.
//! What is left are the ends of closures, branching points, held poses and those with priors, and its
//! optimum is that of the whole graph, to first order in the errors. Closures are weighed there, because
//! that takes many solves and few of their poses matter. Solves nothing.

use super::chain::Measured;
use crate::factors::{PosePrior, PositionPrior, RelativePose};
use crate::geometry::LieGroup;
use crate::information::Covariance;
use crate::loss::Loss;
use crate::problem::PoseGraph;

/// A pose that was left out, between two that were kept or behind one.
struct Between<G, const N: usize> {
    pose: usize,
    /// From the first kept pose.
    measured: Measured<G, N>,
}

/// Poses that were left out in a row.
struct Row<G, const N: usize> {
    first: usize,
    between: Vec<Between<G, N>>,
    /// The kept pose at the end, with the way to it; `None` for a branch that ends.
    last: Option<(usize, Measured<G, N>)>,
}

/// What was left out of a graph, to be put back.
pub(super) struct Contraction<G, const N: usize> {
    /// The whole graph.
    full: PoseGraph<G, N>,
    /// Its index of each pose that was kept.
    kept: Vec<usize>,
    rows: Vec<Row<G, N>>,
    /// The closures of the whole graph.
    pub(super) closures: Vec<usize>,
}

/// Replaces `graph` by one without the poses that only pass trusted edges on, and `closures`, indices
/// of edges, by those in it. `None`, and nothing is replaced, where less than half of the poses would
/// go, or where a loss makes two edges more than one.
pub(super) fn contract<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    closures: &mut Vec<usize>,
) -> Option<Contraction<G, N>> {
    let has_loss = |edge: &RelativePose<G, N>| edge.loss.unwrap_or(graph.loss) != Loss::Trivial;
    if graph.edges.iter().any(has_loss) {
        return None;
    }
    let mut is_placed = vec![false; graph.poses.len()];
    graph.placed().for_each(|pose| is_placed[pose] = true);
    let edges_of = edges_of(graph);
    let is_closure = |edge: &usize| closures.binary_search(edge).is_ok();
    let is_passing = |pose: usize| {
        !is_placed[pose] && edges_of[pose].len() <= 2 && !edges_of[pose].iter().any(is_closure)
    };
    let passing: Vec<bool> = (0..graph.poses.len()).map(is_passing).collect();
    if 2 * passing.iter().filter(|&&passes| passes).count() < graph.poses.len() {
        return None;
    }
    let kept: Vec<usize> = (0..graph.poses.len()).filter(|&pose| !passing[pose]).collect();
    let mut place = vec![usize::MAX; graph.poses.len()];
    kept.iter().enumerate().for_each(|(at, &pose)| place[pose] = at);
    let mut reduced = PoseGraph {
        ids: kept.iter().map(|&pose| graph.ids[pose]).collect(),
        poses: kept.iter().map(|&pose| graph.poses[pose]).collect(),
        constant: kept.iter().map(|&pose| graph.constant[pose]).collect(),
        edges: Vec::new(),
        pose_priors: graph
            .pose_priors
            .iter()
            .map(|p| PosePrior { pose: place[p.pose], ..*p })
            .collect(),
        position_priors: graph
            .position_priors
            .iter()
            .map(|p| PositionPrior { pose: place[p.pose], ..*p })
            .collect(),
        loss: graph.loss,
    };
    let mut rows = Vec::new();
    for &first in &kept {
        for &edge in edges_of[first].iter().filter(|edge| passing[other(graph, **edge, first)]) {
            let row = follow(graph, &edges_of, &passing, first, edge)?;
            // A row between two kept poses is met from both of its ends.
            let is_second = row.last.as_ref().is_some_and(|(last, _)| {
                let back = row.between.last().map(|end| end.pose);
                (*last, back) < (first, row.between.first().map(|begin| begin.pose))
            });
            if is_second {
                continue;
            }
            if let Some((last, way)) = &row.last
                && *last != first
            {
                let information = Covariance::new(&way.covariance).ok()?.information().ok()?;
                let (i, j) = (place[first], place[*last]);
                reduced.edges.push(RelativePose {
                    i,
                    j,
                    i_from_j: way.motion,
                    information,
                    loss: None,
                });
            }
            rows.push(row);
        }
    }
    let mut new_closures = Vec::new();
    for (at, edge) in graph.edges.iter().enumerate() {
        if passing[edge.i] || passing[edge.j] {
            continue;
        }
        if is_closure(&at) {
            new_closures.push(reduced.edges.len());
        }
        reduced.edges.push(RelativePose { i: place[edge.i], j: place[edge.j], ..*edge });
    }
    let is_whole = rows.iter().map(|row| row.between.len()).sum::<usize>() + kept.len();
    // A ring without a kept pose is met by none.
    if is_whole != graph.poses.len() || reduced.edges.is_empty() {
        return None;
    }
    let closures = std::mem::replace(closures, new_closures);
    Some(Contraction { full: std::mem::replace(graph, reduced), kept, rows, closures })
}

/// The edges at each pose.
fn edges_of<G, const N: usize>(graph: &PoseGraph<G, N>) -> Vec<Vec<usize>> {
    let mut edges_of = vec![Vec::new(); graph.poses.len()];
    for (edge, RelativePose { i, j, .. }) in graph.edges.iter().enumerate() {
        edges_of[*i].push(edge);
        edges_of[*j].push(edge);
    }
    edges_of
}

fn other<G, const N: usize>(graph: &PoseGraph<G, N>, edge: usize, pose: usize) -> usize {
    let RelativePose { i, j, .. } = graph.edges[edge];
    if i == pose { j } else { i }
}

/// The row that begins at `first` with `edge`; `None` where an edge has no covariance.
fn follow<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    edges_of: &[Vec<usize>],
    passing: &[bool],
    first: usize,
    edge: usize,
) -> Option<Row<G, N>> {
    let (mut at, mut edge) = (first, edge);
    let mut way = Measured::exact();
    let mut between = Vec::new();
    loop {
        let step = Measured::of(&graph.edges[edge])?;
        let is_forward = graph.edges[edge].i == at;
        way = way.compose(&if is_forward { step } else { step.inverse() });
        at = other(graph, edge, at);
        if !passing[at] {
            return Some(Row { first, between, last: Some((at, way)) });
        }
        between.push(Between { pose: at, measured: way });
        match edges_of[at].iter().find(|&&next| next != edge) {
            Some(&next) => edge = next,
            None => return Some(Row { first, between, last: None }),
        }
    }
}

impl<G: LieGroup<N>, const N: usize> Contraction<G, N> {
    /// Puts the whole graph back into `graph`, with the poses that it has by then; those in between
    /// share the error of their row by their covariance.
    pub(super) fn expand(self, graph: &mut PoseGraph<G, N>) {
        let Self { mut full, kept, rows, .. } = self;
        for (&pose, value) in kept.iter().zip(&graph.poses) {
            full.poses[pose] = *value;
        }
        for row in rows {
            let first = full.poses[row.first];
            let error = row.last.as_ref().map(|(last, way)| {
                let found = first.inverse().compose(&full.poses[*last]);
                (way, way.motion.inverse().compose(&found).log())
            });
            for Between { pose, measured } in &row.between {
                let mut value = first.compose(&measured.motion);
                if let Some((way, error)) = &error {
                    let share = measured.covariance.trace() / way.covariance.trace();
                    let rest = measured.motion.inverse().compose(&way.motion);
                    value = value.plus(&(rest.adjoint() * error * share.clamp(0.0, 1.0)));
                }
                full.poses[*pose] = value;
            }
        }
        *graph = full;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::geometry::Se3;
    use crate::information::Information;
    use crate::optimizer::ignore_iterations;
    use crate::pose_graph;
    use crate::testing::random::{element, perturbed, seeded};

    /// A noisy walk of 200 poses with closures between `ends`.
    fn walk(ends: &[(usize, usize)]) -> (PoseGraph<Se3, 6>, Vec<usize>) {
        let mut rng = seeded(5);
        let mut graph: PoseGraph<Se3, 6> = PoseGraph::new();
        let sigmas = Vector6::new(0.02, 0.01, 0.01, 0.002, 0.004, 0.002);
        let information = Information::from_sigmas(&sigmas).unwrap();
        let mut truth = vec![Se3::identity()];
        graph.push_pose(0, Se3::identity());
        graph.constant[0] = true;
        for k in 1..200 {
            let step: Se3 = element(&mut rng, 0.3);
            truth.push(truth[k - 1].compose(&step));
            let i_from_j = perturbed(&mut rng, &step, &sigmas);
            let pose = graph.poses[k - 1].compose(&i_from_j);
            graph.push_pose(k as i64, pose);
            // Some edges the other way round.
            graph.edges.push(match k % 3 {
                0 => RelativePose {
                    i: k,
                    j: k - 1,
                    i_from_j: i_from_j.inverse(),
                    information,
                    loss: None,
                },
                _ => RelativePose { i: k - 1, j: k, i_from_j, information, loss: None },
            });
        }
        let mut closures = Vec::new();
        for &(i, j) in ends {
            closures.push(graph.edges.len());
            let measured = truth[i].inverse().compose(&truth[j]);
            let i_from_j = perturbed(&mut rng, &measured, &sigmas);
            graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
        }
        (graph, closures)
    }

    #[test]
    fn the_optimum_of_a_contracted_graph_is_that_of_the_whole_one() {
        let (graph, closures) = walk(&[(3, 120), (40, 180), (41, 181), (60, 150)]);
        let solve = |graph: &mut PoseGraph<Se3, 6>| {
            let options = pose_graph::Options::default();
            pose_graph::solve(graph, &options, &mut ignore_iterations).unwrap().final_cost
        };
        let mut whole = graph.clone();
        let cost = solve(&mut whole);
        let (mut reduced, mut ends) = (graph.clone(), closures.clone());
        let contraction = contract(&mut reduced, &mut ends).unwrap();
        assert_eq!((reduced.poses.len(), reduced.edges.len(), ends.len()), (9, 12, 4));
        assert_eq!(contraction.closures, closures);
        let reduced_cost = solve(&mut reduced);
        assert!((reduced_cost / cost - 1.0).abs() < 0.02, "{reduced_cost} {cost}");
        contraction.expand(&mut reduced);
        assert_eq!(reduced.edges, graph.edges);
        for (a, b) in reduced.poses.iter().zip(&whole.poses) {
            assert!(a.minus(b).norm() < 0.05, "{}", a.minus(b).norm());
        }
    }

    #[test]
    fn a_graph_of_closures_everywhere_stays_as_it_is() {
        let ends: Vec<(usize, usize)> = (0..110).map(|i| (i, i + 60)).collect();
        let (graph, closures) = walk(&ends);
        let (mut same, mut ends) = (graph.clone(), closures.clone());
        assert!(contract(&mut same, &mut ends).is_none());
        assert_eq!((same, ends), (graph, closures));
    }
}
