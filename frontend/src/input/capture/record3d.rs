//! A recording of Record3D, an unpacked `.r3d` file: `metadata` (JSON), and in `rgbd` `N.jpg`, `N.depth`
//! and `N.conf`.
//!
//! Depth is a float a pixel in meters, confidence a byte, both compressed with LZFSE and at a resolution
//! of their own. Poses are world_from_camera of an OpenGL camera, quaternion (x, y, z, w) first.

use std::path::Path;

use covis_solvers::geometry::So3;
use serde::Deserialize;

use super::container::Container;
use super::error::{CaptureError, Place};
use super::numbers::{self, Given};
use super::{Capture, CapturedFrame, Depth, parsed};

/// What makes a folder a recording of Record3D.
pub(super) const METADATA: &str = "metadata";
pub(super) const IMAGES: &str = "rgbd";

const NAMES: [&str; 6] = ["K[0]", "K[4]", "K[6]", "K[7]", "w", "h"];
const NAMES_OF_FRAME: [&str; 6] = [
    "perFrameIntrinsicCoeffs[0]",
    "perFrameIntrinsicCoeffs[1]",
    "perFrameIntrinsicCoeffs[2]",
    "perFrameIntrinsicCoeffs[3]",
    "w",
    "h",
];
/// No recording is longer, and no clock later, s.
const MOST_S: f64 = 1e10;

/// The file `metadata`; what is not needed is left out.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Metadata {
    w: f64,
    h: f64,
    dw: f64,
    dh: f64,
    fps: Option<f64>,
    /// Column by column.
    #[serde(rename = "K")]
    k: [f64; 9],
    #[serde(default)]
    poses: Vec<[f64; 7]>,
    #[serde(default)]
    frame_timestamps: Vec<f64>,
    /// fx, fy, cx and cy of each frame, in later versions.
    #[serde(default)]
    per_frame_intrinsic_coeffs: Vec<Vec<f64>>,
}

impl Metadata {
    /// Parses the file.
    pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Self, CaptureError> {
        parsed(bytes, path)
    }

    /// The size of depth, columns and rows.
    pub(super) fn depth_size(&self, path: &Path) -> Result<(usize, usize), CaptureError> {
        let place = || Place { path: path.to_owned(), frame: None };
        let size = [self.dw, self.dh];
        let given = Given { pinhole: [1.0, 1.0, 0.0, 0.0], size, ..Given::default() };
        Ok(given.lens(["", "", "", "", "dw", "dh"], place)?.size)
    }

    /// Frame `number`, as a frame without files.
    pub(super) fn frame(&self, number: usize, path: &Path) -> Result<CapturedFrame, CaptureError> {
        let place = || Place { path: path.to_owned(), frame: Some(number.to_string()) };
        let [fx, _, _, _, fy, _, cx, cy, _] = self.k;
        let own = self.per_frame_intrinsic_coeffs.get(number).map(Vec::as_slice);
        let (pinhole, names) = match own {
            Some(&[fx, fy, cx, cy]) => ([fx, fy, cx, cy], NAMES_OF_FRAME),
            _ => ([fx, fy, cx, cy], NAMES),
        };
        let given = Given { pinhole, distortion: [0.0; 5], size: [self.w, self.h] };
        let (value, field) = match (self.frame_timestamps.get(number), self.fps) {
            (Some(&time), _) => (time, "frameTimestamps"),
            (None, Some(fps)) => (number as f64 / fps, "the number over fps"),
            (None, None) => {
                return Err(CaptureError::Missing { place: place(), field: "frameTimestamps" });
            }
        };
        if !(0.0..=MOST_S).contains(&value) {
            let must = "from 0 to 1e10 s";
            return Err(CaptureError::Number { place: place(), field, value, must });
        }
        let pose = self.poses.get(number).map(|&[x, y, z, w, tx, ty, tz]| {
            let bad = || CaptureError::Pose { place: place(), field: "poses" };
            let rotation = So3::from_quaternion_xyzw(x, y, z, w).ok_or_else(bad)?.matrix();
            let translation = [tx, ty, tz];
            let row =
                |i: usize| [rotation[(i, 0)], rotation[(i, 1)], rotation[(i, 2)], translation[i]];
            numbers::pose([0, 1, 2].map(row), "poses", place)
        });
        Ok(CapturedFrame {
            name: number.to_string(),
            timestamp_s: value,
            color: String::new(),
            depth: None,
            confidence: None,
            lens: given.lens(names, place)?,
            world_from_camera: pose.transpose()?,
        })
    }
}

/// Reads the metadata, and lists the images by number.
pub(super) fn read(mut container: Container) -> Result<Capture, CaptureError> {
    let path = container.path(METADATA);
    let metadata = Metadata::parse(&container.read(METADATA)?, &path)?;
    let size = metadata.depth_size(&path)?;
    let number = |name: String| name.strip_suffix(".jpg")?.parse::<usize>().ok();
    let mut numbers: Vec<usize> = container.names(IMAGES)?.into_iter().filter_map(number).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let frame = |number: usize| {
        let beside = |extension: &str| {
            let name = format!("{IMAGES}/{number}.{extension}");
            container.has(&name).then_some(name)
        };
        Ok(CapturedFrame {
            color: format!("{IMAGES}/{number}.jpg"),
            depth: beside("depth"),
            confidence: beside("conf"),
            ..metadata.frame(number, &path)?
        })
    };
    let frames = numbers.into_iter().map(frame).collect();
    Ok(Capture { container, path, frames, depth: Depth::Lzfse { size }, wanted: "rgbd/N.depth" })
}
