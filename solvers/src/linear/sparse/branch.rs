//! A front of enough work to be dealt out: its columns go to tasks in strips.
//!
//! The operations on an element and their order are those of a sweep.

use super::columns::{COLUMNS_PER_TASK, cholesky, strips};
use super::front::{Lift, fill};
use super::kernels::{BadPivot, Downdate, Source, Start, Target};
use super::numeric::{Numeric, PARALLEL_FLOPS};
use super::plan::Node;

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
        let parallel = self.is_parallel && node.shape().flops() > PARALLEL_FLOPS;
        let strip = (parallel.then_some(COLUMNS_PER_TASK), self.interrupt);
        let lift = |target: Target<'_>| {
            let Target { columns, stride, first_row, first_column } = target;
            for (child, update) in children {
                let target = Target { columns: &mut *columns, stride, first_row, first_column };
                class.run(Lift { child, update, runs: self.lifts(child), target });
            }
        };
        fill(self, node, panel);
        let stride = node.stride;
        strips((stride, 0), panel, strip, |first_column, columns| {
            lift(Target { columns, stride, first_row: 0, first_column });
        });
        cholesky(class, panel, (stride, node.pivots), parallel, self.interrupt)
            .map_err(|bad| bad.after(node.first))?;
        let source = Source { columns: panel, stride };
        let (stride, first_row) = (node.update_stride(), node.update_row());
        strips((stride, node.pivots), update, strip, |first_column, columns| {
            let target = Target { columns: &mut *columns, stride, first_row, first_column };
            class.run(Downdate { source, start: Start::Zero, target });
            lift(Target { columns, stride, first_row, first_column });
        });
        Ok(())
    }
}
