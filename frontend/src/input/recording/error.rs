//! What is wrong with a recording as a whole, or with one message of it.
//!
//! Each variant names the file with the byte or row, or the topic.

use std::fmt;
use std::path::PathBuf;

use super::topics::{Role, TopicSummary};
use crate::input::decode::{DecodeError, MAX_SIDE};

/// A recording that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The operating system refused to read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Whoever opened the recording ended the pass over it.
    #[error("{}: the pass over the recording was ended", path.display())]
    Ended {
        /// The recording.
        path: PathBuf,
    },
    /// The first bytes are of no format that is read.
    #[error("{}: neither an MCAP file nor a SQLite database", path.display())]
    Format {
        /// The file.
        path: PathBuf,
    },
    /// The file is a bag of ROS 1.
    #[error(
        "{}: a bag of ROS 1; `rosbags-convert --src {} --dst FOLDER` makes one of ROS 2 from it",
        path.display(),
        path.display()
    )]
    Ros1 {
        /// The file.
        path: PathBuf,
    },
    /// The folder holds no bag.
    #[error("{}: neither metadata.yaml nor .mcap or .db3 files are in this folder", path.display())]
    NotABag {
        /// The folder.
        path: PathBuf,
    },
    /// `metadata.yaml` names a file outside of its folder.
    #[error("{}: `{found}` leaves the folder", path.display())]
    Outside {
        /// The file `metadata.yaml`.
        path: PathBuf,
        /// What it names.
        found: String,
    },
    /// The bag is compressed in a way that cannot be read from any place.
    #[error(
        "{}: rosbag2 compressed this file or its messages as a whole: decompress it (`zstd -d`, \
         `ros2 bag convert`), or record with chunks that MCAP compresses",
        path.display()
    )]
    Compressed {
        /// The file.
        path: PathBuf,
    },
    /// This program does not read SQLite.
    #[error(
        "{}: this covis was built without SQLite: build it with the feature `sqlite`, or convert the \
         bag to MCAP (`ros2 bag convert`)",
        path.display()
    )]
    WithoutSqlite {
        /// The database.
        path: PathBuf,
    },
    /// SQLite cannot read the database, or a row of it.
    #[error("{}{}: {source}", path.display(), row.map(|r| format!(", row {r}")).unwrap_or_default())]
    Database {
        /// The database.
        path: PathBuf,
        /// The row of the table `messages`.
        row: Option<i64>,
        /// What SQLite said.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The database is not a bag.
    #[error("{}: the database has no table `{table}`, as bags have", path.display())]
    NoTable {
        /// The database.
        path: PathBuf,
        /// The table.
        table: &'static str,
    },
    /// A part of an MCAP file is damaged.
    #[error("{}: byte {offset}: {fault}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where the record begins.
        offset: u64,
        /// What is wrong.
        fault: Fault,
    },
    /// A message is longer than any image that is accepted.
    #[error("{}: a message of {bytes} bytes; at most {most} are read", path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
        /// The limit.
        most: u64,
    },
    /// No topic can have this role.
    #[error("{}: no topic for {role} ({}){}", path.display(), role.wanted(), List(topics))]
    NoTopic {
        /// The recording.
        path: PathBuf,
        /// What is missing.
        role: Role,
        /// All topics.
        topics: Vec<TopicSummary>,
    },
    /// Several topics fit equally well.
    #[error("{}: several topics for {role}; {} names one{}", path.display(), role.option(), List(candidates))]
    Ambiguous {
        /// The recording.
        path: PathBuf,
        /// What they could be.
        role: Role,
        /// Those that fit.
        candidates: Vec<TopicSummary>,
    },
    /// The caller names a topic that is not there, or cannot have this role.
    #[error("{}: `{named}` is not a topic for {role} ({}){}", path.display(), role.wanted(), List(topics))]
    NotThisTopic {
        /// The recording.
        path: PathBuf,
        /// The name.
        named: String,
        /// What it was to be.
        role: Role,
        /// All topics.
        topics: Vec<TopicSummary>,
    },
    /// Color and depth have different sizes: depth is not registered to color.
    #[error(
        "{}: depth of {depth} has {}x{} pixels, color of {color} {}x{}: depth must be registered to \
         color (align_depth, depth_registered)",
        path.display(), depth_size.0, depth_size.1, color_size.0, color_size.1
    )]
    Unregistered {
        /// The recording.
        path: PathBuf,
        /// Its topic of color.
        color: String,
        /// Its topic of depth.
        depth: String,
        /// Columns and rows.
        color_size: (usize, usize),
        /// Columns and rows.
        depth_size: (usize, usize),
    },
    /// No color image has a depth image near it in time.
    #[error(
        "{}: no image of {color} has one of {depth} within {max_difference_s} s",
        path.display()
    )]
    NoFrames {
        /// The recording.
        path: PathBuf,
        /// The topic of color.
        color: String,
        /// The topic of depth.
        depth: String,
        /// How far apart two images of one frame may be.
        max_difference_s: f64,
    },
    /// The camera of a recording cannot be used; a camera that the caller gives replaces it.
    #[error("{}: {topic}: {source}; --camera gives another camera", path.display())]
    Camera {
        /// The recording.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Why.
        source: MessageError,
    },
    /// A message that the whole recording depends on cannot be read.
    #[error("{}: {topic}: {source}", path.display())]
    Message {
        /// The recording.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Why.
        source: MessageError,
    },
    /// The points of a cloud are in another frame than the color camera's, in which z is depth.
    #[error(
        "{}: the points of {cloud} are in frame `{found}`, color is in frame `{camera}`: z is depth only in \
         the color camera's frame",
        path.display()
    )]
    CloudElsewhere {
        /// The recording.
        path: PathBuf,
        /// The topic.
        cloud: String,
        /// Its frame.
        found: String,
        /// That of color.
        camera: String,
    },
    /// Odometry is of a body that no chain of static transforms joins with the camera.
    #[error(
        "{}: odometry is of frame `{body}`, color is in frame `{camera}`, and no static transforms \
         (tf2_msgs/msg/TFMessage on tf_static) join them; frames of these transforms: {}",
        path.display(),
        if frames.is_empty() { "none".to_owned() } else { frames.join(", ") }
    )]
    NoTransform {
        /// The recording.
        path: PathBuf,
        /// The frame of the body.
        body: String,
        /// That of the color images.
        camera: String,
        /// All frames that the static transforms name.
        frames: Vec<String>,
    },
    /// A topic has fewer than two poses.
    #[error("{}: {topic} has fewer than two poses that can be read; odometry needs two", path.display())]
    NoOdometry {
        /// The recording.
        path: PathBuf,
        /// The topic.
        topic: String,
    },
    /// Odometry was recorded at other times than images, or by another clock.
    #[error("{}: {topic} has no pose at the time of any image of {color}", path.display())]
    OdometryElsewhere {
        /// The recording.
        path: PathBuf,
        /// The topic of odometry.
        topic: String,
        /// That of color.
        color: String,
    },
}

/// What is wrong with a record of an MCAP file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// A record ends before its fields do.
    #[error("a record of kind {opcode:#04x} is malformed")]
    Record {
        /// Its first byte.
        opcode: u8,
    },
    /// The checksum of a chunk is another one.
    #[error("the checksum of the chunk is wrong")]
    Checksum,
    /// The chunk is compressed by something else.
    #[error("the compression `{name}` is not read, but zstd and lz4 are")]
    Compression {
        /// Its name.
        name: String,
    },
    /// The chunk cannot be decompressed.
    #[error("the chunk cannot be decompressed: {0}")]
    Decompress(std::io::Error),
    /// The chunk is not as long as its header says.
    #[error("the chunk has another length than its header says")]
    Length,
    /// A chunk is too large.
    #[error("a chunk of {bytes} bytes; at most {most} are read")]
    TooLarge {
        /// Its length.
        bytes: u64,
        /// The limit.
        most: u64,
    },
}

/// A message that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MessageError {
    /// The message ends before a field does.
    #[error("the message ends within {field}, after {bytes} bytes")]
    Short {
        /// The field.
        field: &'static str,
        /// How long it is.
        bytes: usize,
    },
    /// The message is no plain CDR.
    #[error("the encoding {found:#06x} is not plain CDR")]
    Encapsulation {
        /// What the header says.
        found: u16,
    },
    /// The message is no protobuf.
    #[error("no field of protobuf begins or ends before byte {at}")]
    Protobuf {
        /// Where that is seen.
        at: usize,
    },
    /// A text is not UTF-8.
    #[error("{field}: {source}")]
    Text {
        /// The field.
        field: &'static str,
        /// Where it is not.
        source: std::str::Utf8Error,
    },
    /// A sequence is too long.
    #[error("{field} has {found} numbers; at most {most} are read")]
    TooMany {
        /// The field.
        field: &'static str,
        /// How many there are.
        found: usize,
        /// The limit.
        most: usize,
    },
    /// The pixels of an image have an encoding that is not read.
    #[error("the encoding `{found}` is not read, but {known} are")]
    Encoding {
        /// The encoding.
        found: String,
        /// Those that are.
        known: &'static str,
    },
    /// The image has no pixels or too many a side.
    #[error("{width}x{height} pixels, and each side must have 1 to {MAX_SIDE}")]
    Side {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The points of a cloud have no such field, or it is no 32-bit float within a point.
    #[error("the points have no field `{field}` of type FLOAT32 within their {point_step} bytes")]
    NoField {
        /// The field.
        field: &'static str,
        /// Bytes a point.
        point_step: u32,
    },
    /// The rows of an image do not hold its pixels.
    #[error("{bytes} bytes in rows of {step} cannot hold {width}x{height} pixels of `{encoding}`")]
    Rows {
        /// How many there are.
        bytes: usize,
        /// Bytes a row.
        step: u32,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// What a pixel is.
        encoding: String,
    },
    /// A compressed image cannot be decoded.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// The image and those before, or color and depth, have different sizes.
    #[error("{}x{} pixels, not {}x{}", found.0, found.1, expected.0, expected.1)]
    Size {
        /// Columns and rows.
        found: (usize, usize),
        /// Those of the color image, or of the first frame.
        expected: (usize, usize),
    },
    /// A lens that is not modeled.
    #[error(
        "the distortion model `{found}` is not supported: plumb_bob is, and rational_polynomial whose \
         k4, k5 and k6 are 0"
    )]
    Distortion {
        /// The model.
        found: String,
    },
    /// A number of a camera cannot be one.
    #[error("{field} is {value}, which no calibrated camera has")]
    Calibration {
        /// Which number.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// A number of a pose cannot be one.
    #[error("{field} is {value}, which no pose has")]
    Pose {
        /// Which number.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// The image is a part of the sensor or is binned, and the intrinsics are those of the whole.
    #[error("the camera's image is binned or a part of the sensor's (roi), which is not supported")]
    Binned,
}

/// Topics in one line, as errors are.
struct List<'a>(&'a [TopicSummary]);

impl fmt::Display for List<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            return write!(f, "; there are no topics");
        }
        let topics: Vec<String> = self.0.iter().map(ToString::to_string).collect();
        write!(f, "; topics: {}", topics.join("; "))
    }
}
