//! Adds a closure to a map that is solved already.
//!
//! The poses fit everything except the new closure, and most closures are true: a plain solve is tried
//! first, and accepted if it strains nothing. The test looks at every edge, not at closures alone,
//! because a single false closure bends the odometry before it shows a residual of its own. Only where
//! something is strained do the stages of [`super::solve`] begin.

use super::{Options, RobustSummary, Weighted, run};
use crate::geometry::LieGroup;
use crate::initialization::Start;
use crate::interrupt::Interrupt;
use crate::optimizer::{Observer, SolveSummary};
use crate::problem::{PoseGraph, SolveError};

/// The least weight of a closure that counts: Geman and McClure's at the threshold.
const KEPT_WEIGHT: f64 = 0.25;

/// Optimizes `graph` in place from its poses, which fit all edges except new closures.
///
/// `off` are the edges that were found false before, rising. The first of these is taken that strains
/// nothing, that is, in which every closure that counts and every trusted edge has a χ² within the
/// threshold:
///
/// 1. all closures but `off`, and of those what then fits; the weights are 1;
/// 2. graduated non-convexity over all closures, as in [`super::solve`];
/// 3. the closures that fit the given poses, and what fits then. Trusted edges that are strained
///    before the solve or here are so without the closures, and are not asked in the other two.
///
/// Where a neighbor supports a closure that 1 leaves out, 2 is tried too, and taken if it keeps more.
/// `options.start` does not count. `observer` sees the rows of every solve.
///
/// # Errors
/// Those of [`super::solve`].
pub fn update<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    off: &[usize],
    options: &Options,
    observer: &mut Observer<'_>,
) -> Result<RobustSummary, SolveError> {
    update_until(graph, off, options, &Interrupt::NEVER, observer)
}

/// As [`update`], ending once `interrupt` is due as well, as [`super::solve_until`] does.
///
/// # Errors
/// As [`update`].
pub fn update_until<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    off: &[usize],
    options: &Options,
    interrupt: &Interrupt,
    observer: &mut Observer<'_>,
) -> Result<RobustSummary, SolveError> {
    run(graph, options, interrupt, |weighted| Ok((weighted.update(off, observer)?, Start::Given)))
}

/// A result that may be restored.
struct State<G> {
    poses: Vec<G>,
    weights: Vec<f64>,
    solve: SolveSummary,
}

impl<G: LieGroup<N>, const N: usize> Weighted<'_, G, N> {
    fn update(
        &mut self,
        off: &[usize],
        observer: &mut Observer<'_>,
    ) -> Result<SolveSummary, SolveError> {
        let given = self.graph.poses.clone();
        let mut asked = self.unstrained();
        let weight = |edge: &usize| f64::from(u8::from(off.binary_search(edge).is_err()));
        self.weights = self.closures.iter().map(weight).collect();
        let plain = self.last(observer)?;
        if self.closures.is_empty() || self.is_stopped {
            return Ok(plain.solve);
        }
        if !self.fits(&asked) {
            self.graph.poses.clone_from(&given);
            self.judge_closures(observer)?;
            let judged = self.last(observer)?;
            asked.retain(|&edge| self.chi2_of(edge) <= self.threshold);
            self.restore(&plain);
            if !self.fits(&asked) {
                let robust = self.stages(&given, observer)?;
                if !self.fits(&asked) {
                    return Ok(self.take(judged));
                }
                return Ok(robust.solve);
            }
        }
        let plain = self.with_what_fits(plain, &asked, observer)?;
        let is_outside = |(&weight, &is_supported)| is_supported && weight < KEPT_WEIGHT;
        if self.weights.iter().zip(&self.is_supported).any(is_outside) {
            let kept = self.kept();
            let robust = self.stages(&given, observer)?;
            if self.kept() > kept && self.fits(&asked) {
                return Ok(robust.solve);
            }
        }
        Ok(self.take(plain))
    }

    /// The trusted edges that fit the poses.
    fn unstrained(&self) -> Vec<usize> {
        let is_trusted = |edge: &usize| self.closures.binary_search(edge).is_err();
        let fits = |&edge: &usize| self.chi2_of(edge) <= self.threshold;
        (0..self.graph.edges.len()).filter(is_trusted).filter(fits).collect()
    }

    /// Whether the edges of `asked` and the closures that count fit the poses.
    fn fits(&self, asked: &[usize]) -> bool {
        let closures = self.closures.iter().zip(&self.weights);
        let counted = closures.filter(|&(_, &weight)| weight >= KEPT_WEIGHT).map(|(edge, _)| edge);
        asked.iter().chain(counted).all(|&edge| self.chi2_of(edge) <= self.threshold)
    }

    /// How many closures count.
    fn kept(&self) -> usize {
        self.weights.iter().filter(|&&weight| weight >= KEPT_WEIGHT).count()
    }

    /// Solves with the current weights, and returns the resulting state.
    fn last(&mut self, observer: &mut Observer<'_>) -> Result<State<G>, SolveError> {
        let options = self.options;
        let solve = self.solve(&options, observer)?;
        Ok(State { poses: self.graph.poses.clone(), weights: self.weights.clone(), solve })
    }

    fn restore(&mut self, state: &State<G>) {
        self.graph.poses.clone_from(&state.poses);
        self.weights.clone_from(&state.weights);
    }

    fn take(&mut self, state: State<G>) -> SolveSummary {
        self.restore(&state);
        state.solve
    }

    /// `plain`, with the closures that it leaves out and that fit it nevertheless.
    fn with_what_fits(
        &mut self,
        plain: State<G>,
        asked: &[usize],
        observer: &mut Observer<'_>,
    ) -> Result<State<G>, SolveError> {
        let chi2 = self.chi2();
        for (weight, chi2) in self.weights.iter_mut().zip(chi2) {
            if chi2 <= self.threshold {
                *weight = 1.0;
            }
        }
        if self.weights != plain.weights {
            let more = self.last(observer)?;
            if self.fits(asked) {
                return Ok(more);
            }
        }
        self.restore(&plain);
        Ok(plain)
    }

    /// Graduated non-convexity and judgment from `poses`.
    fn stages(&mut self, poses: &[G], observer: &mut Observer<'_>) -> Result<State<G>, SolveError> {
        self.graph.poses = poses.to_vec();
        self.weigh_by_support();
        self.graduate(observer)?;
        self.judge_closures(observer)?;
        self.last(observer)
    }
}
