//! The fourth of the paper's threads: dense mapping, in parallel to tracking.
//!
//! Frames and corrections are handed over and processed in order, so that the volume does not depend on
//! timing. Tracking does not wait until a frame is integrated. It waits only for room in a short
//! queue when it is faster for long, so that no frame of a recorded sequence is dropped. Each frame
//! takes a bounded time, whatever a correction moved. Which frames are mapped is decided by tracking.

use std::sync::mpsc::{self, Receiver, Sender, SyncSender};
use std::thread::JoinHandle;
use std::time::Instant;

use covis_solvers::geometry::Se3;
use rayon::ThreadPool;

use super::integrate::IntegrateError;
use super::mapper::{AnchoredFrame, DenseError, DenseMapper};
use super::paged::PagedVolume;

/// Frames that wait to be integrated, some 2.5 MB each at 640 × 480. While the volume is rebuilt,
/// frames may take longer than a camera's period for a second; tracking does not wait for them.
const QUEUE: usize = 16;

/// A message to the thread of dense mapping.
enum Message {
    /// A frame, and the pose of its keyframe.
    Frame(Box<AnchoredFrame>, Se3),
    /// The current poses of keyframes.
    Correct(Vec<(usize, Se3)>),
}

/// The result of dense mapping.
#[derive(Debug)]
pub struct DenseReport {
    /// The volume, at the keyframes' last poses.
    pub volume: PagedVolume,
    /// Integrating a frame, seconds each.
    pub integrate_s: Vec<f64>,
    /// Integrating earlier frames again after it, seconds each.
    pub follow_s: Vec<f64>,
    /// Frames that could not be integrated.
    pub skipped: usize,
    /// How many times the volume was rebuilt to follow the keyframes.
    pub rebuilt: usize,
}

/// What hands frames and corrections over.
#[derive(Clone, Debug)]
pub struct DenseFeed {
    messages: SyncSender<Message>,
    /// One of this many frames is sent; at least 1.
    pub every: usize,
}

impl DenseFeed {
    /// Hands a frame over; `world_from_keyframe` is used if its keyframe is new.
    pub fn integrate(&self, frame: AnchoredFrame, world_from_keyframe: Se3) {
        // A thread that ended gives the reason in its report.
        let _ended = self.messages.send(Message::Frame(Box::new(frame), world_from_keyframe));
    }

    /// Sends the current poses of keyframes.
    pub fn correct(&self, poses: Vec<(usize, Se3)>) {
        let _ended = self.messages.send(Message::Correct(poses));
    }
}

/// A thread that owns a [`DenseMapper`].
#[derive(Debug)]
pub struct DenseThread {
    messages: SyncSender<Message>,
    progress: Receiver<(usize, usize)>,
    thread: JoinHandle<Result<DenseReport, DenseError>>,
}

impl DenseThread {
    /// Starts it; its work is spread over `pool`.
    #[must_use]
    pub fn start(mapper: DenseMapper, pool: ThreadPool) -> Self {
        let (messages, inbox) = mpsc::sync_channel(QUEUE);
        let (outbox, progress) = mpsc::channel();
        let work = move || pool.install(move || work(mapper, inbox, &outbox));
        Self { messages, progress, thread: std::thread::spawn(work) }
    }

    /// A way to hand over one of `every` frames, from any thread. The work ends when all of them are
    /// dropped and [`DenseThread::finish`] is called.
    #[must_use]
    pub fn feed(&self, every: usize) -> DenseFeed {
        DenseFeed { messages: self.messages.clone(), every }
    }

    /// Waits until the volume has followed the keyframes. `done` is called with the number of frames
    /// that were integrated again, and of all.
    ///
    /// # Errors
    /// The error that ended it before.
    ///
    /// # Panics
    /// If the thread panicked.
    pub fn finish(self, done: &mut dyn FnMut(usize, usize)) -> Result<DenseReport, DenseError> {
        drop(self.messages);
        for (again, all) in self.progress {
            done(again, all);
        }
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

fn work(
    mut mapper: DenseMapper,
    messages: Receiver<Message>,
    progress: &Sender<(usize, usize)>,
) -> Result<DenseReport, DenseError> {
    let (mut integrate_s, mut follow_s, mut skipped) = (Vec::new(), Vec::new(), 0);
    for message in messages {
        match message {
            Message::Correct(poses) => mapper.correct(&poses),
            Message::Frame(frame, world_from_keyframe) => {
                let start = Instant::now();
                match mapper.integrate(*frame, &world_from_keyframe) {
                    Ok(()) => {}
                    // What is lost on disk is lost for other frames too.
                    Err(error @ DenseError::Frame(IntegrateError::Pages(_))) => return Err(error),
                    Err(DenseError::Frame(error)) => {
                        tracing::warn!("a frame was not integrated: {error}");
                        skipped += 1;
                    }
                    Err(error) => return Err(error),
                }
                integrate_s.push(start.elapsed().as_secs_f64());
                let start = Instant::now();
                mapper.follow()?;
                follow_s.push(start.elapsed().as_secs_f64());
            }
        }
    }
    mapper.finish(&mut |again, all| {
        // The receiver is gone when the caller has stopped waiting.
        let _gone = progress.send((again, all));
    })?;
    let DenseMapper { volume, rebuilt, .. } = mapper;
    Ok(DenseReport { volume, integrate_s, follow_s, skipped, rebuilt })
}
