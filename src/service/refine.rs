//! `RefinePose`: from the request to the answer, on a thread of the solver pool. Solver and
//! evaluator do the mathematics; here observations are only compared with a quantile.

use std::time::Instant;

use covis_solvers::evaluation::bundle_cost;
use covis_solvers::factors::{PosePrior, Reprojection};
use covis_solvers::geometry::{Camera, Se3};
use covis_solvers::information::Information;
use covis_solvers::interrupt::{Interrupt, Interruption};
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{self, Control, IterationSummary};
use covis_solvers::pose_refinement::{self, PointObservation, Prior};
use covis_solvers::problem::BundleProblem;

use super::convert::camera::camera;
use super::convert::geometry::{rigid_transform, to_information6, to_rigid_transform};
use super::convert::problem::{point_observations, prior};
use super::convert::solve::{Systems, add_costs, loss, options, to_summary};
use super::convert::{Path, convert};
use super::engine::Estimate;
use super::error::ServiceError;
use super::optimization_service::SolveBudget;
use crate::wire::v1;

/// Loss if the request names none.
const DEFAULT_LOSS: Loss = Loss::Huber(2.0);
/// 95 % quantile of the chi-square distribution with 2 degrees of freedom: a pixel.
const PIXEL_QUANTILE: f64 = 5.991;
/// The same with 3: a pixel with its depth.
const DEPTH_QUANTILE: f64 = 7.815;

/// A request in the solver's terms.
#[derive(Clone, Debug)]
pub(super) struct Input {
    camera: Camera,
    start: Se3,
    observations: Vec<PointObservation>,
    prior: Option<Prior>,
    options: pose_refinement::Options,
    include_information: bool,
    budget: SolveBudget,
}

impl Input {
    /// The expected cost of its solve.
    pub(super) fn estimate(&self) -> Estimate {
        let bound = pose_refinement::price_bound(self.observations.len());
        Estimate::new(bound, self.options.optimizer.max_iterations, &self.budget.ceiling)
    }
}

/// Reads a request.
pub(super) fn input(
    request: v1::RefinePoseRequest,
    budget: &SolveBudget,
) -> Result<Input, ServiceError> {
    Ok(convert(|out| {
        let at = Path::root("camera");
        let camera = out.required(at, request.camera.as_ref()).and_then(|m| camera(at, m, out));
        let start = request.world_from_camera.as_ref();
        let start = rigid_transform(Path::root("world_from_camera"), start, out);
        let observations = point_observations(&request.observations, out);
        let loss = loss(Path::root("loss"), request.loss.as_ref(), out);
        let systems = Systems::SinglePose;
        let options = options(request.options.as_ref(), systems, budget.threads, None, out);
        let prior = prior(request.prior.as_ref(), out);
        if request.include_covariance {
            let _: Option<()> = out.unimplemented(Path::root("include_covariance"));
        }
        let loss = loss?.unwrap_or(DEFAULT_LOSS);
        Some(Input {
            camera: camera?.camera,
            start: start?,
            observations: observations?,
            prior: prior?,
            options: pose_refinement::Options { optimizer: options?.optimizer, loss, class: None },
            include_information: request.include_information,
            budget: *budget,
        })
    })?)
}

/// Refines the pose.
pub(super) fn run(
    input: Input,
    interrupt: &Interrupt,
) -> Result<v1::RefinePoseResponse, ServiceError> {
    let Input { camera, start, observations, .. } = &input;
    // The time that is left after the wait in the queue.
    let left = input.budget.deadline.map(|at| at.saturating_duration_since(Instant::now()));
    let optimizer = input.options.optimizer;
    let deadline = optimizer.deadline.into_iter().chain(left).min();
    let optimizer = optimizer::Options { deadline, ..optimizer };
    let options = &pose_refinement::Options { optimizer, ..input.options };
    let mut observer = |_row: &IterationSummary| match interrupt.reason() {
        Some(Interruption::Cancelled) => Control::Cancel,
        Some(Interruption::Deadline) | None => Control::Continue,
    };
    let prior = input.prior.as_ref();
    let refined =
        pose_refinement::refine(camera, start, observations, prior, options, &mut observer);
    let refined =
        refined.map_err(|error| ServiceError::Unsolvable { field: "observations", error })?;
    let mut summary = to_summary(&refined.summary, options.optimizer.method);
    let before = bundle_cost(&as_bundle(&input, *start));
    let after = bundle_cost(&as_bundle(&input, refined.world_from_camera));
    add_costs(&mut summary, &before, &after);
    summary.linear_solver = v1::LinearSolver::DenseCholesky.into();
    // Known points fix the frame; the wire has no name for that.
    let gauge = if input.prior.is_some() { v1::Gauge::Priors } else { v1::Gauge::Unspecified };
    summary.gauge = gauge.into();
    summary.free_pose_count = 1;
    let errors = refined.squared_errors.iter().zip(&refined.behind_camera).zip(observations);
    let results = errors.map(|((&squared_error, &behind_camera), observation)| {
        let quantile = if observation.depth_m.is_some() { DEPTH_QUANTILE } else { PIXEL_QUANTILE };
        let inlier = squared_error <= quantile && !behind_camera;
        let squared_error = squared_error.min(f64::MAX);
        v1::ObservationResult { squared_error, inlier, behind_camera }
    });
    // Absent when not positive definite, as the wire says.
    let information = Information::new(&refined.information).ok();
    Ok(v1::RefinePoseResponse {
        world_from_camera: Some(to_rigid_transform(&refined.world_from_camera)),
        summary: Some(summary),
        observations: results.collect(),
        information: information
            .filter(|_| input.include_information)
            .map(|information| to_information6(&information)),
        covariance: None,
    })
}

/// The same problem in the evaluator's terms: known points, one pose.
fn as_bundle(input: &Input, pose: Se3) -> BundleProblem {
    let mut problem =
        BundleProblem { observation_loss: input.options.loss, ..BundleProblem::default() };
    problem.push_pose(pose);
    problem.push_camera(input.camera, true);
    for (index, seen) in (0u32..).zip(&input.observations) {
        problem.push_landmark(seen.point_in_world);
        let PointObservation { pixel, sigma_px, depth_m, .. } = *seen;
        problem.push_observation(0, 0, index, Reprojection { pixel, sigma_px, depth_m });
    }
    problem.constant_landmarks.fill(true);
    problem.pose_priors = input.prior.iter().map(as_factor).collect();
    problem
}

fn as_factor(prior: &Prior) -> PosePrior {
    let Prior { world_from_camera, information } = *prior;
    PosePrior { pose: 0, world_from_camera, information, loss: Loss::Trivial }
}
