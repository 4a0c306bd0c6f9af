//! Runs a whole sequence: tracks the frames of a source, sends keyframes to the server and applies its
//! corrections, and computes the trajectory on the final map.
//!
//! Of the paper's four threads tracking is here, dense mapping receives the tracked frames
//! ([`DenseThread`]), and the server does local mapping and loop closing. The server runs in lock-step,
//! so that a run repeats to the last digit. Frames are decoded ahead on a separate thread; a frame that
//! cannot be read is reported and skipped.

use std::sync::mpsc;
use std::time::Instant;

use covis_solvers::geometry::{LieGroup, Se3};

use super::Mapper;
use covis_client::{Client, ClientError};

use crate::dense::frame_log::LoggedFrame;
use crate::dense::mapper::AnchoredFrame;
use crate::dense::thread::DenseThread;
use crate::image::{Image, RgbdFrame};
use crate::input::{FrameError, FrameSource};
use crate::local_map::Corrections;
use crate::pipeline::{Outcome, Pipeline, StageSeconds, TrackedFrame};

/// Frames that are decoded ahead.
const AHEAD: usize = 4;

/// The map that receives the keyframes.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// The server.
    pub client: &'a Client,
    /// A map that exists there.
    pub map_id: &'a str,
    /// The client that sends.
    pub client_id: &'a str,
}

/// Where tracked frames are sent.
#[derive(Clone, Copy, Debug)]
pub struct DenseFeed<'a> {
    /// Dense mapping.
    pub thread: &'a DenseThread,
    /// One of this many frames is sent; at least 1.
    pub every: usize,
}

/// Durations in seconds, in the order of frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Durations {
    /// Reading and decoding a frame.
    pub decode: Vec<f64>,
    /// Tracking a frame, by stages.
    pub stages: Vec<StageSeconds>,
    /// Waiting for the server, per keyframe.
    pub map: Vec<f64>,
}

/// The result of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunReport {
    /// Frames that were read.
    pub frames: usize,
    /// Frames that could not be read.
    pub skipped: usize,
    /// Frames with a pose, as published at the time.
    pub live: Vec<TrackedFrame>,
    /// Their poses on the final map: seconds and world_from_camera.
    pub trajectory: Vec<(f64, Se3)>,
    /// The keyframes' final poses.
    pub keyframes: Vec<(f64, Se3)>,
    /// Landmarks that were sent.
    pub landmarks: usize,
    /// How long everything took.
    pub durations: Durations,
}

impl RunReport {
    /// Frames without a pose.
    #[must_use]
    pub fn lost(&self) -> usize {
        self.frames - self.live.len()
    }
}

/// The caller's side of a run: gives masks, and is told about each frame.
pub trait Companion {
    /// The user's mask for the frame of this time: 255 where something moves.
    fn mask(&mut self, timestamp_s: f64) -> Option<Image<u8>>;

    /// A frame was tracked, or lost.
    fn tracked(&mut self, frame: &RgbdFrame, outcome: &Outcome);

    /// A frame could not be read.
    fn skipped(&mut self, error: &FrameError);
}

/// The state of a run.
struct Run<'a> {
    pipeline: Pipeline,
    mapper: Mapper,
    companion: &'a mut dyn Companion,
    dense: Option<DenseFeed<'a>>,
    report: RunReport,
}

/// Runs a source through a pipeline. `decodes_ahead` uses one more thread. At the end, dense mapping,
/// if there is any, has received the final map; the caller waits for it to finish.
///
/// # Errors
/// The error that ended the session with the server.
pub async fn run(
    mut source: Box<dyn FrameSource>,
    pipeline: Pipeline,
    target: Target<'_>,
    decodes_ahead: bool,
    companion: &mut dyn Companion,
    dense: Option<DenseFeed<'_>>,
) -> Result<RunReport, ClientError> {
    let Target { client, map_id, client_id } = target;
    let mapper = Mapper::open(client, map_id, client_id, pipeline.camera()).await?;
    let mut run = Run { pipeline, mapper, companion, dense, report: RunReport::default() };
    let mut frames = move || {
        let start = Instant::now();
        Some((source.next_frame()?, start.elapsed().as_secs_f64()))
    };
    if decodes_ahead {
        let (sender, receiver) = mpsc::sync_channel(AHEAD);
        // It ends with the source, or when the receiver is gone.
        let decoder = std::thread::spawn(move || {
            while let Some(frame) = frames() {
                if sender.send(frame).is_err() {
                    break;
                }
            }
        });
        for (frame, seconds) in receiver {
            run.step(frame, seconds).await?;
        }
        // A decoder that panicked has already reported it; the frames so far are valid.
        let _ended = decoder.join();
    } else {
        while let Some((frame, seconds)) = frames() {
            run.step(frame, seconds).await?;
        }
    }
    run.finish().await
}

impl Run<'_> {
    /// One frame, read or not.
    async fn step(
        &mut self,
        frame: Result<RgbdFrame, FrameError>,
        decode_s: f64,
    ) -> Result<(), ClientError> {
        let frame = match frame {
            Ok(frame) => frame,
            Err(error) => {
                self.report.skipped += 1;
                self.companion.skipped(&error);
                return Ok(());
            }
        };
        self.report.frames += 1;
        let mask = self.companion.mask(frame.timestamp_s);
        let mut outcome = self.pipeline.track(&frame, mask.as_ref());
        self.report.durations.decode.push(decode_s);
        self.report.durations.stages.push(outcome.seconds);
        self.report.live.extend(outcome.tracked);
        self.companion.tracked(&frame, &outcome);
        let keyframe = outcome.keyframe.take();
        self.map_densely(frame, outcome, keyframe.is_some());
        if let Some(keyframe) = &keyframe {
            let start = Instant::now();
            let corrections = self.mapper.map_keyframe(keyframe).await?;
            self.correct(&corrections);
            self.report.durations.map.push(start.elapsed().as_secs_f64());
        }
        Ok(())
    }

    /// Hands a frame to dense mapping, if it is due and its pose is based on landmarks.
    fn map_densely(&self, frame: RgbdFrame, outcome: Outcome, keyframe_is_new: bool) {
        let Some(DenseFeed { thread, every }) = self.dense else { return };
        let is_due = (self.report.frames - 1).is_multiple_of(every.max(1));
        // A pose of the alignment alone drifts; the first keyframe has no landmarks before it.
        let is_sure = |tracked: &TrackedFrame| tracked.inliers > 0 || keyframe_is_new;
        let Some(tracked) = outcome.tracked.filter(is_sure).filter(|_| is_due) else { return };
        let frame = LoggedFrame {
            depth_m: outcome.synchronized_depth_m.unwrap_or(frame.depth_m),
            color: frame.color,
            moving: outcome.moving,
        };
        let TrackedFrame { keyframe, keyframe_from_camera, .. } = tracked;
        let world_from_keyframe = self.pipeline.map().keyframes[keyframe].world_from_camera;
        let anchored = AnchoredFrame { frame, keyframe, keyframe_from_camera };
        thread.integrate(anchored, world_from_keyframe);
    }

    /// Passes on what the server corrected.
    fn correct(&mut self, corrections: &Corrections) {
        self.pipeline.correct(corrections);
        if let Some(dense) = self.dense {
            dense.thread.correct(corrections.keyframes.clone());
        }
    }

    /// Computes the trajectory on the final map.
    async fn finish(mut self) -> Result<RunReport, ClientError> {
        if !self.report.durations.map.is_empty() {
            let corrections = self.mapper.optimize().await?;
            self.correct(&corrections);
        }
        self.mapper.finish().await?;
        let (map, mut report) = (self.pipeline.map(), self.report);
        let pose = |tracked: &TrackedFrame| {
            map.keyframes[tracked.keyframe].world_from_camera.compose(&tracked.keyframe_from_camera)
        };
        report.trajectory = report.live.iter().map(|t| (t.timestamp_s, pose(t))).collect();
        report.keyframes =
            map.keyframes.iter().map(|k| (k.timestamp_s, k.world_from_camera)).collect();
        report.landmarks = map.landmarks.len();
        Ok(report)
    }
}
