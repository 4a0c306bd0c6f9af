//! `transforms.json` of nerfstudio and instant-ngp: images with lenses and poses, and back with refined
//! poses.
//!
//! A frame has the lens that it gives itself, else that of the whole file. The file has no times: frames
//! follow each other as their names do, [`RATE_HZ`] a second. Of several cameras, or of fisheyes, none
//! is read.

use std::path::Path;

use covis_solvers::geometry::Se3;
use covis_solvers::io::natural_cmp;
use serde::Deserialize;
use serde_json::Value;

use super::container::{Container, inside};
use super::error::{CaptureError, Place};
use super::numbers::{self, Given, Lens};
use super::{Capture, CapturedFrame, Depth, Frames, parsed};

/// The file's usual name.
pub const TRANSFORMS_FILE: &str = "transforms.json";

/// Frames a second: such a file holds a choice of a video's images, or photographs.
const RATE_HZ: f64 = 10.0;
/// What nerfstudio assumes: depth in millimeters.
const USUAL_UNIT_M: f64 = 0.001;
/// The lenses that are read; a file that names none has the first.
const MODELS: [&str; 4] = ["OPENCV", "PINHOLE", "PERSPECTIVE", "SIMPLE_PINHOLE"];

const NAMES: [&str; 6] = ["fl_x", "fl_y", "cx", "cy", "w", "h"];
const MATRIX: &str = "transform_matrix";

/// A struct with these fields and those of a lens, which file and frames have alike.
macro_rules! with_lens {
    ($(#[$doc:meta])* $name:ident { $($field:ident: $type:ty,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Deserialize)]
        struct $name {
            $($field: $type,)*
            camera_model: Option<String>,
            is_fisheye: Option<bool>,
            fl_x: Option<f64>,
            fl_y: Option<f64>,
            cx: Option<f64>,
            cy: Option<f64>,
            w: Option<f64>,
            h: Option<f64>,
            k1: Option<f64>,
            k2: Option<f64>,
            k3: Option<f64>,
            k4: Option<f64>,
            p1: Option<f64>,
            p2: Option<f64>,
        }

        impl $name {
            /// fl_x, fl_y, cx, cy, w, h; and k1, k2, p1, p2, k3, k4.
            fn numbers(&self) -> [[Option<f64>; 6]; 2] {
                [
                    [self.fl_x, self.fl_y, self.cx, self.cy, self.w, self.h],
                    [self.k1, self.k2, self.p1, self.p2, self.k3, self.k4],
                ]
            }

            /// Refuses lenses that tracking does not know.
            fn check_model(&self, place: impl Fn() -> Place) -> Result<(), CaptureError> {
                let fisheye = self.is_fisheye.unwrap_or(false).then_some("a fisheye");
                let model = self.camera_model.as_deref().filter(|model| !MODELS.contains(model));
                let Some(found) = fisheye.or(model) else { return Ok(()) };
                let found = found.chars().take(40).collect();
                Err(CaptureError::Model { place: place(), found })
            }
        }
    };
}

with_lens! {
    /// The whole file.
    File {
        frames: Vec<Frame>,
        depth_unit_scale_factor: Option<f64>,
    }
}

with_lens! {
    /// One image.
    Frame {
        file_path: String,
        depth_file_path: Option<String>,
        transform_matrix: [[f64; 4]; 4],
    }
}

impl File {
    /// The lens of a frame.
    fn lens(&self, frame: &Frame, place: impl Fn() -> Place) -> Result<Lens, CaptureError> {
        frame.check_model(&place)?;
        let ([own, own_distortion], [usual, usual_distortion]) = (frame.numbers(), self.numbers());
        let either = |own: [Option<f64>; 6], usual: [Option<f64>; 6]| {
            let mut both = own;
            both.iter_mut().zip(usual).for_each(|(own, usual)| *own = own.or(usual));
            both
        };
        let mut found = [0.0; 6];
        for ((found, value), field) in found.iter_mut().zip(either(own, usual)).zip(NAMES) {
            *found = value.ok_or_else(|| CaptureError::Missing { place: place(), field })?;
        }
        let [fx, fy, cx, cy, w, h] = found;
        let distortion = either(own_distortion, usual_distortion).map(|k| k.unwrap_or(0.0));
        let [k1, k2, p1, p2, k3, k4] = distortion;
        if k4 != 0.0 {
            let must = "0: distortion of OPENCV has k1, k2, k3, p1 and p2";
            return Err(CaptureError::Number { place: place(), field: "k4", value: k4, must });
        }
        let given =
            Given { pinhole: [fx, fy, cx, cy], distortion: [k1, k2, p1, p2, k3], size: [w, h] };
        given.lens(NAMES, place)
    }

    /// A frame as tracking wants it.
    fn captured(&self, frame: &Frame, path: &Path) -> Result<CapturedFrame, CaptureError> {
        let place = || Place { path: path.to_owned(), frame: Some(short(&frame.file_path)) };
        let [first, second, third, _] = frame.transform_matrix;
        Ok(CapturedFrame {
            name: frame.file_path.clone(),
            timestamp_s: 0.0,
            color: inside(&frame.file_path, path)?,
            depth: frame.depth_file_path.as_deref().map(|depth| inside(depth, path)).transpose()?,
            confidence: None,
            lens: self.lens(frame, place)?,
            world_from_camera: Some(numbers::pose([first, second, third], MATRIX, place)?),
        })
    }
}

/// A path that is short enough for a message.
fn short(path: &str) -> String {
    path.chars().take(80).collect()
}

/// Reads a file; frames by their names.
pub(super) fn read(mut container: Container, name: &str) -> Result<Capture, CaptureError> {
    let path = container.path(name);
    let bytes = container.read(name)?;
    let (depth, frames) = parse(&bytes, &path)?;
    Ok(Capture { container, path, frames, depth, wanted: "depth_file_path" })
}

/// Frames by their names, and how their depth is read.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<(Depth, Frames), CaptureError> {
    let mut file: File = parsed(bytes, path)?;
    let place = || Place { path: path.to_owned(), frame: None };
    file.check_model(place)?;
    let is_usual = file.depth_unit_scale_factor.is_none();
    let unit_m = file.depth_unit_scale_factor.unwrap_or(USUAL_UNIT_M);
    let units_per_m = numbers::units_per_m(unit_m, "depth_unit_scale_factor", place)?;
    let mut frames = std::mem::take(&mut file.frames);
    frames.sort_by(|a, b| natural_cmp(&a.file_path, &b.file_path));
    let frames = frames.iter().enumerate().map(|(number, frame)| {
        let timestamp_s = number as f64 / RATE_HZ;
        Ok(CapturedFrame { timestamp_s, ..file.captured(frame, path)? })
    });
    Ok((Depth::Png { units_per_m, is_usual }, frames.collect()))
}

/// The text of a `transforms.json` with other poses: of each frame that `refined` knows by its
/// `file_path`, the matrix is replaced; all else stays as it is. Also how many frames kept theirs.
///
/// # Errors
/// [`CaptureError::Read`], [`CaptureError::Json`].
pub fn with_poses(
    path: &Path,
    refined: impl Fn(&str) -> Option<Se3>,
) -> Result<(String, usize), CaptureError> {
    let bytes = std::fs::read(path)
        .map_err(|source| CaptureError::Read { path: path.to_owned(), source })?;
    let mut file: Value = parsed(&bytes, path)?;
    let mut kept = 0;
    for frame in file.get_mut("frames").and_then(Value::as_array_mut).into_iter().flatten() {
        let pose = frame.get("file_path").and_then(Value::as_str).and_then(&refined);
        match (pose, frame.get_mut(MATRIX)) {
            (Some(pose), Some(matrix)) => {
                let [first, second, third] = numbers::rows(&pose);
                *matrix = Value::from(
                    [first, second, third, [0.0, 0.0, 0.0, 1.0]].map(Vec::from).to_vec(),
                );
            }
            _ => kept += 1,
        }
    }
    let text = serde_json::to_string_pretty(&file)
        .map_err(|source| CaptureError::Json { path: path.to_owned(), source })?;
    Ok((text + "\n", kept))
}
