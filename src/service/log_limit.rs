//! Limits how often one thing is logged, so that a flood does not fill a disk. It writes nothing
//! itself; the caller writes the lines.

use std::sync::Arc;
use std::time::Duration;

use tokio::runtime::Handle;
use tokio::time::Instant;

use crate::sync::Mutex;

/// Lines of one minute that are written one by one.
const LINES: u32 = 10;
/// The time after which the other lines are summed up in one line.
const PERIOD: Duration = Duration::from_secs(60);

/// Writes the first lines of a minute, and in one line how many more there were.
#[derive(Clone, Debug, Default)]
pub(super) struct LogLimit(Arc<Mutex<Period>>);

#[derive(Debug, Default)]
struct Period {
    begin: Option<Instant>,
    written: u32,
    left_out: u64,
}

impl LogLimit {
    /// Calls `line` if it may be written now; otherwise counts it, and calls `summary` with the
    /// count when the minute is over.
    pub(super) fn log(&self, line: impl FnOnce(), summary: impl FnOnce(u64) + Send + 'static) {
        let mut period = self.0.lock();
        let now = Instant::now();
        let begin = period.begin.filter(|begin| now.duration_since(*begin) < PERIOD);
        if begin.is_none() && period.left_out == 0 {
            *period = Period { begin: Some(now), ..Period::default() };
        }
        if period.written < LINES {
            period.written += 1;
            drop(period);
            line();
            return;
        }
        period.left_out += 1;
        let end = period.begin.unwrap_or(now) + PERIOD;
        let is_first = period.left_out == 1;
        drop(period);
        // Only the first line that is left out starts a task; without a runtime there is no flood.
        if is_first && let Ok(runtime) = Handle::try_current() {
            let limit = self.clone();
            runtime.spawn(async move {
                tokio::time::sleep_until(end).await;
                summary(limit.end());
            });
        }
    }

    /// Ends the minute; returns how many lines were left out.
    fn end(&self) -> u64 {
        let mut period = self.0.lock();
        std::mem::take(&mut *period).left_out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_ten_lines_and_a_count_each_minute() {
        let limit = LogLimit::default();
        for _minute in 0..3 {
            let mut lines = 0;
            for _ in 0..5000 {
                limit.log(|| lines += 1, |_| ());
            }
            assert_eq!((lines, limit.end()), (10, 4990));
        }
    }
}
