//! A landmark's errors as ratios ‖N v‖ / (h·v) of linear functions, one or two a view.
//!
//! v = (y, t) stands for the point `center + scale · y / t`, t ≥ 0: points at infinity are covered and
//! the numbers do not depend on the world's unit. In a camera the point is p = scale · q / t, q linear
//! in v. With n on the measured ray, scaled so that a·n = 1 (a: the optical axis, for a fisheye n):
//! - image: J q / (σ a·q), J = ∂pixel/∂p at n, where J n = 0. This is the whitened reprojection error
//!   of a pinhole without distortion; other lenses are taken as linear about the measured pixel.
//! - depth: (p_z − d) / σ.
//!
//! Quasi-convex where h·v > 0: in front, or on the side of a fisheye's ray. `worst_error` minimizes.

use std::cmp::Ordering;

use nalgebra::{Matrix2x4, Matrix3x4, RowVector4, Vector3, Vector4};

use super::View;
use crate::geometry::Camera;

/// One error of one view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ratio {
    /// N; of a depth the second row is zero.
    pub(super) numerator: Matrix2x4<f64>,
    /// h.
    pub(super) denominator: RowVector4<f64>,
}

impl Ratio {
    /// The error at v, in standard deviations; infinite where h·v is not positive.
    pub(super) fn at(&self, v: &Vector4<f64>) -> f64 {
        let denominator = self.denominator_at(v);
        let error = (self.numerator * v).norm() / denominator;
        let fits = denominator > 0.0 && denominator.is_finite() && !error.is_nan();
        if fits { error } else { f64::INFINITY }
    }

    /// h·v.
    pub(super) fn denominator_at(&self, v: &Vector4<f64>) -> f64 {
        (self.denominator * v).x
    }

    fn numbers(&self) -> impl Iterator<Item = &f64> {
        self.denominator.iter().chain(&self.numerator)
    }
}

/// Where the homogeneous points stand in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    center: Vector3<f64>,
    scale: f64,
}

impl Frame {
    /// In the middle of the camera centers, as large as their spread or the largest measured depth;
    /// `None` where there is no such length.
    fn new(views: &[View]) -> Option<Self> {
        let centers = || views.iter().map(|view| view.world_from_camera.translation);
        let first = centers().next()?;
        let low = centers().fold(first, |low, center| low.inf(&center));
        let high = centers().fold(first, |high, center| high.sup(&center));
        let depths = views.iter().filter_map(|view| view.depth_m).map(|(depth_m, _)| depth_m);
        let scale = depths.fold(0.5 * (high - low).norm(), f64::max);
        (scale > 0.0 && scale.is_finite()).then(|| Self { center: 0.5 * (low + high), scale })
    }

    /// The point of v; not finite where it lies at infinity.
    pub(super) fn point_in_world(&self, v: &Vector4<f64>) -> Vector3<f64> {
        self.center + v.xyz() * (self.scale / v.w)
    }

    /// The errors of `view`.
    fn ratios(&self, view: &View) -> Option<(Ratio, Option<Ratio>)> {
        let center = (view.world_from_camera.translation - self.center) / self.scale;
        let mut q = Matrix3x4::identity();
        q.set_column(3, &-center);
        let q = view.world_from_camera.rotation.matrix().transpose() * q;
        let ray = view.camera.unproject(&view.pixel)?;
        let d_point = view.camera.project_with_jacobians(&ray)?.d_point;
        let axis = match view.camera {
            Camera::Fisheye(_) => ray,
            Camera::Pinhole(_) | Camera::Snavely(_) => Vector3::z(),
        };
        let image =
            Ratio { numerator: d_point * q / view.sigma_px, denominator: axis.transpose() * q };
        let depth = view.depth_m.map(|(depth_m, sigma_m)| {
            let mut difference = q.row(2) * self.scale;
            difference[3] -= depth_m;
            let mut numerator = Matrix2x4::zeros();
            numerator.set_row(0, &(difference / sigma_m));
            Ratio { numerator, denominator: RowVector4::new(0.0, 0.0, 0.0, 1.0) }
        });
        Some((image, depth))
    }
}

/// The errors of `views`, in an order of their own: it does not depend on that of the views. `None`
/// where a pixel has no ray, the views span no length or a number is not finite.
pub(super) fn ratios(views: &[View]) -> Option<(Frame, Vec<Ratio>)> {
    let frame = Frame::new(views)?;
    let mut ratios = Vec::with_capacity(2 * views.len());
    for view in views {
        let (image, depth) = frame.ratios(view)?;
        ratios.push(image);
        ratios.extend(depth);
    }
    let finite = ratios.iter().flat_map(Ratio::numbers).all(|number| number.is_finite());
    ratios.sort_by(|a, b| a.numbers().partial_cmp(b.numbers()).unwrap_or(Ordering::Equal));
    finite.then_some((frame, ratios))
}
