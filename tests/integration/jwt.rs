//! JSON Web Tokens through a real server, beside static ones: roles, tenants, expiry and keys that
//! change. What makes a token bad is tested where it is checked, `access::jwt`.
//!
//! The server's clock stands where a test puts it.

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use covis::service::{Clock, JwtOptions};
use covis::wire::v1;
use ring::rand::SystemRandom;
use ring::signature::{Ed25519KeyPair, KeyPair};
use serde_json::json;
use tempfile::TempDir;
use tokio::sync::watch;
use tonic::{Code, Status};

use crate::common::{TestServer, bearing, check_status, run};
use crate::rpc_access::tokens_toml;

/// When the tests begin.
pub(crate) const NOW: i64 = 1_800_000_000;

/// Signs tokens.
pub(crate) struct Issuer {
    key: Ed25519KeyPair,
    kid: &'static str,
}

impl Issuer {
    pub(crate) fn new(kid: &'static str) -> Self {
        let pkcs8 = Ed25519KeyPair::generate_pkcs8(&SystemRandom::new()).unwrap();
        Self { key: Ed25519KeyPair::from_pkcs8(pkcs8.as_ref()).unwrap(), kid }
    }

    /// The set of its one key.
    pub(crate) fn jwks(&self) -> String {
        let x = URL_SAFE_NO_PAD.encode(self.key.public_key());
        json!({"keys": [{"kty": "OKP", "crv": "Ed25519", "kid": self.kid, "x": x}]}).to_string()
    }

    /// A token that is good for five minutes.
    pub(crate) fn token(&self, tenant: &str, role: &str) -> String {
        let header = json!({"alg": "EdDSA", "kid": self.kid}).to_string();
        let claims = json!({
            "iss": "https://issuer", "aud": "covis", "sub": "robot", "exp": NOW + 300,
            "covis_tenant": tenant, "covis_role": role,
        });
        let claims = URL_SAFE_NO_PAD.encode(claims.to_string());
        let signed = format!("{}.{claims}", URL_SAFE_NO_PAD.encode(header));
        let signature = URL_SAFE_NO_PAD.encode(self.key.sign(signed.as_bytes()));
        format!("{signed}.{signature}")
    }
}

/// A server that takes an issuer's tokens and those of a file.
pub(crate) struct Guarded {
    pub(crate) server: TestServer,
    files: TempDir,
    pub(crate) time: watch::Sender<i64>,
}

impl Guarded {
    pub(crate) async fn start(jwks: &str, tokens: Option<&str>) -> Self {
        let files = tempfile::tempdir().unwrap();
        fs_err::write(files.path().join("keys.json"), jwks).unwrap();
        let listed = tokens.map(|text| {
            fs_err::write(files.path().join("tokens.toml"), text).unwrap();
            files.path().join("tokens.toml")
        });
        let (time, clock) = watch::channel(NOW);
        let options = JwtOptions {
            jwks: files.path().join("keys.json"),
            issuer: "https://issuer".to_owned(),
            audience: "covis".to_owned(),
        };
        let server = TestServer::with(|config| {
            config.jwt = Some(options);
            config.tokens = listed;
            config.clock = Clock::Manual(clock);
        })
        .await;
        Self { server, files, time }
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        fs_err::write(self.files.path().join(name), text).unwrap();
    }

    pub(crate) async fn create(&self, token: &str) -> Result<(), Status> {
        let map_id = "house".to_owned();
        let request = v1::CreateMapRequest { map_id, ..v1::CreateMapRequest::default() };
        self.server.maps().create_map(bearing(token, request)).await.map(drop)
    }

    /// The maps that the bearer sees.
    async fn list(&self, token: &str) -> Result<usize, Status> {
        let request = bearing(token, v1::ListMapsRequest::default());
        Ok(self.server.maps().list_maps(request).await?.into_inner().maps.len())
    }
}

#[test]
fn roles_and_tenants_of_signed_tokens_are_those_of_static_ones() {
    run(async {
        let issuer = Issuer::new("k");
        let listed = tokens_toml(&[("reader", "acme", "read"), ("other", "rival", "read")]);
        let guarded = Guarded::start(&issuer.jwks(), Some(&listed)).await;
        let status = guarded.create(&issuer.token("acme", "read")).await.unwrap_err();
        check_status(&status, Code::PermissionDenied, "ROLE_TOO_LOW");
        guarded.create(&issuer.token("acme", "write")).await.unwrap();
        for (token, seen) in [
            (issuer.token("acme", "read"), 1),
            (issuer.token("rival", "admin"), 0),
            ("secret-of-reader".to_owned(), 1),
            ("secret-of-other".to_owned(), 0),
        ] {
            assert_eq!(guarded.list(&token).await.unwrap(), seen, "{token}");
        }
    });
}

#[test]
fn who_is_refused_learns_no_more_than_whether_the_token_has_expired() {
    run(async {
        let issuer = Issuer::new("k");
        let guarded = Guarded::start(&issuer.jwks(), None).await;
        let token = issuer.token("acme", "read");
        guarded.list(&token).await.unwrap();
        for bad in [
            Issuer::new("k").token("acme", "read"),
            Issuer::new("q").token("acme", "read"),
            issuer.token("acme", "root"),
            token.rsplit_once('.').unwrap().0.to_owned() + ".",
            token.rsplit_once('.').unwrap().0.to_owned(),
            "secret-of-reader".to_owned(),
        ] {
            let status = guarded.list(&bad).await.unwrap_err();
            check_status(&status, Code::Unauthenticated, "UNAUTHENTICATED");
            assert_eq!(status.message(), "the token is not known", "{bad}");
        }
        guarded.time.send_replace(NOW + 359);
        guarded.list(&token).await.unwrap();
        guarded.time.send_replace(NOW + 360);
        let status = guarded.list(&token).await.unwrap_err();
        check_status(&status, Code::Unauthenticated, "UNAUTHENTICATED");
        assert_eq!(status.message(), "the token has expired");
    });
}

#[test]
fn keys_and_tokens_are_read_again_together_or_not_at_all() {
    run(async {
        let (old, new) = (Issuer::new("old"), Issuer::new("new"));
        let guarded =
            Guarded::start(&old.jwks(), Some(&tokens_toml(&[("a", "acme", "read")]))).await;
        let (before, after) = (old.token("acme", "read"), new.token("acme", "read"));
        guarded.write("tokens.toml", &tokens_toml(&[("b", "acme", "read")]));
        guarded.write("keys.json", "{\"keys\": []}");
        let error = guarded.server.running.reload().unwrap_err();
        let cause = std::error::Error::source(&error).unwrap().to_string();
        assert!(cause.contains("keys.json: holds no key"), "{cause}");
        for token in [before.as_str(), "secret-of-a"] {
            guarded.list(token).await.unwrap();
        }
        guarded.write("keys.json", &new.jwks());
        guarded.server.running.reload().unwrap();
        for token in [after.as_str(), "secret-of-b"] {
            guarded.list(token).await.unwrap();
        }
        for token in [before.as_str(), "secret-of-a"] {
            let status = guarded.list(token).await.unwrap_err();
            assert_eq!(status.code(), Code::Unauthenticated, "{token}");
        }
    });
}
