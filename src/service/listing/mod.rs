//! Pages of `JobService`, pages and streams of `MapService`: jobs, maps, trajectories, landmarks,
//! keyframes, constraints, searches for places.
//!
//! A page token names the last entry of its page, so that a later call continues after it whatever
//! has changed since. A token is valid only for the list that it was made for. Streams send about 1
//! MiB per message. `pager.rs` cuts a stream into messages, `mask.rs` leaves out fields; longer lists
//! have a file. Nothing here changes a map.

mod constraints;
mod keyframes;
mod landmarks;
mod mask;
mod pager;

use prost::Message;
use sha2::{Digest as _, Sha256};

use super::context::Sink;
use super::convert::entities::{clients_by_name, to_keyframe_pose, to_place_search};
use super::convert::{Path, Violations, convert};
use super::error::ServiceError;
use crate::map::{ClientIndex, Map, Reason};
use crate::wire::v1;

pub(super) use constraints::{constraint_pages, constraints};
pub(super) use keyframes::{keyframe_pages, keyframes};
pub(super) use landmarks::{landmark_pages, landmarks};
use pager::{Pager, Pages};

/// Size at which a streamed message is cut, bytes.
pub(super) const MESSAGE_BYTES: usize = 1 << 20;
/// Maps or jobs in a page if the request gives no number.
const DEFAULT_ROWS: usize = 100;
/// Most maps or jobs in a page.
const MAX_ROWS: i64 = 1000;
/// Bytes of a repeated message's tag and length, at most.
pub(super) const ENTRY_OVERHEAD: usize = 6;

/// A list with pages: its call, and the owner of its entries.
#[derive(Clone, Debug)]
pub(super) struct PagedList {
    call: &'static str,
    owner: String,
}

impl PagedList {
    /// The answers of `call`; `owner` tells one list of that call from another.
    pub(super) fn new(call: &'static str, owner: impl Into<String>) -> Self {
        Self { call, owner: owner.into() }
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
            let text = format!("not a page token of this server for this {}", self.call);
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

/// How many maps or jobs a page has, and the one after which it begins.
pub(super) fn page(
    page_size: i32,
    page_token: &str,
    list: &PagedList,
) -> Result<(usize, String), ServiceError> {
    let page = convert(|out| {
        let size = out.within(Path::root("page_size"), page_size, 0, MAX_ROWS);
        let after = match page_token {
            "" => Some(""),
            token => list.last(token, out),
        };
        Some((if size? == 0 { DEFAULT_ROWS } else { size? }, after?.to_owned()))
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

/// Reads the paging fields of a request.
pub(super) fn place_search_pages(
    request: &v1::ListPlaceSearchesRequest,
    out: &mut Violations,
) -> Option<Pages> {
    let list = PagedList::new("ListPlaceSearches", &request.map_id);
    Pages::of(list, request.page_size, &request.page_token, out)
}

/// Streams the searches for known places by client name, then keyframe.
pub(super) async fn place_searches(
    map: &Map,
    pages: &Pages,
    sink: &Sink<v1::ListPlaceSearchesResponse>,
) -> Result<(), ServiceError> {
    let mut pager = Pager::new(map.revision(), pages, sink);
    for range in pages.ranges(map) {
        for (&id, search) in map.place_searches().done.range(range.ids.clone()) {
            pager.push(to_place_search(map, id, search), range.position(id, None)).await?;
        }
    }
    pager.finish().await
}
