//! Watching a map: what changed since a reader last looked, however slow it is.
//!
//! The engine writes what an event touches into one log for all watchers ([`WatchLog`]) and answers
//! with snapshots: constant work a watcher. All else is done in the watcher's own task: it folds the
//! log into a set of ids, and what lies before its start it reads from the journal (`history.rs`). Values
//! are read in the newest snapshot. The memory of a watcher is bounded by the map, and revisions are
//! never skipped, only joined.

use std::sync::Arc;

use tokio::sync::watch;

use super::history::{self, Past};
use super::touched::Touched;
use super::watch_log::{LogReader, Taken, WatchLog};
use super::{EngineError, MapHandle, MapState, Reservation};
use crate::map::{Change, Map};
use crate::meter::Held;

/// More ids than this and than the map has entities are not kept: the reader gets the full state.
const LEAST_TOUCHED: usize = 10_000;

/// A step of a watched map.
#[derive(Clone, Debug)]
pub struct MapChange {
    /// Whether the reader drops what it holds, because too much was touched to be told: then
    /// `touched` is of no use, and the snapshot is the full state.
    pub reset: bool,
    /// What the reader held.
    pub base_revision: i64,
    /// What it holds after the step.
    pub revision: i64,
    /// Whether the map takes changes.
    pub state: MapState,
    /// What lies between the two.
    pub touched: Touched,
    /// The map at `revision`.
    pub snapshot: Arc<Map>,
}

/// Ids that were touched, as long as they are not too many.
#[derive(Debug)]
pub(super) struct Gathered {
    pub(super) touched: Touched,
    /// Whether there were too many, or some are not known.
    pub(super) reset: bool,
    /// More ids than this are not kept.
    most: usize,
}

impl Gathered {
    pub(super) fn new(most: usize) -> Self {
        Self { touched: Touched::default(), reset: false, most }
    }

    /// Gives up what was gathered: the full state is told.
    pub(super) fn reset(&mut self) {
        self.reset = true;
        self.touched = Touched::default();
    }

    pub(super) fn join(&mut self, touched: &Touched) {
        if !self.reset {
            self.touched.join(touched);
            self.check();
        }
    }

    /// Resets where there are too many ids.
    pub(super) fn check(&mut self) {
        if self.touched.len() > self.most {
            self.reset();
        }
    }
}

/// How many ids a watcher of `map` keeps.
pub(super) fn most_touched(map: &Map) -> usize {
    let constraints = map.constraints().len() + map.priors().len();
    let held = map.keyframes().len() + map.landmarks().len() + constraints;
    LEAST_TOUCHED.max(held + map.cameras().len() + map.clients().len())
}

/// A watched map.
#[derive(Debug)]
pub struct Watch {
    /// The full state to begin with; absent when the reader goes on from a revision it holds.
    pub reset: Option<Arc<Map>>,
    /// The revision that the first change starts from.
    pub base_revision: i64,
    /// The map's state at the start.
    pub state: MapState,
    handle: MapHandle,
    log: LogReader,
    signal: watch::Receiver<()>,
    /// What the next change has so far.
    gathered: Gathered,
    /// Names of clients that opened a stream before the log begins.
    opened: Vec<String>,
    /// What the reader was told last, the start included.
    sent: (i64, MapState),
    /// Whether the map may have changed since.
    due: bool,
    /// A change that is not durable yet.
    pending: Option<MapChange>,
    _place: [Reservation; 2],
    _open: Held,
}

impl Watch {
    /// The next step, joined from everything since the last one; waits until there is something.
    /// Canceling loses nothing.
    ///
    /// # Errors
    /// Why watching ended: [`EngineError::MapNotFound`] when the map was deleted,
    /// [`EngineError::ShuttingDown`].
    pub async fn next(&mut self) -> Result<MapChange, EngineError> {
        loop {
            if let Some(change) = &self.pending {
                // Once no crash can take it back.
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
            let (revision, state) = (info.snapshot.revision(), info.state);
            self.fold(revision).await;
            // From here on nothing waits: the step is taken whole.
            self.due = false;
            if self.sent == (revision, state) && !self.gathered.reset {
                continue;
            }
            self.pending = Some(self.step(info.snapshot, state));
        }
    }

    /// Gathers what the map's events touch while the reader is busy with an earlier step, so that
    /// the engine need not keep it. Never ends; canceling loses nothing.
    pub async fn gather(&mut self) {
        loop {
            self.fold(i64::MAX).await;
            if self.changed().await.is_err() {
                // Whoever asks for the next step is told why.
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

    fn step(&mut self, snapshot: Arc<Map>, state: MapState) -> MapChange {
        let next = Gathered::new(most_touched(&snapshot));
        let Gathered { mut touched, reset, .. } = std::mem::replace(&mut self.gathered, next);
        let opened = std::mem::take(&mut self.opened).into_iter();
        touched.clients.extend(opened.filter_map(|name| snapshot.client_named(&name)));
        let (revision, base_revision) = (snapshot.revision(), self.sent.0);
        self.sent = (revision, state);
        MapChange { reset, base_revision, revision, state, touched, snapshot }
    }

    /// Takes what the log has, up to `through`.
    async fn fold(&mut self, through: i64) {
        loop {
            match self.log.take(through) {
                Taken::Nothing => return,
                Taken::Lost => self.gathered.reset(),
                Taken::Some(some, most) => {
                    self.gathered.most = most;
                    some.iter().for_each(|touched| self.gathered.join(touched));
                }
            }
            // Others have work too, the engine above all.
            tokio::task::yield_now().await;
        }
    }

    /// Goes on from `revision`, which the reader holds: what lies between it and the start is read
    /// from the journal, beside the engine. Where that cannot be told, the watch begins with a reset.
    pub(super) async fn go_on_from(
        &mut self,
        revision: i64,
        past: Past,
    ) -> Result<(), EngineError> {
        let through = self.log.at();
        self.base_revision = revision;
        self.sent.0 = revision;
        if revision >= through {
            return Ok(());
        }
        self.due = true;
        let handle = self.handle.clone();
        let read = tokio::select! {
            read = history::read(&handle, revision, through, &past) => read,
            () = self.gather() => None,
        };
        match read {
            Some(read) => {
                self.gathered.join(&read.touched);
                self.opened = read.opened.into_iter().collect();
            }
            None => self.gathered.reset(),
        }
        if !self.gathered.reset {
            return Ok(());
        }
        let info = self.handle.info().await?;
        (self.base_revision, self.state) = (info.snapshot.revision(), info.state);
        self.sent = (self.base_revision, self.state);
        self.fold(self.base_revision).await;
        self.gathered = Gathered::new(most_touched(&info.snapshot));
        self.reset = Some(info.snapshot);
        Ok(())
    }
}

/// The engine's side: the log, and who wakes its watchers.
pub(super) struct Watchers {
    signal: watch::Sender<()>,
    log: WatchLog,
}

impl Watchers {
    pub(super) fn new() -> Self {
        Self { signal: watch::Sender::new(()), log: WatchLog::default() }
    }

    /// Adds a watcher that holds `map`.
    pub(super) fn open(
        &self,
        handle: MapHandle,
        map: &Map,
        state: MapState,
        place: [Reservation; 2],
    ) -> Watch {
        let revision = map.revision();
        Watch {
            reset: None,
            base_revision: revision,
            state,
            log: self.log.reader(revision),
            signal: self.signal.subscribe(),
            gathered: Gathered::new(most_touched(map)),
            opened: Vec::new(),
            sent: (revision, state),
            due: false,
            pending: None,
            _place: place,
            _open: handle.shared.meters.watchers.hold(),
            handle,
        }
    }

    /// Tells the watchers of an event that is about to change `map`.
    pub(super) fn tell(&self, change: &Change, map: &Map) {
        if self.log.is_read() {
            let mut touched = Touched::default();
            touched.add(change, map);
            let most = most_touched(map) + touched.len();
            self.log.push(map.revision().saturating_add(1), touched, most);
        }
    }

    /// Wakes the watchers: the map or its state has changed.
    pub(super) fn wake(&self) {
        self.signal.send_replace(());
    }
}
