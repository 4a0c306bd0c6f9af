//! Observations one by one, through the factors: slow, and exact where the kernels give up.
//!
//! Kernels only notice that a sum is not finite. Here the first observation that is at fault is
//! named, and one without a finite projection is left out of H and g while its cost is the loss at
//! infinity (finite under Tukey's). Tests hold the kernels against this file.

use super::PointObservation;
use super::normal_equations::Evaluation;
use crate::factors::Reprojection;
use crate::geometry::{Camera, Se3};
use crate::loss::Loss;
use crate::problem::SolveError;

impl PointObservation {
    fn factor(&self) -> Reprojection {
        Reprojection { pixel: self.pixel, sigma_px: self.sigma_px, depth_m: self.depth_m }
    }

    fn squared_error(&self, pose: &Se3, camera: &Camera) -> f64 {
        self.factor().squared_error(pose, camera, &self.point_in_world)
    }
}

/// Names the first observation that cannot be solved with from `pose`.
pub(super) fn validate(
    observations: &[PointObservation],
    pose: &Se3,
    camera: &Camera,
) -> Result<(), SolveError> {
    let positive = |x: f64| x.is_finite() && x > 0.0;
    for (index, o) in observations.iter().enumerate() {
        let factor = "observation";
        let mut numbers = o.point_in_world.iter().chain(o.pixel.iter());
        let depth = o.depth_m.is_none_or(|(depth, _)| depth.is_finite());
        if !(depth && numbers.all(|x| x.is_finite())) {
            return Err(SolveError::NotFinite { what: factor, index: index as i64 });
        }
        if !(positive(o.sigma_px) && o.depth_m.is_none_or(|(_, sigma)| positive(sigma))) {
            return Err(SolveError::NotPositiveDefinite { factor, index });
        }
        if !o.squared_error(pose, camera).is_finite() {
            return Err(SolveError::ResidualNotFinite { factor, index });
        }
    }
    Ok(())
}

/// Cost, H and g at `pose`.
pub(super) fn evaluate(
    observations: &[PointObservation],
    pose: &Se3,
    camera: &Camera,
    loss: Loss,
) -> Evaluation {
    let mut sum = Evaluation::zero();
    for o in observations {
        sum.cost += 0.5 * loss.evaluate(o.squared_error(pose, camera)).rho;
        if let Some(l) = o.factor().linearize(pose, camera, &o.point_in_world) {
            let weight = loss.evaluate(l.residual.norm_squared()).weight;
            let left = l.d_pose.transpose() * weight;
            sum.hessian += left * l.d_pose;
            sum.gradient += left * l.residual;
        }
    }
    sum
}
