//! Bad measurements and bad starts: outliers, landmarks behind and inside cameras, coincidences.

use covis_solvers::bundle_adjustment::Options;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::Termination;
use covis_solvers::problem::BundleProblem;
use covis_solvers::testing::random::seeded;
use nalgebra::{Vector2, Vector3};
use rand::RngExt;

use super::{
    NO_SLACK, ROBUST, SOLVERS, Slack, run, scene, solve_honestly, solve_honestly_with, windows,
};

/// Puts three pixels of ten anywhere in the image.
fn spoil(problem: &mut BundleProblem) {
    let mut rng = seeded(5);
    let plain = &mut problem.reprojections.pixels;
    for pixel in plain.iter_mut().chain(&mut problem.depth_reprojections.pixels) {
        if rng.random::<f64>() < 0.3 {
            *pixel = Vector2::new(640.0 * rng.random::<f64>(), 480.0 * rng.random::<f64>());
        }
    }
}

#[test]
fn three_outliers_of_ten_end_honestly_with_every_loss() {
    for (name, mut problem) in windows() {
        spoil(&mut problem);
        for loss in ROBUST {
            problem.observation_loss = loss;
            solve_honestly(&format!("{name} with outliers"), &problem);
        }
    }
}

#[test]
fn a_robust_loss_finds_the_poses_among_outliers() {
    let scene = scene();
    let mut problem = scene.to_problem();
    spoil(&mut problem);
    let worst = |problem: &BundleProblem| {
        let pairs = problem.poses.iter().zip(&scene.truth);
        pairs.map(|(p, truth)| (p.translation - truth.translation).norm()).fold(0.0, f64::max)
    };
    problem.observation_loss = Loss::Cauchy(1.5);
    for outcome in solve_honestly("outliers", &problem) {
        let error = worst(&outcome.solved);
        assert!(error < 0.05, "{error} m");
    }
    problem.observation_loss = Loss::Trivial;
    assert!(worst(&run(&problem, &Options::default()).solved) > 0.2);
}

#[test]
fn landmarks_that_start_behind_cameras_end_honestly() {
    for (name, mut problem) in windows() {
        let center = problem.poses[4].translation;
        for landmark in problem.landmarks.iter_mut().step_by(10) {
            *landmark = center - (*landmark - center) * 0.7;
        }
        assert!(problem.behind_camera_count() > 10);
        for loss in ROBUST {
            problem.observation_loss = loss;
            for outcome in solve_honestly(&format!("{name} behind"), &problem) {
                let behind = outcome.solved.behind_camera_count();
                assert_eq!(outcome.summary.behind_camera, behind);
            }
        }
    }
}

#[test]
fn a_landmark_close_to_a_center_plane_ends_honestly() {
    for (name, problem) in windows() {
        let plain = problem.reprojections.poses.iter().zip(&problem.reprojections.landmarks);
        let depth = &problem.depth_reprojections;
        let mut pairs = plain.chain(depth.poses.iter().zip(&depth.landmarks));
        let (_, &landmark) = pairs.find(|&(&pose, _)| pose == 3).unwrap();
        for z in [0.1, 1e-3, 1e-6, 1e-9, 1e-12] {
            for z in [z, -z] {
                let mut problem = problem.clone();
                let point = problem.poses[3].transform(&Vector3::new(0.5, 0.2, z));
                problem.landmarks[landmark as usize] = point;
                // z is a difference of coordinates of meters.
                let slack = Slack { rounding: 1e-9_f64.max(1e-13 / z.abs()), ..NO_SLACK };
                solve_honestly_with(slack, &format!("{name}, z = {z:e}"), &problem);
            }
        }
    }
}

#[test]
fn a_landmark_at_a_camera_center_is_a_numerical_failure_that_moves_nothing() {
    for (name, mut problem) in windows() {
        problem.landmarks[3] = problem.poses[2].translation;
        for loss in ROBUST {
            problem.observation_loss = loss;
            for linear_solver in SOLVERS {
                let outcome = run(&problem, &Options { linear_solver, ..Options::default() });
                let summary = &outcome.summary.solve;
                let case = format!("{name}, {loss:?}, {linear_solver:?}");
                assert_eq!(summary.termination, Termination::NumericalFailure, "{case}");
                assert!(!summary.initial_cost.is_finite(), "{case}: {}", summary.initial_cost);
                assert_eq!(summary.final_cost, summary.initial_cost, "{case}");
                assert_eq!(outcome.solved, problem, "{case}");
            }
        }
    }
}

#[test]
fn coincident_landmarks_and_cameras_end_honestly() {
    for (name, problem) in windows() {
        // Landmarks at one place.
        let mut together = problem.clone();
        let place = together.landmarks[7];
        together.landmarks.iter_mut().step_by(3).for_each(|landmark| *landmark = place);
        // All cameras in one place.
        let mut still = problem.clone();
        let start = still.poses[0];
        still.poses.fill(start);
        // Every observation twice, by two poses that are one.
        let mut twice = problem.clone();
        let pose = twice.push_pose(twice.poses[4]) as u32;
        for o in problem.observations().filter(|o| o.pose == 4) {
            twice.push_observation(pose, 0, o.landmark, o.seen);
        }
        let cases = [("landmarks", together), ("cameras", still), ("keyframe twice", twice)];
        for (what, mut problem) in cases {
            for loss in [Loss::Trivial, Loss::Huber(1.5)] {
                problem.observation_loss = loss;
                solve_honestly(&format!("{name}, coincident {what}"), &problem);
            }
        }
    }
}
