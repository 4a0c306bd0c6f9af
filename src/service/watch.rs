//! `WatchMap`: the steps of a map as deltas in parts of at most about 256 KiB.
//!
//! Entities are sent whole, read from the newest snapshot, where the reader has another value (`sent`
//! knows); an entity that a step touched and that is no longer in the snapshot is reported as removed.
//! A part is sent when the next entity does not fit, so that a large map is never encoded as a whole.

mod sent;

use std::collections::BTreeSet;

use prost::Message;

use super::context::{Context, Sink};
use super::convert::entities::{
    to_any_constraint, to_camera, to_client_frame, to_keyframe_pose, to_landmark,
};
use super::convert::ids::{to_constraint_ref, to_keyframe_ref, to_landmark_ref};
use super::convert::map::{to_pending_work, to_state};
use super::engine::{MapChange, MapHandle};
use super::error::ServiceError;
use super::listing::ENTRY_OVERHEAD;
use crate::map::{ClientIndex, EntityId, Map};
use crate::wire::v1;
pub(super) use sent::Resolution;
use sent::Sent;

/// Size of a full part. While a larger part is encoded, other messages of the connection's thread
/// would wait.
const PART_BYTES: usize = 256 << 10;
/// After this many entities other tasks of the thread run, however few of the entities are sent.
const ENTITIES_PER_TURN: u32 = 1024;

/// The options of a watcher.
#[derive(Clone, Debug)]
pub(super) struct WatcherOptions {
    /// The revision that it has; `None` for the full state.
    pub from_revision: Option<i64>,
    /// Whether landmarks are sent.
    pub landmarks: bool,
    /// Whether constraints are sent.
    pub constraints: bool,
    /// How far the reader's values may be off.
    pub resolution: Resolution,
}

/// Sends deltas until the caller leaves, the map is deleted or the server drains.
pub(super) async fn watch(
    context: &Context,
    map: &MapHandle,
    wanted: &WatcherOptions,
    sink: &Sink<v1::WatchMapResponse>,
) -> Result<(), ServiceError> {
    // Opening may take long: changes that the reader missed may be read first.
    let mut watch = tokio::select! {
        watch = map.watch(wanted.from_revision) => watch?,
        () = context.drained() => return Err(ServiceError::Draining),
    };
    if !wanted.landmarks {
        watch.omit_landmarks();
    }
    let mut sent = Sent::new(wanted.resolution);
    loop {
        let change = tokio::select! {
            biased;
            change = watch.next() => change?,
            () = context.drained() => return Err(ServiceError::Draining),
        };
        if change.reset {
            sent.reset();
        }
        // Meanwhile the changes of the map are gathered, however slow the reader is.
        tokio::select! {
            ended = send_delta(&change, map.uid(), wanted, &mut sent, sink) => ended?,
            // It never returns.
            () = watch.gather() => {}
        }
    }
}

/// The ids of one kind to send: those of `touched`, or all ids of the map, which are not collected
/// first.
fn ids<'a, I: Iterator<Item = EntityId> + Send + 'a>(
    touched: Option<&'a BTreeSet<EntityId>>,
    all: impl FnOnce() -> I,
) -> impl Iterator<Item = EntityId> + Send + 'a {
    let touched = touched.map(|ids| ids.iter().copied());
    let all = touched.is_none().then(all);
    touched.into_iter().flatten().chain(all.into_iter().flatten())
}

/// A kind of entity: `M` is what is sent of one, `G` of one that is gone.
struct Kind<M, G> {
    /// An entity of a map; `None` where the map does not have it.
    now: fn(&Map, EntityId) -> Option<M>,
    /// Whether the reader needs it.
    needs: fn(&mut Sent, EntityId, &M) -> bool,
    push: fn(&mut v1::MapDelta, M),
    gone: fn(&Map, EntityId) -> G,
    push_gone: fn(&mut v1::MapDelta, G),
}

/// The part that is being filled.
struct Parts<'a> {
    change: &'a MapChange,
    map_uid: &'a str,
    sink: &'a Sink<v1::WatchMapResponse>,
    part: v1::MapDelta,
    bytes: usize,
    index: i32,
    /// How many entities were looked at.
    looked_at: u32,
}

impl<'a> Parts<'a> {
    /// Makes room for an entry, sending the part when it is full, and returns where to put it.
    async fn room(&mut self, entry: &impl Message) -> Result<&mut v1::MapDelta, ServiceError> {
        let size = entry.encoded_len() + ENTRY_OVERHEAD;
        if self.bytes > 0 && self.bytes + size > PART_BYTES {
            self.send(false).await?;
        }
        self.bytes += size;
        Ok(&mut self.part)
    }

    /// Sends what the reader needs of some entities of a kind.
    async fn send_all<M: Message, G: Message>(
        &mut self,
        map: &Map,
        ids: impl Iterator<Item = EntityId>,
        sent: &mut Sent,
        kind: &Kind<M, G>,
    ) -> Result<(), ServiceError> {
        for id in ids {
            if let Some(now) = (kind.now)(map, id) {
                if (kind.needs)(sent, id, &now) {
                    (kind.push)(self.room(&now).await?, now);
                }
            } else if sent.may_have(id, |last| (kind.now)(last, id).is_some()) {
                let gone = (kind.gone)(map, id);
                (kind.push_gone)(self.room(&gone).await?, gone);
            }
            self.look().await;
        }
        Ok(())
    }

    /// One more entity was looked at.
    async fn look(&mut self) {
        self.looked_at = self.looked_at.wrapping_add(1);
        if self.looked_at.is_multiple_of(ENTITIES_PER_TURN) {
            tokio::task::yield_now().await;
        }
    }

    async fn send(&mut self, last_part: bool) -> Result<(), ServiceError> {
        let MapChange { reset, base_revision, revision, state, pending, .. } = *self.change;
        let delta = v1::MapDelta {
            base_revision: if reset { 0 } else { base_revision },
            revision,
            reset,
            part_index: self.index,
            last_part,
            state: to_state(state).into(),
            map_uid: self.map_uid.to_owned(),
            pending_work: Some(to_pending_work(&pending)),
            ..std::mem::take(&mut self.part)
        };
        self.index += 1;
        self.bytes = 0;
        self.sink.send(v1::WatchMapResponse { delta: Some(delta) }).await
    }
}

/// Sends what the reader needs of a step, and remembers that it has it.
async fn send_delta(
    change: &MapChange,
    map_uid: &str,
    wanted: &WatcherOptions,
    sent: &mut Sent,
    sink: &Sink<v1::WatchMapResponse>,
) -> Result<(), ServiceError> {
    let map = &change.snapshot;
    let touched = (!change.reset).then_some(&change.touched);
    let part = v1::MapDelta::default();
    let mut parts = Parts { change, map_uid, sink, part, bytes: 0, index: 0, looked_at: 0 };
    for id in ids(touched.map(|t| &t.cameras), || map.cameras().keys().copied()) {
        let camera = map.cameras().get(&id).map(|camera| to_camera(map, id, camera));
        if let Some(camera) = camera.filter(|camera| sent.needs_camera(id, camera)) {
            parts.room(&camera).await?.cameras.push(camera);
        }
    }
    let of_map = ids(touched.map(|t| &t.keyframes), || map.keyframes().keys().copied());
    let keyframes = Kind {
        now: |map, id| Some(to_keyframe_pose(map, id, map.keyframes().get(&id)?)),
        needs: Sent::needs_keyframe,
        push: |part, keyframe| part.keyframes.push(keyframe),
        gone: to_keyframe_ref,
        push_gone: |part, gone| part.removed_keyframes.push(gone),
    };
    parts.send_all(map, of_map, sent, &keyframes).await?;
    if wanted.landmarks {
        let of_map = ids(touched.map(|t| &t.landmarks), || map.landmarks().keys().copied());
        let landmarks = Kind {
            now: |map, id| Some(to_landmark(map, id, map.landmarks().get(&id)?)),
            needs: Sent::needs_landmark,
            push: |part, landmark| part.landmarks.push(landmark),
            gone: to_landmark_ref,
            push_gone: |part, gone| part.removed_landmarks.push(gone),
        };
        parts.send_all(map, of_map, sent, &landmarks).await?;
    }
    if wanted.constraints {
        let all = || map.constraints().keys().chain(map.priors().keys()).copied();
        let of_map = ids(touched.map(|t| &t.constraints), all);
        let constraints = Kind {
            now: to_any_constraint,
            needs: |sent, id, now| sent.needs_constraint(id, now),
            push: |part, constraint| part.constraints.push(constraint),
            gone: to_constraint_ref,
            push_gone: |part, gone| part.removed_constraints.push(gone),
        };
        parts.send_all(map, of_map, sent, &constraints).await?;
    }
    let clients = touched.map(|t| t.clients.clone());
    let clients = clients.unwrap_or_else(|| {
        (0u32..).zip(map.clients()).map(|(index, _)| ClientIndex(index)).collect()
    });
    for client in clients {
        let lost = touched.is_some_and(|t| t.keyframes.iter().any(|id| id.client == client));
        // A client whose last keyframe went has no frame any more.
        let gone = || {
            let client_id = map.client(client)?.name.clone();
            lost.then(|| v1::ClientFrame { client_id, ..v1::ClientFrame::default() })
        };
        let frame = to_client_frame(map, client).or_else(gone);
        if let Some(frame) = frame.filter(|frame| sent.needs_client_frame(client, frame)) {
            parts.room(&frame).await?.client_frames.push(frame);
        }
    }
    parts.send(true).await?;
    sent.took(map);
    Ok(())
}
