//! Residuals and projections written out in plain numbers, by their definitions.
//!
//! Log(Z⁻¹ · X_i⁻¹ · X_j) in SE(2) and SE(3), and camera models: pinhole and fisheye as OpenCV's
//! documentation states them, Snavely as Bundler's with z forward.
//!
//! SE(3): with q = (v, w), w ≥ 0 and θ = 2 atan2(|v|, w), ω = θ v/|v| and
//! ρ = V⁻¹ t = t − ½ ω × t + c ω × (ω × t), c = (1 − (θ/2) cot(θ/2)) / θ².
//! SE(2): ρ = V⁻¹ t with V⁻¹ = (a, θ/2; −θ/2, a), a = (θ/2) cot(θ/2). It must not call the logarithms
//! and camera models of `geometry`: it is what they are compared with.

use nalgebra::{Matrix3, SVector, Vector2, Vector3, Vector4};

use crate::geometry::{Camera, LieGroup, Se2, Se3};

/// |v| below which the rotation vector is 2 v.
const SMALL_SINE: f64 = 1e-9;
/// θ below which the limits of c and a are taken.
const SMALL_ANGLE: f64 = 1e-4;

/// A pose whose relative-pose residual the evaluator can compute on its own.
pub trait ReferencePose<const N: usize>: LieGroup<N> {
    /// Log(`i_from_j`⁻¹ · `world_from_i`⁻¹ · `world_from_j`), translation first.
    fn reference_residual(
        i_from_j: &Self,
        world_from_i: &Self,
        world_from_j: &Self,
    ) -> SVector<f64, N>;

    /// Where the pose takes a point of space; a motion of the plane leaves z as it is.
    fn reference_point(&self, point: &Vector3<f64>) -> Vector3<f64>;

    /// The point of the pose's frame that the pose takes to `point`: the inverse of
    /// [`ReferencePose::reference_point`].
    fn reference_local(&self, point: &Vector3<f64>) -> Vector3<f64>;
}

impl ReferencePose<3> for Se2 {
    fn reference_residual(z: &Self, a: &Self, b: &Self) -> SVector<f64, 3> {
        let predicted = Plane::of(a).inverse_times(&Plane::of(b));
        Plane::of(z).inverse_times(&predicted).log()
    }

    fn reference_point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let Plane { c, s, t } = Plane::of(self);
        let (x, y) = (c * point.x - s * point.y, s * point.x + c * point.y);
        Vector3::new(x + t.x, y + t.y, point.z)
    }

    fn reference_local(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let Plane { c, s, t } = Plane::of(self);
        let (x, y) = (point.x - t.x, point.y - t.y);
        Vector3::new(c * x + s * y, c * y - s * x, point.z)
    }
}

impl ReferencePose<6> for Se3 {
    fn reference_residual(z: &Self, a: &Self, b: &Self) -> SVector<f64, 6> {
        let predicted = Rigid::of(a).inverse_times(&Rigid::of(b));
        Rigid::of(z).inverse_times(&predicted).log()
    }

    fn reference_point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let rigid = Rigid::of(self);
        rigid.matrix() * point + rigid.t
    }

    fn reference_local(&self, point: &Vector3<f64>) -> Vector3<f64> {
        Rigid::of(self).to_local(point)
    }
}

/// Cosine and sine of the angle, and the translation.
struct Plane {
    c: f64,
    s: f64,
    t: Vector2<f64>,
}

impl Plane {
    fn of(pose: &Se2) -> Self {
        let m = pose.rotation.matrix();
        Self { c: m[(0, 0)], s: m[(1, 0)], t: pose.translation }
    }

    /// self⁻¹ · other.
    fn inverse_times(&self, other: &Self) -> Self {
        let d = other.t - self.t;
        Self {
            c: self.c * other.c + self.s * other.s,
            s: self.c * other.s - self.s * other.c,
            t: Vector2::new(self.c * d.x + self.s * d.y, -self.s * d.x + self.c * d.y),
        }
    }

    fn log(&self) -> SVector<f64, 3> {
        let theta = self.s.atan2(self.c);
        let half = 0.5 * theta;
        let a =
            if theta.abs() < SMALL_ANGLE { 1.0 - theta * theta / 12.0 } else { half / half.tan() };
        let t = &self.t;
        SVector::from([a * t.x + half * t.y, -half * t.x + a * t.y, theta])
    }
}

/// A quaternion (x, y, z, w) and the translation.
pub(super) struct Rigid {
    q: Vector4<f64>,
    t: Vector3<f64>,
}

impl Rigid {
    pub(super) fn of(pose: &Se3) -> Self {
        let q = pose.rotation.quaternion();
        let q = Vector4::new(q.i, q.j, q.k, q.w);
        Self { q: q / q.norm(), t: pose.translation }
    }

    /// The rotation matrix.
    fn matrix(&self) -> Matrix3<f64> {
        let [x, y, z, w] = self.q.into();
        Matrix3::new(
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - z * w),
            2.0 * (x * z + y * w),
            2.0 * (x * y + z * w),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - x * w),
            2.0 * (x * z - y * w),
            2.0 * (y * z + x * w),
            1.0 - 2.0 * (x * x + y * y),
        )
    }

    /// Rᵀ (point − t): a world point in this pose's frame.
    pub(super) fn to_local(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.matrix().transpose() * (point - self.t)
    }

    /// self⁻¹ · other.
    fn inverse_times(&self, other: &Self) -> Self {
        let (a, b) = (&self.q, &other.q);
        let (u, v) = (-a.xyz(), b.xyz());
        let vector = v * a.w + u * b.w + u.cross(&v);
        let scalar = a.w * b.w - u.dot(&v);
        let q = Vector4::new(vector.x, vector.y, vector.z, scalar);
        Self { q: q / q.norm(), t: self.to_local(&other.t) }
    }

    fn log(&self) -> SVector<f64, 6> {
        let q = if self.q.w < 0.0 { -self.q } else { self.q };
        let v = q.xyz();
        let sine = v.norm();
        let scale = if sine > SMALL_SINE { 2.0 * sine.atan2(q.w) / sine } else { 2.0 };
        let omega = v * scale;
        let theta = omega.norm();
        let c = if theta > SMALL_ANGLE {
            let half = 0.5 * theta;
            (1.0 - half / half.tan()) / (theta * theta)
        } else {
            1.0 / 12.0 + theta * theta / 720.0
        };
        let turned = omega.cross(&self.t);
        let rho = self.t - turned * 0.5 + omega.cross(&turned) * c;
        SVector::from([rho.x, rho.y, rho.z, omega.x, omega.y, omega.z])
    }
}

/// The pixel (u, v) of a point in camera coordinates. Nothing guards a division: a point in the center
/// plane gives a residual that is not finite.
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
