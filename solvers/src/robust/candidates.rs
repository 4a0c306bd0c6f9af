//! The results that a robust solve chooses from.
//!
//! The first comes from the closures that support each other. Where it switches closures off, it may
//! have missed a solution that explains more of them: each closure is judged at an optimum that the
//! others make, and the odometry may have drifted so far that no closure fits where it leads. More
//! candidates begin with more closures: with those that nearly fit the best result so far, with all of
//! them at their plain optimum, and with graduated non-convexity over all of them, the last two from the
//! chordal start. The result of the lowest objective is taken: Σ χ² of the trusted edges and the
//! kernel's cost of the closures, at the whole graph. False closures make a factor dense, so that a
//! candidate whose factorization takes many times that of the first result is not tried.

use super::{NEAR_DAMPING, RobustSummary, UncertainMotion, Weighted};
use crate::geometry::{LieGroup, RigidMotion};
use crate::initialization::Start;
use crate::linear::{BlockPattern, Cholesky};
use crate::optimizer::Observer;
use crate::problem::SolveError;

/// A candidate's factorization may take so many times the flops of the first result's.
const MOST_FLOPS: f64 = 4.0;

/// Flops of a factorization that is cheap enough in any case: about a millisecond.
const CHEAP_FLOPS: f64 = 1e7;

/// A closure nearly fits where its χ² is at most so many times the threshold.
const NEARLY: f64 = 4.0;

/// A candidate is given up where its objective is more than so many times the lowest before its last
/// judgment, which changes little.
const HOPELESS: f64 = 1.02;

/// The graduated candidate is tried where less than this share of the closures counts.
const FEW: f64 = 1.0 / 3.0;

/// Which closures a candidate begins with, and what is done with them before they are judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Beginning {
    /// Those that nearly fit the best result so far, from its poses.
    NearlyFitting,
    /// All that are not held back, at their plain optimum.
    Plain,
    /// All that are not held back, by graduated non-convexity.
    Graduated,
}

/// A result of the judgment.
struct Candidate<G> {
    objective: f64,
    poses: Vec<G>,
    weights: Vec<f64>,
    summary: RobustSummary,
}

impl<G> Candidate<G> {
    /// Closures that count.
    fn kept(&self) -> usize {
        self.summary.closures.iter().filter(|verdict| !verdict.is_switched_off).count()
    }
}

impl<G: LieGroup<N>, const N: usize> Weighted<'_, G, N> {
    /// Judges from `start`, and from more closures where some were switched off; leaves the poses and
    /// weights of the lowest objective.
    pub(super) fn best<const D: usize>(
        &mut self,
        start: Start,
        has_poses: bool,
        trust_odometry: bool,
        observer: &mut Observer<'_>,
    ) -> Result<RobustSummary, SolveError>
    where
        G: RigidMotion<D, N>,
    {
        let start = self.start(start, has_poses)?;
        let is_near = self.contracted(|weighted| weighted.judge(trust_odometry, observer))?;
        let mut best = self.ended(is_near, start, observer)?;
        let all = self.closures.len();
        let ceiling = self.options.optimizer.ceiling;
        let mut is_limited = false;
        for beginning in [Beginning::NearlyFitting, Beginning::Plain, Beginning::Graduated] {
            let kept = best.kept();
            let is_needed = match beginning {
                Beginning::NearlyFitting | Beginning::Plain => kept < all,
                Beginning::Graduated => (kept as f64) < FEW * all as f64,
            };
            if self.is_stopped || !is_needed {
                break;
            }
            if !std::mem::replace(&mut is_limited, true) {
                self.options.optimizer.ceiling.flops_per_iteration = Some(self.most_flops());
            }
            let candidate = self.candidate(beginning, &best, observer);
            self.consider(candidate, &mut best)?;
        }
        self.options.optimizer.ceiling = ceiling;
        self.graph.poses = best.poses;
        self.weights = best.weights;
        let mut summary = best.summary;
        summary.solves = self.solves;
        summary.solve.solve_seconds = self.begin.elapsed().as_secs_f64();
        Ok(summary)
    }

    /// The last solve of a candidate, from poses that are its optimum where it `is_near`.
    fn ended(
        &mut self,
        is_near: bool,
        start: Start,
        observer: &mut Observer<'_>,
    ) -> Result<Candidate<G>, SolveError> {
        let mut last = self.options;
        if is_near {
            last.optimizer.initial_damping = last.optimizer.initial_damping.min(NEAR_DAMPING);
        }
        let solve = self.solve(&last, observer)?;
        let summary = self.summary(solve, start);
        let (poses, weights) = (self.graph.poses.clone(), self.weights.clone());
        Ok(Candidate { objective: self.objective(), poses, weights, summary })
    }

    /// Takes a candidate that is better than the best so far. One that is too expensive, or that the
    /// measurements leave open, is none.
    fn consider(
        &self,
        candidate: Result<Option<Candidate<G>>, SolveError>,
        best: &mut Candidate<G>,
    ) -> Result<(), SolveError> {
        match candidate {
            Ok(Some(candidate)) if candidate.objective < best.objective && !self.is_stopped => {
                *best = candidate;
                Ok(())
            }
            Ok(_)
            | Err(
                SolveError::TooExpensive(_) | SolveError::Singular { .. } | SolveError::Interrupted,
            ) => Ok(()),
            Err(error) => Err(error),
        }
    }

    /// The result of one beginning; `None` where it cannot be better than the best so far.
    fn candidate<const D: usize>(
        &mut self,
        beginning: Beginning,
        best: &Candidate<G>,
        observer: &mut Observer<'_>,
    ) -> Result<Option<Candidate<G>>, SolveError>
    where
        G: RigidMotion<D, N>,
    {
        let mut start = Start::Chordal;
        let counts = |is_in: bool| f64::from(u8::from(is_in));
        if beginning == Beginning::NearlyFitting {
            self.graph.poses.clone_from(&best.poses);
            let most = NEARLY * self.threshold;
            let nearly = self.chi2().into_iter().filter(|chi2| *chi2 <= most).count();
            if nearly <= best.kept() {
                return Ok(None);
            }
            self.weights = self.chi2().into_iter().map(|chi2| counts(chi2 <= most)).collect();
            start = best.summary.start;
        } else {
            self.weights = self.held_back.iter().map(|&held| counts(!held)).collect();
            self.start(Start::Chordal, false)?;
        }
        self.measured = UncertainMotion::all(self.graph);
        let mut is_promising = true;
        let is_near = self.contracted(|weighted| {
            if beginning == Beginning::Graduated {
                weighted.graduate(observer)?;
            } else {
                let options = weighted.options;
                weighted.solve(&options, observer)?;
                let fits = weighted.chi2().into_iter().filter(|chi2| *chi2 <= weighted.threshold);
                is_promising = fits.count() > best.kept();
            }
            if is_promising { weighted.judge_closures(observer) } else { Ok(()) }
        })?;
        if !is_promising || self.is_stopped || self.objective() > HOPELESS * best.objective {
            return Ok(None);
        }
        if is_near {
            // The contracted graph is exact to first order only.
            self.judge_closures(observer)?;
        }
        self.ended(is_near, start, observer).map(Some)
    }

    /// A few times the flops of a factorization over the closures that fit at the poses, at most those
    /// of the options.
    fn most_flops(&mut self) -> f64 {
        let fits = |chi2: f64| f64::from(u8::from(chi2 <= self.threshold));
        let fitting: Vec<f64> = self.chi2().into_iter().map(fits).collect();
        let weights = std::mem::replace(&mut self.weights, fitting);
        let graph = self.weighted_graph();
        self.weights = weights;
        let (poses, row_of) = graph.free_poses_of_solve();
        let pairs = graph.free_indices_of_edges(&row_of).filter_map(|(i, j)| i.zip(j));
        let pattern = BlockPattern::new(vec![N; poses.len()], pairs);
        // Without an order nothing but what is cheap in any case is tried.
        let flops = Cholesky::order(&pattern, self.interrupt)
            .map_or(0.0, |ordered| ordered.price().flops_per_iteration);
        let most = (MOST_FLOPS * flops).max(CHEAP_FLOPS);
        self.options.optimizer.ceiling.flops_per_iteration.map_or(most, |own| own.min(most))
    }
}
