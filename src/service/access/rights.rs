//! Whether an open stream may continue: its caller was admitted, but may have lost the right since.
//!
//! The token is not kept, only what identifies it: the digest of a listed token; the key and the
//! expiry of a signed one. A token that is removed from the file, changes its tenant, expires, or
//! whose key is removed counts as no token. If its role no longer covers the call, the call is
//! refused.

use std::sync::Arc;

use super::jwks::Key;
use super::{Access, Caller, CredentialFiles, EXPIRED, UNKNOWN, audit};
use crate::service::error::ServiceError;

/// The proof that a caller presented.
#[derive(Clone, Debug)]
pub(super) enum Proof {
    /// No proof was required.
    Nothing,
    /// A token of the file, by its digest.
    Listed([u8; 32]),
    /// A JSON Web Token.
    Signed {
        /// The name of the key that signed it.
        kid: Arc<str>,
        /// The key that signed it.
        key: Arc<Key>,
        /// When the token expires, leeway included, Unix time in seconds.
        end: i64,
    },
}

impl Access {
    /// Resolves once `caller` may no longer make the call that it was admitted to, with the reason.
    pub(in crate::service) async fn withdrawn(&self, caller: &Caller) -> ServiceError {
        let reason = tokio::select! {
            biased;
            () = self.expired(caller) => EXPIRED,
            reason = self.refused(caller) => reason,
        };
        audit::withdrawn(caller, &reason);
        reason
    }

    async fn expired(&self, caller: &Caller) {
        match caller.proof() {
            Proof::Signed { end, .. } => self.clock.reached(*end).await,
            Proof::Nothing | Proof::Listed(_) => std::future::pending().await,
        }
    }

    /// Resolves once the files no longer admit the caller.
    async fn refused(&self, caller: &Caller) -> ServiceError {
        let mut known = self.known.subscribe();
        loop {
            // Also at once: the files may have changed since the call was admitted.
            if let Err(reason) = still_admits(&known.borrow_and_update(), caller) {
                return reason;
            }
            if known.changed().await.is_err() {
                std::future::pending::<()>().await;
            }
        }
    }
}

fn still_admits(known: &CredentialFiles, caller: &Caller) -> Result<(), ServiceError> {
    match caller.proof() {
        Proof::Nothing => Ok(()),
        Proof::Listed(digest) => {
            let owner = known.tokens.as_ref().and_then(|tokens| tokens.owner(digest));
            let owner = owner.filter(|owner| owner.tenant() == caller.tenant()).ok_or(UNKNOWN)?;
            owner.require(caller.needed())
        }
        Proof::Signed { kid, key, .. } => {
            let present = known.keys.as_ref().and_then(|keys| keys.get(kid));
            (present == Some(key)).then_some(()).ok_or(UNKNOWN)
        }
    }
}
