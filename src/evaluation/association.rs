//! Pairs poses of two trajectories by timestamp, as evo's `associate_trajectories` does.
//!
//! The trajectory with fewer poses walks (the estimate, where both have as many) and takes for each
//! of its stamps the nearest of the other within the limit, inclusive; of two equally near ones the
//! earlier. Nothing is unique: two stamps may take the same partner. Differences are plain f64 of
//! the stamps as they are, without an offset, so that the same ones pass the limit as in evo.

/// The matched pairs (index in `truth`, index in `estimate`) in the walker's order.
#[must_use]
pub fn associate(truth: &[f64], estimate: &[f64], max_difference_s: f64) -> Vec<(usize, usize)> {
    if estimate.len() > truth.len() {
        walk(truth, estimate, max_difference_s)
    } else {
        let pairs = walk(estimate, truth, max_difference_s);
        pairs.into_iter().map(|(estimate, truth)| (truth, estimate)).collect()
    }
}

/// For each stamp of `walker` that has one: its index and its partner's in `searched`.
fn walk(walker: &[f64], searched: &[f64], max_difference: f64) -> Vec<(usize, usize)> {
    let nearest = if searched.is_sorted() { nearest_in_sorted } else { nearest_in_unsorted };
    let pair = |(index, &stamp)| Some((index, nearest(searched, stamp, max_difference)?));
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

/// Linear search: the first of the nearest stamps.
fn nearest_in_unsorted(searched: &[f64], stamp: f64, max_difference: f64) -> Option<usize> {
    let distance = |s: &f64| (s - stamp).abs();
    let (index, nearest) =
        searched.iter().enumerate().min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)))?;
    (distance(nearest) <= max_difference).then_some(index)
}
