//! Pairs of poses of two trajectories by timestamp, as evo's `associate_trajectories` finds them.
//!
//! The trajectory with fewer poses walks (the estimate, where both have as many) and takes for each
//! of its stamps the nearest of the other within the limit, inclusive; of two equally near ones the
//! earlier. Nothing is unique: two stamps may take the same partner. Differences are plain f64 of
//! the stamps as they are, without an offset, so that the same ones pass the limit as in evo. No pose
//! is interpolated.

/// The matched pairs (index in `truth`, index in `estimate`) in the walker's order.
pub(super) fn associate(
    truth: &[f64],
    estimate: &[f64],
    max_difference_s: f64,
) -> Vec<(usize, usize)> {
    if estimate.len() > truth.len() {
        walk(truth, estimate, max_difference_s)
    } else {
        let pairs = walk(estimate, truth, max_difference_s);
        pairs.into_iter().map(|(estimate, truth)| (truth, estimate)).collect()
    }
}

/// For each stamp of `walker` that has one: its index and its partner's in `searched`.
fn walk(walker: &[f64], searched: &[f64], max_difference: f64) -> Vec<(usize, usize)> {
    if searched.is_sorted() {
        let pair =
            |(index, &stamp)| Some((index, nearest_in_sorted(searched, stamp, max_difference)?));
        return walker.iter().enumerate().filter_map(pair).collect();
    }
    let order = Order::of(searched);
    let pair = |(index, &stamp)| Some((index, order.nearest(searched, stamp, max_difference)?));
    walker.iter().enumerate().filter_map(pair).collect()
}

/// Binary search; past the end the last stamp is the candidate, which the range check bounds.
fn nearest_in_sorted(searched: &[f64], stamp: f64, max_difference: f64) -> Option<usize> {
    let (first, last) = (searched.first()?, searched.last()?);
    if stamp < first - max_difference || stamp > last + max_difference {
        return None;
    }
    let after = searched.partition_point(|&s| s <= stamp).min(searched.len() - 1);
    let above = searched[after] - stamp;
    let below = if after > 0 { stamp - searched[after - 1] } else { f64::INFINITY };
    if above <= max_difference && above < below {
        Some(after)
    } else if below <= max_difference && below <= above {
        Some(after - 1)
    } else {
        None
    }
}

/// Indices of stamps that are not sorted, by stamp; those of equal stamps in their own order. A search of
/// all stamps for each pose would take hours of two long trajectories.
struct Order(Vec<usize>);

impl Order {
    fn of(stamps: &[f64]) -> Self {
        let mut order: Vec<usize> = (0..stamps.len()).collect();
        order.sort_by(|&a, &b| stamps[a].total_cmp(&stamps[b]));
        Self(order)
    }

    /// The first in the list of the nearest stamps.
    fn nearest(&self, stamps: &[f64], stamp: f64, max_difference: f64) -> Option<usize> {
        let from = |bound: f64| self.0.partition_point(|&index| stamps[index] < bound);
        let above = self.0.get(from(stamp)).copied();
        // The first of those that have the next lower stamp.
        let below = from(stamp).checked_sub(1).map(|last| stamps[self.0[last]]);
        let below = below.and_then(|bound| self.0.get(from(bound)).copied());
        let distance = |index: &usize| (stamps[*index] - stamp).abs();
        let candidates = [above, below].into_iter().flatten();
        let nearest =
            candidates.min_by(|a, b| distance(a).total_cmp(&distance(b)).then_with(|| a.cmp(b)))?;
        (distance(&nearest) <= max_difference).then_some(nearest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition: the first of the nearest stamps, by looking at all.
    fn by_definition(searched: &[f64], stamp: f64, max_difference: f64) -> Option<usize> {
        let distance = |s: &f64| (s - stamp).abs();
        let nearest =
            searched.iter().enumerate().min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
        nearest.filter(|(_, s)| distance(s) <= max_difference).map(|(index, _)| index)
    }

    #[test]
    fn of_stamps_in_any_order_the_first_of_the_nearest_is_found() {
        let mut state = 7_u64;
        let mut next = |most: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) % most
        };
        for length in 1..40 {
            // Quarters repeat, and lie in the middle of others.
            let stamps: Vec<f64> = (0..length).map(|_| 0.25 * next(30) as f64).collect();
            let order = Order::of(&stamps);
            for step in 0..80 {
                let stamp = 0.125 * f64::from(step) - 1.0;
                for most in [0.0, 0.125, 0.5, 100.0] {
                    let wanted = by_definition(&stamps, stamp, most);
                    assert_eq!(order.nearest(&stamps, stamp, most), wanted, "{stamp} {stamps:?}");
                }
            }
        }
        assert_eq!(Order::of(&[]).nearest(&[], 0.0, 1.0), None);
    }
}
