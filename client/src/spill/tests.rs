//! The spill file: what outlives a session, what a damaged file still gives, and a disk that is full.

use std::path::Path;

use super::*;

fn item(sequence: i64) -> v1::IngestRequest {
    v1::IngestRequest { sequence, item: Some(v1::Camera::default().into()) }
}

fn open(directory: &Path, uid: &str) -> Result<(Spill, Option<LeftOver>), ClientError> {
    let options = SpillOptions { directory: directory.to_owned(), max_bytes: 1 << 20 };
    Spill::open(&options, "room", "robot", uid)
}

/// Writes items and returns the file's path.
fn written(directory: &Path, sequences: &[i64]) -> PathBuf {
    let (mut spill, _) = open(directory, "uid").unwrap();
    for &sequence in sequences {
        assert!(spill.append(&item(sequence)));
    }
    spill.path.clone()
}

fn rest(spill: &mut Spill) -> Vec<i64> {
    let mut sequences = Vec::new();
    while spill.has_unread() {
        let request = spill.next().unwrap();
        assert_eq!(request, item(request.sequence));
        sequences.push(request.sequence);
    }
    sequences
}

#[test]
fn items_outlive_the_session_and_an_empty_file_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), &[3, 5, 9]);
    let (mut spill, left) = open(folder.path(), "uid").unwrap();
    let left = left.unwrap();
    assert_eq!((left.items, left.last_sequence, left.damage), (3, 9, None));
    let held = open(folder.path(), "uid").unwrap_err();
    assert!(matches!(held, ClientError::SpillInUse { .. }), "{held}");
    assert_eq!(spill.next().unwrap().sequence, 3);
    assert!(spill.append(&item(11)));
    assert_eq!(rest(&mut spill), [5, 9, 11]);
    spill.clear();
    assert!(!spill.is_used() && path.exists());
    drop(spill);
    assert!(!path.exists());
    assert!(open(folder.path(), "other").unwrap().1.is_none());
}

#[test]
fn the_file_of_another_map_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), &[1]);
    let before = fs::read(&path).unwrap();
    let error = open(folder.path(), "other").unwrap_err();
    assert!(matches!(error, ClientError::SpillOfAnotherMap { .. }), "{error}");
    let text = error.to_string();
    for part in ["room.robot.spill", "uid", "other"] {
        assert!(text.contains(part), "{text}");
    }
    assert_eq!(fs::read(&path).unwrap(), before);
}

#[test]
fn every_cut_and_every_flipped_bit_leaves_a_beginning_of_what_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), &[1, 2, 3]);
    let whole = fs::read(&path).unwrap();
    let check = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let (mut spill, left) = match open(folder.path(), "uid") {
            Ok(opened) => opened,
            Err(error) => panic!("{error}"),
        };
        let items = rest(&mut spill);
        assert!([1, 2, 3].starts_with(&items), "{items:?}");
        // What is no item was kept.
        if let Some(SpillDamage { offset, bytes: lost, moved_to }) =
            left.and_then(|left| left.damage)
        {
            assert_eq!(offset + lost, bytes.len() as u64);
            assert_eq!(fs::read(&moved_to).unwrap(), bytes[offset as usize..]);
            fs::remove_file(moved_to).unwrap();
        } else {
            assert!(items.is_empty() || bytes.len() as u64 == spill.length);
        }
        // It goes on from there.
        assert!(spill.append(&item(7)));
        assert_eq!(rest(&mut spill), [7]);
        items.len()
    };
    assert_eq!(check(&whole), 3);
    for cut in 0..whole.len() {
        assert!(check(&whole[..cut]) < 3);
    }
    for index in 0..whole.len() {
        let mut flipped = whole.clone();
        flipped[index] ^= 0x10;
        assert!(check(&flipped) < 3, "byte {index}");
    }
}

#[test]
fn a_name_never_leaves_the_folder() {
    assert_eq!(file_name("../../etc", "a/b\\c"), "______etc.a_b_c.spill");
}

/// A file in memory on a disk of so many bytes.
struct Small {
    bytes: io::Cursor<Vec<u8>>,
    room: u64,
}

impl Read for Small {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.bytes.read(buffer)
    }
}

impl Write for Small {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let left = usize::try_from(self.room.saturating_sub(self.bytes.position())).unwrap();
        let count = buffer.len().min(left);
        if count == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.bytes.write(&buffer[..count])
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Small {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.bytes.seek(position)
    }
}

impl Medium for Small {
    fn set_len(&mut self, length: u64) -> io::Result<()> {
        self.bytes.get_mut().truncate(usize::try_from(length).unwrap());
        Ok(())
    }
}

/// A file on a disk that is full after `room` bytes.
pub(crate) fn on_small_disk(room: u64) -> Spill {
    let medium = Box::new(Small { bytes: io::Cursor::default(), room });
    Spill::over(medium, PathBuf::from("on a small disk"), u64::MAX, "uid")
}

#[test]
fn a_write_that_fails_midway_leaves_what_was_there() {
    let mut spill = on_small_disk(100);
    let mut taken = Vec::new();
    for sequence in 1..100 {
        if spill.append(&item(sequence)) {
            taken.push(sequence);
        }
    }
    assert!((1..50).contains(&taken.len()), "{taken:?}");
    assert!(spill.is_failing);
    assert_eq!(rest(&mut spill), taken);
    spill.clear();
    assert!(spill.append(&item(100)) && !spill.is_failing);
}
