//! Work and span of a factorization: its flops, and those of the longest chain of steps that wait for each
//! other.
//!
//! Work over span bounds how many threads can help (Brent, "The parallel evaluation of general arithmetic
//! expressions", 1974). The steps are those of `numeric` and `columns`; memory and the dealing out of tasks
//! are not counted. Structure only: no values are seen.

use super::columns::{COLUMNS_PER_TASK, DEALT_PANEL, PARALLEL_FLOPS};
use super::plan::Plan;
use super::shape::Shape;

/// Flops of the longest chain of steps.
pub(super) fn span(plan: &Plan) -> f64 {
    let mut longest = vec![0.0; plan.nodes.len()];
    for (s, node) in plan.nodes.iter().enumerate() {
        // What is no branch is swept by one task.
        if !node.is_branch {
            longest[s] = node.flops;
            continue;
        }
        // A line of branches waits for all subtrees that hang on it.
        let (mut line, mut below, mut next) = (0.0, 0.0, Some(s as u32));
        while let Some(link) = next {
            let link = link as usize;
            next = plan.next_branch(link);
            line += of_front(plan.nodes[link].shape);
            let others = plan.children.of(link).iter().filter(|&&child| Some(child) != next);
            below = others.fold(below, |most: f64, &child| most.max(longest[child as usize]));
        }
        longest[s] = below + line;
    }
    plan.roots.iter().map(|&root| longest[root as usize]).fold(0.0, f64::max)
}

/// Of a front: panels follow each other, each with the strip that is updated last.
fn of_front(shape: Shape) -> f64 {
    let flops = shape.flops();
    if flops <= PARALLEL_FLOPS {
        return flops;
    }
    let strip = COLUMNS_PER_TASK as f64;
    let panels = (0..shape.pivots).step_by(DEALT_PANEL).map(|first| {
        let width = DEALT_PANEL.min(shape.pivots - first) as f64;
        let rows = (shape.rows - first) as f64;
        width * rows * (width + 2.0 * strip)
    });
    let below = (shape.rows - shape.pivots) as f64;
    let update = 2.0 * strip.min(below) * below * shape.pivots as f64;
    (panels.sum::<f64>() + update).min(flops)
}
