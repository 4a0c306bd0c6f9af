//! Refinement of a start: least squares on the whitened reprojection (and depth) errors.
//!
//! Three unknowns, dense normal equations. A point behind a camera has an error like any other, so
//! that the result may lie there: the caller checks.

use nalgebra::{Matrix3, Vector3};

use super::View;
use crate::factors::{DepthReprojection, Linearization, Reprojection};

/// Refinement steps; the start is close, so that few are needed.
const REFINEMENT_STEPS: usize = 10;

/// Levenberg-Marquardt on three unknowns; returns the best point met.
pub(super) fn refine(views: &[View], start: Vector3<f64>) -> Vector3<f64> {
    let mut point = start;
    let (mut cost, _) = squared_error(views, &point);
    let mut damping = 1e-6;
    for _ in 0..REFINEMENT_STEPS {
        let mut hessian = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        for view in views {
            match view.depth_factor() {
                Some(f) => add(
                    f.linearize(&view.world_from_camera, &view.camera, &point),
                    &mut hessian,
                    &mut gradient,
                ),
                None => add(
                    view.factor().linearize(&view.world_from_camera, &view.camera, &point),
                    &mut hessian,
                    &mut gradient,
                ),
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

fn add<const R: usize>(
    linearization: Option<Linearization<R>>,
    hessian: &mut Matrix3<f64>,
    gradient: &mut Vector3<f64>,
) {
    if let Some(l) = linearization {
        *hessian += l.d_landmark.transpose() * l.d_landmark;
        *gradient += l.d_landmark.transpose() * l.residual;
    }
}

/// Σ of squared whitened residuals and how many residuals there are; infinite where one has none.
pub(super) fn squared_error(views: &[View], point: &Vector3<f64>) -> (f64, usize) {
    let mut sum = 0.0;
    let mut count = 0;
    for view in views {
        let squared = match view.depth_factor() {
            Some(factor) => {
                count += 3;
                factor
                    .residual(&view.world_from_camera, &view.camera, point)
                    .map(|r| r.norm_squared())
            }
            None => {
                count += 2;
                view.factor()
                    .residual(&view.world_from_camera, &view.camera, point)
                    .map(|r| r.norm_squared())
            }
        };
        sum += squared.unwrap_or(f64::INFINITY);
    }
    (sum, count)
}

impl View {
    fn factor(&self) -> Reprojection {
        Reprojection { pixel: self.pixel, sigma_px: self.sigma_px }
    }

    fn depth_factor(&self) -> Option<DepthReprojection> {
        let (depth_m, sigma_depth_m) = self.depth_m?;
        let (pixel, sigma_px) = (self.pixel, self.sigma_px);
        Some(DepthReprojection { pixel, depth_m, sigma_px, sigma_depth_m })
    }
}
