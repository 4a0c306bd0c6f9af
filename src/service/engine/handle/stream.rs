//! The caller's side of an ingest stream: items in, events out.
//!
//! Sending waits while the engine's queue is full or the events are not read: that is the back-pressure. Items
//! keep the caller's order; the edge checks that sequences increase.

use std::time::Instant;

use tokio::sync::{mpsc, watch};
use tracing::Span;

use crate::map::{ClientIndex, Digest, Item, PartialItem, Rejection};
use crate::service::engine::events::{Body, Permit, Queued, QueuedItem, may_start_solve};
use crate::service::engine::ingest::OpenedStream;
use crate::service::engine::{EngineError, MapHandle, Opened, StreamEvent};

/// An open ingest stream.
#[derive(Debug)]
pub struct IngestStream {
    /// The state from which it starts.
    pub opened: Opened,
    sender: ItemSender,
    events: mpsc::Receiver<StreamEvent>,
}

impl IngestStream {
    /// A stream of the map of `handle`.
    pub(crate) fn new(handle: MapHandle, opened: OpenedStream) -> Self {
        let OpenedStream { opened, sender: events_sender, events, ended } = opened;
        let Opened { client, epoch, .. } = opened;
        let sender =
            ItemSender { handle, client, epoch, events: events_sender, ended, finished: false };
        Self { opened, sender, events }
    }

    /// The two halves. The receiver ends after [`StreamEvent::End`], or after
    /// [`ItemSender::finish`] once every ack was sent.
    #[must_use]
    pub fn split(self) -> (ItemSender, mpsc::Receiver<StreamEvent>) {
        (self.sender, self.events)
    }
}

/// Sends the items of one stream. Dropping it finishes the stream.
#[derive(Debug)]
pub struct ItemSender {
    handle: MapHandle,
    client: ClientIndex,
    epoch: i64,
    events: mpsc::Sender<StreamEvent>,
    ended: watch::Receiver<Option<EngineError>>,
    finished: bool,
}

impl ItemSender {
    /// Queues an item; its acks are events of the stream. `digest` is computed from the item as
    /// received.
    ///
    /// # Errors
    /// Why the stream has ended; [`EngineError::Cancelled`] when the receiver of its events was
    /// dropped.
    pub async fn send(&self, sequence: i64, digest: Digest, item: Item) -> Result<(), EngineError> {
        let arrived = Instant::now();
        let permit = || self.permit(sequence, arrived);
        let receipt = permit().await?;
        let durable = if self.handle.shared.is_durable() { Some(permit().await?) } else { None };
        let optimized = if may_start_solve(&item) { Some(permit().await?) } else { None };
        let item = QueuedItem { sequence, digest, item, receipt, durable, optimized };
        self.queue(Body::Item(Box::new(item))).await
    }

    /// Queues the rejection of an item that could not be converted, so that its ack keeps its
    /// place. The readable part of the item is checked against the map, so that all violations are
    /// reported at once.
    ///
    /// # Errors
    /// As [`ItemSender::send`].
    pub async fn reject(
        &self,
        sequence: i64,
        rejection: Rejection,
        partial: Option<Box<PartialItem>>,
    ) -> Result<(), EngineError> {
        let receipt = self.permit(sequence, Instant::now()).await?;
        self.queue(Body::Rejected { sequence, rejection, partial, receipt }).await
    }

    /// Half-closes the stream: the outstanding acks are sent, including those of solves, then the
    /// events end.
    pub async fn finish(mut self) {
        self.finished = true;
        // A stream that has already ended has reported the reason.
        let _ended = self.queue(Body::Finish).await;
    }

    async fn queue(&self, body: Body) -> Result<(), EngineError> {
        let span = Span::current();
        let queued = Queued { client: self.client, epoch: self.epoch, span, body };
        tokio::select! {
            biased;
            error = self.end() => Err(error),
            sent = self.handle.items.send(queued) => sent.map_err(|_closed| self.handle.end_error()),
        }
    }

    async fn permit(&self, sequence: i64, arrived: Instant) -> Result<Permit, EngineError> {
        tokio::select! {
            biased;
            error = self.end() => Err(error),
            permit = self.events.clone().reserve_owned() => {
                let gone = |_closed| EngineError::Cancelled { map: self.handle.name().to_owned() };
                let meters = &self.handle.shared.meters;
                permit.map_err(gone).map(|room| Permit::new(room, meters, sequence, arrived))
            }
        }
    }

    /// Resolves when the stream has ended.
    async fn end(&self) -> EngineError {
        let mut ended = self.ended.clone();
        let error = ended.wait_for(Option::is_some).await.ok().and_then(|error| error.clone());
        error.unwrap_or_else(|| self.handle.end_error())
    }
}

impl Drop for ItemSender {
    fn drop(&mut self) {
        if self.finished {
            return;
        }
        let (client, epoch, span) = (self.client, self.epoch, Span::none());
        let finish = Queued { client, epoch, span, body: Body::Finish };
        if let Err(mpsc::error::TrySendError::Full(finish)) = self.handle.items.try_send(finish)
            && let Ok(runtime) = tokio::runtime::Handle::try_current()
        {
            let queue = self.handle.items.clone();
            runtime.spawn(async move {
                // A closed queue has no streams left to finish.
                let _closed = queue.send(finish).await;
            });
        }
    }
}
