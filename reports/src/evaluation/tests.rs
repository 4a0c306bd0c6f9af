//! Matching rules, alignment and statistics on small cases with known answers.

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::io::trajectory::Trajectory;
use nalgebra::{Vector3, Vector6};

use super::matching::{align, associate};
use super::{EvaluationError, Statistics, ape, rpe};

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
    let difference = absolute.truth_from_estimate.minus(&estimate_from_truth.inverse());
    assert!(difference.norm() < 1e-11, "{difference}");
    let relative = rpe(&truth, &estimate, 0.01).unwrap();
    assert_eq!(relative.translation_m.count, 49);
    assert!(relative.translation_m.max < 1e-13 && relative.angle_deg.max < 1e-11);
}

#[test]
fn a_mirrored_set_is_aligned_by_a_rotation() {
    let points: Vec<Vector3<f64>> =
        walk(20).world_from_body.iter().map(|p| p.translation).collect();
    let mirrored: Vec<Vector3<f64>> = points.iter().map(|p| Vector3::new(-p.x, p.y, p.z)).collect();
    let motion = align(&points, &mirrored).unwrap();
    assert!((motion.rotation.matrix().determinant() - 1.0).abs() < 1e-12);
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
