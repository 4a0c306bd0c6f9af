//! The files of an import: one that is read while it comes, or several that are kept until all are
//! there. `service/upload.rs` puts their chunks in order.

use std::io::{self, Read};

use tokio::sync::mpsc;

use super::File;
use crate::map::Usage;
use crate::service::engine::ImportRoom;
use crate::service::error::ServiceError;
use crate::service::upload::{Chunk, MAX_FILES, Upload, sent_before};
use crate::wire::v1;

/// Chunks that wait for the reader of a file.
const PIPE_CHUNKS: usize = 2;
/// Most bytes of files that are kept until all are there.
const MAX_KEPT: u64 = 1 << 28;

/// The upload of a map.
pub(super) type Import<'a> = Upload<'a, v1::ImportMapRequest>;

/// Sends the bytes of the only file to its reader, and returns its path. Ends early if the reader has
/// ended, which then says why.
pub(super) async fn one_file(
    upload: &mut Import<'_>,
    reader: mpsc::Sender<Vec<u8>>,
) -> Result<String, ServiceError> {
    let missing = "the format has one file";
    let missing = ServiceError::Protocol { field: "chunk", description: missing };
    let mut chunk = upload.chunk().await?.ok_or(missing)?;
    loop {
        let Chunk { path, data, ends_file, .. } = chunk;
        if reader.send(data).await.is_err() {
            return Ok(path);
        }
        if ends_file {
            return match upload.chunk().await? {
                None => Ok(path),
                Some(_) => {
                    let description = "the format has one file";
                    Err(ServiceError::Protocol { field: "chunk.path", description })
                }
            };
        }
        chunk = upload.chunk().await?.ok_or(ServiceError::Gone)?;
    }
}

/// Keeps all files, as far as the account has room for them.
pub(super) async fn files(
    upload: &mut Import<'_>,
    mut room: ImportRoom,
) -> Result<(Vec<File>, ImportRoom), ServiceError> {
    let mut files: Vec<File> = Vec::new();
    let mut bytes = 0;
    while let Some(Chunk { path, data, begins_file, .. }) = upload.chunk().await? {
        bytes += data.len() as u64;
        let maximum = i64::try_from(MAX_KEPT).unwrap_or(i64::MAX);
        if bytes > MAX_KEPT {
            return Err(ServiceError::ServerLimit { limit: "max_import_bytes", maximum });
        }
        if begins_file && files.len() == MAX_FILES {
            let maximum = i64::try_from(MAX_FILES).unwrap_or(i64::MAX);
            return Err(ServiceError::ServerLimit { limit: "max_import_files", maximum });
        }
        room.reach(Usage { bytes, ..Usage::default() })?;
        if begins_file && files.iter().any(|file| file.path == path) {
            return Err(sent_before());
        }
        match files.last_mut().filter(|_| !begins_file) {
            Some(file) => file.bytes.extend_from_slice(&data),
            None => files.push(File { path, bytes: data }),
        }
    }
    Ok((files, room))
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
