//! Starts and stops a server on a bound listener.
//!
//! Plain text is served beyond the loopback interface only if the configuration allows it.
//!
//! Metrics have their own listener, which answers from the start to the end of the drain. So does the
//! page ([`super::page`]): its connections are accepted, bounded and drained like all others.
//!
//! Starting: the transport answers at once, health with NOT_SERVING and calls with UNAVAILABLE, until
//! every map is open.
//!
//! [`super::connections`] bounds the resources that a client without a token can occupy.
//!
//! Shutting down: health turns NOT_SERVING, open streams end with UNAVAILABLE once their accepted
//! items are answered, running calls and solves finish within the budget, then the engines stop and
//! the store is closed. Nothing that was acknowledged is lost, even if the budget was too short.
//! While the server drains, the transport refuses new calls.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

#[cfg(feature = "faults")]
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio_stream::Stream;
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;

use super::access::{Access, AccessError};
use super::clock::Clock;
use super::config::ServerConfig;
use super::connections::{self, Accepted, Connections, Socket, Transport};
use super::context::Context;
use super::engine::{Accounts, EngineError, Maps, SolverPool};
use super::jobs::{self, Jobs};
use super::random::random_id;
use super::readers::Readers;
use super::routes::{Routed, SERVED, routes, transport};
use super::same_site::Hosts;
use super::telemetry::{self, ServerMeters};
use super::tls::{self, Tls, TlsError};
use crate::store::{
    FileStore, FileStoreOptions, JobFiles, MemoryStore, Store, StoreMeters, TaskQueue,
};
#[cfg(feature = "cluster")]
use crate::store::{ReplicatedStore, ReplicationError};

/// Why a server does not start.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum ServerError {
    /// The listener has no address.
    #[error("the listener's address")]
    Address(#[source] io::Error),
    /// The engines do not start, for instance because a journal does not replay.
    #[error("the engines")]
    Engine(#[from] EngineError),
    /// The folder of jobs cannot be read.
    #[error("the jobs: {reason}")]
    Jobs { reason: String },
    /// Maps cannot be shared with other servers.
    #[cfg(feature = "cluster")]
    #[error("the cluster")]
    Replication(#[from] ReplicationError),
    /// The file of tokens or that of keys cannot be used.
    #[error("who may come in")]
    Access(#[from] AccessError),
    /// Certificates or keys cannot be used.
    #[error("TLS")]
    Tls(#[from] TlsError),
    /// Others on the network could read the traffic.
    #[error(
        "plain text is served on loopback only, not on {address}: give a certificate and a key, \
            or allow it explicitly"
    )]
    PlainText { address: SocketAddr },
    /// Others on the network could read the metrics.
    #[error(
        "metrics are plain text and served on loopback only, not on {address}: allow plain text \
         explicitly"
    )]
    PlainMetrics { address: SocketAddr },
    /// The address for metrics cannot be bound.
    #[error("cannot serve metrics on {address}")]
    Metrics { address: String, source: io::Error },
    /// The address for the page cannot be bound.
    #[error("cannot serve the page on {address}")]
    Page { address: String, source: io::Error },
    /// The descriptors of the wire cannot be served.
    #[error("server reflection")]
    Reflection(#[from] tonic_reflection::server::Error),
    /// An unknown test fault.
    #[cfg(feature = "faults")]
    #[error("unknown test fault {name:?}")]
    UnknownFault { name: String },
}

/// Starts servers.
#[derive(Clone, Copy, Debug)]
pub struct Server;

/// A server whose transport answers while its maps are still closed: health with NOT_SERVING, calls
/// with UNAVAILABLE. Dropping it ends it at once.
#[derive(Debug)]
pub struct StartingServer(RunningServer);

/// A server that accepts calls until it is shut down; dropping it ends it at once.
#[derive(Debug)]
pub struct RunningServer {
    address: SocketAddr,
    context: Arc<Context>,
    jobs: Arc<Jobs>,
    /// That of the listener, and that of the page.
    tls: Vec<Arc<Tls>>,
    metrics: Option<(SocketAddr, JoinHandle<()>)>,
    page: Option<(SocketAddr, JoinHandle<()>)>,
    drain: watch::Sender<bool>,
    health: HealthReporter,
    task: JoinHandle<()>,
    /// Runs the jobs, once every map is open.
    schedule: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves on `listener` in the background; returns when every map is open.
    ///
    /// # Errors
    /// [`ServerError`] if something does not start.
    pub async fn start(
        listener: TcpListener,
        config: ServerConfig,
    ) -> Result<RunningServer, ServerError> {
        Self::listen(listener, config).await?.open().await
    }

    /// Answers on `listener` in the background; maps are opened by [`StartingServer::open`].
    ///
    /// # Errors
    /// [`ServerError`] if something does not start.
    pub async fn listen(
        listener: TcpListener,
        config: ServerConfig,
    ) -> Result<StartingServer, ServerError> {
        let address = listener.local_addr().map_err(ServerError::Address)?;
        let incoming = connections::accepted(listener, config.keep_alive.tcp);
        Self::listen_to(incoming, address, config, None).await
    }

    /// As [`Server::listen`] in a simulation: on one thread, with the sockets of a simulated network and the
    /// store of a simulated disk. Jobs are kept in memory.
    ///
    /// # Errors
    /// [`ServerError`] if something does not start.
    #[cfg(feature = "faults")]
    pub async fn listen_in_place<S: AsyncRead + AsyncWrite + Unpin + Send + 'static>(
        incoming: impl Stream<Item = io::Result<(S, SocketAddr)>> + Send + 'static,
        address: SocketAddr,
        config: ServerConfig,
        store: FileStore,
    ) -> Result<StartingServer, ServerError> {
        let backend = Backend {
            counted: store.meters(),
            store: Arc::new(store),
            pool: SolverPool::in_place(),
            readers: Readers::in_place(),
            job_files: JobFiles::in_memory(),
            tasks: None,
        };
        Self::listen_to(incoming, address, config, Some(backend)).await
    }

    /// As [`Server::listen`], with sockets of any kind that are accepted elsewhere, for example by
    /// a simulated network. `address` is the address that they connected to. Without a `backend`
    /// the server opens the one from its configuration.
    async fn listen_to<S: Socket>(
        incoming: impl Stream<Item = io::Result<Accepted<S>>> + Send + 'static,
        address: SocketAddr,
        config: ServerConfig,
        backend: Option<Backend>,
    ) -> Result<StartingServer, ServerError> {
        #[cfg(feature = "faults")]
        let config = staged(config)?;
        let secured = |protocols| config.tls.clone().map(|files| Tls::new(files, protocols));
        let tls = secured(tls::GRPC).transpose()?.map(Arc::new);
        let access = Access::new(config.tokens.clone(), config.jwt.clone(), config.clock.clone())?;
        let access = Arc::new(access);
        check_address(address, &config, &access)?;
        let page = page_listener(&config).await?;
        if let Some((address, _)) = &page {
            check_address(*address, &config, &access)?;
        }
        let page_tls = match &page {
            Some(_) => secured(tls::BROWSERS).transpose()?.map(Arc::new),
            None => None,
        };
        let accounts = Accounts::new(
            config.account_limits(),
            config.tenant_limits,
            config.map_account_limits(),
        );
        accounts.set_tenants(access.tenant_limits());
        let metrics = metrics_listener(&config).await?;
        let Backend { store, counted, pool, readers, job_files, tasks } = match backend {
            Some(backend) => backend,
            None => Backend::open(&config, accounts).await?,
        };
        let meters = ServerMeters::new(counted);
        let maps = Maps::new(store, pool, config.engine);
        let (drain, draining) = watch::channel(false);
        let connections = Connections::new(config.connections, telemetry::max_open_files());
        let instance_id = random_id();
        let (start_time_ns, ready) = (Clock::System.now_ns(), AtomicBool::new(false));
        let context = Arc::new(Context {
            maps,
            config,
            meters,
            access,
            connections,
            instance_id,
            start_time_ns,
            ready,
            draining,
            readers,
        });
        let jobs = Arc::new(Jobs::new(Arc::clone(&context), job_files, tasks));
        let hosts =
            page.as_ref().map(|_| Hosts::of_page(page_tls.is_some(), context.access.is_guarded()));
        let Routed { health, grpc, page: page_routes } = routes(&context, &jobs, hosts).await?;
        let server = transport(&context);
        let grpc = Transport { server: server.clone(), routes: grpc, tls: tls.clone() };
        let task = tokio::spawn(connections::serve(incoming, grpc, Arc::clone(&context)));
        let page = page.zip(page_routes).map(|((address, listener), routes)| {
            // Browsers speak HTTP/2 with TLS only.
            let server = server.accept_http1(true);
            let transport = Transport { server, routes, tls: page_tls.clone() };
            let incoming = connections::accepted(listener, context.config.keep_alive.tcp);
            (address, tokio::spawn(connections::serve(incoming, transport, Arc::clone(&context))))
        });
        let tls = tls.into_iter().chain(page_tls).collect();
        let metrics = metrics.map(|(address, listener)| {
            let (context, jobs) = (Arc::clone(&context), Arc::clone(&jobs));
            (address, tokio::spawn(telemetry::serve(listener, address, context, jobs)))
        });
        // From here on, dropping the server ends the transport.
        Ok(StartingServer(RunningServer {
            address,
            context,
            jobs,
            tls,
            metrics,
            page,
            drain,
            health,
            task,
            schedule: None,
        }))
    }
}

/// Where a server keeps its maps and runs its solves.
struct Backend {
    store: Arc<dyn Store>,
    /// The meters of the store.
    counted: Arc<StoreMeters>,
    pool: Arc<SolverPool>,
    /// The threads that build messages from maps.
    readers: Readers,
    /// Where jobs are kept.
    job_files: JobFiles,
    /// Where problems are given to workers.
    tasks: Option<Arc<dyn TaskQueue>>,
}

/// The maps' store, and where problems are given to workers.
type Shared = (Arc<dyn Store>, Option<Arc<dyn TaskQueue>>);

impl Backend {
    /// Opens the backend of a configuration.
    async fn open(config: &ServerConfig, accounts: Accounts) -> Result<Self, ServerError> {
        let pool = SolverPool::shared_by(accounts, config.threads)?;
        let count = pool.threads();
        let readers = Readers::start(count).map_err(|_error| EngineError::Threads { count })?;
        let Some(directory) = &config.data_dir else {
            let store = Arc::new(MemoryStore::new());
            let job_files = JobFiles::in_memory();
            let counted = Arc::default();
            return Ok(Self { store, counted, pool, readers, job_files, tasks: None });
        };
        let opened = FileStore::open(directory, FileStoreOptions::default()).await;
        let store = opened.map_err(EngineError::Store)?;
        let (counted, job_files) = (store.meters(), store.job_files());
        let (store, tasks) = Self::shared(config, store).await?;
        Ok(Self { counted, store, pool, readers, job_files, tasks })
    }

    /// The store between several servers, where maps are shared.
    #[cfg(feature = "cluster")]
    async fn shared(config: &ServerConfig, store: FileStore) -> Result<Shared, ServerError> {
        let Some(options) = &config.replication else { return Ok((Arc::new(store), None)) };
        let store = ReplicatedStore::open(store, options.clone()).await?;
        let tasks = store.tasks();
        Ok((Arc::new(store), Some(tasks)))
    }

    /// Without the feature `cluster` maps are not shared.
    #[cfg(not(feature = "cluster"))]
    #[allow(clippy::unused_async, reason = "as with the feature")]
    async fn shared(_config: &ServerConfig, store: FileStore) -> Result<Shared, ServerError> {
        Ok((Arc::new(store), None))
    }
}

impl StartingServer {
    /// Opens every map; then calls are accepted.
    ///
    /// # Errors
    /// [`ServerError::Engine`] when the store cannot be read, [`ServerError::Jobs`] when jobs cannot.
    pub async fn open(self) -> Result<RunningServer, ServerError> {
        let mut server = self.0;
        server.context.maps.load().await?;
        let loaded = server.jobs.load().await;
        loaded.map_err(|error| ServerError::Jobs { reason: error.to_string() })?;
        server.schedule = Some(tokio::spawn(jobs::serve(Arc::clone(&server.jobs))));
        server.context.ready.store(true, Ordering::Release);
        server.tell_health(ServingStatus::Serving).await;
        Ok(server)
    }
}

impl RunningServer {
    /// The pool that runs this server's solves. The caller can queue its own work here, so that a
    /// test can block the pool and observe what waits.
    pub fn solver_pool(&self) -> Arc<SolverPool> {
        Arc::clone(self.context.maps.pool())
    }

    /// The address that was bound.
    pub fn local_addr(&self) -> SocketAddr {
        self.address
    }

    /// The address where `GET /metrics` is answered, with the port that was bound.
    pub fn metrics_addr(&self) -> Option<SocketAddr> {
        self.metrics.as_ref().map(|(address, _)| *address)
    }

    /// The address of the page, with the port that was bound.
    pub fn page_addr(&self) -> Option<SocketAddr> {
        self.page.as_ref().map(|(address, _)| *address)
    }

    /// Reads certificates, keys, tokens and the keys of JSON Web Tokens again. New connections use
    /// the new certificate; new calls and open streams need a token that is known now.
    ///
    /// # Errors
    /// [`ServerError::Tls`], [`ServerError::Access`]; then nothing is changed.
    pub fn reload(&self) -> Result<(), ServerError> {
        let acceptors = self.tls.iter().map(|tls| tls.read()).collect::<Result<Vec<_>, _>>()?;
        let known = self.context.access.read()?;
        for (tls, acceptor) in self.tls.iter().zip(acceptors) {
            tls.put(acceptor);
        }
        self.context.access.put(known);
        self.solver_pool().accounts().set_tenants(self.context.access.tenant_limits());
        tracing::info!("certificates and tokens were read again");
        Ok(())
    }

    async fn tell_health(&self, status: ServingStatus) {
        for name in SERVED.into_iter().chain([""]) {
            self.health.set_service_status(name, status).await;
        }
    }

    /// Drains and stops the server within its budget; returns when its engines have stopped and
    /// everything they accepted is durable.
    pub async fn shutdown(mut self) {
        let start = Instant::now();
        self.tell_health(ServingStatus::NotServing).await;
        self.drain.send_replace(true);
        let budget = self.context.config.drain_budget;
        for task in [Some(&mut self.task), self.page.as_mut().map(|(_, task)| task)] {
            let Some(task) = task else { continue };
            match tokio::time::timeout(budget.saturating_sub(start.elapsed()), &mut *task).await {
                Ok(Ok(())) => {}
                Ok(Err(error)) => tracing::warn!(%error, "the transport's task ended badly"),
                Err(_elapsed) => {
                    tracing::warn!("calls were still running after {budget:?}, they are cut off");
                    task.abort();
                }
            }
        }
        // Jobs and engines without work also need some time to stop.
        let left = || budget.saturating_sub(start.elapsed()).max(budget / 10);
        if let Some(mut schedule) = self.schedule.take()
            && tokio::time::timeout(left(), &mut schedule).await.is_err()
        {
            tracing::warn!("jobs were still running, they start again with the server");
            schedule.abort();
        }
        let left = left();
        self.context.maps.shutdown(left).await;
        if let Some((_, task)) = &mut self.metrics {
            task.abort();
            // Waits for the canceled task, because its port is free only then.
            let _canceled = task.await;
        }
    }
}

impl Drop for RunningServer {
    fn drop(&mut self) {
        self.drain.send_replace(true);
        self.task.abort();
        for (_, task) in self.metrics.iter().chain(&self.page) {
            task.abort();
        }
    }
}

/// Plain text is served beyond the loopback interface only if the configuration allows it.
fn check_address(
    address: SocketAddr,
    config: &ServerConfig,
    access: &Access,
) -> Result<(), ServerError> {
    if address.ip().is_loopback() {
        return Ok(());
    }
    if config.tls.is_none() && !config.insecure_plain_text {
        return Err(ServerError::PlainText { address });
    }
    if !access.is_guarded() {
        tracing::warn!("without tokens, anyone who reaches {address} may do everything");
    }
    Ok(())
}

/// The listener for metrics, if one is configured.
async fn metrics_listener(
    config: &ServerConfig,
) -> Result<Option<(SocketAddr, TcpListener)>, ServerError> {
    let Some(wanted) = &config.metrics_listen else { return Ok(None) };
    let failed = |source| ServerError::Metrics { address: wanted.clone(), source };
    let (address, listener) = bind(wanted).await.map_err(failed)?;
    if !address.ip().is_loopback() && !config.insecure_plain_text {
        return Err(ServerError::PlainMetrics { address });
    }
    Ok(Some((address, listener)))
}

/// The listener for the page, if one is configured.
async fn page_listener(
    config: &ServerConfig,
) -> Result<Option<(SocketAddr, TcpListener)>, ServerError> {
    let Some(wanted) = &config.page_listen else { return Ok(None) };
    let failed = |source| ServerError::Page { address: wanted.clone(), source };
    bind(wanted).await.map_err(failed).map(Some)
}

async fn bind(wanted: &str) -> io::Result<(SocketAddr, TcpListener)> {
    let listener = TcpListener::bind(wanted).await?;
    Ok((listener.local_addr()?, listener))
}

/// Passes a fault of the engine to its configuration; the edge handles faults of handlers.
#[cfg(feature = "faults")]
fn staged(mut config: ServerConfig) -> Result<ServerConfig, ServerError> {
    use super::engine::Fault;

    let Some(name) = &config.test_fault else { return Ok(config) };
    let is_held_solve = name == "hold-reconstruction";
    if !is_held_solve && (name.starts_with("rpc:") || name.starts_with("hold-")) {
        return Ok(config);
    }
    let fault = match name.as_str() {
        "panic-in-solve" => Fault::PanicInSolve,
        "panic-in-window" => Fault::PanicInWindow,
        "panic-in-result" => Fault::PanicInResult,
        "panic-in-retirement" => Fault::PanicInRetirement,
        "panic-in-background" => Fault::PanicInBackground,
        "impossible-result" => Fault::ImpossibleResult,
        "hold-reconstruction" => Fault::HoldReconstruction,
        "panic-in-engine" => Fault::PanicInEngine,
        "fail-calls" => Fault::FailCalls,
        _ => return Err(ServerError::UnknownFault { name: name.clone() }),
    };
    config.engine.fault = Some(fault);
    Ok(config)
}
