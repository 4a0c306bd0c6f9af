//! The dynamic update: how a voxel handles a measurement that disagrees with its state.
//!
//! Disagreement is a distance that differs by more than the noise of depth and two voxels. Then
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
use super::fuse::{Frame, Measured, Stored, sigma_m};
use super::lanes::{Lanes, WIDTH};

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

/// The content of a voxel's fourth byte.
struct Memory<L: Lanes> {
    count: L::I,
    spread: L::I,
}

impl<L: Lanes> Memory<L> {
    #[inline(always)]
    fn of(l: L, word: L::I) -> Self {
        let spread = l.and_int(l.shift_down::<24>(word), l.splat_int(31));
        Self { count: l.shift_down::<29>(word), spread }
    }

    #[inline(always)]
    fn with_color(self, l: L, color: L::I) -> L::I {
        let byte = l.or_int(l.shift_up::<5>(self.count), self.spread);
        l.or_int(l.and_int(color, l.splat_int(0x00ff_ffff)), l.shift_up::<24>(byte))
    }
}

/// What voxels store after a measurement; `moved` grows to the largest color change.
#[inline(always)]
pub(super) fn update<L: Lanes>(
    l: L,
    frame: &Frame<'_>,
    new: &Measured<L>,
    old: &Stored<L>,
    colors: &mut [[u8; 4]; WIDTH],
    moved: &mut L::I,
) -> Stored<L> {
    let (zero, one) = (l.splat(0.0), l.splat(DISTANCE_ONE));
    let near = l.splat(frame.near);
    let is_edge = l.above_int(l.splat_int(0), new.word);
    let through = l.both(new.seen, l.at_most(one, new.distance));
    let mean = old.mean(l, new);
    // Free space gains little weight, but keeps the weight that the voxel has.
    let free_weight = l.mul(new.weight, l.splat(FREE_FRAMES));
    let free_weight = l.max(old.weight, l.min(mean.weight, free_weight));
    let mean_weight =
        l.select(through, free_weight, l.min(mean.weight, l.splat(frame.most_weight)));
    let known = l.both(new.seen, l.less(zero, old.weight));
    let gap = l.sub(new.distance, old.distance);

    let mut agrees = new.seen;
    let mut contests = l.but_not(new.seen, new.seen);
    let mut distance = mean.distance;
    let mut weight = mean_weight;
    if l.any(l.both(known, l.less(near, l.abs(gap)))) {
        let slack = l.max(near, l.mul(sigma_m(l, new.depth_m), l.splat(frame.slack)));
        let farther = l.less(slack, gap);
        let nearer = l.less(slack, l.sub(zero, gap));
        let hidden = l.less(new.distance, l.sub(zero, near));
        let was_free = l.less(l.splat(FREE), old.distance);
        let apart = l.both(known, l.either(farther, nearer));
        // Hidden voxels and edges do not disagree.
        let mute = l.either(is_edge, l.but_not(l.both(hidden, nearer), was_free));
        let disputes = l.but_not(apart, mute);
        agrees = l.but_not(new.seen, apart);
        contests = l.but_not(disputes, through);
        let carves = l.both(disputes, through);
        let left = l.float(l.truncate(l.mul(old.weight, l.splat(1.0 - LOSS))));
        let gone = l.less(left, l.add(new.weight, new.weight));
        distance = l.select(l.both(carves, gone), one, distance);
        weight = l.select(carves, l.select(gone, new.weight, left), weight);
        let stays = l.but_not(apart, carves);
        distance = l.select(l.either(stays, l.but_not(carves, gone)), old.distance, distance);
        weight = l.select(stays, old.weight, weight);
    }
    distance = l.select(new.seen, distance, old.distance);
    weight = l.select(new.seen, weight, old.weight);
    let within = l.but_not(new.seen, through);
    if !l.any(within) {
        return Stored { distance, weight };
    }

    let word = l.load_bytes(colors);
    let Memory { count, spread } = Memory::of(l, word);
    let is_near = l.at_most(l.abs(new.distance), near);
    let colors_now = l.both(agrees, is_near);
    let waits = l.both(within, l.above_int(count, l.splat_int(0)));
    if !l.any(l.either(l.either(colors_now, contests), waits)) {
        return Stored { distance, weight };
    }
    let change = l.shift_down::<3>(l.color_difference(word, new.word));
    let has_color = l.both(known, l.above_int(spread, l.splat_int(0)));
    let thrice = l.add_int(spread, l.add_int(spread, spread));
    let is_other = l.above_int(change, l.add_int(thrice, l.splat_int(COLOR_SLACK)));
    let recolors = l.but_not(l.both(l.both(colors_now, has_color), is_other), is_edge);
    let ticks = l.either(contests, recolors);
    let more = l.add_int(count, l.splat_int(1));
    let ripe = l.both(ticks, l.above_int(more, l.splat_int(PATIENCE - 1)));
    let begins = l.both(ripe, contests);
    let calm = l.but_not(l.both(agrees, within), recolors);
    let none = l.splat_int(0);
    let count = l.select_int(ticks, more, l.select_int(calm, none, count));
    let count = l.select_int(ripe, none, count);

    let first = l.but_not(colors_now, has_color);
    let fresh = l.either(first, l.both(ripe, l.either(recolors, is_near)));
    let blends = l.but_not(l.but_not(colors_now, recolors), fresh);
    let blend = frame.blend(l, word, new.word, mean.color_share);
    let color = l.select_int(fresh, new.word, l.select_int(blends, blend, word));
    let wider = l.min_int(l.add_int(spread, l.splat_int(2)), l.splat_int(31));
    let closer = l.max_int(l.sub_int(spread, l.splat_int(1)), l.splat_int(1));
    let follow = l.select_int(l.above_int(change, spread), wider, closer);
    let spread = l.select_int(blends, follow, l.select_int(begins, none, spread));
    let spread = l.select_int(fresh, l.splat_int(FIRST_SPREAD), spread);
    let next = Memory { count, spread }.with_color(l, color);
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
