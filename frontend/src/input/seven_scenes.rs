//! A folder of 7-Scenes: `frame-000000.color.png` and `frame-000000.depth.png`, 30 frames a second.
//!
//! Depth is in millimeters with 65535 where none was measured. The poses that lie beside the images
//! are truth and stay closed.

use std::path::{Path, PathBuf};

use covis_solvers::geometry::PinholeRadialTangential;

use super::camera_file::{self, CameraOrigin, Fallback};
use super::error::{FrameError, InputError};
use super::pair::{DepthScale, PairReader};
use super::{FrameSource, SensorTiming};
use crate::image::RgbdFrame;

/// Frames a second.
const RATE_HZ: f64 = 30.0;
/// Units of a depth image a meter.
const DEPTH_UNITS_PER_M: f32 = 1000.0;
/// What stands in a depth image where none was measured, beside 0.
const NO_DEPTH: u16 = u16::MAX;

/// The camera that the data set's authors name for all scenes.
const CAMERA: [f64; 4] = [585.0, 585.0, 320.0, 240.0];

/// A Kinect's rows; its files are numbered and tell no times, so that depth goes with color.
const USUAL_TIMING: SensorTiming = SensorTiming { depth_late_s: 0.0, ..SensorTiming::KINECT };

/// The frames of one folder.
#[derive(Debug)]
pub struct SevenScenesFolder {
    folder: PathBuf,
    camera: PinholeRadialTangential,
    camera_origin: CameraOrigin,
    timing: SensorTiming,
    /// The numbers in the names, ascending.
    numbers: Vec<u32>,
    next: usize,
    reader: PairReader,
}

/// Whether a folder holds color images by this layout's names.
///
/// # Errors
/// [`InputError::Read`] where the folder cannot be listed.
pub fn is_one(folder: &Path) -> Result<bool, InputError> {
    Ok(!numbers(folder)?.is_empty())
}

impl SevenScenesFolder {
    /// Lists the frames and chooses the camera as [`super::open_folder`] does.
    ///
    /// # Errors
    /// [`InputError`] where the folder has no frames, and for the camera.
    pub fn open(folder: &Path, camera: Option<&str>) -> Result<Self, InputError> {
        let numbers = numbers(folder)?;
        if numbers.is_empty() {
            return Err(InputError::NotASequence { path: folder.to_owned() });
        }
        let [fx, fy, cx, cy] = CAMERA;
        let usual = PinholeRadialTangential::undistorted(fx, fy, cx, cy);
        let choice = camera_file::choose(camera, folder, Fallback::Layout(usual))?;
        let scale = DepthScale { units_per_m: DEPTH_UNITS_PER_M, none: Some(NO_DEPTH) };
        Ok(Self {
            folder: folder.to_owned(),
            camera: choice.camera,
            camera_origin: choice.origin,
            timing: SensorTiming::of_folder(folder, USUAL_TIMING)?,
            numbers,
            next: 0,
            reader: PairReader::new(scale),
        })
    }

    /// Where the camera came from.
    #[must_use]
    pub fn camera_origin(&self) -> &CameraOrigin {
        &self.camera_origin
    }
}

impl FrameSource for SevenScenesFolder {
    fn camera(&self) -> &PinholeRadialTangential {
        &self.camera
    }

    fn timing(&self) -> SensorTiming {
        self.timing
    }

    fn len(&self) -> usize {
        self.numbers.len()
    }

    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>> {
        let number = *self.numbers.get(self.next)?;
        self.next += 1;
        let file = |kind| self.folder.join(format!("frame-{number:06}.{kind}.png"));
        let (color, depth) = (file("color"), file("depth"));
        Some(self.reader.read(f64::from(number) / RATE_HZ, 0.0, &color, &depth))
    }
}

/// The numbers of the color images in a folder, ascending.
fn numbers(folder: &Path) -> Result<Vec<u32>, InputError> {
    let failed = |source| InputError::Read { path: folder.to_owned(), source };
    let mut numbers = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        numbers.extend(name.to_str().and_then(number));
    }
    numbers.sort_unstable();
    Ok(numbers)
}

/// The number in a color image's name, which has six digits.
fn number(name: &str) -> Option<u32> {
    let digits = name.strip_prefix("frame-")?.strip_suffix(".color.png")?;
    let six = digits.len() == 6 && digits.bytes().all(|byte| byte.is_ascii_digit());
    digits.parse().ok().filter(|_| six)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;
    use crate::input::{encode, open_folder};

    #[test]
    fn frames_come_by_number_in_millimeters() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: Vec<u8>| {
            fs_err::write(folder.path().join(name), bytes).unwrap();
        };
        let color = Image::filled(2, 1, [1, 2, 3]);
        let depth = Image::from_pixels(2, 1, vec![1500u16, NO_DEPTH]).unwrap();
        for number in [30, 3] {
            write(&format!("frame-{number:06}.color.png"), encode::rgb(&color).unwrap());
            write(&format!("frame-{number:06}.depth.png"), encode::gray16(&depth).unwrap());
        }
        write("frame-000004.color.png", encode::rgb(&color).unwrap());
        write("frame-5.color.png", Vec::new());
        write("frame-000006.pose.txt", Vec::new());

        let mut open = open_folder(folder.path(), None).unwrap();
        assert_eq!(open.camera_origin, CameraOrigin::Layout);
        assert_eq!((open.source.camera().fx, open.source.len()), (585.0, 3));
        let frame = open.source.next_frame().unwrap().unwrap();
        assert_eq!(frame.timestamp_s, 0.1);
        assert_eq!(frame.color, color);
        assert_eq!(frame.depth_m.pixels(), [1.5, 0.0]);
        let error = open.source.next_frame().unwrap().unwrap_err();
        assert!(matches!(&error, FrameError::Read { path, .. }
            if path.ends_with("frame-000004.depth.png")));
        assert_eq!(open.source.next_frame().unwrap().unwrap().timestamp_s, 1.0);
        assert!(open.source.next_frame().is_none());
        let given = open_folder(folder.path(), Some("500,501,1,2")).unwrap();
        assert_eq!(given.source.camera().fy, 501.0);
    }

    #[test]
    fn a_folder_of_neither_layout_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error = open_folder(folder.path(), None).err().unwrap();
        assert!(matches!(error, InputError::NotASequence { .. }), "{error}");
        let missing = folder.path().join("none");
        assert!(matches!(open_folder(&missing, None).err(), Some(InputError::Read { .. })));
    }
}
