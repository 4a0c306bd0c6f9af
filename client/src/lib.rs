//! What a Rust frontend links: connect, keep maps, stream keyframes in, follow corrections.
//!
//! Speaks `covis.v1` (docs/wire.md) and knows nothing of the server: only the messages in [`wire`] and
//! tonic. Messages stay the wire's own, so that nothing is lost in between. First what a program calls,
//! then what stands behind it:
//!
//! | module | role |
//! |---|---|
//! | [`Client`] | a connection; `calls` has one call a method |
//! | `credentials` | [`Credentials`]: token, certificates, trust |
//! | `link` | [`LinkOptions`]: how a link that is gone is found |
//! | `ingest` | [`IngestSession`]: send with back-pressure, acks, finish |
//! | `watch`, `mirror` | [`MapWatch`]: a [`MapMirror`] that deltas keep up to date |
//! | `settled` | waiting until the server has nothing left to do about a map |
//! | `export` | [`MapExport`]: the files of a map, chunk by chunk |
//! | `jobs` | jobs, their uploads, [`JobDownload`]: the files that they made |
//! | [`wire`] | generated from `proto/covis/v1`, and the codec of every call |
//! | [`depth_noise`] | standard deviations of measured depths |
//! | `servers` | which of several servers a client talks to |
//! | `stream` | the task behind a session: reconnects and resumes |
//! | `next_ids` | the next free ids of keyframes and landmarks |
//! | `outbox` | the items that the server has not answered yet |
//! | `spill` | the file of those that memory does not hold |
//! | `retry`, `error` | what is tried again, and when to give up |
//! | `repeats` | the attempts at one call |
//! | `decoding` | what a message takes in memory, before it is decoded |

mod calls;
mod credentials;
#[doc(hidden)]
pub mod decoding;
pub mod depth_noise;
mod error;
mod export;
mod ingest;
mod jobs;
mod link;
mod mirror;
mod next_ids;
mod outbox;
mod repeats;
mod retry;
mod servers;
mod settled;
mod spill;
mod stream;
mod watch;
pub mod wire;

use std::sync::Arc;
use std::time::Duration;

use tonic::Request;
use tonic::codegen::InterceptedService;
use tonic::transport::Channel;

use crate::wire::v1;
use v1::ingest_service_client::IngestServiceClient;
use v1::job_service_client::JobServiceClient;
use v1::map_service_client::MapServiceClient;
use v1::optimization_service_client::OptimizationServiceClient;
use v1::server_service_client::ServerServiceClient;

use credentials::Bearer;
use servers::Servers;

pub use calls::MapDigests;
pub use credentials::{Credentials, Token};
pub use error::{ClientError, describe_violation};
pub use export::MapExport;
pub use ingest::{
    IngestReport, IngestSession, Item, KEPT_REJECTIONS, OnAck, RejectedItem, SessionOptions,
};
pub use jobs::JobDownload;
pub use link::LinkOptions;
pub use mirror::{Key, MapChanges, MapMirror};
pub use next_ids::NextIds;
pub use retry::RetryPolicy;
pub use servers::connect_channel;
pub use spill::{LeftOver, SpillDamage, SpillOptions};
pub use watch::{MapWatch, WatchOptions};

/// Largest message that is taken: a server sends at most what it is configured to.
const MAX_ANSWER_BYTES: usize = 256 * 1024 * 1024;
/// A client of a service, compressing where the link asks for it; the generated ones share no trait.
macro_rules! packed {
    ($client:expr, $service:ident) => {{
        let service = $service::new($client.servers.link());
        let service = service.max_decoding_message_size(MAX_ANSWER_BYTES);
        if $client.compress {
            let encoding = tonic::codec::CompressionEncoding::Gzip;
            service.send_compressed(encoding).accept_compressed(encoding)
        } else {
            service
        }
    }};
}

/// A channel whose calls carry the token.
type Link = InterceptedService<Channel, Bearer>;

/// A connection to a server; cheap to clone, clones share it. A broken connection is made again by
/// the next call.
#[derive(Clone, Debug)]
pub struct Client {
    servers: Arc<Servers>,
    deadline: Duration,
    retry: RetryPolicy,
    compress: bool,
}

impl Client {
    /// Connects to a server without credentials, for instance `http://127.0.0.1:7411`. Of several URLs,
    /// separated by commas, the first that answers is taken, and the others when it is gone.
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
        Self::connect_over(url, credentials, LinkOptions::default()).await
    }

    /// As [`Client::connect_with`], with other times than the usual ones.
    ///
    /// # Errors
    /// As [`Client::connect_with`].
    pub async fn connect_over(
        url: &str,
        credentials: &Credentials,
        link: LinkOptions,
    ) -> Result<Self, ClientError> {
        let servers = Servers::connect(url, credentials, link).await?;
        let LinkOptions { deadline, retry, compress, .. } = link;
        Ok(Self { servers, deadline, retry, compress })
    }

    /// A client without credentials on a channel that the caller made, for instance over a socket of
    /// its own. `url` is for messages only.
    #[must_use]
    pub fn on_channel(channel: Channel, url: &str, deadline: Duration) -> Self {
        let (servers, retry) = (Servers::on_channel(channel, url), RetryPolicy::default());
        Self { servers, deadline, retry, compress: false }
    }

    /// The same client with another deadline of calls that solve nothing.
    #[must_use]
    pub fn with_deadline(&self, deadline: Duration) -> Self {
        Self { deadline, ..self.clone() }
    }

    /// The same client with other retries of its calls ([`LinkOptions::retry`]).
    #[must_use]
    pub fn with_retry(&self, retry: RetryPolicy) -> Self {
        Self { retry, ..self.clone() }
    }

    /// The address of the server that calls go to.
    pub fn url(&self) -> Arc<str> {
        self.servers.url()
    }

    /// A client that goes its own ways from here on, for what follows one map.
    fn apart(&self) -> Self {
        Self { servers: self.servers.apart(), ..self.clone() }
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

    /// A request with the deadline of calls that solve nothing.
    fn timed<T>(&self, message: T) -> Request<T> {
        let mut request = Request::new(message);
        request.set_timeout(self.deadline);
        request
    }

    fn ingest_service(&self) -> IngestServiceClient<Link> {
        packed!(self, IngestServiceClient)
    }

    fn job_service(&self) -> JobServiceClient<Link> {
        packed!(self, JobServiceClient)
    }

    fn map_service(&self) -> MapServiceClient<Link> {
        packed!(self, MapServiceClient)
    }

    fn optimization_service(&self) -> OptimizationServiceClient<Link> {
        packed!(self, OptimizationServiceClient)
    }

    fn server_service(&self) -> ServerServiceClient<Link> {
        ServerServiceClient::new(self.servers.link())
    }
}
