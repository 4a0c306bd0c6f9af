//! The numeric factorization: fronts are filled, factored and handed up the elimination tree.
//!
//! Multifrontal (Duff and Reid, "The multifrontal solution of indefinite sparse symmetric linear
//! equations", 1983): a node's panel takes the matrix's blocks and its children's updates, is
//! factored, makes its update matrix −L₂₁L₂₁ᵀ, and that takes what is left of its children's.
//! Subtrees of little work are swept by one task. Above them, subtrees run in parallel and a
//! front's columns are dealt out in strips. Each element has one owner and one order of operations,
//! so the bits do not depend on the number of threads.

use super::branch::Updated;
use super::kernels::BadPivot;
use super::plan::{Node, Plan, Run};
use crate::interrupt::Interrupt;
use crate::simd::Class;

/// Work of fewer flops is not dealt out.
pub(super) const PARALLEL_FLOPS: f64 = 1e6;

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
struct Link<'a, 's> {
    node: &'a Node,
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

    pub(super) fn node(&self, s: u32) -> &'a Node {
        &self.plan.nodes[s as usize]
    }

    pub(super) fn lifts(&self, child: &Node) -> &'a [Run] {
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
            let panels = node.panel + node.panel_size() - self.node(node.first_node).panel;
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
            return tasks.iter_mut().try_for_each(|task| self.subtree(task));
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

    fn subtree(&self, task: &mut Task<'_>) -> Result<(), BadPivot> {
        let Task { root, factor, space } = task;
        if self.node(*root).is_branch {
            self.branches(*root, factor, space)
        } else {
            self.sweep(*root, factor, space)
        }
    }

    /// A branch with the branches under it, down to the first with more than one branch below.
    ///
    /// What hangs on them is done first, then they are, bottom up: the depth of recursion is
    /// bounded by the number of branches side by side, however long the tree is.
    fn branches(&self, top: u32, factor: &mut [f64], space: &mut [f64]) -> Result<(), BadPivot> {
        let (mut tasks, mut links) = (Vec::new(), Vec::new());
        let [own, other, _] = self.node(top).space;
        let (mut own, rest) = space.split_at_mut(own);
        let (mut other, mut space) = rest.split_at_mut(other);
        let (mut factor, mut next) = (factor, Some(top));
        while let Some(s) = next {
            let node = self.node(s);
            let (below, panel) = factor.split_at_mut(factor.len() - node.panel_size());
            links.push(Link { node, panel, first_task: tasks.len() });
            next = self.plan.next_branch(node);
            let children = self.plan.children_of(node);
            (factor, space) = self.deal(children, next, below, space, &mut tasks);
        }
        self.forest(&mut tasks)?;
        // The top's update matrix belongs into its own space, so every other one does.
        if links.len().is_multiple_of(2) {
            std::mem::swap(&mut own, &mut other);
        }
        let mut below: Option<&Node> = None;
        let mut end = tasks.len();
        for Link { node, panel, first_task } in links.into_iter().rev() {
            let updates = tasks[first_task..end].iter().map(|task| (task.root, &*task.space));
            let updates = updates.map(|(root, space)| (self.node(root), space));
            let updates: Vec<Updated<'_>> = updates
                .chain(below.map(|child| (child, &*other)))
                .map(|(child, space)| (child, &space[..child.update_size()]))
                .collect();
            self.front(node, &updates, panel, &mut own[..node.update_size()])?;
            std::mem::swap(&mut own, &mut other);
            (below, end) = (Some(node), first_task);
        }
        Ok(())
    }
}
