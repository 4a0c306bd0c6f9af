//! A recorded folder as a source of frames, whatever its layout: `tum` and `seven_scenes` list the
//! files, this reads them one frame after the other.
//!
//! Also judges whether the usual depth scale of a layout fits the recording. Opens the camera file
//! and the images that the listing names, and nothing else.

use std::fmt;
use std::path::{Path, PathBuf};

use covis_solvers::geometry::PinholeRadialTangential;

use super::camera_file::{self, CameraOrigin, Fallback};
use super::error::{FrameError, InputError};
use super::pair::{DepthScale, PairReader, depth_values};
use super::{FolderOptions, FrameSource, SensorTiming};
use crate::image::RgbdFrame;

/// Depth images that are looked at for the depth scale.
pub(super) const SCALE_IMAGES: usize = 5;
/// RGB-D cameras measure nothing nearer than 0.3 to 0.5 m. A recording of which a tenth is nearer
/// than this has another scale: millimeters that are read as 5000 units a meter bring the first
/// 1.75 m in front of the camera below it.
const LEAST_NEAR_M: f32 = 0.35;
/// A camera that is carried through a room sees more than what is at arm's length. A recording of
/// which nine tenths are nearer than this has another scale: as above, with walls up to 5 m away.
const LEAST_FAR_M: f32 = 1.0;
/// They measure little beyond 8 m. A recording of which a tenth is farther than this has another
/// scale: 5000 units a meter that are read as millimeters bring all beyond 2 m above it.
const MOST_FAR_M: f32 = 10.0;

/// The files of one frame.
#[derive(Clone, Debug)]
pub(super) struct FrameFiles {
    /// That of the color image, s.
    pub(super) timestamp_s: f64,
    /// How much later the depth image's timestamp is, s.
    pub(super) depth_delay_s: f64,
    pub(super) color: PathBuf,
    pub(super) depth: PathBuf,
    /// Where the color image is listed, from 1.
    pub(super) line: usize,
}

/// What a layout knows of a folder.
#[derive(Debug)]
pub(super) struct Listing {
    /// In the order of the list.
    pub(super) frames: Vec<FrameFiles>,
    /// What is named where a timestamp is out of order.
    pub(super) list: PathBuf,
    /// Color images that no depth image is near enough in time.
    pub(super) without_depth: usize,
    /// The layout's.
    pub(super) scale: DepthScale,
    /// What holds where the camera file says nothing.
    pub(super) usual_timing: SensorTiming,
    /// What holds where there is no camera file.
    pub(super) usual_camera: Fallback,
}

/// The frames of one folder.
#[derive(Debug)]
pub(super) struct RecordedFolder {
    camera: PinholeRadialTangential,
    timing: SensorTiming,
    list: PathBuf,
    frames: Vec<FrameFiles>,
    next: usize,
    /// The latest time that a frame had.
    latest_s: Option<f64>,
    reader: PairReader,
}

/// Why the usual depth scale of a layout does not seem to be a recording's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImplausibleDepth {
    /// The scale, units a meter.
    pub units_per_m: f32,
    /// A tenth of the measured depth is nearer, m.
    pub near_m: f32,
    /// A tenth of the measured depth is farther, m.
    pub far_m: f32,
}

impl ImplausibleDepth {
    /// What the values of a few depth images say, where they are implausible.
    pub(super) fn of(mut values: Vec<u16>, units_per_m: f32) -> Option<Self> {
        values.sort_unstable();
        let last = values.len().checked_sub(1)?;
        let meters = |index: usize| f32::from(values[index]) / units_per_m;
        let (near_m, far_m) = (meters(last / 10), meters(last - last / 10));
        let fits = near_m >= LEAST_NEAR_M && (LEAST_FAR_M..=MOST_FAR_M).contains(&far_m);
        (!fits).then_some(Self { units_per_m, near_m, far_m })
    }
}

impl fmt::Display for ImplausibleDepth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { units_per_m, near_m, far_m } = self;
        write!(f, "at {units_per_m} units a meter ")?;
        if *near_m < LEAST_NEAR_M {
            write!(f, "a tenth of the measured depth is nearer than {near_m:.2} m")
        } else if *far_m < LEAST_FAR_M {
            write!(f, "nine tenths of the measured depth are nearer than {far_m:.2} m")
        } else {
            write!(f, "a tenth of the measured depth is farther than {far_m:.1} m")
        }
    }
}

/// A folder, and what the caller should know of it.
pub(super) struct Opened {
    pub(super) folder: RecordedFolder,
    pub(super) camera_origin: CameraOrigin,
    pub(super) implausible_depth: Option<ImplausibleDepth>,
}

impl RecordedFolder {
    /// Chooses camera, timing and depth scale; images are read one by one.
    pub(super) fn open(
        folder: &Path,
        listing: Listing,
        options: FolderOptions<'_>,
    ) -> Result<Opened, InputError> {
        let choice = camera_file::choose(options.camera, folder, listing.usual_camera)?;
        let mut scale = listing.scale;
        let mut implausible_depth = None;
        match options.depth_units_per_m {
            Some(units) if units.is_finite() && units > 0.0 => scale.units_per_m = units,
            Some(value) => return Err(InputError::DepthScale { value }),
            None => {
                let values = first_values(&listing.frames, scale);
                implausible_depth = ImplausibleDepth::of(values, scale.units_per_m);
            }
        }
        let folder = Self {
            camera: choice.camera,
            timing: SensorTiming::of_folder(folder, listing.usual_timing)?,
            list: listing.list,
            frames: listing.frames,
            next: 0,
            latest_s: None,
            reader: PairReader::new(scale),
        };
        Ok(Opened { folder, camera_origin: choice.origin, implausible_depth })
    }
}

/// All that was measured in the first depth images that can be read.
fn first_values(frames: &[FrameFiles], scale: DepthScale) -> Vec<u16> {
    let images = frames.iter().filter_map(|frame| depth_values(&frame.depth).ok());
    let mut values = Vec::new();
    for image in images.take(SCALE_IMAGES) {
        // The largest number stands for "none" in many recordings.
        let measured = |v: &u16| ![0, u16::MAX].contains(v) && Some(*v) != scale.none;
        values.extend(image.pixels().iter().copied().filter(measured));
    }
    values
}

impl FrameSource for RecordedFolder {
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
        let FrameFiles { timestamp_s, depth_delay_s, color, depth, line } =
            self.frames.get(self.next)?;
        self.next += 1;
        if let Some(previous_s) = self.latest_s.filter(|latest| timestamp_s <= latest) {
            return Some(Err(FrameError::OutOfOrder {
                path: self.list.clone(),
                line: *line,
                timestamp_s: *timestamp_s,
                previous_s,
            }));
        }
        self.latest_s = Some(*timestamp_s);
        Some(self.reader.read(*timestamp_s, *depth_delay_s, color, depth))
    }
}
