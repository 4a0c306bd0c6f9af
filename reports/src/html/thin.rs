//! What bounds a report's size: of very many points those are kept that show the worst.
//!
//! Points are left out and never averaged.

/// Indices of at most `limit` + 2 of `count` points: the first, the last, and of each of `limit` pieces of
/// equal length the one whose `weight` is the largest. A weight that is no number counts as the smallest.
pub(super) fn thin(count: usize, limit: usize, weight: impl Fn(usize) -> f64) -> Vec<usize> {
    if count <= limit + 2 || limit == 0 {
        return (0..count).collect();
    }
    let mut kept = vec![0];
    for piece in 0..limit {
        let bounds = piece * count / limit..(piece + 1) * count / limit;
        let heavier = |best: usize, next: usize| {
            let (a, b) = (weight(best), weight(next));
            if b > a || (a.is_nan() && !b.is_nan()) { next } else { best }
        };
        kept.extend(bounds.reduce(heavier));
    }
    kept.push(count - 1);
    kept.dedup();
    kept
}
