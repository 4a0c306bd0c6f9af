//! `ListConstraints`: relative poses and priors of a map by client name, then id.
//!
//! Both kinds share one space of ids, and so one list; those of the server have negative ids. Only
//! reads the map.

use super::super::context::Sink;
use super::super::convert::Violations;
use super::super::convert::entities::to_any_constraint;
use super::super::error::ServiceError;
use super::PagedList;
use super::pager::{Pager, Pages};
use crate::map::{EntityId, Map};
use crate::wire::v1;

/// Reads the paging fields of a request.
pub(in crate::service) fn constraint_pages(
    request: &v1::ListConstraintsRequest,
    out: &mut Violations,
) -> Option<Pages> {
    let list = PagedList::new("ListConstraints", &request.map_id);
    Pages::of(list, request.page_size, &request.page_token, out)
}

/// Streams the constraints by client name, then id.
pub(in crate::service) async fn constraints(
    map: &Map,
    pages: &Pages,
    sink: &Sink<v1::ListConstraintsResponse>,
) -> Result<(), ServiceError> {
    let mut pager = Pager::new(map.revision(), pages, sink);
    for range in pages.ranges(map) {
        let relative = map.constraints().range(range.ids.clone()).map(id_of);
        let priors = map.priors().range(range.ids.clone()).map(id_of);
        for id in merged(relative, priors) {
            if let Some(entry) = to_any_constraint(map, id) {
                pager.push(entry, range.position(id, None)).await?;
            }
        }
    }
    pager.finish().await
}

fn id_of<V>((&id, _): (&EntityId, &V)) -> EntityId {
    id
}

/// The ids of two ascending lists in ascending order.
fn merged(
    one: impl Iterator<Item = EntityId>,
    other: impl Iterator<Item = EntityId>,
) -> impl Iterator<Item = EntityId> {
    let (mut one, mut other) = (one.peekable(), other.peekable());
    std::iter::from_fn(move || match (one.peek(), other.peek()) {
        (Some(first), Some(second)) if first > second => other.next(),
        (Some(_), _) => one.next(),
        (None, _) => other.next(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::ClientIndex;

    #[test]
    fn two_lists_are_merged_in_the_order_of_ids() {
        let ids = |ids: &[i64]| -> Vec<EntityId> {
            ids.iter().map(|&id| EntityId::new(ClientIndex(0), id)).collect()
        };
        for (one, other) in [(&[-4, 1, 5, 6][..], &[2, 7][..]), (&[], &[1]), (&[1], &[])] {
            let mut all = ids(&[one, other].concat());
            all.sort_unstable();
            let merged: Vec<_> = merged(ids(one).into_iter(), ids(other).into_iter()).collect();
            assert_eq!(merged, all);
        }
    }
}
