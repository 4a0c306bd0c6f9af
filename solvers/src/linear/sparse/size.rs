//! What a sparse factorization allocates, from the column heights alone: no rows are listed.
//!
//! Nodes are those of the plan, so panels and update matrices are counted exactly; lists of indices
//! are bounded from above. Memory and time are linear in the blocks, whatever the fill.

use super::super::ordering::{Elimination, NO_PARENT};
use super::super::pattern::BlockPattern;
use super::plan::{Entry, Node, Plan, Run, children, range};
use super::shape::Shape;
use super::supernodes::{FRONT, amalgamate};

/// Bytes of an index list's growth: a vector doubles, and stands beside its former self meanwhile.
const GROWTH: u64 = 2;

/// Bytes of planning and factoring on `pattern` in the postordered `order`.
pub(in super::super) fn bytes(
    pattern: &BlockPattern,
    order: &[u32],
    elimination: &Elimination,
) -> u64 {
    let sizes: Vec<usize> = order.iter().map(|&b| pattern.sizes()[b as usize]).collect();
    let supernodes = amalgamate(&sizes, elimination, FRONT);
    let (children, child_starts, roots) = children(&supernodes.parents);
    let mut plan = Plan { roots, children, ..Plan::default() };
    let mut listed_rows = 0_u64;
    for (s, blocks) in supernodes.blocks.iter().enumerate() {
        let placed = &supernodes.order[blocks.clone()];
        let pivots: usize = placed.iter().map(|&k| sizes[k as usize]).sum();
        // A node's last block is its top, whose structure is that of the node.
        let Some(&top) = placed.last() else { continue };
        let rows = pivots + elimination.heights[top as usize];
        listed_rows += u64::from(elimination.block_heights[top as usize]);
        let shape = Shape::new(pivots, rows, 0);
        let child_nodes = child_starts[s]..child_starts[s + 1];
        let mut node = Node {
            pivots,
            rows,
            stride: shape.stride,
            flops: shape.flops(),
            first_node: s as u32,
            parent: supernodes.parents[s],
            children: range(child_nodes.start, child_nodes.end),
            ..Node::default()
        };
        for &child in &plan.children[child_nodes] {
            node.flops += plan.nodes[child as usize].flops;
        }
        plan.factor_size += shape.panel_size();
        plan.longest = plan.longest.max(shape.stride);
        plan.nodes.push(node);
    }
    plan.place_updates();
    let numbers = plan.factor_size + plan.space + plan.longest + pattern.dimension();
    let [entry, run, node] = [size_of::<Entry>(), size_of::<Run>(), size_of::<Node>()];
    let (stored, nodes) = (pattern.stored_block_count() as u64, plan.nodes.len() as u64);
    let blocks = pattern.block_count() as u64;
    // Pairs and rows of the structure, their runs in both directions, at most one a row.
    let lists = listed_rows * (8 * GROWTH + 4 + 2 * GROWTH * run as u64)
        + stored * (2 * entry as u64 + 8 + 12)
        + nodes * (node as u64 + 64)
        + blocks * 64
        + pattern.dimension() as u64 * 8;
    8 * numbers as u64 + lists
}

/// A node without a parent is its own root; here so that `Node` has a default.
impl Default for Node {
    fn default() -> Self {
        Self {
            first: 0,
            pivots: 0,
            rows: 0,
            stride: 0,
            panel: 0,
            update: 0,
            is_odd: false,
            space: [0; 3],
            is_branch: false,
            flops: 0.0,
            first_node: 0,
            parent: NO_PARENT,
            children: 0..0,
            entries: 0..0,
            row_runs: 0..0,
            lifts: 0..0,
        }
    }
}
