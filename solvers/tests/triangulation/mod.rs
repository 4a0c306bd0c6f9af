//! Triangulation: recovers points, and says why where it cannot.

mod hard;
mod robustness;
mod worst_error;

use covis_solvers::geometry::{Camera, PinholeRadialTangential, Se3, So3};
use covis_solvers::initialization::{TriangulationError, TriangulationOptions, View, triangulate};
use covis_solvers::testing::random::{normal_vector, seeded};
use nalgebra::{Vector2, Vector3};

fn camera() -> Camera {
    PinholeRadialTangential::undistorted(500.0, 500.0, 320.0, 240.0).into()
}

/// `count` cameras `baseline_m` apart along x that look along z at `point`, with pixel noise.
fn views(
    point: &Vector3<f64>,
    count: usize,
    baseline_m: f64,
    noise_px: f64,
    seed: u64,
) -> Vec<View> {
    let mut rng = seeded(seed);
    (0..count)
        .map(|k| {
            let translation = Vector3::new(k as f64 * baseline_m, 0.1 * (k % 2) as f64, 0.0);
            let world_from_camera =
                Se3::new(So3::from_quaternion_xyzw(0.0, 0.0, 0.0, 1.0).unwrap(), translation);
            let noise: Vector2<f64> = normal_vector(&mut rng, noise_px);
            let pixel =
                camera().project(&world_from_camera.inverse_transform(point)).unwrap() + noise;
            View { world_from_camera, camera: camera(), pixel, sigma_px: 1.0, depth_m: None }
        })
        .collect()
}

#[test]
fn recovers_a_noiseless_point_exactly_and_a_noisy_one_closely() {
    let point = Vector3::new(0.5, -0.3, 4.0);
    let options = TriangulationOptions::default();
    let exact = triangulate(&views(&point, 3, 0.3, 0.0, 1), &options).unwrap();
    assert!((exact.point_in_world - point).norm() < 1e-9);
    assert!(exact.whitened_rms < 1e-7);
    let noisy = triangulate(&views(&point, 10, 0.2, 0.5, 2), &options).unwrap();
    assert!((noisy.point_in_world - point).norm() < 0.03);
}

#[test]
fn refinement_lowers_the_reprojection_error_to_its_minimum() {
    let point = Vector3::new(0.5, -0.3, 4.0);
    let views = views(&point, 6, 0.2, 1.0, 3);
    let best = triangulate(&views, &TriangulationOptions::default()).unwrap().point_in_world;
    let error = |p: &Vector3<f64>| -> f64 {
        views
            .iter()
            .map(|v| {
                (v.camera.project(&v.world_from_camera.inverse_transform(p)).unwrap() - v.pixel)
                    .norm_squared()
            })
            .sum()
    };
    for axis in 0..3 {
        for step in [-1e-3, 1e-3] {
            let mut moved = best;
            moved[axis] += step;
            assert!(error(&moved) > error(&best), "axis {axis} step {step}");
        }
    }
}

#[test]
fn one_view_with_depth_is_enough() {
    let point = Vector3::new(0.5, -0.3, 4.0);
    let mut one = views(&point, 1, 0.0, 0.0, 1);
    one[0].depth_m = Some((4.0, 0.02));
    let found = triangulate(&one, &TriangulationOptions::default()).unwrap();
    assert!((found.point_in_world - point).norm() < 1e-9);
}

#[test]
fn says_why_there_is_no_position() {
    let point = Vector3::new(0.0, 0.0, 4.0);
    let options = TriangulationOptions::default();
    let one = views(&point, 1, 0.0, 0.0, 1);
    assert_eq!(triangulate(&one, &options), Err(TriangulationError::TooFewViews { views: 1 }));
    let near = views(&Vector3::new(0.0, 0.0, 400.0), 2, 0.01, 0.0, 1);
    assert!(matches!(triangulate(&near, &options), Err(TriangulationError::SmallParallax { .. })));
    let mut wrong = views(&point, 4, 0.3, 0.0, 1);
    wrong[2].pixel.y += 90.0;
    assert!(matches!(triangulate(&wrong, &options), Err(TriangulationError::Contradiction { .. })));
    // Rays that diverge meet behind the cameras.
    let mut diverging = views(&point, 2, 0.3, 0.0, 1);
    diverging[0].pixel.x -= 200.0;
    diverging[1].pixel.x += 200.0;
    let error = triangulate(&diverging, &options).unwrap_err();
    assert!(matches!(error, TriangulationError::Contradiction { .. }), "{error:?}");
    // So wide that they agree only on a point at infinity.
    let wide = TriangulationOptions { max_whitened_error: 1e3, ..options };
    let error = triangulate(&diverging, &wide).unwrap_err();
    assert!(matches!(error, TriangulationError::Inconsistent { .. }), "{error:?}");
    diverging.iter_mut().for_each(|view| view.sigma_px = 50.0);
    let error = triangulate(&diverging, &options).unwrap_err();
    assert!(matches!(error, TriangulationError::SmallParallax { .. }), "{error:?}");
    // No point lies in front of cameras that stand back to back.
    let mut apart = views(&point, 2, 0.3, 0.0, 1);
    apart[1].world_from_camera = Se3::new(
        So3::from_quaternion_xyzw(0.0, 1.0, 0.0, 0.0).unwrap(),
        Vector3::new(0.3, 0.0, -1.0),
    );
    let error = triangulate(&apart, &options).unwrap_err();
    assert!(matches!(error, TriangulationError::BehindCamera { .. }), "{error:?}");
}
