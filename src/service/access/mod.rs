//! Who may call what: bearer tokens, roles, tenants, and the record of deletions.
//!
//! [`Guarded`] stands before every service but health. It admits a request by its token and by the
//! role that its RPC needs, and hands the [`Caller`] on in the request's extensions. Without a file
//! of tokens everybody is an administrator of the default tenant. No token is logged or kept: what
//! is compared are digests.

mod audit;
mod guard;
mod roles;
mod tenants;
mod tokens;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{PoisonError, RwLock};

use tonic::Request;
use tonic::codegen::http::HeaderMap;

use super::engine::TenantCeilings;
use super::error::ServiceError;
use tokens::Tokens;

pub(super) use audit::deletion;
pub(super) use guard::Guarded;
use roles::Role;
pub(super) use tenants::{Caller, hide_tenant, shown};
pub use tokens::AccessError;
#[cfg(any(test, feature = "fuzzing"))]
pub(super) use tokens::Tokens as ParsedTokens;

/// Which tokens are known, and to whom they belong.
#[derive(Debug)]
pub(super) struct Access {
    /// `None` admits everybody.
    known: Option<(PathBuf, RwLock<Tokens>)>,
}

impl Access {
    /// Reads the file of tokens, if there is one.
    pub(super) fn new(file: Option<&Path>) -> Result<Self, AccessError> {
        let known = match file {
            None => None,
            Some(path) => Some((path.to_owned(), RwLock::new(Tokens::read(path)?))),
        };
        Ok(Self { known })
    }

    /// Whether only those with a token are admitted.
    pub(super) fn is_guarded(&self) -> bool {
        self.known.is_some()
    }

    /// Ceilings of the tenants that have their own.
    pub(super) fn tenant_ceilings(&self) -> BTreeMap<String, TenantCeilings> {
        let Some((_, known)) = &self.known else { return BTreeMap::new() };
        known.read().unwrap_or_else(PoisonError::into_inner).tenant_ceilings()
    }

    /// Reads the file again; nothing changes before [`Access::put`].
    pub(super) fn read(&self) -> Result<Option<Tokens>, AccessError> {
        self.known.as_ref().map(|(path, _)| Tokens::read(path)).transpose()
    }

    /// From now on these tokens are known, and no others.
    pub(super) fn put(&self, tokens: Option<Tokens>) {
        if let (Some((_, known)), Some(tokens)) = (&self.known, tokens) {
            *known.write().unwrap_or_else(PoisonError::into_inner) = tokens;
        }
    }

    /// The caller behind a request for the RPC at `path`, if it may make it.
    fn admit(&self, path: &str, headers: &HeaderMap) -> Result<Caller, ServiceError> {
        let Some((_, known)) = &self.known else { return Ok(Caller::everybody()) };
        let refused = |what| ServiceError::Unauthenticated { what };
        let token = bearer(headers).ok_or(refused("a bearer token is needed"))?;
        let known = known.read().unwrap_or_else(PoisonError::into_inner);
        let caller = known.caller(token).ok_or(refused("the token is not known"))?;
        let needed = roles::needed(path);
        if caller.role() < needed {
            audit::refusal(&caller, path, needed);
            return Err(ServiceError::RoleTooLow { needed: needed.name() });
        }
        Ok(caller)
    }
}

impl Caller {
    /// The caller that the guard admitted.
    pub(super) fn of<T>(request: &Request<T>) -> Result<Self, ServiceError> {
        let caller = request.extensions().get::<Self>().cloned();
        // A service that stands behind no guard serves nobody.
        caller.ok_or(ServiceError::Unauthenticated { what: "the caller is not known" })
    }
}

/// `authorization: Bearer TOKEN`.
fn bearer(headers: &HeaderMap) -> Option<&str> {
    let (scheme, token) = headers.get("authorization")?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then_some(token.trim()).filter(|token| !token.is_empty())
}
