//! Messages over a stream of bytes: each in a frame with version, length and checksum.
//!
//! A frame: `cvsp`, version (1 byte), three zero bytes, length (8 bytes), CRC32C of the payload (4
//! bytes), payload. Memory for a payload grows with the bytes that arrive, not with what was announced.
//! What a payload means is known to `codec`.

use std::io::{self, Read, Write};

use super::codec::{CodecError, Coded, decode, encode};
use super::message::Request;
use super::worker::Worker;
use crate::interrupt::Interrupt;

const MAGIC: [u8; 4] = *b"cvsp";
const VERSION: u8 = 2;
const HEAD: usize = 20;

/// Why a stream is of no use any more.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// The stream failed or ended within a frame.
    #[error("the stream broke: {0}")]
    Broken(#[from] io::Error),
    /// These are not frames of this protocol.
    #[error("the stream does not carry sections of a bundle adjustment")]
    Foreign,
    /// Another version of the protocol.
    #[error("the other side speaks version {found} of the protocol, this one {VERSION}")]
    Version {
        /// The other side's.
        found: u8,
    },
    /// A payload that was damaged on its way.
    #[error("a message was damaged on its way")]
    Checksum,
    /// A payload that is no message.
    #[error("a message cannot be read: {0}")]
    Codec(#[from] CodecError),
}

/// Writes a message.
pub(super) fn write_message<T: Coded>(stream: &mut impl Write, value: &T) -> io::Result<()> {
    let payload = encode(value);
    let mut head = Vec::with_capacity(HEAD);
    head.extend_from_slice(&MAGIC);
    head.extend_from_slice(&[VERSION, 0, 0, 0]);
    (payload.len() as u64).put(&mut head);
    crc32c::crc32c(&payload).put(&mut head);
    stream.write_all(&head)?;
    stream.write_all(&payload)?;
    stream.flush()
}

/// Reads a message; `None` where the stream ends before one.
pub(super) fn read_message<T: Coded>(stream: &mut impl Read) -> Result<Option<T>, FrameError> {
    let mut head = Vec::with_capacity(HEAD);
    stream.by_ref().take(HEAD as u64).read_to_end(&mut head)?;
    if head.is_empty() {
        return Ok(None);
    }
    let Some((magic, rest)) = head.split_first_chunk::<4>() else {
        return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
    };
    if *magic != MAGIC {
        return Err(FrameError::Foreign);
    }
    match rest.first() {
        Some(&VERSION) if head.len() == HEAD => {}
        Some(&found) if found != VERSION => return Err(FrameError::Version { found }),
        Some(_) | None => return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into()),
    }
    let length: u64 = decode(&head[8..16])?;
    let checksum: u32 = decode(&head[16..HEAD])?;
    let mut payload = Vec::new();
    stream.by_ref().take(length).read_to_end(&mut payload)?;
    if payload.len() as u64 != length {
        return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
    }
    if crc32c::crc32c(&payload) != checksum {
        return Err(FrameError::Checksum);
    }
    Ok(Some(decode(&payload)?))
}

/// Answers the requests of `input` on `output` until it ends: what a worker's process does.
///
/// # Errors
/// [`FrameError`] where a stream breaks or what comes is no request.
pub fn serve(input: &mut impl Read, output: &mut impl Write) -> Result<(), FrameError> {
    let mut worker = Worker::new();
    while let Some(request) = read_message::<Request>(input)? {
        let answer = worker.answer(request, &Interrupt::NEVER);
        write_message(output, &answer)?;
    }
    Ok(())
}
