//! MCAP files by hand, so that each kind of chunk, cut and damage is at hand; files of real writers are in
//! `tests/integration/recordings.rs`.

use std::io::Write;

use super::super::index::{At, Topic};
use super::super::messages::Kind;
use super::mcap_record::MAGIC;
use super::*;
use crate::input::recording::note::Note;

fn record(opcode: u8, fields: &[&[u8]]) -> Vec<u8> {
    let fields = fields.concat();
    [&[opcode][..], &(fields.len() as u64).to_le_bytes(), &fields].concat()
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

/// A message in CDR that begins with a header of this time.
fn image(seconds: i32) -> Vec<u8> {
    let frame = [&7u32.to_le_bytes()[..], b"camera\0", &[0]].concat();
    let size = [2u32, 3].map(u32::to_le_bytes).concat();
    let encoding = [&5u32.to_le_bytes()[..], b"rgb8\0"].concat();
    [&[0, 1, 0, 0][..], &seconds.to_le_bytes(), &[0; 4], &frame, &size, &encoding].concat()
}

fn message(channel: u16, seconds: i32) -> Vec<u8> {
    let times = [u64::from(seconds.unsigned_abs()) * 1_000_000_000; 2].map(u64::to_le_bytes);
    record(0x05, &[&channel.to_le_bytes(), &[0; 4], &times.concat(), &image(seconds)])
}

/// A schema and a channel.
fn topic() -> Vec<u8> {
    let schema = record(
        0x03,
        &[&1u16.to_le_bytes(), &text("sensor_msgs/msg/Image"), &text("ros2msg"), &text("x")],
    );
    let ids = [4u16, 1].map(u16::to_le_bytes).concat();
    [schema, record(0x04, &[&ids, &text("/rgb"), &text("cdr"), &text("")])].concat()
}

fn chunk(compression: &str, data: &[u8]) -> Vec<u8> {
    let stored = match compression {
        "zstd" => zstd::encode_all(data, 1).unwrap(),
        "lz4" => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            encoder.write_all(data).unwrap();
            encoder.finish().unwrap()
        }
        _ => data.to_vec(),
    };
    let checksum = crc32fast::hash(data).to_le_bytes();
    let lengths = [data.len(), stored.len()].map(|length| (length as u64).to_le_bytes());
    record(0x06, &[&[0; 16], &lengths[0], &checksum, &text(compression), &lengths[1], &stored])
}

/// A file of these records.
fn file(records: &[Vec<u8>], has_end: bool) -> Vec<u8> {
    let header = record(0x01, &[&text("ros2"), &text("test")]);
    let end = [record(0x0f, &[&[0; 4]]), record(0x02, &[&[0; 20]]), MAGIC.to_vec()].concat();
    [&MAGIC[..], &header, &records.concat(), if has_end { &end } else { &[] }].concat()
}

fn scan(bytes: &[u8]) -> Result<(Vec<Topic>, Vec<Note>, Storage), RecordingError> {
    let path = tempfile::NamedTempFile::new().unwrap();
    fs_err::write(path.path(), bytes).unwrap();
    let mut storage = Storage::open(path.path())?;
    let mut index = Index::default();
    storage.scan(0, &mut index)?;
    let (topics, notes) = index.finish();
    Ok((topics, notes, storage))
}

#[test]
fn messages_are_found_in_chunks_of_each_kind_and_outside() {
    let two = [message(4, 1), message(4, 2)].concat();
    for records in [
        vec![topic(), two.clone()],
        vec![chunk("", &[topic(), two.clone()].concat())],
        vec![chunk("zstd", &topic()), chunk("zstd", &two)],
        vec![chunk("lz4", &[topic(), two.clone()].concat())],
        // Of a channel that nobody described, and a record that a later version has.
        vec![topic(), message(9, 1), record(0x42, &[&[1; 2000]]), chunk("zstd", &two)],
    ] {
        let (topics, notes, mut storage) = scan(&file(&records, true)).unwrap();
        assert!(notes.is_empty(), "{notes:?}");
        let [topic] = &topics[..] else { panic!("{topics:?}") };
        assert_eq!((&*topic.name, topic.kind, topic.count), ("/rgb", Kind::Image, 2));
        assert_eq!((&*topic.sample.frame_id, topic.sample.size), ("camera", Some((3, 2))));
        let mut bytes = Vec::new();
        for (number, found) in (1..).zip(&topic.messages) {
            assert_eq!(found.timestamp_s, f64::from(number));
            storage.read(found.place, &mut bytes).unwrap();
            assert_eq!(bytes, image(number));
        }
    }
}

#[test]
fn a_file_without_an_end_is_read_up_to_there() {
    let parts = [topic(), chunk("zstd", &message(4, 1)), chunk("zstd", &message(4, 2))];
    let whole = file(&parts, false);
    let last = whole.len() - parts[2].len();
    for length in 8..=whole.len() {
        let (topics, notes, _) = scan(&whole[..length]).unwrap();
        let [Note::Cut { offset, .. }] = &notes[..] else { panic!("{length}: {notes:?}") };
        assert!(*offset <= length as u64);
        if length >= last {
            let expected = if length == whole.len() { (2, length) } else { (1, last) };
            assert_eq!((topics[0].count, *offset as usize), (expected.0, expected.1));
        }
    }
    assert!(matches!(scan(&whole[..7]), Err(RecordingError::Format { .. })));
    assert!(matches!(scan(&ZSTD_MAGIC), Err(RecordingError::Compressed { .. })));
    assert!(matches!(scan(b"#ROSBAG V2.0\n"), Err(RecordingError::Ros1 { .. })));
}

#[test]
fn a_damaged_chunk_is_skipped_and_named() {
    let good = chunk("zstd", &message(4, 1));
    let damaged = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bad = chunk("", &message(4, 2));
        change(&mut bad);
        let (topics, notes, _) = scan(&file(&[topic(), bad, good.clone()], true)).unwrap();
        assert_eq!(topics[0].messages.last().unwrap().timestamp_s, 1.0);
        notes.iter().map(ToString::to_string).collect::<String>()
    };
    // The length of the message's record, behind the chunk's head of 45 bytes.
    let told = damaged(&|bytes| bytes[9 + 40 + 2] = 0xff);
    assert!(told.contains("malformed"), "{told}");
    let mut other = chunk("zstd", &message(4, 2));
    let checksum = 9 + 24;
    other[checksum] ^= 1;
    let told = scan(&file(&[topic(), other, good.clone()], true)).unwrap().1;
    assert!(told[0].to_string().contains("checksum"), "{told:?}");
    let mut other = chunk("lz4", &message(4, 2));
    let length = other.len();
    other[length - 30] ^= 0xff;
    assert_eq!(scan(&file(&[topic(), other], true)).unwrap().1.len(), 1);
    let other = chunk("brotli", &message(4, 2));
    let told = scan(&file(&[topic(), other], true)).unwrap().1;
    assert!(told[0].to_string().contains("`brotli`"), "{told:?}");
    // A chunk that claims 2^60 bytes takes none of them.
    let mut other = chunk("zstd", &message(4, 2));
    other[9 + 16 + 7] = 0x10;
    let told = scan(&file(&[topic(), other], true)).unwrap().1;
    assert!(told[0].to_string().contains("at most"), "{told:?}");
}

#[test]
fn no_change_of_a_byte_is_fatal() {
    let whole = file(
        &[topic(), chunk("lz4", &message(4, 1)), chunk("", &message(4, 2)), message(4, 3)],
        true,
    );
    for at in 8..whole.len() {
        for value in [0, 1, 0x7f, 0xff] {
            let mut changed = whole.clone();
            changed[at] = value;
            let (topics, _, mut storage) = scan(&changed).unwrap();
            for found in topics.iter().flat_map(|topic| &topic.messages) {
                let _read = storage.read(found.place, &mut Vec::new());
            }
        }
    }
    let (_, _, mut storage) = scan(&whole).unwrap();
    for at in [At::File(u64::MAX), At::Chunk { record: 3, offset: usize::MAX }] {
        let _read = storage.read(Place { file: 0, at, length: 9 }, &mut Vec::new());
    }
}

/// A bag's database of two images, one of which has no data, and a topic that is not read.
#[cfg(feature = "sqlite")]
fn database(path: &Path) {
    let connection = rusqlite::Connection::open(path).unwrap();
    connection
        .execute_batch(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
             serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
             CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, \
             timestamp INTEGER NOT NULL, data BLOB);
             INSERT INTO topics VALUES (1, '/rgb', 'sensor_msgs/msg/Image', 'cdr', ''), \
             (2, '/imu', 'sensor_msgs/msg/Imu', 'cdr', '');
             INSERT INTO messages VALUES (2, 2, 5, x'00'), (3, 1, 7000000000, NULL);",
        )
        .unwrap();
    let insert = "INSERT INTO messages VALUES (1, 1, 1, ?1)";
    connection.execute(insert, [image(1)]).unwrap();
}

#[cfg(feature = "sqlite")]
#[test]
fn a_database_is_read_by_rows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.db3");
    database(&path);
    let mut storage = Storage::open(&path).unwrap();
    let mut index = Index::default();
    storage.scan(0, &mut index).unwrap();
    let (topics, notes) = index.finish();
    assert!(notes.is_empty(), "{notes:?}");
    let counts: Vec<_> = topics.iter().map(|topic| (&*topic.name, topic.count)).collect();
    assert_eq!(counts, [("/imu", 1), ("/rgb", 2)]);
    let [first, second] = &topics[1].messages[..] else { panic!("{topics:?}") };
    // A message without a header has the time of the recorder.
    assert_eq!((first.timestamp_s, second.timestamp_s), (1.0, 7.0));
    let mut bytes = Vec::new();
    storage.read(first.place, &mut bytes).unwrap();
    assert_eq!(bytes, image(1));
    let error = storage.read(second.place, &mut bytes).unwrap_err().to_string();
    assert!(error.contains("bag.db3, row 3: "), "{error}");
}

#[cfg(feature = "sqlite")]
#[test]
fn a_database_that_is_no_bag_or_is_damaged_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.db3");
    database(&path);
    let whole = fs_err::read(&path).unwrap();
    let connection = rusqlite::Connection::open(&path).unwrap();
    // A view that never ends.
    connection
        .execute_batch(
            "DROP TABLE messages; CREATE VIEW messages AS WITH RECURSIVE more(id) AS (SELECT 1 UNION ALL \
             SELECT id + 1 FROM more) SELECT id, 1 AS topic_id, 1 AS timestamp, x'' AS data FROM more",
        )
        .unwrap();
    drop(connection);
    let error = Storage::open(&path).unwrap_err();
    assert!(matches!(error, RecordingError::NoTable { table: "messages", .. }), "{error}");
    let scan = |bytes: &[u8]| {
        fs_err::write(&path, bytes).unwrap();
        let mut storage = Storage::open(&path).ok()?;
        let mut index = Index::default();
        storage.scan(0, &mut index).ok()?;
        for found in index.finish().0.iter().flat_map(|topic| &topic.messages) {
            let _read = storage.read(found.place, &mut Vec::new());
        }
        Some(())
    };
    assert!(scan(&whole).is_some());
    for length in (16..whole.len()).step_by(509) {
        scan(&whole[..length]);
    }
    for at in (16..whole.len()).filter(|&at| whole[at] != 0) {
        let mut changed = whole.clone();
        changed[at] ^= 0xff;
        scan(&changed);
    }
}
