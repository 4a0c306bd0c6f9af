//! Timestamps: nanoseconds since the Unix epoch as one signed integer, years 1678 to 2261.
//!
//! No clock is read here.

use prost_types::Timestamp;

use super::{Path, Violations};
use crate::map::Reason;

const NANOSECONDS: i64 = 1_000_000_000;

/// A required timestamp in nanoseconds.
pub(in crate::service) fn nanoseconds(
    at: Path<'_>,
    time: Option<&Timestamp>,
    out: &mut Violations,
) -> Option<i64> {
    let time = out.required(at, time)?;
    if !(0..NANOSECONDS).contains(&i64::from(time.nanos)) {
        let text = format!("{} is not in 0 to 999999999", time.nanos);
        return out.report(at.field("nanos"), Reason::OutOfRange, text);
    }
    let total = time.seconds.checked_mul(NANOSECONDS);
    let total = total.and_then(|ns| ns.checked_add(i64::from(time.nanos)));
    total.or_else(|| {
        out.report(at.field("seconds"), Reason::OutOfRange, "past what 64-bit nanoseconds hold")
    })
}

/// The timestamp of nanoseconds since the epoch.
pub(in crate::service) fn timestamp(nanoseconds: i64) -> Timestamp {
    let nanos = i32::try_from(nanoseconds.rem_euclid(NANOSECONDS)).unwrap_or(0);
    Timestamp { seconds: nanoseconds.div_euclid(NANOSECONDS), nanos }
}
