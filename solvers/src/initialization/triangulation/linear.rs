//! The linear start: the point nearest to all viewing rays (midpoint method, any number of views).
//!
//! Σ (I − d dᵀ) X = Σ (I − d dᵀ) c with ray directions d and camera centers c in the world. It knows
//! nothing of sigmas and of which side of a camera a point lies on; the caller checks.

use nalgebra::{Matrix3, Vector3};

use super::View;

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

    /// The point at the view's measured depth, where it has one.
    pub(super) fn at_depth(&self, view: &View) -> Option<Vector3<f64>> {
        let (depth_m, _) = view.depth_m?;
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

/// The point with the least sum of squared distances to `rays`.
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
