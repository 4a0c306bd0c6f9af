//! `ListPlaceSearches`: what the searches for known places found, by client name, then keyframe.
//!
//! Only reads the map.

use super::super::context::Sink;
use super::super::convert::Violations;
use super::super::convert::entities::to_place_search;
use super::super::error::ServiceError;
use super::PagedList;
use super::pager::{Pager, Pages};
use crate::map::Map;
use crate::wire::v1;

/// Reads the paging fields of a request.
pub(in crate::service) fn place_search_pages(
    request: &v1::ListPlaceSearchesRequest,
    out: &mut Violations,
) -> Option<PlaceSearchPages> {
    let list = PagedList::of_map("ListPlaceSearches", &request.map_id);
    let pages = Pages::of(list, request.page_size, &request.page_token, out)?;
    Some(PlaceSearchPages(pages))
}

/// The options of `ListPlaceSearches`.
#[derive(Clone, Debug)]
pub(in crate::service) struct PlaceSearchPages(Pages);

/// Streams the searches by client name, then keyframe.
pub(in crate::service) async fn place_searches(
    map: &Map,
    PlaceSearchPages(pages): &PlaceSearchPages,
    sink: &Sink<v1::ListPlaceSearchesResponse>,
) -> Result<(), ServiceError> {
    let mut pager = Pager::new(map.revision(), pages, sink);
    for range in pages.ranges(map) {
        for (&id, search) in map.place_searches().done.range(range.ids.clone()) {
            pager.push(to_place_search(map, id, search), range.place(id, None)).await?;
        }
    }
    pager.finish().await
}
