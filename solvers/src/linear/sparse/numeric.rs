//! The numeric factorization: fronts are filled, factored and handed up the elimination tree.
//!
//! Multifrontal (Duff and Reid, "The multifrontal solution of indefinite sparse symmetric linear equations",
//! 1983): a node's panel takes the matrix's blocks and its children's updates, is factored, makes its update
//! matrix −L₂₁L₂₁ᵀ, and that takes what is left of its children's. Subtrees of little work are swept by one
//! task, update matrices on two stacks. Above them, subtrees run in parallel and a front's columns are dealt
//! out in strips. Each element has one owner and one order of operations, so the bits do not depend on the
//! number of threads. The order of elimination follows the plan.

use super::columns::{COLUMNS_PER_TASK, Cut, PARALLEL_FLOPS, clear, eliminate};
use super::front::{Lift, fill};
use super::kernels::{BadPivot, Target};
use super::plan::{Node, Plan, Run};
use crate::interrupt::Interrupt;
use crate::simd::{Class, WIDTH};

/// Fronts of fewer flops are eliminated without a check of the interrupt.
const SOME_FLOPS: f64 = 1e5;

/// A factorization under way.
#[derive(Clone, Copy)]
pub(super) struct Numeric<'a> {
    pub(super) plan: &'a Plan,
    pub(super) values: &'a [f64],
    /// D in the caller's order, or empty.
    pub(super) added: &'a [f64],
    pub(super) class: Class,
    /// Where it is due, what is done so far is left as it is, without an error.
    pub(super) interrupt: &'a Interrupt,
    /// Whether there is more than one thread.
    pub(super) is_parallel: bool,
}

/// A subtree with its part of the factor and of the space for update matrices.
struct Task<'s> {
    root: u32,
    factor: &'s mut [f64],
    space: &'s mut [f64],
}

/// A branch with its panel.
struct Link<'s> {
    s: u32,
    panel: &'s mut [f64],
    /// Where its children begin among the tasks; the link below is left out.
    first_task: usize,
}

impl<'a> Numeric<'a> {
    /// Factors all trees into `factor`, with `space` for update matrices.
    pub(super) fn run(&self, factor: &mut [f64], space: &mut [f64]) -> Result<(), BadPivot> {
        let mut tasks = Vec::with_capacity(self.plan.roots.len());
        self.deal(&self.plan.roots, None, factor, space, &mut tasks);
        self.forest(&mut tasks)
    }

    fn node(&self, s: u32) -> &'a Node {
        &self.plan.nodes[s as usize]
    }

    fn lifts(&self, child: &Node) -> &'a [Run] {
        &self.plan.lifts[child.lifts.start as usize..child.lifts.end as usize]
    }

    /// A task for each of some siblings, whose memory `factor` and `space` are, in order. The one
    /// that is `left_out` has no space here; its part of the factor is returned, and what is left
    /// of the space.
    fn deal<'s>(
        &self,
        roots: &[u32],
        left_out: Option<u32>,
        mut factor: &'s mut [f64],
        mut space: &'s mut [f64],
        tasks: &mut Vec<Task<'s>>,
    ) -> (&'s mut [f64], &'s mut [f64]) {
        let mut kept: &mut [f64] = &mut [];
        for &root in roots {
            let node = self.node(root);
            let panels = node.panel + node.shape.panel_size() - self.node(node.first_node).panel;
            let (own_factor, rest) = factor.split_at_mut(panels);
            factor = rest;
            if left_out == Some(root) {
                kept = own_factor;
                continue;
            }
            let (own_space, rest) = space.split_at_mut(node.whole_space());
            space = rest;
            tasks.push(Task { root, factor: own_factor, space: own_space });
        }
        (kept, space)
    }

    /// Independent subtrees.
    fn forest(&self, tasks: &mut [Task<'_>]) -> Result<(), BadPivot> {
        let flops: f64 = tasks.iter().map(|task| self.node(task.root).flops).sum();
        if tasks.len() < 2 || !self.is_parallel || flops < PARALLEL_FLOPS {
            return tasks.iter_mut().try_for_each(|Task { root, factor, space }| {
                match self.node(*root).is_branch {
                    true => self.branches(*root, factor, space),
                    false => self.sweep(*root, factor, space),
                }
            });
        }
        let (mut middle, mut left_flops) = (0, 0.0);
        while middle + 1 < tasks.len() && left_flops < 0.5 * flops {
            left_flops += self.node(tasks[middle].root).flops;
            middle += 1;
        }
        let (left, right) = tasks.split_at_mut(middle);
        let (left, right) = rayon::join(|| self.forest(left), || self.forest(right));
        left.and(right)
    }

    /// A branch with the branches under it, down to the first with more than one branch below.
    ///
    /// The subtrees below them are eliminated first, then the branches, bottom up. So the depth of
    /// recursion is bounded by the number of branches side by side, not by the height of the tree.
    fn branches(&self, top: u32, factor: &mut [f64], space: &mut [f64]) -> Result<(), BadPivot> {
        let (mut tasks, mut links) = (Vec::new(), Vec::new());
        let [own, other, _] = self.node(top).space;
        let (mut own, rest) = space.split_at_mut(own);
        let (mut other, mut space) = rest.split_at_mut(other);
        let (mut factor, mut next) = (factor, Some(top));
        while let Some(s) = next {
            let node = self.node(s);
            let (below, panel) = factor.split_at_mut(factor.len() - node.shape.panel_size());
            links.push(Link { s, panel, first_task: tasks.len() });
            next = self.plan.next_branch(s as usize);
            let children = self.plan.children.of(s as usize);
            (factor, space) = self.deal(children, next, below, space, &mut tasks);
        }
        self.forest(&mut tasks)?;
        // The top's update matrix belongs into its own space, so every other one does.
        if links.len().is_multiple_of(2) {
            std::mem::swap(&mut own, &mut other);
        }
        let mut below: Option<&Node> = None;
        let mut end = tasks.len();
        for Link { s, panel, first_task } in links.into_iter().rev() {
            let node = self.node(s);
            let updates = tasks[first_task..end].iter().map(|task| (task.root, &*task.space));
            let updates = updates.map(|(root, space)| (self.node(root), space));
            let updates: Vec<(&Node, &[f64])> = updates
                .chain(below.map(|child| (child, &*other)))
                .map(|(child, space)| (child, &space[..child.shape.update_size()]))
                .collect();
            let update = &mut own[..node.shape.update_size()];
            let is_dealt = self.is_parallel && node.shape.flops() > PARALLEL_FLOPS;
            self.front(s, updates.iter().copied(), panel, update, is_dealt)?;
            std::mem::swap(&mut own, &mut other);
            (below, end) = (Some(node), first_task);
        }
        Ok(())
    }

    /// The subtree under `root` in one task, with its part of the factor and of the space.
    fn sweep(&self, root: u32, factor: &mut [f64], space: &mut [f64]) -> Result<(), BadPivot> {
        let root_node = self.node(root);
        let base = self.node(root_node.first_node).panel;
        let (mut own, mut other) = space.split_at_mut(root_node.space[0]);
        let mut is_odd = root_node.is_odd;
        for s in root_node.first_node..=root {
            let node = self.node(s);
            if node.shape.flops() > SOME_FLOPS && self.interrupt.is_due() {
                return Ok(());
            }
            if node.is_odd != is_odd {
                std::mem::swap(&mut own, &mut other);
                is_odd = node.is_odd;
            }
            let panel = &mut factor[node.panel - base..][..node.shape.panel_size()];
            let update = &mut own[node.update..][..node.shape.update_size()];
            let other = &*other;
            let children = self.plan.children.of(s as usize).iter().map(|&child| {
                let child = self.node(child);
                (child, &other[child.update..][..child.shape.update_size()])
            });
            self.front(s, children, panel, update, false)?;
        }
        Ok(())
    }

    /// One front from the matrix and the `children` with their update matrices: its panel is
    /// factored, then its own update matrix is made. `is_dealt` says whether strips of columns go to
    /// tasks.
    fn front<'c>(
        &self,
        s: u32,
        children: impl Iterator<Item = (&'c Node, &'c [f64])> + Clone + Sync,
        panel: &mut [f64],
        update: &mut [f64],
        is_dealt: bool,
    ) -> Result<(), BadPivot> {
        let node = self.node(s);
        // Kernels take eight columns at a time.
        let cut = if is_dealt { Cut::Dealt(COLUMNS_PER_TASK) } else { Cut::InTurn(WIDTH) };
        let lift = |target: Target<'_>| {
            let Target { columns, stride, first_row, first_column } = target;
            for (child, update) in children.clone() {
                let target = Target { columns: &mut *columns, stride, first_row, first_column };
                let runs = self.lifts(child);
                self.class.run(Lift { shape: child.shape, update, runs, target });
            }
        };
        clear(node.shape.stride, panel, cut, self.interrupt);
        fill(self.plan, s as usize, self.values, self.added, panel, self.interrupt);
        eliminate(self.class, node.shape, panel, update, cut, self.interrupt, lift)
            .map_err(|bad| bad.after(node.first))
    }
}
