//! FAST-9 corners (Rosten and Drummond, "Machine learning for high-speed corner detection", 2006),
//! at most one for each cell of a grid.
//!
//! A pixel of gray value c is a corner for threshold t if 9 neighbors in a row on a ring of 16 are
//! all brighter than c + t or all darker than c − t. Its strength is the largest difference that
//! all of such an arc reach: a corner for t is a pixel of strength > t. Weaker neighbors (3 × 3)
//! are dropped. What is left is ranked by the smaller eigenvalue of the gradient's second moments
//! (Shi and Tomasi, "Good features to track", 1994), since an alignment of patches needs texture in
//! both directions, which a high contrast alone does not promise.
//!
//! Must not depend on anything but the image: no state from frame to frame.

use crate::image::Image;

/// The ring of 16 pixels, as (du, dv), clockwise from above.
const RING: [(isize, isize); 16] = [
    (0, -3),
    (1, -3),
    (2, -2),
    (3, -1),
    (3, 0),
    (3, 1),
    (2, 2),
    (1, 3),
    (0, 3),
    (-1, 3),
    (-2, 2),
    (-3, 1),
    (-3, 0),
    (-3, -1),
    (-2, -2),
    (-1, -3),
];

/// Pixels in a row on the ring that make a corner.
const ARC: usize = 9;

/// Half the side of the window of the second moments.
const WINDOW: usize = 3;

/// The window's gradients read one pixel more; the ring, of radius 3, fits as well.
const SMALLEST_BORDER: usize = WINDOW + 1;

/// How corners are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CornerOptions {
    /// Gray values by which the arc differs from its center.
    pub threshold: u8,
    /// The same for cells in which `threshold` finds nothing.
    pub fallback_threshold: u8,
    /// Side of a cell in pixels; the first one begins at the first pixel. 0 counts as 1.
    pub cell_px: usize,
    /// Pixels at the image's rim without corners; at least 4 are.
    pub border_px: usize,
}

impl Default for CornerOptions {
    fn default() -> Self {
        Self { threshold: 20, fallback_threshold: 7, cell_px: 10, border_px: 16 }
    }
}

/// A corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Column.
    pub u: usize,
    /// Row.
    pub v: usize,
    /// Smaller eigenvalue of the mean of ∇I ∇Iᵀ over 7 × 7 pixels, (gray values / px)².
    pub score: f32,
}

/// The best corner of each cell that has one, cell by cell, row by row.
///
/// Only pixels for which `allowed(u, v)` holds are taken. It is asked once at most for each corner
/// that would otherwise be a candidate, so that it may be costly.
#[must_use]
pub fn detect(
    image: &Image<u8>,
    options: &CornerOptions,
    allowed: impl Fn(usize, usize) -> bool,
) -> Vec<Corner> {
    let (width, height) = image.size();
    let border = options.border_px.max(SMALLEST_BORDER);
    // Without overflow for any border: it is less than half of both sides.
    if border >= width.min(height).div_ceil(2) {
        return Vec::new();
    }
    let cell = options.cell_px.max(1);
    let columns = width.div_ceil(cell);
    let mut best: Vec<Option<Corner>> = vec![None; columns * height.div_ceil(cell)];
    let peaks = peaks(image, border, options.threshold.min(options.fallback_threshold));
    let is_strong = |peak: &&Peak| peak.strength > options.threshold;
    for peak in peaks.iter().filter(is_strong) {
        keep_better(&mut best[peak.v / cell * columns + peak.u / cell], image, peak, &allowed);
    }
    let found: Vec<bool> = best.iter().map(Option::is_some).collect();
    for peak in peaks.iter().filter(|peak| !is_strong(peak)) {
        let index = peak.v / cell * columns + peak.u / cell;
        if !found[index] {
            keep_better(&mut best[index], image, peak, &allowed);
        }
    }
    best.into_iter().flatten().collect()
}

/// A corner that no neighbor outshines.
struct Peak {
    u: usize,
    v: usize,
    strength: u8,
}

/// Of equal scores the first one stays.
fn keep_better(
    best: &mut Option<Corner>,
    image: &Image<u8>,
    peak: &Peak,
    allowed: impl Fn(usize, usize) -> bool,
) {
    let Peak { u, v, .. } = *peak;
    if allowed(u, v) {
        let score = smaller_eigenvalue(image, u, v);
        if best.is_none_or(|best| score > best.score) {
            *best = Some(Corner { u, v, score });
        }
    }
}

/// The peaks for a threshold, row by row; of equally strong neighbors the first is one.
fn peaks(image: &Image<u8>, border: usize, threshold: u8) -> Vec<Peak> {
    let (width, height) = image.size();
    let ring = RING.map(|(du, dv)| dv * width as isize + du);
    let mut strengths = Image::filled(width, height, 0_u8);
    let mut corners = Vec::new();
    let mut likely = vec![0; width - 2 * border];
    for v in border..height - border {
        mark_likely(image, v, border, threshold, &mut likely);
        // Most pixels are none: eight at a time are passed over.
        for (block, marks) in likely.chunks(8).enumerate() {
            if marks.iter().fold(0, |any, mark| any | mark) == 0 {
                continue;
            }
            for at in (0..marks.len()).filter(|&at| marks[at] != 0) {
                let u = border + 8 * block + at;
                let index = v * width + u;
                if !has_arc(image.pixels(), index, &ring, threshold) {
                    continue;
                }
                let strength = strength(image.pixels(), index, &ring);
                strengths.set(u, v, strength);
                corners.push(Peak { u, v, strength });
            }
        }
    }
    corners.retain(|&Peak { u, v, strength }| {
        let [above, row, below] = [v - 1, v, v + 1].map(|v| &strengths.row(v)[u - 1..=u + 1]);
        let before = [above[0], above[1], above[2], row[0]];
        let after = [row[2], below[0], below[1], below[2]];
        before.iter().all(|&s| s < strength) && after.iter().all(|&s| s <= strength)
    });
    corners
}

/// Marks the pixels (`start` + k, `v`) that can be corners: of each pair of opposite pixels on the
/// ring an arc of 9 has at least one, so that one of them must be brighter, in each pair, or darker.
/// Four pairs are tested, a row at a time and without branches, which is what makes it fast.
fn mark_likely(image: &Image<u8>, v: usize, start: usize, threshold: u8, likely: &mut [u8]) {
    let count = likely.len();
    let side = |index: usize| {
        let (du, dv) = RING[index];
        let row = image.row(v.wrapping_add_signed(dv));
        &row[start.wrapping_add_signed(du)..][..count]
    };
    let center = &image.row(v)[start..][..count];
    let [north, northeast, east, southeast] = [0, 2, 4, 6].map(side);
    let [south, southwest, west, northwest] = [8, 10, 12, 14].map(side);
    for k in 0..count {
        let high = center[k].saturating_add(threshold);
        let low = center[k].saturating_sub(threshold);
        let brighter = |a: &[u8], b: &[u8]| u8::from(a[k] > high) | u8::from(b[k] > high);
        let darker = |a: &[u8], b: &[u8]| u8::from(a[k] < low) | u8::from(b[k] < low);
        likely[k] = (brighter(north, south)
            & brighter(east, west)
            & brighter(northeast, southwest)
            & brighter(southeast, northwest))
            | (darker(north, south)
                & darker(east, west)
                & darker(northeast, southwest)
                & darker(southeast, northwest));
    }
}

/// Whether the strength exceeds the threshold, for less than the strength itself takes.
#[inline]
fn has_arc(pixels: &[u8], index: usize, ring: &[isize; 16], threshold: u8) -> bool {
    let center = pixels[index];
    let (high, low) = (center.saturating_add(threshold), center.saturating_sub(threshold));
    let (mut brighter, mut darker) = (0_u32, 0_u32);
    for k in 0..16 {
        let pixel = pixels[index.wrapping_add_signed(ring[k])];
        brighter |= u32::from(pixel > high) << k;
        darker |= u32::from(pixel < low) << k;
    }
    [brighter, darker].into_iter().any(|bits| {
        let twice = bits | bits << 16;
        // Bit k: 2, 4, 8, then 9 in a row from k on.
        let two = twice & twice >> 1;
        let four = two & two >> 2;
        four & four >> 4 & twice >> 8 != 0
    })
}

/// The largest difference that some 9 pixels in a row on the ring all reach, to the same side.
fn strength(pixels: &[u8], index: usize, ring: &[isize; 16]) -> u8 {
    let center = i16::from(pixels[index]);
    let mut difference = [0_i16; 16 + ARC - 1];
    for k in 0..16 {
        difference[k] = i16::from(pixels[index.wrapping_add_signed(ring[k])]) - center;
    }
    difference.copy_within(0..ARC - 1, 16);
    // Least and most of 2, 4, 8 in a row, each from the one before, then of 9.
    let (mut least, mut most) = (difference, difference);
    for step in [1, 2, 4] {
        for k in 0..difference.len() - step {
            least[k] = least[k].min(least[k + step]);
            most[k] = most[k].max(most[k + step]);
        }
    }
    let mut reached = 0;
    for k in 0..16 {
        let brighter = least[k].min(difference[k + 8]);
        let darker = -most[k].max(difference[k + 8]);
        reached = reached.max(brighter).max(darker);
    }
    reached.clamp(0, 255) as u8
}

/// The smaller eigenvalue of the mean of ∇I ∇Iᵀ in the window, by central differences.
fn smaller_eigenvalue(image: &Image<u8>, u: usize, v: usize) -> f32 {
    const SIDE: usize = 2 * WINDOW + 1;
    let (mut uu, mut uv, mut vv) = (0_i32, 0_i32, 0_i32);
    for row in v - WINDOW..=v + WINDOW {
        let part = |row: usize, from: usize| &image.row(row)[from - WINDOW..][..SIDE];
        let (left, right) = (part(row, u - 1), part(row, u + 1));
        let (above, below) = (part(row - 1, u), part(row + 1, u));
        for k in 0..SIDE {
            let du = i32::from(right[k]) - i32::from(left[k]);
            let dv = i32::from(below[k]) - i32::from(above[k]);
            uu += du * du;
            uv += du * dv;
            vv += dv * dv;
        }
    }
    let [uu, uv, vv] = [uu, uv, vv].map(|sum| sum as f32);
    // A central difference is over two pixels.
    let scale = 1.0 / (4 * SIDE * SIDE) as f32;
    0.5 * scale * (uu + vv - ((uu - vv) * (uu - vv) + 4.0 * uv * uv).sqrt()).max(0.0)
}
