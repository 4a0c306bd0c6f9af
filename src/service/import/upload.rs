//! The messages of an upload: a header, then the chunks of each file in order.
//!
//! A chunk that does not continue its file ends the call, and so does an upload on which nothing
//! comes for long, because it holds memory. Paths only name files in errors and to each other; none
//! is opened on this server.

use std::io::{self, Read};
use std::time::Duration;

use tokio::sync::mpsc;
use tonic::Streaming;

use super::File;
use crate::map::Usage;
use crate::service::context::Context;
use crate::service::engine::ImportRoom;
use crate::service::error::ServiceError;
use crate::wire::v1;
use v1::import_map_request::Content;

/// Longest data of a chunk, bytes.
const MAX_CHUNK: usize = 1 << 20;
/// Longest path of a file, bytes.
const MAX_PATH: usize = 1024;
/// Chunks that wait for the reader of a file.
const PIPE_CHUNKS: usize = 2;
/// Most bytes of files that are kept until all are there.
const MAX_KEPT: u64 = 1 << 28;
/// Most files that are kept.
const MAX_FILES: usize = 1024;
/// Longest time between two messages.
const LONGEST_PAUSE: Duration = Duration::from_secs(120);

/// An upload.
pub(super) struct Upload<'a> {
    context: &'a Context,
    inbound: Streaming<v1::ImportMapRequest>,
    /// The file whose next chunk is expected, and how much of it was sent.
    open: Option<(String, i64)>,
}

/// The place of bytes in an upload.
struct Chunk {
    path: String,
    data: Vec<u8>,
    ends_file: bool,
}

impl<'a> Upload<'a> {
    pub(super) fn new(context: &'a Context, inbound: Streaming<v1::ImportMapRequest>) -> Self {
        Self { context, inbound, open: None }
    }

    /// The first message.
    pub(super) async fn header(&mut self) -> Result<v1::ImportMapHeader, ServiceError> {
        match self.message().await? {
            Some(Content::Header(header)) => Ok(header),
            Some(Content::Chunk(_)) | None => {
                let description = "the first message is the header";
                Err(ServiceError::Protocol { field: "header", description })
            }
        }
    }

    /// Sends the bytes of the only file to its reader, and returns its path. Ends early if the
    /// reader has ended, which then says why.
    pub(super) async fn one_file(
        &mut self,
        reader: mpsc::Sender<Vec<u8>>,
    ) -> Result<String, ServiceError> {
        let missing = "the format has one file";
        let missing = ServiceError::Protocol { field: "chunk", description: missing };
        let mut chunk = self.chunk().await?.ok_or(missing)?;
        loop {
            let Chunk { path, data, ends_file } = chunk;
            if reader.send(data).await.is_err() {
                return Ok(path);
            }
            if ends_file {
                return match self.chunk().await? {
                    None => Ok(path),
                    Some(_) => {
                        let description = "the format has one file";
                        Err(ServiceError::Protocol { field: "chunk.path", description })
                    }
                };
            }
            chunk = self.chunk().await?.ok_or(ServiceError::Gone)?;
        }
    }

    /// Keeps all files, as far as the account has room for them.
    pub(super) async fn files(
        &mut self,
        mut room: ImportRoom,
    ) -> Result<(Vec<File>, ImportRoom), ServiceError> {
        let mut files: Vec<File> = Vec::new();
        let mut bytes = 0;
        while let Some(Chunk { path, data, ends_file: _ }) = self.chunk().await? {
            bytes += data.len() as u64;
            let is_new = files.last().is_none_or(|file| file.path != path);
            let maximum = i64::try_from(MAX_KEPT).unwrap_or(i64::MAX);
            if bytes > MAX_KEPT {
                return Err(ServiceError::ServerLimit { limit: "max_import_bytes", maximum });
            }
            if is_new && files.len() == MAX_FILES {
                let maximum = i64::try_from(MAX_FILES).unwrap_or(i64::MAX);
                return Err(ServiceError::ServerLimit { limit: "max_import_files", maximum });
            }
            room.reach(Usage { bytes, ..Usage::default() })?;
            if is_new && files.iter().any(|file| file.path == path) {
                let description = "the file has ended already";
                return Err(ServiceError::Protocol { field: "chunk.path", description });
            }
            match files.last_mut().filter(|_| !is_new) {
                Some(file) => file.bytes.extend_from_slice(&data),
                None => files.push(File { path, bytes: data }),
            }
        }
        Ok((files, room))
    }

    /// The next chunk, which continues its file; `None` at the end of the upload.
    async fn chunk(&mut self) -> Result<Option<Chunk>, ServiceError> {
        let protocol = |field, description| Err(ServiceError::Protocol { field, description });
        let chunk = match self.message().await? {
            Some(Content::Chunk(chunk)) => chunk,
            Some(Content::Header(_)) => return protocol("header", "the header comes once"),
            None if self.open.is_some() => {
                return protocol("chunk", "the upload ends within a file");
            }
            None => return Ok(None),
        };
        let v1::FileChunk { path, offset, data, last_chunk } = chunk;
        if path.is_empty() || path.len() > MAX_PATH || path.contains(['\0', '\n']) {
            return protocol("chunk.path", "a path has 1 to 1024 bytes in one line");
        }
        if data.len() > MAX_CHUNK {
            return protocol("chunk.data", "a chunk has at most 1 MiB");
        }
        let expected = match self.open.take() {
            Some((open, _)) if open != path => {
                return protocol("chunk.path", "the file before it has not ended");
            }
            Some((_, expected)) => expected,
            None => 0,
        };
        if offset != expected {
            return protocol("chunk.offset", "chunks come in order and without gaps");
        }
        if !last_chunk {
            let length = i64::try_from(data.len()).unwrap_or(i64::MAX);
            self.open = Some((path.clone(), expected.saturating_add(length)));
        }
        Ok(Some(Chunk { path, data, ends_file: last_chunk }))
    }

    async fn message(&mut self) -> Result<Option<Content>, ServiceError> {
        let read = tokio::time::timeout(LONGEST_PAUSE, self.inbound.message());
        let message = tokio::select! {
            read = read => match read {
                Ok(read) => read,
                Err(_late) => {
                    let seconds = LONGEST_PAUSE.as_secs();
                    return Err(ServiceError::SlowMessage { seconds });
                }
            },
            () = self.context.drained() => return Err(ServiceError::Draining),
        };
        let message = message.map_err(|status| {
            let (code, message) = (status.code(), status.message().to_owned());
            ServiceError::Transport { code, message }
        })?;
        let Some(message) = message else { return Ok(None) };
        let description = "a message without content";
        let empty = ServiceError::Protocol { field: "content", description };
        message.content.map(Some).ok_or(empty)
    }
}

/// Bytes from an upload to the thread that reads them.
pub(super) fn pipe() -> (mpsc::Sender<Vec<u8>>, Pipe) {
    let (sender, chunks) = mpsc::channel(PIPE_CHUNKS);
    (sender, Pipe { chunks, rest: io::Cursor::default() })
}

/// The end of a pipe that is read, on a thread that may block.
#[derive(Debug)]
pub(super) struct Pipe {
    chunks: mpsc::Receiver<Vec<u8>>,
    rest: io::Cursor<Vec<u8>>,
}

impl Read for Pipe {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        loop {
            let read = self.rest.read(out)?;
            if read > 0 || out.is_empty() {
                return Ok(read);
            }
            match self.chunks.blocking_recv() {
                Some(chunk) => self.rest = io::Cursor::new(chunk),
                None => return Ok(0),
            }
        }
    }
}
