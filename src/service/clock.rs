//! What time it is, where that decides who may come in. Tests set it by hand: nothing waits for real
//! time to pass.
//!
//! Only expiry is measured by it; waits and budgets run on the runtime's own timers.

use std::time::{SystemTime, UNIX_EPOCH};

use tokio::sync::watch;

/// A clock of whole seconds since 1970 (UTC).
#[derive(Clone, Debug)]
pub enum Clock {
    /// The system's.
    System,
    /// One that stands still until the other end of the channel sets it.
    Manual(watch::Receiver<i64>),
}

impl Clock {
    /// The present time.
    pub(super) fn now(&self) -> i64 {
        match self {
            Self::System => {
                let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
                i64::try_from(since.as_secs()).unwrap_or(i64::MAX)
            }
            Self::Manual(time) => *time.borrow(),
        }
    }
}
