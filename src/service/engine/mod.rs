//! The engine: each map is owned by one task, which is its only writer and never waits for a solve.
//!
//! A client's item goes check → event → journal → map → `RECEIVED`. Solves run on the
//! [`SolverPool`] beside the task, from the values at the revision where they start, and their
//! results become events. Work that is more than one pass over the entities of an item runs on
//! another thread; the task awaits it, so that its own thread is free for other maps and calls.
//! Readers get snapshots ([`std::sync::Arc`] of the map, copied on write). In lock-step the next
//! item waits for the solve, so that the same items give the same bits. `docs/wire.md` defines
//! acks, epochs, resume and watching. This module uses no tonic and no wire types, and has no
//! mathematics.
//!
//! | file | role |
//! |---|---|
//! | `maps`, `opening` | all maps of a server: create, open, delete, shut down; their names |
//! | `importing` | creating a map with content |
//! | `merging`, `joining` | maps that become one and part again; what an engine does meanwhile |
//! | `sharing` | maps that several servers share |
//! | `handle`, `stream` | the caller's side: the handle of a map, an ingest stream |
//! | `actor` | the task: its loop hands events from one of the parts below to another |
//! | `items` | what one item goes through |
//! | `ingest` | open streams, their acks, and which items are accepted |
//! | `durability` | the journal, DURABLE acks, snapshots |
//! | `schedule` | which items wait for which solve |
//! | `solving`, `solve` | starting and ending a solve; its body |
//! | `rebuilding` | the body of a solve that starts from observations alone |
//! | `cancellation` | whether a requested change may still be made, or is canceled |
//! | `compacting` | a map made smaller on request: redundant keyframes and old journal go |
//! | `background` | what follows a loop closure while items are accepted: comparing places, adjusting the map |
//! | `recognition` | searching the places that keyframes show again |
//! | `places` | the index of a map's places |
//! | `pending` | what the engine still does by itself: whether a map is settled |
//! | `updating` | a requested change of name, policy or state |
//! | `measured_pairs` | relative poses of keyframes that a pose graph need not measure again |
//! | `watching`, `touched` | what the engine tells watchers: what the last events touched |
//! | `watch` | the watcher's side: changes joined, and missed ones read from the journal |
//! | `meters`, `error` | counters and histograms; why the engine does not do something |
//! | `pool`, `fair_queue` | the threads of solves and computations, and the order of solves |
//! | `account` | resources that each map, each tenant and the server hold, and their limits |

mod account;
mod actor;
mod background;
mod cancellation;
mod compacting;
mod durability;
mod error;
mod fair_queue;
mod handle;
mod importing;
mod ingest;
mod items;
mod joining;
mod maps;
mod measured_pairs;
mod merging;
mod meters;
mod opening;
mod pending;
mod places;
mod pool;
mod rebuilding;
mod recognition;
mod results;
mod schedule;
mod sharing;
mod solve;
mod solving;
mod stream;
mod touched;
mod updating;
mod watch;
mod watching;
mod window_solve;

use covis_solvers::price::Ceiling;

pub use account::{
    Account, AccountLimits, AccountRow, Accounts, Reservation, Resource, SEPARATOR, limit_name,
    tenant_of,
};
pub use cancellation::Cancellation;
pub use compacting::Compacted;
pub use error::EngineError;
pub use fair_queue::{FairQueue, Turn};
pub use handle::{MapHandle, MapInfo, MapState};
pub use importing::{ImportRoom, ImportedAs};
pub use maps::Maps;
pub use merging::{LinkRequest, MergeOutcome, MergeRequest};
pub use meters::{EngineMeters, MapCounts, QueuedSolve, SolveMeters};
pub use pending::PendingWork;
pub use places::UnknownType;
pub(crate) use pool::panic_message;
pub use pool::{Estimate, PoolError, SolvePanicked, SolverPool, lower_priority};
pub use rebuilding::{Rebuilt, UnplacedKeyframe};
pub use solve::{
    ClosureCounts, GaugeKind, HeldKeyframe, OptimizeCounts, OptimizeOptions, OptimizeOutcome,
    OptimizeProblem, SolveCertificate, SolveStep, SolverKind,
};
pub use stream::{Ack, AckStatus, IngestStream, ItemSender, Opened, SolveReport, StreamEvent};
pub use touched::Touched;
pub use updating::{MapUpdate, PolicyUpdate};
pub use watch::{MapChange, Watch};

/// How the engines of a server run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EngineConfig {
    /// Whether every stream is in lock-step (false).
    pub lock_step: bool,
    /// Most items of a map that wait for its engine, at least 1 (64). Streams wait while the queue
    /// is full.
    pub queue_capacity: usize,
    /// Most memory of a solve, estimated before it starts, bytes (1 GiB).
    pub max_solve_bytes: u64,
    /// Most work per iteration of a solve, estimated before it starts, Gflop (1000).
    pub max_solve_gflops: u64,
    /// A fault to inject for tests (none).
    #[cfg(feature = "faults")]
    pub fault: Option<Fault>,
}

impl Default for EngineConfig {
    fn default() -> Self {
        Self {
            lock_step: false,
            queue_capacity: 64,
            max_solve_bytes: 1 << 30,
            max_solve_gflops: 1000,
            #[cfg(feature = "faults")]
            fault: None,
        }
    }
}

impl EngineConfig {
    /// The limits of a solve.
    pub fn ceiling(&self) -> Ceiling {
        Ceiling {
            bytes: Some(self.max_solve_bytes),
            flops_per_iteration: Some(1e9 * self.max_solve_gflops as f64),
        }
    }

    /// Whether tests inject this fault; never without the feature `faults`.
    pub(crate) fn injects(&self, fault: Fault) -> bool {
        #[cfg(feature = "faults")]
        return self.fault == Some(fault);
        #[cfg(not(feature = "faults"))]
        return {
            let _ = fault;
            false
        };
    }

    /// Fails the calls on maps if tests inject that.
    fn check_calls(&self) -> Result<(), EngineError> {
        if self.injects(Fault::FailCalls) {
            Err(error::report_bug("staged by a test"))
        } else {
            Ok(())
        }
    }
}

/// A fault that tests inject; only a build with the feature `faults` can.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Every solve panics that items or a request make due.
    PanicInSolve,
    /// The choice of every window panics.
    PanicInWindow,
    /// Whatever a solve found panics before it becomes an event.
    PanicInResult,
    /// Every keyframe that makes room panics.
    PanicInRetirement,
    /// Every search for a place and every task that follows a loop closure panics.
    PanicInBackground,
    /// The result of every solve has a pose that is no number.
    ImpossibleResult,
    /// The engine panics while it applies a client's item.
    PanicInEngine,
    /// Every call on a map, including its creation and deletion, returns [`EngineError::Bug`].
    FailCalls,
}
