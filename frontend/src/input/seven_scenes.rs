//! A folder of 7-Scenes: `frame-000000.color.png` and `frame-000000.depth.png`, 30 frames a second.
//!
//! Color may also be `.color.jpg` or `.color.jpeg`. Depth is in millimeters, unless the caller says
//! otherwise, with 65535 where none was measured. The poses that lie beside the images are truth and
//! stay closed; [`files`] lists them for those who compare with it.

use std::path::{Path, PathBuf};

use covis_solvers::geometry::PinholeRadialTangential;

use super::SensorTiming;
use super::camera_file::Fallback;
use super::error::InputError;
use super::folder::{FrameFiles, Listing};
use super::pair::DepthScale;

/// Frames a second.
const RATE_HZ: f64 = 30.0;
/// Units of a depth image a meter.
const DEPTH_UNITS_PER_M: f32 = 1000.0;
/// What stands in a depth image where none was measured, beside 0.
const NO_DEPTH: u16 = u16::MAX;

/// How color images are named after their number. Where a frame has several, the first is read.
const COLOR: [&str; 3] = ["color.png", "color.jpg", "color.jpeg"];

/// How the files of the true poses are named after their number: 4x4 matrices,
/// `world_from_camera`, row by row.
pub const POSE: &str = "pose.txt";

/// The camera that the data set's authors name for all scenes.
const CAMERA: [f64; 4] = [585.0, 585.0, 320.0, 240.0];

/// A Kinect's rows; its files are numbered and tell no times, so that depth goes with color.
const USUAL_TIMING: SensorTiming = SensorTiming { depth_late_s: 0.0, ..SensorTiming::KINECT };

/// A file of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberedFile {
    /// The frame's time: its number over 30 frames a second, s.
    pub timestamp_s: f64,
    /// The file, the folder included.
    pub path: PathBuf,
    /// The number in its name.
    number: u32,
}

/// The files `frame-NNNNNN.KIND` in a folder by number, one of each number: that of the first of
/// `kinds`, for instance [`POSE`].
///
/// # Errors
/// [`InputError::Read`] where the folder cannot be listed.
pub fn files(folder: &Path, kinds: &[&str]) -> Result<Vec<NumberedFile>, InputError> {
    let failed = |source| InputError::Read { path: folder.to_owned(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        found.extend(name.to_str().and_then(|name| number_and_kind(name, kinds)));
    }
    found.sort_unstable();
    found.dedup_by_key(|&mut (number, _)| number);
    let file = |(number, kind): (u32, usize)| NumberedFile {
        timestamp_s: f64::from(number) / RATE_HZ,
        path: path(folder, number, kinds[kind]),
        number,
    };
    Ok(found.into_iter().map(file).collect())
}

fn path(folder: &Path, number: u32, kind: &str) -> PathBuf {
    folder.join(format!("frame-{number:06}.{kind}"))
}

/// The number in a name, which has six digits, and which of the kinds it is.
fn number_and_kind(name: &str, kinds: &[&str]) -> Option<(u32, usize)> {
    let (digits, kind) = name.strip_prefix("frame-")?.split_once('.')?;
    let kind = kinds.iter().position(|&known| known == kind)?;
    let six = digits.len() == 6 && digits.bytes().all(|byte| byte.is_ascii_digit());
    digits.parse().ok().filter(|_| six).map(|number| (number, kind))
}

/// Lists the frames; `None` where the folder holds no color images by this layout's names. Fails
/// where the folder cannot be listed.
pub(super) fn listing(folder: &Path) -> Result<Option<Listing>, InputError> {
    let color = files(folder, &COLOR)?;
    if color.is_empty() {
        return Ok(None);
    }
    let frame = |color: NumberedFile| FrameFiles {
        timestamp_s: color.timestamp_s,
        depth_delay_s: 0.0,
        color: color.path,
        depth: path(folder, color.number, "depth.png"),
        line: 1,
    };
    let [fx, fy, cx, cy] = CAMERA;
    let camera = PinholeRadialTangential::undistorted(fx, fy, cx, cy);
    Ok(Some(Listing {
        frames: color.into_iter().map(frame).collect(),
        list: folder.to_owned(),
        without_depth: 0,
        scale: DepthScale { units_per_m: DEPTH_UNITS_PER_M, none: Some(NO_DEPTH) },
        usual_timing: USUAL_TIMING,
        usual_camera: Fallback::Layout(camera),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;
    use crate::input::{CameraOrigin, FolderOptions, FrameError, encode, open_folder};

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

        let mut open = open_folder(folder.path(), FolderOptions::default()).unwrap();
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
        let options = FolderOptions { camera: Some("500,501,1,2"), ..FolderOptions::default() };
        let given = open_folder(folder.path(), options).unwrap();
        assert_eq!(given.source.camera().fy, 501.0);
    }

    #[test]
    fn color_may_be_jpeg_and_a_frame_is_read_once() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| {
            fs_err::write(folder.path().join(name), bytes).unwrap();
        };
        let jpeg = include_bytes!("decode/tests/orange.jpg");
        let size = crate::input::decode::color(jpeg).unwrap().size();
        let png = |color| encode::rgb(&Image::filled(size.0, size.1, color)).unwrap();
        let depth = encode::gray16(&Image::filled(size.0, size.1, 2000)).unwrap();
        for number in 0..4 {
            write(&format!("frame-{number:06}.depth.png"), &depth);
        }
        write("frame-000000.color.jpg", jpeg);
        write("frame-000001.color.jpeg", jpeg);
        write("frame-000002.color.jpg", jpeg);
        write("frame-000002.color.png", &png([1, 2, 3]));
        write("frame-000003.color.gif", jpeg);
        write("frame-000003.color.jpg.bak", jpeg);

        let mut source = open_folder(folder.path(), FolderOptions::default()).unwrap().source;
        assert_eq!(source.len(), 3, "no GIF, no backup, and the second frame once");
        let frames: Vec<_> = (0..3).map(|_| source.next_frame().unwrap().unwrap()).collect();
        let [r, g, b] = frames[0].color.at(0, 0);
        assert!(r > 200 && g > 60 && b < 100, "orange: {r} {g} {b}");
        assert_eq!(frames[1].color, frames[0].color);
        assert_eq!(frames[2].color.at(0, 0), [1, 2, 3], "PNG goes before JPEG");
        assert_eq!(frames[2].timestamp_s, 2.0 / 30.0);
        assert_eq!(frames[0].depth_m.at(0, 0), 2.0);
    }

    #[test]
    fn a_folder_of_neither_layout_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error = open_folder(folder.path(), FolderOptions::default()).err().unwrap();
        assert!(matches!(error, InputError::NotASequence { .. }), "{error}");
        let missing = folder.path().join("none");
        assert!(matches!(
            open_folder(&missing, FolderOptions::default()).err(),
            Some(InputError::Read { .. })
        ));
    }
}
