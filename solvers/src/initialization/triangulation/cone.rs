//! The second-order cone program of one step of `worst_error`, solved by Clarabel.
//!
//! Minimize s over v ∈ R⁴ and s, subject to t ≥ 0, to Σ hᵢ·v = count and for each ratio i to
//! ‖a Nᵢ v‖ ≤ b hᵢ·v + s wᵢ. Some s is always large enough, and the sum keeps it from falling without
//! end. Nothing else in the crate knows Clarabel. No clock and no other thread has a say in the result.

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{NonnegativeConeT, SecondOrderConeT, ZeroConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver};
use nalgebra::{RowVector4, Vector4};

use super::ratios::Ratio;

/// Unknowns: v, then s.
const COLUMNS: usize = 5;

/// Residuals and duality gap to which a program is solved, relative to its own numbers.
const TOLERANCE: f64 = 1e-10;

/// Dual residual up to which the dual objective counts as a bound.
const BOUND_TOLERANCE: f64 = 1e-9;

/// Interior-point steps; 6 to 15 are usual.
const MOST_STEPS: u32 = 60;

/// The program.
pub(super) struct Program<'a> {
    /// N and h.
    pub(super) ratios: &'a [Ratio],
    /// a.
    pub(super) numerator: f64,
    /// b.
    pub(super) denominator: f64,
    /// w, positive, one for each ratio.
    pub(super) weights: &'a [f64],
}

/// Where the interior-point method ended.
pub(super) struct Solution {
    /// v. It need not fulfill the constraints.
    pub(super) v: Vector4<f64>,
    /// No s is below this one: the dual objective, or −∞ where the dual point is not good enough.
    pub(super) slack_bound: f64,
}

impl Program<'_> {
    /// `None` where the method comes to no finite point.
    pub(super) fn solve(&self) -> Option<Solution> {
        // Rows of A (v, s) + slack = b. Each cone is divided by its weight.
        let mut rows = Rows::default();
        rows.push(&self.ratios.iter().map(|ratio| ratio.denominator).sum(), 0.0);
        rows.push(&RowVector4::new(0.0, 0.0, 0.0, -1.0), 0.0);
        let mut cones = vec![ZeroConeT(1), NonnegativeConeT(1)];
        for (ratio, weight) in self.ratios.iter().zip(self.weights) {
            rows.push(&(ratio.denominator * (-self.denominator / weight)), -1.0);
            for row in ratio.numerator.row_iter() {
                rows.push(&(row * (-self.numerator / weight)), 0.0);
            }
            cones.push(SecondOrderConeT(3));
        }
        let matrix = rows.matrix()?;
        let mut right = vec![0.0; matrix.m];
        right[0] = self.ratios.len() as f64;
        let quadratic = CscMatrix::zeros((COLUMNS, COLUMNS));
        let linear = [0.0, 0.0, 0.0, 0.0, 1.0];
        let mut solver =
            DefaultSolver::new(&quadratic, &linear, &matrix, &right, &cones, settings()).ok()?;
        solver.solve();
        let found = &solver.solution;
        let v = Vector4::from_iterator(found.x.iter().copied().take(4));
        let dual = found.r_dual <= BOUND_TOLERANCE && found.obj_val_dual.is_finite();
        let slack_bound = if dual { found.obj_val_dual } else { f64::NEG_INFINITY };
        v.iter().all(|v| v.is_finite()).then_some(Solution { v, slack_bound })
    }
}

fn settings() -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_iter: MOST_STEPS,
        tol_gap_abs: TOLERANCE,
        tol_gap_rel: TOLERANCE,
        tol_feas: TOLERANCE,
        max_threads: 1,
        direct_solve_method: "qdldl".to_owned(),
        // It would only look for infinite bounds, and there are none.
        presolve_enable: false,
        ..DefaultSettings::default()
    }
}

/// The matrix A, column by column.
#[derive(Default)]
struct Rows([Vec<f64>; COLUMNS]);

impl Rows {
    fn push(&mut self, v: &RowVector4<f64>, s: f64) {
        for (column, value) in self.0.iter_mut().zip(v.iter().copied().chain([s])) {
            column.push(value);
        }
    }

    /// The matrix with every entry stored; `None` where one is not finite.
    fn matrix(self) -> Option<CscMatrix<f64>> {
        let rows = self.0[0].len();
        let starts = (0..=COLUMNS).map(|column| column * rows).collect();
        let indices = (0..COLUMNS).flat_map(|_| 0..rows).collect();
        let values: Vec<f64> = self.0.into_iter().flatten().collect();
        let finite = values.iter().all(|value| value.is_finite());
        finite.then(|| CscMatrix::new(rows, COLUMNS, starts, indices, values))
    }
}
