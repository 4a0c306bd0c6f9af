//! Block Cholesky against nalgebra on random systems: chains, grids, loops, arrows, full ones.
//!
//! Every system is A Aᵀ restricted to a pattern plus a diagonal that makes it dominant, with
//! values from a fixed integer sequence, so that the expected answer never depends on a library.

use std::sync::Arc;

use covis_solvers::interrupt::Interrupt;
use covis_solvers::linear::{BlockMatrix, BlockPattern, Cholesky, LinearError};
use covis_solvers::testing::lower_triangle;
use nalgebra::{DMatrix, DVector};

/// Numbers in -1..1 from a 64-bit linear congruence.
struct Sequence(u64);

impl Sequence {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn below(&mut self, limit: usize) -> usize {
        ((self.next() + 1.0) / 2.0 * limit as f64) as usize % limit
    }
}

fn sizes(count: usize, choices: &[usize]) -> Vec<usize> {
    (0..count).map(|i| choices[(i * 7 + i / 3) % choices.len()]).collect()
}

/// The graphs under test: name and pattern.
fn patterns() -> Vec<(&'static str, Arc<BlockPattern>)> {
    let chain = |n: usize| (1..n).map(|i| (i, i - 1));
    let grid = (0..144usize).flat_map(|k| {
        let right = (k % 12 < 11).then_some((k, k + 1));
        let down = (k < 132).then_some((k, k + 12));
        right.into_iter().chain(down)
    });
    let mut random = Sequence(5);
    let closures: Vec<_> = (0..60).map(|_| (random.below(150), random.below(150))).collect();
    let two_pieces = chain(20).filter(|&(i, _)| i != 9);
    [
        ("chain", BlockPattern::new(sizes(40, &[6]), chain(40))),
        ("grid", BlockPattern::new(sizes(144, &[3]), grid)),
        ("loops", BlockPattern::new(sizes(150, &[6]), chain(150).chain(closures))),
        ("arrow", BlockPattern::new(sizes(30, &[15, 6, 9]), (1..30).map(|i| (0, i)))),
        ("full", BlockPattern::full(sizes(25, &[6, 9, 15, 7]))),
        ("mixed", BlockPattern::new(sizes(60, &[6, 9, 15, 3, 7, 1]), chain(60).chain([(59, 0)]))),
        ("two pieces", BlockPattern::new(sizes(20, &[6, 3]), two_pieces)),
        ("empty blocks", BlockPattern::new(sizes(12, &[0, 4, 2]), chain(12).chain([(7, 1)]))),
        ("one", BlockPattern::new(vec![6], [])),
        ("nothing", BlockPattern::new(vec![], [])),
    ]
    .map(|(name, pattern)| (name, Arc::new(pattern)))
    .into()
}

/// Random blocks; the diagonal outweighs its row, so that the matrix is positive definite.
fn random_matrix(pattern: &Arc<BlockPattern>, seed: u64) -> BlockMatrix {
    let mut random = Sequence(seed);
    let mut matrix = BlockMatrix::new(pattern.clone());
    matrix.values_mut().fill_with(|| random.next());
    let dense = to_dense(&matrix);
    for i in 0..pattern.block_count() {
        let (size, top) = (pattern.sizes()[i], pattern.offset(i));
        let block = matrix.block_mut(i, i).unwrap();
        for k in 0..size {
            let row: f64 = dense.row(top + k).iter().map(|v| v.abs()).sum();
            block[k * (size + 1)] = 1.05 * row + 0.1;
        }
    }
    matrix
}

/// A dense and a sparse factorization.
fn both(pattern: &Arc<BlockPattern>) -> [Cholesky; 2] {
    let ordered = Cholesky::order(pattern, &Interrupt::NEVER).unwrap();
    [Cholesky::dense(pattern.clone()), Cholesky::ordered(pattern.clone(), ordered)]
        .map(Result::unwrap)
}

fn to_dense(matrix: &BlockMatrix) -> DMatrix<f64> {
    let dimension = matrix.pattern().dimension();
    let mut dense = DMatrix::zeros(dimension, dimension);
    for (r, c, value) in lower_triangle(matrix) {
        (dense[(r, c)], dense[(c, r)]) = (value, value);
    }
    dense
}

#[test]
fn dense_and_sparse_agree_with_nalgebra_over_refactorizations() {
    for (name, pattern) in patterns() {
        let n = pattern.dimension();
        let [dense, sparse] = both(&pattern);
        let mut solvers = [dense, sparse, Cholesky::new(pattern.clone()).unwrap()];
        for seed in [1, 2, 3] {
            let matrix = random_matrix(&pattern, seed);
            let mut random = Sequence(100 + seed);
            let added: Vec<f64> = (0..n).map(|_| 0.5 + 0.5 * random.next()).collect();
            let g = DVector::from_fn(n, |_, _| random.next());
            let damped =
                to_dense(&matrix) + DMatrix::from_diagonal(&DVector::from_vec(added.clone()));
            let expected = damped.cholesky().unwrap().solve(&g);
            for solver in &mut solvers {
                solver.factor(&matrix, &added).unwrap();
                let mut x = g.as_slice().to_vec();
                solver.solve(&mut x);
                let error = DVector::from_column_slice(&x) - &expected;
                let scale = expected.iter().fold(1.0f64, |m, v| m.max(v.abs()));
                assert!(error.iter().all(|e| e.abs() < 1e-10 * scale), "{name} {solver:?}");
                let mut checked = vec![0.0; n];
                let residual = solver.solve_checked(&matrix, &added, g.as_slice(), &mut checked);
                assert!(residual < 1e-12, "{name} {solver:?}: {residual}");
                assert_eq!(x, checked, "{name}: no refinement is due");
                solver.factor(&matrix, &added).unwrap();
                let mut again = g.as_slice().to_vec();
                solver.solve(&mut again);
                assert_eq!(x, again, "{name}: the same bits again");
            }
        }
    }
}

#[test]
fn indefinite_and_singular_systems_are_refused_and_named() {
    for (name, pattern) in patterns().into_iter().filter(|(_, p)| p.dimension() > 0) {
        for mut solver in both(&pattern) {
            let mut matrix = random_matrix(&pattern, 4);
            let block = pattern.block_count() - 1;
            matrix.block_mut(block, block).unwrap()[0] = -1.0;
            let error = solver.factor(&matrix, &[]).unwrap_err();
            let LinearError::NotPositiveDefinite { block: found, scalar } = error else {
                panic!("{name}: {error}");
            };
            let rows = pattern.offset(found)..pattern.offset(found + 1);
            assert!(rows.contains(&scalar), "{name}: scalar {scalar} in block {found}");
            // Zero is singular; after a refusal no factor stands; enough damping is accepted.
            matrix.set_zero();
            assert!(solver.factor(&matrix, &[]).is_err(), "{name}");
            let mut x = vec![1.0; pattern.dimension()];
            solver.solve(&mut x);
            assert!(x.iter().all(|v| v.is_nan()), "{name}");
            solver.factor(&matrix, &vec![4.0; pattern.dimension()]).unwrap();
            x.fill(1.0);
            solver.solve(&mut x);
            assert_eq!(x, vec![0.25; pattern.dimension()], "{name}");
        }
    }
}

#[test]
fn values_that_are_not_finite_are_refused_wherever_they_stand() {
    for (name, pattern) in patterns().into_iter().filter(|(_, p)| p.dimension() > 0) {
        for mut solver in both(&pattern) {
            for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                for k in (0..pattern.value_count()).step_by(pattern.value_count() / 20 + 1) {
                    let mut matrix = random_matrix(&pattern, 6);
                    matrix.values_mut()[k] = bad;
                    let error = solver.factor(&matrix, &[]).unwrap_err();
                    assert!(matches!(error, LinearError::NonFinite { .. }), "{name}: {error}");
                }
                let matrix = random_matrix(&pattern, 6);
                let mut added = vec![1.0; pattern.dimension()];
                *added.last_mut().unwrap() = bad;
                assert!(matches!(
                    solver.factor(&matrix, &added),
                    Err(LinearError::NonFinite { .. })
                ));
            }
            // Finite values whose products overflow must not pass as a factor either.
            let mut matrix = random_matrix(&pattern, 6);
            matrix.values_mut().iter_mut().for_each(|v| *v *= 1e300);
            if solver.factor(&matrix, &[]).is_ok() {
                let mut x = vec![0.0; pattern.dimension()];
                let residual = solver.solve_checked(&matrix, &[], &x.clone(), &mut x);
                assert_eq!(residual, 0.0, "{name}");
            }
        }
    }
}

#[test]
fn a_factor_that_is_slightly_off_is_refined() {
    let pattern = Arc::new(BlockPattern::new(vec![3; 30], (1..30).map(|i| (i, i - 1))));
    let matrix = random_matrix(&pattern, 9);
    let g: Vec<f64> = (0..90).map(|k| f64::from(k).cos()).collect();
    let mut x = vec![0.0; 90];
    for mut solver in both(&pattern) {
        // The factor is of H + 1e-7 I: one step takes the residual from 1e-8 to its square.
        solver.factor(&matrix, &[1e-7; 90]).unwrap();
        let residual = solver.solve_checked(&matrix, &[], &g, &mut x);
        assert!(residual < 1e-13, "{residual}");
        let mut r = vec![0.0; 90];
        matrix.residual(&[], &x, &g, &mut r).unwrap();
        let relative = DVector::from_vec(r).norm() / DVector::from_column_slice(&g).norm();
        assert!((relative - residual).abs() < 1e-15, "{relative} against {residual}");
        // Another matrix altogether: one step cannot mend it, and the residual tells.
        let other = random_matrix(&pattern, 10);
        assert!(solver.solve_checked(&other, &[], &g, &mut x) > 1e-3);
    }
}

#[test]
fn other_shapes_are_refused() {
    let pattern = Arc::new(BlockPattern::new(vec![2; 3], [(0, 1)]));
    let other = Arc::new(BlockPattern::new(vec![2; 3], [(0, 2)]));
    for mut solver in both(&pattern) {
        let mismatch = LinearError::PatternMismatch { expected: 4, found: 4 };
        assert_eq!(solver.factor(&random_matrix(&other, 1), &[]), Err(mismatch));
        let mismatch = LinearError::DimensionMismatch { expected: 6, found: 5 };
        assert_eq!(solver.factor(&random_matrix(&pattern, 1), &[1.0; 5]), Err(mismatch));
        assert_eq!(
            solver.solve_checked(&random_matrix(&pattern, 1), &[], &[1.0; 6], &mut [0.0; 6]),
            f64::INFINITY
        );
    }
}

#[test]
fn the_choice_follows_the_fill() {
    let full = Cholesky::new(Arc::new(BlockPattern::full(vec![6; 30]))).unwrap();
    assert!(full.is_dense());
    let chain = BlockPattern::new(vec![6; 300], (1..300).map(|i| (i, i - 1)));
    let ordered = Cholesky::order(&chain, &Interrupt::NEVER).unwrap();
    let chain = Cholesky::new(Arc::new(chain)).unwrap();
    assert!(!chain.is_dense());
    let expected = 216.0 * (299.0 * (1.0 / 3.0 + 2.0) + 1.0 / 3.0);
    assert!((ordered.price().flops_per_iteration / expected - 1.0).abs() < 1e-12);
}

#[test]
fn many_threads_help_where_work_is_side_by_side() {
    let planned = |pattern: BlockPattern| {
        let ordered = Cholesky::order(&pattern, &Interrupt::NEVER).unwrap();
        let (work, span) = Cholesky::ordered(Arc::new(pattern), ordered).unwrap().work_and_span();
        assert!(0.0 < span && span <= work, "{span} {work}");
        work / span
    };
    // What is small is one task.
    let chain = |from: usize, count: usize| (from + 1..from + count).map(|i| (i, i - 1));
    assert_eq!(planned(BlockPattern::new(vec![6; 300], chain(0, 300))), 1.0);
    // A dense front of 600: 19 panels of 32 columns, one strip of 24 columns after each.
    let [work, span] = [
        600.0_f64.powi(3) / 3.0,
        32.0 * 80.0 * (0..19).map(|k| 600.0 - 32.0 * f64::from(k)).sum::<f64>(),
    ];
    let last = 24.0 * (24.0 + 48.0) * 24.0 - 32.0 * 80.0 * 24.0;
    let dense = Cholesky::dense(Arc::new(BlockPattern::full(vec![6; 100]))).unwrap();
    assert_eq!(dense.work_and_span(), (work, span + last));
    // Two fronts that share nothing take as long as one.
    let pairs = |from: usize| (0..100).flat_map(move |i| (0..i).map(move |j| (from + i, from + j)));
    let one = planned(BlockPattern::new(vec![6; 100], pairs(0)));
    let two = planned(BlockPattern::new(vec![6; 200], pairs(0).chain(pairs(100))));
    assert!((two / one - 2.0).abs() < 1e-9, "{two} {one}");
}
