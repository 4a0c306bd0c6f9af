//! A graph without the poses that have nothing but odometry.
//!
//! A pose with two trusted edges and no closure is a link of a chain: its two edges are composed to one
//! edge, whose covariance is the sum of theirs. A pose at the end of a branch follows its neighbor.
//! What is left are the ends of closures, branching points, held poses and those with priors, and its
//! optimum is that of the whole graph, to first order in the errors. Closures are weighed there,
//! because that takes many solves and few of their poses matter. Where the errors are large, each row
//! can be measured anew along its most probable path (`bending`), which brings both optima together. At
//! the end the poses that were left out are put back on these paths. Solves nothing.

use super::bending::{Bend, Path, bend};
use super::chain::UncertainMotion;
use crate::factors::{PosePrior, PositionPrior, RelativePose};
use crate::geometry::LieGroup;
use crate::information::Covariance;
use crate::lists::Lists;
use crate::loss::Loss;
use crate::parallel;
use crate::problem::{Landmarks, PoseGraph};

/// Most steps of a row. The errors of a longer one add up to so much that the first order says little:
/// in graphs of 20,000 poses some rows of 512 steps do not end (0.7 s instead of 0.28 s at most); with 128
/// it is as with 256.
const MOST_STEPS: usize = 256;

/// An edge of a row.
#[derive(Clone, Copy)]
struct Step {
    edge: usize,
    /// Whether the row goes from pose i of the edge to pose j.
    is_forward: bool,
    /// The pose that it leads to.
    pose: usize,
}

/// Poses that were left out in a row.
struct Row {
    first: usize,
    steps: Vec<Step>,
    /// Whether the last step leads to a kept pose; else the branch ends.
    is_closed: bool,
}

impl Row {
    /// The poses that were left out.
    fn between(&self) -> impl DoubleEndedIterator<Item = usize> + ExactSizeIterator + '_ {
        let count = self.steps.len() - usize::from(self.is_closed);
        self.steps[..count].iter().map(|step| step.pose)
    }

    /// The kept pose at the end.
    fn last(&self) -> Option<usize> {
        self.steps.last().filter(|_| self.is_closed).map(|step| step.pose)
    }

    /// Pieces of nearly the same length; a branch is left whole.
    fn cut(self) -> Vec<Self> {
        if !self.is_closed {
            return vec![self];
        }
        let count = self.steps.len().div_ceil(MOST_STEPS);
        let mut first = self.first;
        let piece = |steps: &[Step]| {
            let piece = Self { first, steps: steps.to_vec(), is_closed: true };
            first = piece.last().unwrap_or(first);
            piece
        };
        self.steps.chunks(self.steps.len().div_ceil(count)).map(piece).collect()
    }

    /// What each step measured, from the first pose on; `None` where an edge has no covariance.
    fn measured<'a, G: LieGroup<N>, const N: usize>(
        &'a self,
        measured: &'a [Option<UncertainMotion<G, N>>],
    ) -> impl Iterator<Item = Option<UncertainMotion<G, N>>> + 'a {
        self.steps.iter().map(|step| {
            let along = measured[step.edge]?;
            Some(if step.is_forward { along } else { along.inverse() })
        })
    }
}

/// What was left out of a graph, to be put back.
pub(super) struct Contraction<G, const N: usize> {
    /// The whole graph.
    full: PoseGraph<G, N>,
    /// Of each of its edges.
    measured: Vec<Option<UncertainMotion<G, N>>>,
    /// Its index of each pose that was kept.
    kept: Vec<usize>,
    /// Each with its most probable path to the end that was last asked for.
    rows: Vec<(Row, Bend<G, N>)>,
    /// Of each row, its edge in the contracted graph.
    edges: Vec<Option<usize>>,
    /// The closures of the whole graph.
    pub(super) closures: Vec<usize>,
}

/// Replaces `graph` by one without the poses that only pass trusted edges on, and `closures`, indices
/// of edges, by those in it; `measured` is that of each edge. `None`, and nothing is replaced, where
/// less than half of the poses would go, or where a loss makes two edges more than one.
pub(super) fn contract<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    measured: Vec<Option<UncertainMotion<G, N>>>,
    closures: &mut Vec<usize>,
) -> Option<Contraction<G, N>> {
    let has_loss = |edge: &RelativePose<G, N>| edge.loss.unwrap_or(graph.loss) != Loss::Trivial;
    if graph.edges.iter().any(has_loss) {
        return None;
    }
    let mut is_placed = vec![false; graph.poses.len()];
    graph.placed().for_each(|pose| is_placed[pose] = true);
    let edges_of = graph.edges_of_poses();
    let is_closure = |edge: &usize| closures.binary_search(edge).is_ok();
    let is_passing = |pose: usize| {
        let edges = edges_of.of(pose);
        !is_placed[pose] && edges.len() <= 2 && !edges.iter().any(is_closure)
    };
    let mut passing: Vec<bool> = (0..graph.poses.len()).map(is_passing).collect();
    if 2 * passing.iter().filter(|&&passes| passes).count() < graph.poses.len() {
        return None;
    }
    let rows = rows(graph, &edges_of, &mut passing);
    let kept: Vec<usize> = (0..graph.poses.len()).filter(|&pose| !passing[pose]).collect();
    let mut reduced_index = vec![usize::MAX; graph.poses.len()];
    kept.iter().enumerate().for_each(|(at, &pose)| reduced_index[pose] = at);
    let mut reduced = PoseGraph {
        ids: kept.iter().map(|&pose| graph.ids[pose]).collect(),
        poses: kept.iter().map(|&pose| graph.poses[pose]).collect(),
        constant: kept.iter().map(|&pose| graph.constant[pose]).collect(),
        edges: Vec::new(),
        pose_priors: graph
            .pose_priors
            .iter()
            .map(|p| PosePrior { pose: reduced_index[p.pose], ..*p })
            .collect(),
        position_priors: graph
            .position_priors
            .iter()
            .map(|p| PositionPrior { pose: reduced_index[p.pose], ..*p })
            .collect(),
        // [`super::solve`] takes no graph with landmarks.
        landmarks: Landmarks::default(),
        ranges: Vec::new(),
        loss: graph.loss,
    };
    let way = |row: Row| {
        let mut way = UncertainMotion::exact();
        for step in row.measured(&measured) {
            way = way.compose(&step?);
        }
        Some((row, way))
    };
    let rows = parallel::map(rows.into_iter(), way).into_iter().collect::<Option<Vec<_>>>()?;
    let mut edges = Vec::with_capacity(rows.len());
    for (row, way) in &rows {
        let last = row.last().filter(|&last| last != row.first);
        edges.push(last.map(|_| reduced.edges.len()));
        let Some(last) = last else { continue };
        let information = Covariance::new(&way.covariance).ok()?.information().ok()?;
        let (i, j, i_from_j) = (reduced_index[row.first], reduced_index[last], way.motion);
        reduced.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
    }
    let mut new_closures = Vec::new();
    for (at, edge) in graph.edges.iter().enumerate() {
        if passing[edge.i] || passing[edge.j] {
            continue;
        }
        if is_closure(&at) {
            new_closures.push(reduced.edges.len());
        }
        reduced.edges.push(RelativePose {
            i: reduced_index[edge.i],
            j: reduced_index[edge.j],
            ..*edge
        });
    }
    let is_whole = rows.iter().map(|(row, _)| row.between().len()).sum::<usize>() + kept.len();
    // A ring without a kept pose is met by none.
    if is_whole != graph.poses.len() || reduced.edges.is_empty() {
        return None;
    }
    let closures = std::mem::replace(closures, new_closures);
    let full = std::mem::replace(graph, reduced);
    let rows = rows.into_iter().map(|(row, way)| (row, Bend::none(&way))).collect();
    Some(Contraction { full, measured, kept, rows, edges, closures })
}

fn other<G, const N: usize>(graph: &PoseGraph<G, N>, edge: usize, pose: usize) -> usize {
    let RelativePose { i, j, .. } = graph.edges[edge];
    if i == pose { j } else { i }
}

/// All rows between poses that are not `passing`. Long ones are cut: the poses between their pieces
/// are no longer `passing`.
fn rows<G, const N: usize>(
    graph: &PoseGraph<G, N>,
    edges_of: &Lists<usize>,
    passing: &mut [bool],
) -> Vec<Row> {
    let mut rows = Vec::new();
    for first in (0..graph.poses.len()).filter(|&pose| !passing[pose]) {
        for &edge in edges_of.of(first).iter().filter(|edge| passing[other(graph, **edge, first)]) {
            let row = follow(graph, edges_of, passing, first, edge);
            // A row between two kept poses is met from both of its ends.
            let is_second = row.last().is_some_and(|last| {
                (last, row.between().next_back()) < (first, row.between().next())
            });
            if !is_second {
                rows.push(row);
            }
        }
    }
    let pieces: Vec<Row> = rows.into_iter().flat_map(Row::cut).collect();
    for pose in pieces.iter().filter_map(Row::last) {
        passing[pose] = false;
    }
    pieces
}

/// The row that begins at `first` with `edge`.
fn follow<G, const N: usize>(
    graph: &PoseGraph<G, N>,
    edges_of: &Lists<usize>,
    passing: &[bool],
    first: usize,
    edge: usize,
) -> Row {
    let (mut at, mut edge) = (first, edge);
    let mut steps = Vec::new();
    loop {
        let is_forward = graph.edges[edge].i == at;
        at = other(graph, edge, at);
        steps.push(Step { edge, is_forward, pose: at });
        if !passing[at] {
            return Row { first, steps, is_closed: true };
        }
        match edges_of.of(at).iter().find(|&&next| next != edge) {
            Some(&next) => edge = next,
            None => return Row { first, steps, is_closed: false },
        }
    }
}

impl<G: LieGroup<N>, const N: usize> Contraction<G, N> {
    /// Replaces the edges of rows by what their most probable paths measure at the poses of the
    /// contracted `graph`, where there is such a path.
    pub(super) fn measure(&mut self, graph: &mut PoseGraph<G, N>) {
        self.take(graph);
        let at_ends = |(row, near): &(Row, Bend<G, N>)| {
            let (steps, path) = self.bent(row, near);
            let bend = Bend::of(&steps, &path)?;
            let measured = bend.measurement();
            let information = Covariance::new(&measured.covariance).ok()?.information().ok()?;
            Some((bend, measured.motion, information))
        };
        let found = parallel::map(self.rows.iter(), at_ends);
        for (((_, near), edge), found) in self.rows.iter_mut().zip(&self.edges).zip(found) {
            let edge = edge.and_then(|edge| graph.edges.get_mut(edge));
            if let Some((edge, (bend, motion, information))) = edge.zip(found) {
                (edge.i_from_j, edge.information) = (motion, information);
                *near = bend;
            }
        }
    }

    /// Puts the whole graph back into `graph`, with the poses that it has by then; those in between
    /// are where they are most probable.
    pub(super) fn expand(mut self, graph: &mut PoseGraph<G, N>) {
        self.take(graph);
        let bent = parallel::map(self.rows.iter(), |(row, near)| self.bent(row, near).1.poses);
        let Self { mut full, rows, .. } = self;
        for ((row, _), poses) in rows.iter().zip(bent) {
            let first = full.poses[row.first];
            for (pose, value) in row.between().zip(poses) {
                full.poses[pose] = first.compose(&value);
            }
        }
        *graph = full;
    }

    /// Gives the kept poses of the whole graph the values of the contracted one.
    fn take(&mut self, graph: &PoseGraph<G, N>) {
        for (&pose, value) in self.kept.iter().zip(&graph.poses) {
            self.full.poses[pose] = *value;
        }
    }

    /// The steps of a row and the path along them between the kept poses.
    fn bent(&self, row: &Row, near: &Bend<G, N>) -> (Vec<UncertainMotion<G, N>>, Path<G, N>) {
        let steps: Vec<UncertainMotion<G, N>> = row.measured(&self.measured).flatten().collect();
        let first_from_world = self.full.poses[row.first].inverse();
        let end = row.last().map(|last| first_from_world.compose(&self.full.poses[last]));
        let path = bend(&steps, near, end.as_ref());
        (steps, path)
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

    /// A noisy walk of `count` poses with closures between `ends`.
    fn walk(count: usize, ends: &[(usize, usize)]) -> (PoseGraph<Se3, 6>, Vec<usize>) {
        let mut rng = seeded(5);
        let mut graph: PoseGraph<Se3, 6> = PoseGraph::new();
        let sigmas = Vector6::new(0.02, 0.01, 0.01, 0.002, 0.004, 0.002);
        let information = Information::from_sigmas(&sigmas).unwrap();
        let mut truth = vec![Se3::identity()];
        graph.push_pose(0, Se3::identity());
        graph.constant[0] = true;
        for k in 1..count {
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

    /// The cost at the optimum.
    fn solve(graph: &mut PoseGraph<Se3, 6>) -> f64 {
        let options = pose_graph::Options::default();
        pose_graph::solve(graph, &options, &mut ignore_iterations).unwrap().final_cost
    }

    /// Solves the contracted graph, measured anew four times; its cost is then that of the whole one.
    fn reaches(contraction: &mut Contraction<Se3, 6>, reduced: &mut PoseGraph<Se3, 6>, cost: f64) {
        solve(reduced);
        let costs = [(); 4].map(|()| {
            contraction.measure(reduced);
            solve(reduced)
        });
        assert!((costs[3] / cost - 1.0).abs() < 1e-5, "{costs:?} {cost}");
    }

    #[test]
    fn the_optimum_of_a_contracted_graph_is_that_of_the_whole_one() {
        let (graph, closures) = walk(200, &[(3, 120), (40, 180), (41, 181), (60, 150)]);
        let mut whole = graph.clone();
        let cost = solve(&mut whole);
        let (mut reduced, mut ends) = (graph.clone(), closures.clone());
        let measured = UncertainMotion::all(&graph);
        let contraction = contract(&mut reduced, measured, &mut ends).unwrap();
        assert_eq!((reduced.poses.len(), reduced.edges.len(), ends.len()), (9, 12, 4));
        assert_eq!(contraction.closures, closures);
        let reduced_cost = solve(&mut reduced);
        assert!((reduced_cost / cost - 1.0).abs() < 0.02, "{reduced_cost} {cost}");
        contraction.expand(&mut reduced);
        assert_eq!(reduced.edges, graph.edges);
        for (a, b) in reduced.poses.iter().zip(&whole.poses) {
            assert!(a.minus(b).norm() < 0.05, "{}", a.minus(b).norm());
        }
        // Measured anew, it is the same.
        let (mut reduced, mut ends) = (graph.clone(), closures);
        let mut contraction =
            contract(&mut reduced, UncertainMotion::all(&graph), &mut ends).unwrap();
        reaches(&mut contraction, &mut reduced, cost);
        contraction.expand(&mut reduced);
        for (a, b) in reduced.poses.iter().zip(&whole.poses) {
            assert!(a.minus(b).norm() < 1e-3, "{}", a.minus(b).norm());
        }
    }

    #[test]
    fn long_rows_are_cut() {
        let (graph, closures) = walk(2000, &[(3, 1200), (400, 1990), (1000, 1999)]);
        let cost = solve(&mut graph.clone());
        let (mut reduced, mut ends) = (graph.clone(), closures);
        let mut contraction =
            contract(&mut reduced, UncertainMotion::all(&graph), &mut ends).unwrap();
        let longest = contraction.rows.iter().map(|(row, _)| row.steps.len()).max();
        assert!(longest <= Some(MOST_STEPS) && contraction.rows.len() > 8, "{longest:?}");
        reaches(&mut contraction, &mut reduced, cost);
        contraction.expand(&mut reduced);
        let options = pose_graph::Options::default();
        let last = pose_graph::solve(&mut reduced, &options, &mut ignore_iterations).unwrap();
        assert!((last.initial_cost / cost - 1.0).abs() < 1e-4, "{} {cost}", last.initial_cost);
    }

    #[test]
    fn a_graph_of_closures_everywhere_stays_as_it_is() {
        let ends: Vec<(usize, usize)> = (0..110).map(|i| (i, i + 60)).collect();
        let (graph, closures) = walk(200, &ends);
        let (mut same, mut ends) = (graph.clone(), closures.clone());
        assert!(contract(&mut same, UncertainMotion::all(&graph), &mut ends).is_none());
        assert_eq!((same, ends), (graph, closures));
    }
}
