//! What an outside client does in these tests: raw calls, so that each can be cut off where it is.

use std::time::Duration;

use covis::wire::v1;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Request, Status, Streaming};
use v1::ingest_request::Item;
use v1::ingest_response::Event;
use v1::ingest_service_client::IngestServiceClient;
use v1::map_service_client::MapServiceClient;
use v1::server_service_client::ServerServiceClient;

use super::trace::{Field, Stage};
use crate::common::{camera, open_item};
use crate::durable::long_keyframe;

/// How long something that must happen may take before the test gives up.
const PATIENCE: Duration = Duration::from_secs(20);
/// Between two looks at something that is bound to change.
const LOOK: Duration = Duration::from_millis(5);

pub(super) async fn connect(url: &str) -> Channel {
    Endpoint::from_shared(url.to_owned()).unwrap().connect().await.unwrap()
}

pub(super) fn create_request(map_id: &str) -> v1::CreateMapRequest {
    v1::CreateMapRequest { map_id: map_id.to_owned(), ..Default::default() }
}

pub(super) async fn create(channel: &Channel, map_id: &str) -> Result<(), Status> {
    MapServiceClient::new(channel.clone()).create_map(create_request(map_id)).await.map(drop)
}

pub(super) async fn delete(channel: &Channel, map_id: &str) -> Result<(), Status> {
    let request = v1::DeleteMapRequest { map_id: map_id.to_owned() };
    MapServiceClient::new(channel.clone()).delete_map(request).await.map(drop)
}

pub(super) async fn get(channel: &Channel, map_id: &str) -> Result<v1::Map, Status> {
    let request = v1::GetMapRequest { map_id: map_id.to_owned(), ..Default::default() };
    let answer = MapServiceClient::new(channel.clone()).get_map(request).await?;
    Ok(answer.into_inner().map.unwrap())
}

/// Calls that the server answers in order behind what the connection brought before.
pub(super) async fn pass(channel: &Channel) {
    for _ in 0..5 {
        let mut service = ServerServiceClient::new(channel.clone());
        service.get_server_info(v1::GetServerInfoRequest {}).await.unwrap();
    }
}

/// Looks until `is_so`; false where it never is.
pub(super) async fn eventually<F: Future<Output = bool>>(is_so: impl Fn() -> F) -> bool {
    let begin = std::time::Instant::now();
    while begin.elapsed() < PATIENCE / 4 {
        if is_so().await {
            return true;
        }
        tokio::time::sleep(LOOK).await;
    }
    false
}

/// How a call is cut off while the disk holds it up.
#[derive(Clone, Copy, Debug)]
pub(super) enum Cut {
    /// The caller goes.
    Dropped,
    /// The call has a deadline.
    Deadline,
}

/// Makes a call whose work waits at the sync after `syncs` of them, cuts it off there, and lets the
/// disk go on. Returns what the call said where it was done before.
pub(super) async fn cut_off<T, F>(
    channel: &Channel,
    stage: &Stage,
    (cut, syncs): (Cut, i64),
    call: impl FnOnce(Request<()>) -> F,
) -> Option<Result<T, Status>>
where
    F: Future<Output = Result<T, Status>>,
{
    stage.set(Field::Permits, syncs);
    stage.set(Field::IsHeld, 1);
    let mut request = Request::new(());
    if matches!(cut, Cut::Deadline) {
        request.set_timeout(Duration::from_millis(150));
    }
    let mut call = Box::pin(call(request));
    let waits = async {
        while stage.get(Field::Waiting) == 0 || stage.get(Field::Permits) > 0 {
            tokio::time::sleep(LOOK).await;
        }
    };
    let early = tokio::select! {
        answer = &mut call => Some(answer),
        () = waits => None,
    };
    let answer = match (early, cut) {
        (None, Cut::Deadline) => Some(call.await),
        (early, _) => {
            drop(call);
            early
        }
    };
    // The server has seen the reset of the call when it answers what came after.
    pass(channel).await;
    stage.heal();
    answer
}

/// An ingest stream.
pub(super) struct Robot {
    requests: mpsc::Sender<v1::IngestRequest>,
    answers: Streaming<v1::IngestResponse>,
    pub(super) next_sequence: i64,
}

impl Robot {
    pub(super) async fn open(channel: &Channel, map_id: &str) -> Result<Self, Status> {
        let (requests, receiver) = mpsc::channel(64);
        let open = open_item(map_id, "robot", 0);
        let open = v1::IngestRequest { sequence: 0, item: Some(open) };
        requests.send(open).await.unwrap();
        let mut service = IngestServiceClient::new(channel.clone());
        let mut answers = service.ingest(ReceiverStream::new(receiver)).await?.into_inner();
        let opened = answers.message().await?.and_then(|answer| answer.event);
        let Some(Event::Opened(opened)) = opened else { panic!("not opened: {opened:?}") };
        Ok(Self { requests, answers, next_sequence: opened.next_sequence })
    }

    pub(super) async fn send(&self, sequence: i64, item: Item) {
        let _ended = self.requests.send(v1::IngestRequest { sequence, item: Some(item) }).await;
    }

    /// Sends the camera (sequence 1) or keyframe `sequence - 2`, as `durable.rs` numbers them.
    pub(super) async fn send_item(&self, sequence: i64) {
        let item = match sequence {
            1 => Item::Camera(camera(0)),
            later => Item::Keyframe(long_keyframe(later - 2)),
        };
        self.send(sequence, item).await;
    }

    /// Reads until an ack of this status covers `sequence`; how the stream ended otherwise.
    pub(super) async fn until(
        &mut self,
        status: v1::AckStatus,
        sequence: i64,
    ) -> Result<(), Status> {
        loop {
            let answer = tokio::time::timeout(PATIENCE, self.answers.message()).await;
            let answer = answer.map_err(|_late| Status::deadline_exceeded("no ack came"))??;
            let Some(answer) = answer else { return Err(Status::cancelled("the stream ended")) };
            if let Some(Event::Ack(ack)) = answer.event {
                assert_ne!(ack.status(), v1::AckStatus::Rejected, "{ack:?}");
                if ack.status() == status && ack.sequence >= sequence {
                    return Ok(());
                }
            }
        }
    }
}

/// Sends a camera and keyframes up to `last` and waits until they are durable.
pub(super) async fn map_out(channel: &Channel, map_id: &str, last: i64) -> Result<(), Status> {
    let mut robot = Robot::open(channel, map_id).await?;
    for sequence in robot.next_sequence..=last {
        robot.send_item(sequence).await;
    }
    robot.until(v1::AckStatus::Durable, last).await
}

/// Creates a map as a client does whose first attempt was cut off: again until it is there.
pub(super) async fn create_again(channel: &Channel, map_id: &str) -> bool {
    eventually(|| async {
        match create(channel, map_id).await {
            Ok(()) => true,
            Err(status) => status.code() == Code::AlreadyExists,
        }
    })
    .await
}
