//! The symbolic plan of a sparse factorization: nodes, scatter maps, memory. It holds no values.
//!
//! A node is a supernode: pivot columns with one list of rows. Its front is the dense lower
//! trapezoid over pivots and rows; the pivot columns (the panel) become the factor, the rest (the
//! update matrix) is added into the parent's front. Nodes stand in postorder, so a subtree's panels
//! are contiguous and its update matrices live on two stacks, one for even and one for odd depths:
//! a node pushes on one what it makes of its children's on top of the other.
//! Subtrees of enough work are branches, whose children may be eliminated in parallel; the cut
//! depends on the structure only.

use std::ops::Range;

use super::super::error::LinearError;
use super::super::ordering::{Elimination, NO_PARENT, earlier_neighbors};
use super::super::pattern::BlockPattern;
use super::shape::Shape;
use super::supernodes::{FRONT, Placed, Supernodes, amalgamate};

/// A subtree is a branch if it has at least this share of all flops, and at least so many.
const BRANCH_SHARE: f64 = 1.0 / 32.0;
const BRANCH_FLOPS: f64 = 2e6;

/// A stored block's way into its front.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    /// First value in the matrix.
    pub(super) source: u32,
    /// First element in the panel.
    pub(super) target: u32,
    /// Rows and columns as stored.
    pub(super) rows: u16,
    pub(super) columns: u16,
    /// Whether the block stands above the diagonal in elimination order.
    pub(super) is_transposed: bool,
}

/// Rows that are contiguous in two places.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    pub(super) from: u32,
    pub(super) to: u32,
    pub(super) length: u32,
}

/// A supernode.
#[derive(Debug, Clone)]
pub(super) struct Node {
    /// First pivot, a scalar in elimination order.
    pub(super) first: usize,
    /// Pivots.
    pub(super) pivots: usize,
    /// Pivots and rows below them.
    pub(super) rows: usize,
    /// From one column of the panel to the next.
    pub(super) stride: usize,
    /// Where the panel begins in the factor.
    pub(super) panel: usize,
    /// Where the update matrix begins on its stack.
    pub(super) update: usize,
    /// Which stack, relative to other nodes.
    pub(super) is_odd: bool,
    /// Memory for the update matrices of the subtree, this one at its beginning: the own stack, the
    /// other one, and, under a branch, what hangs on it.
    pub(super) space: [usize; 3],
    pub(super) is_branch: bool,
    /// Flops of the subtree.
    pub(super) flops: f64,
    /// First node of the subtree.
    pub(super) first_node: u32,
    pub(super) parent: u32,
    /// Into [`Plan::children`], [`Plan::entries`], [`Plan::rows`] and [`Plan::lifts`].
    pub(super) children: Range<u32>,
    pub(super) entries: Range<u32>,
    pub(super) row_runs: Range<u32>,
    pub(super) lifts: Range<u32>,
}

impl Node {
    pub(super) fn shape(&self) -> Shape {
        Shape { pivots: self.pivots, rows: self.rows, stride: self.stride }
    }

    pub(super) fn update_row(&self) -> usize {
        self.shape().update_row()
    }

    pub(super) fn update_stride(&self) -> usize {
        self.shape().update_stride()
    }

    pub(super) fn update_size(&self) -> usize {
        self.shape().update_size()
    }

    /// Elements of the memory for update matrices of the subtree.
    pub(super) fn whole_space(&self) -> usize {
        self.space.iter().sum()
    }

    pub(super) fn panel_size(&self) -> usize {
        self.shape().panel_size()
    }
}

/// What a sparse factorization keeps from planning.
#[derive(Debug, Default)]
pub(super) struct Plan {
    /// `scalars[k]` is the caller's scalar that is eliminated k-th.
    pub(super) scalars: Vec<u32>,
    pub(super) nodes: Vec<Node>,
    /// Nodes without a parent.
    pub(super) roots: Vec<u32>,
    pub(super) children: Vec<u32>,
    pub(super) entries: Vec<Entry>,
    /// Rows below the pivots, from the front to the scalars in elimination order.
    pub(super) rows: Vec<Run>,
    /// Rows below the pivots, from the update matrix's columns to the parent's front.
    pub(super) lifts: Vec<Run>,
    /// Elements of all panels.
    pub(super) factor_size: usize,
    /// Elements of the memory for update matrices.
    pub(super) space: usize,
    /// The longest column of a front.
    pub(super) longest: usize,
}

impl Plan {
    /// Plans for the postordered elimination order `order` with its `elimination`.
    pub(super) fn new(
        pattern: &BlockPattern,
        order: &[u32],
        elimination: &Elimination,
    ) -> Result<Self, LinearError> {
        let dimension = pattern.dimension();
        let too_large = LinearError::TooLarge { dimension };
        if u32::try_from(pattern.value_count()).is_err()
            || pattern.sizes().iter().any(|&size| size > usize::from(u16::MAX))
        {
            return Err(too_large);
        }
        let sizes: Vec<usize> = order.iter().map(|&b| pattern.sizes()[b as usize]).collect();
        let supernodes = amalgamate(&sizes, elimination, FRONT);
        let builder = Builder::new(pattern, order, &supernodes);
        builder.build(pattern, &supernodes).ok_or(too_large)
    }
}

/// Index work on the way to a plan; blocks are numbered by their position in the final order.
struct Builder {
    position: Vec<u32>,
    sizes: Vec<usize>,
    /// First scalar of each block in elimination order.
    offsets: Vec<usize>,
    scalars: Vec<u32>,
    node_of: Vec<u32>,
    /// Blocks below the pivots of each node, ascending.
    row_starts: Vec<usize>,
    row_blocks: Vec<u32>,
}

impl Builder {
    fn new(pattern: &BlockPattern, order: &[u32], supernodes: &Supernodes) -> Self {
        let Placed { order, position, node_of } = supernodes.placed(order);
        let count = order.len();
        let sizes: Vec<usize> = order.iter().map(|&b| pattern.sizes()[b as usize]).collect();
        let mut offsets = Vec::with_capacity(count + 1);
        offsets.push(0);
        let mut scalars = Vec::with_capacity(pattern.dimension());
        for (k, &block) in order.iter().enumerate() {
            let start = pattern.offset(block as usize) as u32;
            scalars.extend(start..start + sizes[k] as u32);
            offsets.push(scalars.len());
        }
        let (row_starts, row_blocks) =
            row_structure(pattern, &position, &node_of, &supernodes.parents);
        Self { position, sizes, offsets, scalars, node_of, row_starts, row_blocks }
    }

    fn rows_of(&self, s: usize) -> &[u32] {
        &self.row_blocks[self.row_starts[s]..self.row_starts[s + 1]]
    }

    /// `None` where something does not fit its index.
    fn build(self, pattern: &BlockPattern, supernodes: &Supernodes) -> Option<Plan> {
        let count = supernodes.parents.len();
        let (entry_starts, mut stored) = self.entries_by_node(pattern);
        let (children, child_starts, roots) = children(&supernodes.parents);
        let mut plan = Plan {
            scalars: Vec::new(),
            nodes: Vec::with_capacity(count),
            roots,
            children,
            entries: Vec::with_capacity(stored.len()),
            rows: Vec::new(),
            lifts: Vec::new(),
            factor_size: 0,
            space: 0,
            longest: 0,
        };
        // Where each block stands in the front of the node at hand.
        let mut local = vec![0u32; self.sizes.len()];
        for s in 0..count {
            let blocks = supernodes.blocks[s].clone();
            let first = self.offsets[blocks.start];
            let pivots = self.offsets[blocks.end] - first;
            for block in blocks {
                local[block] = (self.offsets[block] - first) as u32;
            }
            let mut rows = pivots;
            let row_runs = plan.rows.len();
            for &block in self.rows_of(s) {
                let size = self.sizes[block as usize];
                local[block as usize] = rows as u32;
                push_run(&mut plan.rows, row_runs, rows, self.offsets[block as usize], size);
                rows += size;
            }
            let stride = Shape::new(pivots, rows, 0).stride;
            u32::try_from(stride.checked_mul(rows)?).ok()?;
            for block in &mut stored[entry_starts[s]..entry_starts[s + 1]] {
                let (r, c) = (local[block.row as usize], local[block.column as usize]);
                block.entry.target = r + c * stride as u32;
                plan.entries.push(block.entry);
            }
            let child_nodes = child_starts[s]..child_starts[s + 1];
            for &child in &plan.children[child_nodes.clone()] {
                let start = plan.lifts.len();
                let mut from = 0;
                for &block in self.rows_of(child as usize) {
                    let size = self.sizes[block as usize];
                    let to = local[block as usize] as usize;
                    // Pivots and rows of the parent are columns of different targets.
                    let first = if to == pivots { plan.lifts.len() } else { start };
                    push_run(&mut plan.lifts, first, from, to, size);
                    from += size;
                }
                plan.nodes[child as usize].lifts = range(start, plan.lifts.len());
            }
            let mut node = Node {
                first,
                pivots,
                rows,
                stride,
                panel: plan.factor_size,
                update: 0,
                is_odd: false,
                space: [0; 3],
                is_branch: false,
                flops: 0.0,
                first_node: s as u32,
                parent: supernodes.parents[s],
                children: range(child_nodes.start, child_nodes.end),
                entries: range(entry_starts[s], entry_starts[s + 1]),
                row_runs: range(row_runs, plan.rows.len()),
                lifts: 0..0,
            };
            node.flops = node.shape().flops();
            for &child in &plan.children[child_nodes] {
                let child = &plan.nodes[child as usize];
                node.flops += child.flops;
                node.first_node = node.first_node.min(child.first_node);
            }
            plan.factor_size += node.panel_size();
            plan.longest = plan.longest.max(stride);
            plan.nodes.push(node);
        }
        plan.scalars = self.scalars;
        plan.place_updates();
        Some(plan)
    }

    /// The stored blocks by the node of their column; targets are still missing.
    fn entries_by_node(&self, pattern: &BlockPattern) -> (Vec<usize>, Vec<Stored>) {
        let count = self.node_of.last().map_or(0, |&last| last as usize + 1);
        let mut starts = vec![0usize; count + 1];
        let column_of = |i: usize, j: u32| self.position[i].min(self.position[j as usize]);
        for i in 0..pattern.block_count() {
            for &j in pattern.row(i) {
                starts[self.node_of[column_of(i, j) as usize] as usize + 1] += 1;
            }
        }
        for s in 0..count {
            starts[s + 1] += starts[s];
        }
        let mut next = starts.clone();
        let mut stored = vec![Stored::default(); starts[count]];
        for i in 0..pattern.block_count() {
            for (number, &j) in pattern.row_range(i).zip(pattern.row(i)) {
                let (p, q) = (self.position[i], self.position[j as usize]);
                let entry = Entry {
                    source: pattern.value_starts()[number] as u32,
                    target: 0,
                    rows: pattern.sizes()[i] as u16,
                    columns: pattern.sizes()[j as usize] as u16,
                    is_transposed: p < q,
                };
                let slot = &mut next[self.node_of[column_of(i, j) as usize] as usize];
                stored[*slot] = Stored { row: p.max(q), column: p.min(q), entry };
                *slot += 1;
            }
        }
        (starts, stored)
    }
}

/// A stored block in elimination order.
#[derive(Clone, Copy)]
struct Stored {
    row: u32,
    column: u32,
    entry: Entry,
}

impl Default for Stored {
    fn default() -> Self {
        let entry = Entry { source: 0, target: 0, rows: 0, columns: 0, is_transposed: false };
        Self { row: 0, column: 0, entry }
    }
}

pub(super) fn range(start: usize, end: usize) -> Range<u32> {
    start as u32..end as u32
}

/// Appends rows, joining them to the last run since index `first` where both sides continue it.
fn push_run(runs: &mut Vec<Run>, first: usize, from: usize, to: usize, length: usize) {
    if length == 0 {
        return;
    }
    let (from, to, length) = (from as u32, to as u32, length as u32);
    if runs.len() > first
        && let Some(last) = runs.last_mut()
        && last.from + last.length == from
        && last.to + last.length == to
    {
        last.length += length;
        return;
    }
    runs.push(Run { from, to, length });
}

/// Children of each node, ascending: list, starts, and the nodes without a parent.
pub(super) fn children(parents: &[u32]) -> (Vec<u32>, Vec<usize>, Vec<u32>) {
    let count = parents.len();
    let mut starts = vec![0usize; count + 1];
    let mut roots = Vec::new();
    for (s, &parent) in parents.iter().enumerate() {
        if parent == NO_PARENT {
            roots.push(s as u32);
        } else {
            starts[parent as usize + 1] += 1;
        }
    }
    for s in 0..count {
        starts[s + 1] += starts[s];
    }
    let mut next = starts.clone();
    let mut list = vec![0u32; starts[count]];
    for (s, &parent) in parents.iter().enumerate() {
        if parent != NO_PARENT {
            list[next[parent as usize]] = s as u32;
            next[parent as usize] += 1;
        }
    }
    (list, starts, roots)
}

/// Blocks below the pivots of each node: a block is a row of every node on the paths from the
/// nodes of its earlier neighbors up to its own.
pub(super) fn row_structure(
    pattern: &BlockPattern,
    position: &[u32],
    node_of: &[u32],
    parents: &[u32],
) -> (Vec<usize>, Vec<u32>) {
    let (neighbor_starts, neighbors) = earlier_neighbors(pattern, position);
    let mut visited = vec![u32::MAX; parents.len()];
    let mut pairs = Vec::with_capacity(2 * neighbors.len());
    let mut starts = vec![0usize; parents.len() + 1];
    for i in 0..position.len() {
        let own = node_of[i];
        for &neighbor in &neighbors[neighbor_starts[i]..neighbor_starts[i + 1]] {
            let mut s = node_of[neighbor as usize];
            while s != own && s != NO_PARENT && visited[s as usize] != i as u32 {
                visited[s as usize] = i as u32;
                pairs.push((s, i as u32));
                starts[s as usize + 1] += 1;
                s = parents[s as usize];
            }
        }
    }
    for s in 0..parents.len() {
        starts[s + 1] += starts[s];
    }
    let mut next = starts.clone();
    let mut rows = vec![0u32; pairs.len()];
    for (s, block) in pairs {
        rows[next[s as usize]] = block;
        next[s as usize] += 1;
    }
    (starts, rows)
}

impl Plan {
    /// Gives every update matrix its place.
    pub(super) fn place_updates(&mut self) {
        let total: f64 = self.roots.iter().map(|&root| self.nodes[root as usize].flops).sum();
        let least = (BRANCH_SHARE * total).max(BRANCH_FLOPS);
        for s in 0..self.nodes.len() {
            self.nodes[s].is_branch = self.nodes[s].flops >= least;
        }
        // Depths from the roots down, which stand last.
        for s in (0..self.nodes.len()).rev() {
            let parent = self.nodes[s].parent;
            self.nodes[s].is_odd = parent != NO_PARENT && !self.nodes[parent as usize].is_odd;
        }
        // Heights of the two stacks as the subtree at hand is swept, and their maxima.
        let mut heights = [0usize; 2];
        let mut peaks = [0usize; 2];
        for s in 0..self.nodes.len() {
            let node = &self.nodes[s];
            let (own, parent, size) = (usize::from(node.is_odd), node.parent, node.update_size());
            let children = self.children_of(node).iter().map(|&child| &self.nodes[child as usize]);
            if node.is_branch {
                let below: usize = children.map(Node::whole_space).sum();
                self.nodes[s].space = match self.next_branch(node) {
                    // Of a line of branches two update matrices live at a time.
                    Some(next) => {
                        let next = &self.nodes[next as usize];
                        let others = below - next.whole_space();
                        [size.max(next.space[1]), next.space[0], others + next.space[2]]
                    }
                    None => [size, 0, below],
                };
                continue;
            }
            heights[1 - own] -= children.map(Node::update_size).sum::<usize>();
            self.nodes[s].update = heights[own];
            heights[own] += size;
            peaks[own] = peaks[own].max(heights[own]);
            if parent == NO_PARENT || self.nodes[parent as usize].is_branch {
                self.nodes[s].space = [peaks[own], peaks[1 - own], 0];
                (heights, peaks) = ([0; 2], [0; 2]);
            }
        }
        self.space = self.roots.iter().map(|&root| self.nodes[root as usize].whole_space()).sum();
    }

    /// The only child that is a branch too.
    pub(super) fn next_branch(&self, node: &Node) -> Option<u32> {
        let children = self.children_of(node).iter();
        let mut branches = children.filter(|&&child| self.nodes[child as usize].is_branch);
        branches.next().copied().filter(|_| branches.next().is_none())
    }

    /// The nodes below a node.
    pub(super) fn children_of(&self, node: &Node) -> &[u32] {
        &self.children[node.children.start as usize..node.children.end as usize]
    }
}
