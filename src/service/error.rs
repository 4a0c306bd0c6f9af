//! Why a call or stream ends early, in the edge's own terms. [`super::status`] assigns the codes.
//! The rejection of one item of a stream is not an error: it is a `Rejection` in the item's ack.

use covis_solvers::problem::SolveError;

use super::engine::{EngineError, PoolError};
use super::job_error::JobError;
use super::names::hide_tenant;
use crate::map::{Reason, Rejection};
use crate::wire::v1;

/// The end of a call that has no answer.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum ServiceError {
    /// Fields of the request are bad, or not served yet.
    Rejected(Rejection),
    /// Messages arrived out of order, or one had no content.
    Protocol { field: &'static str, description: &'static str },
    /// An error of the engine.
    Engine(EngineError),
    /// The problem in the request cannot be solved as posed.
    Unsolvable { field: &'static str, error: SolveError },
    /// The map has no such client.
    ClientNotFound { map: String, client: String },
    /// A file format has no place for something in the map.
    FormatCannotHoldMap { map: String, reason: String },
    /// An error of a job.
    Job(JobError),
    /// A worker could not do its task: what the call would have answered there.
    OfWorker(v1::JobFailure),
    /// Part of the wire, not served yet.
    Unserved { what: &'static str },
    /// The server keeps no more of something.
    ServerLimit { limit: &'static str, maximum: i64 },
    /// A request message, or the rest of one, did not arrive in time.
    SlowMessage {
        /// The time limit, seconds.
        seconds: u64,
    },
    /// The caller sent no token, or an unknown one.
    Unauthenticated { what: &'static str },
    /// The caller's role does not cover the call.
    RoleTooLow { needed: &'static str },
    /// The server is still opening its maps.
    Starting,
    /// The server is shutting down.
    Draining,
    /// The call's deadline passed.
    DeadlineExceeded,
    /// The caller read no message for so long that the call was ended.
    Unread {
        /// How long, in seconds.
        seconds: u64,
    },
    /// The caller went away; nobody reads the code.
    Gone,
    /// A message that could not be read, with the code that the transport gives it.
    Transport { code: tonic::Code, message: String },
    /// A bug in a handler or a solve.
    Panicked { message: String },
}

impl ServiceError {
    /// One bad field.
    pub(super) fn field(
        field: impl Into<String>,
        reason: Reason,
        description: impl Into<String>,
    ) -> Self {
        Self::Rejected(Rejection::of(field, reason, description))
    }
}

impl From<Rejection> for ServiceError {
    fn from(rejection: Rejection) -> Self {
        Self::Rejected(rejection)
    }
}

impl From<JobError> for ServiceError {
    fn from(error: JobError) -> Self {
        Self::Job(error)
    }
}

impl From<EngineError> for ServiceError {
    fn from(error: EngineError) -> Self {
        Self::Engine(hide_tenant(error))
    }
}

impl From<PoolError> for ServiceError {
    fn from(error: PoolError) -> Self {
        match error {
            PoolError::Panicked(panicked) => Self::Panicked { message: panicked.message },
            PoolError::Full(error) => Self::Engine(error),
        }
    }
}
