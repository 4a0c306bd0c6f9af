//! Kannala-Brandt fisheye, as OpenCV's `fisheye` module evaluates it (without skew).
//!
//! With r = √(x² + y²), θ = atan2(r, z) and θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸):
//! (u, v) = (fx x θ_d/r + cx, fy y θ_d/r + cy). Any direction but the backward axis projects, so
//! a field of view past 180° needs no special case. The size of the image is not known here.

use std::f64::consts::PI;

use nalgebra::{Matrix2x3, SMatrix, SVector, Vector2, Vector3};

use super::{CameraModel, Projection, finite_pixel, radial};

/// (r/z)² below which θ/r and the radial derivative come from their series about the axis.
const AXIS_LIMIT: f64 = 1e-10;
/// Steps in which the profile is searched for the first angle past a target.
const SEARCH_STEPS: u32 = 64;

/// Equidistant-like fisheye with four coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KannalaBrandt {
    /// Horizontal focal length, px.
    pub fx: f64,
    /// Vertical focal length, px.
    pub fy: f64,
    /// Column of the principal point, px.
    pub cx: f64,
    /// Row of the principal point, px.
    pub cy: f64,
    /// Coefficient of θ³.
    pub k1: f64,
    /// Coefficient of θ⁵.
    pub k2: f64,
    /// Coefficient of θ⁷.
    pub k3: f64,
    /// Coefficient of θ⁹.
    pub k4: f64,
}

impl KannalaBrandt {
    /// θ_d/θ at θ² = `t2`.
    #[inline]
    fn distortion(&self, t2: f64) -> f64 {
        1.0 + t2 * (self.k1 + t2 * (self.k2 + t2 * (self.k3 + t2 * self.k4)))
    }

    /// ∂θ_d/∂θ at θ² = `t2`.
    #[inline]
    fn slope(&self, t2: f64) -> f64 {
        1.0 + t2
            * (3.0 * self.k1 + t2 * (5.0 * self.k2 + t2 * (7.0 * self.k3 + t2 * 9.0 * self.k4)))
    }
}

/// (θ, θ/r) for r² = `r2` and depth `z`; not finite on the backward axis.
#[inline]
fn angle_and_ratio(r2: f64, z: f64) -> (f64, f64) {
    if z > 0.0 && r2 < AXIS_LIMIT * z * z {
        let ratio = (1.0 - r2 / (3.0 * z * z)) / z;
        (r2.sqrt() * ratio, ratio)
    } else {
        let r = r2.sqrt();
        let theta = r.atan2(z);
        (theta, theta / r)
    }
}

impl CameraModel<8> for KannalaBrandt {
    #[inline]
    fn parameters(&self) -> SVector<f64, 8> {
        SVector::from([self.fx, self.fy, self.cx, self.cy, self.k1, self.k2, self.k3, self.k4])
    }

    #[inline]
    fn from_parameters(parameters: &SVector<f64, 8>) -> Self {
        let p = parameters;
        Self { fx: p[0], fy: p[1], cx: p[2], cy: p[3], k1: p[4], k2: p[5], k3: p[6], k4: p[7] }
    }

    #[inline]
    fn project(&self, point_in_camera: &Vector3<f64>) -> Option<Vector2<f64>> {
        let (x, y, z) = (point_in_camera.x, point_in_camera.y, point_in_camera.z);
        let (theta, ratio) = angle_and_ratio(x * x + y * y, z);
        let q = ratio * self.distortion(theta * theta);
        finite_pixel(self.fx * q * x + self.cx, self.fy * q * y + self.cy)
    }

    #[inline]
    fn project_with_jacobians(&self, point_in_camera: &Vector3<f64>) -> Option<Projection<8>> {
        let (x, y, z) = (point_in_camera.x, point_in_camera.y, point_in_camera.z);
        let r2 = x * x + y * y;
        let (theta, ratio) = angle_and_ratio(r2, z);
        let t2 = theta * theta;
        let q = ratio * self.distortion(t2);
        let slope_over_square = self.slope(t2) / (r2 + z * z);
        // growth = (∂q/∂r)/r, so that ∂(q x)/∂x = q + growth x².
        let growth = if z > 0.0 && r2 < AXIS_LIMIT * z * z {
            2.0 * (self.k1 - 1.0 / 3.0) / (z * z * z)
        } else {
            (slope_over_square * z - q) / r2
        };
        let cross = growth * x * y;
        let (bx, by) = (self.fx * ratio * x, self.fy * ratio * y);
        let (t4, t6) = (t2 * t2, t2 * t2 * t2);
        let t8 = t4 * t4;
        Projection {
            pixel: Vector2::new(self.fx * q * x + self.cx, self.fy * q * y + self.cy),
            d_point: Matrix2x3::new(
                self.fx * (q + growth * x * x),
                self.fx * cross,
                -self.fx * x * slope_over_square,
                self.fy * cross,
                self.fy * (q + growth * y * y),
                -self.fy * y * slope_over_square,
            ),
            d_parameters: SMatrix::<f64, 2, 8>::from_columns(&[
                Vector2::new(q * x, 0.0),
                Vector2::new(0.0, q * y),
                Vector2::new(1.0, 0.0),
                Vector2::new(0.0, 1.0),
                Vector2::new(bx * t2, by * t2),
                Vector2::new(bx * t4, by * t4),
                Vector2::new(bx * t6, by * t6),
                Vector2::new(bx * t8, by * t8),
            ]),
        }
        .finite()
    }

    /// The unit bearing with the least angle θ ≤ π whose θ_d fits the pixel; `None` where θ_d
    /// turns back before it gets there.
    fn unproject(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        let x = (pixel.x - self.cx) / self.fx;
        let y = (pixel.y - self.cy) / self.fy;
        let target = x.hypot(y);
        if !target.is_finite() {
            return None;
        }
        if target == 0.0 {
            return Some(Vector3::new(0.0, 0.0, 1.0));
        }
        let profile = |theta: f64| {
            let t2 = theta * theta;
            (theta * self.distortion(t2), self.slope(t2))
        };
        let (mut low, mut step) = (0.0, 0);
        let high = loop {
            step += 1;
            let high = PI * f64::from(step) / f64::from(SEARCH_STEPS);
            let (value, slope) = profile(high);
            if value >= target {
                break high;
            }
            if step == SEARCH_STEPS || slope.is_nan() || slope <= 0.0 {
                return None;
            }
            low = high;
        };
        let theta = radial::invert(profile, target, low, high)?;
        let (sin, cos) = theta.sin_cos();
        Some(Vector3::new(x * (sin / target), y * (sin / target), cos))
    }
}
