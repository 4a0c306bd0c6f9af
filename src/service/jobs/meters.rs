//! What is counted of jobs: atomics that the jobs write and `telemetry` reads. No names of metrics here.

use std::collections::BTreeMap;

use super::spec::KINDS;
use crate::meter::Histogram;
use crate::sync::Mutex;
use crate::wire::v1::JobState;

/// Instruments of jobs.
#[derive(Debug)]
pub(in crate::service) struct JobMeters {
    /// Jobs that ended, by kind and state.
    ended: Mutex<BTreeMap<(&'static str, &'static str), u64>>,
    /// From a job's begin to its end, of those that ran.
    pub(in crate::service) running_ns: Histogram,
    /// From a job's creation to its begin.
    pub(in crate::service) waiting_ns: Histogram,
}

impl Default for JobMeters {
    fn default() -> Self {
        let (running_ns, waiting_ns) = (Histogram::default(), Histogram::default());
        // A row for each from the start, so that no alert waits for one that is not there yet.
        let states = [JobState::Succeeded, JobState::Failed, JobState::Cancelled];
        let rows = KINDS.into_iter().flat_map(|kind| states.map(|state| ((kind, name(state)), 0)));
        Self { ended: Mutex::new(rows.collect()), running_ns, waiting_ns }
    }
}

impl JobMeters {
    /// Counts a job that has ended.
    pub(super) fn ended(&self, kind: &'static str, state: JobState) {
        *self.ended.lock().entry((kind, name(state))).or_default() += 1;
    }

    /// Jobs that ended: kind, state, count.
    pub(in crate::service) fn rows(&self) -> Vec<(&'static str, &'static str, u64)> {
        self.ended.lock().iter().map(|(&(kind, state), &count)| (kind, state, count)).collect()
    }
}

/// The name of a state.
fn name(state: JobState) -> &'static str {
    match state {
        JobState::Pending | JobState::Unspecified => "pending",
        JobState::Running => "running",
        JobState::Succeeded => "succeeded",
        JobState::Failed => "failed",
        JobState::Cancelled => "cancelled",
    }
}
