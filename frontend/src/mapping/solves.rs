//! What the server's solves reached, for reports: each local solve by the answer that names it, and the last
//! optimization of the whole map by its rows.
//!
//! Answers come on the session's task, so that they are kept behind a lock, held for a push alone.
//! Tracking never reads it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use covis_client::SessionOptions;
use covis_client::wire::v1;

/// A solve of the server that covered keyframes of the run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalSolve {
    /// When the newest keyframe had been captured that was sent before its answer came, seconds.
    pub newest_keyframe_s: f64,
    /// Cost before, in the unit of its problem.
    pub initial_cost: f64,
    /// Cost after.
    pub final_cost: f64,
    /// What the solve took, seconds.
    pub solve_s: f64,
}

/// The optimization of the whole map at the end of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LastSolve {
    /// Its iterations.
    pub iterations: Vec<v1::IterationSummary>,
    /// Its certificate.
    pub summary: v1::SolveSummary,
}

/// The local solves of a run, as their answers come.
#[derive(Clone, Debug, Default)]
pub(super) struct SolveLog {
    log: Arc<Mutex<Log>>,
}

#[derive(Clone, Debug, Default)]
struct Log {
    newest_keyframe_s: f64,
    solves: Vec<LocalSolve>,
}

impl SolveLog {
    /// A keyframe is sent that was captured at this time.
    pub(super) fn sends(&self, captured_s: f64) {
        self.lock().newest_keyframe_s = captured_s;
    }

    /// Options of a session whose answers are kept here.
    pub(super) fn listening(&self, options: SessionOptions) -> SessionOptions {
        let log = self.clone();
        let mut last = None;
        options.on_ack(move |ack| {
            // One solve may answer several items.
            if let Some(summary) = &ack.solve_summary
                && last.replace(ack.solve_id) != Some(ack.solve_id)
            {
                let mut log = log.lock();
                let solve = LocalSolve {
                    newest_keyframe_s: log.newest_keyframe_s,
                    initial_cost: summary.initial_cost,
                    final_cost: summary.final_cost,
                    solve_s: summary.solve_duration_us as f64 * 1e-6,
                };
                log.solves.push(solve);
            }
        })
    }

    /// Those so far.
    pub(super) fn solves(&self) -> Vec<LocalSolve> {
        self.lock().solves.clone()
    }

    fn lock(&self) -> MutexGuard<'_, Log> {
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
