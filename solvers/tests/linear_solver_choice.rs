//! Which solver [`LinearSolver::Auto`] takes for the reduced system of problems of ten shapes, and that it
//! changes its mind where conjugate gradients take too many products.
//!
//! All poses stand close together and see every landmark, so that a problem has any structure that its
//! tracks say.

use covis_solvers::bundle_adjustment::{
    BundleSummary, Checkpoint, Keeper, LinearSolver, Options, solve, solve_kept,
};
use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3, So3};
use covis_solvers::information::Information;
use covis_solvers::optimizer::{IterationSummary, ignore_iterations};
use covis_solvers::problem::{BundleProblem, SolveError};
use covis_solvers::testing::random::{normal_vector, seeded};
use nalgebra::{SVector, Vector3};
use rand::RngExt;

/// A problem with so many poses, the first constant, and a landmark for each track, whose pixels weigh little
/// from track `vague` on.
fn problem(poses: usize, tracks: &[Vec<usize>], vague: usize) -> BundleProblem {
    let mut rng = seeded(3);
    let mut problem = BundleProblem::default();
    let (fx, fy, cx, cy) = (500.0, 500.0, 320.0, 240.0);
    let lens =
        PinholeRadialTangential { fx, fy, cx, cy, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 };
    let camera: Camera = lens.into();
    problem.push_camera(camera, true);
    let mut truth = Vec::new();
    for pose in 0..poses {
        let at = Vector3::from_fn(|_, _| rng.random::<f64>());
        truth.push(Se3::new(So3::identity(), at));
        let index = problem.push_pose(truth[pose].plus(&normal_vector(&mut rng, 1e-3)));
        problem.constant_poses[index] = pose == 0;
    }
    for (number, track) in tracks.iter().enumerate() {
        let sigma_px = if number < vague { 1.0 } else { 1000.0 };
        let point = Vector3::new(
            4.0 * rng.random::<f64>() - 2.0,
            4.0 * rng.random::<f64>() - 2.0,
            4.0 + 4.0 * rng.random::<f64>(),
        );
        let landmark = problem.push_landmark(point + normal_vector::<3>(&mut rng, 1e-2)) as u32;
        for &pose in track {
            let in_camera = truth[pose].inverse_transform(&point);
            let pixel = camera.project(&in_camera).unwrap() + normal_vector::<2>(&mut rng, 0.3);
            problem.reprojections.push(pose as u32, 0, landmark, pixel, sigma_px);
        }
    }
    problem
}

fn run(
    problem: &mut BundleProblem,
    linear_solver: LinearSolver,
    iterations: usize,
) -> BundleSummary {
    let mut options = Options { linear_solver, ..Options::default() };
    options.optimizer.max_iterations = iterations;
    solve(problem, &options, &mut ignore_iterations).unwrap()
}

/// Tracks of `length` poses in a row, `count` of them from each.
fn chain(poses: usize, length: usize, count: usize) -> Vec<Vec<usize>> {
    let starts = 0..=poses - length;
    starts.flat_map(|start| std::iter::repeat_n((start..start + length).collect(), count)).collect()
}

/// A grid of `side` × `side` poses: landmarks seen by squares of 2 × 2, and by whole rows of `width`.
fn grid(side: usize, width: usize, count: usize) -> Vec<Vec<usize>> {
    let mut tracks = Vec::new();
    for y in 0..side - 1 {
        for x in 0..side - 1 {
            let square =
                vec![y * side + x, y * side + x + 1, (y + 1) * side + x, (y + 1) * side + x + 1];
            tracks.extend(std::iter::repeat_n(square, count));
            let row = x..(x + width).min(side);
            tracks.push(row.map(|x| y * side + x).collect());
        }
    }
    tracks
}

/// Tracks of `length` poses anywhere.
fn anywhere(poses: usize, length: usize, count: usize) -> Vec<Vec<usize>> {
    let mut rng = seeded(5);
    let mut track = || {
        let mut track: Vec<usize> = Vec::new();
        while track.len() < length {
            let pose = rng.random_range(0..poses);
            if !track.contains(&pose) {
                track.push(pose);
            }
        }
        track
    };
    (0..count).map(|_| track()).collect()
}

#[test]
fn the_choice_suits_the_shape() {
    use LinearSolver::{DenseSchur, IterativeSchur, SparseSchur};
    let loops = |poses: usize| {
        let mut tracks = chain(poses, 4, 6);
        tracks.extend((0..poses / 2).map(|k| vec![k, poses - 1 - k]));
        tracks
    };
    let star = |leaves: usize| -> Vec<Vec<usize>> {
        (1..=leaves).flat_map(|leaf| std::iter::repeat_n(vec![0, leaf], 8)).collect()
    };
    let hub = |poses: usize| {
        let mut tracks = chain(poses, 4, 6);
        tracks.push((0..poses).step_by(40).collect());
        tracks
    };
    let shapes = [
        ("a window", 20, chain(20, 6, 20), DenseSchur),
        ("orbits of one thing", 120, anywhere(120, 8, 3000), IterativeSchur),
        ("a short street", 300, chain(300, 6, 6), SparseSchur),
        ("a long street", 3000, chain(3000, 6, 6), SparseSchur),
        ("a long street of long tracks", 1500, chain(1500, 30, 6), SparseSchur),
        ("a street driven back", 1000, loops(1000), SparseSchur),
        ("a street with a tower", 2000, hub(2000), SparseSchur),
        ("a grid", 900, grid(30, 5, 4), SparseSchur),
        ("a star", 1001, star(1000), IterativeSchur),
        ("views of anything", 1500, anywhere(1500, 5, 8000), IterativeSchur),
    ];
    for (name, poses, tracks, expected) in shapes {
        let mut problem = problem(poses, &tracks, tracks.len());
        let summary = run(&mut problem, LinearSolver::Auto, 1);
        assert_eq!(summary.linear_solver, expected, "{name}");
    }
}

/// Keeps every checkpoint.
#[derive(Default)]
struct All(Vec<Checkpoint>);

impl Keeper for All {
    fn is_due(&mut self, _row: &IterationSummary) -> bool {
        true
    }

    fn keep(&mut self, checkpoint: Checkpoint) {
        self.0.push(checkpoint);
    }
}

#[test]
fn conjugate_gradients_that_take_too_many_products_are_left() {
    // Views that share a vague landmark are close to each other, and what they know of each other goes the
    // long way, from neighbor to neighbor.
    let mut tracks = chain(800, 3, 6);
    let precise = tracks.len();
    tracks.extend(chain(800, 100, 1));
    let start = problem(800, &tracks, precise);
    let mut options = Options::default();
    options.optimizer.max_iterations = 12;
    let solve = |from: Option<&Checkpoint>| {
        let (mut problem, mut all) = (start.clone(), All::default());
        let summary =
            solve_kept(&mut problem, &options, from, &mut all, &mut ignore_iterations).unwrap();
        assert_eq!(summary.linear_solver, LinearSolver::SparseSchur);
        (problem, all.0)
    };
    let (whole, checkpoints) = solve(None);
    let left = checkpoints.iter().filter(|checkpoint| checkpoint.left_iterative).count();
    assert!(left > 0 && left < checkpoints.len(), "{left} of {}", checkpoints.len());
    // A solve that goes on from a checkpoint takes the same way, to the bit.
    let last = checkpoints.len() - 1;
    for checkpoint in [&checkpoints[last - left], &checkpoints[last]] {
        assert_eq!(solve(Some(checkpoint)).0, whole);
    }
}

#[test]
fn poses_that_nothing_observes_are_factored() {
    let mut problem = problem(100, &[], 0);
    for i in 1..100 {
        problem.relative_poses.push(RelativePose {
            i: i - 1,
            j: i,
            i_from_j: Se3::new(So3::identity(), Vector3::new(0.1, 0.0, 0.0)),
            information: Information::from_sigmas(&SVector::from([0.01; 6])).unwrap(),
            loss: None,
        });
    }
    let summary = run(&mut problem, LinearSolver::Auto, 50);
    assert_eq!(summary.linear_solver, LinearSolver::SparseSchur);
    assert!(summary.solve.final_cost < 1e-9 * summary.solve.initial_cost, "{summary:?}");
}

#[test]
fn a_ceiling_that_is_high_enough_changes_no_choice() {
    // Long enough that a bound of its pairs of views would be much memory.
    let mut problem = problem(30_000, &chain(30_000, 12, 2), usize::MAX);
    let mut options = Options::default();
    options.optimizer.max_iterations = 1;
    options.optimizer.ceiling.bytes = Some(1 << 36);
    let summary = solve(&mut problem, &options, &mut ignore_iterations).unwrap();
    assert_eq!(summary.linear_solver, LinearSolver::SparseSchur);
}

#[test]
fn a_ceiling_below_the_factorization_leaves_conjugate_gradients() {
    let start = problem(2000, &chain(2000, 12, 2), usize::MAX);
    let within = |bytes| {
        let mut options = Options::default();
        options.optimizer.max_iterations = 1;
        options.optimizer.ceiling.bytes = Some(bytes);
        solve(&mut start.clone(), &options, &mut ignore_iterations)
            .map(|solved| solved.linear_solver)
    };
    let choices: Vec<_> = (20..40).rev().map(|power| within(1 << power)).collect();
    // From much memory to little: factored, then without the matrix, then refused.
    let rank = |choice: &Result<LinearSolver, SolveError>| match choice {
        Ok(LinearSolver::SparseSchur) => 0,
        Ok(LinearSolver::IterativeSchur) => 1,
        Err(SolveError::TooExpensive(_)) => 2,
        other => panic!("{other:?}"),
    };
    let ranks: Vec<i32> = choices.iter().map(rank).collect();
    assert!(ranks.is_sorted() && [0, 1, 2].iter().all(|rank| ranks.contains(rank)), "{ranks:?}");
}
