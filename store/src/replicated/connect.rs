//! Connecting: what servers share is opened, or made by the first of them. A NATS that cannot be used is
//! refused here, before a map is served.

use std::fmt;
use std::future::Future;
use std::time::Duration;

use async_nats::jetstream::context::{Context, ContextBuilder};
use async_nats::jetstream::{kv, object_store};

use super::catalog::Catalog;
use super::members::Members;
use super::message::Owner;
use super::snapshots::Snapshots;
use super::tasks::Tasks;
use super::{new_uid, synced};

/// Longest wait for an answer of NATS.
const PATIENCE: Duration = Duration::from_secs(3);
/// Messages of a connection that wait for their acknowledgments.
const IN_FLIGHT: usize = 4096;
/// Most bytes of events in a message; less where NATS takes less.
const MESSAGE: usize = 512 << 10;
/// Bytes of a message that are left for its headers.
const HEADERS: usize = 4 << 10;
/// Least bytes that a message must hold besides.
const LEAST_MESSAGE: usize = 4 << 10;
/// How long the beat of a server that is gone stays.
const OLDEST_BEAT: Duration = Duration::from_secs(3600);
/// How long a start waits for NATS, which may start at the same time.
const START: Duration = Duration::from_secs(30);
/// The wait between two tries.
const AGAIN: Duration = Duration::from_millis(500);

/// How maps are shared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReplicationOptions {
    /// URLs of NATS servers, separated by commas.
    pub nats: String,
    /// Their monitoring addresses (`http://host:8222`), one each.
    pub monitoring: Vec<String>,
    /// Whether NATS servers may acknowledge before they have synced; the monitoring addresses are then
    /// not asked.
    pub accept_unsynced: bool,
    /// On how many NATS servers each stream is: 1, 3 or 5.
    pub replicas: usize,
    /// How long a server that is not heard of keeps its maps.
    pub lease: Duration,
    /// Where clients reach this server, as a URL.
    pub address: String,
}

/// Why maps cannot be shared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum ReplicationError {
    /// NATS does not answer, or not as it should.
    #[error("NATS: {what}: {reason}")]
    Nats { what: &'static str, reason: String },
    /// A monitoring address does not tell.
    #[error("the monitoring address {address}: {reason}")]
    Monitoring { address: String, reason: String },
    /// Nothing tells whether NATS syncs.
    #[error(
        "the monitoring addresses of the NATS servers are needed to check that NATS syncs before \
         it acknowledges: give all of them, or accept unsynced replicas explicitly"
    )]
    NoMonitoring,
    /// A NATS server acknowledges what a loss of power takes back.
    #[error(
        "NATS server {server:?} acknowledges before it syncs: set `sync_interval: always` in its \
         `jetstream` block, or accept unsynced replicas explicitly"
    )]
    Unsynced { server: String },
    /// There are more NATS servers than monitoring addresses.
    #[error("{servers} NATS servers keep streams, and the monitoring addresses are of {asked}")]
    Unmonitored { asked: usize, servers: usize },
}

impl ReplicationError {
    /// Whether it may pass when NATS has started.
    fn passes(&self) -> bool {
        match self {
            Self::Nats { .. } | Self::Monitoring { .. } => true,
            Self::NoMonitoring | Self::Unsynced { .. } | Self::Unmonitored { .. } => false,
        }
    }
}

/// What servers share.
pub(super) struct Shared {
    pub(super) context: Context,
    /// Most bytes of events in a message.
    pub(super) most: usize,
    pub(super) catalog: Catalog,
    pub(super) snapshots: Snapshots,
    pub(super) members: Members,
    pub(super) tasks: Tasks,
}

impl Shared {
    /// Connects; waits a while for NATS, which may start at the same time.
    ///
    /// # Errors
    /// [`ReplicationError`].
    pub(super) async fn open(options: &ReplicationOptions) -> Result<Self, ReplicationError> {
        patiently(options, || Self::connect(options)).await
    }

    async fn connect(options: &ReplicationOptions) -> Result<Self, ReplicationError> {
        let (context, most) = link(options).await?;
        let (replicas, lease) = (options.replicas, options.lease);
        let maps = bucket("covis_maps", replicas, Duration::ZERO);
        let maps = context.create_key_value(maps).await;
        let catalog = Catalog(maps.map_err(|error| nats("the bucket of maps", &error))?);
        let beats = bucket("covis_servers", replicas, OLDEST_BEAT);
        let beats = context.create_key_value(beats).await;
        let beats = beats.map_err(|error| nats("the bucket of servers", &error))?;
        let objects = object_store::Config {
            bucket: "covis_snapshots".to_owned(),
            num_replicas: replicas,
            ..object_store::Config::default()
        };
        let objects = context.create_object_store(objects).await;
        let snapshots = Snapshots(objects.map_err(|error| nats("the snapshots", &error))?);
        let tasks = Tasks::open(&context, options).await?;
        let me = Owner { server: new_uid(), address: options.address.clone() };
        // The thread of the lease has a connection of its own.
        let (name, options) = (beats.name, options.clone());
        let open = move || async move {
            let (context, _) = connect(&options).await.map_err(|error| error.to_string())?;
            context.get_key_value(name).await.map_err(|error| error.to_string())
        };
        let members = Members::start(me, lease, open).await;
        let members = members.map_err(|error| nats("the lease", &error))?;
        Ok(Self { context, most, catalog, snapshots, members, tasks })
    }
}

/// A bucket that keeps the newest value of each key.
pub(super) fn bucket(name: &str, replicas: usize, max_age: Duration) -> kv::Config {
    kv::Config {
        bucket: name.to_owned(),
        history: 1,
        num_replicas: replicas,
        max_age,
        ..kv::Config::default()
    }
}

/// Tries until NATS has started, for a while.
///
/// # Errors
/// [`ReplicationError`].
pub(super) async fn patiently<T, F: Future<Output = Result<T, ReplicationError>>>(
    options: &ReplicationOptions,
    attempt: impl Fn() -> F,
) -> Result<T, ReplicationError> {
    if options.accept_unsynced {
        tracing::warn!("if NATS machines lose power, acknowledged items may be lost");
    } else if options.monitoring.is_empty() {
        return Err(ReplicationError::NoMonitoring);
    }
    let start = tokio::time::Instant::now();
    loop {
        match attempt().await {
            Err(error) if error.passes() && start.elapsed() < START => {
                tracing::info!(%error, "waiting for NATS");
                tokio::time::sleep(AGAIN).await;
            }
            ended => return ended,
        }
    }
}

/// Connects to a NATS that can be used; also answers how many bytes of events a message may have.
///
/// # Errors
/// [`ReplicationError`].
pub(super) async fn link(
    options: &ReplicationOptions,
) -> Result<(Context, usize), ReplicationError> {
    if !options.accept_unsynced {
        synced::check(&options.monitoring).await?;
    }
    connect(options).await
}

/// Connects; also answers how many bytes of events a message may have.
async fn connect(options: &ReplicationOptions) -> Result<(Context, usize), ReplicationError> {
    let servers: Vec<String> = options.nats.split(',').map(|url| url.trim().to_owned()).collect();
    let connected = async_nats::ConnectOptions::new()
        .name("covis")
        .connection_timeout(PATIENCE)
        .request_timeout(Some(PATIENCE))
        .connect(servers)
        .await;
    let client = connected.map_err(|error| nats("cannot connect", &error))?;
    let info = client.server_info();
    if !is_recent(&info.version) {
        let reason = format!("version {} is older than 2.10", info.version);
        return Err(ReplicationError::Nats { what: "cannot be used", reason });
    }
    let most = info.max_payload.saturating_sub(HEADERS).min(MESSAGE);
    if most < LEAST_MESSAGE {
        let reason = format!("max_payload is {}", info.max_payload);
        return Err(ReplicationError::Nats { what: "cannot be used", reason });
    }
    let context = ContextBuilder::new()
        .timeout(PATIENCE)
        .ack_timeout(PATIENCE)
        .max_ack_inflight(IN_FLIGHT)
        .build(client);
    Ok((context, most))
}

pub(super) fn nats(what: &'static str, reason: &dyn fmt::Display) -> ReplicationError {
    ReplicationError::Nats { what, reason: reason.to_string() }
}

/// Whether a version of NATS knows what is needed here: 2.10 or later.
fn is_recent(version: &str) -> bool {
    let mut numbers = version.split('.').map(|number| number.parse::<u32>().unwrap_or(0));
    (numbers.next(), numbers.next()) >= (Some(2), Some(10))
}
