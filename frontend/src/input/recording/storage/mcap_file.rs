//! An MCAP file: one pass over its records for the index, and single messages by their place.
//!
//! A file without an end is read as far as it goes, and a damaged chunk is skipped. Chunks that are not
//! compressed are gone through in the file; of the others a few are kept, because the images of a frame lie
//! near each other.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use lz4_flex::frame::FrameDecoder;

use super::super::error::{Fault, RecordingError};
use super::super::index::{At, HEAD_BYTES, Index, Place};
use super::super::note::Note;
use super::mcap_record::{self as record, MESSAGE_HEAD, PREFIX};
use super::{MAX_MESSAGE_BYTES, check_length};

/// Decompressed chunks that are kept, at most, and their bytes together.
const KEPT_CHUNKS: usize = 4;
const KEPT_BYTES: usize = 256 << 20;

/// An open file.
pub(in crate::input::recording) struct McapFile {
    path: PathBuf,
    file: BufReader<File>,
    /// Where the reader is.
    position: u64,
    length: u64,
    /// Where the record of each begins, and its data; the latest last.
    chunks: VecDeque<(u64, Vec<u8>)>,
}

impl std::fmt::Debug for McapFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("McapFile").field("path", &self.path).finish_non_exhaustive()
    }
}

/// What one pass knows of the file.
struct Pass<'a> {
    file: usize,
    index: &'a mut Index,
    schemas: BTreeMap<u16, String>,
    /// The topic of each channel.
    channels: BTreeMap<u16, usize>,
}

impl Pass<'_> {
    /// Takes a record of which the first fields, and the length of all, are known. `data_at` says where in
    /// the file something is that is so far behind the beginning of the fields.
    fn record(
        &mut self,
        opcode: u8,
        head: &[u8],
        length: u64,
        data_at: impl Fn(usize) -> At,
    ) -> Result<(), Fault> {
        match opcode {
            record::SCHEMA => {
                let (id, name) = record::schema(head)?;
                self.schemas.insert(id, name.to_owned());
            }
            record::CHANNEL => {
                let channel = record::channel(head)?;
                let type_name = self.schemas.get(&channel.schema).map_or("", String::as_str);
                let topic = self.index.topic(channel.topic, type_name, channel.encoding);
                self.channels.insert(channel.id, topic);
            }
            record::MESSAGE => {
                let (channel, recorded_ns, data) = record::message(head)?;
                if let Some(&topic) = self.channels.get(&channel) {
                    let (at, length) = (data_at(MESSAGE_HEAD), length - MESSAGE_HEAD as u64);
                    let place = Place { file: self.file, at, length };
                    self.index.message(topic, recorded_ns as f64 * 1e-9, data, place);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes the records of a decompressed chunk.
    fn chunk(&mut self, begin: u64, bytes: &[u8]) -> Result<(), Fault> {
        let mut at = 0;
        while let Some(rest) = bytes.get(at..).filter(|rest| !rest.is_empty()) {
            let malformed = Fault::Record { opcode: record::CHUNK };
            let Some((opcode, length)) = record::prefix(rest) else { return Err(malformed) };
            let end = usize::try_from(length).ok().and_then(|length| length.checked_add(PREFIX));
            let Some(fields) = end.and_then(|end| rest.get(PREFIX..end)) else {
                return Err(malformed);
            };
            let head = &fields[..fields.len().min(HEAD_BYTES)];
            self.record(opcode, head, length, |behind| At::Chunk {
                record: begin,
                offset: at + PREFIX + behind,
            })?;
            at += PREFIX + fields.len();
        }
        Ok(())
    }
}

impl McapFile {
    pub(super) fn new(file: File, path: &Path) -> io::Result<Self> {
        let mut file = BufReader::with_capacity(1 << 16, file);
        let length = file.seek(SeekFrom::End(0))?;
        file.seek(SeekFrom::Start(0))?;
        Ok(Self { path: path.to_owned(), file, position: 0, length, chunks: VecDeque::new() })
    }

    /// Adds its topics and messages to the index.
    pub(super) fn scan(&mut self, file: usize, index: &mut Index) -> Result<(), RecordingError> {
        let (schemas, channels) = (BTreeMap::new(), BTreeMap::new());
        let mut pass = Pass { file, index, schemas, channels };
        let begin = record::MAGIC.len() as u64;
        if let Some(offset) = self.records(begin, self.length, false, &mut pass)? {
            pass.index.note(Note::Cut { path: self.path.clone(), offset });
        }
        Ok(())
    }

    /// Takes the records between two places of the file. The answer is where they end, unless it is by the
    /// record that says so, or in a chunk at `end`.
    fn records(
        &mut self,
        begin: u64,
        end: u64,
        is_chunk: bool,
        pass: &mut Pass<'_>,
    ) -> Result<Option<u64>, RecordingError> {
        let mut at = begin;
        let mut head = Vec::with_capacity(HEAD_BYTES);
        loop {
            self.read_at(at, (PREFIX + HEAD_BYTES) as u64, end, &mut head)?;
            let Some((opcode, length)) = record::prefix(&head) else { break };
            if !is_chunk && matches!(opcode, record::DATA_END | record::FOOTER) {
                return Ok(None);
            }
            let fields_at = at + PREFIX as u64;
            let Some(next) = fields_at.checked_add(length).filter(|&next| next <= end) else {
                break;
            };
            let known = usize::try_from(length).unwrap_or(usize::MAX).min(head.len() - PREFIX);
            let fields = &head[PREFIX..PREFIX + known];
            let taken = if opcode == record::CHUNK && !is_chunk {
                let fields = fields.to_vec();
                self.chunk(at, &fields, length, pass)?
            } else {
                let data_at = |behind| At::File(fields_at + behind as u64);
                pass.record(opcode, fields, length, data_at)
            };
            if let Err(fault) = taken {
                pass.index.damage(self.damaged(at, fault));
            }
            // The records of a chunk count with the chunk.
            if !is_chunk && !pass.index.pass(next - at) {
                return Ok(None);
            }
            at = next;
        }
        Ok((!is_chunk || at < end).then_some(at))
    }

    /// Takes the records of the chunk at this place of the file.
    fn chunk(
        &mut self,
        at: u64,
        fields: &[u8],
        length: u64,
        pass: &mut Pass<'_>,
    ) -> Result<Result<(), Fault>, RecordingError> {
        let chunk = match record::chunk(fields) {
            Ok(chunk) if chunk.stored <= length - chunk.head => chunk,
            Ok(_) => return Ok(Err(Fault::Length)),
            Err(fault) => return Ok(Err(fault)),
        };
        let begin = at + PREFIX as u64 + chunk.head;
        if chunk.compression.is_empty() {
            let cut = self.records(begin, begin + chunk.stored, true, pass)?;
            return Ok(cut.map_or(Ok(()), |_| Err(Fault::Record { opcode: record::CHUNK })));
        }
        Ok(self.decompress(begin, &chunk)?.and_then(|bytes| {
            if chunk.checksum != 0 && chunk.checksum != crc32fast::hash(&bytes) {
                return Err(Fault::Checksum);
            }
            pass.chunk(at, &bytes)
        }))
    }

    /// The data of a chunk.
    fn decompress(
        &mut self,
        begin: u64,
        chunk: &record::Chunk<'_>,
    ) -> Result<Result<Vec<u8>, Fault>, RecordingError> {
        if chunk.length > MAX_MESSAGE_BYTES {
            return Ok(Err(Fault::TooLarge { bytes: chunk.length, most: MAX_MESSAGE_BYTES }));
        }
        self.seek(begin)?;
        let stored = (&mut self.file).take(chunk.stored);
        let bytes = match chunk.compression {
            "zstd" => {
                zstd::Decoder::with_buffer(stored).and_then(|decoder| all(decoder, chunk.length))
            }
            "lz4" => all(FrameDecoder::new(stored), chunk.length),
            name => {
                let name = name.chars().take(40).collect();
                return Ok(Err(Fault::Compression { name }));
            }
        };
        self.position = self.file.stream_position().map_err(|source| self.failed(source))?;
        Ok(match bytes {
            Ok(bytes) if bytes.len() as u64 == chunk.length => Ok(bytes),
            Ok(_) => Err(Fault::Length),
            Err(source) => Err(Fault::Decompress(source)),
        })
    }

    /// Reads a message.
    pub(super) fn read(&mut self, place: Place, into: &mut Vec<u8>) -> Result<(), RecordingError> {
        check_length(&self.path, place.length)?;
        match place.at {
            At::File(at) => self.read_at(at, place.length, self.length, into),
            At::Chunk { record, offset } => {
                let kept = self.chunks.iter().position(|(begin, _)| *begin == record);
                let number = match kept {
                    Some(number) => number,
                    None => self.keep_chunk(record)?,
                };
                let length = usize::try_from(place.length).unwrap_or(usize::MAX);
                let end = offset.saturating_add(length);
                let chunk = self.chunks.get(number).and_then(|(_, bytes)| bytes.get(offset..end));
                into.extend_from_slice(chunk.ok_or_else(|| self.damaged(record, Fault::Length))?);
                Ok(())
            }
            #[cfg(feature = "sqlite")]
            At::Row(_) => Ok(()),
        }
    }

    /// Decompresses the chunk at this place of the file; the answer is its number among those that are kept.
    fn keep_chunk(&mut self, at: u64) -> Result<usize, RecordingError> {
        let mut head = Vec::new();
        self.read_at(at, (PREFIX + HEAD_BYTES) as u64, self.length, &mut head)?;
        let fields = head.get(PREFIX..).unwrap_or_default();
        let chunk = record::chunk(fields).map_err(|fault| self.damaged(at, fault))?;
        let bytes = self.decompress(at + PREFIX as u64 + chunk.head, &chunk)?;
        let bytes = bytes.map_err(|fault| self.damaged(at, fault))?;
        let kept = |chunks: &VecDeque<(u64, Vec<u8>)>| -> usize {
            chunks.iter().map(|(_, bytes)| bytes.len()).sum()
        };
        while self.chunks.len() >= KEPT_CHUNKS
            || (!self.chunks.is_empty() && kept(&self.chunks) + bytes.len() > KEPT_BYTES)
        {
            self.chunks.pop_front();
        }
        self.chunks.push_back((at, bytes));
        Ok(self.chunks.len() - 1)
    }

    /// Reads from a place on, so much or up to `end`, in place of what `into` holds.
    fn read_at(
        &mut self,
        at: u64,
        most: u64,
        end: u64,
        into: &mut Vec<u8>,
    ) -> Result<(), RecordingError> {
        into.clear();
        self.seek(at)?;
        let length = most.min(end.saturating_sub(at));
        let read = (&mut self.file).take(length).read_to_end(into);
        self.position += into.len() as u64;
        read.map(|_| ()).map_err(|source| self.failed(source))
    }

    /// Goes to a place, within what is buffered where it is there.
    fn seek(&mut self, at: u64) -> Result<(), RecordingError> {
        let step = i128::from(at) - i128::from(self.position);
        let sought = match i64::try_from(step) {
            Ok(step) => self.file.seek_relative(step),
            Err(_) => self.file.seek(SeekFrom::Start(at)).map(|_| ()),
        };
        sought.map_err(|source| self.failed(source))?;
        self.position = at;
        Ok(())
    }

    fn failed(&self, source: io::Error) -> RecordingError {
        RecordingError::Read { path: self.path.clone(), source }
    }

    fn damaged(&self, offset: u64, fault: Fault) -> RecordingError {
        RecordingError::Damaged { path: self.path.clone(), offset, fault }
    }
}

/// What a decoder gives, up to as much as is expected: memory grows with what is there.
fn all(decoder: impl Read, expected: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    decoder.take(expected).read_to_end(&mut bytes)?;
    Ok(bytes)
}
