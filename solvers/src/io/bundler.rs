//! Bundler's files (`bundle.out`, v0.3; Snavely, Seitz, Szeliski 2006), also written by VisualSFM and
//! COLMAP, and the list of image names beside them.
//!
//! Text: `# Bundle file v0.3`, counts of cameras and points, then a camera (focal length, k1, k2, the
//! rows of R, t of camera_from_world) and a point (position, color, and its views `camera key x y`).
//! Cameras look down −z with y up; x and y are pixels from the image's center, y up (`down_z`). A
//! camera of zeros was not reconstructed: it keeps its number and is in no problem. Images and keypoint
//! files are never opened.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use super::text::{Line, Text, TextWriter};
use super::{IoError, down_z, files, pose_matrix};
use crate::geometry::{Se3, Snavely};

/// Least bytes of a camera, a point and a view, with their separators.
const CAMERA_BYTES: usize = 2 * 15;
const POINT_BYTES: usize = 2 * 7;
const VIEW_BYTES: usize = 2 * 4;

/// A camera in the file's own conventions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BundlerCamera {
    /// Focal length in pixels, k1, k2.
    pub intrinsics: [f64; 3],
    /// Rows of R of camera_from_world.
    pub rotation: [[f64; 3]; 3],
    /// Translation of camera_from_world.
    pub translation: [f64; 3],
}

/// A point in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BundlerView {
    /// Number of the camera.
    pub camera: u32,
    /// Number of the keypoint in its image.
    pub key: u32,
    /// Column in pixels from the image's center, to the right.
    pub x: f64,
    /// Row in pixels from the image's center, upwards.
    pub y: f64,
}

/// A point with the images that show it.
#[derive(Clone, Debug, PartialEq)]
pub struct BundlerPoint {
    /// Position in the world frame.
    pub position: [f64; 3],
    /// Red, green, blue.
    pub color: [u8; 3],
    /// Where it is seen.
    pub views: Vec<BundlerView>,
}

/// A Bundler file's numbers in the file's own conventions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BundlerFile {
    /// Cameras by number.
    pub cameras: Vec<BundlerCamera>,
    /// Points in file order.
    pub points: Vec<BundlerPoint>,
    /// Name of each camera's image; empty where no list lies beside the file.
    pub image_names: Vec<String>,
}

impl BundlerCamera {
    /// The camera of a pose and its intrinsics.
    #[must_use]
    pub fn new(world_from_camera: &Se3, camera: &Snavely) -> Self {
        let rows = pose_matrix::rows(&down_z::file_camera_from_world(world_from_camera));
        Self {
            intrinsics: [camera.focal, camera.k1, camera.k2],
            rotation: rows.map(|[a, b, c, _]| [a, b, c]),
            translation: rows.map(|[.., t]| t),
        }
    }

    /// Whether the camera was reconstructed.
    #[must_use]
    pub fn is_placed(&self) -> bool {
        self.intrinsics[0] != 0.0
    }

    /// The camera's model.
    #[must_use]
    pub fn snavely(&self) -> Snavely {
        let [focal, k1, k2] = self.intrinsics;
        Snavely { focal, k1, k2 }
    }

    /// The pose.
    ///
    /// # Errors
    /// [`IoError::NotRigid`] at `camera`, its number.
    pub fn world_from_camera(&self, camera: usize) -> Result<Se3, IoError> {
        let row = |i: usize| {
            let [a, b, c] = self.rotation[i];
            [a, b, c, self.translation[i]]
        };
        let location = || super::Location::record(Path::new("camera"), camera as u64);
        let file_camera_from_world = pose_matrix::rigid([row(0), row(1), row(2)], location)?;
        Ok(down_z::world_from_camera(&file_camera_from_world))
    }
}

impl BundlerFile {
    /// Reads a file, and the names of its images where a list lies beside it: `NAME.list.txt` for
    /// `NAME.out`, else `list.txt`.
    ///
    /// # Errors
    /// [`IoError::Read`], those of [`BundlerFile::parse`], and [`IoError::ListLength`] where the list
    /// has not one name a camera.
    pub fn read(path: &Path) -> Result<Self, IoError> {
        let mut file = Self::parse(&files::read(path)?, path)?;
        let beside = [list_path(path), path.with_file_name("list.txt")];
        if let Some(list) = beside.into_iter().find(|list| list.is_file()) {
            file.image_names = names(&files::read(&list)?, &list)?;
            let (actual, expected) = (file.image_names.len(), file.cameras.len());
            if actual != expected {
                let path = list;
                return Err(IoError::ListLength { path, what: "image names", actual, expected });
            }
        }
        Ok(file)
    }

    /// Parses a file's bytes; `path` names them in errors.
    ///
    /// # Errors
    /// With its line: the first field that is missing, malformed, not finite or out of range, a
    /// rotation that is none, counts that the bytes could not hold, anything after the last point.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, IoError> {
        files::check_lines(bytes, path)?;
        let mut text = Text::new(bytes, path);
        let mut head = record(&mut text, "camera count")?;
        let camera_count = count(&mut head, "camera count", (text.remaining() + 1) / CAMERA_BYTES)?;
        let point_count = count(&mut head, "point count", (text.remaining() + 1) / POINT_BYTES)?;
        head.end()?;
        let mut file = Self::default();
        file.cameras.reserve(camera_count);
        for k in 0..camera_count {
            file.cameras.push(parse_camera(&mut text, k)?);
        }
        file.points.reserve(point_count);
        for _ in 0..point_count {
            let point = parse_point(&mut text, &file.cameras)?;
            file.points.push(point);
        }
        text.end()?;
        Ok(file)
    }

    /// Writes the file with 17 significant digits, and beside it `NAME.list.txt` for `NAME.out` where
    /// the images have names.
    ///
    /// # Errors
    /// [`IoError::Write`], and [`IoError::UnwritableText`] for a name that a line does not hold.
    pub fn write(&self, path: &Path) -> Result<(), IoError> {
        if !self.image_names.is_empty() {
            let mut list = TextWriter::default();
            for (k, name) in self.image_names.iter().enumerate() {
                if name.is_empty() || name.contains(char::is_whitespace) {
                    let reason = "a list of images needs a name without white space";
                    return Err(IoError::UnwritableText { field: "image", id: k as u64, reason });
                }
                list.put(format_args!("{name}\n"));
            }
            files::write(&list_path(path), &list.into_bytes())?;
        }
        files::write(path, &self.to_bytes())
    }

    /// The file's bytes, without the list of names.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut text = TextWriter::default();
        text.put("# Bundle file v0.3\n");
        text.put(format_args!("{} {}\n", self.cameras.len(), self.points.len()));
        for camera in &self.cameras {
            let BundlerCamera { intrinsics, rotation: [r0, r1, r2], translation } = camera;
            for row in [intrinsics, r0, r1, r2, translation] {
                put_row(&mut text, row);
            }
        }
        for point in &self.points {
            put_row(&mut text, &point.position);
            let [r, g, b] = point.color;
            text.put(format_args!("{r} {g} {b}\n{}", point.views.len()));
            for BundlerView { camera, key, x, y } in &point.views {
                text.put(format_args!(" {camera} {key} {x:.16e} {y:.16e}"));
            }
            text.end_line();
        }
        text.into_bytes()
    }
}

/// Where the names of a file's images are written.
fn list_path(path: &Path) -> PathBuf {
    path.with_extension("list.txt")
}

/// The first word of each line; VisualSFM adds focal lengths after it.
fn names(bytes: &[u8], path: &Path) -> Result<Vec<String>, IoError> {
    let mut text = Text::new(bytes, path);
    let mut names = Vec::new();
    while let Some(mut line) = text.record() {
        let name = line.word().unwrap_or_default();
        let Ok(name) = std::str::from_utf8(name) else {
            let found = super::error::excerpt(name);
            let (location, field) = (line.location(), "image name".to_owned());
            return Err(IoError::Malformed { location, field, found });
        };
        names.push(name.to_owned());
    }
    Ok(names)
}

fn put_row(text: &mut TextWriter, [a, b, c]: &[f64; 3]) {
    text.put(format_args!("{a:.16e} {b:.16e} {c:.16e}\n"));
}

/// The next line with something on it.
fn record<'a>(text: &mut Text<'a>, field: &str) -> Result<Line<'a>, IoError> {
    let location = text.location();
    text.record().ok_or_else(|| IoError::Truncated { location, field: field.to_owned() })
}

/// A count that is at most `possible`.
fn count(line: &mut Line<'_>, field: &str, possible: usize) -> Result<usize, IoError> {
    let count: u32 = line.integer(field)?;
    if count as usize <= possible {
        return Ok(count as usize);
    }
    let (location, field, possible) = (line.location(), field.to_owned(), possible as u64);
    Err(IoError::CountTooLarge { location, field, count: count.into(), possible })
}

fn parse_camera(text: &mut Text<'_>, k: usize) -> Result<BundlerCamera, IoError> {
    let mut rows = [[0.0; 3]; 5];
    let mut location = text.location();
    let fields =
        ["focal length, k1, k2", "rotation row 0", "rotation row 1", "rotation row 2", "t"];
    for (row, field) in rows.iter_mut().zip(fields) {
        let mut line = record(text, field)?;
        if field == "rotation row 0" {
            location = line.location();
        }
        *row = line.numbers(field)?;
        line.end()?;
    }
    let [intrinsics, r0, r1, r2, translation] = rows;
    let camera = BundlerCamera { intrinsics, rotation: [r0, r1, r2], translation };
    match camera.world_from_camera(k) {
        Err(IoError::NotRigid { deviation, .. }) if camera.is_placed() => {
            Err(IoError::NotRigid { location, deviation })
        }
        Ok(_) | Err(_) => Ok(camera),
    }
}

fn parse_point(text: &mut Text<'_>, cameras: &[BundlerCamera]) -> Result<BundlerPoint, IoError> {
    let mut line = record(text, "position")?;
    let position = line.numbers("position")?;
    line.end()?;
    let mut line = record(text, "color")?;
    let color = [line.integer("red")?, line.integer("green")?, line.integer("blue")?];
    line.end()?;
    let mut line = record(text, "view count")?;
    let possible = line.remaining() / VIEW_BYTES;
    let view_count = count(&mut line, "view count", possible)?;
    let mut views = Vec::with_capacity(view_count);
    for _ in 0..view_count {
        let camera: u32 = line.integer("camera of a view")?;
        if !cameras.get(camera as usize).is_some_and(BundlerCamera::is_placed) {
            let (location, id) = (line.location(), camera.into());
            return Err(IoError::UnknownId { location, field: "reconstructed camera", id });
        }
        let key = line.integer("key of a view")?;
        let [x, y] = line.numbers("view")?;
        views.push(BundlerView { camera, key, x, y });
    }
    line.end()?;
    Ok(BundlerPoint { position, color, views })
}

impl BundlerPoint {
    /// A point that nothing sees yet.
    #[must_use]
    pub fn new(point_in_world: &Vector3<f64>, color: [u8; 3]) -> Self {
        Self { position: (*point_in_world).into(), color, views: Vec::new() }
    }
}
