//! The supernodal Cholesky: against faer, on every instruction set, on any number of threads, and
//! on the Hessians of public pose graphs.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use covis_solvers::interrupt::Interrupt;
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::linear::{BlockMatrix, BlockPattern, Cholesky, LinearError};
use covis_solvers::simd::Class;
use covis_solvers::testing::{lower_triangle, normal_equations};
use faer::linalg::solvers::Solve;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Side};
use proptest::prelude::*;

use crate::io::data::data;

const SIZES: [usize; 9] = [1, 2, 3, 6, 7, 9, 15, 3, 6];

/// Numbers in -1..1 from a 64-bit linear congruence.
struct Sequence(u64);

impl Sequence {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Random off-diagonal blocks under a diagonal that outweighs them.
fn random_matrix(pattern: &Arc<BlockPattern>, seed: u64) -> BlockMatrix {
    let mut random = Sequence(seed);
    let mut matrix = BlockMatrix::new(pattern.clone());
    matrix.values_mut().fill_with(|| random.next());
    let mut sums = vec![0.1; pattern.dimension()];
    for (r, c, value) in lower_triangle(&matrix) {
        sums[r] += value.abs();
        sums[c] += value.abs();
    }
    for i in 0..pattern.block_count() {
        let (size, top) = (pattern.sizes()[i], pattern.offset(i));
        let block = matrix.block_mut(i, i).unwrap();
        for k in 0..size {
            block[k * (size + 1)] = sums[top + k];
        }
    }
    matrix
}

/// The solution by faer's own sparse Cholesky.
fn solved_by_faer(matrix: &BlockMatrix, added: &[f64], rhs: &[f64]) -> Vec<f64> {
    let n = rhs.len();
    let entries = lower_triangle(matrix).into_iter().map(|(r, c, value)| {
        let added = if r == c { added.get(r).copied().unwrap_or(0.0) } else { 0.0 };
        Triplet::new(r, c, value + added)
    });
    let entries: Vec<_> = entries.collect();
    let sparse = SparseColMat::<usize, f64>::try_new_from_triplets(n, n, &entries).unwrap();
    let x = sparse.sp_cholesky(Side::Lower).unwrap().solve(Mat::from_fn(n, 1, |i, _| rhs[i]));
    (0..n).map(|i| x[(i, 0)]).collect()
}

fn sparse(pattern: &Arc<BlockPattern>) -> Cholesky {
    let ordered = Cholesky::order(pattern, &Interrupt::NEVER).unwrap();
    Cholesky::ordered(Arc::clone(pattern), ordered).unwrap()
}

fn solution(solver: &mut Cholesky, rhs: &[f64]) -> Vec<f64> {
    let mut x = rhs.to_vec();
    solver.solve(&mut x);
    x
}

fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

/// A grid whose factorization is worth several branches, with blocks of `size` or, for 0, of many.
fn grid(side: usize, size: usize) -> Arc<BlockPattern> {
    let sizes = (0..side * side).map(|k| if size > 0 { size } else { SIZES[k % SIZES.len()] });
    let pairs = (0..side * side).flat_map(|k| {
        let right = (k % side + 1 < side).then_some((k, k + 1));
        let down = (k + side < side * side).then_some((k, k + side));
        right.into_iter().chain(down)
    });
    Arc::new(BlockPattern::new(sizes.collect(), pairs))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, ..Default::default() })]

    #[test]
    fn random_patterns_agree_with_faer(
        kinds in prop::collection::vec(0..SIZES.len(), 1..70),
        uniform in prop::option::of(0..SIZES.len()),
        pairs in prop::collection::vec((0..70usize, 0..70usize), 0..160),
        seed in any::<u64>(),
    ) {
        let count = kinds.len();
        let sizes = kinds.iter().map(|&kind| SIZES[uniform.unwrap_or(kind)]).collect();
        let pairs = pairs.into_iter().map(|(i, j)| (i % count, j % count));
        let pattern = Arc::new(BlockPattern::new(sizes, pairs));
        let matrix = random_matrix(&pattern, seed);
        let mut random = Sequence(seed ^ 1);
        let n = pattern.dimension();
        let added: Vec<f64> = (0..n).map(|_| random.next().abs()).collect();
        let rhs: Vec<f64> = (0..n).map(|_| random.next()).collect();
        let mut solver = sparse(&pattern);
        solver.factor(&matrix, &added).unwrap();
        let expected = solved_by_faer(&matrix, &added, &rhs);
        let scale = expected.iter().fold(1e-3f64, |m, v| m.max(v.abs()));
        for (found, expected) in solution(&mut solver, &rhs).iter().zip(&expected) {
            prop_assert!((found - expected).abs() < 1e-11 * scale, "{found} {expected}");
        }
    }
}

#[test]
fn bits_depend_neither_on_threads_nor_on_fused_classes() {
    for pattern in [grid(40, 6), grid(70, 3), grid(24, 0), grid(16, 15), grid(20, 2)] {
        let matrix = random_matrix(&pattern, 3);
        let rhs: Vec<f64> = (0..pattern.dimension()).map(|k| (k as f64).sin()).collect();
        let run = |class: Class, threads| {
            let mut solver = sparse(&pattern);
            solver.set_class(class);
            on_threads(threads, || solver.factor(&matrix, &[]).unwrap());
            let mut x = vec![0.0; rhs.len()];
            let residual = solver.solve_checked(&matrix, &[], &rhs, &mut x);
            assert!(residual < 1e-13, "{class}: {residual}");
            x
        };
        let scalar = run(Class::Scalar, 1);
        assert_eq!(scalar, run(Class::Scalar, 3));
        let fused = [Class::Avx512, Class::Avx2, Class::Neon].into_iter();
        let mut one = None;
        for class in fused.filter(|class| class.is_available()) {
            let x = one.get_or_insert_with(|| run(class, 1));
            for threads in [1, 2, 3] {
                assert_eq!(*x, run(class, threads), "{class} on {threads} threads");
            }
            let scale = scalar.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            assert!(x.iter().zip(&scalar).all(|(a, b)| (a - b).abs() < 1e-12 * scale), "{class}");
        }
    }
}

#[test]
fn the_failing_pivot_is_named_on_any_number_of_threads() {
    let pattern = grid(40, 6);
    for block in [0, 777, 1599] {
        let mut matrix = random_matrix(&pattern, 5);
        matrix.block_mut(block, block).unwrap()[2 * 7] = -1e3;
        for threads in [1, 2, 3] {
            let mut solver = sparse(&pattern);
            let outcome = on_threads(threads, || solver.factor(&matrix, &[]));
            let expected = LinearError::NotPositiveDefinite { block, scalar: 6 * block + 2 };
            assert_eq!(outcome, Err(expected), "{threads} threads");
        }
    }
}

#[test]
fn hessians_of_public_graphs_are_solved_to_rounding() {
    for name in [
        "CSAIL",
        "M3500",
        "city10000",
        "intel",
        "kitti_00",
        "parking-garage",
        "smallGrid3D",
        "sphere2500",
        "tinyGrid3D",
        "torus3D",
    ] {
        let Some(path) = data(&format!("pose_graph/{name}.g2o")) else { return };
        let (matrix, gradient) = match G2oGraph::read(&path).unwrap() {
            G2oGraph::Se2(file) => normal_equations(&file.to_pose_graph().unwrap()),
            G2oGraph::Se3(file) => normal_equations(&file.to_pose_graph().unwrap()),
        };
        let mut solver = sparse(matrix.pattern());
        solver.factor(&matrix, &[]).unwrap();
        // g = H x for an x of ones and of the gradient's signs: of the size that a solve meets.
        let ones: Vec<f64> = gradient.iter().map(|g| g.signum()).collect();
        let mut rhs = vec![0.0; ones.len()];
        matrix.symmetric_multiply(&ones, &mut rhs);
        let mut x = vec![0.0; rhs.len()];
        let residual = solver.solve_checked(&matrix, &[], &rhs, &mut x);
        assert!(residual < 1e-12, "{name}: {residual:e}");
        // The gradient itself: small against what the Hessian makes of the step.
        let residual = solver.solve_checked(&matrix, &[], &gradient, &mut x);
        assert!(residual < 1e-8, "{name}: {residual:e}");
    }
}

#[test]
fn a_solve_ends_when_the_factorization_may_not_go_on() {
    let pattern = Arc::new(BlockPattern::new(vec![6; 300], (1..300).map(|i| (i, i / 2))));
    let matrix = random_matrix(&pattern, 5);
    let mut solver = sparse(&pattern);
    let flag = Arc::new(AtomicBool::new(false));
    let interrupt = Interrupt::NEVER.or_when(Arc::clone(&flag));
    solver.factor_until(&matrix, &[], &interrupt).unwrap();
    let mut x = vec![1.0; 1800];
    solver.solve(&mut x);
    assert!(x.iter().all(|value| value.is_finite()));
    flag.store(true, Ordering::Relaxed);
    solver.solve(&mut x);
    assert!(x.iter().all(|value| value.is_nan()));
}
