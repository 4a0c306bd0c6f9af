//! What comes back on an ingest stream: acks of items, and the reason when the stream ends.
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
    /// The stream is over; nothing follows. A stream that its client finished ends without it.
    End(EngineError),
}

/// An acknowledgment.
#[derive(Clone, Debug)]
pub struct Ack {
    /// The item's sequence; for cumulative statuses the last that is covered.
    pub sequence: i64,
    /// Revision of the map that holds the effect; 0 when rejected.
    pub revision: i64,
    /// How far the item has come.
    pub status: AckStatus,
}

/// How far an item has come.
#[derive(Clone, Debug)]
pub enum AckStatus {
    /// Checked, journaled, applied.
    Received {
        /// The map already had this very item; nothing changed.
        duplicate: bool,
    },
    /// Every taken item up to the sequence is on stable storage.
    Durable,
    /// Solves have covered every taken item up to the sequence.
    Optimized {
        /// The solve, counted from 1 in each map; 0 when there was nothing to solve.
        solve_id: i64,
        /// What it did.
        outcome: SolveReport,
    },
    /// Refused for good; nothing changed.
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
