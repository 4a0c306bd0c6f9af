//! Linearized observations under a loss, after Triggs et al., "Bundle adjustment: a modern synthesis"
//! (2000), §4.3. Lanes are observations; this file does not know where they come from.
//!
//! With n = r/‖r‖ and d of [`LossValue::curvature_from`](crate::loss::LossValue::curvature_from), the
//! rows are √ρ' (I − (1 − √d) n nᵀ) J and the residual is √(ρ'/d) r. Their Jᵀr is the gradient ρ' Jᵀr
//! of ½ ρ(‖r‖²) and their JᵀJ is ρ' Jᵀ(I − (1 − d) n nᵀ)J: reweighted least squares where d is 1, the
//! curvature of the cost for a linear r where d is not bounded.

use super::observe::{Linearized, squared_norm};
use crate::lanes::models::PARAMETERS;
use crate::loss::{Loss, at_least};
use crate::simd::{Lanes, Row, WIDTH};

impl<L: Lanes, const R: usize> Linearized<L, R> {
    /// Puts the loss in, for so many columns a view.
    #[inline(always)]
    pub(super) fn weigh(&mut self, l: L, loss: &Loss, stiffness: f64, columns: usize) {
        let correction = Correction::new(l, &mut self.residual, loss, stiffness);
        for c in 0..6 {
            correction.apply(l, &mut self.pose, c);
        }
        for c in 0..3 {
            correction.apply(l, &mut self.landmark, c);
        }
        // Bounds that are known to the compiler keep the columns in registers.
        if columns > 6 {
            for c in 0..3 {
                correction.apply(l, &mut self.camera, c);
            }
        }
        if columns > 9 {
            for c in 3..PARAMETERS {
                correction.apply(l, &mut self.camera, c);
            }
        }
    }

    /// Puts the loss into the residuals and the columns of the landmarks; returns ½ ρ, infinite where
    /// there is no finite residual.
    #[inline(always)]
    pub(super) fn weigh_landmark(&mut self, l: L, loss: &Loss, stiffness: f64) -> L::V {
        let mut squares = [0.0; WIDTH];
        l.store(squared_norm(l, &self.residual), &mut squares);
        // A bounded loss must not hide that there is no residual.
        let cost = |s: f64| if s.is_finite() { 0.5 * loss.rho(s) } else { f64::INFINITY };
        let costs = squares.map(cost);
        let correction = Correction::new(l, &mut self.residual, loss, stiffness);
        for c in 0..3 {
            correction.apply(l, &mut self.landmark, c);
        }
        l.load(&costs)
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
}

impl<L: Lanes, const R: usize> Correction<L, R> {
    /// Corrects the residual, and says how to correct columns.
    #[inline(always)]
    fn new(l: L, residual: &mut [L::V; R], loss: &Loss, stiffness: f64) -> Self {
        let mut squares = [0.0; WIDTH];
        l.store(squared_norm(l, residual), &mut squares);
        let Scales { root, stretch, shrink } = Scales::under(loss, stiffness, &squares);
        let (stretch, shrink) = (l.load(&stretch), l.load(&shrink));
        let before = *residual;
        let mut shrunk = before;
        for r in 0..R {
            shrunk[r] = l.mul(before[r], shrink);
            residual[r] = l.mul(before[r], stretch);
        }
        Self { root: l.load(&root), residual: before, shrunk }
    }

    /// Corrects a column.
    #[inline(always)]
    fn apply<const C: usize>(&self, l: L, columns: &mut [[L::V; C]; R], c: usize) {
        let column = columns.map(|row| row[c]);
        let column = correct(l, column, self.root, &self.residual, &self.shrunk);
        (0..R).for_each(|r| columns[r][c] = column[r]);
    }
}

/// The factors of eight observations.
struct Scales {
    /// √ρ'.
    root: Row,
    /// √(ρ' / d).
    stretch: Row,
    /// (1 − √d) / s.
    shrink: Row,
}

impl Scales {
    /// Under any loss: by code for each of them, so that the lanes are computed together.
    #[inline(always)]
    fn under(loss: &Loss, stiffness: f64, squares: &Row) -> Self {
        match *loss {
            Loss::Trivial => Self::of(Loss::Trivial, stiffness, squares),
            Loss::Huber(width) => Self::of(Loss::Huber(width), stiffness, squares),
            Loss::Cauchy(width) => Self::of(Loss::Cauchy(width), stiffness, squares),
            Loss::Tukey(width) => Self::of(Loss::Tukey(width), stiffness, squares),
            Loss::GemanMcClure(width) => Self::of(Loss::GemanMcClure(width), stiffness, squares),
        }
    }

    #[inline(always)]
    fn of(loss: Loss, stiffness: f64, squares: &Row) -> Self {
        let mut scales = Self { root: [0.0; WIDTH], stretch: [0.0; WIDTH], shrink: [0.0; WIDTH] };
        for lane in 0..WIDTH {
            let s = squares[lane];
            let (weight, curvature) = loss.derivatives(s);
            let along = at_least(curvature, stiffness).sqrt();
            scales.root[lane] = weight.sqrt();
            scales.stretch[lane] = scales.root[lane] / along;
            scales.shrink[lane] = if along < 1.0 { (1.0 - along) / s } else { 0.0 };
        }
        scales
    }
}

/// root · (column − shrunk · (residualᵀ column)).
#[inline(always)]
fn correct<L: Lanes, const R: usize>(
    l: L,
    mut column: [L::V; R],
    root: L::V,
    residual: &[L::V; R],
    shrunk: &[L::V; R],
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
        lin.weigh(Scalar, loss, stiffness, 6);
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
