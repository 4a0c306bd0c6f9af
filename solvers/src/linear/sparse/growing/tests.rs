//! A growing system has the solution of the dense one, whatever was added in whichever order.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{GrowingCholesky, PairTerm};

const N: usize = 3;

type Term = (Option<usize>, Option<usize>, PairTerm<N>);

fn random_term(rng: &mut ChaCha8Rng) -> PairTerm<N> {
    let a = SMatrix::<f64, N, N>::from_fn(|_, _| rng.random_range(-0.3..0.3)) + SMatrix::identity();
    let b = SMatrix::<f64, N, N>::from_fn(|_, _| rng.random_range(-0.3..0.3)) - SMatrix::identity();
    let r = SVector::<f64, N>::from_fn(|_, _| rng.random_range(-1.0..1.0));
    PairTerm {
        h_ii: a.tr_mul(&a),
        h_ij: a.tr_mul(&b),
        h_jj: b.tr_mul(&b),
        g_i: a.tr_mul(&r),
        g_j: b.tr_mul(&r),
        cost: 0.5 * r.norm_squared(),
    }
}

/// −H⁻¹ g by dense elimination.
fn dense(count: usize, terms: &[Term]) -> DVector<f64> {
    let mut h = DMatrix::<f64>::zeros(count * N, count * N);
    let mut g = DVector::<f64>::zeros(count * N);
    let mut add = |i: usize, j: usize, block: SMatrix<f64, N, N>| {
        let mut view = h.view_mut((i * N, j * N), (N, N));
        view += block;
    };
    for &(i, j, term) in terms {
        if let Some(i) = i {
            add(i, i, term.h_ii);
            let mut rows = g.rows_mut(i * N, N);
            rows += term.g_i;
        }
        if let Some(j) = j {
            add(j, j, term.h_jj);
            let mut rows = g.rows_mut(j * N, N);
            rows += term.g_j;
        }
        if let Some((i, j)) = i.zip(j) {
            add(i, j, term.h_ij);
            add(j, i, term.h_ij.transpose());
        }
    }
    h.cholesky().unwrap().solve(&-g)
}

fn assert_solved(system: &mut GrowingCholesky<N>, terms: &[Term], what: &str) {
    let count = system.block_count();
    let expected = dense(count, terms);
    for block in 0..count {
        let error = (system.delta(block) - expected.fixed_rows::<N>(block * N)).amax();
        assert!(error < 1e-9 * expected.amax().max(1.0), "{what}: block {block} is off by {error}");
    }
}

#[test]
fn every_step_of_a_growing_graph_has_the_dense_solution() {
    for seed in 0..8 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut system = GrowingCholesky::<N>::new();
        let mut terms: Vec<Term> = Vec::new();
        for step in 0..60 {
            let block = system.push_block();
            let mut fresh = vec![(block.checked_sub(1), Some(block), random_term(&mut rng))];
            for _ in 0..rng.random_range(0..3) {
                let other = rng.random_range(0..=block);
                if other < block {
                    let (i, j) = if rng.random() { (other, block) } else { (block, other) };
                    fresh.push((Some(i), Some(j), random_term(&mut rng)));
                }
            }
            for &(i, j, term) in &fresh {
                system.push_term(i, j, term);
            }
            terms.extend(fresh);
            if step % 7 == 3 {
                let number = rng.random_range(0..terms.len());
                terms[number].2 = random_term(&mut rng);
                system.set_term(number, terms[number].2);
            }
            if step % 3 != 1 {
                let updated = system.update(&[block]).unwrap();
                assert!(updated.blocks >= 1 && updated.nodes <= updated.blocks);
                system.solve(0.0);
                assert_solved(&mut system, &terms, &format!("seed {seed}, step {step}"));
            }
        }
    }
}

#[test]
fn a_chain_is_solved_by_its_newest_blocks_alone() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut system = GrowingCholesky::<N>::new();
    for _ in 0..200 {
        let block = system.push_block();
        system.push_term(block.checked_sub(1), Some(block), random_term(&mut rng));
        let updated = system.update(&[block]).unwrap();
        assert!(updated.blocks <= 40, "{updated:?} at block {block}");
        system.solve(0.0);
    }
}

#[test]
fn an_unsolvable_update_is_reported_and_repaired_by_the_next() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut system = GrowingCholesky::<N>::new();
    let mut terms: Vec<Term> = Vec::new();
    for block in 0..10_usize {
        system.push_block();
        let term = (block.checked_sub(1), Some(block), random_term(&mut rng));
        terms.push(term);
        system.push_term(term.0, term.1, term.2);
    }
    system.update(&[]).unwrap();
    // A block without terms has no information.
    let free = system.push_block();
    assert!(system.update(&[]).is_err());
    let term = (Some(4), Some(free), random_term(&mut rng));
    terms.push(term);
    system.push_term(term.0, term.1, term.2);
    system.update(&[]).unwrap();
    system.solve(0.0);
    assert_solved(&mut system, &terms, "after the failure");
}

#[test]
fn a_front_that_is_updated_in_pieces_has_the_dense_solution() {
    // Two blocks are tied to overlapping ranges of the others, so the first of them and what it alone
    // is tied to share a front whose update matrix is too large for one piece. Tips add theirs to it.
    const OTHERS: usize = 260;
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut pairs: Vec<(Option<usize>, usize)> = (2..OTHERS + 2).map(|k| (None, k)).collect();
    pairs.extend((2..222).map(|k| (Some(0), k)).chain((42..262).map(|k| (Some(1), k))));
    for tip in 0..8 {
        let tied = (5 * tip..5 * (tip + 1)).map(|k| 2 + k);
        let tied = tied.chain((23 * tip..23 * (tip + 1)).map(|k| 42 + k % 180));
        pairs.push((None, OTHERS + 2 + tip));
        pairs.extend(tied.map(|k| (Some(OTHERS + 2 + tip), k)));
    }
    let mut system = GrowingCholesky::<N>::new();
    for _ in 0..OTHERS + 10 {
        system.push_block();
    }
    let mut terms: Vec<Term> = Vec::new();
    for (i, j) in pairs {
        terms.push((i, Some(j), random_term(&mut rng)));
        system.push_term(i, Some(j), terms[terms.len() - 1].2);
    }
    // On one thread, since tasks cut the columns in other places.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let last: Vec<usize> = (2..OTHERS + 2).collect();
    pool.install(|| system.update(&last)).unwrap();
    system.solve(0.0);
    assert_solved(&mut system, &terms, "in pieces");
}
