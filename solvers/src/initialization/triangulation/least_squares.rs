//! The nearest point to all viewing rays, and its refinement on the whitened errors.
//!
//! The start is linear (midpoint method, any number of views) and knows nothing of sigmas; the
//! refinement is least squares with three unknowns and dense normal equations. Neither knows on which
//! side of a camera a point lies; the caller checks.

use nalgebra::{Matrix3, Vector3};

use super::View;
use crate::factors::Reprojection;

/// Refinement steps; the start is close, so that few are needed.
const REFINEMENT_STEPS: usize = 10;

/// A viewing ray in the world.
pub(super) struct Ray {
    pub(super) center: Vector3<f64>,
    /// Of unit length.
    pub(super) direction: Vector3<f64>,
    /// The direction in the camera's frame, not normalized.
    in_camera: Vector3<f64>,
}

impl Ray {
    pub(super) fn new(view: &View) -> Option<Self> {
        let in_camera = view.camera.unproject(&view.pixel)?;
        let direction =
            view.world_from_camera.rotation.rotate(&in_camera).try_normalize(f64::MIN_POSITIVE)?;
        Some(Self { center: view.world_from_camera.translation, direction, in_camera })
    }

    /// The point at the view's measured depth, where it has one that says more than that it is ahead.
    pub(super) fn at_depth(&self, view: &View) -> Option<Vector3<f64>> {
        let (depth_m, _) = view.depth_m.filter(|(depth_m, sigma_m)| sigma_m < depth_m)?;
        let point_in_camera = self.in_camera * (depth_m / self.in_camera.z);
        (self.in_camera.z > 0.0).then(|| view.world_from_camera.transform(&point_in_camera))
    }
}

/// The largest angle between two of `directions`, in radians.
pub(super) fn largest_angle(directions: impl Iterator<Item = Vector3<f64>> + Clone) -> f64 {
    let mut largest: f64 = 0.0;
    for (index, d) in directions.clone().enumerate() {
        for e in directions.clone().take(index) {
            largest = largest.max(d.cross(&e).norm().atan2(d.dot(&e)));
        }
    }
    largest
}

/// The point with the least sum of squared distances to `rays`: Σ (I − d dᵀ) X = Σ (I − d dᵀ) c with
/// ray directions d and camera centers c.
pub(super) fn nearest_point(rays: &[Ray]) -> Option<Vector3<f64>> {
    let mut matrix = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for ray in rays {
        let projector = Matrix3::identity() - ray.direction * ray.direction.transpose();
        matrix += projector;
        right += projector * ray.center;
    }
    matrix.cholesky().map(|c| c.solve(&right))
}

/// Levenberg-Marquardt on the whitened reprojection (and depth) errors; returns the best point met. A
/// point behind a camera has an error like any other: the caller checks where the result lies.
pub(super) fn refine(views: &[View], start: Vector3<f64>) -> Vector3<f64> {
    let mut point = start;
    let (mut cost, _) = squared_error(views, &point);
    let mut damping = 1e-6;
    for _ in 0..REFINEMENT_STEPS {
        let mut hessian = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        for view in views {
            let seen = view.factor();
            if let Some(l) = seen.linearize(&view.world_from_camera, &view.camera, &point) {
                hessian += l.d_landmark.transpose() * l.d_landmark;
                gradient += l.d_landmark.transpose() * l.residual;
            }
        }
        for i in 0..3 {
            hessian[(i, i)] *= 1.0 + damping;
        }
        let Some(factor) = hessian.cholesky() else { return point };
        let trial = point - factor.solve(&gradient);
        let (trial_cost, _) = squared_error(views, &trial);
        if trial_cost < cost {
            let done = cost - trial_cost <= 1e-12 * cost;
            (point, cost, damping) = (trial, trial_cost, damping * 0.1);
            if done {
                return point;
            }
        } else {
            damping = (damping * 10.0).max(1e-6);
        }
    }
    point
}

/// Σ of squared whitened residuals and how many residuals there are; infinite where one has none.
pub(super) fn squared_error(views: &[View], point: &Vector3<f64>) -> (f64, usize) {
    let mut sum = 0.0;
    let mut count = 0;
    for view in views {
        sum += view.factor().squared_error(&view.world_from_camera, &view.camera, point);
        count += if view.depth_m.is_some() { 3 } else { 2 };
    }
    (sum, count)
}

impl View {
    fn factor(&self) -> Reprojection {
        Reprojection { pixel: self.pixel, sigma_px: self.sigma_px, depth_m: self.depth_m }
    }
}
