//! Checkpoints of bundle adjustments of problem files: written while the solve goes on, read by the attempt
//! that a restart begins.
//!
//! One is due when as much time has passed in the solve as writing may take a small share of. A checkpoint
//! that cannot be written is told and the solve goes on: it costs time after a crash, nothing else.

use std::sync::Arc;

use covis_solvers::bundle_adjustment::{Checkpoint, Keeper};
use covis_solvers::optimizer::IterationSummary;

use super::Context;
use super::entry::Entry;
use crate::service::engine::EngineError;
use crate::store::JobFileError;

/// Seconds of a solve between two checkpoints.
const BETWEEN_S: f64 = 10.0;

/// Keeps the checkpoints of one solve of a job.
pub(super) struct Checkpoints {
    context: Arc<Context>,
    entry: Arc<Entry>,
    /// The solve among those of the job.
    number: u32,
    /// When the last one was kept, seconds of the solve.
    last_s: f64,
    /// Bytes that are counted for the job.
    counted: u64,
}

impl Checkpoints {
    pub(super) fn new(context: &Arc<Context>, entry: &Arc<Entry>, number: u32) -> Self {
        let (context, entry) = (Arc::clone(context), Arc::clone(entry));
        Self { context, entry, number, last_s: 0.0, counted: 0 }
    }

    /// The last checkpoint of an earlier attempt, if there is one.
    pub(super) fn last(&self) -> Option<Checkpoint> {
        match self.context.jobs.files.read_checkpoint(&self.entry.uid, self.number) {
            Ok(checkpoint) => Some(checkpoint),
            Err(JobFileError::Missing) => None,
            Err(error) => {
                let job = self.entry.id();
                tracing::warn!(job, %error, "a checkpoint cannot be read, the solve begins again");
                None
            }
        }
    }

    /// Counts the bytes of a checkpoint for the job, once for all that replace each other.
    fn count(&mut self, bytes: u64) -> Result<(), EngineError> {
        if bytes > self.counted {
            let mut held = self.entry.held();
            let amount = held.bytes.amount().saturating_add(bytes - self.counted);
            held.bytes.resize(amount)?;
            self.counted = bytes;
        }
        Ok(())
    }
}

impl Keeper for Checkpoints {
    fn is_due(&mut self, row: &IterationSummary) -> bool {
        let is_due =
            row.seconds >= self.last_s + BETWEEN_S || self.context.config.holds("hold-checkpoint");
        if is_due {
            self.last_s = row.seconds;
        }
        is_due
    }

    fn keep(&mut self, checkpoint: Checkpoint) {
        let values = 3 * checkpoint.landmarks.len() + 8 * checkpoint.poses.len();
        let bytes = 9 * (values + 16 * checkpoint.cameras.len() + 8 * checkpoint.state.rows.len());
        let job = self.entry.id().to_owned();
        if let Err(error) = self.count(bytes as u64) {
            tracing::warn!(job, %error, "there is no room for a checkpoint");
            return;
        }
        let files = &self.context.jobs.files;
        if let Err(error) = files.write_checkpoint(&self.entry.uid, self.number, &checkpoint) {
            tracing::warn!(job, %error, "a checkpoint cannot be written");
            return;
        }
        // A test kills the server here.
        if checkpoint.state.iteration() >= 3 && self.context.config.holds("hold-checkpoint") {
            let now_ns = self.context.jobs.now_ns();
            self.entry.progress(now_ns, |progress| progress.phase = "held by a test".to_owned());
            while !self.entry.cancellation.is_canceled() {
                std::thread::yield_now();
            }
        }
    }
}
