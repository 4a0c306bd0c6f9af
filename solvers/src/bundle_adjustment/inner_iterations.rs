//! Landmarks minimized each on its own, with poses and cameras held, under a loss.
//!
//! After a joint step the landmarks are at the minimum of a quadratic model, which under a loss is far
//! from that of their cost. Moving them there (Ruhe and Wedin, "Algorithms for separable nonlinear
//! least squares problems", 1980) leaves a problem in the poses and cameras alone, of which the reduced
//! system is the model. Steps are Newton's, damped, and shortened where they do not lower the cost,
//! which never rises. Landmarks are independent; a tile of them stays in the cache. This file moves
//! nothing else.

use crate::interrupt::Interrupt;
use crate::simd::{Kernel, Lanes, Line, Subroutine, WIDTH};

use super::landmarks::Rows;
use super::layout::Layout;
use super::observe::{InTile, Inputs, by_model};
use super::sorted::{Chunk, GROUPS, Sorted, Tile};

/// Numbers of a landmark in the kernels' order: x, y, z and one of padding.
pub(super) const POINT: usize = 4;

/// Landmarks of a tile, at most.
const LANDMARKS: usize = GROUPS * WIDTH;

/// The stiffness of the models, see [`System::set_stiffness`](crate::optimizer::System::set_stiffness):
/// nearly the curvature of the loss, since a step that does not lower the cost is taken back.
pub(super) const INNER_STIFFNESS: f64 = 0.02;

/// λ of the steps.
const DAMPING: f64 = 1e-4;

/// At most so many steps: with 10 and fewer, landmarks that have not arrived slow the whole solve down.
const MAX_STEPS: usize = 20;

/// A landmark has arrived where its model has no more than this to gain; costs are in units of a
/// variance.
const GAIN: f64 = 1e-9;

/// The factor of a step that did not lower the cost.
const SHORTEN: f64 = 0.25;

/// Minimizes the landmarks of one chunk.
pub(super) struct InnerIterations<'a, const R: usize> {
    /// Without points.
    pub(super) inputs: Inputs<'a>,
    pub(super) layout: &'a Layout,
    pub(super) chunk: &'a Chunk,
    /// Of the chunk's landmarks.
    pub(super) points: &'a mut [f64],
    /// Asked after each tile.
    pub(super) interrupt: &'a Interrupt,
}

impl<const R: usize> Kernel for InnerIterations<'_, R> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self { inputs, layout, chunk, points, interrupt } = self;
        let mut rows = Rows::<2>::new(inputs.sorted.longest_tile + 2 * WIDTH);
        for (_, tile) in layout.tiles(chunk) {
            if interrupt.is_due() {
                return;
            }
            let begin = (tile.landmarks.start - chunk.landmarks.start) * POINT;
            let points = &mut points[begin..begin + tile.landmarks.len() * POINT];
            // Eight numbers are read from any landmark on.
            let mut trial = [0.0; (LANDMARKS + 1) * POINT];
            trial[..points.len()].copy_from_slice(points);
            let mut groups: [Group; GROUPS] =
                std::array::from_fn(|g| Group::new(inputs.sorted, &tile, g, &trial));
            for _ in 0..=MAX_STEPS {
                let inputs = Inputs { points: &trial, ..inputs };
                evaluate::<L, R>(l, &inputs, &tile, &mut rows);
                let mut gain = 0.0;
                for (g, group) in groups.iter_mut().enumerate() {
                    if g * WIDTH < tile.landmarks.len() {
                        group.advance(l, &rows, g);
                        group.write_trial(&mut trial[g * WIDTH * POINT..]);
                        gain = group.gain.iter().fold(gain, |a, b| f64::max(a, *b));
                    }
                }
                if gain <= GAIN {
                    break;
                }
            }
            for (k, point) in points.chunks_exact_mut(POINT).enumerate() {
                for c in 0..3 {
                    point[c] = groups[k / WIDTH].best[c][k % WIDTH];
                }
            }
        }
    }
}

/// Costs, gradients and Hessians of the landmarks of a tile.
#[inline(always)]
fn evaluate<L: Lanes, const R: usize>(l: L, inputs: &Inputs<'_>, tile: &Tile, rows: &mut Rows<2>) {
    let point_index = InTile { first: tile.landmarks.start };
    let begin = tile.observations.start;
    for first in tile.observations.clone().step_by(WIDTH) {
        let lines = l.call(Observe::<R> { inputs, first, point_index });
        rows.put(l, first - begin, 0, lines[0]);
        rows.put(l, first - begin, 1, lines[1]);
    }
    rows.sum(l, inputs.sorted, tile);
}

/// What eight observations add to their landmarks: J_lᵀJ_l (00, 10, 11, 20, 21, 22) and the first two
/// of J_lᵀr; then the third and ½ ρ.
struct Observe<'a, const R: usize> {
    inputs: &'a Inputs<'a>,
    first: usize,
    point_index: InTile,
}

impl<L: Lanes, const R: usize> Subroutine<L> for Observe<'_, R> {
    type Output = [[L::V; WIDTH]; 2];

    #[inline(always)]
    fn run(self, l: L) -> [[L::V; WIDTH]; 2] {
        let Self { inputs, first, point_index } = self;
        // Nothing reads the columns of pose and camera, so that they are not computed.
        let mut lin = by_model::<L, _, R>(l, inputs, first, point_index);
        let cost = lin.weigh_landmark(l, &inputs.loss, inputs.stiffness);
        let mut lines = [[l.splat(0.0); WIDTH]; 2];
        let [products, last] = &mut lines;
        for r in 0..R {
            let [a, b, c] = lin.landmark[r];
            products[0] = l.fma(a, a, products[0]);
            products[1] = l.fma(b, a, products[1]);
            products[2] = l.fma(b, b, products[2]);
            products[3] = l.fma(c, a, products[3]);
            products[4] = l.fma(c, b, products[4]);
            products[5] = l.fma(c, c, products[5]);
            products[6] = l.fma(a, lin.residual[r], products[6]);
            products[7] = l.fma(b, lin.residual[r], products[7]);
            last[0] = l.fma(c, lin.residual[r], last[0]);
        }
        last[1] = cost;
        lines
    }
}

/// Eight landmarks on their way, a lane each.
struct Group {
    /// 1 where the landmark moves, 0 where it is held fixed or there is none.
    moves: Line,
    /// Where the cost was lowest.
    best: [Line; 3],
    /// The lowest cost; infinite before the first.
    cost: Line,
    /// From there to where it is evaluated next.
    step: [Line; 3],
    /// What the model has to gain by that, about.
    gain: Line,
}

impl Group {
    fn new(sorted: &Sorted, tile: &Tile, g: usize, points: &[f64]) -> Self {
        let mut group = Self {
            moves: Line::ZERO,
            best: [Line::ZERO; 3],
            cost: Line([f64::INFINITY; WIDTH]),
            step: [Line::ZERO; 3],
            gain: Line::ZERO,
        };
        for lane in 0..WIDTH {
            let k = g * WIDTH + lane;
            let is_constant = sorted.constant[tile.landmarks.clone()].get(k).copied();
            group.moves[lane] = if is_constant == Some(false) { 1.0 } else { 0.0 };
            for c in 0..3 {
                group.best[c][lane] = points[k * POINT + c];
            }
        }
        group
    }

    /// Keeps what was evaluated where it is better and sets a step by its model, shortens the step
    /// elsewhere.
    #[inline(always)]
    fn advance<L: Lanes>(&mut self, l: L, rows: &Rows<2>, g: usize) {
        let [h00, h10, h11, h20, h21, h22, g0, g1] = rows.lanes(l, g, 0);
        let [g2, cost, ..] = rows.lanes(l, g, 1);
        let (zero, one) = (l.splat(0.0), l.splat(1.0));
        // L Lᵀ = H + λD, its diagonal inverted.
        let damped = l.splat(1.0 + DAMPING);
        let i00 = l.div(one, l.sqrt(l.mul(damped, h00)));
        let l10 = l.mul(h10, i00);
        let l20 = l.mul(h20, i00);
        let i11 = l.div(one, l.sqrt(l.fnma(l10, l10, l.mul(damped, h11))));
        let l21 = l.mul(l.fnma(l20, l10, h21), i11);
        let d2 = l.fnma(l20, l20, l.mul(damped, h22));
        let i22 = l.div(one, l.sqrt(l.fnma(l21, l21, d2)));
        let y0 = l.mul(g0, i00);
        let y1 = l.mul(l.fnma(l10, y0, g1), i11);
        let y2 = l.mul(l.fnma(l21, y1, l.fnma(l20, y0, g2)), i22);
        let gain = l.fma(y0, y0, l.fma(y1, y1, l.mul(y2, y2)));
        let z = l.mul(y2, i22);
        let y = l.mul(l.fnma(l21, z, y1), i11);
        let x = l.mul(l.fnma(l20, z, l.fnma(l10, y, y0)), i00);
        let moves = l.load(&self.moves);
        // Not a number, and so not better, where there is no model to step by.
        let better = l.fma(zero, gain, l.sub(l.load(&self.cost), cost));
        let shorten = l.splat(SHORTEN);
        for (c, newton) in [x, y, z].into_iter().enumerate() {
            let (best, step) = (l.load(&self.best[c]), l.load(&self.step[c]));
            let next = l.select(better, l.sub(zero, newton), l.mul(step, shorten));
            l.store(l.select(better, l.add(best, step), best), &mut self.best[c]);
            l.store(l.select(moves, next, zero), &mut self.step[c]);
        }
        let next = l.select(better, gain, l.mul(l.load(&self.gain), shorten));
        l.store(l.select(moves, next, zero), &mut self.gain);
        l.store(l.select(better, cost, l.load(&self.cost)), &mut self.cost);
    }

    /// Where the landmarks are evaluated next.
    #[inline(always)]
    fn write_trial(&self, points: &mut [f64]) {
        for (lane, point) in points.chunks_exact_mut(POINT).take(WIDTH).enumerate() {
            for c in 0..3 {
                point[c] = self.best[c][lane] + self.step[c][lane];
            }
        }
    }
}
