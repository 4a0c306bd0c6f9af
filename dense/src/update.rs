//! What a measurement does to voxels: it is averaged in, unless it shows that the scene has changed.
//!
//! That is where a distance differs by more than the noise of depth and two voxels:
//!
//! - a voxel that is seen through loses three eighths of its weight per frame, and is free when little
//!   is left: removed objects vanish, and a single wrong pixel does no harm;
//! - a voxel with another distance, or a color outside its own variance, is reset after some frames in
//!   a row that disagree: nothing is averaged across a change;
//! - a hidden voxel keeps its state, unless it was free: then an object was put there.
//!
//! Near a depth discontinuity nothing counts as disagreement: edges of depth are noisy and shift. Free
//! space gets little weight. A voxel's fourth byte counts the frames that disagree (three bits) and
//! tracks how much its color varies (five bits, the 67th percentile of the difference by steps up and
//! down).

use super::block::DISTANCE_ONE;
use super::lanes::{Lanes, WIDTH};

/// Least share of the new color, in 1 / 256.
const LEAST_COLOR_SHARE: f32 = 16.0;
/// Beyond this distance, as stored, a voxel is free space and no part of a surface.
pub(super) const FREE: f32 = 0.75 * DISTANCE_ONE;
/// Largest weight that free space gains, in measurements.
const FREE_FRAMES: f32 = 4.0;
/// Share of its weight that a voxel loses when it is seen through.
const LOSS: f32 = 0.375;
/// A voxel is reset after this many frames in a row that disagree; at most 7.
const PATIENCE: i32 = 6;
/// Initial variation of a color, in eighths of the color difference.
const FIRST_SPREAD: i32 = 4;
/// A color has changed if it differs by more than three times the spread plus this, in eighths.
const COLOR_SLACK: i32 = 6;

/// Measurements of sixteen voxels.
pub(super) struct VoxelMeasurements<L: Lanes> {
    /// Which voxels were seen; the numbers of the others are undefined.
    pub(super) seen: L::M,
    /// As stored, clamped to one truncation on both sides.
    pub(super) distance: L::F,
    /// As stored, whole and not 0.
    pub(super) weight: L::F,
    /// Color in the three lower bytes; negative where depth jumps nearby.
    pub(super) word: L::I,
    /// Measured depth, meters.
    pub(super) depth_m: L::F,
}

/// What sixteen voxels store.
pub(super) struct Stored<L: Lanes> {
    pub(super) distance: L::F,
    pub(super) weight: L::F,
}

impl<L: Lanes> Stored<L> {
    /// Whether all of them are known to be free space.
    #[inline(always)]
    pub(super) fn is_free(&self, l: L) -> bool {
        let known = l.less(l.splat(0.0), self.weight);
        l.all(l.both(known, l.less(l.splat(FREE), self.distance)))
    }

    /// Weighted mean of old and new: distance, sum of both weights, and the share of the new color in
    /// 1 / 256.
    #[inline(always)]
    fn mean(&self, l: L, new: &VoxelMeasurements<L>) -> (L::F, L::F, L::I) {
        let weight = l.add(self.weight, new.weight);
        let share = l.div(new.weight, weight);
        let step = l.sub(new.distance, self.distance);
        let color_share = l.max(l.mul(share, l.splat(256.0)), l.splat(LEAST_COLOR_SHARE));
        (l.fma(step, share, self.distance), weight, l.round(color_share))
    }
}

/// How voxels are updated, the same for all of a frame.
#[derive(Clone, Debug)]
pub(super) struct Rules {
    /// Largest weight of a voxel, as stored.
    pub(super) most_weight: f32,
    /// Largest distance with color, as stored; a surface hides the voxels farther behind it.
    pub(super) near: f32,
    /// Distances disagree beyond this many standard deviations of depth, as stored for a meter.
    pub(super) slack: f32,
    /// A number of the frame, 0 to 255, that dithers the rounding of colors.
    pub(super) dither: i32,
}

impl Rules {
    /// Mixes two colors, `share` / 256 of the new one. The highest byte stays.
    #[inline(always)]
    fn blend<L: Lanes>(&self, l: L, old: L::I, new: L::I, share: L::I) -> L::I {
        let rest = l.sub_int(l.splat_int(256), share);
        // Red and blue together, and green alone: 16 bits per channel, which just hold the weighted
        // sums.
        let pick = l.splat_int(0x00ff_00ff);
        let dither = l.splat_int(self.dither * 0x0001_0001);
        let shares = [rest, share];
        let red_blue = [l.and_int(old, pick), l.and_int(new, pick)];
        let red_blue = mix(l, red_blue, shares, dither);
        let byte = l.splat_int(0xff);
        let old_green = l.and_int(l.shift_down::<8>(old), byte);
        let new_green = l.and_int(l.shift_down::<8>(new), byte);
        let green = mix(l, [old_green, new_green], shares, dither);
        let last = l.and_int(old, l.splat_int(0xff00_0000_u32.cast_signed()));
        l.or_int(last, l.or_int(red_blue, l.shift_up::<8>(green)))
    }

    /// What voxels store after a measurement, which may free them; `moved` grows to the largest color
    /// change.
    #[inline(always)]
    pub(super) fn average_or_free<L: Lanes>(
        &self,
        l: L,
        new: &VoxelMeasurements<L>,
        old: &Stored<L>,
        colors: &mut [[u8; 4]; WIDTH],
        moved: &mut L::I,
    ) -> Stored<L> {
        let (zero, one) = (l.splat(0.0), l.splat(DISTANCE_ONE));
        let near = l.splat(self.near);
        let is_edge = l.above_int(l.splat_int(0), new.word);
        let through = l.both(new.seen, l.at_most(one, new.distance));
        let (mut distance, mean_weight, color_share) = old.mean(l, new);
        // Free space gains little weight, but keeps the weight that the voxel has.
        let free_weight = l.mul(new.weight, l.splat(FREE_FRAMES));
        let free_weight = l.max(old.weight, l.min(mean_weight, free_weight));
        let mean_weight = l.min(mean_weight, l.splat(self.most_weight));
        let mut weight = l.select(through, free_weight, mean_weight);
        let known = l.both(new.seen, l.less(zero, old.weight));
        let gap = l.sub(new.distance, old.distance);

        let mut agrees = new.seen;
        let mut is_contested = l.but_not(new.seen, new.seen);
        if l.any(l.both(known, l.less(near, l.abs(gap)))) {
            let slack = l.max(near, l.mul(sigma_m(l, new.depth_m), l.splat(self.slack)));
            let farther = l.less(slack, gap);
            let nearer = l.less(slack, l.sub(zero, gap));
            let hidden = l.less(new.distance, l.sub(zero, near));
            let was_free = l.less(l.splat(FREE), old.distance);
            let differs = l.both(known, l.either(farther, nearer));
            // Hidden voxels and edges do not disagree.
            let is_ignored = l.either(is_edge, l.but_not(l.both(hidden, nearer), was_free));
            let disagrees = l.but_not(differs, is_ignored);
            agrees = l.but_not(new.seen, differs);
            is_contested = l.but_not(disagrees, through);
            let sees_through = l.both(disagrees, through);
            let left = l.float(l.truncate(l.mul(old.weight, l.splat(1.0 - LOSS))));
            let is_freed = l.less(left, l.add(new.weight, new.weight));
            distance = l.select(l.both(sees_through, is_freed), one, distance);
            weight = l.select(sees_through, l.select(is_freed, new.weight, left), weight);
            let stays = l.but_not(differs, sees_through);
            distance = l.select(
                l.either(stays, l.but_not(sees_through, is_freed)),
                old.distance,
                distance,
            );
            weight = l.select(stays, old.weight, weight);
        }
        distance = l.select(new.seen, distance, old.distance);
        weight = l.select(new.seen, weight, old.weight);
        let within = l.but_not(new.seen, through);
        if !l.any(within) {
            return Stored { distance, weight };
        }

        let word = l.load_bytes(colors);
        let count = l.shift_down::<29>(word);
        let spread = l.and_int(l.shift_down::<24>(word), l.splat_int(31));
        let is_near = l.at_most(l.abs(new.distance), near);
        let colors_now = l.both(agrees, is_near);
        let waits = l.both(within, l.above_int(count, l.splat_int(0)));
        if !l.any(l.either(l.either(colors_now, is_contested), waits)) {
            return Stored { distance, weight };
        }
        let change = l.shift_down::<3>(l.color_difference(word, new.word));
        let has_color = l.both(known, l.above_int(spread, l.splat_int(0)));
        let thrice = l.add_int(spread, l.add_int(spread, spread));
        let is_other = l.above_int(change, l.add_int(thrice, l.splat_int(COLOR_SLACK)));
        let recolors = l.but_not(l.both(l.both(colors_now, has_color), is_other), is_edge);
        let counts = l.either(is_contested, recolors);
        let more = l.add_int(count, l.splat_int(1));
        let is_replaced = l.both(counts, l.above_int(more, l.splat_int(PATIENCE - 1)));
        let begins = l.both(is_replaced, is_contested);
        let resets = l.but_not(l.both(agrees, within), recolors);
        let none = l.splat_int(0);
        let count = l.select_int(counts, more, l.select_int(resets, none, count));
        let count = l.select_int(is_replaced, none, count);

        let first = l.but_not(colors_now, has_color);
        let fresh = l.either(first, l.both(is_replaced, l.either(recolors, is_near)));
        let blends = l.but_not(l.but_not(colors_now, recolors), fresh);
        let blend = self.blend(l, word, new.word, color_share);
        let color = l.select_int(fresh, new.word, l.select_int(blends, blend, word));
        let wider = l.min_int(l.add_int(spread, l.splat_int(2)), l.splat_int(31));
        let closer = l.max_int(l.sub_int(spread, l.splat_int(1)), l.splat_int(1));
        let follow = l.select_int(l.above_int(change, spread), wider, closer);
        let spread = l.select_int(blends, follow, l.select_int(begins, none, spread));
        let spread = l.select_int(fresh, l.splat_int(FIRST_SPREAD), spread);
        let byte = l.or_int(l.shift_up::<5>(count), spread);
        let next = l.or_int(l.and_int(color, l.splat_int(0x00ff_ffff)), l.shift_up::<24>(byte));
        let next = l.select_int(within, next, word);
        if l.any(l.differ_int(next, word)) {
            l.store_bytes(next, colors);
            *moved = l.max_int(*moved, l.color_difference(next, word));
        }
        Stored {
            distance: l.select(begins, new.distance, distance),
            weight: l.select(begins, new.weight, weight),
        }
    }
}

/// Mixes two levels per lane, one in each half, which just holds the weighted sum; the shares of old
/// and new sum to 256.
#[inline(always)]
fn mix<L: Lanes>(l: L, [old, new]: [L::I; 2], [rest, share]: [L::I; 2], dither: L::I) -> L::I {
    let sum = l.add_int(l.mul_int(old, rest), l.mul_int(new, share));
    let level = l.shift_down::<8>(l.add_int(sum, dither));
    l.and_int(level, l.splat_int(0x00ff_00ff))
}

/// Standard deviation of depth, meters: see [`crate::depth::sigma_m`].
#[inline(always)]
pub(super) fn sigma_m<L: Lanes>(l: L, depth_m: L::F) -> L::F {
    let beyond = l.max(l.sub(depth_m, l.splat(0.4)), l.splat(0.0));
    l.fma(l.mul(beyond, beyond), l.splat(0.0019), l.splat(0.0012))
}
