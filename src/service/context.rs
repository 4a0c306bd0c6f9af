//! State that all services share: the maps, the settings, and the code that answers with a
//! handler's outcome.
//!
//! [`Context::answer`] and [`Context::stream`] run handlers: an error becomes a status, a panic
//! becomes INTERNAL instead of a broken connection, a stream ends when its caller leaves, its
//! deadline passes or the server drains. Handlers use no other transport types.

use std::future::Future;
use std::panic::AssertUnwindSafe;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{self, Poll, ready};
use std::time::Duration;

use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use tokio::sync::{mpsc, oneshot, watch};
use tokio_stream::Stream;
use tonic::{Response, Status};
use tracing::Instrument;

use super::access::Access;
use super::config::ServerConfig;
use super::connections::Connections;
use super::convert::map::{ServerLimits, to_map};
use super::engine::{EngineError, MapInfo, Maps, panic_message};
use super::error::ServiceError;
use super::readers::Readers;
use super::telemetry::ServerMeters;
use crate::wire::v1;

/// Most small messages that wait for a slow reader of a stream.
const STREAM_QUEUE: usize = 8;
/// Most large messages that wait: the next one is made while the reader takes this one.
const LARGE_QUEUE: usize = 1;
/// How long a large message waits for its reader. Then the stream ends, so that its snapshot of a
/// map is released.
const LONGEST_UNREAD: Duration = Duration::from_secs(120);

/// State that all services share.
#[derive(Debug)]
pub(super) struct Context {
    /// All maps.
    pub maps: Maps,
    /// The settings.
    pub config: ServerConfig,
    /// Meters besides those of the engines.
    pub meters: ServerMeters,
    /// Who may call what.
    pub access: Arc<Access>,
    /// Who is connected.
    pub connections: Arc<Connections>,
    /// Random at each start.
    pub instance_id: String,
    /// Start of the server, nanoseconds of Unix time.
    pub start_time_ns: i64,
    /// Whether all maps are open; until then every call is refused.
    pub ready: AtomicBool,
    /// Becomes true when the server shuts down.
    pub draining: watch::Receiver<bool>,
    /// Threads for streams that read maps.
    pub readers: Readers,
}

/// The services of the wire but that of jobs: the files `*_service` have one each.
#[derive(Clone, Debug)]
pub(super) struct Rpcs {
    pub(super) context: Arc<Context>,
}

/// A stream of answers.
#[derive(Debug)]
pub(super) struct Answers<T> {
    messages: mpsc::Receiver<T>,
    /// Why it ends early. The error does not wait in the queue, so that an unread stream holds
    /// nothing else.
    end: Option<oneshot::Receiver<Status>>,
}

impl<T> Stream for Answers<T> {
    type Item = Result<T, Status>;

    fn poll_next(
        mut self: Pin<&mut Self>,
        cx: &mut task::Context<'_>,
    ) -> Poll<Option<Result<T, Status>>> {
        if let Some(message) = ready!(self.messages.poll_recv(cx)) {
            return Poll::Ready(Some(Ok(message)));
        }
        let Some(end) = &mut self.end else { return Poll::Ready(None) };
        let status = ready!(Pin::new(end).poll(cx));
        self.end = None;
        Poll::Ready(status.ok().map(Err))
    }
}

/// How large the messages of a stream are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Messages {
    /// Acks and progress.
    Small,
    /// Parts of a map.
    Large,
}

/// Where a stream's handler puts its messages.
#[derive(Debug)]
pub(super) struct Sink<T> {
    messages: mpsc::Sender<T>,
    /// How long a message may wait for its reader.
    longest_unread: Option<Duration>,
}

impl<T> Clone for Sink<T> {
    fn clone(&self) -> Self {
        Self { messages: self.messages.clone(), longest_unread: self.longest_unread }
    }
}

impl<T> Sink<T> {
    /// Sends a message, waiting while the reader is slow.
    ///
    /// # Errors
    /// As [`Sink::room`].
    pub(super) async fn send(&self, message: T) -> Result<(), ServiceError> {
        self.room().await?.send(message);
        Ok(())
    }

    /// Waits until there is room for a message, so that the message can be made afterwards.
    ///
    /// # Errors
    /// [`ServiceError::Gone`] when the reader is gone, [`ServiceError::Unread`] when it has read
    /// nothing for too long.
    pub(super) async fn room(&self) -> Result<mpsc::Permit<'_, T>, ServiceError> {
        let room = self.messages.reserve();
        let room = match self.longest_unread {
            None => room.await,
            Some(longest) => tokio::time::timeout(longest, room)
                .await
                .map_err(|_elapsed| ServiceError::Unread { seconds: longest.as_secs() })?,
        };
        room.map_err(|_closed| ServiceError::Gone)
    }
}

impl Context {
    /// The limits that policies must not exceed.
    pub(super) fn limits(&self) -> ServerLimits {
        let queued_items = self.config.engine.queue_capacity;
        ServerLimits { map: self.config.map_limits, queued_items }
    }

    /// Resolves when the server drains.
    pub(super) async fn drained(&self) {
        let mut draining = self.draining.clone();
        // A dropped sender means that the server has ended.
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

    /// Starts the handler of a streaming call. It ends early when the caller leaves, and when `time`
    /// has passed. A handler with large messages reads a map: it runs on the threads of readers, and
    /// also ends when nobody reads its messages.
    pub(super) fn stream<T, H>(
        self: &Arc<Self>,
        rpc: &'static str,
        time: Option<Duration>,
        size: Messages,
        handler: impl FnOnce(Sink<T>) -> H,
    ) -> Result<Response<Answers<T>>, Status>
    where
        T: Send + 'static,
        H: Future<Output = Result<(), ServiceError>> + Send + 'static,
    {
        let (queue, longest_unread) = match size {
            Messages::Small => (STREAM_QUEUE, None),
            Messages::Large => (LARGE_QUEUE, Some(LONGEST_UNREAD)),
        };
        let (sender, messages) = mpsc::channel(queue);
        let sink = Sink { messages: sender, longest_unread };
        let (end, ended) = oneshot::channel();
        let handler = handler(sink.clone());
        let context = Arc::clone(self);
        let running = async move {
            let result = tokio::select! {
                biased;
                result = context.guarded(rpc, handler) => result,
                () = sink.messages.closed() => Err(ServiceError::Gone),
                () = passed(time) => Err(ServiceError::DeadlineExceeded),
            };
            if let Err(error) = result {
                // A reader that left needs no reason.
                let _unread = end.send(error.into());
            }
        };
        // Boxed, because the runtime's code is compiled for each kind of task.
        let running: BoxFuture<'static, ()> = running.in_current_span().boxed();
        match size {
            Messages::Small => drop(tokio::spawn(running)),
            Messages::Large => self.readers.spawn(running),
        }
        Ok(Response::new(Answers { messages, end: Some(ended) }))
    }

    /// Refuses calls while maps are still being opened, and catches a panic of the handler.
    async fn guarded<T>(
        &self,
        rpc: &'static str,
        handler: impl Future<Output = Result<T, ServiceError>>,
    ) -> Result<T, ServiceError> {
        if !self.ready.load(Ordering::Acquire) {
            return Err(ServiceError::Starting);
        }
        let faulty = self.config.panics_in_rpc(rpc);
        let handler = AssertUnwindSafe(async {
            assert!(!faulty, "the fault that a test asked for");
            handler.await
        });
        handler.catch_unwind().await.unwrap_or_else(|panic| {
            self.meters.rpc_panics.increment();
            let message = panic_message(panic.as_ref());
            Err(ServiceError::Panicked { message: format!("{rpc}: {message}") })
        })
    }

    /// Runs work that blocks its thread for a while (building files) outside the async threads.
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

    /// The message of a map.
    ///
    /// # Errors
    /// [`ServiceError`] where the server ends.
    pub(super) async fn map_message(&self, info: MapInfo) -> Result<v1::Map, ServiceError> {
        let queued = self.config.engine.queue_capacity;
        Self::blocking(move || Ok(to_map(&info, queued))).await
    }
}

/// Resolves after `time`, or never.
async fn passed(time: Option<Duration>) {
    match time {
        Some(time) => tokio::time::sleep(time).await,
        None => std::future::pending().await,
    }
}

#[cfg(test)]
mod tests {
    use tokio_stream::StreamExt;

    use super::*;

    #[tokio::test]
    async fn a_stream_that_nobody_reads_ends_and_says_why() {
        let (messages, receiver) = mpsc::channel(LARGE_QUEUE);
        let sink = Sink { messages, longest_unread: Some(Duration::ZERO) };
        let (end, ended) = oneshot::channel();
        let mut answers = Answers { messages: receiver, end: Some(ended) };
        sink.send(1).await.unwrap();
        let unread = sink.send(2).await.unwrap_err();
        assert_eq!(unread, ServiceError::Unread { seconds: 0 });
        // A reader that takes a message in time gets the next one.
        assert_eq!(answers.next().await.unwrap().unwrap(), 1);
        sink.send(3).await.unwrap();
        // The end does not wait for a reader, and arrives after the messages that were sent.
        end.send(unread.into()).unwrap();
        drop(sink);
        assert_eq!(answers.next().await.unwrap().unwrap(), 3);
        let status = answers.next().await.unwrap().unwrap_err();
        assert_eq!(status.code(), tonic::Code::ResourceExhausted);
        assert!(answers.next().await.is_none());
    }
}
