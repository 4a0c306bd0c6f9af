//! Times between seconds and nanoseconds, rounded once, and nanoseconds as decimal seconds.
//!
//! A product with 1e9 rounds to a multiple of 256 ns in this century, one with 1e-9 makes
//! 1000.0000000000001 of 1000 s. Whole seconds and the rest are converted apart here.

use std::fmt;

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

/// Nanoseconds that are displayed as seconds, in the fewest digits by which [`nanoseconds_of_seconds`] gives
/// them back, or with all of theirs where a double does not hold them.
pub(super) struct DecimalSeconds(pub(super) i64);

impl fmt::Display for DecimalSeconds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let (all, second) = (self.0.unsigned_abs(), NANOSECONDS.unsigned_abs());
        let fraction = format!("{:09}", all % second);
        let digits = fraction.trim_end_matches('0').len().max(1);
        let exact = format!("{sign}{}.{}", all / second, &fraction[..digits]);
        // A time that was a double has more digits as nanoseconds than it had as decimal.
        let seconds = seconds_of_nanoseconds(self.0);
        let shortest = format!("{seconds}");
        let is_shorter = shortest.len() < exact.len() && shortest.contains('.');
        let comes_back = nanoseconds_of_seconds(seconds) == Some(self.0);
        f.write_str(if is_shorter && comes_back { &shortest } else { &exact })
    }
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
        for nanoseconds in [0, 1403636579763555584, 1305031102175304000, -300_000_001, i64::MIN] {
            let text = DecimalSeconds(nanoseconds).to_string();
            assert_eq!(text.parse(), Ok(seconds_of_nanoseconds(nanoseconds)), "{text}");
        }
        for seconds in [f64::NAN, f64::INFINITY, 9.3e9, -9.3e9] {
            assert_eq!(nanoseconds_of_seconds(seconds), None);
        }
    }

    #[test]
    fn decimal_seconds_have_the_fewest_digits_that_give_the_nanoseconds_back() {
        for (nanoseconds, text) in [
            (0, "0.0"),
            (1_000_000_000_000, "1000.0"),
            (-1, "-0.000000001"),
            (-1_500_000_000, "-1.5"),
            (1305031102175304000, "1305031102.175304"),
            // The whole nanoseconds of the double that is nearest to that time.
            (1305031102175303936, "1305031102.175304"),
            (1305031102175303937, "1305031102.175303937"),
            (1403636579763555584, "1403636579.763555584"),
            (i64::MIN, "-9223372036.854775808"),
        ] {
            assert_eq!(DecimalSeconds(nanoseconds).to_string(), text);
        }
    }
}
