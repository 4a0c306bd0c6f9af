//! Motion-only refinement: one pose from observations of known landmarks.
//!
//! Minimizes ½ Σ ρ(‖r‖²) over `world_from_camera` (equation 8 of the reference frontend's paper),
//! with an optional prior. Six unknowns: one dense 6 × 6 system a step, on the caller's thread.

use std::time::Instant;

use nalgebra::{SMatrix, SVector, Vector2, Vector3};

use crate::factors::{DepthReprojection, Linearization, PosePrior, Reprojection};
use crate::geometry::{Camera, LieGroup, Se3};
use crate::information::Information;
use crate::loss::Loss;
use crate::optimizer::{
    self, Gradient, Observer, SolveSummary, Step, StepFailure, System, damping_scale, minimize,
};
use crate::problem::SolveError;

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
}

/// The refined pose and what it says of its observations.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// The pose.
    pub world_from_camera: Se3,
    /// What the loop did.
    pub summary: SolveSummary,
    /// H = Σ w JᵀJ at the result, over the right tangent, translation first.
    pub information: SMatrix<f64, 6, 6>,
    /// Whitened squared residual s of each observation.
    pub squared_errors: Vec<f64>,
    /// Whether each observation's landmark is at or behind the camera's center plane.
    pub behind_camera: Vec<bool>,
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
    validate(camera, world_from_camera, observations, prior, options)?;
    let mut system = PoseSystem {
        camera,
        observations,
        prior: prior.map(|p| PosePrior {
            pose: 0,
            world_from_camera: p.world_from_camera,
            information: p.information,
        }),
        loss: options.loss,
        pose: *world_from_camera,
        backup: *world_from_camera,
        hessian: SMatrix::zeros(),
        gradient: SVector::zeros(),
        step: SVector::zeros(),
    };
    let summary = minimize(&mut system, &options.optimizer, start, observer);
    system.linearize(0.0);
    let squared = |o: &PointObservation| o.squared_error(&system.pose, camera);
    let behind = |o: &PointObservation| system.pose.inverse_transform(&o.point_in_world).z <= 0.0;
    Ok(Refined {
        world_from_camera: system.pose,
        summary,
        information: system.hessian,
        squared_errors: observations.iter().map(squared).collect(),
        behind_camera: observations.iter().map(behind).collect(),
    })
}

fn validate(
    camera: &Camera,
    world_from_camera: &Se3,
    observations: &[PointObservation],
    prior: Option<&Prior>,
    options: &Options,
) -> Result<(), SolveError> {
    options.optimizer.validate()?;
    if !options.loss.is_valid() {
        let reason = "the width must be finite and positive";
        return Err(SolveError::InvalidOption { field: "loss", reason });
    }
    if observations.is_empty() {
        return Err(SolveError::Empty("there are no observations"));
    }
    let finite = |what, ok: bool, index: usize| {
        if ok { Ok(()) } else { Err(SolveError::NotFinite { what, index: index as i64 }) }
    };
    finite("camera", camera.is_finite(), 0)?;
    finite("pose", world_from_camera.is_finite(), 0)?;
    finite("pose prior", prior.is_none_or(|p| p.world_from_camera.is_finite()), 0)?;
    let positive = |x: f64| x.is_finite() && x > 0.0;
    for (index, o) in observations.iter().enumerate() {
        let numbers = o.point_in_world.iter().chain(o.pixel.iter());
        let depth = o.depth_m.is_none_or(|(depth, _)| depth.is_finite());
        finite("observation", depth && numbers.into_iter().all(|x| x.is_finite()), index)?;
        let factor = "observation";
        if !(positive(o.sigma_px) && o.depth_m.is_none_or(|(_, sigma)| positive(sigma))) {
            return Err(SolveError::NotPositiveDefinite { factor, index });
        }
        if !o.squared_error(world_from_camera, camera).is_finite() {
            return Err(SolveError::ResidualNotFinite { factor, index });
        }
    }
    Ok(())
}

impl PointObservation {
    fn reprojection(&self) -> Reprojection {
        Reprojection { pixel: self.pixel, sigma_px: self.sigma_px }
    }

    fn depth_reprojection(&self) -> Option<DepthReprojection> {
        let (depth_m, sigma_depth_m) = self.depth_m?;
        let (pixel, sigma_px) = (self.pixel, self.sigma_px);
        Some(DepthReprojection { pixel, depth_m, sigma_px, sigma_depth_m })
    }

    /// The whitened squared residual; infinite where the projection is not finite.
    fn squared_error(&self, pose: &Se3, camera: &Camera) -> f64 {
        match self.depth_reprojection() {
            Some(f) => f.residual(pose, camera, &self.point_in_world).map(|r| r.norm_squared()),
            None => self
                .reprojection()
                .residual(pose, camera, &self.point_in_world)
                .map(|r| r.norm_squared()),
        }
        .unwrap_or(f64::INFINITY)
    }
}

struct PoseSystem<'a> {
    camera: &'a Camera,
    observations: &'a [PointObservation],
    prior: Option<PosePrior>,
    loss: Loss,
    pose: Se3,
    backup: Se3,
    hessian: SMatrix<f64, 6, 6>,
    gradient: SVector<f64, 6>,
    step: SVector<f64, 6>,
}

impl PoseSystem<'_> {
    fn add<const R: usize>(&mut self, linearization: Option<Linearization<R>>) {
        let Some(l) = linearization else { return };
        let weight = self.loss.evaluate(l.residual.norm_squared()).weight;
        let left = l.d_pose.transpose() * weight;
        self.hessian += left * l.d_pose;
        self.gradient += left * l.residual;
    }

    fn scale(&self, i: usize) -> f64 {
        damping_scale(self.hessian[(i, i)])
    }
}

impl System for PoseSystem<'_> {
    fn cost(&mut self) -> f64 {
        let observations: f64 = self
            .observations
            .iter()
            .map(|o| self.loss.evaluate(o.squared_error(&self.pose, self.camera)).rho)
            .sum();
        let prior = self
            .prior
            .as_ref()
            .map_or(0.0, |prior| prior.information.squared_norm(&prior.linearize(&self.pose).0));
        0.5 * (observations + prior)
    }

    fn linearize(&mut self, _damping: f64) -> Gradient {
        self.hessian = SMatrix::zeros();
        self.gradient = SVector::zeros();
        for o in self.observations {
            match o.depth_reprojection() {
                Some(f) => self.add(f.linearize(&self.pose, self.camera, &o.point_in_world)),
                None => {
                    self.add(o.reprojection().linearize(
                        &self.pose,
                        self.camera,
                        &o.point_in_world,
                    ));
                }
            }
        }
        if let Some(prior) = &self.prior {
            let (residual, d_pose) = prior.linearize(&self.pose);
            let left = d_pose.transpose() * prior.information.matrix();
            self.hessian += left * d_pose;
            self.gradient += left * residual;
        }
        let entry = |i: usize| self.gradient[i].abs() / self.scale(i).sqrt();
        Gradient { max_norm: (0..6).map(entry).fold(0.0, f64::max) }
    }

    fn solve(&mut self, damping: f64) -> Result<Step, StepFailure> {
        let mut damped = self.hessian;
        for i in 0..6 {
            damped[(i, i)] += damping * self.scale(i);
        }
        let factor = damped.cholesky().ok_or(StepFailure)?;
        self.step = -factor.solve(&self.gradient);
        let norm = self.step.norm();
        let residual = (damped * self.step + self.gradient).norm();
        let decrease =
            |i: usize| self.step[i] * (damping * self.scale(i) * self.step[i] - self.gradient[i]);
        if !norm.is_finite() {
            return Err(StepFailure);
        }
        Ok(Step {
            predicted_decrease: 0.5 * (0..6).map(decrease).sum::<f64>(),
            norm,
            state_norm: self.pose.translation.norm() + 1.0,
            linear_residual: residual / self.gradient.norm().max(f64::MIN_POSITIVE),
            is_inexact: false,
        })
    }

    fn apply(&mut self) -> f64 {
        self.backup = self.pose;
        self.pose = self.pose.plus(&self.step);
        self.cost()
    }

    fn restore(&mut self) {
        self.pose = self.backup;
    }
}
