//! The record of deletions and refusals: log lines with target `audit`, which `COVIS_LOG` filters like any other
//! but which the command line keeps on by default. They name the token's owner, never the token.

use std::net::SocketAddr;

use super::jwt::Refusal;
use super::{Caller, Role};
use crate::service::error::ServiceError;

/// Who deleted which map, and whether it worked.
pub(in crate::service) fn deletion(
    caller: &Caller,
    peer: Option<SocketAddr>,
    map: &str,
    result: &Result<(), ServiceError>,
) {
    let outcome = if result.is_ok() { "deleted" } else { "failed" };
    let peer = peer.map(|peer| peer.to_string()).unwrap_or_default();
    let (token, tenant) = (caller.token(), caller.tenant());
    tracing::info!(target: "audit", action = "DeleteMap", map, tenant, token, peer, outcome);
}

/// A known caller asked for more than its role allows.
pub(super) fn refusal(caller: &Caller, path: &str, needed: Role) {
    let (token, tenant, needed) = (caller.token(), caller.tenant(), needed.name());
    tracing::info!(target: "audit", action = path, tenant, token, needed, outcome = "refused");
}

/// A JSON Web Token was not taken; its bearer is not told why.
pub(super) fn not_taken(path: &str, reason: &Refusal) {
    tracing::info!(target: "audit", action = path, %reason, outcome = "refused");
}

/// An open stream ends because its caller has lost the right to it.
pub(super) fn withdrawn(caller: &Caller, reason: &ServiceError) {
    let (token, tenant) = (caller.token(), caller.tenant());
    let is_known = matches!(reason, ServiceError::RoleTooLow { .. });
    let reason = if is_known { "the role is too low now" } else { "the token no longer counts" };
    tracing::info!(target: "audit", tenant, token, reason, outcome = "stream ended");
}
