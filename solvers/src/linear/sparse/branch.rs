//! A front of enough work to be dealt out: its columns go to tasks in strips.
//!
//! The operations on an element and their order are those of a sweep.

use rayon::prelude::*;

use super::front::{Lift, fill};
use super::kernels::{BadPivot, Downdate, Factor, Source, Start, Target};
use super::numeric::{Numeric, PARALLEL_FLOPS};
use super::plan::Node;

/// Columns that a task updates at a time.
const COLUMNS_PER_TASK: usize = 24;

/// Columns of the panel that are factored at a time, so that updates are soon in parallel.
const BRANCH_PANEL: usize = 32;

/// A child with its update matrix.
pub(super) type Updated<'a> = (&'a Node, &'a [f64]);

impl Numeric<'_> {
    /// A branch's own front, once its children are done.
    pub(super) fn front(
        &self,
        node: &Node,
        children: &[Updated<'_>],
        panel: &mut [f64],
        update: &mut [f64],
    ) -> Result<(), BadPivot> {
        let class = self.class;
        let parallel = self.is_parallel && node.own_flops() > PARALLEL_FLOPS;
        let lift = |target: Target<'_>| {
            let Target { columns, stride, first_row, first_column } = target;
            for (child, update) in children {
                let target = Target { columns: &mut *columns, stride, first_row, first_column };
                class.run(Lift { child, update, runs: self.lifts(child), target });
            }
        };
        fill(self, node, panel);
        let stride = node.stride;
        strips(stride, 0, panel, parallel, |first_column, columns| {
            lift(Target { columns, stride, first_row: 0, first_column });
        });
        let mut first = 0;
        while first < node.pivots {
            let end = (first + BRANCH_PANEL).min(node.pivots);
            let (head, rest) = panel.split_at_mut(end * stride);
            let columns = &mut head[first * stride..];
            class
                .run(Factor { columns: &mut *columns, stride, first })
                .map_err(|bad| BadPivot { column: node.first + bad.column, ..bad })?;
            let source = Source { columns, stride };
            strips(stride, end, rest, parallel, |first_column, columns| {
                let target = Target { columns, stride, first_row: 0, first_column };
                class.run(Downdate { source, start: Start::Target, target });
            });
            first = end;
        }
        let source = Source { columns: panel, stride };
        let (stride, first_row) = (node.update_stride(), node.update_row());
        strips(stride, node.pivots, update, parallel, |first_column, columns| {
            let target = Target { columns: &mut *columns, stride, first_row, first_column };
            class.run(Downdate { source, start: Start::Zero, target });
            lift(Target { columns, stride, first_row, first_column });
        });
        Ok(())
    }
}

/// Runs `work` on strips of columns from column `first` on.
fn strips(
    stride: usize,
    first: usize,
    columns: &mut [f64],
    parallel: bool,
    work: impl Fn(usize, &mut [f64]) + Sync,
) {
    if columns.is_empty() {
        return;
    }
    if !parallel {
        work(first, columns);
        return;
    }
    columns
        .par_chunks_mut(COLUMNS_PER_TASK * stride)
        .enumerate()
        .for_each(|(k, strip)| work(first + k * COLUMNS_PER_TASK, strip));
}
