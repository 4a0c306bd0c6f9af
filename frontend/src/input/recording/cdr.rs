//! CDR, the encoding of ROS 2 messages: 4 bytes that tell the byte order, then fields, each aligned to
//! its size from behind these 4 bytes (OMG DDSI-RTPS 2.5, 9.4.2 and 10; XCDR version 1).
//!
//! Strings and sequences are borrowed from the message: nothing is copied or allocated by a count. This
//! is why no serde codec is used: those copy images byte by byte. It knows no message.

use super::error::MessageError;

/// Plain CDR, big and little endian.
const BIG: u16 = 0x0000;
const LITTLE: u16 = 0x0001;
/// The bytes before the first field.
const HEADER: usize = 4;

/// A message that is read field by field.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cdr<'a> {
    /// What is behind the header.
    bytes: &'a [u8],
    at: usize,
    is_big: bool,
}

impl<'a> Cdr<'a> {
    /// Begins with the first field.
    pub(super) fn new(message: &'a [u8]) -> Result<Self, MessageError> {
        let Some((&[a, b, _, _], bytes)) = message.split_first_chunk::<HEADER>() else {
            return Err(MessageError::Short { field: "the CDR header", bytes: message.len() });
        };
        let is_big = match u16::from_be_bytes([a, b]) {
            BIG => true,
            LITTLE => false,
            found => return Err(MessageError::Encapsulation { found }),
        };
        Ok(Self { bytes, at: 0, is_big })
    }

    /// The next `count` bytes, as they are.
    fn take(&mut self, field: &'static str, count: usize) -> Result<&'a [u8], MessageError> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let found = rest.get(..count);
        let found = found.ok_or(MessageError::Short { field, bytes: self.bytes.len() + HEADER })?;
        self.at += count;
        Ok(found)
    }

    /// The next number of `N` bytes, aligned, highest byte first.
    fn number<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N], MessageError> {
        self.at = self.at.next_multiple_of(N);
        let mut number = [0; N];
        number.copy_from_slice(self.take(field, N)?);
        if !self.is_big {
            number.reverse();
        }
        Ok(number)
    }

    pub(super) fn u8(&mut self, field: &'static str) -> Result<u8, MessageError> {
        Ok(u8::from_be_bytes(self.number(field)?))
    }

    pub(super) fn u32(&mut self, field: &'static str) -> Result<u32, MessageError> {
        Ok(u32::from_be_bytes(self.number(field)?))
    }

    pub(super) fn i32(&mut self, field: &'static str) -> Result<i32, MessageError> {
        Ok(i32::from_be_bytes(self.number(field)?))
    }

    pub(super) fn f64(&mut self, field: &'static str) -> Result<f64, MessageError> {
        Ok(f64::from_be_bytes(self.number(field)?))
    }

    /// A sequence of bytes.
    pub(super) fn bytes(&mut self, field: &'static str) -> Result<&'a [u8], MessageError> {
        let count = self.u32(field)?;
        self.take(field, usize::try_from(count).unwrap_or(usize::MAX))
    }

    /// A string, without the zero at its end.
    pub(super) fn text(&mut self, field: &'static str) -> Result<&'a str, MessageError> {
        let bytes = self.bytes(field)?;
        let text = bytes.strip_suffix(b"\0").unwrap_or(bytes);
        str::from_utf8(text).map_err(|source| MessageError::Text { field, source })
    }

    /// A sequence of at most `MOST` numbers, and how many there are.
    pub(super) fn numbers<const MOST: usize>(
        &mut self,
        field: &'static str,
    ) -> Result<([f64; MOST], usize), MessageError> {
        let count = self.u32(field)? as usize;
        let mut numbers = [0.0; MOST];
        let Some(used) = numbers.get_mut(..count) else {
            return Err(MessageError::TooMany { field, found: count, most: MOST });
        };
        for number in used {
            *number = self.f64(field)?;
        }
        Ok((numbers, count))
    }

    /// An array of a fixed length.
    pub(super) fn array<const N: usize>(
        &mut self,
        field: &'static str,
    ) -> Result<[f64; N], MessageError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.f64(field)?;
        }
        Ok(numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_aligned_to_their_size_in_either_byte_order() {
        // A byte, 3 bytes of padding, a number, a text with its zero, padding, a double.
        let little = [
            &[0, 1, 0, 0, 7, 0, 0, 0][..],
            &258u32.to_le_bytes(),
            &3u32.to_le_bytes(),
            b"ab\0",
            &[0; 1],
            &1.5f64.to_le_bytes(),
        ]
        .concat();
        let big = [
            &[0, 0, 0, 0, 7, 0, 0, 0][..],
            &258u32.to_be_bytes(),
            &3u32.to_be_bytes(),
            b"ab\0",
            &[0; 1],
            &1.5f64.to_be_bytes(),
        ]
        .concat();
        for (message, is_big) in [(little, false), (big, true)] {
            let mut cdr = Cdr::new(&message).unwrap();
            assert_eq!(cdr.is_big, is_big);
            assert_eq!(cdr.u8("a").unwrap(), 7);
            assert_eq!(cdr.u32("b").unwrap(), 258);
            assert_eq!(cdr.text("c").unwrap(), "ab");
            assert_eq!(cdr.f64("d").unwrap(), 1.5);
            assert!(matches!(cdr.u8("e"), Err(MessageError::Short { field: "e", .. })));
        }
    }

    #[test]
    fn counts_that_the_message_does_not_have_and_other_encodings_are_refused() {
        let message = [&[0, 1, 0, 0][..], &u32::MAX.to_le_bytes(), &[1, 2]].concat();
        let mut cdr = Cdr::new(&message).unwrap();
        assert!(matches!(cdr.bytes("data"), Err(MessageError::Short { .. })));
        let mut cdr = Cdr::new(&message).unwrap();
        assert!(matches!(cdr.numbers::<14>("d"), Err(MessageError::TooMany { .. })));
        // Parameter lists, and version 2.
        for header in [[0, 2, 0, 0], [0, 3, 0, 0], [0, 7, 0, 0], [1, 0, 0, 0]] {
            assert!(matches!(Cdr::new(&header), Err(MessageError::Encapsulation { .. })));
        }
        assert!(Cdr::new(&[0, 1, 0]).is_err());
        let text = [&[0, 1, 0, 0][..], &2u32.to_le_bytes(), &[0xff, 0]].concat();
        assert!(matches!(Cdr::new(&text).unwrap().text("t"), Err(MessageError::Text { .. })));
    }
}
