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
//! | `maps`, `table` | all maps of a server: create, open, delete, shut down; their names |
//! | `handle`, `stream` | the caller's side: the handle of a map, an ingest stream |
//! | `actor`, `journal`, `items` | the task: its loop, its commits, how it handles an item |
//! | `durable` | DURABLE acks, snapshots, a failing journal |
//! | `streams`, `schedule` | open streams with their acks; which items wait for which solve |
//! | `solves`, `work`, `pose_graph`, `optimize` | starting, superseding and applying solves; their bodies |
//! | `watch`, `watch_log`, `touched`, `history` | changes for readers, coalesced; missed changes |
//! | `meters` | counters and histograms |
//! | `pool`, `fair_queue` | the threads of solves and computations, and the order of solves |
//! | `account` | resources that each map, each tenant and the server hold, and their limits |

mod account;
mod acks;
mod actor;
mod certificate;
mod durable;
mod error;
mod estimate;
mod fair_queue;
mod fault;
mod handle;
mod history;
mod items;
mod journal;
mod maps;
mod meters;
mod opening;
mod optimize;
mod pool;
mod pose_graph;
mod schedule;
mod solves;
mod stream;
mod streams;
mod table;
mod touched;
mod watch;
mod watch_log;
mod work;

use covis_solvers::price::Ceiling;

pub use account::{
    Account, AccountLimits, AccountRow, Accounts, Reservation, Resource, SEPARATOR, tenant_of,
};
pub use acks::{Ack, AckStatus, SolveReport, StreamEvent};
pub use certificate::{GaugeKind, SolveCertificate, SolverKind};
pub use error::EngineError;
pub use estimate::Estimate;
#[cfg(feature = "faults")]
pub use fault::Fault;
pub use handle::{MapHandle, MapInfo, MapState};
pub use maps::Maps;
pub use meters::{EngineMeters, MapCounts, QueuedSolve, SolveMeters};
pub use optimize::{OptimizeCounts, OptimizeOptions, OptimizeOutcome, OptimizeProblem};
pub use pool::{PoolError, SolvePanicked, SolverPool, lower_priority};
pub use stream::{IngestStream, ItemSender, Opened};
pub use touched::Touched;
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
    #[must_use]
    pub fn ceiling(&self) -> Ceiling {
        Ceiling {
            bytes: Some(self.max_solve_bytes),
            flops_per_iteration: Some(1e9 * self.max_solve_gflops as f64),
        }
    }
}
