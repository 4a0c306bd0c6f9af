//! `ListLandmarks`: the landmarks of a map by client name, then id.
//!
//! Which fields are returned is the request's; descriptors are not kept yet. Only reads the map.

use super::super::context::Sink;
use super::super::convert::Violations;
use super::super::convert::entities::to_landmark;
use super::super::error::ServiceError;
use super::PagedList;
use super::mask::{Field, LeaveOut, left_out};
use super::pager::{Pager, Pages};
use crate::map::Map;
use crate::wire::v1;

/// The options of `ListLandmarks`.
#[derive(Clone, Debug)]
pub(in crate::service) struct LandmarkPages {
    pages: Pages,
    left_out: Vec<LeaveOut<v1::Landmark>>,
}

/// The fields that a mask can name. Ids are always returned; descriptors are not kept yet.
const FIELDS: [Field<v1::Landmark>; 8] = [
    ("client_id", |_| {}),
    ("id", |_| {}),
    ("descriptor", |_| {}),
    ("point_in_world", |landmark| landmark.point_in_world = None),
    ("reference_keyframe", |landmark| landmark.reference_keyframe = None),
    ("observation_count", |landmark| landmark.observation_count = 0),
    ("state", |landmark| landmark.state = 0),
    ("duplicate_of", |landmark| landmark.duplicate_of = None),
];

/// Reads the paging fields and the mask of a request.
pub(in crate::service) fn landmark_pages(
    request: &v1::ListLandmarksRequest,
    out: &mut Violations,
) -> Option<LandmarkPages> {
    let list = PagedList::new("ListLandmarks", &request.map_id);
    let pages = Pages::of(list, request.page_size, &request.page_token, out);
    let left_out = left_out(request.read_mask.as_ref(), &FIELDS, "Landmark", out);
    Some(LandmarkPages { pages: pages?, left_out: left_out? })
}

/// Streams the landmarks by client name, then id.
pub(in crate::service) async fn landmarks(
    map: &Map,
    LandmarkPages { pages, left_out }: &LandmarkPages,
    sink: &Sink<v1::ListLandmarksResponse>,
) -> Result<(), ServiceError> {
    let mut pager = Pager::new(map.revision(), pages, sink);
    for range in pages.ranges(map) {
        for (&id, landmark) in map.landmarks().range(range.ids.clone()) {
            let mut entry = to_landmark(map, id, landmark);
            left_out.iter().for_each(|leave_out| leave_out(&mut entry));
            pager.push(entry, range.position(id, None)).await?;
        }
    }
    pager.finish().await
}
