//! Fuses a frame into the voxels of a block: sixteen at a time, two rows along x.
//!
//! A voxel is projected to its pixel, and measures the distance to the plane through the pixel's
//! surface point: (measured depth − own depth) / |n|, where n is the normal of depth as a function of
//! the ray. The distance is averaged by weight (Curless and Levoy, SIGGRAPH 1996), see `update`. Which
//! blocks are fused is decided by `integrate`.

use super::block::{Block, DISTANCE_ONE, WEIGHT_ONE};
use super::lanes::{Lanes, WIDTH};
use super::pixels::{DEPTH_UNITS, FACING_ONE, SLOPE_UNIT};
use super::tiles::Range;
use super::update::{FREE, Rules, Stored, VoxelMeasurements};
use super::visibility::{Lens, NEAREST_M};

/// Pairs of rows in a layer of a block.
const PAIRS: usize = 4;
/// Measurements have full weight up to this depth; beyond, it falls with the fourth power, as the
/// variance of depth rises.
const FULL_WEIGHT_M: f32 = 1.0;

/// The data of a frame that all blocks share.
#[derive(Clone, Debug)]
pub(super) struct Frame<'a> {
    pub(super) lens: Lens,
    /// Packed pixels, see `pixels`.
    pub(super) pixels: &'a [u64],
    /// Pixels from row to row.
    pub(super) stride: usize,
    /// From the first voxel of two rows to each of the sixteen, in the camera's axes; see
    /// [`Frame::steps`].
    pub(super) lanes: [[f32; WIDTH]; 3],
    /// The least and the greatest z of them, meters.
    pub(super) spread_m: [f32; 2],
    /// Steps from two rows to the next two, and from layer to layer.
    pub(super) pair: [f32; 3],
    pub(super) layer: [f32; 3],
    /// The depth of the largest unit, meters.
    pub(super) farthest_m: f32,
    pub(super) truncation_m: f32,
    /// Least weight of a measurement, as stored.
    pub(super) least_weight: f32,
    pub(super) rules: Rules,
}

/// How a frame changed a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Outcome {
    /// A distance or a weight changed.
    pub(super) changed: bool,
    /// Largest change of color, by [`Lanes::color_difference`]; 0 where anything else changed.
    pub(super) recolored: u32,
    /// Voxels at or behind a surface were written.
    pub(super) solid: bool,
    /// All voxels were seen and are free.
    pub(super) free: bool,
}

impl Frame<'_> {
    /// Converts a point, or a step, to what the kernel interpolates: for a pinhole (u z, v z, z), with
    /// half a pixel added to u and v so that truncation rounds; otherwise the point itself.
    pub(super) fn steps(lens: &Lens, [x, y, z]: [f32; 3]) -> [f32; 3] {
        if lens.is_pinhole {
            [lens.fx * x + (lens.cx + 0.5) * z, lens.fy * y + (lens.cy + 0.5) * z, z]
        } else {
            [x, y, z]
        }
    }

    /// Fuses the frame into a block whose first voxel is at `corner` (made by [`Frame::steps`]). Space
    /// nearer than the range, meters, is free, and beyond it nothing is seen.
    #[inline(always)]
    pub(super) fn fuse<L: Lanes>(
        &self,
        l: L,
        block: &mut Block,
        corner: [f32; 3],
        range: Range,
    ) -> Outcome {
        if self.lens.is_pinhole {
            self.fuse_as::<L, true>(l, block, corner, range)
        } else {
            self.fuse_as::<L, false>(l, block, corner, range)
        }
    }

    #[inline(always)]
    fn fuse_as<L: Lanes, const PINHOLE: bool>(
        &self,
        l: L,
        block: &mut Block,
        corner: [f32; 3],
        [nearest_m, farthest_m]: Range,
    ) -> Outcome {
        let mut outcome = Outcome { changed: false, recolored: 0, solid: false, free: true };
        let mut moved = l.splat_int(0);
        let lanes = [l.load(&self.lanes[0]), l.load(&self.lanes[1]), l.load(&self.lanes[2])];
        let distances = block.distances.as_chunks_mut::<WIDTH>().0;
        let weights = block.weights.as_chunks_mut::<WIDTH>().0;
        let colors = block.colors.as_chunks_mut::<WIDTH>().0;
        let rows = distances.iter_mut().zip(weights).zip(colors);
        for (row, ((distances, weights), colors)) in rows.enumerate() {
            let (layer, pair) = ((row / PAIRS) as f32, (row % PAIRS) as f32);
            let start = |k: usize| corner[k] + layer * self.layer[k] + pair * self.pair[k];
            let depth = start(2);
            if depth + self.spread_m[0] > farthest_m {
                outcome.free = false;
                continue;
            }
            let (old_distance, old_weight) = (l.load_i16(distances), l.load_u16(weights));
            let old = Stored { distance: l.float(old_distance), weight: l.float(old_weight) };
            if depth + self.spread_m[1] < nearest_m && old.is_free(l) {
                continue;
            }
            let p = l.add(l.splat(start(0)), lanes[0]);
            let q = l.add(l.splat(start(1)), lanes[1]);
            let z = l.add(l.splat(depth), lanes[2]);
            let per_z = l.div(l.splat(1.0), z);
            let (a, b) = (l.mul(p, per_z), l.mul(q, per_z));
            let mut seen = l.less(l.splat(NEAREST_M), z);
            let (u, v) = if PINHOLE { (a, b) } else { self.distort(l, a, b, &mut seen) };
            let (column, line) = (l.truncate(u), l.truncate(v));
            seen = l.both(seen, l.below_int(column, l.splat_int(self.lens.size[0] as i32)));
            seen = l.both(seen, l.below_int(line, l.splat_int(self.lens.size[1] as i32)));
            let index = l.add_int(l.mul_int(line, l.splat_int(self.stride as i32)), column);
            let (low, high) = l.gather(self.pixels, index, seen);
            let units = l.and_int(low, l.splat_int(0xffff));
            seen = l.both(seen, l.above_int(units, l.splat_int(0)));
            let depth = l.mul(l.float(units), l.splat(self.farthest_m / DEPTH_UNITS));
            // The plane at the voxel's own ray, not at the pixel's center.
            let half = l.splat(0.5);
            let du = l.sub(l.sub(u, l.float(column)), half);
            let dv = l.sub(l.sub(v, l.float(line)), half);
            let slope_u = l.float(l.shift_down_signed::<24>(l.shift_up::<8>(low)));
            let slope_v = l.float(l.shift_down_signed::<24>(low));
            let tilt = l.fma(slope_u, du, l.mul(slope_v, dv));
            let tilt = l.mul(tilt, l.splat(SLOPE_UNIT));
            let before = l.sub(l.fma(depth, tilt, depth), z);
            let behind = l.add(before, l.splat(self.truncation_m));
            seen = l.both(seen, l.less(l.splat(0.0), behind));
            if !l.any(seen) {
                outcome.free = false;
                continue;
            }
            let facing = l.float(l.and_int(l.shift_down::<24>(high), l.splat_int(127)));
            let facing = l.mul(facing, l.splat(1.0 / FACING_ONE));
            let scale = l.splat(DISTANCE_ONE / self.truncation_m);
            let far = l.mul(l.mul(before, scale), facing);
            let one = l.splat(DISTANCE_ONE);
            let distance = l.max(l.min(far, one), l.splat(-DISTANCE_ONE));

            let square = l.mul(l.splat(FULL_WEIGHT_M), per_z);
            let square = l.mul(square, square);
            let full = l.min(l.mul(square, square), l.splat(1.0));
            let oblique = l.min(l.mul(facing, facing), l.splat(1.0));
            let weight = l.mul(full, l.mul(oblique, l.splat(f32::from(WEIGHT_ONE))));
            let weight = l.float(l.round(l.max(weight, l.splat(self.least_weight))));

            let measured = VoxelMeasurements { seen, distance, weight, word: high, depth_m: depth };
            let new = self.rules.average_or_free(l, &measured, &old, colors, &mut moved);
            let (new_distance, new_weight) = (l.round(new.distance), l.round(new.weight));
            let changed = l.either(
                l.differ_int(new_distance, old_distance),
                l.differ_int(new_weight, old_weight),
            );
            if l.any(changed) {
                l.store_i16(new_distance, distances);
                l.store_u16(new_weight, weights);
                outcome.changed = true;
            }
            let solid = l.both(seen, l.less(new.distance, l.splat(FREE)));
            outcome.solid |= l.any(solid);
            outcome.free &= l.all(l.but_not(seen, solid));
        }
        if !outcome.changed {
            outcome.recolored = most(l, moved);
        }
        outcome
    }

    /// Projects x/z and y/z through the lens to pixels, with half a pixel added.
    #[inline(always)]
    fn distort<L: Lanes>(&self, l: L, a: L::F, b: L::F, seen: &mut L::M) -> (L::F, L::F) {
        let Lens { fx, fy, cx, cy, distortion, .. } = self.lens;
        let [k1, k2, k3, p1, p2] = distortion;
        let [k1, k2, k3] = [l.splat(k1), l.splat(k2), l.splat(k3)];
        let [p1, p2] = [l.splat(p1), l.splat(p2)];
        let (aa, bb, ab) = (l.mul(a, a), l.mul(b, b), l.mul(a, b));
        let ab = l.add(ab, ab);
        let r2 = l.add(aa, bb);
        *seen = l.both(*seen, l.less(r2, l.splat(self.lens.largest_tangent2)));
        let radial = l.fma(r2, l.fma(r2, l.fma(r2, k3, k2), k1), l.splat(1.0));
        let x = l.fma(p2, l.add(r2, l.add(aa, aa)), l.mul(p1, ab));
        let y = l.fma(p1, l.add(r2, l.add(bb, bb)), l.mul(p2, ab));
        let u = l.fma(l.fma(a, radial, x), l.splat(fx), l.splat(cx + 0.5));
        let v = l.fma(l.fma(b, radial, y), l.splat(fy), l.splat(cy + 0.5));
        (u, v)
    }
}

/// The largest of sixteen numbers, none of them negative and none above 2²².
#[inline(always)]
fn most<L: Lanes>(l: L, numbers: L::I) -> u32 {
    if !l.any(l.above_int(numbers, l.splat_int(0))) {
        return 0;
    }
    let mut out = [0.0; WIDTH];
    l.store(l.float(numbers), &mut out);
    out.into_iter().fold(0.0, f32::max) as u32
}
