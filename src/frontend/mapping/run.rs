//! A whole sequence: frames from a source through the pipeline, keyframes to the server and
//! corrections back, until the trajectory stands on the final map.
//!
//! In lock-step, so that a run repeats to the digit. Frames are decoded ahead on a thread of their
//! own; a frame that cannot be read is told and passed over.

use std::sync::mpsc;
use std::time::Instant;

use covis_solvers::geometry::{LieGroup, Se3};

use super::Mapper;
use crate::client::{Client, ClientError};
use crate::frontend::image::{Image, RgbdFrame};
use crate::frontend::input::{FrameError, FrameSource};
use crate::frontend::pipeline::{Outcome, Pipeline, StageSeconds, TrackedFrame};

/// Frames that are decoded ahead.
const AHEAD: usize = 4;

/// Where the keyframes go.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// The server.
    pub client: &'a Client,
    /// A map that exists there.
    pub map_id: &'a str,
    /// Who sends.
    pub client_id: &'a str,
}

/// Durations of one kind, seconds, in the order of frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Durations {
    /// Reading and decoding a frame.
    pub decode: Vec<f64>,
    /// Tracking it, with what follows.
    pub stages: Vec<StageSeconds>,
    /// Waiting for the server, a keyframe.
    pub map: Vec<f64>,
}

/// What a run left.
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

/// What a caller sees of a run while it goes on, and what it knows.
pub trait Companion {
    /// What the user knows to move in the frame of this time: 255 there.
    fn mask(&mut self, timestamp_s: f64) -> Option<Image<u8>>;

    /// A frame was tracked, or lost.
    fn tracked(&mut self, frame: &RgbdFrame, outcome: &Outcome);

    /// A frame could not be read.
    fn skipped(&mut self, error: &FrameError);
}

/// Runs a source through a pipeline. `decodes_ahead` takes a thread more.
///
/// # Errors
/// Why the session with the server ended.
pub async fn run(
    mut source: Box<dyn FrameSource>,
    mut pipeline: Pipeline,
    target: Target<'_>,
    decodes_ahead: bool,
    companion: &mut dyn Companion,
) -> Result<RunReport, ClientError> {
    let Target { client, map_id, client_id } = target;
    let mut mapper = Mapper::open(client, map_id, client_id, pipeline.camera()).await?;
    let mut report = RunReport::default();
    let mut frames = move || {
        let start = Instant::now();
        Some((source.next_frame()?, start.elapsed().as_secs_f64()))
    };
    if decodes_ahead {
        let (sender, receiver) = mpsc::sync_channel(AHEAD);
        // It ends with the source, or when nobody receives any more.
        let decoder = std::thread::spawn(move || {
            while let Some(frame) = frames() {
                if sender.send(frame).is_err() {
                    break;
                }
            }
        });
        for (frame, seconds) in receiver {
            step(frame, seconds, &mut pipeline, &mut mapper, companion, &mut report).await?;
        }
        // A decoder that panicked has told so on its own; the frames so far stand.
        let _ended = decoder.join();
    } else {
        while let Some((frame, seconds)) = frames() {
            step(frame, seconds, &mut pipeline, &mut mapper, companion, &mut report).await?;
        }
    }
    if !pipeline.map().keyframes.is_empty() {
        pipeline.correct(&mapper.optimize().await?);
    }
    mapper.finish().await?;
    let map = pipeline.map();
    let pose = |tracked: &TrackedFrame| {
        map.keyframes[tracked.keyframe].world_from_camera.compose(&tracked.keyframe_from_camera)
    };
    report.trajectory = report.live.iter().map(|t| (t.timestamp_s, pose(t))).collect();
    report.keyframes = map.keyframes.iter().map(|k| (k.timestamp_s, k.world_from_camera)).collect();
    report.landmarks = map.landmarks.len();
    Ok(report)
}

/// One frame, read or not.
async fn step(
    frame: Result<RgbdFrame, FrameError>,
    decode_s: f64,
    pipeline: &mut Pipeline,
    mapper: &mut Mapper,
    companion: &mut dyn Companion,
    report: &mut RunReport,
) -> Result<(), ClientError> {
    let frame = match frame {
        Ok(frame) => frame,
        Err(error) => {
            report.skipped += 1;
            companion.skipped(&error);
            return Ok(());
        }
    };
    report.frames += 1;
    let mask = companion.mask(frame.timestamp_s);
    let outcome = pipeline.track(&frame, mask.as_ref());
    report.durations.decode.push(decode_s);
    report.durations.stages.push(outcome.seconds);
    report.live.extend(outcome.tracked);
    companion.tracked(&frame, &outcome);
    if let Some(keyframe) = &outcome.keyframe {
        let start = Instant::now();
        pipeline.correct(&mapper.map_keyframe(keyframe).await?);
        report.durations.map.push(start.elapsed().as_secs_f64());
    }
    Ok(())
}
