//! A map comes back from its file as it was; what is damaged, cut or too new is refused.

use std::path::Path;

use covis_solvers::geometry::{LieGroup, Se3};
use proptest::prelude::*;

use super::*;
use crate::encoding::tests::every_change;
use covis_map::{CameraEntity, ClientIndex, EntityId, MapParts};

fn map() -> Map {
    Map::replay(every_change().iter()).unwrap()
}

fn file(map: &Map, most: usize) -> Vec<u8> {
    let (mut writer, mut file) = (MapFileWriter::default(), Vec::new());
    loop {
        let mut piece = Vec::new();
        let has_more = writer.put(map, most, &mut piece);
        file.extend_from_slice(&piece);
        if !has_more {
            return file;
        }
    }
}

fn read(bytes: &[u8]) -> Result<Map, MapFileError> {
    read_map_file(&mut &bytes[..], &mut |_| true)
}

#[test]
fn a_map_comes_back_from_its_file_at_every_revision() {
    let mut map = Map::new();
    for event in every_change() {
        map.apply(&event).unwrap();
        let bytes = file(&map, 0);
        let decoded = read(&bytes).unwrap();
        assert_eq!(decoded, map, "after revision {}", event.revision);
        assert_eq!(decoded.state_hash(), map.state_hash());
        // The size of the pieces is not seen in the file.
        assert_eq!(file(&map, usize::MAX), bytes);
    }
}

/// Each version has a file under `tests/golden/map_file` with every kind of change of its time, and a
/// line with the state hash that its writer had. `COVIS_TEST_RECORD_GOLDEN=1` writes those of the present
/// version, which a version that grows needs.
#[test]
fn files_of_every_version_so_far_are_read_to_the_recorded_hash() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/map_file");
    let hex = |map: &Map| -> String {
        map.state_hash().iter().map(|byte| format!("{byte:02x}")).collect()
    };
    let path = golden.join("hashes.txt");
    let mut hashes = fs_err::read_to_string(&path).unwrap();
    if std::env::var_os("COVIS_TEST_RECORD_GOLDEN").is_some() {
        let earlier = hashes.lines().take(VERSION as usize - 1);
        hashes = earlier.map(|line| format!("{line}\n")).collect();
        hashes.push_str(&format!("{VERSION} {}\n", hex(&map())));
        fs_err::write(golden.join(format!("v{VERSION}.covis")), file(&map(), usize::MAX)).unwrap();
        fs_err::write(&path, &hashes).unwrap();
    }
    for (line, version) in hashes.lines().zip(1..) {
        let bytes = fs_err::read(golden.join(format!("v{version}.covis"))).unwrap();
        assert_eq!(format!("{version} {}", hex(&read(&bytes).unwrap())), line);
    }
    assert_eq!(hashes.lines().count(), VERSION as usize);
}

#[test]
fn a_reader_counts_what_it_has_and_can_stop() {
    let (map, mut last) = (map(), Usage::default());
    let bytes = file(&map, 1 << 20);
    read_map_file(&mut &bytes[..], &mut |usage| {
        last = usage;
        true
    })
    .unwrap();
    let held = map.usage();
    assert_eq!((last.keyframes, last.landmarks), (held.keyframes, held.landmarks));
    assert_eq!((last.observations, last.priors), (held.observations, held.priors));
    assert_eq!(last.bytes, bytes.len() as u64 - 8, "all but the end record");
    let stopped = read_map_file(&mut &bytes[..], &mut |usage| usage.keyframes == 0);
    assert_eq!(stopped, Err(MapFileError::Stopped));
}

#[test]
fn a_reader_can_stop_within_a_record() {
    let mut bytes = Vec::new();
    put_head(VERSION, NEEDS, &mut bytes);
    put_record(&vec![0; 8 << 20], &mut bytes);
    let mut rest = &bytes[..];
    let most = 2 << 20;
    let stopped = read_map_file(&mut rest, &mut |usage| usage.bytes <= most);
    assert_eq!(stopped, Err(MapFileError::Stopped));
    assert!((bytes.len() - rest.len()) as u64 <= most + PIECE, "no more is read");
}

#[test]
fn a_file_that_is_cut_or_goes_on_is_refused() {
    let mut bytes = file(&map(), 1 << 20);
    for cut in 0..bytes.len() {
        let told = read(&bytes[..cut]);
        let Err(MapFileError::Damaged { offset, .. }) = told else { panic!("{cut}: {told:?}") };
        assert!(offset <= cut as u64);
    }
    bytes.push(0);
    assert!(matches!(read(&bytes), Err(MapFileError::Damaged { .. })));
}

#[test]
fn each_changed_byte_is_told() {
    let bytes = file(&map(), 1 << 20);
    for at in 0..bytes.len() {
        let mut changed = bytes.clone();
        changed[at] ^= 0x10;
        assert!(read(&changed).is_err(), "byte {at} of {}", bytes.len());
    }
}

/// A file of another version, whose parts are changed by `change`.
fn rewritten(version: u32, needs: u32, mut change: impl FnMut(&mut Vec<u8>)) -> Vec<u8> {
    let mut out = Vec::new();
    put_head(version, needs, &mut out);
    let (map, mut parts) = (map(), Parts::default());
    while let Some(mut part) = parts.next(&map) {
        change(&mut part);
        put_record(&part, &mut out);
    }
    let crc = crc32c::crc32c(&out);
    put_end(crc, &mut out);
    out
}

#[test]
fn a_later_version_is_read_as_far_as_it_says_that_it_can_be() {
    // Field 60, a number: no version knows it yet.
    let unknown = |part: &mut Vec<u8>| part.extend_from_slice(&[0xe0, 0x03, 0x01]);
    let later = rewritten(VERSION + 1, VERSION, unknown);
    assert_eq!(read(&later).unwrap().state_hash(), map().state_hash());
    let needs = VERSION + 1;
    let told = read(&rewritten(needs, needs, unknown));
    assert_eq!(told, Err(MapFileError::Later { needs }));
    assert!(told.unwrap_err().to_string().contains(&format!("version {needs}")));
    // A file of this version has no such field.
    let own = read(&rewritten(VERSION, NEEDS, unknown));
    assert!(matches!(own, Err(MapFileError::Damaged { offset: 20, .. })), "{own:?}");
}

/// The file of a map that was put together without its checks.
fn unsound(change: impl FnOnce(&mut MapParts)) -> Result<Map, MapFileError> {
    let mut parts = map().to_parts();
    change(&mut parts);
    read(&file(&Map::from_parts(parts).unwrap(), 1 << 20))
}

#[test]
fn a_map_that_no_event_makes_is_refused() {
    assert!(unsound(|_| {}).is_ok());
    type Change = (&'static str, fn(&mut MapParts));
    let id = EntityId::new(ClientIndex(0), 10);
    assert!(map().keyframes().contains_key(&id));
    let changes: [Change; 15] = [
        ("a revision below 1", |p| p.revision = 0),
        ("a negative number of solves", |p| p.solve_count = -1),
        ("an epoch of 0", |p| p.clients[0].epoch = 0),
        ("a next sequence before the last", |p| p.clients[0].next_sequence = 1),
        ("a name twice", |p| p.clients.push(p.clients[0].clone())),
        ("a NaN in a pose", |p| {
            p.keyframes.values_mut().last().unwrap().world_from_camera.translation.x = f64::NAN;
        }),
        ("a keyframe of no client", |p| {
            let keyframe = p.keyframes.values_mut().last().unwrap().clone();
            p.keyframes.insert(EntityId::new(ClientIndex(9), 1), keyframe);
        }),
        ("more earlier frames than are kept", |p| {
            p.clients[0].earlier_frames = vec![Se3::identity(); 5];
        }),
        ("a keyframe of a later revision", |p| {
            p.keyframes.values_mut().last().unwrap().added_revision = i64::MAX;
        }),
        ("an observation twice", |p| {
            let keyframe = p.keyframes.get_mut(&EntityId::new(ClientIndex(0), 10)).unwrap();
            let twice = keyframe.observations.iter().chain(keyframe.observations.iter());
            keyframe.observations = twice.cloned().collect::<Vec<_>>().into();
        }),
        ("an observation without a sigma", |p| {
            let keyframe = p.keyframes.get_mut(&EntityId::new(ClientIndex(0), 10)).unwrap();
            let mut seen = keyframe.observations.to_vec();
            seen[0].sigma_px = 0.0;
            keyframe.observations = seen.into();
        }),
        ("a landmark at infinity", |p| {
            p.landmarks.values_mut().last().unwrap().position = Some([f64::INFINITY; 3].into());
        }),
        ("a camera without a focal length", |p| {
            let camera: &mut CameraEntity = p.cameras.values_mut().last().unwrap();
            let count = camera.camera.parameter_count();
            camera.camera.plus_parameters(&vec![-1e6; count]);
        }),
        ("a constraint from a keyframe to itself", |p| {
            let constraint = p.constraints.values_mut().last().unwrap();
            constraint.keyframe_j = constraint.keyframe_i;
        }),
        ("a digest of nothing", |p| {
            let (&(kind, id), &digest) = p.contents.last_key_value().unwrap();
            p.contents.insert((kind, EntityId::new(id.client, id.id + 77)), digest);
        }),
    ];
    for (what, change) in changes {
        let told = unsound(change);
        assert!(matches!(told, Err(MapFileError::Damaged { .. })), "{what}: {told:?}");
    }
}

proptest! {
    #[test]
    fn arbitrary_bytes_are_no_map(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(read(&bytes).is_err());
        let mut behind_a_head = Vec::new();
        put_head(VERSION, NEEDS, &mut behind_a_head);
        behind_a_head.extend_from_slice(&bytes);
        prop_assert!(read(&behind_a_head).is_err());
    }

    /// Checksums do not protect from somebody who makes them.
    #[test]
    fn parts_with_true_checksums_are_a_map_of_sound_numbers_or_refused(
        which in 0_usize..12,
        at in any::<prop::sample::Index>(),
        value in any::<u8>(),
    ) {
        let mut index = 0;
        let bytes = rewritten(VERSION + 1, VERSION, |part| {
            if index == which && !part.is_empty() {
                let at = at.index(part.len());
                part[at] = value;
            }
            index += 1;
        });
        if let Ok(map) = read(&bytes) {
            prop_assert_eq!(map.check_sound(), Ok(()));
        }
    }
}
