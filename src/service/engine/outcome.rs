//! What a solve is asked for, and what it made: options, problem, steps, certificate, and what it moved.
//!
//! Plain values; nothing is solved here.

use std::sync::Arc;
use std::time::Instant;

use covis_solvers::bundle_adjustment::LinearSolver;
use covis_solvers::evaluation::CostReport;
use covis_solvers::graph_optimization::Proof;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{self, IterationSummary, Method, SolveSummary};
use covis_solvers::problem::SolveError;
use covis_solvers::reconstruction::{self, Scale, ViewGraph};
use covis_solvers::robust::VarianceFactors;
use tokio::sync::{mpsc, oneshot};
use tracing::Span;

pub use crate::map::Gauge as GaugeKind;
use crate::map::{GraphProblem, Held, MapProblem, RequestId, Solved, SwitchedOff};
use crate::service::engine::{Cancellation, EngineError};

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
    /// Poses and landmarks anew, from observations alone.
    Rebuild,
}

/// What a solve on request reports while it runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SolveStep {
    /// An iteration of its last solve.
    Iteration(IterationSummary),
    /// A step of a reconstruction.
    Reconstruction(reconstruction::Progress),
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
    /// What fixes the frame; `None` uses the policy's.
    pub gauge: Option<GaugeKind>,
    /// Whether intrinsics are free too (false).
    pub refine_intrinsics: bool,
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
    /// What was found from observations, where the map was rebuilt.
    pub rebuilt: Option<Rebuilt>,
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

impl OptimizeCounts {
    pub(crate) fn of(problem: &MapProblem) -> Self {
        let bundle = &problem.problem;
        Self {
            cameras: problem.cameras.len(),
            keyframes: problem.keyframes.len(),
            landmarks: problem.landmarks.len(),
            observations: bundle.observation_count(),
            constraints: bundle.relative_poses.len()
                + bundle.pose_priors.len()
                + bundle.position_priors.len(),
        }
    }
}

/// An optimization that waits or runs.
pub(crate) struct OptimizeRequest {
    pub(crate) options: OptimizeOptions,
    pub(crate) steps: mpsc::UnboundedSender<SolveStep>,
    pub(crate) cancellation: Arc<Cancellation>,
    /// What asks, where the event that applies the result is to say so.
    pub(crate) request: Option<RequestId>,
    /// Span of the call that requested it.
    pub(crate) span: Span,
    pub(crate) reply: oneshot::Sender<Result<OptimizeOutcome, EngineError>>,
}

impl OptimizeRequest {
    pub(crate) fn is_canceled(&self) -> bool {
        self.cancellation.is_canceled()
    }

    /// Sends the outcome to the caller, if it still waits.
    pub(crate) fn answer(self, outcome: Result<OptimizeOutcome, EngineError>) {
        let _gone = self.reply.send(outcome);
    }
}

/// The linear system of a solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolverKind {
    /// Landmarks are eliminated; the value is never [`LinearSolver::Auto`].
    Schur(LinearSolver),
    /// Sparse block Cholesky of a pose graph.
    SparseCholesky,
}

/// The certificate of a solve.
#[derive(Clone, Debug, PartialEq)]
pub struct SolveCertificate {
    /// Summary of the optimizer's loop.
    pub solve: SolveSummary,
    /// The step method that was requested.
    pub method: Method,
    /// The linear system that was used.
    pub linear_solver: SolverKind,
    /// Cost before, by kind of factor.
    pub before: CostReport,
    /// Cost after.
    pub after: CostReport,
    /// What fixed the frame.
    pub gauge: GaugeKind,
    /// Poses that could move.
    pub free_poses: usize,
    /// Poses that were fixed.
    pub fixed_poses: usize,
    /// Landmarks that could move.
    pub free_landmarks: usize,
    /// What was found of the loop closures, where they were judged.
    pub closures: Option<ClosureCounts>,
    /// Keyframes that a window was to move and holds.
    pub held: Vec<HeldKeyframe>,
}

/// A keyframe that a window was to move and holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeldKeyframe {
    /// Name of its client.
    pub client: String,
    /// Its id there.
    pub id: i64,
    /// Why it is held.
    pub reason: Held,
}

/// What a pose graph found of a map's loop closures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClosureCounts {
    /// Loop closures.
    pub judged: usize,
    /// Those that are switched off.
    pub switched_off: usize,
    /// Those of them that are provisional.
    pub provisional: usize,
    /// How far each client's stated information was believed, by client name.
    pub factors: Vec<(String, VarianceFactors)>,
}

/// A problem whose values were moved.
pub(crate) enum Moved {
    Bundle(Box<MapProblem>),
    Graph(Box<GraphProblem>),
}

impl Moved {
    pub(crate) fn solved(&self) -> Solved<'_> {
        match self {
            Self::Bundle(problem) => Solved::Bundle(problem),
            Self::Graph(problem) => Solved::Graph(problem),
        }
    }
}

/// The result of a solve.
pub(crate) struct Solution {
    pub(crate) moved: Moved,
    pub(crate) certificate: SolveCertificate,
    pub(crate) counts: OptimizeCounts,
    pub(crate) proof: Option<Proof>,
    pub(crate) rebuilt: Option<Rebuilt>,
    /// Whether it is plausible; where it is not, the map keeps its estimates.
    pub(crate) refused: Option<Held>,
}

/// `Ok(None)` when there was nothing to solve.
pub(crate) type Outcome = Result<Option<Solution>, SolveError>;

/// Gets the steps of a solve of a whole map.
pub(crate) type Tell<'a> = dyn FnMut(SolveStep) + Send + 'a;

/// What a reconstruction found.
#[derive(Clone, Debug, PartialEq)]
pub struct Rebuilt {
    /// Keyframes.
    pub keyframes: usize,
    /// Those that have a pose.
    pub placed: usize,
    /// The others.
    pub unplaced: Vec<UnplacedKeyframe>,
    /// Landmarks.
    pub landmarks: usize,
    /// Those that have a position.
    pub placed_landmarks: usize,
    /// Observations.
    pub observations: usize,
    /// Those that agree.
    pub agreeing: usize,
    /// The view graph in numbers.
    pub view_graph: ViewGraph,
    /// The unit of length.
    pub scale: Scale,
}

/// A keyframe without a pose.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnplacedKeyframe {
    /// Its client's name; empty in files.
    pub client: String,
    /// Its id.
    pub id: i64,
    /// Why it has none, for people.
    pub reason: String,
}
