//! Keyframes that follow each other in time and are voted for together are one island (Garcia-Fidalgo and
//! Ortiz, RA-L 2018).
//!
//! A point is seen by some keyframes in a row, and so is the place that a query comes back to: what their
//! sum says is clear before what one of them says is. Knows nothing of descriptors.

use std::ops::Range;

/// Keyframes to each side that are counted together. A point stays in sight for about ten keyframes, so
/// that those further away see another place.
pub(super) const REACH: usize = 5;

/// Keyframes that were voted for together.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Island {
    /// Its keyframes, as indices in the order of time.
    pub(super) members: Range<usize>,
    /// The one with most votes.
    pub(super) best: usize,
}

/// The `count` islands with most votes, best first; they do not overlap. `votes` are in the order of time,
/// those of each run of `runs` by themselves: islands do not reach from one into the next.
pub(super) fn islands(votes: &[f64], runs: &[Range<usize>], count: usize) -> Vec<Island> {
    let mut sums = vec![0.0; votes.len()];
    for run in runs {
        for at in run.clone() {
            sums[at] = votes[around(at, REACH, run)].iter().sum();
        }
    }
    let mut found = Vec::new();
    while found.len() < count {
        let Some(middle) = first_largest(&sums, 0..sums.len()) else { break };
        let Some(run) = runs.iter().find(|run| run.contains(&middle)) else { break };
        let members = around(middle, REACH, run);
        let Some(best) = first_largest(votes, members.clone()) else { break };
        sums[around(middle, 2 * REACH, run)].fill(0.0);
        found.push(Island { members, best });
    }
    found
}

fn around(at: usize, reach: usize, run: &Range<usize>) -> Range<usize> {
    at.saturating_sub(reach).max(run.start)..(at + reach + 1).min(run.end)
}

/// Where the largest positive value is; the first of equal ones.
fn first_largest(values: &[f64], within: Range<usize>) -> Option<usize> {
    let start = within.start;
    let mut best: Option<(usize, f64)> = None;
    for (at, &value) in values[within].iter().enumerate() {
        if value > best.map_or(0.0, |(_, largest)| largest) {
            best = Some((start + at, value));
        }
    }
    best.map(|(at, _)| at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbors_in_time_are_one_island_and_runs_are_not_mixed() {
        let mut votes = vec![0.0; 60];
        // One strong keyframe alone, against a row of weak ones.
        votes[10] = 4.0;
        votes[30..36].fill(1.0);
        // At the border of two runs.
        votes[49..52].fill(0.5);
        let found = islands(&votes, &[0..50, 50..60], 9);
        let best: Vec<usize> = found.iter().map(|island| island.best).collect();
        assert_eq!(best, [30, 10, 50, 49]);
        assert_eq!(found[2].members, 50..56);
        assert_eq!(found[3].members.end, 50);
        assert!(islands(&[0.0; 9], &[0..4, 4..9], 3).is_empty(), "nothing was voted for");
        assert!(islands(&[], &[], 3).is_empty());
    }
}
