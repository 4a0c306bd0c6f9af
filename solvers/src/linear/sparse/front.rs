//! Filling a front: the matrix's own blocks, and the update matrices of its children.
//!
//! Blocks of usual sizes have loops of fixed length. Squares on the diagonal are taken whole where
//! that is simpler: what lands above the diagonal is never read.
//! Children are added in order, each element by one task, so that sums keep their order. It eliminates
//! nothing: see `columns`.

use super::kernels::Target;
use super::plan::{Node, Plan, Run};
use super::shape::Shape;
use crate::interrupt::Interrupt;
use crate::simd::{Kernel, Lanes, WIDTH};

/// Columns of a diagonal square that are added at a time.
const DIAGONAL: usize = 8;

/// Elements that are scattered between two checks of the interrupt: about a millisecond.
const ELEMENTS_PER_CHECK: u32 = 1 << 20;

/// Scatters the values of H and of D, which is in the caller's order or empty, over the panel of node `s`,
/// which is zero. Ends early where `interrupt` is due.
pub(super) fn fill(
    plan: &Plan,
    s: usize,
    values: &[f64],
    added: &[f64],
    panel: &mut [f64],
    interrupt: &Interrupt,
) {
    let Node { first, shape: Shape { pivots, stride, .. }, .. } = plan.nodes[s];
    let mut steps = interrupt.in_steps(ELEMENTS_PER_CHECK);
    for entry in plan.entries.of(s) {
        let (rows, columns) = (usize::from(entry.rows), usize::from(entry.columns));
        if steps.is_due_after(u32::from(entry.rows) * u32::from(entry.columns)) {
            return;
        }
        let Some(source) =
            values.get(entry.source as usize..).and_then(|v| v.get(..rows * columns))
        else {
            continue;
        };
        let Some(target) = panel.get_mut(entry.target as usize..) else { continue };
        match (rows, columns) {
            (3, 3) => scatter_block::<3>(source, target, stride, entry.is_transposed),
            (6, 6) => scatter_block::<6>(source, target, stride, entry.is_transposed),
            (7, 7) => scatter_block::<7>(source, target, stride, entry.is_transposed),
            (9, 9) => scatter_block::<9>(source, target, stride, entry.is_transposed),
            _ if rows == 0 => {}
            _ => {
                for (c, column) in source.chunks_exact(rows).enumerate() {
                    for (r, &value) in column.iter().enumerate() {
                        let at = if entry.is_transposed { c + r * stride } else { r + c * stride };
                        if let Some(slot) = target.get_mut(at) {
                            *slot = value;
                        }
                    }
                }
            }
        }
    }
    if !added.is_empty() {
        for (k, &scalar) in plan.scalars[first..first + pivots].iter().enumerate() {
            panel[k * (stride + 1)] += added[scalar as usize];
        }
    }
}

/// A square block of fixed size.
#[inline(always)]
fn scatter_block<const N: usize>(
    source: &[f64],
    target: &mut [f64],
    stride: usize,
    is_transposed: bool,
) {
    let (columns, _) = source.as_chunks::<N>();
    let Some(columns) = columns.first_chunk::<N>() else { return };
    for c in 0..N {
        let column = if is_transposed {
            let mut row = [0.0; N];
            for r in 0..N {
                row[r] = columns[r][c];
            }
            row
        } else {
            columns[c]
        };
        if let Some(slot) = target.get_mut(c * stride..).and_then(|tail| tail.first_chunk_mut()) {
            *slot = column;
        }
    }
}

/// Adds a child's update matrix to those columns of the parent's front that `target` holds.
pub(super) struct Lift<'a> {
    /// The child's.
    pub(super) shape: Shape,
    pub(super) update: &'a [f64],
    pub(super) runs: &'a [Run],
    pub(super) target: Target<'a>,
}

impl Kernel for Lift<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { shape, update, runs, target } = self;
        let stride = shape.update_stride();
        let top = shape.pivots - shape.update_row();
        let first = target.first_column;
        let end = first + target.columns.len() / target.stride.max(1);
        for (index, run) in runs.iter().enumerate() {
            let (to, length) = (run.to as usize, run.length as usize);
            // The columns of this run that the target holds.
            let from = first.saturating_sub(to).min(length);
            let until = end.saturating_sub(to).min(length);
            if from >= until {
                if to >= end {
                    return;
                }
                continue;
            }
            let source_column = (run.from as usize + from) * stride;
            let target_column = (to + from - first) * target.stride;
            let offsets = |row: usize, run: &Run| {
                (
                    source_column + top + run.from as usize + row,
                    target_column + run.to as usize + row - target.first_row,
                )
            };
            // The run's own square from its diagonal down, in steps.
            let mut column = from;
            while column < until {
                let width = DIAGONAL.min(until - column);
                let (source_at, target_at) = offsets(column, run);
                let skipped = column - from;
                let source = Block { values: update, first: source_at + skipped * stride, stride };
                let target = BlockMut {
                    values: &mut *target.columns,
                    first: target_at + skipped * target.stride,
                    stride: target.stride,
                };
                add(lanes, source, target, length - column, width);
                column += width;
            }
            for below in &runs[index + 1..] {
                let (source_at, target_at) = offsets(0, below);
                let source = Block { values: update, first: source_at, stride };
                let target = BlockMut {
                    values: &mut *target.columns,
                    first: target_at,
                    stride: target.stride,
                };
                add(lanes, source, target, below.length as usize, until - from);
            }
        }
    }
}

/// A block of columns, whose first entry is at `first`.
struct Block<'a> {
    values: &'a [f64],
    first: usize,
    /// From one column to the next.
    stride: usize,
}

/// The same, to be written.
struct BlockMut<'a> {
    values: &'a mut [f64],
    first: usize,
    stride: usize,
}

/// target += source for a block of `rows` × `columns` elements.
#[inline(always)]
fn add<L: Lanes>(lanes: L, source: Block<'_>, target: BlockMut<'_>, rows: usize, columns: usize) {
    let Block { values: source, first: source_at, stride: source_stride } = source;
    let BlockMut { values: target, first: target_at, stride: target_stride } = target;
    macro_rules! fixed {
        ($($rows:literal),*) => {
            match rows {
                $($rows => {
                    for c in 0..columns {
                        let (s, t) = (source_at + c * source_stride, target_at + c * target_stride);
                        add_fixed::<$rows>(source, s, target, t);
                    }
                })*
                _ => {
                    for c in 0..columns {
                        let (s, t) = (source_at + c * source_stride, target_at + c * target_stride);
                        let (Some(source), Some(target)) =
                            (source.get(s..s + rows), target.get_mut(t..t + rows))
                        else {
                            return;
                        };
                        add_rows(lanes, source, target);
                    }
                }
            }
        };
    }
    fixed!(2, 3, 6, 7, 9, 12);
}

/// target += source for `N` rows of a column.
#[inline(always)]
fn add_fixed<const N: usize>(source: &[f64], s: usize, target: &mut [f64], t: usize) {
    let source = source.get(s..).and_then(|tail| tail.first_chunk::<N>());
    let target = target.get_mut(t..).and_then(|tail| tail.first_chunk_mut::<N>());
    if let (Some(source), Some(target)) = (source, target) {
        // Sums of copies: nothing overlaps, so they become vectors.
        let (a, mut b) = (*source, *target);
        for r in 0..N {
            b[r] += a[r];
        }
        *target = b;
    }
}

/// target += source for the rows of a column.
#[inline(always)]
pub(super) fn add_rows<L: Lanes>(lanes: L, source: &[f64], target: &mut [f64]) {
    let (vectors, rest) = source.as_chunks::<WIDTH>();
    let (targets, target_rest) = target.as_chunks_mut::<WIDTH>();
    for (t, s) in targets.iter_mut().zip(vectors) {
        lanes.store(lanes.add(lanes.load(t), lanes.load(s)), t);
    }
    let mut at = 0;
    if rest.len() & 4 > 0 {
        add_fixed::<4>(rest, at, target_rest, at);
        at += 4;
    }
    if rest.len() & 2 > 0 {
        add_fixed::<2>(rest, at, target_rest, at);
        at += 2;
    }
    if rest.len() & 1 > 0 {
        add_fixed::<1>(rest, at, target_rest, at);
    }
}
