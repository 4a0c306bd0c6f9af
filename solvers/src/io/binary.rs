//! Little-endian binary files: checked reads that name the byte of what they refuse.
//!
//! A count is checked against the bytes that are left before anything is reserved for it.

use std::fmt::Display;
use std::path::Path;

use super::error::excerpt;
use super::{IoError, Location};

/// A binary file's bytes and how far they are read.
pub(super) struct Binary<'a> {
    bytes: &'a [u8],
    offset: usize,
    path: &'a Path,
}

impl<'a> Binary<'a> {
    /// Starts at byte 0.
    pub(super) fn new(bytes: &'a [u8], path: &'a Path) -> Self {
        Self { bytes, offset: 0, path }
    }

    /// The byte that is read next.
    pub(super) fn location(&self) -> Location {
        Location::byte(self.path, self.offset)
    }

    fn array<const N: usize>(&mut self, field: impl Display) -> Result<[u8; N], IoError> {
        match self.bytes[self.offset..].first_chunk::<N>() {
            Some(chunk) => {
                self.offset += N;
                Ok(*chunk)
            }
            None => Err(IoError::Truncated { location: self.location(), field: field.to_string() }),
        }
    }

    /// Three bytes of color.
    pub(super) fn color(&mut self, field: impl Display) -> Result<[u8; 3], IoError> {
        self.array(field)
    }

    /// An unsigned 32-bit integer.
    pub(super) fn u32(&mut self, field: impl Display) -> Result<u32, IoError> {
        Ok(u32::from_le_bytes(self.array(field)?))
    }

    /// An unsigned 64-bit integer.
    pub(super) fn u64(&mut self, field: impl Display) -> Result<u64, IoError> {
        Ok(u64::from_le_bytes(self.array(field)?))
    }

    /// A finite 64-bit number.
    pub(super) fn f64(&mut self, field: impl Display) -> Result<f64, IoError> {
        let location = self.offset;
        let value = f64::from_le_bytes(self.array(&field)?);
        if value.is_finite() {
            Ok(value)
        } else {
            let location = Location::byte(self.path, location);
            Err(IoError::NotFinite { location, field: field.to_string() })
        }
    }

    /// `N` finite 64-bit numbers.
    pub(super) fn f64s<const N: usize>(&mut self, field: &str) -> Result<[f64; N], IoError> {
        let mut numbers = [0.0; N];
        for (k, number) in numbers.iter_mut().enumerate() {
            *number = self.f64(format_args!("{field}[{k}]"))?;
        }
        Ok(numbers)
    }

    /// A 64-bit count of records that take at least `record_bytes` each.
    pub(super) fn count(
        &mut self,
        field: impl Display,
        record_bytes: usize,
    ) -> Result<usize, IoError> {
        let location = self.location();
        let count = self.u64(&field)?;
        let possible = (self.bytes.len() - self.offset) / record_bytes;
        match usize::try_from(count) {
            Ok(count) if count <= possible => Ok(count),
            _ => {
                let (field, possible) = (field.to_string(), possible as u64);
                Err(IoError::CountTooLarge { location, field, count, possible })
            }
        }
    }

    /// A text that ends with a zero byte.
    pub(super) fn c_string(&mut self, field: impl Display) -> Result<&'a str, IoError> {
        let rest = &self.bytes[self.offset..];
        let Some(length) = rest.iter().position(|&c| c == 0) else {
            return Err(IoError::Truncated { location: self.location(), field: field.to_string() });
        };
        let Ok(text) = std::str::from_utf8(&rest[..length]) else {
            let (location, found) = (self.location(), excerpt(&rest[..length]));
            return Err(IoError::Malformed { location, field: field.to_string(), found });
        };
        self.offset += length + 1;
        Ok(text)
    }

    /// Refuses bytes past the last record.
    pub(super) fn end(&self) -> Result<(), IoError> {
        let rest = &self.bytes[self.offset..];
        if rest.is_empty() {
            Ok(())
        } else {
            let found = format!("{} bytes", rest.len());
            Err(IoError::Trailing { location: self.location(), found })
        }
    }
}
