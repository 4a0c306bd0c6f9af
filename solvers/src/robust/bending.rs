//! The most probable poses along a row of measured steps whose end is known.
//!
//! Let Z_k be the steps with covariances Σ_k and F the end in the frame of the first pose. The noise
//! n_k of least Σ n_kᵀ Σ_k⁻¹ n_k with Π Z_k Exp(n_k) = F has one multiplier λ for all of the row, n_k =
//! Σ_k B_kᵀ λ with B_k = Ad(F⁻¹ P_k), where P_k is the pose after step k (Ad(P_k⁻¹ F) brings a
//! perturbation of the end back to it). So the row is found by shooting: λ has as many numbers as a
//! pose, and the end that a λ leads to says how to change it (Broyden's method). Exact to first order
//! in the single n_k, however far the whole row is bent. In a graph, the measurement of the end that
//! the path gives replaces the row ([`Bend::measurement`]). Knows no graph.

use nalgebra::{SMatrix, SVector};

use super::chain::UncertainMotion;
use crate::geometry::LieGroup;

/// Most paths that are tried; a row whose end is a few standard deviations off takes four or five.
const MAX_PATHS: usize = 20;

/// The largest χ² of what is left of the error at the end: far below that of any edge.
const LEAST_ERROR: f64 = 1e-12;

/// The most probable path to one end, and how it changes with the end.
#[derive(Clone, Copy)]
pub(super) struct Bend<G, const N: usize> {
    /// The end in the frame of the first pose.
    end: G,
    /// λ in the frame of the end.
    multiplier: SVector<f64, N>,
    /// C = Σ B_k Σ_k B_kᵀ: the end moves by C δλ.
    covariance: SMatrix<f64, N, N>,
}

/// The pose after each step in the frame of the first pose, and λ where the path is the most probable.
pub(super) struct Path<G, const N: usize> {
    pub(super) poses: Vec<G>,
    multiplier: Option<SVector<f64, N>>,
}

impl<G: LieGroup<N>, const N: usize> Bend<G, N> {
    /// The path without noise; `way` is all steps composed.
    pub(super) fn none(way: &UncertainMotion<G, N>) -> Self {
        Self { end: way.motion, multiplier: SVector::zeros(), covariance: way.covariance }
    }

    /// That of the most probable `path` along `steps`.
    pub(super) fn of(steps: &[UncertainMotion<G, N>], path: &Path<G, N>) -> Option<Self> {
        let (&end, multiplier) = path.poses.last().zip(path.multiplier)?;
        let to_end = end.inverse();
        let mut covariance = SMatrix::zeros();
        let mut at = G::identity();
        for (step, pose) in steps.iter().zip(&path.poses) {
            let adjoint = to_end.compose(&at).compose(&step.motion).adjoint();
            covariance += adjoint * step.covariance * adjoint.transpose();
            at = *pose;
        }
        Some(Self { end, multiplier, covariance })
    }

    /// One measurement in place of all steps. With the path's end it has the χ² of the steps and its
    /// gradient: χ² = λᵀCλ is that of the residual r = Cλ, and J⁻ᵀC⁻¹J⁻¹ with J = J_r⁻¹(r) leaves r as it
    /// is, since J_r(r) r = r.
    pub(super) fn measurement(&self) -> UncertainMotion<G, N> {
        let residual = self.covariance * self.multiplier;
        let jacobian = G::right_jacobian_inverse(&residual);
        let covariance = jacobian * self.covariance * jacobian.transpose();
        UncertainMotion { motion: self.end.compose(&G::exp(&-residual)), covariance }
    }
}

/// The path along `steps` whose last pose is at `end`, found from the path to an end near by; without an
/// end that without noise.
pub(super) fn bend<G: LieGroup<N>, const N: usize>(
    steps: &[UncertainMotion<G, N>],
    near: &Bend<G, N>,
    end: Option<&G>,
) -> Path<G, N> {
    let without_noise = || {
        let poses = path(steps, &G::identity(), &SVector::zeros());
        Path { poses, multiplier: None }
    };
    let Some((end, root)) = end.zip(near.covariance.cholesky()) else { return without_noise() };
    let root = root.l();
    // Whitened, a change of the multiplier moves the end by about as much.
    let error = |at: &G| root.solve_lower_triangular(&at.inverse().compose(end).log());
    let to_end = end.inverse();
    let mut left = error(&near.end).filter(|left| left.norm_squared().is_finite());
    // The same noise in the frame of the new end.
    let from_near = near.end.inverse().compose(end).adjoint();
    let mut whitened = root.tr_mul(&from_near.tr_mul(&near.multiplier));
    let mut inverse = SMatrix::<f64, N, N>::identity();
    let mut best: Option<(f64, Path<G, N>)> = None;
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
            best = Some((chi2, Path { poses, multiplier: Some(multiplier) }));
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
    best.map_or_else(without_noise, |(_, found)| found)
}

/// The poses for a multiplier in the frame of the end.
fn path<G: LieGroup<N>, const N: usize>(
    steps: &[UncertainMotion<G, N>],
    to_end: &G,
    multiplier: &SVector<f64, N>,
) -> Vec<G> {
    let is_straight = multiplier.iter().all(|x| *x == 0.0);
    let mut at = G::identity();
    let step = |step: &UncertainMotion<G, N>| {
        at = at.compose(&step.motion);
        if !is_straight {
            let to = to_end.compose(&at).adjoint();
            at = at.plus(&(step.covariance * to.tr_mul(multiplier)));
        }
        at
    };
    steps.iter().map(step).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::geometry::Se3;
    use crate::testing::random::{element, perturbed, seeded};

    /// Steps with the covariances of `sigmas`, and all of them composed.
    fn row(
        count: usize,
        sigmas: &Vector6<f64>,
    ) -> (Vec<UncertainMotion<Se3, 6>>, UncertainMotion<Se3, 6>) {
        let mut rng = seeded(7);
        let covariance = SMatrix::from_diagonal(&sigmas.component_mul(sigmas));
        let step = |_| UncertainMotion { motion: element(&mut rng, 0.3), covariance };
        let steps: Vec<UncertainMotion<Se3, 6>> = (0..count).map(step).collect();
        let way = steps.iter().fold(UncertainMotion::exact(), |way, step| way.compose(step));
        (steps, way)
    }

    /// What each step is off between the poses.
    fn noise(steps: &[UncertainMotion<Se3, 6>], poses: &[Se3]) -> Vec<Vector6<f64>> {
        let mut at = Se3::identity();
        let of = |(step, pose): (&UncertainMotion<Se3, 6>, &Se3)| {
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
            let path = bend(&steps, &Bend::none(&way), Some(&end));
            let poses = &path.poses;
            assert!(poses.last().unwrap().minus(&end).norm() < 1e-4 * scale, "{seed}");
            let chi2 = |poses: &[Se3]| -> f64 {
                let of = |noise: Vector6<f64>| noise.component_div(&sigmas).norm_squared();
                noise(&steps, poses).into_iter().map(of).sum()
            };
            let least = chi2(poses);
            for pose in [0, 100, 150, 298] {
                for axis in 0..6 {
                    for sign in [-1.0, 1.0] {
                        let mut other = poses.clone();
                        let mut tangent = Vector6::zeros();
                        tangent[axis] = sign * sigmas[axis];
                        other[pose] = other[pose].plus(&tangent);
                        assert!(chi2(&other) > least, "{seed} {pose} {axis}");
                    }
                }
            }
            assert!(least < 1.3 * scale * scale, "{seed}: {least}");
        }
    }

    #[test]
    fn the_measurement_of_a_bent_row_has_its_cost_and_its_gradient() {
        let sigmas = Vector6::new(0.02, 0.01, 0.01, 0.002, 0.004, 0.002);
        let (steps, way) = row(300, &sigmas);
        let root = way.covariance.cholesky().unwrap().l();
        let off: Se3 = perturbed(&mut seeded(4), &Se3::identity(), &Vector6::repeat(1.0));
        let end = way.motion.plus(&(root * off.log().normalize() * 3.0));
        let path = bend(&steps, &Bend::none(&way), Some(&end));
        let bent = Bend::of(&steps, &path).unwrap();
        let least = |end: &Se3| -> f64 {
            let path = bend(&steps, &bent, Some(end));
            let of = |noise: Vector6<f64>| noise.component_div(&sigmas).norm_squared();
            noise(&steps, &path.poses).into_iter().map(of).sum()
        };
        let measured = bent.measurement();
        let information = measured.covariance.try_inverse().unwrap();
        let of_measurement = |end: &Se3| {
            let residual = end.minus(&measured.motion);
            residual.dot(&(information * residual))
        };
        let cost = least(&end);
        assert!((of_measurement(&end) / cost - 1.0).abs() < 1e-6);
        // Along each direction that the row leaves open, a hundredth of a standard deviation.
        for direction in 0..6 {
            let step = root.column(direction) * 0.01;
            let slope =
                |cost: &dyn Fn(&Se3) -> f64| cost(&end.plus(&step)) - cost(&end.plus(&-step));
            let (of_row, of_edge) = (slope(&least), slope(&of_measurement));
            assert!((of_row - of_edge).abs() < 1e-3 * 0.04 * cost.sqrt(), "{of_row} {of_edge}");
        }
    }

    #[test]
    fn a_branch_without_an_end_is_its_steps() {
        let (steps, way) = row(20, &Vector6::repeat(0.01));
        let poses = bend(&steps, &Bend::none(&way), None).poses;
        assert!(poses.last().unwrap().minus(&way.motion).norm() < 1e-12);
    }
}
