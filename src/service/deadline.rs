//! Deadlines and cancellation of calls that solve.
//!
//! A client's `grpc-timeout` becomes the solve's deadline, a little earlier, so that the best state
//! so far still travels back. A call that is dropped (canceled, timed out, link broken) drops its
//! [`CancelOnDrop`], which the solve's observer asks after each iteration.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use covis_solvers::optimizer::{Control, IterationSummary};
use tonic::metadata::MetadataMap;

/// The share of a call's time that is kept for the answer: one part in so many.
const ANSWER_SHARE: u32 = 10;

/// The time that a call has; `None` when it names no deadline.
pub(super) fn call_time(metadata: &MetadataMap) -> Option<Duration> {
    parse(metadata.get("grpc-timeout")?.to_str().ok()?)
}

/// The time that a call leaves for solving; `None` when it names no deadline.
pub(super) fn solve_time(metadata: &MetadataMap) -> Option<Duration> {
    call_time(metadata).map(|time| time - time / ANSWER_SHARE)
}

/// `TimeoutValue TimeoutUnit` of the gRPC protocol: at most 8 digits, then H, M, S, m, u or n.
fn parse(text: &str) -> Option<Duration> {
    let (digits, unit) = text.split_at_checked(text.len().checked_sub(1)?)?;
    if digits.is_empty() || digits.len() > 8 || !digits.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let value: u64 = digits.parse().ok()?;
    match unit {
        "H" => Some(Duration::from_secs(value * 3600)),
        "M" => Some(Duration::from_secs(value * 60)),
        "S" => Some(Duration::from_secs(value)),
        "m" => Some(Duration::from_millis(value)),
        "u" => Some(Duration::from_micros(value)),
        "n" => Some(Duration::from_nanos(value)),
        _ => None,
    }
}

/// Tells a solve that nobody waits for it any more.
#[derive(Debug, Default)]
pub(super) struct CancelOnDrop(Arc<AtomicBool>);

impl CancelOnDrop {
    /// An observer that stops the solve once this guard is gone.
    pub(super) fn observer(
        &self,
    ) -> impl FnMut(&IterationSummary) -> Control + Send + 'static + use<> {
        let canceled = Arc::clone(&self.0);
        move |_row| {
            if canceled.load(Ordering::Relaxed) { Control::Cancel } else { Control::Continue }
        }
    }
}

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use covis_solvers::optimizer::{Control, IterationSummary};

    use super::{CancelOnDrop, parse};

    #[test]
    fn reads_the_units_of_grpc() {
        let check = |text: &str, expected: Option<Duration>| assert_eq!(parse(text), expected);
        check("2H", Some(Duration::from_secs(7200)));
        check("3M", Some(Duration::from_secs(180)));
        check("4S", Some(Duration::from_secs(4)));
        check("250m", Some(Duration::from_millis(250)));
        check("99999999u", Some(Duration::from_micros(99_999_999)));
        check("7n", Some(Duration::from_nanos(7)));
        for bad in ["", "S", "12", "-1S", "123456789S", "1.5S", "1x", "1µ"] {
            check(bad, None);
        }
    }

    #[test]
    fn a_dropped_guard_cancels() {
        let row = IterationSummary {
            iteration: 0,
            cost: 1.0,
            seconds: 0.0,
            accepted: true,
            damping: 0.0,
            gradient_max_norm: 0.0,
            step_norm: 0.0,
            step_quality: 0.0,
        };
        let guard = CancelOnDrop::default();
        let mut observer = guard.observer();
        assert_eq!(observer(&row), Control::Continue);
        drop(guard);
        assert_eq!(observer(&row), Control::Cancel);
    }
}
