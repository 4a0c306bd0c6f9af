//! Pinhole with three radial and two tangential coefficients, in OpenCV's convention and order.
//!
//! With (a, b) = (x/z, y/z), r² = a² + b² and ρ = 1 + k1 r² + k2 r⁴ + k3 r⁶:
//! a_d = a ρ + 2 p1 a b + p2 (r² + 2 a²), b_d = b ρ + p1 (r² + 2 b²) + 2 p2 a b,
//! (u, v) = (fx a_d + cx, fy b_d + cy). Points with z < 0 project through the center like the
//! others: the caller checks cheirality.

use nalgebra::{Matrix2, Matrix2x3, SMatrix, SVector, Vector2, Vector3};

use super::{CameraModel, Projection, finite_pixel};

/// Newton steps of the undistortion; it takes four or five where the lens is usable.
const MAX_STEPS: usize = 50;
/// Halvings of one step before the undistortion gives up.
const MAX_HALVINGS: usize = 30;
/// Residual, relative to 1 + |distorted point|, at which an undistorted point is accepted.
const TOLERANCE: f64 = 1e-12;

/// Pinhole camera with radial-tangential distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PinholeRadialTangential {
    /// Horizontal focal length, px.
    pub fx: f64,
    /// Vertical focal length, px.
    pub fy: f64,
    /// Column of the principal point, px.
    pub cx: f64,
    /// Row of the principal point, px.
    pub cy: f64,
    /// Radial coefficient of r².
    pub k1: f64,
    /// Radial coefficient of r⁴.
    pub k2: f64,
    /// First tangential coefficient.
    pub p1: f64,
    /// Second tangential coefficient.
    pub p2: f64,
    /// Radial coefficient of r⁶.
    pub k3: f64,
}

impl PinholeRadialTangential {
    /// A pinhole without distortion.
    pub fn undistorted(fx: f64, fy: f64, cx: f64, cy: f64) -> Self {
        Self { fx, fy, cx, cy, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 }
    }

    /// Whether every distortion coefficient is zero.
    #[inline]
    pub fn is_undistorted(&self) -> bool {
        [self.k1, self.k2, self.p1, self.p2, self.k3] == [0.0; 5]
    }

    /// The distorted point of a normalized one.
    #[inline]
    fn distort(&self, a: f64, b: f64) -> Vector2<f64> {
        let r2 = a * a + b * b;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        Vector2::new(
            a * radial + 2.0 * self.p1 * a * b + self.p2 * (r2 + 2.0 * a * a),
            b * radial + self.p1 * (r2 + 2.0 * b * b) + 2.0 * self.p2 * a * b,
        )
    }

    /// ∂(a_d, b_d)/∂(a, b), which is symmetric.
    #[inline]
    fn distortion_jacobian(&self, a: f64, b: f64) -> Matrix2<f64> {
        let r2 = a * a + b * b;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let growth = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3));
        let cross = growth * a * b + 2.0 * (self.p1 * a + self.p2 * b);
        Matrix2::new(
            radial + growth * a * a + 2.0 * self.p1 * b + 6.0 * self.p2 * a,
            cross,
            cross,
            radial + growth * b * b + 6.0 * self.p1 * b + 2.0 * self.p2 * a,
        )
    }

    /// The normalized point of a distorted one: Newton's method, with steps halved until the
    /// residual falls and the image has not folded (positive determinant).
    fn undistort(&self, distorted: &Vector2<f64>) -> Option<Vector2<f64>> {
        let accepted = TOLERANCE * (1.0 + distorted.norm());
        let mut point = *distorted;
        let mut residual = self.distort(point.x, point.y) - distorted;
        for _ in 0..MAX_STEPS {
            let jacobian = self.distortion_jacobian(point.x, point.y);
            let determinant = jacobian.determinant();
            if !(determinant > 0.0 && residual.norm().is_finite()) {
                return None;
            }
            let step = Vector2::new(
                jacobian[(1, 1)] * residual.x - jacobian[(0, 1)] * residual.y,
                jacobian[(0, 0)] * residual.y - jacobian[(1, 0)] * residual.x,
            ) / determinant;
            let mut factor = 1.0;
            let mut moved = false;
            for _ in 0..MAX_HALVINGS {
                let trial = point - step * factor;
                let trial_residual = self.distort(trial.x, trial.y) - distorted;
                let upright = self.distortion_jacobian(trial.x, trial.y).determinant() > 0.0;
                if upright && trial_residual.norm() < residual.norm() {
                    (point, residual, moved) = (trial, trial_residual, true);
                    break;
                }
                if residual.norm() <= accepted {
                    break;
                }
                factor *= 0.5;
            }
            if !moved {
                break;
            }
        }
        (residual.norm() <= accepted).then_some(point)
    }
}

impl CameraModel<9> for PinholeRadialTangential {
    #[inline]
    fn parameters(&self) -> SVector<f64, 9> {
        SVector::from([
            self.fx, self.fy, self.cx, self.cy, self.k1, self.k2, self.p1, self.p2, self.k3,
        ])
    }

    #[inline]
    fn from_parameters(parameters: &SVector<f64, 9>) -> Self {
        let p = parameters;
        Self {
            fx: p[0],
            fy: p[1],
            cx: p[2],
            cy: p[3],
            k1: p[4],
            k2: p[5],
            p1: p[6],
            p2: p[7],
            k3: p[8],
        }
    }

    #[inline]
    fn project(&self, point_in_camera: &Vector3<f64>) -> Option<Vector2<f64>> {
        let inverse_z = 1.0 / point_in_camera.z;
        let distorted = self.distort(point_in_camera.x * inverse_z, point_in_camera.y * inverse_z);
        finite_pixel(self.fx * distorted.x + self.cx, self.fy * distorted.y + self.cy)
    }

    #[inline]
    fn project_with_jacobians(&self, point_in_camera: &Vector3<f64>) -> Option<Projection<9>> {
        let inverse_z = 1.0 / point_in_camera.z;
        let (a, b) = (point_in_camera.x * inverse_z, point_in_camera.y * inverse_z);
        let (fx, fy) = (self.fx, self.fy);
        let distorted = self.distort(a, b);
        let j = self.distortion_jacobian(a, b);
        let (ja, jb) = (j.row(0) * (fx * inverse_z), j.row(1) * (fy * inverse_z));
        let r2 = a * a + b * b;
        let (r4, r6) = (r2 * r2, r2 * r2 * r2);
        let (fa, fb) = (fx * a, fy * b);
        Projection {
            pixel: Vector2::new(fx * distorted.x + self.cx, fy * distorted.y + self.cy),
            d_point: Matrix2x3::new(
                ja[0],
                ja[1],
                -(ja[0] * a + ja[1] * b),
                jb[0],
                jb[1],
                -(jb[0] * a + jb[1] * b),
            ),
            d_parameters: SMatrix::<f64, 2, 9>::from_columns(&[
                Vector2::new(distorted.x, 0.0),
                Vector2::new(0.0, distorted.y),
                Vector2::new(1.0, 0.0),
                Vector2::new(0.0, 1.0),
                Vector2::new(fa * r2, fb * r2),
                Vector2::new(fa * r4, fb * r4),
                Vector2::new(2.0 * fa * b, fy * (r2 + 2.0 * b * b)),
                Vector2::new(fx * (r2 + 2.0 * a * a), 2.0 * a * fb),
                Vector2::new(fa * r6, fb * r6),
            ]),
        }
        .finite()
    }

    /// The point at z = 1 of the lens's unfolded part; `None` where there is none.
    fn unproject(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        let distorted = Vector2::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy);
        let point = self.undistort(&distorted)?;
        Some(Vector3::new(point.x, point.y, 1.0))
    }
}
