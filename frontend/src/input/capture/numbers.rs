//! Numbers of a capture's JSON, checked: sizes, lenses and poses.
//!
//! Converts the conventions: a capture's principal point counts from the first pixel's corner, and its
//! cameras look along -z with y up (OpenGL); covis counts from the first pixel's center and looks along
//! +z with y down.

use covis_solvers::geometry::{PinholeRadialTangential, Se3, So3};
use covis_solvers::io::pose_matrix;
use nalgebra::{Matrix3, Vector3};

use super::error::{CaptureError, Place};
use crate::input::decode::MAX_SIDE;

/// No lens of a camera is longer or farther off its image, px.
const MOST_PX: f64 = 1e5;
/// Nobody carries a camera farther, m.
const MOST_M: f64 = 1e6;
/// Depth in units of more than a meter, or finer than this, is a mistake.
const LEAST_UNIT_M: f64 = 1e-6;

/// A lens and the size of its images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lens {
    /// px, from the first pixel's center.
    pub(super) camera: PinholeRadialTangential,
    /// Columns and rows.
    pub(super) size: (usize, usize),
}

/// A lens as a capture gives it, px.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Given {
    /// fx, fy, cx and cy, from the first pixel's corner.
    pub(super) pinhole: [f64; 4],
    /// k1, k2, p1, p2 and k3.
    pub(super) distortion: [f64; 5],
    /// Columns and rows.
    pub(super) size: [f64; 2],
}

impl Given {
    /// The lens; `names` are those of fx, fy, cx, cy, columns and rows.
    pub(super) fn lens(
        &self,
        names: [&'static str; 6],
        place: impl Fn() -> Place,
    ) -> Result<Lens, CaptureError> {
        let bad = |index: usize, value, must| {
            Err(CaptureError::Number { place: place(), field: names[index], value, must })
        };
        for (index, &value) in self.pinhole.iter().enumerate() {
            if index < 2 && !(value > 0.0 && value <= MOST_PX) {
                return bad(index, value, "a focal length of more than 0 and at most 100000 px");
            }
            if value.abs() > MOST_PX {
                return bad(index, value, "from -100000 to 100000 px");
            }
        }
        let most = MAX_SIDE as f64;
        for (index, &value) in self.size.iter().enumerate() {
            if !((1.0..=most).contains(&value) && value.fract() == 0.0) {
                return bad(4 + index, value, "a whole number of pixels from 1 to 8192");
            }
        }
        let [fx, fy, cx, cy] = self.pinhole;
        let [k1, k2, p1, p2, k3] = self.distortion;
        let camera = PinholeRadialTangential {
            k1,
            k2,
            p1,
            p2,
            k3,
            ..PinholeRadialTangential::undistorted(fx, fy, cx - 0.5, cy - 0.5)
        };
        Ok(Lens { camera, size: (self.size[0] as usize, self.size[1] as usize) })
    }
}

/// From a camera with y down that looks along z to one with y up that looks along -z, and back: half a
/// turn about x.
fn turned(world_from_camera: &Se3) -> Se3 {
    let rotation = world_from_camera.rotation.matrix();
    let half_turn = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    Se3::new(So3::from_matrix(&(rotation * half_turn)), world_from_camera.translation)
}

/// `world_from_camera` from the rows [R | t] of an OpenGL camera.
pub(super) fn pose(
    rows: [[f64; 4]; 3],
    field: &'static str,
    place: impl Fn() -> Place,
) -> Result<Se3, CaptureError> {
    let rigid = pose_matrix::from_rows(rows).ok();
    let rigid = rigid.filter(|pose| pose.translation.amax() <= MOST_M);
    rigid.map(|pose| turned(&pose)).ok_or_else(|| CaptureError::Pose { place: place(), field })
}

/// The rows [R | t] of an OpenGL camera at `world_from_camera`.
pub(super) fn rows(world_from_camera: &Se3) -> [[f64; 4]; 3] {
    pose_matrix::rows(&turned(world_from_camera))
}

/// Units of depth a meter, from the meters of a unit.
pub(super) fn units_per_m(
    unit_m: f64,
    field: &'static str,
    place: impl Fn() -> Place,
) -> Result<f32, CaptureError> {
    if (LEAST_UNIT_M..=1.0).contains(&unit_m) {
        return Ok((1.0 / unit_m) as f32);
    }
    let must = "from 0.000001 to 1 m a unit of depth";
    Err(CaptureError::Number { place: place(), field, value: unit_m, must })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_looks_along_minus_z_with_y_up_looks_along_z_with_y_down() {
        let place = || Place { path: "a.json".into(), frame: None };
        let given = [[0.0, 0.0, 1.0, 1.0], [1.0, 0.0, 0.0, 2.0], [0.0, 1.0, 0.0, 3.0]];
        let found = pose(given, "transform_matrix", place).unwrap();
        // It looks along its -z, the world's -x; what is up in the image is the world's z.
        assert!((found.rotation.rotate(&Vector3::z()) + Vector3::x()).norm() < 1e-12);
        assert!((found.rotation.rotate(&Vector3::y()) + Vector3::z()).norm() < 1e-12);
        assert_eq!(found.translation, Vector3::new(1.0, 2.0, 3.0));
        let again = rows(&found);
        for (row, expected) in again.as_flattened().iter().zip(given.as_flattened()) {
            assert!((row - expected).abs() < 1e-12, "{again:?}");
        }
        let mut mirrored = given;
        mirrored[0][2] = -1.0;
        let error = pose(mirrored, "transform_matrix", place).unwrap_err().to_string();
        assert!(error.starts_with("a.json: transform_matrix is no rigid motion"), "{error}");
        let mut far = given;
        far[2][3] = 1e7;
        assert!(pose(far, "transform_matrix", place).is_err());
    }

    #[test]
    fn a_lens_has_numbers_that_a_lens_can_have() {
        let place = || Place { path: "a.json".into(), frame: Some("3".into()) };
        let names = ["fl_x", "fl_y", "cx", "cy", "w", "h"];
        let good = Given {
            pinhole: [500.0, 501.0, 320.0, 240.0],
            distortion: [0.1, 0.0, 0.0, 0.0, 0.0],
            size: [640.0, 480.0],
        };
        let lens = good.lens(names, place).unwrap();
        assert_eq!((lens.camera.cx, lens.camera.k1, lens.size), (319.5, 0.1, (640, 480)));
        let with = |index: usize, value: f64| {
            let mut all = [good.pinhole.as_slice(), &good.size].concat();
            all[index] = value;
            let (pinhole, size) = ([all[0], all[1], all[2], all[3]], [all[4], all[5]]);
            Given { pinhole, size, ..good }.lens(names, place).unwrap_err().to_string()
        };
        assert_eq!(
            with(1, -3.0),
            "a.json, frame 3: fl_y is -3, not a focal length of more than 0 and at most 100000 px"
        );
        assert!(with(0, 0.0).contains("fl_x is 0"));
        assert!(with(2, 1e300).contains("cx is 1"));
        assert!(with(4, 640.5).contains("w is 640.5"));
        assert!(with(5, 1e9).contains("h is 1000000000"));
    }
}
