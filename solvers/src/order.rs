//! Sorting of indices by what they stand for, compiled once: a sort of its own for each closure takes
//! ten kilobytes of code, and these lists are short beside the work that follows.

use std::cmp::Ordering;

/// Sorts `indices` stably by `compare`.
pub(crate) fn sort_by(indices: &mut [usize], compare: &mut dyn FnMut(usize, usize) -> Ordering) {
    indices.sort_by(|&a, &b| compare(a, b));
}

/// Sorts `indices` stably by `key`.
pub(crate) fn sort_by_key(indices: &mut [u32], key: &dyn Fn(u32) -> u64) {
    indices.sort_by_key(|&index| key(index));
}
