//! What one earlier frame, a witness, says of each cell of the current frame: that space was free there, or that
//! the same surface, or another one, was there.
//!
//! Cells are looked up one by one and judged many at a time, field by field. Which frames are asked, and how much
//! each of them counts, is decided in `history`.

use covis_solvers::geometry::Se3;

use super::gaussian::CellView;
use super::history::Current;
use super::warp::{CellPositions, CellWarp, Exposure};
use crate::depth::sigma_m;
use crate::image::Image;
use crate::simd::{self, Kernel};

/// How far behind a point free space must reach, meters.
const FREE_M: f32 = 0.05;
/// The same, relative to its depth.
const FREE_SHARE: f32 = 0.03;
/// A mean this far outside the range around a place is another surface, gray levels.
const OTHER_GRAY: f32 = 15.0;
/// Votes of a witness that saw free space; one that saw the same surface has one vote.
const FREE_VOTES: f32 = 2.0;

/// The ranges of depth and gray level within one cell of each, because edges of depth and of color
/// differ. In whole millimeters and gray levels, because every keyframe keeps them, and in two words, because
/// those are looked up one by one and then taken apart many at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Around {
    /// Least depth, 0 where too little was measured; from bit 16 on the largest depth. Millimeters.
    pub(super) depths: u32,
    /// Least mean; from bit 8 on the largest mean; bit 16 where something moved there.
    pub(super) grays: u32,
}

impl Around {
    #[inline(always)]
    fn nearest_mm(self) -> f32 {
        number(self.depths & 0xffff)
    }

    #[inline(always)]
    fn farthest_mm(self) -> f32 {
        number(self.depths >> 16)
    }

    #[inline(always)]
    fn darkest(self) -> f32 {
        number(self.grays & 0xff)
    }

    #[inline(always)]
    fn brightest(self) -> f32 {
        number(self.grays >> 8 & 0xff)
    }

    #[inline(always)]
    fn is_moving(self) -> bool {
        self.grays >> 16 != 0
    }
}

/// A number below 2³¹; vectors of older processors have only signed ones.
#[inline(always)]
fn number(small: u32) -> f32 {
    small as i32 as f32
}

/// The cells of the current frame and the votes on them, field by field: loops over many take these at once.
pub(super) struct Tally {
    mean: Vec<f32>,
    depth_m: Vec<f32>,
    is_saturated: Vec<bool>,
    pub(super) moves: Vec<f32>,
    pub(super) stands: Vec<f32>,
}

impl Tally {
    pub(super) fn of(cells: &Image<CellView>) -> Self {
        let cells = cells.pixels();
        Self {
            mean: cells.iter().map(|cell| cell.mean).collect(),
            depth_m: cells.iter().map(|cell| cell.depth_m).collect(),
            is_saturated: cells.iter().map(CellView::is_saturated).collect(),
            moves: vec![0.0; cells.len()],
            stands: vec![0.0; cells.len()],
        }
    }
}

/// An earlier frame that votes on the current one.
pub(super) struct Witness<'a> {
    pub(super) around: &'a Image<Around>,
    /// witness_from_current, between the cameras.
    pub(super) motion: Se3,
    /// From its gray levels to the current ones; `None` where they cannot be compared.
    pub(super) exposure: Option<Exposure>,
    pub(super) other_votes: f32,
    pub(super) same_votes: f32,
}

impl Witness<'_> {
    /// Adds its votes on each cell.
    pub(super) fn testify(&self, current: &Current<'_>, tally: &mut Tally) {
        let warp = CellWarp::new(current.camera, current.rays, &self.motion);
        let positions = warp.positions(tally.depth_m.iter().copied());
        simd::run(Testimony { witness: self, positions: &positions, tally });
    }
}

/// Adds the votes of a witness on all cells.
struct Testimony<'a> {
    witness: &'a Witness<'a>,
    positions: &'a CellPositions,
    tally: &'a mut Tally,
}

/// Cells that are looked up before votes are computed: they fit into the nearest cache.
const BLOCK: usize = 128;

impl Kernel for Testimony<'_> {
    type Output = ();

    /// Finds the cells of a block, then looks up what the witness saw there, then computes the votes without
    /// branches.
    #[inline(always)]
    fn run(self) {
        let Self { witness, positions, tally } = self;
        let seen = witness.around.pixels();
        let (width, height) = witness.around.size();
        let (right, bottom, columns) = (width as f32, height as f32, width as i32);
        let exposure = witness.exposure.unwrap_or(Exposure::SAME);
        let is_incomparable = witness.exposure.is_none();
        let (other_votes, same_votes) = (witness.other_votes, witness.same_votes);
        let mut indices = [0_i32; BLOCK];
        let (mut depths, mut grays) = ([0_u32; BLOCK], [0_u32; BLOCK]);
        for start in (0..tally.mean.len()).step_by(BLOCK) {
            let end = tally.mean.len().min(start + BLOCK);
            let count = end - start;
            let (x, y) = (&positions.x[start..end], &positions.y[start..end]);
            let expected_m = &positions.depth_m[start..end];
            let (mean, depth_m) = (&tally.mean[start..end], &tally.depth_m[start..end]);
            let is_saturated = &tally.is_saturated[start..end];
            let moves = &mut tally.moves[start..end];
            let stands = &mut tally.stands[start..end];
            for i in 0..count {
                let (x, y) = (x[i] + 0.5, y[i] + 0.5);
                let is_inside = (x >= 0.0) & (y >= 0.0) & (x < right) & (y < bottom);
                let index = simd::floor(y) * columns + simd::floor(x);
                indices[i] = if is_inside { index } else { -1 };
            }
            for i in 0..count {
                let around = seen.get(indices[i] as usize).copied().unwrap_or_default();
                (depths[i], grays[i]) = (around.depths, around.grays);
            }
            for i in 0..count {
                let around = Around { depths: depths[i], grays: grays[i] };
                let cell = Cell {
                    mean: mean[i],
                    is_measured: depth_m[i] > 0.0,
                    is_incomparable: is_saturated[i] | is_incomparable,
                };
                let look = look(around, &cell, expected_m[i], &exposure);
                let other = if look.is_other { other_votes } else { 0.0 };
                moves[i] += if look.is_free { FREE_VOTES } else { other };
                let is_static = look.is_same & !around.is_moving();
                stands[i] += if is_static { same_votes } else { 0.0 };
            }
        }
    }
}

/// A cell of the current frame.
struct Cell {
    mean: f32,
    is_measured: bool,
    /// Whether its gray level says nothing.
    is_incomparable: bool,
}

/// What a witness saw at the place of a cell; all false where that is unclear.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Look {
    is_free: bool,
    is_same: bool,
    is_other: bool,
}

/// Compares a cell with what a witness saw around its place; `expected_m` is the depth that it had
/// there if it stood still.
#[inline(always)]
fn look(around: Around, cell: &Cell, expected_m: f32, exposure: &Exposure) -> Look {
    /// From this mean gray level on, part of a cell may be saturated.
    const BRIGHT: f32 = 245.0;
    let (nearest_m, farthest_m) = (around.nearest_mm() * 1e-3, around.farthest_mm() * 1e-3);
    let (darkest, brightest) = (around.darkest(), around.brightest());
    let is_known = (nearest_m > 0.0) & cell.is_measured;
    let sigma_m = sigma_m(f64::from(expected_m)) as f32;
    let margin_m = FREE_M + FREE_SHARE * expected_m + 3.0 * sigma_m;
    let is_free = is_known & (nearest_m > expected_m + margin_m);
    let is_there =
        is_known & (expected_m <= farthest_m + margin_m) & (expected_m >= nearest_m - margin_m);
    let limit = |gray: f32| OTHER_GRAY + exposure.sigma(gray);
    let is_alike = cell.is_incomparable
        | (brightest >= BRIGHT)
        | (cell.mean > exposure.apply(darkest) - limit(darkest))
            & (cell.mean < exposure.apply(brightest) + limit(brightest));
    Look { is_free, is_same: is_there & is_alike, is_other: is_there & !is_alike }
}
