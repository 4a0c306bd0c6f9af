//! The graph of a block pattern: a vertex for each block row, an edge for each off-diagonal block.
//!
//! Compressed neighbor lists, both directions, ascending; with weights once vertices are merged. It
//! knows neither sizes nor values.

use crate::linear::pattern::BlockPattern;
use crate::lists::Lists;

/// An undirected graph without loops: the neighbors of each vertex.
pub(super) type Graph = Lists<u32>;

impl Graph {
    /// The graph of a pattern. Patterns too large for 32-bit indices have a graph without vertices.
    pub(super) fn of_pattern(pattern: &BlockPattern) -> Self {
        if pattern.stored_block_count() > (u32::MAX / 4) as usize {
            return Self::default();
        }
        // Rows ascend, so a vertex meets its lower neighbors in its own row before any higher one.
        let of_row = |i: usize| pattern.row(i).iter().map(move |&j| (i, j as usize));
        let edges = (0..pattern.block_count()).flat_map(of_row).filter(|(i, j)| i != j);
        let ends = edges.flat_map(|(i, j)| [(i, j as u32), (j, i as u32)]);
        Self::new(pattern.block_count(), ends)
    }

    /// The graph of the vertices that are kept, numbered anew, and their numbers here. `neighbors` are
    /// those of a vertex, from which the ones that are not kept are left out.
    pub(super) fn induced<'a>(
        &self,
        is_kept: impl Fn(usize) -> bool,
        neighbors: impl Fn(usize) -> &'a [u32],
    ) -> (Self, Vec<u32>) {
        let mut number = vec![0u32; self.count()];
        let mut kept = Vec::new();
        for v in (0..self.count()).filter(|&v| is_kept(v)) {
            number[v] = kept.len() as u32;
            kept.push(v as u32);
        }
        let most = kept.iter().map(|&v| neighbors(v as usize).len()).sum();
        let mut part = Self { starts: vec![0], items: Vec::with_capacity(most) };
        for &v in &kept {
            let inside = neighbors(v as usize).iter().filter(|&&w| is_kept(w as usize));
            part.items.extend(inside.map(|&w| number[w as usize]));
            part.starts.push(part.items.len());
        }
        (part, kept)
    }
}

/// A graph with weights.
#[derive(Debug, Clone)]
pub(super) struct Level {
    pub(super) graph: Graph,
    /// Original vertices in each vertex.
    pub(super) weights: Vec<u32>,
    /// Original edges along each entry of the neighbor lists.
    pub(super) edge_weights: Vec<u32>,
}

impl Level {
    /// All weights one.
    pub(super) fn of(graph: Graph) -> Self {
        let weights = vec![1; graph.count()];
        let edge_weights = vec![1; graph.items.len()];
        Self { graph, weights, edge_weights }
    }
}
