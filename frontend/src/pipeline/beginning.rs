//! How a sequence begins: the first keyframe, made twice.
//!
//! A frame of a camera that turns is bent by its shutter, and its depth is of another time. By how
//! much is known when the next frame has come; until then the first keyframe is kept back.

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

/// The first frame, until the next one tells how the camera turned.
pub(super) struct First {
    frame: RgbdFrame,
    pyramid: Arc<Pyramid>,
    /// What its user knows to move.
    mask: Option<Image<u8>>,
    pub(super) keyframe: Option<NewKeyframe>,
}

impl Pipeline {
    /// The first frame with enough landmarks is the first keyframe, its camera the origin of map and
    /// odometry. It is handed out with the next frame.
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

    /// The first frame once more, now that the next one tells how the camera turned while its rows
    /// and its depth were taken: landmarks that are off by what a shutter bends never fit again.
    pub(super) fn begin_again(
        &mut self,
        first: &mut First,
        (pyramid, next): (&Pyramid, &RgbdFrame),
    ) {
        /// The motion is as wrong as the first frame is; both become better together.
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
