//! Bundle adjustment in sections: what the single solve finds, by any workers, also where some are lost.

use std::io::{self, Read};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;

use covis_solvers::bundle_adjustment::split::{
    self, Link, LocalWorkers, RemoteWorkers, SplitError, SplitOptions, SplitSummary, Start,
};
use covis_solvers::bundle_adjustment::{self, LinearSolver, Options};
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::factors::{PosePrior, PositionPrior, RelativePose};
use covis_solvers::geometry::LieGroup;
use covis_solvers::information::Information;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::io::bal::BalFile;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{self, Control, Termination, ignore_iterations};
use covis_solvers::price::Ceiling;
use covis_solvers::problem::{BundleProblem, SolveError};
use covis_solvers::testing::data;
use covis_solvers::testing::scene::{Scene, SceneOptions};
use nalgebra::{SVector, Vector3};

/// A walk of 40 keyframes with depths and odometry; the first pose is constant.
fn walk(seed: u64) -> BundleProblem {
    let options =
        SceneOptions { keyframes: 40, laps: 0.5, landmarks: 700, seed, ..Default::default() };
    let mut problem = Scene::generate(&options).to_problem();
    for j in 1..problem.poses.len() {
        let i_from_j = problem.poses[j - 1].inverse().compose(&problem.poses[j]);
        let information = Information::identity();
        problem.relative_poses.push(RelativePose {
            i: j - 1,
            j,
            i_from_j,
            information,
            loss: None,
        });
    }
    problem
}

fn twin() -> BundleProblem {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/twins");
    BalFile::read(&root.join("window-6-80.txt")).unwrap().to_problem()
}

fn options(sections: usize) -> SplitOptions {
    SplitOptions { sections, ..SplitOptions::default() }
}

fn split(problem: &mut BundleProblem, options: &SplitOptions, workers: usize) -> SplitSummary {
    let mut workers = LocalWorkers::new(workers);
    split::solve(problem, options, &mut workers, &Interrupt::NEVER, &mut ignore_iterations).unwrap()
}

fn single(problem: &mut BundleProblem, options: &Options) -> bundle_adjustment::BundleSummary {
    bundle_adjustment::solve(problem, options, &mut ignore_iterations).unwrap()
}

/// Solves by both and compares; poses may differ by `pose_tolerance` in any entry of their motion.
fn compare(name: &str, problem: &BundleProblem, options: &Options, pose_tolerance: f64) {
    let mut whole = problem.clone();
    let expected = single(&mut whole, options);
    for sections in [1, 2, 4, 7] {
        let mut part = problem.clone();
        let split_options = SplitOptions { bundle: *options, sections, ..SplitOptions::default() };
        let summary = split(&mut part, &split_options, 1);
        let found = &summary.bundle.solve;
        let context = format!("{name} in {sections} ({} made)", summary.sections.len());
        let relative = (found.final_cost / expected.solve.final_cost - 1.0).abs();
        assert!(relative < 1e-8, "{context}: {} {}", found.final_cost, expected.solve.final_cost);
        let start = (found.initial_cost / expected.solve.initial_cost - 1.0).abs();
        assert!(start < 1e-12, "{context}: starts at {}", found.initial_cost);
        let evaluated = bundle_cost(&part).total;
        assert!((evaluated / found.final_cost - 1.0).abs() < 1e-10, "{context}: {evaluated}");
        assert_eq!(summary.bundle.behind_camera, part.behind_camera_count());
        for (k, (a, b)) in part.poses.iter().zip(&whole.poses).enumerate() {
            let difference = a.inverse().compose(b).log().norm();
            assert!(difference < pose_tolerance, "{context}: pose {k} is {difference} off");
        }
    }
}

#[test]
fn sections_find_what_the_single_solve_finds() {
    compare("walk", &walk(1), &Options::default(), 1e-6);
    let mut known = twin();
    known.constant_cameras.fill(true);
    known.constant_poses[0] = true;
    known.constant_poses[1] = true;
    compare("twin", &known, &Options::default(), 1e-6);
    for loss in [Loss::Huber(1.0), Loss::Cauchy(2.0), Loss::Tukey(6.0)] {
        let mut robust = walk(2);
        robust.observation_loss = loss;
        robust.relative_pose_loss = Loss::Huber(1.0);
        let optimizer = optimizer::Options { cost_tolerance: 1e-12, ..Default::default() };
        compare(&format!("{loss:?}"), &robust, &Options { optimizer, ..Options::default() }, 1e-4);
    }
}

#[test]
fn sections_take_the_steps_of_the_single_solve() {
    let mut problem = walk(3);
    let mut whole = problem.clone();
    let expected = single(&mut whole, &Options::default());
    let found = split(&mut problem, &options(4), 1).bundle.solve;
    assert_eq!(found.iterations.len(), expected.solve.iterations.len());
    for (a, b) in found.iterations.iter().zip(&expected.solve.iterations) {
        assert!((a.cost / b.cost - 1.0).abs() < 1e-9, "{} {}", a.cost, b.cost);
        assert!((a.step_norm - b.step_norm).abs() <= 1e-6 * b.step_norm + 1e-12);
        assert!((a.step_quality - b.step_quality).abs() < 1e-3);
        let (a, b) = (a.gradient_max_norm, b.gradient_max_norm);
        assert!((a - b).abs() <= 1e-4 * b + 1e-9, "{a} {b}");
    }
    assert!(found.linear_residual < 1e-8);
}

#[test]
fn real_files_with_free_intrinsics_reach_the_single_solves_cost() {
    for name in ["ladybug-49-7776.txt", "trafalgar-21-11315.txt"] {
        let Some(path) = data(&format!("bal/{name}")) else { return };
        let problem = BalFile::read(&path).unwrap().to_problem();
        let mut known = problem.clone();
        known.constant_cameras.fill(true);
        compare(name, &known, &Options::default(), 1e-4);
        // The gauge is free and the valley flat: the cost is what both agree in.
        let mut whole = problem.clone();
        let expected = single(&mut whole, &Options::default()).solve.final_cost;
        let mut part = problem;
        let found = split(&mut part, &options(4), 1).bundle.solve;
        assert!(found.termination.is_converged());
        let cost = found.final_cost;
        assert!((cost / expected - 1.0).abs() < 1e-6, "{name}: {cost} against {expected}");
    }
}

#[test]
fn cameras_that_poses_share_and_pose_factors_hold() {
    let mut problem = walk(4);
    // One camera for all, free; another one for the last poses; priors inside and on borders.
    problem.constant_cameras.fill(false);
    let last = problem.poses.len() - 8;
    let more = problem.push_camera(problem.cameras[0], false) as u32;
    let batch = &mut problem.depth_reprojections;
    for (camera, &pose) in batch.cameras.iter_mut().zip(&batch.poses) {
        if pose as usize >= last {
            *camera = more;
        }
    }
    for pose in [3, 20] {
        problem.pose_priors.push(PosePrior {
            pose,
            world_from_camera: problem.poses[pose],
            information: Information::identity(),
            loss: Loss::Trivial,
        });
        problem.position_priors.push(PositionPrior {
            pose: pose + 5,
            position_in_world: problem.poses[pose + 5].translation,
            point_in_camera: Vector3::new(0.1, 0.0, 0.0),
            information: Information::identity(),
            loss: Loss::Huber(1.0),
        });
    }
    problem.constant_landmarks[10] = true;
    problem.constant_poses[15] = true;
    let optimizer = optimizer::Options { cost_tolerance: 1e-13, ..Default::default() };
    compare("shared camera", &problem, &Options { optimizer, ..Options::default() }, 1e-4);
}

#[test]
fn the_bits_depend_neither_on_workers_nor_on_threads_nor_on_what_is_kept() {
    let problem = walk(5);
    let mut expected = problem.clone();
    let first = split(&mut expected, &options(4), 1);
    let folder = tempfile::tempdir().unwrap();
    let check = |name: &str, found: &BundleProblem, summary: &SplitSummary| {
        assert!(*found == expected, "{name}");
        let costs = |s: &SplitSummary| -> Vec<u64> {
            s.bundle.solve.iterations.iter().map(|row| row.cost.to_bits()).collect()
        };
        assert_eq!(costs(summary), costs(&first), "{name}");
    };
    for (workers, threads) in [(1, 2), (2, 1), (3, 2), (4, 4)] {
        let mut found = problem.clone();
        let mut options = options(4);
        options.bundle.optimizer.threads = Some(threads);
        let summary = split(&mut found, &options, workers);
        check(&format!("{workers} workers, {threads} threads"), &found, &summary);
    }
    let mut found = problem.clone();
    let summary = split(&mut found, &SplitOptions { keep_bytes: 0, ..options(4) }, 2);
    check("nothing kept", &found, &summary);
    for file in [None, Some(folder.path().join("sections"))] {
        let mut found = problem.clone();
        let mut workers = RemoteWorkers::start(2, Box::new(|_| Ok(pipe(None)))).unwrap();
        let options = SplitOptions { file, keep_bytes: 1 << 21, ..options(4) };
        let summary = solve_by(&mut found, &options, &mut workers).unwrap();
        check("over streams", &found, &summary);
    }
}

fn solve_by(
    problem: &mut BundleProblem,
    options: &SplitOptions,
    workers: &mut RemoteWorkers,
) -> Result<SplitSummary, SplitError> {
    split::solve(problem, options, workers, &Interrupt::NEVER, &mut ignore_iterations)
}

/// A worker behind pipes, which dies after so many bytes of answers.
fn pipe(dies_after: Option<u64>) -> Link {
    let (mut input, requests) = io::pipe().unwrap();
    let (answers, mut output) = io::pipe().unwrap();
    // It ends with its input; what it was told last may be lost.
    thread::spawn(move || {
        let _outcome = split::serve(&mut input, &mut output);
    });
    let answers: Box<dyn Read + Send> = match dies_after {
        None => Box::new(answers),
        Some(bytes) => Box::new(answers.take(bytes)),
    };
    Link { answers, requests: Box::new(requests), end: Box::new(|| ()) }
}

#[test]
fn a_worker_that_is_lost_gets_its_state_again_and_the_bits_are_the_same() {
    let mut problem = walk(6);
    problem.observation_loss = Loss::Cauchy(2.0);
    let mut expected = problem.clone();
    split(&mut expected, &options(4), 1);
    // Within the first answer, a load, a contribution, a step, and between messages.
    for bytes in [0, 30, 2_000, 20_000, 100_000, 300_000] {
        let mut found = problem.clone();
        let started = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&started);
        let start: Box<Start> = Box::new(move |worker| {
            let is_first = count.fetch_add(1, Ordering::Relaxed) < 2;
            Ok(pipe((worker == 1 && is_first).then_some(bytes)))
        });
        let mut workers = RemoteWorkers::start(2, start).unwrap();
        let summary = solve_by(&mut found, &options(4), &mut workers).unwrap();
        assert!(found == expected, "lost after {bytes} bytes");
        assert_eq!(summary.workers[1].restarts, 1, "lost after {bytes} bytes");
        assert_eq!(started.load(Ordering::Relaxed), 3);
    }
}

#[test]
fn a_worker_that_dies_at_every_start_is_an_error_and_the_problem_is_untouched() {
    let mut problem = walk(6);
    let before = problem.clone();
    let mut workers = RemoteWorkers::start(2, Box::new(|_| Ok(pipe(Some(10))))).unwrap();
    let outcome = solve_by(&mut problem, &options(4), &mut workers);
    assert!(matches!(outcome, Err(SplitError::Lost { .. })), "{outcome:?}");
    assert!(problem == before);
}

#[test]
fn a_cancelled_solve_ends_at_its_best_state() {
    let mut problem = walk(7);
    let mut seen = Vec::new();
    let mut cancel = |row: &optimizer::IterationSummary| {
        seen.push(row.cost);
        if row.iteration == 2 { Control::Cancel } else { Control::Continue }
    };
    let mut workers = LocalWorkers::new(2);
    let interrupt = Interrupt::NEVER;
    let summary =
        split::solve(&mut problem, &options(4), &mut workers, &interrupt, &mut cancel).unwrap();
    assert_eq!(summary.bundle.solve.termination, Termination::Cancelled);
    let evaluated = bundle_cost(&problem).total;
    assert!((evaluated / seen.last().unwrap() - 1.0).abs() < 1e-10);
}

#[test]
fn an_interrupt_ends_a_wait_for_workers_at_the_best_state() {
    let mut problem = walk(7);
    let flag = Arc::new(AtomicBool::new(false));
    let interrupt = Interrupt::NEVER.or_when(Arc::clone(&flag));
    // From the third row on nobody answers: the interrupt alone ends the wait.
    let is_silent = Arc::new(AtomicBool::new(false));
    let silence = Arc::clone(&is_silent);
    let start: Box<Start> = Box::new(move |_| {
        let mut link = pipe(None);
        let (gone, ended) = (Arc::new(AtomicBool::new(false)), Arc::clone(&silence));
        let is_gone = Arc::clone(&gone);
        let flag = Arc::clone(&flag);
        let inner = std::mem::replace(&mut link.answers, Box::new(io::empty()));
        link.answers = Box::new(Silent { inner, is_silent: ended, is_gone, flag });
        link.end = Box::new(move || gone.store(true, Ordering::Release));
        Ok(link)
    });
    let mut workers = RemoteWorkers::start(2, start).unwrap();
    let mut costs = Vec::new();
    let mut observe = |row: &optimizer::IterationSummary| {
        costs.push(row.cost);
        if row.iteration == 2 {
            is_silent.store(true, Ordering::Release);
        }
        Control::Continue
    };
    let summary =
        split::solve(&mut problem, &options(4), &mut workers, &interrupt, &mut observe).unwrap();
    assert_eq!(summary.bundle.solve.termination, Termination::Cancelled);
    assert_eq!(costs.len(), 3);
    assert!((bundle_cost(&problem).total / costs[2] - 1.0).abs() < 1e-10);
}

/// Answers that stop, then set the flag of the interrupt, and end when the link does.
struct Silent {
    inner: Box<dyn Read + Send>,
    is_silent: Arc<AtomicBool>,
    is_gone: Arc<AtomicBool>,
    flag: Arc<AtomicBool>,
}

impl Read for Silent {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if !self.is_silent.load(Ordering::Acquire) {
            return self.inner.read(buffer);
        }
        self.flag.store(true, Ordering::Release);
        while !self.is_gone.load(Ordering::Acquire) {
            thread::yield_now();
        }
        Ok(0)
    }
}

#[test]
fn an_interrupt_that_is_due_at_once_is_reported() {
    let mut problem = walk(7);
    let before = problem.clone();
    let interrupt = Interrupt::NEVER.or_when(Arc::new(AtomicBool::new(true)));
    let mut workers = LocalWorkers::new(2);
    let outcome =
        split::solve(&mut problem, &options(4), &mut workers, &interrupt, &mut ignore_iterations);
    assert!(matches!(outcome, Err(SplitError::Solve(SolveError::Interrupted))), "{outcome:?}");
    assert!(problem == before);
}

#[test]
fn graphs_that_cannot_be_cut_or_are_in_pieces_are_solved_all_the_same() {
    // More sections than cameras.
    let mut tiny = twin();
    tiny.constant_cameras.fill(true);
    let mut whole = tiny.clone();
    let expected = single(&mut whole, &Options::default()).solve.final_cost;
    let summary = split(&mut tiny, &options(50), 3);
    assert!((summary.bundle.solve.final_cost / expected - 1.0).abs() < 1e-8);
    assert!(summary.sections.len() <= 50);

    // Two walks that share nothing.
    let mut pieces = walk(8);
    let other = walk(9);
    let (poses, landmarks) = (pieces.poses.len() as u32, pieces.landmarks.len() as u32);
    let cameras = pieces.cameras.len() as u32;
    pieces.poses.extend(&other.poses);
    pieces.constant_poses.extend(&other.constant_poses);
    pieces.cameras.extend(&other.cameras);
    pieces.constant_cameras.extend(&other.constant_cameras);
    pieces.landmarks.extend(&other.landmarks);
    pieces.constant_landmarks.extend(&other.constant_landmarks);
    for o in other.observations() {
        let (pose, camera, landmark) = (poses + o.pose, cameras + o.camera, landmarks + o.landmark);
        pieces.push_observation(pose, camera, landmark, o.seen);
    }
    let shifted = other.relative_poses.iter().map(|f| RelativePose {
        i: f.i + poses as usize,
        j: f.j + poses as usize,
        ..*f
    });
    pieces.relative_poses.extend(shifted);
    compare("pieces", &pieces, &Options::default(), 1e-6);
    let summary = split(&mut pieces, &options(2), 1);
    assert_eq!(summary.separator_dimension, 0, "two pieces need no separator");

    // Nothing but landmarks moves: no section has a camera to eliminate.
    let mut structure = walk(10);
    structure.constant_poses.fill(true);
    structure.constant_cameras.fill(true);
    compare("structure", &structure, &Options::default(), 1e-12);

    // A single pose sees constant landmarks.
    let mut one = walk(10);
    one.constant_poses.fill(true);
    one.constant_cameras.fill(true);
    one.constant_landmarks.fill(true);
    one.constant_poses[5] = false;
    let step: SVector<f64, 6> = SVector::repeat(0.01);
    one.poses[5] = one.poses[5].plus(&step);
    compare("one pose", &one, &Options::default(), 1e-7);
}

#[test]
fn long_tracks_never_join_the_insides_of_two_sections() {
    // Some landmarks are seen from everywhere.
    let mut problem = walk(11);
    let point = Vector3::new(0.0, 0.0, 0.0);
    for _ in 0..3 {
        let landmark = problem.push_landmark(point) as u32;
        for pose in 0..problem.poses.len() {
            let in_camera: Vector3<f64> = problem.poses[pose].inverse_transform(&point);
            let seen = covis_solvers::factors::Reprojection {
                pixel: nalgebra::Vector2::new(320.0, 240.0),
                sigma_px: 500.0,
                depth_m: Some((in_camera.z, 5.0)),
            };
            problem.push_observation(pose as u32, 0, landmark, seen);
        }
    }
    compare("long tracks", &problem, &Options::default(), 1e-5);
}

#[test]
fn what_cannot_be_solved_as_asked_is_refused() {
    let refused = |options: &SplitOptions, problem: &BundleProblem| {
        let mut problem = problem.clone();
        let mut workers = LocalWorkers::new(2);
        let never = Interrupt::NEVER;
        split::solve(&mut problem, options, &mut workers, &never, &mut ignore_iterations)
            .unwrap_err()
            .to_string()
    };
    let problem = walk(12);
    for linear_solver in [LinearSolver::DenseSchur, LinearSolver::IterativeSchur] {
        let bundle = Options { linear_solver, ..Options::default() };
        let error = refused(&SplitOptions { bundle, ..options(2) }, &problem);
        assert!(error.contains("linear_solver"), "{error}");
    }
    let error = refused(&options(0), &problem);
    assert!(error.contains("sections"), "{error}");
    let mut tight = options(2);
    tight.bundle.optimizer.ceiling = Ceiling { bytes: Some(1000), ..Ceiling::NONE };
    let error = refused(&tight, &problem);
    assert!(error.contains("the limit is 1000 bytes"), "{error}");
    let mut broken = problem.clone();
    broken.landmarks[3].x = f64::NAN;
    assert!(refused(&options(2), &broken).contains("landmark 3"));
    let mut still = problem;
    still.constant_poses.fill(true);
    still.constant_cameras.fill(true);
    still.constant_landmarks.fill(true);
    assert!(refused(&options(2), &still).contains("constant"));
}
