//! A folder of the TUM RGB-D benchmark: `rgb.txt` and `depth.txt` list the images with their times.
//!
//! Color is PNG or JPEG, depth a 16-bit PNG with 5000 units a meter and 0 where none was measured.
//! A frame has the time of its color image; its depth image is the one nearest in time. Only the two
//! lists, what they name and `camera.txt` are opened.

use std::path::{Path, PathBuf};

use covis_solvers::geometry::PinholeRadialTangential;

use super::camera_file::{self, CameraOrigin, Fallback};
use super::error::{FrameError, InputError};
use super::list::Entry;
use super::pair::{DepthScale, PairReader};
use super::{FrameSource, SensorTiming, association, list};
use crate::image::RgbdFrame;

/// The list of color images.
pub const COLOR_LIST: &str = "rgb.txt";
/// The list of depth images.
pub const DEPTH_LIST: &str = "depth.txt";
/// Units of a depth image a meter.
pub const DEPTH_UNITS_PER_M: f32 = 5000.0;
/// Color and depth of one frame are less far apart than this, s.
pub const MAX_DIFFERENCE_S: f64 = 0.02;

/// The frames of one folder.
#[derive(Debug)]
pub struct TumFolder {
    camera: PinholeRadialTangential,
    camera_origin: CameraOrigin,
    timing: SensorTiming,
    color_list: PathBuf,
    without_depth: usize,
    /// Color and its depth, in the list's order.
    frames: Vec<(Entry, Entry)>,
    next: usize,
    /// The latest time that a frame had.
    latest_s: Option<f64>,
    reader: PairReader,
}

impl TumFolder {
    /// Reads the lists and the camera as [`super::open_folder`] does; images are read one by one.
    ///
    /// # Errors
    /// [`InputError`] where a list is missing or malformed or no two images belong together, and for
    /// the camera.
    pub fn open(folder: &Path, camera: Option<&str>) -> Result<Self, InputError> {
        if folder.is_dir() && !folder.join(COLOR_LIST).exists() {
            return Err(InputError::NotASequence { path: folder.to_owned() });
        }
        let color = list::read(folder, COLOR_LIST)?;
        let depth = list::read(folder, DEPTH_LIST)?;
        let partner = association::nearest_pairs(&color, &depth, MAX_DIFFERENCE_S);
        let colors = color.len();
        let paired = color.into_iter().zip(partner);
        let frames: Vec<_> = paired
            .filter_map(|(color, partner)| partner.map(|index| (color, depth[index].clone())))
            .collect();
        if frames.is_empty() {
            let max_difference_s = MAX_DIFFERENCE_S;
            return Err(InputError::NoFrames { path: folder.to_owned(), max_difference_s });
        }
        let choice = camera_file::choose(camera, folder, Fallback::FolderName)?;
        let scale = DepthScale { units_per_m: DEPTH_UNITS_PER_M, none: None };
        Ok(Self {
            camera: choice.camera,
            camera_origin: choice.origin,
            timing: SensorTiming::of_folder(folder, SensorTiming::KINECT)?,
            color_list: folder.join(COLOR_LIST),
            without_depth: colors - frames.len(),
            frames,
            next: 0,
            latest_s: None,
            reader: PairReader::new(scale),
        })
    }

    /// Where the camera came from.
    #[must_use]
    pub fn camera_origin(&self) -> &CameraOrigin {
        &self.camera_origin
    }

    /// How many color images have no depth image near them; they are no frames.
    #[must_use]
    pub fn without_depth(&self) -> usize {
        self.without_depth
    }
}

impl FrameSource for TumFolder {
    fn camera(&self) -> &PinholeRadialTangential {
        &self.camera
    }

    fn timing(&self) -> SensorTiming {
        self.timing
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>> {
        let (Entry { timestamp_s, path, line }, depth) = self.frames.get(self.next)?;
        self.next += 1;
        if let Some(previous_s) = self.latest_s.filter(|latest| timestamp_s <= latest) {
            return Some(Err(FrameError::OutOfOrder {
                path: self.color_list.clone(),
                line: *line,
                timestamp_s: *timestamp_s,
                previous_s,
            }));
        }
        self.latest_s = Some(*timestamp_s);
        let delay_s = depth.timestamp_s - timestamp_s;
        Some(self.reader.read(*timestamp_s, delay_s, path, &depth.path))
    }
}

#[cfg(test)]
mod tests;
