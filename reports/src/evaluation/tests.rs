//! Matching rules, alignment, pairs of motions and statistics on small cases with known answers.

use std::num::NonZeroUsize;

use covis_solvers::geometry::{LieGroup, Se3, Sim3, So3};
use covis_solvers::io::trajectory::Trajectory;
use nalgebra::{Vector3, Vector6};

use super::alignment::umeyama;
use super::matching::associate;
use super::*;

#[test]
fn the_shorter_trajectory_walks_and_ties_go_to_the_earlier_stamp() {
    let check = |truth: &[f64], estimate: &[f64], limit: f64, expected: &[(usize, usize)]| {
        assert_eq!(associate(truth, estimate, limit), expected, "{truth:?} {estimate:?}");
    };
    // 0.5 is as far from 0 as from 1; the estimate walks.
    check(&[0.0, 1.0, 2.0], &[0.5, 2.0], 0.5, &[(0, 0), (2, 1)]);
    // The truth is shorter and walks; pairs stay (truth, estimate).
    check(&[0.5, 2.0], &[0.0, 1.0, 2.0], 0.5, &[(0, 0), (1, 2)]);
    // The limit is inclusive, past the ends too.
    check(&[1.0, 2.0], &[0.75, 2.25], 0.25, &[(0, 0), (1, 1)]);
    check(&[1.0, 2.0], &[0.74, 2.26], 0.25, &[]);
    // Two stamps may share a partner.
    check(&[1.0, 5.0], &[0.9, 1.1], 0.2, &[(0, 0), (0, 1)]);
    // Of equal stamps the last before the insertion point is hit.
    check(&[1.0, 1.0, 3.0], &[1.0], 0.1, &[(1, 0)]);
    // Unsorted stamps are searched one by one, the first of the nearest wins.
    check(&[3.0, 1.0, 1.0], &[1.1], 0.2, &[(1, 0)]);
    check(&[], &[], 0.1, &[]);
}

fn walk(count: usize) -> Trajectory {
    let mut trajectory = Trajectory::default();
    for k in 0..count {
        let s = 0.1 * k as f64;
        let tangent = Vector6::new(s, s.sin(), 0.3 * (2.0 * s).cos(), 0.1 * s, -0.2, 0.05 * s);
        trajectory.push(100.0 + s, Se3::exp(&tangent));
    }
    trajectory
}

#[test]
fn a_moved_trajectory_has_no_error_and_gives_its_motion_back() {
    let truth = walk(50);
    let estimate_from_truth = Se3::exp(&Vector6::new(1.0, -2.0, 0.5, 0.4, -1.2, 2.0));
    let mut estimate = truth.clone();
    for pose in &mut estimate.world_from_body {
        *pose = estimate_from_truth.compose(pose);
    }
    let absolute = ape(&truth, &estimate, 0.01).unwrap();
    assert_eq!(absolute.pairs, 50);
    assert!(absolute.translation_m.max < 1e-13, "{absolute:?}");
    assert!(absolute.angle_deg.max < 1e-11, "{absolute:?}");
    let motion = absolute.truth_from_estimate.rigid();
    let difference = motion.minus(&estimate_from_truth.inverse());
    assert!(difference.norm() < 1e-11, "{difference}");
    let relative = rpe(&truth, &estimate, 0.01).unwrap();
    assert_eq!(relative.translation_m.count, 49);
    assert!(relative.translation_m.max < 1e-13 && relative.angle_deg.max < 1e-11);
}

#[test]
fn a_mirrored_set_is_aligned_by_a_rotation() {
    let pair = |truth: Se3| {
        let mut estimate = truth;
        estimate.translation.x *= -1.0;
        Pair { truth, estimate, estimate_s: 0.0 }
    };
    let pairs: Vec<Pair> = walk(20).world_from_body.into_iter().map(pair).collect();
    for with_scale in [false, true] {
        let motion = umeyama(&pairs, with_scale).unwrap();
        assert!((motion.rotation.matrix().determinant() - 1.0).abs() < 1e-12);
        assert!(motion.scale > 0.0 && motion.scale <= 1.0, "{}", motion.scale);
    }
}

fn moved_by(trajectory: &Trajectory, similarity: &Sim3) -> Trajectory {
    let mut moved = trajectory.clone();
    moved.world_from_body.iter_mut().for_each(|p| *p = similarity.transform_pose(p));
    moved
}

fn corrected(correction: Correction) -> Alignment {
    Alignment { correction, first_poses: None }
}

#[test]
fn each_correction_undoes_what_it_can_and_no_more() {
    let truth = walk(50);
    let turn = Se3::exp(&Vector6::new(1.0, -2.0, 0.5, 0.4, -1.2, 2.0));
    let errors = |estimate: &Trajectory, correction| {
        let result = ape_aligned(&truth, estimate, 0.01, corrected(correction)).unwrap();
        (result.translation_m.max, result.truth_from_estimate)
    };
    let similarity = Sim3::new(turn.rotation, turn.translation, 0.25);
    let estimate = moved_by(&truth, &similarity);
    let (error, found) = errors(&estimate, Correction::Sim3);
    assert!(error < 1e-12, "{error}");
    assert!(found.minus(&similarity.inverse()).norm() < 1e-11);
    assert!(errors(&estimate, Correction::Se3).0 > 0.1);
    // The scale alone is about the origin, and is that of the similarity.
    let (error, found) = errors(&estimate, Correction::Scale);
    assert!((found.scale - 4.0).abs() < 1e-12 && error > 0.1);
    assert_eq!(found.rigid(), Se3::identity());
    let scaled = moved_by(&truth, &Sim3::new(So3::identity(), Vector3::zeros(), 0.25));
    assert!(errors(&scaled, Correction::Scale).0 < 1e-12);
    // Of a rigid motion the first pose tells all; without a correction the numbers stay as they are.
    let turned = moved_by(&truth, &turn.into());
    assert!(errors(&turned, Correction::Origin).0 < 1e-12);
    let (error, found) = errors(&truth, Correction::None);
    assert!(error < 1e-14 && found == Sim3::identity());
    assert!(errors(&turned, Correction::None).0 > 1.0);
}

#[test]
fn an_alignment_by_the_first_poses_does_not_see_the_later_ones() {
    let truth = walk(50);
    let mut estimate = truth.clone();
    for pose in &mut estimate.world_from_body[20..] {
        pose.translation.x += 0.5;
    }
    let by = |poses| {
        let alignment =
            Alignment { correction: Correction::Sim3, first_poses: NonZeroUsize::new(poses) };
        ape_aligned(&truth, &estimate, 0.01, alignment)
    };
    let result = by(20).unwrap();
    assert!((result.translation_m.max - 0.5).abs() < 1e-11 && result.pairs == 50);
    assert!(by(50).unwrap().translation_m.max < 0.49);
    assert_eq!(by(50), by(1000));
    // Two poses lie on a line.
    assert_eq!(by(2), Err(EvaluationError::Degenerate { pairs: 2, rank: 1 }));
}

/// Poses along x at these places, turned about z by as many radians.
fn along(places: &[f64]) -> Vec<Se3> {
    let turn = |x: f64| So3::exp(&Vector3::new(0.0, 0.0, x));
    places.iter().map(|&x| Se3::new(turn(x), Vector3::new(x, 0.0, 0.0))).collect()
}

#[test]
fn motions_are_consecutive_or_begin_at_each_pose() {
    let check = |places: &[f64], motions: &MotionPairs, expected: &[(usize, usize)]| {
        assert_eq!(motions.among(&along(places)).unwrap(), expected, "{motions:?}");
    };
    let places = [0.0, 1.0, 2.0, 2.0, 3.5, 4.0, 6.0];
    let by = |delta, unit, all_pairs| MotionPairs { delta, unit, all_pairs, ..Default::default() };
    check(&places, &by(3.0, DeltaUnit::Frames, false), &[(0, 3), (3, 6)]);
    check(&places, &by(4.0, DeltaUnit::Frames, true), &[(0, 4), (1, 5), (2, 6)]);
    // Each pair begins where the last one ended, however far beyond delta that was.
    check(&places, &by(2.0, DeltaUnit::Meters, false), &[(0, 2), (2, 5), (5, 6)]);
    check(&places, &by(1.25, DeltaUnit::Radians, false), &[(0, 2), (2, 4), (4, 6)]);
    // Of the poses at one place the first, and none that is off by more than the tolerance.
    let exact = MotionPairs { tolerance: 0.0, ..by(2.0, DeltaUnit::Meters, true) };
    check(&places, &exact, &[(0, 2), (2, 5), (3, 5), (5, 6)]);
    let wide = MotionPairs { tolerance: 0.25, ..exact };
    check(&places, &wide, &[(0, 2), (1, 4), (2, 5), (3, 5), (4, 6), (5, 6)]);
    // By angle all of the later poses count, on the direct way: from 4 to 6 is a turn of 2.
    let turned = MotionPairs { tolerance: 0.1, ..by(2.0, DeltaUnit::Radians, true) };
    check(&places, &turned, &[(0, 2), (0, 3), (2, 5), (3, 5), (5, 6)]);
    let degrees = MotionPairs { delta: 2.0_f64.to_degrees(), unit: DeltaUnit::Degrees, ..turned };
    check(&places, &degrees, &[(0, 2), (0, 3), (2, 5), (3, 5), (5, 6)]);
    // A path adds up what the direct way does not.
    let back = [0.0, 1.0, 0.0, 1.0, 0.0];
    check(&back, &by(2.5, DeltaUnit::Radians, false), &[(0, 3)]);
    check(&back, &by(3.0, DeltaUnit::Meters, true), &[(0, 3), (1, 4)]);
}

#[test]
fn the_nearest_on_a_path_is_the_first_of_the_nearest() {
    let mut state = 11_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        // Quarters, so that places repeat and sums are exact.
        (state >> 33) as f64 % 4.0 * 0.25
    };
    for count in 2..40 {
        let mut x = 0.0;
        let mut place = || {
            x += next();
            x
        };
        let places: Vec<f64> = (0..count).map(|_| place()).collect();
        for delta in [0.25, 0.5, 1.1, 3.0] {
            let motions = MotionPairs {
                delta,
                unit: DeltaUnit::Meters,
                all_pairs: true,
                tolerance: 0.3,
                from_truth: false,
            };
            let off = |i: usize, j: usize| (places[j] - places[i] - delta).abs();
            let pair = |i: usize| {
                let nearest = (i + 1..count).min_by(|&a, &b| off(i, a).total_cmp(&off(i, b)))?;
                (off(i, nearest) <= 0.3 * delta).then_some((i, nearest))
            };
            let expected: Vec<_> = (0..count).filter_map(pair).collect();
            let found = motions.among(&along(&places)).unwrap_or_default();
            assert_eq!(found, expected, "{places:?} {delta}");
        }
    }
}

#[test]
fn relations_are_figures_of_one_error() {
    let mut truth = walk(4);
    // The truth rests between the last two poses, the estimate turns and drifts there.
    truth.world_from_body[3] = truth.world_from_body[2];
    let mut estimate = truth.clone();
    let drift = Se3::exp(&Vector6::new(0.3, 0.0, 0.4, 0.0, 0.0, 0.2));
    estimate.world_from_body[3] = truth.world_from_body[3].compose(&drift);
    let result = rpe(&truth, &estimate, 0.01).unwrap();
    let max = |relation| result.statistics(relation).unwrap().max;
    let length = drift.translation.norm();
    for (relation, expected) in [
        (PoseRelation::TranslationPart, length),
        (PoseRelation::PointDistance, length),
        (PoseRelation::AngleRad, 0.2),
        (PoseRelation::AngleDeg, 0.2_f64.to_degrees()),
        (PoseRelation::RotationPart, 8.0_f64.sqrt() * 0.1_f64.sin()),
        (PoseRelation::Full, (8.0 * 0.1_f64.sin().powi(2) + length * length).sqrt()),
        // The one that would divide by 0 is left out; the others have no error.
        (PoseRelation::PointDistanceErrorRatio, 0.0),
    ] {
        assert!((max(relation) - expected).abs() < 1e-12, "{relation:?}: {}", max(relation));
    }
    assert_eq!(result.statistics(PoseRelation::PointDistanceErrorRatio).unwrap().count, 2);
    // Twice as far is wrong by all of the length, whatever the direction.
    let twice = moved_by(&truth, &Sim3::new(So3::identity(), Vector3::zeros(), 2.0));
    let ratio = rpe(&truth, &twice, 0.01).unwrap();
    let ratio = ratio.statistics(PoseRelation::PointDistanceErrorRatio).unwrap();
    assert!((ratio.min - 100.0).abs() < 1e-9 && (ratio.max - 100.0).abs() < 1e-9);
    let still = Trajectory { world_from_body: vec![Se3::identity(); 4], ..truth.clone() };
    let still = rpe(&still, &estimate, 0.01).unwrap();
    let none = still.statistics(PoseRelation::PointDistanceErrorRatio);
    assert_eq!(none, Err(EvaluationError::NoRatio));
}

#[test]
fn what_cannot_be_compared_is_named() {
    let truth = walk(10);
    let mut line = truth.clone();
    for (k, pose) in line.world_from_body.iter_mut().enumerate() {
        *pose = Se3::exp(&Vector6::new(k as f64, 0.0, 0.0, 0.0, 0.0, 0.0));
    }
    let degenerate = ape(&line, &line, 0.01);
    assert_eq!(degenerate, Err(EvaluationError::Degenerate { pairs: 10, rank: 1 }));
    let mut late = truth.clone();
    late.timestamps.iter_mut().for_each(|t| *t += 100.0);
    let none = Err(EvaluationError::NoMatches { max_difference_s: 0.01 });
    assert_eq!(ape(&truth, &late, 0.01), none);
    let one = walk(1);
    assert_eq!(rpe(&one, &one, 0.01), Err(EvaluationError::TooFewPairs { pairs: 1 }));
    assert!(matches!(
        ape(&truth, &truth, f64::NAN),
        Err(EvaluationError::InvalidTimeDifference { .. })
    ));
    let refused = |delta, unit, tolerance, text: &str| {
        let motions = MotionPairs { delta, unit, tolerance, ..Default::default() };
        let error = rpe_between(&truth, &truth, 0.01, Alignment::NONE, &motions).unwrap_err();
        assert!(error.to_string().contains(text), "{error}");
    };
    refused(0.0, DeltaUnit::Meters, 0.1, "a delta of 0 m");
    refused(f64::NAN, DeltaUnit::Frames, 0.1, "must be finite and positive");
    refused(1.5, DeltaUnit::Frames, 0.1, "must be a whole number");
    refused(181.0, DeltaUnit::Degrees, 0.1, "must be at most 180");
    refused(3.2, DeltaUnit::Radians, 0.1, "must be at most pi");
    refused(1.0, DeltaUnit::Meters, -0.1, "tolerance of the delta is -0.1");
    refused(10.0, DeltaUnit::Frames, 0.1, "a delta of 10 poses apart");
    refused(1e30, DeltaUnit::Frames, 0.1, "no two matched poses");
    refused(1e3, DeltaUnit::Meters, 0.1, "a delta of 1000 m apart");
}

#[test]
fn statistics_of_a_short_list() {
    let s = Statistics::of(&[3.0, 1.0, 2.0, 4.0]);
    assert_eq!((s.count, s.mean, s.median, s.min, s.max, s.sse), (4, 2.5, 2.5, 1.0, 4.0, 30.0));
    assert_eq!(s.rmse, 7.5_f64.sqrt());
    assert_eq!(s.std, 1.25_f64.sqrt());
    assert_eq!(Statistics::of(&[3.0, 1.0, 2.0]).median, 2.0);
    assert_eq!(Statistics::of(&[]).count, 0);
}
