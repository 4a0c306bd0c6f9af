//! What a Rust frontend links: connect, keep maps, stream keyframes in, follow corrections.
//!
//! Speaks `covis.v1` (docs/wire.md) and knows nothing of the server's insides: only the messages in
//! [`crate::wire`] and tonic. Messages stay the wire's own, so that nothing is lost in between.
//!
//! | module | role |
//! |---|---|
//! | [`Client`] | one call a method |
//! | `credentials` | [`Credentials`]: token, certificates, trust |
//! | `ingest` | [`IngestSession`]: send with back-pressure, acks, finish |
//! | `stream` | the task behind a session: reconnects and resumes |
//! | `outbox` | the items that the server has not answered yet |
//! | `spill` | the file of those that memory does not hold |
//! | `shared` | the outbox between a session's handle and its task |
//! | `watch` | [`MapWatch`]: a [`MapMirror`] that deltas keep up to date |
//! | `retry`, `error` | what is tried again, and when to give up |

mod calls;
mod credentials;
mod error;
mod export;
mod ingest;
mod items;
mod mirror;
mod outbox;
mod retry;
mod shared;
mod spill;
mod stream;
mod watch;

use std::sync::Arc;
use std::time::Duration;

use tonic::codegen::InterceptedService;
use tonic::transport::{Channel, Endpoint};

use crate::wire::v1;
use v1::ingest_service_client::IngestServiceClient;
use v1::map_service_client::MapServiceClient;
use v1::optimization_service_client::OptimizationServiceClient;
use v1::server_service_client::ServerServiceClient;

use credentials::Bearer;

pub use calls::{Landmarks, MapDigests, Trajectory};
pub use credentials::{Credentials, Token};
pub use error::{ClientError, describe_violation};
pub use export::MapExport;
pub use ingest::{
    IngestReport, IngestSession, Item, KEPT_REJECTIONS, OnAck, RejectedItem, SessionOptions,
};
pub use mirror::{Key, MapMirror};
pub use retry::RetryPolicy;
pub use spill::{LeftOver, SpillDamage, SpillOptions};
pub use watch::{MapWatch, WatchOptions};

/// Largest message that is taken: a server sends at most what it is configured to.
const MAX_ANSWER_BYTES: usize = 256 * 1024 * 1024;
/// How long a connection may take to stand.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// An idle connection is probed so often, and given up when the probe stays unanswered: a link that
/// went away without a word is found.
const KEEP_ALIVE: Duration = Duration::from_secs(10);

/// A channel whose calls carry the token.
type Link = InterceptedService<Channel, Bearer>;

/// A connection to a server; cheap to clone, clones share it. A broken connection is made again by
/// the next call.
#[derive(Clone, Debug)]
pub struct Client {
    channel: Link,
    url: Arc<str>,
}

impl Client {
    /// Connects to a server without credentials, for instance `http://127.0.0.1:7411`.
    ///
    /// # Errors
    /// As [`Client::connect_with`].
    pub async fn connect(url: &str) -> Result<Self, ClientError> {
        Self::connect_with(url, &Credentials::default()).await
    }

    /// Connects to a server, for instance `https://maps.example:7411`. An `https` URL takes TLS; its
    /// host must stand in the server's certificate.
    ///
    /// # Errors
    /// [`ClientError::InvalidUrl`], [`ClientError::Unreachable`]; for credentials that cannot be used
    /// [`ClientError::Tls`], [`ClientError::InvalidToken`], [`ClientError::TokenInPlainText`].
    pub async fn connect_with(url: &str, credentials: &Credentials) -> Result<Self, ClientError> {
        let invalid = || ClientError::InvalidUrl { url: url.to_owned() };
        let endpoint = Endpoint::from_shared(url.to_owned()).map_err(|_invalid| invalid())?;
        let is_http = matches!(endpoint.uri().scheme_str(), Some("http" | "https"));
        if !is_http || endpoint.uri().host().is_none() {
            return Err(invalid());
        }
        let bearer = credentials.bearer(&endpoint)?;
        let connected = credentials
            .secure(endpoint)?
            .connect_timeout(CONNECT_TIMEOUT)
            .tcp_nodelay(true)
            .http2_keep_alive_interval(KEEP_ALIVE)
            .keep_alive_timeout(KEEP_ALIVE)
            .keep_alive_while_idle(true)
            .connect()
            .await;
        let channel = connected.map_err(|source| ClientError::Unreachable {
            url: url.to_owned(),
            source: Arc::new(source),
        })?;
        Ok(Self { channel: InterceptedService::new(channel, bearer), url: url.into() })
    }

    /// The server's address as it was given.
    #[must_use]
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Opens a session that sends items of `client_id` into a map; the map must exist.
    ///
    /// # Errors
    /// NOT_FOUND for the map, [`ClientError::RetriesExhausted`] when the server stays away, any
    /// other code of `Ingest`.
    pub async fn ingest(
        &self,
        map_id: &str,
        client_id: &str,
        options: SessionOptions,
    ) -> Result<IngestSession, ClientError> {
        IngestSession::open(self, map_id, client_id, options).await
    }

    /// Follows a map from its full state on.
    ///
    /// # Errors
    /// NOT_FOUND for the map, any other code of `WatchMap`.
    pub async fn watch(
        &self,
        map_id: &str,
        options: WatchOptions,
    ) -> Result<MapWatch, ClientError> {
        MapWatch::open(self, map_id, options).await
    }

    fn ingest_service(&self) -> IngestServiceClient<Link> {
        IngestServiceClient::new(self.channel.clone()).max_decoding_message_size(MAX_ANSWER_BYTES)
    }

    fn map_service(&self) -> MapServiceClient<Link> {
        MapServiceClient::new(self.channel.clone()).max_decoding_message_size(MAX_ANSWER_BYTES)
    }

    fn optimization_service(&self) -> OptimizationServiceClient<Link> {
        OptimizationServiceClient::new(self.channel.clone())
            .max_decoding_message_size(MAX_ANSWER_BYTES)
    }

    fn server_service(&self) -> ServerServiceClient<Link> {
        ServerServiceClient::new(self.channel.clone())
    }
}
