//! `ListKeyframes`: the keyframes of a map by client name, then id.
//!
//! Observations are returned only where the mask names them. A keyframe with more of them than fit a
//! message is sent in several entries: each has the ids and the next observations, the first one
//! also the other fields. Only reads the map.

use prost::Message;

use super::super::context::Sink;
use super::super::convert::entities::{to_descriptor, to_keyframe, to_observation};
use super::super::convert::{Path, Violations};
use super::super::error::ServiceError;
use super::pager::{Pager, Pages};
use super::{ENTRY_OVERHEAD, MESSAGE_BYTES, PagedList};
use crate::map::{Map, Reason};
use crate::wire::v1;

/// Bytes that an entry leaves for its ids and for its poses.
const ENTRY_BYTES: usize = MESSAGE_BYTES - 1024;

/// The options of `ListKeyframes`.
#[derive(Clone, Debug)]
pub(in crate::service) struct KeyframePages {
    pages: Pages,
    /// Which fields are returned.
    mask: Mask,
}

/// Fields of a keyframe that are returned besides its ids.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Mask {
    capture_time: bool,
    sensor: bool,
    world_from_camera: bool,
    odom_from_camera: bool,
    observations: bool,
    global_descriptor: bool,
}

/// Reads the paging fields and the mask of a request.
pub(in crate::service) fn keyframe_pages(
    request: &v1::ListKeyframesRequest,
    out: &mut Violations,
) -> Option<KeyframePages> {
    let list = PagedList::of_map("ListKeyframes", &request.map_id);
    let pages = Pages::of(list, request.page_size, &request.page_token, out);
    let mask = mask(request.read_mask.as_ref(), out);
    Some(KeyframePages { pages: pages?, mask: mask? })
}

fn mask(mask: Option<&prost_types::FieldMask>, out: &mut Violations) -> Option<Mask> {
    let Some(mask) = mask else {
        return Some(Mask {
            capture_time: true,
            sensor: true,
            world_from_camera: true,
            odom_from_camera: true,
            observations: false,
            global_descriptor: false,
        });
    };
    let mut fields = Mask::default();
    for path in &mask.paths {
        match path.as_str() {
            // Ids are always returned. A keyframe has no rig yet, its landmarks are entities of
            // their own.
            "client_id" | "id" | "rig_id" | "world_from_rig" | "landmarks" => {}
            "global_descriptor" => fields.global_descriptor = true,
            "capture_time" => fields.capture_time = true,
            "camera_id" => fields.sensor = true,
            "world_from_camera" => fields.world_from_camera = true,
            "odom_from_camera" => fields.odom_from_camera = true,
            "observations" => fields.observations = true,
            unknown => {
                let text = format!("{unknown:?} is no field of Keyframe");
                return out.report(Path::root("read_mask"), Reason::UnknownValue, text);
            }
        }
    }
    Some(fields)
}

fn masked(message: v1::Keyframe, mask: Mask) -> v1::Keyframe {
    v1::Keyframe {
        capture_time: message.capture_time.filter(|_| mask.capture_time),
        sensor: message.sensor.filter(|_| mask.sensor),
        world_from_camera: message.world_from_camera.filter(|_| mask.world_from_camera),
        odom_from_camera: message.odom_from_camera.filter(|_| mask.odom_from_camera),
        ..message
    }
}

/// Streams the keyframes by client name, then id.
pub(in crate::service) async fn keyframes(
    map: &Map,
    KeyframePages { pages, mask }: &KeyframePages,
    sink: &Sink<v1::ListKeyframesResponse>,
) -> Result<(), ServiceError> {
    let mut pager = Pager::new(map.revision(), pages, sink);
    for range in pages.ranges(map) {
        for (&id, keyframe) in map.keyframes().range(range.ids.clone()) {
            let sent = range.sent(id);
            let mut entry = match sent {
                0 => masked(to_keyframe(map, id, keyframe), *mask),
                _ => ids_only(range.name, id.id),
            };
            let image = keyframe.global_descriptor.as_deref();
            entry.global_descriptor =
                image.filter(|_| sent == 0 && mask.global_descriptor).map(to_descriptor);
            let mut bytes = entry.global_descriptor.as_ref().map_or(0, Message::encoded_len);
            let rest = keyframe.observations.iter().skip(sent).filter(|_| mask.observations);
            for (sent, observation) in (sent..).zip(rest) {
                let message = to_observation(map, observation);
                let size = message.encoded_len() + ENTRY_OVERHEAD;
                if bytes + size > ENTRY_BYTES && !entry.observations.is_empty() {
                    let part = std::mem::replace(&mut entry, ids_only(range.name, id.id));
                    pager.push(part, range.place(id, Some(sent))).await?;
                    bytes = 0;
                }
                bytes += size;
                entry.observations.push(message);
            }
            pager.push(entry, range.place(id, None)).await?;
        }
    }
    pager.finish().await
}

fn ids_only(client: &str, id: i64) -> v1::Keyframe {
    v1::Keyframe { client_id: client.to_owned(), id, ..v1::Keyframe::default() }
}
