//! TLS of the listener: certificate, key, and which authority signs the clients' certificates.
//!
//! rustls is driven here and not through tonic, whose acceptor keeps its certificate for good: a
//! handshake takes what was read last. Handshakes run side by side, bounded in number and time, so
//! that a peer that says nothing keeps nobody out. Keys are never logged.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::server::{VerifierBuilderError, WebPkiClientVerifier};
use tokio_rustls::rustls::{self, RootCertStore};
use tokio_rustls::server::TlsStream;
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt};

use super::connections::{Accepted, Connection, Socket};
use super::context::Context;

/// Handshakes that run at once; further connections wait in the system's queue.
const MAX_HANDSHAKES: usize = 256;
/// How long a handshake may take.
const HANDSHAKE_TIME: Duration = Duration::from_secs(10);

/// Where certificates and keys are; all in PEM.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TlsFiles {
    /// The server's certificate, followed by those between it and the authority.
    pub certificate: PathBuf,
    /// Its private key.
    pub key: PathBuf,
    /// Certificates of the authorities that sign the clients' (mutual TLS); without it clients need
    /// no certificate.
    pub client_ca: Option<PathBuf>,
}

/// Certificates or keys that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    /// A file cannot be read.
    #[error("certificates and keys")]
    Read(#[from] io::Error),
    /// A file holds nothing of what it should.
    #[error("{}: holds no {what} in PEM", path.display())]
    Pem {
        /// The file.
        path: PathBuf,
        /// What it should hold.
        what: &'static str,
    },
    /// The certificate is none, or the key is not its own.
    #[error("certificate and key")]
    Refused(#[from] rustls::Error),
    /// The authorities that sign the clients' certificates.
    #[error("the authorities of clients")]
    ClientCa(#[from] VerifierBuilderError),
}

/// The listener's side of TLS, as it was read last.
pub(super) struct Tls {
    files: TlsFiles,
    acceptor: RwLock<TlsAcceptor>,
}

impl fmt::Debug for Tls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tls").field("files", &self.files).finish_non_exhaustive()
    }
}

impl Tls {
    /// Reads the files.
    pub(super) fn new(files: TlsFiles) -> Result<Self, TlsError> {
        let acceptor = RwLock::new(acceptor(&files)?);
        Ok(Self { files, acceptor })
    }

    /// Reads the files again; nothing changes before [`Tls::put`].
    pub(super) fn read(&self) -> Result<TlsAcceptor, TlsError> {
        acceptor(&self.files)
    }

    /// From now on handshakes are made with `acceptor`.
    pub(super) fn put(&self, acceptor: TlsAcceptor) {
        *self.acceptor.write().unwrap_or_else(PoisonError::into_inner) = acceptor;
    }

    fn current(&self) -> TlsAcceptor {
        self.acceptor.read().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

fn acceptor(files: &TlsFiles) -> Result<TlsAcceptor, TlsError> {
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
    config.alpn_protocols = vec![b"h2".to_vec()];
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

/// The certificates of a PEM file; `None` where there is none, or a bad one.
pub(super) fn certificates_in(pem: &[u8]) -> Option<Vec<CertificateDer<'static>>> {
    let found: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(pem).collect();
    found.ok().filter(|certificates| !certificates.is_empty())
}

/// The first private key of a PEM file.
pub(super) fn key_in(pem: &[u8]) -> Option<PrivateKeyDer<'static>> {
    PrivateKeyDer::from_pem_slice(pem).ok()
}

/// The connections of `incoming` whose handshake succeeds.
pub(super) fn handshakes<S: Socket>(
    incoming: impl Stream<Item = io::Result<Accepted<S>>> + Send + 'static,
    tls: Arc<Tls>,
    context: Arc<Context>,
) -> ReceiverStream<io::Result<Connection<TlsStream<S>>>> {
    let (sender, receiver) = mpsc::channel(1);
    tokio::spawn(async move {
        let mut incoming = pin!(incoming);
        let mut running = JoinSet::new();
        loop {
            tokio::select! {
                next = incoming.next(), if running.len() < MAX_HANDSHAKES => match next {
                    Some(Ok(accepted)) => {
                        running.spawn(handshake(tls.current(), accepted, sender.clone(), Arc::clone(&context)));
                    }
                    Some(Err(error)) => {
                        // The transport decides which errors end the server.
                        let _gone = sender.send(Err(error)).await;
                    }
                    None => return,
                },
                Some(_ended) = running.join_next(), if !running.is_empty() => {}
                () = sender.closed() => return,
            }
        }
    });
    ReceiverStream::new(receiver)
}

async fn handshake<S: Socket>(
    acceptor: TlsAcceptor,
    (socket, peer): Accepted<S>,
    sender: mpsc::Sender<io::Result<Connection<TlsStream<S>>>>,
    context: Arc<Context>,
) {
    let failed = || context.meters.failed_handshakes.increment();
    match tokio::time::timeout(HANDSHAKE_TIME, acceptor.accept(socket)).await {
        Ok(Ok(stream)) => {
            let _gone = sender.send(Ok(Connection::new(stream, peer))).await;
        }
        Ok(Err(error)) => {
            failed();
            tracing::debug!(%error, "a TLS handshake failed");
        }
        Err(_elapsed) => {
            failed();
            tracing::debug!("a TLS handshake took too long");
        }
    }
}
