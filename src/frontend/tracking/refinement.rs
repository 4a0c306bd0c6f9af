//! D. The pose that explains the static matches best (the paper's equation 8, with depth).
//!
//! Robust first, then once more without what does not fit. Landmarks count the more the more frames
//! they fitted. Gives the pose, its information, and
//! which matches are inliers.

use covis_solvers::geometry::{Camera, Se3};
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{Control, IterationSummary};
use covis_solvers::pose_refinement::{self, Options, PointObservation};
use nalgebra::Matrix6;

use super::local_matching::Match;
use crate::frontend::camera::FrameCamera;
use crate::frontend::local_map::LocalMap;

/// χ² of two coordinates and a depth that one match in a hundred exceeds.
const LARGEST_CHI2: f64 = 11.3;
/// The median of that χ².
const MEDIAN_CHI2: f64 = 2.37;
/// By how much blur and a rolling shutter may make matches worse than they are at rest.
const LARGEST_SCALE: f64 = 4.0;
/// Variance of a landmark that is new, beyond that of one that fitted for long: what walks in brings
/// many landmarks at a time, and none that fits for long while those of the room have the say.
const NEW_DOUBT: f64 = 10.0;
/// Width of the first pass' loss, standard deviations.
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
    /// By how much the matches are less certain than at rest: 1 or more.
    pub scale: f64,
}

/// Refines a pose; `None` where fewer than `least` matches fit or they leave it open.
#[must_use]
pub fn refine_pose(
    camera: &FrameCamera,
    map: &LocalMap,
    matches: &[Match],
    start: &Se3,
    least: usize,
) -> Option<RefinedPose> {
    let lens = Camera::from(*camera.model());
    let doubt = |found: &Match| {
        let times = map.landmarks[found.landmark].times_tracked as f64;
        (1.0 + NEW_DOUBT / (1.0 + times)).sqrt()
    };
    let observe = |found: &Match, scale: f64| {
        let scale = scale * doubt(found);
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
        // As of landmarks that are not new: doubt is a weight, and excuses nothing.
        let errors = refined.squared_errors.iter().zip(&kept);
        let mut errors: Vec<f64> = errors.map(|(e, found)| e * doubt(found).powi(2)).collect();
        match pass {
            0 => {
                errors.sort_by(f64::total_cmp);
                scale = (errors[errors.len() / 2] / MEDIAN_CHI2).sqrt().clamp(1.0, LARGEST_SCALE);
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
