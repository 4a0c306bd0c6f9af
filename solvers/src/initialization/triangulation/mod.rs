//! Triangulation: a landmark's position from the views that observe it.
//!
//! A linear start (`linear`) is refined on the whitened reprojection error (`refinement`) and must
//! pass two checks: enough parallax between the rays, and in front of every camera (cheirality).
//! `worst_error` stands beside it: the point whose worst error is least, by cone programs over `ratios`.

mod cone;
mod linear;
mod ratios;
mod refinement;
mod worst_error;

use nalgebra::{Vector2, Vector3};

use self::linear::{Ray, largest_angle, nearest_point};
use self::refinement::{refine, squared_error};
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
    /// Measured depth and its standard deviation, in meters, where the sensor has one.
    pub depth_m: Option<(f64, f64)>,
}

/// When a triangulated point is good enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangulationOptions {
    /// Least angle between two viewing rays, in radians (1 degree). Views with depth need none.
    pub min_parallax_rad: f64,
    /// Largest root mean square of the whitened reprojection errors (4).
    pub max_whitened_rms: f64,
}

impl Default for TriangulationOptions {
    fn default() -> Self {
        Self { min_parallax_rad: 1.0_f64.to_radians(), max_whitened_rms: 4.0 }
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
    /// The rays are too nearly parallel.
    #[error("parallax of {parallax_rad} rad is too small")]
    SmallParallax {
        /// The largest angle between two rays.
        parallax_rad: f64,
    },
    /// The point is at or behind a camera's center plane.
    #[error("the point is behind view {view}")]
    BehindCamera {
        /// The first such view, from 0.
        view: usize,
    },
    /// The views contradict each other.
    #[error("whitened residual of {whitened_rms} is too large")]
    Inconsistent {
        /// Root mean square of the whitened residuals.
        whitened_rms: f64,
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
    let parallax_rad = largest_angle(&rays);
    let start = match with_depth {
        Some(point) => point,
        None if views.len() < 2 => {
            return Err(TriangulationError::TooFewViews { views: views.len() });
        }
        None if parallax_rad < options.min_parallax_rad => {
            return Err(TriangulationError::SmallParallax { parallax_rad });
        }
        None => nearest_point(&rays).ok_or(TriangulationError::SmallParallax { parallax_rad })?,
    };
    let point_in_world = refine(views, start);
    if let Some(view) =
        views.iter().position(|v| v.world_from_camera.inverse_transform(&point_in_world).z <= 0.0)
    {
        return Err(TriangulationError::BehindCamera { view });
    }
    let (squared, residuals) = squared_error(views, &point_in_world);
    let whitened_rms = (squared / residuals as f64).sqrt();
    if whitened_rms.is_nan() || whitened_rms > options.max_whitened_rms {
        return Err(TriangulationError::Inconsistent { whitened_rms });
    }
    Ok(Triangulated { point_in_world, parallax_rad, whitened_rms })
}
