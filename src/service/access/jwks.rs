//! The public keys that sign JSON Web Tokens: a JSON Web Key Set (RFC 7517) in a file.
//!
//! | key | algorithms |
//! |---|---|
//! | RSA, 2048 to 8192 bits | RS256, PS256, or the one that its `alg` names |
//! | EC, P-256 | ES256 |
//! | OKP, Ed25519 | EdDSA |
//!
//! The key determines its algorithms and the token only chooses among them, so that a public key is
//! never used as an HMAC secret. Keys for other purposes are skipped, as the RFC requires. A
//! suitable key that is broken, or a private key, makes the whole file invalid.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use ring::signature::{
    ECDSA_P256_SHA256_FIXED, ED25519, RSA_PKCS1_2048_8192_SHA256, RSA_PSS_2048_8192_SHA256,
    RsaPublicKeyComponents, UnparsedPublicKey,
};
use serde::Deserialize;

use super::AccessError;

/// How a token may be signed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Algorithm {
    Rs256,
    Ps256,
    Es256,
    EdDsa,
}

impl Algorithm {
    /// The algorithm with this name in `alg`.
    pub(super) fn of_name(name: &str) -> Option<Self> {
        match name {
            "RS256" => Some(Self::Rs256),
            "PS256" => Some(Self::Ps256),
            "ES256" => Some(Self::Es256),
            "EdDSA" => Some(Self::EdDsa),
            _ => None,
        }
    }
}

/// A public key.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Key {
    /// Big-endian numbers without leading zeros, and the only algorithm of the key, if it names
    /// one.
    Rsa { modulus: Vec<u8>, exponent: Vec<u8>, only: Option<Algorithm> },
    /// The point, uncompressed (SEC 1).
    P256(Vec<u8>),
    /// The point as RFC 8032 writes it.
    Ed25519(Vec<u8>),
}

impl Key {
    /// Whether the key may be used with an algorithm.
    pub(super) fn serves(&self, algorithm: Algorithm) -> bool {
        match (self, algorithm) {
            (Self::Rsa { only, .. }, Algorithm::Rs256 | Algorithm::Ps256) => {
                only.is_none_or(|only| only == algorithm)
            }
            (Self::P256(_), Algorithm::Es256) | (Self::Ed25519(_), Algorithm::EdDsa) => true,
            _ => false,
        }
    }

    /// Whether this key made `signature` of `message` by an algorithm of the key.
    pub(super) fn signed(&self, algorithm: Algorithm, message: &[u8], signature: &[u8]) -> bool {
        let verified = match (self, algorithm) {
            _ if !self.serves(algorithm) => return false,
            (Self::Rsa { modulus: n, exponent: e, .. }, Algorithm::Ps256) => {
                let key = RsaPublicKeyComponents { n, e };
                key.verify(&RSA_PSS_2048_8192_SHA256, message, signature)
            }
            (Self::Rsa { modulus: n, exponent: e, .. }, _) => {
                let key = RsaPublicKeyComponents { n, e };
                key.verify(&RSA_PKCS1_2048_8192_SHA256, message, signature)
            }
            (Self::P256(point), _) => {
                UnparsedPublicKey::new(&ECDSA_P256_SHA256_FIXED, point).verify(message, signature)
            }
            (Self::Ed25519(point), _) => {
                UnparsedPublicKey::new(&ED25519, point).verify(message, signature)
            }
        };
        verified.is_ok()
    }
}

/// Keys by their `kid`.
#[derive(Debug, Default)]
pub(super) struct Keys(BTreeMap<String, Arc<Key>>);

#[derive(Deserialize)]
struct Set {
    keys: Vec<serde_json::Value>,
}

/// A key as in the file, with the members of all key types.
#[derive(Deserialize)]
struct Jwk {
    kty: String,
    kid: Option<String>,
    #[serde(rename = "use")]
    usage: Option<String>,
    alg: Option<String>,
    crv: Option<String>,
    n: Option<String>,
    e: Option<String>,
    x: Option<String>,
    y: Option<String>,
    d: Option<serde::de::IgnoredAny>,
}

/// Why an entry gives no key.
enum Unusable {
    /// It is for another purpose.
    Unsuited { why: &'static str },
    /// The file must be corrected.
    Bad(&'static str),
}

impl Keys {
    /// Reads a file.
    pub(super) fn read(path: &Path) -> Result<Self, AccessError> {
        Self::parse(&fs_err::read_to_string(path).map_err(AccessError::ReadKeys)?, path)
    }

    pub(super) fn parse(text: &str, path: &Path) -> Result<Self, AccessError> {
        // The parser's message could quote the file's content.
        let set: Set = serde_json::from_str(text)
            .map_err(|error| AccessError::Keys { path: path.to_owned(), line: error.line() })?;
        let mut keys = BTreeMap::new();
        for (number, entry) in (1..).zip(set.keys) {
            match read_key(entry) {
                Ok((kid, key)) => {
                    if keys.insert(kid, Arc::new(key)).is_some() {
                        let reason = "another key has the same kid";
                        return Err(AccessError::Key { path: path.to_owned(), number, reason });
                    }
                }
                Err(Unusable::Unsuited { why }) => {
                    tracing::info!("{}: key {number} is not used: {why}", path.display());
                }
                Err(Unusable::Bad(reason)) => {
                    return Err(AccessError::Key { path: path.to_owned(), number, reason });
                }
            }
        }
        if keys.is_empty() {
            return Err(AccessError::NoKey { path: path.to_owned() });
        }
        Ok(Self(keys))
    }

    /// The key that a token names.
    pub(super) fn get(&self, kid: &str) -> Option<&Arc<Key>> {
        self.0.get(kid)
    }
}

fn read_key(entry: serde_json::Value) -> Result<(String, Key), Unusable> {
    let Ok(jwk) = serde_json::from_value::<Jwk>(entry) else {
        return Err(Unusable::Bad("it is not a JSON Web Key"));
    };
    if jwk.d.is_some() {
        return Err(Unusable::Bad("it is a private key, which does not belong here"));
    }
    if jwk.usage.is_some_and(|usage| usage != "sig") {
        return Err(Unusable::Unsuited { why: "it is not for signatures" });
    }
    let only = match jwk.alg.as_deref().map(Algorithm::of_name) {
        Some(None) => return Err(Unusable::Unsuited { why: "its algorithm is not supported" }),
        only => only.flatten(),
    };
    let key = match (jwk.kty.as_str(), jwk.crv.as_deref()) {
        ("RSA", _) => rsa(jwk.n, jwk.e, only)?,
        ("EC", Some("P-256")) => {
            let (x, y) = (bytes(jwk.x)?, bytes(jwk.y)?);
            if x.len() != 32 || y.len() != 32 {
                return Err(Unusable::Bad("x and y must be of 32 bytes"));
            }
            Key::P256([&[4], x.as_slice(), y.as_slice()].concat())
        }
        ("OKP", Some("Ed25519")) => {
            let x = bytes(jwk.x)?;
            if x.len() != 32 {
                return Err(Unusable::Bad("x must be of 32 bytes"));
            }
            Key::Ed25519(x)
        }
        _ => return Err(Unusable::Unsuited { why: "its type is not supported" }),
    };
    if only.is_some_and(|only| !key.serves(only)) {
        return Err(Unusable::Bad("its alg does not fit its type"));
    }
    let kid = jwk.kid.ok_or(Unusable::Bad("it has no kid, so tokens cannot name it"))?;
    Ok((kid, key))
}

fn rsa(n: Option<String>, e: Option<String>, only: Option<Algorithm>) -> Result<Key, Unusable> {
    let (modulus, exponent) = (number(n)?, number(e)?);
    let bits = modulus.len() * 8 - modulus.first().map_or(0, |b| b.leading_zeros() as usize);
    if !(2048..=8192).contains(&bits) {
        return Err(Unusable::Bad("n must be of 2048 to 8192 bits"));
    }
    let is_odd = exponent.last().is_some_and(|byte| byte % 2 == 1);
    // The limits of ring, which otherwise refuses every signature.
    if !is_odd || exponent.len() > 4 || exponent == [1] {
        return Err(Unusable::Bad("e must be odd, above 1 and of at most 32 bits"));
    }
    Ok(Key::Rsa { modulus, exponent, only })
}

/// A number, big-endian without leading zeros.
fn number(text: Option<String>) -> Result<Vec<u8>, Unusable> {
    Ok(bytes(text)?.into_iter().skip_while(|&byte| byte == 0).collect())
}

fn bytes(text: Option<String>) -> Result<Vec<u8>, Unusable> {
    let decoded = text.and_then(|text| URL_SAFE_NO_PAD.decode(text).ok());
    decoded.ok_or(Unusable::Bad("a member is missing or not base64url"))
}
