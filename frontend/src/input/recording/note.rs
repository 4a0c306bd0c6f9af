//! What the caller should know of a recording that can be used: cuts, damage, and messages that are left out.
//!
//! Each variant names the file or the topic. What cannot be used is an [`error`](super::error).

use std::fmt;
use std::path::PathBuf;

use super::error::RecordingError;

/// What the caller should know of a recording that is read nevertheless.
#[derive(Debug)]
#[non_exhaustive]
pub enum Note {
    /// The file has no end: whoever recorded it was killed, or it was copied in part.
    Cut {
        /// The file.
        path: PathBuf,
        /// Where what can be read ends.
        offset: u64,
    },
    /// A part is skipped.
    Damaged(RecordingError),
    /// More parts than are listed are skipped.
    MoreDamage {
        /// How many.
        parts: u64,
    },
    /// The folder has no `metadata.yaml`, as where its recorder was killed.
    WithoutMetadata {
        /// The folder.
        path: PathBuf,
    },
    /// A topic has more images than are listed; the later ones are not read.
    TooMany {
        /// The topic.
        topic: String,
        /// The limit.
        most: usize,
    },
    /// Images of one topic have the same timestamp; the first of them is used.
    Repeated {
        /// The topic.
        topic: String,
        /// How many are not used.
        messages: usize,
    },
    /// Color images that no depth image is near enough in time; they are no frames.
    WithoutDepth {
        /// How many.
        images: usize,
    },
    /// Color and depth are in different frames, and nothing says that their cameras are the same.
    OtherFrame {
        /// That of color.
        color: String,
        /// That of depth.
        depth: String,
    },
    /// Messages of odometry that cannot be used.
    NoPoses {
        /// The topic.
        topic: String,
        /// How many.
        messages: usize,
    },
    /// Color images at whose time odometry has no pose.
    WithoutOdometry {
        /// The topic of odometry.
        topic: String,
        /// How many.
        images: usize,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cut { path, offset } => write!(
                f,
                "{}: the recording has no end; it is read up to byte {offset}",
                path.display()
            ),
            Self::Damaged(error) => write!(f, "{error}; this part is skipped"),
            Self::MoreDamage { parts } => write!(f, "{parts} more damaged parts are skipped"),
            Self::WithoutMetadata { path } => write!(
                f,
                "{}: no metadata.yaml; the files are read in the order of their names",
                path.display()
            ),
            Self::TooMany { topic, most } => {
                write!(f, "{topic}: more than {most} images; the later ones are not read")
            }
            Self::Repeated { topic, messages } => {
                write!(f, "{topic}: {messages} images have the timestamp of another one; not used")
            }
            Self::WithoutDepth { images } => {
                write!(f, "{images} color images have no depth image close in time")
            }
            Self::OtherFrame { color, depth } => write!(
                f,
                "color is in frame `{color}` and depth in `{depth}`: depth must be registered to color, \
                 else the map will be wrong"
            ),
            Self::NoPoses { topic, messages } => write!(
                f,
                "{topic}: {messages} messages are no poses, are of another body than the first, or repeat \
                 a time; not used"
            ),
            Self::WithoutOdometry { topic, images } => {
                write!(f, "{topic} has no pose at the time of {images} images")
            }
        }
    }
}
