//! What can go wrong between a frontend and its server, and what may be tried again.
//!
//! A status that the server built carries an `ErrorInfo` of domain "covis"; one without comes from
//! the transport, whose codes for a broken link vary (docs/wire.md, "Errors"). Whether a call may be
//! repeated is decided here and nowhere else.

use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tonic::{Code, Status};
use tonic_types::StatusExt;

use crate::wire::v1;

/// `ErrorInfo.domain` of statuses that the server built.
const DOMAIN: &str = "covis";
/// `ErrorInfo.reason` where another server serves the map.
const ELSEWHERE: &str = "MAP_OWNED_ELSEWHERE";

/// Reasons of UNAVAILABLE with which the server did nothing of the call.
const NOT_BEGUN: [&str; 3] = ["STARTING", "MAP_MOVING", ELSEWHERE];
/// How the calls begin that change nothing, or nothing when they are made again.
const HARMLESS: [&str; 7] =
    ["Get", "List", "Localize", "RefinePose", "Solve", "ExportMap", "CreateJob"];

/// Why a call or a session failed.
#[derive(Clone, Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum ClientError {
    /// The server's address is no URL.
    #[error("{url:?} is not the URL of a server, such as http://127.0.0.1:7411")]
    InvalidUrl { url: String },
    /// Nobody answers at the server's address.
    #[error("no server answers at {url}")]
    Unreachable {
        url: String,
        #[source]
        source: Arc<tonic::transport::Error>,
    },
    /// Certificates or a key that cannot be used.
    #[error("certificates for {url}")]
    Tls {
        url: String,
        #[source]
        source: Arc<tonic::transport::Error>,
    },
    /// A token that is empty or does not fit a header. It is not shown.
    #[error("the token is empty or not one line of ASCII")]
    InvalidToken,
    /// A token that others on the network could read along; nothing was sent.
    #[error("a token is not sent in plain text to {url}: use https")]
    TokenInPlainText { url: String },
    /// The server, or the link to it, ended a call.
    #[error("{rpc}: {}", describe(status))]
    Rpc {
        /// The call, for instance `CreateMap`.
        rpc: &'static str,
        status: Box<Status>,
    },
    /// An answer that the wire does not allow.
    #[error("{rpc}: {what}")]
    Protocol { rpc: &'static str, what: &'static str },
    /// An item that the server would not take because of its size; nothing was sent.
    #[error("the item has {bytes} bytes, and the server accepts messages of at most {limit}")]
    TooLarge {
        /// The message's size, bytes.
        bytes: usize,
        /// The server's limit, bytes.
        limit: usize,
    },
    /// A sequence that is not above the one before; nothing was sent.
    #[error("sequence {sequence} is not above {last}")]
    SequenceOrder { sequence: i64, last: i64 },
    /// An item that was waited for, and that the server refused for good. The session goes on.
    #[error("item {sequence} was rejected: {}", describe_violations(violations))]
    Rejected {
        sequence: i64,
        /// Empty when too many items were refused to keep them all.
        violations: Vec<v1::ItemViolation>,
    },
    /// A newer stream of the same client took over.
    #[error("another stream of client {client_id} on map {map_id} has taken over")]
    Fenced { map_id: String, client_id: String },
    /// The map was deleted and made again while the session was open.
    #[error("map {map_id} is not the same map as before (uid {uid}, was {expected})")]
    MapReplaced { map_id: String, expected: String, uid: String },
    /// The server was started anew and no longer has the map: its journal was in memory.
    #[error("the server was restarted (instance {instance_id}) and has no map {map_id} any more")]
    ServerRestarted { map_id: String, instance_id: String },
    /// A map that does not settle, because it takes no changes.
    #[error("map {map_id} is {state}: its remaining work waits until it is open")]
    MapNotOpen {
        map_id: String,
        /// `frozen` or `poisoned`.
        state: &'static str,
    },
    /// The server no longer has items that it had acknowledged.
    #[error(
        "the server lost items: it continues at {next_sequence}, but {acknowledged} was acknowledged"
    )]
    ItemsLost { next_sequence: i64, acknowledged: i64 },
    /// The file of items that do not fit memory cannot be used.
    #[error("{}: the file of waiting items", path.display())]
    Spill {
        path: PathBuf,
        #[source]
        source: Arc<std::io::Error>,
    },
    /// Another process sends for this client on this map, with the same folder.
    #[error("{}: another session holds this file", path.display())]
    SpillInUse { path: PathBuf },
    /// Items of an earlier session wait for a map that is gone. They are left as they are.
    #[error(
        "{}: its items are for another map of this name (uid {expected}, this one has {uid}); \
         remove the file to discard them",
        path.display()
    )]
    SpillOfAnotherMap { path: PathBuf, expected: String, uid: String },
    /// The link did not come back within the retries.
    #[error("gave up after {attempts} attempts")]
    RetriesExhausted {
        attempts: u32,
        #[source]
        last: Box<ClientError>,
    },
    /// The session has ended.
    #[error("the session has ended")]
    Closed,
}

impl ClientError {
    /// Wraps what `rpc` ended with.
    pub(super) fn rpc(rpc: &'static str) -> impl Fn(Status) -> Self {
        move |status| Self::Rpc { rpc, status: Box::new(status) }
    }

    /// The error without the name of the call, which is nothing to whoever called by a command.
    #[must_use]
    pub fn without_call(&self) -> String {
        if let Self::Rpc { status, .. } = self {
            return describe(status);
        }
        if let Self::Protocol { what, .. } = self { (*what).to_owned() } else { self.to_string() }
    }

    /// What a call ended with.
    fn status(&self) -> Option<&Status> {
        if let Self::Rpc { status, .. } = self { Some(status) } else { None }
    }

    /// The error that the last attempt ended with, or this one.
    pub(super) fn into_cause(self) -> Self {
        if let Self::RetriesExhausted { last, .. } = self { *last } else { self }
    }

    /// As [`ClientError::into_cause`].
    fn cause(&self) -> &Self {
        if let Self::RetriesExhausted { last, .. } = self { last } else { self }
    }

    /// The status code, where a call ended with one.
    pub fn code(&self) -> Option<Code> {
        self.cause().status().map(Status::code)
    }

    /// `ErrorInfo.reason` of a status that the server built, for instance `MAP_NOT_FOUND`.
    pub fn reason(&self) -> Option<String> {
        reason(self.cause().status()?)
    }

    /// Whether trying again may help: the link broke, or the server is full or shutting down.
    pub(super) fn is_transient(&self) -> bool {
        let Some(status) = self.status() else {
            return matches!(self, Self::Unreachable { source, .. } if !is_refused_by_tls(&**source));
        };
        let code = status.code();
        if reason(status).is_some() {
            return matches!(code, Code::Unavailable | Code::ResourceExhausted);
        }
        matches!(code, Code::Unavailable | Code::Unknown | Code::Internal | Code::Cancelled)
    }

    /// Whether the call may be made again: the server or the link was not there, and the server says that
    /// it did nothing of the call, or the call changes nothing.
    pub(super) fn may_repeat(&self) -> bool {
        let Self::Rpc { rpc, status } = self else { return false };
        let is_begun = reason(status).is_none_or(|reason| !NOT_BEGUN.contains(&reason.as_str()));
        let is_harmless = HARMLESS.iter().any(|start| rpc.starts_with(start));
        self.is_transient() && !self.is_full() && (is_harmless || !is_begun)
    }

    /// Whether the server has no room.
    pub(super) fn is_full(&self) -> bool {
        self.code() == Some(Code::ResourceExhausted)
    }

    /// The URL of the server that serves the map of a call, where the one that was asked does not.
    /// Nothing of the call was done then.
    pub(super) fn owner(&self) -> Option<String> {
        let info = self.cause().status()?.get_details_error_info()?;
        let is_elsewhere = info.domain == DOMAIN && info.reason == ELSEWHERE;
        info.metadata.get("owner").filter(|_| is_elsewhere).cloned()
    }

    /// How long the server asks to wait before the next attempt.
    pub(super) fn retry_delay(&self) -> Option<Duration> {
        self.status()?.get_details_retry_info()?.retry_delay
    }
}

/// Whether somebody answers whom TLS does not accept, or who does not speak it: that does not pass.
fn is_refused_by_tls(source: &(dyn Error + 'static)) -> bool {
    std::iter::successors(Some(source), |&cause| cause.source()).any(|cause| {
        let error = cause.downcast_ref::<std::io::Error>();
        error.is_some_and(|error| error.kind() == std::io::ErrorKind::InvalidData)
    })
}

/// `ErrorInfo.reason`, where the server built the status.
fn reason(status: &Status) -> Option<String> {
    let info = status.get_details_error_info()?;
    (info.domain == DOMAIN).then_some(info.reason)
}

/// One line: message, bad fields, code.
fn describe(status: &Status) -> String {
    let mut text = match status.message() {
        "" => status.code().description().to_owned(),
        message => message.to_owned(),
    };
    let bad_fields = status.get_details_bad_request().map(|bad| bad.field_violations);
    for violation in bad_fields.unwrap_or_default() {
        if !text.contains(&violation.field) {
            text.push_str(&format!("; {}: {}", violation.field, violation.description));
        }
    }
    format!("{text} ({:?})", status.code())
}

/// One line for a refused field: path, description and reason.
#[must_use]
pub fn describe_violation(violation: &v1::ItemViolation) -> String {
    let reason = violation.reason().as_str_name();
    let reason = reason.strip_prefix("VIOLATION_REASON_").unwrap_or(reason);
    format!("{}: {} ({reason})", violation.field, violation.description)
}

fn describe_violations(violations: &[v1::ItemViolation]) -> String {
    violations.iter().map(describe_violation).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use tonic_types::ErrorDetails;

    use super::*;

    fn error(code: Code, domain: Option<&str>) -> ClientError {
        let mut details = ErrorDetails::new();
        if let Some(domain) = domain {
            details.set_error_info("BUG", domain, std::collections::HashMap::new());
        }
        ClientError::rpc("Ingest")(Status::with_error_details(code, "text", details))
    }

    fn of(rpc: &'static str, code: Code, reason: Option<&str>) -> ClientError {
        let mut details = ErrorDetails::new();
        if let Some(reason) = reason {
            details.set_error_info(reason, DOMAIN, std::collections::HashMap::new());
        }
        ClientError::rpc(rpc)(Status::with_error_details(code, "text", details))
    }

    #[test]
    fn a_call_is_made_again_if_it_changes_nothing_or_was_not_begun() {
        let gone = Code::Unavailable;
        for rpc in ["GetMap", "ListJobs", "SolveBundle", "CreateJob"] {
            assert!(of(rpc, gone, None).may_repeat(), "{rpc}");
            assert!(of(rpc, gone, Some("DRAINING")).may_repeat(), "{rpc}");
            assert!(!of(rpc, Code::NotFound, Some("MAP_NOT_FOUND")).may_repeat(), "{rpc}");
            assert!(!of(rpc, Code::ResourceExhausted, Some("MAP_LIMIT")).may_repeat(), "{rpc}");
        }
        for rpc in ["CreateMap", "DeleteMap", "OptimizeMap", "CancelJob", "MergeMaps"] {
            assert!(!of(rpc, gone, None).may_repeat(), "{rpc}");
            assert!(!of(rpc, gone, Some("DRAINING")).may_repeat(), "{rpc}");
            assert!(of(rpc, gone, Some("STARTING")).may_repeat(), "{rpc}");
            assert!(of(rpc, gone, Some("MAP_MOVING")).may_repeat(), "{rpc}");
        }
    }

    #[test]
    fn a_broken_link_may_be_tried_again_and_a_bug_of_the_server_not() {
        assert!(error(Code::Internal, None).is_transient());
        assert!(error(Code::Unknown, None).is_transient());
        assert!(error(Code::Unavailable, Some("covis")).is_transient());
        assert!(error(Code::ResourceExhausted, Some("covis")).is_transient());
        assert!(!error(Code::Internal, Some("covis")).is_transient());
        assert!(!error(Code::InvalidArgument, None).is_transient());
        assert!(!ClientError::Closed.is_transient());
        assert_eq!(error(Code::Internal, Some("covis")).reason().as_deref(), Some("BUG"));
        assert_eq!(error(Code::Internal, Some("other")).reason(), None);
    }
}
