//! The messages of an upload: a header, then the chunks of each file in order.
//!
//! A chunk that does not continue its file ends the call, and so does an upload on which nothing
//! comes for long, because it holds memory. Paths only name files in errors and to each other; none
//! is opened on this server.

use std::time::Duration;

use tonic::Streaming;

use super::context::Context;
use super::error::ServiceError;
use super::printable::is_printable;
use crate::wire::v1;

/// Longest data of a chunk, bytes.
const MAX_CHUNK: usize = 1 << 20;
/// Longest path of a file, bytes.
const MAX_PATH: usize = 1024;
/// Most files of an upload.
pub(super) const MAX_FILES: usize = 1024;
/// Longest time between two messages.
const LONGEST_PAUSE: Duration = Duration::from_secs(120);

/// A message of an upload.
pub(super) trait UploadMessage {
    /// The first message.
    type Header;

    /// What it holds; `None` where it is empty.
    fn content(self) -> Option<Content<Self::Header>>;
}

/// What a message of an upload holds.
pub(super) enum Content<H> {
    /// What follows.
    Header(H),
    /// A piece of a file.
    Chunk(v1::FileChunk),
}

impl UploadMessage for v1::ImportMapRequest {
    type Header = v1::ImportMapHeader;

    fn content(self) -> Option<Content<Self::Header>> {
        Some(match self.content? {
            v1::import_map_request::Content::Header(header) => Content::Header(header),
            v1::import_map_request::Content::Chunk(chunk) => Content::Chunk(chunk),
        })
    }
}

impl UploadMessage for v1::UploadJobFilesRequest {
    type Header = v1::UploadJobFilesHeader;

    fn content(self) -> Option<Content<Self::Header>> {
        Some(match self.content? {
            v1::upload_job_files_request::Content::Header(header) => Content::Header(header),
            v1::upload_job_files_request::Content::Chunk(chunk) => Content::Chunk(chunk),
        })
    }
}

/// An upload.
pub(super) struct Upload<'a, M> {
    context: &'a Context,
    inbound: Streaming<M>,
    /// The file whose next chunk is expected, and how much of it was sent.
    open: Option<(String, i64)>,
}

/// A chunk of a file in an upload.
pub(super) struct Chunk {
    /// The path of its file.
    pub(super) path: String,
    /// The bytes.
    pub(super) data: Vec<u8>,
    /// Whether the file begins with them.
    pub(super) begins_file: bool,
    /// Whether the file ends with them.
    pub(super) ends_file: bool,
}

impl<'a, M: UploadMessage> Upload<'a, M> {
    pub(super) fn new(context: &'a Context, inbound: Streaming<M>) -> Self {
        Self { context, inbound, open: None }
    }

    /// The first message.
    pub(super) async fn header(&mut self) -> Result<M::Header, ServiceError> {
        match self.message().await? {
            Some(Content::Header(header)) => Ok(header),
            Some(Content::Chunk(_)) | None => {
                let description = "the first message is the header";
                Err(ServiceError::Protocol { field: "header", description })
            }
        }
    }

    /// The next chunk, which continues its file; `None` at the end of the upload.
    pub(super) async fn chunk(&mut self) -> Result<Option<Chunk>, ServiceError> {
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
        if path.is_empty() || path.len() > MAX_PATH || !path.chars().all(is_printable) {
            let text = "a path has 1 to 1024 bytes, no control characters and no direction marks";
            return protocol("chunk.path", text);
        }
        if data.len() > MAX_CHUNK {
            return protocol("chunk.data", "a chunk has at most 1 MiB");
        }
        let begins_file = self.open.is_none();
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
        Ok(Some(Chunk { path, data, begins_file, ends_file: last_chunk }))
    }

    async fn message(&mut self) -> Result<Option<Content<M::Header>>, ServiceError> {
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
        message.content().map(Some).ok_or(empty)
    }
}

/// The error of a file whose path was sent before.
pub(super) fn sent_before() -> ServiceError {
    let description = "the file has ended already";
    ServiceError::Protocol { field: "chunk.path", description }
}
