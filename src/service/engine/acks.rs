//! Events of an ingest stream: acks of items, and the reason when the stream ends.
//!
//! `RECEIVED` and `REJECTED` answer one item each, in the order of the items; `DURABLE` and
//! `OPTIMIZED` are cumulative.

use std::sync::Arc;

use covis_solvers::problem::SolveError;

use super::{EngineError, SolveCertificate};
use crate::map::Rejection;

/// One event of an ingest stream.
#[derive(Clone, Debug)]
pub enum StreamEvent {
    /// An acknowledgment.
    Ack(Ack),
    /// The stream has ended; no event follows. A stream that its client finished ends without this
    /// event.
    End(EngineError),
}

/// An acknowledgment.
#[derive(Clone, Debug)]
pub struct Ack {
    /// The item's sequence; for cumulative statuses, the last sequence that is covered.
    pub sequence: i64,
    /// Revision of the map that contains the item's effect; 0 when rejected.
    pub revision: i64,
    /// The stage that the item has reached.
    pub status: AckStatus,
}

/// The stage that an item has reached.
#[derive(Clone, Debug)]
pub enum AckStatus {
    /// Checked, journaled, applied.
    Received {
        /// The map already had the same item; nothing changed.
        duplicate: bool,
    },
    /// Every accepted item up to the sequence is on stable storage.
    Durable,
    /// Solves have covered every accepted item up to the sequence.
    Optimized {
        /// The solve, counted from 1 in each map; 0 when there was nothing to solve.
        solve_id: i64,
        /// What it did.
        outcome: SolveReport,
    },
    /// Refused permanently; nothing changed.
    Rejected(Rejection),
}

/// What the solve behind an ack did.
#[derive(Clone, Debug)]
pub enum SolveReport {
    /// There was nothing to solve.
    Nothing,
    /// It ran; the certificate says how it ended.
    Solved(Arc<SolveCertificate>),
    /// The problem could not be solved as posed; the map keeps its estimates.
    Failed {
        /// Names the variable or factor.
        error: SolveError,
    },
}
