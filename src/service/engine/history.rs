//! Changes between the revision that a watcher has and the revision where its watch begins.
//!
//! The watcher's own task reads them from the journal, one piece at a time, and folds them into a
//! set of ids; the engine is not involved. Reading stops when the range costs more than the full
//! state. Only a few watchers of a server read at once. Reading must not change anything.

use std::collections::BTreeSet;

use super::touched::Touched;
use super::watch::{Gathered, most_touched};
use super::{EngineError, MapHandle};
use crate::map::{Change, Event, Map};
use crate::store::StoreError;

/// Most watchers of a server that read journals at once; the others wait.
pub(super) const READERS: usize = 2;
/// At least this many bytes of a journal may be read, however small the map is.
const LEAST_BYTES: u64 = 4 << 20;

/// Limits of the history that is read: about the cost of the full state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Past {
    /// Most events, and most ids that they touched.
    entities: usize,
    /// Most bytes of the journal.
    bytes: u64,
}

impl Past {
    /// The bounds for `map`.
    pub(super) fn of(map: &Map) -> Self {
        let entities = most_touched(map);
        Self { entities, bytes: map.usage().bytes.max(LEAST_BYTES) }
    }
}

/// The history that was read.
pub(super) struct History {
    pub(super) touched: Touched,
    /// Names of the clients that opened streams.
    pub(super) opened: BTreeSet<String>,
}

/// Reads the events after `from` up to `through`. `None` if the full state is cheaper, or if the
/// events do not name everything that changed: then the reader needs the full state.
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
    // The semaphore is never closed.
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
        // Lets other tasks run, above all the engine.
        tokio::task::yield_now().await;
    }
    // A journal that is cut off by damage has fewer events.
    let history = History { touched: gathered.touched, opened };
    Ok((last == through).then_some(history))
}

/// Adds the ids that the event touched. False if they are too many, or not all known: what was
/// removed with a keyframe is known only with the map before it.
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
