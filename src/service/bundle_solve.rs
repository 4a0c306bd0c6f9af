//! `SolveBundle`: from the request to the answer, on a thread of the solver pool. The variables
//! that the request fixes are the gauge; costs come from the evaluator. No map is read
//! or changed.

use covis_solvers::bundle_adjustment::{self, Options};
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{self, ignore_iterations};
use covis_solvers::problem::BundleProblem;

use super::convert::solve::{
    Systems, add_costs, loss, options, to_iterations, to_linear_solver, to_summary,
};
use super::convert::{Path, convert, count, problem};
use super::engine::Estimate;
use super::error::ServiceError;
use super::optimization_service::SolveBudget;
use crate::wire::v1;

/// A request in the solver's terms.
pub(super) struct Input {
    request: v1::SolveBundleRequest,
    bundle: BundleProblem,
    gauge: v1::Gauge,
    options: Options,
}

impl Input {
    /// The expected cost of its solve.
    pub(super) fn estimate(&self) -> Estimate {
        let optimizer = &self.options.optimizer;
        let bound = bundle_adjustment::price_bound(&self.bundle);
        Estimate::new(bound, optimizer.max_iterations, &optimizer.ceiling)
    }
}

/// Reads a request.
pub(super) fn input(
    request: v1::SolveBundleRequest,
    budget: &SolveBudget,
) -> Result<Input, ServiceError> {
    let (bundle, gauge, options) = convert(|out| {
        let loss = loss(Path::root("loss"), request.loss.as_ref(), out);
        let options = options(request.options.as_ref(), Systems::Bundle, budget.threads, None, out);
        let loss = loss?.unwrap_or(Loss::Trivial);
        let message = request.problem.as_ref();
        let mut bundle = problem::bundle(message, loss, request.refine_intrinsics, out)?;
        let gauge = problem::hold_gauge(request.gauge, &mut bundle, out);
        let options = options?;
        let options = Options {
            optimizer: optimizer::Options { ceiling: budget.ceiling, ..options.optimizer },
            linear_solver: options.linear_solver,
            ..Options::default()
        };
        Some((bundle, gauge?, options))
    })?;
    Ok(Input { request, bundle, gauge, options })
}

/// Solves the problem.
pub(super) fn run(
    input: Input,
    interrupt: &Interrupt,
) -> Result<v1::SolveBundleResponse, ServiceError> {
    let Input { request, mut bundle, gauge, options } = input;
    let before = bundle_cost(&bundle);
    let solved =
        bundle_adjustment::solve_until(&mut bundle, &options, interrupt, &mut ignore_iterations);
    let solved = solved.map_err(|error| ServiceError::Unsolvable { field: "problem", error })?;
    let mut summary = to_summary(&solved.solve, options.optimizer.method);
    add_costs(&mut summary, &before, &bundle_cost(&bundle));
    summary.linear_solver = to_linear_solver(solved.linear_solver).into();
    summary.gauge = gauge.into();
    let free = |constant: &[bool]| count(constant.iter().filter(|&&c| !c).count());
    summary.free_pose_count = free(&bundle.constant_poses);
    summary.fixed_pose_count = count(bundle.poses.len()) - summary.free_pose_count;
    summary.free_landmark_count = free(&bundle.constant_landmarks);
    let iterations = to_iterations(&solved.solve, request.include_iterations);
    let problem = Some(problem::to_bundle(request.problem.unwrap_or_default(), &bundle));
    Ok(v1::SolveBundleResponse { problem, summary: Some(summary), iterations })
}
