//! The most probable poses along a row of measured steps whose end is known.
//!
//! Let Z_k be the steps with covariances Σ_k and F the end in the frame of the first pose. The noise n_k
//! of least Σ n_kᵀ Σ_k⁻¹ n_k with Π Z_k Exp(n_k) = F has one multiplier λ for all of the row,
//! n_k = Σ_k B_kᵀ λ with B_k = Ad(F⁻¹ P_k), where P_k is the pose after step k (Ad(P_k⁻¹ F) brings a
//! perturbation of the end back to it). So the row is found by shooting: λ has as many numbers as a pose,
//! and the end that a λ leads to says how to change it (Broyden's method). Exact to first order in the
//! single n_k, however far the whole row is bent. Knows no graph.

use nalgebra::{SMatrix, SVector};

use super::chain::Measured;
use crate::geometry::LieGroup;

/// Most paths that are tried; a row whose end is a few standard deviations off takes four or five.
const MAX_PATHS: usize = 12;

/// The largest χ² of what is left of the error at the end: far below that of any edge.
const LEAST_ERROR: f64 = 1e-8;

/// The pose after each of `steps` in the frame of the first pose, where the last one is at `end`; `way`
/// is all steps composed. Without an end they are the steps composed.
pub(super) fn bend<G: LieGroup<N>, const N: usize>(
    steps: &[Measured<G, N>],
    way: &Measured<G, N>,
    end: Option<&G>,
) -> Vec<G> {
    let straight = SVector::zeros();
    let Some((end, root)) = end.zip(way.covariance.cholesky()) else {
        return path(steps, &G::identity(), &straight);
    };
    let root = root.l();
    // Whitened, a change of the multiplier moves the end by about as much.
    let error = |at: &G| root.solve_lower_triangular(&at.inverse().compose(end).log());
    let to_end = end.inverse();
    let mut left = error(&way.motion).filter(|left| left.norm_squared().is_finite());
    let mut whitened = SVector::<f64, N>::zeros();
    let mut inverse = SMatrix::<f64, N, N>::identity();
    let mut best: Option<(f64, Vec<G>)> = None;
    for _ in 0..MAX_PATHS {
        let Some(before) = left else { break };
        let change = inverse * before;
        whitened += change;
        let Some(multiplier) = root.tr_solve_lower_triangular(&whitened) else { break };
        let poses = path(steps, &to_end, &multiplier);
        left = poses.last().and_then(&error).filter(|left| left.norm_squared().is_finite());
        let Some(after) = left else { break };
        let chi2 = after.norm_squared();
        if best.as_ref().is_none_or(|(least, _)| chi2 < *least) {
            best = Some((chi2, poses));
        }
        if chi2 < LEAST_ERROR {
            break;
        }
        let moved = before - after;
        let along = change.transpose() * inverse;
        let scale = (along * moved).x;
        if scale.abs() > f64::MIN_POSITIVE {
            inverse += (change - inverse * moved) * along / scale;
        }
    }
    let start = error(&way.motion).map_or(f64::INFINITY, |left| left.norm_squared());
    match best {
        Some((chi2, poses)) if chi2 < LEAST_ERROR => poses,
        Some((chi2, poses)) if chi2 < start => shared(steps, poses, end),
        Some(_) | None => shared(steps, path(steps, &to_end, &straight), end),
    }
}

/// The poses for a multiplier in the frame of the end.
fn path<G: LieGroup<N>, const N: usize>(
    steps: &[Measured<G, N>],
    to_end: &G,
    multiplier: &SVector<f64, N>,
) -> Vec<G> {
    let is_straight = multiplier.iter().all(|x| *x == 0.0);
    let mut at = G::identity();
    let step = |step: &Measured<G, N>| {
        at = at.compose(&step.motion);
        if !is_straight {
            let to = to_end.compose(&at).adjoint();
            at = at.plus(&(step.covariance * to.tr_mul(multiplier)));
        }
        at
    };
    steps.iter().map(step).collect()
}

/// Brings the last pose to `end`; each pose takes part by the variance up to it.
fn shared<G: LieGroup<N>, const N: usize>(
    steps: &[Measured<G, N>],
    mut poses: Vec<G>,
    end: &G,
) -> Vec<G> {
    let Some(last) = poses.last().copied() else { return poses };
    let error = last.inverse().compose(end).log();
    let whole: f64 = steps.iter().map(|step| step.covariance.trace()).sum();
    let mut variance = 0.0;
    for (pose, step) in poses.iter_mut().zip(steps) {
        variance += step.covariance.trace();
        let rest = pose.inverse().compose(&last);
        *pose = pose.plus(&(rest.adjoint() * error * (variance / whole).clamp(0.0, 1.0)));
    }
    poses
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::geometry::Se3;
    use crate::testing::random::{element, perturbed, seeded};

    /// Steps with the covariances of `sigmas`, and all of them composed.
    fn row(count: usize, sigmas: &Vector6<f64>) -> (Vec<Measured<Se3, 6>>, Measured<Se3, 6>) {
        let mut rng = seeded(7);
        let covariance = SMatrix::from_diagonal(&sigmas.component_mul(sigmas));
        let step = |_| Measured { motion: element(&mut rng, 0.3), covariance };
        let steps: Vec<Measured<Se3, 6>> = (0..count).map(step).collect();
        let way = steps.iter().fold(Measured::exact(), |way, step| way.compose(step));
        (steps, way)
    }

    /// What each step is off between the poses.
    fn noise(steps: &[Measured<Se3, 6>], poses: &[Se3]) -> Vec<Vector6<f64>> {
        let mut at = Se3::identity();
        let of = |(step, pose): (&Measured<Se3, 6>, &Se3)| {
            let found = at.inverse().compose(pose);
            at = *pose;
            step.motion.inverse().compose(&found).log()
        };
        steps.iter().zip(poses).map(of).collect()
    }

    #[test]
    fn a_bent_row_meets_its_end_and_no_neighbor_of_it_is_more_probable() {
        let sigmas = Vector6::new(0.02, 0.01, 0.01, 0.002, 0.004, 0.002);
        let (steps, way) = row(300, &sigmas);
        // Some ends are as far off as the noise makes them, one is ten times as far.
        for (seed, scale) in [(1, 1.0), (2, 1.0), (3, 10.0)] {
            let root = way.covariance.cholesky().unwrap().l() * scale;
            let off: Se3 = perturbed(&mut seeded(seed), &Se3::identity(), &Vector6::repeat(1.0));
            let end = way.motion.plus(&(root * off.log().normalize()));
            let poses = bend(&steps, &way, Some(&end));
            assert!(poses.last().unwrap().minus(&end).norm() < 1e-4 * scale, "{seed}");
            let chi2 = |poses: &[Se3]| -> f64 {
                let of = |noise: Vector6<f64>| noise.component_div(&sigmas).norm_squared();
                noise(&steps, poses).into_iter().map(of).sum()
            };
            let least = chi2(&poses);
            for place in [0, 100, 150, 298] {
                for axis in 0..6 {
                    for sign in [-1.0, 1.0] {
                        let mut other = poses.clone();
                        let mut tangent = Vector6::zeros();
                        tangent[axis] = sign * sigmas[axis];
                        other[place] = other[place].plus(&tangent);
                        assert!(chi2(&other) > least, "{seed} {place} {axis}");
                    }
                }
            }
            assert!(least < 1.3 * scale * scale, "{seed}: {least}");
        }
    }

    #[test]
    fn a_branch_without_an_end_is_its_steps() {
        let (steps, way) = row(20, &Vector6::repeat(0.01));
        let poses = bend(&steps, &way, None);
        assert!(poses.last().unwrap().minus(&way.motion).norm() < 1e-12);
    }
}
