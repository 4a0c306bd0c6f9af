//! Disjoint sets of indices by union-find with path halving.
//!
//! The root of a set is its lowest member, so that sets come out in order. Sets only grow: there is no
//! split.

/// A partition of 0..count.
#[derive(Clone, Debug)]
pub struct DisjointSets(Vec<usize>);

impl DisjointSets {
    /// Each index alone.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    /// The lowest member of the set that holds `index`, which is below the count.
    pub fn root(&mut self, mut index: usize) -> usize {
        while self.0[index] != index {
            self.0[index] = self.0[self.0[index]];
            index = self.0[index];
        }
        index
    }

    /// Makes one set of two; whether they were two.
    pub fn join(&mut self, a: usize, b: usize) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b);
        a != b
    }

    /// Makes one set of all these.
    pub fn join_all(&mut self, members: impl IntoIterator<Item = usize>) {
        let mut members = members.into_iter();
        if let Some(first) = members.next() {
            members.for_each(|member| _ = self.join(first, member));
        }
    }

    /// The lowest member of every set, rising.
    #[must_use]
    pub fn roots(&self) -> Vec<usize> {
        (0..self.0.len()).filter(|&index| self.0[index] == index).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::DisjointSets;

    #[test]
    fn the_lowest_member_stands_for_its_set() {
        let mut sets = DisjointSets::new(8);
        assert!(sets.join(5, 7) && sets.join(7, 2) && !sets.join(2, 5));
        sets.join_all([6, 1, 4]);
        assert_eq!(sets.roots(), [0, 1, 2, 3]);
        assert_eq!((sets.root(7), sets.root(6), sets.root(3)), (2, 1, 3));
    }
}
