//! Watching: a log of what the last events touched, shared by all watchers of a map.
//!
//! The engine adds one entry per event, whatever the number of watchers, and wakes them; each
//! watcher folds the entries into its own set, in its own task. An entry is dropped when every
//! watcher has read it. The oldest entries are dropped when there are too many ids; a watcher that
//! has not read them yet gets the full state instead. So the engine's cost of an event depends only
//! on what the event touches, and a watcher that does not read costs nothing.

pub(crate) mod touched;

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use tokio::sync::watch;

use crate::map::Map;
use crate::service::engine::watching::touched::{Touched, most_touched};
use crate::service::engine::{MapState, Reservation};
use crate::sync::Mutex;

/// Most ids that are kept for watchers that have not read them; the newest entry is always kept.
const MOST_IDS: usize = 1 << 16;
/// Most entries that a watcher takes at once, so that it holds the lock only briefly.
const MOST_TAKEN: usize = 64;

/// A watch as its caller gets it.
pub(crate) struct OpenedWatch {
    pub(crate) map: Arc<Map>,
    pub(crate) state: MapState,
    pub(crate) log: LogReader,
    /// Wakes the watcher.
    pub(crate) signal: watch::Receiver<()>,
    /// A watcher and a stream.
    pub(crate) reservations: [Reservation; 2],
}

/// What the engine tells the watchers of a map.
#[derive(Default)]
pub(crate) struct Watching {
    signal: watch::Sender<()>,
    log: Arc<Mutex<Entries>>,
}

#[derive(Debug, Default)]
struct Entries {
    /// The revision of the last entry.
    newest: i64,
    /// One entry per revision, in increasing order.
    touched: VecDeque<Arc<Touched>>,
    /// Number of ids in all entries, plus one for each entry.
    ids: usize,
    /// Most ids that a watcher keeps.
    most: usize,
    /// Revisions up to which watchers have read, and the number of watchers at each.
    readers: BTreeMap<i64, usize>,
}

impl Watching {
    /// Adds a watcher of a map at `revision`: its position in the log, and the signal that wakes it.
    pub(crate) fn open(&self, revision: i64) -> (LogReader, watch::Receiver<()>) {
        let mut entries = self.log.lock();
        if entries.readers.is_empty() {
            entries.newest = revision;
        }
        *entries.readers.entry(revision).or_default() += 1;
        drop(entries);
        (LogReader { log: Arc::clone(&self.log), at: revision }, self.signal.subscribe())
    }

    /// Whether there are watchers.
    pub(crate) fn is_watched(&self) -> bool {
        !self.log.lock().readers.is_empty()
    }

    /// Logs what the next event touches; `map` is the map before it.
    pub(crate) fn tell(&self, touched: Touched, map: &Map) {
        let most = most_touched(map) + touched.len();
        self.push(map.revision().saturating_add(1), touched, most);
    }

    /// Adds what the event of `revision` touches; a watcher now keeps up to `most` ids.
    fn push(&self, revision: i64, touched: Touched, most: usize) {
        let mut entries = self.log.lock();
        entries.most = most;
        let gone = entries.push(revision, Arc::new(touched));
        drop(entries);
        // Sets are dropped after the lock is released.
        drop(gone);
    }

    /// Wakes the watchers: the map or its state has changed.
    pub(crate) fn wake(&self) {
        self.signal.send_replace(());
    }
}

impl Entries {
    /// The revision before that of the first entry.
    fn floor(&self) -> i64 {
        self.newest.saturating_sub(i64::try_from(self.touched.len()).unwrap_or(i64::MAX))
    }

    /// Adds an entry. Returns the entries that are dropped.
    fn push(&mut self, revision: i64, touched: Arc<Touched>) -> Vec<Arc<Touched>> {
        if self.readers.is_empty() {
            return Vec::new();
        }
        // After a panic the log may have an entry of an event that the map does not have.
        let mut gone = match self.newest.checked_add(1) {
            Some(next) if next == revision => Vec::new(),
            _ => self.drop_first(self.touched.len()),
        };
        self.newest = revision;
        self.ids += touched.len() + 1;
        self.touched.push_back(touched);
        while self.ids > MOST_IDS && self.touched.len() > 1 {
            gone.extend(self.drop_first(1));
        }
        gone
    }

    /// Moves a reader. Returns the entries that no reader needs any more.
    fn read(&mut self, from: i64, to: Option<i64>) -> Vec<Arc<Touched>> {
        if let Some(count) = self.readers.get_mut(&from) {
            *count -= 1;
            if *count == 0 {
                self.readers.remove(&from);
            }
        }
        if let Some(to) = to {
            *self.readers.entry(to).or_default() += 1;
        }
        let least = self.readers.first_key_value().map_or(self.newest, |(&least, _)| least);
        let read = usize::try_from(least.saturating_sub(self.floor())).unwrap_or(0);
        self.drop_first(read.min(self.touched.len()))
    }

    fn drop_first(&mut self, count: usize) -> Vec<Arc<Touched>> {
        let gone: Vec<_> = self.touched.drain(..count).collect();
        self.ids -= gone.iter().map(|touched| touched.len() + 1).sum::<usize>();
        gone
    }
}

/// What [`LogReader::take`] finds.
#[derive(Debug)]
pub(crate) enum LogRead {
    /// The next entries, in order, and how many ids a watcher now keeps.
    Some(Vec<Arc<Touched>>, usize),
    /// All entries were taken.
    Nothing,
    /// Entries were dropped that the reader had not taken.
    Lost,
}

/// A watcher's position in the log; dropping it removes the watcher.
#[derive(Debug)]
pub(crate) struct LogReader {
    log: Arc<Mutex<Entries>>,
    at: i64,
}

impl LogReader {
    /// The revision up to which entries were taken.
    pub(crate) fn at(&self) -> i64 {
        self.at
    }

    /// Takes some of the next entries, up to that of revision `through`.
    pub(crate) fn take(&mut self, through: i64) -> LogRead {
        let mut entries = self.log.lock();
        let through = through.min(entries.newest);
        if self.at >= through {
            return LogRead::Nothing;
        }
        let (from, skipped) = (self.at, self.at - entries.floor());
        let (taken, to) = match usize::try_from(skipped) {
            Err(_negative) => (LogRead::Lost, through),
            Ok(skipped) => {
                let count = usize::try_from(through - from).unwrap_or(usize::MAX).min(MOST_TAKEN);
                let some: Vec<_> =
                    entries.touched.iter().skip(skipped).take(count).map(Arc::clone).collect();
                let to = from + i64::try_from(some.len()).unwrap_or(i64::MAX);
                (LogRead::Some(some, entries.most), to)
            }
        };
        self.at = to;
        let gone = entries.read(from, Some(to));
        drop(entries);
        drop(gone);
        taken
    }
}

impl Drop for LogReader {
    fn drop(&mut self) {
        let _gone = self.log.lock().read(self.at, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{ClientIndex, EntityId};

    /// An event that touches `count` landmarks.
    fn touched(count: i64) -> Touched {
        let ids = (0..count).map(|id| EntityId::new(ClientIndex(0), id));
        Touched { landmarks: ids.collect(), ..Touched::default() }
    }

    /// Entries and ids that are kept.
    fn kept(watching: &Watching) -> (usize, usize) {
        let entries = watching.log.lock();
        (entries.touched.len(), entries.ids)
    }

    fn count(reader: &mut LogReader) -> Option<usize> {
        let mut count = 0;
        loop {
            match reader.take(i64::MAX) {
                LogRead::Some(some, _) => count += some.len(),
                LogRead::Nothing => return Some(count),
                LogRead::Lost => return None,
            }
        }
    }

    #[test]
    fn without_watchers_nothing_is_kept() {
        let log = Watching::default();
        log.push(1, touched(3), 0);
        assert!(!log.is_watched());
        assert_eq!(kept(&log), (0, 0));
    }

    #[test]
    fn an_entry_is_kept_once_and_until_every_watcher_has_it() {
        let log = Watching::default();
        let (mut fast, mut slow) = (log.open(7).0, log.open(7).0);
        (8..108).for_each(|revision| log.push(revision, touched(2), 0));
        assert_eq!(count(&mut fast), Some(100));
        assert_eq!(kept(&log), (100, 300));
        assert_eq!(count(&mut slow), Some(100));
        assert_eq!(kept(&log), (0, 0));
        log.push(108, touched(2), 0);
        assert_eq!(count(&mut fast), Some(1));
        drop(slow);
        assert!(log.is_watched());
        assert_eq!(kept(&log), (0, 0));
        drop(fast);
        assert!(!log.is_watched());
    }

    #[test]
    fn what_is_kept_for_a_watcher_that_does_not_read_has_an_end() {
        let log = Watching::default();
        let (mut fast, mut stuck) = (log.open(0).0, log.open(0).0);
        for revision in 1..=200 {
            log.push(revision, touched(1000), 0);
            assert_eq!(count(&mut fast), Some(1));
            assert!(kept(&log).1 <= MOST_IDS);
        }
        assert_eq!(count(&mut stuck), None, "it begins anew");
        log.push(201, touched(1), 0);
        assert_eq!(count(&mut stuck), Some(1), "and goes on from there");
        assert_eq!(count(&mut fast), Some(1));
        // One event that touches the whole map is logged like any other.
        log.push(202, touched(2 * MOST_IDS as i64), 0);
        assert_eq!(count(&mut fast), Some(1));
    }
}
