//! Recordings of ROS 2 and Foxglove as a source of frames: MCAP files, and rosbag2 folders of MCAP or SQLite files.
//!
//! One pass over the files makes an index of times and places; frames are then read one by one, so that a
//! recording may be larger than memory. Topics are found by type and name, or named by the caller. Images
//! have the time of their header (the recorder's where the driver left it 0), and are paired as those of a
//! folder. A recording whose end is missing is read as far as it goes.
//!
//! | file | role |
//! |---|---|
//! | `bag` | the files of a folder, in order |
//! | `storage/` | MCAP and SQLite: the pass over a file, and single messages |
//! | `index` | topics, times and places |
//! | `topics` | which topics are color, depth and camera |
//! | `cdr`, `messages` | ROS 2 messages from bytes |
//! | `protobuf`, `foxglove` | Foxglove's messages from bytes |
//! | `images`, `clouds`, `camera_info` | what pixels, organized points and lenses mean |
//! | `source` | the frames |
//! | `poses` | the trajectory of a topic, in place of frames |
//! | `odometry`, `transforms` | where the camera was by odometry of another frame of its robot |
//! | `error`, `note` | what is wrong with a recording or a message, and what the caller should know |

mod bag;
mod camera_info;
mod cdr;
mod clouds;
mod error;
mod foxglove;
#[cfg(any(test, feature = "fuzzing"))]
pub(super) mod fuzzing;
mod images;
mod index;
#[cfg(any(test, feature = "fuzzing"))]
pub mod made;
mod messages;
mod note;
mod odometry;
mod poses;
mod protobuf;
mod source;
mod storage;
mod topics;
mod transforms;

use std::path::{Path, PathBuf};

use covis_solvers::geometry::PinholeRadialTangential;

pub use error::{Fault, MessageError, RecordingError};
pub use note::Note;
pub use poses::read_trajectory;
pub use topics::{Role, TopicNames, TopicSummary};

use super::error::InputError;
use super::folder::ImplausibleDepth;
use super::{FrameSource, camera_file};
use index::{Index, Topic};
use messages::{CameraInfo, Kind};
use odometry::Odometry;
use source::{Files, RecordedFrames};
use storage::Storage;

/// What a caller knows better than a recording.
#[derive(Clone, Copy, Debug, Default)]
pub struct RecordingOptions<'a> {
    /// Intrinsics: what [`camera_file::parse_argument`] reads.
    pub camera: Option<&'a str>,
    /// Units of a depth image a meter, more than 0; else 16-bit depth is in millimeters.
    pub depth_units_per_m: Option<f32>,
    /// Topics.
    pub topics: TopicNames<'a>,
}

/// A recording, opened.
pub struct OpenRecording {
    /// Its frames.
    pub source: Box<dyn FrameSource>,
    /// The topics that are used: color, depth, the camera's where the caller gave no camera, and odometry where
    /// the caller named it.
    pub used: Vec<(Role, TopicSummary)>,
    /// The topics that are not.
    pub unused: Vec<TopicSummary>,
    /// What the caller should know.
    pub notes: Vec<Note>,
    /// Set where no depth scale was given and millimeters do not fit the first depth images.
    pub implausible_depth: Option<ImplausibleDepth>,
}

/// Whether a folder is a rosbag2 recording: it has a `metadata.yaml`, or files of one.
#[must_use]
pub fn is_bag(folder: &Path) -> bool {
    bag::is_bag(folder)
}

/// Opens a recording: an MCAP file, a SQLite file of a bag, or a rosbag2 folder. Goes through all of it once:
/// `watch` hears, for each part, how many bytes are done and how many there are, and ends the pass by false.
///
/// # Errors
/// [`InputError`] where files cannot be read, topics are missing or ambiguous, the camera or the depth scale
/// cannot be used, no images belong together, or `watch` ended the pass.
pub fn open_recording(
    path: &Path,
    options: RecordingOptions<'_>,
    mut watch: impl FnMut(u64, u64) -> bool + Send + 'static,
) -> Result<OpenRecording, InputError> {
    if let Some(value) =
        options.depth_units_per_m.filter(|units| !(units.is_finite() && *units > 0.0))
    {
        return Err(InputError::DepthScale { value });
    }
    let (paths, note) = bag::files(path)?;
    // A file that is missing is reported when it is opened.
    let length = |file: &PathBuf| std::fs::metadata(file).map_or(0, |metadata| metadata.len());
    let all = paths.iter().map(length).sum();
    let mut index = Index::watched(move |passed| watch(passed.min(all), all));
    note.into_iter().for_each(|note| index.note(note));
    for (number, file) in paths.iter().enumerate() {
        Storage::open(file)?.scan(number, &mut index)?;
        if index.is_ended() {
            return Err(RecordingError::Ended { path: path.to_owned() }.into());
        }
    }
    let (topics, mut notes) = index.finish();
    let (color, depth) = topics::images(path, &topics, options.topics)?;
    let mut files = Files::new(paths);
    let (camera, info) = match options.camera {
        Some(given) => (camera_file::parse_argument(given)?, None),
        None => {
            let info = topics::camera_info(path, &topics, color, options.topics.camera_info)?;
            (camera_of(path, &mut files, info, color)?, Some(info))
        }
    };
    check_registration(path, &mut files, &topics, [color, depth], &mut notes)?;
    let odometry = options.topics.odometry.map(|named| topics::odometry(path, &topics, named));
    let odometry = odometry.transpose()?;
    let frame = &color.sample.frame_id;
    let measured = odometry
        .map(|topic| Odometry::read(path, &mut files, &topics, topic, frame, &mut notes))
        .transpose()?;
    let units = options.depth_units_per_m;
    let mut source = RecordedFrames::new(path, files, camera, [color, depth], units, &mut notes)?;
    if let Some((topic, measured)) = odometry.zip(measured) {
        source = source.with_odometry(path, topic, measured, &mut notes)?;
    }
    let implausible_depth = source.implausible_depth();
    let roles = [
        (Role::Color, Some(color)),
        (Role::Depth, Some(depth)),
        (Role::Camera, info),
        (Role::Odometry, odometry),
    ];
    let used: Vec<_> =
        roles.into_iter().filter_map(|(role, topic)| Some((role, topic?.summary()))).collect();
    let mut unused: Vec<_> = topics.iter().map(Topic::summary).collect();
    unused.retain(|topic| used.iter().all(|(_, used)| used != topic));
    Ok(OpenRecording { source: Box::new(source), used, unused, notes, implausible_depth })
}

/// The camera that the first message of a topic describes, for images that may be rectified.
fn camera_of(
    path: &Path,
    files: &mut Files,
    info: &Topic,
    images: &Topic,
) -> Result<PinholeRadialTangential, RecordingError> {
    let failed =
        |source| RecordingError::Camera { path: path.to_owned(), topic: info.name.clone(), source };
    let Some(first) = info.messages.first() else {
        return Err(failed(MessageError::Short { field: "the topic", bytes: 0 }));
    };
    // image_pipeline calls the rectified image of `image_raw` so.
    let is_rectified = images.name.split('/').any(|part| part.starts_with("image_rect"));
    let message = CameraInfo::read(info.encoding(), files.read(first.place)?).map_err(failed)?;
    camera_info::camera(&message, is_rectified).map_err(failed)
}

/// Depth must be as if color's camera had taken it: where the sizes differ it is not, where the frames differ
/// the cameras must be the same.
fn check_registration(
    path: &Path,
    files: &mut Files,
    topics: &[Topic],
    [color, depth]: [&Topic; 2],
    notes: &mut Vec<Note>,
) -> Result<(), RecordingError> {
    if let (Some(color_size), Some(depth_size)) = (color.sample.size, depth.sample.size)
        && color_size != depth_size
    {
        return Err(RecordingError::Unregistered {
            path: path.to_owned(),
            color: color.name.clone(),
            depth: depth.name.clone(),
            color_size,
            depth_size,
        });
    }
    let frames = [color, depth].map(|topic| topic.sample.frame_id.clone());
    if frames[0] == frames[1] {
        return Ok(());
    }
    if depth.kind == Kind::PointCloud {
        let (path, cloud) = (path.to_owned(), depth.name.clone());
        let [camera, found] = frames;
        return Err(RecordingError::CloudElsewhere { path, cloud, found, camera });
    }
    let cameras = [color, depth].map(|images| {
        let info = topics::info_beside(topics, images)?;
        camera_of(path, files, info, images).ok()
    });
    if cameras[0].is_none() || cameras[0] != cameras[1] {
        let [color, depth] = frames;
        notes.push(Note::OtherFrame { color, depth });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
