//! How a client proves who it is, and whom it trusts. Secrets show in no `Debug` output.
//!
//! A token travels in the `authorization` header of every call, and never in plain text to another
//! machine.

use std::fmt;
use std::net::IpAddr;
use std::sync::Arc;

use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::transport::{Certificate, ClientTlsConfig, Endpoint, Identity};
use tonic::{Request, Status};

use super::ClientError;

/// A bearer token.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl Token {
    /// The token in `text`, without the white space around it.
    #[must_use]
    pub fn new(text: &str) -> Self {
        Self(text.trim().to_owned())
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(..)")
    }
}

/// What a client shows, and whom it trusts; the default is nothing, and the system's authorities.
#[derive(Clone, Default)]
pub struct Credentials {
    /// Certificates of the authorities that are trusted instead of the system's, PEM.
    pub ca_pem: Option<Vec<u8>>,
    /// The client's own certificate chain and private key for mutual TLS, PEM each.
    pub identity_pem: Option<(Vec<u8>, Vec<u8>)>,
    /// The bearer token.
    pub token: Option<Token>,
}

impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Credentials")
            .field("ca_pem", &self.ca_pem.is_some())
            .field("identity_pem", &self.identity_pem.is_some())
            .field("token", &self.token)
            .finish()
    }
}

impl Credentials {
    /// Sets up TLS where the URL asks for it.
    pub(super) fn secure(&self, endpoint: Endpoint) -> Result<Endpoint, ClientError> {
        if endpoint.uri().scheme_str() != Some("https") {
            return Ok(endpoint);
        }
        let mut tls = match &self.ca_pem {
            Some(pem) => ClientTlsConfig::new().ca_certificate(Certificate::from_pem(pem)),
            None => ClientTlsConfig::new().with_native_roots(),
        };
        if let Some((certificate, key)) = &self.identity_pem {
            tls = tls.identity(Identity::from_pem(certificate, key));
        }
        let url = endpoint.uri().to_string();
        let refused = |source| ClientError::Tls { url, source: Arc::new(source) };
        endpoint.tls_config(tls).map_err(refused)
    }

    /// What adds the token to each call to `endpoint`.
    pub(super) fn bearer(&self, endpoint: &Endpoint) -> Result<Bearer, ClientError> {
        let Some(Token(token)) = &self.token else { return Ok(Bearer(None)) };
        let host = endpoint.uri().host().unwrap_or_default();
        if endpoint.uri().scheme_str() != Some("https") && !is_loopback(host) {
            return Err(ClientError::TokenInPlainText { url: endpoint.uri().to_string() });
        }
        let value =
            (!token.is_empty()).then(|| format!("Bearer {token}").parse::<MetadataValue<Ascii>>());
        let mut value = value.and_then(Result::ok).ok_or(ClientError::InvalidToken)?;
        value.set_sensitive(true);
        Ok(Bearer(Some(value)))
    }
}

fn is_loopback(host: &str) -> bool {
    let address = host.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    host == "localhost" || address.is_ok_and(|address| address.is_loopback())
}

/// Adds the token to each call.
#[derive(Clone, Debug, Default)]
pub(super) struct Bearer(Option<MetadataValue<Ascii>>);

impl Interceptor for Bearer {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(value) = &self.0 {
            request.metadata_mut().insert("authorization", value.clone());
        }
        Ok(request)
    }
}

#[cfg(test)]
mod tests {
    use tonic::transport::Endpoint;

    use super::{Credentials, Token};
    use crate::ClientError;

    fn bearer(url: &str, token: &str) -> Result<super::Bearer, ClientError> {
        let token = Some(Token::new(token));
        let credentials = Credentials { token, ..Credentials::default() };
        credentials.bearer(&Endpoint::from_shared(url.to_owned()).unwrap())
    }

    #[test]
    fn a_token_is_never_shown_nor_sent_in_plain_text_to_another_machine() {
        for url in ["http://127.0.0.1:1", "http://[::1]:1", "http://localhost:1", "https://a:1"] {
            let bearer = bearer(url, " secret\n").unwrap();
            assert!(!format!("{bearer:?}").contains("secret"), "{url}");
        }
        for url in ["http://192.0.2.1:1", "http://robot.example:1", "http://localhost.example:1"] {
            let error = bearer(url, "secret").unwrap_err();
            assert!(matches!(error, ClientError::TokenInPlainText { .. }), "{url}: {error}");
            assert!(!format!("{error:?}").contains("secret"), "{url}");
        }
        for token in ["", " \n", "two\nlines"] {
            assert!(matches!(bearer("https://a:1", token), Err(ClientError::InvalidToken)));
        }
        let credentials = Credentials {
            identity_pem: Some((b"certificate".to_vec(), b"secret".to_vec())),
            token: Some(Token::new("secret")),
            ..Credentials::default()
        };
        assert_eq!(
            format!("{credentials:?}"),
            "Credentials { ca_pem: false, identity_pem: true, token: Some(Token(..)) }"
        );
    }
}
