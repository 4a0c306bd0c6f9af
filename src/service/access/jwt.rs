//! JSON Web Tokens as bearer tokens (RFC 7519, signed as of RFC 7515, with the advice of RFC 8725).
//!
//! A token is accepted if a key of the set, named by `kid`, signed it by an algorithm of that key,
//! and if its claims are valid:
//!
//! | claim | must be |
//! |---|---|
//! | `exp` | not past |
//! | `nbf` | past, if given |
//! | `iss` | the issuer |
//! | `aud` | the audience, or a list that holds it |
//! | `sub` | the caller's name in the audit log: 1 to 255 printable characters |
//! | `covis_role` | `read`, `write` or `admin` |
//! | `covis_tenant` | a tenant; left out for the default tenant |
//!
//! No claim is trusted before the signature is checked. The caller with a refused token only learns
//! whether it expired; [`Refusal`] is for the operator's log and never contains the token.

use std::path::PathBuf;
use std::sync::Arc;

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::jwks::{Algorithm, Key, Keys};
use super::roles::Role;
use crate::service::names::is_name;

/// By how much the clocks of issuer and server may differ, seconds.
const LEEWAY: i64 = 60;
/// Longest `sub`, characters.
const LONGEST_SUBJECT: usize = 255;

/// Which issuer's tokens are accepted, and for which audience.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JwtOptions {
    /// File of the keys that sign them, a JSON Web Key Set.
    pub jwks: PathBuf,
    /// The issuer that tokens must name.
    pub issuer: String,
    /// The audience that tokens must name.
    pub audience: String,
}

/// Why a token is refused. Whatever it quotes of a token was signed by a known key, except the
/// `kid`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Refusal {
    #[error("{0} cannot be read")]
    Malformed(&'static str),
    #[error("its alg is not RS256, PS256, ES256 or EdDSA")]
    Algorithm,
    #[error("it has unknown extensions (crit)")]
    Critical,
    #[error("no key has its kid {0:?}")]
    UnknownKey(String),
    #[error("its alg does not fit the key that it names")]
    OtherAlgorithm,
    #[error("its signature is not valid for the key that it names")]
    Signature,
    #[error("claim {0} is missing or has the wrong type")]
    Claim(&'static str),
    #[error("it expired at {0} (Unix time)")]
    Expired(i64),
    #[error("it is not valid before {0} (Unix time)")]
    NotYet(i64),
    #[error("its issuer is {0:?}")]
    Issuer(String),
    #[error("it is meant for another audience")]
    Audience,
}

/// What a token says about its bearer.
#[derive(Debug)]
pub(super) struct Bearer {
    pub(super) subject: String,
    pub(super) tenant: String,
    pub(super) role: Role,
    /// When the token expires, leeway included, Unix time in seconds.
    pub(super) end: i64,
    /// The name of the key that signed it.
    pub(super) kid: String,
    /// The key that signed it.
    pub(super) key: Arc<Key>,
}

#[derive(Deserialize)]
struct Header {
    alg: String,
    kid: Option<String>,
    crit: Option<serde::de::IgnoredAny>,
}

/// Each claim is checked separately, so that the log can name the wrong one.
#[derive(Deserialize)]
struct Claims {
    exp: Option<serde_json::Value>,
    nbf: Option<serde_json::Value>,
    iss: Option<serde_json::Value>,
    aud: Option<serde_json::Value>,
    sub: Option<serde_json::Value>,
    covis_role: Option<serde_json::Value>,
    covis_tenant: Option<serde_json::Value>,
}

/// Whether a bearer token has the form of a JSON Web Token: three parts.
pub(super) fn has_form(token: &str) -> bool {
    token.bytes().filter(|&byte| byte == b'.').count() == 2
}

/// Checks a token at Unix time `now` (seconds).
pub(super) fn check(
    token: &str,
    keys: &Keys,
    options: &JwtOptions,
    now: i64,
) -> Result<Bearer, Refusal> {
    let (signed, signature) = token.rsplit_once('.').ok_or(Refusal::Malformed("its form"))?;
    let (header, claims) = signed.split_once('.').ok_or(Refusal::Malformed("its form"))?;
    let header: Header = part(header).ok_or(Refusal::Malformed("its header"))?;
    let algorithm = Algorithm::of_name(&header.alg).ok_or(Refusal::Algorithm)?;
    if header.crit.is_some() {
        return Err(Refusal::Critical);
    }
    let kid = header.kid.ok_or(Refusal::Malformed("its kid"))?;
    let Some(key) = keys.get(&kid) else {
        return Err(Refusal::UnknownKey(kid.chars().take(64).collect()));
    };
    if !key.serves(algorithm) {
        return Err(Refusal::OtherAlgorithm);
    }
    let signature = URL_SAFE_NO_PAD.decode(signature).ok();
    let signature = signature.ok_or(Refusal::Malformed("its signature"))?;
    if !key.signed(algorithm, signed.as_bytes(), &signature) {
        return Err(Refusal::Signature);
    }
    let claims: Claims = part(claims).ok_or(Refusal::Malformed("its claims"))?;
    bearer(claims, kid, Arc::clone(key), options, now)
}

/// What the claims of a token with a good signature say.
fn bearer(
    claims: Claims,
    kid: String,
    key: Arc<Key>,
    options: &JwtOptions,
    now: i64,
) -> Result<Bearer, Refusal> {
    let text = |value: Option<serde_json::Value>| Some(value?.as_str()?.to_owned());
    let expiry = time(claims.exp.as_ref()).ok_or(Refusal::Claim("exp"))?;
    let end = expiry.saturating_add(LEEWAY);
    if now >= end {
        return Err(Refusal::Expired(expiry));
    }
    if let Some(begin) = &claims.nbf {
        let begin = time(Some(begin)).ok_or(Refusal::Claim("nbf"))?;
        if now < begin.saturating_sub(LEEWAY) {
            return Err(Refusal::NotYet(begin));
        }
    }
    let issuer = text(claims.iss).ok_or(Refusal::Claim("iss"))?;
    if issuer != options.issuer {
        return Err(Refusal::Issuer(issuer));
    }
    let audience = options.audience.as_str();
    let audiences = claims.aud.ok_or(Refusal::Claim("aud"))?;
    let one = audiences.is_string().then(|| std::slice::from_ref(&audiences));
    let listed = audiences.as_array().map(Vec::as_slice);
    let audiences = one.or(listed).ok_or(Refusal::Claim("aud"))?;
    if !audiences.iter().any(|one| one.as_str() == Some(audience)) {
        return Err(Refusal::Audience);
    }
    let is_subject = |text: &String| {
        let length = text.chars().count();
        (1..=LONGEST_SUBJECT).contains(&length) && !text.chars().any(char::is_control)
    };
    let subject = text(claims.sub).filter(is_subject).ok_or(Refusal::Claim("sub"))?;
    let role = text(claims.covis_role).and_then(|role| Role::of_name(&role));
    let role = role.ok_or(Refusal::Claim("covis_role"))?;
    let tenant = match claims.covis_tenant {
        None => String::new(),
        tenant => text(tenant).filter(|t| is_name(t)).ok_or(Refusal::Claim("covis_tenant"))?,
    };
    Ok(Bearer { subject, tenant, role, end, kid, key })
}

/// Checks claims as if a key had signed them; `None` if they are not JSON. Only for the fuzz
/// target, which could never produce a valid signature.
#[cfg(any(test, feature = "fuzzing"))]
pub(super) fn read_unsigned(
    claims: &str,
    options: &JwtOptions,
    now: i64,
) -> Option<Result<Bearer, Refusal>> {
    let claims = serde_json::from_str(claims).ok()?;
    Some(bearer(claims, String::new(), Arc::new(Key::Ed25519(Vec::new())), options, now))
}

/// JSON in base64url.
fn part<T: DeserializeOwned>(text: &str) -> Option<T> {
    serde_json::from_slice(&URL_SAFE_NO_PAD.decode(text).ok()?).ok()
}

/// A `NumericDate`, rounded down to a second.
fn time(value: Option<&serde_json::Value>) -> Option<i64> {
    let number = value?.as_number()?;
    let whole = number.as_i64();
    // Far later than any real time; larger values are not accepted.
    const LARGEST: f64 = 1e15;
    let rounded = || number.as_f64().map(f64::floor).filter(|time| time.abs() < LARGEST);
    whole.or_else(|| rounded().map(|time| time as i64))
}
