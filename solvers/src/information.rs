//! Information, square-root information and covariance as distinct types.
//!
//! Ω = Σ⁻¹ = RᵀR with R upper triangular; a whitened residual is R r. Conversions are explicit and
//! checked, so that nobody passes a covariance where an information matrix belongs. Ω may be
//! singular where a caller asks for that: a direction that was not measured has no information. What a
//! residual is, and which loss it has, is not known here.

use nalgebra::{Cholesky, SMatrix, SVector};

/// Relative to the largest eigenvalue, a negative one above this is zero with its rounding.
const ROUNDING: f64 = 1e-12;
/// Relative to the largest eigenvalue, a negative one above this stays: clipping leaves as much, a few units
/// in the last place. So clipping a clipped matrix changes no bit.
const CLIPPED: f64 = 1e-14;

/// A symmetric positive semi-definite information matrix Ω; most ways to one ask for a definite one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Information<const N: usize>(SMatrix<f64, N, N>);

/// The upper-triangular R with Ω = RᵀR.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SqrtInformation<const N: usize>(SMatrix<f64, N, N>);

/// A symmetric positive-definite covariance matrix Σ = Ω⁻¹.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance<const N: usize>(SMatrix<f64, N, N>);

/// Why a matrix is not an information or covariance matrix.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
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
    /// An eigenvalue is negative by more than 1e-12 of the largest one.
    #[error("indefinite: the smallest eigenvalue is {smallest_eigenvalue:e}")]
    Indefinite {
        /// The smallest eigenvalue.
        smallest_eigenvalue: f64,
    },
}

/// Checks finiteness and symmetry, and returns the exactly symmetric matrix.
fn symmetric<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
) -> Result<SMatrix<f64, N, N>, InformationError> {
    // Most are exactly symmetric; a number that is not finite makes the sum so.
    let pairs = (0..N).all(|row| (0..row).all(|c| matrix[(row, c)] == matrix[(c, row)]));
    if pairs && matrix.iter().map(|x| x.abs()).sum::<f64>().is_finite() {
        return Ok(*matrix);
    }
    finite(matrix)?;
    if pairs {
        return Ok(*matrix);
    }
    let tolerance = 1e-9 * matrix.amax();
    for row in 0..N {
        for column in 0..row {
            if (matrix[(row, column)] - matrix[(column, row)]).abs() > tolerance {
                return Err(InformationError::NotSymmetric { row, column });
            }
        }
    }
    // Halved first: a sum of the largest numbers is none.
    Ok(matrix * 0.5 + matrix.transpose() * 0.5)
}

/// Names the first entry that is not finite.
fn finite<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Result<(), InformationError> {
    for row in 0..N {
        for column in 0..N {
            if !matrix[(row, column)].is_finite() {
                return Err(InformationError::NotFinite { row, column });
            }
        }
    }
    Ok(())
}

/// Whether a symmetric matrix is positive definite: its diagonal dominates, as in most files, or it has
/// a Cholesky factor.
fn is_definite<const N: usize>(matrix: &SMatrix<f64, N, N>) -> bool {
    let dominates =
        |c: usize| 2.0 * matrix[(c, c)] > matrix.column(c).iter().map(|x| x.abs()).sum::<f64>();
    (0..N).all(dominates) || Cholesky::new(*matrix).is_some()
}

/// The smallest eigenvalue, the same over the largest in magnitude, and the nearest matrix without
/// negative ones (in the Frobenius norm: Higham, "Computing a nearest symmetric positive semidefinite
/// matrix", 1988). Of the largest numbers there are, eigenvalue and matrix may not be finite.
fn clipped<const N: usize>(matrix: &SMatrix<f64, N, N>) -> (f64, f64, SMatrix<f64, N, N>) {
    // Products of entries must not overflow.
    let scale = if matrix.amax() > 0.0 { matrix.amax() } else { 1.0 };
    let (values, mut root) = eigen(&(matrix / scale));
    let (smallest, largest) = (values.min(), values.amax());
    let ratio = if largest > 0.0 { smallest / largest } else { 0.0 };
    // As S Sᵀ: rounding is then relative to the diagonal and leaves no negative entry on it.
    for (mut column, value) in root.column_iter_mut().zip(values.iter()) {
        column *= value.max(0.0).sqrt();
    }
    let nearest = root * root.transpose();
    (smallest * scale, ratio, (nearest + nearest.transpose()) * 0.5 * scale)
}

impl<const N: usize> Information<N> {
    /// Checks that `matrix` is finite, symmetric and positive definite.
    ///
    /// # Errors
    /// [`InformationError`] says which of the three fails.
    pub fn new(matrix: &SMatrix<f64, N, N>) -> Result<Self, InformationError> {
        let matrix = symmetric(matrix)?;
        if is_definite(&matrix) {
            Ok(Self(matrix))
        } else {
            Err(InformationError::NotPositiveDefinite)
        }
    }

    /// Checks that `matrix` is finite, symmetric and positive semi-definite: directions may have no
    /// information. Eigenvalues that are negative by rounding (1e-12 of the largest) become zero.
    ///
    /// Every way to an information matrix ends here, and what it accepts it accepts again with the same
    /// bits: a matrix that was written down can be read back.
    ///
    /// # Errors
    /// [`InformationError`] says which of the three fails.
    pub fn semidefinite(matrix: &SMatrix<f64, N, N>) -> Result<Self, InformationError> {
        let matrix = symmetric(matrix)?;
        if is_definite(&matrix) {
            return Ok(Self(matrix));
        }
        let (smallest_eigenvalue, ratio, nearest) = clipped(&matrix);
        if ratio >= -CLIPPED {
            Ok(Self(matrix))
        } else if ratio >= -ROUNDING {
            finite(&nearest).map(|()| Self(nearest))
        } else {
            Err(InformationError::Indefinite { smallest_eigenvalue })
        }
    }

    /// The positive semi-definite matrix that is nearest to `matrix` in the Frobenius norm:
    /// negative eigenvalues become zero.
    ///
    /// # Errors
    /// [`InformationError`] where `matrix` is not finite or not symmetric, or the nearest one is not
    /// finite, as of entries near the largest number.
    pub fn nearest(matrix: &SMatrix<f64, N, N>) -> Result<Self, InformationError> {
        Self::semidefinite(matrix).or_else(|error| match error {
            InformationError::Indefinite { .. } => {
                let nearest = clipped(&symmetric(matrix)?).2;
                finite(&nearest).map(|()| Self(nearest))
            }
            InformationError::NotFinite { .. }
            | InformationError::NotSymmetric { .. }
            | InformationError::NotPositiveDefinite => Err(error),
        })
    }

    /// Whether every direction has information: with the diagonal scaled to ones, so that units of
    /// the tangent do not matter, no eigenvalue is below 1e-12, where rounding could have made it.
    #[must_use]
    pub fn is_definite(&self) -> bool {
        Cholesky::new(self.0).is_some_and(|factor| {
            let l = factor.l_dirty();
            let diagonal = self.0.diagonal();
            // With a trace of N, an eigenvalue is at least the determinant over e.
            let determinant: f64 = (0..N).map(|k| l[(k, k)] * l[(k, k)] / diagonal[k]).product();
            // And at least one over the trace of the inverse.
            determinant > 3.0 * ROUNDING
                || factor.inverse().diagonal().dot(&diagonal) < 1.0 / ROUNDING
        })
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

    /// rᵀΩr, never negative: not by rounding either, where r has no information.
    #[must_use]
    pub fn squared_norm(&self, residual: &SVector<f64, N>) -> f64 {
        let squared = residual.dot(&(self.0 * residual));
        // NaN stays NaN.
        if squared < 0.0 { 0.0 } else { squared }
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
    /// [`InformationError::NotPositiveDefinite`] for a singular matrix.
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

/// Sweeps of [`eigen`]; convergence is quadratic, and six are many.
const SWEEPS: usize = 16;

/// Eigenvalues, and eigenvectors by column, of a small symmetric matrix: Jacobi's cyclic rotations, which
/// find tiny eigenvalues of a scaled matrix to their own precision (Demmel and Veselić 1992), end on
/// any input and allocate nothing.
pub(crate) fn eigen<const N: usize>(
    matrix: &SMatrix<f64, N, N>,
) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
    let (mut a, mut vectors) = (*matrix, SMatrix::<f64, N, N>::identity());
    for _ in 0..SWEEPS {
        let mut is_diagonal = true;
        for p in 0..N {
            for q in p + 1..N {
                let off = a[(p, q)];
                if off.abs() <= f64::EPSILON * (a[(p, p)] * a[(q, q)]).abs().sqrt() {
                    continue;
                }
                is_diagonal = false;
                let cotangent = (a[(q, q)] - a[(p, p)]) / (2.0 * off);
                let tangent = cotangent.signum() / (cotangent.abs() + cotangent.hypot(1.0));
                let cosine = 1.0 / tangent.hypot(1.0);
                let sine = tangent * cosine;
                turn(&mut a, p, q, cosine, sine);
                a = a.transpose();
                turn(&mut a, p, q, cosine, sine);
                turn(&mut vectors, p, q, cosine, sine);
            }
        }
        if is_diagonal {
            break;
        }
    }
    (a.diagonal(), vectors)
}

/// Rotates columns p and q.
fn turn<const N: usize>(
    matrix: &mut SMatrix<f64, N, N>,
    p: usize,
    q: usize,
    cosine: f64,
    sine: f64,
) {
    for k in 0..N {
        let (x, y) = (matrix[(k, p)], matrix[(k, q)]);
        matrix[(k, p)] = cosine * x - sine * y;
        matrix[(k, q)] = sine * x + cosine * y;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Matrix3, Matrix6, Vector3, Vector6};

    use super::{Covariance, Information, InformationError};

    #[test]
    fn the_largest_numbers_stay_finite() {
        let huge = Matrix3::new(1e308, 0.0, 0.0, 0.0, 1e308, 0.0, 0.0, 0.0, 1e308);
        assert_eq!(Information::semidefinite(&huge).unwrap().matrix(), &huge);
        let uneven = huge + Matrix3::new(0.0, 1e290, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let even = Information::new(&uneven).unwrap();
        assert!(even.matrix().iter().all(|entry| entry.is_finite()), "{even:?}");
        // Clipping makes these larger than a number can be.
        let turned = Matrix2::new(0.0, 1.7e308, 1.7e308, 1.7e308);
        for matrix in [turned, Matrix2::new(1.7e308, 1.7e308, 1.7e308, 1.6e308)] {
            match Information::nearest(&matrix) {
                Ok(nearest) => assert!(nearest.matrix().iter().all(|entry| entry.is_finite())),
                Err(error) => assert!(matches!(error, InformationError::NotFinite { .. })),
            }
        }
    }

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

    #[test]
    fn a_direction_may_have_no_information_where_the_caller_allows_it() {
        let direction = Vector3::new(0.6, -0.3, 0.2);
        for scale in [1e-200, 1.0, 1e200] {
            let rank_one = direction * direction.transpose() * scale;
            let information = Information::semidefinite(&rank_one).unwrap();
            assert!((information.matrix() - rank_one).amax() <= 1e-15 * rank_one.amax());
            assert!(!information.is_definite() && information.sqrt().is_err());
            assert!(information.squared_norm(&Vector3::new(0.3, 0.6, 0.0)) >= 0.0);
            // By rounding and by more than rounding.
            let lowered = |by: f64| rank_one - Matrix3::identity() * (by * scale);
            let clipped = Information::semidefinite(&lowered(1e-13)).unwrap();
            assert!((clipped.matrix() - rank_one).amax() < 1e-12 * scale);
            let error = Information::semidefinite(&lowered(1e-9)).unwrap_err();
            let InformationError::Indefinite { smallest_eigenvalue } = error else {
                panic!("{error}")
            };
            assert!((smallest_eigenvalue / (-1e-9 * scale) - 1.0).abs() < 1e-5, "{error}");
        }
        assert!(Information::semidefinite(&Matrix3::<f64>::zeros()).is_ok());
        // Whatever axis is factored last: its pivot is rounding over the square of the null vector.
        for axis in 0..3 {
            for share in [1.0, 1e-1, 1e-2, 1e-3] {
                let mut null = Vector3::new(0.6, -0.3, 0.2);
                null[axis] *= share;
                let rank_two = Matrix3::identity() - null * null.transpose() / null.norm_squared();
                let units = Matrix3::from_diagonal(&Vector3::new(1e-3, 1.0, 1e4));
                let information = Information::semidefinite(&(units * rank_two * units)).unwrap();
                assert!(!information.is_definite(), "{axis} {share}");
            }
        }
        // Units of a kilometer beside units of a microradian are no lack of information.
        let units = Matrix3::from_diagonal(&Vector3::new(1e-6, 1.0, 1e12));
        assert!(Information::new(&units).unwrap().is_definite());
    }

    #[test]
    fn what_is_accepted_is_accepted_again_with_the_same_bits() {
        let mut state = 1_u64;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        };
        let mut clipped = 0;
        for round in 0..2_000 {
            let rank = round % 6 + 1;
            let units = Vector6::from_fn(|_, _| 10_f64.powf(12.0 * random()));
            let mut matrix = Matrix6::zeros();
            for _ in 0..rank {
                let direction = Vector6::from_fn(|_, _| random()).component_mul(&units);
                matrix += direction * direction.transpose();
            }
            matrix -= Matrix6::identity() * (matrix.amax() * 5e-13 * random().max(0.0));
            let Ok(first) = Information::semidefinite(&matrix) else { continue };
            clipped += usize::from(*first.matrix() != matrix);
            let again = Information::semidefinite(first.matrix()).unwrap();
            assert_eq!(again.matrix(), first.matrix(), "{matrix}");
        }
        assert!(clipped > 100, "{clipped} had negative eigenvalues to clip");
    }

    #[test]
    fn the_nearest_matrix_keeps_what_is_positive() {
        // Eigenvalues 3 along (1, 1) and −1 along (1, −1).
        let nearest = Information::nearest(&Matrix2::new(1.0, 2.0, 2.0, 1.0)).unwrap();
        assert!((nearest.matrix() - Matrix2::repeat(1.5)).amax() < 1e-15);
        let again = Information::semidefinite(nearest.matrix()).unwrap();
        assert!((again.matrix() - nearest.matrix()).amax() < 1e-15);
        let negative = Information::nearest(&-Matrix2::<f64>::identity()).unwrap();
        assert_eq!(*negative.matrix(), Matrix2::zeros());
        assert!(Information::nearest(&Matrix2::repeat(f64::NAN)).is_err());
    }
}
