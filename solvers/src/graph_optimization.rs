//! A pose graph from its start to its result: a start, loop closures judged, a proof, the last solve.
//!
//! The stages of [`crate::initialization`], [`crate::robust`], [`crate::certificate`] and
//! [`crate::pose_graph`] in the order in which a service, a map and a command line want them, with one
//! clock and one deadline. Costs are those of the evaluator. No stage is done here.

use std::time::{Duration, Instant};

use nalgebra::Vector3;

use crate::certificate::{Certificate, certify};
use crate::evaluation::{CostReport, FactorCost, ReferencePose, ResidualReport, pose_graph_cost};
use crate::factors::RelativePose;
use crate::geometry::{LieGroup, RigidMotion, Se2, Se3};
use crate::initialization::{Start, align_to_priors, initialize_in_time};
use crate::interrupt::Interrupt;
use crate::optimizer::{self, IterationSummary, Observer, SolveSummary, ignore_iterations};
use crate::pose_graph;
use crate::price::Limits;
use crate::problem::{PoseGraph, SolveError};
pub use crate::robust::Judging;
use crate::robust::{
    self, ClosureVerdict, PositionJudging, PositionVerdict, RobustSummary, default_threshold,
    edge_variance_factor, judge_positions,
};

/// Position priors that do not fit, of how many, from which on the graph may be at fault: 2, and a tenth.
const LEAST_MISFITS: usize = 2;
const MISFIT_SHARE: usize = 10;

/// Which stages a graph goes through.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Where the poses come from that the first solve starts with.
    pub start: Start,
    /// How loop closures are judged; `None` trusts all of them.
    pub judging: Option<Judging>,
    /// How position priors are judged; `None` trusts all of them.
    pub positions: Option<PositionJudging>,
    /// Whether the last solve starts at the optimum of the chordal objective, which is proved. Given
    /// poses are solved before that too.
    pub certify: bool,
    /// Whether the evaluator counts the costs. It is independent of the solver and slower.
    pub costs: bool,
    /// Of each solve; the deadline is that of all together.
    pub optimizer: optimizer::Options,
}

impl Default for Options {
    /// One solve with the options of [`pose_graph`], no costs.
    fn default() -> Self {
        let optimizer = pose_graph::Options::default().optimizer;
        Self {
            start: Start::default(),
            judging: None,
            positions: None,
            certify: false,
            costs: false,
            optimizer,
        }
    }
}

/// What is proved of the chordal optimum where the last solve started.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proof {
    /// The proof.
    pub certificate: Certificate,
    /// How long it took.
    pub seconds: f64,
}

/// What [`optimize`] leaves besides the poses.
#[derive(Clone, Debug, PartialEq)]
pub struct Optimized {
    /// The last solve; its times count from the beginning of all.
    pub solve: SolveSummary,
    /// The start taken, never [`Start::Auto`].
    pub start: Start,
    /// How long the start took, where it was a stage of its own.
    pub start_seconds: Option<f64>,
    /// Costs at the poses that the graph came with, where closures are judged or the start is
    /// [`Start::Given`], else where the last solve started; of the edges at their weights. Zero without
    /// [`Options::costs`].
    pub before: CostReport,
    /// The same where it ended.
    pub after: CostReport,
    /// The verdicts, with χ² at the result.
    pub judged: Option<RobustSummary>,
    /// The verdict on each position prior where they are judged, with χ² at the result.
    pub positions: Vec<PositionVerdict>,
    /// By what the variance of all edges but the loop closures was multiplied, because true position priors
    /// contradicted them; 1 where nothing did. Costs count it.
    pub edge_variance_factor: f64,
    /// `None` without [`Options::certify`], and where there was no time for a proof.
    pub proof: Option<Proof>,
}

/// A pose whose graphs [`optimize`] takes: a motion of the plane or of space.
///
/// Its methods are those of concrete types, so that all stages are compiled once, in this crate with its
/// options, and not again in each crate that calls them.
pub trait GraphPose<const D: usize, const N: usize>: ReferencePose<N> + RigidMotion<D, N> {
    /// [`optimize`] for this pose.
    ///
    /// # Errors
    /// Those of [`optimize`].
    fn optimize(
        graph: &mut PoseGraph<Self, N>,
        has_poses: bool,
        options: &Options,
        interrupt: &Interrupt,
        observer: &mut Observer<'_>,
    ) -> Result<Optimized, SolveError>;
}

macro_rules! graph_pose {
    ($pose:ty, $space:literal, $tangent:literal) => {
        impl GraphPose<$space, $tangent> for $pose {
            fn optimize(
                graph: &mut PoseGraph<Self, $tangent>,
                has_poses: bool,
                options: &Options,
                interrupt: &Interrupt,
                observer: &mut Observer<'_>,
            ) -> Result<Optimized, SolveError> {
                Run { begin: Instant::now(), options, interrupt }.all(graph, has_poses, observer)
            }
        }
    };
}
graph_pose!(Se2, 2, 3);
graph_pose!(Se3, 3, 6);

/// Optimizes `graph` in place until `interrupt` is due; the best state by then is the answer.
///
/// `has_poses` is whether the graph came with poses. Without a constant pose and without priors the
/// lowest id is held. Pieces without a constant pose begin where their priors are met best
/// ([`align_to_priors`]).
/// `observer` sees the rows of the last solve; those of a robust solve once it has ended.
///
/// # Errors
/// Those of [`pose_graph::solve`], [`crate::initialization::initialize`], [`robust::solve`] and
/// [`crate::certificate::certify`].
pub fn optimize<G: GraphPose<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    has_poses: bool,
    options: &Options,
    interrupt: &Interrupt,
    observer: &mut Observer<'_>,
) -> Result<Optimized, SolveError> {
    G::optimize(graph, has_poses, options, interrupt, observer)
}

/// What placing a graph by its priors found.
struct Placed {
    verdicts: Vec<PositionVerdict>,
    /// The edges that are no loop closures.
    trusted: Vec<usize>,
    edge_variance_factor: f64,
}

/// Where the variables of a graph are.
struct State<G> {
    poses: Vec<G>,
    landmarks: Vec<Vector3<f64>>,
}

impl<G: Copy> State<G> {
    fn of<const N: usize>(graph: &PoseGraph<G, N>) -> Self {
        Self { poses: graph.poses.clone(), landmarks: graph.landmarks.positions.clone() }
    }
}

/// Multiplies the information of these edges.
fn scale<G, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    edges: impl Iterator<Item = usize>,
    factor: f64,
) {
    for edge in edges {
        let edge = &mut graph.edges[edge];
        edge.information = edge.information.scaled(factor);
    }
}

struct Run<'a> {
    begin: Instant,
    options: &'a Options,
    interrupt: &'a Interrupt,
}

impl Run<'_> {
    fn limits(&self) -> Limits<'_> {
        Limits { ceiling: self.options.optimizer.ceiling, interrupt: self.interrupt }
    }

    fn all<G: GraphPose<D, N>, const D: usize, const N: usize>(
        &self,
        graph: &mut PoseGraph<G, N>,
        has_poses: bool,
        observer: &mut Observer<'_>,
    ) -> Result<Optimized, SolveError> {
        graph.hold_gauge();
        let begins_there = self.options.judging.is_some() || self.options.start == Start::Given;
        let came_with = (has_poses && begins_there && self.options.costs).then(|| State::of(graph));
        if !graph.has_priors() {
            let optimized = self.stages(graph, has_poses, observer)?;
            return Ok(self.since(graph, came_with, optimized));
        }
        let Placed { mut verdicts, trusted, edge_variance_factor } =
            self.place(graph, has_poses)?;
        let stated: Vec<_> = graph.edges.iter().map(|edge| edge.information).collect();
        scale(graph, trusted.into_iter(), 1.0 / edge_variance_factor);
        let all = graph.position_priors.clone();
        let mut judged = verdicts.iter();
        graph
            .position_priors
            .retain(|_| judged.next().is_none_or(|verdict| !verdict.is_switched_off));
        let optimized = self.stages(graph, true, observer);
        let optimized = optimized.map(|optimized| self.since(graph, came_with, optimized));
        graph.position_priors = all;
        for (edge, stated) in graph.edges.iter_mut().zip(stated) {
            edge.information = stated;
        }
        for (prior, verdict) in graph.position_priors.iter().zip(&mut verdicts) {
            verdict.chi2 = prior.chi2(&graph.poses[prior.pose]);
        }
        Ok(Optimized { positions: verdicts, edge_variance_factor, ..optimized? })
    }

    /// With the costs of the poses that the graph came with, in place of those of a start that was made.
    fn since<G: ReferencePose<N>, const N: usize>(
        &self,
        graph: &PoseGraph<G, N>,
        came_with: Option<State<G>>,
        optimized: Optimized,
    ) -> Optimized {
        let Some(State { poses, landmarks }) = came_with else { return optimized };
        let closures = optimized.judged.as_ref().map_or(&[][..], |judged| &judged.closures);
        let mut kept = PoseGraph { poses, ..robust::weighted(graph, closures) };
        kept.landmarks.positions = landmarks;
        Optimized { before: self.cost(&kept), ..optimized }
    }

    fn cost<G: ReferencePose<N>, const N: usize>(&self, graph: &PoseGraph<G, N>) -> CostReport {
        if self.options.costs { pose_graph_cost(graph) } else { CostReport::default() }
    }

    fn stages<G: GraphPose<D, N>, const D: usize, const N: usize>(
        &self,
        graph: &mut PoseGraph<G, N>,
        has_poses: bool,
        observer: &mut Observer<'_>,
    ) -> Result<Optimized, SolveError> {
        match &self.options.judging {
            None => self.plain(graph, has_poses, observer),
            Some(judging) => self.robust(graph, has_poses, judging, observer),
        }
    }

    /// Moves the poses to the start, brought to the priors, and on to the optimum of the position
    /// priors that are found true; the verdicts on these. Loop closures that are judged later take no
    /// part, since they may be false too.
    fn place<G: RigidMotion<D, N>, const D: usize, const N: usize>(
        &self,
        graph: &mut PoseGraph<G, N>,
        has_poses: bool,
    ) -> Result<Placed, SolveError> {
        let trusted = self.options.judging.as_ref().map(|judging| &judging.trusted);
        let is_closure = |edge: &usize| {
            let RelativePose { i, j, .. } = graph.edges[*edge];
            let is_judged = trusted.is_some_and(|trusted| trusted.binary_search(edge).is_err());
            is_judged && graph.ids[i].abs_diff(graph.ids[j]) > 1
        };
        let left_out = |edge| ClosureVerdict {
            edge,
            chi2: 0.0,
            weight: 0.0,
            is_supported: false,
            is_switched_off: true,
            is_provisional: false,
        };
        let closures: Vec<ClosureVerdict> =
            (0..graph.edges.len()).filter(is_closure).map(left_out).collect();
        let start = match self.options.start {
            Start::Auto if has_poses => Start::Given,
            Start::Auto => Start::Odometry,
            other @ (Start::Given | Start::Odometry | Start::SpanningTree | Start::Chordal) => {
                other
            }
        };
        graph.validate()?;
        let mut copy = robust::weighted(graph, &closures);
        initialize_in_time(&mut copy, start, has_poses, self.limits())?;
        align_to_priors(&mut copy);
        let start = copy.clone();
        let mut verdicts = self.judge_positions(&mut copy)?;
        let trusted = (0..graph.edges.len()).filter(|edge| !is_closure(edge)).collect();
        let mut factor = 1.0;
        if self.contradict(&verdicts) {
            let options = self.pose_graph_options();
            let mut larger = edge_variance_factor(&mut start.clone(), &options, self.interrupt)?;
            // More than the median may fit with a still larger factor; what is false stays false.
            while larger > factor && larger <= robust::MAX_FACTOR && self.contradict(&verdicts) {
                let mut scaled = start.clone();
                let edges = 0..scaled.edges.len();
                scale(&mut scaled, edges, 1.0 / larger);
                let found = self.judge_positions(&mut scaled)?;
                if self.misfits(&found) >= self.misfits(&verdicts) {
                    break;
                }
                (copy, verdicts, factor) = (scaled, found, larger);
                larger *= robust::STEP;
            }
        }
        graph.poses = copy.poses;
        graph.landmarks.positions = copy.landmarks.positions;
        Ok(Placed { verdicts, trusted, edge_variance_factor: factor })
    }

    /// How many position priors do not fit.
    fn misfits(&self, verdicts: &[PositionVerdict]) -> usize {
        let threshold = self.options.positions.as_ref().and_then(|positions| positions.threshold);
        let threshold = threshold.unwrap_or_else(|| default_threshold(3));
        verdicts.iter().filter(|verdict| verdict.chi2 > threshold).count()
    }

    /// Whether so many position priors do not fit that the graph may be at fault.
    fn contradict(&self, verdicts: &[PositionVerdict]) -> bool {
        let misfits = self.misfits(verdicts);
        misfits >= LEAST_MISFITS && MISFIT_SHARE * misfits >= verdicts.len()
    }

    fn pose_graph_options(&self) -> pose_graph::Options {
        let passed = self.begin.elapsed();
        let mut optimizer = self.options.optimizer;
        optimizer.deadline = optimizer.deadline.map(|deadline| deadline.saturating_sub(passed));
        pose_graph::Options { optimizer }
    }

    fn judge_positions<G: LieGroup<N>, const N: usize>(
        &self,
        graph: &mut PoseGraph<G, N>,
    ) -> Result<Vec<PositionVerdict>, SolveError> {
        let Some(positions) = &self.options.positions else { return Ok(Vec::new()) };
        if graph.position_priors.is_empty() {
            return Ok(Vec::new());
        }
        judge_positions(graph, positions, &self.pose_graph_options(), self.interrupt)
    }

    fn plain<G: GraphPose<D, N>, const D: usize, const N: usize>(
        &self,
        graph: &mut PoseGraph<G, N>,
        has_poses: bool,
        observer: &mut Observer<'_>,
    ) -> Result<Optimized, SolveError> {
        let start = initialize_in_time(graph, self.options.start, has_poses, self.limits())?;
        if start != Start::Given {
            align_to_priors(graph);
        }
        let start_seconds = Some(self.begin.elapsed().as_secs_f64());
        if self.options.certify && start == Start::Given {
            // The proof is looked for near a solution, and there is one if it takes too long.
            self.last(graph, &mut ignore_iterations)?;
        }
        let proof = self.prove(graph)?;
        let (solve, before) = self.last(graph, observer)?;
        let after = self.cost(graph);
        Ok(Optimized {
            solve,
            start,
            start_seconds,
            before,
            after,
            judged: None,
            positions: Vec::new(),
            edge_variance_factor: 1.0,
            proof,
        })
    }

    fn robust<G: GraphPose<D, N>, const D: usize, const N: usize>(
        &self,
        graph: &mut PoseGraph<G, N>,
        has_poses: bool,
        judging: &Judging,
        observer: &mut Observer<'_>,
    ) -> Result<Optimized, SolveError> {
        let options = pose_graph::Options { optimizer: self.options.optimizer };
        let (start, interrupt) = (self.options.start, self.interrupt);
        let rows = &mut ignore_iterations;
        let given = if graph.has_priors() { graph.poses.clone() } else { Vec::new() };
        let mut judged =
            robust::solve(graph, start, has_poses, judging, &options, interrupt, rows)?;
        let mut kept = robust::weighted(graph, &judged.closures);
        let (solve, before, after, proof) = if self.options.certify {
            let proof = self.prove(&mut kept)?;
            let (solve, before) = self.last(&mut kept, observer)?;
            let after = self.cost(&kept);
            graph.poses = kept.poses;
            for verdict in &mut judged.closures {
                let edge = &graph.edges[verdict.edge];
                verdict.chi2 = edge.chi2(&graph.poses[edge.i], &graph.poses[edge.j]);
            }
            (solve, before, after, proof)
        } else {
            for row in &judged.solve.iterations {
                // It has ended: there is nothing to cancel.
                let _control = observer(row);
            }
            let after = self.cost(&kept);
            // The poses of its start are gone, but its cost is known, and it is of one kind.
            let initial = judged.solve.initial_cost;
            let relative_pose = FactorCost { cost: initial, ..after.relative_pose };
            let before = match self.options.costs {
                true if graph.has_priors() => {
                    // It is of several kinds: they are counted where the judging began.
                    self.cost(&PoseGraph { poses: given, ..kept })
                }
                true => {
                    let residuals = ResidualReport::default();
                    CostReport { total: initial, relative_pose, residuals, ..after }
                }
                false => after,
            };
            (judged.solve.clone(), before, after, None)
        };
        let (start, judged) = (judged.start, Some(judged));
        Ok(Optimized {
            solve,
            start,
            start_seconds: None,
            before,
            after,
            judged,
            positions: Vec::new(),
            edge_variance_factor: 1.0,
            proof,
        })
    }

    /// Moves the poses to the chordal optimum, where that is asked for and there is time.
    fn prove<G: RigidMotion<D, N>, const D: usize, const N: usize>(
        &self,
        graph: &mut PoseGraph<G, N>,
    ) -> Result<Option<Proof>, SolveError> {
        if !self.options.certify {
            return Ok(None);
        }
        let begin = Instant::now();
        match certify(graph, self.limits()) {
            Err(SolveError::Interrupted) => Ok(None),
            certified => {
                let certificate = certified?;
                Ok(Some(Proof { certificate, seconds: begin.elapsed().as_secs_f64() }))
            }
        }
    }

    /// A solve on the clock of all, with the costs of its start; what is left of the deadline is its
    /// own.
    fn last<G: GraphPose<D, N>, const D: usize, const N: usize>(
        &self,
        graph: &mut PoseGraph<G, N>,
        observer: &mut Observer<'_>,
    ) -> Result<(SolveSummary, CostReport), SolveError> {
        let before = self.cost(graph);
        let passed = self.begin.elapsed();
        let left = |deadline: Duration| deadline.saturating_sub(passed);
        let mut optimizer = self.options.optimizer;
        optimizer.deadline = optimizer.deadline.map(left);
        let later = |row: &IterationSummary| IterationSummary {
            seconds: row.seconds + passed.as_secs_f64(),
            ..*row
        };
        let options = pose_graph::Options { optimizer };
        let mut rows = |row: &IterationSummary| observer(&later(row));
        let mut solve = pose_graph::solve_until(graph, &options, self.interrupt, &mut rows)?;
        solve.solve_seconds += passed.as_secs_f64();
        solve.iterations.iter_mut().for_each(|row| *row = later(row));
        Ok((solve, before))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_those_of_a_pose_graph() {
        // Those of the optimizer alone take twice the iterations to the optimum of city10000.
        assert_eq!(Options::default().optimizer, pose_graph::Options::default().optimizer);
    }
}
