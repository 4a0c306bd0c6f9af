//! Pages and streams of `MapService`: maps, trajectories, landmarks.
//!
//! A page token names the last entry of its page, so that a later call continues after it whatever
//! has changed since. A token is valid only for the list that it was made for. Streams send about 1
//! MiB per message.

use prost::Message;
use sha2::{Digest as _, Sha256};

use super::context::Sink;
use super::convert::entities::{clients_by_name, to_keyframe_pose, to_landmark};
use super::convert::{Path, Violations, convert};
use super::error::ServiceError;
use crate::map::{ClientIndex, EntityId, Landmark, Map, Reason};
use crate::wire::v1;

/// Size at which a streamed message is cut, bytes.
pub(super) const MESSAGE_BYTES: usize = 1 << 20;
/// Maps in a page if the request gives no number.
const DEFAULT_MAPS: usize = 100;
/// Most maps in a page.
const MAX_MAPS: i64 = 1000;
/// Most landmarks in a message.
const MAX_LANDMARKS: i64 = 10_000;
/// Bytes of a repeated message's tag and length, at most.
pub(super) const ENTRY_OVERHEAD: usize = 6;

/// A list with pages: its call, and the owner of its entries.
#[derive(Clone, Debug)]
pub(super) struct PagedList {
    call: &'static str,
    owner: String,
}

impl PagedList {
    /// The maps of a tenant.
    pub(super) fn maps(tenant: &str) -> Self {
        Self { call: "ListMaps", owner: tenant.to_owned() }
    }

    /// The landmarks of a map.
    fn landmarks(map_id: &str) -> Self {
        Self { call: "ListLandmarks", owner: map_id.to_owned() }
    }

    /// The token of the page after the entry that `last` names.
    pub(super) fn token(&self, last: &str) -> String {
        format!("{last}.{}", self.mark(last))
    }

    /// The entry that a token names; reports one that was not made for this list.
    fn last<'t>(&self, token: &'t str, out: &mut Violations) -> Option<&'t str> {
        let parts = token.rsplit_once('.');
        let last = parts.filter(|(last, mark)| self.mark(last) == *mark).map(|(last, _)| last);
        last.or_else(|| {
            let text = format!("no token that this server gave for this {}", self.call);
            out.report(Path::root("page_token"), Reason::OutOfRange, text)
        })
    }

    /// Detects tokens that are invalid or belong to another list; it does not protect against
    /// forgery.
    fn mark(&self, last: &str) -> String {
        let mut hash = Sha256::new();
        for part in [self.call, &self.owner, last] {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        hash.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect()
    }
}

/// How many maps a page has, and the map after which it begins.
pub(super) fn map_page(
    request: &v1::ListMapsRequest,
    list: &PagedList,
) -> Result<(usize, String), ServiceError> {
    let page = convert(|out| {
        let size = out.within(Path::root("page_size"), request.page_size, 0, MAX_MAPS);
        let after = match request.page_token.as_str() {
            "" => Some(""),
            token => list.last(token, out),
        };
        Some((if size? == 0 { DEFAULT_MAPS } else { size? }, after?.to_owned()))
    })?;
    Ok(page)
}

/// Streams the poses of all clients, or of one.
pub(super) async fn trajectory(
    map: &Map,
    only: Option<ClientIndex>,
    sink: &Sink<v1::GetTrajectoryResponse>,
) -> Result<(), ServiceError> {
    let revision = map.revision();
    let mut message = v1::GetTrajectoryResponse { revision, poses: Vec::new() };
    let (mut bytes, mut sent) = (0, false);
    for (_, client) in clients_by_name(map) {
        if only.is_some_and(|only| only != client) {
            continue;
        }
        for (id, keyframe) in map.trajectory(client) {
            let pose = to_keyframe_pose(map, id, keyframe);
            let size = pose.encoded_len() + ENTRY_OVERHEAD;
            if bytes + size > MESSAGE_BYTES {
                let poses = std::mem::take(&mut message.poses);
                sink.send(v1::GetTrajectoryResponse { revision, poses }).await?;
                (bytes, sent) = (0, true);
            }
            bytes += size;
            message.poses.push(pose);
        }
    }
    if !sent || !message.poses.is_empty() {
        sink.send(message).await?;
    }
    Ok(())
}

/// The options of `ListLandmarks`.
#[derive(Clone, Debug)]
pub(super) struct LandmarkPages {
    /// Landmarks in a message; `None` for as many as fit.
    page_size: Option<usize>,
    /// Continues after this landmark: client name and id.
    after: Option<(String, i64)>,
    /// Which fields are returned.
    mask: Mask,
    list: PagedList,
}

/// Fields of a landmark that are returned besides its ids.
#[derive(Clone, Copy, Debug)]
struct Mask {
    position: bool,
    reference: bool,
    observation_count: bool,
    state: bool,
}

/// Reads the paging fields of a request.
pub(super) fn landmark_pages(
    request: &v1::ListLandmarksRequest,
    out: &mut Violations,
) -> Option<LandmarkPages> {
    let size = out.within(Path::root("page_size"), request.page_size, 0, MAX_LANDMARKS);
    let list = PagedList::landmarks(&request.map_id);
    let after = match request.page_token.as_str() {
        "" => Some(None),
        token => list.last(token, out).and_then(landmark).map(Some),
    };
    let mask = mask(request.read_mask.as_ref(), out);
    let page_size = Some(size?).filter(|&size| size > 0);
    Some(LandmarkPages { page_size, after: after?, mask: mask?, list })
}

fn mask(mask: Option<&prost_types::FieldMask>, out: &mut Violations) -> Option<Mask> {
    let Some(mask) = mask else {
        return Some(Mask {
            position: true,
            reference: true,
            observation_count: true,
            state: true,
        });
    };
    let mut fields =
        Mask { position: false, reference: false, observation_count: false, state: false };
    for path in &mask.paths {
        match path.as_str() {
            // Ids are always returned; descriptors are not kept yet.
            "client_id" | "id" | "descriptor" => {}
            "point_in_world" => fields.position = true,
            "reference_keyframe" => fields.reference = true,
            "observation_count" => fields.observation_count = true,
            "state" => fields.state = true,
            unknown => {
                let text = format!("{unknown:?} is no field of Landmark");
                return out.report(Path::root("read_mask"), Reason::UnknownValue, text);
            }
        }
    }
    Some(fields)
}

fn masked(message: v1::Landmark, mask: Mask) -> v1::Landmark {
    v1::Landmark {
        point_in_world: message.point_in_world.filter(|_| mask.position),
        reference_keyframe: message.reference_keyframe.filter(|_| mask.reference),
        observation_count: if mask.observation_count { message.observation_count } else { 0 },
        state: if mask.state { message.state } else { 0 },
        ..message
    }
}

/// A landmark in a token, `id.client`.
fn landmark(last: &str) -> Option<(String, i64)> {
    let (id, client) = last.split_once('.')?;
    Some((client.to_owned(), id.parse().ok()?))
}

/// Streams the landmarks by client name, then id.
pub(super) async fn landmarks(
    map: &Map,
    pages: &LandmarkPages,
    sink: &Sink<v1::ListLandmarksResponse>,
) -> Result<(), ServiceError> {
    let revision = map.revision();
    let mut page = v1::ListLandmarksResponse { revision, ..Default::default() };
    let mut bytes = 0;
    for (id, landmark) in behind(map, pages.after.as_ref()) {
        let landmark = masked(to_landmark(map, id, landmark), pages.mask);
        let size = landmark.encoded_len() + ENTRY_OVERHEAD;
        let is_full = pages.page_size.is_some_and(|most| page.landmarks.len() >= most);
        if is_full || (bytes + size > MESSAGE_BYTES && !page.landmarks.is_empty()) {
            let last = page.landmarks.last();
            page.next_page_token = last
                .map(|l| format!("{}.{}", l.id, l.client_id))
                .map_or_else(String::new, |last| pages.list.token(&last));
            sink.send(page).await?;
            page = v1::ListLandmarksResponse { revision, ..Default::default() };
            bytes = 0;
        }
        bytes += size;
        page.landmarks.push(landmark);
    }
    sink.send(page).await
}

/// The landmarks in the order of the stream, after the one that a token names.
fn behind<'m>(
    map: &'m Map,
    after: Option<&(String, i64)>,
) -> impl Iterator<Item = (EntityId, &'m Landmark)> {
    let clients = clients_by_name(map).into_iter();
    let after = after.cloned();
    clients.flat_map(move |(name, client)| {
        let first = match &after {
            Some((last, _)) if name < last.as_str() => None,
            Some((last, id)) if name == last => id.checked_add(1),
            _ => Some(i64::MIN),
        };
        let range =
            first.map(|first| EntityId::new(client, first)..=EntityId::new(client, i64::MAX));
        range.into_iter().flat_map(move |r| map.landmarks().range(r).map(|(&id, l)| (id, l)))
    })
}
