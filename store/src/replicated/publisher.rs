//! Publishes a map's events to its stream, in order, and reports how far the stream has acknowledged them.
//!
//! What waits is packed into one round of messages, as the embedded journal writes groups: what arrives
//! meanwhile is the next round. A message is put again until it is known to be there. Once another server
//! has taken the map over nothing more is published.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::task::AbortHandle;

use super::map_stream::{MapStream, PutError};
use super::message::{LENGTH, Outgoing, pack};
use crate::sync::Mutex;
use crate::{Flushed, StoreError};

/// Bytes of a round.
const ROUND: usize = 8 << 20;
/// Bytes that may wait; beyond that appends wait too.
pub(super) const MOST_PENDING: usize = 64 << 20;
/// Delay before a message is put again; it doubles each time.
const FIRST_RETRY: Duration = Duration::from_millis(50);
/// The longest time between two tries.
const LONGEST_RETRY: Duration = Duration::from_secs(1);

#[derive(Debug, Default)]
struct Queue {
    /// Encoded events by revision.
    events: VecDeque<(u64, Vec<u8>)>,
    bytes: usize,
    /// Which revision ends at which message of the stream, rising.
    index: VecDeque<(u64, u64)>,
}

/// The publisher of one map; dropping it ends it.
#[derive(Debug)]
pub(super) struct Publisher {
    shared: Arc<Shared>,
    task: AbortHandle,
}

#[derive(Debug)]
struct Shared {
    queue: Mutex<Queue>,
    arrived: Notify,
    /// How far the stream has acknowledged.
    progress: watch::Sender<Flushed>,
}

/// Where a publisher begins.
#[derive(Debug)]
pub(super) struct Begin {
    /// The sequence of the owner message, which is the stream's last one.
    pub(super) epoch: u64,
    /// The last revision that is in the stream.
    pub(super) through: u64,
    /// Which revision ends at which message.
    pub(super) index: Vec<(u64, u64)>,
    /// Bytes that a message may have.
    pub(super) most: usize,
}

impl Publisher {
    pub(super) fn start(map: String, stream: MapStream, begin: Begin) -> Self {
        let Begin { epoch, through, index, most } = begin;
        let queue = Mutex::new(Queue { index: index.into(), ..Queue::default() });
        let progress = watch::Sender::new(Flushed { through, ..Flushed::default() });
        let shared = Arc::new(Shared { queue, arrived: Notify::new(), progress });
        let publishing = Publishing { map, stream, epoch, last: epoch, most };
        let task = tokio::spawn(publishing.run(Arc::clone(&shared))).abort_handle();
        Self { shared, task }
    }

    /// Takes encoded events; returns the bytes that wait.
    pub(super) fn push(&self, events: impl IntoIterator<Item = (u64, Vec<u8>)>) -> usize {
        let mut queue = self.shared.queue.lock();
        for (revision, event) in events {
            queue.bytes += LENGTH + event.len();
            queue.events.push_back((revision, event));
        }
        let bytes = queue.bytes;
        drop(queue);
        self.shared.arrived.notify_one();
        bytes
    }

    /// Waits while too much is pending and the stream takes messages.
    pub(super) async fn wait_for_room(&self) {
        self.wait_for_at_most(MOST_PENDING, |progress| progress.trouble().is_some()).await;
    }

    /// Resolves when nothing waits, or nothing more is published.
    pub(super) async fn idle(&self) {
        self.wait_for_at_most(0, |progress| progress.failed.is_some()).await;
    }

    /// Waits until no more than so many bytes wait, or it `ends` before.
    async fn wait_for_at_most(&self, bytes: usize, ends: impl Fn(&Flushed) -> bool) {
        let queue = &self.shared.queue;
        let mut progress = self.progress();
        let _told = progress.wait_for(|told| ends(told) || queue.lock().bytes <= bytes).await;
    }

    pub(super) fn progress(&self) -> watch::Receiver<Flushed> {
        self.shared.progress.subscribe()
    }

    /// The first message that has an event from `revision` on, or that has none at all; `None` where
    /// that is not known.
    pub(super) fn message_of(&self, revision: u64) -> Option<u64> {
        let queue = self.shared.queue.lock();
        let before = queue.index.iter().rfind(|&&(last, _)| last < revision)?;
        Some(before.1 + 1)
    }

    /// Forgets where events are that were purged.
    pub(super) fn purged(&self, before: u64) {
        self.shared.queue.lock().index.retain(|&(_, message)| message >= before);
    }

    /// Publishes nothing more.
    pub(super) fn stop(&self) {
        self.task.abort();
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.stop();
    }
}

/// The state of the task.
struct Publishing {
    map: String,
    stream: MapStream,
    epoch: u64,
    /// The stream's last message.
    last: u64,
    most: usize,
}

impl Publishing {
    async fn run(mut self, shared: Arc<Shared>) {
        loop {
            let round = self.round(&shared).await;
            for message in round {
                if !self.put(&shared, &message).await {
                    return;
                }
            }
        }
    }

    /// Waits for events and packs them.
    async fn round(&self, shared: &Shared) -> Vec<Outgoing> {
        loop {
            let arrived = shared.arrived.notified();
            let events: Vec<_> = {
                let mut queue = shared.queue.lock();
                let mut bytes = 0;
                let mut taken = Vec::new();
                while bytes <= ROUND
                    && let Some((revision, event)) = queue.events.pop_front()
                {
                    bytes += event.len();
                    taken.push((revision, event));
                }
                taken
            };
            if !events.is_empty() {
                return pack(events.into_iter(), self.most);
            }
            arrived.await;
        }
    }

    /// Puts a message until it is known to be in the stream; false where nothing more will be.
    async fn put(&mut self, shared: &Shared, message: &Outgoing) -> bool {
        let mut delay = FIRST_RETRY;
        loop {
            match self.stream.put(self.last, self.epoch, message).await {
                Ok(sequence) => {
                    self.last = sequence;
                    let mut queue = shared.queue.lock();
                    queue.bytes = queue.bytes.saturating_sub(message.payload.len());
                    if message.is_whole() {
                        queue.index.push_back((message.last, sequence));
                    }
                    drop(queue);
                    self.tell(shared, message);
                    return true;
                }
                Err(PutError::Fenced) => {
                    let map = self.map.clone();
                    tracing::warn!(map, "another server took the map over");
                    let failed = Some(StoreError::OwnedElsewhere { map, owner: None });
                    shared.progress.send_modify(|progress| progress.failed = failed);
                    return false;
                }
                Err(PutError::Unknown { cause }) => {
                    let map = self.map.clone();
                    tracing::warn!(map, cause, "the stream did not answer, trying again");
                    let unavailable = Some(StoreError::Unavailable { map, cause });
                    shared.progress.send_modify(|progress| progress.unavailable = unavailable);
                    tokio::time::sleep(delay).await;
                    delay = (2 * delay).min(LONGEST_RETRY);
                }
            }
        }
    }

    /// A part of an event is no progress but the last one.
    fn tell(&self, shared: &Shared, message: &Outgoing) {
        shared.progress.send_modify(|progress| {
            progress.unavailable = None;
            if message.is_whole() {
                progress.through = progress.through.max(message.last);
            }
        });
    }
}
