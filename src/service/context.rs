//! What every service shares: the maps, the settings, and how a handler's outcome is answered.
//!
//! [`Context::answer`] and [`Context::stream`] run handlers: an error becomes a status, a panic
//! becomes INTERNAL instead of a broken connection, a stream ends when its caller leaves, its
//! deadline passes or the server drains. No handler touches a transport type beyond these.

use std::future::Future;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use futures_util::FutureExt;
use tokio::sync::{mpsc, watch};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Response, Status};
use tracing::Instrument;

use super::access::Access;
use super::config::ServerConfig;
use super::connections::Connections;
use super::convert::map::ServerCeilings;
use super::engine::{EngineError, Maps};
use super::error::ServiceError;
use super::telemetry::ServerMeters;

/// Messages that wait for a slow reader of a stream.
const STREAM_QUEUE: usize = 8;

/// What services share.
#[derive(Debug)]
pub(super) struct Context {
    /// All maps.
    pub maps: Maps,
    /// The settings.
    pub config: ServerConfig,
    /// What is counted besides what the engines count.
    pub meters: ServerMeters,
    /// Who may call what.
    pub access: Arc<Access>,
    /// Who is connected.
    pub connections: Arc<Connections>,
    /// Random for each start.
    pub instance_id: String,
    /// Start of the server, nanoseconds of Unix time.
    pub start_time_ns: i64,
    /// Whether all maps are open; until then every call is refused.
    pub ready: AtomicBool,
    /// Turns true when the server shuts down.
    pub draining: watch::Receiver<bool>,
}

/// A stream of answers.
pub(super) type Answers<T> = ReceiverStream<Result<T, Status>>;

/// Where a stream's handler puts its messages.
#[derive(Debug)]
pub(super) struct Sink<T>(mpsc::Sender<Result<T, Status>>);

impl<T> Clone for Sink<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<T> Sink<T> {
    /// Sends a message, waiting while the reader is slow.
    ///
    /// # Errors
    /// [`ServiceError::Gone`] when there is no reader any more.
    pub(super) async fn send(&self, message: T) -> Result<(), ServiceError> {
        self.0.send(Ok(message)).await.map_err(|_closed| ServiceError::Gone)
    }

    async fn end(&self, error: ServiceError) {
        // A reader that left misses nothing.
        let _unread = self.0.send(Err(error.into())).await;
    }
}

impl Context {
    /// The ceilings that policies are held to.
    pub(super) fn ceilings(&self) -> ServerCeilings {
        let queued_items = self.config.engine.queue_capacity;
        ServerCeilings { map: self.config.ceilings, queued_items }
    }

    /// Resolves when the server drains.
    pub(super) async fn drained(&self) {
        let mut draining = self.draining.clone();
        // A dropped sender means that the server is gone altogether.
        let _closed = draining.wait_for(|&draining| draining).await;
    }

    /// Runs the handler of a unary call.
    pub(super) async fn answer<T>(
        &self,
        rpc: &'static str,
        handler: impl Future<Output = Result<T, ServiceError>>,
    ) -> Result<Response<T>, Status> {
        let result = self.guarded(rpc, handler).await;
        result.map(Response::new).map_err(Status::from)
    }

    /// Starts the handler of a streaming call. It ends early when the caller leaves, and when
    /// `time` has passed.
    pub(super) fn stream<T, H>(
        self: &Arc<Self>,
        rpc: &'static str,
        time: Option<Duration>,
        handler: impl FnOnce(Sink<T>) -> H,
    ) -> Result<Response<Answers<T>>, Status>
    where
        T: Send + 'static,
        H: Future<Output = Result<(), ServiceError>> + Send + 'static,
    {
        let (sender, receiver) = mpsc::channel(STREAM_QUEUE);
        let sink = Sink(sender);
        let handler = handler(sink.clone());
        let context = Arc::clone(self);
        let running = async move {
            let result = tokio::select! {
                biased;
                result = context.guarded(rpc, handler) => result,
                () = sink.0.closed() => Err(ServiceError::Gone),
                () = passed(time) => Err(ServiceError::DeadlineExceeded),
            };
            if let Err(error) = result {
                sink.end(error).await;
            }
        };
        tokio::spawn(running.in_current_span());
        Ok(Response::new(ReceiverStream::new(receiver)))
    }

    /// Refuses while maps are still opened, and catches a panic of the handler.
    async fn guarded<T>(
        &self,
        rpc: &'static str,
        handler: impl Future<Output = Result<T, ServiceError>>,
    ) -> Result<T, ServiceError> {
        if !self.ready.load(Ordering::Acquire) {
            return Err(ServiceError::Starting);
        }
        let faulty = self.config.test_fault.as_deref().and_then(|f| f.strip_prefix("rpc:"));
        let faulty = faulty.is_some_and(|name| name == rpc || name == "*");
        let handler = AssertUnwindSafe(async {
            assert!(!faulty, "the fault that a test asked for");
            handler.await
        });
        handler.catch_unwind().await.unwrap_or_else(|panic| {
            self.meters.rpc_panics.increment();
            let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
            let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
            let message = text.unwrap_or_else(|| "a panic without a message".to_owned());
            Err(ServiceError::Panicked { message: format!("{rpc}: {message}") })
        })
    }

    /// Runs work that takes a thread for a while (building files) beside the async threads.
    pub(super) async fn blocking<T: Send + 'static>(
        work: impl FnOnce() -> Result<T, ServiceError> + Send + 'static,
    ) -> Result<T, ServiceError> {
        match tokio::task::spawn_blocking(work).await {
            Ok(result) => result,
            Err(error) if error.is_panic() => {
                Err(ServiceError::Panicked { message: error.to_string() })
            }
            Err(_canceled) => Err(ServiceError::Engine(EngineError::ShuttingDown)),
        }
    }
}

/// Resolves after `time`, or never.
async fn passed(time: Option<Duration>) {
    match time {
        Some(time) => tokio::time::sleep(time).await,
        None => std::future::pending().await,
    }
}
