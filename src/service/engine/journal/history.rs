//! Earlier states of a map, replayed from what the store keeps.
//!
//! A state is replayed from the latest snapshot before it, or from the first event, a piece of the journal at
//! a time: only the map itself is in memory. If the store drops what is being read, the search begins again.
//! The engine of the map is not involved, and nothing is changed.

use std::sync::Arc;

use crate::map::{Event, Map};
use crate::service::engine::error::report_bug;
use crate::service::engine::journal::{replay, sequence_of, unix_time_ns};
use crate::service::engine::{EngineError, PastState};
use crate::store::{Store, StoreError};

/// How often the search begins again.
const TRIES: u32 = 8;

/// Which state of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// The one at this revision.
    Revision(i64),
    /// The last one before the first event that is later than this, Unix time in nanoseconds by the server's
    /// clock.
    Time(i64),
}

impl Moment {
    /// The field of a request that names it.
    fn field(self) -> &'static str {
        match self {
            Self::Revision(_) => "revision",
            Self::Time(_) => "time",
        }
    }

    /// Whether it is at a state or behind it.
    fn reaches(self, state: PastState) -> bool {
        match self {
            Self::Revision(revision) => state.revision <= revision,
            Self::Time(time_ns) => state.time_ns <= time_ns,
        }
    }

    /// Whether it is still to come.
    fn is_ahead(self, newest: PastState, now_ns: i64) -> bool {
        match self {
            Self::Revision(revision) => revision > newest.revision,
            Self::Time(time_ns) => time_ns > now_ns.max(newest.time_ns),
        }
    }
}

impl PastState {
    /// The state that a map is in.
    pub(crate) fn of(map: &Map) -> Self {
        Self { revision: map.revision(), time_ns: map.update_time_ns() }
    }
}

/// Why a state is not found.
enum Missing {
    /// It is not between the oldest state, which is this one, and the newest.
    Outside(PastState),
    /// The store has dropped what it was to be replayed from.
    Dropped,
    Failed(EngineError),
}

impl From<StoreError> for Missing {
    fn from(error: StoreError) -> Self {
        if let StoreError::Truncated { .. } = error {
            Self::Dropped
        } else {
            Self::Failed(error.into())
        }
    }
}

/// The map called `name` as it was at a moment, at most as it is at `newest`. `grown` sees it while it grows
/// and may refuse.
///
/// # Errors
/// [`EngineError::NotKept`] with the oldest state that can be replayed, [`EngineError::Store`], and what
/// `grown` answers.
pub(crate) async fn map_at(
    store: &dyn Store,
    name: &str,
    moment: Moment,
    newest: PastState,
    mut grown: impl FnMut(&Map) -> Result<(), EngineError>,
) -> Result<Map, EngineError> {
    let map = name.to_owned();
    for _ in 0..TRIES {
        match replayed(store, name, moment, newest, &mut grown).await {
            Ok(map) => return Ok(map),
            Err(Missing::Outside(oldest)) => {
                return Err(EngineError::NotKept { map, field: moment.field(), oldest, newest });
            }
            Err(Missing::Dropped) => {}
            Err(Missing::Failed(error)) => return Err(error),
        }
    }
    let cause = "its journal is dropped faster than it can be read".to_owned();
    Err(StoreError::Unavailable { map, cause }.into())
}

async fn replayed(
    store: &dyn Store,
    name: &str,
    moment: Moment,
    newest: PastState,
    grown: &mut impl FnMut(&Map) -> Result<(), EngineError>,
) -> Result<Map, Missing> {
    let mut map = begin(store, name, moment, newest).await?;
    grown(&map).map_err(Missing::Failed)?;
    let through = match moment {
        Moment::Revision(revision) => sequence_of(revision),
        Moment::Time(_) => sequence_of(newest.revision),
    };
    let mut reader = store.reader(name, sequence_of(map.revision()), through).await?;
    while sequence_of(map.revision()) < through {
        let mut events = reader.next().await?.events;
        if events.is_empty() {
            return Err(lost(name, map.revision() + 1));
        }
        let later = match moment {
            Moment::Revision(_) => None,
            Moment::Time(time_ns) => events.iter().position(|event| event.time_ns > time_ns),
        };
        events.truncate(later.unwrap_or(events.len()));
        map = folded(name, map, events).await.map_err(Missing::Failed)?;
        grown(&map).map_err(Missing::Failed)?;
        if later.is_some() {
            break;
        }
    }
    Ok(map)
}

/// The latest state that is kept and that the moment reaches.
async fn begin(
    store: &dyn Store,
    name: &str,
    moment: Moment,
    newest: PastState,
) -> Result<Map, Missing> {
    let kept = store.replayable_from(name).await?;
    let is_ahead = moment.is_ahead(newest, unix_time_ns(store));
    for (index, &sequence) in kept.iter().enumerate().rev() {
        let is_behind = match moment {
            Moment::Revision(revision) => sequence > sequence_of(revision),
            // When it was is known by the snapshot itself.
            Moment::Time(_) => false,
        };
        if index > 0 && (is_ahead || is_behind) {
            continue;
        }
        let map = begun(store, name, sequence).await?;
        let state = PastState::of(&map);
        if !is_ahead && moment.reaches(state) {
            return Ok(map);
        }
        if index == 0 {
            return Err(Missing::Outside(state));
        }
    }
    let (map, cause) = (name.to_owned(), "no state is kept whole".to_owned());
    Err(Missing::Failed(StoreError::Failed { map, cause }.into()))
}

/// The map at a snapshot; for 0, after its first event.
async fn begun(store: &dyn Store, name: &str, sequence: u64) -> Result<Map, Missing> {
    if sequence > 0 {
        let map = store.snapshot_at(name, sequence).await?.ok_or(Missing::Dropped)?;
        return Ok(Arc::unwrap_or_clone(map));
    }
    let first = store.reader(name, 0, 1).await?.next().await?.events;
    if first.is_empty() {
        return Err(lost(name, 1));
    }
    folded(name, Map::new(), first).await.map_err(Missing::Failed)
}

fn lost(name: &str, revision: i64) -> Missing {
    let (map, cause) =
        (name.to_owned(), format!("the journal does not give event {revision} back"));
    Missing::Failed(StoreError::Failed { map, cause }.into())
}

/// The map after some more events.
async fn folded(name: &str, map: Map, events: Vec<Arc<Event>>) -> Result<Map, EngineError> {
    let replaying = move || replay(map, events.iter().map(AsRef::as_ref));
    match tokio::task::spawn_blocking(replaying).await {
        Ok((map, None)) => Ok(map),
        Ok((_, Some(stopped))) => Err(stopped.of(name).into()),
        Err(error) if error.is_panic() => Err(report_bug(&error.to_string())),
        Err(_canceled) => Err(EngineError::ShuttingDown),
    }
}
