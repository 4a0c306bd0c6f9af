//! Landmark blocks with a lane a landmark: sums over tracks, Cholesky factors, steps.
//!
//! Observations are handled with a lane each. Between them and the lanes of landmarks stand
//! [`Rows`]: a row an observation or a landmark, turned by transposing, summed in the order of the
//! track. What eight landmarks leave behind is a [`LandmarkGroup`]. Knows neither views nor cameras.

use std::ops::Range;

use crate::optimizer::SCALE_RANGE;
use crate::simd::{Lanes, Line, WIDTH};

use super::observe::{Linearized, eight_indices};
use super::sorted::{GROUPS, Sorted, Tile};

/// Most landmarks of a tile.
const LANDMARKS: usize = GROUPS * WIDTH;

/// What eight landmarks leave behind for the step. Where a landmark is held fixed, or a lane has
/// none, the inverted diagonal is zero, and so is every step.
#[derive(Clone, Copy, Debug)]
pub(super) struct LandmarkGroup {
    /// L by rows, its diagonal inverted: 1/l00, l10, 1/l11, l20, l21, 1/l22.
    factor: [Line; 6],
    /// g_l.
    pub(super) gradient: [Line; 3],
    /// D.
    pub(super) scale: [Line; 3],
}

impl LandmarkGroup {
    pub(super) const ZERO: Self =
        Self { factor: [Line::ZERO; 6], gradient: [Line::ZERO; 3], scale: [Line::ZERO; 3] };

    /// (L Lᵀ)⁻¹ b.
    #[inline(always)]
    pub(super) fn solve<L: Lanes>(&self, l: L, b: [L::V; 3]) -> [L::V; 3] {
        let mut factor = [l.splat(0.0); 6];
        for (entry, line) in factor.iter_mut().zip(&self.factor) {
            *entry = l.load(line);
        }
        let [i00, l10, i11, l20, l21, i22] = factor;
        let x = l.mul(b[0], i00);
        let y = l.mul(l.fnma(l10, x, b[1]), i11);
        let z = l.mul(l.fnma(l21, y, l.fnma(l20, x, b[2])), i22);
        let z = l.mul(z, i22);
        let y = l.mul(l.fnma(l21, z, y), i11);
        let x = l.mul(l.fnma(l20, z, l.fnma(l10, y, x)), i00);
        [x, y, z]
    }
}

/// N lines for each landmark of a tile, and one for each of its observations to sum them from.
#[derive(Clone, Debug)]
pub(super) struct Rows<const N: usize> {
    observations: Vec<[Line; N]>,
    landmarks: [[Line; N]; LANDMARKS],
}

impl<const N: usize> Rows<N> {
    /// For tiles of at most `room` − 8 observations.
    pub(super) fn new(room: usize) -> Self {
        let zero = [Line::ZERO; N];
        Self { observations: vec![zero; room], landmarks: [zero; LANDMARKS] }
    }

    /// Sets line `n` of the observations from `slot` on; lane by lane.
    #[inline(always)]
    pub(super) fn put<L: Lanes>(&mut self, l: L, slot: usize, n: usize, values: [L::V; WIDTH]) {
        let rows = l.transpose(values);
        for (line, row) in self.observations[slot..slot + WIDTH].iter_mut().zip(rows) {
            l.store(row, &mut line[n]);
        }
    }

    /// Sums each landmark's observations.
    #[inline(always)]
    pub(super) fn sum<L: Lanes>(&mut self, l: L, sorted: &Sorted, tile: &Tile) {
        let first = tile.observations.start;
        for (sum, k) in self.landmarks.iter_mut().zip(tile.landmarks.clone()) {
            let track = sorted.track(k);
            let mut total = [l.splat(0.0); N];
            for row in &self.observations[track.start - first..track.end - first] {
                for n in 0..N {
                    total[n] = l.add(total[n], l.load(&row[n]));
                }
            }
            for n in 0..N {
                l.store(total[n], &mut sum[n]);
            }
        }
    }

    /// The lines of a tile's landmarks.
    pub(super) fn of(&self, tile: &Tile) -> &[[Line; N]] {
        &self.landmarks[..tile.landmarks.len()]
    }

    /// Line `n` of eight landmarks, a lane each.
    #[inline(always)]
    pub(super) fn lanes<L: Lanes>(&self, l: L, group: usize, n: usize) -> [L::V; WIDTH] {
        let mut rows = [l.splat(0.0); WIDTH];
        for (row, lines) in rows.iter_mut().zip(&self.landmarks[group * WIDTH..]) {
            *row = l.load(&lines[n]);
        }
        l.transpose(rows)
    }

    /// Sets line `n` of eight landmarks, from a lane each.
    #[inline(always)]
    pub(super) fn set_lanes<L: Lanes>(
        &mut self,
        l: L,
        group: usize,
        n: usize,
        values: [L::V; WIDTH],
    ) {
        let rows = l.transpose(values);
        for (lines, row) in self.landmarks[group * WIDTH..].iter_mut().zip(rows) {
            l.store(row, &mut lines[n]);
        }
    }

    /// Line `n` of the landmarks that the eight observations from `first` on see, a lane each.
    #[inline(always)]
    pub(super) fn gather<L: Lanes>(
        &self,
        l: L,
        sorted: &Sorted,
        tile: &Tile,
        first: usize,
        n: usize,
    ) -> [L::V; WIDTH] {
        let base = tile.landmarks.start;
        let mut rows = [l.splat(0.0); WIDTH];
        for (row, &position) in rows.iter_mut().zip(eight_indices(&sorted.positions, first)) {
            // Lanes past the tile's end read any row; what they compute is not used.
            let j = (position as usize - base).min(LANDMARKS - 1);
            *row = l.load(&self.landmarks[j][n]);
        }
        l.transpose(rows)
    }
}

/// The landmarks of a tile while it is eliminated: first H_ll and g_l, then L and y = L⁻¹ g_l.
#[derive(Clone, Debug)]
pub(super) struct TileLandmarks {
    rows: Rows<2>,
}

impl TileLandmarks {
    pub(super) fn new(room: usize) -> Self {
        Self { rows: Rows::new(room) }
    }

    /// Takes eight observations' share of H_ll (00, 10, 11, 20, 21, 22) and of g_l, at `slot`.
    #[inline(always)]
    pub(super) fn observe<L: Lanes, const R: usize>(
        &mut self,
        l: L,
        lin: &Linearized<L, R>,
        slot: usize,
    ) {
        let zero = l.splat(0.0);
        let (mut products, mut last) = ([zero; WIDTH], [zero; WIDTH]);
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
        self.rows.put(l, slot, 0, products);
        self.rows.put(l, slot, 1, last);
    }

    /// Factors the landmarks of a tile into `out`, with `damping`; returns the largest scaled
    /// gradient entry and whether all are positive definite.
    #[inline(always)]
    pub(super) fn factor<L: Lanes>(
        &mut self,
        l: L,
        sorted: &Sorted,
        tile: &Tile,
        damping: f64,
        out: &mut [LandmarkGroup],
    ) -> (f64, bool) {
        self.rows.sum(l, sorted, tile);
        let (mut norm, mut fine) = (0.0, true);
        for (g, out) in out.iter_mut().enumerate() {
            let begin = tile.landmarks.start + g * WIDTH;
            if begin >= tile.landmarks.end {
                break;
            }
            let lanes = begin..tile.landmarks.end.min(begin + WIDTH);
            let (group_norm, group_fine) = self.factor_group(l, sorted, lanes, g, damping, out);
            norm = f64::max(norm, group_norm);
            fine &= group_fine;
        }
        (norm, fine)
    }

    #[inline(always)]
    fn factor_group<L: Lanes>(
        &mut self,
        l: L,
        sorted: &Sorted,
        landmarks: Range<usize>,
        group: usize,
        damping: f64,
        out: &mut LandmarkGroup,
    ) -> (f64, bool) {
        let mut moves = [0.0; WIDTH];
        for (moves, constant) in moves.iter_mut().zip(&sorted.constant[landmarks]) {
            *moves = if *constant { 0.0 } else { 1.0 };
        }
        let mask = l.load(&moves);
        let [h00, h10, h11, h20, h21, h22, g0, g1] = self.rows.lanes(l, group, 0);
        let [g2, ..] = self.rows.lanes(l, group, 1);
        let (low, high) = (l.splat(SCALE_RANGE.0), l.splat(SCALE_RANGE.1));
        let mut scale = [h00, h11, h22];
        for scale in &mut scale {
            *scale = l.max(l.min(*scale, high), low);
        }
        let (zero, one, damping) = (l.splat(0.0), l.splat(1.0), l.splat(damping));
        let i00 = l.div(one, l.sqrt(l.fma(damping, scale[0], h00)));
        let l10 = l.mul(h10, i00);
        let l20 = l.mul(h20, i00);
        let d1 = l.fnma(l10, l10, l.fma(damping, scale[1], h11));
        let i11 = l.div(one, l.sqrt(d1));
        let l21 = l.mul(l.fnma(l20, l10, h21), i11);
        let d2 = l.fnma(l20, l20, l.fma(damping, scale[2], h22));
        let i22 = l.div(one, l.sqrt(l.fnma(l21, l21, d2)));
        let mut check = [0.0; WIDTH];
        // A pivot that is not positive leaves an infinity or no number here.
        l.store(l.mul(l.mul(i00, i11), i22), &mut check);
        let mut fine = true;
        for (check, moves) in check.iter().zip(&moves) {
            fine &= *moves == 0.0 || (check.is_finite() && *check > 0.0);
        }
        let y0 = l.mul(g0, i00);
        let y1 = l.mul(l.fnma(l10, y0, g1), i11);
        let y2 = l.mul(l.fnma(l21, y1, l.fnma(l20, y0, g2)), i22);
        let mut values = [i00, l10, i11, l20, l21, i22, y0, y1, y2];
        let mut gradient = [g0, g1, g2];
        for value in values.iter_mut().chain(&mut gradient) {
            *value = masked(l, mask, *value);
        }
        let mut norm = zero;
        for i in 0..3 {
            l.store(gradient[i], &mut out.gradient[i]);
            l.store(scale[i], &mut out.scale[i]);
            let size = l.max(gradient[i], l.sub(zero, gradient[i]));
            norm = l.max(l.div(size, l.sqrt(scale[i])), norm);
        }
        for i in 0..6 {
            l.store(values[i], &mut out.factor[i]);
        }
        let [a, b, c, d, e, f, x, y, z] = values;
        self.rows.set_lanes(l, group, 0, [a, b, c, d, e, f, x, y]);
        self.rows.set_lanes(l, group, 1, [z, zero, zero, zero, zero, zero, zero, zero]);
        l.store(norm, &mut check);
        (check.iter().fold(0.0, |a, b| f64::max(a, *b)), fine)
    }

    /// L and y of the landmarks that the eight observations from `first` on see.
    #[inline(always)]
    pub(super) fn factors<L: Lanes>(
        &self,
        l: L,
        sorted: &Sorted,
        tile: &Tile,
        first: usize,
    ) -> ([L::V; 6], [L::V; 3]) {
        let [a, b, c, d, e, f, x, y] = self.rows.gather(l, sorted, tile, first, 0);
        let [z, ..] = self.rows.gather(l, sorted, tile, first, 1);
        ([a, b, c, d, e, f], [x, y, z])
    }
}

/// `value` where the mask is 1, 0 where it is 0, whatever the value is.
#[inline(always)]
fn masked<L: Lanes>(l: L, mask: L::V, value: L::V) -> L::V {
    l.select(mask, value, l.splat(0.0))
}
