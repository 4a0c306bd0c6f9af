//! The task behind a session: one stream after the other until every item is answered.
//!
//! On each stream: open with an epoch above the last one, send what is unanswered, then what comes,
//! and take acks. A stream that breaks is followed by the next (`retry`); a fenced one, a replaced
//! map or a server that lost what it had acknowledged ends the session with the reason. Which items are
//! unanswered is known to `outbox` alone.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::{Notify, mpsc, oneshot, watch};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Streaming};

use super::ingest::{KEPT_REJECTIONS, OnAck, RejectedItem, State};
use super::outbox::{Answer, Outbox};
use super::retry::Retries;
use super::spill::{LeftOver, Spill, SpillOptions};
use super::{Client, ClientError};
use crate::wire::v1;
use v1::ingest_request::Item;
use v1::ingest_response::Event;

const RPC: &str = "Ingest";

/// Messages between this task and the transport; the transport has buffers of its own.
const IN_FLIGHT: usize = 1;

/// What the handle and the task of a session share. The lock is held for moments only, a write to
/// the spill file among them, and never across an await.
#[derive(Debug)]
pub(super) struct Shared {
    outbox: Mutex<Outbox>,
    /// Something was pushed, or the outbox was closed.
    pub(super) arrived: Notify,
    /// Something left: there may be room.
    pub(super) left: Notify,
}

impl Shared {
    /// With an empty outbox.
    pub(super) fn new(outbox: Outbox) -> Self {
        Self { outbox: Mutex::new(outbox), arrived: Notify::new(), left: Notify::new() }
    }

    /// The outbox.
    pub(super) fn outbox(&self) -> MutexGuard<'_, Outbox> {
        self.outbox.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whose stream it is.
pub(super) struct Identity {
    pub(super) map_id: String,
    pub(super) client_id: String,
    pub(super) options: v1::IngestOptions,
}

/// The task's state over all its streams.
pub(super) struct Session {
    pub(super) client: Client,
    pub(super) identity: Identity,
    pub(super) retries: Retries,
    pub(super) shared: Arc<Shared>,
    /// Where items go that do not fit memory; opened with the first stream.
    pub(super) spill: Option<SpillOptions>,
    pub(super) on_ack: Option<OnAck>,
    pub(super) publish: watch::Sender<State>,
    /// The answer to the first opening.
    pub(super) first: Option<v1::IngestOpened>,
    /// The server's process at the first opening.
    pub(super) instance_id: Option<String>,
    /// The highest epoch that was asked for or answered.
    pub(super) epoch: i64,
}

/// The answer to the first opening, and what an earlier session left.
pub(super) type FirstOpened = (v1::IngestOpened, Option<LeftOver>);

/// Runs streams until the session is done or fails.
pub(super) async fn run(
    mut session: Session,
    opened: oneshot::Sender<Result<FirstOpened, ClientError>>,
) {
    let mut opened = Some(opened);
    loop {
        let error = match session.stream(&mut opened).await {
            Ok(()) => {
                session.publish.send_modify(|state| state.is_done = true);
                return;
            }
            Err(error) => session.explain(error).await,
        };
        session.client.servers.follow(&error);
        if let Err(error) = session.retries.wait(error).await {
            session.publish.send_modify(|state| state.failure = Some(error.clone()));
            if let Some(opened) = opened.take() {
                // The caller may have stopped waiting.
                let _ = opened.send(Err(error));
            }
            return;
        }
    }
}

type Opened = Option<oneshot::Sender<Result<FirstOpened, ClientError>>>;

impl Session {
    /// One stream from opening to its end; `Ok` once everything is answered.
    async fn stream(&mut self, opened: &mut Opened) -> Result<(), ClientError> {
        if self.instance_id.is_none() {
            self.instance_id = Some(self.client.server_info().await?.instance_id);
        }
        let (outbound, mut inbound) = self.open().await?;
        let first = inbound.message().await.map_err(ClientError::rpc(RPC))?;
        let Some(v1::IngestResponse { event: Some(Event::Opened(answer)) }) = first else {
            return Err(protocol("the stream did not begin with opened"));
        };
        self.check_resumed(&answer)?;
        self.retries.opened();
        self.epoch = self.epoch.max(answer.epoch);
        self.shared.outbox().rewind(answer.durability() != v1::Durability::InMemory);
        if self.first.is_some() {
            self.publish.send_modify(|state| state.report.reconnects += 1);
            self.catch_up(&answer)?;
        } else {
            let left = self.attach(&answer.map_uid)?;
            self.first = Some(answer.clone());
            if let Some(opened) = opened.take() {
                // A caller that went away aborts this task.
                let _ = opened.send(Ok((answer, left)));
            }
        }
        self.exchange(outbound, inbound).await
    }

    async fn open(
        &mut self,
    ) -> Result<(mpsc::Sender<v1::IngestRequest>, Streaming<v1::IngestResponse>), ClientError> {
        // The first stream takes the server's next epoch; a later one must be above its own
        // predecessor, and not above that of another process that took over meanwhile.
        let epoch = if self.first.is_some() { self.epoch + 1 } else { 0 };
        let open = v1::IngestOpen {
            map_id: self.identity.map_id.clone(),
            client_id: self.identity.client_id.clone(),
            epoch,
            options: Some(self.identity.options),
        };
        let (outbound, requests) = mpsc::channel(IN_FLIGHT);
        let open = v1::IngestRequest { sequence: 0, item: Some(Item::Open(open)) };
        let sent = outbound.try_send(open);
        sent.map_err(|_full| protocol("the stream takes no message"))?;
        let mut service = self.client.ingest_service();
        let answer = service.ingest(ReceiverStream::new(requests)).await;
        // Whether or not the server saw it: this epoch is spent.
        self.epoch = self.epoch.max(epoch);
        Ok((outbound, super::calls::answer(RPC, answer)?))
    }

    /// Takes the OPTIMIZED ack that the broken link may have lost: nobody sends it again.
    fn catch_up(&mut self, answer: &v1::IngestOpened) -> Result<(), ClientError> {
        let through = self.publish.borrow().report.optimized_through;
        let (sequence, revision) = (answer.optimized_sequence, answer.revision);
        if sequence <= through {
            return Ok(());
        }
        let status = v1::AckStatus::Optimized.into();
        self.take(&v1::IngestAck { sequence, status, revision, ..v1::IngestAck::default() })
    }

    /// Opens the spill file, now that the map is known.
    fn attach(&mut self, map_uid: &str) -> Result<Option<LeftOver>, ClientError> {
        let Some(options) = &self.spill else { return Ok(None) };
        let Identity { map_id, client_id, .. } = &self.identity;
        let (spill, left) = Spill::open(options, map_id, client_id, map_uid)?;
        self.shared.outbox().attach(spill)?;
        Ok(left)
    }

    /// Sees whether the server still has what it acknowledged.
    fn check_resumed(&self, answer: &v1::IngestOpened) -> Result<(), ClientError> {
        let Some(first) = &self.first else { return Ok(()) };
        if answer.map_uid != first.map_uid {
            return Err(ClientError::MapReplaced {
                map_id: self.identity.map_id.clone(),
                expected: first.map_uid.clone(),
                uid: answer.map_uid.clone(),
            });
        }
        let (next_sequence, acknowledged) = (answer.next_sequence, self.shared.outbox().released());
        if next_sequence <= acknowledged {
            return Err(ClientError::ItemsLost { next_sequence, acknowledged });
        }
        Ok(())
    }

    /// Sends items and takes acks until the stream ends.
    async fn exchange(
        &mut self,
        outbound: mpsc::Sender<v1::IngestRequest>,
        mut inbound: Streaming<v1::IngestResponse>,
    ) -> Result<(), ClientError> {
        let mut outbound = Some(outbound);
        loop {
            let (has_unsent, is_closing, is_sent) = {
                let outbox = self.shared.outbox();
                (outbox.has_unsent(), outbox.is_closing(), outbox.is_sent())
            };
            if is_closing && is_sent {
                // Half-closes; the server then answers what is outstanding and ends the stream.
                outbound = None;
            }
            tokio::select! {
                // Acks first: they make room.
                biased;
                message = inbound.message() => match message.map_err(ClientError::rpc(RPC))? {
                    Some(v1::IngestResponse { event: Some(Event::Ack(ack)) }) => self.take(&ack)?,
                    Some(v1::IngestResponse { event: Some(Event::Opened(_)) }) => {
                        return Err(protocol("the stream was opened twice"));
                    }
                    // A kind of event that this client does not know.
                    Some(v1::IngestResponse { event: None }) => {}
                    None if self.is_complete() => return Ok(()),
                    None => return Err(broken("the stream ended early")),
                },
                sent = send_next(outbound.as_ref(), &self.shared),
                    if has_unsent && outbound.is_some() =>
                {
                    if !sent {
                        // The transport takes no more: late acks and the reason come inbound.
                        outbound = None;
                    }
                }
                () = self.shared.arrived.notified(), if !has_unsent && !is_closing => {}
            }
        }
    }

    /// Whether everything was sent, half-closed and answered.
    fn is_complete(&self) -> bool {
        let outbox = self.shared.outbox();
        outbox.is_closing() && outbox.is_answered()
    }

    /// Takes an ack.
    fn take(&mut self, ack: &v1::IngestAck) -> Result<(), ClientError> {
        let answer = {
            let mut outbox = self.shared.outbox();
            let answer = match ack.status() {
                v1::AckStatus::Received => outbox.received(ack.sequence),
                v1::AckStatus::Rejected => outbox.rejected(ack.sequence),
                v1::AckStatus::Durable => {
                    outbox.durable(ack.sequence);
                    Answer::First
                }
                v1::AckStatus::Optimized => Answer::First,
                // A status that this client does not know.
                v1::AckStatus::Unspecified => return Ok(()),
            };
            outbox.refill()?;
            answer
        };
        self.shared.left.notify_one();
        if answer == Answer::Unknown {
            return Err(protocol("an ack names an item that was not sent"));
        }
        self.retries.progress();
        if answer == Answer::First {
            self.publish.send_modify(|state| count(state, ack));
        }
        if let Some(on_ack) = &mut self.on_ack {
            on_ack(ack);
        }
        Ok(())
    }

    /// Tells a fenced stream and a restarted server from other ends.
    async fn explain(&mut self, error: ClientError) -> ClientError {
        let (map_id, client_id) = (self.identity.map_id.clone(), self.identity.client_id.clone());
        match error.code() {
            Some(Code::Aborted) => ClientError::Fenced { map_id, client_id },
            Some(Code::NotFound) if self.first.is_some() => {
                let Ok(info) = self.client.server_info().await else { return error };
                if Some(&info.instance_id) == self.instance_id.as_ref() {
                    return error;
                }
                ClientError::ServerRestarted { map_id, instance_id: info.instance_id }
            }
            _ => error,
        }
    }
}

/// Sends the outbox' next message; false when the transport takes no more.
async fn send_next(outbound: Option<&mpsc::Sender<v1::IngestRequest>>, shared: &Shared) -> bool {
    let Some(outbound) = outbound else { return false };
    let Ok(permit) = outbound.reserve().await else { return false };
    if let Some(request) = shared.outbox().take_unsent() {
        permit.send(request);
    }
    true
}

/// Adds an ack that was not counted yet.
fn count(state: &mut State, ack: &v1::IngestAck) {
    let report = &mut state.report;
    report.revision = report.revision.max(ack.revision);
    match ack.status() {
        v1::AckStatus::Received => {
            report.acknowledged += 1;
            report.duplicates += u64::from(ack.duplicate);
        }
        v1::AckStatus::Rejected => {
            report.rejected += 1;
            state.rejected.push(ack.sequence);
            if report.rejections.len() < KEPT_REJECTIONS {
                let (sequence, violations) = (ack.sequence, ack.violations.clone());
                report.rejections.push(RejectedItem { sequence, violations });
            }
        }
        v1::AckStatus::Optimized => {
            report.optimized += 1;
            report.optimized_through = report.optimized_through.max(ack.sequence);
            report.failed_solves += u64::from(ack.solve_failure.is_some());
        }
        v1::AckStatus::Durable | v1::AckStatus::Unspecified => {}
    }
}

fn protocol(what: &'static str) -> ClientError {
    ClientError::Protocol { rpc: RPC, what }
}

/// A link that went away without a word.
fn broken(text: &str) -> ClientError {
    ClientError::rpc(RPC)(tonic::Status::unavailable(text))
}
