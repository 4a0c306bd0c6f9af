//! The relative pose of two keyframes from the landmarks that both see.
//!
//! A landmark is a point with a covariance in the frame of keyframe a, made from the views of a and of
//! keyframes before it ([`PointEstimate::from_views`]). Keyframe b sees it at a pixel, maybe with a
//! depth. [`measure`] minimizes Σ ρ(rᵀ C⁻¹ r) over a_from_b, where C = R + J Σ Jᵀ adds what the point
//! itself is uncertain by: the landmark is eliminated to first order, and H is what the two keyframes
//! together tell of their relative pose. C is that of the result (iterative reweighting). It reads no map and no poses but its start.

mod calibration;

use nalgebra::{
    Matrix2x3, Matrix3, Matrix3x6, Matrix6, SMatrix, SVector, Vector2, Vector3, Vector6,
};

use crate::geometry::{Camera, LieGroup, Se3};
use crate::information::Information;
use crate::initialization::{TriangulationOptions, View, triangulate};

pub use calibration::{Calibration, calibration_covariance};

/// Fewest matches of a measurement: three determine a pose, and as many again can contradict it.
pub const MIN_MATCHES: usize = 6;

/// Width of Huber's loss on the whitened residual: the 95 % quantile of χ with three degrees of freedom.
pub(crate) const HUBER_WIDTH: f64 = 2.795;

/// Most iterations.
const MAX_ITERATIONS: usize = 30;

/// A step whose length in standard deviations is below this ends the iteration.
const STEP_TOLERANCE: f64 = 1e-6;

/// A landmark in the frame of keyframe a.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointEstimate {
    /// `point_in_a` in meters.
    pub point: Vector3<f64>,
    /// Its covariance in m².
    pub covariance: Matrix3<f64>,
}

impl PointEstimate {
    /// The point of views whose `world_from_camera` is `a_from_camera`. A view with depth is enough;
    /// others need parallax. `None` where the views have no point, or leave it undetermined.
    #[must_use]
    pub fn from_views(views: &[View]) -> Option<Self> {
        let point = triangulate(views, &TriangulationOptions::default()).ok()?.point_in_world;
        let mut information = Matrix3::zeros();
        for view in views {
            let in_camera = view.world_from_camera.inverse_transform(&point);
            let projection = view.camera.project_with_jacobians(&in_camera)?;
            let camera_from_a = view.world_from_camera.rotation.inverse().matrix();
            let d_pixel: Matrix2x3<f64> = projection.d_point * camera_from_a / view.sigma_px;
            information += d_pixel.transpose() * d_pixel;
            if let Some((_, sigma)) = view.depth_m {
                let d_depth = camera_from_a.row(2) / sigma;
                information += d_depth.transpose() * d_depth;
            }
        }
        let covariance = information.cholesky()?.inverse();
        Some(Self { point, covariance })
    }
}

/// A landmark that keyframe b sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Where it is by keyframe a.
    pub landmark: PointEstimate,
    /// Where b sees it: (u, v) in pixels.
    pub pixel: Vector2<f64>,
    /// Standard deviation of u and of v in pixels.
    pub sigma_px: f64,
    /// Depth that b measured, and its standard deviation, in meters.
    pub depth_m: Option<(f64, f64)>,
}

/// A measured relative pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativeMotion {
    /// The pose of b in the frame of a.
    pub a_from_b: Se3,
    /// Information of a right perturbation of it, translation first. Where the residuals are larger
    /// than their standard deviations claim, it is less by their variance factor.
    pub information: Information<6>,
    /// Σ w rᵀC⁻¹r over the degrees of freedom, w the weights of the loss.
    pub variance_factor: f64,
}

/// One evaluation of the cost.
struct Linearized {
    cost: f64,
    hessian: Matrix6<f64>,
    gradient: Vector6<f64>,
    /// Σ w rᵀC⁻¹r.
    weighted: f64,
    /// Rows of the matches that project.
    rows: usize,
    /// C⁻¹ of each match that projects.
    informations: Vec<Option<Matrix3<f64>>>,
}

impl Linearized {
    /// The cost of another pose by the same C; infinite where a match does not project any more.
    ///
    /// C turns with the pose, and is not to be minimized over: a pose would gain by making it large.
    fn cost_at(&self, camera: &Camera, matches: &[Match], a_from_b: &Se3) -> f64 {
        let mut cost = 0.0;
        for (seen, information) in matches.iter().zip(&self.informations) {
            let Some(information) = information else { continue };
            let Some((r, _)) = difference(camera, seen, a_from_b) else { return f64::INFINITY };
            cost += huber(r.dot(&(information * r)));
        }
        cost
    }
}

/// Measures the relative pose of two keyframes, from a start that may be rough.
///
/// `None` where fewer than [`MIN_MATCHES`] matches project, where the pose is not determined in all six
/// directions, or where less than half of the matches fit it.
#[must_use]
pub fn measure(camera_b: &Camera, matches: &[Match], start: &Se3) -> Option<RelativeMotion> {
    let mut pose = *start;
    let mut now = linearize(camera_b, matches, &pose)?;
    let mut damping = 1e-6;
    for _ in 0..MAX_ITERATIONS {
        let mut damped = now.hessian;
        for k in 0..6 {
            damped[(k, k)] *= 1.0 + damping;
        }
        let step = -damped.cholesky()?.solve(&now.gradient);
        let trial = pose.compose(&Se3::exp(&step));
        let length = step.dot(&(now.hessian * step)).max(0.0).sqrt();
        let next = match now.cost_at(camera_b, matches, &trial) <= now.cost {
            true => linearize(camera_b, matches, &trial).filter(|next| next.rows >= now.rows),
            false => None,
        };
        match next {
            Some(next) => {
                (pose, now) = (trial, next);
                damping = (damping * 0.2).max(1e-12);
            }
            None => damping *= 10.0,
        }
        if length < STEP_TOLERANCE || damping > 1e9 {
            break;
        }
    }
    let fitting = matches.iter().filter(|seen| {
        residual(camera_b, seen, &pose).is_some_and(|r| r.squared <= HUBER_WIDTH * HUBER_WIDTH)
    });
    if 2 * fitting.count() < matches.len() {
        return None;
    }
    let freedom = now.rows.checked_sub(6).filter(|&freedom| freedom > 0)?;
    let variance_factor = now.weighted / freedom as f64;
    let information = Information::new(&(now.hessian / variance_factor.max(1.0))).ok()?;
    let is_sound = pose.is_finite() && information.is_definite();
    is_sound.then_some(RelativeMotion { a_from_b: pose, information, variance_factor })
}

/// A match at a pose.
struct Residual {
    /// rᵀC⁻¹r.
    squared: f64,
    /// C⁻¹r.
    weighted: Vector3<f64>,
    /// C⁻¹.
    information: Matrix3<f64>,
    /// ∂r/∂δ of a right perturbation.
    jacobian: Matrix3x6<f64>,
    rows: usize,
}

/// rᵀC⁻¹r of a match at a pose, and the number of its rows; `None` where it does not project.
pub(crate) fn squared_error(camera: &Camera, seen: &Match, a_from_b: &Se3) -> Option<(f64, usize)> {
    residual(camera, seen, a_from_b).map(|r| (r.squared, r.rows))
}

/// r of a match at a pose, and the point in the frame of b; `None` where it does not project.
fn difference(
    camera: &Camera,
    seen: &Match,
    a_from_b: &Se3,
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let point = a_from_b.inverse_transform(&seen.landmark.point);
    if point.z <= 0.0 {
        return None;
    }
    let pixel = camera.project(&point)? - seen.pixel;
    let depth = seen.depth_m.map_or(0.0, |(depth, _)| point.z - depth);
    Some((pixel.push(depth), point))
}

fn residual(camera: &Camera, seen: &Match, a_from_b: &Se3) -> Option<Residual> {
    let (r, point) = difference(camera, seen, a_from_b)?;
    let projection = camera.project_with_jacobians(&point)?;
    let mut d_point = Matrix3::zeros();
    d_point.fixed_view_mut::<2, 3>(0, 0).copy_from(&projection.d_point);
    let variance_px = seen.sigma_px * seen.sigma_px;
    let mut noise = Vector3::new(variance_px, variance_px, 1.0);
    let rows = match seen.depth_m {
        Some((_, sigma)) => {
            d_point[(2, 2)] = 1.0;
            noise.z = sigma * sigma;
            3
        }
        None => 2,
    };
    let b_from_a = a_from_b.rotation.inverse().matrix();
    let of_point = d_point * b_from_a;
    let covariance =
        of_point * seen.landmark.covariance * of_point.transpose() + Matrix3::from_diagonal(&noise);
    let information = covariance.cholesky()?.inverse();
    // T Exp(δ) takes the point to Exp(−δ) p = p − δ_t + p × δ_r.
    let mut of_pose = SMatrix::<f64, 3, 6>::zeros();
    of_pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&-Matrix3::identity());
    of_pose.fixed_view_mut::<3, 3>(0, 3).copy_from(&point.cross_matrix());
    let weighted: SVector<f64, 3> = information * r;
    let squared = r.dot(&weighted);
    let jacobian = d_point * of_pose;
    squared.is_finite().then_some(Residual { squared, weighted, information, jacobian, rows })
}

/// The weight of Huber's loss.
fn huber_weight(squared: f64) -> f64 {
    let norm = squared.max(0.0).sqrt();
    if norm <= HUBER_WIDTH { 1.0 } else { HUBER_WIDTH / norm }
}

/// Huber's loss.
fn huber(squared: f64) -> f64 {
    let norm = squared.max(0.0).sqrt();
    if norm <= HUBER_WIDTH { 0.5 * squared } else { HUBER_WIDTH * (norm - 0.5 * HUBER_WIDTH) }
}

/// `None` where fewer than [`MIN_MATCHES`] matches project.
fn linearize(camera: &Camera, matches: &[Match], a_from_b: &Se3) -> Option<Linearized> {
    let mut sum = Linearized {
        cost: 0.0,
        hessian: Matrix6::zeros(),
        gradient: Vector6::zeros(),
        weighted: 0.0,
        rows: 0,
        informations: Vec::with_capacity(matches.len()),
    };
    let mut count = 0;
    for seen in matches {
        let found = residual(camera, seen, a_from_b);
        sum.informations.push(found.as_ref().map(|r| r.information));
        let Some(r) = found else { continue };
        let weight = huber_weight(r.squared);
        sum.cost += huber(r.squared);
        sum.hessian += weight * r.jacobian.transpose() * r.information * r.jacobian;
        sum.gradient += weight * r.jacobian.transpose() * r.weighted;
        sum.weighted += weight * r.squared;
        sum.rows += r.rows;
        count += 1;
    }
    (count >= MIN_MATCHES).then_some(sum)
}

#[cfg(test)]
mod tests;
