//! Information, square-root information and covariance as distinct types.
//!
//! Ω = Σ⁻¹ = RᵀR with R upper triangular; a whitened residual is R r. Conversions are explicit and
//! checked, so that nobody passes a covariance where an information matrix belongs.

use nalgebra::{Cholesky, SMatrix, SVector};

/// A symmetric positive-definite information matrix Ω.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Information<const N: usize>(SMatrix<f64, N, N>);

/// The upper-triangular R with Ω = RᵀR.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SqrtInformation<const N: usize>(SMatrix<f64, N, N>);

/// A symmetric positive-definite covariance matrix Σ = Ω⁻¹.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance<const N: usize>(SMatrix<f64, N, N>);

/// Why a matrix is not an information or covariance matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InformationError {
    /// An entry is NaN or infinite.
    #[error("entry ({row}, {column}) is not finite")]
    NotFinite {
        /// Row of the first such entry, from 0.
        row: usize,
        /// Column of the first such entry, from 0.
        column: usize,
    },
    /// The matrix differs from its transpose by more than 1e-9 of its largest entry.
    #[error("not symmetric at ({row}, {column})")]
    NotSymmetric {
        /// Row of the first asymmetric entry, from 0.
        row: usize,
        /// Column of the first asymmetric entry, from 0.
        column: usize,
    },
    /// The Cholesky factorization meets a pivot that is not positive.
    #[error("not positive definite")]
    NotPositiveDefinite,
}

/// Checks finiteness and symmetry, and returns the exactly symmetric matrix.
fn symmetric<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
) -> Result<SMatrix<f64, N, N>, InformationError> {
    for row in 0..N {
        for column in 0..N {
            if !matrix[(row, column)].is_finite() {
                return Err(InformationError::NotFinite { row, column });
            }
        }
    }
    let tolerance = 1e-9 * matrix.amax();
    for row in 0..N {
        for column in 0..row {
            if (matrix[(row, column)] - matrix[(column, row)]).abs() > tolerance {
                return Err(InformationError::NotSymmetric { row, column });
            }
        }
    }
    Ok((matrix + matrix.transpose()) * 0.5)
}

impl<const N: usize> Information<N> {
    /// Checks that `matrix` is finite, symmetric and positive definite.
    ///
    /// # Errors
    /// [`InformationError`] says which of the three fails.
    pub fn new(matrix: &SMatrix<f64, N, N>) -> Result<Self, InformationError> {
        let matrix = symmetric(matrix)?;
        Cholesky::new(matrix).ok_or(InformationError::NotPositiveDefinite)?;
        Ok(Self(matrix))
    }

    /// Diagonal information from standard deviations.
    ///
    /// # Errors
    /// [`InformationError`] where a sigma is not finite and positive.
    pub fn from_sigmas(sigmas: &SVector<f64, N>) -> Result<Self, InformationError> {
        Self::new(&SMatrix::from_diagonal(&sigmas.map(|s| 1.0 / (s * s))))
    }

    /// The identity: unit standard deviations.
    #[must_use]
    pub fn identity() -> Self {
        Self(SMatrix::identity())
    }

    /// The matrix Ω.
    #[must_use]
    pub fn matrix(&self) -> &SMatrix<f64, N, N> {
        &self.0
    }

    /// rᵀΩr.
    #[must_use]
    pub fn squared_norm(&self, residual: &SVector<f64, N>) -> f64 {
        residual.dot(&(self.0 * residual))
    }

    /// w Ω, the information of a factor that counts w times; w is finite and positive.
    #[must_use]
    pub fn scaled(&self, weight: f64) -> Self {
        debug_assert!(weight.is_finite() && weight > 0.0, "a weight of {weight}");
        Self(self.0 * weight)
    }

    /// The upper-triangular square root.
    ///
    /// # Errors
    /// [`InformationError::NotPositiveDefinite`] only where rounding spoiled a matrix at the edge.
    pub fn sqrt(&self) -> Result<SqrtInformation<N>, InformationError> {
        let factor = Cholesky::new(self.0).ok_or(InformationError::NotPositiveDefinite)?;
        Ok(SqrtInformation(factor.l().transpose()))
    }

    /// The covariance Σ = Ω⁻¹.
    ///
    /// # Errors
    /// As [`Information::sqrt`].
    pub fn covariance(&self) -> Result<Covariance<N>, InformationError> {
        let factor = Cholesky::new(self.0).ok_or(InformationError::NotPositiveDefinite)?;
        Ok(Covariance(factor.inverse()))
    }
}

impl<const N: usize> SqrtInformation<N> {
    /// The matrix R.
    #[must_use]
    pub fn matrix(&self) -> &SMatrix<f64, N, N> {
        &self.0
    }

    /// The whitened residual R r.
    #[must_use]
    pub fn whiten(&self, residual: &SVector<f64, N>) -> SVector<f64, N> {
        self.0 * residual
    }

    /// The information matrix RᵀR.
    #[must_use]
    pub fn information(&self) -> Information<N> {
        Information(self.0.transpose() * self.0)
    }
}

impl<const N: usize> Covariance<N> {
    /// Checks that `matrix` is finite, symmetric and positive definite.
    ///
    /// # Errors
    /// [`InformationError`] says which of the three fails.
    pub fn new(matrix: &SMatrix<f64, N, N>) -> Result<Self, InformationError> {
        Ok(Self(Information::new(matrix)?.0))
    }

    /// The matrix Σ.
    #[must_use]
    pub fn matrix(&self) -> &SMatrix<f64, N, N> {
        &self.0
    }

    /// The information matrix Ω = Σ⁻¹.
    ///
    /// # Errors
    /// As [`Information::sqrt`].
    pub fn information(&self) -> Result<Information<N>, InformationError> {
        let factor = Cholesky::new(self.0).ok_or(InformationError::NotPositiveDefinite)?;
        Ok(Information(factor.inverse()))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Matrix3, Vector3};

    use super::{Covariance, Information, InformationError};

    #[test]
    fn square_root_and_covariance_agree_with_the_matrix() {
        let matrix = Matrix3::new(4.0, 1.0, 0.5, 1.0, 3.0, -0.2, 0.5, -0.2, 2.0);
        let information = Information::new(&matrix).unwrap();
        let root = information.sqrt().unwrap();
        assert!((root.matrix().transpose() * root.matrix() - matrix).norm() < 1e-13);
        assert_eq!(root.matrix()[(1, 0)], 0.0);
        let residual = Vector3::new(0.3, -1.0, 2.0);
        let whitened = root.whiten(&residual).norm_squared();
        assert!((whitened - information.squared_norm(&residual)).abs() < 1e-12);
        let covariance = information.covariance().unwrap();
        assert!((covariance.matrix() * matrix - Matrix3::identity()).norm() < 1e-13);
        assert!((covariance.information().unwrap().matrix() - matrix).norm() < 1e-12);
    }

    #[test]
    fn names_what_is_wrong_with_a_matrix() {
        let check = |m: Matrix2<f64>| Information::new(&m).unwrap_err();
        assert_eq!(
            check(Matrix2::new(1.0, f64::NAN, 0.0, 1.0)),
            InformationError::NotFinite { row: 0, column: 1 }
        );
        assert_eq!(
            check(Matrix2::new(1.0, 0.5, 0.4, 1.0)),
            InformationError::NotSymmetric { row: 1, column: 0 }
        );
        assert_eq!(check(Matrix2::new(1.0, 2.0, 2.0, 1.0)), InformationError::NotPositiveDefinite);
        assert!(Covariance::new(&Matrix2::new(0.0, 0.0, 0.0, 1.0)).is_err());
    }
}
