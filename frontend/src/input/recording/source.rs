//! The frames of a recording: color and depth that belong together in time, read one by one.
//!
//! Holds the index and one message. A frame that cannot be read is an answer, and the next one follows.

use std::path::{Path, PathBuf};

use covis_solvers::geometry::PinholeRadialTangential;

use super::clouds::{self, PointCloud};
use super::error::{MessageError, RecordingError};
use super::images;
use super::index::{Message, Place, Topic};
use super::messages::{CompressedImage, Encoding, Kind, RawImage};
use super::note::Note;
use super::odometry::Odometry;
use super::storage::Storage;
use crate::image::{Image, RgbdFrame};
use crate::input::folder::{ImplausibleDepth, SCALE_IMAGES};
use crate::input::{FrameError, FrameSource, SensorTiming, association};

/// The files of a recording, of which the last that was read stays open.
#[derive(Debug)]
pub(super) struct Files {
    paths: Vec<PathBuf>,
    open: Option<(usize, Storage)>,
    message: Vec<u8>,
}

impl Files {
    pub(super) fn new(paths: Vec<PathBuf>) -> Self {
        Self { paths, open: None, message: Vec::new() }
    }

    /// The file with this number, or the last.
    fn path(&self, file: usize) -> &Path {
        self.paths.get(file).or(self.paths.last()).map_or(Path::new(""), PathBuf::as_path)
    }

    /// Reads a message.
    pub(super) fn read(&mut self, place: Place) -> Result<&[u8], RecordingError> {
        let storage = match self.open.take() {
            Some((file, storage)) if file == place.file => storage,
            _ => Storage::open(self.path(place.file))?,
        };
        let (_, storage) = self.open.insert((place.file, storage));
        storage.read(place, &mut self.message)?;
        Ok(&self.message)
    }
}

/// The images of a frame.
#[derive(Clone, Copy, Debug)]
struct Pair {
    color: Message,
    depth: Message,
}

/// What is read of a topic.
#[derive(Clone, Debug)]
struct Images {
    name: String,
    kind: Kind,
    encoding: Encoding,
}

/// The frames of a recording.
#[derive(Debug)]
pub(super) struct RecordedFrames {
    camera: PinholeRadialTangential,
    files: Files,
    color: Images,
    depth: Images,
    /// Units of depth a meter, where the caller gives them.
    units_per_m: Option<f32>,
    odometry: Option<Odometry>,
    pairs: Vec<Pair>,
    next: usize,
    /// Of the first frame that was read.
    size: Option<(usize, usize)>,
}

/// Images by time, one of each time, and how many others there are.
fn by_time(topic: &Topic) -> (Vec<Message>, usize) {
    let mut messages = topic.messages.clone();
    messages.sort_by(|a, b| a.timestamp_s.total_cmp(&b.timestamp_s));
    messages.dedup_by(|later, first| later.timestamp_s == first.timestamp_s);
    let others = topic.messages.len() - messages.len();
    (messages, others)
}

impl RecordedFrames {
    /// Pairs the images of two topics. Fails where none belong together.
    pub(super) fn new(
        path: &Path,
        files: Files,
        camera: PinholeRadialTangential,
        [color, depth]: [&Topic; 2],
        units_per_m: Option<f32>,
        notes: &mut Vec<Note>,
    ) -> Result<Self, RecordingError> {
        let [colors, depths] = [color, depth].map(|topic| {
            let (messages, others) = by_time(topic);
            if others > 0 {
                notes.push(Note::Repeated { topic: topic.name.clone(), messages: others });
            }
            messages
        });
        let times = |messages: &[Message]| -> Vec<f64> {
            messages.iter().map(|message| message.timestamp_s).collect()
        };
        let (color_times, depth_times) = (times(&colors), times(&depths));
        let max_difference_s = association::max_difference_s(&color_times, &depth_times);
        let partners = association::nearest_pairs(&color_times, &depth_times, max_difference_s);
        let pairs = colors
            .iter()
            .zip(partners)
            .filter_map(|(&color, partner)| Some(Pair { color, depth: *depths.get(partner?)? }));
        let pairs: Vec<Pair> = pairs.collect();
        if pairs.is_empty() {
            return Err(RecordingError::NoFrames {
                path: path.to_owned(),
                color: color.name.clone(),
                depth: depth.name.clone(),
                max_difference_s,
            });
        }
        if pairs.len() < colors.len() {
            notes.push(Note::WithoutDepth { images: colors.len() - pairs.len() });
        }
        let [color, depth] = [color, depth].map(|topic| Images {
            name: topic.name.clone(),
            kind: topic.kind,
            encoding: topic.encoding(),
        });
        let (odometry, next, size) = (None, 0, None);
        Ok(Self { camera, files, color, depth, units_per_m, odometry, pairs, next, size })
    }

    /// The same with the camera's poses by the odometry of a topic. Fails where no frame has one.
    pub(super) fn with_odometry(
        self,
        path: &Path,
        topic: &Topic,
        odometry: Odometry,
        notes: &mut Vec<Note>,
    ) -> Result<Self, RecordingError> {
        let has_none = |pair: &&Pair| odometry.at(pair.color.timestamp_s).is_none();
        let images = self.pairs.iter().filter(has_none).count();
        let topic = topic.name.clone();
        if images == self.pairs.len() {
            let (path, color) = (path.to_owned(), self.color.name);
            return Err(RecordingError::OdometryElsewhere { path, topic, color });
        }
        if images > 0 {
            notes.push(Note::WithoutOdometry { topic, images });
        }
        Ok(Self { odometry: Some(odometry), ..self })
    }

    /// Why millimeters do not seem to be the recording's unit, by its first depth images.
    pub(super) fn implausible_depth(&mut self) -> Option<ImplausibleDepth> {
        if self.units_per_m.is_some() || self.depth.kind != Kind::Image {
            return None;
        }
        let mut values = Vec::new();
        for pair in self.pairs.iter().take(SCALE_IMAGES) {
            let message = self.files.read(pair.depth.place).ok()?;
            let image = images::units(&RawImage::read(self.depth.encoding, message).ok()?).ok()?;
            let measured = |value: &u16| ![0, u16::MAX].contains(value);
            values.extend(image.pixels().iter().copied().filter(measured));
        }
        ImplausibleDepth::of(values, images::UNITS_PER_M)
    }

    fn color(&mut self, message: Message) -> Result<Image<[u8; 3]>, FrameError> {
        let Images { kind, encoding, .. } = self.color;
        let read = |bytes: &[u8]| {
            if kind == Kind::CompressedImage {
                images::compressed_color(&CompressedImage::read(encoding, bytes)?)
            } else {
                images::color(&RawImage::read(encoding, bytes)?)
            }
        };
        let image = read(self.files.read(message.place)?);
        image.map_err(|source| self.failed(&self.color.name, message, source))
    }

    fn depth(&mut self, message: Message) -> Result<Image<f32>, FrameError> {
        let (Images { kind, encoding, .. }, units_per_m) = (&self.depth, self.units_per_m);
        let read = |bytes: &[u8]| {
            if *kind == Kind::CompressedImage {
                images::compressed_depth(&CompressedImage::read(*encoding, bytes)?, units_per_m)
            } else if *kind == Kind::PointCloud {
                clouds::depth(&PointCloud::read(bytes)?, units_per_m)
            } else {
                images::depth(&RawImage::read(*encoding, bytes)?, units_per_m)
            }
        };
        let image = read(self.files.read(message.place)?);
        image.map_err(|source| self.failed(&self.depth.name, message, source))
    }

    fn failed(&self, topic: &str, message: Message, source: MessageError) -> FrameError {
        FrameError::Message {
            path: self.files.path(message.place.file).to_owned(),
            topic: topic.to_owned(),
            timestamp_s: message.timestamp_s,
            source,
        }
    }

    fn read(&mut self, Pair { color, depth }: Pair) -> Result<RgbdFrame, FrameError> {
        let image = self.color(color)?;
        let expected = self.size.unwrap_or(image.size());
        if image.size() != expected {
            let source = MessageError::Size { found: image.size(), expected };
            return Err(self.failed(&self.color.name, color, source));
        }
        let depth_m = self.depth(depth)?;
        if depth_m.size() != expected {
            let source = MessageError::Size { found: depth_m.size(), expected };
            return Err(self.failed(&self.depth.name, depth, source));
        }
        self.size = Some(expected);
        Ok(RgbdFrame {
            timestamp_s: color.timestamp_s,
            depth_delay_s: depth.timestamp_s - color.timestamp_s,
            color: image,
            depth_m,
            given_pose: self.odometry.as_ref().and_then(|found| found.at(color.timestamp_s)),
        })
    }
}

impl FrameSource for RecordedFrames {
    fn camera(&self) -> &PinholeRadialTangential {
        &self.camera
    }

    /// A recording does not say: rows and depth are taken at the timestamps.
    fn timing(&self) -> SensorTiming {
        SensorTiming::default()
    }

    fn has_odometry(&self) -> bool {
        self.odometry.is_some()
    }

    fn len(&self) -> usize {
        self.pairs.len()
    }

    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>> {
        let pair = *self.pairs.get(self.next)?;
        self.next += 1;
        Some(self.read(pair))
    }
}
