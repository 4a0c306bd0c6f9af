//! Cuts a stream of entities into messages, and says where a later call continues.
//!
//! An entry is named by its position: client, id, and for an entity in several entries how much of it
//! was sent. Entities come by client name, then id; what they are and how they are read is not known
//! here.

use prost::Message;

use super::super::context::Sink;
use super::super::convert::entities::clients_by_name;
use super::super::convert::{Path, Violations};
use super::super::error::ServiceError;
use super::{ENTRY_OVERHEAD, MESSAGE_BYTES, PagedList};
use crate::map::{EntityId, Map};
use crate::wire::v1;

/// Most entries in a message.
const MAX_ENTRIES: i64 = 10_000;

/// The position of an entry in its list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ListPosition {
    /// The client that owns the entity.
    pub(super) client: String,
    /// The entity.
    pub(super) id: i64,
    /// Parts of the entity that were sent, if it is not complete.
    pub(super) sent: Option<usize>,
}

impl ListPosition {
    /// In a token, `id.client` or `id+sent.client`.
    fn text(&self) -> String {
        let Self { client, id, sent } = self;
        match sent {
            None => format!("{id}.{client}"),
            Some(sent) => format!("{id}+{sent}.{client}"),
        }
    }

    fn of_text(text: &str) -> Option<Self> {
        let (entity, client) = text.split_once('.')?;
        let (id, sent) = match entity.split_once('+') {
            None => (entity, None),
            Some((id, sent)) => (id, Some(sent.parse().ok()?)),
        };
        Some(Self { client: client.to_owned(), id: id.parse().ok()?, sent })
    }
}

/// The paging fields of a request.
#[derive(Clone, Debug)]
pub(in crate::service) struct Pages {
    /// Entries in a message; `None` for as many as fit.
    size: Option<usize>,
    /// Continues after this entry.
    after: Option<ListPosition>,
    list: PagedList,
}

impl Pages {
    /// Reads the paging fields of a request.
    pub(super) fn of(
        list: PagedList,
        page_size: i32,
        page_token: &str,
        out: &mut Violations,
    ) -> Option<Self> {
        let size = out.within(Path::root("page_size"), page_size, 0, MAX_ENTRIES);
        let after = match page_token {
            "" => Some(None),
            token => list.last(token, out).and_then(ListPosition::of_text).map(Some),
        };
        Some(Self { size: Some(size?).filter(|&size| size > 0), after: after?, list })
    }

    /// The ids that remain of each client, in the order of the stream.
    pub(super) fn ranges<'m>(&self, map: &'m Map) -> impl Iterator<Item = Range<'m>> {
        let after = self.after.clone();
        clients_by_name(map).into_iter().filter_map(move |(name, client)| {
            let (first, sent) = match &after {
                Some(last) if name < last.client.as_str() => return None,
                Some(last) if name == last.client => match last.sent {
                    Some(sent) => (last.id, sent),
                    None => (last.id.checked_add(1)?, 0),
                },
                Some(_) | None => (i64::MIN, 0),
            };
            let ids = EntityId::new(client, first)..=EntityId::new(client, i64::MAX);
            Some(Range { name, ids, continued: (EntityId::new(client, first), sent) })
        })
    }
}

/// The remaining ids of a client.
pub(super) struct Range<'m> {
    /// The client's name.
    pub(super) name: &'m str,
    /// Its remaining ids.
    pub(super) ids: std::ops::RangeInclusive<EntityId>,
    /// An entity, and how many of its parts an earlier message had.
    continued: (EntityId, usize),
}

impl Range<'_> {
    /// How many parts of an entity an earlier message had.
    pub(super) fn sent(&self, id: EntityId) -> usize {
        let (continued, sent) = self.continued;
        if id == continued { sent } else { 0 }
    }

    /// The position of an entity of which all parts up to `sent` are sent.
    pub(super) fn position(&self, id: EntityId, sent: Option<usize>) -> ListPosition {
        ListPosition { client: self.name.to_owned(), id: id.id, sent }
    }
}

/// A message of a list.
pub(super) trait Page {
    /// One entity, or a part of one.
    type Entry: Message;

    /// A message without entries.
    fn new(revision: i64) -> Self;
    fn entries(&mut self) -> &mut Vec<Self::Entry>;
    fn set_token(&mut self, token: String);
}

macro_rules! page {
    ($message:ty, $entry:ty, $entries:ident) => {
        impl Page for $message {
            type Entry = $entry;

            fn new(revision: i64) -> Self {
                Self { revision, ..Self::default() }
            }

            fn entries(&mut self) -> &mut Vec<$entry> {
                &mut self.$entries
            }

            fn set_token(&mut self, token: String) {
                self.next_page_token = token;
            }
        }
    };
}

page!(v1::ListLandmarksResponse, v1::Landmark, landmarks);
page!(v1::ListKeyframesResponse, v1::Keyframe, keyframes);
page!(v1::ListConstraintsResponse, v1::Constraint, constraints);
page!(v1::ListPlaceSearchesResponse, v1::PlaceSearch, searches);

/// The message that is being filled.
pub(super) struct Pager<'a, P: Page> {
    pages: &'a Pages,
    sink: &'a Sink<P>,
    revision: i64,
    page: P,
    bytes: usize,
    last: Option<ListPosition>,
}

impl<'a, P: Page> Pager<'a, P> {
    /// Of a list of the map at `revision`.
    pub(super) fn new(revision: i64, pages: &'a Pages, sink: &'a Sink<P>) -> Self {
        Self { pages, sink, revision, page: P::new(revision), bytes: 0, last: None }
    }

    /// Adds an entry. Sends the message first if the entry does not fit.
    pub(super) async fn push(
        &mut self,
        entry: P::Entry,
        position: ListPosition,
    ) -> Result<(), ServiceError> {
        let size = entry.encoded_len() + ENTRY_OVERHEAD;
        let count = self.page.entries().len();
        let is_full = self.pages.size.is_some_and(|most| count >= most);
        if let Some(last) = self.last.as_ref().filter(|_| count > 0)
            && (is_full || self.bytes + size > MESSAGE_BYTES)
        {
            let mut page = std::mem::replace(&mut self.page, P::new(self.revision));
            page.set_token(self.pages.list.token(&last.text()));
            self.sink.send(page).await?;
            self.bytes = 0;
        }
        self.bytes += size;
        self.page.entries().push(entry);
        self.last = Some(position);
        Ok(())
    }

    /// Sends the last message, without a token; it has no entries if the list is empty.
    pub(super) async fn finish(self) -> Result<(), ServiceError> {
        self.sink.send(self.page).await
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_read_as_it_was_written() {
        for (id, sent) in [(0, None), (7, Some(12)), (-3, None), (i64::MAX, Some(usize::MAX))] {
            let position = ListPosition { client: "robot-1".to_owned(), id, sent };
            assert_eq!(ListPosition::of_text(&position.text()), Some(position));
        }
        for text in ["", "7", "x.robot", "7+.robot", "7+-1.robot"] {
            assert_eq!(ListPosition::of_text(text), None, "{text}");
        }
    }
}
