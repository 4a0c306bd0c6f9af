//! The records of an MCAP file that matter here: schemas, channels, messages and the heads of chunks
//! (<https://mcap.dev/spec>). Numbers are little endian, texts follow their length.
//!
//! All that is read is in the first bytes of a record, so that none of them is read as a whole. The
//! crate `mcap` is not used: it reserves memory by lengths that the file has not proven, and does not tell where
//! a record is. Nothing here reads files.

use super::super::error::Fault;

/// The first bytes of a file, and the last ones.
pub(super) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
/// What comes before a record's fields: what it is, and its length.
pub(super) const PREFIX: usize = 9;

pub(super) const FOOTER: u8 = 0x02;
pub(super) const SCHEMA: u8 = 0x03;
pub(super) const CHANNEL: u8 = 0x04;
pub(super) const MESSAGE: u8 = 0x05;
pub(super) const CHUNK: u8 = 0x06;
pub(super) const DATA_END: u8 = 0x0f;

/// Bytes of a message's record before its data.
pub(super) const MESSAGE_HEAD: usize = 22;

/// What a record is, and how long its fields are.
pub(super) fn prefix(bytes: &[u8]) -> Option<(u8, u64)> {
    let (&[opcode], rest) = bytes.split_first_chunk()?;
    let (&length, _) = rest.split_first_chunk()?;
    Some((opcode, u64::from_le_bytes(length)))
}

/// The fields of a record, one after the other.
struct Fields<'a> {
    opcode: u8,
    bytes: &'a [u8],
}

impl<'a> Fields<'a> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let (field, rest) =
            self.bytes.split_first_chunk().ok_or(Fault::Record { opcode: self.opcode })?;
        self.bytes = rest;
        Ok(*field)
    }

    fn u16(&mut self) -> Result<u16, Fault> {
        Ok(u16::from_le_bytes(self.take()?))
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        Ok(u32::from_le_bytes(self.take()?))
    }

    fn u64(&mut self) -> Result<u64, Fault> {
        Ok(u64::from_le_bytes(self.take()?))
    }

    fn text(&mut self) -> Result<&'a str, Fault> {
        let malformed = Fault::Record { opcode: self.opcode };
        let length = self.u32()? as usize;
        let Some((text, rest)) = self.bytes.split_at_checked(length) else { return Err(malformed) };
        self.bytes = rest;
        str::from_utf8(text).ok().ok_or(malformed)
    }
}

/// The number and the name of a schema.
pub(super) fn schema(head: &[u8]) -> Result<(u16, &str), Fault> {
    let mut fields = Fields { opcode: SCHEMA, bytes: head };
    Ok((fields.u16()?, fields.text()?))
}

/// A topic.
pub(super) struct Channel<'a> {
    pub(super) id: u16,
    pub(super) schema: u16,
    pub(super) topic: &'a str,
    pub(super) encoding: &'a str,
}

pub(super) fn channel(head: &[u8]) -> Result<Channel<'_>, Fault> {
    let mut fields = Fields { opcode: CHANNEL, bytes: head };
    Ok(Channel {
        id: fields.u16()?,
        schema: fields.u16()?,
        topic: fields.text()?,
        encoding: fields.text()?,
    })
}

/// A message: its channel, when it was recorded, and the beginning of its data.
pub(super) fn message(head: &[u8]) -> Result<(u16, u64, &[u8]), Fault> {
    let mut fields = Fields { opcode: MESSAGE, bytes: head };
    let channel = fields.u16()?;
    let _sequence = fields.u32()?;
    let recorded_ns = fields.u64()?;
    let _published_ns = fields.u64()?;
    Ok((channel, recorded_ns, fields.bytes))
}

/// A chunk, without its data.
pub(super) struct Chunk<'a> {
    /// Of the data after decompression, bytes.
    pub(super) length: u64,
    /// Of the same, 0 where there is none.
    pub(super) checksum: u32,
    pub(super) compression: &'a str,
    /// Of the data as they stand, bytes.
    pub(super) stored: u64,
    /// Of the fields before the data, bytes.
    pub(super) head: u64,
}

pub(super) fn chunk(head: &[u8]) -> Result<Chunk<'_>, Fault> {
    let mut fields = Fields { opcode: CHUNK, bytes: head };
    let _times_ns = [fields.u64()?, fields.u64()?];
    let length = fields.u64()?;
    let checksum = fields.u32()?;
    let compression = fields.text()?;
    let stored = fields.u64()?;
    let head = (head.len() - fields.bytes.len()) as u64;
    Ok(Chunk { length, checksum, compression, stored, head })
}
