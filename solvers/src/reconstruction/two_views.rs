//! The relative pose of two keyframes from rays alone: the essential matrix that most pairs agree on.
//!
//! LO-RANSAC over five-point samples (Nistér 2004; Chum, Matas and Kittler 2003). The residual of a pair of
//! rays is Sampson's: b·(t × R a) over its standard deviation, first order (Sampson 1982). The pose is
//! refined over its five unknowns, and the information that is left of the rotation when the direction of the
//! translation is eliminated goes with it: a pair with a short baseline says little about the rotation that
//! looks like a shift, and says so. Where all rays are parallel after a turn the translation is open; that is
//! told by the parallax, not refused. Of the translation only the direction is found, and nothing of it is
//! returned.

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Matrix5, Vector3, Vector5};

use super::five_point::essential_matrices;
use super::tangent_basis;
use crate::geometric_verification::{Numbers, distinct, samples_needed};
use crate::geometry::{LieGroup, So3, hat};
use crate::robust::default_threshold;

/// Fewest samples, since noise in a sample hides what agrees.
const MIN_SAMPLES: usize = 24;
/// Most samples.
const MAX_SAMPLES: usize = 600;
/// Steps of a refinement within the search, and of the last one.
const QUICK_STEPS: usize = 3;
const LAST_STEPS: usize = 15;

/// A landmark as two keyframes see it.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayPair {
    pub(super) a: Vector3<f64>,
    pub(super) b: Vector3<f64>,
    pub(super) sigma_a: f64,
    pub(super) sigma_b: f64,
}

/// The outcome.
#[derive(Clone, Debug)]
pub(super) struct TwoViews {
    /// Rotation of `b_from_a`.
    pub(super) rotation: So3,
    /// Information of a left perturbation of it, 1/rad².
    pub(super) information: Matrix3<f64>,
    /// Whether each pair agrees.
    pub(super) inliers: Vec<bool>,
    /// Median angle between the rays of the inliers after the turn, over its standard deviation.
    pub(super) parallax_sigmas: f64,
}

/// A hypothesis: X_b = R X_a + s t, t of unit length.
#[derive(Clone, Copy, Debug)]
struct Motion {
    rotation: So3,
    direction: Vector3<f64>,
}

/// Searches and refines; `None` where fewer than `min_inliers` agree.
pub(super) fn two_views(
    pairs: &[RayPair],
    allowance: f64,
    min_inliers: usize,
    numbers: &mut Numbers,
) -> Option<TwoViews> {
    let gate = default_threshold(1) * allowance * allowance;
    let count = pairs.len();
    if count < min_inliers.max(6) {
        return None;
    }
    let mut best: Option<Motion> = None;
    let (mut most, mut needed, mut drawn) = (0.0, MAX_SAMPLES, 0);
    while drawn < needed.max(MIN_SAMPLES) {
        drawn += 1;
        let sample = distinct::<5>(numbers, count);
        for e in essential_matrices(&sample.map(|k| (pairs[k].a, pairs[k].b))) {
            if support(pairs, &e, gate, most) <= most {
                continue;
            }
            let Some(motion) = decomposed(pairs, &e, gate) else { continue };
            let motion = refined(pairs, motion, gate, QUICK_STEPS).map_or(motion, |r| r.0);
            let gained = support(pairs, &motion.essential(), gate, 0.0);
            if gained > most {
                most = gained;
                let agreeing = pairs.iter().filter(|p| squared(p, &motion.essential()) < gate);
                let share = agreeing.count() as f64 / count as f64;
                needed = samples_needed(share, 5, MAX_SAMPLES);
                best = Some(motion);
            }
        }
    }
    let (motion, hessian) = refined(pairs, best?, gate, LAST_STEPS)?;
    // The refinement may have found the mirrored one.
    let motion = decomposed(pairs, &motion.essential(), gate)?;
    let inliers: Vec<bool> = pairs
        .iter()
        .map(|p| squared(p, &motion.essential()) < gate && motion.is_in_front(p))
        .collect();
    let agreeing = inliers.iter().filter(|&&agrees| agrees).count();
    if agreeing < min_inliers {
        return None;
    }
    let parallax_sigmas = parallax(pairs, &inliers, &motion.rotation);
    let information = rotation_information(&hessian, pairs, &inliers, &motion)?;
    let rotation = motion.rotation;
    Some(TwoViews { rotation, information, inliers, parallax_sigmas })
}

/// Sampson's squared residual, whitened.
#[inline]
fn squared(pair: &RayPair, e: &Matrix3<f64>) -> f64 {
    let (ea, eb) = (e * pair.a, e.tr_mul(&pair.b));
    let error = pair.b.dot(&ea);
    // Only what is across the rays is uncertain.
    let along = error * error;
    let variance = pair.sigma_b * pair.sigma_b * (ea.norm_squared() - along)
        + pair.sigma_a * pair.sigma_a * (eb.norm_squared() - along);
    if variance > 0.0 { along / variance } else { f64::INFINITY }
}

/// The gain of MSAC; 0 as soon as it cannot exceed `most`.
fn support(pairs: &[RayPair], e: &Matrix3<f64>, gate: f64, most: f64) -> f64 {
    let (mut gained, mut left) = (0.0, pairs.len() as f64);
    for pair in pairs {
        let chi2 = squared(pair, e);
        if chi2 < gate {
            gained += 1.0 - chi2 / gate;
        }
        left -= 1.0;
        if gained + left < most {
            return 0.0;
        }
    }
    gained
}

impl Motion {
    fn essential(&self) -> Matrix3<f64> {
        hat(&self.direction) * self.rotation.matrix()
    }

    /// Whether the rays meet in front of both cameras, or are parallel within their noise.
    fn is_in_front(&self, pair: &RayPair) -> bool {
        let turned = self.rotation.rotate(&pair.a);
        let cosine = turned.dot(&pair.b);
        let squared_sine = turned.cross(&pair.b).norm_squared();
        let noise = pair.sigma_a * pair.sigma_a + pair.sigma_b * pair.sigma_b;
        if cosine > 0.0 && squared_sine < 9.0 * noise {
            return true;
        }
        let (along_a, along_b) = (turned.dot(&self.direction), pair.b.dot(&self.direction));
        cosine * along_b - along_a > 0.0 && along_b - cosine * along_a > 0.0
    }
}

/// The motion of an essential matrix that has most agreeing pairs in front of both cameras.
fn decomposed(pairs: &[RayPair], e: &Matrix3<f64>, gate: f64) -> Option<Motion> {
    let svd = e.try_svd(true, true, f64::EPSILON, 100)?;
    let (mut u, mut v_t) = (svd.u?, svd.v_t?);
    // The direction belongs to the singular value that is zero.
    let least = svd.singular_values.imin();
    if least != 2 {
        u.swap_columns(least, 2);
        v_t.swap_rows(least, 2);
    }
    if u.determinant() < 0.0 {
        u = -u;
    }
    if v_t.determinant() < 0.0 {
        v_t = -v_t;
    }
    let direction = u.column(2).into_owned();
    let turn = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let rotations = [u * turn * v_t, u * turn.transpose() * v_t].map(|r| So3::from_matrix(&r));
    let agreeing: Vec<&RayPair> = pairs.iter().filter(|p| squared(p, e) < gate).collect();
    let mut best: Option<(usize, Motion)> = None;
    for rotation in rotations {
        for direction in [direction, -direction] {
            let motion = Motion { rotation, direction };
            let count = agreeing.iter().filter(|p| motion.is_in_front(p)).count();
            if best.is_none_or(|(most, _)| count > most) {
                best = Some((count, motion));
            }
        }
    }
    best.map(|(_, motion)| motion).filter(|motion| motion.rotation.is_finite())
}

/// The motion with the least truncated cost nearby, and the Hessian of (turn, two of the direction).
fn refined(
    pairs: &[RayPair],
    start: Motion,
    gate: f64,
    steps: usize,
) -> Option<(Motion, Matrix5<f64>)> {
    let mut motion = start;
    let (mut cost, mut hessian, mut gradient) = linearized(pairs, &motion, gate);
    let mut damping = 1e-4;
    for _ in 0..steps {
        let mut damped = hessian;
        for k in 0..5 {
            damped[(k, k)] += damping * hessian[(k, k)] + 1e-9;
        }
        let step = -damped.cholesky()?.solve(&gradient);
        let turn: Vector3<f64> = step.fixed_rows::<3>(0).into_owned();
        let shift = tangent_basis(&motion.direction) * step.fixed_rows::<2>(3);
        let trial = Motion {
            rotation: So3::exp(&turn).compose(&motion.rotation),
            direction: (motion.direction + shift).try_normalize(1e-12)?,
        };
        let next = linearized(pairs, &trial, gate);
        if next.0 < cost {
            let gain = cost - next.0;
            (motion, (cost, hessian, gradient)) = (trial, next);
            damping *= 0.1;
            if gain < 1e-8 * cost {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    Some((motion, hessian))
}

/// ½ Σ min(χ², gate) with the normal equations of what is below the gate.
fn linearized(pairs: &[RayPair], motion: &Motion, gate: f64) -> (f64, Matrix5<f64>, Vector5<f64>) {
    let e = motion.essential();
    let tangent: Matrix3x2<f64> = tangent_basis(&motion.direction);
    let (mut cost, mut hessian, mut gradient) = (0.0, Matrix5::zeros(), Vector5::zeros());
    for pair in pairs {
        let chi2 = squared(pair, &e);
        if chi2.is_nan() || chi2 >= gate {
            cost += 0.5 * gate;
            continue;
        }
        cost += 0.5 * chi2;
        let turned = motion.rotation.rotate(&pair.a);
        let error = pair.b.dot(&motion.direction.cross(&turned));
        // χ² is the squared error over its variance, which is held.
        let weight = if error == 0.0 { 0.0 } else { (chi2.sqrt() / error.abs()).max(0.0) };
        let of_turn = turned.cross(&pair.b.cross(&motion.direction));
        let of_direction = tangent.tr_mul(&turned.cross(&pair.b));
        let row =
            Vector5::new(of_turn.x, of_turn.y, of_turn.z, of_direction.x, of_direction.y) * weight;
        hessian += row * row.transpose();
        gradient += row * (error * weight);
    }
    (cost, hessian, gradient)
}

/// What is left of the rotation's information when the direction is eliminated. Of the direction nothing
/// is known beforehand but that it is one, which is worth one radian.
fn rotation_information(
    hessian: &Matrix5<f64>,
    pairs: &[RayPair],
    inliers: &[bool],
    motion: &Motion,
) -> Option<Matrix3<f64>> {
    let e = motion.essential();
    let agreeing = pairs.iter().zip(inliers).filter(|(_, agrees)| **agrees);
    let (sum, count) =
        agreeing.fold((0.0, 0.0), |(sum, count), (p, _)| (sum + squared(p, &e), count + 1.0));
    let variance = (sum / f64::max(count - 5.0, 1.0)).max(1.0);
    let turn: Matrix3<f64> = hessian.fixed_view::<3, 3>(0, 0) / variance;
    let cross: Matrix3x2<f64> = hessian.fixed_view::<3, 2>(0, 3) / variance;
    let direction: Matrix2<f64> = hessian.fixed_view::<2, 2>(3, 3) / variance + Matrix2::identity();
    let left = turn - cross * direction.try_inverse()? * cross.transpose();
    left.iter().all(|v| v.is_finite()).then(|| (left + left.transpose()) * 0.5)
}

/// Median angle between the rays of the inliers after the turn, in standard deviations.
fn parallax(pairs: &[RayPair], inliers: &[bool], rotation: &So3) -> f64 {
    let agreeing = pairs.iter().zip(inliers).filter(|(_, agrees)| **agrees);
    let angles = agreeing.map(|(pair, _)| {
        let turned = rotation.rotate(&pair.a);
        let angle = turned.cross(&pair.b).norm().atan2(turned.dot(&pair.b));
        angle / pair.sigma_a.hypot(pair.sigma_b)
    });
    super::median(&mut angles.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Se3;
    use crate::testing::random::{normal_vector, seeded, uniform_vector, unit_vector};

    const SIGMA: f64 = 1e-3;

    fn scene(b_from_a: &Se3, count: usize, wrong: usize, seed: u64) -> Vec<RayPair> {
        let mut rng = seeded(seed);
        let mut noisy =
            |ray: Vector3<f64>| (ray.normalize() + normal_vector::<3>(&mut rng, SIGMA)).normalize();
        let mut points = seeded(seed + 100);
        (0..count)
            .map(|k| {
                let spread: Vector3<f64> = uniform_vector(&mut points, 2.0);
                let a = spread + Vector3::new(0.0, 0.0, 5.0);
                let b = b_from_a.transform(&a);
                let random = unit_vector(&mut points);
                let b = if k < wrong { Vector3::new(random.x, random.y, 2.0) } else { b };
                RayPair { a: noisy(a), b: noisy(b), sigma_a: SIGMA, sigma_b: SIGMA }
            })
            .collect()
    }

    #[test]
    fn the_rotation_is_found_among_wrong_matches_with_an_honest_information() {
        let b_from_a =
            Se3::new(So3::exp(&Vector3::new(0.1, -0.3, 0.2)), Vector3::new(1.0, 0.2, -0.3));
        let chi2_of = |wrong: usize| -> f64 {
            let of_seed = |seed: u64| {
                let pairs = scene(&b_from_a, 60, wrong, seed);
                let found = two_views(&pairs, 1.5, 10, &mut Numbers::new(seed)).unwrap();
                let error = found.rotation.compose(&b_from_a.rotation.inverse()).log();
                assert!(error.norm() < 0.02, "seed {seed}: {error:?}");
                let kept = found.inliers[wrong..].iter().filter(|&&agrees| agrees).count();
                assert!(kept + 7 >= 60 - wrong, "seed {seed}: {kept}");
                assert!(found.parallax_sigmas > 30.0);
                error.dot(&(found.information * error))
            };
            (0..40).map(of_seed).sum::<f64>() / 40.0
        };
        // Three degrees of freedom. A wrong match agrees by chance where it lies on the epipolar line,
        // and makes the fit worse than it says.
        let (clean, contaminated) = (chi2_of(0), chi2_of(15));
        assert!((1.5..5.0).contains(&clean), "{clean}");
        assert!((1.5..10.0).contains(&contaminated), "{contaminated}");
    }

    #[test]
    fn a_turn_without_translation_has_no_parallax() {
        let b_from_a = Se3::new(So3::exp(&Vector3::new(0.05, 0.2, 0.0)), Vector3::zeros());
        let found = two_views(&scene(&b_from_a, 60, 0, 5), 1.5, 10, &mut Numbers::new(1)).unwrap();
        assert!(found.parallax_sigmas < 2.0, "{}", found.parallax_sigmas);
        // How much depends on which direction the noise suggests.
        let error = found.rotation.compose(&b_from_a.rotation.inverse()).log();
        assert!(error.dot(&(found.information * error)) < 30.0);
    }

    #[test]
    fn matches_without_a_common_motion_are_refused() {
        let b_from_a = Se3::new(So3::identity(), Vector3::x());
        let pairs = scene(&b_from_a, 40, 40, 9);
        assert!(two_views(&pairs, 1.5, 15, &mut Numbers::new(1)).is_none());
    }
}
