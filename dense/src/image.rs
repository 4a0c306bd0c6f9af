//! Images: rows of pixels.
//!
//! A pixel is (u, v) = (column, row), an integer lies at its center. Knows nothing of cameras.

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
