//! The pose from correspondences, most of them false.

use covis_solvers::geometry::camera::{Camera, PinholeRadialTangential};
use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::{Vector2, Vector3, Vector6};

use super::super::rigid_alignment::{AlignmentOptions, Correspondence, align};
use super::super::splitmix::SplitMix64;
use super::normal;

const CAMERA: Camera = Camera::Pinhole(PinholeRadialTangential { k1: 0.1, k2: -0.05, ..PLAIN });
const PLAIN: PinholeRadialTangential = PinholeRadialTangential {
    fx: 520.0,
    fy: 515.0,
    cx: 319.5,
    cy: 239.5,
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
};

/// Kinect: σ grows with the square of the depth.
fn sigma_m(depth_m: f64) -> f64 {
    0.0015 * depth_m * depth_m
}

struct Scene {
    truth: Se3,
    correspondences: Vec<Correspondence>,
    /// Whether each is a true one.
    is_true: Vec<bool>,
}

/// Points seen with noise (σ = `pixel_px` and the depth's own, times `noise`); of `count`, `falsely` are
/// matched with another point.
fn scene(seed: u64, count: usize, falsely: usize, noise: f64) -> Scene {
    let mut generator = SplitMix64(seed);
    let mut uniform = |low: f64, high: f64| {
        low + (high - low) * generator.below(1 << 30) as f64 / f64::from(1 << 30)
    };
    let truth = Se3::exp(&Vector6::from_fn(|_, _| uniform(-1.0, 1.0)));
    let seen: Vec<(Vector2<f64>, f64)> = (0..count)
        .map(|_| (Vector2::new(uniform(0.0, 639.0), uniform(0.0, 479.0)), uniform(0.6, 5.0)))
        .collect();
    let points: Vec<Vector3<f64>> = seen
        .iter()
        .map(|(pixel, depth)| truth.inverse_transform(&at_depth(pixel, *depth)))
        .collect();
    let mut correspondences = Vec::new();
    let mut is_true = Vec::new();
    for (k, (pixel, depth)) in seen.iter().enumerate() {
        let mut draw = || noise * normal(&mut generator);
        let pixel = pixel + 0.5 * Vector2::new(draw(), draw());
        let depth = depth + sigma_m(*depth) * draw();
        let other = k < falsely;
        correspondences.push(Correspondence {
            point_in_world: points
                [if other { (k + 1 + generator.below(count - 1)) % count } else { k }],
            point_in_camera: at_depth(&pixel, depth),
        });
        is_true.push(!other);
    }
    Scene { truth, correspondences, is_true }
}

fn at_depth(pixel: &Vector2<f64>, depth: f64) -> Vector3<f64> {
    let ray = CAMERA.unproject(pixel).unwrap();
    ray / ray.z * depth
}

#[test]
fn without_noise_the_pose_is_exact() {
    for seed in 0..5 {
        let scene = scene(seed, 100, 60, 0.0);
        let options = AlignmentOptions { seed, ..AlignmentOptions::default() };
        let found = align(&CAMERA, &scene.correspondences, sigma_m, &options).unwrap();
        let error = scene.truth.inverse().compose(&found.camera_from_world).log().norm();
        assert!(error < 1e-9, "seed {seed}: {error}");
        assert_eq!(found.inliers, (60..100).collect::<Vec<_>>());
    }
}

#[test]
fn sixty_percent_of_false_matches_and_noise_leave_the_pose_right() {
    for seed in 0..20 {
        let scene = scene(seed, 150, 90, 1.0);
        let options = AlignmentOptions { seed, ..AlignmentOptions::default() };
        let found = align(&CAMERA, &scene.correspondences, sigma_m, &options).unwrap();
        let error = scene.truth.inverse().compose(&found.camera_from_world).log();
        let [translation, rotation] = [0, 3].map(|at| error.fixed_rows::<3>(at).norm());
        assert!(translation < 0.015 && rotation < 0.01, "seed {seed}: {translation} {rotation}");
        let falsely = found.inliers.iter().filter(|&&k| !scene.is_true[k]).count();
        assert!(
            falsely <= 1 && found.inliers.len() >= 55,
            "{seed}: {} {falsely}",
            found.inliers.len()
        );
        // The same seed gives the same bits.
        let again = align(&CAMERA, &scene.correspondences, sigma_m, &options);
        assert_eq!(again, Some(found));
    }
}

#[test]
fn a_point_must_agree_in_its_pixel_and_in_its_depth() {
    let mut scene = scene(1, 40, 0, 0.0);
    // Along the ray by 10 σ; and to the side by 10 px at the same depth.
    let far = &mut scene.correspondences[3].point_in_camera;
    *far *= 1.0 + 10.0 * sigma_m(far.z) / far.z;
    let aside = &mut scene.correspondences[7].point_in_camera;
    aside.x += 10.0 / 520.0 * aside.z;
    let options = AlignmentOptions::default();
    let found = align(&CAMERA, &scene.correspondences, sigma_m, &options).unwrap();
    assert_eq!(found.inliers.len(), 38);
    assert!(!found.inliers.contains(&3) && !found.inliers.contains(&7));
}

#[test]
fn no_pose_is_told_where_none_is_supported() {
    let options = AlignmentOptions::default();
    let aligned = |correspondences: &[Correspondence]| {
        align(&CAMERA, correspondences, sigma_m, &options).map(|found| found.inliers.len())
    };
    for seed in 0..5 {
        assert_eq!(aligned(&scene(seed, 80, 80, 1.0).correspondences), None, "all false");
    }
    let good = scene(2, 30, 0, 0.0).correspondences;
    assert_eq!(aligned(&[]), None);
    assert_eq!(aligned(&good[..11]), None);
    assert_eq!(aligned(&good[..12]), Some(12));
    // On a line, or all in one place, the rotation is free.
    let straight = |step: f64| -> Vec<Correspondence> {
        let point = |k: usize| Vector3::new(0.1 + step * k as f64, 0.2, 2.0);
        let correspondence =
            |k| Correspondence { point_in_world: point(k), point_in_camera: point(k) };
        (0..30).map(correspondence).collect()
    };
    assert_eq!(aligned(&straight(0.05)), None);
    assert_eq!(aligned(&straight(0.0)), None);
    // What is no measurement agrees with nothing and does no harm.
    let mut damaged = good;
    damaged[0].point_in_camera.x = f64::NAN;
    damaged[1].point_in_world.y = f64::INFINITY;
    damaged[2].point_in_camera.z = 0.0;
    damaged[3].point_in_camera *= -1.0;
    assert_eq!(aligned(&damaged), Some(26));
    let never = |sigma: f64| align(&CAMERA, &damaged, |_| sigma, &options);
    assert!([0.0, -1.0, f64::NAN, f64::INFINITY].iter().all(|&sigma| never(sigma).is_none()));
}
