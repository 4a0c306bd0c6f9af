//! Pose graphs with false loop closures.
//!
//! Odometry, the edges between consecutive ids, is trusted; every other edge is a loop closure and
//! may be false. Three stages: closures that agree with a neighbor over a short loop of odometry are
//! looked for (`screening`, after Mangelson et al. 2018); graduated non-convexity weighs those
//! (`graduated`, after Yang et al. 2020); then every closure, supported or not, is judged by its χ²
//! at the solution, and the graph is solved again with those that pass, until none changes. This
//! file holds the stages. It solves through [`crate::pose_graph`] and must not weigh odometry.

mod graduated;
mod screening;

use std::time::Instant;

pub use graduated::Kernel;

use crate::factors::RelativePose;
use crate::geometry::{LieGroup, RigidMotion};
use crate::initialization::{Start, initialize};
use crate::optimizer::{self, Observer, SolveSummary, ignore_iterations, with_threads};
use crate::pose_graph;
use crate::problem::{PoseGraph, SolveError};

/// Rounds of judging all closures after the weights have settled.
const MAX_JUDGMENTS: usize = 20;

/// Weight of a switched-off closure that alone ties two parts of the graph together.
const BRIDGE_WEIGHT: f64 = 1e-6;

/// Options of a robust solve.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// How weights follow from residuals.
    pub kernel: Kernel,
    /// The largest χ² of a true closure; `None` takes the 99 % quantile for its dimension.
    pub threshold: Option<f64>,
    /// The start; [`Start::Auto`] makes one from odometry and supported closures only.
    pub start: Start,
    /// Edges that are trusted although their ids are not consecutive, rising.
    pub trusted: Vec<usize>,
    /// Options of each solve within.
    pub pose_graph: pose_graph::Options,
}

impl Options {
    /// The defaults with `kernel`.
    #[must_use]
    pub fn new(kernel: Kernel) -> Self {
        Self {
            kernel,
            threshold: None,
            start: Start::Auto,
            trusted: Vec::new(),
            pose_graph: pose_graph::Options::default(),
        }
    }
}

/// What became of a loop closure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// Index of the edge.
    pub edge: usize,
    /// χ² = rᵀΩr at the result.
    pub chi2: f64,
    /// Its weight in the result, from 0 (switched off) to 1.
    pub weight: f64,
    /// Whether it closed a short loop with a neighbor.
    pub is_supported: bool,
    /// Whether it was found false: χ² above the threshold.
    pub is_switched_off: bool,
}

/// The outcome of [`solve`].
#[derive(Clone, Debug, PartialEq)]
pub struct RobustSummary {
    /// The last solve; its costs are those of the edges at their weights.
    pub solve: SolveSummary,
    /// The start taken, never [`Start::Auto`].
    pub start: Start,
    /// Every loop closure, in edge order.
    pub closures: Vec<Verdict>,
    /// The largest χ² that a closure may have.
    pub threshold: f64,
    /// Solves in all.
    pub solves: usize,
}

/// Optimizes `graph` in place over odometry and the closures that are found true.
///
/// The graph's own loss holds for every edge on top. Gauge and determinism are those of
/// [`pose_graph::solve`]; `observer` sees the last solve.
///
/// # Errors
/// Those of [`pose_graph::solve`] and [`initialize`]; [`SolveError::InvalidOption`] for a threshold
/// that is not finite and positive.
pub fn solve<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    has_poses: bool,
    options: &Options,
    observer: &mut Observer<'_>,
) -> Result<RobustSummary, SolveError> {
    let begin = Instant::now();
    graph.validate()?;
    let threshold = options.threshold.unwrap_or_else(|| chi2_99(N));
    if !(threshold.is_finite() && threshold > 0.0) {
        let reason = "must be finite and positive";
        return Err(SolveError::InvalidOption { field: "threshold", reason });
    }
    if !graph.constant.contains(&true) {
        graph.fix_lowest_id();
    }
    with_threads(options.pose_graph.optimizer.threads, || {
        let mut weighted = Weighted::new(graph, options, threshold);
        let start = weighted.start(options.start, has_poses)?;
        weighted.graduate(options.kernel)?;
        let (mut solve, solves) = weighted.judge(options.kernel, observer)?;
        let before = begin.elapsed().as_secs_f64() - solve.solve_seconds;
        solve.solve_seconds += before;
        solve.iterations.iter_mut().for_each(|row| row.seconds += before);
        let closures = weighted.verdicts();
        Ok(RobustSummary { solve, start, closures, threshold, solves })
    })?
}

/// A graph whose closures have weights.
struct Weighted<'a, G, const N: usize> {
    graph: &'a mut PoseGraph<G, N>,
    options: pose_graph::Options,
    threshold: f64,
    /// Indices of the closures, rising.
    closures: Vec<usize>,
    is_supported: Vec<bool>,
    /// One a closure.
    weights: Vec<f64>,
    solves: usize,
}

impl<'a, G: LieGroup<N>, const N: usize> Weighted<'a, G, N> {
    fn new(graph: &'a mut PoseGraph<G, N>, options: &Options, threshold: f64) -> Self {
        let is_closure = |&edge: &usize| {
            let RelativePose { i, j, .. } = graph.edges[edge];
            graph.ids[i].abs_diff(graph.ids[j]) > 1 && options.trusted.binary_search(&edge).is_err()
        };
        let closures: Vec<usize> = (0..graph.edges.len()).filter(is_closure).collect();
        let is_supported = screening::supported(graph, &closures, threshold);
        let any = is_supported.contains(&true);
        // Without a single supported closure there is nothing to tell them apart by.
        let weights = is_supported.iter().map(|&s| if s || !any { 1.0 } else { 0.0 }).collect();
        let mut inner = options.pose_graph;
        inner.optimizer.threads = None;
        Self { graph, options: inner, threshold, closures, is_supported, weights, solves: 0 }
    }

    /// The edges at their weights, as a graph of its own in one piece.
    fn weighted_graph(&self) -> PoseGraph<G, N> {
        let mut weights = vec![1.0; self.graph.edges.len()];
        for (&edge, &weight) in self.closures.iter().zip(&self.weights) {
            weights[edge] = weight;
        }
        let mut copy = PoseGraph {
            ids: self.graph.ids.clone(),
            poses: self.graph.poses.clone(),
            constant: self.graph.constant.clone(),
            edges: Vec::with_capacity(self.graph.edges.len()),
            loss: self.graph.loss,
        };
        let mut pieces = Pieces::new(&copy.constant);
        for (edge, &weight) in self.graph.edges.iter().zip(&weights) {
            if weight > 0.0 {
                pieces.join(edge.i, edge.j);
                copy.edges
                    .push(RelativePose { information: edge.information.scaled(weight), ..*edge });
            }
        }
        for (edge, &weight) in self.graph.edges.iter().zip(&weights) {
            if weight <= 0.0 && pieces.join(edge.i, edge.j) {
                let information = edge.information.scaled(BRIDGE_WEIGHT);
                copy.edges.push(RelativePose { information, ..*edge });
            }
        }
        copy
    }

    fn start<const D: usize>(&mut self, start: Start, has_poses: bool) -> Result<Start, SolveError>
    where
        G: RigidMotion<D, N>,
    {
        let mut copy = self.weighted_graph();
        let any = self.is_supported.contains(&true);
        let taken = match start {
            // The poses of a file often come from all closures, the false ones among them.
            Start::Auto if any => initialize(&mut copy, Start::Chordal, has_poses)?,
            Start::Auto => initialize(&mut copy, Start::Odometry, has_poses)?,
            other @ (Start::Given | Start::Odometry | Start::SpanningTree | Start::Chordal) => {
                initialize(&mut copy, other, has_poses)?
            }
        };
        self.graph.poses = copy.poses;
        Ok(taken)
    }

    /// χ² of each closure at the poses.
    fn chi2(&self) -> Vec<f64> {
        let chi2 = |&edge: &usize| {
            let edge = &self.graph.edges[edge];
            let residual = edge.residual(&self.graph.poses[edge.i], &self.graph.poses[edge.j]);
            edge.information.squared_norm(&residual)
        };
        self.closures.iter().map(chi2).collect()
    }

    fn solve(
        &mut self,
        options: &pose_graph::Options,
        observer: &mut Observer<'_>,
    ) -> Result<SolveSummary, SolveError> {
        let mut copy = self.weighted_graph();
        let summary = pose_graph::solve(&mut copy, options, observer)?;
        self.graph.poses = copy.poses;
        self.solves += 1;
        Ok(summary)
    }

    /// Weighs the supported closures, from a convex cost to the kernel.
    fn graduate(&mut self, kernel: Kernel) -> Result<(), SolveError> {
        let active: Vec<usize> =
            (0..self.weights.len()).filter(|&k| self.weights[k] > 0.0).collect();
        let options = pose_graph::Options {
            optimizer: optimizer::Options {
                max_iterations: 4,
                cost_tolerance: 1e-3,
                ..self.options.optimizer
            },
        };
        self.solve(&options, &mut ignore_iterations)?;
        let largest = |chi2: &[f64]| active.iter().map(|&k| chi2[k]).fold(0.0, f64::max);
        let mut chi2 = self.chi2();
        let Some(mut schedule) = kernel.schedule(largest(&chi2), self.threshold) else {
            return Ok(());
        };
        loop {
            let mut change = 0.0_f64;
            for &k in &active {
                let weight = schedule.weight(chi2[k]);
                change = change.max((weight - self.weights[k]).abs());
                self.weights[k] = weight;
            }
            if change > 0.0 {
                self.solve(&options, &mut ignore_iterations)?;
                chi2 = self.chi2();
            }
            let is_settled = self.weights.iter().all(|w| *w == 0.0 || *w == 1.0);
            if !schedule.advance() || (is_settled && kernel.is_binary()) {
                return Ok(());
            }
        }
    }

    /// Judges every closure at the solution until no verdict changes; returns the last solve.
    fn judge(
        &mut self,
        kernel: Kernel,
        observer: &mut Observer<'_>,
    ) -> Result<(SolveSummary, usize), SolveError> {
        let options = self.options;
        let mut before: Vec<Vec<bool>> = Vec::new();
        for _ in 0..MAX_JUDGMENTS {
            let chi2 = self.chi2();
            let kept: Vec<bool> = chi2.iter().map(|&chi2| chi2 <= self.threshold).collect();
            for (weight, &chi2) in self.weights.iter_mut().zip(&chi2) {
                *weight = kernel.final_weight(chi2, self.threshold);
            }
            if before.contains(&kept) {
                break;
            }
            before.push(kept);
            self.solve(&options, &mut ignore_iterations)?;
        }
        let summary = self.solve(&options, observer)?;
        Ok((summary, self.solves))
    }

    fn verdicts(&self) -> Vec<Verdict> {
        let chi2 = self.chi2();
        let verdict = |(k, &edge): (usize, &usize)| Verdict {
            edge,
            chi2: chi2[k],
            weight: self.weights[k],
            is_supported: self.is_supported[k],
            is_switched_off: chi2[k] > self.threshold || chi2[k].is_nan(),
        };
        self.closures.iter().enumerate().map(verdict).collect()
    }
}

/// Which poses hang together.
struct Pieces {
    parents: Vec<usize>,
}

impl Pieces {
    /// Poses that are held hang together.
    fn new(constant: &[bool]) -> Self {
        let mut pieces = Self { parents: (0..constant.len()).collect() };
        let held: Vec<usize> = (0..constant.len()).filter(|&i| constant[i]).collect();
        for pair in held.windows(2) {
            pieces.join(pair[0], pair[1]);
        }
        pieces
    }

    fn root(&mut self, mut i: usize) -> usize {
        while self.parents[i] != i {
            self.parents[i] = self.parents[self.parents[i]];
            i = self.parents[i];
        }
        i
    }

    /// Ties two poses; whether they were apart before.
    fn join(&mut self, i: usize, j: usize) -> bool {
        let (a, b) = (self.root(i), self.root(j));
        self.parents[a.max(b)] = a.min(b);
        a != b
    }
}

/// The 99 % quantile of χ² with `dimension` degrees of freedom, by Wilson and Hilferty's cube.
fn chi2_99(dimension: usize) -> f64 {
    let n = dimension as f64;
    let spread = 2.0 / (9.0 * n);
    n * (1.0 - spread + 2.326_347_874 * spread.sqrt()).powi(3)
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_quantile_is_that_of_tables() {
        for (dimension, table) in [(3, 11.345), (6, 16.812), (7, 18.475)] {
            assert!((super::chi2_99(dimension) / table - 1.0).abs() < 3e-3);
        }
    }
}
