//! A file of pages: bytes are stored, and read back unchanged or with an error.
//!
//! It is a temporary file without a name. The offset and the checksum of each page are in memory. The
//! room of freed pages is reused, the first that is large enough. Independent of blocks.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Why a page was not written or not read back.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PageError {
    /// An error of the system: the disk may be full.
    #[error("the page file in {folder}: cannot {action} {bytes} bytes at byte {offset}: {message}")]
    File {
        /// The file's folder; the file has no name.
        folder: String,
        /// The action that failed.
        action: &'static str,
        /// Byte offset in the file.
        offset: u64,
        /// Number of bytes.
        bytes: usize,
        /// The system's message.
        message: String,
    },
    /// What was read is not what was written.
    #[error("the page file in {folder}: {bytes} bytes at byte {offset} are damaged")]
    Damaged {
        /// The file's folder.
        folder: String,
        /// Where the page begins.
        offset: u64,
        /// Its length.
        bytes: usize,
    },
    /// Blocks cannot be packed.
    #[error("blocks cannot be packed: {message}")]
    Packing {
        /// The packer's message.
        message: String,
    },
}

/// The offset and checksum of stored bytes.
#[derive(Debug)]
pub(super) struct Page {
    offset: u64,
    bytes: usize,
    crc: u32,
}

/// Storage for pages: a file, and in tests one on a full disk.
pub(super) trait Storage: Read + Write + Seek + Debug + Send + Sync {}

impl Storage for File {}

/// Pages in a file.
#[derive(Debug)]
pub(super) struct PageFile {
    file: Box<dyn Storage>,
    /// The file's folder, for error messages.
    folder: String,
    /// End of the last page.
    end: u64,
    /// Free ranges between pages: offset and bytes. No two are adjacent.
    free: BTreeMap<u64, u64>,
}

impl PageFile {
    /// An empty one in a folder, or in the system's temporary one, if a file can be made there.
    pub(super) fn new(folder: Option<&Path>) -> io::Result<Self> {
        let folder = folder.map_or_else(std::env::temp_dir, Path::to_owned);
        let file = tempfile::tempfile_in(&folder)?;
        Ok(Self::over(Box::new(file), &folder))
    }

    fn over(file: Box<dyn Storage>, folder: &Path) -> Self {
        Self { file, folder: folder.display().to_string(), end: 0, free: BTreeMap::new() }
    }

    /// Bytes from the file's start to the end of its last page.
    pub(super) fn bytes(&self) -> u64 {
        self.end
    }

    /// Stores bytes. With [`PageError::File`] no page was changed.
    pub(super) fn put(&mut self, bytes: &[u8]) -> Result<Page, PageError> {
        let length = bytes.len() as u64;
        let room = self.free.iter().find(|&(_, &room)| room >= length);
        let (offset, room) = room.map_or((self.end, None), |(&offset, &room)| (offset, Some(room)));
        let sought = self.file.seek(SeekFrom::Start(offset));
        let written = sought.and_then(|_| self.file.write_all(bytes));
        written.map_err(|error| self.failed("write", offset, bytes.len(), &error))?;
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

    /// The bytes of a page; [`PageError::Damaged`] where they differ from what was stored.
    pub(super) fn read(&mut self, page: &Page) -> Result<Vec<u8>, PageError> {
        let mut bytes = vec![0; page.bytes];
        let sought = self.file.seek(SeekFrom::Start(page.offset));
        let read = sought.and_then(|_| self.file.read_exact(&mut bytes));
        read.map_err(|error| self.failed("read", page.offset, page.bytes, &error))?;
        if crc32c::crc32c(&bytes) != page.crc {
            return Err(self.damaged(page));
        }
        Ok(bytes)
    }

    /// The error for a page with invalid content.
    pub(super) fn damaged(&self, page: &Page) -> PageError {
        PageError::Damaged { folder: self.folder.clone(), offset: page.offset, bytes: page.bytes }
    }

    fn failed(
        &self,
        action: &'static str,
        offset: u64,
        bytes: usize,
        error: &io::Error,
    ) -> PageError {
        let (folder, message) = (self.folder.clone(), error.to_string());
        PageError::File { folder, action, offset, bytes, message }
    }

    /// Frees the room of a page.
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

/// A disk with `room` bytes, for tests.
#[cfg(test)]
#[derive(Debug)]
struct Disk {
    file: File,
    room: u64,
}

#[cfg(test)]
impl Storage for Disk {}

#[cfg(test)]
impl Read for Disk {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.file.read(bytes)
    }
}

#[cfg(test)]
impl Seek for Disk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

#[cfg(test)]
impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // Like a file system: as many bytes as fit are written, and the next byte is refused.
        let left = self.room.saturating_sub(self.file.stream_position()?);
        let taken = usize::try_from(left).map_or(bytes.len(), |left| left.min(bytes.len()));
        if taken == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.file.write(&bytes[..taken])
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

#[cfg(test)]
impl PageFile {
    /// As [`PageFile::new`], on a disk with `room` bytes.
    pub(super) fn on_disk_of(room: u64, folder: &Path) -> Self {
        let file = tempfile::tempfile_in(folder).unwrap();
        Self::over(Box::new(Disk { file, room }), folder)
    }
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
        let refused = file.read(&pages[1]).unwrap_err().to_string();
        assert!(refused.ends_with(": 50 bytes at byte 100 are damaged"), "{refused}");
    }

    #[test]
    fn a_page_that_is_cut_off_is_refused() {
        let file = tempfile::tempfile().unwrap();
        let mut pages = PageFile::over(Box::new(file.try_clone().unwrap()), Path::new("here"));
        let page = pages.put(&[7; 100]).unwrap();
        file.set_len(60).unwrap();
        let refused = pages.read(&page).unwrap_err().to_string();
        let expected = "the page file in here: cannot read 100 bytes at byte 0: ";
        assert!(refused.starts_with(expected), "{refused}");
    }

    #[test]
    fn a_full_disk_refuses_a_page_and_keeps_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let mut pages = PageFile::on_disk_of(150, folder.path());
        let first = pages.put(&[1; 100]).unwrap();
        let refused = pages.put(&[2; 100]).unwrap_err().to_string();
        let path = folder.path().display();
        let expected = format!("the page file in {path}: cannot write 100 bytes at byte 100: ");
        assert!(refused.starts_with(&expected), "{refused}");
        assert_eq!(pages.bytes(), 100);
        // Smaller pages still fit, and so does a page in the room of a freed one.
        let small = pages.put(&[3; 50]).unwrap();
        assert!(pages.put(&[4; 1]).is_err());
        assert_eq!(pages.read(&first).unwrap(), [1; 100]);
        pages.free(&first);
        let again = pages.put(&[5; 100]).unwrap();
        assert_eq!(pages.read(&again).unwrap(), [5; 100]);
        assert_eq!(pages.read(&small).unwrap(), [3; 50]);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_device_that_is_full_is_told_by_the_systems_own_words() {
        let full = File::options().read(true).write(true).open("/dev/full").unwrap();
        let mut pages = PageFile::over(Box::new(full), Path::new("/dev"));
        let refused = pages.put(&[1; 10]).unwrap_err().to_string();
        assert!(refused.contains("No space left on device"), "{refused}");
        assert_eq!(pages.bytes(), 0);
    }
}
