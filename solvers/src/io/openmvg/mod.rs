//! OpenMVG's `sfm_data.json`, versions 0.2 and 0.3: views, intrinsics, poses and points. Read only.
//!
//! The structs hold the file's own numbers: camera_from_world as the rows of R and the center C in the
//! world, t = −R C; the camera looks along +z; an integer pixel is a pixel's center, as OpenMVG's
//! sampling of images has it. All of this is covis' own convention, except the direction of the
//! transform. Images and features are never opened, and the binary `sfm_data.bin` is not read.

mod convert;
mod json;

use std::collections::BTreeMap;
use std::path::Path;

pub use convert::OpenMvgLeftOut;
use serde::Deserialize;

use super::{IoError, files};

/// The id that means none.
const UNDEFINED: u32 = u32::MAX;

/// An image.
#[derive(Clone, Debug, Deserialize, PartialEq)]
pub struct OpenMvgView {
    /// Folder of the image below the file's root; empty where it is the root.
    pub local_path: String,
    /// File name.
    pub filename: String,
    /// Key of its intrinsic; `u32::MAX` where it has none.
    pub id_intrinsic: u32,
    /// Key of its pose, which an image that was not placed lacks.
    pub id_pose: u32,
}

/// The intrinsics of a camera. What its model lacks is `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenMvgIntrinsic {
    /// OpenMVG's name of the model.
    pub model: String,
    /// Width and height of its images, px.
    pub size_px: Option<[u32; 2]>,
    /// Focal length, px.
    pub focal_length: Option<f64>,
    /// Principal point (x, y), px.
    pub principal_point: Option<[f64; 2]>,
    /// `pinhole_radial_k1`: k1.
    pub disto_k1: Option<[f64; 1]>,
    /// `pinhole_radial_k3`: k1, k2, k3.
    pub disto_k3: Option<[f64; 3]>,
    /// `pinhole_brown_t2`: k1, k2, k3, t1, t2, which are OpenCV's k1, k2, k3, p1, p2.
    pub disto_t2: Option<[f64; 5]>,
    /// `fisheye`: k1 to k4 of OpenCV's model.
    pub fisheye: Option<[f64; 4]>,
}

/// A pose.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
pub struct OpenMvgPose {
    /// Rows of R of camera_from_world.
    pub rotation: [[f64; 3]; 3],
    /// The camera's center in the world.
    pub center: [f64; 3],
}

/// A point with the views that show it.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenMvgPoint {
    /// Position in the world.
    pub position: [f64; 3],
    /// Key of a view, and the pixel (column, row) in it.
    pub observations: Vec<(u32, [f64; 2])>,
}

/// The numbers of a file, by the keys that it has.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenMvgFile {
    /// Images.
    pub views: BTreeMap<u32, OpenMvgView>,
    /// Cameras.
    pub intrinsics: BTreeMap<u32, OpenMvgIntrinsic>,
    /// Poses of the images that were placed.
    pub poses: BTreeMap<u32, OpenMvgPose>,
    /// Points.
    pub points: BTreeMap<u32, OpenMvgPoint>,
    /// How many control points there are; what they say is not read.
    pub control_points: usize,
}

impl OpenMvgFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`IoError::Read`], and those of [`OpenMvgFile::parse`].
    pub fn read(path: &Path) -> Result<Self, IoError> {
        Self::parse(&files::read(path)?, path)
    }

    /// Parses a file's bytes; `path` names them in errors.
    ///
    /// # Errors
    /// [`IoError::Compressed`]; [`IoError::Json`] with the line of what is no JSON, is missing or has
    /// another type; [`IoError::Malformed`] for another version, and for an intrinsic without the name of
    /// its model; [`IoError::DuplicateId`] for a key that occurs twice.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, IoError> {
        files::check_plain(bytes, path)?;
        json::parse(bytes, path)
    }
}
