//! `IngestService`: one bidirectional stream by which a client builds a map.
//!
//! A session reads items and forwards acks side by side. Bad items are answered with acks. Only a
//! protocol error, a limit, a newer epoch or the end of the map or server ends the stream, after
//! the acks of the accepted items. Nothing is buffered beyond the engine's queue, so that a full
//! one slows the client.

use std::sync::Arc;

use tokio::sync::mpsc;
use tonic::{Code, Request, Response, Status, Streaming};

use super::access::Caller;
use super::context::{Answers, Context, Messages, Rpcs, Sink};
use super::convert::map::{queued, to_durability, to_limits};
use super::convert::solve::to_certificate;
use super::convert::{Path, convert, count, ids, item};
use super::engine::{Ack, AckStatus, ItemSender, MapHandle, Opened, SolveReport, StreamEvent};
use super::error::ServiceError;
use super::reasons::{solve_reason, violation_reason};
use crate::map::{MAX_NUMBER, Reason, Rejection};
use crate::wire::v1;
use v1::ingest_request::Item as WireItem;
use v1::ingest_response::Event;
use v1::ingest_service_server::IngestService;

#[async_trait::async_trait]
impl IngestService for Rpcs {
    type IngestStream = Answers<v1::IngestResponse>;

    async fn ingest(
        &self,
        request: Request<Streaming<v1::IngestRequest>>,
    ) -> Result<Response<Self::IngestStream>, Status> {
        let context = Arc::clone(&self.context);
        let caller = Caller::of(&request)?;
        let inbound = request.into_inner();
        let session = |sink| session(context, caller, inbound, sink);
        self.context.stream("Ingest", None, Messages::Small, session)
    }
}

/// The contents of the first message.
struct Open {
    map: String,
    client: String,
    epoch: i64,
    lock_step: bool,
    omit_summary: bool,
}

async fn session(
    context: Arc<Context>,
    caller: Caller,
    mut inbound: Streaming<v1::IngestRequest>,
    sink: Sink<v1::IngestResponse>,
) -> Result<(), ServiceError> {
    let open = tokio::select! {
        biased;
        open = read_open(&mut inbound) => open?,
        () = context.drained() => return Err(ServiceError::Draining),
        reason = context.access.withdrawn(&caller) => return Err(reason),
    };
    let map = context.maps.find(&caller.engine_name(&open.map)).await?;
    let stream = map.open_stream(open.client.clone(), open.epoch, open.lock_step).await?;
    let opened = opened(&context, &map, stream.opened).await?;
    sink.send(v1::IngestResponse { event: Some(Event::Opened(opened)) }).await?;
    let (sender, events) = stream.split();
    let client = &open.client;
    let reading = async { Ok(read_items(&context, &caller, client, &mut inbound, sender).await) };
    let sending = send_acks(events, &sink, open.omit_summary);
    // The error that ended the reading is returned after everything that was accepted is answered.
    let (read, ()) = tokio::try_join!(reading, sending)?;
    read
}

/// The first message, which must open the stream.
async fn read_open(inbound: &mut Streaming<v1::IngestRequest>) -> Result<Open, ServiceError> {
    let first = inbound.message().await.map_err(|status| broken(&status))?;
    let description = "the first message opens the stream";
    let Some(v1::IngestRequest { sequence, item: Some(WireItem::Open(open)) }) = first else {
        return Err(ServiceError::Protocol { field: "open", description });
    };
    if sequence != 0 {
        let text = "it is 0 with open";
        return Err(ServiceError::field("sequence", Reason::OutOfRange, text));
    }
    let at = Path::root("open");
    Ok(convert(|out| {
        let map = ids::name(at.field("map_id"), &open.map_id, out);
        let client = ids::name(at.field("client_id"), &open.client_id, out);
        let epoch = ids::id(at.field("epoch"), open.epoch, out);
        let options = open.options.unwrap_or_default();
        Some(Open {
            map: map?,
            client: client?,
            epoch: epoch?,
            lock_step: options.lock_step,
            omit_summary: options.omit_solve_summary,
        })
    })?)
}

async fn opened(
    context: &Context,
    map: &MapHandle,
    opened: Opened,
) -> Result<v1::IngestOpened, ServiceError> {
    let snapshot = map.snapshot().await?;
    let waiting = context.config.engine.queue_capacity;
    Ok(v1::IngestOpened {
        next_sequence: opened.next_sequence,
        epoch: opened.epoch,
        durability: to_durability(context.maps.durability()).into(),
        revision: opened.revision,
        max_message_bytes: count(context.config.max_message_bytes),
        limits: Some(to_limits(&snapshot.policy().limits, queued(snapshot.policy(), waiting))),
        lock_step: opened.lock_step,
        map_uid: map.ingest_uid().to_owned(),
        optimized_sequence: opened.optimized_sequence,
        next_keyframe_id: snapshot.next_keyframe_id(opened.client),
        next_landmark_id: snapshot.next_landmark_id(opened.client),
    })
}

/// Hands items to the engine until the client half-closes, breaks the protocol, leaves or loses the
/// right to write, or the server drains.
async fn read_items(
    context: &Context,
    caller: &Caller,
    client: &str,
    inbound: &mut Streaming<v1::IngestRequest>,
    sender: ItemSender,
) -> Result<(), ServiceError> {
    let result = tokio::select! {
        biased;
        result = hand_over(client, inbound, &sender) => result,
        () = context.drained() => Err(ServiceError::Draining),
        reason = context.access.withdrawn(caller) => Err(reason),
    };
    // After a broken connection nobody waits for the acks.
    if result != Err(ServiceError::Gone) {
        sender.finish().await;
    }
    result
}

async fn hand_over(
    client: &str,
    inbound: &mut Streaming<v1::IngestRequest>,
    sender: &ItemSender,
) -> Result<(), ServiceError> {
    let mut last = 0;
    while let Some(request) = inbound.message().await.map_err(|status| broken(&status))? {
        let (sequence, wire) = (request.sequence, request.item);
        let Some(wire) = wire else {
            let description = "a message without an item";
            return Err(ServiceError::Protocol { field: "item", description });
        };
        if let WireItem::Open(_) = wire {
            let description = "the stream is open already";
            return Err(ServiceError::Protocol { field: "open", description });
        }
        if sequence <= last {
            let description = "it must be at least 1 and above the one before";
            return Err(ServiceError::Protocol { field: "sequence", description });
        }
        // A sequence that is refused because it is too large is not recorded, so that others can
        // follow.
        if sequence <= MAX_NUMBER {
            last = sequence;
        }
        let digest = item::digest(&wire);
        let sent = match item::item(wire, client) {
            Ok(item) => sender.send(sequence, digest, item).await,
            Err(item::Refused { rejection, partial }) => {
                sender.reject(sequence, rejection, partial).await
            }
        };
        if sent.is_err() {
            // The events of the stream end with the reason.
            return Ok(());
        }
    }
    Ok(())
}

/// A message that cannot be read; the transport has its own code for it.
fn broken(status: &Status) -> ServiceError {
    let code = status.code();
    if matches!(code, Code::OutOfRange | Code::Internal) {
        ServiceError::Transport { code, message: status.message().to_owned() }
    } else {
        ServiceError::Gone
    }
}

/// Sends the events of a stream to its client.
async fn send_acks(
    mut events: mpsc::Receiver<StreamEvent>,
    sink: &Sink<v1::IngestResponse>,
    omit_summary: bool,
) -> Result<(), ServiceError> {
    while let Some(event) = events.recv().await {
        match event {
            StreamEvent::Ack(ack) => {
                let ack = to_ack(ack, omit_summary);
                sink.send(v1::IngestResponse { event: Some(Event::Ack(ack)) }).await?;
            }
            StreamEvent::End(error) => return Err(error.into()),
        }
    }
    Ok(())
}

fn to_ack(ack: Ack, omit_summary: bool) -> v1::IngestAck {
    let mut message = v1::IngestAck {
        sequence: ack.sequence,
        revision: ack.revision,
        ..v1::IngestAck::default()
    };
    let status = match ack.status {
        AckStatus::Received { duplicate } => {
            message.duplicate = duplicate;
            v1::AckStatus::Received
        }
        AckStatus::Durable => v1::AckStatus::Durable,
        AckStatus::Optimized { solve_id, outcome } => {
            message.solve_id = solve_id;
            match outcome {
                SolveReport::Nothing => {}
                SolveReport::Solved(certificate) => {
                    message.solve_summary = (!omit_summary).then(|| to_certificate(&certificate));
                }
                SolveReport::Failed { error } => {
                    message.solve_failure = Some(v1::SolveFailure {
                        reason: solve_reason(&error).into(),
                        description: error.to_string(),
                    });
                }
                SolveReport::Lost { bug } => {
                    message.solve_failure = Some(v1::SolveFailure {
                        reason: v1::ViolationReason::Unspecified.into(),
                        description: bug.to_string(),
                    });
                }
                SolveReport::Refused { reason } => {
                    message.solve_failure = Some(v1::SolveFailure {
                        reason: v1::ViolationReason::OutOfRange.into(),
                        description: format!("the result is not possible: {reason}"),
                    });
                }
            }
            v1::AckStatus::Optimized
        }
        AckStatus::Rejected(rejection) => {
            message.violations = to_violations(rejection);
            v1::AckStatus::Rejected
        }
    };
    message.status = status.into();
    message
}

fn to_violations(rejection: Rejection) -> Vec<v1::ItemViolation> {
    let violations = rejection.violations.into_iter();
    violations
        .map(|v| v1::ItemViolation {
            field: v.field,
            description: v.description,
            reason: violation_reason(v.reason).into(),
        })
        .collect()
}
