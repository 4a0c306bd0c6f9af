//! Pose graphs with false loop closures.
//!
//! Odometry, the edges between consecutive ids, is trusted; every other edge is a loop closure and may
//! be false. There are three stages: `screening` finds closures that agree with a neighbor over a short
//! loop of odometry (after Mangelson et al. 2018); graduated non-convexity weighs those (`graduated`,
//! after Yang et al. 2020); then every closure, supported or not, is judged by its χ² at the solution,
//! and the graph is solved again with those that pass, until none changes. Where closures are switched
//! off, `candidates` begins again with more of them and keeps the better result. This file holds what
//! they share; `variance` finds how far the stated information may be believed. All of it is a function
//! of what was measured. It solves through [`crate::pose_graph`] and must not weight odometry.
//!
//! | file | role |
//! |---|---|
//! | `chain`, `contraction`, `bending` | the odometry of a graph; the graph without poses that have only odometry; poses along a row of steps whose end is known |
//! | `screening` | closures beside their neighbors and the odometry |
//! | `graduated` | weights of graduated non-convexity |
//! | `judging`, `candidates` | the stages, and the results to choose from |
//! | `variance`, `edge_variance` | how far stated information may be believed |
//! | `positions` | false position priors |

mod bending;
mod candidates;
mod chain;
mod contraction;
mod edge_variance;
mod graduated;
mod judging;
mod positions;
mod screening;
mod variance;

use std::time::Instant;

use chain::UncertainMotion;
use contraction::{Contraction, contract};
pub use edge_variance::edge_variance_factor;
pub(crate) use edge_variance::{MAX_FACTOR, STEP};
pub use graduated::Kernel;
pub use positions::{PositionJudging, PositionVerdict, judge_positions};
use screening::{Screened, screen};
pub use variance::{VarianceFactors, variance_factors};

use crate::factors::{PosePrior, PositionPrior, RelativePose};
use crate::geometry::{LieGroup, RigidMotion};
use crate::initialization::{Start, align_to_priors, initialize_in_time};
use crate::interrupt::Interrupt;
use crate::optimizer::{
    self, Observer, SolveSummary, Termination, ignore_iterations, with_threads,
};
use crate::pose_graph;
use crate::price::Limits;
use crate::problem::{PoseGraph, SolveError};

/// Weight of a switched-off closure that is the only connection of two parts of the graph.
const BRIDGE_WEIGHT: f64 = 1e-6;

/// Initial damping of the solve of a whole graph from the optimum of the contracted one. The softest
/// modes of a row of n poses have n⁻⁴ of the stiffness of a pose, and a step that is to move them may not
/// be damped by more: this much is about the rounding of the matrix.
const NEAR_DAMPING: f64 = 1e-16;

/// Most times that the rows which were left out are measured anew; three as a rule.
const MAX_REFINEMENTS: usize = 10;

/// The relative decrease of the cost that ends this: one step of the whole graph takes the rest.
const REFINED: f64 = 1e-6;

/// How loop closures are judged.
#[derive(Clone, Debug, PartialEq)]
pub struct Judging {
    /// How weights follow from residuals.
    pub kernel: Kernel,
    /// The largest χ² of a true closure; `None` takes the 99 % quantile for its dimension.
    pub threshold: Option<f64>,
    /// Edges that are trusted although their ids are not consecutive, rising.
    pub trusted: Vec<usize>,
    /// Whether the covariances of the odometry hold, so that it may judge closures (false). One that no
    /// neighbor supports and that the odometry does not explain then counts only if it fits the solution
    /// without it: alone it would bend the odometry, true or not. And what the odometry explains is a
    /// second start of the judgment; of the two results that of the lower objective is taken.
    pub trust_odometry: bool,
}

impl Judging {
    /// The defaults with `kernel`.
    #[must_use]
    pub fn new(kernel: Kernel) -> Self {
        Self { kernel, threshold: None, trusted: Vec::new(), trust_odometry: false }
    }
}

/// The verdict on a loop closure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosureVerdict {
    /// Index of the edge.
    pub edge: usize,
    /// χ² = rᵀΩr at the result.
    pub chi2: f64,
    /// Its weight in the result, from 0 (switched off) to 1.
    pub weight: f64,
    /// Whether it closed a short loop with a neighbor.
    pub is_supported: bool,
    /// Whether it does not count: χ² above the threshold.
    pub is_switched_off: bool,
    /// Whether it is switched off and no other closure joins its places, so that nothing but the
    /// odometry speaks against it.
    pub is_provisional: bool,
}

/// The outcome of [`solve`].
#[derive(Clone, Debug, PartialEq)]
pub struct RobustSummary {
    /// The last solve; its costs are those of the edges at their weights.
    pub solve: SolveSummary,
    /// The start that the result came from, never [`Start::Auto`].
    pub start: Start,
    /// Every loop closure, in edge order.
    pub closures: Vec<ClosureVerdict>,
    /// The largest χ² that a closure may have.
    pub threshold: f64,
    /// Solves in all.
    pub solves: usize,
}

/// Optimizes `graph` in place over odometry and the closures that are found true.
///
/// `start` is that of the first of several results, of which that of the lowest objective is taken;
/// [`Start::Auto`] makes one from odometry and supported closures only; `has_poses` is whether the
/// graph came with poses. `options` are those of each solve within; the deadline is that of all
/// together. The graph's own loss holds for every edge on top. Gauge and determinism are those of
/// [`pose_graph::solve`]; `observer` sees the rows of every solve. It ends once `interrupt` is due,
/// within a stage and within its solves. The result is what the stages found until then; if they found
/// nothing, it is the given poses, or the odometry of a graph without poses.
///
/// # Errors
/// Those of [`pose_graph::solve`] and [`initialize`](crate::initialization::initialize);
/// [`SolveError::InvalidOption`] for a threshold that is not finite and positive, and for a graph with
/// landmarks.
pub fn solve<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    start: Start,
    has_poses: bool,
    judging: &Judging,
    options: &pose_graph::Options,
    interrupt: &Interrupt,
    observer: &mut Observer<'_>,
) -> Result<RobustSummary, SolveError> {
    let begin = Instant::now();
    let interrupt = interrupt.or_after(begin, options.optimizer.deadline);
    graph.validate()?;
    let threshold = judging.threshold.unwrap_or_else(|| default_threshold(N));
    if !(threshold.is_finite() && threshold > 0.0) {
        let reason = "must be finite and positive";
        return Err(SolveError::InvalidOption { field: "threshold", reason });
    }
    if graph.has_measured() {
        let reason = "loop closures of a graph with landmarks or ranges cannot be judged";
        return Err(SolveError::InvalidOption { field: "robust", reason });
    }
    graph.hold_gauge();
    with_threads(options.optimizer.threads, || {
        let mut weighted = Weighted::new(graph, judging, options, threshold, begin, &interrupt);
        weighted.best(start, has_poses, judging.trust_odometry, observer)
    })?
}

/// Bytes of the weighted copy, of states that may be restored, and of the screening.
fn copies_bytes<G, const N: usize>(graph: &PoseGraph<G, N>) -> u64 {
    let edge = size_of::<RelativePose<G, N>>() + 2 * (size_of::<G>() + 8 * N * N) + 160;
    let pose = 4 * size_of::<G>() + 64;
    let priors = graph.pose_priors.len() * size_of::<PosePrior<G, N>>()
        + graph.position_priors.len() * size_of::<PositionPrior>();
    (graph.edges.len() * edge + graph.poses.len() * pose + priors) as u64
}

/// What [`solve`] minimized at its end: the edges of `graph` with `closures` at their weights, in one
/// piece. A switched-off closure that is the only connection of two parts keeps a millionth of its
/// weight.
#[must_use]
pub fn weighted<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    closures: &[ClosureVerdict],
) -> PoseGraph<G, N> {
    at_weights(graph, closures.iter().map(|verdict| (verdict.edge, verdict.weight)))
}

fn at_weights<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    closures: impl Iterator<Item = (usize, f64)>,
) -> PoseGraph<G, N> {
    let mut weights = vec![1.0; graph.edges.len()];
    for (edge, weight) in closures {
        if let Some(of_edge) = weights.get_mut(edge) {
            *of_edge = weight;
        }
    }
    let mut copy = PoseGraph {
        ids: graph.ids.clone(),
        poses: graph.poses.clone(),
        constant: graph.constant.clone(),
        edges: Vec::with_capacity(graph.edges.len()),
        pose_priors: graph.pose_priors.clone(),
        position_priors: graph.position_priors.clone(),
        landmarks: graph.landmarks.clone(),
        ranges: graph.ranges.clone(),
        loss: graph.loss,
    };
    let mut pieces = graph.ties();
    // Poses with a place in the world belong to one piece.
    pieces.join_all(graph.placed());
    for (edge, &weight) in graph.edges.iter().zip(&weights) {
        if weight > 0.0 {
            pieces.join(edge.i, edge.j);
            let information = edge.information.scaled(weight);
            copy.edges.push(RelativePose { information, ..*edge });
        }
    }
    for (edge, &weight) in graph.edges.iter().zip(&weights) {
        if weight <= 0.0 && pieces.join(edge.i, edge.j) {
            let information = edge.information.scaled(BRIDGE_WEIGHT);
            copy.edges.push(RelativePose { information, ..*edge });
        }
    }
    copy
}

/// A graph whose closures have weights.
struct Weighted<'a, G, const N: usize> {
    graph: &'a mut PoseGraph<G, N>,
    kernel: Kernel,
    threshold: f64,
    /// Indices of the closures, rising.
    closures: Vec<usize>,
    /// One per closure.
    screened: Vec<Screened>,
    /// Which count only if they fit the solution without them; one per closure.
    held_back: Vec<bool>,
    /// One per closure.
    weights: Vec<f64>,
    /// One per edge, until the graph is contracted.
    measured: Vec<Option<UncertainMotion<G, N>>>,
    solves: usize,
    begin: Instant,
    interrupt: &'a Interrupt,
    /// Whether a solve was canceled or ran out of time: the stages end then.
    is_stopped: bool,
    options: pose_graph::Options,
    /// Bytes that are used besides each solve.
    copies: u64,
}

impl<'a, G: LieGroup<N>, const N: usize> Weighted<'a, G, N> {
    fn new(
        graph: &'a mut PoseGraph<G, N>,
        judging: &Judging,
        options: &pose_graph::Options,
        threshold: f64,
        begin: Instant,
        interrupt: &'a Interrupt,
    ) -> Self {
        let is_closure = |&edge: &usize| {
            let RelativePose { i, j, .. } = graph.edges[edge];
            graph.ids[i].abs_diff(graph.ids[j]) > 1 && judging.trusted.binary_search(&edge).is_err()
        };
        let closures: Vec<usize> = (0..graph.edges.len()).filter(is_closure).collect();
        let measured = UncertainMotion::all(graph);
        let screened = screen(graph, &measured, &closures, threshold, interrupt);
        let held_back = |seen: &Screened| {
            let is_strained = seen.odometry_chi2.is_some_and(|chi2| chi2 > threshold);
            judging.trust_odometry && !seen.is_supported && is_strained
        };
        let held_back = screened.iter().map(held_back).collect();
        let copies = copies_bytes(graph);
        let mut weighted = Self {
            graph,
            kernel: judging.kernel,
            threshold,
            weights: vec![1.0; closures.len()],
            closures,
            screened,
            held_back,
            measured,
            solves: 0,
            begin,
            interrupt,
            is_stopped: false,
            options: *options,
            copies,
        };
        weighted.weigh_by_support();
        weighted
    }

    /// Does `stages` on the graph without the poses that only pass odometry on, and puts these where they
    /// are most probable; false where it has too few of them and is left whole.
    fn contracted(
        &mut self,
        stages: impl FnOnce(&mut Self) -> Result<(), SolveError>,
    ) -> Result<bool, SolveError> {
        let measured = std::mem::take(&mut self.measured);
        let contraction = contract(self.graph, measured, &mut self.closures);
        let mut outcome = stages(self);
        let is_contracted = contraction.is_some();
        if let Some(mut contraction) = contraction {
            outcome = outcome.and_then(|()| self.refine(&mut contraction));
            self.closures = std::mem::take(&mut contraction.closures);
            contraction.expand(self.graph);
        }
        outcome.map(|()| is_contracted)
    }

    /// Brings the poses of the contracted graph to the optimum of the whole one at the present weights:
    /// each row is measured anew at the ends that it has come to, until the cost stays.
    fn refine(&mut self, contraction: &mut Contraction<G, N>) -> Result<(), SolveError> {
        let mut options = self.options;
        options.optimizer.initial_damping = options.optimizer.initial_damping.min(NEAR_DAMPING);
        let mut best = (f64::INFINITY, self.graph.poses.clone());
        for _ in 0..MAX_REFINEMENTS {
            if self.is_stopped {
                break;
            }
            contraction.measure(self.graph);
            let begin = self.graph.poses.clone();
            let solved = self.solve(&options, &mut ignore_iterations)?;
            if solved.initial_cost >= best.0 {
                self.graph.poses = best.1;
                break;
            }
            best = (solved.initial_cost, begin);
            if solved.initial_cost - solved.final_cost <= REFINED * solved.initial_cost {
                break;
            }
        }
        Ok(())
    }

    fn weighted_graph(&self) -> PoseGraph<G, N> {
        at_weights(self.graph, self.closures.iter().copied().zip(self.weights.iter().copied()))
    }

    fn start<const D: usize>(&mut self, start: Start, has_poses: bool) -> Result<Start, SolveError>
    where
        G: RigidMotion<D, N>,
    {
        let mut copy = self.weighted_graph();
        let any = self.has_support();
        let wished = match start {
            // The poses of a file often come from all closures, the false ones among them.
            Start::Auto if any => Start::Chordal,
            Start::Auto => Start::Odometry,
            other @ (Start::Given | Start::Odometry | Start::SpanningTree | Start::Chordal) => {
                other
            }
        };
        let ceiling = self.options.optimizer.ceiling;
        let limits = Limits { ceiling, interrupt: self.interrupt }.less(self.copies);
        let taken = initialize_in_time(&mut copy, wished, has_poses, limits)
            .map_err(|error| error.beside(self.copies))?;
        if taken != Start::Given {
            align_to_priors(&mut copy);
        }
        self.graph.poses = copy.poses;
        Ok(taken)
    }

    /// χ² of an edge at the poses.
    fn chi2_of(&self, edge: usize) -> f64 {
        let edge = &self.graph.edges[edge];
        edge.chi2(&self.graph.poses[edge.i], &self.graph.poses[edge.j])
    }

    /// χ² of each closure at the poses.
    fn chi2(&self) -> Vec<f64> {
        self.closures.iter().map(|&edge| self.chi2_of(edge)).collect()
    }

    fn solve(
        &mut self,
        options: &pose_graph::Options,
        observer: &mut Observer<'_>,
    ) -> Result<SolveSummary, SolveError> {
        let mut copy = self.weighted_graph();
        // The interrupt has the deadline of all solves together.
        let ceiling = options.optimizer.ceiling.less(self.copies);
        let whole = optimizer::Options { deadline: None, threads: None, ..options.optimizer };
        let optimizer = optimizer::Options { ceiling, ..whole };
        let options = pose_graph::Options { optimizer };
        let summary = pose_graph::solve_until(&mut copy, &options, self.interrupt, observer)
            .map_err(|error| error.beside(self.copies))?;
        self.graph.poses = copy.poses;
        self.solves += 1;
        self.is_stopped |=
            matches!(summary.termination, Termination::Cancelled | Termination::Deadline);
        Ok(summary)
    }

    /// The outcome, `solve` the last one; its clock is set to the beginning of all.
    fn summary(&self, mut solve: SolveSummary, start: Start) -> RobustSummary {
        let before = self.begin.elapsed().as_secs_f64() - solve.solve_seconds;
        solve.solve_seconds += before;
        solve.iterations.iter_mut().for_each(|row| row.seconds += before);
        let closures = self.verdicts();
        RobustSummary { solve, start, closures, threshold: self.threshold, solves: self.solves }
    }

    fn verdicts(&self) -> Vec<ClosureVerdict> {
        let chi2 = self.chi2();
        let verdict = |(k, &edge): (usize, &usize)| {
            let is_switched_off = chi2[k] > self.threshold || chi2[k].is_nan();
            ClosureVerdict {
                edge,
                chi2: chi2[k],
                weight: self.weights[k],
                is_supported: self.screened[k].is_supported,
                is_switched_off,
                is_provisional: is_switched_off && !self.screened[k].has_neighbor,
            }
        };
        self.closures.iter().enumerate().map(verdict).collect()
    }
}

/// The threshold where none is given: the 99 % quantile of χ² with `dimension` degrees of freedom, by
/// Wilson and Hilferty's cube.
#[must_use]
pub fn default_threshold(dimension: usize) -> f64 {
    let n = dimension as f64;
    let spread = 2.0 / (9.0 * n);
    n * (1.0 - spread + 2.326_347_874 * spread.sqrt()).powi(3)
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_quantile_is_that_of_tables() {
        for (dimension, table) in [(3, 11.345), (6, 16.812), (7, 18.475)] {
            assert!((super::default_threshold(dimension) / table - 1.0).abs() < 3e-3);
        }
    }
}
