//! A solve that goes on from a checkpoint comes to the result that it would have come to, to the bit.

use covis_solvers::bundle_adjustment::{
    BundleSummary, Checkpoint, Keeper, LinearSolver, Options, solve, solve_kept,
};
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{IterationSummary, ignore_iterations};
use covis_solvers::problem::{BundleProblem, SolveError};

use crate::bundle_adjustment::{small_scene, twin};

/// Keeps every checkpoint.
#[derive(Default)]
struct All(Vec<Checkpoint>);

impl Keeper for All {
    fn is_due(&mut self, row: &IterationSummary) -> bool {
        assert!(row.accepted);
        true
    }

    fn keep(&mut self, checkpoint: Checkpoint) {
        self.0.push(checkpoint);
    }
}

/// Keeps no checkpoint.
struct Never;

impl Keeper for Never {
    fn is_due(&mut self, _row: &IterationSummary) -> bool {
        false
    }

    fn keep(&mut self, _checkpoint: Checkpoint) {
        panic!("none is due");
    }
}

/// The numbers of a solve that do not depend on clocks.
fn numbers(summary: &BundleSummary) -> Vec<u64> {
    let solve = &summary.solve;
    let row = |row: &IterationSummary| {
        let numbers = [row.cost, row.damping, row.gradient_max_norm, row.step_norm];
        let counts = [row.iteration as u64, u64::from(row.accepted)];
        numbers.map(f64::to_bits).into_iter().chain(counts).chain([row.step_quality.to_bits()])
    };
    let rows = solve.iterations.iter().flat_map(row);
    let ends =
        [solve.initial_cost, solve.final_cost, solve.gradient_max_norm, solve.linear_residual];
    ends.map(f64::to_bits).into_iter().chain(rows).collect()
}

fn check(problem: &BundleProblem, options: &Options, least: usize) {
    let mut whole = problem.clone();
    let plain = solve(&mut whole, options, &mut ignore_iterations).unwrap();
    let mut kept = problem.clone();
    let mut all = All::default();
    let summary = solve_kept(&mut kept, options, None, &mut all, &mut ignore_iterations).unwrap();
    assert_eq!(numbers(&summary), numbers(&plain), "keeping changes nothing");
    assert_eq!(kept, whole);
    assert!(all.0.len() >= least, "{} checkpoints", all.0.len());
    for checkpoint in &all.0 {
        // The values that the problem has are no matter.
        let mut again = problem.clone();
        again.landmarks.iter_mut().for_each(|landmark| landmark.x += 1.0);
        let from = Some(checkpoint);
        let summary =
            solve_kept(&mut again, options, from, &mut Never, &mut ignore_iterations).unwrap();
        let at = checkpoint.state.iteration();
        assert_eq!(numbers(&summary), numbers(&plain), "from iteration {at}");
        assert_eq!(summary.solve.termination, plain.solve.termination);
        assert_eq!(again, whole, "from iteration {at}");
    }
}

#[test]
fn every_checkpoint_leads_to_the_same_bits() {
    for linear_solver in
        [LinearSolver::DenseSchur, LinearSolver::SparseSchur, LinearSolver::IterativeSchur]
    {
        let options = Options { linear_solver, ..Options::default() };
        check(&twin(), &options, 5);
        check(&small_scene(3), &options, 2);
    }
}

#[test]
fn checkpoints_have_what_losses_change_of_the_loop() {
    for loss in [Loss::Huber(1.0), Loss::Cauchy(1.0), Loss::Tukey(4.0), Loss::GemanMcClure(4.0)] {
        let mut problem = twin();
        problem.observation_loss = loss;
        check(&problem, &Options::default(), 3);
    }
}

#[test]
fn a_checkpoint_of_another_problem_is_refused() {
    let mut all = All::default();
    let options = Options::default();
    solve_kept(&mut twin(), &options, None, &mut all, &mut ignore_iterations).unwrap();
    let mut other = small_scene(3);
    let refused =
        solve_kept(&mut other, &options, all.0.last(), &mut Never, &mut ignore_iterations);
    assert!(matches!(refused, Err(SolveError::LengthMismatch { .. })), "{refused:?}");
}
