//! The observations of one pose, packed by eight for the kernels.
//!
//! A lane an observation, in the caller's order. What weighs nothing has an infinite sigma: a depth
//! that was not measured, and the lanes past the end, which repeat the last observation's point.
//! Whether a number is finite is only noticed here; `one_by_one` says which.

use super::PointObservation;
use super::normal_equations::{Evaluate, Evaluation};
use super::view::{Fit, OnView, View};
use crate::geometry::{Camera, Se3};
use crate::loss::Loss;
use crate::simd::{Class, Row, WIDTH};

/// Eight observations.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(super) struct Eight {
    pub(super) point_in_world: [Row; 3],
    pub(super) pixel: [Row; 2],
    /// 1/σ of a pixel coordinate.
    pub(super) weight: Row,
    pub(super) depth: Row,
    /// 1/σ of the depth.
    pub(super) depth_weight: Row,
}

/// The observations of one pose and the camera that made them.
pub(super) struct Observations<'a> {
    camera: &'a Camera,
    blocks: Vec<Eight>,
    count: usize,
    class: Class,
    /// Whether all numbers are finite and all sigmas positive.
    pub(super) sound: bool,
}

impl<'a> Observations<'a> {
    pub(super) fn new(camera: &'a Camera, list: &[PointObservation], class: Class) -> Self {
        let mut sound = true;
        let blocks = list.chunks(WIDTH).map(|chunk| pack(chunk, &mut sound)).collect();
        Self { camera, blocks, count: list.len(), class, sound }
    }

    /// Cost, H and g at `pose`; not finite where one of the observations is not.
    pub(super) fn evaluate(&self, pose: &Se3, loss: Loss) -> Evaluation {
        self.class.run(OnView { view: self.view(pose), work: Evaluate { loss } })
    }

    /// s, the whitened squared residual, and p_z of each observation at `pose`.
    pub(super) fn fit(&self, pose: &Se3) -> (Vec<f64>, Vec<f64>) {
        let (mut squared, mut depths) = self.class.run(OnView { view: self.view(pose), work: Fit });
        squared.truncate(self.count);
        depths.truncate(self.count);
        (squared, depths)
    }

    fn view<'b>(&'b self, pose: &'b Se3) -> View<'b> {
        View { blocks: &self.blocks, pose, camera: self.camera }
    }
}

/// Up to eight observations; `sound` falls where one is not fit to be solved with.
fn pack(chunk: &[PointObservation], sound: &mut bool) -> Eight {
    let mut block = Eight::default();
    let mut sigma = [f64::INFINITY; WIDTH];
    let mut sigma_depth = [f64::INFINITY; WIDTH];
    for lane in 0..WIDTH {
        let Some(o) = chunk.get(lane).or(chunk.last()) else { continue };
        for i in 0..3 {
            block.point_in_world[i][lane] = o.point_in_world[i];
        }
        for i in 0..2 {
            block.pixel[i][lane] = o.pixel[i];
        }
        if lane >= chunk.len() {
            continue;
        }
        let positive = |x: f64| x > 0.0 && x < f64::INFINITY;
        sigma[lane] = o.sigma_px;
        *sound &= positive(o.sigma_px);
        // A sum is finite only if no term is NaN or infinite.
        let mut sum = o.point_in_world.sum() + o.pixel.sum();
        if let Some((depth, sigma)) = o.depth_m {
            block.depth[lane] = depth;
            sigma_depth[lane] = sigma;
            *sound &= positive(sigma);
            sum += depth;
        }
        *sound &= sum.is_finite();
    }
    block.weight = sigma.map(|s| 1.0 / s);
    block.depth_weight = sigma_depth.map(|s| 1.0 / s);
    block
}
