//! The index follows the maps of its searches, takes no more memory than a map counts, and goes where
//! what it holds has gone.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3};
use nalgebra::Vector2;

use super::*;
use crate::map::{
    CameraEntity, Change, ClientIndex, Descriptor, DescriptorKind, Event, INDEXED_KEYFRAME,
    MapPolicy, NewLandmark, Observation,
};

type Described<'a> = (&'a str, Vec<u8>);

fn id(id: i64) -> EntityId {
    EntityId::new(ClientIndex(0), id)
}

fn apply(map: &mut Map, change: Change) {
    let event = Event { revision: map.revision() + 1, time_ns: 0, cause: None, change };
    map.apply(&event).unwrap();
}

fn empty() -> Map {
    let mut map = Map::new();
    let (policy, display_name) = (MapPolicy::default(), String::new());
    apply(&mut map, Change::Created { policy, create_time_ns: 1, display_name });
    apply(&mut map, Change::ClientOpened { name: "robot".to_owned(), epoch: 1 });
    let model = PinholeRadialTangential::undistorted(500.0, 500.0, 320.0, 240.0);
    let camera = CameraEntity { camera: Camera::Pinhole(model), width_px: 640, height_px: 480 };
    apply(&mut map, Change::CameraSet { id: id(0), camera });
    map
}

/// Adds a keyframe that sees landmarks of its own.
fn add(map: &mut Map, keyframe: i64, described: &[Described<'_>]) {
    let landmark = |k: usize| id(keyframe * 10_000 + k as i64);
    let seen = |(k, (name, data)): (usize, &Described<'_>)| Observation {
        landmark: landmark(k),
        pixel: Vector2::new(k as f64, 0.5),
        sigma_px: 1.0,
        depth: None,
        descriptor: Some(Arc::new(Descriptor {
            kind: DescriptorKind::Binary,
            name: (*name).to_owned(),
            data: data.clone(),
        })),
    };
    let landmarks = 0..described.len();
    let change = Change::KeyframeAdded {
        id: id(keyframe),
        capture_time_ns: keyframe,
        camera: Some(id(0)),
        world_from_camera: Se3::identity(),
        odom_from_camera: Se3::identity(),
        observations: described.iter().enumerate().map(seen).collect(),
        landmarks: landmarks.map(|k| NewLandmark { id: landmark(k), position: None }).collect(),
        motion: None,
        global_descriptor: None,
    };
    apply(map, change);
}

/// Bytes that a seed decides.
fn bytes(seed: u64, count: usize) -> Vec<u8> {
    let word = |k: u64| {
        let mut z = (seed * 64 + k + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    (0..).flat_map(|k| word(k).to_le_bytes()).take(count).collect()
}

/// The descriptors of a place.
fn place(number: u64) -> Vec<Described<'static>> {
    (0..40).map(|k| ("orb", bytes(100 * number + k, 32))).collect()
}

/// The candidates for what a keyframe sees.
fn candidates(places: &Places, map: &Map, keyframe: i64, interrupt: &Interrupt) -> Vec<i64> {
    let view = QueryView::of_keyframe(map, map.keyframes().get(&id(keyframe)).unwrap()).unwrap();
    let found = places.candidates(map, &view, interrupt, &|_| false).unwrap();
    found.iter().map(|candidate| candidate.keyframe.id).collect()
}

#[test]
fn what_comes_while_the_first_search_waits_is_found_later() {
    let places = Places::default();
    let mut map = empty();
    add(&mut map, 1, &place(1));
    let at_first = map.clone();
    // The map goes on before the index is made of the first search's map.
    add(&mut map, 2, &place(2));
    assert_eq!(candidates(&places, &at_first, 1, &Interrupt::default()), [1]);
    assert_eq!(candidates(&places, &map, 2, &Interrupt::default()), [2]);
    // Whoever still has the first map finds what is in that one.
    apply(&mut map, Change::KeyframeRemoved { keyframe: id(1) });
    add(&mut map, 3, &place(1));
    assert_eq!(candidates(&places, &map, 3, &Interrupt::default()), [3]);
    assert!(candidates(&places, &at_first, 1, &Interrupt::default()).is_empty());
}

#[test]
fn an_index_that_is_cut_off_is_finished_by_the_next_search() {
    let places = Places::default();
    let mut map = empty();
    (1..5).for_each(|number| add(&mut map, number, &place(number as u64)));
    let due = Interrupt::at(None).or_when(Arc::new(AtomicBool::new(true)));
    assert!(candidates(&places, &map, 4, &due).is_empty());
    assert_eq!(candidates(&places, &map, 4, &Interrupt::default()), [4]);
    assert_eq!(candidates(&places, &map, 1, &Interrupt::default()), [1]);
}

#[test]
fn an_index_that_lacks_much_is_made_in_pieces() {
    let mut map = empty();
    // Eight of these are a piece.
    let large = PIECE as u64 / 8;
    for number in 0..12 {
        let first = 10_000 * (number + 1);
        let seen: Vec<_> = (first..first + large).map(|k| ("orb", bytes(k, 16))).collect();
        add(&mut map, number as i64, &seen);
    }
    let (places, never) = (Places::default(), Interrupt::default());
    let indexed = || places.read().indexed.len();
    assert!(!places.advance(&map, &never) && indexed() == 8);
    // What comes meanwhile waits for its turn.
    add(&mut map, 12, &place(3));
    let due = Interrupt::at(None).or_when(Arc::new(AtomicBool::new(true)));
    assert!(places.advance(&map, &due) && indexed() == 8);
    assert!(places.advance(&map, &never) && indexed() == 13);
    assert!(places.advance(&map, &never));
    assert_eq!(candidates(&places, &map, 12, &never), [12]);
    // So does what leaves.
    for number in 0..12 {
        apply(&mut map, Change::KeyframeRemoved { keyframe: id(number) });
    }
    assert!(!places.advance(&map, &never) && indexed() == 5);
    while !places.advance(&map, &never) {}
    assert_eq!(candidates(&places, &map, 12, &never), [12]);
}

/// The memory of the index of a map with these keyframes, and what the map counts for it.
fn memory(keyframes: &[Vec<Described<'_>>]) -> (u64, u64) {
    let places = Places::default();
    let mut map = empty();
    let mut plain = empty();
    for (described, k) in keyframes.iter().zip(0..) {
        add(&mut map, k, described);
        let float = |o: &Observation| {
            let descriptor = o.descriptor.as_deref().cloned();
            let kind = DescriptorKind::Float32;
            let descriptor = descriptor.map(|known| Arc::new(Descriptor { kind, ..known }));
            Observation { descriptor, ..o.clone() }
        };
        // The same keyframe with descriptors that are not indexed.
        let known = map.keyframes().get(&id(k)).unwrap();
        let landmarks = known.observations.iter();
        let landmarks = landmarks.map(|o| NewLandmark { id: o.landmark, position: None }).collect();
        let change = Change::KeyframeAdded {
            id: id(k),
            capture_time_ns: k,
            camera: Some(id(0)),
            world_from_camera: Se3::identity(),
            odom_from_camera: Se3::identity(),
            observations: known.observations.iter().map(float).collect(),
            landmarks,
            motion: None,
            global_descriptor: None,
        };
        apply(&mut plain, change);
    }
    candidates(&places, &map, 0, &Interrupt::default());
    let of_keyframes = INDEXED_KEYFRAME * keyframes.len() as u64;
    let counted = map.usage().bytes - plain.usage().bytes + of_keyframes;
    (places.bytes.load(Ordering::Relaxed), counted)
}

#[test]
fn the_index_takes_no_more_memory_than_the_map_counts() {
    let usual = |k: u64| (0..500).map(|n| ("orb", bytes(500 * k + n, 32))).collect();
    let one = |k: u64| vec![("orb", bytes(k, 32))];
    // Whole words in the index.
    let odd = |k: u64| (0..300).map(|n| ("odd", bytes(500 * k + n, 17))).collect();
    // A few bits of all are 0: their buckets are full, and others are empty.
    let alike = |k: u64| {
        let zeros = |n| bytes(500 * k + n, 32).iter().map(|byte| byte & 0xf0).collect();
        (0..500).map(|n| ("orb", zeros(n))).collect()
    };
    let equal = |_| vec![("orb", vec![0; 32]); 500];
    let cases: [(&str, Vec<Vec<Described<'_>>>); 5] = [
        ("usual", (0..40).map(usual).collect()),
        ("one", (0..2000).map(one).collect()),
        ("odd", (0..40).map(odd).collect()),
        ("alike", (0..40).map(alike).collect()),
        ("equal", (0..40).map(equal).collect()),
    ];
    for (name, keyframes) in cases {
        let (taken, counted) = memory(&keyframes);
        println!("{name}: {taken} of {counted} bytes");
        assert!(taken <= counted, "{name}: {taken} of {counted} bytes");
    }
    // An index of many makes is small as long as they are.
    let (taken, _) = memory(&[(0..16).map(|n| (NAMES[n], bytes(n as u64, 16))).collect()]);
    assert!(taken < 64 << 10, "{taken} bytes");
}

const NAMES: [&str; 16] =
    ["a", "b", "c", "d", "e", "f", "g", "h", "i", "j", "k", "l", "m", "n", "o", "p"];

#[test]
fn an_index_of_what_has_left_the_map_is_given_back() {
    let places = Places::default();
    let mut map = empty();
    let large = |k: u64| (0..2000).map(|n| ("orb", bytes(2000 * k + n, 64))).collect::<Vec<_>>();
    (0..20).for_each(|k| add(&mut map, k, &large(k as u64)));
    candidates(&places, &map, 0, &Interrupt::default());
    assert!(places.take_excess(&map).is_none());
    for k in 1..20 {
        apply(&mut map, Change::KeyframeRemoved { keyframe: id(k) });
    }
    assert!(places.take_excess(&map).is_some());
    assert!(places.take_excess(&map).is_none(), "it is given back once");
    assert_eq!(candidates(&places, &map, 0, &Interrupt::default()), [0]);
    // Nothing is searched where the policy has it off.
    let policy = MapPolicy { place_recognition: false, ..MapPolicy::default() };
    let off = Change::MapUpdated { display_name: None, policy: Some(policy), frozen: None };
    apply(&mut map, off);
    assert!(places.take_excess(&map).is_some());
}
