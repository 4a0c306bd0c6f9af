//! Times of records, seconds.
//!
//! A time is kept as the file writes it: a double does not hold the nanoseconds of a Unix time, and a file
//! that is written back has the same times. No clock is read.

use std::fmt;
use std::str::FromStr;

/// The time of a record.
#[derive(Clone, Debug, PartialEq)]
pub struct PyfgTime {
    text: Box<str>,
    seconds: f64,
}

/// A word that is no finite number of seconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a time is a finite number of seconds")]
pub struct BadTime;

impl PyfgTime {
    /// Seconds, to the precision of a double.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.seconds
    }
}

impl fmt::Display for PyfgTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl FromStr for PyfgTime {
    type Err = BadTime;

    fn from_str(text: &str) -> Result<Self, BadTime> {
        let seconds: f64 = text.parse().map_err(|_error| BadTime)?;
        if !seconds.is_finite() {
            return Err(BadTime);
        }
        Ok(Self { text: text.into(), seconds })
    }
}

impl From<i64> for PyfgTime {
    fn from(seconds: i64) -> Self {
        Self { text: seconds.to_string().into(), seconds: seconds as f64 }
    }
}
