//! Computes from the bytes of a protobuf message how much memory it takes once it is decoded.
//!
//! An empty entry of a list takes two bytes on the wire and as many as its struct has in memory, a
//! hundredfold. A decoder that finds that out has allocated it already. So the bytes are walked
//! first, along the message's descriptor and without allocating, and entries are counted with an
//! upper estimate of their size. Nothing here is decoded, and what is malformed is for the decoder
//! to refuse.

use std::collections::BTreeMap;

use prost::Message as _;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorSet};

/// Decoded bytes that any message may take: 65,536 landmarks that have an id alone fit.
const ALWAYS: usize = 20 << 20;
/// Decoded bytes that a larger message may take for each of its own. What is filled takes less:
/// an observation three, a landmark with its position six.
const PER_BYTE: usize = 16;
/// A message that is shorter cannot take [`ALWAYS`]: no entry of a list takes 2560 bytes for each of
/// its own two.
const SHORT: usize = ALWAYS / 2560;

/// A message that would take more memory than its length earns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{length} bytes that decode to {decoded}, {allowed} are allowed for their length")]
pub struct TooDense {
    /// Its length.
    length: usize,
    /// What it would take, about.
    decoded: usize,
    /// What it may.
    allowed: usize,
}

/// The messages of a package, as far as their memory goes.
#[derive(Debug)]
pub struct Shapes {
    /// Without the dot that descriptors put first.
    by_name: BTreeMap<String, usize>,
    shapes: Vec<Shape>,
}

/// One message.
#[derive(Debug, Default)]
struct Shape {
    /// Upper estimate of its struct, without what is behind pointers.
    size: usize,
    /// By number.
    fields: BTreeMap<u32, Field>,
}

/// What a field's bytes become.
#[derive(Clone, Copy, Debug)]
enum Field {
    /// A message; in a list it takes its size each time.
    Message { shape: usize, repeated: bool },
    /// Text or bytes; in a list with their own pointer, length and capacity.
    Bytes { repeated: bool },
    /// A list of numbers, packed or not.
    Numbers,
}

/// Pointer, length and capacity.
const VECTOR: usize = 24;
/// A number with what it takes to be absent.
const NUMBER: usize = 16;
/// What an `Option` or the tag of an enum adds.
const TAG: usize = 8;

impl Shapes {
    /// The shapes of an encoded `FileDescriptorSet`; of bytes that are none there are none.
    pub fn of(descriptors: &[u8]) -> Self {
        let files = FileDescriptorSet::decode(descriptors).unwrap_or_default().file;
        let mut messages = BTreeMap::new();
        for file in &files {
            collect(file.package(), &file.message_type, &mut messages);
        }
        let by_name: BTreeMap<String, usize> = messages.keys().cloned().zip(0..).collect();
        let size = |name: &str| size(name, &messages, 0);
        let shape = |(name, message): (&String, &&DescriptorProto)| Shape {
            size: size(name),
            fields: message.field.iter().filter_map(|f| field(f, &by_name)).collect(),
        };
        let shapes = messages.iter().map(shape).collect();
        Self { by_name, shapes }
    }

    /// Whether a message of this full name may be decoded.
    ///
    /// # Errors
    /// [`TooDense`] where it takes more than 20 MiB and more than 16 bytes a byte.
    pub fn check(&self, name: &str, bytes: &[u8]) -> Result<(), TooDense> {
        if bytes.len() <= SHORT {
            return Ok(());
        }
        let Some(&shape) = self.by_name.get(name) else { return Ok(()) };
        let decoded = self.decoded(shape, bytes);
        let length = bytes.len();
        let allowed = ALWAYS.max(length.saturating_mul(PER_BYTE));
        if decoded <= allowed { Ok(()) } else { Err(TooDense { length, decoded, allowed }) }
    }

    /// Messages of this name that take as much as they can: for each list that it holds, however
    /// deep, `length` bytes of empty entries, and as many of them as are allowed.
    #[cfg(any(test, feature = "fuzzing"))]
    pub fn densest(&self, name: &str, length: usize) -> Vec<Vec<u8>> {
        self.by_name.get(name).map_or_else(Vec::new, |&shape| self.dense(shape, length))
    }

    #[cfg(any(test, feature = "fuzzing"))]
    fn dense(&self, shape: usize, length: usize) -> Vec<Vec<u8>> {
        let mut found = Vec::new();
        for (&number, field) in &self.shapes[shape].fields {
            let key = u64::from(number) << 3 | 2;
            let Field::Message { shape: inner, repeated } = *field else { continue };
            let mut entry = Vec::new();
            prost::encoding::encode_varint(key, &mut entry);
            if repeated {
                let empty = [&entry[..], &[0]].concat();
                for count in [length / empty.len(), ALWAYS / self.shapes[inner].size] {
                    found.push(empty.repeat(count.min(length / empty.len())));
                }
            }
            for content in self.dense(inner, length.saturating_sub(16)) {
                let mut message = entry.clone();
                prost::encoding::encode_varint(content.len() as u64, &mut message);
                found.push([message, content].concat());
            }
        }
        found
    }

    /// Upper estimate of what the lists and texts of a message take.
    fn decoded(&self, shape: usize, mut bytes: &[u8]) -> usize {
        let mut sum: usize = 0;
        while let Some(key) = varint(&mut bytes) {
            let number = u32::try_from(key >> 3).ok();
            let field = number.and_then(|number| self.shapes[shape].fields.get(&number));
            let content = match key & 7 {
                0 => varint(&mut bytes).map(|_number| &[][..]),
                1 => cut(&mut bytes, 8),
                2 => varint(&mut bytes)
                    .and_then(|length| cut(&mut bytes, usize::try_from(length).ok()?)),
                5 => cut(&mut bytes, 4),
                // A group, which no message of ours has and a decoder would skip.
                _ => return usize::MAX,
            };
            // The decoder stops at the same place.
            let Some(content) = content else { break };
            let is_long = key & 7 == 2;
            sum = sum.saturating_add(match field {
                Some(&Field::Message { shape, repeated }) if is_long => {
                    let own = if repeated { self.shapes[shape].size } else { 0 };
                    self.decoded(shape, content).saturating_add(own)
                }
                Some(&Field::Bytes { repeated }) if is_long => {
                    content.len() + if repeated { VECTOR } else { 0 }
                }
                Some(Field::Numbers) => 8 * content.len().max(1),
                Some(Field::Message { .. } | Field::Bytes { .. }) | None => 0,
            });
        }
        sum
    }
}

/// The messages of a file, nested ones too, by full name.
fn collect<'a>(
    scope: &str,
    messages: &'a [DescriptorProto],
    all: &mut BTreeMap<String, &'a DescriptorProto>,
) {
    for message in messages {
        let name = format!("{scope}.{}", message.name());
        collect(&name, &message.nested_type, all);
        all.insert(name, message);
    }
}

fn name_of(field: &FieldDescriptorProto) -> &str {
    field.type_name().trim_start_matches('.')
}

/// Upper estimate of a message's struct. A message that holds itself would be boxed; ours do not.
fn size(name: &str, messages: &BTreeMap<String, &DescriptorProto>, depth: usize) -> usize {
    let Some(message) = messages.get(name).filter(|_| depth < 16) else { return VECTOR };
    let mut sum = 0;
    let mut choices: BTreeMap<i32, usize> = BTreeMap::new();
    for field in &message.field {
        let own = match (field.label(), field.r#type()) {
            (Label::Repeated, _) | (_, Type::String | Type::Bytes) => VECTOR,
            (_, Type::Message) => TAG + size(name_of(field), messages, depth + 1),
            _ => NUMBER,
        };
        match field.oneof_index {
            Some(choice) => {
                let largest = choices.entry(choice).or_default();
                *largest = own.max(*largest);
            }
            None => sum += own,
        }
    }
    sum + choices.values().map(|largest| TAG + largest).sum::<usize>()
}

/// A field that takes memory of its own, by its number.
fn field(
    descriptor: &FieldDescriptorProto,
    by_name: &BTreeMap<String, usize>,
) -> Option<(u32, Field)> {
    let number = u32::try_from(descriptor.number()).ok()?;
    let repeated = descriptor.label() == Label::Repeated;
    let kind = descriptor.r#type();
    let field = if kind == Type::Message {
        Field::Message { shape: *by_name.get(name_of(descriptor))?, repeated }
    } else if matches!(kind, Type::String | Type::Bytes) {
        Field::Bytes { repeated }
    } else if repeated {
        Field::Numbers
    } else {
        return None;
    };
    Some((number, field))
}

fn varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for shift in (0..70).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u64::from(byte & 0x7f).checked_shl(shift).unwrap_or(0);
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}

fn cut<'a>(bytes: &mut &'a [u8], length: usize) -> Option<&'a [u8]> {
    let (content, rest) = bytes.split_at_checked(length)?;
    *bytes = rest;
    Some(content)
}

#[cfg(test)]
mod tests {
    use prost::Message as _;

    use super::{Field, SHORT, Shapes};
    use crate::wire::v1;

    fn shapes() -> Shapes {
        Shapes::of(v1::FILE_DESCRIPTOR_SET)
    }

    /// Bytes of a message that holds `count` times the field `number` with this content.
    fn repeated(number: u8, content: &[u8], count: usize) -> Vec<u8> {
        let entry = [&[number << 3 | 2, content.len() as u8][..], content].concat();
        entry.repeat(count)
    }

    #[test]
    fn a_list_of_empty_entries_is_refused_before_it_is_decoded() {
        let bytes = repeated(4, &[], 500_000);
        let error = shapes().check("covis.v1.BundleProblem", &bytes).unwrap_err();
        assert!(error.to_string().starts_with("1000000 bytes that decode to "), "{error}");
        // The same deeper down, where every level is short for itself.
        let inner = repeated(9, &[], 20);
        let mut bytes = Vec::new();
        while bytes.len() < 900_000 {
            let keyframe = [&[12 << 3 | 2, inner.len() as u8][..], &inner].concat();
            bytes.extend(keyframe);
        }
        assert!(shapes().check("covis.v1.IngestRequest", &bytes).is_err());
        // A group would be skipped by the decoder, and what follows it decoded.
        let bytes = [&[0x2b, 0x2c][..], &repeated(4, &[], 100_000)].concat();
        assert!(shapes().check("covis.v1.BundleProblem", &bytes).is_err());
    }

    #[test]
    fn what_is_filled_is_decoded() {
        let landmarks = (0..65_536)
            .map(|id| v1::Landmark { id, ..v1::Landmark::default() })
            .collect::<Vec<_>>();
        let batch = v1::LandmarkBatch { landmarks }.encode_to_vec();
        assert_eq!(shapes().check("covis.v1.LandmarkBatch", &batch), Ok(()));
        let pixel = Some(v1::Vector2 { x: 0.5, y: 0.5 });
        let seen = |k: i32| v1::BundleObservation {
            pose_index: k % 7,
            point_index: k % 9,
            pixel,
            ..v1::BundleObservation::default()
        };
        let observations = (0..200_000).map(seen).collect();
        let problem = v1::BundleProblem { observations, ..v1::BundleProblem::default() };
        let bytes = problem.encode_to_vec();
        assert_eq!(shapes().check("covis.v1.BundleProblem", &bytes), Ok(()));
        assert_eq!(shapes().check("covis.v1.BundleProblem", &bytes[..99_999]), Ok(()), "cut off");
    }

    #[test]
    fn estimates_are_upper_bounds() {
        let shapes = shapes();
        let check = |name: &str, actual: usize| {
            let estimate = shapes.shapes[shapes.by_name[name]].size;
            assert!((actual..2 * actual).contains(&estimate), "{name}: {estimate} for {actual}");
        };
        check("covis.v1.Observation", size_of::<v1::Observation>());
        check("covis.v1.Landmark", size_of::<v1::Landmark>());
        check("covis.v1.Keyframe", size_of::<v1::Keyframe>());
        check("covis.v1.Camera", size_of::<v1::Camera>());
        check("covis.v1.BundleObservation", size_of::<v1::BundleObservation>());
        check("covis.v1.PoseGraphEdgeSe3", size_of::<v1::PoseGraphEdgeSe3>());
        check("covis.v1.IngestRequest", size_of::<v1::IngestRequest>());
        // An entry has a tag and a length at least, so that a short message is always allowed.
        let fields = shapes.shapes.iter().flat_map(|shape| shape.fields.values());
        let size = |field: &Field| match *field {
            Field::Message { shape, repeated: true } => shapes.shapes[shape].size,
            Field::Message { .. } | Field::Bytes { .. } | Field::Numbers => 0,
        };
        let largest = fields.map(size).max().unwrap();
        assert!(SHORT / 2 * largest <= super::ALWAYS, "{largest}");
    }
}
