//! The price of a solve, and of reading a file, against what they allocate, counted by the allocator of this
//! binary.
//!
//! It has a binary of its own because the allocator counts the whole process; tests take turns.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a failed unwrap is a failed test")]
#![allow(unsafe_code, reason = "an allocator is unsafe")]
#![allow(clippy::print_stdout, reason = "the figures are read by people")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::any::Any;
use std::path::Path;
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Mutex, PoisonError};

use covis_solvers::bundle_adjustment::{self, LinearSolver};
use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se2, Se3, So3};
use covis_solvers::information::Information;
use covis_solvers::io::bal::BalFile;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel};
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::io::reading::{Content, FileCounts};
use covis_solvers::io::trajectory::Trajectory;
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

/// What is in memory after files were read: the parsed files, their problem where they have one, and the
/// files of the problem as it would be written, where that `is_written`.
fn read(content: Content, files: &[Vec<u8>], is_written: bool) -> Box<dyn Any> {
    let path = Path::new("file");
    let colmap = |encoding| -> Box<dyn Any> {
        let model = ColmapModel::parse(encoding, [&files[0], &files[1], &files[2]], path).unwrap();
        let problem = model.to_problem().unwrap();
        let written = is_written.then(|| model.to_files(encoding).unwrap());
        Box::new((model, problem, written))
    };
    match content {
        Content::Bal => {
            let file = BalFile::parse(&files[0], path).unwrap();
            let (problem, written) = (file.to_problem(), is_written.then(|| file.to_bytes()));
            Box::new((file, problem, written))
        }
        Content::Graph => {
            let graph = G2oGraph::parse(&files[0], path).unwrap();
            let problem: Box<dyn Any> = match &graph {
                G2oGraph::Se2(file) => Box::new(file.to_pose_graph().unwrap()),
                G2oGraph::Se3(file) => Box::new(file.to_pose_graph().unwrap()),
            };
            let written = is_written.then(|| graph.to_bytes());
            Box::new((graph, problem, written))
        }
        Content::ColmapText => colmap(ColmapEncoding::Text),
        Content::ColmapBinary => colmap(ColmapEncoding::Binary),
        Content::Trajectory => Box::new(Trajectory::parse(&files[0], path).unwrap()),
    }
}

/// Compares the price of reading files, and of writing their solution, with what both take, the bytes of
/// the files included.
fn check_reading(name: &str, content: Content, files: &[Vec<u8>], is_honest: bool) {
    let mut counts = FileCounts::default();
    for file in files {
        counts.add(file);
        counts.end_file();
    }
    let price = counts.price(content);
    let bytes = files.iter().map(Vec::len).sum::<usize>() as f64;
    let with_solution = price.reading + price.solution;
    for (is_written, estimate) in [(false, price.reading), (true, with_solution)] {
        let actual = bytes + peak(|| drop(read(content, files, is_written)));
        let ratio = estimate as f64 / actual;
        let text =
            format!("{name}: {bytes} bytes, estimate {estimate}, actual {actual}, {ratio:.2}");
        assert!(ratio >= 1.0, "{text}");
        assert!(ratio <= MOST || !is_honest, "{text}");
        println!("{text}");
    }
}

/// As many as leave lists that double just before their next doubling with the most room.
const MANY: usize = (1 << 15) + 1;

#[test]
fn files_of_the_shortest_numbers_take_no_more_than_their_price() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let line = |text: &str| text.repeat(MANY).into_bytes();
    let counted = |counts: [usize; 3], body: String| {
        format!("{} {} {}\n{body}", counts[0], counts[1], counts[2])
    };
    let points = |count: usize| "0 0 0\n".repeat(count);
    let cameras = |count: usize| "0 0 0 0 0 0 1 0 0\n".repeat(count);
    let bal = counted([MANY, 0, 0], cameras(MANY));
    check_reading("BAL, cameras", Content::Bal, &[bal.into_bytes()], false);
    let bal = counted([0, MANY, 0], points(MANY));
    check_reading("BAL, points", Content::Bal, &[bal.into_bytes()], false);
    let bal = counted([1, 1, MANY], "0 0 1 1\n".repeat(MANY) + &cameras(1) + &points(1));
    check_reading("BAL, observations", Content::Bal, &[bal.into_bytes()], false);

    let number = |text: fn(usize) -> String| (0..MANY).map(text).collect::<String>().into_bytes();
    let vertices = number(|k| format!("VERTEX_SE2 {k} 0 0 0\n"));
    check_reading(
        "g2o, vertices in the plane",
        Content::Graph,
        std::slice::from_ref(&vertices),
        false,
    );
    let vertices_3d = number(|k| format!("VERTEX_SE3:QUAT {k} 0 0 0 0 0 0 1\n"));
    check_reading("g2o, vertices in space", Content::Graph, &[vertices_3d], false);
    let edges = number(|k| format!("EDGE_SE2 {k} {} 0 0 0 1 0 0 1 0 1\n", k + 1));
    check_reading("g2o, edges alone in the plane", Content::Graph, &[edges], false);
    let diagonal = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1";
    let edge = format!("EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 {diagonal}\n");
    check_reading("g2o, edges in space", Content::Graph, &[line(&edge)], false);
    let fixed = [&b"VERTEX_SE2 0 0 0 0\nFIX"[..], &line(" 0")].concat();
    check_reading("g2o, fixed", Content::Graph, &[fixed], false);

    let camera = b"1 SIMPLE_PINHOLE 1 1 1 1 1\n".to_vec();
    let point = b"0 0 0 0 0 0 0 0\n".to_vec();
    let all = number(|k| format!("{k} SIMPLE_PINHOLE 1 1 1 1 1\n"));
    check_reading("COLMAP, cameras", Content::ColmapText, &[all, vec![], vec![]], false);
    let all = number(|k| format!("{k} 0 0 0 0 0 0 0\n"));
    check_reading("COLMAP, points", Content::ColmapText, &[camera.clone(), vec![], all], false);
    let all = number(|k| format!("{k} 1 0 0 0 0 0 0 1 a\n\n"));
    check_reading(
        "COLMAP, images",
        Content::ColmapText,
        &[camera.clone(), all, point.clone()],
        false,
    );
    let image = [&b"1 1 0 0 0 0 0 0 1 a\n"[..], &line("0 0 0 "), b"\n"].concat();
    check_reading("COLMAP, keypoints", Content::ColmapText, &[camera.clone(), image, point], false);
    let image = b"1 1 0 0 0 0 0 0 1 a\n0 0 -1\n".to_vec();
    let track = [&b"0 0 0 0 0 0 0 0"[..], &line(" 1 0"), b"\n"].concat();
    check_reading("COLMAP, tracks", Content::ColmapText, &[camera, image, track], false);

    check_reading("trajectory", Content::Trajectory, &[line("0 0 0 0 0 0 0 1\n")], false);
}

#[test]
fn a_binary_model_takes_no_more_than_its_price() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let camera = "1 SIMPLE_PINHOLE 1 1 1 1 1\n";
    let made = |cameras: &str, images: &str, points: &str| {
        let files = [cameras.as_bytes(), images.as_bytes(), points.as_bytes()];
        let model = ColmapModel::parse(ColmapEncoding::Text, files, Path::new("file")).unwrap();
        let files = model.to_files(ColmapEncoding::Binary).unwrap();
        files.into_iter().map(|(_, bytes)| bytes).collect::<Vec<_>>()
    };
    let cameras: String = (0..MANY).map(|k| format!("{k} SIMPLE_PINHOLE 1 1 1 1 1\n")).collect();
    check_reading("binary, cameras", Content::ColmapBinary, &made(&cameras, "", ""), false);
    let keypoints = format!("1 1 0 0 0 0 0 0 1 a\n{}\n", "0 0 0 ".repeat(MANY));
    let files = made(camera, &keypoints, "0 0 0 0 0 0 0 0\n");
    check_reading("binary, keypoints", Content::ColmapBinary, &files, false);
    let images: String = (0..MANY).map(|k| format!("{k} 1 0 0 0 0 0 0 1 a\n\n")).collect();
    check_reading("binary, images", Content::ColmapBinary, &made(camera, &images, ""), false);
    let points: String = (0..MANY).map(|k| format!("{k} 0 0 0 0 0 0 0\n")).collect();
    check_reading("binary, points", Content::ColmapBinary, &made(camera, "", &points), false);
}

#[test]
fn files_as_programs_write_them_are_not_priced_far_above_what_they_take() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/twins");
    let file = |name: &str| std::fs::read(golden.join(name)).unwrap();
    check_reading("window", Content::Bal, &[file("window-6-80.txt")], true);
    check_reading("grid", Content::Graph, &[file("grid-200.g2o")], true);
    check_reading("sphere", Content::Graph, &[file("sphere-200.g2o")], true);
    let model = ["cameras.txt", "images.txt", "points3D.txt"];
    let model = model.map(|name| file(&format!("colmap-room/{name}")));
    check_reading("room", Content::ColmapText, &model, true);
}
