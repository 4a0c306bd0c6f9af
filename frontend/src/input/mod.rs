//! Where frames come from: recorded folders, and whatever else is a [`FrameSource`].
//!
//! A source opens or fails as a whole ([`InputError`]); afterwards each frame is read or reported on
//! its own ([`FrameError`]), and the next one follows. Nothing here opens the truth that lies beside
//! a sequence (`groundtruth.txt`, `mask.txt`, `mask/`, poses of 7-Scenes).

mod association;
pub mod camera_file;
pub mod decode;
pub mod encode;
mod error;
#[cfg(any(test, feature = "fuzzing"))]
pub mod fuzzing;
mod list;
mod pair;
pub mod seven_scenes;
mod timing;
pub mod tum;

use std::path::Path;

use covis_solvers::geometry::PinholeRadialTangential;

pub use camera_file::CameraOrigin;
pub use decode::DecodeError;
pub use error::{FrameError, InputError};
pub use seven_scenes::SevenScenesFolder;
pub use timing::SensorTiming;
pub use tum::TumFolder;

use crate::image::RgbdFrame;

/// Frames in the order of their time, one camera for all of them.
pub trait FrameSource: Send {
    /// The camera of color and depth, px.
    fn camera(&self) -> &PinholeRadialTangential;

    /// When its rows and its depth are taken.
    fn timing(&self) -> SensorTiming;

    /// How many times [`FrameSource::next_frame`] answers in all, frames and errors together.
    fn len(&self) -> usize;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The next frame, `None` after the last.
    ///
    /// # Errors
    /// What is wrong with this one frame; the source goes on behind it. Timestamps of the frames
    /// that are delivered increase, and all of them have one size.
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>>;
}

/// A recorded folder, opened.
pub struct OpenFolder {
    /// Its frames.
    pub source: Box<dyn FrameSource>,
    /// Where the camera came from. The command line warns where it was assumed.
    pub camera_origin: CameraOrigin,
    /// Color images that no depth image is near enough in time; they are no frames.
    pub without_depth: usize,
}

/// Opens a folder of the TUM RGB-D layout, or of 7-Scenes where it has no `rgb.txt` but frames by
/// that layout's names. `camera` is what [`camera_file::parse_argument`] reads; without it holds the
/// folder's `camera.txt`, else what the layout or the folder's name tells, else TUM's fr1.
///
/// # Errors
/// [`InputError`] where the folder, a list in it or the camera cannot be used.
pub fn open_folder(folder: &Path, camera: Option<&str>) -> Result<OpenFolder, InputError> {
    if !folder.join(tum::COLOR_LIST).exists() && seven_scenes::is_one(folder)? {
        let folder = SevenScenesFolder::open(folder, camera)?;
        let camera_origin = folder.camera_origin().clone();
        return Ok(OpenFolder { source: Box::new(folder), camera_origin, without_depth: 0 });
    }
    let folder = TumFolder::open(folder, camera)?;
    let camera_origin = folder.camera_origin().clone();
    let without_depth = folder.without_depth();
    Ok(OpenFolder { source: Box::new(folder), camera_origin, without_depth })
}
