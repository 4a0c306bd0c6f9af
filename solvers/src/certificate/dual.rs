//! Whether a critical point of the chordal problem is its global optimum.
//!
//! With S = M − Λ and C the ones on rotation rows, S + ηC ⪰ 0 bounds every other state: F ≥ F* − η D n
//! over n poses (SE-Sync, theorem 7, with a margin). A Cholesky factorization of S + ηC proves it for
//! that η, whatever an eigensolver thinks; the smallest eigenvalue of the pencil (S, C) and its vector
//! come from Lanczos on (S + ηC)⁻¹ C. Nothing here moves a state.

use nalgebra::{DMatrix, SMatrix};

use super::manifold::{multipliers, subtract_multiplied};
use super::quadratic::{Lifted, add};
use crate::interrupt::Interrupt;
use crate::linear::{BlockMatrix, Cholesky, LinearError};
use crate::price::Ceiling;

/// Steps of Lanczos.
pub(super) const LANCZOS_STEPS: usize = 40;

/// η beyond which nothing is proved any more, over the mean diagonal of M.
const LARGEST_MARGIN: f64 = 10.0;

/// What the dual says of a state.
#[derive(Clone, Debug)]
pub(super) struct Dual {
    /// η for which S + ηC was factored: F is within η D n of the optimum.
    pub(super) margin: f64,
    /// The smallest eigenvalue of (S, C), estimated.
    pub(super) min_eigenvalue: f64,
    /// Its vector, normed over rotation rows: a row that lowers F where the eigenvalue is negative.
    pub(super) direction: Vec<f64>,
}

/// Looks for the smallest margin from `margin` on, tenfold each time.
///
/// # Errors
/// [`LinearError`] where no margin makes the matrix positive definite: a state that is not finite;
/// [`LinearError::Interrupted`].
pub(super) fn dual<const D: usize>(
    matrix: &BlockMatrix,
    x: &Lifted,
    margin: f64,
    interrupt: &Interrupt,
) -> Result<Dual, LinearError> {
    let multipliers = multipliers::<D>(x, &x.times(matrix));
    let slack = slack::<D>(matrix, &multipliers);
    let diagonal = matrix.diagonal();
    let mean = diagonal.iter().sum::<f64>() / diagonal.len().max(1) as f64;
    // Of the size of the preconditioner, which was within the limits.
    let pattern = std::sync::Arc::clone(slack.pattern());
    let mut factor = Cholesky::within(pattern, Ceiling::NONE, interrupt)?;
    let mut margin = margin;
    let mut added = vec![0.0; diagonal.len()];
    loop {
        for (k, added) in added.iter_mut().enumerate() {
            *added = if k % (D + 1) == D { 0.0 } else { margin };
        }
        // Moving all positions alike changes nothing: the first is held.
        added[D] = mean;
        match factor.factor_until(&slack, &added, interrupt) {
            Ok(()) => break,
            Err(LinearError::NotPositiveDefinite { .. }) if margin < LARGEST_MARGIN * mean => {
                margin *= 10.0;
            }
            Err(error) => return Err(error),
        }
    }
    let (top, direction) = lanczos::<D>(&mut factor, x, interrupt);
    if interrupt.is_due() {
        return Err(LinearError::Interrupted);
    }
    Ok(Dual { margin, min_eigenvalue: 1.0 / top - margin, direction })
}

/// S.
fn slack<const D: usize>(matrix: &BlockMatrix, multipliers: &[SMatrix<f64, D, D>]) -> BlockMatrix {
    let mut slack = matrix.clone();
    for (i, lambda) in multipliers.iter().enumerate() {
        add(&mut slack, (i, i), D + 1, |r, c| if r == D || c == D { 0.0 } else { -lambda[(r, c)] });
    }
    slack
}

/// The largest eigenvalue of (S + ηC)⁻¹ C and its vector, C-orthogonal to the rows of `x`.
///
/// The rows of a critical point span eigenvectors of value 0 of S, which say nothing of other states
/// and would hide a negative eigenvalue that is not far below; so they are taken out.
fn lanczos<const D: usize>(
    factor: &mut Cholesky,
    x: &Lifted,
    interrupt: &Interrupt,
) -> (f64, Vec<f64>) {
    let length = x.rows[0].len();
    let dot = |a: &[f64], b: &[f64]| -> f64 {
        let rotation = |k: &usize| k % (D + 1) != D;
        (0..length).filter(rotation).map(|k| a[k] * b[k]).sum()
    };
    let known = orthonormal(&x.rows, &dot);
    let clean = |v: &mut Vec<f64>, basis: &[Vec<f64>]| {
        for _ in 0..2 {
            for b in known.iter().chain(basis) {
                let share = dot(v, b);
                v.iter_mut().zip(b).for_each(|(v, b)| *v -= share * b);
            }
        }
    };
    // Any start with a share of everything, the same each time.
    let mut v: Vec<f64> =
        (0..length).map(|k| ((k as f64 * 0.754_877_666).fract() - 0.5) * 2.0).collect();
    clean(&mut v, &[]);
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let (mut alphas, mut betas) = (Vec::new(), Vec::new());
    let mut norm = dot(&v, &v).max(0.0).sqrt();
    let steps = LANCZOS_STEPS.min(length.saturating_sub(known.len()));
    let mut largest = 0.0_f64;
    while basis.len() < steps
        && norm > 1e-12 * largest.max(f64::MIN_POSITIVE)
        && !interrupt.is_due()
    {
        v.iter_mut().for_each(|v| *v /= norm);
        basis.push(v.clone());
        for (k, v) in v.iter_mut().enumerate() {
            if k % (D + 1) == D {
                *v = 0.0;
            }
        }
        factor.solve(&mut v);
        let last = &basis[basis.len() - 1];
        let alpha = dot(&v, last);
        largest = largest.max(alpha.abs());
        alphas.push(alpha);
        clean(&mut v, &basis);
        norm = dot(&v, &v).max(0.0).sqrt();
        betas.push(norm);
    }
    let count = basis.len();
    if count == 0 {
        return (f64::INFINITY, vec![0.0; length]);
    }
    let tridiagonal = DMatrix::from_fn(count, count, |r, c| match r.abs_diff(c) {
        0 => alphas[r],
        1 => betas[r.min(c)],
        _ => 0.0,
    });
    let eigen = tridiagonal.symmetric_eigen();
    let top = eigen.eigenvalues.imax();
    let mut direction = vec![0.0; length];
    for (b, &share) in basis.iter().zip(eigen.eigenvectors.column(top).iter()) {
        direction.iter_mut().zip(b).for_each(|(d, b)| *d += share * b);
    }
    // Orthogonality holds for rotations alone and lets positions drift: once more, the best ones for
    // these rotations.
    direction.iter_mut().skip(D).step_by(D + 1).for_each(|position| *position = 0.0);
    factor.solve(&mut direction);
    (eigen.eigenvalues[top], direction)
}

/// The vectors made orthonormal in order; those that depend on earlier ones are left out.
fn orthonormal(vectors: &[Vec<f64>], dot: &impl Fn(&[f64], &[f64]) -> f64) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for vector in vectors {
        let mut v = vector.clone();
        let before = dot(&v, &v);
        for b in &basis {
            let share = dot(&v, b);
            v.iter_mut().zip(b).for_each(|(v, b)| *v -= share * b);
        }
        let norm = dot(&v, &v);
        if norm > 1e-12 * before {
            v.iter_mut().for_each(|v| *v /= norm.sqrt());
            basis.push(v);
        }
    }
    basis
}

/// The largest entry of the gradient P(X M), for the report.
pub(super) fn gradient_max<const D: usize>(matrix: &BlockMatrix, x: &Lifted) -> f64 {
    let mut gradient = x.times(matrix);
    let multipliers = multipliers::<D>(x, &gradient);
    subtract_multiplied(&mut gradient, x, &multipliers);
    gradient.rows.iter().flatten().fold(0.0, |m, g| m.max(g.abs()))
}
