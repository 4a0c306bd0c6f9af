//! Files that are written once: sealed by a checksum, never seen half.
//!
//! ```text
//! "covissnp" or "covismap"  version u32  0 u32  uid [16]  sequence u64  length u64
//! body [length]  crc32c u32 over all that stands before it
//! ```
//!
//! A file is written under a temporary name, synced, renamed and its folder synced: whoever sees the
//! name sees the whole file. Snapshots are compressed with zstd; the identity of a map is not.

use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use super::disk::Disk;
use super::file_error;
use super::record::{Uid, VERSION};
use crate::map::Map;
use crate::store::StoreError;
use crate::store::encoding::{compare_map, decode_map, encode_map};

/// Bytes before the body.
const HEAD: usize = 48;
/// Fast, and within a few percent of what more effort would save on poses and pixels.
const COMPRESSION_LEVEL: i32 = 3;

/// The kinds of sealed file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// A map's name.
    Identity,
    /// A map at a sequence.
    Snapshot,
}

impl Kind {
    fn magic(self) -> &'static [u8; 8] {
        match self {
            Self::Identity => b"covismap",
            Self::Snapshot => b"covissnp",
        }
    }
}

/// The bytes of a file.
pub(super) fn seal(kind: Kind, uid: &Uid, sequence: u64, body: &[u8]) -> Vec<u8> {
    let mut bytes = head(kind, uid, sequence);
    bytes.extend_from_slice(body);
    finish(bytes)
}

/// The bytes before the body, whose length is not known yet.
fn head(kind: Kind, uid: &Uid, sequence: u64) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEAD);
    bytes.extend_from_slice(kind.magic());
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(&0_u32.to_le_bytes());
    bytes.extend_from_slice(uid);
    bytes.extend_from_slice(&sequence.to_le_bytes());
    bytes.extend_from_slice(&0_u64.to_le_bytes());
    bytes
}

/// Writes the body's length into the head and puts the checksum behind.
fn finish(mut bytes: Vec<u8>) -> Vec<u8> {
    let length = (bytes.len() - HEAD) as u64;
    bytes[HEAD - 8..HEAD].copy_from_slice(&length.to_le_bytes());
    bytes.extend_from_slice(&crc32c::crc32c(&bytes).to_le_bytes());
    bytes
}

/// The uid, sequence and body of a file, or what is wrong with it.
pub(super) fn unseal(kind: Kind, bytes: &[u8]) -> Result<(Uid, u64, &[u8]), String> {
    let Some((sealed, crc)) = bytes.split_last_chunk::<4>() else {
        return Err("the file is too short".to_owned());
    };
    let Some((head, body)) = sealed.split_first_chunk::<HEAD>() else {
        return Err("the file is too short".to_owned());
    };
    if crc32c::crc32c(sealed) != u32::from_le_bytes(*crc) {
        return Err("the checksum does not fit".to_owned());
    }
    let number = |at: usize| head[at..].first_chunk().map_or(0, |&b| u64::from_le_bytes(b));
    let version = head[8..].first_chunk().map_or(0, |&b| u32::from_le_bytes(b));
    if !head.starts_with(kind.magic()) || number(40) != body.len() as u64 {
        return Err("it is no file of this kind".to_owned());
    }
    if version != VERSION {
        return Err(format!("it has version {version}, and {VERSION} is the latest known here"));
    }
    let mut uid = Uid::default();
    uid.copy_from_slice(&head[16..32]);
    Ok((uid, number(32), body))
}

/// Writes a file so that it is there whole and durable, or not at all.
pub(super) fn write(disk: &dyn Disk, path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let temporary = path.with_extension("tmp");
    let folder = path.parent().unwrap_or(path);
    let written = disk.create(&temporary).and_then(|mut file| {
        file.append(bytes)?;
        file.sync()
    });
    let named = written.and_then(|()| disk.rename(&temporary, path));
    named.and_then(|()| disk.sync_folder(folder)).map_err(|error| {
        // What is left of it goes when the store is opened next, if not now.
        let _left = disk.remove(&temporary);
        file_error("cannot write", path, &error)
    })
}

/// The bytes of a snapshot.
///
/// # Errors
/// [`StoreError::Content`], which would be a bug.
pub(super) fn seal_map(uid: &Uid, map: &Map) -> Result<Vec<u8>, StoreError> {
    let failed = |message: String| StoreError::Content { path: "a snapshot".to_owned(), message };
    let stream = |error: std::io::Error| failed(error.to_string());
    // Compressed behind the head, so that the file stands in memory once.
    let head = head(Kind::Snapshot, uid, crate::store::sequence_of(map.revision()));
    let mut encoder = zstd::Encoder::new(head, COMPRESSION_LEVEL).map_err(stream)?;
    encode_map(map, &mut encoder).map_err(|error| failed(error.to_string()))?;
    Ok(finish(encoder.finish().map_err(stream)?))
}

/// The map of a snapshot, checked down to its state hash.
pub(super) fn unseal_map(bytes: &[u8]) -> Result<Arc<Map>, String> {
    let (sequence, mut parts) = unseal_parts(bytes)?;
    let map = decode_map(&mut parts).map_err(|error| error.to_string())?;
    if crate::store::sequence_of(map.revision()) != sequence {
        return Err("the map has another revision than the file".to_owned());
    }
    Ok(Arc::new(map))
}

/// Whether a snapshot holds this map, or what is wrong with it. Takes little memory beside both.
pub(super) fn compare_sealed(bytes: &[u8], map: &Map) -> Result<(), String> {
    let (sequence, mut parts) = unseal_parts(bytes)?;
    compare_map(&mut parts, map).map_err(|error| error.to_string())?;
    if crate::store::sequence_of(map.revision()) != sequence {
        return Err("the map has another revision than the file".to_owned());
    }
    Ok(())
}

/// A snapshot's sequence and the stream of its parts.
fn unseal_parts(bytes: &[u8]) -> Result<(u64, impl Read), String> {
    let (_uid, sequence, body) = unseal(Kind::Snapshot, bytes)?;
    let stream = |error: std::io::Error| error.to_string();
    let mut decoder = zstd::Decoder::with_buffer(body).map_err(stream)?;
    // Ours have 21; a window beyond this would only cost memory.
    decoder.window_log_max(23).map_err(stream)?;
    Ok((sequence, decoder))
}
