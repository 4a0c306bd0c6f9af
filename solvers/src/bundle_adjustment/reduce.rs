//! From the sums of the chunks to the reduced camera system.
//!
//! Each block row is summed by one task, chunk after chunk, so that its bits do not depend on the
//! number of threads. Views become blocks here: a part of a view's columns lands in its block.

use std::sync::Arc;

use rayon::prelude::*;

use crate::linear::{BlockMatrix, BlockPattern, BlockRowMut};
use crate::simd::WIDTH;

use super::accumulate::{ChunkSums, Column};
use super::covisible::ChunkPairs;
use super::layout::{Layout, Part};

/// One sub-block of a view's or a pair's sum and where it lands in its block row.
#[derive(Clone, Copy, Debug)]
struct Source {
    chunk: u32,
    /// A view, or a pair slot where `pair` is set.
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

/// Where every sum goes, worked out once a solve.
#[derive(Debug)]
pub(super) struct Reduction {
    /// Sources of each block row, in chunk order.
    rows: Vec<Vec<Source>>,
    /// Views and their part in each block.
    views: Vec<Vec<(u32, Part)>>,
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
        for (index, view) in layout.views.iter().enumerate() {
            for part in &view.parts {
                reduction.views[part.block as usize].push((index as u32, *part));
            }
        }
        for (chunk, pairs) in pairs.iter().enumerate() {
            let chunk = chunk as u32;
            for (index, view) in layout.views.iter().enumerate() {
                for p in &view.parts {
                    for q in view.parts.iter().filter(|q| q.block <= p.block) {
                        reduction.push(pattern, (chunk, index as u32, false), (p, q), false);
                    }
                }
            }
            for (index, &(a, b)) in pairs.slots.iter().enumerate() {
                let source = (chunk, index as u32, true);
                for p in &layout.views[a as usize].parts {
                    for q in &layout.views[b as usize].parts {
                        if p.block >= q.block {
                            reduction.push(pattern, source, (p, q), false);
                        }
                        // A block met with itself takes both orders: E_i E_jᵀ + E_j E_iᵀ.
                        if p.block <= q.block {
                            reduction.push(pattern, source, (p, q), true);
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
        (chunk, index, pair): (u32, u32, bool),
        (p, q): (&Part, &Part),
        transposed: bool,
    ) {
        let (row, column) = if transposed { (q.block, p.block) } else { (p.block, q.block) };
        let Ok(slot) = pattern.row(row as usize).binary_search(&column) else { return };
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

    /// Sums the chunks: `reduced` (without pose factors), gradient, diagonal of H_vv, and E y.
    pub(super) fn sum<const D: usize, const Q: usize>(
        &self,
        layout: &Layout,
        chunks: &[ChunkSums<D, Q>],
        reduced: &mut BlockMatrix,
        vectors: &mut ReducedVectors,
    ) {
        reduced.set_zero();
        let sizes = &layout.block_sizes;
        let rows = reduced.rows_mut().into_par_iter().zip(&self.rows);
        rows.with_min_len(8).for_each(|(mut row, sources)| {
            let stride = sizes[row.index()];
            for source in sources {
                add_source(&mut row, stride, source, chunks);
            }
        });
        vectors.clear();
        let mut offset = 0;
        for (block, &size) in sizes.iter().enumerate() {
            for (view, part) in &self.views[block] {
                for chunk in chunks {
                    let sum = &chunk.views[*view as usize];
                    for i in 0..part.size {
                        let (q, k) = ((part.column + i) / WIDTH, (part.column + i) % WIDTH);
                        vectors.gradient[offset + i] += sum.gradient[q][k];
                        vectors.diagonal[offset + i] += sum.diagonal[q][k];
                        vectors.eliminated[offset + i] += sum.eliminated[q][k];
                    }
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
    /// Σ E y.
    pub(super) eliminated: Vec<f64>,
}

impl ReducedVectors {
    pub(super) fn new(dimension: usize) -> Self {
        let zero = vec![0.0; dimension];
        Self { gradient: zero.clone(), diagonal: zero.clone(), eliminated: zero }
    }

    fn clear(&mut self) {
        self.gradient.fill(0.0);
        self.diagonal.fill(0.0);
        self.eliminated.fill(0.0);
    }
}

fn add_source<const D: usize, const Q: usize>(
    row: &mut BlockRowMut<'_>,
    stride: usize,
    source: &Source,
    chunks: &[ChunkSums<D, Q>],
) {
    let chunk = &chunks[source.chunk as usize];
    let columns: &[Column<Q>; D] = if source.pair {
        &chunk.pairs[source.index as usize]
    } else {
        &chunk.views[source.index as usize].reduced
    };
    let target = row.slot_mut(source.slot as usize);
    let (first_row, first_column) = (source.row as usize, source.column as usize);
    for c in 0..source.columns as usize {
        let column = columns[first_column + c].as_flattened();
        for r in 0..source.rows as usize {
            let value = column[first_row + r];
            let place = if source.transposed { r * stride + c } else { c * stride + r };
            target[place] += value;
        }
    }
}
