//! Seeds of the store: every kind of change, the golden journal and snapshot, a map's folder, files
//! of maps.
//! They come from real encodings. `COVIS_TEST_RECORD_CORPUS=1` writes them to the corpora.

use std::path::Path;

use crate::encoding::tests::every_change;
use crate::encoding::{encode_event, encode_identity, encode_map};
use crate::map_file::MapFileWriter;
use covis_map::Map;

type Named = Vec<(&'static str, Vec<u8>)>;

fn golden(file: &str) -> Vec<u8> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/journal/v1/data/maps");
    fs_err::read(root.join(file)).unwrap()
}

/// The changes of a journal as the targets take them: length, step, payload.
fn parts(changes: impl Iterator<Item = usize>) -> Vec<u8> {
    let events = every_change();
    let mut bytes = Vec::new();
    for index in changes {
        let mut payload = Vec::new();
        encode_event(&events[index], &mut payload);
        bytes.extend(u16::try_from(payload.len()).unwrap().to_le_bytes());
        bytes.push(1);
        bytes.append(&mut payload);
    }
    bytes
}

fn behind(head: &[u8], bytes: &[u8]) -> Vec<u8> {
    [head, bytes].concat()
}

/// Of the target `journal`.
fn journal() -> Named {
    let count = every_change().len();
    let walk = golden("06876deb53d64c463d82056bfd4fe1ee/00000000000000000001.log");
    let mut gap = parts(0..6);
    gap.extend([1, 0, 255, 9, 1, 0, 1, 9]);
    vec![
        ("every-change", behind(&[1], &parts(0..count))),
        ("map-with-a-keyframe", behind(&[1], &parts(0..6))),
        ("constraints", behind(&[1], &parts((0..6).chain([7, 9, 10, 11, 12, 13, 15, 16])))),
        ("removals", behind(&[1], &parts((0..8).chain(18..count)))),
        ("last-sequence", behind(&[1], &gap)),
        ("golden", behind(&[0], &walk)),
        ("golden-torn", behind(&[0], &walk[..walk.len() - 9])),
        ("golden-hole", {
            let mut torn = behind(&[0], &walk);
            torn[400..440].fill(0);
            torn
        }),
    ]
}

/// Of the target `snapshot`.
fn snapshot() -> Named {
    let map = |count: usize| {
        let mut bytes = Vec::new();
        encode_map(&Map::replay(every_change()[..count].iter()).unwrap(), &mut bytes).unwrap();
        bytes
    };
    let compressed = zstd::encode_all(&map(8)[..], 3).unwrap();
    let file = golden("06876deb53d64c463d82056bfd4fe1ee/00000000000000000012.snap");
    vec![
        ("golden", behind(&[0], &file)),
        ("golden-cut", behind(&[0], &file[..600])),
        ("compressed-body", behind(&[1], &compressed)),
        ("one-event", behind(&[2], &map(1))),
        ("keyframes", behind(&[2], &map(8))),
        ("every-change", behind(&[2], &map(every_change().len()))),
        ("identity", behind(&[3], &encode_identity("house"))),
    ]
}

/// Of the target `map_file`.
fn map_file() -> Named {
    let map = |count: usize| Map::replay(every_change()[..count].iter()).unwrap();
    let parts = |count: usize| {
        let mut bytes = Vec::new();
        encode_map(&map(count), &mut bytes).unwrap();
        bytes
    };
    let mut file = Vec::new();
    let whole = map(every_change().len());
    assert!(!MapFileWriter::default().put(&whole, usize::MAX, &mut file));
    vec![
        ("file", behind(&[0], &file)),
        ("file-cut", behind(&[0], &file[..file.len() / 2])),
        ("file-that-goes-on", behind(&[0], &[&file[..], &file].concat())),
        ("one-event", behind(&[1], &parts(1))),
        ("keyframes", behind(&[1], &parts(8))),
        ("every-change", behind(&[1], &parts(every_change().len()))),
    ]
}

/// Of the target `journal_folder`: flags, second file, snapshot, mark, two cuts.
fn journal_folder() -> Named {
    let folder = |[flags, second, snapshot, mark]: [u8; 4], pieces: [&[u8]; 3]| {
        let cuts = [pieces[0].len(), pieces[0].len() + pieces[1].len()];
        let cuts = cuts.iter().flat_map(|&cut| u16::try_from(cut).unwrap().to_le_bytes());
        let head = [flags, second, snapshot, mark].into_iter().chain(cuts);
        head.chain(pieces.concat()).collect::<Vec<u8>>()
    };
    let (first, second) = (parts(0..5), parts(5..8));
    let mut gap = first.clone();
    gap[2] = 3;
    vec![
        ("two-files", folder([3, 6, 0, 0], [&first, &second, &[]])),
        ("marked", folder([7, 6, 0, 8], [&first, &second, &[]])),
        ("snapshot", folder([11, 6, 5, 0], [&first, &second, &[]])),
        ("bad-snapshot", folder([3, 6, 5, 0], [&first, &second, b"no snapshot"])),
        ("lost-end", folder([7, 6, 0, 20], [&first, &second, &[]])),
        ("gap", folder([3, 6, 0, 0], [&gap, &second, &[]])),
        ("second-file-torn", folder([1, 6, 0, 0], [&first, b"covisjrn", &[]])),
        ("first-file-torn", folder([2, 6, 0, 0], [b"covisjrn", &second, &[]])),
        ("missing-file", folder([3, 9, 0, 0], [&first, &second, &[]])),
        ("last-file-there-can-be", folder([3, 255, 0, 0], [&first, &second, &[]])),
        ("last-snapshot-there-can-be", folder([3, 6, 255, 255], [&first, &second, &[]])),
    ]
}

#[test]
fn the_seeds_break_no_target() {
    let seeds = [
        ("journal", super::journal as fn(&[u8]), journal()),
        ("journal_folder", super::journal_folder, journal_folder()),
        ("map_file", super::map_file, map_file()),
        ("snapshot", super::snapshot, snapshot()),
    ];
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus");
    for (target, run, named) in seeds {
        for (name, bytes) in named {
            run(&bytes);
            if std::env::var_os("COVIS_TEST_RECORD_CORPUS").is_some() {
                fs_err::write(corpus.join(target).join(name), bytes).unwrap();
            }
        }
    }
}
