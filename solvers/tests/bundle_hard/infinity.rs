//! Landmarks at infinity must spoil neither the poses nor the stopping test.

use covis_solvers::bundle_adjustment::{LinearSolver, Options};
use covis_solvers::geometry::LieGroup;
use covis_solvers::loss::Loss;
use covis_solvers::problem::BundleProblem;
use nalgebra::Vector3;

use super::{ROBUST, run, solve_honestly, windows};

/// Adds a landmark `distance` ahead of pose 3, seen in the direction that it has from the poses of
/// `best`: parallel rays.
fn add_far(problem: &mut BundleProblem, best: &BundleProblem, distance: f64, views: &[usize]) {
    let far = best.poses[3].transform(&(Vector3::new(0.1, -0.2, 1.0) * distance));
    let landmark = problem.push_landmark(far) as u32;
    for &pose in views {
        let point = best.poses[pose].inverse_transform(&far);
        let pixel = best.cameras[0].project(&point).unwrap();
        problem.reprojections.push(pose as u32, 0, landmark, pixel, 0.7);
    }
}

fn best(problem: &BundleProblem) -> BundleProblem {
    let mut options = Options::default();
    options.optimizer.cost_tolerance = 1e-14;
    options.optimizer.max_iterations = 400;
    run(problem, &options).solved
}

#[test]
fn a_landmark_at_infinity_ends_honestly() {
    for (name, problem) in windows() {
        let best = best(&problem);
        for distance in [1e4, 1e8, 1e12] {
            let mut problem = problem.clone();
            add_far(&mut problem, &best, distance, &[0, 1, 2, 3, 4, 5, 6, 7]);
            for loss in ROBUST {
                problem.observation_loss = loss;
                solve_honestly(&format!("{name}, {distance:e} m"), &problem);
            }
        }
    }
}

#[test]
fn a_landmark_at_infinity_does_not_end_the_solve_early() {
    // Its norm makes every step a tiny share of the state's.
    for (name, problem) in windows() {
        let best = best(&problem);
        for distance in [1e8, 1e10, 1e12, 1e14] {
            for views in [&[3][..], &[0, 1, 2, 3, 4, 5, 6, 7]] {
                let mut problem = problem.clone();
                add_far(&mut problem, &best, distance, views);
                for linear_solver in [LinearSolver::DenseSchur, LinearSolver::SparseSchur] {
                    let options = Options { linear_solver, ..Options::default() };
                    let outcome = run(&problem, &options);
                    assert!(outcome.is_converged(), "{name} {distance:e}");
                    let poses = outcome.solved.poses.iter().zip(&best.poses);
                    let off = poses.map(|(a, b)| a.minus(b).norm()).fold(0.0, f64::max);
                    assert!(off < 1e-4, "{name} {distance:e}, {} views: {off}", views.len());
                }
            }
        }
    }
}

#[test]
fn landmarks_that_the_optimum_sends_to_infinity() {
    // Rays that diverge a little: the best point is behind infinity.
    for (name, problem) in windows() {
        let best = best(&problem);
        let mut problem = problem.clone();
        let ahead = best.poses[3];
        for i in 0..5 {
            let direction = Vector3::new(0.1 * f64::from(i) - 0.2, 0.1, 1.0);
            let landmark = problem.push_landmark(ahead.transform(&(direction * 50.0))) as u32;
            for pose in 2..6 {
                let point =
                    best.poses[pose].inverse_transform(&ahead.transform(&(direction * 1e9)));
                let mut pixel = best.cameras[0].project(&point).unwrap();
                pixel.x += (pose as f64 - 3.5) * 0.5;
                problem.reprojections.push(pose as u32, 0, landmark, pixel, 0.7);
            }
        }
        for loss in [Loss::Trivial, Loss::Huber(1.5)] {
            problem.observation_loss = loss;
            solve_honestly(&format!("{name}, diverging rays"), &problem);
        }
    }
}
