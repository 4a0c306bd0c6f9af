//! Computes the numbers of a growing system's fronts: in which order, on which threads, from which
//! terms.
//!
//! Memory is given out first. Then subtrees of little work are made side by side, and the fronts above
//! them one after the other, the columns of each dealt out in strips. Each element has one owner and
//! one order of operations, so the bits do not depend on the number of threads.
//! A child's rows may stand in another order than in the front above: its update matrix is added block
//! by block, transposed where need be. The kernels are those of the factorization that does not grow.
//! Which fronts are made, and from which blocks, is decided by `top`.

use super::terms::Terms;
use super::top::{Planned, Top};
use super::tree::{NONE, Node, Tree};
use crate::interrupt::Interrupt;
use crate::linear::error::LinearError;
use crate::linear::sparse::columns::{self, COLUMNS_PER_TASK, Cut};
use crate::linear::sparse::front::add_rows;
use crate::linear::sparse::kernels::{BadPivot, Target};
use crate::linear::sparse::shape::Shape;
use crate::parallel;
use crate::simd::{Class, Kernel, Lanes, WIDTH};

/// A top of fewer flops is made by one task; a subtree with less than this share of them is.
const PARALLEL_FLOPS: f64 = 6e6;
const SHARE: f64 = 1.0 / 6.0;

/// A front that is to be made.
struct Work {
    node: Node,
    /// Number of the work above, or [`NONE`].
    parent: u32,
    /// Roots of unchanged subtrees that become children of this node.
    orphans: Vec<u32>,
    /// Numbers of works.
    children: Vec<usize>,
    /// The first work of the subtree.
    first: usize,
    /// Of the subtree.
    flops: f64,
    /// √H of the pivots' scalars.
    weights: Vec<f64>,
}

/// What all fronts of a top are made from.
struct Shared<'a, const N: usize> {
    tree: &'a Tree,
    terms: &'a Terms<N>,
    class: Class,
    /// Number of blocks in the top.
    blocks: usize,
}

/// Makes the planned nodes and attaches the unchanged subtrees to them; returns the flops. `weight`
/// takes √H.
pub(super) fn eliminate<const N: usize>(
    tree: &mut Tree,
    terms: &Terms<N>,
    top: Top,
    class: Class,
    weight: &mut [f64],
) -> Result<f64, LinearError> {
    let Top { blocks, nodes: planned } = top;
    let count = planned.len();
    let dimension = terms.block_count() * N;
    let mut works: Vec<Work> = Vec::with_capacity(count);
    for (first, Planned { blocks, pivots, parent, orphans }) in planned.into_iter().enumerate() {
        let node = Node::new::<N>(blocks, pivots, &mut tree.memory)
            .ok_or(LinearError::OutOfMemory { dimension })?;
        let (flops, children, weights) = (node.shape::<N>().flops(), Vec::new(), Vec::new());
        works.push(Work { node, parent, orphans, children, first, flops, weights });
    }
    for s in 0..count {
        let Work { parent, first, flops, .. } = works[s];
        if let Some(parent) = works.get_mut(parent as usize) {
            parent.children.push(s);
            parent.first = parent.first.min(first);
            parent.flops += flops;
        }
    }
    let total = works.iter().filter(|work| work.parent == NONE).map(|work| work.flops).sum();
    let shared = Shared { tree, terms, class, blocks: blocks.len() };
    let outcome = shared.make_all(&mut works, total);
    for &block in &blocks {
        tree.local[block as usize] = NONE;
    }
    outcome?;
    let mut numbers = Vec::with_capacity(count);
    for Work { node, parent, orphans, children, weights, .. } in works {
        for (pivot, values) in node.pivots().iter().zip(weights.chunks_exact(N)) {
            weight[*pivot as usize * N..][..N].copy_from_slice(values);
        }
        let number = tree.insert(node);
        for child in children.into_iter().map(|child: usize| numbers[child]).chain(orphans) {
            tree.hang(child, number);
        }
        if parent == NONE {
            tree.roots.push(number);
        }
        numbers.push(number);
    }
    Ok(total)
}

impl<const N: usize> Shared<'_, N> {
    /// Makes all fronts, which stand in postorder and take `total` flops.
    fn make_all(&self, works: &mut [Work], total: f64) -> Result<(), LinearError> {
        if total < PARALLEL_FLOPS || rayon::current_num_threads() < 2 {
            return self.sweep(works, 0);
        }
        let is_light = |work: &Work| work.flops < SHARE * total;
        // Light subtrees under heavy parents, from the back; heavy nodes stay one by one.
        let mut light: Vec<(usize, &mut [Work])> = Vec::new();
        let mut end = works.len();
        let mut rest = &mut *works;
        while end > 0 {
            let begin = if is_light(&rest[end - 1]) { rest[end - 1].first } else { end - 1 };
            let (before, range) = rest.split_at_mut(begin);
            if is_light(&range[range.len() - 1]) {
                light.push((begin, range));
            }
            (rest, end) = (before, begin);
        }
        let sweep = |(first, range): (usize, &mut [Work])| self.sweep(range, first);
        parallel::map(light.into_iter(), sweep).into_iter().collect::<Result<(), _>>()?;
        for s in 0..works.len() {
            if !is_light(&works[s]) {
                let (below, own) = works.split_at_mut(s);
                self.make(&mut own[0], below, 0, &mut self.scratch(), true)?;
            }
        }
        Ok(())
    }

    /// Makes a run of nodes whose first has the number `first`, one after the other.
    fn sweep(&self, works: &mut [Work], first: usize) -> Result<(), LinearError> {
        let mut scratch = self.scratch();
        for s in 0..works.len() {
            let (below, own) = works.split_at_mut(s);
            self.make(&mut own[0], below, first, &mut scratch, false)?;
        }
        Ok(())
    }

    /// Where each block of the top begins in the front at hand.
    fn scratch(&self) -> Vec<u32> {
        vec![NONE; self.blocks]
    }

    /// Makes one front; `below` has the works before it from number `first` on, `at` is free.
    fn make(
        &self,
        work: &mut Work,
        below: &[Work],
        first: usize,
        at: &mut [u32],
        is_dealt: bool,
    ) -> Result<(), LinearError> {
        let shape = work.node.shape::<N>();
        let Node { blocks, pivots, panel, update, decrease, .. } = &mut work.node;
        let pivots = &blocks[..*pivots];
        let panel = &mut panel.slice_mut()[..shape.panel_size()];
        let update = &mut update.slice_mut()[..shape.update_size()];
        for (k, &block) in blocks.iter().enumerate() {
            at[self.tree.local[block as usize] as usize] = (k * N) as u32;
        }
        let offsets = FrontOffsets { local: &self.tree.local, at };
        work.weights = fill(self.terms, pivots, &offsets, shape, panel);
        let made = work.children.iter().map(|&child| &below[child - first].node);
        let orphans = work.orphans.iter().filter_map(|&orphan| self.tree.node(orphan));
        let children: Vec<&Node> = made.chain(orphans).collect();
        let lift = |target: Target<'_>| {
            let Target { columns, stride, first_row, first_column } = target;
            for child in &children {
                let target = Target { columns: &mut *columns, stride, first_row, first_column };
                self.class.run(Lift::<N> { child, offsets: &offsets, rhs: shape.rows, target });
            }
        };
        // Columns of a block stay together.
        let cut = match is_dealt && shape.flops() > columns::PARALLEL_FLOPS {
            true => Cut::Dealt(COLUMNS_PER_TASK / N * N),
            false => Cut::InTurn(WIDTH * N),
        };
        let interrupt = &Interrupt::NEVER;
        let outcome =
            columns::eliminate(self.class, shape, &mut *panel, update, cut, interrupt, lift);
        let outcome = outcome.map_err(|BadPivot { column, is_finite }| {
            let block = pivots[column / N] as usize;
            if is_finite {
                LinearError::NotPositiveDefinite { block, scalar: block * N + column % N }
            } else {
                LinearError::NonFinite { block }
            }
        });
        let solved = panel.chunks_exact(shape.stride).map(|column| column[shape.rows]);
        *decrease = solved.map(|y| 0.5 * y * y).sum();
        for &block in blocks.iter() {
            at[self.tree.local[block as usize] as usize] = NONE;
        }
        outcome
    }
}

/// Where blocks begin in the front at hand.
struct FrontOffsets<'a> {
    local: &'a [u32],
    at: &'a [u32],
}

impl FrontOffsets<'_> {
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
    offsets: &FrontOffsets<'_>,
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
            let at = offsets.of(other);
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

/// Adds a child's update matrix, and its right-hand side, to those columns of a front.
struct Lift<'a, 'p, 'c, const N: usize> {
    child: &'a Node,
    offsets: &'a FrontOffsets<'p>,
    /// The front's row of the right-hand side.
    rhs: usize,
    target: Target<'c>,
}

impl<const N: usize> Kernel for Lift<'_, '_, '_, N> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { child, offsets, rhs, mut target } = self;
        let (rows, shape) = (child.rows(), child.shape::<N>());
        let stride = shape.update_stride();
        let update = &child.update.slice()[..shape.update_size()];
        let top = shape.pivots - shape.update_row();
        let range =
            target.first_column..target.first_column + target.columns.len() / target.stride.max(1);
        let to = |k: usize| offsets.of(rows[k]) as usize;
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
                            at(&mut target, row, column + c).and_then(|t| t.get_mut(..length)),
                        ) {
                            add_rows(lanes, source, target);
                        }
                    }
                } else {
                    for k in (0..length).filter(|k| range.contains(&(row + k))) {
                        let Some(target) = at(&mut target, column, row + k) else { continue };
                        for c in 0..N {
                            target[c] += update[source + c * stride + k];
                        }
                    }
                }
                a = end;
            }
            for c in 0..if is_here { N } else { 0 } {
                let from = (b * N + c) * stride + top + rows.len() * N;
                if let Some(target) = at(&mut target, rhs, column + c) {
                    target[0] += update[from];
                }
            }
        }
    }
}

/// From the front's row `row` of its column `column` down.
#[inline(always)]
fn at<'t>(target: &'t mut Target<'_>, row: usize, column: usize) -> Option<&'t mut [f64]> {
    let column = column - target.first_column;
    target.columns.get_mut(column * target.stride + row - target.first_row..)
}
