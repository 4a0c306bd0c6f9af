//! Cameras that look down −z with y up, and images whose v points up: those of BAL and Bundler.
//!
//! The one place where these axes become covis' (z forward, y down, v down) and back. The world stays as it
//! is, and so do residuals except for the sign of v. Must not read or write files.

use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};

use crate::geometry::{LieGroup, Se3, So3};

/// The half turn about x that flips y and z: from one camera frame to the other, and back.
fn flip() -> Se3 {
    let half_turn = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
    Se3::new(So3::from_unit_quaternion(half_turn), Vector3::zeros())
}

/// covis' `world_from_camera` of a file's camera_from_world.
pub(super) fn world_from_camera(file_camera_from_world: &Se3) -> Se3 {
    flip().compose(file_camera_from_world).inverse()
}

/// A file's camera_from_world of covis' `world_from_camera`.
pub(super) fn file_camera_from_world(world_from_camera: &Se3) -> Se3 {
    flip().compose(&world_from_camera.inverse())
}

/// covis' pixel of a file's, and a file's of covis'.
pub(super) fn flip_pixel(pixel: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(pixel.x, -pixel.y)
}
