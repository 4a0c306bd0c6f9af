//! A graph cut into parts of equal weight that meet in separators only.
//!
//! Recursive bisection by small vertex separators (`multilevel`), each cut in proportion to the parts
//! that are still to be made of its sides. No edge joins two parts. The same graph gives the same parts.
//! It does not order inside of a part.

use super::graph::{Balance, Graph, Level};
use super::multilevel::separate;
use super::refinement::SEPARATOR;
use crate::interrupt::Interrupt;
use crate::lists::Lists;

/// Marks a vertex of a separator.
pub(crate) const SEPARATE: u32 = u32::MAX;

/// A part may have at most so many times its share of the weight.
const SLACK: f64 = 1.05;

/// The part of each of `count` vertices, or [`SEPARATE`]. `edges` are (later, earlier, weight), each
/// pair once, ascending. Parts are numbered from 0 on without gaps; there are fewer than `wanted` where
/// the graph cannot be cut so often. `None` once `interrupt` is due.
pub(crate) fn parts(
    count: usize,
    edges: &[(u32, u32, u32)],
    wanted: usize,
    interrupt: &Interrupt,
) -> Option<Vec<u32>> {
    let mut cutter = Cutter { parts: vec![SEPARATE; count], next: 0, interrupt };
    let level = Level::weighted(count, edges);
    cutter.cut(level, (0..count as u32).collect(), wanted.max(1))?;
    Some(cutter.parts)
}

impl Level {
    /// The graph of weighted edges (later, earlier, weight), ascending; each vertex weighs one.
    fn weighted(count: usize, edges: &[(u32, u32, u32)]) -> Self {
        // Edges ascend, so a vertex meets its earlier neighbors before any later one.
        let ends = edges.iter().flat_map(|&(later, earlier, weight)| {
            [(later as usize, (earlier, weight)), (earlier as usize, (later, weight))]
        });
        let Lists { starts, items } = Lists::new(count, ends);
        let (items, edge_weights) = items.into_iter().unzip();
        let graph = Graph { starts, items };
        Self { graph, weights: vec![1; count], edge_weights, balance: Balance::HALVES }
    }

    /// The vertices on one side, with their numbers here.
    fn side(&self, sides: &[u8], side: u8) -> (Self, Vec<u32>) {
        let is_kept = |v: usize| sides[v] == side;
        let (graph, kept) = self.graph.induced(is_kept, |v| self.graph.of(v));
        let mut edge_weights = Vec::with_capacity(graph.items.len());
        for &v in &kept {
            let range = self.graph.range(v as usize);
            let entries = self.graph.items[range.clone()].iter().zip(&self.edge_weights[range]);
            let inside = entries.filter(|&(&w, _)| is_kept(w as usize));
            edge_weights.extend(inside.map(|(_, &weight)| weight));
        }
        let weights = vec![1; kept.len()];
        (Self { graph, weights, edge_weights, balance: self.balance }, kept)
    }
}

struct Cutter<'a> {
    parts: Vec<u32>,
    /// The number of the next part.
    next: u32,
    interrupt: &'a Interrupt,
}

impl Cutter<'_> {
    /// Makes `wanted` parts of a graph whose vertices are called `names`.
    fn cut(&mut self, mut level: Level, names: Vec<u32>, wanted: usize) -> Option<()> {
        if names.is_empty() {
            return Some(());
        }
        let whole = |cutter: &mut Self| {
            for &name in &names {
                cutter.parts[name as usize] = cutter.next;
            }
            cutter.next += 1;
            Some(())
        };
        if wanted < 2 {
            return whole(self);
        }
        let first = wanted / 2;
        let shares = [first as u32, (wanted - first) as u32];
        level.balance = Balance { shares, slack: SLACK };
        let sides = separate(&level, self.interrupt)?;
        if !(sides.contains(&0) && sides.contains(&1)) {
            return whole(self);
        }
        debug_assert!(sides.iter().all(|&side| side <= SEPARATOR));
        for (side, wanted) in [(0, first), (1, wanted - first)] {
            let (part, kept) = level.side(&sides, side);
            let names = kept.iter().map(|&v| names[v as usize]).collect();
            self.cut(part, names, wanted)?;
        }
        Some(())
    }
}
