//! Which depth image belongs to which color image: the pair nearest in time first.
//!
//! As the script of the TUM RGB-D benchmark does it: of all pairs that are less than the limit apart,
//! the nearest is taken and both its images are used up, then the next nearest. Where that leaves a
//! color image alone it shares the nearest depth image: to a tracker a frame less is a leap.
//! The limit follows from the rates of the two lists. It knows times alone and opens no image.

/// What the TUM scripts allow; at 30 Hz the nearest image is at most 17 ms away.
const LEAST_DIFFERENCE_S: f64 = 0.02;
/// Longer ago the camera was elsewhere: depth that late cannot be laid on the color.
const MOST_DIFFERENCE_S: f64 = 0.1;
/// The nearest image of a list is at most half its interval away; the rest is for jitter.
const INTERVALS: f64 = 0.55;

/// How far apart the two images of a frame may be, seconds: about half the interval of the list with
/// the higher rate. So each image of the slower list finds its nearest in the other one, whatever the
/// rates are and however the two are shifted, and none is paired with an image much farther away.
pub(super) fn max_difference_s(color: &[f64], depth: &[f64]) -> f64 {
    let intervals = [color, depth].into_iter().filter_map(median_interval_s);
    let shortest = intervals.min_by(f64::total_cmp).unwrap_or(0.0);
    (INTERVALS * shortest).clamp(LEAST_DIFFERENCE_S, MOST_DIFFERENCE_S)
}

/// The median of the times between neighbors of different times.
fn median_interval_s(times: &[f64]) -> Option<f64> {
    let mut times = times.to_vec();
    times.sort_unstable_by(f64::total_cmp);
    let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
    let mut intervals: Vec<f64> = steps.filter(|&step| step > 0.0).collect();
    intervals.sort_unstable_by(f64::total_cmp);
    intervals.get(intervals.len().checked_sub(1)? / 2).copied()
}

/// For each color image the index of its depth image.
pub(super) fn nearest_pairs(
    color: &[f64],
    depth: &[f64],
    max_difference_s: f64,
) -> Vec<Option<usize>> {
    let mut by_time: Vec<usize> = (0..depth.len()).collect();
    by_time.sort_by(|&a, &b| depth[a].total_cmp(&depth[b]));
    let mut pairs = Vec::new();
    for (c, &time) in color.iter().enumerate() {
        let first = by_time.partition_point(|&d| depth[d] <= time - max_difference_s);
        for &d in &by_time[first..] {
            let difference = (depth[d] - time).abs();
            if difference >= max_difference_s {
                break;
            }
            pairs.push((difference, c, d));
        }
    }
    pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    let mut partner = vec![None; color.len()];
    let mut used = vec![false; depth.len()];
    for &(_, c, d) in &pairs {
        if partner[c].is_none() && !used[d] {
            partner[c] = Some(d);
            used[d] = true;
        }
    }
    for (_, c, d) in pairs {
        partner[c].get_or_insert(d);
    }
    partner
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_pair_goes_first_and_uses_its_images_up() {
        // The second color image is nearer to the only depth image than the first one is.
        let pairs = nearest_pairs(&[1.000, 1.012], &[1.010], 0.02);
        assert_eq!(nearest_pairs(&[1.000, 1.012], &[1.010, 0.981], 0.02), [Some(1), Some(0)]);
        // Without another one the first shares it.
        assert_eq!(pairs, [Some(0), Some(0)]);
        // The first loses its nearest to the second and takes the other one.
        let pairs = nearest_pairs(&[1.000, 1.004], &[0.985, 1.003], 0.02);
        assert_eq!(pairs, [Some(0), Some(1)]);
    }

    #[test]
    fn images_too_far_apart_are_no_pair_and_order_does_not_matter() {
        let pairs = nearest_pairs(&[3.0, 1.0, 2.0], &[2.001, 3.5, 0.999], 0.02);
        assert_eq!(pairs, [None, Some(2), Some(0)]);
        assert_eq!(nearest_pairs(&[1.0], &[], 0.02), [None]);
        assert_eq!(nearest_pairs(&[0.0], &[0.02], 0.02), [None]);
    }

    /// Images at this rate, the first at `from`.
    fn at_rate(hz: f64, from: f64, count: u32) -> Vec<f64> {
        (0..count).map(|i| from + f64::from(i) / hz).collect()
    }

    fn pairs(color: &[f64], depth: &[f64]) -> Vec<Option<usize>> {
        nearest_pairs(color, depth, max_difference_s(color, depth))
    }

    #[test]
    fn at_any_rate_each_color_image_finds_its_depth_image() {
        for hz in [5.5, 10.0, 15.0, 25.0, 30.0, 60.0, 90.0] {
            // As far apart as two cameras that do not know of each other can be.
            let shift = 0.499 / hz;
            let (color, depth) = (at_rate(hz, 7.0, 20), at_rate(hz, 7.0 + shift, 20));
            let all: Vec<_> = (0..20).map(Some).collect();
            assert_eq!(pairs(&color, &depth), all, "{hz} Hz");
        }
    }

    #[test]
    fn of_the_faster_list_those_far_from_the_slower_one_are_left_alone() {
        // Color at 30 Hz, depth at 5 Hz: one color image in six has depth of its time.
        let found = pairs(&at_rate(30.0, 0.0, 30), &at_rate(5.0, 0.0, 5));
        let expected = (0..30).map(|i| (i % 6 == 0).then_some(i / 6));
        assert_eq!(found, expected.collect::<Vec<_>>());
        // Color at 10 Hz, depth at 90 Hz: each has one.
        let found = pairs(&at_rate(10.0, 0.003, 10), &at_rate(90.0, 0.0, 90));
        assert_eq!(found, (0..10).map(|i| Some(9 * i)).collect::<Vec<_>>());
    }

    #[test]
    fn the_limit_has_bounds_whatever_the_times_are() {
        let limit = max_difference_s;
        assert_eq!(limit(&[], &[1.0]), LEAST_DIFFERENCE_S);
        assert_eq!(limit(&[1.0, 1.0], &[2.0]), LEAST_DIFFERENCE_S);
        assert_eq!(limit(&[0.0, 1e300], &[-1e300, 1e300]), MOST_DIFFERENCE_S);
        // A gap in a recording changes nothing.
        let gap = [0.0, 0.1, 0.2, 60.0, 60.1, 60.2];
        assert!((limit(&gap, &gap) - 0.055).abs() < 1e-12);
    }
}
