//! A. The initial pose of a frame: from several starts, the alignment that fits best. Compares with
//! the last frame only; the map comes later.

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Vector2;

use super::Last;
use crate::frontend::camera::FrameCamera;
use crate::frontend::input::SensorTiming;
use crate::frontend::motion::warp::Exposure;
use crate::frontend::pyramid::Pyramid;
use crate::frontend::shutter::Shutter;
use crate::frontend::tracking::alignment::{Alignment, AlignmentOptions, Reference};
use crate::frontend::tracking::rotation::SmallImage;

/// An alignment that fits so well needs no other start, gray levels.
const GOOD_RESIDUAL: f32 = 6.0;

/// Where a frame is beside the last one.
pub(super) struct InitialPose {
    pub(super) last_from_camera: Se3,
    pub(super) exposure: Exposure,
    /// Of the alignment, gray levels.
    pub(super) median_residual: f32,
}

/// The pose of a frame that was taken `elapsed_s` after the last one.
pub(super) fn initial_pose(
    camera: &FrameCamera,
    last: &Last,
    pyramid: &Pyramid,
    elapsed_s: f64,
    timing: &SensorTiming,
    options: &AlignmentOptions,
) -> Option<InitialPose> {
    let (motion, motion_s) = &last.motion;
    let rate = if *motion_s > 0.0 { 1.0 / motion_s } else { 0.0 };
    // As it went on, for as long as it took this time.
    let predicted = Se3::exp(&(motion.log() * (elapsed_s * rate))).inverse();
    let shutter = Shutter::new(camera, &(motion.rotation.log() * rate), timing.readout_s);
    let is_moving = |pixel: &Vector2<f64>| {
        let at = |x: f64, size: usize| (x.max(0.0) as usize).min(size - 1);
        let value = |mask: &crate::frontend::image::Image<u8>| {
            mask.at(at(pixel.x, mask.width()), at(pixel.y, mask.height()))
        };
        last.moving.as_ref().is_some_and(|mask| value(mask) > 127)
    };
    let small = SmallImage::new(pyramid);
    let turned = last.small.rotation_to(&small, camera, &predicted.rotation, is_moving);
    let turned = turned.map(|rotation| Se3::new(rotation, predicted.translation));
    let reference = Reference::new(camera, &last.pyramid, &last.points, options);
    let mut best = None;
    for start in turned.into_iter().chain([predicted, Se3::identity()]) {
        let Some(found) = reference.align((camera, &shutter), pyramid, &start) else { continue };
        let is_good = found.median_residual < GOOD_RESIDUAL;
        let better = |best: &Alignment| found.median_residual < best.median_residual;
        if best.as_ref().is_none_or(better) {
            best = Some(found);
        }
        if is_good {
            break;
        }
    }
    let found = best?;
    Some(InitialPose {
        last_from_camera: found.current_from_reference.inverse(),
        exposure: Exposure { gain: found.gain as f32, offset: found.offset as f32 },
        median_residual: found.median_residual,
    })
}
