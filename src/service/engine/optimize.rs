//! Optimizing a whole map on request: options, outcome, and the job that waits or runs.
//!
//! A map has one job at a time. The job starts when the running solve has ended, covers every
//! trigger that is open then, and is applied as one event. A canceled job leaves the map unchanged.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use covis_solvers::bundle_adjustment::LinearSolver;
use covis_solvers::graph_optimization::Proof;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{self, IterationSummary};
use tokio::sync::mpsc;
use tracing::Span;

use super::handle::Reply;
use super::{EngineError, GaugeKind, SolveCertificate};
use crate::map::SwitchedOff;

/// Which part of a map is optimized.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OptimizeProblem {
    /// Poses and landmarks over all factors.
    #[default]
    Full,
    /// Poses over the graph of a loop closure; landmarks follow their reference keyframes.
    PoseGraph {
        /// Whether the chordal optimum is proved and used as the start of the last solve.
        certify: bool,
    },
}

/// How a whole map is optimized.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OptimizeOptions {
    /// Limits and tolerances.
    pub optimizer: optimizer::Options,
    /// The linear system.
    pub linear_solver: LinearSolver,
    /// Loss of the observations; `None` uses the policy's.
    pub observation_loss: Option<Loss>,
    /// Loss of the constraints; `None` uses the policy's.
    pub constraint_loss: Option<Loss>,
    /// What is optimized.
    pub problem: OptimizeProblem,
    /// What fixes the frame. A pose graph fixes the first keyframe of each connected piece.
    /// [`GaugeKind::FixedPoses`] fixes the first keyframe, because a map marks no others.
    pub gauge: GaugeKind,
    /// Deadline of the solve, which includes its time in the queue (none).
    pub deadline: Option<Instant>,
}

/// What an optimization did.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimizeOutcome {
    /// The certificate.
    pub certificate: Arc<SolveCertificate>,
    /// The revision that holds the result.
    pub revision: i64,
    /// The solve's number in the map, from 1.
    pub solve_id: i64,
    /// What was in the problem.
    pub counts: OptimizeCounts,
    /// What is proved about the chordal cost at the start of the last solve, if it was requested.
    pub proof: Option<Proof>,
    /// Every constraint of the map that is switched off after it, sorted by client name, then id.
    pub switched_off: Vec<(String, i64, SwitchedOff)>,
}

/// What was in a problem.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OptimizeCounts {
    /// Cameras.
    pub cameras: usize,
    /// Keyframes.
    pub keyframes: usize,
    /// Landmarks.
    pub landmarks: usize,
    /// Observations.
    pub observations: usize,
    /// Constraints and priors.
    pub constraints: usize,
}

/// An optimization that waits or runs.
pub(super) struct Job {
    pub(super) options: OptimizeOptions,
    pub(super) rows: mpsc::UnboundedSender<IterationSummary>,
    pub(super) cancel: Arc<AtomicBool>,
    /// Span of the call that requested it.
    pub(super) span: Span,
    pub(super) reply: Reply<Result<OptimizeOutcome, EngineError>>,
}

impl Job {
    pub(super) fn is_canceled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }

    /// Sends the outcome to the caller, if it still waits.
    pub(super) fn answer(self, outcome: Result<OptimizeOutcome, EngineError>) {
        let _gone = self.reply.send(outcome);
    }
}
