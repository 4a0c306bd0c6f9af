//! The camera of Bundler and BAL files, in covis axes.
//!
//! pixel = f (1 + k1 r² + k2 r⁴) (x/z, y/z) with r² = (x² + y²)/z², principal point at (0, 0).
//! The files' own camera looks down −z: `io` flips y and z on import, nothing here does.

use nalgebra::{Matrix2x3, SMatrix, SVector, Vector2, Vector3};

use super::{CameraModel, Projection, finite_pixel, radial};

/// One focal length, two radial coefficients, principal point at the origin of the pixel plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Snavely {
    /// Focal length, px.
    pub focal: f64,
    /// Coefficient of r².
    pub k1: f64,
    /// Coefficient of r⁴.
    pub k2: f64,
}

impl Snavely {
    /// The radius at which the image folds back: the least root of 1 + 3 k1 r² + 5 k2 r⁴.
    fn fold_radius(&self) -> Option<f64> {
        let (a, b) = (5.0 * self.k2, 3.0 * self.k1);
        let discriminant = b * b - 4.0 * a;
        if discriminant < 0.0 {
            return None;
        }
        // 2 / (−b ± √…) are the roots of a s² + b s + 1 without a division by a, which may be 0;
        // the larger denominator belongs to the smaller positive root.
        let root = discriminant.sqrt();
        let denominator = root - b;
        (denominator > 0.0).then(|| (2.0 / denominator).sqrt())
    }
}

impl CameraModel<3> for Snavely {
    #[inline]
    fn parameters(&self) -> SVector<f64, 3> {
        SVector::from([self.focal, self.k1, self.k2])
    }

    #[inline]
    fn from_parameters(parameters: &SVector<f64, 3>) -> Self {
        Self { focal: parameters[0], k1: parameters[1], k2: parameters[2] }
    }

    #[inline]
    fn project(&self, point_in_camera: &Vector3<f64>) -> Option<Vector2<f64>> {
        let inverse_z = 1.0 / point_in_camera.z;
        let (x, y) = (point_in_camera.x * inverse_z, point_in_camera.y * inverse_z);
        let r2 = x * x + y * y;
        let scale = self.focal * (1.0 + r2 * (self.k1 + r2 * self.k2));
        finite_pixel(scale * x, scale * y)
    }

    #[inline]
    fn project_with_jacobians(&self, point_in_camera: &Vector3<f64>) -> Option<Projection<3>> {
        let inverse_z = 1.0 / point_in_camera.z;
        let (x, y) = (point_in_camera.x * inverse_z, point_in_camera.y * inverse_z);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * self.k2);
        // ∂(f radial)/∂(x, y) = growth (x, y).
        let growth = self.focal * (2.0 * self.k1 + 4.0 * self.k2 * r2);
        let scale = self.focal * radial;
        let (xx, xy, yy) = (scale + growth * x * x, growth * x * y, scale + growth * y * y);
        let (fx, fy) = (self.focal * x, self.focal * y);
        Projection {
            pixel: Vector2::new(scale * x, scale * y),
            d_point: Matrix2x3::new(xx, xy, -(xx * x + xy * y), xy, yy, -(xy * x + yy * y))
                * inverse_z,
            d_parameters: SMatrix::<f64, 2, 3>::new(
                radial * x,
                fx * r2,
                fx * r2 * r2,
                radial * y,
                fy * r2,
                fy * r2 * r2,
            ),
        }
        .finite()
    }

    /// The point at z = 1 inside the first fold of the distortion; `None` past it.
    fn unproject(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        let distorted = pixel / self.focal;
        let target = distorted.norm();
        if !target.is_finite() {
            return None;
        }
        if target == 0.0 {
            return Some(Vector3::new(0.0, 0.0, 1.0));
        }
        let profile = |r: f64| {
            let r2 = r * r;
            let value = r * (1.0 + r2 * (self.k1 + r2 * self.k2));
            (value, 1.0 + r2 * (3.0 * self.k1 + r2 * 5.0 * self.k2))
        };
        // Without a fold the profile grows without bound, and so does the bracket.
        let high = self.fold_radius().unwrap_or_else(|| {
            let mut high = target;
            while profile(high).0 < target && high.is_finite() {
                high *= 2.0;
            }
            high
        });
        let factor = radial::invert(profile, target, 0.0, high)? / target;
        Some(Vector3::new(distorted.x * factor, distorted.y * factor, 1.0))
    }
}
