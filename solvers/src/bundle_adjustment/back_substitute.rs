//! The two passes after the reduced system: landmark steps, and the cost of a state.
//!
//! δ_l = −(L Lᵀ)⁻¹ (g_l + Σ J_lᵀ J_v δ_v) with the Jacobians of the linearization point computed anew,
//! which is cheaper than reading them back from memory. Nothing is moved here: `system` applies the
//! steps.

use crate::interrupt::Interrupt;
use crate::loss::Loss;
use crate::simd::{Kernel, Lanes, WIDTH};

use super::blocks::ViewVector;
use super::landmarks::{LandmarkGroup, Rows};
use super::layout::Layout;
use super::observe::{
    Consumer, Inputs, Linearized, LinearizingKernel, eight_indices, linearize, squared_errors,
};
use super::sorted::{Chunk, GROUPS};

/// What the landmark steps of a chunk add to the step's figures.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StepSums {
    /// Σ δᵀ(λDδ − g).
    pub(super) decrease: f64,
    /// Σ ‖δ‖².
    pub(super) squared: f64,
}

/// J_v δ_v of eight observations, for vectors `of` by view in `views`' numbering.
#[inline(always)]
pub(super) fn along<L: Lanes, const D: usize, const V: usize, const T: usize, const R: usize>(
    l: L,
    lin: &Linearized<L, R>,
    of: &[ViewVector<V, T>],
    views: &[u32; WIDTH],
) -> [L::V; R] {
    let mut along = [l.splat(0.0); R];
    for v in 0..V {
        let mut rows = [l.splat(0.0); WIDTH];
        for (row, &view) in rows.iter_mut().zip(views) {
            *row = l.load(&of[view as usize].rows[v]);
        }
        for (i, delta) in l.transpose(rows).into_iter().enumerate() {
            let column = v * WIDTH + i;
            if column < D {
                for (r, sum) in along.iter_mut().enumerate() {
                    *sum = l.fma(lin.column(l, r, column, D), delta, *sum);
                }
            }
        }
    }
    for t in 0..T {
        let mut rows = [l.splat(0.0); WIDTH];
        for (row, &view) in rows.iter_mut().zip(views) {
            *row = l.load(&of[view as usize].tail[t]);
        }
        // The lanes after the first are not wanted: their shuffles are never made.
        let [delta, ..] = l.transpose(rows);
        for (r, sum) in along.iter_mut().enumerate() {
            *sum = l.fma(lin.column(l, r, V * WIDTH + t, D), delta, *sum);
        }
    }
    along
}

/// Landmark steps of one chunk.
pub(super) struct BackSubstitute<'a, const D: usize, const V: usize, const T: usize, const R: usize>
{
    pub(super) inputs: Inputs<'a>,
    pub(super) layout: &'a Layout,
    pub(super) chunk: &'a Chunk,
    pub(super) damping: f64,
    /// δ_v of each view, zero where constant.
    pub(super) view_steps: &'a [ViewVector<V, T>],
    /// [`GROUPS`] for each tile of the chunk.
    pub(super) groups: &'a [LandmarkGroup],
    /// Four numbers for each landmark of the chunk, in sorted order; the last is zero.
    pub(super) steps: &'a mut [f64],
    /// Asked after each tile.
    pub(super) interrupt: &'a Interrupt,
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> LinearizingKernel
    for BackSubstitute<'_, D, V, T, R>
{
    const COLUMNS: usize = D;
    const ROWS: usize = R;
    type Output = StepSums;

    #[inline(always)]
    fn run<L: Lanes, const SPECIAL: bool>(self, l: L) -> StepSums {
        let sorted = self.inputs.sorted;
        let mut rows = Rows::<1>::new(sorted.longest_tile + 2 * WIDTH);
        let zero = l.splat(0.0);
        let (mut decrease, mut squared) = (zero, zero);
        for (t, tile) in self.layout.tiles(self.chunk) {
            if self.interrupt.is_due() {
                break;
            }
            let first = tile.observations.start;
            for o in tile.observations.clone().step_by(WIDTH) {
                let views = eight_indices(&sorted.views, o);
                let steps = self.view_steps;
                let part =
                    StoreProjection::<D, V, T> { steps, views, slot: o - first, rows: &mut rows };
                linearize::<L, _, D, R, SPECIAL>(l, &self.inputs, o, part);
            }
            rows.sum(l, sorted, &tile);
            let groups = (t - self.chunk.tiles.start) * GROUPS;
            for (g, group) in self.groups[groups..groups + GROUPS].iter().enumerate() {
                if g * WIDTH >= tile.landmarks.len() {
                    break;
                }
                let [x, y, z, ..] = rows.lanes(l, g, 0);
                let (mut gradient, mut right) = ([zero; 3], [x, y, z]);
                for c in 0..3 {
                    gradient[c] = l.load(&group.gradient[c]);
                    right[c] = l.sub(zero, l.add(gradient[c], right[c]));
                }
                let step = group.solve(l, right);
                for c in 0..3 {
                    let scaled = l.mul(l.splat(self.damping), l.load(&group.scale[c]));
                    let damped = l.fma(scaled, step[c], l.sub(zero, gradient[c]));
                    decrease = l.fma(step[c], damped, decrease);
                    squared = l.fma(step[c], step[c], squared);
                }
                let [x, y, z] = step;
                rows.set_lanes(l, g, 0, [x, y, z, zero, zero, zero, zero, zero]);
            }
            let begin = tile.landmarks.start - self.chunk.landmarks.start;
            for (step, row) in self.steps[4 * begin..].chunks_exact_mut(4).zip(rows.of(&tile)) {
                step.copy_from_slice(&row[0][..4]);
            }
        }
        let total = |v: L::V| {
            let mut row = [0.0; WIDTH];
            l.store(v, &mut row);
            row.iter().sum()
        };
        StepSums { decrease: total(decrease), squared: total(squared) }
    }
}

/// Stores J_lᵀ J_v δ_v of eight observations in `rows`, from `slot` on.
struct StoreProjection<'a, const D: usize, const V: usize, const T: usize> {
    steps: &'a [ViewVector<V, T>],
    views: &'a [u32; WIDTH],
    slot: usize,
    rows: &'a mut Rows<1>,
}

impl<L: Lanes, const D: usize, const V: usize, const T: usize, const R: usize> Consumer<L, R>
    for StoreProjection<'_, D, V, T>
{
    #[inline(always)]
    fn consume(self, l: L, lin: &Linearized<L, R>) {
        let along = along::<L, D, V, T, R>(l, lin, self.steps, self.views);
        self.rows.put(l, self.slot, 0, lin.onto_landmark(l, along));
    }
}

/// ½ Σ ρ of one chunk; infinite where an observation has no finite residual.
pub(super) struct Cost<'a, const R: usize> {
    pub(super) inputs: Inputs<'a>,
    pub(super) chunk: &'a Chunk,
}

impl<const R: usize> Kernel for Cost<'_, R> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> f64 {
        let loss = self.inputs.loss;
        let mut total = l.splat(0.0);
        let mut rest = 0.0;
        let mut row = [0.0; WIDTH];
        for first in self.chunk.observations.clone().step_by(WIDTH) {
            let squared = squared_errors::<L, R>(l, &self.inputs, first);
            let lanes = self.chunk.observations.end - first;
            if loss == Loss::Trivial && lanes >= WIDTH {
                total = l.add(total, squared);
                continue;
            }
            l.store(squared, &mut row);
            for s in &row[..lanes.min(WIDTH)] {
                // A bounded loss must not hide that there is no residual.
                rest += if s.is_finite() { loss.evaluate(*s).rho } else { f64::INFINITY };
            }
        }
        l.store(total, &mut row);
        let cost = 0.5 * (row.iter().sum::<f64>() + rest);
        if cost.is_finite() { cost } else { f64::INFINITY }
    }
}
