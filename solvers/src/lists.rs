//! Lists of items by group, one after the other in one array: compressed sparse rows.
//!
//! It knows neither what the groups are nor what the items mean.

use std::ops::Range;

/// A list of items for each group.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Lists<T> {
    /// Where each list begins, and the end of the last.
    pub(crate) starts: Vec<usize>,
    pub(crate) items: Vec<T>,
}

impl<T: Copy + Default> Lists<T> {
    /// Puts each item into the list of its group; items keep their order.
    pub(crate) fn new(groups: usize, items: impl Iterator<Item = (usize, T)> + Clone) -> Self {
        let mut counts = vec![0; groups + 1];
        items.clone().for_each(|(group, _)| counts[group + 1] += 1);
        Self::counted(counts, items)
    }

    /// The same; `counts` has the number of items of each group after a zero.
    pub(crate) fn counted(mut counts: Vec<usize>, items: impl Iterator<Item = (usize, T)>) -> Self {
        for group in 1..counts.len() {
            counts[group] += counts[group - 1];
        }
        let (starts, mut next) = (counts.clone(), counts);
        let mut list = vec![T::default(); starts[starts.len() - 1]];
        items.for_each(|(group, item)| {
            list[next[group]] = item;
            next[group] += 1;
        });
        Self { starts, items: list }
    }
}

impl<T> Lists<T> {
    /// How many groups there are.
    pub(crate) fn count(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Where the items of a group stand.
    #[inline]
    pub(crate) fn range(&self, group: usize) -> Range<usize> {
        self.starts[group]..self.starts[group + 1]
    }

    /// The items of a group.
    #[inline]
    pub(crate) fn of(&self, group: usize) -> &[T] {
        &self.items[self.range(group)]
    }
}
