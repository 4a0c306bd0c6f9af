//! The fused pass: residuals, Jacobians, landmark elimination and the reduced camera system in one.
//!
//! For a landmark with H_ll + λD = L Lᵀ and y = L⁻¹ g_l, each of its observations has E = J_vᵀ J_l L⁻ᵀ
//! (D × 3). A chunk sums, for each view, J_vᵀJ_v − E Eᵀ, its gradient and diagonal, and for each pair
//! of views −E_i E_jᵀ. Jacobians live in a tile of a few dozen observations and are never written
//! out; a landmark leaves only L, g_l and D behind. Rows of a block are vectors of Q·8 lanes with the
//! residual as row D, so that gradients come with the products.

use crate::simd::{Kernel, Lanes, Row, WIDTH};

use super::covisible::{ChunkPairs, NO_SLOT};
use super::layout::{Chunk, Layout};
use super::models::LaneModel;
use super::observe::{Inputs, linearize};

/// Observations of a tile: enough to fill the lanes, few enough for the first-level cache.
const TILE: usize = 64;

/// Diagonal entries of D are kept in this range, so that directions without information are damped.
const DIAGONAL_RANGE: (f64, f64) = (1e-6, 1e32);

/// Marquardt's scale of a diagonal entry of H.
pub(super) fn damping_scale(diagonal: f64) -> f64 {
    diagonal.clamp(DIAGONAL_RANGE.0, DIAGONAL_RANGE.1)
}

/// D (+ residual) entries of a view's column, padded.
pub(super) type Column<const Q: usize> = [Row; Q];

/// What a chunk sums for a view.
#[derive(Clone, Copy, Debug)]
pub(super) struct ViewSum<const D: usize, const Q: usize> {
    /// Columns of J_vᵀJ_v − E Eᵀ.
    pub(super) reduced: [Column<Q>; D],
    /// Diagonal of J_vᵀJ_v.
    pub(super) diagonal: Column<Q>,
    /// J_vᵀ r.
    pub(super) gradient: Column<Q>,
    /// E y.
    pub(super) eliminated: Column<Q>,
}

/// Columns of −E_i E_jᵀ of a pair of views.
pub(super) type PairSum<const D: usize, const Q: usize> = [Column<Q>; D];

/// What a landmark leaves behind for the step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LandmarkRecord {
    /// L by rows, its diagonal inverted: 1/l00, l10, 1/l11, l20, l21, 1/l22.
    pub(super) factor: [f64; 6],
    /// g_l.
    pub(super) gradient: [f64; 3],
    /// D.
    pub(super) scale: [f64; 3],
}

/// What a chunk of landmarks sums.
#[derive(Clone, Debug)]
pub(super) struct ChunkSums<const D: usize, const Q: usize> {
    pub(super) views: Vec<ViewSum<D, Q>>,
    pub(super) pairs: Vec<PairSum<D, Q>>,
    /// Largest |g_i| / √D_i of its landmarks.
    pub(super) gradient_max_norm: f64,
    /// Whether every landmark's block was positive definite.
    pub(super) positive_definite: bool,
    scratch: Scratch<D, Q>,
}

#[derive(Clone, Debug)]
struct Scratch<const D: usize, const Q: usize> {
    /// Rows of the view's Jacobian with the residual behind, up to three an observation.
    jacobian: Vec<[Column<Q>; 3]>,
    /// Landmark Jacobian (3 × 3 by rows) as a structure of arrays.
    landmark: Vec<[f64; 9]>,
    /// H_ll (6) and g_l (3) of each observation.
    products: Vec<[f64; 9]>,
    eliminated: Vec<[Column<Q>; 3]>,
}

impl<const D: usize, const Q: usize> ChunkSums<D, Q> {
    pub(super) fn new(layout: &Layout, pairs: &ChunkPairs) -> Self {
        let zero = [[0.0; WIDTH]; Q];
        let room = TILE + layout.longest_track + WIDTH;
        Self {
            views: vec![
                ViewSum {
                    reduced: [zero; D],
                    diagonal: zero,
                    gradient: zero,
                    eliminated: zero
                };
                layout.views.len()
            ],
            pairs: vec![[zero; D]; pairs.slots.len()],
            gradient_max_norm: 0.0,
            positive_definite: true,
            scratch: Scratch {
                jacobian: vec![[zero; 3]; room],
                landmark: vec![[0.0; 9]; room],
                products: vec![[0.0; 9]; room],
                eliminated: vec![[zero; 3]; room],
            },
        }
    }
}

/// The pass over one chunk.
pub(super) struct Accumulate<'a, M, const D: usize, const Q: usize, const R: usize> {
    pub(super) inputs: Inputs<'a, M>,
    pub(super) layout: &'a Layout,
    pub(super) constant: &'a [bool],
    pub(super) chunk: &'a Chunk,
    pub(super) pairs: &'a ChunkPairs,
    pub(super) damping: f64,
    pub(super) sums: &'a mut ChunkSums<D, Q>,
    /// One for each landmark of the chunk.
    pub(super) records: &'a mut [LandmarkRecord],
}

impl<M: LaneModel, const D: usize, const Q: usize, const R: usize> Kernel
    for Accumulate<'_, M, D, Q, R>
{
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self, l: L) {
        let zero = [[0.0; WIDTH]; Q];
        let sums = &mut *self.sums;
        sums.views.fill(ViewSum {
            reduced: [zero; D],
            diagonal: zero,
            gradient: zero,
            eliminated: zero,
        });
        sums.pairs.fill([zero; D]);
        sums.gradient_max_norm = 0.0;
        sums.positive_definite = true;
        let mut begin = self.chunk.landmarks.start;
        while begin < self.chunk.landmarks.end {
            let first = self.layout.starts[begin] as usize;
            let mut end = begin + 1;
            while end < self.chunk.landmarks.end
                && self.layout.starts[end + 1] as usize - first <= TILE
            {
                end += 1;
            }
            let last = self.layout.starts[end] as usize;
            for o in (first..last).step_by(WIDTH) {
                self.observe(l, o, o - first);
            }
            for k in begin..end {
                self.landmark(l, k, first);
            }
            begin = end;
        }
    }
}

impl<M: LaneModel, const D: usize, const Q: usize, const R: usize> Accumulate<'_, M, D, Q, R> {
    /// Eight observations into the tile, at `slot`.
    #[inline(always)]
    fn observe<L: Lanes>(&mut self, l: L, first: usize, slot: usize) {
        let lin = linearize::<L, M, R>(l, &self.inputs, first);
        let scratch = &mut self.sums.scratch;
        let zero = l.splat(0.0);
        for r in 0..R {
            for q in 0..Q {
                let column = |i: usize| -> L::V {
                    let i = q * WIDTH + i;
                    if i == D {
                        lin.residual[r]
                    } else if i < 6 {
                        lin.pose[r][i]
                    } else if i < D {
                        lin.camera[r][i - 6]
                    } else {
                        zero
                    }
                };
                let rows = l.transpose([
                    column(0),
                    column(1),
                    column(2),
                    column(3),
                    column(4),
                    column(5),
                    column(6),
                    column(7),
                ]);
                for (lane, row) in rows.into_iter().enumerate() {
                    l.store(row, &mut scratch.jacobian[slot + lane][r][q]);
                }
            }
        }
        let mut columns = [[0.0; WIDTH]; 9];
        for r in 0..R {
            for c in 0..3 {
                l.store(lin.landmark[r][c], &mut columns[3 * r + c]);
            }
        }
        for lane in 0..WIDTH {
            for i in 0..3 * R {
                scratch.landmark[slot + lane][i] = columns[i][lane];
            }
        }
        let mut product = |i: usize, a: usize, b: Option<usize>| {
            let right = |r: usize| b.map_or(lin.residual[r], |b| lin.landmark[r][b]);
            let mut sum = l.mul(lin.landmark[0][a], right(0));
            for r in 1..R {
                sum = l.fma(lin.landmark[r][a], right(r), sum);
            }
            l.store(sum, &mut columns[i]);
        };
        product(0, 0, Some(0));
        product(1, 1, Some(0));
        product(2, 1, Some(1));
        product(3, 2, Some(0));
        product(4, 2, Some(1));
        product(5, 2, Some(2));
        product(6, 0, None);
        product(7, 1, None);
        product(8, 2, None);
        for lane in 0..WIDTH {
            for i in 0..9 {
                scratch.products[slot + lane][i] = columns[i][lane];
            }
        }
    }

    /// Eliminates the landmark at sorted position `k`; its tile begins at observation `first`.
    #[inline(always)]
    fn landmark<L: Lanes>(&mut self, l: L, k: usize, first: usize) {
        let track = self.layout.track(k);
        let constant = self.constant[self.layout.order[k] as usize];
        let mut record = LandmarkRecord::default();
        let place = k - self.chunk.landmarks.start;
        if track.is_empty() {
            self.records[place] = record;
            return;
        }
        let slots = track.start - first..track.end - first;
        let mut y = [0.0; 3];
        if !constant {
            let mut sum = [0.0; 9];
            for product in &self.sums.scratch.products[slots.clone()] {
                for (s, p) in sum.iter_mut().zip(product) {
                    *s += p;
                }
            }
            match factor(&sum, self.damping) {
                Some((factored, whitened)) => (record, y) = (factored, whitened),
                None => self.sums.positive_definite = false,
            }
            for i in 0..3 {
                let norm = record.gradient[i].abs() / record.scale[i].sqrt();
                self.sums.gradient_max_norm = self.sums.gradient_max_norm.max(norm);
            }
            self.eliminate(l, slots.clone(), &record.factor);
        }
        self.records[place] = record;
        self.add_views(l, track.start, slots.clone(), if constant { None } else { Some(y) });
        if !constant {
            self.add_pairs(l, k, slots);
        }
    }

    /// E = J_vᵀ J_l L⁻ᵀ of each observation of a landmark.
    #[inline(always)]
    fn eliminate<L: Lanes>(&mut self, l: L, slots: std::ops::Range<usize>, factor: &[f64; 6]) {
        let scratch = &mut self.sums.scratch;
        let [i00, l10, i11, l20, l21, i22] = *factor;
        for slot in slots {
            let j = &scratch.landmark[slot];
            let mut e = [[l.splat(0.0); Q]; 3];
            for r in 0..R {
                let a = j[3 * r] * i00;
                let b = (j[3 * r + 1] - a * l10) * i11;
                let c = (j[3 * r + 2] - a * l20 - b * l21) * i22;
                for (m, x) in [a, b, c].into_iter().enumerate() {
                    let x = l.splat(x);
                    for q in 0..Q {
                        let row = l.load(&scratch.jacobian[slot][r][q]);
                        e[m][q] = if r == 0 { l.mul(row, x) } else { l.fma(row, x, e[m][q]) };
                    }
                }
            }
            for m in 0..3 {
                for q in 0..Q {
                    l.store(e[m][q], &mut scratch.eliminated[slot][m][q]);
                }
            }
        }
    }

    /// Adds J_vᵀJ_v − E Eᵀ, the diagonal and the gradients of a track to its views.
    #[inline(always)]
    fn add_views<L: Lanes>(
        &mut self,
        l: L,
        first: usize,
        slots: std::ops::Range<usize>,
        y: Option<[f64; 3]>,
    ) {
        let sums = &mut *self.sums;
        for (i, slot) in slots.enumerate() {
            let view = self.inputs.sorted.views[first + i];
            if !self.layout.is_active(view) {
                continue;
            }
            let sum = &mut sums.views[view as usize];
            let jacobian = &sums.scratch.jacobian[slot];
            let eliminated = &sums.scratch.eliminated[slot];
            for q in 0..Q {
                let mut rows = [l.splat(0.0); R];
                for (r, row) in rows.iter_mut().enumerate() {
                    *row = l.load(&jacobian[r][q]);
                }
                let e = [
                    l.load(&eliminated[0][q]),
                    l.load(&eliminated[1][q]),
                    l.load(&eliminated[2][q]),
                ];
                for column in 0..D {
                    let (cq, ci) = (column / WIDTH, column % WIDTH);
                    if cq > q {
                        continue;
                    }
                    let mut total = l.load(&sum.reduced[column][q]);
                    for (r, row) in rows.iter().enumerate() {
                        total = l.fma(*row, l.splat(jacobian[r][cq][ci]), total);
                    }
                    if y.is_some() {
                        for m in 0..3 {
                            total = l.fnma(e[m], l.splat(eliminated[m][cq][ci]), total);
                        }
                    }
                    l.store(total, &mut sum.reduced[column][q]);
                }
                let (rq, ri) = (D / WIDTH, D % WIDTH);
                let mut diagonal = l.load(&sum.diagonal[q]);
                let mut gradient = l.load(&sum.gradient[q]);
                for (r, row) in rows.iter().enumerate() {
                    diagonal = l.fma(*row, *row, diagonal);
                    gradient = l.fma(*row, l.splat(jacobian[r][rq][ri]), gradient);
                }
                l.store(diagonal, &mut sum.diagonal[q]);
                l.store(gradient, &mut sum.gradient[q]);
                if let Some(y) = y {
                    let mut part = l.load(&sum.eliminated[q]);
                    for m in 0..3 {
                        part = l.fma(e[m], l.splat(y[m]), part);
                    }
                    l.store(part, &mut sum.eliminated[q]);
                }
            }
        }
    }

    /// Subtracts E_i E_jᵀ for the pairs of a track.
    #[inline(always)]
    fn add_pairs<L: Lanes>(&mut self, l: L, k: usize, slots: std::ops::Range<usize>) {
        let sums = &mut *self.sums;
        let mut pair = self.pairs.starts[k - self.chunk.landmarks.start] as usize;
        let eliminated = &sums.scratch.eliminated[slots];
        for (i, left) in eliminated.iter().enumerate() {
            let row = &self.pairs.slot_of[pair..pair + i];
            pair += i;
            for (&slot, right) in row.iter().zip(eliminated) {
                if slot == NO_SLOT {
                    continue;
                }
                let target = &mut sums.pairs[slot as usize];
                for q in 0..Q {
                    let e = [l.load(&left[0][q]), l.load(&left[1][q]), l.load(&left[2][q])];
                    for column in 0..D {
                        let (cq, ci) = (column / WIDTH, column % WIDTH);
                        let mut total = l.load(&target[column][q]);
                        for m in 0..3 {
                            total = l.fnma(e[m], l.splat(right[m][cq][ci]), total);
                        }
                        l.store(total, &mut target[column][q]);
                    }
                }
            }
        }
    }
}

/// Factors H_ll + λD from the lower triangle and gradient in `sum`; also y = L⁻¹ g.
#[inline(always)]
fn factor(sum: &[f64; 9], damping: f64) -> Option<(LandmarkRecord, [f64; 3])> {
    let [h00, h10, h11, h20, h21, h22, g0, g1, g2] = *sum;
    let scale = [damping_scale(h00), damping_scale(h11), damping_scale(h22)];
    let d0 = h00 + damping * scale[0];
    let i00 = 1.0 / d0.sqrt();
    let l10 = h10 * i00;
    let l20 = h20 * i00;
    let d1 = h11 + damping * scale[1] - l10 * l10;
    let i11 = 1.0 / d1.sqrt();
    let l21 = (h21 - l20 * l10) * i11;
    let d2 = h22 + damping * scale[2] - l20 * l20 - l21 * l21;
    let i22 = 1.0 / d2.sqrt();
    let gradient = [g0, g1, g2];
    let fine = d0 > 0.0 && d1 > 0.0 && d2 > 0.0 && (i00 * i11 * i22).is_finite();
    if !fine {
        return None;
    }
    let y0 = g0 * i00;
    let y1 = (g1 - l10 * y0) * i11;
    let y2 = (g2 - l20 * y0 - l21 * y1) * i22;
    let factor = [i00, l10, i11, l20, l21, i22];
    Some((LandmarkRecord { factor, gradient, scale }, [y0, y1, y2]))
}
