//! Triangulation: a landmark's position from the views that observe it.
//!
//! Linear start: the point nearest to all viewing rays, Σ (I − d dᵀ) X = Σ (I − d dᵀ) c with ray
//! directions d and camera centers c in the world (midpoint method, any number of views). It is then
//! refined on the whitened reprojection error by damped Gauss-Newton and must pass two checks: enough
//! parallax between the rays, and in front of every camera (cheirality).

use nalgebra::{Matrix3, Vector2, Vector3};

use crate::factors::{DepthReprojection, Linearization, Reprojection};
use crate::geometry::{Camera, Se3};

/// Refinement steps; the start is close, so that few are needed.
const REFINEMENT_STEPS: usize = 10;

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

/// A viewing ray in the world.
struct Ray {
    center: Vector3<f64>,
    direction: Vector3<f64>,
    /// The direction in the camera's frame, not normalized.
    in_camera: Vector3<f64>,
}

impl Ray {
    fn new(view: &View) -> Option<Self> {
        let in_camera = view.camera.unproject(&view.pixel)?;
        let direction =
            view.world_from_camera.rotation.rotate(&in_camera).try_normalize(f64::MIN_POSITIVE)?;
        Some(Self { center: view.world_from_camera.translation, direction, in_camera })
    }

    /// The point at the view's measured depth, where it has one.
    fn at_depth(&self, view: &View) -> Option<Vector3<f64>> {
        let (depth_m, _) = view.depth_m?;
        let point_in_camera = self.in_camera * (depth_m / self.in_camera.z);
        (self.in_camera.z > 0.0).then(|| view.world_from_camera.transform(&point_in_camera))
    }
}

fn largest_angle(rays: &[Ray]) -> f64 {
    let mut largest: f64 = 0.0;
    for (index, a) in rays.iter().enumerate() {
        for b in &rays[..index] {
            let (d, e) = (&a.direction, &b.direction);
            largest = largest.max(d.cross(e).norm().atan2(d.dot(e)));
        }
    }
    largest
}

fn nearest_point(rays: &[Ray]) -> Option<Vector3<f64>> {
    let mut matrix = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for ray in rays {
        let projector = Matrix3::identity() - ray.direction * ray.direction.transpose();
        matrix += projector;
        right += projector * ray.center;
    }
    matrix.cholesky().map(|c| c.solve(&right))
}

/// Levenberg-Marquardt on three unknowns; returns the best point met.
fn refine(views: &[View], start: Vector3<f64>) -> Vector3<f64> {
    let mut point = start;
    let (mut cost, _) = squared_error(views, &point);
    let mut damping = 1e-6;
    for _ in 0..REFINEMENT_STEPS {
        let mut hessian = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        for view in views {
            match view.depth_factor() {
                Some(f) => add(
                    f.linearize(&view.world_from_camera, &view.camera, &point),
                    &mut hessian,
                    &mut gradient,
                ),
                None => add(
                    view.factor().linearize(&view.world_from_camera, &view.camera, &point),
                    &mut hessian,
                    &mut gradient,
                ),
            }
        }
        for i in 0..3 {
            hessian[(i, i)] *= 1.0 + damping;
        }
        let Some(factor) = hessian.cholesky() else { return point };
        let trial = point - factor.solve(&gradient);
        let (trial_cost, _) = squared_error(views, &trial);
        if trial_cost < cost {
            let done = cost - trial_cost <= 1e-12 * cost;
            (point, cost, damping) = (trial, trial_cost, damping * 0.1);
            if done {
                return point;
            }
        } else {
            damping = (damping * 10.0).max(1e-6);
        }
    }
    point
}

fn add<const R: usize>(
    linearization: Option<Linearization<R>>,
    hessian: &mut Matrix3<f64>,
    gradient: &mut Vector3<f64>,
) {
    if let Some(l) = linearization {
        *hessian += l.d_landmark.transpose() * l.d_landmark;
        *gradient += l.d_landmark.transpose() * l.residual;
    }
}

/// Σ of squared whitened residuals and how many residuals there are; infinite where one has none.
fn squared_error(views: &[View], point: &Vector3<f64>) -> (f64, usize) {
    let mut sum = 0.0;
    let mut count = 0;
    for view in views {
        let squared = match view.depth_factor() {
            Some(factor) => {
                count += 3;
                factor
                    .residual(&view.world_from_camera, &view.camera, point)
                    .map(|r| r.norm_squared())
            }
            None => {
                count += 2;
                view.factor()
                    .residual(&view.world_from_camera, &view.camera, point)
                    .map(|r| r.norm_squared())
            }
        };
        sum += squared.unwrap_or(f64::INFINITY);
    }
    (sum, count)
}

impl View {
    fn factor(&self) -> Reprojection {
        Reprojection { pixel: self.pixel, sigma_px: self.sigma_px }
    }

    fn depth_factor(&self) -> Option<DepthReprojection> {
        let (depth_m, sigma_depth_m) = self.depth_m?;
        let (pixel, sigma_px) = (self.pixel, self.sigma_px);
        Some(DepthReprojection { pixel, depth_m, sigma_px, sigma_depth_m })
    }
}
