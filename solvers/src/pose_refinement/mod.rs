//! Motion-only refinement: one pose from observations of known landmarks.
//!
//! Minimizes ½ Σ ρ(‖r‖²) over `world_from_camera` (equation 8 of the reference frontend's paper),
//! with an optional prior. Six unknowns: one dense 6 × 6 system a step, on the caller's thread.
//! Observations are packed by eight (`observations`) and summed in lanes (`normal_equations`: cost, H
//! and g in one pass); `one_by_one` takes over where a number is not finite. Landmarks and camera stay
//! as they are.

mod normal_equations;
mod observations;
mod one_by_one;
mod system;
#[cfg(test)]
mod tests;

use std::time::Instant;

use nalgebra::{SMatrix, Vector2, Vector3};

use crate::factors::PosePrior;
use crate::geometry::{Camera, LieGroup, Se3};
use crate::information::Information;
use crate::interrupt::Interrupt;
use crate::loss::Loss;
use crate::optimizer::{self, Observer, SolveSummary, minimize};
use crate::price::Price;
use crate::problem::SolveError;
use crate::simd::Class;

use observations::Observations;
use system::{PoseSystem, Terms};

/// A known landmark as this camera sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointObservation {
    /// The landmark's position, in meters.
    pub point_in_world: Vector3<f64>,
    /// Measured pixel (u, v).
    pub pixel: Vector2<f64>,
    /// Standard deviation of u and of v, in pixels.
    pub sigma_px: f64,
    /// Measured depth and its standard deviation, in meters.
    pub depth_m: Option<(f64, f64)>,
}

/// A measured pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// The measurement.
    pub world_from_camera: Se3,
    /// Ω over the tangent, translation first.
    pub information: Information<6>,
}

/// Options of [`refine`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// The loop's options; `threads` is not used.
    pub optimizer: optimizer::Options,
    /// The loss of every observation.
    pub loss: Loss,
    /// The instruction set of the kernels; `None` takes the widest of this processor.
    pub class: Option<Class>,
}

impl Options {
    fn validate(&self) -> Result<(), SolveError> {
        self.optimizer.validate()?;
        if !self.loss.is_valid() {
            let reason = "the width must be finite and positive";
            return Err(SolveError::InvalidOption { field: "loss", reason });
        }
        Ok(())
    }
}

/// The refined pose and what it says of its observations.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// The pose.
    pub world_from_camera: Se3,
    /// What the loop did.
    pub summary: SolveSummary,
    /// H = Σ w JᵀJ at the result, over the right tangent, translation first. Zero where the loss
    /// gave up every observation: then nothing pulls at the start, and it counts as converged.
    pub information: SMatrix<f64, 6, 6>,
    /// Whitened squared residual s of each observation.
    pub squared_errors: Vec<f64>,
    /// Whether each observation's landmark is at or behind the camera's center plane.
    pub behind_camera: Vec<bool>,
}

/// No less than what [`refine`] takes with so many observations.
#[must_use]
pub fn price_bound(observations: usize) -> Price {
    let observations = observations as f64;
    Price { bytes: (1000.0 * observations) as u64, flops_per_iteration: 1500.0 * observations }
}

/// Refines `world_from_camera` on `observations` and an optional `prior`.
///
/// # Errors
/// [`SolveError`] where there is no observation, a number is not finite or a sigma not positive.
pub fn refine(
    camera: &Camera,
    world_from_camera: &Se3,
    observations: &[PointObservation],
    prior: Option<&Prior>,
    options: &Options,
    observer: &mut Observer<'_>,
) -> Result<Refined, SolveError> {
    let start = Instant::now();
    options.validate()?;
    validate(camera, world_from_camera, observations, prior)?;
    let class = options.class.unwrap_or_else(Class::detect);
    let packed = Observations::new(camera, observations, class);
    let prior = prior.map(|p| PosePrior {
        pose: 0,
        world_from_camera: p.world_from_camera,
        information: p.information,
        loss: Loss::Trivial,
    });
    let terms = Terms { camera, list: observations, packed: &packed, prior, loss: options.loss };
    let mut system = PoseSystem::new(terms, *world_from_camera)?;
    let interrupt = Interrupt::NEVER.or_after(start, options.optimizer.deadline);
    let summary = minimize(&mut system, &options.optimizer, start, &interrupt, None, observer);
    let (mut squared_errors, depths) = packed.fit(system.pose());
    for s in &mut squared_errors {
        // No projection is an infinite error.
        *s = if s.is_nan() { f64::INFINITY } else { *s };
    }
    Ok(Refined {
        world_from_camera: *system.pose(),
        summary,
        information: system.value().hessian,
        squared_errors,
        behind_camera: depths.iter().map(|&z| z <= 0.0).collect(),
    })
}

fn validate(
    camera: &Camera,
    world_from_camera: &Se3,
    observations: &[PointObservation],
    prior: Option<&Prior>,
) -> Result<(), SolveError> {
    if observations.is_empty() {
        return Err(SolveError::Empty("there are no observations"));
    }
    let parts = [
        ("camera", camera.is_finite()),
        ("pose", world_from_camera.is_finite()),
        ("pose prior", prior.is_none_or(|p| p.world_from_camera.is_finite())),
    ];
    match parts.into_iter().find(|&(_, is_finite)| !is_finite) {
        Some((what, _)) => Err(SolveError::NotFinite { what, index: 0 }),
        None => Ok(()),
    }
}
