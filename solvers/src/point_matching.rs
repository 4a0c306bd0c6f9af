//! Points of two places that are one, where the motion between the places is roughly known.
//!
//! Each point has a covariance. The covariance of the motion bounds where a point of place b may lie
//! among those of place a; the best match inside, by appearance where it is known, aligns the places,
//! which narrows the bound, until the matches stay. What remains are pairs that are each other's best
//! match, not ambiguous, within the 99 % quantile of χ² with three degrees of freedom. Reads no map and
//! moves nothing.

mod mutual;

use nalgebra::{Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};

use crate::geometry::{LieGroup, Se3};
use crate::information::Information;
use crate::interrupt::Interrupt;
use crate::relative_motion::{HUBER_WIDTH, PointEstimate};
use crate::robust::default_threshold;
pub(crate) use mutual::{MutualBest, RATIO};

/// Fewest matches that align two places: three determine an alignment, and a few more may agree with
/// it by chance. A choice, not a measurement.
const MIN_MATCHES: usize = 10;

/// Most points of place a that are compared with one of place b, the best ones: a point with more is
/// ambiguous, and memory stays in proportion to the points.
const MOST_CANDIDATES: usize = 32;

/// Rounds of matching and aligning.
const MAX_ROUNDS: usize = 8;

/// Steps of an alignment.
const MAX_STEPS: usize = 10;

/// A step shorter than this many standard deviations ends an alignment.
const STEP_TOLERANCE: f64 = 1e-3;

/// By position, in standard deviations, the best match must be closer than the second best by this
/// factor: positions alone say little.
const RATIO_OF_POSITIONS: f64 = 1.0 / 3.0;

/// Largest variance factor of an alignment: errors of more than three times what the points claim have
/// a reason that is not known here.
const MOST_VARIANCE: f64 = 9.0;

/// How alike two points look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Likeness {
    /// Their appearance is not known, or of different kinds.
    Unknown,
    /// They cannot be one point.
    Different,
    /// The distance of their descriptors, at least 0.
    Distance(f64),
}

/// Pairs (index in `a`, index in `b`) of points that are one, by rising index in `a`; none where the
/// places cannot be aligned or `interrupt` is due.
///
/// All points are in one world frame, as far as the motion is known. `information` is that of a right
/// perturbation of `world_from_b`, by which place b may be off, translation first.
#[must_use]
pub fn match_points(
    a: &[PointEstimate],
    b: &[PointEstimate],
    world_from_b: &Se3,
    information: &Information<6>,
    likeness: &dyn Fn(usize, usize) -> Likeness,
    interrupt: &Interrupt,
) -> Vec<(usize, usize)> {
    let prior = information.matrix();
    let Some(covariance) = prior.try_inverse() else { return Vec::new() };
    let mut alignment = Alignment {
        world_from_b: *world_from_b,
        b_from_b: Se3::identity(),
        covariance,
        variance_factor: 1.0,
    };
    let candidates = candidates(a, b, &alignment, likeness, interrupt);
    let mut matches = best_matches(a, b, &candidates, &alignment);
    for _ in 0..MAX_ROUNDS {
        if matches.len() < MIN_MATCHES || interrupt.is_due() {
            return Vec::new();
        }
        let Some(aligned) = align(a, b, &matches, &alignment, prior) else { return Vec::new() };
        alignment = aligned;
        let next = best_matches(a, b, &candidates, &alignment);
        if next == matches {
            break;
        }
        matches = next;
    }
    if matches.len() < MIN_MATCHES { Vec::new() } else { matches }
}

/// Where place b is moved to: T Exp(ξ) T⁻¹ with T = `world_from_b`, and the covariance of ξ.
#[derive(Clone, Debug)]
struct Alignment {
    world_from_b: Se3,
    /// Exp(ξ).
    b_from_b: Se3,
    covariance: Matrix6<f64>,
    /// By what the covariances of the points are multiplied, at least 1.
    variance_factor: f64,
}

impl Alignment {
    fn apply(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.world_from_b.transform(&self.b_from_b.transform(&self.in_b(point)))
    }

    fn in_b(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.world_from_b.inverse_transform(point)
    }

    fn rotation(&self) -> Matrix3<f64> {
        self.world_from_b.compose(&self.b_from_b).rotation.matrix()
    }

    /// ∂ moved point / ∂δ of a right perturbation Exp(ξ) Exp(δ).
    fn jacobian(&self, point: &Vector3<f64>) -> Matrix3x6<f64> {
        let mut local = Matrix3x6::zeros();
        local.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
        local.fixed_view_mut::<3, 3>(0, 3).copy_from(&-self.in_b(point).cross_matrix());
        self.rotation() * local
    }

    /// Covariance of the moved point itself.
    fn turned(&self, covariance: &Matrix3<f64>) -> Matrix3<f64> {
        let turn = self.rotation() * self.world_from_b.rotation.inverse().matrix();
        turn * covariance * turn.transpose()
    }

    /// Covariance of the moved point, with that of the alignment.
    fn covariance_of(&self, point: &PointEstimate) -> Matrix3<f64> {
        let jacobian = self.jacobian(&point.point);
        self.turned(&point.covariance) * self.variance_factor
            + jacobian * self.covariance * jacobian.transpose()
    }
}

/// Two points that may be one.
struct Candidate {
    a: usize,
    b: usize,
    /// Distance of their descriptors, where it is known.
    distance: Option<f64>,
}

/// The pairs that are near each other at the start, where the bound is widest, and do not look
/// different.
fn candidates(
    a: &[PointEstimate],
    b: &[PointEstimate],
    start: &Alignment,
    likeness: &dyn Fn(usize, usize) -> Likeness,
    interrupt: &Interrupt,
) -> Vec<Candidate> {
    let threshold = default_threshold(3);
    // What the bound needs, in one piece of memory, by x.
    let keyed = |(index, estimate): (usize, &PointEstimate)| {
        (estimate.point, estimate.covariance.trace(), index)
    };
    let mut by_x: Vec<(Vector3<f64>, f64, usize)> = a.iter().enumerate().map(keyed).collect();
    by_x.sort_by(|a, b| a.0.x.total_cmp(&b.0.x));
    let widest = by_x.iter().map(|&(_, trace, _)| trace).fold(0.0, f64::max);
    let mut candidates = Vec::new();
    // Candidates of one point, behind what ranks them.
    let mut near: Vec<(f64, Candidate)> = Vec::new();
    for (at_b, estimate) in b.iter().enumerate() {
        if interrupt.is_due() {
            return Vec::new();
        }
        // No direction has a larger variance than the trace.
        let trace_b = start.covariance_of(estimate).trace();
        let (center, radius) = (&estimate.point, (threshold * (widest + trace_b)).sqrt());
        let first = by_x.partition_point(|(point, ..)| point.x < center.x - radius);
        let last = by_x.partition_point(|(point, ..)| point.x <= center.x + radius);
        for &(point, trace_a, at_a) in &by_x[first..last] {
            let ratio = (point - center).norm_squared() / (trace_a + trace_b);
            if ratio > threshold {
                continue;
            }
            let distance = match likeness(at_a, at_b) {
                Likeness::Different => continue,
                Likeness::Unknown => None,
                Likeness::Distance(distance) => Some(distance),
            };
            near.push((distance.unwrap_or(ratio), Candidate { a: at_a, b: at_b, distance }));
        }
        if near.len() > MOST_CANDIDATES {
            near.select_nth_unstable_by(MOST_CANDIDATES, |a, b| {
                (a.0.total_cmp(&b.0)).then(a.1.a.cmp(&b.1.a))
            });
            near.truncate(MOST_CANDIDATES);
        }
        candidates.extend(near.drain(..).map(|(_, candidate)| candidate));
    }
    candidates
}

/// Candidates that are each other's best match, neither of them ambiguous.
fn best_matches(
    a: &[PointEstimate],
    b: &[PointEstimate],
    candidates: &[Candidate],
    alignment: &Alignment,
) -> Vec<(usize, usize)> {
    let threshold = default_threshold(3);
    let mut best = MutualBest::new(a.len(), b.len());
    let moved = |estimate: &PointEstimate| {
        (alignment.apply(&estimate.point), alignment.covariance_of(estimate))
    };
    let moved: Vec<(Vector3<f64>, Matrix3<f64>)> = b.iter().map(moved).collect();
    for candidate in candidates {
        let (of_a, (position, of_b)) = (&a[candidate.a], &moved[candidate.b]);
        let difference = of_a.point - position;
        let covariance = of_a.covariance * alignment.variance_factor + of_b;
        let Some(cholesky) = covariance.cholesky() else { continue };
        let chi2 = difference.dot(&cholesky.solve(&difference));
        if chi2 <= threshold {
            // By the distance of the descriptors, or of the points in standard deviations.
            let (distance, ratio) = match candidate.distance {
                Some(distance) => (distance, RATIO),
                None => (chi2.sqrt(), RATIO_OF_POSITIONS),
            };
            best.add(candidate.a, candidate.b, distance, ratio);
        }
    }
    best.pairs()
}

/// Aligns place b with the matches by Gauss-Newton steps from `start`, under Huber's loss, with the
/// information of the motion as prior.
fn align(
    a: &[PointEstimate],
    b: &[PointEstimate],
    matches: &[(usize, usize)],
    start: &Alignment,
    prior: &Matrix6<f64>,
) -> Option<Alignment> {
    let mut alignment = start.clone();
    let (mut hessian, mut weighted) = (*prior, 0.0);
    for _ in 0..MAX_STEPS {
        let mut gradient = prior * alignment.b_from_b.log();
        (hessian, weighted) = (*prior, 0.0);
        for &(at_a, at_b) in matches {
            let (of_a, of_b) = (&a[at_a], &b[at_b]);
            let difference = alignment.apply(&of_b.point) - of_a.point;
            let covariance = of_a.covariance + alignment.turned(&of_b.covariance);
            let information = covariance.cholesky()?.inverse();
            let chi2 = difference.dot(&(information * difference));
            let norm = chi2.max(0.0).sqrt();
            let weight = if norm <= HUBER_WIDTH { 1.0 } else { HUBER_WIDTH / norm };
            let jacobian = alignment.jacobian(&of_b.point);
            hessian += weight * jacobian.transpose() * information * jacobian;
            gradient += weight * jacobian.transpose() * information * difference;
            weighted += weight * chi2;
        }
        let step: Vector6<f64> = -hessian.cholesky()?.solve(&gradient);
        let length = step.dot(&(hessian * step)).max(0.0).sqrt();
        alignment.b_from_b = alignment.b_from_b.compose(&Se3::exp(&step));
        if length < STEP_TOLERANCE {
            break;
        }
    }
    let freedom = (3 * matches.len()).checked_sub(6).filter(|&freedom| freedom > 0)?;
    alignment.variance_factor = (weighted / freedom as f64).max(1.0);
    alignment.covariance = hessian.try_inverse()? * alignment.variance_factor;
    let is_sound = alignment.variance_factor <= MOST_VARIANCE && alignment.b_from_b.is_finite();
    is_sound.then_some(alignment)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random::{element, normal_vector, seeded, uniform_vector};

    const SIGMA_M: f64 = 0.01;

    fn estimate(point: Vector3<f64>) -> PointEstimate {
        PointEstimate { point, covariance: Matrix3::identity() * SIGMA_M * SIGMA_M }
    }

    /// Two views of `count` points of a room; the second, in reverse order, is moved by `error` in the
    /// frame of `world_from_b`.
    fn room(count: usize, world_from_b: &Se3, error: &Se3) -> [Vec<PointEstimate>; 2] {
        let mut rng = seeded(3);
        let points: Vec<Vector3<f64>> = (0..count).map(|_| uniform_vector(&mut rng, 3.0)).collect();
        let moved = |point: &Vector3<f64>| {
            world_from_b.transform(&error.transform(&world_from_b.inverse_transform(point)))
        };
        let a = points.iter().map(|p| estimate(p + normal_vector::<3>(&mut rng, SIGMA_M)));
        let a = a.collect();
        let b = points.iter().rev();
        let b = b.map(|p| estimate(moved(p) + normal_vector::<3>(&mut rng, SIGMA_M))).collect();
        [a, b]
    }

    fn information(sigma: f64) -> Information<6> {
        Information::from_sigmas(&Vector6::from_element(sigma)).unwrap()
    }

    fn never() -> Interrupt {
        Interrupt::at(None)
    }

    #[test]
    fn the_jacobian_of_an_alignment_is_that_of_differences() {
        let mut rng = seeded(1);
        for _ in 0..100 {
            let alignment = Alignment {
                world_from_b: element(&mut rng, 1.0),
                b_from_b: element(&mut rng, 0.5),
                covariance: Matrix6::identity(),
                variance_factor: 1.0,
            };
            let point: Vector3<f64> = normal_vector(&mut rng, 2.0);
            let jacobian = alignment.jacobian(&point);
            let h = 1e-6;
            for k in 0..6 {
                let at = |step: f64| {
                    let mut delta = Vector6::zeros();
                    delta[k] = step;
                    let b_from_b = alignment.b_from_b.compose(&Se3::exp(&delta));
                    Alignment { b_from_b, ..alignment.clone() }.apply(&point)
                };
                let difference = (at(h) - at(-h)) / (2.0 * h);
                assert!((jacobian.column(k) - difference).norm() < 1e-7, "column {k}");
            }
        }
    }

    #[test]
    fn points_are_matched_by_appearance_across_an_error_of_many_spacings() {
        let world_from_b: Se3 = element(&mut seeded(2), 1.0);
        let error = Se3::exp(&Vector6::new(0.1, -0.2, 0.1, 0.02, 0.05, -0.03));
        let count = 2000;
        let [a, b] = room(count, &world_from_b, &error);
        // A tenth of all points look like those of another one, too.
        let likeness = |a: usize, b: usize| match count - 1 - b {
            own if own == a => Likeness::Distance(0.1),
            own if own / 10 == a / 10 => Likeness::Distance(0.25),
            _ => Likeness::Different,
        };
        let pairs = match_points(&a, &b, &world_from_b, &information(0.2), &likeness, &never());
        assert!(pairs.len() > count * 9 / 10, "{} pairs", pairs.len());
        assert!(pairs.iter().all(|&(a, b)| a + b == count - 1));
    }

    #[test]
    fn points_that_look_the_same_at_distance_0_are_ambiguous() {
        let [a, b] = room(2000, &Se3::identity(), &Se3::identity());
        let same = |_: usize, _: usize| Likeness::Distance(0.0);
        let world_from_b = Se3::identity();
        // Some points have several others within the bound, others have none.
        let pairs = match_points(&a, &b, &world_from_b, &information(0.05), &same, &never());
        assert!(pairs.iter().all(|&(a, b)| a + b == 1999), "{pairs:?}");
    }

    #[test]
    fn an_interrupted_or_hopeless_search_finds_nothing() {
        let [a, b] = room(300, &Se3::identity(), &Se3::identity());
        let unknown = |_: usize, _: usize| Likeness::Unknown;
        let (start, near, wide) = (&Se3::identity(), &information(0.01), &information(1.0));
        let found = match_points(&a, &b, start, near, &unknown, &never()).len();
        assert!(found > 200, "{found}");
        let due = Interrupt::at(Some(std::time::Instant::now()));
        assert_eq!(match_points(&a, &b, start, near, &unknown, &due), []);
        assert_eq!(match_points(&a, &[], start, near, &unknown, &never()), []);
        let different = |_: usize, _: usize| Likeness::Different;
        assert_eq!(match_points(&a, &b, start, near, &different, &never()), []);
        // Far off, and nothing to tell points apart.
        let error = Se3::exp(&Vector6::new(1.0, -0.5, 0.7, 0.3, -0.2, 0.5));
        let [a, b] = room(300, &Se3::identity(), &error);
        assert_eq!(match_points(&a, &b, start, wide, &unknown, &never()), []);
    }
}
