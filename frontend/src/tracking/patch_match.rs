//! Where a patch of a keyframe lies in the current image (the paper's equations 5 to 7).
//!
//! The patch is warped into the view of the current frame by the affine map A and moved over the image
//! until intensities agree up to the offset γ, which models another exposure. Inverse compositional in
//! two dimensions: gradients are those of the warped patch. Works on one level of the pyramids. Where
//! to search is decided by `local_matching`.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use crate::image::Image;
use crate::pyramid::{Pyramid, scale, to_level};
use crate::simd::{self, Kernel};

/// Columns and rows of a patch: four times the paper's area, because smaller patches are too ambiguous.
pub(super) const SIDE: usize = 8;
const AREA: usize = SIDE * SIDE;
/// Columns and rows of a patch with a border of one pixel, for gradients.
const FRAMED: usize = SIDE + 2;
/// Columns and rows of the window from which a patch is read.
const WINDOW: usize = 32;
/// Most steps.
const MAX_STEPS: usize = 12;
/// A step shorter than this is the last, pixels of the level.
const SHORT_PX: f32 = 0.02;
/// How far a match may lie from where it was expected, pixels of the level.
const FARTHEST_PX: f32 = 6.0;
/// Least correlation of patch and image at the match.
const LEAST_CORRELATION: f32 = 0.8;
/// Least sum of squared gradients along the weaker direction, gray levels squared: flat patches
/// and edges match anywhere.
const LEAST_TEXTURE: f32 = 400.0;

/// A patch of a keyframe as the current frame should see it.
#[derive(Clone, Debug)]
pub(super) struct WarpedPatch {
    /// With a border of one pixel.
    framed: [f32; FRAMED * FRAMED],
    /// The level of the current pyramid that it belongs to.
    pub(super) level: usize,
}

impl WarpedPatch {
    /// Warps the patch around `pixel` of a keyframe; `current_from_keyframe` is A on level 0. `None`
    /// where the patch leaves the image, or where the views differ so much that nothing would match.
    pub(super) fn new(
        keyframe: &Pyramid,
        pixel: &Vector2<f64>,
        current_from_keyframe: &Matrix2<f64>,
        coarser: usize,
    ) -> Option<Self> {
        let mut area = current_from_keyframe.determinant().abs();
        if !(0.02..=50.0).contains(&area) {
            return None;
        }
        // A patch that is larger in the current view is matched on a coarser level.
        let mut level = 0;
        while (area > 3.0 || level < coarser) && level + 1 < keyframe.level_count() {
            area *= 0.25;
            level += 1;
        }
        let keyframe_from_current = current_from_keyframe.try_inverse()? * scale(level);
        // A patch that is smaller is read from a coarser level of the keyframe.
        let mut source = 0;
        while area < 0.34 && source + 1 < keyframe.level_count() {
            area *= 4.0;
            source += 1;
        }
        let image = keyframe.level(source);
        let warp = keyframe_from_current.map(|value| (value / scale(source)) as f32);
        let (u, v) = (to_level(pixel.x, source) as f32, to_level(pixel.y, source) as f32);
        // The patch is inside the image if its corners are.
        let reach = FRAMED as f32 * 0.5;
        let (du, dv) =
            ((warp.m11.abs() + warp.m12.abs()) * reach, (warp.m21.abs() + warp.m22.abs()) * reach);
        let (right, bottom) = ((image.width() - 2) as f32, (image.height() - 2) as f32);
        if u - du < 0.0 || v - dv < 0.0 || u + du >= right || v + dv >= bottom {
            return None;
        }
        let window = Window::around(image, (u - du, v - dv), (u + du, v + dv))?;
        let center = (u - window.left as f32, v - window.top as f32);
        let framed = simd::run(Warping { window: &window, center, warp: &warp });
        Some(Self { framed, level })
    }

    /// Searches for the patch near `expected` (level 0). Returns the pixel (level 0) and its
    /// correlation.
    pub(super) fn find(
        &self,
        current: &Pyramid,
        expected: &Vector2<f64>,
    ) -> Option<(Vector2<f64>, f32)> {
        let image = current.level(self.level);
        let start = [expected.x, expected.y].map(|x| to_level(x, self.level) as f32);
        let (pixel, correlation) = simd::run(Search { framed: &self.framed, image, start })?;
        let [u, v] = pixel.map(|x| from_level(x, self.level));
        Some((Vector2::new(u, v), correlation))
    }
}

/// The part of an image that a patch is read from.
struct Window {
    pixels: [u8; WINDOW * WINDOW],
    left: usize,
    top: usize,
}

impl Window {
    /// The window with both corners, which are inside the image, and the pixels to their right and
    /// below; `None` where that is too large.
    fn around(image: &Image<u8>, first: (f32, f32), last: (f32, f32)) -> Option<Self> {
        let (left, top) = (first.0 as usize, first.1 as usize);
        let (columns, rows) = (last.0 as usize + 2 - left, last.1 as usize + 2 - top);
        if columns > WINDOW || rows > WINDOW {
            return None;
        }
        let mut pixels = [0; WINDOW * WINDOW];
        for (row, out) in pixels.chunks_exact_mut(WINDOW).take(rows).enumerate() {
            let from = &image.row(top + row)[left..];
            // A copy of fixed length is a few instructions.
            if let Some(from) = from.first_chunk::<WINDOW>() {
                out.copy_from_slice(from);
            } else {
                out[..from.len()].copy_from_slice(from);
            }
        }
        Some(Self { pixels, left, top })
    }
}

/// Reads a patch from a window.
struct Warping<'a> {
    window: &'a Window,
    /// The patch's middle in the window.
    center: (f32, f32),
    warp: &'a Matrix2<f32>,
}

impl Kernel for Warping<'_> {
    type Output = [f32; FRAMED * FRAMED];

    #[inline(always)]
    fn run(self) -> Self::Output {
        const COUNT: usize = FRAMED * FRAMED;
        let Self { window: Window { pixels, .. }, center, warp } = self;
        let mut at = [0_u16; COUNT];
        let (mut between_columns, mut between_rows) = ([0.0_f32; COUNT], [0.0_f32; COUNT]);
        for row in 0..FRAMED {
            let y = row as f32 - (FRAMED as f32 - 1.0) * 0.5;
            for column in 0..FRAMED {
                let x = column as f32 - (FRAMED as f32 - 1.0) * 0.5;
                let i = row * FRAMED + column;
                let u = center.0 + (warp.m11 * x + warp.m12 * y);
                let v = center.1 + (warp.m21 * x + warp.m22 * y);
                let (left, top) = (simd::floor(u), simd::floor(v));
                at[i] = (top * WINDOW as i32 + left) as u16;
                (between_columns[i], between_rows[i]) = (u - left as f32, v - top as f32);
            }
        }
        let mut corners = [[0_u8; COUNT]; 4];
        for (i, &at) in at.iter().enumerate() {
            // The remainder does not change the index, and avoids a bounds check.
            let pixel = |further: usize| pixels[(usize::from(at) + further) % (WINDOW * WINDOW)];
            corners[0][i] = pixel(0);
            corners[1][i] = pixel(1);
            corners[2][i] = pixel(WINDOW);
            corners[3][i] = pixel(WINDOW + 1);
        }
        let mut framed = [0.0; COUNT];
        for i in 0..COUNT {
            let (a, b) = (f32::from(corners[0][i]), f32::from(corners[1][i]));
            let (c, d) = (f32::from(corners[2][i]), f32::from(corners[3][i]));
            let (s, t) = (between_columns[i], between_rows[i]);
            framed[i] = (1.0 - t) * ((1.0 - s) * a + s * b) + t * ((1.0 - s) * c + s * d);
        }
        framed
    }
}

/// Moves a patch over an image.
struct Search<'a> {
    framed: &'a [f32; FRAMED * FRAMED],
    image: &'a Image<u8>,
    start: [f32; 2],
}

/// Eight sums side by side, for the eight columns of a patch.
type Columns = [f32; SIDE];

impl Kernel for Search<'_> {
    type Output = Option<([f32; 2], f32)>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self { framed, image, start } = self;
        let mut patch = [[0.0; SIDE]; SIDE];
        let mut gradients = [[[0.0; SIDE]; SIDE]; 2];
        // Sums of gx², gx gy, gy², gx, gy, and the gray levels.
        let mut sums: [Columns; 6] = [[0.0; SIDE]; 6];
        for row in 0..SIDE {
            for column in 0..SIDE {
                let at = (row + 1) * FRAMED + column + 1;
                let gx = 0.5 * (framed[at + 1] - framed[at - 1]);
                let gy = 0.5 * (framed[at + FRAMED] - framed[at - FRAMED]);
                gradients[0][row][column] = gx;
                gradients[1][row][column] = gy;
                patch[row][column] = framed[at];
                sums[0][column] += gx * gx;
                sums[1][column] += gx * gy;
                sums[2][column] += gy * gy;
                sums[3][column] += gx;
                sums[4][column] += gy;
                sums[5][column] += framed[at];
            }
        }
        let [xx, xy, yy, x, y, gray] = sums.map(|columns| simd::sum(&columns));
        let spread = ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt();
        if 0.5 * (xx + yy - spread) < LEAST_TEXTURE {
            return None;
        }
        let inverse = Matrix3::new(xx, xy, x, xy, yy, y, x, y, AREA as f32).try_inverse()?;
        let mean = gray / AREA as f32;
        let [mut u, mut v] = start;
        let mut gamma = 0.0;
        for step in 0..MAX_STEPS {
            let seen = read(image, u, v)?;
            if step == 0 {
                gamma = mean - mean_of(&seen);
            }
            let mut sums: [Columns; 3] = [[0.0; SIDE]; 3];
            for row in 0..SIDE {
                for column in 0..SIDE {
                    let residual = seen[row][column] - patch[row][column] + gamma;
                    sums[0][column] += residual * gradients[0][row][column];
                    sums[1][column] += residual * gradients[1][row][column];
                    sums[2][column] += residual;
                }
            }
            let update = inverse * Vector3::from(sums.map(|columns| simd::sum(&columns)));
            u -= update.x;
            v -= update.y;
            gamma -= update.z;
            if (u - start[0]).abs() > FARTHEST_PX || (v - start[1]).abs() > FARTHEST_PX {
                return None;
            }
            if update.x * update.x + update.y * update.y < SHORT_PX * SHORT_PX {
                let correlation = correlation(&patch, &read(image, u, v)?);
                return (correlation >= LEAST_CORRELATION).then_some(([u, v], correlation));
            }
        }
        None
    }
}

fn from_level(coordinate: f32, level: usize) -> f64 {
    (f64::from(coordinate) + 0.5) * scale(level) - 0.5
}

/// The image around (u, v).
#[inline(always)]
fn read(image: &Image<u8>, u: f32, v: f32) -> Option<[Columns; SIDE]> {
    let reach = (SIDE as f32 - 1.0) * 0.5;
    let (u, v) = (u - reach, v - reach);
    if !(u >= 0.0 && v >= 0.0) {
        return None;
    }
    let (left, top) = (u as usize, v as usize);
    if left + SIDE >= image.width() || top + SIDE >= image.height() {
        return None;
    }
    let (s, t) = (u - left as f32, v - top as f32);
    let mut out = [[0.0; SIDE]; SIDE];
    let mut above = [0.0; SIDE];
    for row in 0..=SIDE {
        let pixels = &image.row(top + row)[left..=left + SIDE];
        let mut along = [0.0; SIDE];
        for i in 0..SIDE {
            let (a, b) = (f32::from(pixels[i]), f32::from(pixels[i + 1]));
            along[i] = a + s * (b - a);
        }
        if row > 0 {
            for i in 0..SIDE {
                out[row - 1][i] = above[i] + t * (along[i] - above[i]);
            }
        }
        above = along;
    }
    Some(out)
}

#[inline(always)]
fn mean_of(pixels: &[Columns; SIDE]) -> f32 {
    let mut sums = [0.0; SIDE];
    for row in pixels {
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
    }
    simd::sum(&sums) / AREA as f32
}

/// Pearson's correlation.
#[inline(always)]
fn correlation(a: &[Columns; SIDE], b: &[Columns; SIDE]) -> f32 {
    let (mean_a, mean_b) = (mean_of(a), mean_of(b));
    let mut sums: [Columns; 3] = [[0.0; SIDE]; 3];
    for (a, b) in a.iter().zip(b) {
        for column in 0..SIDE {
            let (a, b) = (a[column] - mean_a, b[column] - mean_b);
            sums[0][column] += a * a;
            sums[1][column] += a * b;
            sums[2][column] += b * b;
        }
    }
    let [aa, ab, bb] = sums.map(|columns| simd::sum(&columns));
    ab / (aa * bb).sqrt().max(f32::MIN_POSITIVE)
}
