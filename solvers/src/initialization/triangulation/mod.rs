//! Triangulation: a landmark's position from the views that observe it.
//!
//! A linear start is refined on the whitened reprojection error (`least_squares`) and must pass the
//! checks: enough parallax between the rays, in front of every camera (cheirality), small residuals.
//! Where it does not, the point whose worst error is least (`worst_error`, a sequence of cone
//! programs over `ratios`) is the start, or the proof that there is no such point. Views that pass at
//! once never pay for that. It reads views alone: no pose is changed.

mod cone;
mod least_squares;
mod ratios;
mod worst_error;

use std::f64::consts::SQRT_2;

use nalgebra::{Vector2, Vector3};

use self::least_squares::{Ray, largest_angle, nearest_point, refine, squared_error};
use self::worst_error::least_worst_error_within;
pub use self::worst_error::{LeastWorstError, least_worst_error};
use crate::geometry::{Camera, Se3};

/// One observation of the landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The observing pose.
    pub world_from_camera: Se3,
    /// The observing camera.
    pub camera: Camera,
    /// Measured pixel (u, v).
    pub pixel: Vector2<f64>,
    /// Standard deviation of u and of v, in pixels.
    pub sigma_px: f64,
    /// Measured depth and its standard deviation, in meters, where the sensor has one. A deviation of the
    /// depth itself or more places no point.
    pub depth_m: Option<(f64, f64)>,
}

/// When a triangulated point is good enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangulationOptions {
    /// Least angle between two viewing rays, in radians (1 degree). Views with depth need none.
    pub min_parallax_rad: f64,
    /// Largest root mean square of the whitened reprojection errors (4).
    pub max_whitened_rms: f64,
    /// Views contradict each other where every point leaves some view with a whitened error longer
    /// than this (4 √2: normal noise is so long in one view of 9·10⁶, and a point that leaves less in
    /// all views has a root mean square below 4).
    pub max_whitened_error: f64,
}

impl Default for TriangulationOptions {
    fn default() -> Self {
        Self {
            min_parallax_rad: 1.0_f64.to_radians(),
            max_whitened_rms: 4.0,
            max_whitened_error: 4.0 * SQRT_2,
        }
    }
}

/// A landmark's position and how well it explains its views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangulated {
    /// The position in the world, in meters.
    pub point_in_world: Vector3<f64>,
    /// Largest angle between two viewing rays, in radians.
    pub parallax_rad: f64,
    /// Root mean square of the whitened residuals.
    pub whitened_rms: f64,
}

/// Why there is no position.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TriangulationError {
    /// One view without depth, or none at all.
    #[error("{views} views without depth are too few")]
    TooFewViews {
        /// How many there are.
        views: usize,
    },
    /// A pixel has no viewing ray in its camera's model.
    #[error("view {view} has no viewing ray")]
    NoRay {
        /// Its position in the list, from 0.
        view: usize,
    },
    /// The rays are too nearly parallel, or their best point is too far away.
    #[error("parallax of {parallax_rad} rad is too small")]
    SmallParallax {
        /// The largest angle between two rays, or as seen from the best point.
        parallax_rad: f64,
    },
    /// The point is at or behind a camera's center plane.
    #[error("the point is behind view {view}")]
    BehindCamera {
        /// The first such view, from 0.
        view: usize,
    },
    /// The point found leaves residuals that are too large.
    #[error("whitened residual of {whitened_rms} is too large")]
    Inconsistent {
        /// Root mean square of the whitened residuals.
        whitened_rms: f64,
    },
    /// The views contradict each other, whatever the point.
    #[error("no point explains all views within {max_whitened_error} sigma")]
    Contradiction {
        /// What every point in front of all cameras exceeds in some view, in standard deviations; how
        /// far, [`least_worst_error`] tells.
        max_whitened_error: f64,
    },
}

/// Finds the point that explains `views` best.
///
/// # Errors
/// [`TriangulationError`] says which condition fails.
pub fn triangulate(
    views: &[View],
    options: &TriangulationOptions,
) -> Result<Triangulated, TriangulationError> {
    let mut rays = Vec::with_capacity(views.len());
    for (index, view) in views.iter().enumerate() {
        rays.push(Ray::new(view).ok_or(TriangulationError::NoRay { view: index })?);
    }
    let with_depth = views.iter().zip(&rays).find_map(|(view, ray)| ray.at_depth(view));
    let parallax_rad = largest_angle(rays.iter().map(|ray| ray.direction));
    let start = match with_depth {
        Some(point) => Some(point),
        None if views.len() < 2 => {
            return Err(TriangulationError::TooFewViews { views: views.len() });
        }
        None if parallax_rad < options.min_parallax_rad => {
            return Err(TriangulationError::SmallParallax { parallax_rad });
        }
        None => nearest_point(&rays),
    };
    let from_start = start
        .ok_or(TriangulationError::SmallParallax { parallax_rad })
        .and_then(|start| check(views, &refine(views, start), options));
    let (point_in_world, whitened_rms) = from_start.or_else(|error| {
        let checked = from_worst_error(views, options)?.ok_or(error)?;
        // Rays that hardly meet can have an angle and their best point still be too far away.
        let parallax_rad = largest_angle(rays.iter().map(|ray| checked.0 - ray.center));
        if with_depth.is_none() && parallax_rad < options.min_parallax_rad {
            return Err(TriangulationError::SmallParallax { parallax_rad });
        }
        Ok(checked)
    })?;
    Ok(Triangulated { point_in_world, parallax_rad, whitened_rms })
}

/// A point that passed [`check`], with its whitened root mean square error.
type Checked = (Vector3<f64>, f64);

/// The position of views that the linear start served badly, or the proof that there is none; `None`
/// where the least worst error cannot be found.
fn from_worst_error(
    views: &[View],
    options: &TriangulationOptions,
) -> Result<Option<Checked>, TriangulationError> {
    let max_whitened_error = options.max_whitened_error;
    let Some(best) = least_worst_error_within(views, max_whitened_error) else { return Ok(None) };
    if best.lower_bound >= max_whitened_error {
        return Err(TriangulationError::Contradiction { max_whitened_error });
    }
    // Refinement knows nothing of cheirality and may leave the front of a camera: the start did not.
    let start = best.point_in_world;
    check(views, &refine(views, start), options)
        .or_else(|_| check(views, &start, options))
        .map(Some)
}

/// `point` with its error, where it is in front of every camera and the error is small enough.
fn check(
    views: &[View],
    point: &Vector3<f64>,
    options: &TriangulationOptions,
) -> Result<Checked, TriangulationError> {
    if let Some(view) =
        views.iter().position(|v| v.world_from_camera.inverse_transform(point).z <= 0.0)
    {
        return Err(TriangulationError::BehindCamera { view });
    }
    let (squared, residuals) = squared_error(views, point);
    let whitened_rms = (squared / residuals as f64).sqrt();
    if whitened_rms <= options.max_whitened_rms {
        return Ok((*point, whitened_rms));
    }
    let whitened_rms = if whitened_rms.is_nan() { f64::INFINITY } else { whitened_rms };
    Err(TriangulationError::Inconsistent { whitened_rms })
}
