//! Runs a whole sequence: tracks the frames of a source, sends keyframes to the server and applies its
//! corrections, and computes the trajectory on the final map.
//!
//! Of the paper's four threads tracking has its own, dense mapping receives the tracked frames
//! ([`crate::dense::thread`]), and the server does local mapping and loop closing. Tracking never waits
//! for the server. In lock-step it waits at each keyframe until a solve has included it, so that a run
//! repeats to the last digit. Frames are decoded ahead on a separate thread; a frame that cannot be
//! read is reported and skipped. It writes no files and prints nothing.

use covis_solvers::geometry::{LieGroup, Se3};
use tokio::sync::{mpsc, oneshot};

use super::handover;
use super::mapper::Mapper;
use super::solves::{LastSolve, LocalSolve};
use super::tracker::{Tracked, Tracker};
use covis_client::{Client, ClientError};

use crate::dense::thread::DenseFeed;
use crate::image::{Image, RgbdFrame};
use crate::input::{FrameError, FrameSource};
use crate::pipeline::{Outcome, Pipeline, StageSeconds, TrackedFrame};

/// The most keyframes that wait for the server's answer in memory, some 60 kB each: five minutes of a
/// moving camera.
pub const MOST_HELD: usize = 1000;
/// The period of a usual camera, seconds: a frame that takes longer comes late.
const PERIOD_S: f64 = 1.0 / 30.0;

/// The map that receives the keyframes.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// The server.
    pub client: &'a Client,
    /// A map that exists there.
    pub map_id: &'a str,
    /// The client that sends.
    pub client_id: &'a str,
    /// Whether tracking waits at each keyframe until a solve has included it.
    pub lock_step: bool,
    /// The most items that wait for the server's answer, at least 1; [`MOST_HELD`] as a rule. Beyond
    /// it keyframes are left out.
    pub most_held: usize,
}

/// Durations in seconds, in the order of frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Durations {
    /// Reading and decoding a frame.
    pub decode: Vec<f64>,
    /// Tracking a frame, by stages.
    pub stages: Vec<StageSeconds>,
    /// Tracking a frame and handing it over: all that the tracking thread does for it.
    pub frame: Vec<f64>,
    /// The part of it for mapping, of frames with a keyframe, a question or a correction: handing over,
    /// in lock-step waiting for the server.
    pub map: Vec<f64>,
}

/// Constraints of kind `LOOP_CLOSURE` in the map at the end, whoever found them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loops {
    /// Those that count.
    pub counting: usize,
    /// Those that were found false and are switched off.
    pub switched_off: usize,
    /// Of those that count and are the run's own: when the camera came back, and when it had been there,
    /// seconds, in the order of the first.
    pub times_s: Vec<(f64, f64)>,
}

/// The result of a run.
#[derive(Clone, Debug, Default)]
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
    /// Landmarks that were made.
    pub landmarks: usize,
    /// How often tracking took corrections from the server.
    pub corrections: usize,
    /// How often the server found the pose of a lost frame.
    pub relocalizations: usize,
    /// Loop closures of the map.
    pub loops: Loops,
    /// The server's solves that covered the run's keyframes, in the order of their answers.
    pub local_solves: Vec<LocalSolve>,
    /// The optimization of the whole map at the end; absent where the session had ended before.
    pub last_solve: Option<LastSolve>,
    /// The most keyframes that waited for the server's answer.
    pub most_held: usize,
    /// Keyframes that were not sent, because too many waited or the session had ended.
    pub left_out: usize,
    /// How often the link broke and came back.
    pub reconnects: u64,
    /// Why the session with the server ended early; tracking went on without it.
    pub failure: Option<ClientError>,
    /// How long everything took.
    pub durations: Durations,
}

impl RunReport {
    /// Frames without a pose.
    #[must_use]
    pub fn lost(&self) -> usize {
        self.frames - self.live.len()
    }

    /// Frames that took the tracking thread longer than a camera's period.
    #[must_use]
    pub fn late(&self) -> usize {
        self.durations.frame.iter().filter(|seconds| **seconds > PERIOD_S).count()
    }
}

/// The caller's side of a run: gives masks, and receives each frame. Called on the tracking
/// thread.
pub trait Companion {
    /// The user's mask for the frame of this time: 255 where something moves.
    fn mask(&mut self, timestamp_s: f64) -> Option<Image<u8>>;

    /// A frame was tracked, or lost.
    fn tracked(&mut self, frame: &RgbdFrame, outcome: &Outcome);

    /// A frame could not be read.
    fn skipped(&mut self, error: &FrameError);
}

/// Runs a source through a pipeline, on a thread of its own, and gives the companion back.
/// `decodes_ahead` uses one more thread. At the end, dense mapping, if there is any, has received the
/// final map; the caller waits for it to finish.
///
/// # Errors
/// The session cannot be opened. In lock-step also what ended it; otherwise that is
/// [`RunReport::failure`].
///
/// # Panics
/// If tracking panicked.
pub async fn run<C: Companion + Send + 'static>(
    source: Box<dyn FrameSource>,
    pipeline: Pipeline,
    target: Target<'_>,
    decodes_ahead: bool,
    companion: C,
    dense: Option<DenseFeed>,
) -> Result<(RunReport, C), ClientError> {
    let mut mapper = Mapper::open(&target, pipeline.camera()).await?;
    let (mapping, inbox) = mpsc::unbounded_channel();
    let (putting, from_server) = handover::from_server(target.lock_step);
    let (ended, end) = oneshot::channel();
    let tracker = Tracker {
        pipeline,
        companion,
        dense: dense.clone(),
        mapping,
        from_server,
        tracked: Tracked::default(),
    };
    let tracking = std::thread::spawn(move || {
        // The receiver is gone when the run was given up.
        let _gone = ended.send(tracker.run(source, decodes_ahead));
    });
    mapper.serve(inbox, putting).await?;
    let (tracked, companion) = match end.await {
        Ok(ended) => ended,
        Err(_panicked) => match tracking.join() {
            Err(panic) => std::panic::resume_unwind(panic),
            Ok(()) => return Err(ClientError::Closed),
        },
    };
    Ok((finish(mapper, tracked, target.lock_step, dense.as_ref()).await?, companion))
}

/// Waits for the final map and computes the trajectory on it.
async fn finish(
    mut mapper: Mapper,
    tracked: Tracked,
    lock_step: bool,
    dense: Option<&DenseFeed>,
) -> Result<RunReport, ClientError> {
    let mut last_solve = None;
    if mapper.sender.failure.is_none() {
        match mapper.optimize_whole_map().await {
            Ok(solve) => last_solve = solve,
            Err(error) if lock_step => return Err(error),
            Err(error) => mapper.sender.failure = Some(error),
        }
    }
    let pose = |tracked: &TrackedFrame| {
        let keyframe = mapper.sender.book.pose(tracked.keyframe);
        let pose = keyframe.map(|keyframe| keyframe.compose(&tracked.keyframe_from_camera));
        (tracked.timestamp_s, pose.unwrap_or(tracked.world_from_camera))
    };
    let mut report = RunReport {
        frames: tracked.frames,
        skipped: tracked.skipped,
        trajectory: tracked.live.iter().map(pose).collect(),
        live: tracked.live,
        keyframes: mapper.sender.book.poses().map(|(_, seconds, pose)| (seconds, pose)).collect(),
        landmarks: tracked.landmarks,
        corrections: tracked.corrections,
        relocalizations: tracked.relocalizations,
        loops: mapper.loops(),
        local_solves: mapper.sender.solves.solves(),
        last_solve,
        most_held: mapper.sender.most_held,
        left_out: mapper.sender.left_out,
        durations: tracked.durations,
        ..RunReport::default()
    };
    if let Some(dense) = dense {
        dense.correct(mapper.sender.book.poses().map(|(id, _, pose)| (id, pose)).collect());
    }
    report.failure = mapper.sender.failure.take();
    if report.failure.is_none() {
        match mapper.finish().await {
            Ok(answered) => report.reconnects = answered.reconnects,
            Err(error) if lock_step => return Err(error),
            Err(error) => report.failure = Some(error),
        }
    }
    Ok(report)
}
