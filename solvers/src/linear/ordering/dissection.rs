//! Nested dissection (George, "Nested dissection of a regular finite element mesh", 1973).
//!
//! A graph is cut by a small set of vertices, which is eliminated after both sides; the sides are
//! cut in turn, and small ones are ordered by minimum degree. Good where separators are small
//! against the whole (grids, tori, long corridors), and the two sides can be eliminated side by
//! side. METIS would serve, but draws from the process-wide `rand` and brings a regex library under
//! the LGPL. Everything here is deterministic on any number of threads.

use super::graph::{Graph, Level};
use super::minimum_degree::approximate;
use super::multilevel::separate;
use super::refinement::SEPARATOR;
use crate::interrupt::Interrupt;

/// Graphs of at most so many vertices are not cut.
const LEAF: usize = 100;

/// Graphs of at least so many vertices are worth a task of their own.
const TASK: usize = 600;

/// The order, or `None` for want of memory or of index range, or once `interrupt` is due.
pub(super) fn nested_dissection(graph: &Graph, interrupt: &Interrupt) -> Option<Vec<u32>> {
    let count = graph.count();
    let mut order = vec![0u32; count];
    dissect(graph.clone(), (0..count as u32).collect(), &mut order, interrupt).then_some(order)
}

/// Writes the order of `graph`, whose vertices are called `names`, to `order`.
fn dissect(graph: Graph, names: Vec<u32>, order: &mut [u32], interrupt: &Interrupt) -> bool {
    let count = graph.count();
    if count <= LEAF {
        return leaf(&graph, &names, order);
    }
    let level = Level::of(graph);
    let Some(sides) = separate(&level, interrupt) else { return false };
    let [left, right, separator] =
        [0, 1, SEPARATOR].map(|side| sides.iter().filter(|&&found| found == side).count());
    if left == 0 || right == 0 {
        return leaf(&level.graph, &names, order);
    }
    let (left_order, rest) = order.split_at_mut(left);
    let (right_order, last) = rest.split_at_mut(right);
    debug_assert_eq!(last.len(), separator);
    let cut = sides.iter().zip(&names).filter(|&(&side, _)| side == SEPARATOR);
    for (slot, (_, &name)) in last.iter_mut().zip(cut) {
        *slot = name;
    }
    let (left, left_names) = part(&level.graph, &names, &sides, 0);
    let (right, right_names) = part(&level.graph, &names, &sides, 1);
    drop((level, sides, names));
    let first = || dissect(left, left_names, left_order, interrupt);
    let second = || dissect(right, right_names, right_order, interrupt);
    let (first, second) =
        if count >= TASK { rayon::join(first, second) } else { (first(), second()) };
    first && second
}

/// Minimum degree.
fn leaf(graph: &Graph, names: &[u32], order: &mut [u32]) -> bool {
    let Some(found) = approximate(graph) else { return false };
    for (slot, k) in order.iter_mut().zip(found) {
        *slot = names[k as usize];
    }
    true
}

/// The graph on one side of a cut, with the names of its vertices.
fn part(graph: &Graph, names: &[u32], sides: &[u8], side: u8) -> (Graph, Vec<u32>) {
    let (part, kept) = graph.induced(|v| sides[v] == side, |v| graph.of(v));
    (part, kept.iter().map(|&v| names[v as usize]).collect())
}
