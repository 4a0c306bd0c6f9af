//! Windows whose measurements do not determine every unknown.

use covis_solvers::geometry::Se3;
use covis_solvers::loss::Loss;
use covis_solvers::problem::BundleProblem;
use covis_solvers::testing::random::{normal_vector, seeded};
use nalgebra::Vector2;

use super::{
    NO_SLACK, Slack, depth_window, mono_window, retain, scene, solve_honestly, solve_honestly_with,
    windows,
};

/// Solves every window after `change`, with and without a robust loss.
fn each_window(what: &str, change: impl Fn(&mut BundleProblem)) {
    for (name, mut problem) in windows() {
        change(&mut problem);
        for loss in [Loss::Trivial, Loss::Huber(1.5)] {
            problem.observation_loss = loss;
            solve_honestly(&format!("{name}, {what}"), &problem);
        }
    }
}

#[test]
fn no_constant_pose() {
    each_window("free gauge", |problem| problem.constant_poses.fill(false));
}

#[test]
fn free_intrinsics_with_and_without_a_constant_pose() {
    each_window("free camera", |problem| problem.constant_cameras.fill(false));
    each_window("free camera and gauge", |problem| {
        problem.constant_cameras.fill(false);
        problem.constant_poses.fill(false);
    });
}

#[test]
fn a_scale_that_nothing_holds() {
    let mut problem = mono_window();
    problem.constant_poses[1] = false;
    for outcome in solve_honestly("free scale", &problem) {
        assert!(outcome.is_converged());
        assert!(outcome.cost() < 0.05 * outcome.summary.solve.initial_cost);
    }
}

#[test]
fn landmarks_that_one_view_sees() {
    each_window("one view", |problem| {
        let mut seen = vec![false; problem.landmarks.len()];
        retain(problem, |_, landmark| {
            let first = !std::mem::replace(&mut seen[landmark as usize], true);
            first || landmark % 5 != 0
        });
    });
}

#[test]
fn a_window_of_one_camera() {
    each_window("one camera", |problem| {
        retain(problem, |pose, _| pose == 3);
        problem.constant_poses.fill(false);
    });
    each_window("one constant camera", |problem| {
        retain(problem, |pose, _| pose == 0);
    });
}

#[test]
fn a_camera_with_few_observations() {
    for count in 0..4 {
        each_window(&format!("a camera with {count} observations"), |problem| {
            let mut left = count;
            retain(problem, |pose, _| {
                let keep = pose != 5 || left > 0;
                left -= usize::from(pose == 5 && keep);
                keep
            });
        });
    }
}

#[test]
fn a_component_that_nothing_ties_to_the_rest() {
    each_window("two components", |problem| {
        // Landmarks take a side; the last four keyframes keep one side, the others the other.
        retain(problem, |pose, landmark| (pose >= 4) == (landmark % 2 == 0));
    });
}

#[test]
fn nothing_but_landmarks_or_nothing_but_poses_moves() {
    each_window("constant poses", |problem| problem.constant_poses.fill(true));
    each_window("constant landmarks", |problem| problem.constant_landmarks.fill(true));
}

/// The window as cameras see it that turn but do not move, with noise.
fn turning(mut problem: BundleProblem) -> BundleProblem {
    let scene = scene();
    let mut rng = seeded(7);
    let center = problem.poses[0].translation;
    let mut see = |pose: u32, landmark: u32| {
        let pose = Se3::new(scene.truth[pose as usize].rotation, center);
        let point = pose.inverse_transform(&scene.landmarks[landmark as usize]);
        let noise: Vector2<f64> = normal_vector(&mut rng, 0.7);
        (scene.camera.project(&point).unwrap() + noise, point.z)
    };
    let batch = &mut problem.reprojections;
    for k in 0..batch.len() {
        batch.pixels[k] = see(batch.poses[k], batch.landmarks[k]).0;
    }
    let batch = &mut problem.depth_reprojections;
    for k in 0..batch.len() {
        (batch.pixels[k], batch.depths_m[k]) = see(batch.poses[k], batch.landmarks[k]);
    }
    problem.poses.iter_mut().for_each(|pose| pose.translation = center);
    problem
}

#[test]
fn pure_rotation() {
    for (name, problem) in [("depth", depth_window()), ("mono", mono_window())] {
        let mut problem = turning(problem);
        for loss in [Loss::Trivial, Loss::Huber(1.5)] {
            problem.observation_loss = loss;
            for outcome in solve_honestly(&format!("{name}, pure rotation"), &problem) {
                assert!(outcome.cost() < 0.1 * outcome.summary.solve.initial_cost);
            }
        }
    }
}

/// The window as cameras see it that walk among landmarks too far away for that to show.
fn no_parallax_of(mut problem: BundleProblem) -> BundleProblem {
    let center = problem.poses[0].translation;
    let (scene, mut rng) = (scene(), seeded(11));
    for (landmark, truth) in problem.landmarks.iter_mut().zip(&scene.landmarks) {
        *landmark = center + (truth - center).normalize() * 1e7;
    }
    let plain = std::mem::take(&mut problem.reprojections);
    let depth = std::mem::take(&mut problem.depth_reprojections);
    let poses = plain.poses.iter().chain(&depth.poses);
    for (&pose, &landmark) in poses.zip(plain.landmarks.iter().chain(&depth.landmarks)) {
        let point = &problem.landmarks[landmark as usize];
        let point = scene.truth[pose as usize].inverse_transform(point);
        let noise: Vector2<f64> = normal_vector(&mut rng, 0.7);
        let pixel = scene.camera.project(&point).unwrap() + noise;
        problem.reprojections.push(pose, 0, landmark, pixel, 0.7);
    }
    problem
}

#[test]
fn no_parallax() {
    let slack = Slack { beyond_infinity: true, ..NO_SLACK };
    for (name, problem) in windows() {
        let mut problem = no_parallax_of(problem);
        for loss in [Loss::Trivial, Loss::Huber(1.5)] {
            problem.observation_loss = loss;
            for outcome in solve_honestly_with(slack, &format!("{name}, no parallax"), &problem) {
                assert!(outcome.cost() < 0.1 * outcome.summary.solve.initial_cost);
            }
        }
    }
}
