//! The elimination tree of a growing system: nodes, their parents and children, and their memory.
//!
//! A node holds its front after elimination: pivot columns (the panel, with the right-hand side as
//! the row below all others) and the update matrix that its parent takes. Memory of nodes that are
//! gone is used again. It knows structure and memory; the numbers are made in `fronts`.

use crate::linear::ordering::NO_PARENT;
use crate::linear::sparse::shape::{Aligned, Shape};

/// No block, no node.
pub(super) const NONE: u32 = NO_PARENT;

/// A node.
#[derive(Debug)]
pub(super) struct Node {
    /// Blocks eliminated here, in order, and after them those below, which are eliminated above.
    pub(super) blocks: Vec<u32>,
    pub(super) pivots: usize,
    pub(super) parent: u32,
    first_child: u32,
    next_sibling: u32,
    pub(super) panel: Aligned,
    pub(super) update: Aligned,
    /// Whether it is about to be made anew.
    pub(super) is_marked: bool,
    /// Whether back substitution has not been here since the front was made.
    pub(super) is_new: bool,
    /// ½ yᵀy over its pivots, L y = −g: what they lower the cost by.
    pub(super) decrease: f64,
}

impl Node {
    /// A node without a parent and without children; `blocks` are the pivots and the rows. `None` where
    /// there is no memory for its front.
    pub(super) fn new<const N: usize>(
        blocks: Vec<u32>,
        pivots: usize,
        memory: &mut Memory,
    ) -> Option<Self> {
        let shape = shape::<N>(pivots, blocks.len());
        Some(Self {
            blocks,
            pivots,
            parent: NONE,
            first_child: NONE,
            next_sibling: NONE,
            panel: memory.take(shape.panel_size())?,
            update: memory.take(shape.update_size())?,
            is_marked: false,
            is_new: true,
            decrease: 0.0,
        })
    }

    pub(super) fn pivots(&self) -> &[u32] {
        &self.blocks[..self.pivots]
    }

    pub(super) fn rows(&self) -> &[u32] {
        &self.blocks[self.pivots..]
    }

    pub(super) fn shape<const N: usize>(&self) -> Shape {
        shape::<N>(self.pivots, self.blocks.len())
    }
}

/// The measures of a front with the right-hand side's row below all others.
fn shape<const N: usize>(pivots: usize, blocks: usize) -> Shape {
    Shape::new(pivots * N, blocks * N, 1)
}

/// The forest with what is needed to walk it.
#[derive(Debug, Default)]
pub(super) struct Tree {
    nodes: Vec<Option<Node>>,
    free: Vec<u32>,
    pub(super) roots: Vec<u32>,
    /// The node where each block is eliminated, or [`NONE`].
    pub(super) node_of: Vec<u32>,
    /// Over all nodes.
    pub(super) decrease: f64,
    /// Numbers in all panels.
    pub(super) entries: usize,
    pub(super) memory: Memory,
    /// The number of each block in the top while one is made, or [`NONE`].
    pub(super) local: Vec<u32>,
}

impl Tree {
    pub(super) fn push_block(&mut self) {
        self.node_of.push(NONE);
        self.local.push(NONE);
    }

    pub(super) fn node(&self, number: u32) -> Option<&Node> {
        self.nodes.get(number as usize)?.as_ref()
    }

    pub(super) fn node_mut(&mut self, number: u32) -> Option<&mut Node> {
        self.nodes.get_mut(number as usize)?.as_mut()
    }

    /// A node's children.
    pub(super) fn children(&self, node: &Node) -> impl Iterator<Item = u32> {
        let mut next = node.first_child;
        std::iter::from_fn(move || {
            let child = next;
            next = self.node(child)?.next_sibling;
            Some(child)
        })
    }

    /// Hangs a node on another one.
    pub(super) fn hang(&mut self, child: u32, parent: u32) {
        let Some(node) = self.node_mut(parent) else { return };
        let next = std::mem::replace(&mut node.first_child, child);
        if let Some(child) = self.node_mut(child) {
            (child.parent, child.next_sibling) = (parent, next);
        }
    }

    /// Removes a node. Its children have no parent then.
    pub(super) fn remove(&mut self, number: u32) -> Option<Node> {
        let node = self.nodes.get_mut(number as usize)?.take()?;
        self.free.push(number);
        self.decrease -= node.decrease;
        self.entries -= node.panel.len();
        Some(node)
    }

    /// Takes a new node in, with its pivots.
    pub(super) fn insert(&mut self, node: Node) -> u32 {
        self.decrease += node.decrease;
        self.entries += node.panel.len();
        let number = self.free.pop().unwrap_or(self.nodes.len() as u32);
        for &pivot in node.pivots() {
            self.node_of[pivot as usize] = number;
        }
        if number as usize == self.nodes.len() {
            self.nodes.push(None);
        }
        self.nodes[number as usize] = Some(node);
        number
    }

    /// Forgets all nodes.
    pub(super) fn clear(&mut self) {
        let none = vec![NONE; self.node_of.len()];
        let memory = std::mem::take(&mut self.memory);
        *self = Self { node_of: none.clone(), local: none, memory, ..Self::default() };
    }
}

/// Memory to be used again, by size: the exponent of two, and a quarter between.
#[derive(Debug, Default)]
pub(super) struct Memory {
    shelves: Vec<Vec<Aligned>>,
}

/// The least length, so that small fronts share a shelf.
const SMALLEST: usize = 64;

/// The shelf for a length, and the length that its pieces have.
fn shelf(length: usize) -> (usize, usize) {
    let length = length.max(SMALLEST);
    let quarter = 1 << (length.ilog2() - 2);
    let whole = length.next_multiple_of(quarter);
    let exponent = whole.ilog2() as usize;
    (4 * exponent + (whole >> (exponent - 2)) - 4, whole)
}

impl Memory {
    /// Memory for so many numbers, which are not zero.
    fn take(&mut self, length: usize) -> Option<Aligned> {
        if length == 0 {
            return Aligned::new(0);
        }
        let (shelf, whole) = shelf(length);
        self.shelves.get_mut(shelf).and_then(Vec::pop).or_else(|| Aligned::new(whole))
    }

    pub(super) fn give_back(&mut self, piece: Aligned) {
        if piece.len() == 0 {
            return;
        }
        let (shelf, _) = shelf(piece.len());
        if self.shelves.len() <= shelf {
            self.shelves.resize_with(shelf + 1, Vec::new);
        }
        self.shelves[shelf].push(piece);
    }
}
