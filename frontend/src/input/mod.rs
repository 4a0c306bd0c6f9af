//! Where frames come from: recorded folders, recordings of ROS 2, and whatever else is a [`FrameSource`].
//!
//! A source opens or fails as a whole ([`InputError`]); afterwards each frame is read or reported on
//! its own ([`FrameError`]), and the next one follows. Nothing here opens the truth that lies beside
//! a sequence (`groundtruth.txt`, `mask.txt`, `mask/`, poses of 7-Scenes).
//!
//! | file | role |
//! |---|---|
//! | `folder`, `tum`, `seven_scenes` | a recorded folder, and its layouts |
//! | [`capture`] | captures of phones: nerfstudio, Polycam, Record3D |
//! | [`recording`] | MCAP files and rosbag2 folders |
//! | [`without_depth`] | folders of EuRoC and KITTI, which are no source |
//! | `list`, `association`, `timing` | lists of timed files, pairs in time, times of rows and depth |
//! | `pair`, `decode`, `encode` | one frame from its files; PNG and JPEG |
//! | `camera_file` | intrinsics of a folder |
//! | `error` | what is wrong with a source, or with one frame |

mod association;
pub mod camera_file;
pub mod capture;
pub mod decode;
pub mod encode;
mod error;
mod folder;
#[cfg(any(test, feature = "fuzzing"))]
pub mod fuzzing;
mod list;
mod pair;
pub mod recording;
pub mod seven_scenes;
mod timing;
pub mod tum;
pub mod without_depth;

use std::path::Path;

use covis_solvers::geometry::PinholeRadialTangential;

pub use camera_file::CameraOrigin;
pub use decode::DecodeError;
pub use error::{FrameError, InputError};
pub use folder::ImplausibleDepth;
pub use timing::SensorTiming;

use crate::image::RgbdFrame;
use folder::{Opened, RecordedFolder};

/// Frames in the order of their time, one camera for all of them.
pub trait FrameSource: Send {
    /// The camera of color and depth, px.
    fn camera(&self) -> &PinholeRadialTangential;

    /// When its rows and its depth are taken.
    fn timing(&self) -> SensorTiming;

    /// Whether [`RgbdFrame::given_pose`] is odometry, which goes to the server as a measurement. Otherwise it
    /// is a start for tracking and nothing else.
    fn has_odometry(&self) -> bool {
        false
    }

    /// How many times [`FrameSource::next_frame`] answers in all, frames and errors together.
    fn len(&self) -> usize;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The next frame, `None` after the last.
    ///
    /// # Errors
    /// What is wrong with this one frame; the source continues with the next one. Timestamps of the frames
    /// that are delivered increase, and all of them have one size.
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>>;
}

/// What a caller knows better than a folder.
#[derive(Clone, Copy, Debug, Default)]
pub struct FolderOptions<'a> {
    /// Intrinsics: what [`camera_file::parse_argument`] reads.
    pub camera: Option<&'a str>,
    /// Units of a depth image a meter, more than 0.
    pub depth_units_per_m: Option<f32>,
}

/// A recorded folder, opened.
pub struct OpenFolder {
    /// Its frames.
    pub source: Box<dyn FrameSource>,
    /// Where the camera came from. The command line warns where it was assumed.
    pub camera_origin: CameraOrigin,
    /// Color images that no depth image is near enough in time; they are no frames.
    pub without_depth: usize,
    /// Set where no depth scale was given and the layout's does not fit the first depth images.
    pub implausible_depth: Option<ImplausibleDepth>,
}

/// Opens a folder of the TUM RGB-D layout, or of 7-Scenes where it has no `rgb.txt` but frames by
/// that layout's names. Where no camera is given, that of the folder's `camera.txt` holds, else what
/// the layout or the folder's name tells, else TUM's fr1. Where no depth scale is given, the layout's
/// holds: 5000 units a meter for TUM, 1000 for 7-Scenes.
///
/// # Errors
/// [`InputError`] where the folder, a list in it, the camera or the depth scale cannot be used.
pub fn open_folder(folder: &Path, options: FolderOptions<'_>) -> Result<OpenFolder, InputError> {
    if let Some(found) = without_depth::WithoutDepth::of(folder) {
        return Err(found.error(folder));
    }
    let numbered =
        if folder.join(tum::COLOR_LIST).exists() { None } else { seven_scenes::listing(folder)? };
    let listing = numbered.map_or_else(|| tum::listing(folder), Ok)?;
    let without_depth = listing.without_depth;
    let Opened { folder, camera_origin, implausible_depth } =
        RecordedFolder::open(folder, listing, options)?;
    let source = Box::new(folder);
    Ok(OpenFolder { source, camera_origin, without_depth, implausible_depth })
}
