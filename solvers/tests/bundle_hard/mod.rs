//! Bundle adjustment on problems that are hard or hopeless: each must end finite and honest.
//!
//! What honest means is in [`solve_honestly`]: it holds each solver's word against the evaluator, a
//! stricter solve and trial moves along single coordinates.

mod infinity;
mod rank;
mod scales;
mod starts;

use covis_solvers::bundle_adjustment::{BundleSummary, LinearSolver, Options, solve};
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::geometry::LieGroup;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{Termination, ignore_iterations};
use covis_solvers::problem::BundleProblem;
use covis_solvers::testing::scene::{Scene, SceneOptions};
use nalgebra::{SVector, Vector3};

const SOLVERS: [LinearSolver; 3] =
    [LinearSolver::DenseSchur, LinearSolver::SparseSchur, LinearSolver::IterativeSchur];

const ROBUST: [Loss; 5] =
    [Loss::Trivial, Loss::Huber(1.5), Loss::Cauchy(1.5), Loss::Tukey(5.0), Loss::GemanMcClure(3.0)];

/// A claimed minimum may be so much of its cost above what a stricter solve finds from there.
const MINIMUM: f64 = 1e-6;

/// Costs below this are zero, and so are differences: a billionth of a standard deviation. The
/// gradient's tolerance of 1e-10 is told in the same unit.
const ZERO: f64 = 1e-18;

fn window() -> SceneOptions {
    SceneOptions { keyframes: 8, laps: 0.12, landmarks: 400, seed: 21, ..Default::default() }
}

fn scene() -> Scene {
    Scene::generate(&window())
}

/// Eight keyframes with depth, the first one constant.
fn depth_window() -> BundleProblem {
    scene().to_problem()
}

/// The same without depth, of landmarks with three views at least; a second constant pose holds the
/// scale.
fn mono_window() -> BundleProblem {
    let mut problem = depth_window();
    let depth = std::mem::take(&mut problem.depth_reprojections);
    let mut views = vec![0; problem.landmarks.len()];
    depth.landmarks.iter().for_each(|&l| views[l as usize] += 1);
    for k in (0..depth.len()).filter(|&k| views[depth.landmarks[k] as usize] >= 3) {
        let (pose, camera, landmark) = (depth.poses[k], depth.cameras[k], depth.landmarks[k]);
        problem.reprojections.push(pose, camera, landmark, depth.pixels[k], depth.sigmas_px[k]);
    }
    problem.constant_poses[1] = true;
    problem
}

fn windows() -> [(&'static str, BundleProblem); 2] {
    [("depth", depth_window()), ("mono", mono_window())]
}

/// Removes the observations for which `keep(pose, landmark)` is false.
fn retain(problem: &mut BundleProblem, mut keep: impl FnMut(u32, u32) -> bool) {
    let (poses, landmarks) =
        (problem.reprojections.poses.clone(), problem.reprojections.landmarks.clone());
    problem.reprojections.retain(|k| keep(poses[k], landmarks[k]));
    let batch = &problem.depth_reprojections;
    let (poses, landmarks) = (batch.poses.clone(), batch.landmarks.clone());
    problem.depth_reprojections.retain(|k| keep(poses[k], landmarks[k]));
}

/// Multiplies every length with `factor`.
fn scale(problem: &mut BundleProblem, factor: f64) {
    problem.poses.iter_mut().for_each(|pose| pose.translation *= factor);
    problem.landmarks.iter_mut().for_each(|landmark| *landmark *= factor);
    let depth = &mut problem.depth_reprojections;
    depth.depths_m.iter_mut().chain(&mut depth.sigmas_depth_m).for_each(|x| *x *= factor);
}

/// What a solve left behind.
struct Outcome {
    solved: BundleProblem,
    summary: BundleSummary,
}

impl Outcome {
    fn cost(&self) -> f64 {
        self.summary.solve.final_cost
    }

    fn is_converged(&self) -> bool {
        self.summary.solve.termination.is_converged()
    }
}

fn run(problem: &BundleProblem, options: &Options) -> Outcome {
    let mut solved = problem.clone();
    let summary = solve(&mut solved, options, &mut ignore_iterations).unwrap();
    Outcome { solved, summary }
}

/// What a check lets pass.
#[derive(Clone, Copy)]
struct Slack {
    /// Largest relative difference of the evaluator's cost and the solver's.
    rounding: f64,
    /// Whether a stricter solve may find less. It does where the cost falls toward infinity and beyond
    /// it, behind the camera: from a certain distance on, rounding takes a landmark there.
    beyond_infinity: bool,
}

const NO_SLACK: Slack = Slack { rounding: 1e-9, beyond_infinity: false };

/// Solves with every linear solver and checks each result:
/// the same bits on 1, 2 and 3 threads; state and cost finite; no row above the one before; the
/// evaluator finds the same cost; a claimed minimum is one.
fn solve_honestly(name: &str, problem: &BundleProblem) -> Vec<Outcome> {
    solve_honestly_with(NO_SLACK, name, problem)
}

/// [`solve_honestly`] for problems that ask for less than the usual rigor.
fn solve_honestly_with(slack: Slack, name: &str, problem: &BundleProblem) -> Vec<Outcome> {
    SOLVERS
        .into_iter()
        .map(|linear_solver| {
            let name = format!("{name}, {:?}, {linear_solver:?}", problem.observation_loss);
            let with = |threads| {
                let mut options = Options { linear_solver, ..Options::default() };
                options.optimizer.threads = Some(threads);
                run(problem, &options)
            };
            let outcome = with(1);
            for threads in [2, 3] {
                assert_eq!(outcome.solved, with(threads).solved, "{name}: {threads} threads");
            }
            check_finite(&name, &outcome);
            let independent = bundle_cost(&outcome.solved).total;
            let difference = (independent - outcome.cost()).abs();
            assert!(difference <= slack.rounding * independent + ZERO, "{name}: {independent:e}");
            if outcome.is_converged() {
                check_minimum(slack, &name, &outcome.solved);
            } else {
                let termination = outcome.summary.solve.termination;
                assert_eq!(termination, Termination::MaxIterations, "{name}");
            }
            outcome
        })
        .collect()
}

fn check_finite(name: &str, outcome: &Outcome) {
    let Outcome { solved, summary } = outcome;
    assert!(solved.poses.iter().all(LieGroup::is_finite), "{name}: poses");
    assert!(solved.cameras.iter().all(|c| c.is_finite()), "{name}: cameras");
    assert!(solved.landmarks.iter().flat_map(Vector3::iter).all(|x| x.is_finite()), "{name}");
    assert!(summary.solve.final_cost.is_finite(), "{name}: cost");
    let rows = &summary.solve.iterations;
    assert!(rows.windows(2).all(|pair| pair[1].cost <= pair[0].cost), "{name}: the cost rose");
    assert_eq!(summary.solve.final_cost, rows.last().unwrap().cost, "{name}");
}

/// Neither a stricter solve nor a small move along a coordinate finds much less.
fn check_minimum(slack: Slack, name: &str, solved: &BundleProblem) {
    let mut strict = Options { linear_solver: LinearSolver::DenseSchur, ..Options::default() };
    strict.optimizer.max_iterations = 300;
    strict.optimizer.cost_tolerance = 1e-13;
    strict.optimizer.gradient_tolerance = 0.0;
    strict.optimizer.step_tolerance = 0.0;
    let cost = bundle_cost(solved).total;
    let limit = (1.0 - MINIMUM) * cost - ZERO;
    let again = run(solved, &strict).cost();
    let fine = again >= limit || slack.beyond_infinity;
    assert!(fine, "{name}: claimed {cost:e}, a stricter solve finds {again:e}");
    for size in [1e-3, 1e-5] {
        for pose in (0..solved.poses.len()).filter(|&p| !solved.constant_poses[p]) {
            // A move is told as a share of the scene: its farthest camera, or a radian.
            let length = solved.poses.iter().map(|p| p.translation.norm()).fold(0.0, f64::max);
            for i in 0..12 {
                let mut delta = SVector::<f64, 6>::zeros();
                delta[i / 2] = if i % 2 == 0 { size } else { -size };
                delta.fixed_rows_mut::<3>(0).scale_mut(length);
                let mut moved = solved.clone();
                moved.poses[pose] = moved.poses[pose].plus(&delta);
                assert!(bundle_cost(&moved).total >= limit, "{name}: pose {pose}, {delta}");
            }
        }
        for landmark in (0..solved.landmarks.len()).step_by(9) {
            for i in (0..6).filter(|_| !solved.constant_landmarks[landmark]) {
                let mut moved = solved.clone();
                let length = moved.landmarks[landmark].norm();
                moved.landmarks[landmark][i / 2] += if i % 2 == 0 { size } else { -size } * length;
                assert!(bundle_cost(&moved).total >= limit, "{name}: landmark {landmark}, {i}");
            }
        }
    }
}
