//! COLMAP sparse models: cameras, images and points of a folder, text or binary.
//!
//! The structs hold the file's own numbers: camera_from_world as a quaternion (w, x, y, z) and a
//! translation, pixels with the center of the first pixel at (0.5, 0.5). Converting to a problem
//! inverts the pose and subtracts 0.5 px from principal points and observations; converting back
//! adds it. Files of newer versions that repeat the poses (rigs, frames) are neither read nor made.

mod binary;
mod camera;
mod convert;
mod text;

use std::collections::BTreeMap;
use std::path::Path;

pub use camera::{ColmapCamera, ColmapCameraModel};
pub(super) use convert::mean_errors_px;
pub use convert::{ColmapPointError, ColmapProblem};

use super::text::TextWriter;
use super::{IoError, Location, files};

/// How the three files are written: whole by [`ColmapModel`], or record by record for a caller that
/// does not hold all of a model. A file is its head, then its records by rising id; nothing is checked
/// across records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColmapEncoding {
    /// `cameras.txt`, `images.txt`, `points3D.txt`.
    Text,
    /// `cameras.bin`, `images.bin`, `points3D.bin`.
    Binary,
}

impl ColmapEncoding {
    /// The encoding of the model in a folder, binary where there are both; `None` without a model.
    #[must_use]
    pub fn of_folder(folder: &Path) -> Option<Self> {
        let has = |encoding: &Self| folder.join(encoding.file_names()[0]).is_file();
        [Self::Binary, Self::Text].into_iter().find(has)
    }

    /// Names of the files of cameras, images and points.
    #[must_use]
    pub fn file_names(self) -> [&'static str; 3] {
        match self {
            Self::Text => ["cameras.txt", "images.txt", "points3D.txt"],
            Self::Binary => ["cameras.bin", "images.bin", "points3D.bin"],
        }
    }

    /// Appends what stands before `count` cameras.
    pub fn put_cameras_head(self, count: usize, out: &mut Vec<u8>) {
        self.put_head(text::CAMERAS_HEAD, count, out);
    }

    /// Appends what stands before `count` images.
    pub fn put_images_head(self, count: usize, out: &mut Vec<u8>) {
        self.put_head(text::IMAGES_HEAD, count, out);
    }

    /// Appends what stands before `count` points.
    pub fn put_points_head(self, count: usize, out: &mut Vec<u8>) {
        self.put_head(text::POINTS_HEAD, count, out);
    }

    /// Appends a camera.
    pub fn put_camera(self, id: u32, camera: &ColmapCamera, out: &mut Vec<u8>) {
        match self {
            Self::Text => TextWriter::append(out, |text| text::put_camera(text, id, camera)),
            Self::Binary => binary::put_camera(out, id, camera),
        }
    }

    /// Appends an image with its keypoints.
    ///
    /// # Errors
    /// [`IoError::UnwritableText`] where the name does not survive the format.
    pub fn put_image(self, id: u32, image: &ColmapImage, out: &mut Vec<u8>) -> Result<(), IoError> {
        match self {
            Self::Text => {
                text::check_name(id, &image.name)?;
                TextWriter::append(out, |text| text::put_image(text, id, image));
                Ok(())
            }
            Self::Binary => binary::put_image(out, id, image),
        }
    }

    /// Appends a point with its track.
    pub fn put_point(self, id: u64, point: &ColmapPoint, out: &mut Vec<u8>) {
        match self {
            Self::Text => TextWriter::append(out, |text| text::put_point(text, id, point)),
            Self::Binary => binary::put_point(out, id, point),
        }
    }

    fn put_head(self, comment: &[u8], count: usize, out: &mut Vec<u8>) {
        match self {
            Self::Text => out.extend(comment),
            Self::Binary => binary::put_count(out, count),
        }
    }
}

/// A point in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColmapKeypoint {
    /// Column in pixels, the first pixel's center at 0.5.
    pub x: f64,
    /// Row in pixels, the first pixel's center at 0.5.
    pub y: f64,
    /// The 3D point that it observes.
    pub point: Option<u64>,
}

/// An image with its pose.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapImage {
    /// Rotation of camera_from_world, (w, x, y, z).
    pub quaternion_wxyz: [f64; 4],
    /// Translation of camera_from_world.
    pub translation: [f64; 3],
    /// Id of its camera.
    pub camera: u32,
    /// File name.
    pub name: String,
    /// Its keypoints, also those without a 3D point.
    pub keypoints: Vec<ColmapKeypoint>,
}

/// A 3D point.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapPoint {
    /// Position in the world frame.
    pub position: [f64; 3],
    /// Red, green, blue.
    pub color: [u8; 3],
    /// Mean reprojection error in pixels ([`ColmapPointError`]); −1 where it was not computed.
    pub error: f64,
    /// Observations as (image id, index of the keypoint in the image).
    pub track: Vec<(u32, u32)>,
}

/// A sparse model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColmapModel {
    /// Cameras by id.
    pub cameras: BTreeMap<u32, ColmapCamera>,
    /// Images by id.
    pub images: BTreeMap<u32, ColmapImage>,
    /// Points by id.
    pub points: BTreeMap<u64, ColmapPoint>,
}

impl ColmapModel {
    /// Reads the model in a folder, binary if `cameras.bin` is there, else text.
    ///
    /// # Errors
    /// [`IoError::MissingFile`], [`IoError::Read`], and those of [`ColmapModel::parse`].
    pub fn read(folder: &Path) -> Result<Self, IoError> {
        let Some(encoding) = ColmapEncoding::of_folder(folder) else {
            let what = "cameras.bin or cameras.txt";
            return Err(IoError::MissingFile { path: folder.to_owned(), what });
        };
        Self::read_as(folder, encoding)
    }

    /// Reads the model in a folder that has this encoding.
    ///
    /// # Errors
    /// [`IoError::Read`], and those of [`ColmapModel::parse`].
    pub fn read_as(folder: &Path, encoding: ColmapEncoding) -> Result<Self, IoError> {
        let [cameras, images, points] = encoding.file_names().map(|f| files::read(&folder.join(f)));
        Self::parse(encoding, [&cameras?, &images?, &points?], folder)
    }

    /// Parses the bytes of the three files: cameras, images, points. `folder` names them in errors.
    ///
    /// # Errors
    /// With line or byte: what is truncated, malformed, not finite or follows the end, a count that
    /// the file cannot hold, an unknown camera model, a point id of 2⁶⁴ − 1 (which means none), a quaternion whose norm is off by more than
    /// 1e-3, an id that stands twice or does not exist.
    pub fn parse(
        encoding: ColmapEncoding,
        [cameras, images, points]: [&[u8]; 3],
        folder: &Path,
    ) -> Result<Self, IoError> {
        let [camera_path, image_path, point_path] = encoding.file_names().map(|f| folder.join(f));
        let mut model = Self::default();
        match encoding {
            ColmapEncoding::Text => {
                files::check_lines(cameras, &camera_path)?;
                files::check_lines(points, &point_path)?;
                files::check_lines(images, &image_path)?;
                text::parse_cameras(&mut model, cameras, &camera_path)?;
                text::parse_points(&mut model, points, &point_path)?;
                text::parse_images(&mut model, images, &image_path)?;
            }
            ColmapEncoding::Binary => {
                binary::parse_cameras(&mut model, cameras, &camera_path)?;
                binary::parse_points(&mut model, points, &point_path)?;
                binary::parse_images(&mut model, images, &image_path)?;
            }
        }
        model.check_tracks(&point_path)?;
        Ok(model)
    }

    /// Writes the three files into a folder, which is made if need be. Files of the other encoding
    /// that stand there are left alone.
    ///
    /// # Errors
    /// [`IoError::Write`], and those of [`ColmapModel::to_files`].
    pub fn write(&self, folder: &Path, encoding: ColmapEncoding) -> Result<(), IoError> {
        files::create_folder(folder)?;
        for (name, bytes) in self.to_files(encoding)? {
            files::write(&folder.join(name), &bytes)?;
        }
        Ok(())
    }

    /// The names and bytes of the three files. Reading them gives the same numbers.
    ///
    /// # Errors
    /// [`IoError::UnwritableText`] where an image's name does not survive the format.
    pub fn to_files(
        &self,
        encoding: ColmapEncoding,
    ) -> Result<Vec<(&'static str, Vec<u8>)>, IoError> {
        let mut bytes = [const { Vec::new() }; 3];
        let [cameras, images, points] = &mut bytes;
        encoding.put_cameras_head(self.cameras.len(), cameras);
        for (&id, camera) in &self.cameras {
            encoding.put_camera(id, camera, cameras);
        }
        encoding.put_images_head(self.images.len(), images);
        for (&id, image) in &self.images {
            encoding.put_image(id, image, images)?;
        }
        encoding.put_points_head(self.points.len(), points);
        for (&id, point) in &self.points {
            encoding.put_point(id, point, points);
        }
        Ok(encoding.file_names().into_iter().zip(bytes).collect())
    }

    /// How many points fewer than two images observe. COLMAP's bundle adjustment refuses a model with a
    /// track of one view.
    #[must_use]
    pub fn single_view_points(&self) -> usize {
        let is_single = |point: &&ColmapPoint| {
            let mut images = point.track.iter().map(|&(image, _)| image);
            let first = images.next();
            images.all(|image| Some(image) == first)
        };
        self.points.values().filter(is_single).count()
    }

    /// Checks that every track entry names a keypoint. `path` is the file of the points.
    fn check_tracks(&self, path: &Path) -> Result<(), IoError> {
        for (&id, point) in &self.points {
            let location = || Location::record(path, id);
            for &(image, keypoint) in &point.track {
                let Some(observer) = self.images.get(&image) else {
                    let (location, id) = (location(), image.into());
                    return Err(IoError::UnknownId { location, field: "image", id });
                };
                let count = observer.keypoints.len();
                if keypoint as usize >= count {
                    let field = format!("track keypoint of image {image}");
                    let (value, count) = (keypoint.into(), count as u64);
                    return Err(IoError::OutOfRange { location: location(), field, value, count });
                }
            }
        }
        Ok(())
    }

    /// Refuses an image's camera that was not read.
    fn check_camera(&self, id: u32, location: impl FnOnce() -> Location) -> Result<(), IoError> {
        if self.cameras.contains_key(&id) {
            return Ok(());
        }
        Err(IoError::UnknownId { location: location(), field: "camera", id: id.into() })
    }

    /// Refuses a keypoint's point that was not read.
    fn check_point(
        &self,
        id: Option<u64>,
        location: impl FnOnce() -> Location,
    ) -> Result<(), IoError> {
        match id {
            Some(id) if !self.points.contains_key(&id) => {
                Err(IoError::UnknownId { location: location(), field: "point", id: id.into() })
            }
            Some(_) | None => Ok(()),
        }
    }
}

/// The point id that means none in a binary file, which no point can have.
const NO_POINT: u64 = u64::MAX;

/// The id of a point that was read.
fn point_id(id: u64, location: &Location) -> Result<u64, IoError> {
    if id == NO_POINT {
        let (location, field) = (location.clone(), "point id".to_owned());
        return Err(IoError::Malformed { location, field, found: id.to_string() });
    }
    Ok(id)
}

/// Adds a record that was read, refusing a second one with its id.
fn insert<K: Copy + Ord + Into<u64>, V>(
    map: &mut BTreeMap<K, V>,
    field: &'static str,
    id: K,
    record: V,
    location: Location,
) -> Result<(), IoError> {
    match map.insert(id, record) {
        None => Ok(()),
        Some(_) => Err(IoError::DuplicateId { location, field, id: id.into().into() }),
    }
}
