//! The numbers of a growing system's fronts: terms, children's update matrices, elimination.
//!
//! A child's rows may stand in another order than here: its update matrix is added block by block,
//! transposed where need be. The kernels are those of the factorization that does not grow.

use super::terms::Terms;
use super::top::{Planned, Top};
use super::tree::{NONE, Node, Shape, Tree};
use crate::linear::LinearError;
use crate::linear::sparse::front::add_rows;
use crate::linear::sparse::kernels::{Downdate, Factor, PANEL, Source, Start, Target};
use crate::simd::{Class, Kernel, Lanes};

impl Tree {
    /// Makes the planned nodes and hangs up the subtrees that stay. `weight` takes √H.
    pub(super) fn eliminate<const N: usize>(
        &mut self,
        terms: &Terms<N>,
        top: Top,
        class: Class,
        weight: &mut [f64],
    ) -> Result<(), LinearError> {
        let mut numbers: Vec<u32> = Vec::with_capacity(top.nodes.len());
        let parents: Vec<u32> = top.nodes.iter().map(|node| node.parent).collect();
        let mut children: Vec<Vec<u32>> = Vec::with_capacity(top.nodes.len());
        children.resize_with(top.nodes.len(), Vec::new);
        for (s, planned) in top.nodes.into_iter().enumerate() {
            let mut below = std::mem::take(&mut children[s]);
            below.extend_from_slice(&planned.orphans);
            let number = self.make(terms, planned, below, class, weight)?;
            match parents[s] {
                NONE => self.roots.push(number),
                parent => children[parent as usize].push(number),
            }
            numbers.push(number);
        }
        Ok(())
    }

    /// Makes one node with its children.
    fn make<const N: usize>(
        &mut self,
        terms: &Terms<N>,
        planned: Planned,
        children: Vec<u32>,
        class: Class,
        weight: &mut [f64],
    ) -> Result<u32, LinearError> {
        let Planned { pivots, rows, .. } = planned;
        let shape = Shape::new(pivots.len() * N, rows.len() * N);
        let dimension = terms.block_count() * N;
        let memory = || LinearError::OutOfMemory { dimension };
        let mut panel = self.take(shape.panel_size()).ok_or_else(memory)?;
        let mut update = self.take(shape.update_size()).ok_or_else(memory)?;
        let panel_values = &mut panel.slice_mut()[..shape.panel_size()];
        let update_values = &mut update.slice_mut()[..shape.update_size()];
        panel_values.fill(0.0);
        for (k, &block) in pivots.iter().chain(&rows).enumerate() {
            self.local[block as usize] = (k * N) as u32;
        }
        fill(terms, &pivots, &self.local, shape, panel_values, weight);
        let lifts = |panel: Option<&mut [f64]>, update: Option<&mut [f64]>| {
            let mut front = Front { shape, panel, update };
            for child in children.iter().filter_map(|&child| self.node(child)) {
                let local = &self.local;
                class.run(Lift::<N> { child, local, front: &mut front });
            }
        };
        lifts(Some(&mut *panel_values), None);
        let outcome = factor(class, shape, panel_values).map_err(|(column, is_finite)| {
            let block = pivots[column / N] as usize;
            if is_finite {
                LinearError::NotPositiveDefinite { block, scalar: block * N + column % N }
            } else {
                LinearError::NonFinite { block }
            }
        });
        if outcome.is_ok() && !update_values.is_empty() {
            let target = Target {
                columns: &mut *update_values,
                stride: shape.update_stride(),
                first_row: shape.update_row(),
                first_column: shape.pivots,
            };
            let source = Source { columns: panel_values, stride: shape.stride };
            class.run(Downdate { source, start: Start::Zero, target });
            lifts(None, Some(&mut *update_values));
        }
        for &block in pivots.iter().chain(&rows) {
            self.local[block as usize] = NONE;
        }
        outcome?;
        let solved = panel_values.chunks_exact(shape.stride).map(|column| column[shape.rows]);
        let decrease = solved.map(|y| 0.5 * y * y).sum();
        let (parent, is_new) = (NONE, true);
        let node = Node { pivots, rows, parent, children, panel, update, is_new, decrease };
        let number = self.insert(node);
        self.adopt(number);
        Ok(number)
    }

    /// Tells a new node's children and pivots where they belong.
    fn adopt(&mut self, number: u32) {
        let Some(node) = self.node_mut(number) else { return };
        let children = std::mem::take(&mut node.children);
        let pivots = std::mem::take(&mut node.pivots);
        for &child in &children {
            if let Some(child) = self.node_mut(child) {
                child.parent = number;
            }
        }
        for &pivot in &pivots {
            self.node_of[pivot as usize] = number;
        }
        if let Some(node) = self.node_mut(number) {
            (node.children, node.pivots) = (children, pivots);
        }
    }
}

/// The terms of the pivots into a panel of zeros; `local` says where a block of this front begins.
fn fill<const N: usize>(
    terms: &Terms<N>,
    pivots: &[u32],
    local: &[u32],
    Shape { rows, stride, .. }: Shape,
    panel: &mut [f64],
    weight: &mut [f64],
) {
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
            let Some(&at) = local.get(other as usize) else { continue };
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
        for c in 0..N {
            weight[pivot as usize * N + c] = panel[(first + c) * (stride + 1)].max(0.0).sqrt();
        }
    }
}

/// Cholesky of a panel; an error is the column and whether its pivot is finite.
fn factor(class: Class, shape: Shape, panel: &mut [f64]) -> Result<(), (usize, bool)> {
    let stride = shape.stride;
    let mut first = 0;
    while first < shape.pivots {
        let end = (first + PANEL).min(shape.pivots);
        let (head, rest) = panel.split_at_mut(end * stride);
        let columns = &mut head[first * stride..];
        class
            .run(Factor { columns: &mut *columns, stride, first })
            .map_err(|bad| (bad.column, bad.is_finite))?;
        if !rest.is_empty() {
            let source = Source { columns, stride };
            let target = Target { columns: rest, stride, first_row: 0, first_column: end };
            class.run(Downdate { source, start: Start::Target, target });
        }
        first = end;
    }
    Ok(())
}

/// The half of a front that is being added to: its panel or its update matrix.
struct Front<'a> {
    shape: Shape,
    panel: Option<&'a mut [f64]>,
    update: Option<&'a mut [f64]>,
}

impl Front<'_> {
    /// From row `row` of column `column` down, or `None` in the other half.
    #[inline(always)]
    fn at(&mut self, row: usize, column: usize) -> Option<&mut [f64]> {
        let shape = self.shape;
        if column < shape.pivots {
            self.panel.as_mut()?.get_mut(column * shape.stride + row..)
        } else {
            let (row, column) = (row - shape.update_row(), column - shape.pivots);
            self.update.as_mut()?.get_mut(column * shape.update_stride() + row..)
        }
    }
}

/// Adds a child's update matrix, and its right-hand side, to half of a front.
struct Lift<'a, 'f, const N: usize> {
    child: &'a Node,
    local: &'a [u32],
    front: &'a mut Front<'f>,
}

impl<const N: usize> Kernel for Lift<'_, '_, N> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { child, local, front } = self;
        let shape = child.shape::<N>();
        let stride = shape.update_stride();
        let update = &child.update.slice()[..shape.update_size()];
        let top = shape.pivots - shape.update_row();
        let rows = &child.rows;
        let to = |k: usize| local[rows[k] as usize] as usize;
        for b in 0..rows.len() {
            let column = to(b);
            let is_panel = column < front.shape.pivots;
            let mut a = b;
            while a < rows.len() {
                // Blocks that stand side by side in both.
                let row = to(a);
                let mut end = a + 1;
                while end < rows.len() && to(end) == row + (end - a) * N {
                    end += 1;
                }
                let source = b * N * stride + top + a * N;
                if row >= column {
                    let length = (end - a) * N;
                    if front.panel.is_some() == is_panel {
                        for c in 0..N {
                            if let (Some(source), Some(target)) = (
                                update.get(source + c * stride..).and_then(|s| s.get(..length)),
                                front.at(row, column + c).and_then(|t| t.get_mut(..length)),
                            ) {
                                add_rows(lanes, source, target);
                            }
                        }
                    }
                } else {
                    for k in 0..end - a {
                        let row = row + k * N;
                        if front.panel.is_some() != (row < front.shape.pivots) {
                            continue;
                        }
                        for r in 0..N {
                            let Some(target) = front.at(column, row + r) else { continue };
                            for c in 0..N {
                                target[c] += update[source + c * stride + k * N + r];
                            }
                        }
                    }
                }
                a = end;
            }
            if front.panel.is_some() == is_panel {
                for c in 0..N {
                    let from = (b * N + c) * stride + top + rows.len() * N;
                    let rhs = front.shape.rows;
                    if let Some(target) = front.at(rhs, column + c) {
                        target[0] += update[from];
                    }
                }
            }
        }
    }
}
