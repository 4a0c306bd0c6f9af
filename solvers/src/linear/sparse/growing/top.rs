//! Which nodes are made anew, from which blocks, in which order.
//!
//! The top holds the blocks whose terms changed, new ones included, and all that is eliminated after
//! them. Its graph has an edge for each term between two of its blocks, and all pairs among the rows
//! of a subtree that stays (an orphan), since its update matrix ties them. This decides structure
//! only; no value is seen.

use super::terms::Terms;
use super::tree::{NONE, Tree};
use crate::linear::ordering::ordered_with_last;
use crate::linear::pattern::BlockPattern;
use crate::linear::sparse::plan::row_structure;
use crate::linear::sparse::supernodes::{Ordered, amalgamate};

/// What a front costs by itself, as [`amalgamate`] counts: besides its elimination, every back
/// substitution comes by.
const FRONT: f64 = 800.0;

/// The part of a tree that is to be made, blocks numbered as the system numbers them.
#[derive(Debug)]
pub(super) struct Top {
    /// Its blocks; the tree's `local` has their indices here.
    pub(super) blocks: Vec<u32>,
    /// Its nodes in postorder.
    pub(super) nodes: Vec<Planned>,
}

/// A node to be made.
#[derive(Debug)]
pub(super) struct Planned {
    /// Its pivots, in order, and the rows below them.
    pub(super) blocks: Vec<u32>,
    pub(super) pivots: usize,
    /// Among the planned nodes, or [`NONE`].
    pub(super) parent: u32,
    /// Roots of unchanged subtrees that become children of this node.
    pub(super) orphans: Vec<u32>,
}

impl Top {
    /// Takes the nodes above `touched` out of the tree and plans others for their blocks.
    pub(super) fn of<const N: usize>(
        terms: &Terms<N>,
        tree: &mut Tree,
        touched: &[u32],
        last: &[usize],
    ) -> Self {
        let mut blocks = Vec::new();
        let mut marked = Vec::new();
        for &block in touched {
            let mut number = tree.node_of[block as usize];
            if number == NONE && tree.local[block as usize] == NONE {
                tree.local[block as usize] = blocks.len() as u32;
                blocks.push(block);
            }
            while let Some(node) = tree.node_mut(number).filter(|node| !node.is_marked) {
                node.is_marked = true;
                marked.push(number);
                number = node.parent;
            }
        }
        let mut orphans = Vec::new();
        for node in marked.iter().filter_map(|&number| tree.node(number)) {
            let stays = |&child: &u32| tree.node(child).is_some_and(|child| !child.is_marked);
            orphans.extend(tree.children(node).filter(stays));
        }
        for number in marked {
            let Some(node) = tree.remove(number) else { continue };
            for &pivot in node.pivots() {
                tree.node_of[pivot as usize] = NONE;
                tree.local[pivot as usize] = blocks.len() as u32;
                blocks.push(pivot);
            }
            tree.memory.give_back(node.panel);
            tree.memory.give_back(node.update);
        }
        let mut roots = std::mem::take(&mut tree.roots);
        roots.retain(|&root| tree.node(root).is_some());
        tree.roots = roots;
        plan::<N>(terms, tree, blocks, &orphans, last)
    }
}

/// Plans for `blocks`, whose indices in this list `tree.local` holds.
fn plan<const N: usize>(
    terms: &Terms<N>,
    tree: &Tree,
    blocks: Vec<u32>,
    orphans: &[u32],
    last: &[usize],
) -> Top {
    let local = |block: u32| tree.local.get(block as usize).copied().unwrap_or(NONE);
    let mut pairs = Vec::new();
    for (k, &block) in blocks.iter().enumerate() {
        for (_, other, _) in terms.incident(block) {
            let other = local(other) as usize;
            if other < k {
                pairs.push((k, other));
            }
        }
    }
    for node in orphans.iter().filter_map(|&orphan| tree.node(orphan)) {
        for (a, &row) in node.rows().iter().enumerate() {
            pairs
                .extend(node.rows()[..a].iter().map(|&b| (local(row) as usize, local(b) as usize)));
        }
    }
    let pattern = BlockPattern::new(vec![N; blocks.len()], pairs);
    let mut is_last = vec![false; blocks.len()];
    for &block in last {
        if let Some(is_last) = is_last.get_mut(local(block as u32) as usize) {
            *is_last = true;
        }
    }
    let (order, elimination) = ordered_with_last(&pattern, &is_last);
    let supernodes = amalgamate(pattern.sizes(), &elimination, FRONT);
    let ordered = supernodes.ordered(&order);
    let rows = row_structure(&pattern, &ordered, &supernodes.parents);
    let Ordered { order, position, node_of } = ordered;
    let block_at = |k: u32| blocks[order[k as usize] as usize];
    let mut nodes: Vec<Planned> = supernodes
        .blocks
        .iter()
        .enumerate()
        .map(|(s, range)| Planned {
            pivots: range.len(),
            blocks: (range.start as u32..range.end as u32)
                .chain(rows.of(s).iter().copied())
                .map(block_at)
                .collect(),
            parent: supernodes.parents[s],
            orphans: Vec::new(),
        })
        .collect();
    for &orphan in orphans {
        let Some(node) = tree.node(orphan) else { continue };
        let first = node.rows().iter().map(|&row| position[local(row) as usize]).min();
        if let Some(first) = first {
            nodes[node_of[first as usize] as usize].orphans.push(orphan);
        }
    }
    Top { blocks, nodes }
}
