//! `ListKeyframes`: the keyframes of a map by client name, then id.
//!
//! Observations are returned only where the mask names them. A keyframe with more of them than fit a
//! message is sent in several entries: each has the ids and the next observations, the first one
//! also the other fields. Only reads the map.

use prost::Message;

use super::super::context::Sink;
use super::super::convert::Violations;
use super::super::convert::entities::{to_descriptor, to_keyframe, to_observation};
use super::super::error::ServiceError;
use super::mask::{Field, LeaveOut, left_out};
use super::pager::{Pager, Pages};
use super::{ENTRY_OVERHEAD, MESSAGE_BYTES, PagedList};
use crate::map::Map;
use crate::wire::v1;

/// Bytes that an entry leaves for its ids and for its poses.
const ENTRY_BYTES: usize = MESSAGE_BYTES - 1024;

/// The options of `ListKeyframes`.
#[derive(Clone, Debug)]
pub(in crate::service) struct KeyframePages {
    pages: Pages,
    left_out: Vec<LeaveOut<v1::Keyframe>>,
    /// Whether observations are returned.
    observations: bool,
    /// Whether the descriptor of the image is returned.
    global_descriptor: bool,
}

/// The fields that a mask can name. Ids are always returned. A keyframe has no rig yet, its landmarks are
/// entities of their own. What is last is long, and made only where it is named.
const FIELDS: [Field<v1::Keyframe>; 11] = [
    ("client_id", |_| {}),
    ("id", |_| {}),
    ("rig_id", |_| {}),
    ("world_from_rig", |_| {}),
    ("landmarks", |_| {}),
    ("capture_time", |keyframe| keyframe.capture_time = None),
    ("camera_id", |keyframe| keyframe.sensor = None),
    ("world_from_camera", |keyframe| keyframe.world_from_camera = None),
    ("odom_from_camera", |keyframe| keyframe.odom_from_camera = None),
    ("observations", |_| {}),
    ("global_descriptor", |_| {}),
];

/// Reads the paging fields and the mask of a request.
pub(in crate::service) fn keyframe_pages(
    request: &v1::ListKeyframesRequest,
    out: &mut Violations,
) -> Option<KeyframePages> {
    let list = PagedList::new("ListKeyframes", &request.map_id);
    let pages = Pages::of(list, request.page_size, &request.page_token, out);
    let mask = request.read_mask.as_ref();
    let left_out = left_out(mask, &FIELDS, "Keyframe", out);
    let is_named = |field| mask.is_some_and(|mask| mask.paths.iter().any(|path| path == field));
    Some(KeyframePages {
        pages: pages?,
        left_out: left_out?,
        observations: is_named("observations"),
        global_descriptor: is_named("global_descriptor"),
    })
}

/// Streams the keyframes by client name, then id.
pub(in crate::service) async fn keyframes(
    map: &Map,
    options: &KeyframePages,
    sink: &Sink<v1::ListKeyframesResponse>,
) -> Result<(), ServiceError> {
    let KeyframePages { pages, left_out, observations, global_descriptor } = options;
    let mut pager = Pager::new(map.revision(), pages, sink);
    for range in pages.ranges(map) {
        for (&id, keyframe) in map.keyframes().range(range.ids.clone()) {
            let sent = range.sent(id);
            let mut entry = match sent {
                0 => to_keyframe(map, id, keyframe),
                _ => ids_only(range.name, id.id),
            };
            left_out.iter().for_each(|leave_out| leave_out(&mut entry));
            let image = keyframe.global_descriptor.as_deref();
            entry.global_descriptor =
                image.filter(|_| sent == 0 && *global_descriptor).map(to_descriptor);
            let mut bytes = entry.global_descriptor.as_ref().map_or(0, Message::encoded_len);
            let rest = keyframe.observations.iter().skip(sent).filter(|_| *observations);
            for (sent, observation) in (sent..).zip(rest) {
                let message = to_observation(map, observation);
                let size = message.encoded_len() + ENTRY_OVERHEAD;
                if bytes + size > ENTRY_BYTES && !entry.observations.is_empty() {
                    let part = std::mem::replace(&mut entry, ids_only(range.name, id.id));
                    pager.push(part, range.position(id, Some(sent))).await?;
                    bytes = 0;
                }
                bytes += size;
                entry.observations.push(message);
            }
            pager.push(entry, range.position(id, None)).await?;
        }
    }
    pager.finish().await
}

fn ids_only(client: &str, id: i64) -> v1::Keyframe {
    v1::Keyframe { client_id: client.to_owned(), id, ..v1::Keyframe::default() }
}
