//! What a client may send to make a query long: equal descriptors, zeros, the largest that are taken, and
//! neighbors of one descriptor that fill every bucket that a query looks into.

use std::time::Instant;

use super::*;
use crate::place::descriptor_index::MOST_NEAR;

/// 64 bytes that a seed decides.
fn long(seed: u64) -> Vec<u8> {
    [descriptor(2 * seed), descriptor(2 * seed + 1)].concat()
}

/// Keyframes of as many bytes as are taken; how long a query for one of them takes is shown.
#[allow(clippy::print_stdout, reason = "a test shows what it measured")]
fn full(name: &str, described: impl Fn(u64) -> Vec<u8>) -> Vec<Candidate> {
    let mut index = filled(0..10);
    let count = KEYFRAME_BYTES / described(0).len();
    let keyframe = |number: u64| -> Vec<Vec<u8>> {
        (0..count as u64).map(|k| described(number * count as u64 + k)).collect()
    };
    for number in 0..3 {
        index.add(id(1, number as i64), number as i64, &orb(&keyframe(number))).unwrap();
    }
    let (query, begin) = (keyframe(1), Instant::now());
    let answer = index.query(&orb(&query), None, 3, |_| false).unwrap();
    println!("{name}: {count} descriptors, {:.3} s", begin.elapsed().as_secs_f64());
    let found = index.query(&orb(&place(4)), None, 1, |_| false).unwrap();
    assert_eq!(found[0].keyframe, id(0, 4), "{name}");
    let more = [query, keyframe(2)].concat();
    let refused = index.query(&orb(&more[..count + 1]), None, 3, |_| false).unwrap_err();
    assert!(matches!(refused, PlaceError::Bytes(_) | PlaceError::Descriptors { .. }), "{refused}");
    answer
}

#[test]
fn the_largest_keyframes_are_compared() {
    for (name, bytes) in [("64 bytes", 64), ("512 bytes", 512)] {
        let repeated = |seed: u64| long(seed).repeat(bytes / 64);
        let answer = full(name, repeated);
        assert_eq!(answer[0].keyframe, id(1, 1), "{name}");
        assert_eq!(answer[0].matches.len(), KEYFRAME_BYTES / bytes, "{name}");
    }
}

#[test]
fn keyframes_full_of_one_descriptor_match_nothing() {
    for (name, byte) in [("zeros", 0), ("ones", 255)] {
        for bytes in [64, 512] {
            let answer = full(&format!("{name}, {bytes} bytes"), |_| vec![byte; bytes]);
            assert!(answer.is_empty(), "{answer:?}");
        }
    }
}

#[test]
fn a_keyframe_with_many_descriptor_types_is_as_large_as_with_one() {
    let mut index = PlaceIndex::default();
    // 16 types with 4096 descriptors each, of 512 bytes and less: 30 MB.
    let data: Vec<Vec<u8>> = (0..16).map(|shorter| vec![1; 512 - shorter]).collect();
    let worst: Vec<Feature<'_>> = data
        .iter()
        .flat_map(|data| std::iter::repeat_n(Feature { name: "orb", data }, DESCRIPTORS))
        .collect();
    assert_eq!(worst.len(), 65_536);
    let bytes = worst.iter().map(|feature| feature.data.len()).sum();
    assert_eq!(index.add(id(0, 1), 0, &worst), Err(PlaceError::Bytes(bytes)));
    assert_eq!(index.query(&worst, None, 3, |_| false), Err(PlaceError::Bytes(bytes)));
    assert_eq!(index.bytes(), PlaceIndex::default().bytes());
}

#[test]
fn neighbors_of_one_descriptor_do_not_make_its_search_long() {
    let mut index = DescriptorIndex::new(32);
    let of_size = DescriptorIndex::new(32);
    let words = |data: &[u8]| of_size.pack(std::iter::once(data));
    let target = descriptor(7);
    // The bits 4k and 4k + 1 of a quarter are keys: one of them differs, or none.
    let mut flood = Vec::new();
    for bit in 0..64 {
        for copy in 0..256_u64 {
            let mut data = target.clone();
            let at = 8 * (bit / 2) + 2 * (bit % 2);
            data[at / 8] ^= 1 << (at % 8);
            // Bits that are in no key and few fingerprints keep them apart.
            data[31] ^= (copy as u8) & 0x80;
            flood.extend(words(&data));
        }
    }
    for (number, part) in flood.chunks(4 * 512).enumerate() {
        let numbers = (0..part.len() as u16 / 4).collect();
        index.add(id(0, number as i64), number as i64, part.into(), numbers);
    }
    let query: Vec<u64> = words(&target).repeat(1024);
    let mut voted = 0;
    let compared = index.hits(&query, VOTERS, |_| false, |_, _| voted += 1);
    assert!(compared <= 1024 * MOST_NEAR, "{compared}");
    assert_eq!((voted, compared), (0, 0), "each has more neighbors than count");
    // A descriptor beside them votes.
    let other = words(&descriptor(8));
    index.add(id(1, 0), 0, other.clone(), Box::new([0]));
    let compared = index.hits(&other, VOTERS, |_| false, |_, hits| voted += hits.len());
    assert!(voted == 1 && (1..MOST_NEAR).contains(&compared), "{voted}, {compared}");
}
