//! The meters of a server's engines: atomic counters, and the names of their rows.
//!
//! All maps of a server share one set, so that the number of rows does not grow with the number of
//! maps. The public names of the sets are in `service/telemetry`.

use std::future::poll_fn;
use std::pin::pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use covis_solvers::optimizer::Termination;

use crate::map::{Change, Held, Reason, SolveKind};
use crate::meter::{Counter, Gauge, GaugeGuard, Histogram};
use crate::service::engine::outcome::Outcome;

/// Why items are rejected, in the order of [`Reason`] and of the counters.
const REASONS: [&str; 14] = [
    "missing",
    "not_finite",
    "out_of_range",
    "not_normalized",
    "not_positive_definite",
    "wrong_length",
    "unknown_reference",
    "already_exists",
    "duplicate",
    "projection_not_finite",
    "inconsistent",
    "unknown_value",
    "unimplemented",
    "too_large",
];
const _: () = assert!(Reason::TooLarge as usize + 1 == REASONS.len());

/// How solves end, in the order of the counters.
const ENDS: [&str; 10] = [
    "converged",
    "max_iterations",
    "deadline",
    "canceled",
    "stalled",
    "numerical_failure",
    "nothing_to_solve",
    "unsolvable",
    "panicked",
    "answered",
];
/// Kinds of solves, in the order of their instruments: of windows, of pose graphs, of whole maps, and of
/// problems that came with a call.
const SOLVES: [&str; 4] = ["local_bundle", "pose_graph", "global", "request"];

/// Why results of windows are not believed, in the order of [`Held`] and of the counters.
const HELD: [&str; 5] = ["unmeasured", "behind", "worse", "undetermined", "scale"];
const _: () = assert!(Held::Scale as usize + 1 == HELD.len());

/// What refused changes are, in the order of the counters.
const CHANGES: [&str; 5] = ["item", "solve", "merge", "retirement", "other"];

const PANICKED: usize = 8;
/// The solve's problem came with a call; the answer of the call says how it ended.
const ANSWERED: usize = 9;

fn place_of_end(outcome: &Outcome) -> usize {
    match outcome {
        Ok(Some(solution)) => match solution.certificate.solve.termination {
            Termination::Converged(_) => 0,
            Termination::MaxIterations => 1,
            Termination::Deadline => 2,
            Termination::Cancelled => 3,
            Termination::Stalled => 4,
            Termination::NumericalFailure => 5,
        },
        Ok(None) => 6,
        Err(_) => 7,
    }
}

/// Instruments of one kind of solve.
#[derive(Debug, Default)]
pub struct SolveMeters {
    /// How long it waited for a thread of the pool, ns.
    pub waiting_ns: Histogram,
    /// How long it ran, ns.
    pub running_ns: Histogram,
    /// Solves that wait for a thread now.
    pub waiting: Arc<Gauge>,
    /// Solves that run now.
    pub running: Arc<Gauge>,
    ends: [Counter; ENDS.len()],
}

impl SolveMeters {
    /// How its solves ended, by name.
    pub fn ends(&self) -> impl Iterator<Item = (&'static str, &Counter)> {
        ENDS.into_iter().zip(&self.ends)
    }

    /// Counts a solve that is queued in the pool.
    pub(super) fn queued(self: &Arc<Self>) -> QueuedSolve {
        QueuedSolve { since: Instant::now(), _held: self.waiting.hold(), meters: Arc::clone(self) }
    }
}

/// Measures a solve that waits for a thread.
#[derive(Debug)]
pub struct QueuedSolve {
    since: Instant,
    meters: Arc<SolveMeters>,
    _held: GaugeGuard,
}

impl QueuedSolve {
    /// The solve has got its thread.
    fn started(self) -> StartedSolve {
        self.meters.waiting_ns.observe_time(self.since.elapsed());
        let running = self.meters.running.hold();
        let meters = Arc::clone(&self.meters);
        StartedSolve { since: Instant::now(), meters, end: PANICKED, _held: running }
    }

    /// Runs the solve.
    pub(super) fn solve(self, work: impl FnOnce() -> Outcome) -> Outcome {
        let mut started = self.started();
        let outcome = work();
        started.end = place_of_end(&outcome);
        outcome
    }

    /// Runs work whose result does not say how it ended.
    pub fn run<R>(self, work: impl FnOnce() -> R) -> R {
        let mut started = self.started();
        let result = work();
        started.end = ANSWERED;
        result
    }
}

/// Measures a running solve. If it is dropped before its end is set, the solve panicked.
#[derive(Debug)]
struct StartedSolve {
    since: Instant,
    meters: Arc<SolveMeters>,
    end: usize,
    _held: GaugeGuard,
}

impl Drop for StartedSolve {
    fn drop(&mut self) {
        let took = self.since.elapsed();
        self.meters.running_ns.observe_time(took);
        if let (Some(count), Some(end)) = (self.meters.ends.get(self.end), ENDS.get(self.end)) {
            count.increment();
            tracing::debug!(termination = end, ?took, "solve ended");
        }
    }
}

/// Instruments of all engines of a server.
#[derive(Debug, Default)]
pub struct EngineMeters {
    /// Open ingest streams.
    pub streams: Arc<Gauge>,
    /// Watchers.
    pub watchers: Arc<Gauge>,
    /// Items that were journaled.
    pub received: Counter,
    /// Items that the map had already.
    pub duplicate: Counter,
    /// Streams that ended at a limit.
    pub at_limit: Counter,
    rejected: [Counter; REASONS.len()],
    refused: [Counter; CHANGES.len()],
    /// Keyframes that were retired because their map was full.
    pub retired: Counter,
    /// From an item's arrival until it was durable, ns.
    pub durable_ns: Histogram,
    /// From an item's arrival until the solve that it started was applied, ns.
    pub optimized_ns: Histogram,
    solves: [Arc<SolveMeters>; SOLVES.len()],
    /// Solves whose result was dropped, those of windows for an adjustment after closures.
    pub superseded: Counter,
    implausible: [Counter; HELD.len()],
    /// How long the search for the place of a keyframe took, ns.
    pub place_search_ns: Histogram,
    /// Loop closures that searches added.
    pub closures_found: Counter,
    /// How long each poll of an engine ran on a thread of the async runtime, ns of `thread_time`.
    pub held_ns: Histogram,
    /// Panics that were caught in an engine.
    pub engine_panics: Counter,
    /// Panics that were caught in a solve.
    pub solve_panics: Counter,
}

impl EngineMeters {
    /// Runs the task of an engine and measures how long each poll takes.
    pub(super) async fn measure(self: Arc<Self>, engine: impl Future<Output = ()>) {
        let mut engine = pin!(engine);
        poll_fn(|context| {
            let begin = thread_time();
            let poll = engine.as_mut().poll(context);
            self.held_ns.observe_time(thread_time().saturating_sub(begin));
            poll
        })
        .await;
    }

    /// Solves by kind.
    pub fn solves(&self) -> impl Iterator<Item = (&'static str, &Arc<SolveMeters>)> {
        SOLVES.into_iter().zip(&self.solves)
    }

    /// Rejected items by the reason of their first violation.
    pub fn rejected(&self) -> impl Iterator<Item = (&'static str, &Counter)> {
        REASONS.into_iter().zip(&self.rejected)
    }

    /// Counts a rejected item.
    pub(super) fn reject(&self, reason: Reason) {
        if let Some(count) = self.rejected.get(reason as usize) {
            count.increment();
        }
    }

    /// Changes that were not possible and so were not journaled, by what they are.
    pub fn refused(&self) -> impl Iterator<Item = (&'static str, &Counter)> {
        CHANGES.into_iter().zip(&self.refused)
    }

    /// Counts a change that is not possible.
    pub(super) fn refuse(&self, change: &Change, is_item: bool) {
        let [item, solve, merge, retirement, other] = &self.refused;
        let counter = if is_item {
            item
        } else if matches!(change, Change::SolveApplied { .. }) {
            solve
        } else if matches!(change, Change::MapMerged { .. } | Change::MapTakenOut { .. }) {
            merge
        } else if matches!(change, Change::KeyframeRetired { .. }) {
            retirement
        } else {
            other
        };
        counter.increment();
    }

    /// Results of windows that were not believed, by reason.
    pub fn implausible(&self) -> impl Iterator<Item = (&'static str, &Counter)> {
        HELD.into_iter().zip(&self.implausible)
    }

    /// Counts the result of a window that is not believed.
    pub(super) fn disbelieve(&self, why: Held) {
        if let Some(count) = self.implausible.get(why as usize) {
            count.increment();
        }
    }

    /// Counts a solve of a map that is queued in the pool.
    pub(super) fn solve(&self, kind: SolveKind) -> QueuedSolve {
        let [local_bundle, pose_graph, global, _] = &self.solves;
        match kind {
            SolveKind::LocalBundle => local_bundle.queued(),
            SolveKind::PoseGraph => pose_graph.queued(),
            SolveKind::Global => global.queued(),
        }
    }

    /// Counts a solve of a problem that came with a call and is queued in the pool.
    #[must_use]
    pub fn request_solve(&self) -> QueuedSolve {
        let [.., request] = &self.solves;
        request.queued()
    }
}

/// How long this thread has run: on Linux its processor time, so that a wait for a processor does
/// not count (a call takes about 0.4 µs); elsewhere the time that has passed.
fn thread_time() -> Duration {
    #[cfg(target_os = "linux")]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Duration::try_from(time).unwrap_or_default()
    }
    #[cfg(not(target_os = "linux"))]
    {
        static BEGIN: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
        BEGIN.get_or_init(Instant::now).elapsed()
    }
}
