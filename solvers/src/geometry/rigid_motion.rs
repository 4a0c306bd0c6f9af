//! What SE(2) and SE(3) have in common: a rotation matrix and a translation.
//!
//! For code that treats rotations as matrices (chordal distances), with D = 2 or 3 dimensions of
//! space and N = 3 or 6 of the tangent. Beside the matrices it holds the projection of any matrix
//! onto the rotations; it knows nothing of measurements.

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2};

use super::{LieGroup, Se2, Se3, So2, So3};

/// A rigid motion x ↦ R x + t of the D-dimensional space.
pub trait RigidMotion<const D: usize, const N: usize>: LieGroup<N> {
    /// R.
    fn rotation_matrix(&self) -> SMatrix<f64, D, D>;

    /// t, in meters.
    fn translation(&self) -> SVector<f64, D>;

    /// The motion with translation `t` and the rotation nearest to `matrix` in the Frobenius norm.
    ///
    /// `None` where no rotation is nearest: a matrix that is not finite or, in the plane, without a
    /// direction.
    fn from_matrix(matrix: &SMatrix<f64, D, D>, t: &SVector<f64, D>) -> Option<Self>;
}

impl RigidMotion<2, 3> for Se2 {
    #[inline]
    fn rotation_matrix(&self) -> Matrix2<f64> {
        self.rotation.matrix()
    }

    #[inline]
    fn translation(&self) -> Vector2<f64> {
        self.translation
    }

    fn from_matrix(matrix: &Matrix2<f64>, t: &Vector2<f64>) -> Option<Self> {
        // Of the cosine and sine that maximize tr(Rᵀ M) only the direction matters.
        let cosine = matrix.m11 + matrix.m22;
        let sine = matrix.m21 - matrix.m12;
        let length = cosine.hypot(sine);
        let is_usable = length > 0.0 && length.is_finite();
        is_usable.then(|| Self::new(So2::from_angle(sine.atan2(cosine)), *t))
    }
}

impl RigidMotion<3, 6> for Se3 {
    #[inline]
    fn rotation_matrix(&self) -> Matrix3<f64> {
        self.rotation.matrix()
    }

    #[inline]
    fn translation(&self) -> nalgebra::Vector3<f64> {
        self.translation
    }

    fn from_matrix(matrix: &Matrix3<f64>, t: &nalgebra::Vector3<f64>) -> Option<Self> {
        nearest_rotation(matrix).map(|r| Self::new(So3::from_matrix(&r), *t))
    }
}

/// Newton steps of the polar decomposition; scaled, they converge from a condition of 1e9 in eleven.
const POLAR_STEPS: usize = 16;

/// A matrix of norm 1 with less is as good as singular, or mirrors.
const LEAST_DETERMINANT: f64 = 1e-9;

/// The rotation that maximizes tr(Rᵀ M).
///
/// Newton's scaled iteration for the polar factor (Higham 1986; Byers and Xu 2008) where M has a
/// positive determinant, as in nearly all calls; the singular value decomposition otherwise.
fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let scale = matrix.norm();
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let start = matrix / scale;
    let mut x = start;
    if start.determinant() > LEAST_DETERMINANT {
        for _ in 0..POLAR_STEPS {
            // X⁻ᵀ is the cofactor matrix over the determinant.
            let columns = [x.column(1).cross(&x.column(2)), x.column(2).cross(&x.column(0))];
            let cofactors =
                Matrix3::from_columns(&[columns[0], columns[1], x.column(0).cross(&x.column(1))]);
            let determinant = x.column(0).dot(&columns[0]);
            // Far from a rotation, X is first scaled to a determinant of one.
            let is_far = (determinant - 1.0).abs() > 0.05;
            let grow = if is_far { determinant.cbrt().recip() } else { 1.0 };
            let next = (x * grow + cofactors / (determinant * grow)) * 0.5;
            let change = (next - x).norm_squared();
            x = next;
            if change < 1e-24 {
                return Some(x);
            }
        }
    }
    let svd = start.try_svd(true, true, f64::EPSILON, 100)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut signs = Matrix3::identity();
    // The smallest singular direction turns where the product would be a reflection.
    let smallest = svd.singular_values.imin();
    signs[(smallest, smallest)] = (u * v_t).determinant().signum();
    Some(u * signs * v_t)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

    use super::super::LieGroup;
    use super::{RigidMotion, Se2, Se3, So3};

    #[test]
    fn the_nearest_rotation_forgets_a_stretch() {
        let rotation = So3::exp(&Vector3::new(1.0, -2.0, 0.5)).matrix();
        for stretch in [
            Matrix3::from_diagonal(&Vector3::new(3.0, 0.1, 1.0)),
            Matrix3::from_diagonal(&Vector3::new(1e-3, 1.0, 1.0)),
            Matrix3::from_diagonal(&Vector3::new(1e-9, 1.0, 2.0)),
            Matrix3::new(2.0, 0.3, 0.1, 0.3, 1.5, -0.2, 0.1, -0.2, 0.7) * 1e-7,
        ] {
            let motion = Se3::from_matrix(&(rotation * stretch), &Vector3::zeros()).unwrap();
            assert!((motion.rotation_matrix() - rotation).norm() < 1e-12, "{stretch}");
        }
        let turn = Se2::from_xy_angle(1.0, 2.0, 3.0).rotation_matrix();
        let motion = Se2::from_matrix(&(turn * 0.01), &Vector2::new(1.0, 2.0)).unwrap();
        assert!((motion.rotation_matrix() - turn).norm() < 1e-15);
    }

    #[test]
    fn a_reflection_becomes_the_rotation_that_is_nearest() {
        let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 0.9, -0.2));
        let motion = Se3::from_matrix(&mirror, &Vector3::zeros()).unwrap();
        assert!((motion.rotation_matrix() - Matrix3::identity()).norm() < 1e-12);
    }

    #[test]
    fn a_matrix_without_direction_has_no_nearest_rotation() {
        assert!(Se3::from_matrix(&Matrix3::zeros(), &Vector3::zeros()).is_none());
        assert!(Se3::from_matrix(&Matrix3::from_element(f64::NAN), &Vector3::zeros()).is_none());
        assert!(Se2::from_matrix(&Matrix2::zeros(), &Vector2::zeros()).is_none());
        let mirror = Matrix2::new(1.0, 0.0, 0.0, -1.0);
        assert!(Se2::from_matrix(&mirror, &Vector2::zeros()).is_none());
    }
}
