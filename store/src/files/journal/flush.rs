//! Flushes of a journal: pending events are written and synced in groups, until nothing is pending or
//! something is used up. What is accepted is not decided here.

use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::super::MARK;
use super::super::record::mark;
use super::super::writer::{Group, JournalLocation, WriteError};
use super::Journal;
use crate::StoreError;

/// Delay before a write that lacked space, descriptors or memory is tried again; it doubles each
/// time.
const FIRST_RETRY: Duration = Duration::from_millis(100);
/// The longest time between two tries.
const LONGEST_RETRY: Duration = Duration::from_secs(5);

impl Journal {
    /// Runs [`Journal::flush`] after `delay` where the disk runs blocking work, and repeats it
    /// while it returns a delay. Needs a tokio runtime.
    pub(in crate::files) fn start_flush(journal: Arc<Self>, delay: Option<Duration>) {
        let runtime = tokio::runtime::Handle::current();
        if let Some(delay) = delay {
            runtime.spawn(async move {
                tokio::time::sleep(delay).await;
                Self::start_flush(journal, None);
            });
            return;
        }
        let disk = Arc::clone(&journal.disk);
        disk.spawn(Box::new(move || {
            if let Some(delay) = journal.flush() {
                let _entered = runtime.enter();
                Self::start_flush(journal, Some(delay));
            }
        }));
    }

    /// Writes and syncs until nothing is pending, or until a resource is used up; then returns the
    /// delay until the next try. Blocks.
    pub(in crate::files) fn flush(&self) -> Option<Duration> {
        loop {
            // Locked again for each group, so that other users of the files get the lock in
            // between.
            let mut writer = self.writer();
            {
                let mut state = self.state();
                if state.failed.is_some() {
                    writer.end();
                }
                if writer.group.is_none() && !state.pending.is_empty() {
                    let bytes = std::mem::take(&mut state.pending);
                    let (first, last) = (state.pending_first, state.last);
                    writer.group = Some(Group { bytes, first, last });
                }
                if writer.is_idle() {
                    state.flushing = false;
                    return None;
                }
            }
            let start = Instant::now();
            let (disk, folder, uid) = (&*self.disk, &*self.folder, &self.uid);
            let segment_bytes = self.options.segment_bytes;
            let written = writer.write(&JournalLocation { disk, folder, uid, segment_bytes });
            match written {
                Ok(()) => {}
                Err(WriteError::Passes(error)) => return Some(self.wait(&error)),
                Err(WriteError::Fatal(error)) => {
                    self.failed_flush(&error);
                    writer.end();
                    return None;
                }
            }
            let group = writer.group.take();
            if let Some(group) = &group {
                self.meters.sync_ns.observe_time(start.elapsed());
                self.meters.group_events.observe(group.last.saturating_sub(group.first) + 1);
                self.meters.journal_bytes.add(group.bytes.len() as u64);
            }
            let (is_idle, durable) = {
                let mut state = self.state();
                // Without a group, the write made durable what the start found.
                state.durable = group.as_ref().map_or(state.last, |group| group.last);
                state.retries = 0;
                if state.unavailable.take().is_some() {
                    tracing::info!(map = %self.name, "the journal goes on");
                }
                (state.pending.is_empty() && group.is_some(), state.durable)
            };
            self.tell();
            // The mark is optional: without it, damage at the end may go unnoticed.
            if is_idle
                && let Err(error) =
                    self.disk.overwrite(&self.folder.join(MARK), &mark(&self.uid, durable))
            {
                tracing::warn!(map = %self.name, %error, "the mark was not written");
            }
        }
    }

    /// A resource is used up: accepts nothing new. Returns the delay until the next try.
    fn wait(&self, error: &io::Error) -> Duration {
        self.meters.journal_retries.increment();
        let mut state = self.state();
        let delay = FIRST_RETRY.saturating_mul(1 << state.retries.min(10)).min(LONGEST_RETRY);
        state.retries = state.retries.saturating_add(1);
        let map = self.name.clone();
        let unavailable = StoreError::Unavailable { map, cause: error.to_string() };
        let is_new = state.failed.is_none() && state.unavailable.is_none();
        if state.failed.is_none() {
            state.unavailable = Some(unavailable);
        }
        drop(state);
        if is_new {
            let folder = self.folder.display();
            tracing::error!(map = %self.name, %folder, %error, "the journal waits and tries again");
            self.tell();
        }
        delay
    }

    fn failed_flush(&self, error: &io::Error) {
        // Counted before the failure is reported, so that a caller that gets the report sees the
        // count.
        self.meters.journal_failures.increment();
        let stopped = self.stop(error.to_string());
        let folder = self.folder.display();
        tracing::error!(map = %self.name, %folder, error = %stopped, "the journal stops");
        self.state().flushing = false;
    }
}
