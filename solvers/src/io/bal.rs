//! BAL files: "Bundle Adjustment in the Large" (Agarwal, Snavely, Seitz, Szeliski 2010).
//!
//! Text: a header `cameras points observations`, then observations `camera point u v`, then nine
//! numbers a camera (Rodrigues vector and translation of camera_from_world, focal length, k1, k2),
//! then three a point. BAL's camera looks down −z with y up, and its image's v points up: on import
//! the camera's y and z and the image's v are flipped, on export flipped back (`down_z`). The world and
//! the cost ½ Σ ‖r‖² stay as they are. Compressed files are refused, not unpacked.

use std::path::Path;

use nalgebra::{Vector2, Vector3};

use super::text::{Text, TextWriter};
use super::{IoError, down_z, files};
use crate::geometry::{Camera, LieGroup, Se3, Snavely, So3};
use crate::problem::BundleProblem;

/// Least bytes that one observation, camera or point takes, with its separators.
const OBSERVATION_BYTES: usize = 8;
const CAMERA_BYTES: usize = 18;
const POINT_BYTES: usize = 6;

/// One line `camera point u v`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BalObservation {
    /// Index of the camera.
    pub camera: u32,
    /// Index of the point.
    pub point: u32,
    /// Column in pixels from the image's center, to the right.
    pub u: f64,
    /// Row in pixels from the image's center, upwards.
    pub v: f64,
}

/// A BAL file's numbers in the file's own conventions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BalFile {
    /// Rodrigues vector, translation (camera_from_world), focal length in pixels, k1, k2.
    pub cameras: Vec<[f64; 9]>,
    /// Points in the world frame.
    pub points: Vec<[f64; 3]>,
    /// Observations, in file order.
    pub observations: Vec<BalObservation>,
}

impl BalFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`IoError::Read`], and those of [`BalFile::parse`].
    pub fn read(path: &Path) -> Result<Self, IoError> {
        Self::parse(&files::read(path)?, path)
    }

    /// Parses a file's bytes; `path` names them in errors.
    ///
    /// # Errors
    /// [`IoError::Compressed`]; the first field that is missing, malformed, not finite or out of range,
    /// with its line; a header that announces more than the bytes could hold; anything after the last point.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, IoError> {
        files::check_plain(bytes, path)?;
        let mut text = Text::new(bytes, path);
        let camera_count: u32 = text.integer("camera count")?;
        let point_count: u32 = text.integer("point count")?;
        let observation_count: u32 = text.integer("observation count")?;
        // The last number needs no separator after it.
        let mut room = text.remaining() + 1;
        for (field, count, bytes) in [
            ("observation count", observation_count, OBSERVATION_BYTES),
            ("camera count", camera_count, CAMERA_BYTES),
            ("point count", point_count, POINT_BYTES),
        ] {
            let (count, possible) = (u64::from(count), (room / bytes) as u64);
            if count > possible {
                let (location, field) = (text.location(), field.to_owned());
                return Err(IoError::CountTooLarge { location, field, count, possible });
            }
            room -= count as usize * bytes;
        }
        let mut observations = Vec::with_capacity(observation_count as usize);
        for k in 0..observation_count {
            let camera = index(&mut text, "camera", k, camera_count)?;
            let point = index(&mut text, "point", k, point_count)?;
            let u = text.number(format_args!("observation {k} u"))?;
            let v = text.number(format_args!("observation {k} v"))?;
            observations.push(BalObservation { camera, point, u, v });
        }
        let cameras = arrays(&mut text, "camera", camera_count)?;
        let points = arrays(&mut text, "point", point_count)?;
        text.end()?;
        Ok(Self { cameras, points, observations })
    }

    /// Writes the file with 17 significant digits: reading it gives the same numbers.
    ///
    /// # Errors
    /// [`IoError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), IoError> {
        files::write(path, &self.to_bytes())
    }

    /// The file's bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut text = TextWriter::default();
        let counts = (self.cameras.len(), self.points.len(), self.observations.len());
        text.put(format_args!("{} {} {}\n", counts.0, counts.1, counts.2));
        for BalObservation { camera, point, u, v } in &self.observations {
            text.put(format_args!("{camera} {point} {u:.16e} {v:.16e}\n"));
        }
        let numbers = self.cameras.iter().flatten().chain(self.points.iter().flatten());
        for number in numbers {
            text.put(format_args!("{number:.16e}\n"));
        }
        text.into_bytes()
    }

    /// The bundle adjustment problem in covis' conventions. Pose k and camera k are the file's
    /// camera k, all free; landmarks and observations keep their order; sigma is 1 px.
    #[must_use]
    pub fn to_problem(&self) -> BundleProblem {
        let mut problem = BundleProblem::default();
        // Lists that grow by doubling would take twice the memory of a large file's.
        problem.poses.reserve_exact(self.cameras.len());
        problem.cameras.reserve_exact(self.cameras.len());
        problem.landmarks.reserve_exact(self.points.len());
        for numbers in &self.cameras {
            let [.., focal, k1, k2] = *numbers;
            problem.push_pose(world_from_camera(numbers));
            problem.push_camera(Camera::Snavely(Snavely { focal, k1, k2 }), false);
        }
        for &[x, y, z] in &self.points {
            problem.push_landmark(Vector3::new(x, y, z));
        }
        problem.reprojections.reserve(self.observations.len());
        for o in &self.observations {
            let pixel = down_z::flip_pixel(Vector2::new(o.u, o.v));
            problem.reprojections.push(o.camera, o.camera, o.point, pixel, 1.0);
        }
        problem
    }

    /// Takes poses, intrinsics and landmarks of a problem that [`BalFile::to_problem`] made.
    /// Observations stay the file's.
    ///
    /// # Errors
    /// [`IoError::SizeMismatch`] where the counts differ, [`IoError::UnsupportedCamera`] where a
    /// camera is not BAL's; the file is then unchanged.
    pub fn update_from(&mut self, problem: &BundleProblem) -> Result<(), IoError> {
        for (what, actual, expected) in [
            ("poses", problem.poses.len(), self.cameras.len()),
            ("cameras", problem.cameras.len(), self.cameras.len()),
            ("landmarks", problem.landmarks.len(), self.points.len()),
        ] {
            if actual != expected {
                return Err(IoError::SizeMismatch { what, actual, expected });
            }
        }
        let mut cameras = Vec::with_capacity(self.cameras.len());
        for (k, (pose, camera)) in problem.poses.iter().zip(&problem.cameras).enumerate() {
            let Camera::Snavely(snavely) = *camera else {
                return Err(IoError::UnsupportedCamera {
                    camera: k as u64,
                    model: format!("{camera:?}"),
                    reason: "a BAL file holds Snavely cameras only",
                });
            };
            cameras.push(camera_numbers(pose, &snavely));
        }
        self.cameras = cameras;
        self.points = problem.landmarks.iter().map(|p| [p.x, p.y, p.z]).collect();
        Ok(())
    }
}

fn world_from_camera(numbers: &[f64; 9]) -> Se3 {
    let [w0, w1, w2, t0, t1, t2, ..] = *numbers;
    let rotation = So3::exp(&Vector3::new(w0, w1, w2));
    down_z::world_from_camera(&Se3::new(rotation, Vector3::new(t0, t1, t2)))
}

/// The nine numbers of a camera.
pub(super) fn camera_numbers(world_from_camera: &Se3, camera: &Snavely) -> [f64; 9] {
    let Se3 { rotation, translation: t } = down_z::file_camera_from_world(world_from_camera);
    let w = rotation.log();
    [w.x, w.y, w.z, t.x, t.y, t.z, camera.focal, camera.k1, camera.k2]
}

/// The next word as an index below `count`.
fn index(text: &mut Text<'_>, kind: &str, k: u32, count: u32) -> Result<u32, IoError> {
    let value: u32 = text.integer(format_args!("observation {k} {kind}"))?;
    if value < count {
        return Ok(value);
    }
    Err(IoError::OutOfRange {
        location: text.location(),
        field: format!("observation {k} {kind}"),
        value: value.into(),
        count: count.into(),
    })
}

/// The next `count` groups of `N` numbers.
fn arrays<const N: usize>(
    text: &mut Text<'_>,
    kind: &str,
    count: u32,
) -> Result<Vec<[f64; N]>, IoError> {
    let mut arrays = Vec::with_capacity(count as usize);
    for k in 0..count {
        let mut array = [0.0; N];
        for (n, number) in array.iter_mut().enumerate() {
            *number = text.number(format_args!("{kind} {k}[{n}]"))?;
        }
        arrays.push(array);
    }
    Ok(arrays)
}
