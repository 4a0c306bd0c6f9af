//! The least worst error: against searches, known answers and samples, whatever the order and unit.

use covis_solvers::geometry::{Camera, KannalaBrandt, LieGroup, PinholeRadialTangential, Se3, So3};
use covis_solvers::initialization::{View, least_worst_error};
use covis_solvers::testing::random::{normal_vector, seeded, uniform_vector};
use nalgebra::{Vector2, Vector3};
use rand::RngExt;

use super::{camera, views};

/// The worst error of a point, from the definitions.
fn worst(views: &[View], point: &Vector3<f64>) -> f64 {
    views.iter().fold(0.0, |worst: f64, view| {
        let in_camera = view.world_from_camera.inverse_transform(point);
        if in_camera.z <= 0.0 {
            return f64::INFINITY;
        }
        let pixel = view.camera.project(&in_camera).unwrap();
        let depth = view.depth_m.map_or(0.0, |(depth, sigma)| (in_camera.z - depth).abs() / sigma);
        worst.max((pixel - view.pixel).norm() / view.sigma_px).max(depth)
    })
}

/// 2 to 6 cameras around the origin that look at a point 1 to 5 m ahead, some with depth, with noise
/// of 0.5, 3, 20 or 100 sigma.
pub(super) fn scattered(seed: u64) -> (Vec<View>, Vector3<f64>) {
    let mut rng = seeded(seed);
    let count = 2 + (seed % 5) as usize;
    let noise = [0.5, 3.0, 20.0, 100.0][(seed / 5 % 4) as usize];
    let point = Vector3::new(0.0, 0.0, 3.0) + uniform_vector::<3>(&mut rng, 2.0);
    let mut views = Vec::new();
    while views.len() < count {
        let center = Vector3::new(0.0, 0.0, -1.0) + uniform_vector::<3>(&mut rng, 1.0);
        let rotation = So3::exp(&uniform_vector(&mut rng, 0.5));
        let world_from_camera = Se3::new(rotation, center);
        let in_camera = world_from_camera.inverse_transform(&point);
        if in_camera.z < 0.3 {
            continue;
        }
        let pixel = camera().project(&in_camera).unwrap() + normal_vector(&mut rng, noise);
        let sigma = 0.02 * in_camera.z;
        let depth = in_camera.z + sigma * noise * (rng.random::<f64>() - 0.5);
        let depth_m =
            (seed.is_multiple_of(3) && rng.random::<f64>() < 0.5).then_some((depth, sigma));
        views.push(View { world_from_camera, camera: camera(), pixel, sigma_px: 1.0, depth_m });
    }
    (views, point)
}

/// The least value of `f` between `low` and `high`, for a function that falls and then rises.
fn golden_section(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let part = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut a, mut b) = (high - part * (high - low), low + part * (high - low));
    let (mut at_a, mut at_b) = (f(a), f(b));
    for _ in 0..44 {
        if at_a < at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - part * (high - low);
            at_a = f(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + part * (high - low);
            at_b = f(b);
        }
    }
    at_a.min(at_b)
}

/// The least worst error by three nested searches: over 1/z, x/z and y/z of the first camera, in which
/// it is quasi-convex, and so is its minimum over some of them.
fn searched(views: &[View]) -> f64 {
    let first = &views[0];
    let ray = first.camera.unproject(&first.pixel).unwrap();
    let at = |x: f64, y: f64, inverse_z: f64| {
        let point = first.world_from_camera.transform(&(Vector3::new(x, y, 1.0) / inverse_z));
        let behind = views
            .iter()
            .map(|v| -inverse_z * v.world_from_camera.inverse_transform(&point).z)
            .fold(f64::NEG_INFINITY, f64::max);
        // Large, and larger the further it is behind a camera.
        if behind >= 0.0 { 1e9 + behind } else { worst(views, &point) }
    };
    golden_section(1e-9, 20.0, |inverse_z| {
        golden_section(ray.x - 0.8, ray.x + 0.8, |x| {
            golden_section(ray.y - 0.8, ray.y + 0.8, |y| at(x, y, inverse_z))
        })
    })
}

#[test]
fn agrees_with_nested_searches() {
    for seed in 0..60 {
        let (views, _) = scattered(seed);
        let found = least_worst_error(&views).unwrap();
        let expected = searched(&views);
        let tolerance = 1e-6 * (1.0 + expected);
        assert!((found.error - expected).abs() < tolerance, "seed {seed}: {found:?}, {expected}");
        let evaluated = worst(&views, &found.point_in_world);
        assert!((found.error - evaluated).abs() < tolerance, "seed {seed}: {found:?}, {evaluated}");
        assert!(found.lower_bound <= found.error, "seed {seed}: {found:?}");
        assert!(found.lower_bound > found.error - tolerance, "seed {seed}: {found:?}");
    }
}

#[test]
fn vertical_disparity_is_shared_and_so_are_two_depths() {
    let point = Vector3::new(0.2, 0.1, 4.0);
    let mut stereo = views(&point, 2, 0.3, 0.0, 1);
    for view in &mut stereo {
        view.world_from_camera.translation.y = 0.0;
        let in_camera = view.world_from_camera.inverse_transform(&point);
        view.pixel = view.camera.project(&in_camera).unwrap();
    }
    stereo[0].pixel.y += 5.0;
    stereo[1].pixel.y -= 3.0;
    let found = least_worst_error(&stereo).unwrap();
    assert!((found.error - 4.0).abs() < 1e-6, "{found:?}");
    let mut depths = views(&point, 1, 0.0, 0.0, 1);
    depths.push(depths[0]);
    depths[0].depth_m = Some((3.0, 0.1));
    depths[1].depth_m = Some((4.5, 0.1));
    let found = least_worst_error(&depths).unwrap();
    assert!((found.error - 7.5).abs() < 1e-6, "{found:?}");
    let expected = point * (3.75 / 4.0);
    assert!((found.point_in_world - expected).norm() < 1e-2, "{found:?}");
}

#[test]
fn neither_order_nor_unit_matters() {
    for seed in 0..40 {
        let (mut views, _) = scattered(seed);
        let found = least_worst_error(&views).unwrap();
        for scale in [1e-3, 1e6] {
            let mut scaled = views.clone();
            for view in &mut scaled {
                view.world_from_camera.translation *= scale;
                view.depth_m = view.depth_m.map(|(depth, sigma)| (depth * scale, sigma * scale));
            }
            let other = least_worst_error(&scaled).unwrap();
            let tolerance = 2e-7 * (1.0 + found.error);
            assert!((other.error - found.error).abs() < tolerance, "seed {seed}, scale {scale}");
            assert!((other.lower_bound - found.lower_bound).abs() < tolerance, "seed {seed}");
        }
        views.reverse();
        assert_eq!(least_worst_error(&views), Some(found), "seed {seed}");
        views.rotate_left(1);
        assert_eq!(least_worst_error(&views), Some(found), "seed {seed}");
    }
}

#[test]
fn no_sampled_point_is_below_the_bound_of_an_outlier() {
    let point = Vector3::new(0.5, -0.3, 4.0);
    for seed in 0..20 {
        let mut rng = seeded(100 + seed);
        let mut wrong = views(&point, 6, 0.2, 0.5, seed);
        wrong[(seed % 6) as usize].pixel += Vector2::new(30.0, 60.0);
        let found = least_worst_error(&wrong).unwrap();
        assert!(found.lower_bound > 20.0, "{found:?}");
        let mut nearest = f64::INFINITY;
        for k in 0..20_000 {
            // About the truth and about the best point, from tight to wide, and all over the place.
            let middle = if k % 2 == 0 { point } else { found.point_in_world };
            let width = 10.0_f64.powf(-4.0 + 5.0 * rng.random::<f64>());
            let sample = middle + normal_vector::<3>(&mut rng, width);
            nearest = nearest.min(worst(&wrong, &sample));
        }
        assert!(nearest >= found.lower_bound, "{nearest} {found:?}");
        assert!(nearest < 1.01 * found.lower_bound, "the samples come close: {nearest} {found:?}");
    }
}

#[test]
fn diverging_rays_are_best_at_infinity() {
    let mut diverging = views(&Vector3::new(0.0, 0.0, 4.0), 2, 0.3, 0.0, 1);
    diverging[0].pixel = Vector2::new(300.0, 240.0);
    diverging[1].pixel = Vector2::new(340.0, 240.0);
    let found = least_worst_error(&diverging).unwrap();
    // Parallel rays miss both pixels by half their distance.
    assert!((found.error - 20.0).abs() < 1e-5, "{found:?}");
    assert!(found.point_in_world.z > 1e6, "{found:?}");
}

#[test]
fn a_fisheye_sees_sideways_and_backward() {
    let camera: Camera = KannalaBrandt {
        fx: 250.0,
        fy: 250.0,
        cx: 0.0,
        cy: 0.0,
        k1: 0.02,
        k2: 0.0,
        k3: 0.0,
        k4: 0.0,
    }
    .into();
    let point = Vector3::new(3.0, 0.5, -0.4);
    let view = |x: f64, y: f64, z: f64| {
        let world_from_camera =
            Se3::new(So3::exp(&Vector3::new(0.1, 0.3 * y, x)), Vector3::new(x, y, z));
        let pixel = camera.project(&world_from_camera.inverse_transform(&point)).unwrap();
        View { world_from_camera, camera, pixel, sigma_px: 1.0, depth_m: None }
    };
    let mut exact = vec![view(0.0, 0.0, 0.0), view(0.1, 0.3, 0.2), view(0.2, -0.3, 0.5)];
    assert!(exact.iter().all(|v| v.world_from_camera.inverse_transform(&point).z < 0.0));
    let found = least_worst_error(&exact).unwrap();
    assert!(found.error < 1e-5, "{found:?}");
    assert!((found.point_in_world - point).norm() < 1e-5, "{found:?}");
    exact[1].pixel.y += 10.0;
    let found = least_worst_error(&exact).unwrap();
    assert!(found.lower_bound > 1.0 && found.error < 10.0, "{found:?}");
}

#[test]
fn a_lens_counts_as_linear_about_the_pixel() {
    let camera: Camera = PinholeRadialTangential {
        k1: -0.2,
        k2: 0.05,
        p1: 1e-3,
        ..PinholeRadialTangential::undistorted(500.0, 500.0, 320.0, 240.0)
    }
    .into();
    let (mut noisy, point) = scattered(3);
    let mut rng = seeded(3);
    for view in &mut noisy {
        view.camera = camera;
        let in_camera = view.world_from_camera.inverse_transform(&point);
        view.pixel = camera.project(&in_camera).unwrap() + normal_vector(&mut rng, 2.0);
        view.depth_m = None;
    }
    let found = least_worst_error(&noisy).unwrap();
    let evaluated = worst(&noisy, &found.point_in_world);
    assert!(found.error > 1.0, "{found:?}");
    assert!((evaluated - found.error).abs() < 0.01 * found.error, "{evaluated} {found:?}");
}

#[test]
fn of_many_views_the_bound_of_some_holds_for_all() {
    let point = Vector3::new(0.5, -0.3, 4.0);
    let many = views(&point, 150, 0.01, 2.0, 7);
    let found = least_worst_error(&many).unwrap();
    assert!(found.lower_bound > 2.0, "{found:?}");
    let evaluated = worst(&many, &found.point_in_world);
    assert!((found.error - evaluated).abs() < 1e-6 * evaluated, "{evaluated} {found:?}");
    assert!(found.error < 2.0 * found.lower_bound, "{found:?}");
}

#[test]
fn has_no_answer_without_a_ray_a_length_or_a_common_front() {
    let point = Vector3::new(0.0, 0.0, 4.0);
    assert_eq!(least_worst_error(&[]), None);
    assert_eq!(least_worst_error(&views(&point, 1, 0.0, 0.0, 1)), None);
    let good = views(&point, 2, 0.3, 0.0, 1);
    assert!(least_worst_error(&good).is_some());
    let broken: [fn(&mut View); 5] = [
        |view| view.pixel.x = f64::NAN,
        |view| view.sigma_px = 0.0,
        |view| view.world_from_camera.translation.y = f64::INFINITY,
        |view| view.depth_m = Some((1.0, f64::NAN)),
        // Looks away from the other.
        |view| {
            view.world_from_camera.rotation =
                So3::from_quaternion_xyzw(0.0, 1.0, 0.0, 0.0).unwrap();
            view.world_from_camera.translation.z = -1.0;
        },
    ];
    for (index, breaks) in broken.iter().enumerate() {
        let mut bad = good.clone();
        breaks(&mut bad[1]);
        assert_eq!(least_worst_error(&bad), None, "{index}");
    }
}
