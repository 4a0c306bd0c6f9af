//! One pass over the bytes of a text file: lines, words and numbers with their line number.
//!
//! Words are cut from the file's bytes without copies. A field is any `Display`, so that
//! `format_args!` names it and costs nothing unless it fails. Must not interpret any format.

use std::fmt::Display;
use std::io::Write as _;
use std::path::Path;
use std::str::FromStr;

use super::error::excerpt;
use super::{IoError, Location};

/// A text file's bytes and how far they are read.
pub(super) struct Text<'a> {
    rest: &'a [u8],
    line: u64,
    path: &'a Path,
}

impl<'a> Text<'a> {
    /// Starts at the first byte of `bytes`, skipping a byte order mark.
    pub(super) fn new(bytes: &'a [u8], path: &'a Path) -> Self {
        let rest = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        Self { rest, line: 1, path }
    }

    /// How many bytes are left.
    pub(super) fn remaining(&self) -> usize {
        self.rest.len()
    }

    /// The line that is read next.
    pub(super) fn location(&self) -> Location {
        Location::line(self.path, self.line)
    }

    /// The next word on this or a later line.
    pub(super) fn word(&mut self) -> Option<&'a [u8]> {
        let mut start = 0;
        while let Some(c) = self.rest.get(start) {
            if *c == b'\n' {
                self.line += 1;
            } else if !c.is_ascii_whitespace() {
                break;
            }
            start += 1;
        }
        let word = cut_word(&self.rest[start..]);
        self.rest = &self.rest[start + word.len()..];
        (!word.is_empty()).then_some(word)
    }

    /// The next word as a finite number.
    pub(super) fn number(&mut self, field: impl Display) -> Result<f64, IoError> {
        let word = self.word();
        number(word, &field, || self.location())
    }

    /// The next word as an integer.
    pub(super) fn integer<T: FromStr>(&mut self, field: impl Display) -> Result<T, IoError> {
        let word = self.word();
        integer(word, &field, || self.location())
    }

    /// Refuses anything but white space up to the end of the file.
    pub(super) fn end(&mut self) -> Result<(), IoError> {
        match self.word() {
            None => Ok(()),
            Some(word) => {
                Err(IoError::Trailing { location: self.location(), found: excerpt(word) })
            }
        }
    }

    /// The next line; `None` at the end of the file.
    pub(super) fn line(&mut self) -> Option<Line<'a>> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.iter().position(|&c| c == b'\n');
        let line = Line {
            rest: &self.rest[..end.unwrap_or(self.rest.len())],
            number: self.line,
            path: self.path,
            is_table: false,
        };
        self.rest = end.map_or(&[], |end| &self.rest[end + 1..]);
        self.line += 1;
        Some(line)
    }

    /// The next line that is neither blank nor a comment (`#`).
    pub(super) fn record(&mut self) -> Option<Line<'a>> {
        loop {
            let mut line = self.line()?;
            line.rest = line.rest.trim_ascii_start();
            if !line.rest.is_empty() && line.rest[0] != b'#' {
                return Some(line);
            }
        }
    }
}

/// What is left of one line.
#[derive(Clone, Copy)]
pub(super) struct Line<'a> {
    rest: &'a [u8],
    number: u64,
    path: &'a Path,
    /// Whether words end at commas, as in a table, and not at white space.
    is_table: bool,
}

impl<'a> Line<'a> {
    /// The line's location.
    pub(super) fn location(&self) -> Location {
        Location::line(self.path, self.number)
    }

    /// The line's number, from 1.
    pub(super) fn line_number(&self) -> u64 {
        self.number
    }

    /// The same line as one of a table whose cells commas separate, or else white space.
    pub(super) fn separated(self, by_commas: bool) -> Self {
        Self { is_table: by_commas, ..self }
    }

    /// The next word, `None` at the end of the line.
    pub(super) fn word(&mut self) -> Option<&'a [u8]> {
        if self.is_table {
            let end = self.rest.iter().position(|&c| c == b',').unwrap_or(self.rest.len());
            let is_last = self.is_at_end();
            let cell = self.rest[..end].trim_ascii();
            self.rest = self.rest.get(end + 1..).unwrap_or_default();
            return (!is_last).then_some(cell);
        }
        self.rest = self.rest.trim_ascii_start();
        let word = cut_word(self.rest);
        self.rest = &self.rest[word.len()..];
        (!word.is_empty()).then_some(word)
    }

    /// How many bytes are left.
    pub(super) fn remaining(&self) -> usize {
        self.rest.len()
    }

    /// Whether nothing but white space is left.
    pub(super) fn is_at_end(&self) -> bool {
        self.rest.trim_ascii_start().is_empty()
    }

    /// The rest of the line without white space around it.
    pub(super) fn tail(&mut self) -> &'a [u8] {
        let tail = self.rest.trim_ascii();
        self.rest = &[];
        tail
    }

    /// The next word as a finite number.
    pub(super) fn number(&mut self, field: impl Display) -> Result<f64, IoError> {
        let word = self.word();
        number(word, &field, || self.location())
    }

    /// The next `N` words as finite numbers.
    pub(super) fn numbers<const N: usize>(&mut self, field: &str) -> Result<[f64; N], IoError> {
        let mut numbers = [0.0; N];
        for (k, number) in numbers.iter_mut().enumerate() {
            *number = self.number(format_args!("{field}[{k}]"))?;
        }
        Ok(numbers)
    }

    /// The next word as an integer.
    pub(super) fn integer<T: FromStr>(&mut self, field: impl Display) -> Result<T, IoError> {
        self.parsed(field)
    }

    /// The next word as what its type makes of it.
    pub(super) fn parsed<T: FromStr>(&mut self, field: impl Display) -> Result<T, IoError> {
        let word = self.word();
        integer(word, &field, || self.location())
    }

    /// Refuses anything but white space up to the end of the line.
    pub(super) fn end(mut self) -> Result<(), IoError> {
        match self.word() {
            None => Ok(()),
            Some(word) => {
                Err(IoError::Trailing { location: self.location(), found: excerpt(word) })
            }
        }
    }
}

/// The leading characters of `bytes` that are not white space.
fn cut_word(bytes: &[u8]) -> &[u8] {
    let end = bytes.iter().position(u8::is_ascii_whitespace).unwrap_or(bytes.len());
    &bytes[..end]
}

fn number(
    word: Option<&[u8]>,
    field: &dyn Display,
    location: impl Fn() -> Location,
) -> Result<f64, IoError> {
    let value: f64 = integer(word, field, &location)?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err(IoError::NotFinite { location: location(), field: field.to_string() })
    }
}

fn integer<T: FromStr>(
    word: Option<&[u8]>,
    field: &dyn Display,
    location: impl Fn() -> Location,
) -> Result<T, IoError> {
    let Some(word) = word else {
        return Err(IoError::Truncated { location: location(), field: field.to_string() });
    };
    let parsed = std::str::from_utf8(word).ok().and_then(|text| text.parse().ok());
    parsed.ok_or_else(|| IoError::Malformed {
        location: location(),
        field: field.to_string(),
        found: excerpt(word),
    })
}

/// Text that is being written. Writing to memory cannot fail.
#[derive(Default)]
pub(super) struct TextWriter {
    bytes: Vec<u8>,
}

impl TextWriter {
    /// Appends to `out` what `write` writes.
    pub(super) fn append(out: &mut Vec<u8>, write: impl FnOnce(&mut Self)) {
        let mut text = Self { bytes: std::mem::take(out) };
        write(&mut text);
        *out = text.into_bytes();
    }

    /// Appends anything that can be displayed.
    pub(super) fn put(&mut self, value: impl Display) {
        // A `Vec` takes every write.
        let _ = write!(self.bytes, "{value}");
    }

    /// Appends a space and `value` with 17 significant digits, enough to read it back exactly.
    pub(super) fn put_number(&mut self, value: f64) {
        self.put(format_args!(" {value:.16e}"));
    }

    /// Appends each of `values` as [`TextWriter::put_number`] does.
    pub(super) fn put_numbers(&mut self, values: &[f64]) {
        for &value in values {
            self.put_number(value);
        }
    }

    /// Ends the line.
    pub(super) fn end_line(&mut self) {
        self.bytes.push(b'\n');
    }

    /// What was written.
    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }
}
