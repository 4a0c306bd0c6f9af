//! Rotations of space, stored as a unit quaternion.
//!
//! Exp(φ) = (cos θ/2, φ sin(θ/2)/θ) and Log(q) = v · 2 atan2(|v|, w)/|v| with q's sign chosen so
//! that w ≥ 0, hence θ ≤ π: accurate to the last place both near 0 and near π. Products are pulled
//! back to unit length by one Newton step (in `compose`, and nowhere else), so drift cannot
//! accumulate over long chains. Jacobians: Solà et al. (2018), section "The 3D rotation group".

use nalgebra::{Matrix3, Matrix4, Quaternion, SymmetricEigen, UnitQuaternion, Vector3};

use super::LieGroup;
use super::coefficients::{RotationCoefficients, hat};

/// A matrix whose columns are orthonormal to this is a rotation, or mirrors.
const ORTHONORMAL: f64 = 1e-14;

/// θ² below which Exp takes sin(θ/2)/θ from its series; the term left out is below 3e-20.
const EXP_SERIES_LIMIT: f64 = 1e-8;
/// |v|² below which Log takes 2 atan(|v|/w)/|v| from its series; the term left out is below 1e-20.
const LOG_SERIES_LIMIT: f64 = 1e-10;
/// Squared norms this close to 1 are unit already; leaving them alone makes reading back idempotent.
const UNIT_NORM_TOLERANCE: f64 = 4.0 * f64::EPSILON;
/// Bound on the QR sweeps of a 4 × 4 symmetric eigenproblem, which needs about ten.
const MAX_EIGEN_SWEEPS: usize = 200;

/// A rotation of space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct So3 {
    quaternion: UnitQuaternion<f64>,
}

impl So3 {
    /// The rotation of a unit quaternion, which is kept as it is.
    #[inline]
    pub fn from_unit_quaternion(quaternion: UnitQuaternion<f64>) -> Self {
        Self { quaternion }
    }

    /// The rotation of the quaternion x i + y j + z k + w, normalized.
    ///
    /// `None` when the norm is zero or not finite. A quaternion that is unit to rounding keeps
    /// its bits.
    pub fn from_quaternion_xyzw(x: f64, y: f64, z: f64, w: f64) -> Option<Self> {
        let largest = x.abs().max(y.abs()).max(z.abs()).max(w.abs());
        // `max` ignores NaN, so the sum is asked too.
        if !(largest > 0.0 && (x + y + z + w).is_finite()) {
            return None;
        }
        let quaternion = Quaternion::new(w, x, y, z);
        if (quaternion.norm_squared() - 1.0).abs() <= UNIT_NORM_TOLERANCE {
            return Some(Self::from_unit_quaternion(UnitQuaternion::new_unchecked(quaternion)));
        }
        // Dividing by the largest entry first keeps the squares from over- and underflowing.
        let scaled = Quaternion::new(w / largest, x / largest, y / largest, z / largest);
        let unit = UnitQuaternion::new_unchecked(scaled / scaled.norm());
        Some(Self::from_unit_quaternion(unit))
    }

    /// The rotation R nearest to `matrix`, which maximizes tr(Rᵀ M) = qᵀ K q.
    ///
    /// q is the eigenvector of K with the largest eigenvalue (Bar-Itzhack 2000), so reflections
    /// and scaled matrices need no cases of their own. An input that is not finite gives a
    /// rotation for which [`LieGroup::is_finite`] is false.
    pub fn from_matrix(matrix: &Matrix3<f64>) -> Self {
        let m = matrix;
        let trace = m.trace();
        let symmetric = m + m.transpose() - Matrix3::identity() * trace;
        let axial =
            Vector3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)]);
        let mut k = Matrix4::zeros();
        k.fixed_view_mut::<3, 3>(0, 0).copy_from(&symmetric);
        k.fixed_view_mut::<3, 1>(0, 3).copy_from(&axial);
        k.fixed_view_mut::<1, 3>(3, 0).copy_from(&axial.transpose());
        k[(3, 3)] = trace;
        let nan = Self {
            quaternion: UnitQuaternion::new_unchecked(Quaternion::new(f64::NAN, 0.0, 0.0, 0.0)),
        };
        if !k.iter().all(|v| v.is_finite()) {
            return nan;
        }
        let is_rotation = (m.tr_mul(m) - Matrix3::identity()).amax() < ORTHONORMAL;
        if is_rotation && m.determinant() > 0.0 {
            // Then K + I = 4 q qᵀ, and its longest column is along q.
            let longest = k.diagonal().imax();
            k[(longest, longest)] += 1.0;
            let q = k.column(longest);
            let q = if q.w < 0.0 { -q } else { q.into_owned() };
            return Self::from_quaternion_xyzw(q.x, q.y, q.z, q.w).unwrap_or(nan);
        }
        let Some(eigen) = SymmetricEigen::try_new(k, f64::EPSILON, MAX_EIGEN_SWEEPS) else {
            return nan;
        };
        let q = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
        let q = if q.w < 0.0 { -q } else { q };
        Self::from_quaternion_xyzw(q.x, q.y, q.z, q.w).unwrap_or(nan)
    }

    /// The unit quaternion; q and −q are the same rotation.
    #[inline]
    pub fn quaternion(&self) -> &UnitQuaternion<f64> {
        &self.quaternion
    }

    /// The 3 × 3 rotation matrix.
    #[inline]
    pub fn matrix(&self) -> Matrix3<f64> {
        self.quaternion.to_rotation_matrix().into_inner()
    }

    /// R p.
    #[inline]
    pub fn rotate(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let q = self.quaternion.as_ref();
        rotate_by(&q.imag(), q.w, point)
    }

    /// Rᵀ p.
    #[inline]
    pub fn inverse_rotate(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let q = self.quaternion.as_ref();
        rotate_by(&-q.imag(), q.w, point)
    }
}

/// p + w t + v × t with t = 2 v × p: the sandwich product of a unit quaternion (w, v).
#[inline]
fn rotate_by(v: &Vector3<f64>, w: f64, point: &Vector3<f64>) -> Vector3<f64> {
    let t = v.cross(point) * 2.0;
    point + t * w + v.cross(&t)
}

impl LieGroup<3> for So3 {
    #[inline]
    fn identity() -> Self {
        Self { quaternion: UnitQuaternion::identity() }
    }

    #[inline]
    fn compose(&self, other: &Self) -> Self {
        let product = self.quaternion.as_ref() * other.quaternion.as_ref();
        let unit = 1.5 - 0.5 * product.norm_squared();
        Self { quaternion: UnitQuaternion::new_unchecked(product * unit) }
    }

    #[inline]
    fn inverse(&self) -> Self {
        Self { quaternion: self.quaternion.inverse() }
    }

    #[inline]
    fn exp(tangent: &Vector3<f64>) -> Self {
        let squared = tangent.norm_squared();
        let theta = squared.sqrt();
        let (sin, cos) = (0.5 * theta).sin_cos();
        let factor = if squared < EXP_SERIES_LIMIT { 0.5 - squared / 48.0 } else { sin / theta };
        let v = tangent * factor;
        Self { quaternion: UnitQuaternion::new_unchecked(Quaternion::new(cos, v.x, v.y, v.z)) }
    }

    #[inline]
    fn log(&self) -> Vector3<f64> {
        let q = self.quaternion.as_ref();
        let (w, v) = if q.w < 0.0 { (-q.w, -q.imag()) } else { (q.w, q.imag()) };
        let squared = v.norm_squared();
        let factor = if squared < LOG_SERIES_LIMIT {
            2.0 / w * (1.0 - squared / (3.0 * w * w))
        } else {
            let norm = squared.sqrt();
            2.0 * norm.atan2(w) / norm
        };
        v * factor
    }

    #[inline]
    fn adjoint(&self) -> Matrix3<f64> {
        self.matrix()
    }

    #[inline]
    fn right_jacobian_inverse(tangent: &Vector3<f64>) -> Matrix3<f64> {
        RotationCoefficients::new(tangent.norm_squared()).right_jacobian_inverse(tangent)
    }

    #[inline]
    fn act(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotate(point)
    }

    #[inline]
    fn act_jacobian(&self, point: &Vector3<f64>) -> Matrix3<f64> {
        -self.matrix() * hat(point)
    }

    #[inline]
    fn is_finite(&self) -> bool {
        self.quaternion.as_ref().coords.iter().all(|v| v.is_finite())
    }
}
