//! What time it is, where that decides who may come in. Tests set it by hand: nothing waits for real
//! time to pass.
//!
//! Only expiry is measured by it; waits and budgets run on the runtime's own timers.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use tokio::sync::watch;

/// Longest sleep before the time is looked at again: the system's clock may be set, and does not
/// count while the machine is suspended.
const LONGEST_SLEEP: Duration = Duration::from_secs(30);

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

    /// Resolves once it is `time`.
    pub(super) async fn reached(&self, time: i64) {
        match self {
            Self::System => {
                while self.now() < time {
                    let left = u64::try_from(time.saturating_sub(self.now())).unwrap_or(0);
                    tokio::time::sleep(Duration::from_secs(left).min(LONGEST_SLEEP)).await;
                }
            }
            Self::Manual(now) => {
                // A clock that nobody sets any more never gets there.
                if now.clone().wait_for(|&now| now >= time).await.is_err() {
                    std::future::pending::<()>().await;
                }
            }
        }
    }
}
