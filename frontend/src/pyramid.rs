//! The image pyramid: each level has half the columns and rows of the one below it.
//!
//! A pixel (u, v) of level 0 lies at ((u + ½) / 2^l − ½, …) of level l, since integers are centers
//! of pixels. Intensities stay 8 bit; what is between pixels is interpolated. Knows neither cameras nor
//! what images show.

use super::image::Image;

/// An image and its halvings, finest first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pyramid {
    levels: Vec<Image<u8>>,
}

impl Pyramid {
    /// Halves an image `levels` − 1 times, or until a side would be shorter than 16 pixels.
    #[must_use]
    pub fn new(image: Image<u8>, levels: usize) -> Self {
        let mut all = vec![image];
        while all.len() < levels {
            let below = &all[all.len() - 1];
            if below.width() < 32 || below.height() < 32 {
                break;
            }
            let half = halved(below);
            all.push(half);
        }
        Self { levels: all }
    }

    /// How many levels there are; at least one.
    #[must_use]
    pub fn level_count(&self) -> usize {
        self.levels.len()
    }

    /// The image of a level, 0 the finest; the coarsest for levels beyond it.
    #[must_use]
    pub fn level(&self, level: usize) -> &Image<u8> {
        &self.levels[level.min(self.levels.len() - 1)]
    }
}

/// Where a coordinate of level 0 lies in a level.
#[must_use]
pub fn to_level(coordinate: f64, level: usize) -> f64 {
    (coordinate + 0.5) / scale(level) - 0.5
}

/// Pixels of level 0 along one of a level.
#[must_use]
pub fn scale(level: usize) -> f64 {
    (1_u64 << level) as f64
}

/// Each pixel the rounded mean of four.
fn halved(image: &Image<u8>) -> Image<u8> {
    let (width, height) = (image.width() / 2, image.height() / 2);
    let mut half = Image::filled(width, height, 0);
    for v in 0..height {
        let (upper, lower) = (image.row(2 * v), image.row(2 * v + 1));
        let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
        for (out, (a, b)) in half.row_mut(v).iter_mut().zip(pairs) {
            let sum = u16::from(a[0]) + u16::from(a[1]) + u16::from(b[0]) + u16::from(b[1]);
            *out = ((sum + 2) / 4) as u8;
        }
    }
    half
}
