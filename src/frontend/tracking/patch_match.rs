//! Where a patch of a keyframe lies in the current image (the paper's equations 5 to 7).
//!
//! The patch is warped into the view of the current frame by the affine map A and moved over the
//! image until intensities agree up to γ, which stands for another exposure. Inverse compositional
//! in two dimensions: gradients are those of the warped patch. Works on one level of the pyramids.

use nalgebra::{Matrix2, Vector2};

use crate::frontend::image::Image;
use crate::frontend::pyramid::{Pyramid, sample, scale, to_level};

/// Columns and rows of a patch: four times the paper's area, which repeats itself too often.
pub(super) const SIDE: usize = 8;
const AREA: usize = SIDE * SIDE;
/// Columns and rows with a pixel around it, for gradients.
const FRAMED: usize = SIDE + 2;
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
    /// With one pixel around it.
    framed: [f32; FRAMED * FRAMED],
    /// The level of the current pyramid that it belongs to.
    pub(super) level: usize,
}

impl WarpedPatch {
    /// Warps the patch around `pixel` of a keyframe; `current_from_keyframe` is A on level 0.
    /// `None` where the image ends, or where the views differ so much that nothing would match.
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
        // What looks larger now is matched on a coarser level.
        let mut level = 0;
        while (area > 3.0 || level < coarser) && level + 1 < keyframe.len() {
            area *= 0.25;
            level += 1;
        }
        let keyframe_from_current = current_from_keyframe.try_inverse()? * scale(level);
        // And what looks smaller is read from a coarser level of the keyframe.
        let mut source = 0;
        while area < 0.34 && source + 1 < keyframe.len() {
            area *= 4.0;
            source += 1;
        }
        let image = keyframe.level(source);
        let warp = keyframe_from_current.map(|value| (value / scale(source)) as f32);
        let (u, v) = (to_level(pixel.x, source) as f32, to_level(pixel.y, source) as f32);
        // Inside everywhere when the corners are.
        let reach = FRAMED as f32 * 0.5;
        let (du, dv) =
            ((warp.m11.abs() + warp.m12.abs()) * reach, (warp.m21.abs() + warp.m22.abs()) * reach);
        let (right, bottom) = ((image.width() - 2) as f32, (image.height() - 2) as f32);
        if u - du < 0.0 || v - dv < 0.0 || u + du >= right || v + dv >= bottom {
            return None;
        }
        let mut framed = [0.0; FRAMED * FRAMED];
        for (at, value) in framed.iter_mut().enumerate() {
            let x = (at % FRAMED) as f32 - (FRAMED as f32 - 1.0) * 0.5;
            let y = (at / FRAMED) as f32 - (FRAMED as f32 - 1.0) * 0.5;
            let (du, dv) = (warp.m11 * x + warp.m12 * y, warp.m21 * x + warp.m22 * y);
            *value = sample(image, u + du, v + dv);
        }
        Some(Self { framed, level })
    }

    /// Finds the patch near `expected` (level 0); the place (level 0) and its correlation.
    pub(super) fn find(
        &self,
        current: &Pyramid,
        expected: &Vector2<f64>,
    ) -> Option<(Vector2<f64>, f32)> {
        let image = current.level(self.level);
        let mut patch = [0.0; AREA];
        let mut gradients = [[0.0; AREA]; 2];
        let mut hessian = nalgebra::Matrix3::<f32>::zeros();
        for row in 0..SIDE {
            for column in 0..SIDE {
                let at = (row + 1) * FRAMED + column + 1;
                let gx = 0.5 * (self.framed[at + 1] - self.framed[at - 1]);
                let gy = 0.5 * (self.framed[at + FRAMED] - self.framed[at - FRAMED]);
                let i = row * SIDE + column;
                (patch[i], gradients[0][i], gradients[1][i]) = (self.framed[at], gx, gy);
                let j = nalgebra::Vector3::new(gx, gy, 1.0);
                hessian += j * j.transpose();
            }
        }
        let structure = Matrix2::new(hessian.m11, hessian.m12, hessian.m12, hessian.m22);
        let spread = ((structure.m11 - structure.m22).powi(2) + 4.0 * structure.m12.powi(2)).sqrt();
        if 0.5 * (structure.trace() - spread) < LEAST_TEXTURE {
            return None;
        }
        let inverse = hessian.try_inverse()?;
        let start =
            (to_level(expected.x, self.level) as f32, to_level(expected.y, self.level) as f32);
        let (mut u, mut v) = start;
        let mean: f32 = patch.iter().sum::<f32>() / AREA as f32;
        let mut gamma = 0.0;
        for step in 0..MAX_STEPS {
            let seen = read(image, u, v)?;
            if step == 0 {
                gamma = mean - seen.iter().sum::<f32>() / AREA as f32;
            }
            let mut sums = nalgebra::Vector3::<f32>::zeros();
            for i in 0..AREA {
                let residual = seen[i] - patch[i] + gamma;
                sums += residual * nalgebra::Vector3::new(gradients[0][i], gradients[1][i], 1.0);
            }
            let update = inverse * sums;
            u -= update.x;
            v -= update.y;
            gamma -= update.z;
            if (u - start.0).abs() > FARTHEST_PX || (v - start.1).abs() > FARTHEST_PX {
                return None;
            }
            if update.x * update.x + update.y * update.y < SHORT_PX * SHORT_PX {
                let correlation = correlation(&patch, &read(image, u, v)?);
                let place = Vector2::new(from_level(u, self.level), from_level(v, self.level));
                return (correlation >= LEAST_CORRELATION).then_some((place, correlation));
            }
        }
        None
    }
}

fn from_level(coordinate: f32, level: usize) -> f64 {
    (f64::from(coordinate) + 0.5) * scale(level) - 0.5
}

/// The image around (u, v).
fn read(image: &Image<u8>, u: f32, v: f32) -> Option<[f32; AREA]> {
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
    let mut out = [0.0; AREA];
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
                out[(row - 1) * SIDE + i] = above[i] + t * (along[i] - above[i]);
            }
        }
        above = along;
    }
    Some(out)
}

/// Pearson's correlation.
fn correlation(a: &[f32; AREA], b: &[f32; AREA]) -> f32 {
    let mean = |x: &[f32; AREA]| x.iter().sum::<f32>() / AREA as f32;
    let (ma, mb) = (mean(a), mean(b));
    let (mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0);
    for i in 0..AREA {
        let (da, db) = (a[i] - ma, b[i] - mb);
        aa += da * da;
        ab += da * db;
        bb += db * db;
    }
    ab / (aa * bb).sqrt().max(f32::MIN_POSITIVE)
}
