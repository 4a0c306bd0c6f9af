//! Optimizing a whole map on request: options, outcome, and the job that waits or runs.
//!
//! One job a map at a time. It starts when the running solve has ended, covers every trigger that
//! is open then, and is applied as one event. A canceled job leaves the map as it was.

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

/// What of a map is optimized.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OptimizeProblem {
    /// Poses and landmarks over all factors.
    #[default]
    Full,
    /// Poses over the graph of a loop closure; landmarks follow.
    PoseGraph {
        /// Whether the chordal optimum is proved, and the last solve starts there.
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
    /// Loss of the observations; `None` takes the policy's.
    pub observation_loss: Option<Loss>,
    /// Loss of the constraints; `None` takes the policy's.
    pub constraint_loss: Option<Loss>,
    /// What is optimized.
    pub problem: OptimizeProblem,
    /// What holds the frame; a pose graph holds the first keyframe of each piece. [`GaugeKind::FixedPoses`] holds the first keyframe, as a map marks no
    /// others.
    pub gauge: GaugeKind,
    /// When the solve must have ended; time that it waits for its turn counts (never).
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
    /// What is proved of the chordal cost where the last solve started; where it was asked for.
    pub proof: Option<Proof>,
    /// Every constraint of the map that is switched off after it, by client name, then id.
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
    /// Of the call that asked for it.
    pub(super) span: Span,
    pub(super) reply: Reply<Result<OptimizeOutcome, EngineError>>,
}

impl Job {
    pub(super) fn is_canceled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }

    /// Tells the caller, if it is still there.
    pub(super) fn answer(self, outcome: Result<OptimizeOutcome, EngineError>) {
        let _gone = self.reply.send(outcome);
    }
}
