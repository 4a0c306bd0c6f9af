//! A camera that moves along an endless wall of points, without images: what a load on a server is
//! made of.
//!
//! The camera looks at the wall (z) and moves along it (x). Points are evenly spaced along the wall at
//! random heights and distances of 3 to 6 m; each view shows the nearest, a tenth of them for the first
//! time. Poses are odometry, which drifts. Everything is a function of the seed and the view's number.
//! Knows neither clients nor messages.

use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3};
use nalgebra::{SVector, Vector2, Vector3};

use super::random::{normal_pair, number, uniform};

/// Width of the wall that a view shows, meters: in the image from 3 m on.
const SHOWN_M: f64 = 3.0;
/// The share of a view's points that the one before did not show.
const NEW_SHARE: f64 = 0.1;
/// Distance of the nearest points, and how much further the others may be, meters.
const NEAREST_M: f64 = 3.0;
const DEPTH_M: f64 = 3.0;
/// Deviation of odometry from one view to the next, meters and radians.
const DRIFT_M: f64 = 1e-3;
const DRIFT_RAD: f64 = 2e-4;
/// Deviation of pixels, and of depths at one meter.
const SIGMA_PX: f64 = 0.5;
const SIGMA_DEPTH: f64 = 1.425e-3;

/// A point as a view shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Its number along the wall.
    pub landmark: u64,
    /// Where it is in the image.
    pub pixel: Vector2<f64>,
    /// How far it is along the optical axis, meters.
    pub depth_m: f64,
    /// Deviation of the depth, meters.
    pub sigma_depth_m: f64,
    /// Whether no view before showed it.
    pub is_new: bool,
}

/// What the camera has at one place.
#[derive(Clone, Debug, PartialEq)]
pub struct CorridorView {
    /// The pose as odometry has it.
    pub odom_from_camera: Se3,
    /// The points in the image.
    pub sightings: Vec<Sighting>,
}

/// The views of a camera, one after the other, without end.
#[derive(Clone, Debug)]
pub struct Corridor {
    seed: u64,
    /// Points in a view.
    points: u64,
    next: u64,
    odom_from_camera: Se3,
}

impl Corridor {
    /// A wall of its own for each seed; `points` are in each view, at least 10.
    #[must_use]
    pub fn new(seed: u64, points: u32) -> Self {
        let points = u64::from(points.max(10));
        Self { seed, points, next: 0, odom_from_camera: Se3::identity() }
    }

    /// The camera of all views, and its image's width and height.
    #[must_use]
    pub fn camera() -> (Camera, [i32; 2]) {
        let camera = PinholeRadialTangential::undistorted(525.0, 525.0, 319.5, 239.5);
        (Camera::Pinhole(camera), [640, 480])
    }

    /// Deviation of pixels.
    #[must_use]
    pub fn sigma_px() -> f64 {
        SIGMA_PX
    }

    /// Points that a view shows and the one before did not.
    fn new_points(&self) -> u64 {
        (self.points as f64 * NEW_SHARE) as u64
    }

    /// Random numbers of a stream that is this corridor's own.
    fn bits(&self, stream: u64, index: u64) -> u64 {
        number(number(self.seed, stream), index)
    }

    fn point(&self, landmark: u64) -> Vector3<f64> {
        let along = landmark as f64 * SHOWN_M / self.points as f64;
        let height = 2.0 * uniform(self.bits(0, landmark)) - 1.0;
        Vector3::new(along, height, NEAREST_M + DEPTH_M * uniform(self.bits(1, landmark)))
    }

    fn step(&mut self, view: u64) {
        let advance = self.new_points() as f64 * SHOWN_M / self.points as f64;
        let noise = |k: u64| normal_pair(self.bits(2, 3 * view + k)).map(f64::from);
        let [[a, b], [c, d], [e, f]] = [noise(0), noise(1), noise(2)];
        let tangent = [
            advance + DRIFT_M * a,
            DRIFT_M * b,
            DRIFT_M * c,
            DRIFT_RAD * d,
            DRIFT_RAD * e,
            DRIFT_RAD * f,
        ];
        self.odom_from_camera = self.odom_from_camera.compose(&Se3::exp(&SVector::from(tangent)));
    }
}

impl Iterator for Corridor {
    type Item = CorridorView;

    fn next(&mut self) -> Option<CorridorView> {
        let view = self.next;
        if view > 0 {
            self.step(view);
        }
        let first = view * self.new_points();
        let center = (first as f64 + 0.5 * self.points as f64) * SHOWN_M / self.points as f64;
        let known = if view == 0 { 0 } else { self.points - self.new_points() };
        let (camera, _) = Self::camera();
        let sighting = |k: u64| {
            let landmark = first + k;
            let in_camera = self.point(landmark) - Vector3::new(center, 0.0, 0.0);
            let noise = |j: u64| {
                let index = 2 * (view * self.points + k) + j;
                normal_pair(self.bits(3, index)).map(f64::from)
            };
            let ([du, dv], [dz, _]) = (noise(0), noise(1));
            let sigma_depth_m = SIGMA_DEPTH * in_camera.z * in_camera.z;
            Some(Sighting {
                landmark,
                pixel: camera.project(&in_camera)? + SIGMA_PX * Vector2::new(du, dv),
                depth_m: in_camera.z + sigma_depth_m * dz,
                sigma_depth_m,
                is_new: k >= known,
            })
        };
        let sightings = (0..self.points).filter_map(sighting).collect();
        self.next += 1;
        Some(CorridorView { odom_from_camera: self.odom_from_camera, sightings })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_point_is_in_the_image_and_new_once() {
        let (_, [width, height]) = Corridor::camera();
        let mut seen = BTreeSet::new();
        for view in Corridor::new(3, 200).take(50) {
            assert_eq!(view.sightings.len(), 200);
            for s in &view.sightings {
                assert_eq!(seen.insert(s.landmark), s.is_new, "{s:?}");
                let inside = s.pixel.x > 0.0 && s.pixel.x < f64::from(width);
                assert!(inside && s.pixel.y > 0.0 && s.pixel.y < f64::from(height), "{s:?}");
            }
        }
        assert_eq!(seen.len(), 200 + 49 * 20);
    }

    #[test]
    fn points_agree_with_the_poses_up_to_noise_and_drift() {
        let (camera, _) = Corridor::camera();
        let mut placed = std::collections::BTreeMap::new();
        for view in Corridor::new(7, 100).take(20) {
            for s in &view.sightings {
                let Some(ray) = camera.unproject(&s.pixel) else { panic!("no ray of {s:?}") };
                let point = view.odom_from_camera.transform(&(ray * (s.depth_m / ray.z)));
                let first = *placed.entry(s.landmark).or_insert(point);
                assert!((point - first).norm() < 0.3, "{s:?}");
            }
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_views_and_another_one_others() {
        let views = |seed| Corridor::new(seed, 50).take(5).collect::<Vec<_>>();
        assert_eq!(views(1), views(1));
        assert_ne!(views(1), views(2));
    }
}
