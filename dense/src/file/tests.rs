//! Volume files: identical to the bit when read, and refused with a reason when damaged.

use super::super::testing::{CENTIMETER, noise, sphere, volume};
use super::fuzzing::{bytes_of, decode, in_memory, resealed};
use super::*;

/// A file with changed content and matching checksums.
fn changed(bytes: &[u8], change: impl Fn(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    change(&mut bytes);
    resealed(&bytes)
}

/// A little volume whose file is small: a ball, noise, and a block of nothing.
fn small() -> Volume {
    let ball = |p| Some((sphere(p, [0.04; 3], 0.03), 3.0, [10, 20, 30]));
    let mut small = volume(CENTIMETER, [0; 3], [0; 3], ball);
    small.insert(BlockKey { x: i32::MIN, y: -1, z: i32::MAX }, Block::EMPTY);
    small
}

fn assert_same(a: &Volume, b: &Volume) {
    assert_eq!((a.options(), a.keys()), (b.options(), b.keys()));
    assert!(a.blocks().iter().eq(b.blocks().iter()), "the voxels differ");
}

#[test]
fn what_is_read_is_what_was_written() {
    // More than one chunk, with every kind of difference between voxels.
    let ball = |p| Some((sphere(p, [0.0; 3], 0.2), 3.0, [10, 20, 30]));
    let mut full = volume(CENTIMETER, [-3; 3], [3; 3], ball);
    let mut wild = Block::EMPTY;
    for k in 0..512 {
        wild.distances[k] = [i16::MIN, i16::MAX, 0, noise(k) as i16][k % 4];
        wild.weights[k] = [u16::MAX, 0, noise(k) as u16][k % 3];
        wild.colors[k] = (noise(k + 7) as u32).to_le_bytes();
    }
    full.insert(BlockKey { x: 9, y: -9, z: i32::MAX }, wild);
    assert!(full.len() > BLOCKS_A_CHUNK);
    for volume in [full, small(), Volume::new(CENTIMETER)] {
        let bytes = bytes_of(volume.clone());
        assert_same(decode(&bytes).unwrap().resident(), &volume);
        assert_eq!(bytes_of(decode(&bytes).unwrap()), bytes);
    }
}

#[test]
fn a_file_replaces_the_one_before_and_leaves_nothing_beside() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.covis");
    save(&mut PagedVolume::new(CENTIMETER), &path).unwrap();
    save(&mut small().into(), &path).unwrap();
    assert_same(load(&path, None).unwrap().resident(), &small());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    let elsewhere = folder.path().join("no").join("volume.covis");
    let refused = save(&mut small().into(), &elsewhere).unwrap_err();
    assert!(refused.to_string().starts_with("cannot create "), "{refused}");
    assert!(load(&elsewhere, None).unwrap_err().to_string().starts_with("cannot read "));
}

#[test]
fn a_file_that_is_cut_short_is_refused_at_every_length() {
    let bytes = bytes_of(small());
    for length in 0..bytes.len() {
        let refused = decode(&bytes[..length]).map(|_| ()).unwrap_err();
        let VolumeFileError::CutShort { length: told, offset, end } = refused else {
            panic!("{length} bytes: {refused}");
        };
        assert!(told == length as u64 && offset <= told && told < end, "{refused}");
    }
    let longer = [&bytes[..], &[0]].concat();
    let offset = bytes.len() as u64;
    assert_eq!(decode(&longer).map(|_| ()), Err(VolumeFileError::Trailing { offset }));
}

#[test]
fn a_file_with_any_bit_flipped_is_refused() {
    let bytes = bytes_of(small());
    for at in 0..bytes.len() {
        for bit in [0, 3, 7] {
            let mut flipped = bytes.clone();
            flipped[at] ^= 1 << bit;
            assert!(decode(&flipped).is_err(), "bit {bit} of byte {at}");
        }
    }
    let mut flipped = bytes.clone();
    flipped[HEADER + 40] ^= 1;
    let refused = decode(&flipped).map(|_| ()).unwrap_err();
    assert_eq!(refused.to_string(), "chunk 0, at byte 36, is damaged");
}

#[test]
fn chunks_that_changed_places_are_refused() {
    let full = volume(CENTIMETER, [0; 3], [7; 3], |_| None);
    let bytes = bytes_of(full.clone());
    let chunks = in_memory(&bytes).find_chunks(full.len()).unwrap();
    let [a, b] = &chunks[..] else { panic!("two chunks") };
    let [a, b] = [a, b].map(|chunk| &bytes[chunk.start as usize..chunk.end as usize]);
    let swapped = [&bytes[..HEADER], b, a].concat();
    let refused = decode(&swapped).map(|_| ());
    let (offset, what) = (HEADER as u64, "is damaged");
    assert_eq!(refused, Err(VolumeFileError::Chunk { chunk: 0, offset, what }));
}

#[test]
fn numbers_that_lie_are_refused_although_checksums_fit() {
    let bytes = bytes_of(small());
    let told = |change: &dyn Fn(&mut Vec<u8>)| {
        decode(&changed(&bytes, change)).map(|_| ()).unwrap_err().to_string()
    };
    assert_eq!(told(&|b| b[0] = b'k'), "this is not a volume: it does not begin with \"covisvol\"");
    let version = told(&|b| b[8] = 2);
    assert_eq!(version, "the volume has version 2, and this covis reads version 1 only");
    assert_eq!(
        told(&|b| b[12..16].copy_from_slice(&f32::NAN.to_le_bytes())),
        "the volume's voxel size is NaN"
    );
    assert_eq!(told(&|b| b[16..20].fill(0)), "the volume's truncation is 0");
    // No memory is allocated for these.
    for blocks in [4, 1 << 20, u64::MAX] {
        let cut = told(&|b| b[24..32].copy_from_slice(&blocks.to_le_bytes()));
        assert!(cut.starts_with("the volume is truncated"), "{cut}");
    }
    let one = told(&|b| b[24..32].copy_from_slice(&1_u64.to_le_bytes()));
    assert_eq!(one, "chunk 0, at byte 36, is not a zstd frame of its blocks' size");
    let frame = told(&|b| b[HEADER + CHUNK_HEAD] ^= 0x55);
    assert_eq!(frame, "chunk 0, at byte 36, is not a zstd frame of its blocks' size");
    let twice = volume(CENTIMETER, [0; 3], [0; 3], |_| None);
    let mut header = bytes_of(twice.clone())[..HEADER].to_vec();
    header[24] = 2;
    let block = (twice.keys()[0], twice.blocks()[0].clone());
    let frame = pack(&[(block.0, &block.1); 2]).unwrap();
    let mut doubled = [&header[..], &(frame.len() as u32).to_le_bytes(), &[0; 4], &frame].concat();
    doubled.resize(HEADER + CHUNK_HEAD + 256, 0);
    let refused = decode(&resealed(&doubled)).map(|_| ()).unwrap_err().to_string();
    assert_eq!(refused, "chunk 0, at byte 36, has a block that was there already");
}

#[test]
fn blocks_of_nothing_take_no_more_than_their_room() {
    let full = volume(CENTIMETER, [0; 3], [7; 3], |_| None);
    let expected = HEADER + 2 * CHUNK_HEAD + BYTES_A_BLOCK * full.len();
    assert_eq!(bytes_of(full.clone()).len(), expected);
}
