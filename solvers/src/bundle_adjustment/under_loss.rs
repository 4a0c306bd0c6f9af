//! Linearized observations under a loss, after Triggs et al., "Bundle adjustment: a modern synthesis"
//! (2000), §4.3. Lanes are observations; this file does not know where they come from.
//!
//! With n = r/‖r‖ and d of [`LossValue::curvature_from`](crate::loss::LossValue::curvature_from), the
//! rows are √ρ' (I − (1 − √d) n nᵀ) J and the residual is √(ρ'/d) r. Their Jᵀr is the gradient ρ' Jᵀr
//! of ½ ρ(‖r‖²) and their JᵀJ is ρ' Jᵀ(I − (1 − d) n nᵀ)J: reweighted least squares where d is 1, the
//! curvature of the cost for a linear r where d is not bounded.

use super::observe::{Linearized, squared_norm};
use crate::lanes::models::PARAMETERS;
use crate::loss::Loss;
use crate::simd::{Lanes, WIDTH};

impl<L: Lanes, const R: usize> Linearized<L, R> {
    /// Puts the loss in, for D columns a view.
    #[inline(always)]
    pub(super) fn weigh<const D: usize>(&mut self, l: L, loss: &Loss, stiffness: f64) {
        let correction = Correction::new(l, &mut self.residual, loss, stiffness);
        for c in 0..6 {
            correction.apply(l, &mut self.pose, c);
        }
        for c in 0..3 {
            correction.apply(l, &mut self.landmark, c);
        }
        for c in 0..(D - 6).min(PARAMETERS) {
            correction.apply(l, &mut self.camera, c);
        }
    }

    /// Puts the loss into the residuals and the columns of the landmarks; returns ½ ρ, infinite where
    /// there is no finite residual.
    #[inline(always)]
    pub(super) fn weigh_landmark(&mut self, l: L, loss: &Loss, stiffness: f64) -> L::V {
        let correction = Correction::new(l, &mut self.residual, loss, stiffness);
        for c in 0..3 {
            correction.apply(l, &mut self.landmark, c);
        }
        l.load(&correction.costs)
    }
}

/// What makes the rows of eight observations those under a loss.
struct Correction<L: Lanes, const R: usize> {
    /// √ρ'.
    root: L::V,
    /// r before.
    residual: [L::V; R],
    /// (1 − √d) / s · r.
    shrunk: [L::V; R],
    /// ½ ρ.
    costs: [f64; WIDTH],
}

impl<L: Lanes, const R: usize> Correction<L, R> {
    /// Corrects the residual, and says how to correct columns.
    #[inline(always)]
    fn new(l: L, residual: &mut [L::V; R], loss: &Loss, stiffness: f64) -> Self {
        let (mut roots, mut stretches, mut shrinks) = ([0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH]);
        let mut costs = [0.0; WIDTH];
        l.store(squared_norm(l, residual), &mut roots);
        for lane in 0..WIDTH {
            let s = roots[lane];
            let value = loss.evaluate(s);
            let along = value.curvature_from(stiffness).sqrt();
            roots[lane] = value.weight.sqrt();
            stretches[lane] = roots[lane] / along;
            shrinks[lane] = if along < 1.0 { (1.0 - along) / s } else { 0.0 };
            // A bounded loss must not hide that there is no residual.
            costs[lane] = if s.is_finite() { 0.5 * value.rho } else { f64::INFINITY };
        }
        let (stretch, shrink) = (l.load(&stretches), l.load(&shrinks));
        let before = *residual;
        let mut shrunk = before;
        for r in 0..R {
            shrunk[r] = l.mul(before[r], shrink);
            residual[r] = l.mul(before[r], stretch);
        }
        Self { root: l.load(&roots), residual: before, shrunk, costs }
    }

    /// Corrects a column.
    #[inline(always)]
    fn apply<const C: usize>(&self, l: L, columns: &mut [[L::V; C]; R], c: usize) {
        let factors = (self.root, &self.residual, &self.shrunk);
        let column = correct(l, columns.map(|row| row[c]), factors);
        (0..R).for_each(|r| columns[r][c] = column[r]);
    }
}

/// root · (column − shrunk · (residualᵀ column)).
#[inline(always)]
fn correct<L: Lanes, const R: usize>(
    l: L,
    mut column: [L::V; R],
    (root, residual, shrunk): (L::V, &[L::V; R], &[L::V; R]),
) -> [L::V; R] {
    let mut along = l.mul(residual[0], column[0]);
    for r in 1..R {
        along = l.fma(residual[r], column[r], along);
    }
    for r in 0..R {
        column[r] = l.mul(l.fnma(shrunk[r], along, column[r]), root);
    }
    column
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Scalar;
    use crate::testing::random::{seeded, uniform_vector};
    use nalgebra::{SMatrix, SVector};

    /// ½ ρ(‖r + J δ‖²) around δ = 0, as a linearization with `stiffness` says.
    fn model(
        loss: &Loss,
        stiffness: f64,
        residual: &SVector<f64, 3>,
        jacobian: &SMatrix<f64, 3, 3>,
    ) -> (SVector<f64, 3>, SMatrix<f64, 3, 3>) {
        let lanes = |x: f64| Scalar.splat(x);
        let mut lin = Linearized::<Scalar, 3> {
            residual: std::array::from_fn(|r| lanes(residual[r])),
            pose: [[lanes(0.0); 6]; 3],
            camera: [[lanes(0.0); PARAMETERS]; 3],
            landmark: std::array::from_fn(|r| std::array::from_fn(|c| lanes(jacobian[(r, c)]))),
        };
        lin.weigh::<6>(Scalar, loss, stiffness);
        let first = |v| {
            let mut row = [0.0; WIDTH];
            Scalar.store(v, &mut row);
            row[3]
        };
        let residual: SVector<f64, 3> = SVector::from(lin.residual.map(first));
        let jacobian = SMatrix::<f64, 3, 3>::from_fn(|r, c| first(lin.landmark[r][c]));
        (jacobian.tr_mul(&residual), jacobian.tr_mul(&jacobian))
    }

    #[test]
    fn the_model_of_a_loss_is_its_second_order_expansion() {
        let mut rng = seeded(4);
        let losses =
            [Loss::Huber(1.0), Loss::Cauchy(2.0), Loss::Tukey(4.0), Loss::GemanMcClure(3.0)];
        for loss in losses {
            for scale in [0.2, 0.7, 1.4, 2.5] {
                let residual: SVector<f64, 3> = uniform_vector(&mut rng, scale);
                let columns: SVector<f64, 9> = uniform_vector(&mut rng, 1.0);
                let jacobian = SMatrix::<f64, 3, 3>::from_column_slice(columns.as_slice());
                let cost = |delta: &SVector<f64, 3>| {
                    0.5 * loss.evaluate((residual + jacobian * delta).norm_squared()).rho
                };
                let delta: SVector<f64, 3> = uniform_vector(&mut rng, 1.0);
                let h = 1e-3;
                let (up, down) = (cost(&(delta * h)), cost(&(delta * -h)));
                let middle = cost(&SVector::zeros());
                let slope = (up - down) / (2.0 * h);
                let curvature = (up + down - 2.0 * middle) / (h * h);
                let (gradient, hessian) = model(&loss, 1e-9, &residual, &jacobian);
                let what = format!("{loss:?}, {}", residual.norm());
                assert!((gradient.dot(&delta) - slope).abs() < 1e-5, "{what}");
                let value = loss.evaluate(residual.norm_squared());
                if value.curvature > 0.0 || matches!(loss, Loss::Huber(_)) {
                    let found = delta.dot(&(hessian * delta));
                    assert!((found - curvature).abs() < 1e-4, "{what}: {found} {curvature}");
                }
                let (same, stiff) = model(&loss, 1.0, &residual, &jacobian);
                assert!((same - gradient).amax() < 1e-7, "{what}");
                let reweighted = jacobian.tr_mul(&jacobian) * value.weight;
                assert!((stiff - reweighted).amax() < 1e-12, "{what}");
            }
        }
    }
}
