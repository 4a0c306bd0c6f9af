//! The camera of a sequence: its lens at one image size, with the ray of each pixel.
//!
//! Images are used as they come, distorted: points are projected through the lens model, pixels are
//! taken back by a table of rays. Knows images' sizes and nothing of what they show.

use covis_solvers::geometry::{CameraModel, PinholeRadialTangential};
use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::image::Image;

/// Nearest depth that is projected, meters.
const NEAREST_M: f64 = 0.05;
/// How far outside of the image's rays a point may lie, as a factor: distortion models are fitted
/// inside the image and may fold back beyond it.
const RAY_MARGIN: f64 = 1.05;
/// A ray that leans more than this many to one on the optical axis belongs to no camera.
const LARGEST_TANGENT: f64 = 1e3;

/// A lens at one image size.
#[derive(Clone, Debug)]
pub struct FrameCamera {
    model: PinholeRadialTangential,
    rays: Image<[f32; 2]>,
    largest_tangent2: f64,
    fast: FastLens,
}

/// A lens in single precision, for many points.
#[derive(Clone, Copy, Debug)]
pub struct FastLens {
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
    k1: f32,
    k2: f32,
    p1: f32,
    p2: f32,
    k3: f32,
    largest_tangent2: f32,
}

impl FastLens {
    /// As [`FrameCamera::project`] to a thousandth of a pixel, and without a branch: where there is
    /// no pixel, (u, v) are not numbers.
    #[inline(always)]
    #[must_use]
    pub fn project(&self, [x, y, z]: [f32; 3]) -> [f32; 2] {
        let (a, b) = (x / z, y / z);
        let (aa, bb, ab) = (a * a, b * b, a * b);
        let r2 = aa + bb;
        let is_seen = (z > NEAREST_M as f32) & (r2 <= self.largest_tangent2);
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let u = a * radial + 2.0 * self.p1 * ab + self.p2 * (r2 + 2.0 * aa);
        let v = b * radial + self.p1 * (r2 + 2.0 * bb) + 2.0 * self.p2 * ab;
        let if_seen = |value: f32| if is_seen { value } else { f32::NAN };
        [if_seen(self.fx * u + self.cx), if_seen(self.fy * v + self.cy)]
    }
}

impl FrameCamera {
    /// The camera for images of this size; `None` where a pixel of it has no ray.
    #[must_use]
    pub fn new(model: PinholeRadialTangential, width: usize, height: usize) -> Option<Self> {
        let mut rays = Image::filled(width, height, [0.0; 2]);
        let mut largest_tangent2 = 0.0_f64;
        for v in 0..height {
            for u in 0..width {
                let ray = model.unproject(&Vector2::new(u as f64, v as f64))?;
                let (a, b) = (ray.x / ray.z, ray.y / ray.z);
                let tangent2 = a * a + b * b;
                if tangent2.is_nan() || tangent2 > LARGEST_TANGENT * LARGEST_TANGENT {
                    return None;
                }
                largest_tangent2 = largest_tangent2.max(tangent2);
                rays.set(u, v, [a as f32, b as f32]);
            }
        }
        let largest_tangent2 = largest_tangent2 * RAY_MARGIN * RAY_MARGIN;
        let m = &model;
        let [fx, fy, cx, cy] = [m.fx, m.fy, m.cx, m.cy].map(|value| value as f32);
        let [k1, k2, p1, p2, k3] = [m.k1, m.k2, m.p1, m.p2, m.k3].map(|value| value as f32);
        let tangent2 = largest_tangent2 as f32;
        let fast = FastLens { fx, fy, cx, cy, k1, k2, p1, p2, k3, largest_tangent2: tangent2 };
        Some(Self { model, rays, largest_tangent2, fast })
    }

    /// The lens.
    #[must_use]
    pub fn model(&self) -> &PinholeRadialTangential {
        &self.model
    }

    /// Columns and rows of its images.
    #[inline]
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        self.rays.size()
    }

    /// (x/z, y/z) of the ray of each pixel.
    #[must_use]
    pub fn rays(&self) -> &Image<[f32; 2]> {
        &self.rays
    }

    /// The pixel of a point, `None` behind the camera and far outside of the image.
    #[inline]
    #[must_use]
    pub fn project(&self, point_in_camera: &Vector3<f64>) -> Option<Vector2<f64>> {
        self.is_seen(point_in_camera).then(|| self.model.project(point_in_camera)).flatten()
    }

    /// As [`FrameCamera::project`], with ∂(u, v)/∂(x, y, z).
    #[inline]
    #[must_use]
    pub fn project_with_jacobian(
        &self,
        point_in_camera: &Vector3<f64>,
    ) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        if !self.is_seen(point_in_camera) {
            return None;
        }
        let projection = self.model.project_with_jacobians(point_in_camera)?;
        Some((projection.pixel, projection.d_point))
    }

    /// The lens in single precision.
    #[must_use]
    pub fn fast(&self) -> FastLens {
        self.fast
    }

    #[inline]
    fn is_seen(&self, p: &Vector3<f64>) -> bool {
        let is_inside = p.x * p.x + p.y * p.y <= self.largest_tangent2 * p.z * p.z;
        p.z > NEAREST_M && is_inside
    }

    /// The point on the ray of a pixel at depth z = 1, between the rays of the table; pixels outside
    /// of the image have the ray of its border.
    #[inline]
    #[must_use]
    pub fn ray(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        let (width, height) = self.size();
        let (u, v) =
            (pixel.x.clamp(0.0, (width - 1) as f64), pixel.y.clamp(0.0, (height - 1) as f64));
        let (left, top) =
            ((u as usize).min(width.saturating_sub(2)), (v as usize).min(height.saturating_sub(2)));
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let (s, t) = (u - left as f64, v - top as f64);
        let at = |u, v| self.rays.at(u, v).map(f64::from);
        let (a, b, c, d) = (at(left, top), at(right, top), at(left, bottom), at(right, bottom));
        let between = |i: usize| {
            (1.0 - t) * ((1.0 - s) * a[i] + s * b[i]) + t * ((1.0 - s) * c[i] + s * d[i])
        };
        Vector3::new(between(0), between(1), 1.0)
    }

    /// Whether a pixel lies inside the image and at least `border` pixels from its edge.
    #[inline]
    #[must_use]
    pub fn contains(&self, pixel: &Vector2<f64>, border: f64) -> bool {
        let (width, height) = self.size();
        pixel.x >= border
            && pixel.y >= border
            && pixel.x <= (width - 1) as f64 - border
            && pixel.y <= (height - 1) as f64 - border
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_whose_rays_lean_out_of_every_image_is_none() {
        let camera = |cy: f64| {
            let model = PinholeRadialTangential {
                fx: 500.0,
                fy: 500.0,
                cx: 4.0,
                cy,
                k1: 0.0,
                k2: 0.0,
                p1: 0.0,
                p2: 0.0,
                k3: 0.0,
            };
            FrameCamera::new(model, 8, 6)
        };
        assert!(camera(3.0).is_some());
        assert!(camera(2.5e55).is_none());
    }
}
