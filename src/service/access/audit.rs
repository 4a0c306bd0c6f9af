//! The record of deletions, merges and refusals: log lines with target `audit`, which `COVIS_LOG` filters like any other
//! but which the command line keeps on by default. They name the token's owner, never the token.

use std::net::SocketAddr;

use super::jwt::Refusal;
use super::{Caller, Role};
use crate::service::error::ServiceError;
use crate::service::log_limit::LogLimit;

/// Who deleted, merged or took apart which map, and whether it worked.
pub(in crate::service) fn change<T>(
    action: &str,
    caller: &Caller,
    peer: Option<SocketAddr>,
    map: &str,
    result: &Result<T, ServiceError>,
) {
    let outcome = if result.is_ok() { "done" } else { "failed" };
    let peer = peer.map(|peer| peer.to_string()).unwrap_or_default();
    let (token, tenant) = (caller.token(), caller.tenant());
    tracing::info!(target: "audit", action, map, tenant, token, peer, outcome);
}

/// Refusals. Anybody can cause any number of them, so that a flood is logged as a sum. Strangers
/// are counted separately, so that they cannot hide what known callers try.
#[derive(Debug, Default)]
pub(super) struct Refusals {
    known: LogLimit,
    strangers: LogLimit,
}

impl Refusals {
    /// A known caller asked for more than its role allows.
    pub(super) fn role(&self, caller: &Caller, path: &str, needed: Role) {
        let (token, tenant, needed) = (caller.token(), caller.tenant(), needed.name());
        let line = || tracing::info!(target: "audit", action = path, tenant, token, needed, outcome = "refused");
        self.known.log(line, |count| {
            let reason = "a role is too low";
            tracing::info!(target: "audit", count, reason, outcome = "more were refused");
        });
    }

    /// A JSON Web Token was refused; its bearer does not learn why.
    pub(super) fn not_taken(&self, path: &str, reason: &Refusal) {
        let line = || tracing::info!(target: "audit", action = path, %reason, outcome = "refused");
        self.strangers.log(line, |count| {
            let reason = "tokens were refused";
            tracing::info!(target: "audit", count, reason, outcome = "more were refused");
        });
    }
}

/// An open stream ends because its caller has lost the right to it.
pub(super) fn withdrawn(caller: &Caller, reason: &ServiceError) {
    let (token, tenant) = (caller.token(), caller.tenant());
    let is_known = matches!(reason, ServiceError::RoleTooLow { .. });
    let reason = if is_known { "the role is too low now" } else { "the token is no longer valid" };
    tracing::info!(target: "audit", tenant, token, reason, outcome = "stream ended");
}
