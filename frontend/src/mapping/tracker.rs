//! The tracking thread: frames in, poses out; keyframes and questions to mapping, corrections and answers
//! from it.
//!
//! Never waits for the server, except in lock-step. Dense mapping has a short queue of its own. What a
//! user's companion does with a frame is not counted as a frame's time.

use std::sync::mpsc::sync_channel;
use std::time::Instant;

use covis_solvers::geometry::Se3;
use tokio::sync::mpsc::UnboundedSender;

use super::handover::{Fetching, FromServer, FromTracking};
use super::run::{Companion, Durations};
use crate::dense::frame_log::LoggedFrame;
use crate::dense::mapper::AnchoredFrame;
use crate::dense::thread::DenseFeed;
use crate::image::RgbdFrame;
use crate::input::{FrameError, FrameSource};
use crate::local_map::Corrections;
use crate::pipeline::{Outcome, Pipeline, TrackedFrame};

/// Frames that are decoded ahead.
const AHEAD: usize = 4;

/// What tracking knows at the end.
#[derive(Clone, Debug, Default)]
pub(super) struct Tracked {
    pub(super) frames: usize,
    pub(super) skipped: usize,
    pub(super) live: Vec<TrackedFrame>,
    pub(super) landmarks: usize,
    pub(super) corrections: usize,
    pub(super) relocalizations: usize,
    pub(super) durations: Durations,
}

/// Tracks a source.
pub(super) struct Tracker<C> {
    pub(super) pipeline: Pipeline,
    pub(super) companion: C,
    pub(super) dense: Option<DenseFeed>,
    /// Mapping takes it at once.
    pub(super) mapping: UnboundedSender<FromTracking>,
    pub(super) from_server: Fetching,
    pub(super) tracked: Tracked,
}

impl<C: Companion> Tracker<C> {
    /// Tracks all frames, until mapping is gone.
    pub(super) fn run(
        mut self,
        mut source: Box<dyn FrameSource>,
        decodes_ahead: bool,
    ) -> (Tracked, C) {
        let mut frames = move || {
            let start = Instant::now();
            Some((source.next_frame()?, start.elapsed().as_secs_f64()))
        };
        if decodes_ahead {
            let (sender, receiver) = sync_channel(AHEAD);
            // It ends with the source, or when the receiver is gone.
            let decoder = std::thread::spawn(move || {
                while let Some(frame) = frames() {
                    if sender.send(frame).is_err() {
                        break;
                    }
                }
            });
            for (frame, seconds) in &receiver {
                if !self.step(frame, seconds) {
                    break;
                }
            }
            drop(receiver);
            // A decoder that panicked has already reported it; the frames so far are valid.
            let _ended = decoder.join();
        } else {
            while let Some((frame, seconds)) = frames() {
                if !self.step(frame, seconds) {
                    break;
                }
            }
        }
        self.tracked.landmarks = self.pipeline.map().next_landmark();
        (self.tracked, self.companion)
    }

    /// One frame, read or not. Whether there is still someone to map.
    fn step(&mut self, frame: Result<RgbdFrame, FrameError>, decode_s: f64) -> bool {
        let frame = match frame {
            Ok(frame) => frame,
            Err(error) => {
                self.tracked.skipped += 1;
                self.companion.skipped(&error);
                return true;
            }
        };
        self.tracked.frames += 1;
        let mask = self.companion.mask(frame.timestamp_s);
        let start = Instant::now();
        let fetched = self.from_server.fetch();
        let has_fetched = fetched.is_some();
        self.take(fetched);
        let fetch_s = start.elapsed().as_secs_f64();
        let mut outcome = self.pipeline.track(&frame, mask.as_ref());
        self.tracked.live.extend(outcome.tracked);
        self.companion.tracked(&frame, &outcome);

        let start = Instant::now();
        let (keyframe, question) = (outcome.keyframe.take(), outcome.question.take());
        let seconds = outcome.seconds;
        self.map_densely(frame, outcome, keyframe.is_some());
        let dense_s = start.elapsed().as_secs_f64();
        let keyframe = keyframe.map(|keyframe| FromTracking::Keyframe(Box::new(keyframe)));
        let question = question.map(FromTracking::Question);
        let hands_over = keyframe.is_some() || question.is_some();
        for message in keyframe.into_iter().chain(question) {
            if self.mapping.send(message).is_err() {
                return false;
            }
            let follows = self.from_server.after_handing_over();
            self.take(follows);
        }
        let map_s = fetch_s + start.elapsed().as_secs_f64() - dense_s;
        let durations = &mut self.tracked.durations;
        durations.decode.push(decode_s);
        durations.stages.push(seconds);
        durations.frame.push(seconds.track + map_s + dense_s);
        if hands_over || has_fetched {
            durations.map.push(map_s);
        }
        !self.mapping.is_closed()
    }

    /// Hands a frame to dense mapping, if it is due and its pose is based on landmarks.
    fn map_densely(&self, frame: RgbdFrame, outcome: Outcome, keyframe_is_new: bool) {
        let Some(dense) = &self.dense else { return };
        let is_due = (self.tracked.frames - 1).is_multiple_of(dense.every.max(1));
        // A pose of the alignment alone drifts; the first keyframe has no landmarks before it.
        let is_sure = |tracked: &TrackedFrame| tracked.inliers > 0 || keyframe_is_new;
        let Some(tracked) = outcome.tracked.filter(is_sure).filter(|_| is_due) else { return };
        let frame = LoggedFrame {
            depth_m: outcome.synchronized_depth_m.unwrap_or(frame.depth_m),
            color: frame.color,
            moving: outcome.moving,
        };
        let TrackedFrame { keyframe, keyframe_from_camera, .. } = tracked;
        let Some(reference) = self.pipeline.map().keyframe(keyframe) else { return };
        let anchored = AnchoredFrame { frame, keyframe, keyframe_from_camera };
        dense.integrate(anchored, reference.world_from_camera);
    }

    /// Takes what came from the server.
    fn take(&mut self, news: Option<FromServer>) {
        let Some(FromServer { corrections, answer }) = news else { return };
        self.correct(corrections);
        if answer.is_some_and(|answer| self.pipeline.answer(&answer)) {
            self.tracked.relocalizations += 1;
        }
    }

    /// Applies what the server corrected.
    fn correct(&mut self, corrections: Corrections) {
        self.tracked.corrections += usize::from(!corrections.is_empty());
        self.pipeline.correct(&corrections);
        let Some(dense) = &self.dense else { return };
        let mut poses: Vec<(usize, Se3)> = corrections.keyframes;
        if let Some(newer) = corrections.newer {
            let moved = self.pipeline.map().keyframes.iter().filter(|k| k.id >= newer.keyframe);
            poses.extend(moved.map(|keyframe| (keyframe.id, keyframe.world_from_camera)));
        }
        dense.correct(poses);
    }
}
