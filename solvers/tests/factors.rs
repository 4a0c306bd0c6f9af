//! Observation factors: analytic Jacobians against central differences over a sweep.

use covis_solvers::factors::Reprojection;
use covis_solvers::geometry::{
    Camera, KannalaBrandt, LieGroup, PinholeRadialTangential, Se3, Snavely,
};
use covis_solvers::testing::assert_jacobian;
use covis_solvers::testing::random::{element, seeded, uniform_vector};
use nalgebra::{SVector, Vector2, Vector3};

const TOLERANCE: f64 = 1e-6;

fn cameras() -> [Camera; 3] {
    [
        PinholeRadialTangential {
            fx: 520.0,
            fy: 515.0,
            cx: 320.0,
            cy: 240.0,
            k1: 0.1,
            k2: -0.05,
            p1: 0.001,
            p2: -0.002,
            k3: 0.01,
        }
        .into(),
        KannalaBrandt {
            fx: 280.0,
            fy: 285.0,
            cx: 320.0,
            cy: 240.0,
            k1: 0.01,
            k2: -0.003,
            k3: 0.001,
            k4: 0.0002,
        }
        .into(),
        Snavely { focal: 600.0, k1: -0.08, k2: 0.02 }.into(),
    ]
}

/// Poses and points such that the point lies in front of the camera, at 1 to 8 m.
fn sweep() -> impl Iterator<Item = (Se3, Vector3<f64>)> {
    let mut rng = seeded(7);
    (0..60).map(move |k| {
        let pose: Se3 = element(&mut rng, 1.0);
        let side: SVector<f64, 2> = uniform_vector(&mut rng, 0.5);
        let depth = 1.0 + 7.0 * f64::from(k) / 60.0;
        let in_camera = Vector3::new(side.x * depth, side.y * depth, depth);
        (pose, pose.transform(&in_camera))
    })
}

#[test]
fn reprojection_jacobians_match_central_differences() {
    for depth_m in [None, Some((2.5, 0.02))] {
        let factor = Reprojection { pixel: Vector2::new(300.0, 250.0), sigma_px: 0.7, depth_m };
        for camera in cameras() {
            for (pose, point) in sweep() {
                let at = |pose: &Se3, point: &Vector3<f64>| {
                    factor.residual(pose, &camera, point).unwrap()
                };
                let lin = factor.linearize(&pose, &camera, &point).unwrap();
                assert!((lin.residual - at(&pose, &point)).norm() < 1e-9);
                assert_eq!(lin.residual.z == 0.0, depth_m.is_none());
                let label = format!("{camera:?}");
                assert_jacobian(&label, |d| at(&pose.plus(d), &point), &lin.d_pose, TOLERANCE);
                let moved = |d: &Vector3<f64>| at(&pose, &(point + d));
                assert_jacobian(&label, moved, &lin.d_landmark, TOLERANCE);
            }
        }
    }
}

#[test]
fn a_point_behind_the_camera_has_a_residual_and_one_in_its_plane_has_none() {
    let factor = Reprojection { pixel: Vector2::zeros(), sigma_px: 1.0, depth_m: None };
    let camera = Camera::from(Snavely { focal: 500.0, k1: 0.0, k2: 0.0 });
    let pose = Se3::identity();
    assert!(factor.residual(&pose, &camera, &Vector3::new(0.1, 0.2, -2.0)).is_some());
    assert!(factor.residual(&pose, &camera, &Vector3::new(0.1, 0.2, 0.0)).is_none());
    assert!(factor.linearize(&pose, &camera, &Vector3::new(0.1, 0.2, 0.0)).is_none());
}
