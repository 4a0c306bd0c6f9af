//! Domain errors → `tonic::Status`: only here, matched exhaustively.
//!
//! Every status carries an `ErrorInfo` (domain "covis"); bad fields also a `BadRequest`, errors
//! that can be retried a `RetryInfo`. Codes and reasons are those of docs/wire.md. A bug is
//! answered with an id under which the log has the details.

use std::collections::HashMap;
use std::time::Duration;

use covis_solvers::price::{Resource, TooExpensive, to_gflop};
use covis_solvers::problem::SolveError;
use tonic::{Code, Status};
use tonic_types::{ErrorDetails, FieldViolation, StatusExt};

use super::convert::time::timestamp;
use super::engine::EngineError;
use super::error::ServiceError;
use super::job_error::JobError;
use super::names::maps_of;
use super::random::random_id;
use super::reasons::{reason_name, solve_reason, wire_name};
use crate::map::{MergeError, Reason, Rejection};
use crate::store::StoreError;
use crate::wire::v1::JobFailure;

/// Most bytes of a status' message, and of a description of a field. A status travels in headers, and
/// clients take 16 KiB of them: what a caller sent is not repeated at any length.
const MESSAGE: usize = 1024;
const DESCRIPTION: usize = 256;
/// Most bytes of all violations of a status.
const VIOLATIONS: usize = 4096;
/// `ErrorInfo.domain`.
const DOMAIN: &str = "covis";
/// Retry delay when a map or the server is full.
const RETRY_FULL: Duration = Duration::from_secs(1);
/// Retry delay while a server opens its maps.
const RETRY_STARTING: Duration = Duration::from_secs(1);
/// Retry delay while a map moves into another one.
const RETRY_MOVING: Duration = Duration::from_millis(100);
/// Retry delay while a map has no server, or the caller has not asked the one that it has.
const RETRY_ELSEWHERE: Duration = Duration::from_millis(100);
/// Retry delay while a server shuts down and another may replace it.
const RETRY_DRAINING: Duration = Duration::from_secs(2);

/// What a status is built from.
struct Parts {
    code: Code,
    reason: &'static str,
    message: String,
    metadata: Vec<(&'static str, String)>,
    violations: Vec<FieldViolation>,
    retry: Option<Duration>,
}

impl Parts {
    fn new(code: Code, reason: &'static str, message: impl Into<String>) -> Self {
        let (metadata, violations) = (Vec::new(), Vec::new());
        Self { code, reason, message: message.into(), metadata, violations, retry: None }
    }

    fn with(mut self, name: &'static str, value: impl ToString) -> Self {
        self.metadata.push((name, value.to_string()));
        self
    }

    fn violation(mut self, field: &str, reason: &'static str, description: &str) -> Self {
        let (field, description) = (field.to_owned(), description.to_owned());
        let reason = reason.to_owned();
        let violation = FieldViolation { field, description, reason, ..FieldViolation::default() };
        self.violations.push(violation);
        self
    }

    fn retry(mut self, delay: Duration) -> Self {
        self.retry = Some(delay);
        self
    }

    /// Cuts what would not fit the headers.
    fn fitting(mut self) -> Self {
        shorten(&mut self.message, MESSAGE);
        let mut bytes = 0;
        self.violations.retain_mut(|violation| {
            shorten(&mut violation.description, DESCRIPTION);
            bytes += violation.field.len() + violation.description.len();
            bytes <= VIOLATIONS
        });
        self
    }

    fn status(self) -> Status {
        let mut details = ErrorDetails::new();
        let metadata: HashMap<String, String> =
            self.metadata.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        details.set_error_info(self.reason, DOMAIN, metadata);
        if !self.violations.is_empty() {
            details.set_bad_request(self.violations);
        }
        if self.retry.is_some() {
            details.set_retry_info(self.retry);
        }
        Status::with_error_details(self.code, self.message, details)
    }
}

/// Cuts a text to at most so many bytes.
fn shorten(text: &mut String, most: usize) {
    const MARK: &str = "…";
    if text.len() > most {
        text.truncate(text.floor_char_boundary(most - MARK.len()));
        text.push_str(MARK);
    }
}

impl From<ServiceError> for Status {
    fn from(error: ServiceError) -> Self {
        match error {
            ServiceError::Rejected(rejection) => rejected(&rejection),
            ServiceError::Protocol { field, description } => {
                Parts::new(Code::InvalidArgument, "PROTOCOL", format!("{field}: {description}"))
                    .violation(field, "PROTOCOL", description)
            }
            ServiceError::Engine(error) => engine(error),
            ServiceError::Unsolvable { field, error } => unsolvable(field, &error),
            ServiceError::ClientNotFound { map, client } => {
                let text = format!("map {map:?} has no client {client:?}");
                Parts::new(Code::NotFound, "CLIENT_NOT_FOUND", text)
                    .with("map_id", map)
                    .with("client_id", client)
            }
            ServiceError::FormatCannotHoldMap { map, reason } => {
                Parts::new(Code::FailedPrecondition, "FORMAT_CANNOT_HOLD_MAP", reason)
                    .with("map_id", map)
            }
            ServiceError::Job(error) => job(error),
            ServiceError::OfWorker(failure) => return of_worker(failure),
            ServiceError::Unserved { what } => {
                let text = format!("{what} is not served yet");
                Parts::new(Code::Unimplemented, "UNIMPLEMENTED", text)
            }
            ServiceError::ServerLimit { limit, maximum } => {
                let text = format!("the server is full: {limit} is {maximum}");
                Parts::new(Code::ResourceExhausted, "SERVER_LIMIT", text)
                    .with("limit", limit)
                    .retry(RETRY_FULL)
            }
            ServiceError::SlowMessage { seconds } => {
                let text = format!("no request message was completed for {seconds} s");
                Parts::new(Code::DeadlineExceeded, "SLOW_MESSAGE", text)
                    .with("message_time_s", seconds)
            }
            ServiceError::Unauthenticated { what } => {
                Parts::new(Code::Unauthenticated, "UNAUTHENTICATED", what)
            }
            ServiceError::RoleTooLow { needed } => {
                let text = format!("the token's role does not cover this call: it needs {needed}");
                Parts::new(Code::PermissionDenied, "ROLE_TOO_LOW", text).with("role", needed)
            }
            ServiceError::Starting => {
                let text = "the server still opens its maps";
                Parts::new(Code::Unavailable, "STARTING", text).retry(RETRY_STARTING)
            }
            ServiceError::Draining => draining(),
            ServiceError::DeadlineExceeded => {
                let text = "the call's deadline passed";
                Parts::new(Code::DeadlineExceeded, "DEADLINE_EXCEEDED", text)
            }
            ServiceError::Unread { seconds } => {
                let text = format!("no message was taken for {seconds} s");
                Parts::new(Code::ResourceExhausted, "UNREAD", text)
                    .with("limit", "max_unread_seconds")
                    .with("maximum", seconds)
                    .retry(RETRY_FULL)
            }
            ServiceError::Gone => Parts::new(Code::Cancelled, "CANCELLED", "the caller canceled"),
            ServiceError::Transport { code, message } => Parts::new(code, "TRANSPORT", message),
            ServiceError::Panicked { message } => bug(None, &message),
        }
        .fitting()
        .status()
    }
}

fn of_worker(failure: JobFailure) -> Status {
    let mut details = ErrorDetails::new();
    details.set_error_info(failure.reason, DOMAIN, HashMap::new());
    Status::with_error_details(Code::from_i32(failure.code), failure.message, details)
}

fn job(error: JobError) -> Parts {
    let message = error.to_string();
    let parts = |code, reason| Parts::new(code, reason, message.clone());
    match error {
        JobError::NotFound { job } => parts(Code::NotFound, "JOB_NOT_FOUND").with("job_id", job),
        JobError::Exists { job } => parts(Code::AlreadyExists, "JOB_EXISTS").with("job_id", job),
        JobError::Ended { job } => parts(Code::FailedPrecondition, "JOB_ENDED").with("job_id", job),
        JobError::NotEnded { job } => {
            parts(Code::FailedPrecondition, "JOB_NOT_ENDED").with("job_id", job)
        }
        JobError::MapBusy { map, job } => {
            parts(Code::Aborted, "JOB_RUNNING").with("map_id", map).with("job_id", job)
        }
        JobError::UploadNotFound { upload } => {
            parts(Code::NotFound, "UPLOAD_NOT_FOUND").with("upload_id", upload)
        }
        JobError::FileNotFound { job, path } => {
            parts(Code::NotFound, "JOB_FILE_NOT_FOUND").with("job_id", job).with("path", path)
        }
        JobError::Unavailable { cause: _ } => {
            parts(Code::ResourceExhausted, "STORE_UNAVAILABLE").retry(RETRY_FULL)
        }
        JobError::Failed { cause: _ } => parts(Code::Internal, "STORE_FAILED"),
        JobError::BadFile { text } => parts(Code::InvalidArgument, "INCONSISTENT").violation(
            "spec.solve_files",
            "INCONSISTENT",
            &text,
        ),
    }
}

fn rejected(rejection: &Rejection) -> Parts {
    let first = rejection.violations.first();
    let reason = first.map_or("MISSING", |v| reason_name(v.reason));
    let code = match first.map(|v| v.reason) {
        Some(Reason::Unimplemented) => Code::Unimplemented,
        _ => Code::InvalidArgument,
    };
    let parts = Parts::new(code, reason, rejection.to_string());
    rejection
        .violations
        .iter()
        .fold(parts, |parts, v| parts.violation(&v.field, reason_name(v.reason), &v.description))
}

fn engine(mut error: EngineError) -> Parts {
    let message = error.to_string();
    let map = maps_of(&mut error)[0].as_deref().cloned();
    let with_map = |parts: Parts| match &map {
        Some(map) => parts.with("map_id", map),
        None => parts,
    };
    let parts = |code, reason| with_map(Parts::new(code, reason, message.clone()));
    let bad_field =
        |field, reason| parts(Code::InvalidArgument, reason).violation(field, reason, &message);
    let full = |reason, limit| {
        parts(Code::ResourceExhausted, reason).with("limit", limit).retry(RETRY_FULL)
    };
    match error {
        EngineError::MapNotFound { .. } => parts(Code::NotFound, "MAP_NOT_FOUND"),
        EngineError::MapExists { .. } => parts(Code::AlreadyExists, "MAP_EXISTS"),
        EngineError::Refused { .. } => parts(Code::FailedPrecondition, "CHANGE_REFUSED"),
        EngineError::Poisoned { .. } => parts(Code::FailedPrecondition, "MAP_POISONED"),
        EngineError::Frozen { .. } => parts(Code::FailedPrecondition, "MAP_FROZEN"),
        EngineError::Moving { .. } => parts(Code::Unavailable, "MAP_MOVING").retry(RETRY_MOVING),
        EngineError::MergedAway { map: _, into } => {
            parts(Code::FailedPrecondition, "MAP_MERGED").with("merged_into", into)
        }
        EngineError::NotMerged { .. } => parts(Code::NotFound, "NOT_MERGED"),
        EngineError::NotAligned { .. } => parts(Code::FailedPrecondition, "NOT_ALIGNED"),
        EngineError::CannotMerge { map: _, error } => {
            let reason = match error {
                MergeError::Anchors => "ANCHOR_IN_USE",
                MergeError::ClientInBoth { .. } => "CLIENT_IN_BOTH",
                MergeError::Scaled { .. } => "SCALE_MEASURED",
                MergeError::OnlySourceIsMetric => "TARGET_WITHOUT_SCALE",
                MergeError::UnknownClient { .. } | MergeError::NameTwice { .. } => {
                    return bad_field("renamed_clients", "INCONSISTENT");
                }
                MergeError::OutOfRange => return bad_field("target_from_source", "OUT_OF_RANGE"),
                MergeError::Content(_) => return with_map(bug(None, &message)),
            };
            parts(Code::FailedPrecondition, reason)
        }
        EngineError::NoSuchKeyframe { .. } => bad_field("constraints", "UNKNOWN_REFERENCE"),
        EngineError::NoPlaceRecognition { .. } => {
            parts(Code::FailedPrecondition, "NO_PLACE_RECOGNITION")
        }
        EngineError::AnchorInUse { .. } => parts(Code::FailedPrecondition, "ANCHOR_IN_USE"),
        EngineError::RevisionMismatch { actual, .. } => {
            parts(Code::Aborted, "REVISION_MISMATCH").with("revision", actual)
        }
        EngineError::EpochFenced { map: _, client, epoch, newest: _ } => {
            parts(Code::Aborted, "EPOCH_FENCED").with("client_id", client).with("epoch", epoch)
        }
        EngineError::TooLarge { field, maximum: _ } => bad_field(field, "OUT_OF_RANGE"),
        EngineError::OptimizationRunning { .. } => parts(Code::Aborted, "OPTIMIZATION_RUNNING"),
        EngineError::MapLimit { map: _, limit, maximum: _ } => full("MAP_LIMIT", limit),
        EngineError::TenantLimit { limit, maximum } => {
            full("TENANT_LIMIT", limit).with("maximum", maximum)
        }
        EngineError::ServerLimit { limit, maximum } => {
            full("SERVER_LIMIT", limit).with("maximum", maximum)
        }
        EngineError::RevisionAhead { .. } => bad_field("from_revision", "OUT_OF_RANGE"),
        EngineError::NotKept { map: _, field, oldest, newest } => {
            let times = [oldest, newest].map(|state| timestamp(state.time_ns));
            let text = format!("{message}, that is at times {} to {}", times[0], times[1]);
            with_map(Parts::new(Code::InvalidArgument, "OUT_OF_RANGE", text.clone()))
                .with("oldest_revision", oldest.revision)
                .with("newest_revision", newest.revision)
                .violation(field, "OUT_OF_RANGE", &text)
        }
        EngineError::Solve(SolveError::Empty(_)) => {
            parts(Code::FailedPrecondition, "NOTHING_TO_SOLVE")
        }
        EngineError::Solve(error) => not_solved(&error, &message)
            .unwrap_or_else(|| parts(Code::FailedPrecondition, wire_name(solve_reason(&error)))),
        EngineError::NothingToSolve { .. } => parts(Code::FailedPrecondition, "NOTHING_TO_SOLVE"),
        EngineError::Cancelled { .. } => parts(Code::Cancelled, "CANCELLED"),
        EngineError::ShuttingDown => draining(),
        EngineError::Store(error) => store(error),
        EngineError::Journal { .. } | EngineError::Threads { .. } => with_map(bug(None, &message)),
        EngineError::Bug { id } => bug(Some(id), &message),
    }
}

fn store(error: StoreError) -> Parts {
    let message = error.to_string();
    let parts =
        |code, reason, map: String| Parts::new(code, reason, message.clone()).with("map_id", map);
    match error {
        StoreError::UnknownMap { map } => parts(Code::NotFound, "MAP_NOT_FOUND", map),
        StoreError::MapExists { map } => parts(Code::AlreadyExists, "MAP_EXISTS", map),
        StoreError::Unavailable { map, cause: _ } => {
            parts(Code::ResourceExhausted, "STORE_UNAVAILABLE", map).retry(RETRY_FULL)
        }
        StoreError::Failed { map, cause: _ } => parts(Code::Internal, "STORE_FAILED", map),
        // The map can be read; it accepts changes again after the disk was repaired.
        StoreError::Stopped { map, .. }
        | StoreError::Unfit { map, .. }
        | StoreError::Later { map, .. }
        | StoreError::Ambiguous { map, .. } => parts(Code::FailedPrecondition, "MAP_POISONED", map),
        StoreError::Damaged { map, mut damage } => {
            // Callers learn nothing about the server's folders.
            damage.file = damage.file.rsplit(['/', '\\']).next().unwrap_or_default().to_owned();
            let message = StoreError::Damaged { map: map.clone(), damage }.to_string();
            Parts::new(Code::FailedPrecondition, "MAP_POISONED", message).with("map_id", map)
        }
        // Clients follow to the owner.
        StoreError::OwnedElsewhere { map, owner } => {
            let parts = parts(Code::Unavailable, "MAP_OWNED_ELSEWHERE", map).retry(RETRY_ELSEWHERE);
            match owner {
                Some(owner) => parts.with("owner", owner),
                None => parts,
            }
        }
        // The engine is the only writer of a journal: if another writer fenced it, that is a bug.
        StoreError::Fenced { .. }
        | StoreError::SequenceMismatch { .. }
        | StoreError::Truncated { .. }
        | StoreError::NotReadable { .. }
        | StoreError::NoSnapshot { .. }
        | StoreError::File { .. }
        | StoreError::Content { .. }
        | StoreError::InUse { .. }
        | StoreError::NotEmpty { .. } => bug(None, &message),
    }
}

fn unsolvable(field: &str, error: &SolveError) -> Parts {
    let message = error.to_string();
    not_solved(error, &message).unwrap_or_else(|| {
        let reason = wire_name(solve_reason(error));
        Parts::new(Code::InvalidArgument, reason, message.clone())
            .violation(field, reason, &message)
    })
}

/// Why a solve did not run or did not end; `None` where its problem is to blame.
fn not_solved(error: &SolveError, message: &str) -> Option<Parts> {
    if let SolveError::Threads { .. } = error {
        Some(bug(None, message))
    } else if let SolveError::TooExpensive(error) = error {
        Some(too_expensive(*error))
    } else if let SolveError::Interrupted = error {
        Some(Parts::new(Code::DeadlineExceeded, "DEADLINE_EXCEEDED", message))
    } else {
        None
    }
}

/// The same request never fits: waiting does not help, so there is no `RetryInfo`.
fn too_expensive(error: TooExpensive) -> Parts {
    let TooExpensive { resource, estimate, limit } = error;
    let (name, estimate, maximum) = match resource {
        Resource::Bytes => ("max_solve_bytes", estimate, limit),
        Resource::FlopsPerIteration => ("max_solve_gflops", to_gflop(estimate), to_gflop(limit)),
    };
    Parts::new(Code::ResourceExhausted, "SOLVE_TOO_EXPENSIVE", error.to_string())
        .with("limit", name)
        .with("estimate", estimate)
        .with("maximum", maximum)
}

fn draining() -> Parts {
    let text = "the server is shutting down";
    Parts::new(Code::Unavailable, "DRAINING", text).retry(RETRY_DRAINING)
}

/// A bug: the message names an entry of the log, which has the details.
fn bug(id: Option<String>, details: &str) -> Parts {
    let id = id.unwrap_or_else(|| {
        let id = random_id();
        tracing::error!(id, details, "a bug was hit");
        id
    });
    let text = format!("a bug was hit, see {id} in the log");
    Parts::new(Code::Internal, "BUG", text).with("id", id)
}

#[cfg(test)]
mod tests {
    use tonic::{Code, Status};
    use tonic_types::StatusExt as _;

    use super::{EngineError, ServiceError};
    use crate::store::{Damage, StoreError};

    fn status(error: StoreError) -> Status {
        ServiceError::Engine(EngineError::Store(error)).into()
    }

    #[test]
    fn an_answer_names_the_map_and_no_file_of_the_server() {
        let (map, path) =
            ("a".to_owned(), "/srv/covis/maps/00ff/00000000000000000001.log".to_owned());
        let (file, lost) = (path.clone(), Some((1, 3)));
        let damage = Damage { file, offset: 44, lost, unreadable: None };
        let damaged = status(StoreError::Damaged { map: map.clone(), damage });
        let text = "map \"a\" takes no changes: 00000000000000000001.log is damaged at byte 44: \
                    events 1 to 3 are lost";
        assert_eq!((damaged.code(), damaged.message()), (Code::FailedPrecondition, text));
        let message = "no".to_owned();
        let file =
            StoreError::File { action: "cannot read", path: path.clone(), message, passes: false };
        let content = StoreError::Content { path, message: "torn".to_owned() };
        for error in [file, content, StoreError::Failed { map, cause: "torn".to_owned() }] {
            assert!(!status(error.clone()).message().contains('/'), "{error}");
        }
    }

    #[test]
    fn a_store_without_room_asks_to_come_back() {
        let (map, cause) = ("a".to_owned(), "No space left on device".to_owned());
        let status = status(StoreError::Unavailable { map, cause });
        assert_eq!(status.code(), Code::ResourceExhausted);
        let info = status.get_details_error_info().unwrap();
        assert_eq!(
            (info.reason.as_str(), info.metadata["map_id"].as_str()),
            ("STORE_UNAVAILABLE", "a")
        );
        assert!(status.get_details_retry_info().is_some());
    }
}
