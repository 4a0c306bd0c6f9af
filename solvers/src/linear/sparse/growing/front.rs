//! One front of a growing system: terms, children's update matrices, elimination.
//!
//! A child's rows may stand in another order than here: its update matrix is added block by block,
//! transposed where need be. The kernels are those of the factorization that does not grow.

use super::terms::Terms;
use super::tree::{NONE, Node, Tree};
use crate::interrupt::Interrupt;
use crate::linear::LinearError;
use crate::linear::sparse::Aligned;
use crate::linear::sparse::columns::{COLUMNS_PER_TASK, cholesky, strips};
use crate::linear::sparse::front::add_rows;
use crate::linear::sparse::kernels::{BadPivot, Downdate, Source, Start, Target};
use crate::linear::sparse::numeric::PARALLEL_FLOPS;
use crate::linear::sparse::shape::Shape;
use crate::simd::{Class, Kernel, Lanes};

/// A front that is to be made.
pub(super) struct Work {
    pub(super) blocks: Vec<u32>,
    pub(super) pivots: usize,
    shape: Shape,
    pub(super) panel: Aligned,
    pub(super) update: Aligned,
    /// Subtrees that stay and hang here.
    pub(super) orphans: Vec<u32>,
    /// Numbers of works.
    pub(super) children: Vec<usize>,
    /// The first work of the subtree.
    pub(super) first: usize,
    /// Of the subtree.
    pub(super) flops: f64,
    pub(super) decrease: f64,
    /// √H of the pivots' scalars.
    pub(super) weights: Vec<f64>,
}

impl Work {
    pub(super) fn new(
        blocks: Vec<u32>,
        pivots: usize,
        shape: Shape,
        [panel, update]: [Aligned; 2],
        orphans: Vec<u32>,
    ) -> Self {
        let (children, weights) = (Vec::new(), Vec::new());
        let (first, flops, decrease) = (0, shape.flops(), 0.0);
        Self {
            blocks,
            pivots,
            shape,
            panel,
            update,
            orphans,
            children,
            first,
            flops,
            decrease,
            weights,
        }
    }
}

/// What all fronts of a top are made from.
pub(super) struct Shared<'a, const N: usize> {
    pub(super) tree: &'a Tree,
    pub(super) terms: &'a Terms<N>,
    pub(super) class: Class,
    /// Number of blocks in the top.
    pub(super) blocks: usize,
}

impl<const N: usize> Shared<'_, N> {
    /// Makes one front; `below` has the works before it from number `first` on, `at` is free.
    pub(super) fn make(
        &self,
        work: &mut Work,
        below: &[Work],
        first: usize,
        at: &mut [u32],
        is_dealt: bool,
    ) -> Result<(), LinearError> {
        let Work { blocks, pivots, shape, panel, update, orphans, children, .. } = work;
        let (shape, pivots) = (*shape, &blocks[..*pivots]);
        let panel = &mut panel.slice_mut()[..shape.panel_size()];
        let update = &mut update.slice_mut()[..shape.update_size()];
        for (k, &block) in blocks.iter().enumerate() {
            at[self.tree.local[block as usize] as usize] = (k * N) as u32;
        }
        let places = Places { local: &self.tree.local, at };
        work.weights = fill(self.terms, pivots, &places, shape, panel);
        let made = children.iter().map(|&child| {
            let Work { blocks, pivots, shape, update, .. } = &below[child - first];
            Child { rows: &blocks[*pivots..], shape: *shape, update }
        });
        let orphans = orphans.iter().filter_map(|&orphan| self.tree.node(orphan));
        let children: Vec<Child<'_>> = made.chain(orphans.map(Child::of::<N>)).collect();
        let lift = |first_column: usize, columns: &mut [f64]| {
            for child in &children {
                let front = Columns { shape, first_column, columns: &mut *columns };
                self.class.run(Lift::<N> { child, places: &places, front });
            }
        };
        lift(0, &mut *panel);
        let is_dealt = is_dealt && shape.flops() > PARALLEL_FLOPS;
        let outcome =
            cholesky(self.class, panel, (shape.stride, shape.pivots), is_dealt, &Interrupt::NEVER);
        let outcome = outcome.map_err(|BadPivot { column, is_finite }| {
            let block = pivots[column / N] as usize;
            if is_finite {
                LinearError::NotPositiveDefinite { block, scalar: block * N + column % N }
            } else {
                LinearError::NonFinite { block }
            }
        });
        if outcome.is_ok() && !update.is_empty() {
            let source = Source { columns: panel, stride: shape.stride };
            let stride = shape.update_stride();
            let work = |first_column: usize, columns: &mut [f64]| {
                let target = Target {
                    columns: &mut *columns,
                    stride,
                    first_row: shape.update_row(),
                    first_column,
                };
                self.class.run(Downdate { source, start: Start::Zero, target });
                lift(first_column, columns);
            };
            // Columns of a block stay together: one task takes all at once, however many there are.
            if is_dealt {
                let strip = (Some(COLUMNS_PER_TASK / N * N), &Interrupt::NEVER);
                strips((stride, shape.pivots), update, strip, work);
            } else {
                work(shape.pivots, update);
            }
        }
        let solved = panel.chunks_exact(shape.stride).map(|column| column[shape.rows]);
        work.decrease = solved.map(|y| 0.5 * y * y).sum();
        for &block in blocks.iter() {
            at[self.tree.local[block as usize] as usize] = NONE;
        }
        outcome
    }
}

/// Where blocks begin in the front at hand.
struct Places<'a> {
    local: &'a [u32],
    at: &'a [u32],
}

impl Places<'_> {
    /// [`NONE`] for a block that this front does not have.
    #[inline(always)]
    fn of(&self, block: u32) -> u32 {
        let local = self.local.get(block as usize).copied().unwrap_or(NONE);
        self.at.get(local as usize).copied().unwrap_or(NONE)
    }
}

/// The terms of the pivots into a panel of zeros; returns √H of the pivots' scalars.
fn fill<const N: usize>(
    terms: &Terms<N>,
    pivots: &[u32],
    places: &Places<'_>,
    Shape { rows, stride, .. }: Shape,
    panel: &mut [f64],
) -> Vec<f64> {
    panel.fill(0.0);
    let mut weights = Vec::with_capacity(pivots.len() * N);
    for (k, &pivot) in pivots.iter().enumerate() {
        let first = k * N;
        for (term, other, is_i) in terms.incident(pivot) {
            let (h, g) = if is_i { (&term.h_ii, &term.g_i) } else { (&term.h_jj, &term.g_j) };
            for c in 0..N {
                let column = &mut panel[(first + c) * stride..][..stride];
                for r in 0..N {
                    column[first + r] += h[(r, c)];
                }
                column[rows] -= g[c];
            }
            // A block that this front does not have was eliminated below, one before the pivot
            // counted this term.
            let at = places.of(other);
            if at == NONE || (at as usize) < first {
                continue;
            }
            for c in 0..N {
                let column = &mut panel[(first + c) * stride + at as usize..][..N];
                for r in 0..N {
                    column[r] += if is_i { term.h_ij[(c, r)] } else { term.h_ij[(r, c)] };
                }
            }
        }
        let diagonal = (first..first + N).map(|c| panel[c * (stride + 1)]);
        weights.extend(diagonal.map(|h| h.max(0.0).sqrt()));
    }
    weights
}

/// A child's update matrix.
struct Child<'a> {
    rows: &'a [u32],
    shape: Shape,
    update: &'a Aligned,
}

impl<'a> Child<'a> {
    fn of<const N: usize>(node: &'a Node) -> Self {
        Self { rows: node.rows(), shape: node.shape::<N>(), update: &node.update }
    }
}

/// Whole columns of a front's panel or of its update matrix, from `first_column` on.
struct Columns<'a> {
    shape: Shape,
    first_column: usize,
    columns: &'a mut [f64],
}

impl Columns<'_> {
    /// The front's columns that are here.
    #[inline(always)]
    fn range(&self) -> std::ops::Range<usize> {
        let stride = self.stride();
        self.first_column..self.first_column + self.columns.len() / stride.max(1)
    }

    #[inline(always)]
    fn stride(&self) -> usize {
        if self.first_column < self.shape.pivots {
            self.shape.stride
        } else {
            self.shape.update_stride()
        }
    }

    /// From the front's row `row` of its column `column` down.
    #[inline(always)]
    fn at(&mut self, row: usize, column: usize) -> Option<&mut [f64]> {
        let first_row =
            if self.first_column < self.shape.pivots { 0 } else { self.shape.update_row() };
        let stride = self.stride();
        self.columns.get_mut((column - self.first_column) * stride + row - first_row..)
    }
}

/// Adds a child's update matrix, and its right-hand side, to those columns.
struct Lift<'a, 'p, 'c, const N: usize> {
    child: &'a Child<'a>,
    places: &'a Places<'p>,
    front: Columns<'c>,
}

impl<const N: usize> Kernel for Lift<'_, '_, '_, N> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { child: Child { rows, shape, update }, places, mut front } = self;
        let stride = shape.update_stride();
        let update = &update.slice()[..shape.update_size()];
        let top = shape.pivots - shape.update_row();
        let range = front.range();
        let to = |k: usize| places.of(rows[k]) as usize;
        for b in 0..rows.len() {
            let column = to(b);
            let is_here = range.contains(&column);
            let mut a = b;
            while a < rows.len() {
                // Blocks that stand side by side in both.
                let row = to(a);
                let mut end = a + 1;
                while end < rows.len() && to(end) == row + (end - a) * N {
                    end += 1;
                }
                let source = b * N * stride + top + a * N;
                let length = (end - a) * N;
                if row >= column {
                    for c in 0..if is_here { N } else { 0 } {
                        if let (Some(source), Some(target)) = (
                            update.get(source + c * stride..).and_then(|s| s.get(..length)),
                            front.at(row, column + c).and_then(|t| t.get_mut(..length)),
                        ) {
                            add_rows(lanes, source, target);
                        }
                    }
                } else {
                    for k in (0..length).filter(|k| range.contains(&(row + k))) {
                        let Some(target) = front.at(column, row + k) else { continue };
                        for c in 0..N {
                            target[c] += update[source + c * stride + k];
                        }
                    }
                }
                a = end;
            }
            for c in 0..if is_here { N } else { 0 } {
                let from = (b * N + c) * stride + top + rows.len() * N;
                let rhs = front.shape.rows;
                if let Some(target) = front.at(rhs, column + c) {
                    target[0] += update[from];
                }
            }
        }
    }
}
