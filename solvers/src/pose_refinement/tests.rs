//! The kernels against the factors, in every instruction set.

use nalgebra::{SVector, Vector2, Vector3};

use super::one_by_one;
use super::system::Terms;
use super::*;
use crate::geometry::{KannalaBrandt, LieGroup, PinholeRadialTangential, Snavely};
use crate::testing::jacobian::central_difference;
use crate::testing::random::{element, normal_vector, seeded, uniform_vector};
use normal_equations::Evaluation;

const CLASSES: [Class; 4] = [Class::Scalar, Class::Avx2, Class::Avx512, Class::Neon];

/// Widths on both sides of which the residuals of [`problem`] lie.
const LOSSES: [Loss; 5] = [
    Loss::Trivial,
    Loss::Huber(8.0),
    Loss::Cauchy(5.0),
    Loss::Tukey(20.0),
    Loss::GemanMcClure(10.0),
];

fn classes() -> impl Iterator<Item = Class> {
    CLASSES.into_iter().filter(|c| c.is_available())
}

fn cameras() -> [Camera; 4] {
    let [fx, fy, cx, cy] = [500.0, 510.0, 320.0, 240.0];
    let undistorted = PinholeRadialTangential::undistorted(fx, fy, cx, cy);
    let distorted = PinholeRadialTangential {
        k1: -0.2,
        k2: 0.05,
        p1: 1e-3,
        p2: -2e-3,
        k3: 0.01,
        ..undistorted
    };
    [
        undistorted.into(),
        distorted.into(),
        Snavely { focal: 520.0, k1: -0.05, k2: 0.01 }.into(),
        KannalaBrandt { fx, fy, cx, cy, k1: 0.02, k2: -0.004, k3: 0.001, k4: 0.0 }.into(),
    ]
}

/// A start some pixels off and what is seen; a depth with each `depth_every`-th observation, and a
/// landmark behind the camera now and then.
fn problem(
    camera: &Camera,
    count: usize,
    depth_every: usize,
    seed: u64,
) -> (Se3, Vec<PointObservation>) {
    let mut rng = seeded(seed);
    let truth: Se3 = element(&mut rng, 0.7);
    let observations = (0..count)
        .map(|k| {
            let side: SVector<f64, 3> = uniform_vector(&mut rng, 1.0);
            let depth_m = if k % 6 == 5 { -1.0 } else { 1.0 } * (4.0 + 2.0 * side.z);
            let in_camera = Vector3::new(0.5 * side.x * depth_m, 0.4 * side.y * depth_m, depth_m);
            let noise: Vector2<f64> = normal_vector(&mut rng, 3.0);
            PointObservation {
                point_in_world: truth.transform(&in_camera),
                pixel: camera.project(&in_camera).unwrap() + noise,
                sigma_px: 0.8 + 0.1 * (k % 4) as f64,
                depth_m: (depth_every > 0 && k % depth_every == 0)
                    .then_some((depth_m + 0.05, 0.02)),
            }
        })
        .collect();
    (truth.plus(&normal_vector(&mut rng, 0.01)), observations)
}

fn assert_close(a: &Evaluation, b: &Evaluation, what: &str) {
    let tolerance = 1e-12;
    assert!((a.cost - b.cost).abs() <= tolerance * b.cost, "{what}: {} {}", a.cost, b.cost);
    let (da, db) = ((a.gradient - b.gradient).amax(), b.gradient.amax());
    assert!(da <= tolerance * db, "{what}: gradient off by {da:e} of {db:e}");
    let (da, db) = ((a.hessian - b.hessian).amax(), b.hessian.amax());
    assert!(da <= tolerance * db, "{what}: hessian off by {da:e} of {db:e}");
}

#[test]
fn the_kernels_sum_what_the_factors_say() {
    for (model, camera) in cameras().iter().enumerate() {
        for count in 1..=20 {
            for depth_every in [0, 1, 3] {
                let (pose, list) = problem(camera, count, depth_every, 7 + count as u64);
                for loss in LOSSES {
                    let expected = one_by_one::evaluate(&list, &pose, camera, loss);
                    for class in classes() {
                        let packed = Observations::new(camera, &list, class);
                        let found = packed.evaluate(&pose, loss);
                        let what = format!("{class}, model {model}, {count}, {loss:?}");
                        assert!(packed.sound && found.is_finite(), "{what}");
                        assert_close(&found, &expected, &what);
                    }
                }
            }
        }
    }
}

#[test]
fn the_gradient_is_the_derivative_of_the_cost() {
    for (model, camera) in cameras().iter().enumerate() {
        for depth_every in [0, 2] {
            let (pose, list) = problem(camera, 20, depth_every, 3);
            for loss in LOSSES {
                for class in classes() {
                    let packed = Observations::new(camera, &list, class);
                    let cost = |delta: &SVector<f64, 6>| {
                        SVector::from([packed.evaluate(&pose.plus(delta), loss).cost])
                    };
                    let numeric = central_difference(cost, 1e-5).transpose();
                    let analytic = packed.evaluate(&pose, loss).gradient;
                    let (error, scale) = ((numeric - analytic).amax(), analytic.amax());
                    assert!(error <= 1e-6 * scale, "{class}, model {model}, {loss:?}: {error:e}");
                }
            }
        }
    }
}

#[test]
fn vector_classes_agree_to_the_bit() {
    let available: Vec<Class> = classes().filter(|c| *c != Class::Scalar).collect();
    for camera in &cameras() {
        let (pose, list) = problem(camera, 19, 3, 5);
        for loss in LOSSES {
            let value = |class| Observations::new(camera, &list, class).evaluate(&pose, loss);
            for pair in available.windows(2) {
                assert_eq!(value(pair[0]), value(pair[1]), "{} {}", pair[0], pair[1]);
            }
        }
    }
}

#[test]
fn the_fit_lists_each_observation_once() {
    for camera in &cameras() {
        for count in 1..=20 {
            let (pose, list) = problem(camera, count, 3, 11);
            for class in classes() {
                let (squared, depths) = Observations::new(camera, &list, class).fit(&pose);
                assert_eq!((squared.len(), depths.len()), (count, count));
                for (k, o) in list.iter().enumerate() {
                    let alone = one_by_one::evaluate(&list[k..=k], &pose, camera, Loss::Trivial);
                    assert!((squared[k] - 2.0 * alone.cost).abs() <= 1e-11 * (1.0 + squared[k]));
                    let depth = pose.inverse_transform(&o.point_in_world).z;
                    assert!((depths[k] - depth).abs() <= 1e-13 * depth.abs().max(1.0));
                }
            }
        }
    }
}

#[test]
fn what_does_not_project_is_left_to_the_factors() {
    let pose = Se3::identity();
    for camera in &cameras() {
        // No pinhole sees its center plane, no fisheye its backward axis.
        let lost = match camera {
            Camera::Fisheye(_) => Vector3::new(0.0, 0.0, -2.0),
            Camera::Pinhole(_) | Camera::Snavely(_) => Vector3::new(1.0, -2.0, 0.0),
        };
        for position in [0, 3, 9] {
            let (_, mut list) = problem(camera, 10, 3, 13);
            for o in &mut list {
                o.point_in_world = Vector3::new(0.3, 0.2, 4.0);
                o.depth_m = o.depth_m.map(|(_, sigma)| (4.1, sigma));
            }
            list[position].point_in_world = lost;
            for loss in LOSSES {
                let expected = one_by_one::evaluate(&list, &pose, camera, loss);
                for class in classes() {
                    let packed = Observations::new(camera, &list, class);
                    assert!(!packed.evaluate(&pose, loss).is_finite(), "{class} {loss:?}");
                    let terms = Terms { camera, list: &list, packed: &packed, prior: None, loss };
                    let found = terms.evaluate(&pose);
                    assert_eq!(found.hessian, expected.hessian);
                    assert_eq!(found.gradient, expected.gradient);
                    // Only Tukey's loss is bounded and defined at infinity.
                    let bounded = matches!(loss, Loss::Tukey(_));
                    assert_eq!(found.cost.is_finite(), bounded, "{loss:?}: {}", found.cost);
                }
            }
        }
    }
}
