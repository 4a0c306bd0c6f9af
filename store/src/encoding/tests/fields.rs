//! Every number of every event, with the values that a solve that overflows or a damaged file may put there.
//!
//! A journal, a snapshot and an uploaded file are read by the same constructors: what [`decode_event`] and
//! [`Map::fits`] let into a map, its snapshot gives back, and [`Map::check_sound`] accepts. `fields.txt` lists
//! who refuses which value; `COVIS_TEST_REGENERATE=1` writes it anew.

use std::collections::BTreeMap;

use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FileDescriptorSet};

use super::{bytes_of, every_change};
use crate::encoding::{
    decode_event, decode_map, encode_map, encode_readable, v1::FILE_DESCRIPTOR_SET,
};
use covis_map::Map;

/// The values, with the letters that `fields.txt` has for them.
const VALUES: [(char, f64); 6] = [
    ('n', f64::NAN),
    ('i', f64::INFINITY),
    ('h', f64::MAX),
    ('l', -f64::MAX),
    ('m', -1.0),
    ('t', 5e-324),
];

/// A number of eight bytes in a message.
struct Number {
    /// The message's kind and the fields that lead to it, such as `SolveApplied.poses.pose.tx`.
    path: String,
    /// Where its bytes begin.
    at: usize,
}

struct Messages(BTreeMap<String, DescriptorProto>);

impl Messages {
    fn new() -> Self {
        let set = FileDescriptorSet::decode(FILE_DESCRIPTOR_SET).unwrap();
        let messages = set.file.into_iter().flat_map(|file| file.message_type);
        Self(messages.map(|message| (message.name().to_owned(), message)).collect())
    }

    /// The numbers of a message of a kind that begins at `at`.
    fn numbers(&self, kind: &str, path: &str, bytes: &[u8], at: usize, out: &mut Vec<Number>) {
        let message = &self.0[kind];
        let mut rest = bytes;
        while !rest.is_empty() {
            let begin = |rest: &[u8]| at + bytes.len() - rest.len();
            let key = varint(&mut rest);
            let field = message.field.iter().find(|field| field.number() as u64 == key >> 3);
            let field = field.unwrap_or_else(|| panic!("{kind} has no field {}", key >> 3));
            let path = format!("{path}.{}", field.name());
            match key & 7 {
                0 => _ = varint(&mut rest),
                1 => {
                    out.push(Number { path, at: begin(rest) });
                    rest = &rest[8..];
                }
                2 => {
                    let length = varint(&mut rest) as usize;
                    let (inner, behind) = rest.split_at(length);
                    let start = begin(rest);
                    let of = field.r#type();
                    if of == Type::Message {
                        let kind = field.type_name().rsplit('.').next().unwrap();
                        self.numbers(kind, &path, inner, start, out);
                    } else if matches!(of, Type::Double | Type::Fixed64) {
                        // A list of numbers in one piece.
                        assert_eq!(field.label(), Label::Repeated);
                        let each = (0..length / 8).map(|k| start + 8 * k);
                        out.extend(each.map(|at| Number { path: path.clone(), at }));
                    }
                    rest = behind;
                }
                5 => rest = &rest[4..],
                other => panic!("{path} has wire type {other}"),
            }
        }
    }
}

fn varint(rest: &mut &[u8]) -> u64 {
    prost::encoding::decode_varint(rest).unwrap()
}

/// Who refuses a value.
fn reached(map: &Map, bytes: &[u8], path: &str) -> &'static str {
    let Ok(event) = decode_event(bytes) else { return "decode" };
    if map.fits(&event).is_err() {
        return "fits";
    }
    let mut again = Vec::new();
    assert_eq!(encode_readable(&event, &mut again), Ok(()), "{path}");
    assert_eq!(again, bytes, "{path} comes back with other bits");
    let mut map = map.clone();
    map.fold(&event);
    let mut snapshot = Vec::new();
    encode_map(&map, &mut snapshot).unwrap();
    let read = decode_map(&mut &snapshot[..]).unwrap_or_else(|e| panic!("{path}: {e}"));
    assert_eq!(read.state_hash(), map.state_hash(), "{path}");
    "accepted"
}

#[test]
fn each_number_of_each_event_is_refused_or_can_be_read_again() {
    let messages = Messages::new();
    let mut map = Map::new();
    // By field the letters of the values that each refuses, in the order of the values.
    let mut table: BTreeMap<String, BTreeMap<&'static str, String>> = BTreeMap::new();
    for event in every_change() {
        let bytes = bytes_of(&event);
        let mut numbers = Vec::new();
        messages.numbers("Event", event.change.name(), &bytes, 0, &mut numbers);
        for Number { path, at } in numbers {
            let row = table.entry(path.clone()).or_default();
            for (letter, value) in VALUES {
                let mut changed = bytes.clone();
                changed[at..at + 8].copy_from_slice(&value.to_bits().to_le_bytes());
                let letters = row.entry(reached(&map, &changed, &path)).or_default();
                if !letters.contains(letter) {
                    letters.push(letter);
                }
            }
        }
        map.apply(&event).unwrap();
    }
    let mut text = String::from(
        "# field: who refuses n (NaN), i (infinity), h and l (the largest and least number), m (-1), t (5e-324)\n",
    );
    for (path, row) in &table {
        let cells: Vec<String> =
            row.iter().map(|(who, letters)| format!("{who} {letters}")).collect();
        text.push_str(&format!("{path}: {}\n", cells.join(", ")));
    }
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/src/encoding/tests/fields.txt");
    if std::env::var_os("COVIS_TEST_REGENERATE").is_some() {
        fs_err::write(file, &text).unwrap();
    }
    let listed = fs_err::read_to_string(file).unwrap();
    let others: Vec<&str> = text.lines().filter(|row| !listed.lines().any(|l| l == *row)).collect();
    assert_eq!(others, Vec::<&str>::new(), "another constructor reaches a field");
    assert_eq!(text.len(), listed.len(), "a field has gone");
}
