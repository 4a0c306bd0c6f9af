//! Relative poses of made scenes: their error beside their information, outliers, missing depth. Uses
//! seeded sampling alone; nothing here reads files.

use nalgebra::{Vector2, Vector3, Vector6};
use rand::Rng;

use super::*;
use crate::geometry::PinholeRadialTangential;
use crate::testing::random::{normal_vector, perturbed, seeded, uniform_vector};

const SIGMA_PX: f64 = 1.0;

fn camera() -> Camera {
    Camera::Pinhole(PinholeRadialTangential::undistorted(500.0, 500.0, 320.0, 240.0))
}

fn depth_sigma(depth: f64) -> f64 {
    0.0015 * depth * depth
}

/// A view of `point` with noise.
fn view(rng: &mut impl Rng, a_from_camera: Se3, point: &Vector3<f64>, has_depth: bool) -> View {
    let in_camera = a_from_camera.inverse_transform(point);
    let noise: Vector3<f64> = normal_vector(rng, 1.0);
    let pixel = camera().project(&in_camera).unwrap() + Vector2::new(noise.x, noise.y) * SIGMA_PX;
    let sigma = depth_sigma(in_camera.z);
    let depth_m = has_depth.then_some((in_camera.z + noise.z * sigma, sigma));
    View { world_from_camera: a_from_camera, camera: camera(), pixel, sigma_px: SIGMA_PX, depth_m }
}

/// `count` landmarks seen from `others`, the origin and `a_from_b`.
fn scene(
    rng: &mut impl Rng,
    count: usize,
    others: &[Se3],
    a_from_b: &Se3,
    has_depth: bool,
) -> Vec<Match> {
    let mut matches = Vec::new();
    for _ in 0..count {
        let spread: Vector3<f64> = uniform_vector(rng, 1.0);
        let point = Vector3::new(1.2 * spread.x, 0.9 * spread.y, 2.5 + spread.z);
        let mut views = vec![view(rng, Se3::identity(), &point, has_depth)];
        views.extend(others.iter().map(|&other| view(rng, other, &point, has_depth)));
        let Some(landmark) = PointEstimate::from_views(&views) else { continue };
        let View { pixel, sigma_px, depth_m, .. } = view(rng, *a_from_b, &point, has_depth);
        matches.push(Match { landmark, pixel, sigma_px, depth_m });
    }
    matches
}

fn motion(rng: &mut impl Rng) -> Se3 {
    let sigmas = Vector6::new(0.1, 0.1, 0.1, 0.05, 0.05, 0.05);
    perturbed(rng, &Se3::identity(), &sigmas)
}

/// The mean of δᵀΩδ over many scenes, for δ the error of the measured motion: 6 where Ω holds.
fn mean_nees(others: &[Se3], has_depth: bool) -> f64 {
    let mut rng = seeded(3);
    let mut sum = 0.0;
    for _ in 0..200 {
        let truth = motion(&mut rng);
        let matches = scene(&mut rng, 60, others, &truth, has_depth);
        let measured = measure(&camera(), &matches, &Se3::identity()).unwrap();
        let error = truth.inverse().compose(&measured.a_from_b).log();
        sum += measured.information.squared_norm(&error);
    }
    sum / 200.0
}

#[test]
fn the_information_holds_with_depth() {
    // The mean of 200 numbers of χ² with 6 degrees of freedom has a standard deviation of 0.25.
    let nees = mean_nees(&[], true);
    assert!((4.8..7.2).contains(&nees), "{nees}");
}

#[test]
fn the_information_holds_without_depth_where_earlier_keyframes_give_parallax() {
    let others = [Vector3::new(-0.4, 0.0, 0.0), Vector3::new(-0.8, 0.1, 0.0)];
    let nees = mean_nees(&others.map(|t| Se3::new(crate::geometry::So3::identity(), t)), false);
    assert!((4.8..7.2).contains(&nees), "{nees}");
}

#[test]
fn a_fifth_of_wrong_matches_moves_the_pose_little() {
    let mut rng = seeded(4);
    for _ in 0..20 {
        let truth = motion(&mut rng);
        let mut matches = scene(&mut rng, 100, &[], &truth, true);
        for wrong in matches.iter_mut().step_by(5) {
            let noise: Vector2<f64> = uniform_vector(&mut rng, 60.0);
            wrong.pixel += noise;
            wrong.depth_m = None;
        }
        let measured = measure(&camera(), &matches, &Se3::identity()).unwrap();
        let error = truth.inverse().compose(&measured.a_from_b).log();
        assert!(error.norm() < 0.02, "{error}");
        assert!(measured.variance_factor > 1.0);
    }
}

#[test]
fn what_leaves_a_direction_open_is_no_measurement() {
    let mut rng = seeded(5);
    let truth = motion(&mut rng);
    let matches = scene(&mut rng, 40, &[], &truth, true);
    assert!(measure(&camera(), &matches[..MIN_MATCHES - 1], &truth).is_none());
    let same = vec![matches[0]; 20];
    assert!(measure(&camera(), &same, &truth).is_none(), "one point leaves the rotation open");
}

#[test]
fn matches_of_which_most_contradict_the_pose_are_no_measurement() {
    let mut rng = seeded(6);
    let truth = motion(&mut rng);
    let mut matches = scene(&mut rng, 60, &[], &truth, true);
    for wrong in &mut matches {
        let noise: Vector2<f64> = uniform_vector(&mut rng, 200.0);
        wrong.pixel += noise;
    }
    assert!(measure(&camera(), &matches, &truth).is_none());
}

/// Landmarks with depth, seen from far to the side by a camera without depth.
fn seen_from_the_side(rng: &mut impl Rng, count: usize) -> (Se3, Vec<Match>) {
    let turn = crate::geometry::So3::exp(&Vector3::new(0.0, -0.4, 0.0));
    let sigmas = Vector6::new(0.2, 0.2, 0.2, 0.1, 0.1, 0.1);
    let truth = perturbed(rng, &Se3::new(turn, Vector3::new(1.0, 0.0, 0.3)), &sigmas);
    let mut matches = scene(rng, count, &[], &truth, true);
    matches.iter_mut().for_each(|seen| seen.depth_m = None);
    (truth, matches)
}

#[test]
fn a_measurement_is_the_same_from_any_start() {
    let mut rng = seeded(7);
    for _ in 0..20 {
        let (truth, matches) = seen_from_the_side(&mut rng, 100);
        let from_truth = measure(&camera(), &matches, &truth).unwrap();
        for _ in 0..5 {
            let off = Vector6::new(0.05, 0.05, 0.05, 0.02, 0.02, 0.02);
            let start = perturbed(&mut rng, &truth, &off);
            let measured = measure(&camera(), &matches, &start).unwrap();
            let between = measured.a_from_b.minus(&from_truth.a_from_b);
            let squared = from_truth.information.squared_norm(&between);
            assert!(squared < 1e-4, "{:.3} standard deviations", squared.sqrt());
        }
    }
}

#[test]
fn the_information_holds_where_uncertain_points_are_seen_from_the_side() {
    let mut rng = seeded(8);
    let mut sum = 0.0;
    for _ in 0..200 {
        let (truth, matches) = seen_from_the_side(&mut rng, 100);
        let measured = measure(&camera(), &matches, &truth).unwrap();
        sum += measured.information.squared_norm(&measured.a_from_b.minus(&truth));
    }
    assert!((4.8..7.2).contains(&(sum / 200.0)), "{}", sum / 200.0);
}
