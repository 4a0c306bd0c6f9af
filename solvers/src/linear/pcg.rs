//! Conjugate gradients on a block-sparse matrix, preconditioned by its diagonal blocks.
//!
//! Solves (H + D) x = g inexactly (Hestenes and Stiefel 1952; block Jacobi). It ends by the rule of
//! Nash and Sofer (1990): once k (Q_k − Q_{k−1}) / Q_k < η with the quadratic Q = ½ xᵀAx − gᵀx, more
//! steps would not make the outer step better. From x = 0 every iterate satisfies xᵀ(Ax − g) = 0,
//! which is what the trust region's predicted decrease needs. Each row of a product is computed by
//! one task, so that bits do not depend on the number of threads.

use std::sync::Arc;

use rayon::prelude::*;

use super::error::LinearError;
use super::matrix::BlockMatrix;
use super::pattern::BlockPattern;
use crate::simd::{Class, Kernel, Lanes};

/// Rows of a task: fixed, so that partial sums are always the same.
const ROWS: usize = 16;

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PcgOutcome {
    /// Products with the matrix.
    pub iterations: usize,
    /// ‖(H + D) x − g‖ / ‖g‖, recurred.
    pub relative_residual: f64,
}

/// Preconditioned conjugate gradients on one pattern; memory is allocated once.
#[derive(Debug)]
pub struct Pcg {
    pattern: Arc<BlockPattern>,
    class: Class,
    /// Blocks below the diagonal of each column: (row, block number).
    below: Vec<Vec<(u32, u32)>>,
    /// Cholesky factors of the diagonal blocks, lower, column-major, diagonal inverted.
    factors: Vec<f64>,
    factor_starts: Vec<usize>,
    r: Vec<f64>,
    z: Vec<f64>,
    p: Vec<f64>,
    q: Vec<f64>,
}

impl Pcg {
    /// Plans for `pattern`.
    pub fn new(pattern: Arc<BlockPattern>) -> Self {
        let blocks = pattern.block_count();
        let mut below = vec![Vec::new(); blocks];
        let mut factor_starts = vec![0; blocks + 1];
        for row in 0..blocks {
            for (slot, &column) in pattern.row_range(row).zip(pattern.row(row)) {
                if (column as usize) < row {
                    below[column as usize].push((row as u32, slot as u32));
                }
            }
            let size = pattern.sizes()[row];
            factor_starts[row + 1] = factor_starts[row] + size * size;
        }
        let zero = vec![0.0; pattern.dimension()];
        Self {
            class: Class::detect(),
            below,
            factors: vec![0.0; factor_starts[blocks]],
            factor_starts,
            r: zero.clone(),
            z: zero.clone(),
            p: zero.clone(),
            q: zero,
            pattern,
        }
    }

    /// Solves (H + D) x = g from x = 0, in at most `max_iterations` products.
    ///
    /// # Errors
    /// Not positive definite, seen in a diagonal block or a direction; then `x` is not a solution.
    pub fn solve(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
        g: &[f64],
        x: &mut [f64],
        (tolerance, max_iterations): (f64, usize),
    ) -> Result<PcgOutcome, LinearError> {
        self.factor_diagonal(matrix, added_diagonal)?;
        x.fill(0.0);
        self.r.copy_from_slice(g);
        let norm = dot(g, g).sqrt();
        let mut outcome = PcgOutcome { iterations: 0, relative_residual: 0.0 };
        if norm == 0.0 {
            return Ok(outcome);
        }
        let mut rho = 0.0;
        let mut quadratic = 0.0;
        for k in 1..=max_iterations {
            self.precondition();
            let before = rho;
            rho = dot(&self.r, &self.z);
            if k == 1 {
                self.p.copy_from_slice(&self.z);
            } else {
                let beta = rho / before;
                self.p.iter_mut().zip(&self.z).for_each(|(p, z)| *p = z + beta * *p);
            }
            self.multiply(matrix, added_diagonal);
            let curvature = dot(&self.p, &self.q);
            if !(curvature > 0.0 && curvature.is_finite()) {
                return Err(LinearError::NotPositiveDefinite { block: 0, scalar: 0 });
            }
            let alpha = rho / curvature;
            for (((x, p), r), q) in x.iter_mut().zip(&self.p).zip(&mut self.r).zip(&self.q) {
                *x += alpha * p;
                *r -= alpha * q;
            }
            outcome.iterations = k;
            outcome.relative_residual = dot(&self.r, &self.r).sqrt() / norm;
            // Q = ½ xᵀAx − gᵀx = −½ xᵀ(g + r).
            let next: f64 = -0.5
                * x.iter().zip(g.iter().zip(&self.r)).map(|(x, (g, r))| x * (g + r)).sum::<f64>();
            let gain = k as f64 * (next - quadratic) / next;
            quadratic = next;
            if gain < tolerance || outcome.relative_residual < 1e-14 {
                break;
            }
        }
        Ok(outcome)
    }

    /// Factors the diagonal blocks of H + D.
    fn factor_diagonal(&mut self, matrix: &BlockMatrix, added: &[f64]) -> Result<(), LinearError> {
        for block in 0..self.pattern.block_count() {
            let size = self.pattern.sizes()[block];
            let offset = self.pattern.offset(block);
            let range = self.factor_starts[block]..self.factor_starts[block + 1];
            let target = &mut self.factors[range];
            let Some(source) = matrix.block(block, block) else { continue };
            target.copy_from_slice(source);
            for i in 0..size {
                target[i * size + i] += added.get(offset + i).copied().unwrap_or(0.0);
            }
            if !factor_in_place(target, size) {
                return Err(LinearError::NotPositiveDefinite { block, scalar: offset });
            }
        }
        Ok(())
    }

    /// z = M⁻¹ r.
    fn precondition(&mut self) {
        for block in 0..self.pattern.block_count() {
            let size = self.pattern.sizes()[block];
            let offset = self.pattern.offset(block);
            let l = &self.factors[self.factor_starts[block]..self.factor_starts[block + 1]];
            let z = &mut self.z[offset..offset + size];
            z.copy_from_slice(&self.r[offset..offset + size]);
            for i in 0..size {
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

    /// q = (H + D) p.
    fn multiply(&mut self, matrix: &BlockMatrix, added: &[f64]) {
        let (pattern, below, p, class) = (&self.pattern, &self.below, &self.p, self.class);
        let blocks = pattern.block_count();
        let mut rest = self.q.as_mut_slice();
        let mut tasks = Vec::with_capacity(blocks / ROWS + 1);
        for begin in (0..blocks).step_by(ROWS) {
            let end = (begin + ROWS).min(blocks);
            let (q, tail) = rest.split_at_mut(pattern.offset(end) - pattern.offset(begin));
            rest = tail;
            tasks.push((begin..end, q));
        }
        tasks.into_par_iter().for_each(|(rows, q)| {
            class.run(Multiply { pattern, below, matrix, added, p, rows, q });
        });
    }
}

struct Multiply<'a> {
    pattern: &'a BlockPattern,
    below: &'a [Vec<(u32, u32)>],
    matrix: &'a BlockMatrix,
    added: &'a [f64],
    p: &'a [f64],
    rows: std::ops::Range<usize>,
    q: &'a mut [f64],
}

impl Kernel for Multiply<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _lanes: L) {
        let (pattern, values) = (self.pattern, self.matrix.values());
        let base = pattern.offset(self.rows.start);
        for row in self.rows {
            let (size, offset) = (pattern.sizes()[row], pattern.offset(row));
            let q = &mut self.q[offset - base..offset - base + size];
            let own = &self.p[offset..offset + size];
            for (i, q) in q.iter_mut().enumerate() {
                *q = self.added.get(offset + i).copied().unwrap_or(0.0) * own[i];
            }
            for (slot, &column) in pattern.row_range(row).zip(pattern.row(row)) {
                let column = column as usize;
                let block = &values[pattern.value_range(slot)];
                if column == row {
                    // Only the lower triangle of a diagonal block is defined.
                    for c in 0..size {
                        let x = own[c];
                        q[c] += block[c * size + c] * x;
                        for r in c + 1..size {
                            let entry = block[c * size + r];
                            q[r] += entry * x;
                            q[c] += entry * own[r];
                        }
                    }
                } else {
                    let start = pattern.offset(column);
                    add_product(q, block, &self.p[start..start + pattern.sizes()[column]]);
                }
            }
            for &(below, slot) in &self.below[row] {
                let start = pattern.offset(below as usize);
                let x = &self.p[start..start + pattern.sizes()[below as usize]];
                add_transposed(q, &values[pattern.value_range(slot as usize)], x);
            }
        }
    }
}

/// q += B x for a column-major block.
#[inline(always)]
fn add_product(q: &mut [f64], block: &[f64], x: &[f64]) {
    for (column, x) in block.chunks_exact(q.len()).zip(x) {
        for (q, entry) in q.iter_mut().zip(column) {
            *q += entry * x;
        }
    }
}

/// q += Bᵀ x for a column-major block.
#[inline(always)]
fn add_transposed(q: &mut [f64], block: &[f64], x: &[f64]) {
    for (column, q) in block.chunks_exact(x.len()).zip(q) {
        *q += column.iter().zip(x).map(|(entry, x)| entry * x).sum::<f64>();
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
