//! The session with the server and the watch on its map.
//!
//! Beside tracking it waits for keyframes, questions, deltas and answers at once and takes whichever
//! comes. A keyframe for which the session has no room is left out; after an error that is final, all
//! are, and tracking continues without corrections. In lock-step each keyframe has a session of its own: the end of a stream waits
//! for all that its items started, searches for known places and their closures among them. Poses and
//! corrections are kept by `book`; it tracks nothing.

use std::pin::pin;

use covis_client::wire::v1;
use covis_client::{
    Client, ClientError, IngestReport, IngestSession, MapMirror, MapWatch, SessionOptions,
    WatchOptions,
};
use tokio::sync::mpsc::UnboundedReceiver;

use super::book::Book;
use super::encode;
use super::handover::{FromServer, FromTracking, Putting};
use super::localizer::{Localizer, Located};
use super::run::{Loops, Target};
use super::solves::{LastSolve, SolveLog};
use crate::camera::FrameCamera;
use crate::local_map::Corrections;
use crate::tracking::keyframe::NewKeyframe;

/// The id of the only camera.
const CAMERA: i64 = 0;

/// A session with the server, a watch on its map, and the questions of a lost camera.
pub(super) struct Mapper {
    client: Client,
    map_id: String,
    client_id: String,
    watch: MapWatch,
    localizer: Localizer,
    pub(super) sender: Sender,
}

/// The session, and what became of the keyframes.
#[derive(Debug)]
pub(super) struct Sender {
    /// `None` in lock-step.
    session: Option<IngestSession>,
    pub(super) book: Book,
    pub(super) solves: SolveLog,
    /// The sequence of the last keyframe.
    last_sequence: Option<i64>,
    /// Keyframes that were left out.
    pub(super) left_out: usize,
    /// The most that waited for an answer.
    pub(super) most_held: usize,
    /// Why the session ended before its time.
    pub(super) failure: Option<ClientError>,
}

impl Mapper {
    /// Opens a session on a map, which must exist, and sends the camera.
    ///
    /// # Errors
    /// As [`Client::ingest`] and [`Client::watch`].
    pub(super) async fn open(
        target: &Target<'_>,
        camera: &FrameCamera,
    ) -> Result<Self, ClientError> {
        let Target { client, map_id, client_id, lock_step, most_held } = *target;
        let options =
            SessionOptions { lock_step, max_unanswered: most_held, ..SessionOptions::default() };
        let solves = SolveLog::default();
        let mut session = client.ingest(map_id, client_id, solves.listening(options)).await?;
        let watch = client.watch(map_id, WatchOptions::default()).await?;
        let camera = encode::camera(CAMERA, camera);
        session.send(camera.clone()).await?;
        session.flush().await?;
        let session = if lock_step {
            session.finish().await?;
            None
        } else {
            Some(session)
        };
        let sender = Sender {
            session,
            book: Book::new(client_id),
            solves,
            last_sequence: None,
            left_out: 0,
            most_held: 0,
            failure: None,
        };
        let localizer = Localizer::new(target, camera);
        let (map_id, client_id) = (map_id.to_owned(), client_id.to_owned());
        Ok(Self { client: client.clone(), map_id, client_id, watch, localizer, sender })
    }

    /// Sends keyframes, asks questions, and passes corrections and answers on, until tracking ends.
    ///
    /// # Errors
    /// In lock-step: why the session ended; [`ClientError::Rejected`] where the server refused a
    /// keyframe. Beside tracking these are kept in [`Sender::failure`].
    pub(super) async fn serve(
        &mut self,
        mut inbox: UnboundedReceiver<FromTracking>,
        putting: Putting,
    ) -> Result<(), ClientError> {
        if self.sender.session.is_none() {
            while let Some(message) = inbox.recv().await {
                putting.put(match message {
                    FromTracking::Keyframe(keyframe) => self.map_keyframe(*keyframe).await?.into(),
                    FromTracking::Question(question) => {
                        self.localizer.ask(question);
                        let Located { revision, answer } = self.localizer.answered().await;
                        let corrections = self.reach(revision).await?;
                        FromServer { corrections, answer: Some(answer) }
                    }
                });
            }
            return Ok(());
        }
        // An answer waits for the corrections of the map that it is in.
        let mut located: Option<Located> = None;
        while self.sender.failure.is_none() {
            let revision = self.watch.mirror().revision;
            located = located.and_then(|located| located.put(revision, &putting));
            // A broken watch waits before it tries again: nothing else must cut that short.
            let changes = {
                let mut changes = pin!(self.watch.next_changes());
                loop {
                    tokio::select! {
                        changes = &mut changes => break changes,
                        message = inbox.recv() => match message {
                            Some(FromTracking::Keyframe(keyframe)) => self.sender.send(*keyframe),
                            Some(FromTracking::Question(question)) => self.localizer.ask(question),
                            None => return Ok(()),
                        },
                        answered = self.localizer.answered() => {
                            located = answered.put(revision, &putting);
                        }
                    }
                }
            };
            match changes {
                Ok(changes) => {
                    putting.put(self.sender.book.correct(&changes, self.watch.mirror()).into());
                }
                Err(error) => self.sender.fail(error),
            }
        }
        while let Some(message) = inbox.recv().await {
            if let FromTracking::Keyframe(keyframe) = message {
                self.sender.send(*keyframe);
            }
        }
        Ok(())
    }

    /// Sends a keyframe, waits for all that follows from it, and returns what changed.
    async fn map_keyframe(
        &mut self,
        mut keyframe: NewKeyframe,
    ) -> Result<Corrections, ClientError> {
        let options = SessionOptions { lock_step: true, ..SessionOptions::default() };
        let options = self.sender.solves.listening(options);
        let mut session = self.client.ingest(&self.map_id, &self.client_id, options).await?;
        self.sender.solves.sends(keyframe.timestamp_s);
        let Sender { book, last_sequence, .. } = &mut self.sender;
        book.enter(&mut keyframe);
        *last_sequence = Some(session.send(encode::keyframe(CAMERA, &keyframe)).await?);
        book.sent(keyframe.id);
        let (answer, before) = follow_until(&mut self.watch, book, session.finish()).await?;
        rejected(&answer?)?;
        let revision = self.client.get_map(&self.map_id).await?.revision;
        Ok(before.then(self.reach(revision).await?))
    }

    /// Follows the map to a revision, or to a later one.
    async fn reach(&mut self, revision: i64) -> Result<Corrections, ClientError> {
        let mut all = Corrections::default();
        while is_before(self.watch.mirror(), revision) {
            let changes = self.watch.next_changes().await?;
            all = all.then(self.sender.book.correct(&changes, self.watch.mirror()));
        }
        Ok(all)
    }

    /// Waits until everything is solved, optimizes the whole map and follows it there. `None` where
    /// no keyframe was sent.
    ///
    /// # Errors
    /// As [`Mapper::serve`] in lock-step; any code of `OptimizeMap`.
    pub(super) async fn optimize_whole_map(&mut self) -> Result<Option<LastSolve>, ClientError> {
        let Sender { session, book, last_sequence, .. } = &mut self.sender;
        let Some(sequence) = *last_sequence else { return Ok(None) };
        if let Some(session) = session {
            let (answer, _) = follow_until(&mut self.watch, book, session.flush()).await?;
            answer?;
            rejected(&session.report())?;
            let solved = session.optimized(sequence);
            let (answer, _) = follow_until(&mut self.watch, book, solved).await?;
            answer?;
        }
        let request = v1::OptimizeMapRequest { map_id: self.map_id.clone(), ..Default::default() };
        let mut iterations = Vec::new();
        let optimize = self.client.optimize_map(request, |row| iterations.push(*row));
        let (answer, _) = follow_until(&mut self.watch, book, optimize).await?;
        let summary = answer?.summary.unwrap_or_default();
        let revision = self.client.get_map(&self.map_id).await?.revision;
        self.reach(revision).await?;
        Ok(Some(LastSolve { iterations, summary }))
    }

    /// The loop closures of the map, as the server last sent it.
    pub(super) fn loops(&self) -> Loops {
        let mut loops = Loops::default();
        for constraint in self.watch.mirror().constraints.values() {
            if let Some(v1::constraint::Constraint::RelativePose(pose)) = &constraint.constraint
                && pose.kind() == v1::ConstraintKind::LoopClosure
            {
                if pose.switched_off.is_some() {
                    loops.switched_off += 1;
                    continue;
                }
                loops.counting += 1;
                let time = |keyframe: &Option<v1::KeyframeRef>| {
                    let keyframe = keyframe.as_ref().filter(|k| k.client_id == self.client_id)?;
                    self.sender.book.timestamp_s(usize::try_from(keyframe.id).ok()?)
                };
                if let Some((a, b)) = time(&pose.keyframe_i).zip(time(&pose.keyframe_j)) {
                    loops.times_s.push((a.max(b), a.min(b)));
                }
            }
        }
        loops.times_s.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        loops
    }

    /// Ends the session.
    ///
    /// # Errors
    /// The error that ended it before everything was answered.
    pub(super) async fn finish(self) -> Result<IngestReport, ClientError> {
        match self.sender.session {
            Some(session) => session.finish().await,
            None => Ok(IngestReport::default()),
        }
    }
}

/// Waits for an answer and follows the map meanwhile: all share one connection, which takes nothing
/// more for anyone when deltas of a large map are not read. Returns the answer and what was corrected.
async fn follow_until<T>(
    watch: &mut MapWatch,
    book: &mut Book,
    answer: impl Future<Output = T>,
) -> Result<(T, Corrections), ClientError> {
    let mut answer = pin!(answer);
    let mut all = Corrections::default();
    loop {
        let changes = tokio::select! {
            biased;
            answer = &mut answer => return Ok((answer, all)),
            changes = watch.next_changes() => changes?,
        };
        all = all.then(book.correct(&changes, watch.mirror()));
    }
}

impl Sender {
    /// Sends a keyframe, or leaves it out where that must wait.
    fn send(&mut self, mut keyframe: NewKeyframe) {
        self.solves.sends(keyframe.timestamp_s);
        self.book.enter(&mut keyframe);
        match self.try_send(&keyframe) {
            Ok(true) => return self.book.sent(keyframe.id),
            Ok(false) => {}
            Err(error) => self.fail(error),
        }
        self.left_out += 1;
        self.book.leave_out(&keyframe);
    }

    /// Sends a keyframe; false where there is no room, or no session any more.
    fn try_send(&mut self, keyframe: &NewKeyframe) -> Result<bool, ClientError> {
        let Some(session) = self.session.as_mut().filter(|_| self.failure.is_none()) else {
            return Ok(false);
        };
        rejected(&session.report())?;
        let Some(sequence) = session.try_send(encode::keyframe(CAMERA, keyframe))? else {
            return Ok(false);
        };
        self.last_sequence = Some(sequence);
        let held = usize::try_from(session.report().unanswered()).unwrap_or(usize::MAX);
        self.most_held = self.most_held.max(held);
        Ok(true)
    }

    /// Ends the session for a reason; the first one counts.
    fn fail(&mut self, error: ClientError) {
        tracing::warn!(%error, "tracking continues without the server");
        self.failure.get_or_insert(error);
    }
}

/// Whether a mirror has not come to a revision.
fn is_before(mirror: &MapMirror, revision: i64) -> bool {
    mirror.uid.is_empty() || mirror.revision < revision
}

/// The first item that the server refused.
fn rejected(report: &IngestReport) -> Result<(), ClientError> {
    match report.rejections.first() {
        Some(item) => {
            let (sequence, violations) = (item.sequence, item.violations.clone());
            Err(ClientError::Rejected { sequence, violations })
        }
        None => Ok(()),
    }
}
