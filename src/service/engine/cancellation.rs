//! Whether work may still change something: who cancels it or the work itself decides, once.
//!
//! Work asks [`Cancellation::commit`] before its first change. From then on nobody cancels it; if it
//! was canceled before, it changes nothing. So a caller knows at once which of both holds, also while
//! the work waits for a thread.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use covis_solvers::interrupt::Interrupt;
use tokio::sync::Notify;

/// The decision about one piece of work.
#[derive(Debug, Default)]
pub struct Cancellation {
    /// Whether the work makes its changes, once that is decided.
    commits: OnceLock<bool>,
    /// Ends solves early.
    flag: Arc<AtomicBool>,
    canceled: Notify,
}

impl Cancellation {
    /// Cancels the work. Returns whether it changes nothing; otherwise its changes are under way.
    pub fn cancel(&self) -> bool {
        let is_canceled = !self.commits.get_or_init(|| false);
        if is_canceled {
            self.flag.store(true, Ordering::Release);
            self.canceled.notify_waiters();
        }
        is_canceled
    }

    /// Asks before a change; returns whether the work may make its changes.
    pub fn commit(&self) -> bool {
        *self.commits.get_or_init(|| true)
    }

    /// Resolves once the work is canceled.
    pub async fn canceled(&self) {
        loop {
            let canceled = self.canceled.notified();
            if self.flag.load(Ordering::Acquire) {
                return;
            }
            canceled.await;
        }
    }

    /// Ends solves once the work is canceled.
    pub fn interrupt(&self) -> Interrupt {
        Interrupt::NEVER.or_when(Arc::clone(&self.flag))
    }

    /// Whether the work is canceled.
    pub fn is_canceled(&self) -> bool {
        self.flag.load(Ordering::Acquire)
    }

    /// Ends solves where nobody waits for the work any more; what is committed is finished.
    pub(super) fn abandon(&self) {
        self.flag.store(true, Ordering::Release);
    }

    /// The flag that ends solves.
    pub(super) fn flag(&self) -> &Arc<AtomicBool> {
        &self.flag
    }
}

#[cfg(test)]
mod tests {
    use super::Cancellation;

    #[tokio::test]
    async fn either_the_caller_or_the_work_decides() {
        let work = Cancellation::default();
        assert!(work.cancel() && work.cancel(), "canceled, and still");
        work.canceled().await;
        assert!(!work.commit());
        assert!(work.interrupt().is_due());
        let work = Cancellation::default();
        assert!(work.commit() && work.commit(), "may change, and still");
        assert!(!work.cancel());
        assert!(!work.is_canceled());
    }
}
