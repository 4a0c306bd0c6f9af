//! Checkpoints of bundle adjustments of problem files: written while the solve runs, read by the attempt
//! that continues after it.
//!
//! One is due when as much time has passed in the solve as writing may take a small share of. A checkpoint
//! that cannot be written is reported and the solve continues: it costs time after a crash, nothing else.

use std::sync::Arc;

use covis_solvers::bundle_adjustment::{Checkpoint, Keeper};
use covis_solvers::optimizer::IterationSummary;

use super::Jobs;
use super::entry::Entry;
use super::solving::{SolveContext, Tell};
use super::uploads::FILE_BYTES;
use crate::service::engine::{Cancellation, EngineError};
use crate::store::JobFileError;

/// Seconds of a solve between two checkpoints.
const BETWEEN_S: f64 = 10.0;

/// Where the checkpoints of one solve lie.
pub(super) trait CheckpointStorage: Send {
    /// The last one, if there is one that can be read.
    fn last(&self) -> Option<Checkpoint>;

    /// Keeps one in place of the last; says why it cannot.
    fn keep(&mut self, checkpoint: &Checkpoint) -> Result<(), String>;
}

/// Keeps the checkpoints of one solve.
pub(super) struct Checkpoints {
    storage: Box<dyn CheckpointStorage>,
    /// When the last one was kept, seconds of the solve.
    last_s: f64,
    /// Whether a test holds the solve after a checkpoint.
    holds: bool,
    cancellation: Arc<Cancellation>,
    tell: Tell,
}

impl Checkpoints {
    pub(super) fn new(
        storage: impl CheckpointStorage + 'static,
        holds: bool,
        context: &SolveContext<'_>,
    ) -> Self {
        let (cancellation, tell) = (Arc::clone(&context.cancellation), Arc::clone(&context.tell));
        Self { storage: Box::new(storage), last_s: 0.0, holds, cancellation, tell }
    }

    /// The last checkpoint of an earlier attempt, if there is one.
    pub(super) fn last(&self) -> Option<Checkpoint> {
        self.storage.last()
    }
}

impl Keeper for Checkpoints {
    fn is_due(&mut self, row: &IterationSummary) -> bool {
        let is_due = row.seconds >= self.last_s + BETWEEN_S || self.holds;
        if is_due {
            self.last_s = row.seconds;
        }
        is_due
    }

    fn keep(&mut self, checkpoint: Checkpoint) {
        if let Err(error) = self.storage.keep(&checkpoint) {
            tracing::warn!(error, "a checkpoint cannot be written");
            return;
        }
        // A test kills the process here.
        if checkpoint.state.iteration() >= 3 && self.holds {
            (self.tell)(&mut |progress| progress.phase = "held by a test".to_owned());
            while !self.cancellation.is_canceled() {
                std::thread::yield_now();
            }
        }
    }
}

/// Checkpoints among the files of a job.
pub(super) struct OnDisk {
    jobs: Arc<Jobs>,
    entry: Arc<Entry>,
    /// The solve among those of the job.
    number: u32,
    /// Bytes that are counted for the job.
    counted: u64,
}

impl OnDisk {
    pub(super) fn new(jobs: &Arc<Jobs>, entry: &Arc<Entry>, number: u32) -> Self {
        let (jobs, entry) = (Arc::clone(jobs), Arc::clone(entry));
        Self { jobs, entry, number, counted: 0 }
    }

    /// Counts the bytes of a checkpoint for the job, once for all that replace each other.
    fn count(&mut self, bytes: u64) -> Result<(), EngineError> {
        let bytes = FILE_BYTES + bytes;
        if bytes > self.counted {
            self.entry.grow(bytes - self.counted)?;
            self.counted = bytes;
        }
        Ok(())
    }
}

impl CheckpointStorage for OnDisk {
    fn last(&self) -> Option<Checkpoint> {
        match self.jobs.files.read_checkpoint(&self.entry.uid, self.number) {
            Ok(checkpoint) => Some(checkpoint),
            Err(JobFileError::Missing) => None,
            Err(error) => {
                let job = self.entry.id();
                tracing::warn!(job, %error, "a checkpoint cannot be read, the solve begins again");
                None
            }
        }
    }

    fn keep(&mut self, checkpoint: &Checkpoint) -> Result<(), String> {
        let values = 3 * checkpoint.landmarks.len() + 8 * checkpoint.poses.len();
        let bytes = 9 * (values + 16 * checkpoint.cameras.len() + 8 * checkpoint.state.rows.len());
        self.count(bytes as u64).map_err(|error| error.to_string())?;
        let files = &self.jobs.files;
        let written = files.write_checkpoint(&self.entry.uid, self.number, checkpoint);
        written.map(drop).map_err(|error| error.to_string())
    }
}
