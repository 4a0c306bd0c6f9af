//! Relative-pose factor in any group: r = Log(Z⁻¹ · X_i⁻¹ · X_j), Z = `i_from_j` measured.
//!
//! With E = Z⁻¹ X_i⁻¹ X_j and right updates, ∂r/∂δ_j = J_r⁻¹(r) and
//! ∂r/∂δ_i = −J_r⁻¹(r) · Ad(X_j⁻¹ X_i), exact for residuals of any size. Residual and Jacobians are not
//! whitened here.

use nalgebra::{SMatrix, SVector};

use crate::geometry::LieGroup;
use crate::information::Information;
use crate::interrupt::Interrupt;
use crate::loss::Loss;
use crate::parallel;

/// A measured relative pose between poses `i` and `j` of group `G` with `N` tangent dimensions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativePose<G, const N: usize> {
    /// Index of pose i.
    pub i: usize,
    /// Index of pose j.
    pub j: usize,
    /// The measurement Z.
    pub i_from_j: G,
    /// Ω over the tangent, translation first.
    pub information: Information<N>,
    /// ρ of this factor alone; `None` takes the loss of its batch.
    pub loss: Option<Loss>,
}

/// A residual between two poses with its Jacobians, not yet whitened.
#[derive(Clone, Copy, Debug)]
pub struct PairLinearization<const N: usize> {
    /// The residual in the tangent, translation first.
    pub residual: SVector<f64, N>,
    /// ∂r/∂δ_i.
    pub d_i: SMatrix<f64, N, N>,
    /// ∂r/∂δ_j.
    pub d_j: SMatrix<f64, N, N>,
}

// Costs of large graphs are sums over these: as calls that are not inlined they take twice as long.
impl<G: LieGroup<N>, const N: usize> RelativePose<G, N> {
    /// The residual, not whitened.
    #[must_use]
    #[inline(always)]
    pub fn residual(&self, world_from_i: &G, world_from_j: &G) -> SVector<f64, N> {
        let i_from_j = world_from_i.inverse().compose(world_from_j);
        self.i_from_j.inverse().compose(&i_from_j).log()
    }

    /// χ² = rᵀΩr.
    #[must_use]
    #[inline(always)]
    pub fn chi2(&self, world_from_i: &G, world_from_j: &G) -> f64 {
        self.information.squared_norm(&self.residual(world_from_i, world_from_j))
    }

    /// ρ(rᵀΩr) at the poses that its indices name; `loss` is the batch's.
    #[inline(always)]
    pub(crate) fn rho(&self, poses: &[G], loss: Loss) -> f64 {
        self.loss.unwrap_or(loss).evaluate(self.chi2(&poses[self.i], &poses[self.j])).rho
    }

    /// The residual with its Jacobians, not whitened.
    #[must_use]
    pub fn linearize(&self, world_from_i: &G, world_from_j: &G) -> PairLinearization<N> {
        let i_from_j = world_from_i.inverse().compose(world_from_j);
        let residual = self.i_from_j.inverse().compose(&i_from_j).log();
        let d_j = G::right_jacobian_inverse(&residual);
        let d_i = -d_j * i_from_j.inverse().adjoint();
        PairLinearization { residual, d_i, d_j }
    }
}

/// Factors that a task handles at a time; part of the definition of every sum over them.
pub(crate) const FACTORS_PER_CHUNK: usize = 128;

/// Factors that a loop handles between two questions to an interrupt: less than a millisecond.
pub(crate) const FACTORS_PER_QUESTION: u32 = 512;

/// ½ Σ ρ(rᵀΩr), `loss` that of factors without their own, summed within chunks in parallel, then over
/// chunks in order. Once `interrupt` is due the rest count nothing.
pub(crate) fn cost<G: LieGroup<N>, const N: usize>(
    factors: &[RelativePose<G, N>],
    poses: &[G],
    loss: Loss,
    interrupt: &Interrupt,
) -> f64 {
    let half = |factor: &RelativePose<G, N>| 0.5 * factor.rho(poses, loss);
    let sum = |chunk: &[RelativePose<G, N>]| match interrupt.is_due() {
        true => 0.0,
        false => chunk.iter().map(half).sum(),
    };
    parallel::map(factors.chunks(FACTORS_PER_CHUNK), sum).iter().sum()
}
