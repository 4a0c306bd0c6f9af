//! From light and depth to what a Kinect delivers, noise and gaps included, or to both as they are.
//!
//! Depth: deviation 0.0012 + 0.0019 (z − 0.4)² m (Nguyen, Izadi and Lovell, 3DIMPVT 2012), then the
//! steps of the disparity, an eighth of a pixel; none nearer than 0.4 m, farther than 4.5 m, at grazing
//! angles, and in patches along edges. Color: gray levels of deviation 2. The noise of a pixel is a
//! hash of seed, frame and pixel. The truth of poses and masks is not changed.

use rayon::prelude::*;

use super::material::Albedo;
use super::random;
use super::render::Surface;
use super::scene::Exposure;
use crate::image::Image;

/// What is measured, m.
const RANGE_M: (f32, f32) = (0.4, 4.5);
/// Focal length times baseline, px m.
const DISPARITY_PX_M: f32 = 525.0 * 0.075;
/// Disparities are multiples of one over this, px.
const STEPS_PER_PX: f32 = 8.0;
/// Of each color channel: the luma of three that are independent has deviation 2.
const CHANNEL_DEVIATION: f32 = 3.0;
/// Units of a depth image a meter, as it is written: noisy depth is rounded to them.
pub(super) const UNITS_PER_M: f32 = 5000.0;
/// Below this cosine there is no depth, and up to the second there are gaps.
const GRAZING: (f32, f32) = (0.12, 0.25);
/// An edge: depth changes by more than this share within two pixels.
const EDGE: f32 = 0.05;

/// The random numbers of one frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameNoise {
    stream: u64,
}

impl FrameNoise {
    pub(super) fn new(seed: u64, frame: usize) -> Self {
        Self { stream: random::number(!seed, frame as u64) }
    }

    fn bits(&self, kind: u64, pixel: usize) -> u64 {
        random::number(self.stream ^ kind, pixel as u64)
    }

    fn uniform(&self, kind: u64, pixel: usize) -> f64 {
        random::uniform(self.bits(kind, pixel))
    }
}

/// Light to gray levels.
pub(super) fn color(
    light: &Image<Albedo>,
    exposure: Exposure,
    noise: Option<FrameNoise>,
) -> Image<[u8; 3]> {
    let (width, height) = light.size();
    let mut image = Image::filled(width, height, [0; 3]);
    let rows = image.pixels_mut().par_chunks_mut(width).enumerate();
    rows.for_each(|(v, row)| {
        for (u, (pixel, light)) in row.iter_mut().zip(light.row(v)).enumerate() {
            let error = noise.map_or([0.0; 3], |noise| {
                let [a, b] = random::normal_pair(noise.bits(1, v * width + u));
                let [c, _] = random::normal_pair(noise.bits(2, v * width + u));
                [a, b, c].map(|number| CHANNEL_DEVIATION * number)
            });
            *pixel = std::array::from_fn(|channel| {
                let level = 255.0 * exposure.gain * light[channel] + exposure.offset;
                nearest(level + error[channel]).min(255) as u8
            });
        }
    });
    image
}

/// Depth, m; exact without noise.
pub(super) fn depth(surfaces: &Image<Surface>, noise: Option<FrameNoise>) -> Image<f32> {
    let Some(noise) = noise else { return surfaces.map(|surface| surface.depth_m) };
    let (width, height) = surfaces.size();
    let mut image = Image::filled(width, height, 0.0);
    let rows = image.pixels_mut().par_chunks_mut(width).enumerate();
    rows.for_each(|(v, row)| {
        for (u, pixel) in row.iter_mut().enumerate() {
            *pixel = measured(surfaces, u, v, noise);
        }
    });
    image
}

fn measured(surfaces: &Image<Surface>, u: usize, v: usize, noise: FrameNoise) -> f32 {
    let (width, height) = surfaces.size();
    let index = v * width + u;
    let Surface { depth_m: z, cosine, .. } = surfaces.at(u, v);
    if z < RANGE_M.0 || z > RANGE_M.1 || cosine < GRAZING.0 {
        return 0.0;
    }
    let jumps = |u: usize, v: usize| {
        let other = surfaces.at(u.min(width - 1), v.min(height - 1)).depth_m;
        (other - z).abs() > EDGE * z
    };
    let at_edge = jumps(u + 2, v)
        || jumps(u, v + 2)
        || jumps(u.saturating_sub(2), v)
        || jumps(u, v.saturating_sub(2));
    // Gaps come in patches of three pixels, and now and then alone.
    let patch = noise.uniform(3, (v / 3) * width + u / 3);
    let gap = (at_edge && patch < 0.5) || (cosine < GRAZING.1 && patch < 0.4);
    if gap || noise.uniform(4, index) < 0.002 {
        return 0.0;
    }
    let [error, _] = random::normal_pair(noise.bits(5, index));
    let noisy = z + error * (0.0012 + 0.0019 * (z - 0.4) * (z - 0.4));
    let disparity = nearest(STEPS_PER_PX * DISPARITY_PX_M / noisy) as f32 / STEPS_PER_PX;
    f32::from(to_units(DISPARITY_PX_M / disparity)) / UNITS_PER_M
}

/// The number that stands for a depth in a file.
pub(super) fn to_units(depth_m: f32) -> u16 {
    u16::try_from(nearest(depth_m * UNITS_PER_M)).unwrap_or(u16::MAX)
}

/// The nearest whole number, 0 for what is negative. `f32::round` is a call, this is not.
#[inline]
fn nearest(x: f32) -> u32 {
    (x + 0.5) as u32
}
