//! The wire's reason for what is wrong with a field or a problem.
//!
//! Both kinds of answer use them: an ack carries the enum, a status the name. Matches are exhaustive. No
//! status is made here.

use covis_solvers::problem::SolveError;

use crate::map::Reason;
use crate::wire::v1::ViolationReason;

/// The wire's reason for a domain reason.
pub(super) fn violation_reason(reason: Reason) -> ViolationReason {
    match reason {
        Reason::Missing => ViolationReason::Missing,
        Reason::NotFinite => ViolationReason::NotFinite,
        Reason::OutOfRange => ViolationReason::OutOfRange,
        Reason::NotNormalized => ViolationReason::NotUnit,
        Reason::NotPositiveDefinite => ViolationReason::NotPositiveDefinite,
        Reason::WrongLength => ViolationReason::WrongLength,
        Reason::UnknownReference => ViolationReason::UnknownReference,
        Reason::AlreadyExists => ViolationReason::AlreadyExists,
        Reason::Duplicate => ViolationReason::Duplicate,
        Reason::ProjectionNotFinite => ViolationReason::NotProjectable,
        Reason::Inconsistent => ViolationReason::Inconsistent,
        Reason::UnknownValue => ViolationReason::UnknownValue,
        Reason::Unimplemented => ViolationReason::Unimplemented,
        Reason::TooLarge => ViolationReason::TooLarge,
    }
}

/// The wire's reason for a problem that cannot be solved as posed.
pub(super) fn solve_reason(error: &SolveError) -> ViolationReason {
    match error {
        SolveError::Empty(_) => ViolationReason::Missing,
        SolveError::IndexOutOfRange { .. } => ViolationReason::UnknownReference,
        SolveError::LengthMismatch { .. } => ViolationReason::WrongLength,
        SolveError::NotFinite { .. } => ViolationReason::NotFinite,
        SolveError::ResidualNotFinite { .. } => ViolationReason::NotProjectable,
        SolveError::NotPositiveDefinite { .. } | SolveError::Singular { .. } => {
            ViolationReason::NotPositiveDefinite
        }
        SolveError::Disconnected { .. } => ViolationReason::Disconnected,
        SolveError::DuplicateId { .. } => ViolationReason::Duplicate,
        SolveError::TooLarge { .. } | SolveError::TooExpensive(_) | SolveError::Interrupted => {
            ViolationReason::TooLarge
        }
        SolveError::InvalidOption { .. }
        | SolveError::SelfRange { .. }
        | SolveError::BadLoss { .. }
        | SolveError::Threads { .. } => ViolationReason::OutOfRange,
    }
}

/// The name of a domain reason on the wire.
pub(super) fn reason_name(reason: Reason) -> &'static str {
    wire_name(violation_reason(reason))
}

/// A reason's name without the enum's prefix.
pub(super) fn wire_name(reason: ViolationReason) -> &'static str {
    let name = reason.as_str_name();
    name.strip_prefix("VIOLATION_REASON_").unwrap_or(name)
}
