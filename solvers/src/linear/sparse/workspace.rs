//! A plan with the memory that its factorizations and solves take, and the steps of both. The values of the
//! matrix are the caller's.

use std::sync::Arc;

use super::numeric::Numeric;
use super::plan::Plan;
use super::shape::Aligned;
use super::triangular::{Sweep, Triangular};
use crate::interrupt::Interrupt;
use crate::linear::checked::check_system;
use crate::linear::error::LinearError;
use crate::linear::matrix::BlockMatrix;
use crate::linear::pattern::BlockPattern;
use crate::simd::Class;

#[derive(Debug)]
pub(super) struct Workspace {
    pub(super) pattern: Arc<BlockPattern>,
    pub(super) plan: Plan,
    pub(super) factor: Aligned,
    /// Update matrices.
    space: Aligned,
    /// A permuted right-hand side.
    pub(super) permuted: Aligned,
    /// One column of a front.
    front: Aligned,
    class: Class,
    /// Whether there is a factor.
    pub(super) factored: bool,
}

impl Workspace {
    pub(super) fn new(pattern: Arc<BlockPattern>, plan: Plan) -> Result<Self, LinearError> {
        let dimension = pattern.dimension();
        let memory = |length| Aligned::new(length).ok_or(LinearError::OutOfMemory { dimension });
        Ok(Self {
            factor: memory(plan.factor_size)?,
            space: memory(plan.space)?,
            permuted: memory(dimension)?,
            front: memory(plan.longest)?,
            class: Class::detect(),
            factored: false,
            pattern,
            plan,
        })
    }

    pub(super) fn set_class(&mut self, class: Class) {
        self.class = class;
        self.factored = false;
    }

    /// Factors H + D; `added_diagonal` is D, or empty for zero.
    pub(super) fn factor_until(
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

    /// Takes a right-hand side into the order of the factor.
    pub(super) fn permute(&mut self, rhs: &[f64]) {
        for (value, &scalar) in self.permuted.slice_mut().iter_mut().zip(&self.plan.scalars) {
            *value = rhs[scalar as usize];
        }
    }

    /// Gives the permuted vector back in the order of the matrix.
    pub(super) fn permute_back(&self, x: &mut [f64]) {
        for (value, &scalar) in self.permuted.slice().iter().zip(&self.plan.scalars) {
            x[scalar as usize] = *value;
        }
    }

    /// Sweeps the permuted vector through the factor.
    pub(super) fn sweep(&mut self, sweep: Sweep, interrupt: &Interrupt) {
        self.class.run(Triangular {
            plan: &self.plan,
            nodes: &self.plan.nodes,
            sweep,
            factor: self.factor.slice(),
            x: self.permuted.slice_mut(),
            front: self.front.slice_mut(),
            interrupt,
        });
    }
}
