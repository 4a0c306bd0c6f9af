//! A file of pages: bytes that are put away, and come back as they were or not at all.
//!
//! It is a temporary file without a name. Where each page stands, and its checksum, is in memory; the
//! room of pages that are no longer needed is used again, first where it fits. Knows no blocks.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Why something was not put on disk, or did not come back.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PageError {
    /// The system says no.
    #[error("the page file: cannot {action} {bytes} bytes at byte {offset}: {message}")]
    File {
        /// What was tried.
        action: &'static str,
        /// Where.
        offset: u64,
        /// How much.
        bytes: usize,
        /// What the system says.
        message: String,
    },
    /// What was read is not what was written.
    #[error("the page file: {bytes} bytes at byte {offset} are damaged")]
    Damaged {
        /// Where the page begins.
        offset: u64,
        /// Its length.
        bytes: usize,
    },
    /// Blocks cannot be packed.
    #[error("blocks cannot be packed: {message}")]
    Packing {
        /// What the packer says.
        message: String,
    },
}

/// Where bytes stand.
#[derive(Debug)]
pub(super) struct Page {
    offset: u64,
    bytes: usize,
    crc: u32,
}

impl Page {
    /// That what was read makes no sense.
    pub(super) fn damaged(&self) -> PageError {
        PageError::Damaged { offset: self.offset, bytes: self.bytes }
    }
}

/// Pages in a file.
#[derive(Debug)]
pub(super) struct PageFile {
    file: File,
    /// Behind the last page.
    end: u64,
    /// Room between pages: where it begins, and its bytes. No two touch.
    free: BTreeMap<u64, u64>,
}

impl PageFile {
    /// An empty one in a folder, or in the system's temporary one.
    ///
    /// # Errors
    /// No file can be made there.
    pub(super) fn new(folder: Option<&Path>) -> io::Result<Self> {
        let file = folder.map_or_else(tempfile::tempfile, tempfile::tempfile_in)?;
        Ok(Self { file, end: 0, free: BTreeMap::new() })
    }

    /// Bytes from the file's begin to the end of its last page.
    pub(super) fn bytes(&self) -> u64 {
        self.end
    }

    /// Puts bytes away.
    ///
    /// # Errors
    /// [`PageError::File`]; no page was changed.
    pub(super) fn put(&mut self, bytes: &[u8]) -> Result<Page, PageError> {
        let length = bytes.len() as u64;
        let room = self.free.iter().find(|&(_, &room)| room >= length);
        let (offset, room) = room.map_or((self.end, None), |(&offset, &room)| (offset, Some(room)));
        let written =
            self.file.seek(SeekFrom::Start(offset)).and_then(|_| self.file.write_all(bytes));
        written.map_err(|error| failed("write", offset, bytes.len(), &error))?;
        match room {
            Some(room) => {
                self.free.remove(&offset);
                if room > length {
                    self.free.insert(offset + length, room - length);
                }
            }
            None => self.end += length,
        }
        Ok(Page { offset, bytes: bytes.len(), crc: crc32c::crc32c(bytes) })
    }

    /// The bytes of a page.
    ///
    /// # Errors
    /// [`PageError::File`], and [`PageError::Damaged`] where they are not those that were put away.
    pub(super) fn read(&mut self, page: &Page) -> Result<Vec<u8>, PageError> {
        let mut bytes = vec![0; page.bytes];
        let read = self
            .file
            .seek(SeekFrom::Start(page.offset))
            .and_then(|_| self.file.read_exact(&mut bytes));
        read.map_err(|error| failed("read", page.offset, page.bytes, &error))?;
        if crc32c::crc32c(&bytes) != page.crc {
            return Err(page.damaged());
        }
        Ok(bytes)
    }

    /// Gives the room of a page to others.
    pub(super) fn free(&mut self, page: &Page) {
        let (mut offset, mut room) = (page.offset, page.bytes as u64);
        if let Some((&before, &bytes)) = self.free.range(..offset).next_back()
            && before + bytes == offset
        {
            self.free.remove(&before);
            (offset, room) = (before, bytes + room);
        }
        if let Some(after) = self.free.remove(&(offset + room)) {
            room += after;
        }
        if offset + room == self.end {
            self.end = offset;
        } else {
            self.free.insert(offset, room);
        }
    }

    /// Flips a bit of a page.
    #[cfg(test)]
    pub(super) fn flip(&mut self, page: &Page) {
        let at = page.offset + page.bytes as u64 / 2;
        let mut byte = [0];
        self.file.seek(SeekFrom::Start(at)).unwrap();
        self.file.read_exact(&mut byte).unwrap();
        self.file.seek(SeekFrom::Start(at)).unwrap();
        self.file.write_all(&[byte[0] ^ 4]).unwrap();
    }
}

fn failed(action: &'static str, offset: u64, bytes: usize, error: &io::Error) -> PageError {
    PageError::File { action, offset, bytes, message: error.to_string() }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn pages_come_back_whatever_was_put_and_freed_between(
            steps in prop::collection::vec((any::<bool>(), 1_usize..2000), 1..80),
        ) {
            let mut file = PageFile::new(None).unwrap();
            let mut kept: Vec<(Page, Vec<u8>)> = Vec::new();
            let mut most = 0;
            for (i, (puts, length)) in steps.into_iter().enumerate() {
                if puts || kept.is_empty() {
                    let bytes: Vec<u8> = (0..length).map(|k| (k * 31 + i) as u8).collect();
                    kept.push((file.put(&bytes).unwrap(), bytes));
                } else {
                    let (page, _) = kept.swap_remove(length % kept.len());
                    file.free(&page);
                }
                let used: u64 = kept.iter().map(|(_, bytes)| bytes.len() as u64).sum();
                let free: u64 = file.free.values().sum();
                prop_assert_eq!(used + free, file.bytes());
                most = most.max(used);
                for (page, bytes) in &kept {
                    prop_assert_eq!(&file.read(page).unwrap(), bytes);
                }
            }
            kept.drain(..).for_each(|(page, _)| file.free(&page));
            prop_assert_eq!((file.bytes(), file.free.len()), (0, 0));
        }
    }

    #[test]
    fn a_page_with_a_bit_flipped_is_refused() {
        let mut file = PageFile::new(None).unwrap();
        let pages = [&[1_u8; 100][..], &[2; 50]].map(|bytes| file.put(bytes).unwrap());
        file.flip(&pages[1]);
        assert_eq!(file.read(&pages[0]).unwrap(), [1; 100]);
        let refused = file.read(&pages[1]).unwrap_err();
        assert_eq!(refused.to_string(), "the page file: 50 bytes at byte 100 are damaged");
    }

    #[test]
    fn a_page_that_is_cut_off_is_refused() {
        let mut file = PageFile::new(None).unwrap();
        let page = file.put(&[7; 100]).unwrap();
        file.file.set_len(60).unwrap();
        let refused = file.read(&page).unwrap_err().to_string();
        assert!(
            refused.starts_with("the page file: cannot read 100 bytes at byte 0: "),
            "{refused}"
        );
    }
}
