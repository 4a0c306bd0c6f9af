//! Pattern and matrix: layout, look-up, row writers, product; the stack that a factorization needs.

use std::sync::Arc;

use super::checked::solve_checked;
use super::sparse::Multifrontal;
use super::*;
use crate::interrupt::Interrupt;

fn mixed() -> Arc<BlockPattern> {
    Arc::new(BlockPattern::new(vec![2, 3, 1, 4], [(3, 0), (0, 1), (1, 0), (3, 0), (2, 2), (0, 3)]))
}

#[test]
fn pattern_accepts_any_order_duplicates_and_both_triangles() {
    let pattern = mixed();
    let rows: Vec<&[u32]> = (0..4).map(|i| pattern.row(i)).collect();
    assert_eq!(rows, [&[0][..], &[0, 1], &[2], &[0, 3]]);
    assert_eq!((pattern.block_count(), pattern.dimension()), (4, 10));
    assert_eq!((0..=4).map(|i| pattern.offset(i)).collect::<Vec<_>>(), [0, 2, 5, 6, 10]);
    assert_eq!(pattern.value_count(), 4 + 6 + 9 + 1 + 8 + 16);
    assert_eq!(pattern.density(), 6.0 / 10.0);
    assert_eq!(
        (0..10).map(|k| pattern.block_of(k)).collect::<Vec<_>>(),
        [0, 0, 1, 1, 1, 2, 3, 3, 3, 3]
    );
    assert_eq!((pattern.find(0, 1), pattern.find(2, 1), pattern.find(9, 0)), (None, None, None));
    assert_eq!(pattern.find(3, 0).map(|block| pattern.value_range(block)), Some(20..28));
    assert_eq!(
        BlockPattern::full(vec![2, 3, 1]),
        BlockPattern::new(vec![2, 3, 1], [(2, 0), (1, 0), (1, 2)])
    );
}

#[test]
fn duplicates_beyond_the_compaction_limit_are_removed() {
    let pairs = (0..3_000_000u32).map(|k| ((k * 7 % 50) as usize, (k * 13 % 50) as usize));
    let found = BlockPattern::new(vec![1; 50], pairs.clone());
    let mut unique: Vec<_> = pairs.take(50).collect();
    unique.reverse();
    assert_eq!(found, BlockPattern::new(vec![1; 50], unique));
}

#[test]
fn row_writers_and_block_access_agree() {
    let mut matrix = BlockMatrix::new(mixed());
    for mut row in matrix.rows_mut() {
        let i = row.index();
        for (k, j) in row.columns().to_vec().into_iter().enumerate() {
            row.slot_mut(k).fill((10 * i + j as usize) as f64);
        }
        row.diagonal_mut()[0] += 0.5;
    }
    assert_eq!(matrix.block(3, 0), Some(&[30.0; 8][..]));
    assert_eq!(matrix.block(1, 0), Some(&[10.0; 6][..]));
    assert_eq!(matrix.block(0, 1), None);
    assert_eq!(matrix.diagonal(), [0.5, 0.0, 11.5, 11.0, 11.0, 22.5, 33.5, 33.0, 33.0, 33.0]);
    matrix.block_mut(3, 0).unwrap()[1] = 7.0;
    assert_eq!(matrix.values()[21], 7.0);
    matrix.set_zero();
    assert!(matrix.values().iter().all(|&v| v == 0.0));
}

#[test]
fn product_reads_the_lower_triangle_only() {
    let pattern = mixed();
    let mut matrix = BlockMatrix::new(pattern.clone());
    for (k, value) in matrix.values_mut().iter_mut().enumerate() {
        *value = ((k * 37 % 101) as f64 - 50.0) / 7.0;
    }
    let mut dense = nalgebra::DMatrix::<f64>::zeros(10, 10);
    for i in 0..4 {
        for &j in pattern.row(i) {
            let (block, j) = (matrix.block(i, j as usize).unwrap(), j as usize);
            for (k, &value) in block.iter().enumerate() {
                let (r, c) = (k % pattern.sizes()[i], k / pattern.sizes()[i]);
                let (r, c) = (pattern.offset(i) + r, pattern.offset(j) + c);
                if r >= c {
                    (dense[(r, c)], dense[(c, r)]) = (value, value);
                }
            }
        }
    }
    let x = nalgebra::DVector::from_fn(10, |k, _| (k as f64 * 1.3).sin());
    let mut y = vec![1.0; 10];
    matrix.symmetric_multiply(x.as_slice(), &mut y);
    assert!((nalgebra::DVector::from_vec(y) - dense * x).amax() < 1e-12);
}

#[test]
fn a_long_chain_in_its_own_order_needs_no_deep_stack() {
    // Each node's subtree is most of the work: a tree of branches, one under the other.
    let count = 30_000_usize;
    let pairs = (1..count).flat_map(|i| [(i, i - 1), (i, i.saturating_sub(2)), (i, i / 2 * 2)]);
    let pattern = Arc::new(BlockPattern::new(vec![6; count], pairs));
    let mut matrix = BlockMatrix::new(pattern.clone());
    matrix.values_mut().iter_mut().zip(0..).for_each(|(v, k)| *v = f64::from(k).sin());
    for block in 0..count {
        let diagonal = matrix.block_mut(block, block).unwrap();
        (0..6).for_each(|k| diagonal[7 * k] = 40.0);
    }
    let natural: Vec<u32> = (0..count as u32).collect();
    let (order, elimination) = ordering::postordered(&pattern, &natural).unwrap();
    let mut solver = Multifrontal::sparse(pattern.clone(), &order, &elimination).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    pool.install(|| solver.factor_until(&matrix, &[], &Interrupt::NEVER).unwrap());
    let rhs = vec![1.0; pattern.dimension()];
    let mut x = vec![0.0; rhs.len()];
    assert!(solve_checked(|v| solver.solve(v), &matrix, &[], &rhs, &mut x) < 1e-13);
}
