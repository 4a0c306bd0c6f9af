//! Made pairs of keyframes: one room seen twice, with noise, wrong matches and errors of the calibration.
//!
//! Feature k of the query is point k of the candidate; a wrong match has a pixel and a depth of its own.

use nalgebra::{Vector2, Vector3, Vector6};
use rand::RngExt;

use super::super::*;
use crate::geometry::PinholeRadialTangential;
use crate::initialization::View;
use crate::testing::random::{normal_vector, perturbed, seeded, uniform_vector};

/// How a scene is made.
#[derive(Clone, Copy)]
pub(super) struct Scene {
    /// Points that both see, before those outside of an image go.
    pub(super) count: usize,
    /// Share of wrong matches.
    pub(super) wrong: f64,
    /// Share of the pairs that are proposed.
    pub(super) proposed: f64,
    pub(super) query_depth: bool,
    /// Standard deviations over what is claimed.
    pub(super) noise: f64,
    /// σ of a depth is this times its square, per m.
    pub(super) sigma_depth: f64,
    /// Depth of the middle, and how far points lie around it, m.
    pub(super) distance: f64,
    pub(super) thickness: f64,
    /// Half of the width of the scene over its distance.
    pub(super) width: f64,
    pub(super) on_line: bool,
    /// Errors of both cameras are drawn with these.
    pub(super) calibration: Calibration,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            count: 160,
            wrong: 0.0,
            proposed: 1.0,
            query_depth: true,
            noise: 1.0,
            sigma_depth: 0.0015,
            distance: 3.0,
            thickness: 1.0,
            width: 0.6,
            on_line: false,
            calibration: Calibration::EXACT,
        }
    }
}

/// Two keyframes.
pub(super) struct Made {
    pub(super) truth: Se3,
    pub(super) camera: Camera,
    pub(super) features: Vec<Feature>,
    pub(super) points: Vec<PointEstimate>,
    pub(super) matches: Vec<Proposed>,
    pub(super) expected: Option<Expected>,
    /// Points that have moved.
    pub(super) moved: Vec<bool>,
    /// Features that are like no point.
    pub(super) unlike_from: Option<Vec<usize>>,
    is_wrong: Vec<bool>,
}

impl Made {
    pub(super) fn input(&self) -> Input<'_> {
        Input {
            camera: &self.camera,
            features: &self.features,
            points: &self.points,
            matches: &self.matches,
            expected: self.expected,
            seed: 5,
        }
    }

    /// How many of the inliers were proposed.
    pub(super) fn proposed_among(&self, verified: &Verified) -> usize {
        let is_inlier = |m: &&Proposed| verified.inliers.contains(&(m.point, m.feature));
        self.matches.iter().filter(is_inlier).count()
    }
}

/// The verdict; features are like the points of the same number, unless they are wrong.
pub(super) fn verdict_of(made: &Made, options: &Options) -> Verdict {
    let likeness = |point: usize, feature: usize| {
        let unlike = made.unlike_from.as_ref().is_some_and(|u| u.binary_search(&feature).is_ok());
        if point == feature && !made.is_wrong[feature] && !unlike {
            Likeness::Distance(0.1)
        } else {
            Likeness::Different
        }
    };
    verify(&made.input(), &likeness, options).unwrap()
}

fn pinhole(focal: f64, center: Vector2<f64>) -> Camera {
    Camera::Pinhole(PinholeRadialTangential::undistorted(focal, focal, center.x, center.y))
}

impl Scene {
    pub(super) fn make(&self, seed: u64) -> Made {
        self.make_repeated(seed, 0.0, Vector3::zeros())
    }

    /// With a share of the points, on one side, moved for the query.
    pub(super) fn make_repeated(&self, seed: u64, share: f64, by: Vector3<f64>) -> Made {
        let mut rng = seeded(seed);
        let c = &self.calibration;
        let errors: SVec = normal_vector(&mut rng, 1.0);
        let focal = 500.0 * (1.0 + errors[0] * c.focal);
        let center = Vector2::new(320.0, 240.0)
            + Vector2::new(errors[1], errors[2]) * (500.0 * c.center_rad);
        // The camera as it is, and as it is believed to be.
        let (real, believed) = (pinhole(focal, center), pinhole(500.0, Vector2::new(320.0, 240.0)));
        let scale = 1.0 / (1.0 + errors[3] * c.depth);
        let sigmas = Vector6::new(0.3, 0.2, 0.3, 0.1, 0.15, 0.1);
        let truth: Se3 = perturbed(&mut rng, &Se3::identity(), &sigmas);
        let in_image = |pixel: &Vector2<f64>| {
            (0.0..640.0).contains(&pixel.x) && (0.0..480.0).contains(&pixel.y)
        };
        let mut made = Made {
            truth,
            camera: believed,
            features: Vec::new(),
            points: Vec::new(),
            matches: Vec::new(),
            expected: None,
            moved: Vec::new(),
            unlike_from: None,
            is_wrong: Vec::new(),
        };
        // Enough of the scene lies outside of one of the images.
        for _ in 0..20 * self.count {
            if made.points.len() == self.count {
                break;
            }
            let spread: Vector3<f64> = uniform_vector(&mut rng, 1.0);
            let half = self.width * self.distance;
            let mut point = Vector3::new(
                half * spread.x,
                0.75 * half * spread.y,
                self.distance + self.thickness * spread.z,
            );
            if self.on_line {
                point = Vector3::new(half * spread.x, 0.1 * half * spread.x, self.distance);
            } else if self.thickness == 0.0 {
                // A wall, seen a little from the side.
                point.z += 0.3 * point.x;
            }
            let is_moved = rng.random::<f64>() < share;
            let seen = if is_moved { point + by } else { point };
            let in_b = truth.inverse_transform(&seen);
            let (Some(pixel_a), Some(pixel_b)) = (real.project(&point), real.project(&in_b)) else {
                continue;
            };
            if !in_image(&pixel_a) || !in_image(&pixel_b) || in_b.z < 0.3 || point.z < 0.3 {
                continue;
            }
            let measured = |rng: &mut _, pixel: Vector2<f64>, z: f64| {
                let noise: Vector3<f64> = normal_vector(rng, self.noise);
                let sigma = self.sigma_depth * z * z;
                let depth = (z * scale + noise.z * sigma).max(0.05);
                (pixel + Vector2::new(noise.x, noise.y), (depth, sigma))
            };
            let (pixel, depth) = measured(&mut rng, pixel_a, point.z);
            let view = View {
                world_from_camera: Se3::identity(),
                camera: believed,
                pixel,
                sigma_px: 1.0,
                depth_m: Some(depth),
            };
            let Some(landmark) = PointEstimate::from_views(&[view]) else { continue };
            let (mut pixel, mut depth) = measured(&mut rng, pixel_b, in_b.z);
            let is_wrong = rng.random::<f64>() < self.wrong;
            if is_wrong {
                pixel = Vector2::new(640.0 * rng.random::<f64>(), 480.0 * rng.random::<f64>());
                let z = self.distance + self.thickness * (2.0 * rng.random::<f64>() - 1.0);
                depth = (z, self.sigma_depth * z * z);
            }
            let index = made.points.len();
            made.points.push(landmark);
            let depth_m = self.query_depth.then_some(depth);
            made.features.push(Feature { pixel, sigma_px: 1.0, depth_m });
            made.moved.push(is_moved);
            made.is_wrong.push(is_wrong);
            if rng.random::<f64>() < self.proposed {
                made.matches.push(Proposed { point: index, feature: index, weight: 1.0 });
            }
        }
        made
    }
}

type SVec = nalgebra::Vector4<f64>;
