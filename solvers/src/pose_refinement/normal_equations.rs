//! Cost, H and g of a view in one pass.
//!
//! With A = ∂(u, v, z)/∂p whitened, an observation's Jacobian is A [−I | p^]. So with S = Aᵀ ρ' A and
//! b = Aᵀ ρ' r it adds
//!
//! H = [S, −S p^; ·, −p^ S p^],   g = (−b, b × p),
//!
//! and a measured depth only adds to S_zz and b_z. Two loops over a tile: the first projects and
//! leaves p, b and S, the second has the sums in registers; one loop for both would wait for its own
//! divisions and spill. Sums stay in lanes and are folded once, in a fixed order. Nothing here judges
//! whether they are finite.

use nalgebra::{SMatrix, SVector};

use super::observations::{Eight, EightResiduals, Observations, PoseObservations, ViewWork};
use crate::geometry::Se3;
use crate::lanes::loss::evaluate;
use crate::lanes::models::LaneModel;
use crate::loss::Loss;
use crate::simd::{Lanes, Row, WIDTH};

/// Blocks of a tile: enough to keep the processor busy, few enough for the first-level cache.
const TILE: usize = 8;

/// The upper triangle of a symmetric 3 × 3 matrix.
const UPPER: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Cost and normal equations at a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Evaluation {
    /// ½ Σ ρ.
    pub(super) cost: f64,
    /// H, translation first.
    pub(super) hessian: SMatrix<f64, 6, 6>,
    /// g.
    pub(super) gradient: SVector<f64, 6>,
}

impl Evaluation {
    pub(super) fn zero() -> Self {
        Self { cost: 0.0, hessian: SMatrix::zeros(), gradient: SVector::zeros() }
    }

    /// Whether every number is finite; a sum that overflows counts as not.
    pub(super) fn is_finite(&self) -> bool {
        (self.cost + self.gradient.sum() + self.hessian.sum()).is_finite()
    }
}

/// p, b and S of eight observations; S as its [`UPPER`] triangle.
#[derive(Clone, Copy, Default)]
#[repr(align(64))]
struct Terms {
    point: [Row; 3],
    pull: [Row; 3],
    square: [Row; 6],
}

/// Fills `terms` and returns ρ.
#[inline(always)]
fn weigh<L: Lanes>(
    l: L,
    loss: &Loss,
    block: &Eight,
    seen: &EightResiduals<L>,
    terms: &mut Terms,
) -> L::V {
    let value = evaluate(l, loss, seen.squared);
    // Residuals are whitened, the projection's Jacobian is not.
    let weight = l.load(&block.weight);
    let depth_weight = l.load(&block.depth_weight);
    let once = l.mul(value.weight, weight);
    let twice = l.mul(once, weight);
    let depth_once = l.mul(value.weight, depth_weight);
    let [du, dv] = seen.projection.d_point;
    let [ru, rv, rd] = seen.residual;
    let (ru, rv) = (l.mul(ru, once), l.mul(rv, once));
    let mut pull = [l.splat(0.0); 3];
    let (mut left_u, mut left_v) = (pull, pull);
    for i in 0..3 {
        pull[i] = l.fma(dv[i], rv, l.mul(du[i], ru));
        left_u[i] = l.mul(du[i], twice);
        left_v[i] = l.mul(dv[i], twice);
    }
    pull[2] = l.fma(depth_once, rd, pull[2]);
    let mut square = [l.splat(0.0); 6];
    for (entry, (i, j)) in square.iter_mut().zip(UPPER) {
        *entry = l.fma(left_v[i], dv[j], l.mul(left_u[i], du[j]));
    }
    square[5] = l.fma(depth_once, depth_weight, square[5]);
    for i in 0..3 {
        l.store(seen.point[i], &mut terms.point[i]);
        l.store(pull[i], &mut terms.pull[i]);
    }
    for (row, entry) in terms.square.iter_mut().zip(square) {
        l.store(entry, row);
    }
    value.rho
}

/// Rows of memory in registers.
#[inline(always)]
fn load_all<L: Lanes, const N: usize>(l: L, rows: &[Row; N]) -> [L::V; N] {
    let mut out = [l.splat(0.0); N];
    for (v, row) in out.iter_mut().zip(rows) {
        *v = l.load(row);
    }
    out
}

/// The row (a, b, c) times p^.
#[inline(always)]
fn times_hat<L: Lanes>(l: L, [a, b, c]: [L::V; 3], [x, y, z]: [L::V; 3]) -> [L::V; 3] {
    [l.fnma(c, y, l.mul(b, z)), l.fnma(a, z, l.mul(c, x)), l.fnma(b, x, l.mul(a, y))]
}

/// Sums over observations, one a lane.
struct Sums<L: Lanes> {
    rho: L::V,
    /// b.
    pull: [L::V; 3],
    /// b × p.
    turn: [L::V; 3],
    /// S.
    square: [L::V; 6],
    /// S p^ by rows.
    mixed: [[L::V; 3]; 3],
    /// −p^ S p^.
    turned: [L::V; 6],
}

impl<L: Lanes> Sums<L> {
    #[inline(always)]
    fn new(l: L) -> Self {
        let zero = l.splat(0.0);
        Self {
            rho: zero,
            pull: [zero; 3],
            turn: [zero; 3],
            square: [zero; 6],
            mixed: [[zero; 3]; 3],
            turned: [zero; 6],
        }
    }

    /// Adds what [`weigh`] left.
    #[inline(always)]
    fn add(&mut self, l: L, terms: &Terms) {
        let point = load_all(l, &terms.point);
        let [x, y, z] = point;
        let b = load_all(l, &terms.pull);
        let s = load_all(l, &terms.square);
        for i in 0..3 {
            self.pull[i] = l.add(self.pull[i], b[i]);
        }
        for i in 0..6 {
            self.square[i] = l.add(self.square[i], s[i]);
        }
        self.turn[0] = l.fnma(b[2], y, l.fma(b[1], z, self.turn[0]));
        self.turn[1] = l.fnma(b[0], z, l.fma(b[2], x, self.turn[1]));
        self.turn[2] = l.fnma(b[1], x, l.fma(b[0], y, self.turn[2]));
        let t = [
            times_hat(l, [s[0], s[1], s[2]], point),
            times_hat(l, [s[1], s[3], s[4]], point),
            times_hat(l, [s[2], s[4], s[5]], point),
        ];
        for i in 0..3 {
            for j in 0..3 {
                self.mixed[i][j] = l.add(self.mixed[i][j], t[i][j]);
            }
        }
        for (sum, (i, j)) in self.turned.iter_mut().zip(UPPER) {
            // Row i of −p^ times column j of S p^.
            let (a, plus, b, minus) = match i {
                0 => (t[1][j], z, t[2][j], y),
                1 => (t[2][j], x, t[0][j], z),
                _ => (t[0][j], y, t[1][j], x),
            };
            *sum = l.fnma(b, minus, l.fma(a, plus, *sum));
        }
    }

    /// Sums over the lanes.
    #[inline(always)]
    fn fold(&self, l: L) -> Evaluation {
        let mut fields = [l.splat(0.0); 4 * WIDTH];
        fields[0] = self.rho;
        fields[1..4].copy_from_slice(&self.pull);
        fields[4..7].copy_from_slice(&self.turn);
        fields[7..13].copy_from_slice(&self.square);
        fields[13..22].copy_from_slice(self.mixed.as_flattened());
        fields[22..28].copy_from_slice(&self.turned);
        let mut sums = [0.0; 4 * WIDTH];
        for (fields, sums) in fields.as_chunks().0.iter().zip(sums.as_chunks_mut().0) {
            let [a, b, c, d, e, f, g, h] = l.transpose(*fields);
            let (low, high) = (l.add(l.add(a, b), l.add(c, d)), l.add(l.add(e, f), l.add(g, h)));
            l.store(l.add(low, high), sums);
        }
        folded(&sums)
    }
}

/// From the sums of the fields, in their order.
fn folded(sums: &[f64; 4 * WIDTH]) -> Evaluation {
    let mut value = Evaluation { cost: 0.5 * sums[0], ..Evaluation::zero() };
    for i in 0..3 {
        value.gradient[i] = -sums[1 + i];
        value.gradient[3 + i] = sums[4 + i];
        for j in 0..3 {
            let mixed = -sums[13 + 3 * i + j];
            value.hessian[(i, 3 + j)] = mixed;
            value.hessian[(3 + j, i)] = mixed;
        }
    }
    for (k, (i, j)) in UPPER.into_iter().enumerate() {
        for (row, column) in [(i, j), (j, i)] {
            value.hessian[(row, column)] = sums[7 + k];
            value.hessian[(3 + row, 3 + column)] = sums[22 + k];
        }
    }
    value
}

impl Observations<'_> {
    /// Cost, H and g at `pose`; not finite where one of the observations is not.
    pub(super) fn evaluate(&self, pose: &Se3, loss: Loss) -> Evaluation {
        self.run(pose, Evaluate { loss })
    }
}

/// Sums a view under a loss.
struct Evaluate {
    loss: Loss,
}

impl ViewWork for Evaluate {
    type Output = Evaluation;

    #[inline(always)]
    fn run<L: Lanes, M: LaneModel>(
        self,
        l: L,
        view: &PoseObservations<'_>,
        model: M,
    ) -> Evaluation {
        let at = view.splat(l);
        let mut sums = Sums::new(l);
        let mut tile = [Terms::default(); TILE];
        for blocks in view.blocks.chunks(TILE) {
            for (block, terms) in blocks.iter().zip(&mut tile) {
                let seen = view.see(l, model, &at, block);
                sums.rho = l.add(sums.rho, weigh(l, &self.loss, block, &seen, terms));
            }
            for terms in &tile[..blocks.len()] {
                sums.add(l, terms);
            }
        }
        sums.fold(l)
    }
}
