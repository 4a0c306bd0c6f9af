//! The fused pass: residuals, Jacobians, landmark elimination and the Schur complement in one.
//!
//! For a landmark with H_ll + λD = L Lᵀ, each of its observations has G = J_l L⁻ᵀ (R × 3) and
//! M = I − G Gᵀ. A view's share of the reduced system is J_vᵀ M J_v, its gradient J_vᵀ (r − G y) with
//! y = L⁻¹ g_l; a pair of views has −E_i E_jᵀ with E = J_vᵀ G. Lanes are observations for G and M,
//! landmarks for L, and entries of a block for the products. Jacobians live in a tile and are never
//! written out; a landmark leaves only L, g_l and D behind. Sums one chunk alone: `reduce` adds the
//! chunks. A landmark whose block is not positive definite is reported, not repaired.

use crate::interrupt::Interrupt;
use crate::simd::{Lanes, Line, WIDTH};

use super::blocks::{Block, ViewVector};
use super::covisible::{ChunkPairs, NO_SLOT};
use super::landmarks::{LandmarkGroup, TileLandmarks};
use super::layout::Layout;
use super::observe::{Consumer, Inputs, Linearized, LinearizingKernel, linearize};
use super::sorted::{Chunk, GROUPS, Tile};

/// A row of so many pairs of a landmark takes some ten microseconds.
const MANY_PAIRS: usize = 256;

/// What a chunk sums for a view.
#[derive(Clone, Copy, Debug)]
pub(super) struct ViewSum<const D: usize, const V: usize, const T: usize> {
    /// J_vᵀ M J_v.
    pub(super) reduced: Block<D, V, T>,
    /// Diagonal of J_vᵀ J_v.
    pub(super) diagonal: ViewVector<V, T>,
    /// J_vᵀ r.
    pub(super) gradient: ViewVector<V, T>,
    /// J_vᵀ (r − G y).
    pub(super) reduced_gradient: ViewVector<V, T>,
}

impl<const D: usize, const V: usize, const T: usize> ViewSum<D, V, T> {
    const ZERO: Self = Self {
        reduced: Block::ZERO,
        diagonal: ViewVector::ZERO,
        gradient: ViewVector::ZERO,
        reduced_gradient: ViewVector::ZERO,
    };
}

/// What a chunk of landmarks sums.
#[derive(Clone, Debug)]
pub(super) struct ChunkSums<const D: usize, const V: usize, const T: usize, const R: usize> {
    /// By the chunk's own numbers of views.
    pub(super) views: Vec<ViewSum<D, V, T>>,
    /// −E_i E_jᵀ; empty where pairs are not wanted.
    pub(super) pairs: Vec<Block<D, V, T>>,
    /// Largest |g_i| / √D_i of its landmarks.
    pub(super) gradient_max_norm: f64,
    /// Whether every landmark's block was positive definite.
    pub(super) positive_definite: bool,
    scratch: Scratch<V, T, R>,
}

/// The tile.
#[derive(Clone, Debug)]
struct Scratch<const V: usize, const T: usize, const R: usize> {
    /// Rows of J_v without their tail, for each observation.
    jacobian: Vec<[[Line; V]; R]>,
    /// What has a lane an observation.
    eights: Vec<Eight<T, R>>,
    landmarks: TileLandmarks,
    /// Columns of E without their tail, for one track.
    eliminated: Vec<[[Line; V]; 3]>,
    /// Tails of E, for one track.
    eliminated_tails: Vec<[f64; 3]>,
}

/// Eight observations of a tile.
#[derive(Clone, Copy, Debug)]
struct Eight<const T: usize, const R: usize> {
    /// Tails of J_v.
    tails: [[Line; T]; R],
    /// J_l by rows; later G.
    landmark: [[Line; 3]; R],
    /// r.
    residual: [Line; R],
    /// M.
    projector: [[Line; R]; R],
    /// r − G y.
    reduced_residual: [Line; R],
}

impl<const T: usize, const R: usize> Eight<T, R> {
    const ZERO: Self = Self {
        tails: [[Line::ZERO; T]; R],
        landmark: [[Line::ZERO; 3]; R],
        residual: [Line::ZERO; R],
        projector: [[Line::ZERO; R]; R],
        reduced_residual: [Line::ZERO; R],
    };
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> ChunkSums<D, V, T, R> {
    /// Bytes of a view's sum, and of an observation of the longest tile.
    pub(super) const VIEW_BYTES: usize = size_of::<ViewSum<D, V, T>>();
    pub(super) const OBSERVATION_BYTES: usize = size_of::<[[Line; V]; R]>()
        + size_of::<Eight<T, R>>().div_ceil(WIDTH)
        + size_of::<[Line; 2]>();

    pub(super) fn new(layout: &Layout, chunk: &Chunk, pairs: Option<&ChunkPairs>) -> Self {
        let room = layout.sorted.longest_tile + 2 * WIDTH;
        let track = if pairs.is_some() { layout.sorted.longest_track } else { 0 };
        Self {
            views: vec![ViewSum::ZERO; chunk.views.len()],
            pairs: vec![Block::ZERO; pairs.map_or(0, |p| p.slots.len())],
            gradient_max_norm: 0.0,
            positive_definite: true,
            scratch: Scratch {
                jacobian: vec![[[Line::ZERO; V]; R]; room],
                eights: vec![Eight::ZERO; room.div_ceil(WIDTH)],
                landmarks: TileLandmarks::new(room),
                eliminated: vec![[[Line::ZERO; V]; 3]; track],
                eliminated_tails: vec![[0.0; 3]; track],
            },
        }
    }
}

/// The pass over one chunk.
pub(super) struct Accumulate<'a, const D: usize, const V: usize, const T: usize, const R: usize> {
    pub(super) inputs: Inputs<'a>,
    pub(super) layout: &'a Layout,
    pub(super) chunk: &'a Chunk,
    /// `None`: only the diagonal of the reduced system.
    pub(super) pairs: Option<&'a ChunkPairs>,
    pub(super) damping: f64,
    /// Asked after each tile, and within landmarks of many pairs.
    pub(super) interrupt: &'a Interrupt,
    pub(super) sums: &'a mut ChunkSums<D, V, T, R>,
    /// [`GROUPS`] for each tile of the chunk.
    pub(super) groups: &'a mut [LandmarkGroup],
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> LinearizingKernel
    for Accumulate<'_, D, V, T, R>
{
    const COLUMNS: usize = D;
    const ROWS: usize = R;
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes, const SPECIAL: bool>(mut self, l: L) {
        self.sums.views.fill(ViewSum::ZERO);
        self.sums.pairs.fill(Block::ZERO);
        self.sums.gradient_max_norm = 0.0;
        self.sums.positive_definite = true;
        let chunk = self.chunk;
        for (t, tile) in self.layout.tiles(chunk) {
            if self.interrupt.is_due() {
                return;
            }
            let first = tile.observations.start;
            for o in tile.observations.clone().step_by(WIDTH) {
                let scratch = &mut self.sums.scratch;
                let tile = StoreInTile::<D, V, T, R> { scratch, slot: o - first };
                linearize::<L, _, D, R, SPECIAL>(l, &self.inputs, o, tile);
            }
            let groups = (t - chunk.tiles.start) * GROUPS;
            let groups = &mut self.groups[groups..groups + GROUPS];
            let landmarks = &mut self.sums.scratch.landmarks;
            let (norm, fine) = landmarks.factor(l, self.inputs.sorted, &tile, self.damping, groups);
            self.sums.gradient_max_norm = self.sums.gradient_max_norm.max(norm);
            self.sums.positive_definite &= fine;
            for o in tile.observations.clone().step_by(WIDTH) {
                self.whiten(l, &tile, o, (o - first) / WIDTH);
            }
            for k in tile.landmarks.clone() {
                self.landmark(l, k, first);
            }
        }
    }
}

/// Stores eight observations in the tile, from `slot` on.
struct StoreInTile<'a, const D: usize, const V: usize, const T: usize, const R: usize> {
    scratch: &'a mut Scratch<V, T, R>,
    slot: usize,
}

impl<L: Lanes, const D: usize, const V: usize, const T: usize, const R: usize> Consumer<L, R>
    for StoreInTile<'_, D, V, T, R>
{
    #[inline(always)]
    fn consume(self, l: L, lin: &Linearized<L, R>) {
        let Self { scratch, slot } = self;
        for r in 0..R {
            for v in 0..V {
                let mut columns = [l.splat(0.0); WIDTH];
                for (i, column) in columns.iter_mut().enumerate() {
                    *column = lin.column(l, r, v * WIDTH + i, D);
                }
                let rows = l.transpose(columns);
                for (lane, row) in rows.into_iter().enumerate() {
                    l.store(row, &mut scratch.jacobian[slot + lane][r][v]);
                }
            }
            let eight = &mut scratch.eights[slot / WIDTH];
            for t in 0..T {
                l.store(lin.column(l, r, V * WIDTH + t, D), &mut eight.tails[r][t]);
            }
            for c in 0..3 {
                l.store(lin.landmark[r][c], &mut eight.landmark[r][c]);
            }
            l.store(lin.residual[r], &mut eight.residual[r]);
        }
        scratch.landmarks.observe::<L, R>(l, lin, slot);
    }
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> Accumulate<'_, D, V, T, R> {
    /// G, M and r − G y of eight observations.
    #[inline(always)]
    fn whiten<L: Lanes>(&mut self, l: L, tile: &Tile, first: usize, index: usize) {
        let scratch = &mut self.sums.scratch;
        let (factor, y) = scratch.landmarks.factors(l, self.inputs.sorted, tile, first);
        let [i00, l10, i11, l20, l21, i22] = factor;
        let eight = &mut scratch.eights[index];
        let mut g = [[l.splat(0.0); 3]; R];
        for r in 0..R {
            let j = &eight.landmark[r];
            let a = l.mul(l.load(&j[0]), i00);
            let b = l.mul(l.fnma(a, l10, l.load(&j[1])), i11);
            let c = l.mul(l.fnma(b, l21, l.fnma(a, l20, l.load(&j[2]))), i22);
            g[r] = [a, b, c];
            let mut residual = l.load(&eight.residual[r]);
            for m in 0..3 {
                l.store(g[r][m], &mut eight.landmark[r][m]);
                residual = l.fnma(g[r][m], y[m], residual);
            }
            l.store(residual, &mut eight.reduced_residual[r]);
            for s in 0..=r {
                let mut entry = l.splat(if r == s { 1.0 } else { 0.0 });
                for m in 0..3 {
                    entry = l.fnma(g[r][m], g[s][m], entry);
                }
                l.store(entry, &mut eight.projector[r][s]);
                l.store(entry, &mut eight.projector[s][r]);
            }
        }
    }

    /// Eliminates the landmark at sorted position `k` of a tile that begins at observation `first`.
    #[inline(always)]
    fn landmark<L: Lanes>(&mut self, l: L, k: usize, first: usize) {
        let track = self.layout.track(k);
        let pairs = self.pairs.filter(|_| !self.layout.sorted.constant[k]);
        for (i, o) in track.clone().enumerate() {
            if self.layout.active[self.inputs.sorted.views[o] as usize] {
                self.add_view(l, self.inputs.sorted.locals[o] as usize, o - first);
                if pairs.is_some() {
                    self.eliminate(l, i, o - first);
                }
            }
        }
        if let Some(pairs) = pairs {
            self.add_pairs(l, pairs, k, track.len());
        }
    }

    /// Adds an observation to its view.
    #[inline(always)]
    fn add_view<L: Lanes>(&mut self, l: L, local: usize, slot: usize) {
        let sums = &mut *self.sums;
        let scratch = &sums.scratch;
        let sum = &mut sums.views[local];
        let jacobian = &scratch.jacobian[slot];
        let (eight, lane) = (&scratch.eights[slot / WIDTH], slot % WIDTH);
        for v in 0..V {
            let mut rows = [l.splat(0.0); R];
            for r in 0..R {
                rows[r] = l.load(&jacobian[r][v]);
            }
            // Row r of M J_v.
            let mut projected = rows;
            for r in 0..R {
                projected[r] = l.mul(rows[0], l.splat(eight.projector[r][0][lane]));
                for s in 1..R {
                    projected[r] =
                        l.fma(rows[s], l.splat(eight.projector[r][s][lane]), projected[r]);
                }
            }
            for column in 0..(V * WIDTH).min(D) {
                let (cv, ci) = (column / WIDTH, column % WIDTH);
                if cv > v {
                    continue;
                }
                let target = &mut sum.reduced.columns[column][v];
                let mut total = l.load(target);
                for r in 0..R {
                    total = l.fma(projected[r], l.splat(jacobian[r][cv][ci]), total);
                }
                l.store(total, target);
            }
            for t in 0..T {
                let target = &mut sum.reduced.tails[t][v];
                let mut total = l.load(target);
                for r in 0..R {
                    total = l.fma(projected[r], l.splat(eight.tails[r][t][lane]), total);
                }
                l.store(total, target);
            }
            let mut diagonal = l.load(&sum.diagonal.rows[v]);
            let mut gradient = l.load(&sum.gradient.rows[v]);
            let mut reduced = l.load(&sum.reduced_gradient.rows[v]);
            for r in 0..R {
                let (plain, less) = (eight.residual[r][lane], eight.reduced_residual[r][lane]);
                diagonal = l.fma(rows[r], rows[r], diagonal);
                gradient = l.fma(rows[r], l.splat(plain), gradient);
                reduced = l.fma(rows[r], l.splat(less), reduced);
            }
            l.store(diagonal, &mut sum.diagonal.rows[v]);
            l.store(gradient, &mut sum.gradient.rows[v]);
            l.store(reduced, &mut sum.reduced_gradient.rows[v]);
        }
        for t in 0..T {
            for r in 0..R {
                let a = eight.tails[r][t][lane];
                for s in 0..R {
                    sum.reduced.corner[t][0] +=
                        a * eight.projector[r][s][lane] * eight.tails[s][t][lane];
                }
                sum.diagonal.tail[t][0] += a * a;
                sum.gradient.tail[t][0] += a * eight.residual[r][lane];
                sum.reduced_gradient.tail[t][0] += a * eight.reduced_residual[r][lane];
            }
        }
    }

    /// E of the observation in `slot`, number `i` of its track.
    #[inline(always)]
    fn eliminate<L: Lanes>(&mut self, l: L, i: usize, slot: usize) {
        let scratch = &mut self.sums.scratch;
        let (eight, lane) = (&scratch.eights[slot / WIDTH], slot % WIDTH);
        for m in 0..3 {
            for v in 0..V {
                let rows = &scratch.jacobian[slot];
                let mut e = l.mul(l.load(&rows[0][v]), l.splat(eight.landmark[0][m][lane]));
                for r in 1..R {
                    e = l.fma(l.load(&rows[r][v]), l.splat(eight.landmark[r][m][lane]), e);
                }
                l.store(e, &mut scratch.eliminated[i][m][v]);
            }
            if T > 0 {
                scratch.eliminated_tails[i][m] =
                    (0..R).map(|r| eight.tails[r][0][lane] * eight.landmark[r][m][lane]).sum();
            }
        }
    }

    /// Subtracts E_i E_jᵀ for the pairs of a track.
    #[inline(always)]
    fn add_pairs<L: Lanes>(&mut self, l: L, pairs: &ChunkPairs, k: usize, length: usize) {
        let sums = &mut *self.sums;
        let mut pair = pairs.starts[k - self.chunk.landmarks.start] as usize;
        let eliminated = &sums.scratch.eliminated[..length];
        let tails = &sums.scratch.eliminated_tails[..length];
        for (i, left) in eliminated.iter().enumerate() {
            if i >= MANY_PAIRS && self.interrupt.is_due() {
                return;
            }
            let row = &pairs.slot_of[pair..pair + i];
            pair += i;
            for ((&slot, right), right_tail) in row.iter().zip(eliminated).zip(tails) {
                if slot == NO_SLOT {
                    continue;
                }
                let target = &mut sums.pairs[slot as usize];
                for v in 0..V {
                    let e = [l.load(&left[0][v]), l.load(&left[1][v]), l.load(&left[2][v])];
                    for column in 0..D {
                        let (cv, ci) = (column / WIDTH, column % WIDTH);
                        let mut total = l.load(&target.columns[column][v]);
                        for m in 0..3 {
                            let x = if cv < V { right[m][cv][ci] } else { right_tail[m] };
                            total = l.fnma(e[m], l.splat(x), total);
                        }
                        l.store(total, &mut target.columns[column][v]);
                    }
                    for t in 0..T {
                        let mut total = l.load(&target.tails[t][v]);
                        for m in 0..3 {
                            total = l.fnma(l.load(&right[m][v]), l.splat(tails[i][m]), total);
                        }
                        l.store(total, &mut target.tails[t][v]);
                    }
                }
                for t in 0..T {
                    for m in 0..3 {
                        target.corner[t][0] -= tails[i][m] * right_tail[m];
                    }
                }
            }
        }
    }
}
