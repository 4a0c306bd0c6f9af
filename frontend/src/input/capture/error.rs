//! What is wrong with a capture as a whole, or with one frame of it.
//!
//! Each variant names the file, and the frame or the field where there is one.

use std::fmt;
use std::path::PathBuf;

use super::MAX_FILE_BYTES;

/// The file of a capture that is meant, and the frame in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file.
    pub path: PathBuf,
    /// The frame, as the file names it; `None` for what holds for all frames.
    pub frame: Option<String>,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        self.frame.as_ref().map_or(Ok(()), |frame| write!(f, ", frame {frame}"))
    }
}

/// A capture, or a frame of it, that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CaptureError {
    /// The operating system refused to read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file is longer than any that is read.
    #[error("{}: is longer than {MAX_FILE_BYTES} bytes, the most that are read of a file", path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
    },
    /// The path has none of the layouts.
    #[error(
        "{}: no capture: neither transforms.json (nerfstudio), keyframes/images (Polycam) nor metadata \
         and rgbd (Record3D)",
        path.display()
    )]
    Layout {
        /// The folder or file.
        path: PathBuf,
    },
    /// The archive is no zip archive, or is cut off.
    #[error("{}: is not a zip archive that can be read: {problem}", path.display())]
    Archive {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// The file is not the JSON that the layout has.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// The field, line and column.
        source: serde_json::Error,
    },
    /// A number is out of its range.
    #[error("{place}: {field} is {value}, not {must}")]
    Number {
        /// The file and the frame.
        place: Place,
        /// The field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// A number is missing.
    #[error("{place}: {field} is missing, for the frame and for all frames")]
    Missing {
        /// The file and the frame.
        place: Place,
        /// The field.
        field: &'static str,
    },
    /// The lens is of a model that tracking does not know.
    #[error("{place}: the camera model is {found}; OPENCV and PINHOLE are read")]
    Model {
        /// The file and the frame.
        place: Place,
        /// The model.
        found: String,
    },
    /// A pose is no rigid motion.
    #[error(
        "{place}: {field} is no rigid motion: it must be a rotation and a translation in meters"
    )]
    Pose {
        /// The file and the frame.
        place: Place,
        /// The field.
        field: &'static str,
    },
    /// A file outside of the capture is named.
    #[error("{place}: the file is outside of the capture's folder")]
    Outside {
        /// The file, and the path that it names as the frame.
        place: Place,
    },
    /// The distortion differs from that of the first frame.
    #[error(
        "{place}: the distortion differs from the first frame's; one lens for all frames is read"
    )]
    OtherLens {
        /// The file and the frame.
        place: Place,
    },
    /// Depth does not show what color shows.
    #[error(
        "{}: depth of {}x{} pixels does not cover the color image of {}x{}: their shapes differ",
        path.display(), depth.0, depth.1, color.0, color.1
    )]
    Shape {
        /// The depth image.
        path: PathBuf,
        /// Its columns and rows.
        depth: (usize, usize),
        /// Those of the color image.
        color: (usize, usize),
    },
    /// The compressed depth of Record3D does not have the size that its metadata give.
    #[error("{}: not {expected} bytes of LZFSE: {problem}", path.display())]
    Lzfse {
        /// The file.
        path: PathBuf,
        /// Columns times rows times bytes a pixel.
        expected: usize,
        /// What was found.
        problem: String,
    },
    /// There are no images.
    #[error("{}: the capture has no images", path.display())]
    Empty {
        /// The file or folder.
        path: PathBuf,
    },
    /// No frame has depth.
    #[error("{}: none of {frames} images has depth ({wanted})", path.display())]
    NoDepth {
        /// The file or folder.
        path: PathBuf,
        /// How many images there are.
        frames: usize,
        /// What is missing.
        wanted: &'static str,
    },
}
