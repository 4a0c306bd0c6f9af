//! The clock that decides whether tokens and jobs have expired. Tests set it by hand, so that they do
//! not wait for real time.
//!
//! It is used for expiry and for the times of jobs only; waits and budgets use the runtime's timers.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use tokio::sync::watch;

/// Longest sleep before the time is read again: the system's clock may be set, and timers do not
/// run while the machine is suspended.
const LONGEST_SLEEP: Duration = Duration::from_secs(30);

/// A clock of whole seconds since 1970 (UTC).
#[derive(Clone, Debug)]
pub enum Clock {
    /// The system's clock.
    System,
    /// A clock that does not advance until the other end of the channel sets it.
    Manual(watch::Receiver<i64>),
}

impl Clock {
    /// The current time.
    pub(super) fn now(&self) -> i64 {
        match self {
            Self::System => self.now_ns() / 1_000_000_000,
            Self::Manual(time) => *time.borrow(),
        }
    }

    /// The current time in nanoseconds, as fine as the clock is.
    pub(super) fn now_ns(&self) -> i64 {
        match self {
            Self::System => {
                let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
                i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
            }
            Self::Manual(time) => time.borrow().saturating_mul(1_000_000_000),
        }
    }

    /// Resolves once the clock reaches `time`.
    pub(super) async fn reached(&self, time: i64) {
        match self {
            Self::System => {
                while self.now() < time {
                    let left = u64::try_from(time.saturating_sub(self.now())).unwrap_or(0);
                    tokio::time::sleep(Duration::from_secs(left).min(LONGEST_SLEEP)).await;
                }
            }
            Self::Manual(now) => {
                // If the sender is gone, the clock never reaches the time.
                if now.clone().wait_for(|&now| now >= time).await.is_err() {
                    std::future::pending::<()>().await;
                }
            }
        }
    }
}
