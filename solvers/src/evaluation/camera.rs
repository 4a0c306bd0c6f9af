//! Projections by the definition of each camera model, for the evaluator only.
//!
//! Pinhole and fisheye as OpenCV's documentation states them, Snavely as Bundler's with z forward.
//! Nothing guards a division: a point in the center plane gives a residual that is not finite.

use nalgebra::Vector3;

use crate::geometry::Camera;

/// The pixel (u, v) of a point in camera coordinates.
pub(super) fn project(camera: &Camera, p: &Vector3<f64>) -> [f64; 2] {
    match camera {
        Camera::Pinhole(c) => {
            let (x, y) = (p.x / p.z, p.y / p.z);
            let r2 = x * x + y * y;
            let radial = 1.0 + c.k1 * r2 + c.k2 * r2.powi(2) + c.k3 * r2.powi(3);
            let u = x * radial + 2.0 * c.p1 * x * y + c.p2 * (r2 + 2.0 * x * x);
            let v = y * radial + c.p1 * (r2 + 2.0 * y * y) + 2.0 * c.p2 * x * y;
            [c.fx * u + c.cx, c.fy * v + c.cy]
        }
        Camera::Fisheye(c) => {
            let r = p.x.hypot(p.y);
            let theta = r.atan2(p.z);
            let t2 = theta * theta;
            let series =
                1.0 + c.k1 * t2 + c.k2 * t2.powi(2) + c.k3 * t2.powi(3) + c.k4 * t2.powi(4);
            // On the axis θ/r is 1/z.
            let scale = if r > 0.0 { theta * series / r } else { series / p.z };
            [c.fx * scale * p.x + c.cx, c.fy * scale * p.y + c.cy]
        }
        Camera::Snavely(c) => {
            let (x, y) = (p.x / p.z, p.y / p.z);
            let r2 = x * x + y * y;
            let scale = c.focal * (1.0 + c.k1 * r2 + c.k2 * r2 * r2);
            [scale * x, scale * y]
        }
    }
}
