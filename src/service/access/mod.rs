//! Who may call what: bearer tokens, roles, tenants, and the record of deletions.
//!
//! [`Guarded`] is in front of every service except health. It admits a request by its token and by
//! the role that its RPC needs, and passes the [`Caller`] on in the request's extensions. Tokens
//! are listed in a file (`tokens`) or signed by an issuer (`jwt`, `jwks`); without either everybody
//! is an administrator of the default tenant. `rights` checks streams while they are open. No token
//! is logged or kept: only digests are compared.
//!
//! | module | role |
//! |---|---|
//! | `guard` | admits requests |
//! | `tokens`, `jwt`, `jwks` | tokens in a file; signed tokens and their keys |
//! | `roles`, `tenants` | the calls of each role; whose maps a caller sees |
//! | `rights` | whether an open stream may continue |
//! | `audit` | the record of deletions |

mod audit;
#[cfg(any(test, feature = "fuzzing"))]
pub(super) mod fuzzing;
mod guard;
mod jwks;
mod jwt;
#[cfg(test)]
mod jwt_tests;
mod rights;
mod roles;
mod tenants;
mod tokens;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use tokio::sync::watch;
use tonic::Request;
use tonic::codegen::http::HeaderMap;

use super::clock::Clock;
use super::engine::AccountLimits;
use super::error::ServiceError;
use audit::Refusals;
use jwks::Keys;
use jwt::Refusal;
use tokens::Tokens;

pub(super) use audit::change;
pub(super) use guard::Guarded;
pub use jwt::JwtOptions;
use rights::Proof;
pub(super) use roles::Role;
pub(super) use tenants::Caller;
pub use tokens::AccessError;
#[cfg(any(test, feature = "fuzzing"))]
pub(super) use tokens::Tokens as ParsedTokens;

const UNKNOWN: ServiceError = ServiceError::Unauthenticated { what: "the token is not known" };
const EXPIRED: ServiceError = ServiceError::Unauthenticated { what: "the token has expired" };

/// The known tokens and their owners.
#[derive(Debug)]
pub(super) struct Access {
    tokens: Option<PathBuf>,
    jwt: Option<JwtOptions>,
    clock: Clock,
    /// Open streams are notified when it changes.
    known: watch::Sender<Arc<CredentialFiles>>,
    refusals: Refusals,
}

/// The contents of the files.
#[derive(Debug)]
pub(super) struct CredentialFiles {
    tokens: Option<Tokens>,
    keys: Option<Keys>,
}

impl CredentialFiles {
    fn read(tokens: Option<&PathBuf>, jwt: Option<&JwtOptions>) -> Result<Arc<Self>, AccessError> {
        let tokens = tokens.map(|path| Tokens::read(path)).transpose()?;
        let keys = jwt.map(|jwt| Keys::read(&jwt.jwks)).transpose()?;
        Ok(Arc::new(Self { tokens, keys }))
    }
}

impl Access {
    /// Reads the file of tokens and the issuer's keys, if there are any.
    pub(super) fn new(
        tokens: Option<PathBuf>,
        jwt: Option<JwtOptions>,
        clock: Clock,
    ) -> Result<Self, AccessError> {
        let (known, _) = watch::channel(CredentialFiles::read(tokens.as_ref(), jwt.as_ref())?);
        Ok(Self { tokens, jwt, clock, known, refusals: Refusals::default() })
    }

    /// Whether only callers with a token are admitted.
    pub(super) fn is_guarded(&self) -> bool {
        self.tokens.is_some() || self.jwt.is_some()
    }

    /// Limits of the tenants that have their own.
    pub(super) fn tenant_limits(&self) -> BTreeMap<String, AccountLimits> {
        let known = self.known();
        known.tokens.as_ref().map(Tokens::tenant_limits).unwrap_or_default()
    }

    /// Reads the files again; nothing changes before [`Access::put`].
    pub(super) fn read(&self) -> Result<Arc<CredentialFiles>, AccessError> {
        CredentialFiles::read(self.tokens.as_ref(), self.jwt.as_ref())
    }

    /// From now on only these tokens and keys are known.
    pub(super) fn put(&self, known: Arc<CredentialFiles>) {
        self.known.send_replace(known);
    }

    fn known(&self) -> Arc<CredentialFiles> {
        Arc::clone(&self.known.borrow())
    }

    /// Checks the token of a request for the RPC at `path`; the caller, if it may make it.
    fn admit(&self, path: &str, headers: &HeaderMap) -> Result<Caller, ServiceError> {
        if !self.is_guarded() {
            return Ok(Caller::everybody());
        }
        let missing = ServiceError::Unauthenticated { what: "a bearer token is needed" };
        let token = bearer(headers).ok_or(missing)?;
        let caller = match &self.jwt {
            Some(options) if jwt::has_form(token) => self.signed(token, options, path)?,
            _ => self.listed(token).ok_or(UNKNOWN)?,
        };
        let needed = roles::needed(path);
        caller.require(needed).inspect_err(|_| self.refusals.role(&caller, path, needed))?;
        Ok(caller.calling(needed))
    }

    /// The owner of a token of the file.
    fn listed(&self, token: &str) -> Option<Caller> {
        self.known().tokens.as_ref()?.caller(token)
    }

    /// The bearer of a JSON Web Token. For a bad token, the bearer only learns whether it expired.
    fn signed(
        &self,
        token: &str,
        options: &JwtOptions,
        path: &str,
    ) -> Result<Caller, ServiceError> {
        let known = self.known();
        let Some(keys) = &known.keys else { return Err(UNKNOWN) };
        let bearer = jwt::check(token, keys, options, self.clock.now()).map_err(|refusal| {
            self.refusals.not_taken(path, &refusal);
            if matches!(refusal, Refusal::Expired(_)) { EXPIRED } else { UNKNOWN }
        })?;
        let caller = Caller::new(&bearer.subject, &bearer.tenant, bearer.role);
        Ok(caller.showing(Proof::Signed {
            kid: bearer.kid.into(),
            key: bearer.key,
            end: bearer.end,
        }))
    }
}

impl Caller {
    /// The caller that the guard admitted.
    pub(super) fn of<T>(request: &Request<T>) -> Result<Self, ServiceError> {
        let caller = request.extensions().get::<Self>().cloned();
        // A service without a guard serves nobody.
        caller.ok_or(ServiceError::Unauthenticated { what: "the caller is not known" })
    }
}

/// `authorization: Bearer TOKEN`.
fn bearer(headers: &HeaderMap) -> Option<&str> {
    let (scheme, token) = headers.get("authorization")?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then_some(token.trim()).filter(|token| !token.is_empty())
}
