//! Relative pose errors over a fixed time, as `evaluate_rpe.py` of the TUM RGB-D benchmark defines
//! them: with `--fixed_delta --delta_unit s --max_pairs 0`. Papers that report a drift in m/s and °/s
//! mean this one, with a delta of 1 s.
//!
//! For each pose i of the estimate, j is the one whose stamp is nearest to t_i + delta; no j is the
//! last pose, which is nearest to all that lies past the end. The truth of each is its pose nearest
//! in time, not interpolated; a pair is dropped where that is further away than twice the median
//! interval of the truth. With M = P_j⁻¹ · P_i of either trajectory,
//!
//! E = M_estimate⁻¹ · M_truth.
//!
//! Evo's definition (the head of [`super`]) composes in another order and pairs what was matched,
//! so the figures differ. Angles are computed without the script's acos, which loses half of the
//! digits near 0. Of poses with equal stamps the last one counts, as in the script.

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::io::trajectory::Trajectory;

use super::{Alignment, Evaluation, EvaluationError, Pair, PoseError, Statistics, evaluation};

/// Relative pose errors between poses of the estimate that are `delta_s` seconds apart, without alignment.
///
/// # Errors
/// As those of [`rpe_over_aligned`].
pub fn rpe_over(
    truth: &Trajectory,
    estimate: &Trajectory,
    delta_s: f64,
) -> Result<Evaluation, EvaluationError> {
    rpe_over_aligned(truth, estimate, delta_s, Alignment::NONE)
}

/// Relative pose errors between poses of the estimate that are `delta_s` seconds apart, after an alignment
/// by the poses that have a truth.
///
/// `pairs` of the result is how many pairs were compared. With a delta of 1 s the translation is in
/// meters a second, and the angle in degrees a second.
///
/// # Errors
/// [`EvaluationError`] where the delta is not a positive number, fewer than two poses of either can
/// be matched by time, the alignment is not determined, or fewer than two pairs are left.
pub fn rpe_over_aligned(
    truth: &Trajectory,
    estimate: &Trajectory,
    delta_s: f64,
    alignment: Alignment,
) -> Result<Evaluation, EvaluationError> {
    if !(delta_s.is_finite() && delta_s > 0.0) {
        return Err(EvaluationError::InvalidDelta { value: delta_s });
    }
    let (truth, mut estimate) = (Ordered::new(truth), Ordered::new(estimate));
    let pairs = matched_poses(&truth, &estimate);
    if pairs < 2 || truth.stamps.len() < 2 {
        return Err(EvaluationError::TooFewPairs { pairs });
    }
    let intervals: Vec<_> = truth.stamps.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let limit = 2.0 * Statistics::of(&intervals).median;
    let true_poses: Vec<Option<usize>> = estimate
        .stamps
        .iter()
        .map(|&stamp| {
            let nearest = truth.nearest(stamp);
            ((truth.stamps[nearest] - stamp).abs() <= limit).then_some(nearest)
        })
        .collect();
    let pair = |(i, of_truth): (usize, &Option<usize>)| {
        let (truth, estimate_s) = (truth.poses[(*of_truth)?], estimate.stamps[i]);
        Some(Pair { truth, estimate: estimate.poses[i], estimate_s })
    };
    let pairs: Vec<Pair> = true_poses.iter().enumerate().filter_map(pair).collect();
    let truth_from_estimate = alignment.of(&pairs)?;
    alignment.move_poses(&truth_from_estimate, estimate.poses.iter_mut());
    let last = estimate.stamps.len() - 1;
    let mut errors = Vec::new();
    for (i, &stamp) in estimate.stamps.iter().enumerate() {
        let j = estimate.nearest(stamp + delta_s);
        if j == last {
            continue;
        }
        let (Some(true_i), Some(true_j)) = (true_poses[i], true_poses[j]) else { continue };
        let error = estimate.motion(i, j).inverse().compose(&truth.motion(true_i, true_j));
        let of_truth = [&truth.poses[true_i], &truth.poses[true_j]];
        let of_estimate = [&estimate.poses[i], &estimate.poses[j]];
        errors.push(PoseError::of_motion(stamp, of_truth, of_estimate, &error));
    }
    let pairs = errors.len();
    if pairs < 2 {
        return Err(EvaluationError::TooFewApart { pairs, delta_s });
    }
    Ok(evaluation(pairs, truth_from_estimate, errors))
}

/// A trajectory in the order of its stamps, each of them once.
struct Ordered {
    stamps: Vec<f64>,
    poses: Vec<Se3>,
}

impl Ordered {
    fn new(trajectory: &Trajectory) -> Self {
        let mut order: Vec<usize> = (0..trajectory.len()).collect();
        order.sort_by(|&a, &b| trajectory.timestamps[a].total_cmp(&trajectory.timestamps[b]));
        // The sort is stable: of equal stamps the last one read comes last.
        let mut ordered = Self { stamps: Vec::new(), poses: Vec::new() };
        for index in order {
            if ordered.stamps.last() == Some(&trajectory.timestamps[index]) {
                ordered.stamps.pop();
                ordered.poses.pop();
            }
            ordered.stamps.push(trajectory.timestamps[index]);
            ordered.poses.push(trajectory.world_from_body[index]);
        }
        ordered
    }

    /// Index of the stamp nearest to `time`, 0 where there is none. Of two equally near ones it is
    /// the one that a search by halves meets first, as the script's does.
    fn nearest(&self, time: f64) -> usize {
        let distance = |index: usize| (self.stamps[index] - time).abs();
        let (mut low, mut high, mut best) = (0, self.stamps.len(), 0);
        while low < high {
            let middle = low.midpoint(high);
            if distance(middle) < distance(best) {
                best = middle;
            }
            if self.stamps[middle] > time {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        best
    }

    /// P_j⁻¹ · P_i.
    fn motion(&self, i: usize, j: usize) -> Se3 {
        self.poses[j].inverse().compose(&self.poses[i])
    }
}

/// How many poses of the estimate are the nearest to the truth that is nearest to some pose of it:
/// without an overlap in time there is one such pose, an end.
fn matched_poses(truth: &Ordered, estimate: &Ordered) -> usize {
    if truth.stamps.is_empty() {
        return 0;
    }
    let back = |&stamp: &f64| estimate.nearest(truth.stamps[truth.nearest(stamp)]);
    let mut matched: Vec<usize> = estimate.stamps.iter().map(back).collect();
    matched.sort_unstable();
    matched.dedup();
    matched.len()
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::So3;
    use nalgebra::{Vector3, Vector6};

    use super::super::Correction;
    use super::*;

    fn along(stamps: &[f64], pose: impl Fn(f64) -> Se3) -> Trajectory {
        let mut trajectory = Trajectory::default();
        stamps.iter().for_each(|&stamp| trajectory.push(stamp, pose(stamp)));
        trajectory
    }

    fn at(x: f64, y: f64) -> Se3 {
        Se3::new(So3::identity(), Vector3::new(x, y, 0.0))
    }

    fn seconds(count: usize, step: f64) -> Vec<f64> {
        (0..count).map(|k| 100.0 + step * k as f64).collect()
    }

    #[test]
    fn the_drift_of_a_hand_computed_sequence() {
        // Every 0.5 s; the estimate runs 10 % too far along x, and at 102 s it slips by 0.3 along y.
        let stamps = seconds(9, 0.5);
        let truth = along(&stamps, |t| at(t - 100.0, 0.0));
        let slip = |t: f64| if t >= 102.0 { 0.3 } else { 0.0 };
        let estimate = along(&stamps, |t| at(1.1 * (t - 100.0), slip(t)));
        let result = rpe_over(&truth, &estimate, 1.0).unwrap();
        // Pairs (100, 101) to (102.5, 103.5); that to 104, the last pose, is left out, and so are
        // those of 103.5 and 104, whose partner is the last one. Two of six see the slip.
        assert_eq!((result.pairs, result.translation_m.count), (6, 6));
        let slipped = 0.1_f64.hypot(0.3);
        let close = |ours: f64, expected: f64| {
            assert!((ours - expected).abs() < 1e-12, "{ours}, not {expected}");
        };
        close(result.translation_m.rmse, ((4.0 * 0.01 + 2.0 * 0.1) / 6.0_f64).sqrt());
        close(result.translation_m.mean, (0.4 + 2.0 * slipped) / 6.0);
        close(result.translation_m.median, 0.1);
        close(result.translation_m.max, slipped);
        close(result.angle_deg.max, 0.0);
        // Half a second: the error is half as large.
        let result = rpe_over(&truth, &estimate, 0.5).unwrap();
        assert_eq!(result.pairs, 7);
        close(result.translation_m.min, 0.05);
    }

    #[test]
    fn a_turn_that_is_too_fast_is_reported_in_degrees_a_second() {
        let stamps = seconds(40, 0.1);
        let turn = |rate: f64| {
            move |t: f64| Se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, rate * (t - 100.0)))
        };
        let result = rpe_over(&along(&stamps, turn(0.5)), &along(&stamps, turn(0.6)), 1.0).unwrap();
        assert!((result.angle_deg.rmse - 0.1_f64.to_degrees()).abs() < 1e-9);
        assert!(result.translation_m.max < 1e-12);
    }

    #[test]
    fn a_scale_of_its_own_is_corrected_by_the_poses_that_have_a_truth() {
        let stamps = seconds(40, 0.1);
        let path = |t: f64| Vector3::new(t.sin(), 0.3 * t, (2.0 * t).cos());
        let pose = |scale: f64| move |t: f64| Se3::new(So3::identity(), path(t) * scale);
        let (truth, mut estimate) = (along(&stamps, pose(1.0)), along(&stamps, pose(0.4)));
        // Without a truth near in time, a pose does not count.
        estimate.push(500.0, at(1e3, 1e3));
        let over = |correction| {
            let alignment = Alignment { correction, first_poses: None };
            rpe_over_aligned(&truth, &estimate, 1.0, alignment).unwrap()
        };
        for correction in [Correction::Sim3, Correction::Scale] {
            let result = over(correction);
            assert!((result.truth_from_estimate.scale - 2.5).abs() < 1e-12, "{correction:?}");
            assert!(result.translation_m.max < 1e-12, "{correction:?}");
        }
        assert_eq!(over(Correction::None), rpe_over(&truth, &estimate, 1.0).unwrap());
        assert!(over(Correction::Se3).translation_m.rmse > 0.1);
    }

    #[test]
    fn truth_that_is_too_far_in_time_drops_the_pair() {
        // The truth has a hole from 101 to 103; its median interval is 0.125 s, the limit 0.25 s.
        let mut times = seconds(9, 0.125);
        times.extend(seconds(9, 0.125).iter().map(|t| t + 3.0));
        let truth = along(&times, |t| at(t, 0.0));
        let estimate = along(&seconds(33, 0.125), |t| at(t, 0.0));
        let result = rpe_over(&truth, &estimate, 0.5).unwrap();
        // i from 100 to 100.75, and from 102.75 to 103.375: seven and six.
        assert_eq!(result.pairs, 13);
        // The truth is not interpolated: 102.75 has that of 103.
        assert_eq!(result.translation_m.max, 0.25);
    }

    #[test]
    fn order_and_equal_stamps_do_not_matter() {
        let stamps = seconds(30, 0.1);
        let truth = along(&stamps, |t| at(t, 0.0));
        let estimate = along(&stamps, |t| at(1.2 * t, 0.0));
        let mut shuffled = Trajectory::default();
        shuffled.push(stamps[7], at(-5.0, 3.0));
        for k in 0..30 {
            shuffled.push(stamps[k * 7 % 30], estimate.world_from_body[k * 7 % 30]);
        }
        assert_eq!(rpe_over(&truth, &shuffled, 1.0), rpe_over(&truth, &estimate, 1.0));
    }

    #[test]
    fn what_cannot_be_compared_is_an_error() {
        let path = |stamps: &[f64]| along(stamps, |t| at(t, 0.0));
        let truth = path(&seconds(50, 0.1));
        let none = Trajectory::default();
        let check = |truth: &Trajectory, estimate: &Trajectory, delta: f64, text: &str| {
            let error = rpe_over(truth, estimate, delta).unwrap_err().to_string();
            assert!(error.contains(text), "{error}");
        };
        for delta in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            check(&truth, &truth, delta, "must be finite and positive");
        }
        check(&none, &truth, 1.0, "0 matched poses");
        check(&truth, &none, 1.0, "0 matched poses");
        check(&path(&[100.0]), &truth, 1.0, "1 matched poses");
        check(&truth, &path(&[900.0, 901.0, 902.0]), 1.0, "1 matched poses");
        check(&truth, &path(&seconds(5, 0.1)), 1.0, "0 pairs of poses are 1 s apart");
    }
}
