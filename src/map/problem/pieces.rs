//! The pieces of a map that nothing ties together, by union-find with path halving.
//!
//! The root of a piece is its lowest member, so that pieces come out in order.

/// A partition of 0..count.
pub(super) struct Pieces(Vec<usize>);

impl Pieces {
    /// Everyone alone.
    pub(super) fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    /// The lowest member of the piece that holds `index`.
    pub(super) fn root(&mut self, mut index: usize) -> usize {
        while self.0[index] != index {
            self.0[index] = self.0[self.0[index]];
            index = self.0[index];
        }
        index
    }

    /// Makes one piece of two.
    pub(super) fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b);
    }

    /// The lowest member of every piece, in order.
    pub(super) fn roots(&mut self) -> Vec<usize> {
        (0..self.0.len()).filter(|&index| self.0[index] == index).collect()
    }
}
