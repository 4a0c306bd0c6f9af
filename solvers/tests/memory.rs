//! The price of a solve against what the solve allocates, counted by the allocator of this binary.
//!
//! It has a binary of its own because the allocator counts the whole process; tests take turns.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a failed unwrap is a failed test")]
#![allow(unsafe_code, reason = "an allocator is unsafe")]
#![allow(clippy::print_stdout, reason = "the figures are read by people")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Mutex, PoisonError};

use covis_solvers::bundle_adjustment::{self, LinearSolver};
use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se2, Se3, So3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{self, ignore_iterations};
use covis_solvers::pose_graph;
use covis_solvers::price::Ceiling;
use covis_solvers::problem::{BundleProblem, PoseGraph, SolveError};
use covis_solvers::testing::random::{element, normal_vector, seeded};
use nalgebra::{SMatrix, Vector3};
use rand::RngExt;

/// An estimate is at least the truth and at most so many times that.
const MOST: f64 = 4.0;

/// Bytes that are live, and the most since it was set.
static LIVE: AtomicIsize = AtomicIsize::new(0);
static PEAK: AtomicIsize = AtomicIsize::new(0);

/// One test at a time, its problem included, so that none counts another's memory.
static TURN: Mutex<()> = Mutex::new(());

struct Counted;

#[global_allocator]
static ALLOCATOR: Counted = Counted;

fn grow(bytes: isize) {
    let live = LIVE.fetch_add(bytes, Ordering::Relaxed) + bytes;
    if bytes > 0 {
        PEAK.fetch_max(live, Ordering::Relaxed);
    }
}

// SAFETY: every call is handed on to the system's allocator as it came.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        grow(layout.size().cast_signed());
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        grow(layout.size().cast_signed());
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        grow(-layout.size().cast_signed());
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Old and new stand beside each other while what is inside is moved.
        grow(size.cast_signed());
        grow(-layout.size().cast_signed());
        // SAFETY: the caller's promise.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

/// Runs `work` and returns the most bytes that it held at once.
fn peak(work: impl FnOnce()) -> f64 {
    let before = LIVE.load(Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    work();
    (PEAK.load(Ordering::Relaxed) - before) as f64
}

#[track_caller]
fn compare(name: &str, estimate: u64, actual: f64) {
    let ratio = estimate as f64 / actual;
    let text = format!("{name}: estimate {estimate}, actual {actual}, ratio {ratio:.2}");
    assert!((1.0..=MOST).contains(&ratio), "{text}");
    // Shown with --nocapture.
    println!("{text}");
}

/// Poses along x that look along +z; each landmark is seen from `track` poses that `pick` chooses.
fn bundle(
    poses: usize,
    landmarks: usize,
    track: usize,
    mut pick: impl FnMut(usize, usize) -> usize,
) -> BundleProblem {
    let mut rng = seeded(5);
    let mut problem = BundleProblem::default();
    let (fx, fy, cx, cy) = (500.0, 500.0, 320.0, 240.0);
    let [k1, k2, p1, p2, k3] = [0.0; 5];
    let pinhole = PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 };
    let camera: Camera = pinhole.into();
    problem.push_camera(camera, true);
    let truth: Vec<Se3> = (0..poses)
        .map(|k| Se3::new(So3::identity(), Vector3::new(0.02 * k as f64, 0.0, 0.0)))
        .collect();
    for (k, pose) in truth.iter().enumerate() {
        let index = problem.push_pose(pose.plus(&normal_vector(&mut rng, 2e-3)));
        problem.constant_poses[index] = k < 2;
    }
    for i in 0..landmarks {
        let x = 0.02 * (i % poses) as f64;
        let y = rng.random::<f64>() * 2.0 - 1.0;
        let point = Vector3::new(x, y, 5.0 + rng.random::<f64>());
        let start = point + normal_vector::<3>(&mut rng, 0.01);
        let landmark = problem.push_landmark(start) as u32;
        let mut seen: Vec<usize> = (0..track).map(|j| pick(i, j)).collect();
        seen.sort_unstable();
        seen.dedup();
        for pose in seen {
            let pixel = camera.project(&truth[pose].inverse_transform(&point)).unwrap();
            problem.reprojections.push(pose as u32, 0, landmark, pixel, 1.0);
        }
    }
    problem
}

fn three_iterations() -> optimizer::Options {
    optimizer::Options { max_iterations: 3, ..optimizer::Options::default() }
}

fn check_bundle(name: &str, problem: &BundleProblem, solvers: &[LinearSolver]) {
    for &linear_solver in solvers {
        for threads in [1, 4] {
            let mut options = bundle_adjustment::Options {
                linear_solver,
                optimizer: three_iterations(),
                ..bundle_adjustment::Options::default()
            };
            options.optimizer.threads = Some(threads);
            let solve = |options: &bundle_adjustment::Options| {
                let mut solved = problem.clone();
                let mut outcome = None;
                let actual = peak(|| {
                    let observer = &mut ignore_iterations;
                    outcome = Some(bundle_adjustment::solve(&mut solved, options, observer));
                });
                (outcome.unwrap(), actual)
            };
            let (summary, actual) = solve(&options);
            // Each refusal says more of what it takes, until what is said is enough.
            options.linear_solver = summary.unwrap().linear_solver;
            let mut estimate = 0;
            loop {
                options.optimizer.ceiling = Ceiling { bytes: Some(estimate), ..Ceiling::NONE };
                match solve(&options).0 {
                    Err(SolveError::TooExpensive(refused)) => estimate = refused.estimate,
                    solved => break assert!(solved.is_ok(), "{solved:?}"),
                }
            }
            compare(&format!("{name}, {linear_solver:?}, {threads}"), estimate, actual);
        }
    }
}

const ALL: [LinearSolver; 4] = [
    LinearSolver::DenseSchur,
    LinearSolver::SparseSchur,
    LinearSolver::IterativeSchur,
    LinearSolver::Auto,
];

#[test]
fn a_bundle_whose_views_all_share_landmarks() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let poses = 300;
    let mut rng = seeded(6);
    let problem =
        bundle(poses, 3000, 12, |_, _| (rng.random::<f64>() * poses as f64) as usize % poses);
    check_bundle("dense", &problem, &ALL);
}

#[test]
fn a_bundle_along_a_street() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let poses = 800;
    let problem = bundle(poses, 16_000, 6, |i, j| (i % poses + j).min(poses - 1));
    check_bundle("street", &problem, &ALL);
}

#[test]
fn a_bundle_under_a_loss() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let poses = 400;
    let mut problem = bundle(poses, 8000, 6, |i, j| (i % poses + j).min(poses - 1));
    problem.observation_loss = Loss::Huber(0.5);
    check_bundle("loss", &problem, &[LinearSolver::SparseSchur, LinearSolver::IterativeSchur]);
}

#[test]
fn a_bundle_of_many_poses_that_see_little() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let problem = bundle(700, 20, 35, |i, j| 35 * i + j);
    check_bundle("little", &problem, &ALL);
}

/// A chain with `extra` edges between any two poses.
fn check_graph<G: LieGroup<N>, const N: usize>(name: &str, poses: usize, extra: usize) {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let mut rng = seeded(9);
    let truth: Vec<G> = (0..poses).map(|_| element(&mut rng, 1.0)).collect();
    let mut graph = PoseGraph::<G, N>::new();
    for (k, pose) in truth.iter().enumerate() {
        let index = graph.push_pose(k as i64, pose.plus(&normal_vector(&mut rng, 0.01)));
        graph.constant[index] = k == 0;
    }
    let mut any = || (rng.random::<f64>() * poses as f64) as usize % poses;
    let mut pairs: Vec<(usize, usize)> = (1..poses).map(|k| (k - 1, k)).collect();
    pairs.extend((0..extra).map(|_| (any(), any())).filter(|(i, j)| i != j));
    let information = Information::new(&SMatrix::<f64, N, N>::identity()).unwrap();
    for (i, j) in pairs {
        let i_from_j = truth[i].inverse().compose(&truth[j]);
        graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
    }
    let ceiling = Ceiling { bytes: Some(0), ..Ceiling::NONE };
    let none =
        pose_graph::Options { optimizer: optimizer::Options { ceiling, ..three_iterations() } };
    let refused = pose_graph::solve(&mut graph.clone(), &none, &mut ignore_iterations);
    let Err(SolveError::TooExpensive(refused)) = refused else { panic!("{name}: {refused:?}") };
    for threads in [1, 4] {
        let mut solved = graph.clone();
        let mut options = pose_graph::Options { optimizer: three_iterations() };
        options.optimizer.threads = Some(threads);
        let actual = peak(|| {
            pose_graph::solve(&mut solved, &options, &mut ignore_iterations).unwrap();
        });
        compare(&format!("{name}, {threads}"), refused.estimate, actual);
    }
}

#[test]
fn a_chain() {
    check_graph::<Se3, 6>("chain", 5000, 0);
}

#[test]
fn a_chain_with_some_closures() {
    check_graph::<Se3, 6>("some closures", 4000, 200);
}

#[test]
fn a_chain_with_edges_between_any_two_poses() {
    check_graph::<Se2, 3>("random edges", 2000, 3000);
}
