//! The similarity between two clouds of points by pairs of which some are wrong: rotation, translation and
//! scale, as between two maps of which one was made without a measured length.
//!
//! Samples of three pairs give similarities in closed form (Umeyama, PAMI 1991); the one that most pairs
//! agree with is refined by Gauss-Newton over its seven parameters, with the covariances of both points:
//! e = S·p − q, Σ = Σ_q + s² R Σ_p Rᵀ. The derivative is taken at the point that p is estimated to be,
//! p − s Σ_p Rᵀ Σ⁻¹ e: taken at p itself, noise of the source makes the scale too small. Reads no map,
//! and gives the same on any number of threads.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::geometric_verification::{Numbers, distinct, samples_needed};
use crate::geometry::{LieGroup, RigidMotion, Se3, Sim3};
use crate::information::Covariance;
use crate::relative_motion::{HUBER_WIDTH, PointEstimate};

/// Fewest pairs that agree: three determine a similarity, and these contradict a wrong one fifteen times.
pub const MIN_INLIERS: usize = 8;
/// Most samples: of pairs of which a seventh is right, 2,400 hold a sample without a wrong one but for a
/// thousandth.
const MAX_SAMPLES: usize = 2400;
/// Standard deviations may be too small by this factor.
const SIGMA_ALLOWANCE: f64 = 2.0;
/// χ² of three degrees of freedom that one right pair in 100 exceeds.
const GATE: f64 = 11.345 * SIGMA_ALLOWANCE * SIGMA_ALLOWANCE;
/// Median of χ² with three degrees of freedom.
const MEDIAN: f64 = 2.366;
/// Iterations of the refinement of a sample, and of the last one.
const QUICK: usize = 2;
const THOROUGH: usize = 30;
/// A step whose length in standard deviations is below this ends the iteration.
const STEP_TOLERANCE: f64 = 1e-6;
/// Points whose spread across a line is a smaller share of that along it leave the turn about it open.
const ONE_LINE: f64 = 0.02;

/// A point in two frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// In the source.
    pub source: PointEstimate,
    /// In the target.
    pub target: PointEstimate,
}

/// A similarity that pairs agree on.
#[derive(Clone, Debug, PartialEq)]
pub struct Similarity {
    /// The target's frame from the source's.
    pub target_from_source: Sim3,
    /// Of a right perturbation of it, in the order of the tangent; with standard deviations of the points as
    /// large as the residuals say, where these are larger than stated.
    pub covariance: Covariance<7>,
    /// The pairs that agree, rising.
    pub inliers: Vec<usize>,
}

/// The similarity that most pairs agree with; `None` where fewer than half of them do, and for numbers that are not
/// finite. The random numbers are those of `seed`.
#[must_use]
pub fn estimate(pairs: &[Pair], seed: u64) -> Option<Similarity> {
    let is_number =
        |p: &PointEstimate| p.point.iter().chain(p.covariance.iter()).all(|v| v.is_finite());
    if pairs.len() < MIN_INLIERS
        || !pairs.iter().all(|pair| is_number(&pair.source) && is_number(&pair.target))
    {
        return None;
    }
    let mut numbers = Numbers::new(seed);
    let mut best: Option<Agreed> = None;
    let (mut needed, mut drawn) = (MAX_SAMPLES, 0);
    while drawn < needed {
        drawn += 1;
        let sample: [usize; 3] = distinct(&mut numbers, pairs.len());
        let Some(found) = fit(sample.iter().map(|&k| &pairs[k])) else { continue };
        let Some(found) = Agreed::new(pairs, found) else { continue };
        if best.as_ref().is_none_or(|best| found.cost < best.cost) {
            let refined = found.refined(pairs, QUICK).unwrap_or(found);
            let share = refined.inliers.len() as f64 / pairs.len() as f64;
            needed = samples_needed(share, 3, MAX_SAMPLES);
            best = Some(refined);
        }
    }
    // A better similarity may have other inliers.
    let found = best?.refined(pairs, THOROUGH)?.refined(pairs, THOROUGH)?;
    // Points near a plane fit a mirrored copy by a third.
    if 2 * found.inliers.len() < pairs.len() {
        return None;
    }
    let covariance = found.covariance(pairs)?;
    let Agreed { target_from_source, inliers, cost: _ } = found;
    Some(Similarity { target_from_source, covariance, inliers })
}

/// The similarity with the least sum of squared distances in the target, in closed form; `None` where
/// the points do not determine it.
fn fit<'a>(pairs: impl Iterator<Item = &'a Pair> + Clone) -> Option<Sim3> {
    let count = pairs.clone().count() as f64;
    let center = |of: fn(&Pair) -> &PointEstimate| {
        pairs.clone().map(|pair| of(pair).point).sum::<Vector3<f64>>() / count
    };
    let (a, b) = (center(|pair| &pair.source), center(|pair| &pair.target));
    let centered = pairs.map(|pair| (pair.source.point - a, pair.target.point - b));
    let (mut cross, mut of_source, mut of_target) =
        (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
    for (x, y) in centered {
        cross += y * x.transpose();
        of_source += x * x.transpose();
        of_target += y * y.transpose();
    }
    if is_line(&of_source) || is_line(&of_target) {
        return None;
    }
    let rotation = Se3::from_matrix(&cross, &Vector3::zeros())?.rotation;
    // tr(Rᵀ C) over the variance of the source.
    let scale = rotation.matrix().dot(&cross) / of_source.trace();
    let found = Sim3::new(rotation, b - rotation.rotate(&a) * scale, scale);
    (scale > 0.0 && found.is_finite()).then_some(found)
}

/// Whether points with this scatter are on one line, or at one place.
fn is_line(scatter: &Matrix3<f64>) -> bool {
    let values = scatter.symmetric_eigenvalues();
    let largest = values.max();
    let middle = values.sum() - largest - values.min();
    !(largest > 0.0 && middle >= ONE_LINE * ONE_LINE * largest)
}

/// A similarity, the pairs inside of [`GATE`] and the sum of all pairs' χ², each counting no more than that.
struct Agreed {
    target_from_source: Sim3,
    inliers: Vec<usize>,
    cost: f64,
}

/// A pair at a similarity.
struct Residual {
    /// S·p − q.
    error: Vector3<f64>,
    /// Σ⁻¹ of the error.
    information: Matrix3<f64>,
    /// Where the source's point is by both.
    source: Vector3<f64>,
}

impl Residual {
    fn new(pair: &Pair, similarity: &Sim3) -> Option<Self> {
        let turn = similarity.rotation.matrix() * similarity.scale;
        let error = similarity.transform(&pair.source.point) - pair.target.point;
        let moved = turn * pair.source.covariance;
        let covariance = pair.target.covariance + moved * turn.transpose();
        let information = covariance.cholesky()?.inverse();
        let source = pair.source.point - moved.transpose() * (information * error);
        Some(Self { error, information, source })
    }

    fn chi2(&self) -> f64 {
        self.error.dot(&(self.information * self.error))
    }
}

impl Agreed {
    fn new(pairs: &[Pair], target_from_source: Sim3) -> Option<Self> {
        let (mut inliers, mut cost) = (Vec::new(), 0.0);
        for (k, pair) in pairs.iter().enumerate() {
            let chi2 = Residual::new(pair, &target_from_source).map_or(f64::INFINITY, |r| r.chi2());
            if chi2 < GATE {
                inliers.push(k);
            }
            cost += chi2.min(GATE);
        }
        (inliers.len() >= MIN_INLIERS).then_some(Self { target_from_source, inliers, cost })
    }

    /// Gauss-Newton over the inliers with Huber's loss, and the inliers of the result.
    fn refined(&self, pairs: &[Pair], iterations: usize) -> Option<Self> {
        let mut similarity = self.target_from_source;
        for _ in 0..iterations {
            let (hessian, gradient) = self.normal_equations(pairs, &similarity);
            let step = hessian.cholesky()?.solve(&-gradient);
            similarity = similarity.plus(&step);
            if !similarity.is_finite() {
                return None;
            }
            if step.dot(&(hessian * step)) < STEP_TOLERANCE * STEP_TOLERANCE {
                break;
            }
        }
        Self::new(pairs, similarity)
    }

    fn residuals<'a>(
        &'a self,
        pairs: &'a [Pair],
        similarity: &'a Sim3,
    ) -> impl Iterator<Item = Residual> + 'a {
        self.inliers.iter().filter_map(move |&k| Residual::new(&pairs[k], similarity))
    }

    fn normal_equations(
        &self,
        pairs: &[Pair],
        similarity: &Sim3,
    ) -> (SMatrix<f64, 7, 7>, SVector<f64, 7>) {
        let (mut hessian, mut gradient) = (SMatrix::zeros(), SVector::zeros());
        for residual in self.residuals(pairs, similarity) {
            let weight = (HUBER_WIDTH / residual.chi2().sqrt()).min(1.0);
            let jacobian = similarity.act_jacobian(&residual.source);
            let weighted = jacobian.transpose() * residual.information * weight;
            hessian += weighted * jacobian;
            gradient += weighted * residual.error;
        }
        (hessian, gradient)
    }

    fn covariance(&self, pairs: &[Pair]) -> Option<Covariance<7>> {
        let similarity = &self.target_from_source;
        let mut squares: Vec<f64> = self.residuals(pairs, similarity).map(|r| r.chi2()).collect();
        squares.sort_unstable_by(f64::total_cmp);
        // The median: wrong pairs move it little.
        let variance = (squares.get(squares.len() / 2)? / MEDIAN).max(1.0);
        let (hessian, _) = self.normal_equations(pairs, similarity);
        let inverse = hessian.cholesky()?.inverse() * variance;
        Covariance::new(&((inverse + inverse.transpose()) * 0.5)).ok()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::So3;

    /// Normal numbers of a seed, by the sum of twelve uniform ones.
    struct Normal(Numbers);

    impl Normal {
        fn next(&mut self) -> f64 {
            (0..12).map(|_| self.0.share()).sum::<f64>() - 6.0
        }

        fn vector(&mut self) -> Vector3<f64> {
            Vector3::from_fn(|_, _| self.next())
        }

        /// A point as a camera at the origin estimates it: its depth is `sigma` of the depth uncertain.
        fn seen(&mut self, point: &Vector3<f64>, sigma: f64) -> PointEstimate {
            let sight = point.normalize();
            let along = point.norm() * sigma;
            let across = along / 10.0;
            let sight = sight * sight.transpose();
            let covariance = sight * along.powi(2) + (Matrix3::identity() - sight) * across.powi(2);
            let root = sight * along + (Matrix3::identity() - sight) * across;
            PointEstimate { point: point + root * self.vector(), covariance }
        }
    }

    /// A room of points, `wrong` of which are pairs of different points.
    fn room(truth: &Sim3, count: usize, wrong: usize, sigma: f64, seed: u64) -> Vec<Pair> {
        let mut normal = Normal(Numbers::new(seed));
        let points: Vec<Vector3<f64>> = (0..count)
            .map(|_| Vector3::new(normal.next(), normal.next(), 4.0 + normal.next()))
            .collect();
        let pair = |k: usize, normal: &mut Normal| {
            let source = normal.seen(&points[k], sigma);
            let other = points[if k < wrong { (k + 1) % count } else { k }];
            // Both cameras are at their frames' origins but for the similarity.
            let seen = normal.seen(&other, sigma);
            let turn = truth.rotation.matrix() * truth.scale;
            let covariance = turn * seen.covariance * turn.transpose();
            let target = PointEstimate { point: truth.transform(&seen.point), covariance };
            Pair { source, target }
        };
        (0..count).map(|k| pair(k, &mut normal)).collect()
    }

    fn similarity() -> impl Strategy<Value = Sim3> {
        let number = -3.0..3.0_f64;
        let vector = proptest::array::uniform3(number);
        (vector.clone(), vector, -4.0..4.0_f64).prop_map(|(turn, t, log_scale)| {
            Sim3::new(So3::exp(&turn.into()), Vector3::from(t), log_scale.exp())
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn points_without_noise_give_their_similarity(truth in similarity(), seed: u64) {
            let mut pairs = room(&truth, 40, 12, 1e-9, seed);
            let covariance = Matrix3::identity() * 1e-6;
            for pair in &mut pairs {
                pair.source.covariance = covariance;
                pair.target.covariance = covariance * truth.scale.powi(2);
            }
            let found = estimate(&pairs, seed).unwrap();
            let error = found.target_from_source.minus(&truth);
            prop_assert!(error.norm() < 1e-6, "{error}");
            prop_assert_eq!(found.inliers, (12..40).collect::<Vec<_>>());
        }

        #[test]
        fn a_third_of_wrong_pairs_and_noise_leave_the_error_inside_the_covariance(
            truth in similarity(),
            seed: u64,
        ) {
            let found = estimate(&room(&truth, 90, 30, 0.02, seed), seed).unwrap();
            let error = found.target_from_source.minus(&truth);
            let information = found.covariance.information().unwrap();
            // One in 100,000 exceeds 36 with seven degrees of freedom.
            prop_assert!(information.squared_norm(&error) < 36.0, "{error}");
            prop_assert!(error[6].abs() < 0.02, "scale is off by {}", error[6]);
        }

        #[test]
        fn a_similarity_of_the_target_moves_the_estimate(
            truth in similarity(),
            motion in similarity(),
            seed: u64,
        ) {
            let pairs = room(&truth, 40, 5, 0.01, seed);
            let moved = pairs.iter().map(|pair| {
                let turn = motion.rotation.matrix() * motion.scale;
                let covariance = turn * pair.target.covariance * turn.transpose();
                let point = motion.transform(&pair.target.point);
                Pair { target: PointEstimate { point, covariance }, ..*pair }
            });
            let moved: Vec<Pair> = moved.collect();
            let (before, after) = (estimate(&pairs, seed).unwrap(), estimate(&moved, seed).unwrap());
            let error =
                after.target_from_source.minus(&motion.compose(&before.target_from_source));
            prop_assert!(error.norm() < 1e-6, "{error}");
        }
    }

    #[test]
    fn the_covariance_is_that_of_the_error() {
        let truth = Sim3::new(So3::identity(), Vector3::new(1.0, 2.0, 3.0), 0.37);
        let mut sum = 0.0;
        for seed in 0..100 {
            let found = estimate(&room(&truth, 60, 0, 0.03, seed), seed).unwrap();
            let error = found.target_from_source.minus(&truth);
            sum += found.covariance.information().unwrap().squared_norm(&error);
        }
        // 7 with a standard deviation of 0.37 where it is exact; stated too large is the safe side.
        let mean = sum / 100.0;
        assert!((4.0..8.5).contains(&mean), "{mean}");
    }

    /// By the derivative at the measured point it was 1.3 % too small.
    #[test]
    fn noise_of_the_source_does_not_shrink_the_scale() {
        let truth = Sim3::new(So3::identity(), Vector3::zeros(), 2.7);
        let errors: Vec<f64> = (0..200)
            .map(|seed| {
                let found = estimate(&room(&truth, 60, 0, 0.1, seed), seed).unwrap();
                (found.target_from_source.scale / truth.scale).ln()
            })
            .collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        assert!(mean.abs() < 0.004, "{mean}");
    }

    #[test]
    fn what_does_not_determine_a_similarity_gives_none() {
        let truth = Sim3::identity();
        let pairs = room(&truth, 40, 0, 0.01, 1);
        assert_eq!(estimate(&pairs[..MIN_INLIERS - 1], 1), None, "too few");
        let on_a_line = |pair: &Pair| {
            let on = |p: PointEstimate| PointEstimate { point: Vector3::x() * p.point.x, ..p };
            Pair { source: on(pair.source), target: on(pair.target) }
        };
        let line: Vec<Pair> = pairs.iter().map(on_a_line).collect();
        assert_eq!(estimate(&line, 1), None, "on a line");
        let one: Vec<Pair> = vec![pairs[0]; 20];
        assert_eq!(estimate(&one, 1), None, "at one place");
        let mut broken = pairs.clone();
        broken[3].target.point.y = f64::NAN;
        assert_eq!(estimate(&broken, 1), None, "not a number");
        // Mirrored points agree on no similarity.
        let mirrored: Vec<Pair> = pairs
            .iter()
            .map(|pair| {
                let mut pair = *pair;
                pair.target.point.x = -pair.target.point.x;
                pair
            })
            .collect();
        assert_eq!(estimate(&mirrored, 1), None, "mirrored");
    }
}
