//! Supernodal Cholesky of a block matrix: sparse in a fill-reducing order, or dense as one supernode.
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
mod span;
mod supernodes;
mod triangular;
mod workspace;

pub use growing::{GrowingCholesky, PairTerm, Updated};
use plan::Plan;
pub(super) use plan::{bytes, dense_bytes};
use triangular::Sweep;
use workspace::Workspace;

/// A factorization, planned once and renewed for each set of values.
#[derive(Debug)]
pub(super) struct Multifrontal {
    workspace: Workspace,
    /// Of the last factorization.
    interrupt: Interrupt,
}

impl Multifrontal {
    /// Plans for a postordered order with its elimination.
    pub(super) fn sparse(
        pattern: Arc<BlockPattern>,
        order: &[u32],
        elimination: &Elimination,
    ) -> Result<Self, LinearError> {
        Self::planned(Plan::new(&pattern, order, elimination)?, pattern)
    }

    /// Plans one front in the caller's order.
    pub(super) fn dense(pattern: Arc<BlockPattern>) -> Result<Self, LinearError> {
        Self::planned(Plan::dense(&pattern)?, pattern)
    }

    fn planned(plan: Plan, pattern: Arc<BlockPattern>) -> Result<Self, LinearError> {
        let workspace = Workspace::new(pattern, plan)?;
        Ok(Self { workspace, interrupt: Interrupt::NEVER })
    }

    pub(super) fn front_count(&self) -> usize {
        self.workspace.plan.nodes.len()
    }

    /// Flops of a factorization, and of its longest chain of steps.
    pub(super) fn work_and_span(&self) -> (f64, f64) {
        let plan = &self.workspace.plan;
        let work = plan.roots.iter().map(|&root| plan.nodes[root as usize].flops).sum();
        (work, span::span(plan))
    }

    pub(super) fn set_class(&mut self, class: Class) {
        self.workspace.set_class(class);
    }

    /// Factors H + D until `interrupt` is due, as do the solves with this factor.
    pub(super) fn factor_until(
        &mut self,
        matrix: &BlockMatrix,
        added_diagonal: &[f64],
        interrupt: &Interrupt,
    ) -> Result<(), LinearError> {
        self.workspace.factor_until(matrix, added_diagonal, interrupt)?;
        self.interrupt = interrupt.clone();
        Ok(())
    }

    /// Solves in place with the last factor, or gives NaN.
    pub(super) fn solve(&mut self, rhs: &mut [f64]) {
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
