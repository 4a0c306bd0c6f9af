//! An ingest session: what a frontend holds to send items, whatever happens to the link.
//!
//! [`IngestSession::send`] numbers an item, keeps it until the server has answered it and waits
//! while too many are unanswered: that is the back-pressure. With [`SessionOptions::spill`] a file
//! takes what memory does not, before sending waits. A task of its own (`stream`) moves the items,
//! reopens a broken stream under a higher epoch and sends the unanswered ones again, which is harmless
//! (docs/wire.md, "Resume and duplicates"). Dropping a session ends it at once; what was not answered
//! may then be missing on the server, or waits in the file for the next session. When a link is tried
//! again and when it is given up is decided by `retry`.

use std::fmt;
use std::sync::Arc;

use prost::Message;
use tokio::sync::{oneshot, watch};
use tokio::task::JoinHandle;

use super::outbox::Outbox;
use super::retry::{Retries, RetryPolicy};
use super::spill::{LeftOver, SpillOptions};
use super::stream::{self, Identity, Session, Shared};
use super::{Client, ClientError, NextIds};
use crate::wire::v1;

pub use v1::ingest_request::Item;

/// What a session sends, without naming the oneof: each kind of message is its item. A camera is one
/// that is new; [`Item::SetCamera`] replaces one.
macro_rules! items {
    ($($message:ident => $variant:ident,)*) => {
        $(
            impl From<v1::$message> for Item {
                fn from(message: v1::$message) -> Self {
                    Self::$variant(message)
                }
            }
        )*
    };
}

items! {
    Camera => Camera,
    Keyframe => Keyframe,
    LandmarkBatch => Landmarks,
    ObservationBatch => Observations,
    RelativePoseConstraint => RelativePose,
    PositionPrior => PositionPrior,
    PosePrior => PosePrior,
    RevokeConstraint => RevokeConstraint,
    RemoveObservations => RemoveObservations,
    FuseLandmarks => FuseLandmarks,
    RemoveLandmarks => RemoveLandmarks,
    RemoveKeyframe => RemoveKeyframe,
}

/// Refused items that a progress report keeps in full.
pub const KEPT_REJECTIONS: usize = 100;

/// Called with each ack, in order.
pub type OnAck = Box<dyn FnMut(&v1::IngestAck) + Send>;

/// How a session behaves.
pub struct SessionOptions {
    /// Items without an answer that memory holds; with more of them sending waits (64).
    pub max_unanswered: usize,
    /// Where further items go before sending waits (nowhere).
    pub spill: Option<SpillOptions>,
    /// Each solve finishes before the server takes the next item (no).
    pub lock_step: bool,
    /// Acks come without the certificates of solves (no).
    pub omit_solve_summary: bool,
    /// When to give a broken link up.
    pub retry: RetryPolicy,
    /// See [`SessionOptions::on_ack`] (none).
    pub on_ack: Option<OnAck>,
}

impl Default for SessionOptions {
    fn default() -> Self {
        Self {
            max_unanswered: 64,
            spill: None,
            lock_step: false,
            omit_solve_summary: false,
            retry: RetryPolicy::default(),
            on_ack: None,
        }
    }
}

impl SessionOptions {
    /// Calls `on_ack` with each ack as it comes, also the cumulative ones, and with an OPTIMIZED of
    /// its own where a reopened stream says that a broken one lost it. It runs in the session's task
    /// and must not block.
    #[must_use]
    pub fn on_ack(mut self, on_ack: impl FnMut(&v1::IngestAck) + Send + 'static) -> Self {
        self.on_ack = Some(Box::new(on_ack));
        self
    }
}

impl fmt::Debug for SessionOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SessionOptions")
            .field("max_unanswered", &self.max_unanswered)
            .field("spill", &self.spill)
            .field("lock_step", &self.lock_step)
            .field("omit_solve_summary", &self.omit_solve_summary)
            .field("retry", &self.retry)
            .finish_non_exhaustive()
    }
}

/// An item that the server refused for good.
#[derive(Clone, Debug, PartialEq)]
pub struct RejectedItem {
    /// Its sequence.
    pub sequence: i64,
    /// The fields that are wrong; at least one.
    pub violations: Vec<v1::ItemViolation>,
}

/// How far a session has come.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IngestReport {
    /// Items that [`IngestSession::send`] took, and those that an earlier session left.
    pub sent: u64,
    /// Items that the server took.
    pub acknowledged: u64,
    /// Those of them that it had already.
    pub duplicates: u64,
    /// Items that it refused.
    pub rejected: u64,
    /// The first [`KEPT_REJECTIONS`] of them.
    pub rejections: Vec<RejectedItem>,
    /// OPTIMIZED acks; one may cover several items.
    pub optimized: u64,
    /// The last sequence that solves have covered; 0 before the first.
    pub optimized_through: i64,
    /// OPTIMIZED acks that told of a problem that cannot be solved as posed.
    pub failed_solves: u64,
    /// The highest revision of the map that an ack named.
    pub revision: i64,
    /// Streams opened after the first: how often the link broke.
    pub reconnects: u64,
}

impl IngestReport {
    /// Items without an answer.
    pub fn unanswered(&self) -> u64 {
        self.sent.saturating_sub(self.acknowledged + self.rejected)
    }
}

/// What the session's task tells its handle.
#[derive(Clone, Debug, Default)]
pub(super) struct State {
    pub(super) report: IngestReport,
    /// Sequences of all refused items, rising.
    pub(super) rejected: Vec<i64>,
    /// Why the session ended, where it failed.
    pub(super) failure: Option<ClientError>,
    /// Whether every ack is there and the stream has ended.
    pub(super) is_done: bool,
}

/// An open session of one client on one map.
#[derive(Debug)]
pub struct IngestSession {
    opened: v1::IngestOpened,
    left_over: Option<LeftOver>,
    /// Items handed over.
    sent: u64,
    /// The highest sequence of them; 0 before the first.
    last_sequence: i64,
    next_ids: NextIds,
    client: Client,
    map_id: String,
    shared: Arc<Shared>,
    state: watch::Receiver<State>,
    task: JoinHandle<()>,
}

impl IngestSession {
    /// Opens the stream; see [`Client::ingest`].
    pub(super) async fn open(
        client: &Client,
        map_id: &str,
        client_id: &str,
        options: SessionOptions,
    ) -> Result<Self, ClientError> {
        let shared = Arc::new(Shared::new(Outbox::new(options.max_unanswered)));
        let (publish, state) = watch::channel(State::default());
        let (opened_sender, opened) = oneshot::channel();
        let identity = Identity {
            map_id: map_id.to_owned(),
            client_id: client_id.to_owned(),
            options: v1::IngestOptions {
                lock_step: options.lock_step,
                omit_solve_summary: options.omit_solve_summary,
            },
        };
        let session = Session {
            client: client.apart(),
            identity,
            retries: Retries::new(options.retry),
            shared: Arc::clone(&shared),
            spill: options.spill,
            on_ack: options.on_ack,
            publish,
            first: None,
            instance_id: None,
            epoch: 0,
        };
        let task = tokio::spawn(stream::run(session, opened_sender));
        let (opened, left_over) = opened.await.map_err(|_ended| ClientError::Closed)??;
        let left = left_over.as_ref();
        let sent = left.map_or(0, |left| left.items);
        let last_sequence = left.map_or(0, |left| left.last_sequence);
        let mut next_ids = left.map_or_else(NextIds::default, |left| left.next_ids);
        let (keyframe, landmark) = (opened.next_keyframe_id, opened.next_landmark_id);
        next_ids.join(NextIds { keyframe, landmark });
        let (client, map_id) = (client.clone(), map_id.to_owned());
        Ok(Self {
            opened,
            left_over,
            sent,
            last_sequence,
            next_ids,
            client,
            map_id,
            shared,
            state,
            task,
        })
    }

    /// The server's answer to the first opening: limits, durability, where it goes on.
    pub fn opened(&self) -> &v1::IngestOpened {
        &self.opened
    }

    /// What an earlier session left in the spill file; it is being sent.
    pub fn left_over(&self) -> Option<&LeftOver> {
        self.left_over.as_ref()
    }

    /// The sequence that [`IngestSession::send`] gives next.
    pub fn next_sequence(&self) -> i64 {
        self.opened.next_sequence.max(self.last_sequence + 1)
    }

    /// A keyframe id that is free: above those of this client's keyframes that the map holds, that an earlier
    /// session left and that this one has sent. A frontend that starts again under its name counts on from
    /// here. An earlier server does not report what the map holds.
    pub fn next_keyframe_id(&self) -> i64 {
        self.next_ids.keyframe
    }

    /// As [`IngestSession::next_keyframe_id`], for landmarks.
    pub fn next_landmark_id(&self) -> i64 {
        self.next_ids.landmark
    }

    /// Sends an item and returns its sequence; waits while too many items are unanswered and there
    /// is no room for them in a spill file.
    /// Canceling it before it returns sends nothing.
    ///
    /// # Errors
    /// [`ClientError::TooLarge`], after which the session goes on; else why the session ended.
    pub async fn send(&mut self, item: impl Into<Item>) -> Result<i64, ClientError> {
        self.send_as(self.next_sequence(), item).await
    }

    /// As [`IngestSession::send`], for callers that must not wait: `None` where there is no room, and
    /// the item is not sent.
    ///
    /// # Errors
    /// As [`IngestSession::send`].
    pub fn try_send(&mut self, item: impl Into<Item>) -> Result<Option<i64>, ClientError> {
        let sequence = self.next_sequence();
        let request = self.request(sequence, item.into())?;
        if self.state.borrow().failure.is_some() {
            return Err(self.failure());
        }
        let refused = self.shared.outbox().push(request).is_some();
        Ok((!refused).then(|| self.pushed(sequence)))
    }

    /// As [`IngestSession::send`] with a sequence of the caller's choice, above all before on this
    /// session. One below [`IngestSession::next_sequence`] of a fresh session sends an item again
    /// that an earlier session may have sent: the server compares the two.
    ///
    /// # Errors
    /// [`ClientError::SequenceOrder`] as well.
    pub async fn send_as(
        &mut self,
        sequence: i64,
        item: impl Into<Item>,
    ) -> Result<i64, ClientError> {
        if sequence <= self.last_sequence {
            return Err(ClientError::SequenceOrder { sequence, last: self.last_sequence });
        }
        let mut request = self.request(sequence, item.into())?;
        loop {
            if self.state.borrow().failure.is_some() {
                return Err(self.failure());
            }
            let pushed = self.shared.outbox().push(request);
            let Some(refused) = pushed else { break };
            request = refused;
            let has_ended = tokio::select! {
                biased;
                () = self.shared.left.notified() => false,
                _ended = self.state.wait_for(|state| state.failure.is_some()) => true,
            };
            if has_ended {
                return Err(self.failure());
            }
        }
        Ok(self.pushed(sequence))
    }

    /// The message of an item that is not too large, whose ids are taken from here on.
    fn request(&mut self, sequence: i64, item: Item) -> Result<v1::IngestRequest, ClientError> {
        let request = v1::IngestRequest { sequence, item: Some(item) };
        let bytes = request.encoded_len();
        let limit = usize::try_from(self.opened.max_message_bytes).unwrap_or(usize::MAX);
        if bytes > limit {
            return Err(ClientError::TooLarge { bytes, limit });
        }
        self.next_ids.take(request.item.as_ref());
        Ok(request)
    }

    /// Counts an item that the outbox took.
    fn pushed(&mut self, sequence: i64) -> i64 {
        self.shared.arrived.notify_one();
        (self.sent, self.last_sequence) = (self.sent + 1, sequence);
        sequence
    }

    /// How far the session has come.
    pub fn report(&self) -> IngestReport {
        IngestReport { sent: self.sent, ..self.state.borrow().report.clone() }
    }

    /// Waits until every item sent so far is answered.
    ///
    /// # Errors
    /// Why the session ended.
    pub async fn flush(&mut self) -> Result<(), ClientError> {
        let sent = self.sent;
        self.wait(move |state| state.report.acknowledged + state.report.rejected >= sent).await
    }

    /// Waits until solves have covered everything up to `sequence`. Only keyframes, observations, loop
    /// closures, priors and edits are answered with OPTIMIZED: waiting for another item waits for the
    /// next of those.
    ///
    /// # Errors
    /// [`ClientError::Rejected`] where the item was refused; else why the session ended.
    pub async fn optimized(&mut self, sequence: i64) -> Result<(), ClientError> {
        let is_rejected = |state: &State| state.rejected.binary_search(&sequence).is_ok();
        let is_met = |state: &State| state.report.optimized_through >= sequence;
        self.wait(|state| is_met(state) || is_rejected(state)).await?;
        let state = self.state.borrow();
        if !is_rejected(&state) {
            return Ok(());
        }
        let kept = state.report.rejections.iter().find(|item| item.sequence == sequence);
        let violations = kept.map(|item| item.violations.clone()).unwrap_or_default();
        Err(ClientError::Rejected { sequence, violations })
    }

    /// Waits until every item sent so far is answered and the map is settled: see
    /// [`Client::wait_settled`].
    ///
    /// # Errors
    /// Why the session ended; as [`Client::wait_settled`].
    pub async fn wait_settled(&mut self) -> Result<(), ClientError> {
        self.flush().await?;
        self.client.wait_settled(&self.map_id).await
    }

    /// Half-closes the stream, waits for all acks, those of pending solves too, and reports.
    ///
    /// # Errors
    /// Why the session ended before that.
    pub async fn finish(mut self) -> Result<IngestReport, ClientError> {
        self.shared.outbox().close();
        self.shared.arrived.notify_one();
        self.wait(|state| state.is_done).await?;
        Ok(self.report())
    }

    async fn wait(&mut self, is_met: impl Fn(&State) -> bool) -> Result<(), ClientError> {
        let waited = self.state.wait_for(|s| is_met(s) || s.failure.is_some()).await;
        let met = waited.is_ok_and(|state| is_met(&state));
        if met { Ok(()) } else { Err(self.failure()) }
    }

    /// Why the session ended.
    fn failure(&self) -> ClientError {
        self.state.borrow().failure.clone().unwrap_or(ClientError::Closed)
    }
}

impl Drop for IngestSession {
    fn drop(&mut self) {
        self.task.abort();
        self.shared.outbox().leave();
    }
}
