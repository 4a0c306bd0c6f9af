//! How a simulated robot sends items to a map, and what it knows of that map.
//!
//! A broken promise that the client itself detects, such as a lost item, is reported here.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::answer::{Answer, Step, answer, broken};
use super::items::item;
use covis::client::{Client, ClientError, IngestSession, RetryPolicy, SessionOptions};
use covis::wire::v1;

/// A map that was created.
#[derive(Clone, Debug, Default)]
pub(super) struct Contents {
    pub(super) uid: String,
    /// The last sequence that was sent.
    pub(super) sent: i64,
    /// The last that was acknowledged as durable.
    pub(super) durable: Arc<Mutex<i64>>,
    /// What was durable when a deletion failed: the map may be gone until more is acknowledged.
    pub(super) failed_deletion: Option<i64>,
}

impl Contents {
    pub(super) fn durable(&self) -> i64 {
        *self.durable.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the map may be gone, because a deletion failed and nothing was promised since.
    pub(super) fn may_be_gone(&self) -> bool {
        self.failed_deletion.is_some_and(|durable| durable >= self.durable())
    }
}

/// Short waits between attempts, with the same jitter in every run of a seed.
pub(super) fn retries() -> RetryPolicy {
    RetryPolicy {
        max_attempts: 4,
        first_delay: Duration::from_millis(5),
        longest_delay: Duration::from_millis(40),
        give_up_after: None,
        seed: Some(0),
    }
}

/// Sends the items from `first` on, waiting for every ack.
pub(super) async fn send(
    client: Client,
    map: String,
    contents: Contents,
    first: i64,
    pause: u64,
) -> Step<Answer<()>> {
    let durable = Arc::clone(&contents.durable);
    let options =
        SessionOptions { max_unanswered: 8, retry: retries(), ..SessionOptions::default() };
    let options = options.on_ack(move |ack| {
        if ack.status() == v1::AckStatus::Durable {
            let mut durable = durable.lock().unwrap_or_else(PoisonError::into_inner);
            *durable = (*durable).max(ack.sequence);
        }
    });
    let mut session = match answer(client.ingest(&map, "robot", options).await) {
        Answer::Some(session) => session,
        Answer::Refused(code, text) => return Ok(Answer::Refused(code, text)),
        Answer::None => return Ok(Answer::None),
    };
    let next = session.opened().next_sequence;
    if session.opened().map_uid != contents.uid {
        return broken(format!("{map}: another map under its name, {contents:?}"));
    }
    if next <= contents.durable() && !contents.may_be_gone() {
        return broken(format!("{map}: goes on at {next} of {contents:?}"));
    }
    for id in first..=contents.sent {
        if let Err(error) = session.send_as(id, item(id)).await {
            return lost(&map, error);
        }
        if pause > 0 {
            tokio::time::sleep(Duration::from_millis(pause)).await;
        }
    }
    finish(&map, session).await
}

async fn finish(map: &str, session: IngestSession) -> Step<Answer<()>> {
    match session.finish().await {
        Ok(report) if report.rejected > 0 => broken(format!("{map}: {:?}", report.rejections)),
        Ok(_) => Ok(Answer::Some(())),
        Err(error) => lost(map, error),
    }
}

/// The client itself sees some promises that do not hold.
fn lost(map: &str, error: ClientError) -> Step<Answer<()>> {
    if matches!(error, ClientError::ItemsLost { .. } | ClientError::MapReplaced { .. }) {
        return broken(format!("{map}: {error}"));
    }
    Ok(answer(Err(error)))
}
