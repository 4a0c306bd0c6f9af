//! The camera's pose from matched points, some of them false: RANSAC (Fischler and Bolles 1981).
//!
//! A correspondence is a point of the map and the same point as the camera's depth shows it. Three
//! determine the motion `camera_from_world` that minimizes Σ w ‖T x − y‖² (Umeyama 1991, without
//! scale). A correspondence agrees with a motion if the pixel of T x is near to the measured one
//! *and* its depth is within the depth's own noise: either alone lets false ones pass, the pixel
//! along the ray, the distance in space for all that is far away. Among motions the one with the
//! least Σ min(1, e²) is kept (MSAC, Torr and Zisserman 2000), e² the larger of both squared errors
//! in units of their limits, and then fitted to all that agree with it.
//!
//! Deterministic: samples come from a seed. Knows no images and no descriptors.

use covis_solvers::geometry::camera::Camera;
use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::{Matrix3, SVD, Vector2, Vector3};

use super::splitmix::SplitMix64;

/// A point of the map and where the camera measured it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correspondence {
    /// The landmark, in meters.
    pub point_in_world: Vector3<f64>,
    /// The pixel's ray at the measured depth, in meters.
    pub point_in_camera: Vector3<f64>,
}

/// What agrees, and how long to look for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlignmentOptions {
    /// The largest reprojection error in pixels.
    pub max_reprojection_px: f64,
    /// The largest depth error in standard deviations of the depth.
    pub max_depth_sigmas: f64,
    /// Fewer correspondences that agree are no answer. At least 3 are needed.
    pub min_inliers: usize,
    /// Stop when a sample of three that agree was drawn with this probability.
    pub confidence: f64,
    /// Stop after this many samples.
    pub max_samples: usize,
    /// What the samples are drawn from.
    pub seed: u64,
}

impl Default for AlignmentOptions {
    fn default() -> Self {
        Self {
            max_reprojection_px: 3.0,
            max_depth_sigmas: 3.0,
            min_inliers: 12,
            confidence: 0.999,
            max_samples: 2000,
            seed: 0,
        }
    }
}

/// A pose and what agrees with it.
#[derive(Clone, Debug, PartialEq)]
pub struct RigidAlignment {
    /// Takes points of the world to the camera.
    pub camera_from_world: Se3,
    /// Indices of the correspondences that agree, ascending.
    pub inliers: Vec<usize>,
}

/// How often the pose is fitted to what agrees with it; it settles after two or three.
const MAX_FITS: usize = 10;

/// The pose that most correspondences agree with.
///
/// `depth_sigma_m` is the standard deviation of a measured depth (z) in meters. Correspondences that
/// are not finite, not in front of the camera, or without a positive sigma agree with nothing.
/// `None` where fewer than `min_inliers` agree with the best pose that was found.
#[must_use]
pub fn align(
    camera: &Camera,
    correspondences: &[Correspondence],
    depth_sigma_m: impl Fn(f64) -> f64,
    options: &AlignmentOptions,
) -> Option<RigidAlignment> {
    let measure = |(index, c): (usize, &Correspondence)| {
        Measured::new(index, c, camera, depth_sigma_m(c.point_in_camera.z), options)
    };
    let measured: Vec<Measured> = correspondences.iter().enumerate().filter_map(measure).collect();
    let needed = options.min_inliers.max(3);
    if measured.len() < needed {
        return None;
    }
    let mut pose = search(camera, &measured, options)?;
    let mut inliers = agreeing(camera, &measured, &pose);
    for _ in 0..MAX_FITS {
        if inliers.len() < needed {
            return None;
        }
        let refitted = fit(inliers.iter().map(|&k| &measured[k]))?;
        let agreeing = agreeing(camera, &measured, &refitted);
        if agreeing.len() < inliers.len() {
            break;
        }
        let settled = agreeing == inliers;
        (pose, inliers) = (refitted, agreeing);
        if settled {
            break;
        }
    }
    (inliers.len() >= needed).then(|| RigidAlignment {
        camera_from_world: pose,
        inliers: inliers.iter().map(|&k| measured[k].index).collect(),
    })
}

/// A correspondence with what its errors are judged by.
struct Measured {
    index: usize,
    world: Vector3<f64>,
    camera: Vector3<f64>,
    pixel: Vector2<f64>,
    /// Squared error in pixels and in meters of depth at which it no longer agrees.
    limits: [f64; 2],
    /// How far the measured point may be from the true one, about, in meters.
    reach_m: f64,
    /// 1 / σ² of the depth.
    weight: f64,
}

impl Measured {
    fn new(
        index: usize,
        correspondence: &Correspondence,
        model: &Camera,
        sigma_m: f64,
        options: &AlignmentOptions,
    ) -> Option<Self> {
        let Correspondence { point_in_world: world, point_in_camera: camera } = *correspondence;
        let finite = world.iter().chain(&camera).all(|value| value.is_finite());
        if !(finite && camera.z > 0.0 && sigma_m > 0.0 && sigma_m.is_finite()) {
            return None;
        }
        let pixel = model.project(&camera)?;
        let depth_m = options.max_depth_sigmas * sigma_m;
        let lateral_m = options.max_reprojection_px * camera.z / model.mean_focal_px();
        Some(Self {
            index,
            world,
            camera,
            pixel,
            limits: [options.max_reprojection_px.powi(2), depth_m * depth_m],
            reach_m: depth_m * camera.norm() / camera.z + lateral_m,
            weight: 1.0 / (sigma_m * sigma_m),
        })
    }

    /// The larger of both squared errors in units of their limits; it agrees up to 1.
    fn error(&self, model: &Camera, pose: &Se3) -> f64 {
        let predicted = pose.transform(&self.world);
        if predicted.z <= 0.0 {
            return f64::INFINITY;
        }
        let depth = (predicted.z - self.camera.z).powi(2) / self.limits[1];
        if depth > 1.0 {
            return depth;
        }
        let Some(pixel) = model.project(&predicted) else { return f64::INFINITY };
        depth.max((pixel - self.pixel).norm_squared() / self.limits[0])
    }
}

fn agreeing(camera: &Camera, measured: &[Measured], pose: &Se3) -> Vec<usize> {
    (0..measured.len()).filter(|&k| measured[k].error(camera, pose) <= 1.0).collect()
}

/// The best pose of samples of three.
fn search(camera: &Camera, measured: &[Measured], options: &AlignmentOptions) -> Option<Se3> {
    let mut generator = SplitMix64(options.seed);
    let mut best: Option<(f64, Se3)> = None;
    let (mut drawn, mut wanted) = (0, options.max_samples);
    while drawn < wanted {
        drawn += 1;
        let Some(pose) = sample_pose(measured, &mut generator) else { continue };
        let bound = best.as_ref().map_or(f64::INFINITY, |(cost, _)| *cost);
        let (mut cost, mut agree) = (0.0, 0);
        for one in measured {
            let error = one.error(camera, &pose);
            agree += usize::from(error <= 1.0);
            cost += error.min(1.0);
            if cost >= bound {
                break;
            }
        }
        if cost < bound {
            best = Some((cost, pose));
            wanted = wanted.min(samples_needed(agree, measured.len(), options.confidence));
        }
    }
    best.map(|(_, pose)| pose)
}

/// Samples until one is of three that agree, with this probability: ln(1 − p) / ln(1 − w³).
fn samples_needed(agree: usize, all: usize, confidence: f64) -> usize {
    let share = (agree as f64 / all as f64).powi(3);
    let samples = (1.0 - confidence).ln() / (1.0 - share).ln();
    // Also for shares of 0 and 1; a cast saturates.
    if samples.is_nan() { usize::MAX } else { samples.ceil().max(1.0) as usize }
}

/// The pose of three different correspondences; `None` where their triangles are not congruent
/// within what the noise allows, which throws most of the false samples out for the price of three
/// distances, or where a triangle is too thin to determine a rotation.
fn sample_pose(measured: &[Measured], generator: &mut SplitMix64) -> Option<Se3> {
    let count = measured.len();
    // Without drawing twice: each is one of those that are left, counted past the ones taken.
    let first = generator.below(count);
    let mut second = generator.below(count - 1);
    second += usize::from(second >= first);
    let mut third = generator.below(count - 2);
    for taken in [first.min(second), first.max(second)] {
        third += usize::from(third >= taken);
    }
    let three = [first, second, third].map(|k| &measured[k]);
    let [a, b, c] = three;
    for (p, q) in [(a, b), (b, c), (c, a)] {
        let difference = (p.world - q.world).norm() - (p.camera - q.camera).norm();
        if difference.abs() > p.reach_m + q.reach_m {
            return None;
        }
    }
    // The triangle's height over its longest side must exceed the noise.
    let sides = [b.camera - a.camera, c.camera - a.camera, c.camera - b.camera];
    let longest = sides.iter().map(Vector3::norm).fold(0.0, f64::max);
    let height = sides[0].cross(&sides[1]).norm() / longest;
    if height <= a.reach_m.max(b.reach_m).max(c.reach_m) {
        return None;
    }
    fit(three.into_iter())
}

/// The motion that minimizes Σ w ‖T x − y‖²; `None` where the points do not determine a rotation.
fn fit<'a>(points: impl Iterator<Item = &'a Measured> + Clone) -> Option<Se3> {
    let (mut total, mut world, mut camera) = (0.0, Vector3::zeros(), Vector3::zeros());
    for p in points.clone() {
        total += p.weight;
        world += p.weight * p.world;
        camera += p.weight * p.camera;
    }
    let (world, camera) = (world / total, camera / total);
    let mut covariance = Matrix3::zeros();
    for p in points {
        covariance += p.weight / total * (p.camera - camera) * (p.world - world).transpose();
    }
    let svd = SVD::new(covariance, true, true);
    let (u, v_transposed) = (svd.u?, svd.v_t?);
    // Points on a line leave the turn around it free.
    if svd.singular_values[1] <= 1e-12 * svd.singular_values[0] {
        return None;
    }
    let sign = if u.determinant() * v_transposed.determinant() < 0.0 { -1.0 } else { 1.0 };
    let signs = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign));
    let rotation = So3::from_matrix(&(u * signs * v_transposed));
    let pose = Se3::new(rotation, camera - rotation.rotate(&world));
    pose.is_finite().then_some(pose)
}
