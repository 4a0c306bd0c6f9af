//! Sparse supernodal Cholesky of a block matrix in a fill-reducing order.
//!
//! P (H + D) Pᵀ = L Lᵀ, with P from the block graph ([`super::ordering`]). Planning joins columns to
//! supernodes, lays out the factor and takes all memory; factoring (multifrontal, in parallel over
//! the elimination tree on the rayon pool of the caller) and solving take none. Kernels are compiled
//! for each instruction set; the classes with fused multiply-add give the same bits, and so does any
//! number of threads. The pattern never changes after planning: `growing` is for systems that grow.

use std::sync::Arc;

use super::error::LinearError;
use super::matrix::BlockMatrix;
use super::ordering::Elimination;
use super::pattern::BlockPattern;
use crate::interrupt::Interrupt;
use crate::simd::Class;

mod columns;
mod front;
mod growing;
mod kernels;
mod numeric;
mod plan;
mod shape;
mod supernodes;
mod triangular;
mod workspace;

pub use growing::{GrowingCholesky, PairTerm, Updated};
use plan::Plan;
pub(super) use plan::bytes;
use triangular::Sweep;
use workspace::Workspace;

/// A sparse factorization, planned once and renewed for each set of values.
#[derive(Debug)]
pub struct SparseCholesky {
    workspace: Workspace,
    /// Of the last factorization.
    interrupt: Interrupt,
}

impl SparseCholesky {
    /// Plans for a postordered order with its elimination.
    ///
    /// # Errors
    /// Too large to index, or no memory.
    pub(super) fn planned(
        pattern: Arc<BlockPattern>,
        order: &[u32],
        elimination: &Elimination,
    ) -> Result<Self, LinearError> {
        let plan = Plan::new(&pattern, order, elimination)?;
        let workspace = Workspace::new(pattern, plan)?;
        Ok(Self { workspace, interrupt: Interrupt::NEVER })
    }

    /// Uses the kernels of another instruction set, or the scalar ones where the processor lacks it.
    pub fn set_class(&mut self, class: Class) {
        self.workspace.set_class(class);
    }

    /// Factors H + D until `interrupt` is due, as do the solves with this factor; `added_diagonal` is D,
    /// or empty for zero.
    ///
    /// # Errors
    /// Not positive definite, not finite, a matrix or diagonal of another shape, or
    /// [`LinearError::Interrupted`].
    pub fn factor_until(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
        interrupt: &Interrupt,
    ) -> Result<(), LinearError> {
        self.workspace.factor_until(matrix, added_diagonal, interrupt)?;
        self.interrupt = interrupt.clone();
        Ok(())
    }

    /// Solves in place with the last factor; without one, or with a vector of another length,
    /// the result is NaN. So it may be once the interrupt of the factorization is due.
    pub fn solve(&mut self, rhs: &mut [f64]) {
        let dimension = self.workspace.pattern.dimension();
        if !self.workspace.factored || rhs.len() != dimension {
            debug_assert_eq!(rhs.len(), dimension, "right-hand side of another length");
            rhs.fill(f64::NAN);
            return;
        }
        self.workspace.permute(rhs);
        self.workspace.sweep(Sweep::Both, &self.interrupt);
        if self.interrupt.is_due() {
            rhs.fill(f64::NAN);
            return;
        }
        self.workspace.permute_back(rhs);
    }
}
