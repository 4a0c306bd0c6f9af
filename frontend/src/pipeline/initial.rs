//! A. The initial pose of a frame: the best alignment from several starts. Compares with the last frame
//! only; the map is used later. Where the source gives poses, the motion between them is the first
//! start, however far apart the frames are, and the guess where nothing aligns. While few landmarks are
//! known, surfaces can reject the alignment, because one textured object that moves can have more
//! gradients than the room. The rotation of the small image is used instead: there each part of the view
//! counts by its area.

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Vector2;

use super::{COASTING_RESIDUAL, CurrentFrame, LastFrame, Motion, Pipeline};
use crate::image::Image;
use crate::motion::warp::Exposure;
use crate::shutter::Shutter;
use crate::tracking::alignment::{Alignment, FINEST, Reference};
use crate::tracking::rotation::SmallImage;
use crate::tracking::surfaces::{CurrentDepth, Surfaces};

/// With a median residual below this no other start is tried, gray levels.
const GOOD_RESIDUAL: f32 = 6.0;

/// An alignment that at least this share of the surfaces agrees with is accepted.
const GOOD_SHARE: f64 = 0.8;
/// Below that, its share must exceed the share of the rotation by more than this.
const CLEAR_SHARE: f64 = 0.2;

/// A. The motion of a frame since the last one.
pub(super) struct InitialPose {
    /// last_from_camera.
    pub(super) motion: Motion,
    pub(super) exposure: Exposure,
    /// Median residual of the alignment, gray levels.
    pub(super) median_residual: f32,
}

impl Pipeline {
    /// A. The initial pose; `None` where no alignment with the last frame is found.
    pub(super) fn initial_pose(
        &self,
        last: &LastFrame,
        frame: &CurrentFrame<'_>,
    ) -> Option<InitialPose> {
        let (camera, timing) = (&self.camera, &self.options.timing);
        let seconds = frame.rgbd.timestamp_s - last.timestamp_s;
        let given = last.given_pose.zip(frame.rgbd.given_pose);
        let given = given.map(|(last, now)| last.inverse().compose(&now));
        // Else the last motion continues at the same rate for the elapsed time.
        let known =
            given.map_or(last.motion, |first_from_second| Motion { first_from_second, seconds });
        let Motion { first_from_second, seconds: known_s } = &known;
        let rate = if *known_s > 0.0 { 1.0 / known_s } else { 0.0 };
        let predicted = match given {
            Some(given) => given.inverse(),
            None => Se3::exp(&(first_from_second.log() * (seconds * rate))).inverse(),
        };
        let turn_rate = first_from_second.rotation.log() * rate;
        let shutter = Shutter::new(camera, &turn_rate, timing.readout_s);
        let is_moving = |pixel: &Vector2<f64>| {
            let at = |x: f64, size: usize| (x.max(0.0) as usize).min(size - 1);
            let value =
                |mask: &Image<u8>| mask.at(at(pixel.x, mask.width()), at(pixel.y, mask.height()));
            last.moving.as_ref().is_some_and(|mask| value(mask) > 127)
        };
        let small = SmallImage::new(&frame.pyramid);
        let turned = last.small.rotation_to(&small, camera, &predicted.rotation, is_moving);
        let turned = turned.map(|rotation| Se3::new(rotation, predicted.translation));
        let starts = match given {
            Some(_) => [Some(predicted), turned, Some(Se3::identity())],
            None => [turned, Some(predicted), Some(Se3::identity())],
        };
        // What nothing aligns with is a guess: landmarks must confirm it.
        let guess = || {
            let first_from_second = starts.iter().flatten().next()?.inverse();
            let motion = Motion { first_from_second, seconds };
            let (exposure, median_residual) = (Exposure::SAME, f32::INFINITY);
            Some(InitialPose { motion, exposure, median_residual })
        };
        if last.points.is_empty() {
            return guess();
        }
        let reference = Reference::new(camera, &last.pyramid, &last.points, FINEST);
        let mut best: Option<Alignment> = None;
        for start in starts.iter().flatten() {
            let Some(found) = reference.align(camera, &shutter, &frame.pyramid, start) else {
                continue;
            };
            let is_good = found.median_residual < GOOD_RESIDUAL;
            if best.as_ref().is_none_or(|best| found.median_residual < best.median_residual) {
                best = Some(found);
            }
            if is_good {
                break;
            }
        }
        let is_fit =
            |found: &Alignment| given.is_none() || found.median_residual < COASTING_RESIDUAL;
        let Some(mut found) = best.filter(is_fit) else { return given.and_then(|_| guess()) };
        let delay_s = frame.rgbd.depth_delay_s + timing.depth_late_s;
        let delay_share = if seconds > 0.0 { delay_s / seconds } else { 0.0 };
        let current = CurrentDepth { camera, depth_m: &frame.rgbd.depth_m, delay_share };
        if let (Some(surfaces), Some(turned)) = (&last.surfaces, &turned)
            && prefer_turn(surfaces, &current, &found.current_from_reference, turned)
        {
            found.current_from_reference = *turned;
        }
        let first_from_second = found.current_from_reference.inverse();
        Some(InitialPose {
            motion: Motion { first_from_second, seconds },
            exposure: Exposure { gain: found.gain as f32, offset: found.offset as f32 },
            median_residual: found.median_residual,
        })
    }
}

/// Whether surfaces prefer the rotation of the small image, with the predicted translation, to an
/// alignment. The rotation has fewer degrees of freedom and is misled less: the alignment must agree
/// with most of the surfaces, or with clearly more of them. Depth is taken at another time than color,
/// so that no motion agrees with all surfaces while the turn rate changes.
fn prefer_turn(
    surfaces: &Surfaces,
    current: &CurrentDepth<'_>,
    aligned: &Se3,
    turned: &Se3,
) -> bool {
    let share = |motion: &Se3| surfaces.agreement(current, motion);
    share(aligned)
        .filter(|&share| share < GOOD_SHARE)
        .zip(share(turned))
        .is_some_and(|(aligned, turned)| aligned <= turned + CLEAR_SHARE)
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::So3;
    use nalgebra::Vector3;

    use super::*;
    use crate::camera::FrameCamera;
    use crate::pyramid::Pyramid;
    use crate::synthetic::{SceneName, Sequence, SequenceOptions};
    use crate::tracking::local_matching::CurrentView;

    /// Whether the turn is preferred between two frames of a static room, half a second apart, if
    /// alignment and turn have these errors.
    fn turn_is_preferred(aligned_off: &Se3, turned_off: &Se3) -> bool {
        let options = SequenceOptions { width: 320, height: 240, frames: 9, seed: 3, noise: false };
        let sequence = Sequence::new(SceneName::Static, &options);
        let camera = FrameCamera::new(*sequence.camera(), 320, 240).unwrap();
        let [last, next] = [0, 8].map(|index| sequence.frame(index));
        let (pyramid, depth_m) = (&Pyramid::new(last.gray(), 4), &last.depth_m);
        let (shutter, moving) = (Shutter::default(), None);
        let view = CurrentView { camera: &camera, pyramid, depth_m, shutter, moving };
        let current = CurrentDepth { camera: &camera, depth_m: &next.depth_m, delay_share: 0.0 };
        let truth = sequence.world_from_camera(8).inverse().compose(&sequence.world_from_camera(0));
        let [aligned, turned] = [aligned_off, turned_off].map(|off| truth.compose(off));
        prefer_turn(&Surfaces::new(&view), &current, &aligned, &turned)
    }

    fn off(turned: [f64; 3], moved: [f64; 3]) -> Se3 {
        Se3::new(So3::exp(&Vector3::from(turned)), Vector3::from(moved))
    }

    #[test]
    fn an_alignment_that_surfaces_agree_with_needs_no_other_opinion() {
        assert!(!turn_is_preferred(&off([0.002, 0.0, 0.0], [0.0; 3]), &Se3::identity()));
    }

    #[test]
    fn an_alignment_that_rode_along_with_something_yields_to_the_turn_of_the_image() {
        let rode_along = off([0.03, -0.02, 0.01], [0.01, -0.02, 0.04]);
        assert!(turn_is_preferred(&rode_along, &off([0.0, 0.004, 0.0], [0.004, 0.0, 0.0])));
        // With equal errors the simpler one is preferred.
        assert!(turn_is_preferred(&rode_along, &rode_along));
    }

    #[test]
    fn a_turn_that_surfaces_contradict_clearly_more_is_not_preferred() {
        let [less, more] = [0.02, 0.15].map(|angle| off([angle, -angle, 0.0], [0.0; 3]));
        assert!(!turn_is_preferred(&less, &more));
    }
}
