//! A synthetic RGB-D walk through a room, with known truth, noise, drift and a loop.
//!
//! The camera walks `laps` of a circle and looks outward at landmarks on the walls of a square
//! room. Odometry is the true motion plus noise, so that the start estimate drifts. A landmark that
//! was out of sight for a while comes back under a new id, as with any frontend that tracks locally:
//! only a loop closure ties the two ends together.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, SVector, Vector2, Vector3};
use rand::{Rng, RngExt};

use super::random::{normal_vector, perturbed, seeded};
use crate::factors::Reprojection;
use crate::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3, So3};
use crate::problem::BundleProblem;

/// Half the room's side, in meters.
const HALF_ROOM_M: f64 = 5.0;

/// Height of the room, in meters; the camera walks at the middle.
const ROOM_HEIGHT_M: f64 = 3.0;

/// Radius of the walk, in meters.
const WALK_RADIUS_M: f64 = 2.0;

/// Image size in pixels.
const IMAGE_PX: (u32, u32) = (640, 480);

/// A landmark unseen for so many keyframes comes back under a new id.
const FORGOTTEN_AFTER: usize = 8;

/// What to make.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneOptions {
    /// Keyframes of the walk.
    pub keyframes: usize,
    /// How often the walk goes round; a little more than 1 closes a loop.
    pub laps: f64,
    /// Landmarks on the walls.
    pub landmarks: usize,
    /// Standard deviation of an observed pixel coordinate, in pixels.
    pub sigma_px: f64,
    /// Standard deviation of a depth measurement at 1 m, growing with the square of the depth.
    pub sigma_depth_m: f64,
    /// Standard deviation of odometry between keyframes: meters, then radians, each axis.
    pub odometry_sigma: (f64, f64),
    /// Seed of all noise.
    pub seed: u64,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            keyframes: 60,
            laps: 1.1,
            landmarks: 1500,
            sigma_px: 0.7,
            sigma_depth_m: 0.004,
            odometry_sigma: (0.012, 0.006),
            seed: 1,
        }
    }
}

/// One observation of a landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneObservation {
    /// The landmark's id as the frontend knows it.
    pub landmark: usize,
    /// What was measured.
    pub measurement: Reprojection,
}

/// A walk with its truth.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The camera of every keyframe.
    pub camera: Camera,
    /// Image size in pixels.
    pub image_px: (u32, u32),
    /// Seconds of each keyframe.
    pub timestamps_s: Vec<f64>,
    /// True `world_from_camera` of each keyframe.
    pub truth: Vec<Se3>,
    /// Drifting start estimate; the first is the truth.
    pub odometry: Vec<Se3>,
    /// True position of each landmark id.
    pub landmarks: Vec<Vector3<f64>>,
    /// Observations of each keyframe, by rising landmark id.
    pub observations: Vec<Vec<SceneObservation>>,
    /// Loop closures (i, j, measured `keyframe_i_from_keyframe_j`), i the older.
    pub loop_closures: Vec<(usize, usize, Se3)>,
}

impl Scene {
    /// Makes the scene of `options`.
    #[must_use]
    pub fn generate(options: &SceneOptions) -> Self {
        let mut rng = seeded(options.seed);
        let camera = Camera::Pinhole(PinholeRadialTangential {
            fx: 525.0,
            fy: 525.0,
            cx: 319.5,
            cy: 239.5,
            k1: 0.05,
            k2: -0.02,
            p1: 0.0005,
            p2: -0.0005,
            k3: 0.0,
        });
        let points: Vec<_> = (0..options.landmarks).map(|_| wall_point(&mut rng)).collect();
        let angle = |k: usize| TAU * options.laps * k as f64 / options.keyframes as f64;
        let truth: Vec<Se3> = (0..options.keyframes).map(|k| outward_pose(angle(k))).collect();
        let mut scene = Self {
            camera,
            image_px: IMAGE_PX,
            timestamps_s: (0..options.keyframes).map(|k| k as f64 * 0.5).collect(),
            odometry: drift(&truth, options, &mut rng),
            truth,
            landmarks: Vec::new(),
            observations: Vec::new(),
            loop_closures: Vec::new(),
        };
        scene.observe(&points, options, &mut rng);
        scene.close_loops(&mut rng);
        scene
    }

    /// The whole walk as a bundle adjustment from the drifting start, first pose constant.
    #[must_use]
    pub fn to_problem(&self) -> BundleProblem {
        let mut problem = BundleProblem::default();
        let camera = problem.push_camera(self.camera, true) as u32;
        for pose in &self.odometry {
            problem.push_pose(*pose);
        }
        if let Some(first) = problem.constant_poses.first_mut() {
            *first = true;
        }
        for start in self.start_landmarks() {
            problem.push_landmark(start);
        }
        for (pose, observations) in self.observations.iter().enumerate() {
            for o in observations {
                let (pose, landmark) = (pose as u32, o.landmark as u32);
                problem.push_observation(pose, camera, landmark, o.measurement);
            }
        }
        problem
    }

    /// Each landmark's position from its first measurement and the drifting pose there.
    #[must_use]
    pub fn start_landmarks(&self) -> Vec<Vector3<f64>> {
        let mut start = vec![None; self.landmarks.len()];
        for (pose, observations) in self.odometry.iter().zip(&self.observations) {
            for o in observations {
                let ray = self.camera.unproject(&o.measurement.pixel);
                let point = ray
                    .zip(o.measurement.depth_m)
                    .map(|(ray, (depth, _))| pose.transform(&(ray * (depth / ray.z))));
                if let Some(entry @ None) = start.get_mut(o.landmark) {
                    *entry = point;
                }
            }
        }
        start.into_iter().zip(&self.landmarks).map(|(s, truth)| s.unwrap_or(*truth)).collect()
    }

    fn observe(&mut self, points: &[Vector3<f64>], options: &SceneOptions, rng: &mut impl Rng) {
        // The id under which each point is tracked now, and the keyframe that saw it last.
        let mut tracked: Vec<Option<(usize, usize)>> = vec![None; points.len()];
        for (keyframe, pose) in self.truth.iter().enumerate() {
            let mut seen = Vec::new();
            for (point, track) in points.iter().zip(&mut tracked) {
                let in_camera = pose.inverse_transform(point);
                let Some(pixel) = visible(&self.camera, &in_camera) else { continue };
                let id = match *track {
                    Some((id, last)) if keyframe - last <= FORGOTTEN_AFTER => id,
                    _ => {
                        self.landmarks.push(*point);
                        self.landmarks.len() - 1
                    }
                };
                *track = Some((id, keyframe));
                let sigma_depth_m = options.sigma_depth_m * in_camera.z * in_camera.z;
                let noise: SVector<f64, 3> = normal_vector(rng, 1.0);
                let depth_m = in_camera.z + noise.z * sigma_depth_m;
                let measurement = Reprojection {
                    pixel: pixel + Vector2::new(noise.x, noise.y) * options.sigma_px,
                    sigma_px: options.sigma_px,
                    depth_m: Some((depth_m, sigma_depth_m)),
                };
                seen.push(SceneObservation { landmark: id, measurement });
            }
            seen.sort_by_key(|o| o.landmark);
            self.observations.push(seen);
        }
    }

    /// One closure for each keyframe past the first lap, to the nearest old keyframe.
    fn close_loops(&mut self, rng: &mut impl Rng) {
        let sigmas = SVector::from([0.005, 0.005, 0.005, 0.002, 0.002, 0.002]);
        for j in 0..self.truth.len() {
            let near = (0..j.saturating_sub(self.truth.len() / 2))
                .map(|i| ((self.truth[j].translation - self.truth[i].translation).norm(), i))
                .filter(|&(distance, _)| distance < 0.15)
                .min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, i)) = near {
                let i_from_j = self.truth[i].inverse().compose(&self.truth[j]);
                self.loop_closures.push((i, j, perturbed(rng, &i_from_j, &sigmas)));
            }
        }
    }
}

/// A point on one of the four walls, in meters; z is up.
fn wall_point(rng: &mut impl Rng) -> Vector3<f64> {
    let along = HALF_ROOM_M * (2.0 * rng.random::<f64>() - 1.0);
    let height = ROOM_HEIGHT_M * rng.random::<f64>();
    // Shelves and frames: up to half a meter off the wall.
    let wall = HALF_ROOM_M - 0.5 * rng.random::<f64>();
    match rng.random_range(0..4) {
        0 => Vector3::new(wall, along, height),
        1 => Vector3::new(-wall, along, height),
        2 => Vector3::new(along, wall, height),
        _ => Vector3::new(along, -wall, height),
    }
}

/// A camera on the circle that looks outward, x to its right along the walk, y down.
fn outward_pose(angle: f64) -> Se3 {
    let forward = Vector3::new(angle.cos(), angle.sin(), 0.0);
    let down = Vector3::new(0.0, 0.0, -1.0);
    let right = down.cross(&forward);
    let rotation = So3::from_matrix(&Matrix3::from_columns(&[right, down, forward]));
    let position = forward * WALK_RADIUS_M + Vector3::new(0.0, 0.0, ROOM_HEIGHT_M / 2.0);
    Se3::new(rotation, position)
}

fn visible(camera: &Camera, in_camera: &Vector3<f64>) -> Option<Vector2<f64>> {
    // Far off the axis the distortion polynomial folds back into the image.
    if in_camera.z < 0.3 || in_camera.xy().norm() > in_camera.z {
        return None;
    }
    let pixel = camera.project(in_camera)?;
    let (width, height) = (f64::from(IMAGE_PX.0), f64::from(IMAGE_PX.1));
    let inside = (0.0..width - 1.0).contains(&pixel.x) && (0.0..height - 1.0).contains(&pixel.y);
    inside.then_some(pixel)
}

fn drift(truth: &[Se3], options: &SceneOptions, rng: &mut impl Rng) -> Vec<Se3> {
    let (meters, radians) = options.odometry_sigma;
    let sigmas = SVector::from([meters, meters, meters, radians, radians, radians]);
    let mut odometry: Vec<Se3> = Vec::with_capacity(truth.len());
    for (k, pose) in truth.iter().enumerate() {
        let next = match odometry.last() {
            None => *pose,
            Some(last) => {
                let motion = truth[k - 1].inverse().compose(pose);
                last.compose(&perturbed(rng, &motion, &sigmas))
            }
        };
        odometry.push(next);
    }
    odometry
}
