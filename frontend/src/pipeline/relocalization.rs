//! Relocalization after tracking was lost: the pose of a lost frame is asked for, and the frames that
//! follow are aligned with one another until the answer comes.
//!
//! Where the answer comes from is not known here; on a robot it is the server. The answer is the pose
//! of an earlier frame; the motion since then carries it to the newest frame, however late it comes.
//! Where that motion is lost too, the newest frame is asked for instead. Besides, each frame is aligned
//! with the last one whose pose is known: without any answer tracking resumes where the camera comes
//! back to it. With odometry nothing is asked for: where no landmark confirms the frame, odometry says where
//! it is, and the place is mapped anew. A frame that was found is not published, because how the camera
//! turns meanwhile, and so the error of its shutter, is not known: the next one is tracked from it.

use std::sync::Arc;

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Vector2;

use super::pose::{FEW_INLIERS, match_map};
use super::{COASTING_RESIDUAL, CurrentFrame, LastFrame, Motion, Pipeline, State};
use crate::depth;
use crate::features::corners::CornerOptions;
use crate::features::descriptor::{Describer, Descriptor, Size};
use crate::local_map::CameraPose;
use crate::tracking::local_matching::CurrentView;
use crate::tracking::surfaces::Surfaces;

/// Fewer corners than this do not show where a camera is.
const LEAST_FEATURES: usize = 12;
/// Standard deviation of a corner, pixels. The motion of the frame is not known: the shutter is not
/// corrected, and depth is of another time.
const SIGMA_PX: f64 = 2.0;

/// A corner of a lost frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feature {
    /// Where the image shows it.
    pub pixel: Vector2<f64>,
    /// Standard deviation of each coordinate, pixels.
    pub sigma_px: f64,
    /// Depth and its standard deviation, meters.
    pub depth_m: (f64, f64),
    /// What it looks like.
    pub descriptor: Descriptor,
}

/// A lost frame, whose pose in the map is asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Question {
    /// The answer has the same.
    pub number: u64,
    /// What the frame shows.
    pub features: Vec<Feature>,
}

/// The answer to a question.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// That of the question.
    pub number: u64,
    /// The pose of the frame; `None` where it was not found.
    pub world_from_camera: Option<Se3>,
}

/// The frame that was asked for, and those after it.
pub(super) struct Asked {
    number: u64,
    /// The newest of them; its pose in the map stands for asked_from_camera.
    newest: LastFrame,
}

impl Pipeline {
    /// Takes a frame after tracking was lost.
    pub(super) fn track_lost_frame(&mut self, frame: &CurrentFrame<'_>) -> Option<Question> {
        let view = frame.view(&self.camera, frame.given_mask);
        let (pose, state) = match self.relocalize_near_last_pose(frame) {
            Some(pose) => (pose, State::Confirmed),
            None => match self.odometry_since_last_pose(frame) {
                Some(pose) if features(&view).len() >= LEAST_FEATURES => (pose, State::Located),
                _ => return self.request_relocalization(frame),
            },
        };
        let newest = lost_frame(frame, &view, pose, Motion::unknown());
        self.resume_from(newest, state);
        None
    }

    /// The pose of a frame by odometry since the last one whose pose is known. No landmark need confirm it:
    /// odometry drifts and does not jump.
    fn odometry_since_last_pose(&self, frame: &CurrentFrame<'_>) -> Option<CameraPose> {
        self.odometry.as_ref()?;
        let last = self.last.as_ref()?;
        let last_from_camera = last.given_pose?.inverse().compose(&frame.rgbd.given_pose?);
        let world_from_camera = last.pose.world_from_camera.compose(&last_from_camera);
        Some(last.pose.moved_to(&world_from_camera))
    }

    /// The pose of a frame near the last one whose pose is known, confirmed by landmarks.
    fn relocalize_near_last_pose(&self, frame: &CurrentFrame<'_>) -> Option<CameraPose> {
        let last = self.last.as_ref()?;
        let motion = self.initial_pose(last, frame)?.motion;
        let start = last.pose.world_from_camera.compose(&motion.first_from_second);
        let view = frame.view(&self.camera, frame.given_mask);
        let refined = match_map(&self.map, &view, &start)?.refined;
        let is_confirmed = refined.inliers.len() >= FEW_INLIERS;
        is_confirmed.then(|| last.pose.moved_to(&refined.world_from_camera))
    }

    /// The next frame is tracked from this one.
    fn resume_from(&mut self, frame: LastFrame, state: State) {
        (self.last, self.state, self.asked) = (Some(frame), state, None);
        self.coasted = 0;
    }

    /// Takes a frame whose pose is not known. Returns a question, unless one is out that can still be
    /// used.
    pub(super) fn request_relocalization(&mut self, frame: &CurrentFrame<'_>) -> Option<Question> {
        self.state = State::Lost;
        if let Some(Asked { number, newest }) = self.asked.take()
            && let Some(newest) = self.track_since_request(&newest, frame)
        {
            self.asked = Some(Asked { number, newest });
            return None;
        }
        let view = frame.view(&self.camera, frame.given_mask);
        let features = features(&view);
        if features.len() < LEAST_FEATURES {
            return None;
        }
        self.questions += 1;
        let number = self.questions;
        let newest = lost_frame(frame, &view, CameraPose::origin(), Motion::unknown());
        self.asked = Some(Asked { number, newest });
        Some(Question { number, features })
    }

    /// Takes the answer to a question: the next frame is tracked from the newest one since. Odometry
    /// continues by the motion in the map, without a gap. Returns whether that frame has a pose now: not
    /// where none was found, nor where tracking was resumed meanwhile or the motion since the question was
    /// lost.
    pub fn answer(&mut self, answer: &Answer) -> bool {
        let is_answered = |asked: &mut Asked| asked.number == answer.number;
        let asked = self.asked.take_if(is_answered);
        let (Some(Asked { newest, .. }), Some(world_from_asked), Some(known)) =
            (asked, answer.world_from_camera, &self.last)
        else {
            return false;
        };
        let world_from_camera = world_from_asked.compose(&newest.pose.world_from_camera);
        let pose = known.pose.moved_to(&world_from_camera);
        self.resume_from(LastFrame { pose, ..newest }, State::Located);
        true
    }

    /// The frame after the newest of those that wait for an answer, where an alignment gives its motion.
    fn track_since_request(
        &self,
        newest: &LastFrame,
        frame: &CurrentFrame<'_>,
    ) -> Option<LastFrame> {
        let initial = self.initial_pose(newest, frame)?;
        if initial.median_residual >= COASTING_RESIDUAL {
            return None;
        }
        let asked_from_newest = newest.pose.world_from_camera;
        let asked_from_camera = asked_from_newest.compose(&initial.motion.first_from_second);
        let pose = newest.pose.moved_to(&asked_from_camera);
        let frame = CurrentFrame::new(frame.rgbd, Arc::clone(&frame.pyramid), frame.given_mask)
            .synchronized(&self.camera, &self.options.timing, &initial.motion);
        let view = frame.view(&self.camera, frame.given_mask);
        Some(lost_frame(&frame, &view, pose, initial.motion))
    }
}

/// A lost frame as the next one needs it. No landmarks tell what moves: surfaces do.
fn lost_frame(
    frame: &CurrentFrame<'_>,
    view: &CurrentView<'_>,
    pose: CameraPose,
    motion: Motion,
) -> LastFrame {
    let surfaces = Some(Surfaces::new(view));
    LastFrame { surfaces, ..LastFrame::new(frame, view, pose, motion) }
}

/// The corners of a frame that lie on surfaces.
fn features(view: &CurrentView<'_>) -> Vec<Feature> {
    let describer = Describer::new(view.pyramid);
    let focal_px = view.camera.model().fx;
    let feature = |(pixel, z): (Vector2<f64>, f64)| {
        let size = Size::at(z, focal_px);
        let descriptor = describer.describe(pixel.x as f32, pixel.y as f32, size)?;
        let depth_m = (z, depth::sigma_m(z));
        Some(Feature { pixel, sigma_px: SIGMA_PX, depth_m, descriptor })
    };
    view.corners(&CornerOptions::default(), |_, _| true).filter_map(feature).collect()
}
