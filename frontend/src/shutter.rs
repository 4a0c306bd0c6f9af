//! A rolling shutter: rows are exposed one after the other while the camera turns.
//!
//! A frame's pose is the pose of its middle row. Row v was exposed earlier or later by its share of
//! the readout; points are projected where they were then, and rays are turned back to the middle.
//! Translation during a readout is left out: at walking speed it is a few centimeters.

use nalgebra::{Vector2, Vector3};

use super::camera::{FastLens, FrameCamera};

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
        // The row that sees it is not that of the middle; the second guess is to a tenth of a pixel.
        let seen_by = |row: f64| {
            let turn = self.turn_per_row * (row - self.middle_row);
            camera.project(&(point - turn.cross(point)))
        };
        seen_by(seen_by(pixel.y)?.y)
    }

    /// As [`Shutter::project`] in single precision and without a branch: where there is no pixel,
    /// (u, v) are not numbers.
    #[inline(always)]
    #[must_use]
    pub fn project_fast(&self, lens: &FastLens, point: [f32; 3]) -> [f32; 2] {
        let [x, y, z] = point;
        let turn = self.turn_per_row;
        let (a, b, c) = (turn.x as f32, turn.y as f32, turn.z as f32);
        let seen_by = |row: f32| {
            let rows = row - self.middle_row as f32;
            let (a, b, c) = (a * rows, b * rows, c * rows);
            lens.project([x - (b * z - c * y), y - (c * x - a * z), z - (a * y - b * x)])
        };
        let [_, row] = lens.project(point);
        let [_, row] = seen_by(row);
        seen_by(row)
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

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::{LieGroup, PinholeRadialTangential, So3};

    use super::*;

    fn camera() -> FrameCamera {
        let (k1, k2, p1, p2, k3) = (0.26, -0.95, -0.005, 0.003, 1.16);
        let model = PinholeRadialTangential {
            k1,
            k2,
            p1,
            p2,
            k3,
            ..PinholeRadialTangential::undistorted(517.0, 516.0, 318.0, 255.0)
        };
        FrameCamera::new(model, 640, 480).unwrap()
    }

    #[test]
    fn a_point_is_projected_where_its_row_saw_it_and_its_ray_leads_back() {
        let camera = camera();
        let (rate, readout_s) = (Vector3::new(0.9, -1.2, 0.7), 0.026);
        let shutter = Shutter::new(&camera, &rate, readout_s);
        for (u, v) in [(40.0, 30.0), (600.0, 60.0), (320.0, 240.0), (100.0, 450.0)] {
            let pixel = Vector2::new(u, v);
            let point = shutter.ray(&camera, &pixel) * 2.5;
            let back = shutter.project(&camera, &point).unwrap();
            assert!((back - pixel).norm() < 0.15, "{pixel}: {back}");
            // What that row saw: the camera turned, so that the point turned the other way.
            let time_s = (back.y - 239.5) / 480.0 * readout_s;
            let seen = So3::exp(&(rate * time_s)).inverse().matrix() * point;
            let truth = camera.project(&seen).unwrap();
            assert!((truth - back).norm() < 0.15, "{pixel}: {truth}");
            let straight = shutter.straightened(&camera, &pixel);
            assert!((straight - camera.project(&point).unwrap()).norm() < 1e-6);
        }
        assert!(
            (shutter.straightened(&camera, &Vector2::new(40.0, 30.0)) - Vector2::new(40.0, 30.0))
                .norm()
                > 5.0
        );
    }

    #[test]
    fn a_global_shutter_changes_nothing() {
        let camera = camera();
        let shutter = Shutter::new(&camera, &Vector3::new(3.0, 2.0, 1.0), 0.0);
        let point = Vector3::new(0.3, -0.2, 1.5);
        assert_eq!(shutter.project(&camera, &point), camera.project(&point));
        let pixel = Vector2::new(77.0, 401.0);
        assert_eq!(shutter.ray(&camera, &pixel), camera.ray(&pixel));
    }
}
