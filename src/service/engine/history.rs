//! What lies between the revision that a watcher holds and the one at which it began to watch.
//!
//! It is read from the journal by the watcher's own task, a piece at a time, and folded into a set of
//! ids: the engine takes no part. A range that costs more than the full state is not read to its
//! end, and only a few watchers of a server read at once. Must not change anything.

use std::collections::BTreeSet;

use super::touched::Touched;
use super::watch::{Gathered, most_touched};
use super::{EngineError, MapHandle};
use crate::map::{Change, Event, Map};
use crate::store::StoreError;

/// Watchers of a server that read the journal at once; the others wait in turn.
pub(super) const READERS: usize = 2;
/// So many bytes of a journal are read for a map of any size.
const LEAST_BYTES: u64 = 4 << 20;

/// How much history is read: no more than the full state would take.
#[derive(Clone, Copy, Debug)]
pub(super) struct Past {
    /// Events, and ids that they touched.
    entities: usize,
    /// Bytes of the journal.
    bytes: u64,
}

impl Past {
    /// The bounds for `map`.
    pub(super) fn of(map: &Map) -> Self {
        let entities = most_touched(map);
        Self { entities, bytes: map.usage().bytes.max(LEAST_BYTES) }
    }
}

/// What was read.
pub(super) struct History {
    pub(super) touched: Touched,
    /// Names of the clients that opened streams.
    pub(super) opened: BTreeSet<String>,
}

/// Reads the events behind `from` up to `through`. `None` where the full state is cheaper or the
/// events do not tell everything: then it has to be told.
pub(super) async fn read(
    handle: &MapHandle,
    from: i64,
    through: i64,
    past: &Past,
) -> Option<History> {
    let events = usize::try_from(through.saturating_sub(from)).unwrap_or(usize::MAX);
    if events > past.entities {
        return None;
    }
    let turn = handle.shared.history.acquire().await;
    // Nobody closes it.
    let _turn = turn.ok()?;
    match pieces(handle, from, through, past).await {
        Ok(history) => history,
        Err(EngineError::Store(StoreError::Truncated { .. })) => None,
        Err(error) => {
            tracing::warn!(%error, "the journal cannot be read");
            None
        }
    }
}

async fn pieces(
    handle: &MapHandle,
    from: i64,
    through: i64,
    past: &Past,
) -> Result<Option<History>, EngineError> {
    let revision = |revision: i64| u64::try_from(revision).unwrap_or(0);
    let (store, name) = (&handle.shared.store, &handle.shared.name);
    let mut reader = store.reader(name, revision(from), revision(through)).await?;
    let mut gathered = Gathered::new(past.entities);
    let (mut opened, mut bytes, mut last) = (BTreeSet::new(), 0, from);
    loop {
        let piece = reader.next().await?;
        let Some(end) = piece.events.last() else { break };
        last = end.revision;
        bytes += piece.bytes;
        let is_told = piece.events.iter().all(|event| add(event, &mut gathered, &mut opened));
        if !is_told || gathered.reset || bytes > past.bytes {
            return Ok(None);
        }
        // Others have work too, the engine above all.
        tokio::task::yield_now().await;
    }
    // A journal that was cut by damage has fewer.
    let history = History { touched: gathered.touched, opened };
    Ok((last == through).then_some(history))
}

/// Whether the event tells what it touched: what went with a keyframe cannot be told without the map
/// before it.
fn add(event: &Event, gathered: &mut Gathered, opened: &mut BTreeSet<String>) -> bool {
    if event.change.removes_keyframe() {
        return false;
    }
    if let Change::ClientOpened { name, .. } = &event.change {
        opened.insert(name.clone());
    }
    gathered.touched.add_values(&event.change);
    gathered.check();
    !gathered.reset
}
