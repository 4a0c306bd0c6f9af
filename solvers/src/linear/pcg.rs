//! Preconditioned conjugate gradients on whatever can be multiplied, and block Jacobi.
//!
//! Solves A x = g inexactly (Hestenes and Stiefel 1952). It ends by the rule of Nash and Sofer
//! (1990): once k (Q_k − Q_{k−1}) / Q_k < η with the quadratic Q = ½ xᵀAx − gᵀx, more steps would not
//! make the outer step better. From x = 0 every iterate satisfies xᵀ(Ax − g) = 0, which is what the
//! trust region's predicted decrease needs. It knows no threads: products are the caller's.

use super::error::LinearError;
use super::matrix::BlockMatrix;
use crate::interrupt::Interrupt;
use crate::parallel;

/// When conjugate gradients end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StoppingRule {
    /// η of the rule of Nash and Sofer.
    pub tolerance: f64,
    /// Products with the matrix, at most.
    pub max_products: usize,
}

/// What a solve by conjugate gradients took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Solved {
    /// ‖A x − g‖ / ‖g‖ by its recurrence.
    pub relative_residual: f64,
    /// Products with the matrix.
    pub products: usize,
}

/// Conjugate gradients; memory is allocated once.
#[derive(Clone, Debug, Default)]
pub struct Pcg {
    r: Vec<f64>,
    z: Vec<f64>,
    p: Vec<f64>,
    q: Vec<f64>,
}

impl Pcg {
    /// Solves A x = g from x = 0; `multiply(p, q)` sets q = A p.
    ///
    /// # Errors
    /// Not positive definite, seen in a direction, or [`LinearError::Interrupted`]; then `x` is not a
    /// solution.
    pub fn solve(
        &mut self,
        mut multiply: impl FnMut(&[f64], &mut [f64]),
        preconditioner: &BlockJacobi,
        g: &[f64],
        x: &mut [f64],
        stop: StoppingRule,
        interrupt: &Interrupt,
    ) -> Result<Solved, LinearError> {
        for vector in [&mut self.z, &mut self.p, &mut self.q] {
            vector.resize(g.len(), 0.0);
        }
        x.fill(0.0);
        self.r.clear();
        self.r.extend_from_slice(g);
        let norm = dot(g, g).sqrt();
        let mut solved = Solved::default();
        if norm == 0.0 {
            return Ok(solved);
        }
        let mut rho = 0.0;
        let mut quadratic = 0.0;
        for k in 1..=stop.max_products {
            if interrupt.is_due() {
                return Err(LinearError::Interrupted);
            }
            preconditioner.apply(&self.r, &mut self.z);
            let before = rho;
            rho = dot(&self.r, &self.z);
            if k == 1 {
                self.p.copy_from_slice(&self.z);
            } else {
                let beta = rho / before;
                self.p.iter_mut().zip(&self.z).for_each(|(p, z)| *p = z + beta * *p);
            }
            multiply(&self.p, &mut self.q);
            let curvature = dot(&self.p, &self.q);
            if !(curvature > 0.0 && curvature.is_finite()) {
                return Err(LinearError::NotPositiveDefinite { block: 0, scalar: 0 });
            }
            let alpha = rho / curvature;
            for (((x, p), r), q) in x.iter_mut().zip(&self.p).zip(&mut self.r).zip(&self.q) {
                *x += alpha * p;
                *r -= alpha * q;
            }
            solved = Solved { relative_residual: dot(&self.r, &self.r).sqrt() / norm, products: k };
            // Q = ½ xᵀAx − gᵀx = −½ xᵀ(g + r).
            let next: f64 = -0.5
                * x.iter().zip(g.iter().zip(&self.r)).map(|(x, (g, r))| x * (g + r)).sum::<f64>();
            let gain = k as f64 * (next - quadratic) / next;
            quadratic = next;
            if gain < stop.tolerance || solved.relative_residual < 1e-14 {
                break;
            }
        }
        Ok(solved)
    }
}

/// The inverses of the diagonal blocks of a matrix.
#[derive(Clone, Debug, Default)]
pub struct BlockJacobi {
    sizes: Vec<usize>,
    /// Inverse blocks one after the other, full and column-major.
    inverses: Vec<f64>,
}

impl BlockJacobi {
    /// Inverts the diagonal blocks of H + D, of which only lower triangles are read.
    ///
    /// # Errors
    /// [`LinearError::NotPositiveDefinite`] names the first block that is not.
    pub fn factor(&mut self, matrix: &BlockMatrix, added: &[f64]) -> Result<(), LinearError> {
        let pattern = matrix.pattern();
        self.sizes.clear();
        self.sizes.extend_from_slice(pattern.sizes());
        self.inverses.resize(self.sizes.iter().map(|n| n * n).sum(), 0.0);
        let mut rest = self.inverses.as_mut_slice();
        let mut blocks = Vec::with_capacity(self.sizes.len());
        for (block, &size) in self.sizes.iter().enumerate() {
            let (inverse, tail) = rest.split_at_mut(size * size);
            rest = tail;
            blocks.push((block, size, inverse));
        }
        let factor = |&mut (block, size, ref mut inverse): &mut (usize, usize, &mut [f64])| {
            let offset = pattern.offset(block);
            let mut factor = matrix.block(block, block)?.to_vec();
            for i in 0..size {
                factor[i * size + i] += added.get(offset + i).copied().unwrap_or(0.0);
            }
            if !factor_in_place(&mut factor, size) {
                return Some((block, offset));
            }
            invert(&factor, size, inverse);
            None
        };
        let failed = parallel::map(blocks.chunks_mut(64), |run| run.iter_mut().find_map(factor));
        match failed.into_iter().flatten().next() {
            None => Ok(()),
            Some((block, scalar)) => Err(LinearError::NotPositiveDefinite { block, scalar }),
        }
    }

    /// z = M⁻¹ r.
    pub fn apply(&self, r: &[f64], z: &mut [f64]) {
        let (mut offset, mut start) = (0, 0);
        for &size in &self.sizes {
            let z = &mut z[offset..offset + size];
            z.fill(0.0);
            let inverse = &self.inverses[start..start + size * size];
            for (column, r) in inverse.chunks_exact(size.max(1)).zip(&r[offset..offset + size]) {
                for (z, entry) in z.iter_mut().zip(column) {
                    *z += entry * r;
                }
            }
            offset += size;
            start += size * size;
        }
    }
}

/// (L Lᵀ)⁻¹, column by column, for a factor with inverted diagonal.
fn invert(l: &[f64], size: usize, inverse: &mut [f64]) {
    inverse.fill(0.0);
    for (c, z) in inverse.chunks_exact_mut(size.max(1)).enumerate() {
        z[c] = 1.0;
        for i in c..size {
            z[i] *= l[i * size + i];
            for k in i + 1..size {
                z[k] -= l[i * size + k] * z[i];
            }
        }
        for i in (0..size).rev() {
            for k in i + 1..size {
                z[i] -= l[i * size + k] * z[k];
            }
            z[i] *= l[i * size + i];
        }
    }
}

/// Lower Cholesky factor of the lower triangle, the diagonal inverted; false where a pivot fails.
fn factor_in_place(a: &mut [f64], size: usize) -> bool {
    for j in 0..size {
        for k in 0..j {
            let factor = a[k * size + j];
            for i in j..size {
                a[j * size + i] -= a[k * size + i] * factor;
            }
        }
        let pivot = a[j * size + j];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        let inverse = 1.0 / pivot.sqrt();
        a[j * size + j] = inverse;
        for i in j + 1..size {
            a[j * size + i] *= inverse;
        }
    }
    true
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
