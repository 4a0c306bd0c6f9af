//! Why a file could not be read or written, with the location and the field.
//!
//! A text file's location is its line from 1, a binary file's its byte from 0. Data that did not come
//! from bytes (a struct that the caller filled) is named by the number of its record. Every variant
//! carries data; none is a bare message.

use std::fmt;
use std::path::{Path, PathBuf};

/// A position in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// A line of a text file, from 1.
    Line(u64),
    /// A byte of a binary file, from 0.
    Byte(u64),
    /// A record (vertex, edge, image, …) by its number or id.
    Record(u64),
    /// A record of a kind by the key that the file has for it.
    Key(&'static str, u32),
}

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(n) => write!(f, "line {n}"),
            Self::Byte(n) => write!(f, "byte {n}"),
            Self::Record(n) => write!(f, "record {n}"),
            Self::Key(kind, key) => write!(f, "{kind} {key}"),
        }
    }
}

/// A file and a position in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Location {
    /// The file, or the name that the caller gave to the bytes.
    pub path: PathBuf,
    /// Where in it.
    pub at: At,
}

impl Location {
    /// A line of a text file, from 1.
    pub(crate) fn line(path: &Path, line: u64) -> Self {
        Self { path: path.to_owned(), at: At::Line(line) }
    }

    /// A byte of a binary file, from 0.
    pub(crate) fn byte(path: &Path, byte: usize) -> Self {
        Self { path: path.to_owned(), at: At::Byte(byte as u64) }
    }

    /// A record of a kind by its key.
    pub(crate) fn key(path: &Path, kind: &'static str, key: u32) -> Self {
        Self { path: path.to_owned(), at: At::Key(kind, key) }
    }

    /// A record by number or id.
    pub(crate) fn record(path: &Path, record: u64) -> Self {
        Self { path: path.to_owned(), at: At::Record(record) }
    }
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}", self.path.display(), self.at)
    }
}

/// A file that cannot be read, written or converted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IoError {
    /// The operating system refused to read.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The operating system refused to write.
    #[error("{}: cannot be written", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A text file is compressed.
    #[error("{}: is compressed ({kind}); `{with} {}` unpacks it", path.display(), path.display())]
    Compressed {
        /// The file.
        path: PathBuf,
        /// The format of the compression.
        kind: &'static str,
        /// The program that unpacks it.
        with: &'static str,
    },
    /// The lines of a text file end in CR alone, so that it would be read as one line.
    #[error("{}: the lines end in CR only; LF or CR LF is needed", path.display())]
    LineEnds {
        /// The file.
        path: PathBuf,
    },
    /// What a file holds is that of another format than the one it is read as.
    #[error("{location}: {reason}; the file looks like {other}")]
    OtherFormat {
        /// The first line that shows it.
        location: Location,
        /// What does not belong to the format.
        reason: &'static str,
        /// The format that has it, and its name in arguments.
        other: &'static str,
    },
    /// A file that belongs to a folder's model is not there.
    #[error("{}: holds no {what}", path.display())]
    MissingFile {
        /// The folder.
        path: PathBuf,
        /// What was looked for.
        what: &'static str,
    },
    /// The line, or the file, ends before a field.
    #[error("{location}: {field} is missing (truncated?)")]
    Truncated {
        /// Where the data end.
        location: Location,
        /// The field that should follow.
        field: String,
    },
    /// A field does not have the form it must have.
    #[error("{location}: {field} cannot be `{found}`")]
    Malformed {
        /// Where.
        location: Location,
        /// The field.
        field: String,
        /// The start of what stands there.
        found: String,
    },
    /// A file is no JSON, or lacks a member, or has one of another type.
    #[error("{location}: {reason}")]
    Json {
        /// The line where it shows.
        location: Location,
        /// What the parser says, cut where it is long.
        reason: String,
    },
    /// A number is NaN, infinite or too large for 64 bits.
    #[error("{location}: {field} is not finite")]
    NotFinite {
        /// Where.
        location: Location,
        /// The field.
        field: String,
    },
    /// Something follows where the record or the file must end.
    #[error("{location}: unexpected `{found}` after the last field")]
    Trailing {
        /// Where.
        location: Location,
        /// The start of what follows.
        found: String,
    },
    /// The first word of a line is not a tag that covis reads.
    #[error("{location}: unknown tag `{tag}`")]
    UnknownTag {
        /// Where.
        location: Location,
        /// The tag.
        tag: String,
    },
    /// A header announces more records than the rest of the file could hold.
    #[error("{location}: {field} says {count}, the file has room for at most {possible}")]
    CountTooLarge {
        /// Where.
        location: Location,
        /// The count's name.
        field: String,
        /// The announced count.
        count: u64,
        /// How many would fit.
        possible: u64,
    },
    /// An index is not below its count.
    #[error("{location}: {field} is {value}, there are {count}")]
    OutOfRange {
        /// Where.
        location: Location,
        /// The index's name.
        field: String,
        /// Its value.
        value: u64,
        /// How many there are.
        count: u64,
    },
    /// Two records share an id.
    #[error("{location}: {field} {id} occurs twice")]
    DuplicateId {
        /// Where the second one stands.
        location: Location,
        /// The kind of record.
        field: &'static str,
        /// The id.
        id: i128,
    },
    /// A record names another that the file does not hold.
    #[error("{location}: {field} {id} does not exist")]
    UnknownId {
        /// Where.
        location: Location,
        /// The kind of record that is missing.
        field: &'static str,
        /// The id.
        id: i128,
    },
    /// An edge ties a vertex to itself.
    #[error("{location}: the edge connects vertex {id} to itself")]
    SelfEdge {
        /// Where.
        location: Location,
        /// The vertex.
        id: i64,
    },
    /// A quaternion's norm is zero or differs from 1 by more than 1e-3.
    #[error("{location}: the quaternion has norm {norm}, 1 is needed")]
    BadQuaternion {
        /// Where.
        location: Location,
        /// Its norm.
        norm: f64,
    },
    /// A matrix is no rigid motion.
    #[error(
        "{location}: the matrix is not a rigid motion: an element is off by {deviation:.3e}, or \
         it is a reflection"
    )]
    NotRigid {
        /// Where it begins.
        location: Location,
        /// Largest deviation of RᵀR from the identity and of the last row from (0, 0, 0, 1).
        deviation: f64,
    },
    /// Information matrices have negative eigenvalues.
    #[error(
        "{first}: the information matrix of edge {i} to {j} is indefinite, its smallest eigenvalue \
         is {smallest_eigenvalue:.3e} ({count} such in the file)"
    )]
    IndefiniteInformation {
        /// The first one's location.
        first: Location,
        /// Its vertex i.
        i: i64,
        /// Its vertex j.
        j: i64,
        /// The first one's smallest eigenvalue.
        smallest_eigenvalue: f64,
        /// How many there are.
        count: usize,
    },
    /// A name does not fit where it is used.
    #[error("{location}: {field} {name} {reason}")]
    Name {
        /// Where.
        location: Location,
        /// What it should name.
        field: &'static str,
        /// The name.
        name: String,
        /// Why it does not fit.
        reason: &'static str,
    },
    /// A covariance is not positive definite, or too small to have an inverse.
    #[error("{location}: the {field} is not positive definite, or too close to zero")]
    Covariance {
        /// Where.
        location: Location,
        /// "covariance" or "variance".
        field: &'static str,
    },
    /// A file mixes 2D and 3D records.
    #[error("{location}: `{found}` in a file of {kind} records")]
    MixedKinds {
        /// Where.
        location: Location,
        /// The kind of the records before it.
        kind: &'static str,
        /// The tag that does not fit.
        found: String,
    },
    /// The file holds nothing to work on.
    #[error("{}: there is no {what}", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
        /// What is missing.
        what: &'static str,
    },
    /// A camera cannot be represented on the other side.
    #[error("camera {camera}: {model} cannot be converted: {reason}")]
    UnsupportedCamera {
        /// The camera's id or index.
        camera: u64,
        /// Its model.
        model: String,
        /// Why it cannot be.
        reason: &'static str,
    },
    /// A text cannot be written in this format.
    #[error("{field} {id}: {reason}")]
    UnwritableText {
        /// The kind of record.
        field: &'static str,
        /// Its id.
        id: u64,
        /// Why it cannot be.
        reason: &'static str,
    },
    /// A factor cannot be written in this format.
    #[error("{factor}, record {index}: {reason}")]
    UnwritableFactor {
        /// The kind of factor.
        factor: &'static str,
        /// Its position in its list, from 0.
        index: usize,
        /// Why it cannot be.
        reason: &'static str,
    },
    /// A file beside another one has not one line for each of its records.
    #[error("{}: {actual} {what}, {expected} are needed", path.display())]
    ListLength {
        /// The file beside.
        path: PathBuf,
        /// What its lines are.
        what: &'static str,
        /// How many there are.
        actual: usize,
        /// How many records the other file has.
        expected: usize,
    },
    /// A problem and a file that should describe the same things differ in size.
    #[error("{what}: the problem has {actual}, the file {expected}")]
    SizeMismatch {
        /// The kind of record.
        what: &'static str,
        /// The problem's count.
        actual: usize,
        /// The file's count.
        expected: usize,
    },
}

/// The start of `bytes` for an error message, characters replaced that are unreadable or that turn the direction
/// of what a terminal prints behind them.
pub(crate) fn excerpt(bytes: &[u8]) -> String {
    const LIMIT: usize = 40;
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(LIMIT)]);
    let is_direction = |c: char| matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let is_printed = |c: char| !c.is_control() && !is_direction(c);
    let mut text: String = text.chars().map(|c| if is_printed(c) { c } else { '?' }).collect();
    if bytes.len() > LIMIT {
        text.push('…');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_excerpt_has_nothing_that_turns_a_terminal() {
        assert_eq!(excerpt("a\u{1b}[31m\u{202e}b\u{2066}".as_bytes()), "a?[31m?b?");
        assert_eq!(excerpt("żółw".as_bytes()), "żółw");
    }
}
