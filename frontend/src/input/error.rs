//! What is wrong with a source as a whole, and with one frame of it.
//!
//! Every variant carries the file, the line or the field; none is a bare message.

use std::path::PathBuf;

use super::capture::CaptureError;
use super::decode::DecodeError;
use super::recording::{MessageError, RecordingError};
use super::without_depth::DataSet;

/// A source that cannot be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// A comment of a camera file that tells when rows or depth are taken cannot be used.
    #[error("{}: line {line}: readout_s must be a number of seconds from 0 to 0.1, depth_late_s one from -0.1 to 0.1", path.display())]
    Timing {
        /// The file.
        path: PathBuf,
        /// The line.
        line: usize,
    },
    /// The operating system refused to read.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The folder has neither layout.
    #[error("{}: neither rgb.txt nor frame-000000.color.png (.jpg, .jpeg) is in this folder", path.display())]
    NotASequence {
        /// The folder.
        path: PathBuf,
    },
    /// The folder is of a data set whose cameras measure no depth.
    #[error(
        "{}: a folder of {layout} with {sensors}: it has no depth images, which tracking needs; stereo \
         and inertial measurements are not used yet",
        path.display()
    )]
    WithoutDepth {
        /// The folder.
        path: PathBuf,
        /// The data set.
        layout: DataSet,
        /// What the folder has.
        sensors: String,
        /// Whether a trajectory lies in it.
        has_truth: bool,
    },
    /// A list has no entries, or none of its color images has a depth image near it in time.
    #[error("{}: no color image has a depth image within {max_difference_s} s", path.display())]
    NoFrames {
        /// The folder.
        path: PathBuf,
        /// How far apart two images of one frame may be.
        max_difference_s: f64,
    },
    /// The depth scale is not a positive number.
    #[error("the depth scale is {value} units a meter, not a positive number")]
    DepthScale {
        /// As given, units a meter.
        value: f32,
    },
    /// A line of a list is not `timestamp path`.
    #[error("{}, line {line}: `{found}` is not a timestamp in seconds and a path", path.display())]
    Line {
        /// The list.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// What stands there.
        found: String,
    },
    /// A list names a file outside of its folder.
    #[error("{}, line {line}: `{found}` leaves the folder", path.display())]
    Outside {
        /// The list.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// The path that stands there.
        found: String,
    },
    /// A number of a camera is missing or not a number.
    #[error("camera {from}: {field} is `{found}`, not a finite number")]
    CameraNumber {
        /// The file or argument.
        from: String,
        /// Which number.
        field: &'static str,
        /// What stands there.
        found: String,
    },
    /// A camera does not have 4 or 9 numbers.
    #[error("camera {from}: {found} numbers, not 4 (fx fy cx cy) or 9 (and k1 k2 p1 p2 k3)")]
    CameraCount {
        /// The file or argument.
        from: String,
        /// How many there are.
        found: usize,
    },
    /// A recording cannot be used.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A capture cannot be used.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// A focal length is not positive.
    #[error("camera {from}: {field} is {value} px, which is not positive")]
    Focal {
        /// The file or argument.
        from: String,
        /// Which of the two.
        field: &'static str,
        /// Its value, px.
        value: f64,
    },
}

/// One frame that cannot be used; those behind it can.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// A file of the frame is missing or cannot be read.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file of the frame is not an image of the right kind.
    #[error("{}: {source}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// Why.
        source: DecodeError,
    },
    /// A message cannot be read from its file.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The frame of a capture cannot be used.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// A message of the frame cannot be used.
    #[error("{}: {topic} at {timestamp_s:.6} s: {source}", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// The message's time.
        timestamp_s: f64,
        /// Why.
        source: MessageError,
    },
    /// The frame's images, or this frame and those before, have different sizes.
    #[error("{}: {}x{} pixels, not {}x{}", path.display(), found.0, found.1, expected.0, expected.1)]
    Size {
        /// The image that differs.
        path: PathBuf,
        /// Its columns and rows.
        found: (usize, usize),
        /// Those of the color image, or of the first frame.
        expected: (usize, usize),
    },
    /// The frame's time does not come after that of the line before.
    #[error("{}, line {line}: timestamp {timestamp_s} s does not follow {previous_s} s", path.display())]
    OutOfOrder {
        /// The list.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// The time that stands there.
        timestamp_s: f64,
        /// The latest time before it.
        previous_s: f64,
    },
}
