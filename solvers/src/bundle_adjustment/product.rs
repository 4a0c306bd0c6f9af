//! The reduced camera system times a vector, without the system.
//!
//! S p = Σ J_vᵀ (J_v p_v − J_l (L Lᵀ)⁻¹ Σ J_lᵀ J_v p_v) over the observations of each landmark, with
//! Jacobians computed anew: for hundreds of cameras that is fewer bytes than reading S would be, and
//! the pairs of views need never be known (Agarwal et al., "Bundle adjustment in the large", 2010).
//! A chunk sums into its own views; the sums are added in the chunks' order. The landmarks' factors are
//! those of the last fused pass at the same state and damping; it makes none.

use crate::interrupt::Interrupt;
use crate::simd::{Lanes, Line, WIDTH};

use super::back_substitute::along;
use super::blocks::ViewVector;
use super::landmarks::{LandmarkGroup, Rows};
use super::layout::Layout;
use super::observe::{Consumer, Inputs, Linearized, LinearizingKernel, eight_indices, linearize};
use super::sorted::{Chunk, GROUPS};

/// What a chunk adds to a product, and its tile.
#[derive(Clone, Debug)]
pub(super) struct ProductSums<const D: usize, const V: usize, const T: usize, const R: usize> {
    /// By the chunk's own numbers of views.
    pub(super) views: Vec<ViewVector<V, T>>,
    eights: Vec<Eight<D, R>>,
    /// J_lᵀ J_v p_v, then (L Lᵀ)⁻¹ of its sum.
    rows: Rows<1>,
}

/// Eight observations of a tile.
#[derive(Clone, Copy, Debug)]
struct Eight<const D: usize, const R: usize> {
    /// J_v by rows.
    jacobian: [[Line; D]; R],
    /// J_l by rows.
    landmark: [[Line; 3]; R],
    /// J_v p_v.
    along: [Line; R],
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> ProductSums<D, V, T, R> {
    /// Bytes of an observation of the longest tile.
    pub(super) const OBSERVATION_BYTES: usize =
        size_of::<Eight<D, R>>().div_ceil(WIDTH) + size_of::<[Line; 1]>();

    pub(super) fn new(layout: &Layout, chunk: &Chunk) -> Self {
        let room = layout.sorted.longest_tile + 2 * WIDTH;
        let zero = Eight {
            jacobian: [[Line::ZERO; D]; R],
            landmark: [[Line::ZERO; 3]; R],
            along: [Line::ZERO; R],
        };
        Self {
            views: vec![ViewVector::ZERO; chunk.views.len()],
            eights: vec![zero; room.div_ceil(WIDTH)],
            rows: Rows::new(room),
        }
    }
}

/// The product of one chunk.
pub(super) struct Product<'a, const D: usize, const V: usize, const T: usize, const R: usize> {
    pub(super) inputs: Inputs<'a>,
    pub(super) layout: &'a Layout,
    pub(super) chunk: &'a Chunk,
    /// [`GROUPS`] for each tile of the chunk.
    pub(super) groups: &'a [LandmarkGroup],
    /// p_v of each view, zero where constant.
    pub(super) vectors: &'a [ViewVector<V, T>],
    pub(super) sums: &'a mut ProductSums<D, V, T, R>,
    /// Asked after each tile.
    pub(super) interrupt: &'a Interrupt,
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> LinearizingKernel
    for Product<'_, D, V, T, R>
{
    const COLUMNS: usize = D;
    const ROWS: usize = R;
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes, const SPECIAL: bool>(self, l: L) {
        let Self { inputs, layout, chunk, groups, vectors, sums, interrupt } = self;
        let sorted = inputs.sorted;
        sums.views.fill(ViewVector::ZERO);
        for (t, tile) in layout.tiles(chunk) {
            if interrupt.is_due() {
                return;
            }
            let first = tile.observations.start;
            let eights = sums.eights.iter_mut();
            for (o, eight) in tile.observations.clone().step_by(WIDTH).zip(eights) {
                let views = eight_indices(&sorted.views, o);
                let rows = &mut sums.rows;
                let tile =
                    StoreProduct::<D, V, T, R> { vectors, views, eight, slot: o - first, rows };
                linearize::<L, _, D, R, SPECIAL>(l, &inputs, o, tile);
            }
            sums.rows.sum(l, sorted, &tile);
            let groups = &groups[(t - chunk.tiles.start) * GROUPS..];
            for (g, group) in groups[..GROUPS].iter().enumerate() {
                if g * WIDTH >= tile.landmarks.len() {
                    break;
                }
                let [x, y, z, ..] = sums.rows.lanes(l, g, 0);
                let [x, y, z] = group.solve(l, [x, y, z]);
                let zero = l.splat(0.0);
                sums.rows.set_lanes(l, g, 0, [x, y, z, zero, zero, zero, zero, zero]);
            }
            let eights = sums.eights.iter();
            for (o, eight) in tile.observations.clone().step_by(WIDTH).zip(eights) {
                let [x, y, z, ..] = sums.rows.gather(l, sorted, &tile, o, 0);
                let rest = eight.rest(l, [x, y, z]);
                let lanes = (tile.observations.end - o).min(WIDTH);
                eight.scatter(l, rest, &sorted.locals[o..o + lanes], &mut sums.views);
            }
        }
    }
}

/// Stores Jacobians and J_v p_v of eight observations in the tile, from `slot` on.
struct StoreProduct<'a, const D: usize, const V: usize, const T: usize, const R: usize> {
    vectors: &'a [ViewVector<V, T>],
    views: &'a [u32; WIDTH],
    eight: &'a mut Eight<D, R>,
    slot: usize,
    rows: &'a mut Rows<1>,
}

impl<L: Lanes, const D: usize, const V: usize, const T: usize, const R: usize> Consumer<L, R>
    for StoreProduct<'_, D, V, T, R>
{
    #[inline(always)]
    fn consume(self, l: L, lin: &Linearized<L, R>) {
        let along = along::<L, D, V, T, R>(l, lin, self.vectors, self.views);
        self.eight.set(l, lin, along);
        self.rows.put(l, self.slot, 0, lin.onto_landmark(l, along));
    }
}

impl<const D: usize, const R: usize> Eight<D, R> {
    #[inline(always)]
    fn set<L: Lanes>(&mut self, l: L, lin: &Linearized<L, R>, along: [L::V; R]) {
        for r in 0..R {
            for c in 0..D {
                l.store(lin.column(l, r, c, D), &mut self.jacobian[r][c]);
            }
            for c in 0..3 {
                l.store(lin.landmark[r][c], &mut self.landmark[r][c]);
            }
            l.store(along[r], &mut self.along[r]);
        }
    }

    /// J_v p_v − J_l x.
    #[inline(always)]
    fn rest<L: Lanes>(&self, l: L, x: [L::V; 3]) -> [L::V; R] {
        let mut rest = [l.splat(0.0); R];
        for r in 0..R {
            rest[r] = l.load(&self.along[r]);
            for c in 0..3 {
                rest[r] = l.fnma(l.load(&self.landmark[r][c]), x[c], rest[r]);
            }
        }
        rest
    }

    /// Adds J_vᵀ `rest` to the views of up to eight observations.
    #[inline(always)]
    fn scatter<L: Lanes, const V: usize, const T: usize>(
        &self,
        l: L,
        rest: [L::V; R],
        locals: &[u32],
        views: &mut [ViewVector<V, T>],
    ) {
        for v in 0..V {
            let mut columns = [l.splat(0.0); WIDTH];
            for (i, column) in columns.iter_mut().enumerate() {
                if v * WIDTH + i < D {
                    *column = self.column(l, v * WIDTH + i, rest);
                }
            }
            for (&local, row) in locals.iter().zip(l.transpose(columns)) {
                let target = &mut views[local as usize].rows[v];
                l.store(l.add(l.load(target), row), target);
            }
        }
        for t in 0..T {
            let mut row = [0.0; WIDTH];
            l.store(self.column(l, V * WIDTH + t, rest), &mut row);
            for (&local, x) in locals.iter().zip(row) {
                views[local as usize].tail[t][0] += x;
            }
        }
    }

    /// Column `i` of J_vᵀ times `rest`.
    #[inline(always)]
    fn column<L: Lanes>(&self, l: L, i: usize, rest: [L::V; R]) -> L::V {
        let mut sum = l.mul(l.load(&self.jacobian[0][i]), rest[0]);
        for r in 1..R {
            sum = l.fma(l.load(&self.jacobian[r][i]), rest[r], sum);
        }
        sum
    }
}
