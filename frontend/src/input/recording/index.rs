//! What a recording holds, without its data: topics with their types and counts, and of images the times and
//! places in the files.
//!
//! The storages fill it in one pass, which the caller watches and may end; what is kept of a message does
//! not grow with it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use super::error::RecordingError;
use super::messages::{self, Encoding, Kind, Sample};
use super::note::Note;
use super::topics::TopicSummary;

/// How many damaged parts are reported.
const MOST_NOTES: usize = 8;
/// Images of a topic: 38 hours at 30 a second. A chunk of nothing but empty messages compresses a thousandfold.
const MOST_MESSAGES: usize = 1 << 22;
/// Topics of all files.
const MOST_TOPICS: usize = 1 << 16;

/// Bytes at the beginning of a message, or of a record, that are looked at: what is in front of the data.
pub(super) const HEAD_BYTES: usize = 1024;

/// Where a message is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    /// The number of the file.
    pub(super) file: usize,
    pub(super) at: At,
    /// Bytes.
    pub(super) length: u64,
}

/// Where in a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum At {
    /// At this byte.
    File(u64),
    /// Behind so many bytes of the decompressed chunk whose record begins at this byte.
    Chunk { record: u64, offset: usize },
    /// In this row.
    #[cfg(feature = "sqlite")]
    Row(i64),
}

/// A message of which the data are read later.
#[derive(Clone, Copy, Debug)]
pub(super) struct Message {
    pub(super) timestamp_s: f64,
    pub(super) place: Place,
}

/// A topic.
#[derive(Clone, Debug)]
pub(super) struct Topic {
    pub(super) name: String,
    pub(super) type_name: String,
    pub(super) encoding: String,
    pub(super) kind: Kind,
    /// All messages.
    pub(super) count: u64,
    /// Those that may be read: all images, point clouds, poses and static transforms, and the first message about a camera.
    pub(super) messages: Vec<Message>,
    /// What the first message says.
    pub(super) sample: Sample,
}

impl Topic {
    /// How its messages are encoded.
    pub(super) fn encoding(&self) -> Encoding {
        Encoding::of(&self.encoding)
    }

    pub(super) fn summary(&self) -> TopicSummary {
        let Self { name, type_name, encoding, count, sample, .. } = self;
        TopicSummary {
            name: name.clone(),
            type_name: type_name.clone(),
            serialization: encoding.clone(),
            count: *count,
            pixels: sample.encoding.chars().take(40).collect(),
            size: sample.size,
        }
    }
}

/// What is asked as the pass goes on: with the bytes so far, whether it goes on.
struct Watch(Box<dyn FnMut(u64) -> bool + Send>);

impl Default for Watch {
    fn default() -> Self {
        Self(Box::new(|_| true))
    }
}

impl fmt::Debug for Watch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Watch")
    }
}

/// The topics of a recording.
#[derive(Debug, Default)]
pub(super) struct Index {
    watch: Watch,
    /// Bytes that the pass has behind it.
    passed: u64,
    is_ended: bool,
    topics: Vec<Topic>,
    /// Of a name, a type and an encoding.
    numbers: BTreeMap<[String; 3], usize>,
    notes: Vec<Note>,
    more_damage: u64,
    /// Topics with more images than are listed.
    is_cut: BTreeSet<String>,
}

impl Index {
    /// An index whose pass `watch` sees, and ends where it answers false.
    pub(super) fn watched(watch: impl FnMut(u64) -> bool + Send + 'static) -> Self {
        Self { watch: Watch(Box::new(watch)), ..Self::default() }
    }

    /// So many more bytes are behind the pass. Whether it goes on.
    pub(super) fn pass(&mut self, bytes: u64) -> bool {
        self.passed = self.passed.saturating_add(bytes);
        self.is_ended |= !(self.watch.0)(self.passed);
        !self.is_ended
    }

    /// Whether the pass was ended before the end of the recording.
    pub(super) fn is_ended(&self) -> bool {
        self.is_ended
    }

    /// The number of a topic, which is added where there is none with this name and type.
    pub(super) fn topic(&mut self, name: &str, type_name: &str, encoding: &str) -> usize {
        let key = [name, type_name, encoding].map(str::to_owned);
        let next = self.topics.len();
        let number = *self.numbers.entry(key).or_insert(next);
        if number < next || next == MOST_TOPICS {
            return number;
        }
        self.topics.push(Topic {
            name: name.to_owned(),
            type_name: type_name.to_owned(),
            encoding: encoding.to_owned(),
            kind: Kind::of(name, type_name, encoding),
            count: 0,
            messages: Vec::new(),
            sample: Sample::default(),
        });
        number
    }

    /// Whether the beginnings of a topic's messages matter.
    #[cfg(feature = "sqlite")]
    pub(super) fn wants_heads(&self, topic: usize) -> bool {
        self.topics.get(topic).is_some_and(|topic| topic.kind != Kind::Other)
    }

    /// A message of a topic; `head` is its beginning, and `recorded_s` its time where it has none itself.
    pub(super) fn message(&mut self, topic: usize, recorded_s: f64, head: &[u8], place: Place) {
        let Some(topic) = self.topics.get_mut(topic) else { return };
        topic.count += 1;
        match topic.kind {
            Kind::Other => return,
            Kind::CameraInfo if !topic.messages.is_empty() => return,
            Kind::Image
            | Kind::CompressedImage
            | Kind::CameraInfo
            | Kind::PointCloud
            | Kind::Pose
            | Kind::StaticTransforms => {}
        }
        if topic.messages.is_empty() {
            topic.sample = Sample::of(topic.encoding(), topic.kind, head);
        }
        if topic.messages.len() == MOST_MESSAGES {
            self.is_cut.insert(topic.name.clone());
            return;
        }
        let timestamp_s = messages::timestamp_s(topic.encoding(), head).unwrap_or(recorded_s);
        topic.messages.push(Message { timestamp_s, place });
    }

    /// Something that the caller should know.
    pub(super) fn note(&mut self, note: Note) {
        self.notes.push(note);
    }

    /// A part that is skipped.
    pub(super) fn damage(&mut self, error: RecordingError) {
        if self.notes.len() < MOST_NOTES {
            self.notes.push(Note::Damaged(error));
        } else {
            self.more_damage += 1;
        }
    }

    /// Topics by name, and notes.
    pub(super) fn finish(mut self) -> (Vec<Topic>, Vec<Note>) {
        self.topics.sort_by(|a, b| a.name.cmp(&b.name).then(a.type_name.cmp(&b.type_name)));
        let too_many = |topic| Note::TooMany { topic, most: MOST_MESSAGES };
        self.notes.extend(self.is_cut.into_iter().map(too_many));
        if self.more_damage > 0 {
            self.notes.push(Note::MoreDamage { parts: self.more_damage });
        }
        (self.topics, self.notes)
    }
}
