//! Asks the server where a lost camera is, one question at a time.
//!
//! A new question waits for the answer to the one before, and takes the place of another that waits. A call
//! that fails, for instance because the server does not recognize places, is answered by nothing a moment
//! later: tracking asks again, and resumes by itself where the camera comes back to what it saw last.
//! What an answer does to tracking is not known here.

use std::pin::Pin;
use std::time::Duration;

use covis_client::Client;
use covis_client::wire::v1;

use super::handover::{FromServer, Putting};
use super::run::Target;
use super::{encode, messages};
use crate::pipeline::relocalization::{Answer, Question};

/// An answer and the revision of the map that it is in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Located {
    pub(super) revision: i64,
    pub(super) answer: Answer,
}

impl Located {
    /// Hands the answer to tracking, where it has been given the corrections up to `revision`; else returns
    /// it.
    pub(super) fn put(self, revision: i64, putting: &Putting) -> Option<Self> {
        if self.revision > revision {
            return Some(self);
        }
        putting.put(FromServer { answer: Some(self.answer), ..FromServer::default() });
        None
    }
}

type Call = Pin<Box<dyn Future<Output = Located> + Send>>;

/// The questions of one camera.
pub(super) struct Localizer {
    client: Client,
    map_id: String,
    camera: v1::Camera,
    /// How long the next call waits after one that failed.
    pause: Duration,
    call: Option<Call>,
    waiting: Option<Question>,
}

impl Localizer {
    /// No question yet.
    pub(super) fn new(target: &Target<'_>, camera: v1::Camera) -> Self {
        let (client, map_id) = (target.client.clone(), target.map_id.to_owned());
        // In lock-step tracking would only wait longer.
        let pause = if target.lock_step { Duration::ZERO } else { Duration::from_millis(500) };
        Self { client, map_id, camera, pause, call: None, waiting: None }
    }

    /// Asks, or keeps the question until the one before is answered.
    pub(super) fn ask(&mut self, question: Question) {
        if self.call.is_some() {
            self.waiting = Some(question);
            return;
        }
        let request = v1::LocalizeRequest {
            map_id: self.map_id.clone(),
            camera: Some(self.camera.clone()),
            features: encode::features(&question.features),
            ..v1::LocalizeRequest::default()
        };
        self.call =
            Some(Box::pin(localize(self.client.clone(), request, question.number, self.pause)));
    }

    /// The next answer; waits without end while there is no question. Safe to cancel.
    pub(super) async fn answered(&mut self) -> Located {
        let Some(call) = &mut self.call else { return std::future::pending().await };
        let located = call.await;
        self.call = None;
        if let Some(question) = self.waiting.take() {
            self.ask(question);
        }
        located
    }
}

async fn localize(
    client: Client,
    request: v1::LocalizeRequest,
    number: u64,
    pause: Duration,
) -> Located {
    match client.localize(request).await {
        Ok(found) => {
            let world_from_camera = found.world_from_camera.as_ref().and_then(messages::se3);
            let answer = Answer { number, world_from_camera };
            Located { revision: found.revision, answer }
        }
        Err(error) => {
            tracing::debug!(%error, "the server did not localize the camera");
            tokio::time::sleep(pause).await;
            Located { revision: 0, answer: Answer { number, world_from_camera: None } }
        }
    }
}
