//! A. Initial estimate of the pose: sparse image alignment (the paper's equations 1 to 4).
//!
//! Patches of 4 × 4 pixels around points of known depth are moved from a reference image to the current
//! one until their intensities agree, coarse to fine. Inverse compositional: the gradients are those of
//! the reference, computed once per level, and the step ξ of equation 3 is inverted, T ← T · T(ξ)⁻¹.
//! Exposure may change by gain and offset, current = gain · reference + offset. Residuals are weighted
//! by Student's t distribution, so that moving objects have little influence.
//!
//! The sums over pixels are computed in `patches`, many patches at a time. Depth is needed in the
//! reference only; the map is not known here.

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::{Matrix6, SVector, Vector6};

use super::patches::{Patches, Points, Sums};
use super::points::AlignmentPoint;
use crate::camera::FrameCamera;
use crate::image::Image;
use crate::pyramid::{Pyramid, scale};
use crate::shutter::Shutter;

/// Least scale of the residuals, gray levels: the noise of an image.
const LEAST_SCALE: f32 = 3.0;
/// A step that moves no point by more than this, pixels of the level, is the last.
const SHORT_PX: f64 = 0.02;
/// A step is rejected if the median residual grows by more than this factor.
const GROWTH: f32 = 1.02;
/// Standard deviations of gain and offset (gray levels) from one frame to the next.
const EXPOSURE_SIGMA: (f64, f64) = (0.2, 20.0);

/// Range of the gain from one frame to the next.
const GAINS: (f64, f64) = (0.5, 2.0);

/// The level to begin with.
const COARSEST: usize = 4;
/// The level on which tracking ends.
pub const FINEST: usize = 1;
/// Most steps on a level.
const MAX_STEPS: usize = 12;
/// Fewer visible points than this determine no pose.
const LEAST_POINTS: usize = 25;

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

/// An image that others are aligned with.
#[derive(Clone, Debug)]
pub struct Reference {
    points: Points,
    /// From the coarsest to the finest.
    levels: Vec<Patches>,
    focal: f64,
}

#[derive(Clone, Copy)]
struct State {
    pose: Se3,
    gain: f64,
    offset: f64,
}

/// What a level found.
struct LevelFit {
    state: State,
    median_residual: f32,
    visible: usize,
}

impl Reference {
    /// Reads the patches around points of an image, on the levels down to `finest`.
    #[must_use]
    pub fn new(
        camera: &FrameCamera,
        reference: &Pyramid,
        points: &[AlignmentPoint],
        finest: usize,
    ) -> Self {
        let points = Points::new(camera, points);
        let coarsest = COARSEST.min(reference.level_count() - 1);
        let levels = (finest.min(coarsest)..=coarsest).rev();
        let levels = levels.map(|l| Patches::new(reference.level(l), l, &points)).collect();
        let focal = camera.model().fx.max(camera.model().fy);
        Self { points, levels, focal }
    }

    /// Finds the motion to the current image from `start` on; `None` where too few points are visible
    /// or their gradients do not determine it.
    #[must_use]
    pub fn align(
        &self,
        camera: &FrameCamera,
        shutter: &Shutter,
        current: &Pyramid,
        start: &Se3,
    ) -> Option<Alignment> {
        let mut state = State { pose: *start, gain: 1.0, offset: 0.0 };
        let mut fit = None;
        for patches in &self.levels {
            let image = current.level(patches.level());
            let found = self.align_level(camera, shutter, patches, image, state)?;
            state = found.state;
            fit = Some(found);
        }
        let LevelFit { state, median_residual, visible } = fit?;
        Some(Alignment {
            current_from_reference: state.pose,
            gain: state.gain,
            offset: state.offset,
            median_residual,
            visible,
        })
    }

    /// Iterates on one level until steps are short.
    fn align_level(
        &self,
        camera: &FrameCamera,
        shutter: &Shutter,
        patches: &Patches,
        image: &Image<u8>,
        mut state: State,
    ) -> Option<LevelFit> {
        let sums = |state: &State, scale| {
            let positions = self.points.positions(camera, shutter, &state.pose);
            let exposure = (state.gain as f32, state.offset as f32);
            let sums = patches.sums(image, &positions, exposure, scale);
            (sums.visible >= LEAST_POINTS).then_some(sums)
        };
        // The first scale is that of the residuals at the start.
        let first = sums(&state, f32::INFINITY)?;
        let mut scale_now = residual_scale(median(&first.histogram));
        let mut now = sums(&state, scale_now)?;
        let mut median_now = median(&now.histogram);
        // Pixels of the level that a radian of rotation, or a meter of translation at a meter's
        // distance, moves a point.
        let focal = self.focal / scale(patches.level());
        for _ in 0..MAX_STEPS {
            let step = step(&now, &state, scale_now)?;
            let motion: Vector6<f64> = step.fixed_rows::<6>(0).into();
            let trial = State {
                pose: state.pose.compose(&Se3::exp(&motion).inverse()),
                gain: (state.gain + step[6]).clamp(GAINS.0, GAINS.1),
                offset: state.offset + step[7],
            };
            let scale_then = residual_scale(median_now);
            let Some(then) = sums(&trial, scale_then) else { break };
            let median_then = median(&then.histogram);
            if median_then > median_now * GROWTH {
                break;
            }
            (state, now, scale_now, median_now) = (trial, then, scale_then, median_then);
            let moved = motion.fixed_rows::<3>(0).norm() + motion.fixed_rows::<3>(3).norm();
            if moved * focal < SHORT_PX {
                break;
            }
        }
        Some(LevelFit { state, median_residual: median_now, visible: now.visible })
    }
}

/// The step that minimizes the weighted squares of the linearized residuals and of the change of
/// exposure.
fn step(sums: &Sums, state: &State, scale: f32) -> Option<SVector<f64, 8>> {
    let (mut hessian, mut gradient) = (sums.hessian, sums.gradient);
    let noise = f64::from(scale * scale);
    for (i, (sigma, away)) in
        [(EXPOSURE_SIGMA.0, state.gain - 1.0), (EXPOSURE_SIGMA.1, state.offset)]
            .into_iter()
            .enumerate()
    {
        let weight = noise / (sigma * sigma);
        hessian[(6 + i, 6 + i)] += weight;
        gradient[6 + i] += weight * away;
    }
    let pose: Matrix6<f64> = hessian.fixed_view::<6, 6>(0, 0).into();
    if pose.diagonal().iter().any(|&d| d <= 0.0) {
        return None;
    }
    let step = -hessian.cholesky()?.solve(&gradient);
    step.iter().all(|value| value.is_finite()).then_some(step)
}

/// Standard deviation of normal residuals with this median of absolute values.
fn residual_scale(median: f32) -> f32 {
    (1.4826 * median).max(LEAST_SCALE)
}

/// The median of a histogram with bins of width 1, interpolated within its bin.
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
