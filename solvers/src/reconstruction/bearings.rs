//! Observations as rays: what a reconstruction works on, sorted by keyframe and by landmark.
//!
//! A bearing is a unit ray in its camera with a standard deviation in radians, and where there is a depth
//! the distance along the ray. Bearings are numbered as the problem's observations: those without depth
//! first, then those with. It reads no pose and no landmark.

use nalgebra::Vector3;

use crate::factors::Reprojection;
use crate::geometry::Camera;
use crate::order;
use crate::problem::{BundleProblem, Observation};

/// One observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bearing {
    pub(super) pose: usize,
    pub(super) camera: usize,
    pub(super) landmark: usize,
    pub(super) seen: Reprojection,
    /// In the camera, of unit length; zero where the pixel has none, and the bearing is not used then.
    pub(super) ray: Vector3<f64>,
    /// Standard deviation of the ray's direction, rad.
    pub(super) sigma_rad: f64,
}

impl Bearing {
    fn new(cameras: &[Camera], observation: &Observation) -> Self {
        let Observation { pose, camera, landmark, seen } = *observation;
        let of = ray(&cameras[camera as usize], &seen);
        let (ray, sigma_rad) = of.unwrap_or((Vector3::zeros(), 0.0));
        let (pose, camera, landmark) = (pose as usize, camera as usize, landmark as usize);
        Self { pose, camera, landmark, seen, ray, sigma_rad }
    }

    /// Whether there is a ray.
    pub(super) fn is_usable(&self) -> bool {
        self.sigma_rad > 0.0
    }

    /// The point in the camera that is measured, with its distance and the standard deviation of that, m.
    pub(super) fn point_in_camera(&self) -> Option<(Vector3<f64>, f64, f64)> {
        let (depth, sigma) = self.seen.depth_m.filter(|&(depth, _)| depth > 0.0)?;
        let distance = depth / self.ray.z;
        (self.ray.z > 0.0).then(|| (self.ray * distance, distance, sigma / self.ray.z))
    }
}

/// All observations of a problem.
#[derive(Clone, Debug)]
pub(super) struct Bearings {
    pub(super) all: Vec<Bearing>,
    /// Bearings of each pose, by rising landmark, usable ones, one a landmark.
    pub(super) of_pose: Vec<Vec<u32>>,
    /// Bearings of each landmark, by rising pose, those of `of_pose`.
    pub(super) of_landmark: Vec<Vec<u32>>,
}

impl Bearings {
    /// The problem is valid.
    pub(super) fn new(problem: &BundleProblem) -> Self {
        let all: Vec<Bearing> =
            problem.observations().map(|o| Bearing::new(&problem.cameras, &o)).collect();
        let mut of_pose = vec![Vec::new(); problem.poses.len()];
        for (index, bearing) in all.iter().enumerate().filter(|(_, bearing)| bearing.is_usable()) {
            of_pose[bearing.pose].push(index as u32);
        }
        let mut of_landmark = vec![Vec::new(); problem.landmarks.len()];
        for bearings in &mut of_pose {
            // By landmark, the first observation where there are several of one.
            order::sort_by_key(bearings, &|s| all[s as usize].landmark as u64);
            bearings.dedup_by_key(|s| all[*s as usize].landmark);
            for &s in bearings.iter() {
                of_landmark[all[s as usize].landmark].push(s);
            }
        }
        Self { all, of_pose, of_landmark }
    }

    /// Takes the rays of cameras that have changed.
    pub(super) fn set_cameras(&mut self, cameras: &[Camera]) {
        for bearing in &mut self.all {
            if bearing.is_usable()
                && let Some((ray, sigma)) = ray(&cameras[bearing.camera], &bearing.seen)
            {
                (bearing.ray, bearing.sigma_rad) = (ray, sigma);
            }
        }
    }

    pub(super) fn get(&self, index: u32) -> &Bearing {
        &self.all[index as usize]
    }

    /// Pairs of bearings of the landmarks that two poses share, by rising landmark.
    pub(super) fn common(&self, a: usize, b: usize) -> Vec<(u32, u32)> {
        let (first, second) = (&self.of_pose[a], &self.of_pose[b]);
        let mut pairs = Vec::new();
        let (mut i, mut j) = (0, 0);
        while let (Some(&s), Some(&t)) = (first.get(i), second.get(j)) {
            let order = self.get(s).landmark.cmp(&self.get(t).landmark);
            if order.is_eq() {
                pairs.push((s, t));
            }
            i += usize::from(order.is_le());
            j += usize::from(order.is_ge());
        }
        pairs
    }
}

/// The unit ray of a pixel and its standard deviation.
fn ray(camera: &Camera, seen: &Reprojection) -> Option<(Vector3<f64>, f64)> {
    let ray = camera.unproject(&seen.pixel)?.try_normalize(f64::MIN_POSITIVE)?;
    let d_point = camera.project_with_jacobians(&ray)?.d_point;
    let tangent = super::tangent_basis(&ray);
    // Pixels a radian, as the root of how areas grow.
    let px_per_rad = (d_point * tangent).determinant().abs().sqrt();
    let sigma = seen.sigma_px / px_per_rad;
    (sigma > 0.0 && sigma.is_finite() && ray.iter().all(|v| v.is_finite())).then_some((ray, sigma))
}
