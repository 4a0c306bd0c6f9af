//! Images: rows of pixels, and a frame of a camera that sees depth.
//!
//! A pixel is (u, v) = (column, row), an integer lies at its center. Knows nothing of cameras.

use super::simd::{self, Kernel};

/// An image with one value a pixel, row by row.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct Image<T> {
    width: usize,
    height: usize,
    pixels: Vec<T>,
}

impl<T: Copy> Image<T> {
    /// An image of one value.
    #[must_use]
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, pixels: vec![value; width * height] }
    }

    /// An image of these pixels, row by row; `None` where they are not width × height.
    #[must_use]
    pub fn from_pixels(width: usize, height: usize, pixels: Vec<T>) -> Option<Self> {
        (width.checked_mul(height) == Some(pixels.len())).then_some(Self { width, height, pixels })
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Columns and rows.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// All pixels, row by row.
    #[must_use]
    pub fn pixels(&self) -> &[T] {
        &self.pixels
    }

    /// All pixels, row by row.
    pub fn pixels_mut(&mut self) -> &mut [T] {
        &mut self.pixels
    }

    /// The pixels of row `v`.
    #[must_use]
    pub fn row(&self, v: usize) -> &[T] {
        &self.pixels[v * self.width..(v + 1) * self.width]
    }

    /// The pixels of row `v`.
    pub fn row_mut(&mut self, v: usize) -> &mut [T] {
        &mut self.pixels[v * self.width..(v + 1) * self.width]
    }

    /// The pixel in column `u` of row `v`.
    #[must_use]
    pub fn at(&self, u: usize, v: usize) -> T {
        self.pixels[v * self.width + u]
    }

    /// Sets the pixel in column `u` of row `v`.
    pub fn set(&mut self, u: usize, v: usize, value: T) {
        self.pixels[v * self.width + u] = value;
    }

    /// Each pixel through a function.
    #[must_use]
    pub fn map<U: Copy>(&self, f: impl Fn(T) -> U) -> Image<U> {
        let pixels = self.pixels.iter().map(|&pixel| f(pixel)).collect();
        Image { width: self.width, height: self.height, pixels }
    }
}

/// What a camera that sees color and depth delivers at one time. Both images have one size and show
/// the same rays, lens distortion included.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdFrame {
    /// Middle of the exposure, seconds of the camera's clock.
    pub timestamp_s: f64,
    /// How much later the depth was taken than the color, seconds.
    pub depth_delay_s: f64,
    /// Red, green, blue.
    pub color: Image<[u8; 3]>,
    /// Distance along the optical axis (z, not the range), in meters; 0 where none was measured.
    pub depth_m: Image<f32>,
}

impl RgbdFrame {
    /// Luma of the color (ITU-R BT.601), rounded.
    #[must_use]
    pub fn gray(&self) -> Image<u8> {
        let (width, height) = self.color.size();
        let mut gray = Image::filled(width, height, 0);
        simd::run(Luma { color: self.color.pixels(), gray: gray.pixels_mut() });
        gray
    }
}

struct Luma<'a> {
    color: &'a [[u8; 3]],
    gray: &'a mut [u8],
}

impl Kernel for Luma<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (gray, &[r, g, b]) in self.gray.iter_mut().zip(self.color) {
            // In 16-bit fixed point; the weights sum to 2^16.
            let sum = 19_595 * u32::from(r) + 38_470 * u32::from(g) + 7_471 * u32::from(b);
            *gray = ((sum + 32_768) >> 16) as u8;
        }
    }
}
