//! The engine: one task a map owns it, is its only writer and never waits for a solve.
//!
//! A client's item goes check → event → journal → map → `RECEIVED`; solves run beside the task on
//! the [`SolverPool`], from the values at the revision where they start, and come back as events.
//! What takes more than a look at each entity of an item is computed on other threads while the task
//! waits: the thread that carries it is free for other maps and calls.
//! Readers get snapshots ([`std::sync::Arc`] of the map, copied on write). In lock-step the next
//! item waits for the solve, so that the same items give the same bits. The semantics of acks,
//! epochs, resume and watching are those of `docs/wire.md`. No tonic, no wire types, no maths here.
//!
//! | file | role |
//! |---|---|
//! | `maps`, `table` | all maps of a server: create, open, delete, shut down; their names |
//! | `handle`, `stream` | what callers hold |
//! | `actor`, `journal`, `items` | the task: what it waits for, commits, and does with an item |
//! | `durable` | DURABLE acks, snapshots, a failing journal |
//! | `streams`, `schedule` | open streams with their acks; which items wait for which solve |
//! | `solves`, `work`, `pose_graph`, `optimize` | starting, superseding and applying solves; their bodies |
//! | `watch`, `watch_log`, `touched`, `history` | changes for readers, coalesced; what a reader missed |
//! | `meters` | what is counted |
//! | `pool`, `fair_queue` | the threads of solves and computations, and whose solve is next |
//! | `account` | what each map, each tenant and the server hold, and how much they may |

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
    /// Items of a map that wait for its engine, at least 1 (64). A full queue slows streams down.
    pub queue_capacity: usize,
    /// Most memory of a solve, estimated before it is begun, bytes (1 GiB).
    pub max_solve_bytes: u64,
    /// Most work of an iteration of a solve, estimated likewise, Gflop (1000).
    pub max_solve_gflops: u64,
    /// A bug to be staged (none).
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
    /// What a solve may take.
    #[must_use]
    pub fn ceiling(&self) -> Ceiling {
        Ceiling {
            bytes: Some(self.max_solve_bytes),
            flops_per_iteration: Some(1e9 * self.max_solve_gflops as f64),
        }
    }
}
