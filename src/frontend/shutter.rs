//! A rolling shutter: rows are exposed one after the other while the camera turns.
//!
//! A frame's pose is that of its middle row. Row v was exposed earlier or later by its share of the
//! readout; points are projected where they were then, and rays are turned back to the middle.
//! Translation during a readout is left out: at walking speed it is a few centimeters.

use nalgebra::{Vector2, Vector3};

use super::camera::FrameCamera;

/// How a frame was read out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shutter {
    /// Angle, rad, by which the camera turns, about its own axes, from one row to the next.
    turn_per_row: Vector3<f64>,
    middle_row: f64,
}

impl Shutter {
    /// Of a camera that turns at a rate (rad/s, its own axes) while its rows are read out.
    #[must_use]
    pub fn new(camera: &FrameCamera, rate: &Vector3<f64>, readout_s: f64) -> Self {
        let rows = camera.size().1 as f64;
        Self { turn_per_row: rate * (readout_s / rows), middle_row: (rows - 1.0) * 0.5 }
    }

    /// The pixel where a row shows a point of the middle row's camera frame.
    #[must_use]
    pub fn project(&self, camera: &FrameCamera, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let pixel = camera.project(point)?;
        if self.turn_per_row == Vector3::zeros() {
            return Some(pixel);
        }
        let turn = self.turn_per_row * (pixel.y - self.middle_row);
        camera.project(&(point - turn.cross(point)))
    }

    /// The point at depth z = 1 on a pixel's ray, in the middle row's camera frame.
    #[must_use]
    pub fn ray(&self, camera: &FrameCamera, pixel: &Vector2<f64>) -> Vector3<f64> {
        let ray = camera.ray(pixel);
        let turn = self.turn_per_row * (pixel.y - self.middle_row);
        let turned = ray + turn.cross(&ray);
        turned / turned.z
    }

    /// The pixel that would show the same had all rows been exposed with the middle one.
    #[must_use]
    pub fn straightened(&self, camera: &FrameCamera, pixel: &Vector2<f64>) -> Vector2<f64> {
        let ray = camera.ray(pixel);
        let turn = self.turn_per_row * (pixel.y - self.middle_row);
        camera.project(&(ray + turn.cross(&ray))).unwrap_or(*pixel)
    }
}
