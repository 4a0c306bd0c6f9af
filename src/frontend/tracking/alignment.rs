//! A. Initial estimate of the pose: sparse image alignment (the paper's equations 1 to 4).
//!
//! Patches of 4 × 4 pixels around points of known depth are moved from a reference image to the
//! current one until their intensities agree, coarse to fine. Inverse compositional: the gradients
//! are those of the reference, taken once a level, and the step ξ of equation 3 is undone,
//! T ← T · T(ξ)⁻¹. Exposure may change by gain and offset, current = gain · reference + offset.
//! Residuals weigh as of Student's t distribution, so that what moves pulls little.

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::{Matrix2x3, Matrix6, SMatrix, SVector, Vector2, Vector3, Vector6};

use crate::frontend::camera::FrameCamera;
use crate::frontend::image::Image;
use crate::frontend::pyramid::{Pyramid, scale, to_level};
use crate::frontend::shutter::Shutter;

/// Columns and rows of a patch.
const SIDE: usize = 4;
/// Pixels of a patch.
const AREA: usize = SIDE * SIDE;
/// From a patch's center to its first pixel.
const REACH: f32 = 1.5;
/// Degrees of freedom of the t distribution (Kerl, Sturm and Cremers, ICRA 2013).
const FREEDOM: f32 = 5.0;
/// Least scale of the residuals, gray levels: the noise of an image.
const LEAST_SCALE: f32 = 3.0;
/// A step that moves no point by more than this, pixels of the level, is the last.
const SHORT_PX: f64 = 0.02;
/// By how much the median residual may grow in a step before it is taken back.
const GROWTH: f32 = 1.02;
/// Standard deviations of gain and offset (gray levels) from one frame to the next.
const EXPOSURE_SIGMA: (f64, f64) = (0.2, 20.0);

/// What a gain can be from one frame to the next.
const GAINS: (f64, f64) = (0.5, 2.0);

/// A point of the reference image with its place in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlignmentPoint {
    /// Where the reference shows it.
    pub pixel: Vector2<f64>,
    /// Where it is, in the reference camera's frame, meters.
    pub point_in_reference: Vector3<f64>,
}

/// Options of [`align`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlignmentOptions {
    /// The level to begin with.
    pub coarsest: usize,
    /// The level to end with.
    pub finest: usize,
    /// Most steps on a level.
    pub max_iterations: usize,
    /// Fewer visible points than this determine no pose.
    pub min_points: usize,
}

impl Default for AlignmentOptions {
    fn default() -> Self {
        Self { coarsest: 4, finest: 1, max_iterations: 12, min_points: 25 }
    }
}

/// What an alignment found.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    /// The motion between the images.
    pub current_from_reference: Se3,
    /// current = gain · reference + offset.
    pub gain: f64,
    /// Gray levels.
    pub offset: f64,
    /// Median of the absolute residuals on the finest level, gray levels.
    pub median_residual: f32,
    /// Points that the current image shows.
    pub visible: usize,
}

/// Finds the motion from `start` on; `None` where too few points are visible or their gradients
/// leave it open.
#[must_use]
pub fn align(
    (camera, shutter): (&FrameCamera, &Shutter),
    (reference, current): (&Pyramid, &Pyramid),
    points: &[AlignmentPoint],
    start: &Se3,
    options: &AlignmentOptions,
) -> Option<Alignment> {
    let mut state = State { pose: *start, gain: 1.0, offset: 0.0 };
    let mut outcome = None;
    let coarsest = options.coarsest.min(reference.len() - 1);
    for level in (options.finest.min(coarsest)..=coarsest).rev() {
        let patches = Patches::new(camera, reference.level(level), level, points);
        outcome =
            Some(patches.align((camera, shutter), current.level(level), &mut state, options)?);
    }
    let (median_residual, visible) = outcome?;
    Some(Alignment {
        current_from_reference: state.pose,
        gain: state.gain,
        offset: state.offset,
        median_residual,
        visible,
    })
}

#[derive(Clone, Copy)]
struct State {
    pose: Se3,
    gain: f64,
    offset: f64,
}

/// What the reference tells of one point on one level.
struct Patch {
    point: Vector3<f64>,
    intensity: [f32; AREA],
    /// Per pixel of the level, along u and v.
    gradient: [[f32; AREA]; 2],
    /// ∂(pixel of the level)/∂ξ.
    motion: SMatrix<f64, 2, 6>,
}

struct Patches {
    patches: Vec<Patch>,
    level: usize,
    /// Pixels of the level that a radian of rotation, or a meter of translation at a meter's
    /// distance, moves a point.
    focal: f64,
}

/// Sums over the visible patches.
struct Sums {
    hessian: SMatrix<f64, 8, 8>,
    gradient: SVector<f64, 8>,
    median: f32,
    visible: usize,
}

impl Patches {
    fn new(
        camera: &FrameCamera,
        image: &Image<u8>,
        level: usize,
        points: &[AlignmentPoint],
    ) -> Self {
        let patches = points.iter().filter_map(|p| Patch::new(camera, image, level, p)).collect();
        let focal = camera.model().fx.max(camera.model().fy) / scale(level);
        Self { patches, level, focal }
    }

    /// Steps until they are short; the median residual and the number of visible points.
    fn align(
        &self,
        camera: (&FrameCamera, &Shutter),
        image: &Image<u8>,
        state: &mut State,
        options: &AlignmentOptions,
    ) -> Option<(f32, usize)> {
        let sums = |state: &State, scale| {
            let sums = self.sums(camera, image, state, scale);
            (sums.visible >= options.min_points).then_some(sums)
        };
        // The first scale is that of the start itself.
        let first = sums(state, f32::INFINITY)?;
        let mut now = sums(state, residual_scale(first.median))?;
        for _ in 0..options.max_iterations {
            let step = now.step()?;
            let motion: Vector6<f64> = step.fixed_rows::<6>(0).into();
            let trial = State {
                pose: state.pose.compose(&Se3::exp(&motion).inverse()),
                gain: (state.gain + step[6]).clamp(GAINS.0, GAINS.1),
                offset: state.offset + step[7],
            };
            let Some(then) = sums(&trial, residual_scale(now.median)) else { break };
            if then.median > now.median * GROWTH {
                break;
            }
            (*state, now) = (trial, then);
            let moved = motion.fixed_rows::<3>(0).norm() + motion.fixed_rows::<3>(3).norm();
            if moved * self.focal < SHORT_PX {
                break;
            }
        }
        Some((now.median, now.visible))
    }

    /// Residuals of all patches at a state, weighed by their scale (all alike where it is infinite).
    fn sums(
        &self,
        (camera, shutter): (&FrameCamera, &Shutter),
        image: &Image<u8>,
        state: &State,
        scale: f32,
    ) -> Sums {
        let mut histogram = [0_u32; 256];
        let mut hessian = SMatrix::<f64, 8, 8>::zeros();
        let mut gradient = SVector::<f64, 8>::zeros();
        let mut visible = 0;
        let (gain, offset) = (state.gain as f32, state.offset as f32);
        for patch in &self.patches {
            let point = state.pose.transform(&patch.point);
            let Some(pixel) = shutter.project(camera, &point) else { continue };
            let Some(seen) = seen(image, &pixel, self.level) else { continue };
            visible += 1;
            let mut sums = PatchSums::default();
            for i in 0..AREA {
                let residual = gain * patch.intensity[i] + offset - seen[i];
                histogram[(residual.abs() as usize).min(255)] += 1;
                let relative = residual / scale;
                let weight = (FREEDOM + 1.0) / (FREEDOM + relative * relative);
                let (gx, gy) = (gain * patch.gradient[0][i], gain * patch.gradient[1][i]);
                sums.add(weight, residual, [gx, gy, patch.intensity[i], 1.0]);
            }
            sums.into(&patch.motion, &mut hessian, &mut gradient);
        }
        let noise = f64::from(if scale.is_finite() { scale * scale } else { 100.0 });
        for (i, (sigma, away)) in
            [(EXPOSURE_SIGMA.0, state.gain - 1.0), (EXPOSURE_SIGMA.1, state.offset)]
                .into_iter()
                .enumerate()
        {
            let weight = noise / (sigma * sigma);
            hessian[(6 + i, 6 + i)] += weight;
            gradient[6 + i] += weight * away;
        }
        Sums { hessian, gradient, median: median(&histogram), visible }
    }
}

impl Sums {
    /// The step that minimizes the weighted squares of the linearized residuals.
    fn step(&self) -> Option<SVector<f64, 8>> {
        let pose: Matrix6<f64> = self.hessian.fixed_view::<6, 6>(0, 0).into();
        if pose.diagonal().iter().any(|&d| d <= 0.0) {
            return None;
        }
        let step = -self.hessian.cholesky()?.solve(&self.gradient);
        step.iter().all(|value| value.is_finite()).then_some(step)
    }
}

/// Sums over the pixels of a patch: ∂residual/∂(u, v, gain, offset) and the residual.
#[derive(Default)]
struct PatchSums {
    /// Upper triangle, row by row.
    products: [f32; 10],
    with_residual: [f32; 4],
}

impl PatchSums {
    #[inline]
    fn add(&mut self, weight: f32, residual: f32, d: [f32; 4]) {
        let mut at = 0;
        for i in 0..4 {
            let weighed = weight * d[i];
            self.with_residual[i] += weighed * residual;
            for &other in &d[i..] {
                self.products[at] += weighed * other;
                at += 1;
            }
        }
    }

    /// Adds what the patch says of pose and exposure.
    fn into(
        self,
        motion: &SMatrix<f64, 2, 6>,
        hessian: &mut SMatrix<f64, 8, 8>,
        gradient: &mut SVector<f64, 8>,
    ) {
        let [uu, uv, ua, ub, vv, va, vb, aa, ab, bb] = self.products.map(f64::from);
        let [u, v, a, b] = self.with_residual.map(f64::from);
        for i in 0..6 {
            let (mu, mv) = (motion[(0, i)], motion[(1, i)]);
            let (left, right) = (mu * uu + mv * uv, mu * uv + mv * vv);
            for j in i..6 {
                let value = left * motion[(0, j)] + right * motion[(1, j)];
                hessian[(i, j)] += value;
                if i != j {
                    hessian[(j, i)] += value;
                }
            }
            for (column, value) in [(6, mu * ua + mv * va), (7, mu * ub + mv * vb)] {
                hessian[(i, column)] += value;
                hessian[(column, i)] += value;
            }
            gradient[i] += mu * u + mv * v;
        }
        hessian[(6, 6)] += aa;
        hessian[(6, 7)] += ab;
        hessian[(7, 6)] += ab;
        hessian[(7, 7)] += bb;
        gradient[6] += a;
        gradient[7] += b;
    }
}

impl Patch {
    fn new(
        camera: &FrameCamera,
        image: &Image<u8>,
        level: usize,
        point: &AlignmentPoint,
    ) -> Option<Self> {
        let (u, v) = (to_level(point.pixel.x, level) as f32, to_level(point.pixel.y, level) as f32);
        // One pixel more on each side for the gradients, and one for the interpolation.
        let around = block::<{ SIDE + 2 }>(image, u - REACH - 1.0, v - REACH - 1.0)?;
        let mut intensity = [0.0; AREA];
        let mut gradient = [[0.0; AREA]; 2];
        for row in 0..SIDE {
            for column in 0..SIDE {
                let at = row * SIDE + column;
                intensity[at] = around[row + 1][column + 1];
                gradient[0][at] = 0.5 * (around[row + 1][column + 2] - around[row + 1][column]);
                gradient[1][at] = 0.5 * (around[row + 2][column + 1] - around[row][column + 1]);
            }
        }
        let (_, by_point) = camera.project_with_jacobian(&point.point_in_reference)?;
        let motion = by_motion(&by_point, &point.point_in_reference) / scale(level);
        Some(Self { point: point.point_in_reference, intensity, gradient, motion })
    }
}

/// ∂pixel/∂ξ of a point that ξ moves: ∂pixel/∂point · [I, −p×].
fn by_motion(by_point: &Matrix2x3<f64>, p: &Vector3<f64>) -> SMatrix<f64, 2, 6> {
    let mut motion = SMatrix::<f64, 2, 6>::zeros();
    motion.fixed_view_mut::<2, 3>(0, 0).copy_from(by_point);
    for row in 0..2 {
        let d: Vector3<f64> = by_point.row(row).transpose();
        // dᵀ (ω × p) = ωᵀ (p × d).
        let turned = p.cross(&d);
        motion.fixed_view_mut::<1, 3>(row, 3).copy_from(&turned.transpose());
    }
    motion
}

/// The current image where a patch's pixels come to lie.
fn seen(image: &Image<u8>, pixel: &Vector2<f64>, level: usize) -> Option<[f32; AREA]> {
    let (u, v) = (to_level(pixel.x, level) as f32, to_level(pixel.y, level) as f32);
    let rows = block::<SIDE>(image, u - REACH, v - REACH)?;
    let mut seen = [0.0; AREA];
    for (row, values) in rows.iter().enumerate() {
        seen[row * SIDE..(row + 1) * SIDE].copy_from_slice(values);
    }
    Some(seen)
}

/// N × N interpolated values, one pixel apart, from (u, v) on; `None` where they leave the image.
#[inline]
fn block<const N: usize>(image: &Image<u8>, u: f32, v: f32) -> Option<[[f32; N]; N]> {
    let (width, height) = image.size();
    if !(u >= 0.0 && v >= 0.0) || u as usize + N >= width || v as usize + N >= height {
        return None;
    }
    let (left, top) = (u as usize, v as usize);
    let (s, t) = (u - left as f32, v - top as f32);
    let mut above = [0.0; N];
    let mut out = [[0.0; N]; N];
    for row in 0..=N {
        let pixels = &image.row(top + row)[left..left + N + 1];
        let mut along = [0.0; N];
        for i in 0..N {
            let (a, b) = (f32::from(pixels[i]), f32::from(pixels[i + 1]));
            along[i] = a + s * (b - a);
        }
        if row > 0 {
            for i in 0..N {
                out[row - 1][i] = above[i] + t * (along[i] - above[i]);
            }
        }
        above = along;
    }
    Some(out)
}

/// Scale of residuals whose absolute median is this, were they normal.
fn residual_scale(median: f32) -> f32 {
    (1.4826 * median).max(LEAST_SCALE)
}

/// The median of values counted by their whole part, between its neighbors by share.
fn median(histogram: &[u32; 256]) -> f32 {
    let half = histogram.iter().sum::<u32>() as f32 * 0.5;
    let mut before = 0.0;
    for (value, &count) in histogram.iter().enumerate() {
        let count = count as f32;
        if count > 0.0 && before + count >= half {
            return value as f32 + (half - before) / count;
        }
        before += count;
    }
    0.0
}
