//! Elimination of all blocks but some: what those leave of the system on the others.
//!
//! With I the blocks that are eliminated and B the border, which all its blocks are tied in, the front
//! of the border holds S = H_BB − H_BI (H_II + D)⁻¹ H_IB once everything else is eliminated. It is left
//! there; the right-hand side goes up the same way, and the solution on the border comes down again. It
//! decides nothing about the border's own system.

use std::sync::Arc;

use super::numeric::Numeric;
use super::plan::{Plan, bytes};
use super::shape::Aligned;
use super::triangular::{Sweep, Triangular};
use crate::interrupt::Interrupt;
use crate::linear::checked::check_system;
use crate::linear::error::LinearError;
use crate::linear::matrix::BlockMatrix;
use crate::linear::ordering::cheapest_with_last;
use crate::linear::pattern::BlockPattern;
use crate::price::Price;
use crate::simd::Class;

/// A factorization of all blocks of a matrix but those of a border.
#[derive(Debug)]
pub struct PartialCholesky {
    pattern: Arc<BlockPattern>,
    plan: Plan,
    /// The node of the border; `None` where the border is empty.
    border: Option<u32>,
    /// Rows of the border.
    border_dimension: usize,
    factor: Aligned,
    space: Aligned,
    permuted: Aligned,
    front: Aligned,
    class: Class,
    price: Price,
    factored: bool,
}

impl PartialCholesky {
    /// Plans for `pattern`, in which the blocks marked in `is_border` are all tied to each other.
    ///
    /// # Errors
    /// Too large to index, no memory, [`LinearError::Interrupted`]; [`LinearError::PatternMismatch`]
    /// where a mark is missing or the border's blocks are not all tied to each other.
    pub fn new(
        pattern: Arc<BlockPattern>,
        is_border: &[bool],
        interrupt: &Interrupt,
    ) -> Result<Self, LinearError> {
        let count = pattern.block_count();
        let border: Vec<usize> =
            (0..count.min(is_border.len())).filter(|&b| is_border[b]).collect();
        let is_tied = border
            .iter()
            .enumerate()
            .all(|(k, &i)| border[..k].iter().all(|&j| pattern.find(i, j).is_some()));
        if is_border.len() != count || !is_tied {
            let (expected, found) = (count, is_border.len());
            return Err(LinearError::PatternMismatch { expected, found });
        }
        let (ordering, elimination) = cheapest_with_last(&pattern, is_border, interrupt)?;
        let first = count - border.len();
        let plan = Plan::with_border(&pattern, &ordering.order, &elimination, first)?;
        let price = Price {
            bytes: bytes(&pattern, &ordering.order, &elimination),
            flops_per_iteration: ordering.flops,
        };
        let dimension = pattern.dimension();
        let memory = |length| Aligned::new(length).ok_or(LinearError::OutOfMemory { dimension });
        Ok(Self {
            border: (!border.is_empty()).then(|| plan.nodes.len().saturating_sub(1) as u32),
            border_dimension: border.iter().map(|&b| pattern.sizes()[b]).sum(),
            factor: memory(plan.factor_size)?,
            space: memory(plan.space)?,
            permuted: memory(dimension)?,
            front: memory(plan.longest)?,
            class: Class::detect(),
            price,
            factored: false,
            pattern,
            plan,
        })
    }

    /// Uses the kernels of another instruction set, or the scalar ones where the processor lacks it.
    pub fn set_class(&mut self, class: Class) {
        self.class = class;
        self.factored = false;
    }

    /// What the factorization takes, planning included, and its flops.
    pub fn price(&self) -> Price {
        self.price
    }

    /// Rows of the border.
    pub fn border_dimension(&self) -> usize {
        self.border_dimension
    }

    /// Eliminates everything but the border of H + D; `added_diagonal` is D, or empty for zero.
    ///
    /// # Errors
    /// Not positive definite, not finite, a matrix or diagonal of another shape,
    /// [`LinearError::Interrupted`]. After an error nothing is eliminated.
    pub fn factor_until(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
        interrupt: &Interrupt,
    ) -> Result<(), LinearError> {
        self.factored = false;
        check_system(&self.pattern, matrix, added_diagonal)?;
        let numeric = Numeric {
            plan: &self.plan,
            values: matrix.values(),
            added: added_diagonal,
            class: self.class,
            interrupt,
            is_parallel: rayon::current_num_threads() > 1,
            border: self.border,
        };
        let outcome = numeric.run(self.factor.slice_mut(), self.space.slice_mut());
        if interrupt.is_due() {
            return Err(LinearError::Interrupted);
        }
        outcome.map_err(|bad| {
            let scalar = self.plan.scalars[bad.column] as usize;
            let block = self.pattern.block_of(scalar);
            if bad.is_finite {
                LinearError::NotPositiveDefinite { block, scalar }
            } else {
                LinearError::NonFinite { block }
            }
        })?;
        self.factored = true;
        Ok(())
    }

    /// S of the last factorization: its lower triangle, column after column, rows and columns in the
    /// order of the border's blocks. Empty where nothing is factored.
    pub fn border_matrix(&self) -> Vec<f64> {
        let n = self.border_dimension;
        let Some(node) = self.border.filter(|_| self.factored) else { return Vec::new() };
        let node = &self.plan.nodes[node as usize];
        let panel = &self.factor.slice()[node.panel..][..node.shape.panel_size()];
        let mut lower = Vec::with_capacity(n * (n + 1) / 2);
        for (k, column) in panel.chunks_exact(node.shape.stride).enumerate() {
            lower.extend_from_slice(&column[k..n]);
        }
        lower
    }

    /// Takes a right-hand side g up: returns g_B − H_BI (H_II + D)⁻¹ g_I and keeps what
    /// [`Self::expand`] needs. NaN where nothing is factored or the length is wrong.
    pub fn reduce(&mut self, rhs: &[f64]) -> Vec<f64> {
        let n = self.border_dimension;
        if !self.factored || rhs.len() != self.pattern.dimension() {
            return vec![f64::NAN; n];
        }
        for (value, &scalar) in self.permuted.slice_mut().iter_mut().zip(&self.plan.scalars) {
            *value = rhs[scalar as usize];
        }
        self.sweep(Sweep::Up);
        let permuted = self.permuted.slice();
        permuted[permuted.len() - n..].to_vec()
    }

    /// The solution of which `border` is the border's part, for the right-hand side that was reduced
    /// last. NaN where nothing is factored or a length is wrong. To be called once after each
    /// [`Self::reduce`].
    pub fn expand(&mut self, border: &[f64], x: &mut [f64]) {
        let n = self.border_dimension;
        if !self.factored || border.len() != n || x.len() != self.pattern.dimension() {
            x.fill(f64::NAN);
            return;
        }
        let permuted = self.permuted.slice_mut();
        let first = permuted.len() - n;
        permuted[first..].copy_from_slice(border);
        self.sweep(Sweep::Down);
        for (value, &scalar) in self.permuted.slice().iter().zip(&self.plan.scalars) {
            x[scalar as usize] = *value;
        }
    }

    fn sweep(&mut self, sweep: Sweep) {
        let eliminated = self.border.map_or(self.plan.nodes.len(), |border| border as usize);
        self.class.run(Triangular {
            plan: &self.plan,
            nodes: &self.plan.nodes[..eliminated],
            sweep,
            factor: self.factor.slice(),
            x: self.permuted.slice_mut(),
            front: self.front.slice_mut(),
            interrupt: &Interrupt::NEVER,
        });
    }
}
