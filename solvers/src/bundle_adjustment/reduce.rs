//! From the sums of the chunks to the reduced camera system, the Schur complement of the landmarks.
//!
//! Each block row is summed by one task, chunk after chunk, so that its bits do not depend on the
//! number of threads. Views become blocks here: a part of a view's columns lands in its block. It
//! evaluates no residual.

use std::sync::Arc;

use super::accumulate::ChunkSums;
use super::blocks::Block;
use super::covisible::ChunkPairs;
use super::layout::{Layout, Part};
use crate::interrupt::Interrupt;
use crate::linear::{BlockMatrix, BlockPattern, BlockRowMut};
use crate::parallel;

/// One sub-block of a view's or a pair's sum and where it lands in its block row.
#[derive(Clone, Copy, Debug)]
struct Source {
    chunk: u32,
    /// The chunk's number of a view, or of a pair where `pair` is set.
    index: u32,
    pair: bool,
    /// Whether rows of the target are columns of the sum.
    transposed: bool,
    /// Position of the target's column in the row.
    slot: u32,
    /// First row and column in the sum.
    row: u8,
    column: u8,
    rows: u8,
    columns: u8,
}

/// A sum of a chunk.
#[derive(Clone, Copy)]
struct ChunkSum {
    chunk: u32,
    /// As in [`Source`].
    index: u32,
    pair: bool,
}

/// Block rows that a task sums.
const ROWS_A_TASK: usize = 8;

/// Bytes of one source.
pub(super) const SOURCE_BYTES: u64 = size_of::<Source>() as u64;

/// Where every sum goes, worked out once a solve.
#[derive(Debug)]
pub(super) struct Reduction {
    /// Sources of each block row, in chunk order.
    rows: Vec<Vec<Source>>,
    /// Chunk, its number of a view, and the view's part in each block.
    views: Vec<Vec<(u32, u32, Part)>>,
}

/// Pairs of blocks that a chunk's pairs, or a view's two parts, tie together.
pub(super) fn block_pairs(layout: &Layout, pairs: &[ChunkPairs]) -> Vec<(usize, usize)> {
    let mut out = Vec::new();
    for view in &layout.views {
        if let [a, b] = view.parts[..] {
            out.push((a.block as usize, b.block as usize));
        }
    }
    let mut seen: Vec<(u32, u32)> = pairs.iter().flat_map(|p| p.slots.iter().copied()).collect();
    seen.sort_unstable();
    seen.dedup();
    for (a, b) in seen {
        for p in &layout.views[a as usize].parts {
            for q in &layout.views[b as usize].parts {
                out.push((p.block as usize, q.block as usize));
            }
        }
    }
    out
}

impl Reduction {
    pub(super) fn new(layout: &Layout, pairs: &[ChunkPairs], pattern: &Arc<BlockPattern>) -> Self {
        let blocks = layout.block_sizes.len();
        let mut reduction =
            Self { rows: vec![Vec::new(); blocks], views: vec![Vec::new(); blocks] };
        for (chunk, found) in layout.chunks().iter().enumerate() {
            for (local, &view) in found.views.iter().enumerate() {
                let (chunk, local) = (chunk as u32, local as u32);
                let parts = &layout.views[view as usize].parts;
                for p in parts {
                    reduction.views[p.block as usize].push((chunk, local, *p));
                    let sum = ChunkSum { chunk, index: local, pair: false };
                    for q in parts.iter().filter(|q| q.block <= p.block) {
                        reduction.push(pattern, sum, p, q, false);
                    }
                }
            }
        }
        for (chunk, pairs) in pairs.iter().enumerate() {
            let chunk = chunk as u32;
            for (index, &(a, b)) in pairs.slots.iter().enumerate() {
                let sum = ChunkSum { chunk, index: index as u32, pair: true };
                for p in &layout.views[a as usize].parts {
                    for q in &layout.views[b as usize].parts {
                        if p.block >= q.block {
                            reduction.push(pattern, sum, p, q, false);
                        }
                        // A block met with itself takes both orders: E_i E_jᵀ + E_j E_iᵀ.
                        if p.block <= q.block {
                            reduction.push(pattern, sum, p, q, true);
                        }
                    }
                }
            }
        }
        reduction
    }

    fn push(
        &mut self,
        pattern: &BlockPattern,
        sum: ChunkSum,
        p: &Part,
        q: &Part,
        transposed: bool,
    ) {
        let (row, column) = if transposed { (q.block, p.block) } else { (p.block, q.block) };
        let Ok(slot) = pattern.row(row as usize).binary_search(&column) else { return };
        let ChunkSum { chunk, index, pair } = sum;
        self.rows[row as usize].push(Source {
            chunk,
            index,
            pair,
            transposed,
            slot: slot as u32,
            row: p.column as u8,
            column: q.column as u8,
            rows: p.size as u8,
            columns: q.size as u8,
        });
    }

    /// Sums the chunks: `reduced`, gradients, and the diagonal of H_vv.
    pub(super) fn sum<const D: usize, const V: usize, const T: usize, const R: usize>(
        &self,
        layout: &Layout,
        chunks: &[ChunkSums<D, V, T, R>],
        reduced: &mut BlockMatrix,
        vectors: &mut ReducedVectors,
        interrupt: &Interrupt,
    ) {
        let sizes = &layout.block_sizes;
        let mut rows = reduced.rows_mut();
        let runs = rows.chunks_mut(ROWS_A_TASK).zip(self.rows.chunks(ROWS_A_TASK));
        parallel::for_each(runs, |(rows, sources)| {
            for (row, sources) in rows.iter_mut().zip(sources) {
                if interrupt.is_due() {
                    return;
                }
                row.values_mut().fill(0.0);
                let stride = sizes[row.index()];
                for source in sources {
                    add_source(row, stride, source, chunks);
                }
            }
        });
        vectors.clear();
        let mut offset = 0;
        for (views, &size) in self.views.iter().zip(sizes) {
            for (chunk, local, part) in views {
                let sum = &chunks[*chunk as usize].views[*local as usize];
                for i in 0..part.size {
                    let column = part.column + i;
                    vectors.gradient[offset + i] += sum.gradient.get(column);
                    vectors.diagonal[offset + i] += sum.diagonal.get(column);
                    vectors.reduced_gradient[offset + i] += sum.reduced_gradient.get(column);
                }
            }
            offset += size;
        }
    }
}

/// Vectors over the unknowns of the reduced system.
#[derive(Clone, Debug)]
pub(super) struct ReducedVectors {
    /// g_v.
    pub(super) gradient: Vec<f64>,
    /// Diagonal of H_vv.
    pub(super) diagonal: Vec<f64>,
    /// g_v − Σ E y.
    pub(super) reduced_gradient: Vec<f64>,
}

impl ReducedVectors {
    pub(super) fn new(dimension: usize) -> Self {
        let zero = vec![0.0; dimension];
        Self { gradient: zero.clone(), diagonal: zero.clone(), reduced_gradient: zero }
    }

    fn clear(&mut self) {
        self.gradient.fill(0.0);
        self.diagonal.fill(0.0);
        self.reduced_gradient.fill(0.0);
    }
}

fn add_source<const D: usize, const V: usize, const T: usize, const R: usize>(
    row: &mut BlockRowMut<'_>,
    stride: usize,
    source: &Source,
    chunks: &[ChunkSums<D, V, T, R>],
) {
    let chunk = &chunks[source.chunk as usize];
    let block: &Block<D, V, T> = if source.pair {
        &chunk.pairs[source.index as usize]
    } else {
        &chunk.views[source.index as usize].reduced
    };
    let target = row.slot_mut(source.slot as usize);
    let (first_row, first_column) = (source.row as usize, source.column as usize);
    for c in 0..source.columns as usize {
        for r in 0..source.rows as usize {
            let value = block.get(first_row + r, first_column + c);
            let index = if source.transposed { r * stride + c } else { c * stride + r };
            target[index] += value;
        }
    }
}
