//! Why a call or stream ends early, in the edge's own terms. [`super::status`] assigns the codes.
//! The rejection of one item of a stream is not an error: it is a `Rejection` in the item's ack.

use covis_solvers::problem::SolveError;

use super::access::hide_tenant;
use super::engine::{EngineError, PoolError};
use super::jobs::JobError;
use crate::map::{Reason, Rejection};
use crate::wire::v1;

/// The end of a call that has no answer.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum ServiceError {
    /// Fields of the request are bad, or not served yet.
    Rejected(Rejection),
    /// Messages arrived out of order, or one had no content.
    Protocol {
        /// The field at fault.
        field: &'static str,
        /// What was expected.
        description: &'static str,
    },
    /// An error of the engine.
    Engine(EngineError),
    /// The problem in the request cannot be solved as posed.
    Unsolvable {
        /// The field that holds the problem.
        field: &'static str,
        /// What is wrong with it.
        error: SolveError,
    },
    /// The map has no such client.
    ClientNotFound {
        /// The map.
        map: String,
        /// The client.
        client: String,
    },
    /// A file format has no place for something in the map.
    FormatCannotHoldMap {
        /// The map.
        map: String,
        /// What the format cannot contain.
        reason: String,
    },
    /// An error of a job.
    Job(JobError),
    /// A worker could not do its task: what the call would have answered there.
    OfWorker(v1::JobFailure),
    /// Part of the wire, not served yet.
    Unserved {
        /// The call or value.
        what: &'static str,
    },
    /// The server keeps no more of something.
    ServerLimit {
        /// The limit's name.
        limit: &'static str,
        /// Its value.
        maximum: i64,
    },
    /// A request message, or the rest of one, did not arrive in time.
    SlowMessage {
        /// The time limit, seconds.
        seconds: u64,
    },
    /// The caller sent no token, or an unknown one.
    Unauthenticated {
        /// What is wrong.
        what: &'static str,
    },
    /// The caller's role does not cover the call.
    RoleTooLow {
        /// The role that the call needs.
        needed: &'static str,
    },
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
    Transport {
        /// The transport's code.
        code: tonic::Code,
        /// Its message.
        message: String,
    },
    /// A bug in a handler or a solve.
    Panicked {
        /// The message of the panic, for the log.
        message: String,
    },
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
