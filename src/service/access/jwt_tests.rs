//! Which JSON Web Tokens and key sets are accepted, and the reason why each bad token is refused.
//!
//! Keys are generated here, except the RSA key of tests/golden/keys, which signs nothing else.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use ring::hmac;
use ring::rand::SystemRandom;
use ring::signature::{
    ECDSA_P256_SHA256_FIXED_SIGNING, EcdsaKeyPair, Ed25519KeyPair, KeyPair, RSA_PKCS1_SHA256,
    RSA_PSS_SHA256, RsaEncoding, RsaKeyPair, RsaPublicKeyComponents,
};
use serde_json::{Value, json};

use super::jwks::Keys;
use super::jwt::{self, Bearer, JwtOptions, Refusal};
use super::roles::Role;

const NOW: i64 = 1_800_000_000;

fn base64(bytes: impl AsRef<[u8]>) -> String {
    URL_SAFE_NO_PAD.encode(bytes)
}

/// The secret keys of an issuer.
struct Issuer {
    rsa: RsaKeyPair,
    p256: EcdsaKeyPair,
    ed25519: Ed25519KeyPair,
    random: SystemRandom,
}

impl Issuer {
    fn new() -> Self {
        let random = SystemRandom::new();
        let algorithm = &ECDSA_P256_SHA256_FIXED_SIGNING;
        let p256 = EcdsaKeyPair::generate_pkcs8(algorithm, &random).unwrap();
        let ed25519 = Ed25519KeyPair::generate_pkcs8(&random).unwrap();
        let rsa = include_bytes!("../../../tests/golden/keys/rsa-2048.pk8");
        Self {
            rsa: RsaKeyPair::from_pkcs8(rsa).unwrap(),
            p256: EcdsaKeyPair::from_pkcs8(algorithm, p256.as_ref(), &random).unwrap(),
            ed25519: Ed25519KeyPair::from_pkcs8(ed25519.as_ref()).unwrap(),
            random,
        }
    }

    fn rsa_jwk(&self) -> Value {
        let public = RsaPublicKeyComponents::<Vec<u8>>::from(self.rsa.public());
        json!({"kty": "RSA", "kid": "r", "n": base64(public.n), "e": base64(public.e)})
    }

    fn p256_jwk(&self) -> Value {
        let point = &self.p256.public_key().as_ref()[1..];
        let (x, y) = (base64(&point[..32]), base64(&point[32..]));
        json!({"kty": "EC", "crv": "P-256", "kid": "e", "x": x, "y": y, "use": "sig"})
    }

    fn ed25519_jwk(&self) -> Value {
        let x = base64(self.ed25519.public_key());
        json!({"kty": "OKP", "crv": "Ed25519", "kid": "o", "x": x, "alg": "EdDSA"})
    }

    fn keys(&self) -> Keys {
        parse(&[self.rsa_jwk(), self.p256_jwk(), self.ed25519_jwk()]).unwrap()
    }

    fn sign(&self, algorithm: &str, message: &[u8]) -> Vec<u8> {
        let rsa = |encoding: &'static dyn RsaEncoding| {
            let mut signature = vec![0; self.rsa.public().modulus_len()];
            self.rsa.sign(encoding, &self.random, message, &mut signature).unwrap();
            signature
        };
        match algorithm {
            "RS256" => rsa(&RSA_PKCS1_SHA256),
            "PS256" => rsa(&RSA_PSS_SHA256),
            "ES256" => self.p256.sign(&self.random, message).unwrap().as_ref().to_vec(),
            "EdDSA" => self.ed25519.sign(message).as_ref().to_vec(),
            // A known attack: the public key used as an HMAC secret.
            "HS256" => {
                let public = RsaPublicKeyComponents::<Vec<u8>>::from(self.rsa.public());
                hmac::sign(&hmac::Key::new(hmac::HMAC_SHA256, &public.n), message).as_ref().to_vec()
            }
            _ => Vec::new(),
        }
    }

    fn token(&self, header: &Value, claims: &Value) -> String {
        let signed = format!("{}.{}", base64(header.to_string()), base64(claims.to_string()));
        let algorithm = header["alg"].as_str().unwrap_or_default();
        format!("{signed}.{}", base64(self.sign(algorithm, signed.as_bytes())))
    }
}

fn parse(keys: &[Value]) -> Result<Keys, String> {
    let text = json!({ "keys": keys }).to_string();
    Keys::parse(&text, Path::new("keys.json")).map_err(|error| error.to_string())
}

fn claims() -> Value {
    json!({
        "iss": "https://issuer", "aud": "covis", "sub": "robot-7", "exp": NOW + 300,
        "covis_role": "write", "covis_tenant": "acme",
    })
}

/// The valid claims with one claim changed, or left out (null).
fn with(claim: &str, value: Value) -> Value {
    let mut claims = claims();
    claims[claim] = value;
    if claims[claim].is_null() {
        claims.as_object_mut().unwrap().remove(claim);
    }
    claims
}

fn check(keys: &Keys, token: &str) -> Result<Bearer, Refusal> {
    let (issuer, audience) = ("https://issuer".to_owned(), "covis".to_owned());
    let options = JwtOptions { jwks: "keys.json".into(), issuer, audience };
    jwt::check(token, keys, &options, NOW)
}

#[test]
fn a_token_of_each_algorithm_says_who_its_bearer_is() {
    let issuer = Issuer::new();
    let keys = issuer.keys();
    for (alg, kid) in [("RS256", "r"), ("PS256", "r"), ("ES256", "e"), ("EdDSA", "o")] {
        let token = issuer.token(&json!({"alg": alg, "kid": kid, "typ": "JWT"}), &claims());
        assert!(jwt::has_form(&token), "{token}");
        let bearer = check(&keys, &token).unwrap();
        assert_eq!((&*bearer.subject, &*bearer.tenant), ("robot-7", "acme"), "{alg}");
        assert_eq!(bearer.role, Role::Write);
        // One bit, in any part.
        for index in [8, token.len() / 2, token.len() - 8] {
            let mut bytes = token.clone().into_bytes();
            bytes[index] ^= 1;
            let refusal = check(&keys, &String::from_utf8(bytes).unwrap()).unwrap_err();
            assert!(!token.contains(&refusal.to_string()), "{refusal}");
        }
    }
}

#[test]
fn claims_are_taken_within_a_minute_and_in_each_of_their_forms() {
    let issuer = Issuer::new();
    let keys = issuer.keys();
    for (claim, value) in [
        ("exp", json!(NOW - 59)),
        ("exp", json!(NOW as f64 + 0.5)),
        ("nbf", json!(NOW + 60)),
        ("nbf", json!(0)),
        ("aud", json!(["other", "covis"])),
        ("covis_tenant", Value::Null),
        ("covis_role", json!("admin")),
        ("unknown", json!({"a": [1]})),
    ] {
        let claims = with(claim, value);
        let token = issuer.token(&json!({"alg": "EdDSA", "kid": "o"}), &claims);
        let bearer = check(&keys, &token).unwrap_or_else(|e| panic!("{claims}: {e}"));
        let tenant = claims["covis_tenant"].as_str().unwrap_or_default();
        assert_eq!(bearer.tenant, tenant, "without a tenant it is the default one");
    }
}

#[test]
fn each_bad_token_is_refused_for_what_is_wrong_with_it() {
    let issuer = Issuer::new();
    let keys = issuer.keys();
    let good = json!({"alg": "EdDSA", "kid": "o"});
    let refused = |header: &Value, claims: &Value| {
        let refusal = check(&keys, &issuer.token(header, claims)).unwrap_err();
        (refusal, format!("{header} {claims}"))
    };
    for (claim, value, expected) in [
        ("exp", json!(NOW - 60), Refusal::Expired(NOW - 60)),
        ("exp", Value::Null, Refusal::Claim("exp")),
        ("exp", json!("1900000000"), Refusal::Claim("exp")),
        ("exp", json!(1e300), Refusal::Claim("exp")),
        ("nbf", json!(NOW + 61), Refusal::NotYet(NOW + 61)),
        ("nbf", json!("0"), Refusal::Claim("nbf")),
        ("iss", Value::Null, Refusal::Claim("iss")),
        ("iss", json!("https://issuer/"), Refusal::Issuer("https://issuer/".to_owned())),
        ("aud", Value::Null, Refusal::Claim("aud")),
        ("aud", json!("Covis"), Refusal::Audience),
        ("aud", json!([]), Refusal::Audience),
        ("aud", json!({"covis": 1}), Refusal::Claim("aud")),
        ("sub", Value::Null, Refusal::Claim("sub")),
        ("sub", json!(""), Refusal::Claim("sub")),
        ("sub", json!("a\nb"), Refusal::Claim("sub")),
        ("sub", json!("a".repeat(256)), Refusal::Claim("sub")),
        ("covis_role", Value::Null, Refusal::Claim("covis_role")),
        ("covis_role", json!("root"), Refusal::Claim("covis_role")),
        ("covis_role", json!(["admin"]), Refusal::Claim("covis_role")),
        ("covis_tenant", json!("a.b"), Refusal::Claim("covis_tenant")),
        ("covis_tenant", json!(""), Refusal::Claim("covis_tenant")),
        ("covis_tenant", json!(7), Refusal::Claim("covis_tenant")),
    ] {
        let (refusal, what) = refused(&good, &with(claim, value));
        assert_eq!(refusal, expected, "{what}");
    }
    for (header, expected) in [
        (json!({"alg": "none", "kid": "o"}), Refusal::Algorithm),
        (json!({"alg": "HS256", "kid": "r"}), Refusal::Algorithm),
        (json!({"alg": "RS512", "kid": "r"}), Refusal::Algorithm),
        (json!({"alg": "rs256", "kid": "r"}), Refusal::Algorithm),
        (json!({"kid": "o"}), Refusal::Malformed("its header")),
        (json!({"alg": "EdDSA"}), Refusal::Malformed("its kid")),
        (json!({"alg": "EdDSA", "kid": "q"}), Refusal::UnknownKey("q".to_owned())),
        (json!({"alg": "EdDSA", "kid": "r"}), Refusal::OtherAlgorithm),
        (json!({"alg": "RS256", "kid": "e"}), Refusal::OtherAlgorithm),
        (json!({"alg": "EdDSA", "kid": "o", "crit": ["b64"]}), Refusal::Critical),
    ] {
        let (refusal, what) = refused(&header, &claims());
        assert_eq!(refusal, expected, "{what}");
    }
}

#[test]
fn what_was_not_signed_is_not_believed() {
    let issuer = Issuer::new();
    let keys = issuer.keys();
    let header = json!({"alg": "ES256", "kid": "e"});
    let token = issuer.token(&header, &claims());
    let (signed, signature) = token.rsplit_once('.').unwrap();
    let head = signed.split_once('.').unwrap().0;
    let admin = base64(with("covis_role", json!("admin")).to_string());
    for (token, expected) in [
        (format!("{head}.{admin}.{signature}"), Refusal::Signature),
        (format!("{signed}."), Refusal::Signature),
        (format!("{signed}.{}", base64([0; 64])), Refusal::Signature),
        (Issuer::new().token(&header, &claims()), Refusal::Signature),
        (format!("{signed}.{signature}="), Refusal::Malformed("its signature")),
        (format!("{{}}.{admin}.{signature}"), Refusal::Malformed("its header")),
        ("..".to_owned(), Refusal::Malformed("its header")),
    ] {
        assert_eq!(check(&keys, &token).unwrap_err(), expected, "{token}");
    }
    // Validly signed, but the payload has no claims.
    let signed = format!("{head}.{}", base64("[]"));
    let token = format!("{signed}.{}", base64(issuer.sign("ES256", signed.as_bytes())));
    assert_eq!(check(&keys, &token).unwrap_err(), Refusal::Malformed("its claims"));
}

#[test]
fn a_key_serves_only_what_it_is_for() {
    let issuer = Issuer::new();
    let mut rsa = issuer.rsa_jwk();
    rsa["alg"] = json!("PS256");
    // Other issuers pad their numbers with zeros.
    let modulus = URL_SAFE_NO_PAD.decode(rsa["n"].as_str().unwrap()).unwrap();
    rsa["n"] = json!(base64([&[0], modulus.as_slice()].concat()));
    let (mut encryption, secret) =
        (issuer.p256_jwk(), json!({"kty": "oct", "kid": "s", "k": "AA"}));
    encryption["use"] = json!("enc");
    let keys = parse(&[secret, encryption, rsa]).unwrap();
    let token = |alg: &str, kid: &str| issuer.token(&json!({"alg": alg, "kid": kid}), &claims());
    check(&keys, &token("PS256", "r")).unwrap();
    assert_eq!(check(&keys, &token("RS256", "r")).unwrap_err(), Refusal::OtherAlgorithm);
    for kid in ["e", "s"] {
        let refusal = check(&keys, &token("ES256", kid)).unwrap_err();
        assert_eq!(refusal, Refusal::UnknownKey(kid.to_owned()));
    }
}

#[test]
fn a_set_of_keys_that_cannot_be_used_is_refused_with_the_number_of_the_key() {
    let issuer = Issuer::new();
    let good = issuer.p256_jwk();
    for (member, value, part) in [
        ("d", json!("c2VjcmV0"), "key 2: it is a private key"),
        ("kid", Value::Null, "key 2: it has no kid"),
        ("kid", json!("e"), "key 2: another key has the same kid"),
        ("kid", json!(7), "key 2: it is not a JSON Web Key"),
        ("alg", json!("RS256"), "key 2: its alg does not fit its type"),
        ("x", json!("c2VjcmV0"), "key 2: x must be of 32 bytes"),
        ("x", json!("not base64"), "key 2: a member is missing or not base64url"),
        ("x", Value::Null, "key 2: a member is missing or not base64url"),
    ] {
        let mut bad = issuer.ed25519_jwk();
        bad[member] = value;
        let message = parse(&[good.clone(), bad]).unwrap_err();
        assert!(message.starts_with("keys.json: ") && message.contains(part), "{message}");
        assert!(!message.contains("c2VjcmV0"), "{message}");
    }
    for (n, e, part) in [
        (vec![255; 128], vec![1, 0, 1], "n must be of 2048 to 8192 bits"),
        (vec![255; 2048], vec![1, 0, 1], "n must be of 2048 to 8192 bits"),
        (vec![255; 256], vec![1], "e must be odd"),
        (vec![255; 256], vec![2], "e must be odd"),
        (vec![255; 256], vec![], "e must be odd"),
    ] {
        let rsa = json!({"kty": "RSA", "kid": "r", "n": base64(n), "e": base64(e)});
        let message = parse(&[rsa]).unwrap_err();
        assert!(message.contains(part), "{message}");
    }
    assert!(parse(&[]).unwrap_err().contains("holds no key"));
    let error = Keys::parse("{\n\"keys\": 3}", Path::new("keys.json")).unwrap_err();
    assert!(error.to_string().contains("keys.json, line 2"), "{error}");
}
