//! Bundle adjustment under robust losses: how fast it converges, and to what.

use std::collections::HashMap;
use std::path::Path;
use std::str::FromStr;

use covis_solvers::bundle_adjustment::{BundleSummary, LinearSolver, Options, solve};
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::factors::{RelativePose, Reprojection};
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3, So3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::problem::BundleProblem;
use covis_solvers::testing::data;
use covis_solvers::testing::random::{normal_vector, seeded};
use covis_solvers::testing::scene::{Scene, SceneOptions};
use nalgebra::{SVector, Vector2, Vector3};

/// The numbers of each line of a text file that begins with a head line.
fn table(path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let numbers = |line: &str| line.split_whitespace().map(|x| f64::from_str(x).unwrap()).collect();
    lines.map(numbers).collect()
}

fn pose(x: &[f64]) -> Se3 {
    let rotation = So3::from_quaternion_xyzw(x[3], x[4], x[5], x[6]).unwrap();
    Se3::new(rotation, Vector3::new(x[0], x[1], x[2]))
}

/// What a small RGB-D frontend made of a real sequence; with its loop closures as relative poses.
pub(crate) fn rgbd() -> Option<BundleProblem> {
    let folder = data("closures/fr1_rpy")?;
    let intrinsics = table(&data("rgbd/tum_fr1_rpy/camera.txt")?).remove(0);
    let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = intrinsics[..] else { unreachable!() };
    let camera = Camera::Pinhole(PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 });
    let mut problem = BundleProblem::default();
    problem.push_camera(camera, true);
    for row in table(&folder.join("keyframes.txt")) {
        problem.push_pose(pose(&row[2..]));
    }
    problem.constant_poses[0] = true;
    let mut landmarks = HashMap::new();
    for row in table(&folder.join("observations.txt")) {
        let [keyframe, id, u, v, depth_m, sigma_px, sigma_depth_m] = row[..] else {
            unreachable!()
        };
        let pixel = Vector2::new(u, v);
        let from = problem.poses[keyframe as usize];
        let landmark = *landmarks.entry(id as u32).or_insert_with(|| {
            let ray = camera.unproject(&pixel).unwrap();
            let point = from.transform(&(ray * (depth_m / ray.z)));
            problem.push_landmark(point) as u32
        });
        let seen = from.inverse_transform(&problem.landmarks[landmark as usize]);
        if camera.project(&seen).is_none() {
            continue;
        }
        if depth_m > 0.0 {
            let factor = Reprojection { pixel, sigma_px, depth_m: Some((depth_m, sigma_depth_m)) };
            problem.push_observation(keyframe as u32, 0, landmark, factor);
        } else {
            problem.reprojections.push(keyframe as u32, 0, landmark, pixel, sigma_px);
        }
    }
    for row in table(&folder.join("closures.txt")) {
        let sigmas = SVector::from([0.03, 0.03, 0.03, 0.0262, 0.0262, 0.0262]);
        problem.relative_poses.push(RelativePose {
            i: row[1] as usize,
            j: row[2] as usize,
            i_from_j: pose(&row[3..]),
            information: Information::from_sigmas(&sigmas).unwrap(),
            loss: None,
        });
    }
    Some(problem)
}

fn run(problem: &mut BundleProblem, options: &Options) -> BundleSummary {
    solve(problem, options, &mut ignore_iterations).unwrap()
}

/// What `rgbd()` reached by reweighted least squares in 100 steps, where none of the losses ended by a
/// tolerance.
const REWEIGHTED: [(Loss, f64); 4] = [
    (Loss::Huber(2.0), 1.04118851e5),
    (Loss::Cauchy(2.0), 3.76718193e4),
    (Loss::Tukey(6.0), 3.63922962e4),
    (Loss::GemanMcClure(3.0), 2.83016202e4),
];

#[test]
fn real_depth_under_every_loss_ends_by_a_tolerance_within_30_iterations() {
    let Some(problem) = rgbd() else { return };
    for (loss, reweighted) in REWEIGHTED {
        let mut problem = problem.clone();
        (problem.observation_loss, problem.relative_pose_loss) = (loss, loss);
        let mut options = Options::default();
        options.optimizer.max_iterations = 30;
        let summary = run(&mut problem, &options).solve;
        assert!(summary.termination.is_converged(), "{loss:?}: {}", summary.termination);
        // Reweighted least squares ends near 2.
        let quality = summary.iterations.last().unwrap().step_quality;
        assert!((0.7..1.7).contains(&quality), "{loss:?}: {quality}");
        // Losses that are not convex have many minima: another one may be a little higher.
        let slack = if matches!(loss, Loss::Huber(_)) { 0.0 } else { 2e-3 };
        assert!(
            summary.final_cost <= reweighted * (1.0 + slack),
            "{loss:?}: {}",
            summary.final_cost
        );
        let evaluated = bundle_cost(&problem).total;
        assert!((evaluated / summary.final_cost - 1.0).abs() < 1e-10, "{loss:?}");
    }
}

/// A walk where a third of the observations are off by many sigmas.
fn with_outliers() -> BundleProblem {
    let options =
        SceneOptions { keyframes: 20, laps: 0.3, landmarks: 700, seed: 2, ..Default::default() };
    let mut problem = Scene::generate(&options).to_problem();
    let mut rng = seeded(6);
    for k in (0..problem.depth_reprojections.len()).step_by(3) {
        problem.depth_reprojections.pixels[k] += normal_vector::<2>(&mut rng, 12.0);
        problem.depth_reprojections.depths_m[k] *= 1.0 + 0.1 * normal_vector::<1>(&mut rng, 1.0).x;
    }
    problem
}

#[test]
fn a_walk_with_outliers_ends_by_a_tolerance_under_every_loss_and_solver() {
    for (loss, _) in REWEIGHTED {
        for linear_solver in [LinearSolver::DenseSchur, LinearSolver::SparseSchur] {
            let mut problem = with_outliers();
            problem.observation_loss = loss;
            let options = Options { linear_solver, ..Options::default() };
            let summary = run(&mut problem, &options).solve;
            let count = summary.iterations.len();
            let is_ended = summary.termination.is_converged() && count <= 31;
            assert!(is_ended, "{loss:?}, {linear_solver:?}: {count}");
            let rows = summary.iterations.windows(2);
            assert!(rows.clone().all(|rows| rows[1].cost <= rows[0].cost), "{loss:?}");
            let evaluated = bundle_cost(&problem).total;
            assert!((evaluated / summary.final_cost - 1.0).abs() < 1e-10, "{loss:?}");
        }
    }
}

#[test]
fn no_small_move_from_a_robust_optimum_lowers_the_cost() {
    for (loss, _) in REWEIGHTED {
        let mut problem = with_outliers();
        problem.observation_loss = loss;
        run(&mut problem, &Options::default());
        let best = bundle_cost(&problem).total;
        let mut rng = seeded(9);
        for _ in 0..20 {
            let mut moved = problem.clone();
            for (pose, &constant) in moved.poses.iter_mut().zip(&problem.constant_poses) {
                if !constant {
                    *pose = pose.plus(&normal_vector(&mut rng, 1e-4));
                }
            }
            for landmark in &mut moved.landmarks {
                *landmark += normal_vector::<3>(&mut rng, 1e-4);
            }
            assert!(bundle_cost(&moved).total > best, "{loss:?}");
        }
    }
}

#[test]
fn one_robust_step_leaves_every_landmark_at_a_minimum_of_its_own() {
    for loss in [Loss::Huber(2.0), Loss::Cauchy(2.0)] {
        let mut problem = with_outliers();
        problem.observation_loss = loss;
        let mut options = Options::default();
        options.optimizer.max_iterations = 1;
        run(&mut problem, &options);
        let after_one = bundle_cost(&problem).total;
        problem.constant_poses.fill(true);
        run(&mut problem, &Options::default());
        let left = after_one - bundle_cost(&problem).total;
        assert!((0.0..=1e-6 * after_one).contains(&left), "{loss:?}: {left} of {after_one}");
    }
}

#[test]
fn landmarks_that_are_held_fixed_stay_under_every_loss() {
    for (loss, _) in REWEIGHTED {
        let mut problem = with_outliers();
        problem.observation_loss = loss;
        problem.constant_landmarks.iter_mut().step_by(3).for_each(|constant| *constant = true);
        let before = problem.landmarks.clone();
        run(&mut problem, &Options::default());
        let held = problem.constant_landmarks.iter().zip(before.iter().zip(&problem.landmarks));
        for (&is_held, (before, after)) in held {
            assert!(!is_held || before == after, "{loss:?}");
        }
        assert_ne!(before, problem.landmarks, "{loss:?}");
    }
}

#[test]
fn robust_solves_have_the_same_bits_at_any_thread_count() {
    for (loss, _) in REWEIGHTED {
        let with = |threads| {
            let mut problem = with_outliers();
            problem.observation_loss = loss;
            let mut options = Options::default();
            options.optimizer.threads = Some(threads);
            options.optimizer.max_iterations = 12;
            run(&mut problem, &options);
            problem
        };
        assert_eq!(with(1), with(3), "{loss:?}");
    }
}
