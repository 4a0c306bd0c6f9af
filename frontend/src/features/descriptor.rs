//! A binary descriptor that turns with the image, after ORB (Rublee, Rabaud, Konolige and Bradski,
//! "ORB: an efficient alternative to SIFT or SURF", 2011).
//!
//! 256 pairs of pixels around a point are compared in a smoothed image, one bit each (BRIEF,
//! Calonder et al. 2010), after the pairs were turned by the patch's orientation: the direction from
//! its center to its intensity centroid, (m10, m01) = Σ (x, y) I(x, y) over a disk.
//!
//! A depth camera knows how far a point is, so the patch has one size in the world instead of one in the
//! image: its radius is 0.114 m, from 15 px to 60 px. What comes nearer looks the same, and a patch of 15 px
//! that shows little is no more than noise. The sizes are quarters of octaves of an image pyramid.
//!
//! Descriptors are kept in maps and compared with those of later versions. So the pairs come from a
//! generator of our own, and all that decides a bit is computed in integers: the bits of a point do
//! not depend on platform, version or compiler. They must not change.

use std::cell::OnceCell;
use std::f64::consts::{SQRT_2, TAU};
use std::sync::OnceLock;

use super::splitmix::SplitMix64;
use crate::image::Image;
use crate::pyramid::{Pyramid, to_level};

/// Bits of a descriptor.
const BITS: usize = 256;

/// Radius in pixels of the smallest disk that is looked at.
const RADIUS: i32 = 15;

/// The radius in the world, m.
const RADIUS_M: f64 = 0.114;

/// Sizes of an octave.
const SIZES: usize = 4;

/// The largest size: two octaves above the smallest.
const LARGEST: usize = 2 * SIZES;

/// Directions that an orientation is rounded to: 11.25° apart, ORB has 12°.
const DIRECTIONS: usize = 32;

/// σ of the points of a pair in pixels: a fifth of the patch's side, as BRIEF found best.
const SPREAD: f64 = 6.2;

/// Weights of the smoothing, a Gaussian of σ = 2 px; they sum to 256.
const SMOOTHING: [u16; 7] = [18, 34, 49, 54, 49, 34, 18];

/// 256 bits; bit k is bit k mod 64 of word k / 64.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Descriptor(pub [u64; 4]);

impl Descriptor {
    /// The words one after the other, little-endian: bit k is bit k mod 8 of byte k / 8.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; 32] {
        let mut bytes = [0; 32];
        for (bytes, word) in bytes.chunks_exact_mut(8).zip(self.0) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        bytes
    }
}

/// How large the patch around a point is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size(usize);

impl Size {
    /// A radius of 15 px.
    #[cfg(test)]
    pub(super) const SMALLEST: Self = Self(0);

    /// The size of what is `z_m` meters away, for a focal length in pixels. A negative depth and
    /// one that is not a number have the smallest.
    #[must_use]
    pub fn at(z_m: f64, focal_px: f64) -> Self {
        let scale = focal_px * RADIUS_M / (z_m * f64::from(RADIUS));
        // Half a size from one to the next: by square roots, which all platforms compute alike.
        let (size, half) = (SQRT_2.sqrt(), SQRT_2.sqrt().sqrt());
        let mut bound = half;
        let mut nearest = 0;
        while nearest < LARGEST && scale > bound {
            bound *= size;
            nearest += 1;
        }
        Self(nearest)
    }
}

/// Describes points of one image.
pub struct Describer<'a> {
    pyramid: &'a Pyramid,
    /// Octaves, in 1/256 of a gray value: what is nearly flat still has an order.
    smoothed: [OnceCell<Image<u16>>; LARGEST / SIZES + 1],
}

impl<'a> Describer<'a> {
    /// A describer of the points of an image. A level is smoothed once for all of them.
    #[must_use]
    pub fn new(pyramid: &'a Pyramid) -> Self {
        Self { pyramid, smoothed: Default::default() }
    }

    /// The descriptor of the pixel nearest to (u, v); `None` where the patch leaves the image, or where
    /// a coordinate is not finite.
    #[must_use]
    pub fn describe(&self, u: f32, v: f32, size: Size) -> Option<Descriptor> {
        let octave = size.0 / SIZES;
        if octave >= self.pyramid.level_count() {
            return None;
        }
        let smoothed = self.smoothed.get(octave)?;
        let smoothed = smoothed.get_or_init(|| smooth(self.pyramid.level(octave)));
        let table = &tables()[size.0 % SIZES];
        let radius = table.half_widths.len() / 2;
        let inside = |at: f32, size: usize| {
            let nearest = to_level(f64::from(at), octave).round();
            // A comparison with NaN is false.
            let fits = nearest >= radius as f64 && nearest + radius as f64 <= size as f64 - 1.0;
            fits.then_some(nearest as usize)
        };
        let (width, height) = smoothed.size();
        let (u, v) = (inside(u, width)?, inside(v, height)?);

        let pairs = &table.pairs[direction(smoothed, table, u, v)];
        let patch = &smoothed.pixels()[(v - radius) * width + u - radius..];
        let at = |x: u8, y: u8| patch[usize::from(y) * width + usize::from(x)];
        let mut words = [0; 4];
        for (word, pairs) in words.iter_mut().zip(pairs.chunks_exact(64)) {
            for (bit, &[x1, y1, x2, y2]) in pairs.iter().enumerate() {
                *word |= u64::from(at(x1, y1) < at(x2, y2)) << bit;
            }
        }
        Some(Descriptor(words))
    }
}

/// Index of the direction nearest to the intensity centroid's; 0 where it has none.
fn direction(smoothed: &Image<u16>, table: &Table, u: usize, v: usize) -> usize {
    let radius = table.half_widths.len() / 2;
    let (mut m10, mut m01) = (0_i64, 0_i64);
    for (row, &half) in table.half_widths.iter().enumerate() {
        let pixels = &smoothed.row(v + row - radius)[u - half..=u + half];
        let (mut sum, mut moment) = (0_i32, 0_i32);
        for (column, &pixel) in pixels.iter().enumerate() {
            sum += i32::from(pixel);
            moment += i32::from(pixel) * column as i32;
        }
        m10 += i64::from(moment - half as i32 * sum);
        m01 += i64::from(sum * (row as i32 - radius as i32));
    }
    let mut best = (0, i64::MIN);
    for (index, [cos, sin]) in table.directions.iter().enumerate() {
        let along = m10 * cos + m01 * sin;
        if along > best.1 {
            best = (index, along);
        }
    }
    best.0
}

/// What is the same for all patches of a size.
struct Table {
    /// (cos, sin) of each direction in units of 2^-20.
    directions: Vec<[i64; 2]>,
    /// Of each direction: x, y of the first and the second pixel of a pair, from the corner of the
    /// patch, all within the disk.
    pairs: Vec<Vec<[u8; 4]>>,
    /// Half the width of each row of the disk.
    half_widths: Vec<usize>,
}

/// The table of each size of an octave.
fn tables() -> &'static [Table] {
    static TABLES: OnceLock<Vec<Table>> = OnceLock::new();
    TABLES.get_or_init(|| {
        let upright = upright_pairs();
        let size = SQRT_2.sqrt();
        let scales = std::iter::successors(Some(1.0), |scale| Some(scale * size));
        scales.take(SIZES).map(|scale| table(&upright, scale)).collect()
    })
}

/// The table of the size that is `scale` times the smallest.
fn table(upright: &[[f64; 4]], scale: f64) -> Table {
    let radius = (scale * f64::from(RADIUS)).round() as i32;
    let units = |index: usize| (TAU * index as f64 / DIRECTIONS as f64).sin_cos();
    let turned = |index: usize| {
        let (sin, cos) = units(index);
        let turn = |x: f64, y: f64| {
            let (x, y) = (scale * x, scale * y);
            let rounded = |value: f64| (value.round() as i32 + radius).clamp(0, 2 * radius) as u8;
            [rounded(cos * x - sin * y), rounded(sin * x + cos * y)]
        };
        let turn_pair = |&[x1, y1, x2, y2]: &[f64; 4]| {
            let ([x1, y1], [x2, y2]) = (turn(x1, y1), turn(x2, y2));
            [x1, y1, x2, y2]
        };
        upright.iter().map(turn_pair).collect()
    };
    let fixed = |index: usize| {
        let (sin, cos) = units(index);
        [cos, sin].map(|value| (value * f64::from(1 << 20)).round() as i64)
    };
    let half_width = |y: i32| f64::from(radius * radius - y * y).sqrt() as usize;
    Table {
        directions: (0..DIRECTIONS).map(fixed).collect(),
        pairs: (0..DIRECTIONS).map(turned).collect(),
        half_widths: (-radius..=radius).map(half_width).collect(),
    }
}

/// The pairs (x1, y1, x2, y2) for an orientation along +x: both points normal around the center,
/// inside the disk, and not too near to each other to differ by more than noise. They differ more
/// across the orientation than along it: along it a patch is brighter ahead by definition, so that
/// such a comparison says little, and straight edges would all look the same.
fn upright_pairs() -> Vec<[f64; 4]> {
    const NEAREST: f64 = 4.0;
    let mut generator = SplitMix64(0x0c0f_fee5);
    // Nearly normal, by a sum of 12 uniform numbers, whose variance is 1; no logarithm, which
    // platforms compute differently.
    let mut normal = || {
        let uniform = |bits: u64| (bits >> 11) as f64 / (1_u64 << 53) as f64;
        (0..12).map(|_| uniform(generator.bits())).sum::<f64>() - 6.0
    };
    let mut pairs = Vec::with_capacity(BITS);
    while pairs.len() < BITS {
        let pair = [(); 4].map(|()| SPREAD * normal());
        let [x1, y1, x2, y2] = pair;
        // Half a pixel less than the radius, so that a turned and rounded point is inside.
        let reach = f64::from(RADIUS) - 0.5;
        let inside = x1 * x1 + y1 * y1 <= reach * reach && x2 * x2 + y2 * y2 <= reach * reach;
        let apart = (x1 - x2) * (x1 - x2) + (y1 - y2) * (y1 - y2) >= NEAREST * NEAREST;
        let across = (y1 - y2).abs() > (x1 - x2).abs();
        if inside && apart && across {
            pairs.push(pair);
        }
    }
    pairs
}

/// Smooths rows, then columns. Outside the image the border pixels are repeated.
fn smooth(image: &Image<u8>) -> Image<u16> {
    const REACH: usize = SMOOTHING.len() / 2;
    let (width, height) = image.size();
    if width == 0 || height == 0 {
        return Image::default();
    }
    // Sums of a row, 256 times the mean: 255 · 256 fits.
    let mut sums = vec![0_u16; width * height];
    let mut padded = vec![0_u8; width + 2 * REACH];
    for (v, sums) in sums.chunks_exact_mut(width).enumerate() {
        let row = image.row(v);
        padded[..REACH].fill(row[0]);
        padded[REACH..REACH + width].copy_from_slice(row);
        padded[REACH + width..].fill(row[width - 1]);
        let [a, b, c, d, e, f, g] = [0, 1, 2, 3, 4, 5, 6].map(|k| &padded[k..k + width]);
        for u in 0..width {
            let pair =
                |weight: u16, x: &[u8], y: &[u8]| weight * (u16::from(x[u]) + u16::from(y[u]));
            sums[u] = pair(SMOOTHING[0], a, g)
                + pair(SMOOTHING[1], b, f)
                + pair(SMOOTHING[2], c, e)
                + SMOOTHING[3] * u16::from(d[u]);
        }
    }
    let mut smoothed = Image::filled(width, height, 0);
    for v in 0..height {
        let row = |offset: usize| {
            let v = (v + offset).saturating_sub(REACH).min(height - 1);
            &sums[v * width..][..width]
        };
        let [a, b, c, d, e, f, g] = [0, 1, 2, 3, 4, 5, 6].map(row);
        let out = &mut smoothed.row_mut(v)[..width];
        for u in 0..width {
            let pair = |weight: u16, x: &[u16], y: &[u16]| {
                u32::from(weight) * (u32::from(x[u]) + u32::from(y[u]))
            };
            let sum = pair(SMOOTHING[0], a, g)
                + pair(SMOOTHING[1], b, f)
                + pair(SMOOTHING[2], c, e)
                + u32::from(SMOOTHING[3]) * u32::from(d[u]);
            out[u] = ((sum + (1 << 7)) >> 8) as u16;
        }
    }
    smoothed
}
