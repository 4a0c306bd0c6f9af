//! The features on images whose truth is known, since they are functions of continuous coordinates.

mod corners;
mod descriptor;

use super::splitmix::SplitMix64;
use crate::image::Image;

/// An image of a function of (u, v), rounded and clamped.
fn render(width: usize, height: usize, value: impl Fn(f64, f64) -> f64) -> Image<u8> {
    let mut image = Image::filled(width, height, 0);
    for v in 0..height {
        for (u, pixel) in image.row_mut(v).iter_mut().enumerate() {
            *pixel = value(u as f64, v as f64).round().clamp(0.0, 255.0) as u8;
        }
    }
    image
}

/// A texture of several scales, about 40 to 215, smooth over less than 2 px.
fn texture(seed: u64, u: f64, v: f64) -> f64 {
    let octave = |k: u64, size_px: f64| {
        let lattice = |i: f64, j: f64| {
            let key = seed ^ (k << 60) ^ ((i as i64 as u64) << 24) ^ (j as i64 as u64 & 0xff_ffff);
            (SplitMix64(key).bits() >> 40) as f64 / f64::from(1 << 24) - 0.5
        };
        let (x, y) = (u / size_px, v / size_px);
        let (i, j) = (x.floor(), y.floor());
        let ease = |t: f64| t * t * (3.0 - 2.0 * t);
        let (s, t) = (ease(x - i), ease(y - j));
        let above = (1.0 - s) * lattice(i, j) + s * lattice(i + 1.0, j);
        let below = (1.0 - s) * lattice(i, j + 1.0) + s * lattice(i + 1.0, j + 1.0);
        (1.0 - t) * above + t * below
    };
    128.0 + 90.0 * octave(1, 31.0) + 80.0 * octave(2, 13.0) + 70.0 * octave(3, 5.0)
}

/// About normal, with σ = 1.
fn normal(generator: &mut SplitMix64) -> f64 {
    (0..12).map(|_| (generator.bits() >> 44) as f64 / f64::from(1 << 20)).sum::<f64>() - 6.0
}
