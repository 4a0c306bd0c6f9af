//! Times between seconds and nanoseconds, rounded once.
//!
//! A product with 1e9 rounds to a multiple of 256 ns in this century, one with 1e-9 makes
//! 1000.0000000000001 of 1000 s. Whole seconds and the rest are converted apart here.

const NANOSECONDS: i64 = 1_000_000_000;

/// The double that is nearest to a time, in seconds.
#[must_use]
pub fn seconds_of_nanoseconds(nanoseconds: i64) -> f64 {
    let rest = (nanoseconds % NANOSECONDS) as f64;
    (nanoseconds / NANOSECONDS) as f64 + rest / NANOSECONDS as f64
}

/// The whole nanoseconds that are nearest to a time; `None` where it is not finite or they have no 64
/// bits.
#[must_use]
pub fn nanoseconds_of_seconds(seconds: f64) -> Option<i64> {
    if !seconds.is_finite() {
        return None;
    }
    let rest = (seconds.fract() * NANOSECONDS as f64).round() as i64;
    // Seconds that a cast saturates overflow here.
    (seconds.trunc() as i64).checked_mul(NANOSECONDS)?.checked_add(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_seconds_and_decimal_times_stay_what_they_are() {
        assert_eq!(seconds_of_nanoseconds(1_000_000_000_000), 1000.0);
        assert_eq!(seconds_of_nanoseconds(-1_500_000_000), -1.5);
        assert_eq!(seconds_of_nanoseconds(1305031102175304000), 1305031102.175304);
        for seconds in [0.0, -2.75, 1305031102.175304, 1403636580.8385556, 9.1e9] {
            let nanoseconds = nanoseconds_of_seconds(seconds);
            assert_eq!(nanoseconds.map(seconds_of_nanoseconds), Some(seconds));
        }
        for seconds in [f64::NAN, f64::INFINITY, 9.3e9, -9.3e9] {
            assert_eq!(nanoseconds_of_seconds(seconds), None);
        }
    }
}
