//! Raw data of Polycam: `keyframes/` with `images`, `depth`, `confidence`, `cameras` and
//! `corrected_cameras`.
//!
//! Files of one frame share a name, the microseconds since the phone started. Depth is in millimeters,
//! confidence 0 where the sensor is not sure. The lens is that of `cameras`; the pose that of
//! `corrected_cameras`, which Polycam optimized, where there are any. `corrected_images` are not read:
//! depth shows what `images` show, and their black rim would be a texture that moves with the camera.

use std::path::Path;

use serde::Deserialize;

use covis_solvers::io::natural_cmp;

use super::container::Container;
use super::error::{CaptureError, Place};
use super::numbers::{self, Given};
use super::{Capture, CapturedFrame, Depth, parsed};

/// The folders that make a capture.
pub(super) const IMAGES: &str = "keyframes/images";
const CAMERAS: &str = "keyframes/cameras";
const CORRECTED: &str = "keyframes/corrected_cameras";
const DEPTH: &str = "keyframes/depth";
const CONFIDENCE: &str = "keyframes/confidence";
/// How images are named after the frame.
const EXTENSIONS: [&str; 3] = ["jpg", "jpeg", "png"];
const UNITS_PER_M: f32 = 1000.0;
const MICROSECOND_S: f64 = 1e-6;
/// No phone runs longer, s: here a double still has microseconds.
const MOST_S: f64 = 1e9;

const NAMES: [&str; 6] = ["fx", "fy", "cx", "cy", "width", "height"];

/// A camera's file, with the pose row by row. It lists all fields: a flattened struct would keep what
/// is not read in memory.
#[derive(Debug, Deserialize)]
struct Camera {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    width: f64,
    height: f64,
    /// Microseconds.
    timestamp: f64,
    t_00: f64,
    t_01: f64,
    t_02: f64,
    t_03: f64,
    t_10: f64,
    t_11: f64,
    t_12: f64,
    t_13: f64,
    t_20: f64,
    t_21: f64,
    t_22: f64,
    t_23: f64,
}

impl Camera {
    fn rows(&self) -> [[f64; 4]; 3] {
        [
            [self.t_00, self.t_01, self.t_02, self.t_03],
            [self.t_10, self.t_11, self.t_12, self.t_13],
            [self.t_20, self.t_21, self.t_22, self.t_23],
        ]
    }
}

/// Parses a camera's file as a frame without files.
pub(super) fn frame(bytes: &[u8], path: &Path) -> Result<CapturedFrame, CaptureError> {
    let camera: Camera = parsed(bytes, path)?;
    let place = || Place { path: path.to_owned(), frame: None };
    let pose = numbers::pose(camera.rows(), "t_00 to t_23", place)?;
    let Camera { fx, fy, cx, cy, width, height, timestamp, .. } = camera;
    let given = Given { pinhole: [fx, fy, cx, cy], distortion: [0.0; 5], size: [width, height] };
    let timestamp_s = timestamp * MICROSECOND_S;
    if !(0.0..=MOST_S).contains(&timestamp_s) {
        let (field, must) = ("timestamp", "from 0 to 1e15 microseconds");
        return Err(CaptureError::Number { place: place(), field, value: timestamp, must });
    }
    Ok(CapturedFrame {
        name: String::new(),
        timestamp_s,
        color: String::new(),
        depth: None,
        confidence: None,
        lens: given.lens(NAMES, place)?,
        world_from_camera: Some(pose),
    })
}

/// Reads the cameras of all images, in the order of time.
pub(super) fn read(mut container: Container) -> Result<Capture, CaptureError> {
    let is_corrected = container.has(CORRECTED);
    let mut images = container.names(IMAGES)?;
    images.sort_by(|a, b| natural_cmp(a, b));
    let mut frames = Vec::new();
    for image in images {
        let Some((stem, extension)) = image.rsplit_once('.') else { continue };
        if EXTENSIONS.contains(&extension.to_ascii_lowercase().as_str()) {
            frames.push(one(&mut container, stem, &image, is_corrected));
        }
    }
    let time =
        |frame: &Result<CapturedFrame, CaptureError>| frame.as_ref().ok().map(|f| f.timestamp_s);
    // Names are times, unless somebody renamed them.
    frames.sort_by(|a, b| time(a).partial_cmp(&time(b)).unwrap_or(std::cmp::Ordering::Equal));
    let path = container.path(IMAGES);
    let depth = Depth::Png { units_per_m: UNITS_PER_M, is_usual: false };
    Ok(Capture { container, path, frames, depth, wanted: "keyframes/depth" })
}

/// The frame of an image.
fn one(
    container: &mut Container,
    stem: &str,
    image: &str,
    is_corrected: bool,
) -> Result<CapturedFrame, CaptureError> {
    let mut camera = |folder: &str| {
        let name = format!("{folder}/{stem}.json");
        let path = container.path(&name);
        frame(&container.read(&name)?, &path)
    };
    let mut found = camera(CAMERAS)?;
    if is_corrected {
        // What Polycam left out when it optimized is in no world with the others.
        found.world_from_camera = camera(CORRECTED).ok().and_then(|frame| frame.world_from_camera);
    }
    let beside = |folder: &str| {
        let name = format!("{folder}/{stem}.png");
        container.has(&name).then_some(name)
    };
    Ok(CapturedFrame {
        name: image.to_owned(),
        color: format!("{IMAGES}/{image}"),
        depth: beside(DEPTH),
        confidence: beside(CONFIDENCE),
        ..found
    })
}
