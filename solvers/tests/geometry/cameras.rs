//! Camera models on a grid over the whole image and several depths: Jacobians against central
//! differences, projection against its inverse, and the places where neither exists.

use covis_solvers::geometry::camera::CameraModel;
use covis_solvers::geometry::{Camera, KannalaBrandt, PinholeRadialTangential, Snavely};
use covis_solvers::testing::assert_jacobian;
use nalgebra::{SVector, Vector2, Vector3};

const DEPTHS: [f64; 5] = [-7.0, -0.5, 0.4, 3.0, 80.0];

fn pinhole() -> PinholeRadialTangential {
    PinholeRadialTangential {
        fx: 458.654,
        fy: 457.296,
        cx: 367.215,
        cy: 248.375,
        k1: -0.2834,
        k2: 0.0739,
        p1: 0.00019,
        p2: 1.76e-5,
        k3: -0.004,
    }
}

fn fisheye() -> KannalaBrandt {
    KannalaBrandt {
        fx: 190.978,
        fy: 190.973,
        cx: 254.931,
        cy: 256.897,
        k1: 0.0034,
        k2: 0.0007,
        k3: -0.0020,
        k4: 0.0002,
    }
}

fn snavely() -> Snavely {
    Snavely { focal: 399.75, k1: -0.0587, k2: 0.0112 }
}

/// Directions (x/z, y/z) over a 100° image, the optical axis and its close neighborhood included.
fn directions() -> Vec<Vector2<f64>> {
    let mut grid = Vec::new();
    for i in -6..=6 {
        for j in -6..=6 {
            grid.push(Vector2::new(0.2 * f64::from(i), 0.2 * f64::from(j) * 0.75));
        }
    }
    grid.extend([1e-12, 1e-9, 1e-7, 1e-5, 2e-5, 1e-3].map(|r| Vector2::new(0.6 * r, -0.8 * r)));
    grid
}

/// Asserts both Jacobians of a model at one point; steps are relative to depth and parameters.
fn assert_model_jacobians<C: CameraModel<P>, const P: usize>(camera: &C, point: &Vector3<f64>) {
    let projection = camera.project_with_jacobians(point).unwrap();
    assert_eq!(Some(projection.pixel), camera.project(point));
    let label = format!("{camera:?} at {point:?}");
    let depth = point.norm();
    assert_jacobian(
        &format!("{label}, point"),
        |delta| camera.project(&(point + delta * depth)).unwrap(),
        &(projection.d_point * depth),
        1e-9,
    );
    assert_jacobian(
        &format!("{label}, parameters"),
        |delta: &SVector<f64, P>| {
            C::from_parameters(&(camera.parameters() + delta)).project(point).unwrap()
        },
        &projection.d_parameters,
        1e-10,
    );
}

#[test]
fn jacobians_match_differences() {
    for direction in directions() {
        for depth in DEPTHS {
            let point = direction.push(1.0) * depth;
            assert_model_jacobians(&pinhole(), &point);
            assert_model_jacobians(&snavely(), &point);
            // The fisheye is singular on the backward axis only.
            if depth > 0.0 || direction.norm() > 0.1 {
                assert_model_jacobians(&fisheye(), &point);
            }
        }
        // At z = 0 the fisheye looks sideways.
        if direction.norm() > 0.1 {
            assert_model_jacobians(&fisheye(), &direction.push(0.0));
        }
    }
}

#[test]
fn fisheye_derivatives_are_continuous_at_the_axis() {
    for factor in [1.0 - 1e-6, 1.0 + 1e-6] {
        let on_limit = Vector3::new(1e-5 * factor, 0.0, 1.0);
        let at = fisheye().project_with_jacobians(&on_limit).unwrap();
        let axis = fisheye().project_with_jacobians(&Vector3::z()).unwrap();
        // ∂u/∂x = fx (1 + 3 (k1 − 1/3) r²) to this order, from either branch.
        let bend = (at.d_point[(0, 0)] - axis.d_point[(0, 0)]) / fisheye().fx;
        let expected = 3.0 * (fisheye().k1 - 1.0 / 3.0) * on_limit.x * on_limit.x;
        assert!((bend - expected).abs() < 1e-14, "{bend:e} is not {expected:e}");
        assert!((at.d_parameters[(0, 0)] - 1e-5 * factor).abs() < 1e-13);
    }
}

#[test]
fn pixels_project_back_to_themselves() {
    for column in (0..=752).step_by(47) {
        for row in (0..=480).step_by(40) {
            let pixel = Vector2::new(f64::from(column), f64::from(row));
            let centered = pixel - Vector2::new(376.0, 240.0);
            for (camera, pixel) in [
                (Camera::from(pinhole()), pixel),
                (Camera::from(fisheye()), pixel),
                (Camera::from(snavely()), centered),
            ] {
                let ray = camera.unproject(&pixel).unwrap();
                let back = camera.project(&(ray * 3.7)).unwrap();
                assert!((back - pixel).amax() < 1e-9, "{camera:?}: {pixel} came back as {back}");
            }
        }
    }
}

#[test]
fn rays_come_back_from_their_pixels() {
    for direction in directions() {
        let point = direction.push(1.0);
        // Inside the fold of the EuRoC-like lens, which lies near r = 1.3.
        if direction.norm() < 1.2 {
            let ray = pinhole().unproject(&pinhole().project(&point).unwrap()).unwrap();
            assert!((ray - point).amax() < 1e-10, "pinhole {point} became {ray}");
        }
        let ray = snavely().unproject(&snavely().project(&point).unwrap()).unwrap();
        assert!((ray - point).amax() < 1e-12, "Snavely {point} became {ray}");
        for side in [point, direction.push(-0.2)] {
            if side.z > 0.0 || direction.norm() > 0.3 {
                let ray = fisheye().unproject(&fisheye().project(&side).unwrap()).unwrap();
                assert!((ray.norm() - 1.0).abs() < 1e-14);
                assert!((ray - side.normalize()).amax() < 1e-12, "fisheye {side} became {ray}");
            }
        }
    }
}

#[test]
fn points_behind_project_through_the_center() {
    let point = Vector3::new(0.3, -0.2, 2.0);
    assert_eq!(pinhole().project(&point), pinhole().project(&-point));
    assert_eq!(snavely().project(&point), snavely().project(&-point));
}

#[test]
fn singular_points_and_pixels_are_refused() {
    for point in [Vector3::zeros(), Vector3::new(1.0, 2.0, 0.0), Vector3::repeat(f64::NAN)] {
        for camera in [Camera::from(pinhole()), Camera::from(snavely())] {
            assert_eq!(camera.project(&point), None);
            assert!(camera.project_with_jacobians(&point).is_none());
        }
    }
    for point in [Vector3::zeros(), -Vector3::z(), Vector3::new(0.0, f64::INFINITY, 1.0)] {
        assert!(fisheye().project_with_jacobians(&point).is_none(), "{point}");
    }
    for camera in [Camera::from(pinhole()), Camera::from(fisheye()), Camera::from(snavely())] {
        assert!(camera.unproject(&Vector2::new(f64::NAN, 0.0)).is_none());
        assert!(camera.unproject(&Vector2::new(0.0, f64::INFINITY)).is_none());
    }
    // This lens never reaches past r_d = 2/(3 √3) ≈ 0.38490018.
    let folding = Snavely { focal: 100.0, k1: -1.0, k2: 0.0 };
    assert!(folding.unproject(&Vector2::new(38.49, 0.0)).is_some());
    assert!(folding.unproject(&Vector2::new(38.4901, 0.0)).is_none());
    let folding = KannalaBrandt { k1: -1.0, k2: 0.0, k3: 0.0, k4: 0.0, ..fisheye() };
    assert!(folding.unproject(&Vector2::new(254.931 + 190.978 * 0.384, 256.897)).is_some());
    assert!(folding.unproject(&Vector2::new(254.931 + 190.978 * 0.386, 256.897)).is_none());
    let folding = PinholeRadialTangential {
        k1: -1.0,
        ..PinholeRadialTangential::undistorted(100.0, 100.0, 0.0, 0.0)
    };
    assert!(folding.unproject(&Vector2::new(38.4, 0.0)).is_some());
    assert!(folding.unproject(&Vector2::new(38.6, 0.0)).is_none());
}

#[test]
fn any_camera_is_its_model() {
    let point = Vector3::new(0.4, -0.3, 1.7);
    for (camera, count, focal) in [
        (Camera::from(pinhole()), 9, 457.975),
        (Camera::from(fisheye()), 8, 190.9755),
        (Camera::from(snavely()), 3, 399.75),
    ] {
        assert_eq!((camera.parameter_count(), camera.parameters().len()), (count, count));
        assert!((camera.mean_focal_px() - focal).abs() < 1e-9);
        let projection = camera.project_with_jacobians(&point).unwrap();
        assert_eq!(Some(projection.pixel), camera.project(&point));
        assert!(projection.d_parameters.columns(count, 9 - count).iter().all(|v| *v == 0.0));
        // A step along the parameters moves the pixel as the Jacobian says.
        let delta: SVector<f64, 9> = SVector::from_fn(|i, _| 1e-6 * (1.0 + i as f64));
        let mut moved = camera;
        moved.plus_parameters(delta.as_slice());
        let predicted = projection.pixel + projection.d_parameters * delta;
        assert!((moved.project(&point).unwrap() - predicted).amax() < 1e-8);
        moved.plus_parameters(&[f64::NAN]);
        assert!(camera.is_finite() && !moved.is_finite());
    }
}
