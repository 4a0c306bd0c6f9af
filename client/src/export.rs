//! An export: the files of a map, chunk by chunk, each checked before it reaches a disk.
//!
//! Paths come from the server, so they are taken for what they are worth: relative, without "..",
//! and among those that the header announced. Chunks must be in order and without gaps. Nothing is
//! written here.

use tonic::Streaming;

use super::ClientError;
use super::calls::next;
use crate::wire::v1;
use v1::export_map_response::Content;

pub(super) const RPC: &str = "ExportMap";

/// A running export.
#[derive(Debug)]
pub struct MapExport {
    header: v1::ExportMapHeader,
    stream: Streaming<v1::ExportMapResponse>,
    order: Order,
}

impl MapExport {
    pub(super) async fn begin(
        mut stream: Streaming<v1::ExportMapResponse>,
    ) -> Result<Self, ClientError> {
        let first = next(RPC, &mut stream).await?.and_then(|answer| answer.content);
        let Some(Content::Header(header)) = first else {
            return Err(protocol("the export did not begin with a header"));
        };
        if !header.paths.iter().all(|path| is_safe(path)) {
            return Err(protocol("a path leaves the folder of the export"));
        }
        let order = Order::of(header.paths.clone());
        Ok(Self { header, stream, order })
    }

    /// What the export holds: revision and the paths of its files, in order.
    pub fn header(&self) -> &v1::ExportMapHeader {
        &self.header
    }

    /// The next piece of a file; `None` after the last one.
    ///
    /// # Errors
    /// The codes of `ExportMap`; [`ClientError::Protocol`] for chunks out of order or an early end.
    pub async fn next(&mut self) -> Result<Option<v1::FileChunk>, ClientError> {
        match next(RPC, &mut self.stream).await?.map(|answer| answer.content) {
            Some(Some(Content::Chunk(chunk))) => {
                let fits = self.order.fits(&chunk);
                fits.then_some(Some(chunk)).ok_or_else(|| protocol("a chunk is out of order"))
            }
            Some(_) => Err(protocol("a chunk was expected")),
            None if self.order.is_done() => Ok(None),
            None => Err(protocol("the export ended early")),
        }
    }
}

/// Where the next chunk must begin.
#[derive(Debug)]
pub(super) struct Order {
    paths: Vec<String>,
    file: usize,
    offset: i64,
}

impl Order {
    /// Of files with these paths.
    pub(super) fn of(paths: Vec<String>) -> Self {
        Self { paths, file: 0, offset: 0 }
    }

    /// Whether a chunk is the next one.
    pub(super) fn fits(&mut self, chunk: &v1::FileChunk) -> bool {
        let path = self.paths.get(self.file);
        if path != Some(&chunk.path) || chunk.offset != self.offset {
            return false;
        }
        self.offset += i64::try_from(chunk.data.len()).unwrap_or(i64::MAX);
        if chunk.last_chunk {
            (self.file, self.offset) = (self.file + 1, 0);
        }
        true
    }

    /// Whether every file was there.
    pub(super) fn is_done(&self) -> bool {
        self.file == self.paths.len()
    }
}

/// Whether a path stays below its folder, on any system.
pub(super) fn is_safe(path: &str) -> bool {
    let is_plain = |part: &str| !matches!(part, "" | "." | "..");
    !path.contains(['\\', ':', '\0']) && path.split('/').all(is_plain)
}

fn protocol(what: &'static str) -> ClientError {
    ClientError::Protocol { rpc: RPC, what }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk(path: &str, offset: i64, data: &[u8], last_chunk: bool) -> v1::FileChunk {
        v1::FileChunk { path: path.to_owned(), offset, data: data.to_vec(), last_chunk }
    }

    #[test]
    fn paths_stay_below_their_folder() {
        assert!(is_safe("map.ply") && is_safe("sparse/0/cameras.bin"));
        for path in ["", "/etc/passwd", "../x", "a/../b", "a//b", "C:\\x", "a\\..\\b", "./a"] {
            assert!(!is_safe(path), "{path}");
        }
    }

    #[test]
    fn chunks_come_in_order_and_without_gaps() {
        let paths = vec!["a".to_owned(), "b".to_owned()];
        let mut order = Order::of(paths);
        assert!(!order.fits(&chunk("b", 0, b"", true)));
        assert!(order.fits(&chunk("a", 0, b"xy", false)));
        assert!(!order.fits(&chunk("a", 3, b"z", true)));
        assert!(order.fits(&chunk("a", 2, b"z", true)));
        assert!(!order.is_done());
        assert!(order.fits(&chunk("b", 0, b"", true)));
        assert!(order.is_done());
        assert!(!order.fits(&chunk("b", 0, b"", true)));
    }
}
