//! The file of tokens: the known callers, each with the SHA-256 of its token.
//!
//! ```toml
//! [[token]]
//! name = "robot-7"       # for the log
//! sha256 = "9f86d081…"   # of the token, 64 hexadecimal digits
//! tenant = "acme"        # left out for the default tenant
//! role = "write"         # read, write or admin
//!
//! [[tenant]]             # limits of its own, see `AccountLimits`
//! name = "acme"
//! limits = { max_maps = 20, max_keyframes = 1_000_000, max_streams = 50 }
//! ```
//!
//! A plain hash is enough because tokens are long and random: there is no list of likely tokens to
//! try. Tokens are found by their digest, and the timing of that reveals nothing that helps to
//! guess a token.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::rights::Proof;
use super::{Caller, Role};
use crate::service::engine::AccountLimits;
use crate::service::names::is_name;

/// Longest file, bytes: some 1,700 tokens. The TOML parser may need a hundred times as much memory.
const MAX_BYTES: usize = 256 << 10;

/// A file of tokens or of keys that cannot be used.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum AccessError {
    /// The file cannot be read.
    #[error("the token file")]
    Read(#[source] std::io::Error),
    /// The file is not TOML of the right shape. Its text is not shown.
    #[error("{}, line {line}: {reason}", path.display())]
    File {
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        reason: String,
    },
    /// An entry has a bad field. Its value is not shown: it could be the token itself.
    #[error("{}: {kind} {number}: {field} must be {expected}", path.display())]
    Entry {
        path: PathBuf,
        /// `token` or `tenant`.
        kind: &'static str,
        /// Which entry, from 1.
        number: usize,
        field: &'static str,
        expected: &'static str,
    },
    /// The file of keys cannot be read.
    #[error("the key file")]
    ReadKeys(#[source] std::io::Error),
    /// The file of keys is not JSON of the right shape. Its text is not shown.
    #[error("{}, line {line}: this is not a JSON Web Key Set", path.display())]
    Keys {
        path: PathBuf,
        /// The line, from 1.
        line: usize,
    },
    /// A key cannot be used.
    #[error("{}: key {number}: {reason}", path.display())]
    Key {
        path: PathBuf,
        /// Which key, from 1.
        number: usize,
        reason: &'static str,
    },
    /// No token could be accepted.
    #[error("{}: holds no key for signatures by RS256, PS256, ES256 or EdDSA", path.display())]
    NoKey { path: PathBuf },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    token: Vec<Entry>,
    #[serde(default)]
    tenant: Vec<TenantEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TenantEntry {
    name: String,
    limits: AccountLimits,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    sha256: String,
    #[serde(default)]
    tenant: String,
    role: Role,
}

/// The known callers, and the limits of tenants.
#[derive(Debug, Default)]
pub(in crate::service) struct Tokens {
    /// Callers by the digest of their token.
    callers: BTreeMap<[u8; 32], Caller>,
    tenants: BTreeMap<String, AccountLimits>,
}

impl Tokens {
    /// Reads a file.
    pub(super) fn read(path: &Path) -> Result<Self, AccessError> {
        Self::parse(&fs_err::read_to_string(path).map_err(AccessError::Read)?, path)
    }

    /// Parses a file's text; `path` names it in errors.
    pub(in crate::service) fn parse(text: &str, path: &Path) -> Result<Self, AccessError> {
        if text.len() > MAX_BYTES {
            let reason = format!("the file has {} bytes, at most {MAX_BYTES} are read", text.len());
            return Err(AccessError::File { path: path.to_owned(), line: 1, reason });
        }
        let file: File = toml::from_str(text).map_err(|error| {
            let offset = error.span().map_or(0, |span| span.start.min(text.len()));
            let line = 1 + text.bytes().take(offset).filter(|&b| b == b'\n').count();
            AccessError::File { path: path.to_owned(), line, reason: error.message().to_owned() }
        })?;
        let (mut tokens, mut names) = (BTreeMap::new(), BTreeSet::new());
        for (number, entry) in (1..).zip(file.token) {
            let bad = |field, expected| {
                let (path, kind) = (path.to_owned(), "token");
                Err(AccessError::Entry { path, kind, number, field, expected })
            };
            if !is_name(&entry.name) || !names.insert(entry.name.clone()) {
                return bad("name", "unique, 1 to 63 characters of a-z, 0-9, '_' and '-'");
            }
            if !entry.tenant.is_empty() && !is_name(&entry.tenant) {
                return bad("tenant", "1 to 63 characters of a-z, 0-9, '_' and '-'");
            }
            let Some(digest) = digest_of_hex(&entry.sha256) else {
                return bad("sha256", "64 hexadecimal digits");
            };
            let caller = Caller::new(&entry.name, &entry.tenant, entry.role);
            let caller = caller.showing(Proof::Listed(digest));
            if tokens.insert(digest, caller).is_some() {
                return bad("sha256", "of a token that no other entry has");
            }
        }
        let mut tenants = BTreeMap::new();
        for (number, TenantEntry { name, limits }) in (1..).zip(file.tenant) {
            let bad = |expected| {
                let (path, kind, field) = (path.to_owned(), "tenant", "name");
                Err(AccessError::Entry { path, kind, number, field, expected })
            };
            if !name.is_empty() && !is_name(&name) {
                return bad("1 to 63 characters of a-z, 0-9, '_' and '-', or empty");
            }
            if tenants.insert(name, limits).is_some() {
                return bad("unique: this tenant has its limits already");
            }
        }
        Ok(Self { callers: tokens, tenants })
    }

    /// The owner of a token.
    pub(super) fn caller(&self, token: &str) -> Option<Caller> {
        self.owner(&Sha256::digest(token.as_bytes()).into()).cloned()
    }

    /// The owner of the token with this digest.
    pub(super) fn owner(&self, digest: &[u8; 32]) -> Option<&Caller> {
        self.callers.get(digest)
    }

    /// The tenants that have limits of their own.
    pub(super) fn tenant_limits(&self) -> BTreeMap<String, AccountLimits> {
        self.tenants.clone()
    }
}

fn digest_of_hex(text: &str) -> Option<[u8; 32]> {
    let mut digest = [0; 32];
    if text.len() != 64 || !text.bytes().all(|c| c.is_ascii_hexdigit()) {
        return None;
    }
    for (index, byte) in digest.iter_mut().enumerate() {
        *byte = u8::from_str_radix(text.get(2 * index..2 * index + 2)?, 16).ok()?;
    }
    Some(digest)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::Tokens;
    use crate::service::access::Role;

    /// The SHA-256 of "test".
    const TEST: &str = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08";

    fn parse(text: &str) -> Result<Tokens, String> {
        Tokens::parse(text, Path::new("tokens.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn a_token_is_known_by_its_digest() {
        let text = format!("[[token]]\nname = 'r'\nsha256 = '{TEST}'\nrole = 'write'\n");
        let tokens = parse(&text).unwrap();
        let caller = tokens.caller("test").unwrap();
        assert_eq!((caller.token(), caller.tenant()), ("r", ""));
        assert!(caller.require(Role::Write).is_ok() && caller.require(Role::Admin).is_err());
        assert!(tokens.caller("tesT").is_none());
        assert!(tokens.caller(TEST).is_none(), "the digest is no token");
        assert!(parse("").unwrap().caller("").is_none());
    }

    #[test]
    fn a_bad_file_is_refused_without_telling_what_it_holds() {
        let check = |name: &str, sha256: &str, rest: &str, part: &str| {
            let text = format!("[[token]]\nname = '{name}'\nsha256 = '{sha256}'\n{rest}\n");
            let message = parse(&text).unwrap_err();
            assert!(message.contains(part), "`{part}` in `{message}`");
            assert!(!message.contains(sha256), "{message}");
        };
        check("r", "my-secret", "role = 'read'", "token 1: sha256");
        check("r", TEST, "role = 'root'", "line 4");
        check("r", TEST, "role = 'read'\nrights = 1", "line 5");
        check("R", TEST, "role = 'read'", "token 1: name");
        check("r", TEST, "role = 'read'\ntenant = 'a.b'", "token 1: tenant");
        let other = format!("role = 'read'\n[[token]]\nname='s'\nsha256='{TEST}'\nrole='read'");
        check("r", TEST, &other, "token 2: sha256");
        let long = format!("role = 'read'\n{}", "# \n".repeat(100_000));
        check("r", TEST, &long, "at most 262144 are read");
    }
}
