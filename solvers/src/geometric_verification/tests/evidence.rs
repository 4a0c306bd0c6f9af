//! What counts as evidence: matches of one patch count once, and what a pose shows must match all over.

use super::super::*;
use super::scene::{Made, Scene, verdict_of};
use super::{exact, reason, same};

/// The verdict where each point is like the feature of its number.
fn verdict(made: &Made) -> Verdict {
    let likeness = |point: usize, feature: usize| match point == feature {
        true => Likeness::Distance(0.1),
        false => Likeness::Different,
    };
    verify(&made.input(), &likeness, &Options::default()).unwrap()
}

/// Each corner of a scene of `count`, `times` times: some pixels from each other.
fn repeated(count: usize, times: usize) -> Made {
    let mut made = Scene { count, ..Scene::default() }.make(2);
    let (points, features) = (made.points.clone(), made.features.clone());
    for k in 1..times {
        let shift = Vector2::new(k as f64, -0.5 * k as f64);
        made.points.extend_from_slice(&points);
        made.features.extend(features.iter().map(|f| Feature { pixel: f.pixel + shift, ..*f }));
    }
    let pair = |k: usize| Proposed { point: k, feature: k, weight: 1.0 };
    made.matches = (0..made.points.len()).map(pair).collect();
    made
}

#[test]
fn matches_of_one_corner_are_one_piece_of_evidence() {
    // Twenty matches, as many as a pose of chance never has, are five corners.
    let few = repeated(5, 4);
    let Verdict::Doubtful(verified, Refusal::TooFewInliers { inliers, needed }) = verdict(&few)
    else {
        panic!("{:?}", verdict(&few));
    };
    let proposed = few.proposed_among(&verified);
    assert!(proposed >= 15 && inliers == 5 && needed > 5, "{inliers} of {needed}");
    // Thirty corners are enough, however often each is found.
    let made = repeated(30, 4);
    let many = verdict(&made);
    let many = same(&many);
    let proposed = made.proposed_among(many);
    assert!((25..=30).contains(&many.independent) && proposed > 90, "{many:?}");
    // They say no more than each of them once.
    let once = verdict(&repeated(30, 1));
    let ratio = many.information.matrix().trace() / same(&once).information.matrix().trace();
    assert!((0.5..2.0).contains(&ratio), "{ratio}");
}

#[test]
fn a_pose_by_which_only_a_part_of_the_image_matches_is_doubtful() {
    for query_depth in [false, true] {
        let mut made = Scene { count: 600, query_depth, ..Scene::default() }.make(1);
        assert_eq!(reason(&verdict_of(&made, &exact())), "same");
        let is_inside = |feature: &Feature| {
            let from = feature.pixel - Vector2::new(230.0, 200.0);
            from.x.abs() < 90.0 && from.y.abs() < 90.0
        };
        let inside: Vec<bool> = made.features.iter().map(is_inside).collect();
        made.matches.retain(|m| inside[m.feature]);
        made.unlike_from = Some((0..inside.len()).filter(|&f| !inside[f]).collect());
        assert!(made.matches.len() > 40, "{}", made.matches.len());
        assert_eq!(reason(&verdict_of(&made, &exact())), "unexplained");
    }
}

#[test]
fn a_half_of_the_image_that_is_hidden_makes_no_doubt() {
    let mut made = Scene { count: 600, ..Scene::default() }.make(1);
    let inside: Vec<bool> = made.features.iter().map(|f| f.pixel.x < 330.0).collect();
    made.matches.retain(|m| inside[m.feature]);
    made.unlike_from = Some((0..inside.len()).filter(|&f| !inside[f]).collect());
    let verdict = verdict_of(&made, &exact());
    let error = same(&verdict).candidate_from_query.minus(&made.truth);
    assert!(error.norm() < 0.1, "{error}");
}

#[test]
fn further_matches_look_as_alike_as_those_that_agree() {
    let made = Scene { proposed: 0.5, ..Scene::default() }.make(4);
    let mut is_proposed = vec![false; made.points.len()];
    made.matches.iter().for_each(|m| is_proposed[m.point] = true);
    let inliers = |of_others: f64| {
        let likeness = |point: usize, feature: usize| match point == feature {
            true if is_proposed[point] => Likeness::Distance(0.16),
            true => Likeness::Distance(of_others),
            false => Likeness::Different,
        };
        let verdict = verify(&made.input(), &likeness, &Options::default()).unwrap();
        same(&verdict).inliers.len()
    };
    let proposed = made.matches.len();
    assert!(inliers(0.15) > proposed + proposed / 2);
    assert!(inliers(0.29) <= proposed, "what chance makes alike");
}

#[test]
fn a_match_with_a_point_before_the_lens_moves_nothing() {
    let mut made = Scene { query_depth: false, ..Scene::default() }.make(5);
    let likely = verdict(&made);
    let before = same(&likely);
    // Its own covariance spreads it over the image, so that any feature fits.
    let near = Vector3::new(-0.003, 0.004, 0.02);
    let pixel = made.camera.project(&near).unwrap() + Vector2::new(25.0, -20.0);
    let covariance = nalgebra::Matrix3::identity() * 0.003_f64.powi(2);
    made.points.push(PointEstimate { point: made.truth.transform(&near), covariance });
    made.features.push(Feature { pixel, sigma_px: 1.0, depth_m: None });
    let last = made.points.len() - 1;
    made.matches.push(Proposed { point: last, feature: last, weight: 1.0 });
    let verdict = verdict(&made);
    let after = same(&verdict);
    assert!(after.inliers.iter().all(|&(point, _)| point != last));
    let moved = after.candidate_from_query.minus(&before.candidate_from_query);
    assert!(before.information.squared_norm(&moved) < 0.01, "{moved}");
}
