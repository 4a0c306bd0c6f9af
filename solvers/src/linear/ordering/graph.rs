//! The graph of a block pattern: who shares an off-diagonal block with whom.
//!
//! Compressed neighbor lists, both directions, ascending. It knows neither sizes nor values.

use std::ops::Range;

use crate::linear::pattern::BlockPattern;

/// An undirected graph without loops.
#[derive(Debug, Clone, Default)]
pub(super) struct Graph {
    /// Where each list begins, and the end of the last.
    pub(super) starts: Vec<u32>,
    pub(super) neighbors: Vec<u32>,
}

impl Graph {
    /// The graph of a pattern. Patterns too large for 32-bit indices have a graph without vertices.
    pub(super) fn new(pattern: &BlockPattern) -> Self {
        let count = pattern.block_count();
        if pattern.stored_block_count() > (u32::MAX / 4) as usize {
            return Self::default();
        }
        let mut starts = vec![0u32; count + 1];
        for i in 0..count {
            for &j in pattern.row(i) {
                if j as usize != i {
                    starts[i + 1] += 1;
                    starts[j as usize + 1] += 1;
                }
            }
        }
        for i in 0..count {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut neighbors = vec![0u32; starts[count] as usize];
        // Rows ascend, so a vertex meets its lower neighbors in its own row before any higher one.
        for i in 0..count {
            for &j in pattern.row(i) {
                if j as usize != i {
                    neighbors[next[i] as usize] = j;
                    next[i] += 1;
                    neighbors[next[j as usize] as usize] = i as u32;
                    next[j as usize] += 1;
                }
            }
        }
        Self { starts, neighbors }
    }

    /// Number of vertices.
    pub(super) fn count(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Where the neighbors of vertex `v` stand.
    pub(super) fn range(&self, v: usize) -> Range<usize> {
        self.starts[v] as usize..self.starts[v + 1] as usize
    }

    /// The neighbors of vertex `v`.
    pub(super) fn of(&self, v: usize) -> &[u32] {
        &self.neighbors[self.range(v)]
    }
}
