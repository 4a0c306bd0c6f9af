//! How a sequence begins: the first keyframe is made twice.
//!
//! While the camera turns, the rolling shutter distorts a frame, and depth is measured at another time
//! than color. Both effects can be corrected once the next frame shows the motion; until then the first
//! keyframe is held back.

use std::sync::Arc;

use covis_solvers::geometry::{LieGroup, Se3};

use super::initial::{self, InitialPose};
use super::{LEAST_LANDMARKS, Now, Outcome, Pipeline, usable_mask};
use crate::image::{Image, RgbdFrame};
use crate::local_map::LocalMap;
use crate::motion::MotionDetector;
use crate::pyramid::Pyramid;
use crate::shutter::Shutter;
use crate::tracking::keyframe::{self, NewKeyframe};

/// The first frame, kept until the next one shows how the camera turned.
pub(super) struct First {
    frame: RgbdFrame,
    pyramid: Arc<Pyramid>,
    /// The user's mask of what moves.
    mask: Option<Image<u8>>,
    pub(super) keyframe: Option<NewKeyframe>,
}

impl Pipeline {
    /// Makes the first frame with enough landmarks the first keyframe. Its camera is the origin of map
    /// and odometry. The keyframe is returned with the next frame.
    pub(super) fn begin(
        &mut self,
        frame: &RgbdFrame,
        pyramid: Arc<Pyramid>,
        mask: Option<&Image<u8>>,
        outcome: &mut Outcome,
    ) {
        let origin = Se3::identity();
        outcome.moving = self.moving(frame, (&pyramid, &frame.depth_m), &origin, None, mask);
        let shutter = Shutter::default();
        let now = Now { frame, pyramid: Arc::clone(&pyramid), depth_m: &frame.depth_m, shutter };
        let view = now.view(&self.camera, usable_mask(outcome.moving.as_ref()));
        let corners = keyframe::free_corners(&view, &[], self.options.keyframes.cell_px);
        if corners.len() < LEAST_LANDMARKS {
            return;
        }
        self.finish_frame(&now, outcome, (origin, origin), (origin, 0.0), &[], true);
        let keyframe = outcome.keyframe.take();
        self.first = Some(First { frame: frame.clone(), pyramid, mask: mask.cloned(), keyframe });
    }

    /// Processes the first frame again, because the next one shows how the camera turned while its rows
    /// and its depth were captured. Landmarks with an uncorrected shutter distortion would never fit
    /// again.
    pub(super) fn begin_again(
        &mut self,
        first: &mut First,
        (pyramid, next): (&Pyramid, &RgbdFrame),
    ) {
        /// The motion has the error of the first frame; each round improves both.
        const ROUNDS: usize = 3;
        let origin = Se3::identity();
        let (frame, timing) = (&first.frame, self.options.timing);
        let elapsed_s = next.timestamp_s - frame.timestamp_s;
        for _ in 0..ROUNDS {
            let Some(last) = &self.last else { return };
            let options = &self.options.alignment;
            let initial =
                initial::initial_pose(&self.camera, last, pyramid, next, &timing, options);
            let Some(InitialPose { last_from_camera, .. }) = initial else { return };
            let (shutter, synchronized) = self.synchronize(frame, &last_from_camera, elapsed_s);
            let depth_m = synchronized.as_ref().unwrap_or(&frame.depth_m);
            let mut outcome = Outcome::default();
            self.map = LocalMap::default();
            self.detector = self.options.motion.map(|m| MotionDetector::new(&self.camera, m));
            let images = (&*first.pyramid, depth_m);
            outcome.moving = self.moving(frame, images, &origin, None, first.mask.as_ref());
            let now = Now { frame, pyramid: Arc::clone(&first.pyramid), depth_m, shutter };
            self.last = None;
            let motion = (last_from_camera, elapsed_s);
            self.finish_frame(&now, &mut outcome, (origin, origin), motion, &[], true);
            first.keyframe = outcome.keyframe;
        }
    }
}
