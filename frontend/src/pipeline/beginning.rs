//! How a sequence begins: the first keyframe is made twice.
//!
//! While the camera turns, the rolling shutter distorts a frame, and depth is measured at another time
//! than color. Both effects can be corrected once the next frame shows the motion; until then the first
//! keyframe is held back. Landmarks with an uncorrected distortion would never fit again. No later
//! keyframe is made twice.

use std::sync::Arc;

use super::{CurrentFrame, Findings, FoundPose, Motion, Outcome, Pipeline, StageSeconds};
use crate::image::{Image, RgbdFrame};
use crate::local_map::{CameraPose, LocalMap};
use crate::motion::MotionDetector;
use crate::motion::warp::Exposure;
use crate::pyramid::Pyramid;
use crate::tracking::keyframe::{NewKeyframe, unmatched_corners};

/// Landmarks that the first keyframe needs.
const LEAST_LANDMARKS: usize = 50;
/// The motion has the error of the first frame; each round of its correction improves both.
const ROUNDS: usize = 3;

/// The first frame, kept until the next one shows how the camera turned.
pub(super) struct FirstFrame {
    rgbd: RgbdFrame,
    pyramid: Arc<Pyramid>,
    given_mask: Option<Image<u8>>,
    keyframe: Option<NewKeyframe>,
}

impl Pipeline {
    /// Makes the first frame with enough landmarks the first keyframe, which the outcome of the next
    /// frame has.
    pub(super) fn begin(&mut self, frame: CurrentFrame<'_>) -> Outcome {
        let first = FirstFrame {
            rgbd: frame.rgbd.clone(),
            pyramid: Arc::clone(&frame.pyramid),
            given_mask: frame.given_mask.cloned(),
            keyframe: None,
        };
        let mut findings = self.at_origin(frame, Motion::unknown());
        let view = findings.frame.view(&self.camera, findings.moving.as_ref());
        if unmatched_corners(&view, &[]).len() < LEAST_LANDMARKS {
            findings.pose = None;
            return self.finish(findings, false);
        }
        let mut outcome = self.finish(findings, true);
        self.first = Some(FirstFrame { keyframe: outcome.keyframe.take(), ..first });
        outcome
    }

    /// Processes the first frame again, because the next one shows how the camera turned while its rows
    /// and its depth were captured. Returns the first keyframe.
    pub(super) fn begin_again(&mut self, next: &CurrentFrame<'_>) -> Option<NewKeyframe> {
        let FirstFrame { rgbd, pyramid, given_mask, mut keyframe } = self.first.take()?;
        for _ in 0..ROUNDS {
            let initial = self.last.as_ref().and_then(|last| self.initial_pose(last, next));
            let Some(initial) = initial else { break };
            let frame = CurrentFrame::new(&rgbd, Arc::clone(&pyramid), given_mask.as_ref())
                .synchronized(&self.camera, &self.options.timing, &initial.motion);
            self.map = LocalMap::default();
            self.detector = self.options.removes_motion.then(|| MotionDetector::new(&self.camera));
            self.last = None;
            let findings = self.at_origin(frame, initial.motion);
            keyframe = self.finish(findings, true).keyframe;
        }
        keyframe
    }

    /// A frame whose camera is the origin of map and odometry.
    fn at_origin<'a>(&mut self, frame: CurrentFrame<'a>, motion: Motion) -> Findings<'a> {
        let pose = CameraPose::origin();
        let moving = self.detect_movement(&frame, &pose, Exposure::SAME);
        let pose = Some(FoundPose { pose, motion, inliers: Vec::new() });
        Findings { frame, pose, moving, seconds: StageSeconds::default() }
    }
}
