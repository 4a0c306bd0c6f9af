//! A subtree in one task: node after node, update matrices on two stacks.
//! It knows nothing of other subtrees; what it leaves is its panels and its root's update matrix.

use super::columns::{cholesky, strips};
use super::front::{Lift, fill, whole_panel, whole_update};
use super::kernels::{BadPivot, Downdate, Source, Start, Target};
use super::numeric::Numeric;

/// Fronts of fewer flops are done without asking whether to go on.
const SOME_FLOPS: f64 = 1e5;

impl Numeric<'_> {
    /// The subtree under `root` with its part of the factor and of the space.
    pub(super) fn sweep(
        &self,
        root: u32,
        factor: &mut [f64],
        space: &mut [f64],
    ) -> Result<(), BadPivot> {
        let root_node = self.node(root);
        let base = self.node(root_node.first_node).panel;
        let (mut own, mut other) = space.split_at_mut(root_node.space[0]);
        let mut is_odd = root_node.is_odd;
        for node in &self.plan.nodes[root_node.first_node as usize..=root as usize] {
            if node.shape().flops() > SOME_FLOPS && self.interrupt.is_due() {
                return Ok(());
            }
            if node.is_odd != is_odd {
                std::mem::swap(&mut own, &mut other);
                is_odd = node.is_odd;
            }
            let panel = &mut factor[node.panel - base..][..node.panel_size()];
            let rest = &mut own[node.update..][..node.update_size()];
            fill(self, node, panel);
            let lift = |target: Target<'_>| {
                let Target { columns, stride, first_row, first_column } = target;
                for &child in self.plan.children_of(node) {
                    let child = self.node(child);
                    let update = &other[child.update..][..child.update_size()];
                    let target = Target { columns: &mut *columns, stride, first_row, first_column };
                    self.class.run(Lift { child, update, runs: self.lifts(child), target });
                }
            };
            lift(whole_panel(node, panel));
            cholesky(self.class, panel, (node.stride, node.pivots), false, self.interrupt)
                .map_err(|bad| bad.after(node.first))?;
            if !rest.is_empty() {
                let source = Source { columns: panel, stride: node.stride };
                let (stride, first_row) = (node.update_stride(), node.update_row());
                let alone = (None, self.interrupt);
                strips((stride, node.pivots), rest, alone, |first_column, columns| {
                    let target = Target { columns, stride, first_row, first_column };
                    self.class.run(Downdate { source, start: Start::Zero, target });
                });
                lift(whole_update(node, rest));
            }
        }
        Ok(())
    }
}
