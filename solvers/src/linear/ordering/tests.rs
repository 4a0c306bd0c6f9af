//! Orders are permutations, flop counts are those of known graphs, fill is counted exactly.

use std::sync::atomic::{AtomicBool, Ordering};

use super::elimination::inverse_permutation;
use super::graph::Level;
use super::multilevel::separate;
use super::refinement::SEPARATOR;
use super::*;

fn chain(count: usize, size: usize) -> BlockPattern {
    BlockPattern::new(vec![size; count], (1..count).map(|i| (i, i - 1)))
}

fn grid(side: usize, size: usize) -> BlockPattern {
    let at = |x: usize, y: usize| y * side + x;
    let pairs = (0..side).flat_map(|y| {
        (0..side).flat_map(move |x| {
            [
                (x + 1 < side).then(|| (at(x, y), at(x + 1, y))),
                (y + 1 < side).then(|| (at(x, y), at(x, y + 1))),
            ]
        })
    });
    BlockPattern::new(vec![size; side * side], pairs.flatten())
}

fn cheapest_ordering(pattern: &BlockPattern) -> BlockOrdering {
    cheapest(pattern, &Interrupt::NEVER).unwrap().0
}

/// `None` where `order` is not a permutation of the blocks.
fn elimination_flops(pattern: &BlockPattern, order: &[u32]) -> Option<f64> {
    eliminate(pattern, order).map(|elimination| elimination.flops)
}

#[test]
fn chain_costs_what_a_band_costs() {
    let found = cheapest_ordering(&chain(50, 6));
    // 49 columns with one block below, the last with none.
    let expected = 216.0 * (49.0 * (1.0 / 3.0 + 1.0 + 1.0) + 1.0 / 3.0);
    assert!((found.flops - expected).abs() < 1e-9 * expected);
}

#[test]
fn full_matrix_costs_a_dense_factorization() {
    let found = cheapest_ordering(&BlockPattern::full(vec![6; 20]));
    let dense = 120.0f64.powi(3) / 3.0;
    // The block count leaves out lower-order terms within a diagonal block only.
    assert!((found.flops / dense - 1.0).abs() < 0.05, "{} against {dense}", found.flops);
    assert_eq!(found.order, (0..20).collect::<Vec<u32>>());
}

#[test]
fn arrow_is_eliminated_tips_first() {
    let pattern = BlockPattern::new(vec![3; 40], (1..40).map(|i| (0, i)));
    let found = cheapest_ordering(&pattern);
    assert_eq!(found.method, OrderingMethod::MinimumDegree);
    // No fill: 39 tips with one block below. Eliminating block 0 first would fill everything.
    let expected = 27.0 * (39.0 * (1.0 / 3.0 + 1.0 + 1.0) + 1.0 / 3.0);
    assert!((found.flops - expected).abs() < 1e-9 * expected);
    let natural: Vec<u32> = (0..40).collect();
    assert!(elimination_flops(&pattern, &natural).unwrap() > 50.0 * found.flops);
}

#[test]
fn grid_order_is_a_postordered_permutation_of_the_same_cost() {
    let pattern = grid(30, 3);
    let found = cheapest_ordering(&pattern);
    assert!(inverse_permutation(&found.order, 900).is_some());
    // Counting the postordered result again must give the same flops and an ordered forest.
    let again = eliminate(&pattern, &found.order).unwrap();
    assert!((again.flops - found.flops).abs() <= 1e-9 * found.flops);
    assert_eq!(again.postorder(), (0..900).collect::<Vec<u32>>());
    let natural: Vec<u32> = (0..900).collect();
    assert!(found.flops < elimination_flops(&pattern, &natural).unwrap());
}

#[test]
fn fill_matches_a_naive_elimination() {
    let pairs = [(1, 0), (5, 0), (5, 3), (2, 4), (6, 2), (6, 1), (7, 3), (3, 1)];
    let pattern = BlockPattern::new(vec![2, 3, 1, 4, 2, 6, 3, 2], pairs);
    for order in [[0, 1, 2, 3, 4, 5, 6, 7], [7, 2, 5, 0, 6, 4, 1, 3]] {
        let mut adjacent = [[false; 8]; 8];
        for (a, b) in pairs {
            (adjacent[a][b], adjacent[b][a]) = (true, true);
        }
        let mut expected = 0.0;
        for (k, &v) in order.iter().enumerate() {
            let later: Vec<usize> = order[k + 1..]
                .iter()
                .map(|&w| w as usize)
                .filter(|&w| adjacent[v as usize][w])
                .collect();
            let b = pattern.sizes()[v as usize] as f64;
            let h: f64 = later.iter().map(|&w| pattern.sizes()[w] as f64).sum();
            expected += b * b * b / 3.0 + b * b * h + b * h * h;
            for &a in &later {
                for &c in &later {
                    adjacent[a][c] = a != c;
                }
            }
        }
        let found = elimination_flops(&pattern, &order).unwrap();
        assert!((found - expected).abs() < 1e-9 * expected, "{found} against {expected}");
    }
}

#[test]
fn wrong_orders_are_refused_and_nothing_is_an_order_of_nothing() {
    let pattern = chain(4, 2);
    assert_eq!(elimination_flops(&pattern, &[0, 1, 2]), None);
    assert_eq!(elimination_flops(&pattern, &[0, 1, 2, 2]), None);
    assert_eq!(elimination_flops(&pattern, &[0, 1, 2, 4]), None);
    assert!(cheapest_ordering(&BlockPattern::new(Vec::new(), [])).order.is_empty());
}

/// Random pairs over a grid: no good separator.
fn tangle(side: usize) -> BlockPattern {
    let count = side * side;
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % count
    };
    let closures: Vec<_> = (0..count).map(|_| (random(), random())).collect();
    let chain = (1..count).map(|i| (i, i - 1));
    BlockPattern::new(vec![3; count], chain.chain(closures))
}

fn dissected(graph: &Graph) -> Option<Vec<u32>> {
    nested_dissection(graph, &Interrupt::NEVER)
}

#[test]
fn an_order_that_may_be_interrupted_is_the_same_and_ends_when_it_is() {
    let pattern = tangle(130);
    assert!(
        Graph::of_pattern(&pattern).items.len() > 50_000,
        "long enough for a thread of its own"
    );
    let flag = Arc::new(AtomicBool::new(false));
    let interrupt = Interrupt::NEVER.or_when(Arc::clone(&flag));
    let (whole, _) = cheapest(&pattern, &interrupt).unwrap();
    assert_eq!(whole, cheapest_ordering(&pattern));
    flag.store(true, Ordering::Relaxed);
    let ended = cheapest(&pattern, &interrupt);
    assert!(matches!(ended, Err(LinearError::Interrupted)), "{ended:?}");
    assert_eq!(nested_dissection(&Graph::of_pattern(&pattern), &interrupt), None);
}

#[test]
fn a_separator_separates_and_is_small_on_a_grid() {
    for (pattern, most) in [(grid(40, 3), 44), (tangle(25), 300)] {
        let graph = Graph::of_pattern(&pattern);
        let sides = separate(&Level::of(graph.clone()), &Interrupt::NEVER).unwrap();
        for v in 0..graph.count() {
            let crosses = |&w: &u32| sides[v] + sides[w as usize] == 1;
            assert!(sides[v] == SEPARATOR || !graph.of(v).iter().any(crosses));
        }
        let weight = |side| sides.iter().filter(|&&found| found == side).count();
        assert!(weight(SEPARATOR) <= most, "{}", weight(SEPARATOR));
        assert!(weight(0).min(weight(1)) * 5 > graph.count() - most, "{}", weight(0));
    }
}

#[test]
fn dissection_is_a_permutation_that_beats_the_callers_order() {
    let scattered = BlockPattern::new(vec![3; 900], (0..450).map(|i| (2 * i, 2 * i + 1)));
    for pattern in [grid(40, 3), tangle(25), scattered, chain(500, 6), grid(1, 2), chain(0, 1)] {
        let graph = Graph::of_pattern(&pattern);
        for order in [dissected(&graph), reduced(&graph, dissected)] {
            let order = order.unwrap();
            let flops = elimination_flops(&pattern, &order).expect("a permutation");
            let natural: Vec<u32> = (0..order.len() as u32).collect();
            // A chain has no fill in its own order; dissected, a vertex has two later neighbors.
            assert!(flops <= 3.0 * elimination_flops(&pattern, &natural).unwrap());
            if order.len() == 1600 {
                assert!(flops < 0.5 * elimination_flops(&pattern, &natural).unwrap());
            }
            let threads = |count| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap();
                pool.install(|| dissected(&graph))
            };
            assert_eq!(threads(1), threads(3));
        }
    }
}

#[test]
fn chains_are_eliminated_without_fill() {
    // Two junctions joined by three chains: everything but a triangle goes by the reduction.
    let mut pairs = Vec::new();
    for path in 0..3 {
        let first = 2 + 20 * path;
        pairs.extend((first + 1..first + 20).map(|i| (i, i - 1)));
        pairs.extend([(0, first), (1, first + 19)]);
    }
    let pattern = BlockPattern::new(vec![3; 62], pairs);
    let found = cheapest_ordering(&pattern);
    // Each of the 60 in a chain has two later neighbors at most.
    let most = 27.0 * (60.0 * (1.0 / 3.0 + 2.0 + 4.0) + (1.0 / 3.0 + 1.0 + 1.0) + 1.0 / 3.0);
    assert!(found.flops <= most * (1.0 + 1e-9), "{} of {most}", found.flops);
}

#[test]
fn large_grids_are_dissected() {
    let found = cheapest_ordering(&grid(110, 6));
    let again = cheapest_ordering(&grid(110, 6));
    assert_eq!(found, again);
    assert!(inverse_permutation(&found.order, 110 * 110).is_some());
}
