//! Sealed files as streams: any cut into pieces reads the same, and a disk that fails is not damage.

use std::io::{self, Read};

use super::script::fold;
use crate::files::sealed::{
    Kind, SealError, check_snapshot, compare_snapshot, read_identity, read_snapshot, sealed,
    sealed_map,
};

/// Reads a file in pieces of some bytes; fails at its end if requested.
struct Pieces<'a> {
    bytes: &'a [u8],
    piece: usize,
    fails: bool,
}

impl Read for Pieces<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.bytes.is_empty() && self.fails {
            return Err(io::Error::other("the disk is gone"));
        }
        let count = out.len().min(self.piece);
        self.bytes.read(&mut out[..count])
    }
}

#[test]
fn a_snapshot_reads_the_same_in_pieces_of_any_size() {
    let map = fold(20, 1);
    let bytes = sealed_map(&[7; 16], &map);
    for piece in [1, 3, 4, 5, 47, 48, 53, 1 << 20] {
        let pieces = || Pieces { bytes: &bytes, piece, fails: false };
        let label = check_snapshot(&mut pieces()).unwrap();
        assert_eq!((label.uid, label.sequence), ([7; 16], 20));
        let read = read_snapshot(&mut pieces()).unwrap();
        assert_eq!(read.state_hash(), map.state_hash());
        compare_snapshot(&mut pieces(), &map).unwrap();
        assert!(compare_snapshot(&mut pieces(), &fold(19, 1)).is_err());
    }
}

#[test]
fn a_disk_that_fails_while_a_file_is_read_is_not_taken_for_damage() {
    let map = fold(20, 1);
    let bytes = sealed_map(&[7; 16], &map);
    for end in 0..bytes.len() {
        let file = |fails| Pieces { bytes: &bytes[..end], piece: 100, fails };
        let failed = [
            read_snapshot(&mut file(true)).map(|_map| ()),
            compare_snapshot(&mut file(true), &map),
            check_snapshot(&mut file(true)).map(|_label| ()),
        ];
        let told = failed.iter().all(|result| matches!(result, Err(SealError::Disk(_))));
        assert!(told, "{end}: {failed:?}");
        let cut = read_snapshot(&mut file(false));
        assert!(matches!(cut, Err(SealError::Damaged(_))), "{end}: {cut:?}");
    }
}

#[test]
fn damage_of_the_file_is_told_before_what_it_makes_of_the_body() {
    let mut bytes = sealed_map(&[7; 16], &fold(20, 1));
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    let told = read_snapshot(&mut &*bytes).unwrap_err().to_string();
    assert_eq!(told, "the checksum does not fit");
    // A body that is no map, with a valid checksum.
    let told = read_snapshot(&mut &*sealed(Kind::Snapshot, &[7; 16], 20, b"no map")).unwrap_err();
    assert!(matches!(told, SealError::Damaged(_)));
    assert_ne!(told.to_string(), "the checksum does not fit");
    let told = read_snapshot(&mut &*sealed(Kind::Identity, &[7; 16], 20, b"")).unwrap_err();
    assert_eq!(told.to_string(), "it is not a file of this kind");
    let told = read_identity(&mut &b"covismap"[..]).unwrap_err().to_string();
    assert_eq!(told, "the file is too short");
}
