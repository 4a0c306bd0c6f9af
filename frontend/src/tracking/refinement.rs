//! D. The pose that explains the static matches best (the paper's equation 8, with depth).
//!
//! A robust solve first, then one more without the outliers. A landmark's weight rises with the number
//! of frames that it fitted. New landmarks in the same part of the image share one weight, because
//! they may belong to one moving object: each part of the image counts the same, however many corners
//! it has.
//! Gives the pose, its information, and which matches are inliers. Landmarks do not move.

use std::collections::BTreeMap;

use covis_solvers::geometry::{Camera, Se3};
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{Control, IterationSummary};
use covis_solvers::pose_refinement::{self, Options, PointObservation};
use nalgebra::Matrix6;

use super::local_matching::Match;
use crate::camera::FrameCamera;
use crate::local_map::LocalMap;

/// χ² of two coordinates and a depth that one match in a hundred exceeds.
const LARGEST_CHI2: f64 = 11.3;
/// The median of that χ².
const MEDIAN_CHI2: f64 = 2.37;
/// Largest factor by which blur and a rolling shutter increase the standard deviations of matches.
const LARGEST_SCALE: f64 = 4.0;
/// Added variance of a landmark that is new and alone in its block, relative to one that fitted for
/// long. A moving object has no landmarks that fitted for long, so that those of the room decide.
const NEW_VARIANCE: f64 = 10.0;
/// Width of the loss in the first two passes, standard deviations.
const WIDTH: f64 = 1.5;

/// A refined pose.
#[derive(Clone, Debug, PartialEq)]
pub struct RefinedPose {
    /// The pose in the map.
    pub world_from_camera: Se3,
    /// Its information over the right tangent, translation first.
    pub information: Matrix6<f64>,
    /// The matches that fit it.
    pub inliers: Vec<Match>,
    /// Factor on the standard deviations of the matches, relative to a camera at rest; at least 1.
    pub scale: f64,
}

/// Refines a pose; `None` where fewer than `least` matches fit or they do not determine it.
#[must_use]
pub fn refine_pose(
    camera: &FrameCamera,
    map: &LocalMap,
    matches: &[Match],
    start: &Se3,
    least: usize,
) -> Option<RefinedPose> {
    let lens = Camera::from(*camera.model());
    let crowds = crowds(map, matches);
    let sigma_factor = |found: &Match| {
        let crowd = crowds.get(&found.block()).copied().unwrap_or(0.0);
        (1.0 + NEW_VARIANCE * novelty(map, found) * crowd).sqrt()
    };
    let observe = |found: &Match, scale: f64| {
        let scale = scale * sigma_factor(found);
        PointObservation {
            point_in_world: map.landmarks[found.landmark].point_in_world,
            pixel: found.straight,
            sigma_px: found.sigma_px * scale,
            depth_m: found.depth_m.map(|(z, sigma)| (z, sigma * scale)),
        }
    };
    let mut kept = matches.to_vec();
    let mut pose = *start;
    let mut scale = 1.0;
    // The first pass finds the scale, the second what fits, the third the pose.
    for pass in 0..3 {
        if kept.len() < least {
            return None;
        }
        let observations: Vec<PointObservation> =
            kept.iter().map(|found| observe(found, scale)).collect();
        let loss = if pass < 2 { Loss::Cauchy(WIDTH) } else { Loss::Trivial };
        let options = Options { loss, ..Options::default() };
        let observer = &mut |_: &IterationSummary| Control::Continue;
        let refined =
            pose_refinement::refine(&lens, &pose, &observations, None, &options, observer).ok()?;
        pose = refined.world_from_camera;
        // Errors without the factor: it lowers the weight of a match, but must not hide an outlier.
        let errors = refined.squared_errors.iter().zip(&kept);
        let errors: Vec<f64> = errors.map(|(e, found)| e * sigma_factor(found).powi(2)).collect();
        match pass {
            0 => {
                let weights = kept.iter().map(|found| sigma_factor(found).powi(-2));
                let median = weighted_median(errors.iter().copied().zip(weights).collect());
                scale = (median / MEDIAN_CHI2).sqrt().clamp(1.0, LARGEST_SCALE);
            }
            1 => {
                let fits = |i: usize| errors[i] < LARGEST_CHI2 && !refined.behind_camera[i];
                kept = (0..kept.len()).filter(|&i| fits(i)).map(|i| kept[i]).collect();
            }
            _ => {
                let information = refined.information;
                information.cholesky()?;
                return Some(RefinedPose {
                    world_from_camera: pose,
                    information,
                    inliers: kept,
                    scale,
                });
            }
        }
    }
    None
}

/// How new a landmark is: 1 for one that never fitted, less with every frame that it fitted.
fn novelty(map: &LocalMap, found: &Match) -> f64 {
    1.0 / (1.0 + map.landmarks[found.landmark].times_tracked as f64)
}

/// The sum of novelties of the matches in each block.
fn crowds(map: &LocalMap, matches: &[Match]) -> BTreeMap<(usize, usize), f64> {
    let mut crowds = BTreeMap::new();
    for found in matches {
        *crowds.entry(found.block()).or_insert(0.0) += novelty(map, found);
    }
    crowds
}

/// The value with equal weight below and above: many new landmarks must not determine the scale of all
/// errors.
fn weighted_median(mut weighted: Vec<(f64, f64)>) -> f64 {
    weighted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = weighted.iter().map(|(_, weight)| weight).sum::<f64>() * 0.5;
    let mut below = 0.0;
    let reached = weighted.iter().find(|(_, weight)| {
        below += weight;
        below >= half
    });
    reached.map_or(0.0, |(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::{LieGroup, PinholeRadialTangential};
    use nalgebra::{Vector2, Vector3};

    use super::*;

    const ORIGIN: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);

    fn camera() -> FrameCamera {
        let lens = PinholeRadialTangential::undistorted(500.0, 500.0, 319.5, 239.5);
        FrameCamera::new(lens, 640, 480).unwrap()
    }

    /// Adds a landmark of one frame that the next one sees displaced by `moved`.
    fn see(
        (map, matches): (&mut LocalMap, &mut Vec<Match>),
        (pixel, z): (Vector2<f64>, f64),
        moved: &Vector3<f64>,
        times_tracked: usize,
    ) {
        let camera = camera();
        let point_in_world = camera.ray(&pixel) * z;
        let seen = point_in_world + moved;
        let pixel = camera.project(&seen).unwrap();
        let landmark = map.add_landmark(point_in_world);
        map.landmarks[landmark].times_tracked = times_tracked;
        let depth_m = Some((seen.z, 0.005));
        matches.push(Match { landmark, pixel, straight: pixel, sigma_px: 0.7, depth_m });
    }

    /// Adds static landmarks all over the image, at many depths.
    fn see_room(map: &mut LocalMap, matches: &mut Vec<Match>, times_tracked: usize) {
        for i in 0..40 {
            let pixel =
                Vector2::new(40.0 + 80.0 * f64::from(i % 8), 50.0 + 90.0 * f64::from(i / 8));
            let z = 1.5 + 0.01 * f64::from(i * 61 % 100);
            see((map, matches), (pixel, z), &ORIGIN, times_tracked);
        }
    }

    /// Asserts that the pose is the identity and that only static landmarks are inliers.
    fn assert_room_fits(map: &LocalMap, matches: &[Match]) {
        let found = refine_pose(&camera(), map, matches, &Se3::identity(), 12).unwrap();
        let pose = found.world_from_camera;
        let (angle, distance) = (pose.rotation.log().norm(), pose.translation.norm());
        assert!(angle < 1e-3 && distance < 2e-3, "{angle} rad, {distance} m");
        let fit: Vec<usize> = found.inliers.iter().map(|found| found.landmark).collect();
        assert!(fit.len() >= 30 && fit.iter().all(|&landmark| landmark < 40), "{fit:?} fit");
    }

    #[test]
    fn known_landmarks_outvote_more_new_ones_that_moved_together() {
        let (mut map, mut matches) = (LocalMap::default(), Vec::new());
        see_room(&mut map, &mut matches, 30);
        for i in 0..60 {
            let pixel =
                Vector2::new(50.0 + 60.0 * f64::from(i % 10), 60.0 + 60.0 * f64::from(i / 10));
            let moved = Vector3::new(0.03, 0.0, -0.02);
            see((&mut map, &mut matches), (pixel, 1.2), &moved, 0);
        }
        assert_room_fits(&map, &matches);
    }

    #[test]
    fn where_all_is_new_a_crowd_of_corners_on_one_thing_does_not_outvote_the_image() {
        let (mut map, mut matches) = (LocalMap::default(), Vec::new());
        see_room(&mut map, &mut matches, 0);
        // A sixth of the image, and two thirds of the landmarks.
        for i in 0..80 {
            let pixel =
                Vector2::new(210.0 + 20.0 * f64::from(i % 8), 90.0 + 22.0 * f64::from(i / 8));
            let z = 1.5 + 0.01 * f64::from(i % 7);
            let moved = Vector3::new(0.06, 0.01, 0.0);
            see((&mut map, &mut matches), (pixel, z), &moved, 0);
        }
        assert_room_fits(&map, &matches);
    }
}
