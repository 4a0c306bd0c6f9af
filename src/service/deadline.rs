//! Deadlines and cancellation of calls that solve.
//!
//! A client's `grpc-timeout` starts when the head of the call arrives, as in the transport. The
//! solve's deadline is earlier by the time that the answer needs: a share of the time, at least
//! some milliseconds and at most a second, and more for a large answer. In that time the solve notices
//! its deadline, and other work of the machine has its turns. Time in the queue counts. A call that is dropped
//! (canceled, timed out, link broken) drops its [`CancelOnDrop`]; a solve checks its flag within
//! its iterations.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use covis_solvers::interrupt::Interrupt;
use tonic::Request;
use tonic::metadata::MetadataMap;

/// The share of a call's time that is reserved for the answer: one part in this many. A dense solve
/// notices its deadline up to 80 ms late on an idle machine, and its answer takes 40 ms; where six
/// solves share two cores both take five times as long.
const ANSWER_SHARE: u32 = 4;

/// Least time that is reserved for the answer, unless that is more than half of the call's time.
const ANSWER_LEAST: Duration = Duration::from_millis(10);
/// Most time that is reserved for the answer, besides that for its bytes.
const ANSWER_MOST: Duration = Duration::from_secs(1);
/// Time that is reserved per byte of an answer, nanoseconds: costs, conversion, encoding,
/// transport.
const ANSWER_BYTE_NS: u64 = 40;

/// When the head of a call arrived.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival(Instant);

impl Arrival {
    pub(super) fn now() -> Self {
        Self(Instant::now())
    }
}

/// The time that a call has; `None` when it names no deadline.
pub(super) fn call_time(metadata: &MetadataMap) -> Option<Duration> {
    parse(metadata.get("grpc-timeout")?.to_str().ok()?)
}

/// When the solve of a call must end for an answer of about `answer_bytes` to arrive in time; `None`
/// when the call names no deadline.
pub(super) fn solve_deadline<T>(request: &Request<T>, answer_bytes: usize) -> Option<Instant> {
    let time = call_time(request.metadata())?;
    let arrival = request.extensions().get::<Arrival>().copied().unwrap_or_else(Arrival::now);
    // A deadline that the clock cannot represent is no deadline.
    arrival.0.checked_add(time - kept(time, answer_bytes))
}

/// The part of `time` that is reserved for the answer, at most half.
fn kept(time: Duration, answer_bytes: usize) -> Duration {
    let bytes = Duration::from_nanos(ANSWER_BYTE_NS.saturating_mul(answer_bytes as u64));
    let share = (time / ANSWER_SHARE).clamp(ANSWER_LEAST, ANSWER_MOST);
    share.saturating_add(bytes).min(time / 2)
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

/// Cancels a solve when its caller is gone.
#[derive(Debug, Default)]
pub(super) struct CancelOnDrop(Arc<AtomicBool>);

impl CancelOnDrop {
    /// Ends the solve at `deadline`, or once this guard is dropped.
    pub(super) fn interrupt(&self, deadline: Option<Instant>) -> Interrupt {
        Interrupt::at(deadline).or_when(Arc::clone(&self.0))
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

    use super::{CancelOnDrop, kept, parse};

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
    fn the_answer_keeps_a_share_a_minimum_and_time_for_its_bytes() {
        let ms = Duration::from_millis;
        assert_eq!(kept(ms(1000), 0), ms(250));
        assert_eq!(kept(ms(20), 0), ms(10));
        assert_eq!(kept(ms(4), 0), ms(2));
        assert_eq!(kept(ms(3_600_000), 0), ms(1000));
        assert_eq!(kept(ms(1000), 1_000_000), ms(290));
        assert_eq!(kept(ms(1000), usize::MAX), ms(500));
    }

    #[test]
    fn a_dropped_guard_cancels() {
        let guard = CancelOnDrop::default();
        let interrupt = guard.interrupt(None);
        assert!(!interrupt.is_due());
        drop(guard);
        assert!(interrupt.is_due());
    }
}
