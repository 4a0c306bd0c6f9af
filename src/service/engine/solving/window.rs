//! The solve of a window: bundle adjustment from a start that may be far, and a result that is plausible.
//!
//! A result that is not (`MapProblem::implausible`) is dropped; the window is solved again from its start with
//! those keyframes held that went astray. If that is no better, the map keeps its estimates. Nothing of the
//! engine's state is used here.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use covis_solvers::evaluation::bundle_cost;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{self, ignore_iterations};
use covis_solvers::price::Ceiling;

use crate::map::{Held, MapProblem};
use crate::service::engine::outcome::{Moved, OptimizeOptions, Outcome, Solution};
use crate::service::engine::solving::whole::solve_bundle;

/// How a window is solved.
pub(crate) struct WindowOptions {
    pub(crate) max_iterations: usize,
    pub(crate) ceiling: Ceiling,
    /// Whether it finds anew how uncertain odometry is.
    pub(crate) learns: bool,
}

/// Solves a window. `refused` gets why a result was not believed.
pub(crate) fn solve_window(
    problem: MapProblem,
    options: &WindowOptions,
    cancel: &Arc<AtomicBool>,
    refused: &mut dyn FnMut(Held),
) -> Outcome {
    let WindowOptions { max_iterations, ceiling, learns } = *options;
    let optimizer = optimizer::Options { max_iterations, ceiling, ..optimizer::Options::default() };
    let options = OptimizeOptions { optimizer, ..OptimizeOptions::default() };
    let start = problem.start();
    let (mut problem, mut is_again) = (problem, false);
    loop {
        let mut solution = match solve_graduated(problem, &options, cancel) {
            Ok(Some(solution)) => solution,
            other => return other,
        };
        let Moved::Bundle(solved) = &mut solution.moved else { return Ok(Some(solution)) };
        let astray = solved.implausible(&start);
        let Some(&(_, why)) = astray.first() else {
            solved.learn_view_noise();
            if learns {
                solved.learn_odometry_noise();
            }
            return Ok(Some(solution));
        };
        refused(why);
        if is_again {
            solution.refused = Some(why);
            return Ok(Some(solution));
        }
        is_again = true;
        solved.restart(&start, &astray);
        problem = (**solved).clone();
    }
}

/// Bundle adjustment by a loss that may let go of what does not fit. From a far start that would be nearly
/// everything; there the convex loss of the same width comes first. Where odometry ties poses a few wrong views
/// look like a far start, too, and the convex loss follows them: it is only tried where the other leaves a
/// keyframe far off, and of both minima the lower one counts. Without odometry the lower one may be that which lets
/// go of everything.
fn solve_graduated(
    problem: MapProblem,
    options: &OptimizeOptions,
    cancel: &Arc<AtomicBool>,
) -> Outcome {
    let loss = problem.problem.observation_loss;
    let width = match loss {
        Loss::GemanMcClure(width) | Loss::Tukey(width) | Loss::Cauchy(width) => Some(width),
        Loss::Trivial | Loss::Huber(_) => None,
    };
    let Some(width) = width.filter(|&width| problem.is_far_off(width)) else {
        return solve_bundle(problem, options, cancel, &mut ignore_iterations);
    };
    let before = bundle_cost(&problem.problem);
    let direct = match problem.odometry.is_empty() {
        true => None,
        false => match solve_bundle(problem.clone(), options, cancel, &mut ignore_iterations) {
            Ok(Some(direct)) if is_far_off(&direct, width) => Some(direct),
            near => return near,
        },
    };
    let mut convex = problem;
    convex.problem.observation_loss = Loss::Huber(width);
    let mut convex = match solve_bundle(convex, options, cancel, &mut ignore_iterations) {
        Ok(Some(Solution { moved: Moved::Bundle(convex), .. })) => convex,
        other => return other,
    };
    convex.problem.observation_loss = loss;
    let mut outcome = solve_bundle(*convex, options, cancel, &mut ignore_iterations);
    if let Ok(Some(Solution { certificate, .. })) = &mut outcome {
        certificate.solve.initial_cost = before.total;
        certificate.before = before;
    }
    let cost = |solution: &Solution| solution.certificate.solve.final_cost;
    match (direct, outcome) {
        (Some(direct), Ok(Some(graduated))) if cost(&direct) <= cost(&graduated) => {
            Ok(Some(direct))
        }
        (_, outcome) => outcome,
    }
}

fn is_far_off(solution: &Solution, width: f64) -> bool {
    matches!(&solution.moved, Moved::Bundle(solved) if solved.is_far_off(width))
}
