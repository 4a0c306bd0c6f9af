//! A. The initial pose of a frame: from several starts, the alignment that fits best. Compares with
//! the last frame only; the map comes later. As long as that knows nothing, surfaces may contradict:
//! one textured thing that walks can have more gray levels to say than the room.

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Vector2;

use super::Last;
use crate::frontend::camera::FrameCamera;
use crate::frontend::image::RgbdFrame;
use crate::frontend::input::SensorTiming;
use crate::frontend::motion::warp::Exposure;
use crate::frontend::pyramid::Pyramid;
use crate::frontend::shutter::Shutter;
use crate::frontend::tracking::alignment::{Alignment, AlignmentOptions, Reference};
use crate::frontend::tracking::rotation::SmallImage;
use crate::frontend::tracking::surfaces::{CurrentDepth, Surfaces};

/// An alignment that fits so well needs no other start, gray levels.
const GOOD_RESIDUAL: f32 = 6.0;

/// An alignment that this share of the surfaces agrees with needs no other opinion.
const GOOD_SHARE: f64 = 0.8;
/// By how much larger the share must be that agrees with another motion.
const CLEAR_SHARE: f64 = 0.2;

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
    frame: &RgbdFrame,
    timing: &SensorTiming,
    options: &AlignmentOptions,
) -> Option<InitialPose> {
    let elapsed_s = frame.timestamp_s - last.timestamp_s;
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
    let delay_s = frame.depth_delay_s + timing.depth_late_s;
    let delay_share = if elapsed_s > 0.0 { delay_s / elapsed_s } else { 0.0 };
    let current = CurrentDepth { camera, depth_m: &frame.depth_m, delay_share };
    let mut best: Option<Alignment> = None;
    for start in turned.into_iter().chain([predicted, Se3::identity()]) {
        let Some(found) = reference.align((camera, &shutter), pyramid, &start) else { continue };
        let is_good = found.median_residual < GOOD_RESIDUAL;
        if best.as_ref().is_none_or(|best| found.median_residual < best.median_residual) {
            best = Some(found);
        }
        if is_good {
            break;
        }
    }
    let mut found = best?;
    if let Some(surfaces) = &last.surfaces {
        let starts = turned.into_iter().chain([found.current_from_reference]);
        if let Some(motion) = contradiction(surfaces, &current, &found, starts) {
            found.current_from_reference = motion;
        }
    }
    Some(InitialPose {
        last_from_camera: found.current_from_reference.inverse(),
        exposure: Exposure { gain: found.gain as f32, offset: found.offset as f32 },
        median_residual: found.median_residual,
    })
}

/// The motion of the surfaces, where they say that it was another one.
fn contradiction(
    surfaces: &Surfaces,
    current: &CurrentDepth<'_>,
    found: &Alignment,
    starts: impl Iterator<Item = Se3>,
) -> Option<Se3> {
    let share = surfaces.agreement(current, &found.current_from_reference)?;
    if share >= GOOD_SHARE {
        return None;
    }
    let aligned = starts.filter_map(|start| {
        let motion = surfaces.align(current, &start)?;
        Some((surfaces.agreement(current, &motion)?, motion))
    });
    let (most, motion) = aligned.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (most > share + CLEAR_SHARE).then_some(motion)
}
