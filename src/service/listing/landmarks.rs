//! `ListLandmarks`: the landmarks of a map by client name, then id.
//!
//! Which fields are returned is the request's; descriptors are not kept yet. Only reads the map.

use super::super::context::Sink;
use super::super::convert::entities::to_landmark;
use super::super::convert::{Path, Violations};
use super::super::error::ServiceError;
use super::PagedList;
use super::pager::{Pager, Pages};
use crate::map::{Map, Reason};
use crate::wire::v1;

/// The options of `ListLandmarks`.
#[derive(Clone, Debug)]
pub(in crate::service) struct LandmarkPages {
    pages: Pages,
    /// Which fields are returned.
    mask: Mask,
}

/// Fields of a landmark that are returned besides its ids.
#[derive(Clone, Copy, Debug)]
struct Mask {
    position: bool,
    reference: bool,
    observation_count: bool,
    state: bool,
    duplicate_of: bool,
}

/// Reads the paging fields and the mask of a request.
pub(in crate::service) fn landmark_pages(
    request: &v1::ListLandmarksRequest,
    out: &mut Violations,
) -> Option<LandmarkPages> {
    let list = PagedList::of_map("ListLandmarks", &request.map_id);
    let pages = Pages::of(list, request.page_size, &request.page_token, out);
    let mask = mask(request.read_mask.as_ref(), out);
    Some(LandmarkPages { pages: pages?, mask: mask? })
}

fn mask(mask: Option<&prost_types::FieldMask>, out: &mut Violations) -> Option<Mask> {
    let Some(mask) = mask else {
        return Some(Mask {
            position: true,
            reference: true,
            observation_count: true,
            state: true,
            duplicate_of: true,
        });
    };
    let mut fields = Mask {
        position: false,
        reference: false,
        observation_count: false,
        state: false,
        duplicate_of: false,
    };
    for path in &mask.paths {
        match path.as_str() {
            // Ids are always returned; descriptors are not kept yet.
            "client_id" | "id" | "descriptor" => {}
            "point_in_world" => fields.position = true,
            "reference_keyframe" => fields.reference = true,
            "observation_count" => fields.observation_count = true,
            "state" => fields.state = true,
            "duplicate_of" => fields.duplicate_of = true,
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
        duplicate_of: message.duplicate_of.filter(|_| mask.duplicate_of),
        ..message
    }
}

/// Streams the landmarks by client name, then id.
pub(in crate::service) async fn landmarks(
    map: &Map,
    LandmarkPages { pages, mask }: &LandmarkPages,
    sink: &Sink<v1::ListLandmarksResponse>,
) -> Result<(), ServiceError> {
    let mut pager = Pager::new(map.revision(), pages, sink);
    for range in pages.ranges(map) {
        for (&id, landmark) in map.landmarks().range(range.ids.clone()) {
            let entry = masked(to_landmark(map, id, landmark), *mask);
            pager.push(entry, range.place(id, None)).await?;
        }
    }
    pager.finish().await
}
