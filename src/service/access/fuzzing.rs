//! The fuzz target of signed tokens: a set of keys, and a token as its issuer writes it.
//!
//! Built for tests and with the feature `fuzzing` only. No key signed the input: a token that is
//! accepted is a finding.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;

use super::jwks::Keys;
use super::jwt::{self, JwtOptions};

/// The time at which claims are checked, Unix time in seconds.
const NOW: i64 = 1_800_000_000;

/// A key set, the header and the claims of a token, with a zero byte between them.
///
/// # Panics
/// If a token that no key signed is accepted, or claims without a subject or an expiry.
pub fn jwt(input: &[u8]) {
    let mut parts = input.splitn(3, |&byte| byte == 0).map(String::from_utf8_lossy);
    let [set, header, claims] = std::array::from_fn(|_| parts.next().unwrap_or_default());
    let keys = match Keys::parse(&set, Path::new("keys")) {
        Ok(keys) => keys,
        Err(error) => {
            let _told = error.to_string();
            Keys::default()
        }
    };
    let (issuer, audience) = ("https://issuer".to_owned(), "covis".to_owned());
    let options = JwtOptions { jwks: "keys".into(), issuer, audience };
    let base64 = |part: &str| URL_SAFE_NO_PAD.encode(part);
    // As an issuer would send it, with a signature of the right length; and unchanged.
    let written = format!("{}.{}.{}", base64(&header), base64(&claims), base64(&"\0".repeat(64)));
    for token in [written, format!("{header}.{claims}")] {
        let taken = jwt::check(&token, &keys, &options, NOW);
        assert!(taken.is_err(), "taken without a signature: {taken:?}");
    }
    if let Some(Ok(bearer)) = jwt::read_unsigned(&claims, &options, NOW) {
        assert!(bearer.end > NOW, "taken after its end");
        assert!(!bearer.subject.is_empty(), "taken for nobody");
    }
}
