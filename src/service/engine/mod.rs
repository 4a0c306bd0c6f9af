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
//! ```text
//!            maps          all maps of a server: create, open, import, copy, merge, share, delete
//!              │
//!            handle        what a caller holds: the handle of a map, an ingest stream, a watch
//!              │ requests, items
//!            actor         the task: its loop hands values from one part to another
//!   ┌───────┬──┴────┬───────────┬──────────┐
//! ingest  journal  solving  recognition  watching     parts: each owns its state, none knows another
//!   └───────┴───────┴───────────┴──────────┘
//!         context, pool, account, …                   what all of them share
//! ```
//!
//! A module uses those below it only; `tests/tidy/engine.rs` has the floors.
//!
//! | module | role |
//! |---|---|
//! | `maps` | all maps of a server and their names; `opening`, `importing`, `copying`, `merging`, `sharing`, `counts` |
//! | `handle` | the caller's side; `stream`: items in, events out; `watch`: changes joined, and missed ones read from the journal; `compacting` |
//! | `actor` | the loop, and what it does with the values of the parts |
//! | `actor::commit` | the one way in which a map changes |
//! | `actor::items` | what one item goes through |
//! | `actor::solves`, `closures`, `searches` | the ends of solves, of what follows a closure, of searches for places |
//! | `actor::requests`, `update`, `merging` | what handles ask; a change of name, policy or state; maps that become one |
//! | `actor::settled` | whether the engine still does something by itself |
//! | `ingest` | open streams, their acks, and which items are accepted |
//! | `journal` | events on their way to the disk, DURABLE acks, snapshots; `history`: earlier states of the map |
//! | `solving` | starting solves; `schedule`: which items wait for which; `whole`, `window`, `rebuild`: their bodies; `after_closures`: comparing places and adjusting the map |
//! | `recognition` | searching the places that keyframes show again |
//! | `watching` | the log for watchers; `touched`: the ids that events touch |
//! | `context` | what an engine, its parts and its handles share |
//! | `events`, `outcome` | values: entries of the queue and their answers; what a solve is asked for and what it made |
//! | `places`, `measured_pairs` | caches of what the map determines: the index of places, relative poses of keyframes |
//! | `merged_name` | the name of a map that became part of another one |
//! | `cancellation` | whether a requested change may still be made |
//! | `meters`, `error` | counters and histograms; why the engine does not do something |
//! | `pool` | the threads of solves and computations; `fair_queue`: the order of solves |
//! | `account` | resources that each map, each tenant and the server hold, and their limits |

mod account;
mod actor;
mod cancellation;
mod context;
mod error;
mod events;
mod handle;
mod ingest;
mod journal;
mod maps;
mod measured_pairs;
mod merged_name;
mod meters;
mod outcome;
mod places;
mod pool;
mod recognition;
mod solving;
mod watching;

use covis_solvers::price::Ceiling;

pub use account::{
    Account, AccountLimits, AccountRow, Accounts, Reservation, Resource, SEPARATOR, limit_name,
    tenant_of,
};
pub use actor::update::{MapUpdate, PolicyUpdate};
pub use cancellation::Cancellation;
pub use context::{MapInfo, MapState, PendingWork};
pub use error::{EngineError, PastState};
pub use events::{Ack, AckStatus, Opened, SolveReport, StreamEvent};
pub use handle::MapHandle;
pub use handle::compacting::Compacted;
pub use handle::stream::{IngestStream, ItemSender};
pub use handle::watch::{MapChange, Watch};
pub use journal::history::Moment;
pub use maps::Maps;
pub use maps::copying::Copied;
pub use maps::counts::MapCounts;
pub use maps::importing::{ImportRoom, ImportedAs};
pub use maps::merging::{LinkRequest, MergeOutcome, MergeRequest};
pub use meters::{EngineMeters, QueuedSolve, SolveMeters};
pub use outcome::{
    ClosureCounts, GaugeKind, HeldKeyframe, OptimizeCounts, OptimizeOptions, OptimizeOutcome,
    OptimizeProblem, Rebuilt, SolveCertificate, SolveStep, SolverKind, UnplacedKeyframe,
};
pub use places::UnknownType;
pub use pool::fair_queue::{FairQueue, Turn};
pub(crate) use pool::panic_message;
pub use pool::{Estimate, PoolError, SolvePanicked, SolverPool, lower_priority};
pub use watching::touched::Touched;

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
    /// Every reconstruction of a map waits after its first step until it is canceled.
    HoldReconstruction,
    /// The engine panics while it applies a client's item.
    PanicInEngine,
    /// Every call on a map, including its creation and deletion, returns [`EngineError::Bug`].
    FailCalls,
}
