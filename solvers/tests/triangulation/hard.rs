//! Views that the linear start serves badly: the cone program finds their point or a contradiction.

use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::initialization::{
    Triangulated, TriangulationError, TriangulationOptions, View, least_worst_error, triangulate,
};
use covis_solvers::testing::random::{normal_vector, seeded, uniform_vector};
use nalgebra::{Matrix3, Vector2, Vector3};

use super::worst_error::scattered;
use super::{camera, views};

/// `count` cameras that go forward past a point about 2 m ahead and 0.3 m off the path.
fn forward(seed: u64, count: usize, sigma_px: f64) -> (Vec<View>, Vector3<f64>) {
    let mut rng = seeded(seed);
    let point = Vector3::new(0.0, 0.0, 2.0) + uniform_vector::<3>(&mut rng, 0.5);
    let views = (0..count)
        .map(|k| {
            let center = Vector3::new(0.0, 0.0, 0.4 * k as f64) + uniform_vector(&mut rng, 0.02);
            let rotation = So3::exp(&uniform_vector(&mut rng, 0.02));
            let world_from_camera = Se3::new(rotation, center);
            let in_camera = world_from_camera.inverse_transform(&point);
            let pixel = camera().project(&in_camera).unwrap() + normal_vector(&mut rng, sigma_px);
            View { world_from_camera, camera: camera(), pixel, sigma_px, depth_m: None }
        })
        .collect();
    (views, point)
}

/// The point nearest to all rays.
fn midpoint(views: &[View]) -> Vector3<f64> {
    let mut matrix = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for view in views {
        let ray = view.camera.unproject(&view.pixel).unwrap();
        let d = view.world_from_camera.rotation.rotate(&ray).normalize();
        let across = Matrix3::identity() - d * d.transpose();
        matrix += across;
        right += across * view.world_from_camera.translation;
    }
    matrix.try_inverse().unwrap() * right
}

/// What the linear start alone comes to: with this bound all that needs more is a contradiction.
fn linear_only(views: &[View]) -> Result<Triangulated, TriangulationError> {
    let options = TriangulationOptions { max_whitened_error: -1.0, ..Default::default() };
    triangulate(views, &options)
}

fn whitened_rms(views: &[View], point: &Vector3<f64>) -> f64 {
    let squares = views.iter().map(|view| {
        let in_camera = view.world_from_camera.inverse_transform(point);
        let pixel = view.camera.project(&in_camera).unwrap();
        (pixel - view.pixel).norm_squared() / view.sigma_px.powi(2)
    });
    (squares.sum::<f64>() / (2 * views.len()) as f64).sqrt()
}

#[test]
fn points_ahead_of_forward_motion_are_found_where_the_linear_start_fails() {
    let options = TriangulationOptions::default();
    let (mut rescued, mut behind) = (0, 0);
    for seed in 0..3000 {
        let (views, truth) = forward(seed, 3, 20.0);
        if linear_only(&views).is_ok() {
            continue;
        }
        let Ok(found) = triangulate(&views, &options) else { continue };
        rescued += 1;
        let point = found.point_in_world;
        let in_front = |p: &Vector3<f64>| {
            views.iter().all(|v| v.world_from_camera.inverse_transform(p).z > 0.0)
        };
        assert!(in_front(&point), "seed {seed}");
        assert!((found.whitened_rms - whitened_rms(&views, &point)).abs() < 1e-9, "seed {seed}");
        assert!(found.whitened_rms <= whitened_rms(&views, &truth) * (1.0 + 1e-6), "seed {seed}");
        behind += usize::from(!in_front(&midpoint(&views)));
    }
    assert!(rescued >= 50, "{rescued}");
    assert!(behind >= 20, "{behind} of {rescued}");
}

#[test]
fn an_outlier_among_consistent_views_is_a_contradiction() {
    let point = Vector3::new(0.5, -0.3, 4.0);
    let options = TriangulationOptions::default();
    for seed in 0..20 {
        let good = views(&point, 5, 0.2, 0.5, seed);
        assert!(triangulate(&good, &options).is_ok(), "seed {seed}");
        let mut wrong = good;
        wrong[(seed % 5) as usize].pixel += Vector2::new(40.0, -40.0);
        let max_whitened_error = options.max_whitened_error;
        let told = Err(TriangulationError::Contradiction { max_whitened_error });
        assert_eq!(triangulate(&wrong, &options), told, "seed {seed}");
        let least = least_worst_error(&wrong).unwrap().lower_bound;
        assert!(least > max_whitened_error, "seed {seed}: {least}");
        let narrow = TriangulationOptions { max_whitened_error: 0.999 * least, ..options };
        let error = triangulate(&wrong, &narrow).unwrap_err();
        assert!(
            matches!(error, TriangulationError::Contradiction { .. }),
            "seed {seed}: {error:?}"
        );
        // What the bound allows is no contradiction.
        let wide = TriangulationOptions { max_whitened_error: 1.001 * least, ..options };
        let error = triangulate(&wrong, &wide).unwrap_err();
        assert!(matches!(error, TriangulationError::Inconsistent { .. }), "seed {seed}: {error:?}");
        let wider = TriangulationOptions { max_whitened_rms: 100.0, ..wide };
        assert!(triangulate(&wrong, &wider).is_ok(), "seed {seed}");
    }
}

#[test]
fn a_depth_that_contradicts_the_rays_is_reported() {
    let point = Vector3::new(0.5, -0.3, 4.0);
    let options = TriangulationOptions::default();
    let mut wrong = views(&point, 4, 0.3, 0.3, 5);
    wrong[1].depth_m = Some((2.0, 0.02));
    let error = triangulate(&wrong, &options).unwrap_err();
    assert!(matches!(error, TriangulationError::Contradiction { .. }), "{error:?}");
    wrong[1].depth_m = Some((4.02, 0.02));
    let found = triangulate(&wrong, &options).unwrap();
    assert!((found.point_in_world - point).norm() < 0.05);
    // A wrong depth in the first view is a bad start; the others outvote it where its sigma is wide.
    wrong[0].depth_m = Some((-3.0, 3.0));
    let found = triangulate(&wrong, &options).unwrap();
    assert!((found.point_in_world - point).norm() < 0.05);
}

#[test]
fn the_order_of_the_views_does_not_matter() {
    let options = TriangulationOptions { max_whitened_rms: 30.0, ..Default::default() };
    let mut hard = 0;
    for seed in 0..400 {
        let (mut views, _) =
            if seed % 2 == 0 { scattered(seed / 2) } else { forward(seed, 4, 20.0) };
        // The first depth is the start.
        views.iter_mut().for_each(|view| view.depth_m = None);
        hard += usize::from(linear_only(&views).is_err());
        let one = triangulate(&views, &options);
        views.rotate_left(1);
        let other = triangulate(&views, &options);
        match (one, other) {
            (Ok(a), Ok(b)) => {
                let moved = (a.point_in_world - b.point_in_world).norm();
                // Refinement stops where a step gains 1e-12 of the cost.
                assert!(moved < 1e-6 * a.point_in_world.norm(), "seed {seed}: {moved}");
                assert!((a.whitened_rms - b.whitened_rms).abs() < 1e-9, "seed {seed}");
            }
            (Err(TriangulationError::Contradiction { .. }), Err(_)) => assert_eq!(one, other),
            (a, b) => assert_eq!(
                std::mem::discriminant(&a.unwrap_err()),
                std::mem::discriminant(&b.unwrap_err()),
                "seed {seed}"
            ),
        }
    }
    assert!(hard > 100, "{hard}");
}
