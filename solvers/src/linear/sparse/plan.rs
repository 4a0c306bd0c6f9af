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

use super::shape::Shape;
use super::supernodes::{FRONT, Ordered, Supernodes, amalgamate};
use crate::linear::error::LinearError;
use crate::linear::ordering::{Elimination, NO_PARENT, earlier_neighbors};
use crate::linear::pattern::BlockPattern;
use crate::lists::Lists;

/// Bytes of an index list's growth: a vector doubles, and stands beside its former self meanwhile.
const GROWTH: u64 = 2;

/// A subtree is a branch if it has at least this share of all flops, and at least so many.
const BRANCH_SHARE: f64 = 1.0 / 32.0;
const BRANCH_FLOPS: f64 = 2e6;

/// A stored block's way into its front.
#[derive(Debug, Clone, Copy, Default)]
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

/// Rows that are contiguous in the source and in the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    pub(super) from: u32,
    pub(super) to: u32,
    pub(super) length: u32,
}

/// A supernode.
#[derive(Debug, Clone, Default)]
pub(super) struct Node {
    /// First pivot, a scalar in elimination order.
    pub(super) first: usize,
    pub(super) shape: Shape,
    /// Where the panel begins in the factor.
    pub(super) panel: usize,
    /// Where the update matrix begins on its stack.
    pub(super) update: usize,
    /// Which stack, relative to other nodes.
    pub(super) is_odd: bool,
    /// Memory for the update matrices of the subtree, this one at its beginning: on its own stack, on
    /// the other one, and, for a branch, of the subtrees below it.
    pub(super) space: [usize; 3],
    pub(super) is_branch: bool,
    /// Flops of the subtree.
    pub(super) flops: f64,
    /// First node of the subtree.
    pub(super) first_node: u32,
    /// Or [`NO_PARENT`].
    pub(super) parent: u32,
    /// Into [`Plan::rows`] and [`Plan::lifts`].
    pub(super) row_runs: Range<u32>,
    pub(super) lifts: Range<u32>,
}

impl Node {
    /// Elements of the memory for update matrices of the subtree.
    pub(super) fn whole_space(&self) -> usize {
        self.space.iter().sum()
    }
}

/// What a sparse factorization keeps from planning. Lists are by node.
#[derive(Debug, Default)]
pub(super) struct Plan {
    /// `scalars[k]` is the caller's scalar that is eliminated k-th.
    pub(super) scalars: Vec<u32>,
    pub(super) nodes: Vec<Node>,
    /// Nodes without a parent.
    pub(super) roots: Vec<u32>,
    pub(super) children: Lists<u32>,
    pub(super) entries: Lists<Entry>,
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
        check_size(pattern)?;
        let sizes: Vec<usize> = order.iter().map(|&b| pattern.sizes()[b as usize]).collect();
        let supernodes = amalgamate(&sizes, elimination, FRONT);
        let ordered = supernodes.ordered(order);
        Self::laid_out(pattern, &supernodes, &ordered).ok_or_else(|| too_large(pattern))
    }

    /// Plans one front for all of `pattern`, in its own order.
    pub(super) fn dense(pattern: &BlockPattern) -> Result<Self, LinearError> {
        check_size(pattern)?;
        let supernodes = Supernodes::one(pattern.block_count());
        let ordered = supernodes.ordered(&supernodes.order);
        Self::laid_out(pattern, &supernodes, &ordered).ok_or_else(|| too_large(pattern))
    }

    /// `None` where something does not fit its index. Blocks are numbered by their position.
    fn laid_out(
        pattern: &BlockPattern,
        supernodes: &Supernodes,
        ordered: &Ordered,
    ) -> Option<Self> {
        let order = &ordered.order;
        let sizes: Vec<usize> = order.iter().map(|&b| pattern.sizes()[b as usize]).collect();
        let mut plan = Self::of_tree(&supernodes.parents);
        plan.scalars.reserve_exact(pattern.dimension());
        // First scalar of each block in elimination order.
        let mut offsets = Vec::with_capacity(order.len() + 1);
        offsets.push(0);
        for (&block, &size) in order.iter().zip(&sizes) {
            let start = pattern.offset(block as usize) as u32;
            plan.scalars.extend(start..start + size as u32);
            offsets.push(plan.scalars.len());
        }
        let below = row_structure(pattern, ordered, &supernodes.parents);
        let mut stored = stored_by_node(pattern, ordered);
        let mut entries = Vec::with_capacity(stored.items.len());
        // Where each block stands in the front of the node at hand.
        let mut local = vec![0u32; sizes.len()];
        for (s, blocks) in supernodes.blocks.iter().enumerate() {
            let first = offsets[blocks.start];
            let pivots = offsets[blocks.end] - first;
            for block in blocks.clone() {
                local[block] = (offsets[block] - first) as u32;
            }
            let mut rows = pivots;
            let row_runs = plan.rows.len();
            for &block in below.of(s) {
                let size = sizes[block as usize];
                local[block as usize] = rows as u32;
                push_run(&mut plan.rows, row_runs, rows, offsets[block as usize], size);
                rows += size;
            }
            let shape = Shape::new(pivots, rows, 0);
            u32::try_from(shape.stride.checked_mul(rows)?).ok()?;
            let range = stored.range(s);
            for block in &mut stored.items[range] {
                let (r, c) = (local[block.row as usize], local[block.column as usize]);
                block.entry.target = r + c * shape.stride as u32;
                entries.push(block.entry);
            }
            for &child in plan.children.of(s) {
                let start = plan.lifts.len();
                let mut from = 0;
                for &block in below.of(child as usize) {
                    let size = sizes[block as usize];
                    let to = local[block as usize] as usize;
                    // Pivots and rows of the parent are columns of different targets.
                    let first = if to == pivots { plan.lifts.len() } else { start };
                    push_run(&mut plan.lifts, first, from, to, size);
                    from += size;
                }
                plan.nodes[child as usize].lifts = start as u32..plan.lifts.len() as u32;
            }
            let row_runs = row_runs as u32..plan.rows.len() as u32;
            plan.push(Node { first, shape, row_runs, ..Node::default() }, supernodes.parents[s]);
        }
        plan.entries = Lists { starts: stored.starts, items: entries };
        plan.place_updates();
        Some(plan)
    }
}

fn too_large(pattern: &BlockPattern) -> LinearError {
    LinearError::TooLarge { dimension: pattern.dimension() }
}

/// Whether values and sizes of blocks can be numbered.
fn check_size(pattern: &BlockPattern) -> Result<(), LinearError> {
    let is_numbered = u32::try_from(pattern.value_count()).is_ok();
    let is_small = |&size: &usize| size <= usize::from(u16::MAX);
    if is_numbered && pattern.sizes().iter().all(is_small) {
        Ok(())
    } else {
        Err(too_large(pattern))
    }
}

/// Bytes of planning and factoring one front of `dimension` scalars with so many stored blocks.
pub(in super::super) fn dense_bytes(dimension: usize, stored_blocks: u64) -> u64 {
    let n = dimension as u64;
    // A stride is padded by up to two vectors. Sorting the blocks by node takes as much again as the list.
    let lists = stored_blocks.saturating_mul(2 * size_of::<Entry>() as u64 + 28);
    n.saturating_mul(8 * (n + 16)).saturating_add(lists).saturating_add(128 * n + (1 << 12))
}

/// Bytes of planning and factoring on `pattern` in the postordered `order`, from the column heights
/// alone: no rows are listed. Panels and update matrices are counted exactly, lists of indices are
/// bounded from above. Memory and time are linear in the blocks, whatever the fill.
pub(in super::super) fn bytes(
    pattern: &BlockPattern,
    order: &[u32],
    elimination: &Elimination,
) -> u64 {
    let sizes: Vec<usize> = order.iter().map(|&b| pattern.sizes()[b as usize]).collect();
    let supernodes = amalgamate(&sizes, elimination, FRONT);
    let mut plan = Plan::of_tree(&supernodes.parents);
    let mut listed_rows = 0_u64;
    for (blocks, &parent) in supernodes.blocks.iter().zip(&supernodes.parents) {
        let placed = &supernodes.order[blocks.clone()];
        let pivots: usize = placed.iter().map(|&k| sizes[k as usize]).sum();
        // A node's last block is its top, whose structure is that of the node.
        let Some(&top) = placed.last() else { continue };
        let rows = pivots + elimination.heights[top as usize];
        listed_rows += u64::from(elimination.block_heights[top as usize]);
        plan.push(Node { shape: Shape::new(pivots, rows, 0), ..Node::default() }, parent);
    }
    plan.place_updates();
    let numbers = plan.factor_size + plan.space + plan.longest + pattern.dimension();
    let [entry, run, node] = [size_of::<Entry>(), size_of::<Run>(), size_of::<Node>()];
    let (stored, nodes) = (pattern.stored_block_count() as u64, plan.nodes.len() as u64);
    let blocks = pattern.block_count() as u64;
    // Pairs and rows of the structure, their runs in both directions, at most one a row.
    let lists = listed_rows * (8 * GROWTH + 4 + 2 * GROWTH * run as u64)
        + stored * (2 * entry as u64 + 8 + 12)
        + nodes * (node as u64 + 80)
        + blocks * 64
        + pattern.dimension() as u64 * 8;
    8 * numbers as u64 + lists
}

/// The stored blocks by the node of their column; targets are still missing.
fn stored_by_node(pattern: &BlockPattern, ordered: &Ordered) -> Lists<Stored> {
    let Ordered { position, node_of, .. } = ordered;
    let blocks = (0..pattern.block_count()).flat_map(|i| {
        pattern.row_range(i).zip(pattern.row(i)).map(move |(number, &j)| (number, i, j as usize))
    });
    let stored = blocks.map(|(number, i, j)| {
        let (p, q) = (position[i], position[j]);
        let entry = Entry {
            source: pattern.value_starts()[number] as u32,
            target: 0,
            rows: pattern.sizes()[i] as u16,
            columns: pattern.sizes()[j] as u16,
            is_transposed: p < q,
        };
        let (row, column) = (p.max(q), p.min(q));
        (node_of[column as usize] as usize, Stored { row, column, entry })
    });
    Lists::new(node_of.last().map_or(0, |&last| last as usize + 1), stored)
}

/// A stored block in elimination order.
#[derive(Clone, Copy, Default)]
struct Stored {
    row: u32,
    column: u32,
    entry: Entry,
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

/// Blocks below the pivots of each node: a block is a row of every node on the paths from the
/// nodes of its earlier neighbors up to its own.
pub(super) fn row_structure(
    pattern: &BlockPattern,
    Ordered { position, node_of, .. }: &Ordered,
    parents: &[u32],
) -> Lists<u32> {
    let neighbors = earlier_neighbors(pattern, position);
    let mut visited = vec![u32::MAX; parents.len()];
    let mut pairs = Vec::with_capacity(2 * neighbors.items.len());
    let mut counts = vec![0; parents.len() + 1];
    for (i, &own) in node_of.iter().enumerate() {
        for &neighbor in neighbors.of(i) {
            let mut s = node_of[neighbor as usize];
            while s != own && s != NO_PARENT && visited[s as usize] != i as u32 {
                visited[s as usize] = i as u32;
                pairs.push((s, i as u32));
                counts[s as usize + 1] += 1;
                s = parents[s as usize];
            }
        }
    }
    Lists::counted(counts, pairs.iter().map(|&(s, block)| (s as usize, block)))
}

impl Plan {
    /// A plan for nodes with these parents, none of which was pushed yet.
    pub(super) fn of_tree(parents: &[u32]) -> Self {
        let nodes = || parents.iter().zip(0_u32..);
        let hung = nodes().filter(|&(&parent, _)| parent != NO_PARENT);
        let roots = nodes().filter(|&(&parent, _)| parent == NO_PARENT);
        Self {
            nodes: Vec::with_capacity(parents.len()),
            roots: roots.map(|(_, s)| s).collect(),
            children: Lists::new(parents.len(), hung.map(|(&parent, s)| (parent as usize, s))),
            ..Self::default()
        }
    }

    /// Appends the next node in postorder, with its panel and its subtree.
    pub(super) fn push(&mut self, node: Node, parent: u32) {
        let (s, shape) = (self.nodes.len(), node.shape);
        let (mut flops, mut first_node) = (shape.flops(), s as u32);
        for &child in self.children.of(s) {
            let child = &self.nodes[child as usize];
            flops += child.flops;
            first_node = first_node.min(child.first_node);
        }
        self.nodes.push(Node { panel: self.factor_size, flops, first_node, parent, ..node });
        self.factor_size += shape.panel_size();
        self.longest = self.longest.max(shape.stride);
    }

    /// Gives every update matrix its offset.
    pub(super) fn place_updates(&mut self) {
        let total: f64 = self.roots.iter().map(|&root| self.nodes[root as usize].flops).sum();
        let least = (BRANCH_SHARE * total).max(BRANCH_FLOPS);
        for node in &mut self.nodes {
            node.is_branch = node.flops >= least;
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
            let (own, parent, size) =
                (usize::from(node.is_odd), node.parent, node.shape.update_size());
            let children = self.children.of(s).iter().map(|&child| &self.nodes[child as usize]);
            if node.is_branch {
                let below: usize = children.map(Node::whole_space).sum();
                self.nodes[s].space = match self.next_branch(s) {
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
            heights[1 - own] -= children.map(|child| child.shape.update_size()).sum::<usize>();
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

    /// The only child of node `s` that is a branch too.
    pub(super) fn next_branch(&self, s: usize) -> Option<u32> {
        let children = self.children.of(s).iter();
        let mut branches = children.filter(|&&child| self.nodes[child as usize].is_branch);
        branches.next().copied().filter(|_| branches.next().is_none())
    }
}
