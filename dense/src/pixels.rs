//! A frame as voxels read it: everything about a pixel in eight bytes.
//!
//! Bits, from the lowest: depth (16, 0 where there is none), its relative change from column to column
//! and from row to row (8 each, signed), red, green, blue (8 each), the ratio of the distance along the
//! surface's normal to that along the optical axis (7), and whether depth jumps nearby (1). Depth that
//! is NaN, out of range, or of something that moves counts as none. Knows no blocks and no pose.

use super::lanes::{Kernel, Lanes, WIDTH};
use super::tiles::{NOTHING, Range, TILE, join};
use super::visibility::NEAREST_M;
use crate::image::Image;

/// Rows that are packed at a time; a multiple of a tile's.
pub(super) const BAND: usize = 16;
/// Distance between depths that are compared for a slope, pixels: it keeps the noise of single pixels
/// small.
const BASELINE: usize = 4;
/// Columns of zeros at each side of a scratch row.
const MARGIN: usize = WIDTH;
/// Depth jumps where it changes by more than this share over the baseline.
const JUMP: f32 = 0.05;
/// Relative change of depth per pixel in one stored unit.
pub(super) const SLOPE_UNIT: f32 = 1e-4;
/// The stored value for a surface that faces the optical axis.
pub(super) const FACING_ONE: f32 = 96.0;
/// Units of depth: the largest depth has this many.
pub(super) const DEPTH_UNITS: f32 = 65_535.0;

/// The number of each lane.
const LANES: [f32; WIDTH] = [0., 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12., 13., 14., 15.];

/// The inputs from a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Source<'a> {
    pub(super) depth_m: &'a Image<f32>,
    pub(super) color: &'a Image<[u8; 3]>,
    /// Not 0 where something moves, dilated.
    pub(super) moving: Option<&'a Image<u8>>,
    pub(super) farthest_m: f32,
    /// Focal lengths and principal point, px; the lens' distortion is too small to matter here.
    pub(super) pinhole: [f32; 4],
}

/// Depth of a band, with the margins that slopes need.
#[derive(Clone, Debug)]
pub(super) struct Scratch {
    stride: usize,
    depth: Vec<f32>,
}

impl Scratch {
    /// For images this wide.
    pub(super) fn new(width: usize) -> Self {
        let stride = stride(width) + 2 * MARGIN;
        Self { stride, depth: vec![0.0; stride * (BAND + 2 * BASELINE)] }
    }

    /// Depth of a row of the band, meters, 0 where there is none.
    pub(super) fn row(&self, row: usize) -> &[f32] {
        &self.depth[(row + BASELINE) * self.stride + MARGIN..][..self.stride - 2 * MARGIN]
    }
}

/// Pixels from a row to the next, for images this wide.
pub(super) fn stride(width: usize) -> usize {
    width.next_multiple_of(WIDTH)
}

/// Packs rows from `first_row` on.
pub(super) struct PackBand<'a> {
    pub(super) source: Source<'a>,
    pub(super) first_row: usize,
    pub(super) scratch: &'a mut Scratch,
    /// Rows of [`stride`] pixels.
    pub(super) out: &'a mut [u64],
    /// Their tiles.
    pub(super) tiles: &'a mut [Range],
}

impl Kernel for PackBand<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self, lanes: L) {
        self.select_depth();
        let stride = stride(self.source.color.width());
        for row in 0..self.out.len() / stride {
            self.pack_row(lanes, row);
        }
        self.fill_tiles(lanes);
    }
}

impl PackBand<'_> {
    /// Copies the valid depth, with margins of zeros.
    #[inline(always)]
    fn select_depth(&mut self) {
        let Source { depth_m, moving, farthest_m, .. } = self.source;
        let (width, height) = depth_m.size();
        let rows = self.scratch.depth.chunks_exact_mut(self.scratch.stride);
        for (row, out) in rows.enumerate() {
            let v = (self.first_row + row).wrapping_sub(BASELINE);
            let out = &mut out[MARGIN..MARGIN + width];
            if v >= height {
                out.fill(0.0);
                continue;
            }
            for (out, &z) in out.iter_mut().zip(depth_m.row(v)) {
                *out = if z >= NEAREST_M && z <= farthest_m { z } else { 0.0 };
            }
            if let Some(moving) = moving {
                for (out, &moves) in out.iter_mut().zip(moving.row(v)) {
                    *out = if moves == 0 { *out } else { 0.0 };
                }
            }
        }
    }

    #[inline(always)]
    fn pack_row<L: Lanes>(&mut self, l: L, row: usize) {
        let Source { color, farthest_m, pinhole: [fx, fy, cx, cy], .. } = self.source;
        let width = color.width();
        let colors = color.row(self.first_row + row);
        let next_colors = color.row((self.first_row + row + 1).min(color.height() - 1));
        let stride = self.scratch.stride;
        let b = l.splat(((self.first_row + row) as f32 - cy) / fy);
        let lanes = l.load(&LANES);
        let out_stride = stride - 2 * MARGIN;
        let out = &mut self.out[row * out_stride..][..out_stride];
        for (chunk, out) in out.as_chunks_mut::<WIDTH>().0.iter_mut().enumerate() {
            let u = chunk * WIDTH;
            let at = (row + BASELINE) * stride + MARGIN + u;
            let depth = &self.scratch.depth;
            let z = load(l, depth, at);
            let small = l.splat(1e-3);
            let root = inverse_root(l, l.max(z, small));
            let inverse = l.mul(root, root);
            let jump = l.mul(z, l.splat(JUMP));
            let smooth = Smooth { z, inverse, jump };
            let (before, after) = (load(l, depth, at - BASELINE), load(l, depth, at + BASELINE));
            let (slope_u, jumps_u) = smooth.slope(l, before, after);
            let rows = BASELINE * stride;
            let (before, after) = (load(l, depth, at - rows), load(l, depth, at + rows));
            let (slope_v, jumps_v) = smooth.slope(l, before, after);
            // The normal of z(a, b) at (a, b, 1) z is (−z_a, −z_b, z + a z_a + b z_b) / z.
            let a = l.mul(l.add(l.splat(u as f32 - cx), lanes), l.splat(1.0 / fx));
            let (to_a, to_b) = (l.mul(slope_u, l.splat(fx)), l.mul(slope_v, l.splat(fy)));
            let along = l.fma(to_a, a, l.fma(to_b, b, l.splat(1.0)));
            let square = l.fma(to_a, to_a, l.fma(to_b, to_b, l.mul(along, along)));
            let facing = l.mul(l.splat(FACING_ONE), inverse_root(l, square));
            let facing = l.max_int(l.round(facing), l.splat_int(1));
            let facing = l.min_int(facing, l.splat_int(127));
            let jumps = l.either(jumps_u, jumps_v);
            let edge = l.select_int(jumps, l.splat_int(128), l.splat_int(0));
            let units = l.truncate(l.fma(z, l.splat(DEPTH_UNITS / farthest_m), l.splat(0.5)));
            let units = l.max_int(l.min_int(units, l.splat_int(65_535)), l.splat_int(1));
            let low = l.or_int(units, l.shift_up::<16>(slope_byte(l, slope_u)));
            let low = l.or_int(low, l.shift_up::<24>(slope_byte(l, slope_v)));
            let low = l.select_int(l.less(l.splat(0.0), z), low, l.splat_int(0));
            let color = if u + WIDTH <= width {
                l.prefetch(take(&next_colors[u..u + WIDTH]));
                l.load_colors(take(&colors[u..u + WIDTH]))
            } else {
                let mut rest = [[0; 3]; WIDTH];
                rest[..width - u].copy_from_slice(&colors[u..]);
                l.load_colors(&rest)
            };
            let high = l.or_int(color, l.shift_up::<24>(l.or_int(facing, edge)));
            l.store_pairs(low, high, out);
        }
    }

    #[inline(always)]
    fn fill_tiles<L: Lanes>(&mut self, l: L) {
        let stride = self.scratch.stride;
        let width = self.source.color.width().div_ceil(TILE);
        for (y, tiles) in self.tiles.chunks_exact_mut(width).enumerate() {
            for (x, tiles) in tiles.chunks_mut(WIDTH / TILE).enumerate() {
                let [mut nearest, mut farthest] = NOTHING.map(|z| l.splat(z));
                for row in 0..TILE {
                    // Rows below the image are zeros.
                    let at = (y * TILE + row + BASELINE) * stride + MARGIN + x * WIDTH;
                    let z = load(l, &self.scratch.depth, at);
                    let is_none = l.at_most(z, l.splat(0.0));
                    nearest = l.min(nearest, l.select(is_none, l.splat(NOTHING[0]), z));
                    farthest = l.max(farthest, z);
                }
                let mut lanes = [[0.0; WIDTH]; 2];
                l.store(nearest, &mut lanes[0]);
                l.store(farthest, &mut lanes[1]);
                for (i, tile) in tiles.iter_mut().enumerate() {
                    let columns = i * TILE..(i + 1) * TILE;
                    let pairs = columns.map(|k| [lanes[0][k], lanes[1][k]]);
                    *tile = pairs.fold(NOTHING, join);
                }
            }
        }
    }
}

/// 1 / √x of a positive number to a fifth of a percent: a guess by halving the exponent, and a step of
/// Newton's method.
#[inline(always)]
fn inverse_root<L: Lanes>(l: L, x: L::F) -> L::F {
    let guess = l.sub_int(l.splat_int(0x5f37_59df), l.shift_down::<1>(l.to_bits(x)));
    let guess = l.of_bits(guess);
    let half = l.mul(l.mul(x, l.splat(0.5)), guess);
    l.mul(guess, l.fnma(half, guess, l.splat(1.5)))
}

/// Depth at the pixels of a vector.
struct Smooth<L: Lanes> {
    z: L::F,
    inverse: L::F,
    /// The least change of depth at a discontinuity.
    jump: L::F,
}

impl<L: Lanes> Smooth<L> {
    /// Relative change of depth per pixel, from the side where it changes less, and whether depth jumps
    /// on either side.
    #[inline(always)]
    fn slope(&self, l: L, before: L::F, after: L::F) -> (L::F, L::M) {
        let (before, after) = (l.sub(self.z, before), l.sub(after, self.z));
        let least = l.less(l.abs(before), l.abs(after));
        let change = l.select(least, before, after);
        let smooth = l.less(l.abs(change), self.jump);
        let change = l.select(smooth, change, l.splat(0.0));
        let jumps = l.at_most(self.jump, l.max(l.abs(before), l.abs(after)));
        (l.mul(change, l.mul(self.inverse, l.splat(1.0 / BASELINE as f32))), jumps)
    }
}

/// A slope as it is stored.
#[inline(always)]
fn slope_byte<L: Lanes>(l: L, slope: L::F) -> L::I {
    let units = l.round(l.mul(slope, l.splat(1.0 / SLOPE_UNIT)));
    let units = l.max_int(l.min_int(units, l.splat_int(127)), l.splat_int(-127));
    l.and_int(units, l.splat_int(255))
}

/// Sixteen depths from `at` on.
#[inline(always)]
fn load<L: Lanes>(l: L, depth: &[f32], at: usize) -> L::F {
    l.load(take(&depth[at..at + WIDTH]))
}

/// The first elements of a slice as an array; `x` has at least that many.
#[inline(always)]
pub(super) fn take<T>(x: &[T]) -> &[T; WIDTH] {
    &x.as_chunks::<WIDTH>().0[0]
}

/// 255 within `by` pixels of what is not 0, along rows and columns: a moving object has soft edges and
/// depth shadows around it.
pub(super) fn dilated(mask: &Image<u8>, by: usize) -> Image<u8> {
    let (width, height) = mask.size();
    let mut wide = Image::filled(width, height, 0);
    for v in 0..height {
        let (row, out) = (mask.row(v), wide.row_mut(v));
        // Counts down the columns that are still within reach of the mask.
        let mut spread = |columns: &mut dyn Iterator<Item = usize>| {
            let mut left = 0;
            for u in columns {
                left = if row[u] > 0 { by + 1 } else { left };
                if left > 0 {
                    out[u] = 255;
                    left -= 1;
                }
            }
        };
        spread(&mut (0..width));
        spread(&mut (0..width).rev());
    }
    let mut tall = Image::filled(width, height, 0);
    for v in 0..height {
        let out = tall.row_mut(v);
        for row in v.saturating_sub(by)..(v + by + 1).min(height) {
            for (out, &value) in out.iter_mut().zip(wide.row(row)) {
                *out |= value;
            }
        }
    }
    tall
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_becomes_a_square() {
        let mut mask = Image::filled(12, 9, 0);
        mask.set(1, 1, 1);
        mask.set(9, 5, 255);
        let wide = dilated(&mask, 2);
        for v in 0..9_usize {
            for u in 0..12_usize {
                let near = |x: usize, y: usize| u.abs_diff(x) <= 2 && v.abs_diff(y) <= 2;
                let expected = if near(1, 1) || near(9, 5) { 255 } else { 0 };
                assert_eq!(wide.at(u, v), expected, "{u} {v}");
            }
        }
        let same = dilated(&mask, 0);
        assert!(same.pixels().iter().zip(mask.pixels()).all(|(a, b)| (*a > 0) == (*b > 0)));
    }
}
