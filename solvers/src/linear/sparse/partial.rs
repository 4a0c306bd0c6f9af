//! Elimination of all blocks but some: what those leave of the system on the others.
//!
//! With I the blocks that are eliminated and B the border, which all its blocks are tied in, the front
//! of the border holds S = H_BB − H_BI (H_II + D)⁻¹ H_IB once everything else is eliminated. It is left
//! there; the right-hand side goes up the same way, and the solution on the border comes down again. It
//! decides nothing about the border's own system.

use std::sync::Arc;

use super::plan::{Plan, bytes};
use super::triangular::Sweep;
use super::workspace::Workspace;
use crate::interrupt::Interrupt;
use crate::linear::error::LinearError;
use crate::linear::matrix::BlockMatrix;
use crate::linear::ordering::cheapest_with_last;
use crate::linear::pattern::BlockPattern;
use crate::price::Price;
use crate::simd::Class;

/// A factorization of all blocks of a matrix but those of a border.
#[derive(Debug)]
pub struct PartialCholesky {
    /// Without a border where that is empty.
    workspace: Workspace,
    /// Rows of the border.
    border_dimension: usize,
    price: Price,
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
        let border_dimension = border.iter().map(|&b| pattern.sizes()[b]).sum();
        let border = (!border.is_empty()).then(|| plan.nodes.len().saturating_sub(1) as u32);
        Ok(Self { workspace: Workspace::new(pattern, plan, border)?, border_dimension, price })
    }

    /// Uses the kernels of another instruction set, or the scalar ones where the processor lacks it.
    pub fn set_class(&mut self, class: Class) {
        self.workspace.set_class(class);
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
        self.workspace.factor_until(matrix, added_diagonal, interrupt)
    }

    /// S of the last factorization: its lower triangle, column after column, rows and columns in the
    /// order of the border's blocks. Empty where nothing is factored.
    pub fn border_matrix(&self) -> Vec<f64> {
        let n = self.border_dimension;
        let Workspace { plan, border, factor, factored, .. } = &self.workspace;
        let Some(node) = border.filter(|_| *factored) else { return Vec::new() };
        let node = &plan.nodes[node as usize];
        let panel = &factor.slice()[node.panel..][..node.shape.panel_size()];
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
        let workspace = &mut self.workspace;
        if !workspace.factored || rhs.len() != workspace.pattern.dimension() {
            return vec![f64::NAN; n];
        }
        workspace.permute(rhs);
        workspace.sweep(Sweep::Up, &Interrupt::NEVER);
        let permuted = workspace.permuted.slice();
        permuted[permuted.len() - n..].to_vec()
    }

    /// The solution of which `border` is the border's part, for the right-hand side that was reduced
    /// last. NaN where nothing is factored or a length is wrong. To be called once after each
    /// [`Self::reduce`].
    pub fn expand(&mut self, border: &[f64], x: &mut [f64]) {
        let n = self.border_dimension;
        let workspace = &mut self.workspace;
        if !workspace.factored || border.len() != n || x.len() != workspace.pattern.dimension() {
            x.fill(f64::NAN);
            return;
        }
        let permuted = workspace.permuted.slice_mut();
        let first = permuted.len() - n;
        permuted[first..].copy_from_slice(border);
        workspace.sweep(Sweep::Down, &Interrupt::NEVER);
        workspace.permute_back(x);
    }
}
