//! The fused pass over tracks of 1 to 40 views: every instruction set and linear solver takes the
//! same step, whatever is free or constant, and gives the same bits on any number of threads.
//!
//! For the threads there are more observations than one chunk holds, so that chunks are summed too.

use covis_solvers::bundle_adjustment::{BundleSummary, LinearSolver, Options, solve};
use covis_solvers::factors::Reprojection;
use covis_solvers::geometry::{
    Camera, KannalaBrandt, LieGroup, PinholeRadialTangential, Se3, Snavely, So3,
};
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::problem::BundleProblem;
use covis_solvers::simd::Class;
use covis_solvers::testing::random::{normal_vector, seeded};
use nalgebra::Vector3;
use rand::RngExt;

const CLASSES: [Class; 4] = [Class::Scalar, Class::Avx2, Class::Avx512, Class::Neon];

const DIRECT: [LinearSolver; 2] = [LinearSolver::DenseSchur, LinearSolver::SparseSchur];

const ROBUST: [Loss; 5] = [
    Loss::Huber(1.0),
    Loss::Cauchy(1.0),
    Loss::Tukey(4.0),
    Loss::Huber(2.5),
    Loss::GemanMcClure(2.0),
];

/// Views of the longest track, and poses.
const POSES: usize = 40;

/// How many landmarks have each length of track: a few tiles, and more than two chunks.
const FEW: usize = 4;
const MANY: usize = 25;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Depth {
    None,
    Some,
    All,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Intrinsics {
    /// One camera, constant.
    Known,
    /// One camera a pose, free.
    Own,
    /// One camera a pose, every third of them constant.
    SomeFixed,
    /// Two cameras that take turns, free.
    Shared,
}

fn snavely() -> Camera {
    Snavely { focal: 520.0, k1: -0.05, k2: 0.01 }.into()
}

fn pinhole() -> Camera {
    let (fx, fy, cx, cy) = (525.0, 520.0, 319.5, 239.5);
    let (k1, k2, p1, p2, k3) = (0.05, -0.02, 5e-4, -5e-4, 1e-3);
    PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 }.into()
}

fn fisheye() -> Camera {
    let [fx, fy, cx, cy] = [300.0, 301.0, 320.0, 240.0];
    KannalaBrandt { fx, fy, cx, cy, k1: 0.02, k2: -0.004, k3: 0.001, k4: 0.0 }.into()
}

/// A row of poses that look along +z, and landmarks before them: `count` of each track length.
fn row(count: usize, camera: Camera, depth: Depth, intrinsics: Intrinsics) -> BundleProblem {
    let mut rng = seeded(17);
    let mut problem = BundleProblem::default();
    let cameras = match intrinsics {
        Intrinsics::Known => 1,
        Intrinsics::Shared => 2,
        Intrinsics::Own | Intrinsics::SomeFixed => POSES,
    };
    for c in 0..cameras {
        let third = intrinsics == Intrinsics::SomeFixed && c % 3 == 0;
        problem.push_camera(camera, third || intrinsics == Intrinsics::Known);
    }
    let truth: Vec<Se3> = (0..POSES)
        .map(|k| Se3::new(So3::identity(), Vector3::new(0.05 * k as f64, 0.0, 0.0)))
        .map(|pose| pose.plus(&normal_vector(&mut rng, 0.02)))
        .collect();
    for (k, pose) in truth.iter().enumerate() {
        let index = problem.push_pose(pose.plus(&normal_vector(&mut rng, 2e-3)));
        problem.constant_poses[index] = k < 2;
    }
    for length in 1..=POSES {
        for i in 0..count {
            let mut uniform = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
            let point = Vector3::new(uniform(-1.0, 3.0), uniform(-1.5, 1.5), uniform(4.0, 8.0));
            let start = point + normal_vector::<3>(&mut rng, 0.01);
            let landmark = problem.push_landmark(start) as u32;
            let first = (i * 7 + length) % (POSES + 1 - length);
            for pose in first..first + length {
                let in_camera = truth[pose].inverse_transform(&point);
                let noise: Vector3<f64> = normal_vector(&mut rng, 1.0);
                let pixel = camera.project(&in_camera).unwrap() + noise.xy() * 0.7;
                let (camera, pose) = ((pose % cameras) as u32, pose as u32);
                let with_depth = match depth {
                    Depth::None => false,
                    Depth::Some => (i + pose as usize).is_multiple_of(2),
                    Depth::All => true,
                };
                if with_depth {
                    let depth_m = in_camera.z + noise.z * 0.02;
                    let (sigma_px, sigma_depth_m) = (0.7, 0.02);
                    let factor =
                        Reprojection { pixel, sigma_px, depth_m: Some((depth_m, sigma_depth_m)) };
                    problem.push_observation(pose, camera, landmark, factor);
                } else {
                    problem.reprojections.push(pose, camera, landmark, pixel, 0.7);
                }
            }
        }
    }
    problem
}

/// Constants in between: poses, and landmarks of every length.
fn with_constants(mut problem: BundleProblem) -> BundleProblem {
    problem.constant_poses.iter_mut().step_by(5).for_each(|constant| *constant = true);
    problem.constant_landmarks.iter_mut().step_by(3).for_each(|constant| *constant = true);
    problem
}

/// Every kernel that `dispatch` can pick, with what may be constant or shared.
fn problems(count: usize) -> Vec<(String, BundleProblem)> {
    use Depth::{All, None, Some};
    use Intrinsics::{Known, Own, Shared, SomeFixed};
    let cases = [
        ("snavely", snavely(), None, Known),
        ("snavely", snavely(), None, Own),
        ("snavely", snavely(), None, SomeFixed),
        ("snavely", snavely(), None, Shared),
        ("pinhole", pinhole(), None, Known),
        ("pinhole", pinhole(), All, Known),
        ("pinhole", pinhole(), Some, Known),
        ("pinhole", pinhole(), None, Shared),
        ("pinhole", pinhole(), Some, SomeFixed),
        ("fisheye", fisheye(), None, Known),
        ("fisheye", fisheye(), Some, Known),
        ("fisheye", fisheye(), Some, Shared),
    ];
    let mut problems = Vec::new();
    for (model, camera, depth, intrinsics) in cases {
        let name = format!("{model}, depth {depth:?}, cameras {intrinsics:?}");
        let problem = row(count, camera, depth, intrinsics);
        problems.push((format!("{name}, constants"), with_constants(problem.clone())));
        problems.push((name, problem));
    }
    problems
}

fn run(problem: &BundleProblem, options: &Options) -> (BundleProblem, BundleSummary) {
    let mut problem = problem.clone();
    let summary = solve(&mut problem, options, &mut ignore_iterations).unwrap();
    (problem, summary)
}

fn steps(count: usize, class: Class, linear_solver: LinearSolver) -> Options {
    let mut options = Options { linear_solver, class: Some(class), ..Options::default() };
    options.optimizer.max_iterations = count;
    options
}

/// Largest difference of two states, each kind in units of what the step moved it at most.
fn difference(start: &BundleProblem, a: &BundleProblem, b: &BundleProblem) -> f64 {
    let largest = |x: &BundleProblem, y: &BundleProblem| {
        let poses = x.poses.iter().zip(&y.poses).map(|(x, y)| x.minus(y).amax());
        let landmarks = x.landmarks.iter().zip(&y.landmarks).map(|(x, y)| (x - y).amax());
        let parameters = |p: &BundleProblem| -> Vec<f64> {
            p.cameras.iter().flat_map(|c| c.parameters().to_vec()).collect()
        };
        let (p, q) = (parameters(x), parameters(y));
        let cameras = p.iter().zip(&q).map(|(p, q)| (p - q).abs());
        [poses.fold(0.0, f64::max), landmarks.fold(0.0, f64::max), cameras.fold(0.0, f64::max)]
    };
    let (moved, apart) = (largest(start, a), largest(a, b));
    let share = |(apart, moved): (f64, f64)| if apart == 0.0 { 0.0 } else { apart / moved };
    apart.into_iter().zip(moved).map(share).fold(0.0, f64::max)
}

#[test]
fn every_class_and_direct_solver_takes_the_same_first_step() {
    for (i, (name, mut problem)) in problems(FEW).into_iter().enumerate() {
        for loss in [Loss::Trivial, ROBUST[i % ROBUST.len()]] {
            problem.observation_loss = loss;
            let options = steps(1, Class::Scalar, LinearSolver::DenseSchur);
            let (reference, summary) = run(&problem, &options);
            let one = summary.solve.iterations[1];
            assert!(one.accepted && one.step_norm > 1e-3, "{name} {loss:?}: {one:?}");
            for class in CLASSES.into_iter().filter(|class| class.is_available()) {
                for linear_solver in DIRECT {
                    let (stepped, other) = run(&problem, &steps(1, class, linear_solver));
                    let case = format!("{name} {loss:?} {class} {linear_solver:?}");
                    assert_eq!((other.class, other.linear_solver), (class, linear_solver));
                    let apart = difference(&problem, &reference, &stepped);
                    assert!(apart < 1e-7, "{case}: {apart:e}");
                    let quality = other.solve.iterations[1].step_quality;
                    assert!((quality - one.step_quality).abs() < 1e-8, "{case}: {quality}");
                    let constant = &problem.constant_landmarks;
                    for held in (0..constant.len()).filter(|&landmark| constant[landmark]) {
                        assert_eq!(stepped.landmarks[held], problem.landmarks[held], "{case}");
                    }
                }
            }
        }
    }
}

#[test]
fn every_class_takes_the_same_first_inexact_step() {
    for (name, mut problem) in problems(FEW) {
        for loss in [Loss::Trivial, Loss::Huber(1.0)] {
            problem.observation_loss = loss;
            let options = |class| steps(1, class, LinearSolver::IterativeSchur);
            let (reference, _) = run(&problem, &options(Class::Scalar));
            for class in CLASSES.into_iter().filter(|class| class.is_available()) {
                let (stepped, _) = run(&problem, &options(class));
                let apart = difference(&problem, &reference, &stepped);
                assert!(apart < 1e-6, "{name} {loss:?} {class}: {apart:e}");
            }
        }
    }
}

#[test]
fn the_same_bits_with_1_2_and_3_threads() {
    for (name, mut problem) in problems(MANY) {
        problem.observation_loss = Loss::Huber(1.0);
        for linear_solver in
            [LinearSolver::DenseSchur, LinearSolver::SparseSchur, LinearSolver::IterativeSchur]
        {
            let with = |threads| {
                let mut options = steps(3, Class::detect(), linear_solver);
                options.optimizer.threads = Some(threads);
                let (solved, summary) = run(&problem, &options);
                let rows = summary.solve.iterations.iter();
                (solved, rows.map(|row| (row.cost, row.gradient_max_norm)).collect::<Vec<_>>())
            };
            let one = with(1);
            for threads in [2, 3] {
                assert_eq!(one, with(threads), "{name} {linear_solver:?} {threads} threads");
            }
        }
    }
}

#[test]
fn the_tracks_fill_more_than_one_chunk() {
    let problem = row(MANY, snavely(), Depth::None, Intrinsics::Own);
    let mut views = vec![0; problem.landmarks.len()];
    problem.reprojections.landmarks.iter().for_each(|&l| views[l as usize] += 1);
    assert!((1..=POSES).all(|n| views.iter().filter(|&&v| v == n).count() == MANY));
    assert!(problem.observation_count() > 2 * 8192);
}
