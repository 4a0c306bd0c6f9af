//! Protobuf, the encoding of Foxglove's messages: fields with numbers, in any order, each a number or bytes with
//! a length (protobuf.dev, "Encoding").
//!
//! Bytes are borrowed from the message: nothing is copied or allocated by a length, which is why no generated
//! code is used. It knows no message.

use super::error::MessageError;

/// The value of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value<'a> {
    /// A number of variable length.
    Number(u64),
    /// Eight bytes, lowest first.
    Eight([u8; 8]),
    /// Four bytes, lowest first.
    Four([u8; 4]),
    /// A text, bytes, numbers in a row, or a message.
    Bytes(&'a [u8]),
}

impl<'a> Value<'a> {
    /// A number that fits, else 0, as a field that is not there.
    pub(super) fn u32(self) -> u32 {
        match self {
            Self::Number(number) => u32::try_from(number).unwrap_or(0),
            Self::Four(bytes) => u32::from_le_bytes(bytes),
            Self::Eight(_) | Self::Bytes(_) => 0,
        }
    }

    /// Bytes, else none.
    pub(super) fn bytes(self) -> &'a [u8] {
        if let Self::Bytes(bytes) = self { bytes } else { &[] }
    }

    /// A text.
    ///
    /// # Errors
    /// For bytes that are not UTF-8.
    pub(super) fn text(self, field: &'static str) -> Result<&'a str, MessageError> {
        std::str::from_utf8(self.bytes()).map_err(|source| MessageError::Text { field, source })
    }
}

/// The fields of a message, one after the other; ends after the first error.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fields<'a> {
    message: &'a [u8],
    rest: &'a [u8],
}

/// The fields of `message`.
pub(super) fn fields(message: &[u8]) -> Fields<'_> {
    Fields { message, rest: message }
}

impl<'a> Fields<'a> {
    /// The next number of variable length: seven bits a byte, lowest first.
    fn number(&mut self) -> Result<u64, MessageError> {
        let mut number = 0_u64;
        for shift in (0..64).step_by(7) {
            let [byte] = self.array()?;
            // What is beyond 64 bits is dropped, as protobuf says.
            number |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok(number);
            }
        }
        Err(self.broken())
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], MessageError> {
        let Some((found, rest)) = self.rest.split_first_chunk() else { return Err(self.short()) };
        self.rest = rest;
        Ok(*found)
    }

    fn field(&mut self) -> Result<(u64, Value<'a>), MessageError> {
        let tag = self.number()?;
        let value = match tag & 7 {
            0 => Value::Number(self.number()?),
            1 => Value::Eight(self.array()?),
            2 => {
                let length = usize::try_from(self.number()?).unwrap_or(usize::MAX);
                let Some((found, rest)) = self.rest.split_at_checked(length) else {
                    return Err(self.short());
                };
                self.rest = rest;
                Value::Bytes(found)
            }
            5 => Value::Four(self.array()?),
            // Groups, which nobody writes any more, and what is no kind at all.
            _ => return Err(self.broken()),
        };
        Ok((tag >> 3, value))
    }

    fn short(&self) -> MessageError {
        MessageError::Short { field: "a field", bytes: self.message.len() }
    }

    fn broken(&self) -> MessageError {
        MessageError::Protobuf { at: self.message.len() - self.rest.len() }
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<(u64, Value<'a>), MessageError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let field = self.field();
        if field.is_err() {
            self.rest = &[];
        }
        Some(field)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(message: &[u8]) -> Result<Vec<(u64, Value<'_>)>, MessageError> {
        fields(message).collect()
    }

    #[test]
    fn fields_have_numbers_and_values_of_four_kinds() {
        // The examples of protobuf's own page: 150, and the text "testing".
        assert_eq!(all(&[0x08, 0x96, 0x01]).unwrap(), [(1, Value::Number(150))]);
        let text = b"\x12\x07testing";
        assert_eq!(all(text).unwrap(), [(2, Value::Bytes(b"testing"))]);
        let both = [&[0x19][..], &1.5f64.to_le_bytes(), &[0x25], &7u32.to_le_bytes()].concat();
        let expected = [(3, Value::Eight(1.5f64.to_le_bytes())), (4, Value::Four([7, 0, 0, 0]))];
        assert_eq!(all(&both).unwrap(), expected);
        assert_eq!(all(&[]).unwrap(), []);
    }

    #[test]
    fn what_is_cut_off_or_no_protobuf_is_an_error() {
        for cut in [&[0x08][..], &[0x08, 0x96], &[0x12, 0x07, b't'], &[0x19, 0], &[0x25, 0, 0]] {
            assert!(matches!(all(cut), Err(MessageError::Short { .. })), "{cut:?}");
        }
        let lasting = [[0x08].as_slice(), &[0xff; 11]].concat();
        for broken in [&[0x0b][..], &[0x0f], &lasting] {
            assert!(matches!(all(broken), Err(MessageError::Protobuf { .. })), "{broken:?}");
        }
        // A length beyond what there is takes no memory.
        let huge = [0x12, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f];
        assert!(matches!(all(&huge), Err(MessageError::Short { .. })));
    }
}
