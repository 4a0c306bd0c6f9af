//! TLS of the listener: certificate, key, and which authority signs the clients' certificates.
//!
//! This module uses rustls directly, because tonic's acceptor never changes its certificate: a
//! handshake uses the files that were read last. `connections` makes the handshakes and limits
//! them. Keys are never logged.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};

use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::server::{VerifierBuilderError, WebPkiClientVerifier};
use tokio_rustls::rustls::{self, RootCertStore};

/// Where certificates and keys are; all in PEM.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TlsFiles {
    /// The server's certificate, followed by the intermediate certificates.
    pub certificate: PathBuf,
    /// Its private key.
    pub key: PathBuf,
    /// Certificates of the authorities that sign the clients' (mutual TLS); without it clients need
    /// no certificate.
    pub client_ca: Option<PathBuf>,
}

/// Certificates or keys that cannot be used.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum TlsError {
    /// A file cannot be read.
    #[error("certificates and keys")]
    Read(#[from] io::Error),
    /// A file does not contain what it should.
    #[error("{}: holds no {what} in PEM", path.display())]
    Pem { path: PathBuf, what: &'static str },
    /// The certificate is not valid, or the key does not belong to it.
    #[error("certificate and key")]
    Refused(#[from] rustls::Error),
    /// The authorities that sign the clients' certificates cannot be used.
    #[error("the authorities of clients")]
    ClientCa(#[from] VerifierBuilderError),
}

/// The protocols of a listener, as ALPN names them.
pub(super) type Protocols = &'static [&'static [u8]];
/// gRPC needs HTTP/2.
pub(super) const GRPC: Protocols = &[b"h2"];
/// Browsers may speak HTTP/1.1 as well.
pub(super) const BROWSERS: Protocols = &[b"h2", b"http/1.1"];

/// The listener's side of TLS, from the files that were read last.
pub(super) struct Tls {
    files: TlsFiles,
    protocols: Protocols,
    acceptor: RwLock<TlsAcceptor>,
}

impl fmt::Debug for Tls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tls").field("files", &self.files).finish_non_exhaustive()
    }
}

impl Tls {
    /// Reads the files.
    pub(super) fn new(files: TlsFiles, protocols: Protocols) -> Result<Self, TlsError> {
        let acceptor = RwLock::new(acceptor(&files, protocols)?);
        Ok(Self { files, protocols, acceptor })
    }

    /// Reads the files again; nothing changes before [`Tls::put`].
    pub(super) fn read(&self) -> Result<TlsAcceptor, TlsError> {
        acceptor(&self.files, self.protocols)
    }

    /// From now on handshakes use `acceptor`.
    pub(super) fn put(&self, acceptor: TlsAcceptor) {
        *self.acceptor.write().unwrap_or_else(PoisonError::into_inner) = acceptor;
    }

    /// The acceptor that handshakes use now.
    pub(super) fn current(&self) -> TlsAcceptor {
        self.acceptor.read().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

fn acceptor(files: &TlsFiles, protocols: Protocols) -> Result<TlsAcceptor, TlsError> {
    let provider = Arc::new(default_provider());
    let builder = rustls::ServerConfig::builder_with_provider(Arc::clone(&provider))
        .with_safe_default_protocol_versions()?;
    let builder = match &files.client_ca {
        None => builder.with_no_client_auth(),
        Some(path) => {
            let mut authorities = RootCertStore::empty();
            for authority in certificates(path)? {
                authorities.add(authority)?;
            }
            let authorities = Arc::new(authorities);
            let verifier = WebPkiClientVerifier::builder_with_provider(authorities, provider);
            builder.with_client_cert_verifier(verifier.build()?)
        }
    };
    let mut config =
        builder.with_single_cert(certificates(&files.certificate)?, key(&files.key)?)?;
    config.alpn_protocols = protocols.iter().map(|name| name.to_vec()).collect();
    Ok(TlsAcceptor::from(Arc::new(config)))
}

fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let found = certificates_in(&fs_err::read(path)?);
    found.ok_or_else(|| TlsError::Pem { path: path.to_owned(), what: "certificate" })
}

fn key(path: &Path) -> Result<PrivateKeyDer<'static>, TlsError> {
    let found = key_in(&fs_err::read(path)?);
    found.ok_or_else(|| TlsError::Pem { path: path.to_owned(), what: "private key" })
}

/// The certificates of a PEM file; `None` if there is none, or a bad one.
pub(super) fn certificates_in(pem: &[u8]) -> Option<Vec<CertificateDer<'static>>> {
    let found: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(pem).collect();
    found.ok().filter(|certificates| !certificates.is_empty())
}

/// The first private key of a PEM file.
pub(super) fn key_in(pem: &[u8]) -> Option<PrivateKeyDer<'static>> {
    PrivateKeyDer::from_pem_slice(pem).ok()
}
