//! Watching a map: what changed since a reader's last step, however slow the reader is.
//!
//! The watcher's own task folds the engine's log (`watching`) into a set of ids, as long as they
//! are not too many; values are read from the newest snapshot. The size of the map bounds the memory
//! of a watcher. Revisions are never skipped, only joined. The changes between the revision that a
//! watcher has and the revision where its watch begins are read from the journal, one piece at a
//! time, unless the range costs more than the full state. Only a few watchers of a server read at
//! once, and reading changes nothing.

use std::collections::BTreeSet;
use std::sync::Arc;

use tokio::sync::watch;

use crate::map::{Change, Event, Map};
use crate::meter::GaugeGuard;
use crate::service::engine::journal::sequence_of;
use crate::service::engine::watching::touched::{Touched, most_touched};
use crate::service::engine::watching::{LogRead, LogReader, OpenedWatch};
use crate::service::engine::{EngineError, MapHandle, MapInfo, MapState, PendingWork, Reservation};
use crate::store::StoreError;

/// Most watchers of a server that read journals at once; the others wait.
pub(crate) const READERS: usize = 2;
/// At least this many bytes of a journal may be read, however small the map is.
const LEAST_BYTES: u64 = 4 << 20;

/// A step of a watched map.
#[derive(Clone, Debug)]
pub struct MapChange {
    /// Whether the reader must drop what it has: it begins, or too many ids were touched. Then
    /// `touched` is not valid, and the snapshot is the full state.
    pub reset: bool,
    /// The revision before the step.
    pub base_revision: i64,
    /// The revision after the step.
    pub revision: i64,
    /// Whether the map accepts changes.
    pub state: MapState,
    /// What the engine still does by itself.
    pub pending: PendingWork,
    /// The ids that were touched between the two revisions.
    pub touched: Touched,
    /// The map at `revision`.
    pub snapshot: Arc<Map>,
}

/// Ids that were touched, as long as they are not too many.
#[derive(Debug)]
pub(crate) struct Gathered {
    pub(crate) touched: Touched,
    /// Whether there were too many ids, or some are unknown.
    pub(crate) reset: bool,
    /// Most ids that are kept.
    most: usize,
}

impl Gathered {
    pub(crate) fn new(most: usize) -> Self {
        Self { touched: Touched::default(), reset: false, most }
    }

    /// Drops the gathered ids: the reader gets the full state.
    pub(crate) fn reset(&mut self) {
        self.reset = true;
        self.touched = Touched::default();
    }

    pub(crate) fn join(&mut self, touched: &Touched, with_landmarks: bool) {
        if !self.reset {
            self.touched.join(touched, with_landmarks);
            self.check();
        }
    }

    /// Resets if there are too many ids.
    pub(crate) fn check(&mut self) {
        if self.touched.is_all || self.touched.len() > self.most {
            self.reset();
        }
    }
}

/// A watched map.
#[derive(Debug)]
pub struct Watch {
    handle: MapHandle,
    log: LogReader,
    signal: watch::Receiver<()>,
    /// Most bytes of the journal that are read for what was missed: about the cost of the full state.
    most_bytes: u64,
    /// The ids gathered so far for the next change.
    gathered: Gathered,
    /// Whether ids of landmarks are gathered.
    with_landmarks: bool,
    /// Names of clients that opened a stream before the log begins.
    opened: BTreeSet<String>,
    /// The revision and state that the reader got last, initially those of the start.
    sent: (i64, MapState),
    /// Whether the reader knows that the map is settled.
    told_settled: bool,
    /// Whether the map may have changed since.
    due: bool,
    /// A change that is not durable yet.
    pending: Option<MapChange>,
    _reservations: [Reservation; 2],
    _open: GaugeGuard,
}

impl Watch {
    /// A watch of a map, whose changes are in the log from now on. Its first step is the full state, unless
    /// [`Watch::resume_from`] finds what came since an earlier one.
    pub(crate) fn new(handle: MapHandle, opened: OpenedWatch) -> Self {
        let OpenedWatch { map, state, log, signal, reservations } = opened;
        let mut gathered = Gathered::new(most_touched(&map));
        gathered.reset();
        Self {
            log,
            signal,
            most_bytes: map.usage().bytes.max(LEAST_BYTES),
            gathered,
            with_landmarks: true,
            opened: BTreeSet::new(),
            sent: (map.revision(), state),
            told_settled: false,
            due: true,
            pending: None,
            _reservations: reservations,
            _open: handle.shared.meters.watchers.hold(),
            handle,
        }
    }

    /// Gathers no ids of landmarks from here on: the reader does not want them.
    pub fn omit_landmarks(&mut self) {
        self.with_landmarks = false;
        self.gathered.touched.landmarks = BTreeSet::new();
    }

    /// Waits for the next step, which joins all changes since the last one. Canceling loses
    /// nothing.
    ///
    /// # Errors
    /// Why watching ended: [`EngineError::MapNotFound`] when the map was deleted,
    /// [`EngineError::ShuttingDown`].
    pub async fn next(&mut self) -> Result<MapChange, EngineError> {
        loop {
            if let Some(change) = &self.pending {
                // A change is returned once no crash can undo it.
                self.handle.durable(change.revision).await?;
            }
            if let Some(change) = self.pending.take() {
                return Ok(change);
            }
            if !self.due {
                self.changed().await?;
            }
            self.signal.borrow_and_update();
            let info = self.handle.info().await?;
            if let Some(merged) = &self.handle.merged {
                merged.entry_in(&info.snapshot)?;
            }
            let (revision, state) = (info.snapshot.revision(), info.state);
            self.fold(revision).await;
            // There is no await from here on, so that canceling cannot split the step.
            self.due = false;
            let settles = info.pending.is_settled() && !self.told_settled;
            if self.sent == (revision, state) && !self.gathered.reset && !settles {
                continue;
            }
            self.pending = Some(self.step(info));
        }
    }

    /// Gathers what the map's events touch while the reader is busy with an earlier step, so that
    /// the log need not keep it. Never returns; canceling loses nothing.
    pub async fn gather(&mut self) {
        loop {
            self.fold(i64::MAX).await;
            if self.changed().await.is_err() {
                // The next call of [`Watch::next`] returns the reason.
                std::future::pending::<()>().await;
            }
        }
    }

    /// Waits until the map or its state may have changed.
    async fn changed(&mut self) -> Result<(), EngineError> {
        let changed = self.signal.changed().await;
        changed.map_err(|_closed| self.handle.end_error())?;
        self.due = true;
        Ok(())
    }

    fn step(&mut self, info: MapInfo) -> MapChange {
        let MapInfo { snapshot, state, pending, .. } = info;
        let next = Gathered::new(most_touched(&snapshot));
        let Gathered { mut touched, reset, .. } = std::mem::replace(&mut self.gathered, next);
        let opened = std::mem::take(&mut self.opened).into_iter();
        touched.clients.extend(opened.filter_map(|name| snapshot.client_named(&name)));
        let (revision, base_revision) = (snapshot.revision(), self.sent.0);
        (self.sent, self.told_settled) = ((revision, state), pending.is_settled());
        MapChange { reset, base_revision, revision, state, pending, touched, snapshot }
    }

    /// Folds the entries of the log up to revision `through`.
    async fn fold(&mut self, through: i64) {
        loop {
            match self.log.take(through) {
                LogRead::Nothing => return,
                LogRead::Lost => self.gathered.reset(),
                LogRead::Some(some, most) => {
                    self.gathered.most = most;
                    let with_landmarks = self.with_landmarks;
                    some.iter().for_each(|touched| self.gathered.join(touched, with_landmarks));
                }
            }
            // Lets other tasks run, above all the engine.
            tokio::task::yield_now().await;
        }
    }

    /// Continues from `revision`, which the reader has. The changes between it and the start are
    /// read from the journal, without the engine. If that is not possible, the watch begins with the
    /// full state.
    pub(crate) async fn resume_from(&mut self, revision: i64) {
        let through = self.log.at();
        self.sent.0 = revision;
        self.gathered.reset = false;
        if revision >= through {
            return;
        }
        let handle = self.handle.clone();
        let (most, most_bytes) = (self.gathered.most, self.most_bytes);
        let read = tokio::select! {
            read = read(&handle, revision, through, most, most_bytes) => read,
            () = self.gather() => None,
        };
        match read {
            Some((touched, opened)) => {
                self.gathered.join(&touched, self.with_landmarks);
                self.opened = opened;
            }
            None => self.gathered.reset(),
        }
    }
}

/// What was touched, and the names of the clients that opened streams.
type History = (Touched, BTreeSet<String>);

/// Reads the events after `from` up to `through`. `None` if the full state is cheaper, because they are
/// more events or ids than `most` or more than `most_bytes`, or if the events do not name everything
/// that changed: then the reader needs the full state.
async fn read(
    handle: &MapHandle,
    from: i64,
    through: i64,
    most: usize,
    most_bytes: u64,
) -> Option<History> {
    let events = usize::try_from(through.saturating_sub(from)).unwrap_or(usize::MAX);
    if events > most {
        return None;
    }
    let turn = handle.shared.history.acquire().await;
    // The semaphore is never closed.
    let _turn = turn.ok()?;
    match pieces(handle, from, through, most, most_bytes).await {
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
    most: usize,
    most_bytes: u64,
) -> Result<Option<History>, EngineError> {
    let (store, name) = (&handle.shared.store, &handle.shared.name);
    let mut reader = store.reader(name, sequence_of(from), sequence_of(through)).await?;
    let mut gathered = Gathered::new(most);
    let (mut opened, mut bytes, mut last) = (BTreeSet::new(), 0, from);
    loop {
        let piece = reader.next().await?;
        let Some(end) = piece.events.last() else { break };
        last = end.revision;
        bytes += piece.bytes;
        let is_known = piece.events.iter().all(|event| add(event, &mut gathered, &mut opened));
        if !is_known || gathered.reset || bytes > most_bytes {
            return Ok(None);
        }
        // Lets other tasks run, above all the engine.
        tokio::task::yield_now().await;
    }
    // A journal that is cut off by damage has fewer events.
    Ok((last == through).then_some((gathered.touched, opened)))
}

/// Adds the ids that the event touched. False if they are too many, or not all known: what changes
/// with a removed entity is known only with the map before it.
fn add(event: &Event, gathered: &mut Gathered, opened: &mut BTreeSet<String>) -> bool {
    if event.change.changes_others() {
        return false;
    }
    if let Change::ClientOpened { name, .. } = &event.change {
        opened.insert(name.clone());
    }
    gathered.touched.add(&event.change);
    gathered.check();
    !gathered.reset
}
