//! What a file itself says about its columns: the unit of its times and the order of its quaternion.
//!
//! Commas do not tell: tables of TUM's columns in seconds exist beside EuRoC's in nanoseconds. So the
//! times decide, and where they fit both, the names in the comments above the first row. The rows' other
//! numbers are not interpreted.

use std::path::Path;

use super::super::IoError;
use super::super::text::{Line, Text};
use super::TrajectoryFormat;

/// Rows whose times are looked at.
const ROWS: usize = 64;
/// Times from here on are nanoseconds: in seconds they would be three million years.
const NANOSECONDS_FROM: f64 = 1e14;
/// A usual step of whole times up to here is one of seconds (three hours), from
/// [`NANOSECOND_STEPS_FROM`] on one of nanoseconds (10 kHz).
const SECOND_STEPS_TO: f64 = 1e4;
const NANOSECOND_STEPS_FROM: f64 = 1e5;
/// Numbers in a row.
const TUM_NUMBERS: usize = 8;
const KITTI_NUMBERS: usize = 12;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Unit {
    Seconds,
    Nanoseconds,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum QuaternionOrder {
    /// x, y, z, w, as TUM's.
    Xyzw,
    /// w, x, y, z, as EuRoC's.
    Wxyz,
}

/// Whether commas separate the numbers of the first row.
pub(super) fn is_table(bytes: &[u8]) -> bool {
    let first = Text::new(bytes, Path::new("")).record();
    first.is_some_and(|mut line| line.tail().contains(&b','))
}

/// How many numbers the first row has, at most one more than the longest that is read.
fn first_row_numbers(bytes: &[u8]) -> usize {
    Text::new(bytes, Path::new("")).record().map_or(0, count)
}

fn count(mut line: Line<'_>) -> usize {
    std::iter::from_fn(|| line.word()).take(KITTI_NUMBERS + 1).count()
}

/// The format of a file of one of the three.
pub(super) fn format(bytes: &[u8]) -> TrajectoryFormat {
    match is_table(bytes) {
        true => format_of_table(bytes),
        false if first_row_numbers(bytes) == KITTI_NUMBERS => TrajectoryFormat::Kitti,
        false => TrajectoryFormat::Tum,
    }
}

/// The format of a file whose columns are TUM's or EuRoC's; EuRoC's where nothing tells.
pub(super) fn format_of_table(bytes: &[u8]) -> TrajectoryFormat {
    let unit = unit(bytes).or_else(|| match quaternion_order(bytes)? {
        QuaternionOrder::Xyzw => Some(Unit::Seconds),
        QuaternionOrder::Wxyz => Some(Unit::Nanoseconds),
    });
    match unit {
        Some(Unit::Seconds) => TrajectoryFormat::Tum,
        Some(Unit::Nanoseconds) | None => TrajectoryFormat::Euroc,
    }
}

fn unit(bytes: &[u8]) -> Option<Unit> {
    let mut text = Text::new(bytes, Path::new(""));
    let rows = std::iter::from_fn(|| text.record()).take(ROWS);
    let by_commas = is_table(bytes);
    let cell = |line: Line<'_>| line.separated(by_commas).number("time").ok();
    let times: Vec<f64> = rows.map_while(cell).collect();
    if times.iter().any(|time| time.fract() != 0.0) {
        return Some(Unit::Seconds);
    }
    if times.iter().any(|time| time.abs() >= NANOSECONDS_FROM) {
        return Some(Unit::Nanoseconds);
    }
    let names = column_names(bytes);
    if names.iter().any(|name| name == "[ns]") {
        return Some(Unit::Nanoseconds);
    }
    if names.iter().any(|name| name == "[s]") {
        return Some(Unit::Seconds);
    }
    let mut steps: Vec<f64> = times.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    steps.sort_unstable_by(f64::total_cmp);
    match *steps.get(steps.len() / 2)? {
        step if step <= SECOND_STEPS_TO => Some(Unit::Seconds),
        step if step >= NANOSECOND_STEPS_FROM => Some(Unit::Nanoseconds),
        _ => None,
    }
}

/// The words of the comments above the first row, in small letters.
fn column_names(bytes: &[u8]) -> Vec<String> {
    let mut text = Text::new(bytes, Path::new(""));
    let mut names = Vec::new();
    while let Some(mut line) = text.line() {
        let line = line.tail();
        if !line.is_empty() && !line.starts_with(b"#") {
            break;
        }
        let is_separator = |c: &u8| c.is_ascii_whitespace() || matches!(c, b',' | b'#');
        let words = line.split(is_separator).filter(|word| !word.is_empty());
        names.extend(words.map(|word| String::from_utf8_lossy(word).to_lowercase()));
    }
    names
}

/// The order that the names give (`qw`, `q_w`, `q_RS_w`).
fn quaternion_order(bytes: &[u8]) -> Option<QuaternionOrder> {
    let names = column_names(bytes);
    let column = |coordinate: char| {
        names.iter().position(|name| {
            let middle = name.strip_prefix('q').and_then(|rest| rest.strip_suffix(coordinate));
            middle.is_some_and(|m| m.is_empty() || (m.starts_with('_') && m.ends_with('_')))
        })
    };
    let (w, x) = (column('w')?, column('x')?);
    Some(if w < x { QuaternionOrder::Wxyz } else { QuaternionOrder::Xyzw })
}

/// Refuses to read a file as TUM's or EuRoC's whose comments name the quaternion in the other order.
pub(super) fn check_order(
    bytes: &[u8],
    path: &Path,
    format: TrajectoryFormat,
) -> Result<(), IoError> {
    let location = Text::new(bytes, path).location();
    match (format, quaternion_order(bytes)) {
        (TrajectoryFormat::Tum, Some(QuaternionOrder::Wxyz)) => Err(IoError::OtherFormat {
            location,
            reason: "the header names the quaternion w, x, y, z, and TUM's is x, y, z, w",
            other: EUROC,
        }),
        (TrajectoryFormat::Euroc, Some(QuaternionOrder::Xyzw)) => Err(IoError::OtherFormat {
            location,
            reason: "the header names the quaternion x, y, z, w, and EuRoC's is w, x, y, z",
            other: TUM,
        }),
        _ => Ok(()),
    }
}

const TUM: &str = "a TUM trajectory (tum)";
const EUROC: &str = "EuRoC ground truth (euroc)";
const KITTI: &str = "KITTI odometry poses (kitti)";

/// The refusal of a row of TUM's, where it has as many numbers as one of KITTI's.
pub(super) fn not_tum(row: Line<'_>) -> Option<IoError> {
    (count(row) == KITTI_NUMBERS).then(|| IoError::OtherFormat {
        location: row.location(),
        reason: "the row has 12 numbers, TUM's have 8",
        other: KITTI,
    })
}

/// The refusal of a row of KITTI's, where it has as many numbers as one of TUM's.
pub(super) fn not_kitti(row: Line<'_>) -> Option<IoError> {
    (count(row) == TUM_NUMBERS).then(|| IoError::OtherFormat {
        location: row.location(),
        reason: "the row has 8 numbers, KITTI's have 12",
        other: TUM,
    })
}

/// Refuses a time of EuRoC's that is no whole number.
pub(super) fn check_nanoseconds(time: f64, row: &Line<'_>) -> Result<(), IoError> {
    if time.fract() == 0.0 {
        return Ok(());
    }
    Err(IoError::OtherFormat {
        location: row.location(),
        reason: "the time is not a whole number, and EuRoC's are nanoseconds",
        other: TUM,
    })
}
