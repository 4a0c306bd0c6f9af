//! Which depth image belongs to which color image: the pair nearest in time first.
//!
//! As the script of the TUM RGB-D benchmark does it: of all pairs that are less than the limit apart,
//! the nearest is taken and both its images are used up, then the next nearest. Where that leaves a
//! color image alone it shares the nearest depth image: to a tracker a frame less is a leap.

use super::list::Entry;

/// For each color image the index of its depth image.
pub(super) fn nearest_pairs(
    color: &[Entry],
    depth: &[Entry],
    max_difference_s: f64,
) -> Vec<Option<usize>> {
    let mut by_time: Vec<usize> = (0..depth.len()).collect();
    by_time.sort_by(|&a, &b| depth[a].timestamp_s.total_cmp(&depth[b].timestamp_s));
    let mut pairs = Vec::new();
    for (c, entry) in color.iter().enumerate() {
        let time = entry.timestamp_s;
        let first = by_time.partition_point(|&d| depth[d].timestamp_s <= time - max_difference_s);
        for &d in &by_time[first..] {
            let difference = (depth[d].timestamp_s - time).abs();
            if difference >= max_difference_s {
                break;
            }
            pairs.push((difference, c, d));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
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

    fn entries(times: &[f64]) -> Vec<Entry> {
        let entry = |&timestamp_s| Entry { timestamp_s, path: "x".into(), line: 1 };
        times.iter().map(entry).collect()
    }

    #[test]
    fn the_nearest_pair_goes_first_and_uses_its_images_up() {
        // The second color image is nearer to the only depth image than the first one is.
        let pairs = nearest_pairs(&entries(&[1.000, 1.012]), &entries(&[1.010]), 0.02);
        assert_eq!(
            nearest_pairs(&entries(&[1.000, 1.012]), &entries(&[1.010, 0.981]), 0.02),
            [Some(1), Some(0)]
        );
        // Without another one the first shares it.
        assert_eq!(pairs, [Some(0), Some(0)]);
        // The first loses its nearest to the second and takes the other one.
        let pairs = nearest_pairs(&entries(&[1.000, 1.004]), &entries(&[0.985, 1.003]), 0.02);
        assert_eq!(pairs, [Some(0), Some(1)]);
    }

    #[test]
    fn images_too_far_apart_are_no_pair_and_order_does_not_matter() {
        let pairs = nearest_pairs(&entries(&[3.0, 1.0, 2.0]), &entries(&[2.001, 3.5, 0.999]), 0.02);
        assert_eq!(pairs, [None, Some(2), Some(0)]);
        assert_eq!(nearest_pairs(&entries(&[1.0]), &[], 0.02), [None]);
        assert_eq!(nearest_pairs(&entries(&[0.0]), &entries(&[0.02]), 0.02), [None]);
    }
}
