//! Numerical quality of rotations: the logarithm at both ends, conversions, drift.

use std::f64::consts::PI;

use covis_solvers::geometry::{LieGroup, Se3, So2, So3};
use covis_solvers::testing::random;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector1, Vector3, Vector6};

#[test]
fn logarithm_keeps_relative_accuracy_near_zero() {
    let mut rng = random::seeded(10);
    for power in -300..=0 {
        let phi = random::unit_vector(&mut rng) * 10.0_f64.powi(power);
        let error = (So3::exp(&phi).log() - phi).amax() / phi.amax();
        assert!(error <= 1e-15, "1e{power}: relative error {error:e}");
    }
}

#[test]
fn logarithm_is_accurate_near_half_a_turn() {
    let mut rng = random::seeded(11);
    for gap in [1e-3, 1e-6, 1e-9, 1e-12, 1e-15] {
        for _ in 0..50 {
            let phi = random::unit_vector(&mut rng) * (PI - gap);
            assert!((So3::exp(&phi).log() - phi).amax() <= 2e-15, "gap {gap:e}");
        }
    }
    // Exactly π: either end of the axis, and never more than π.
    for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
        for sign in [1.0, -1.0] {
            let q = UnitQuaternion::new_unchecked(Quaternion::from_imag(axis * sign));
            let phi = So3::from_unit_quaternion(q).log();
            assert!((phi.norm() - PI).abs() < 1e-15);
            assert!(phi.normalize().cross(&axis).amax() < 1e-15);
        }
    }
    // Past π the logarithm is the short way around.
    let phi = So3::exp(&(Vector3::z() * (PI + 0.25))).log();
    assert!((phi + Vector3::z() * (PI - 0.25)).amax() < 2e-15);
}

#[test]
fn both_quaternions_of_a_rotation_have_one_logarithm() {
    let mut rng = random::seeded(12);
    for _ in 0..100 {
        let rotation = random::rotation(&mut rng);
        let q = rotation.quaternion();
        let flipped = So3::from_quaternion_xyzw(-q.i, -q.j, -q.k, -q.w).unwrap();
        assert_eq!(rotation.log(), flipped.log());
        assert!(rotation.log().norm() <= PI);
    }
}

#[test]
fn quaternions_are_normalized_or_refused() {
    assert!(So3::from_quaternion_xyzw(0.0, 0.0, 0.0, 0.0).is_none());
    assert!(So3::from_quaternion_xyzw(f64::NAN, 0.0, 0.0, 1.0).is_none());
    assert!(So3::from_quaternion_xyzw(0.0, f64::INFINITY, 0.0, 1.0).is_none());
    for scale in [1e-300, 1e-20, 0.999, 3.0, 1e20, 1e300] {
        let rotation = So3::from_quaternion_xyzw(0.0, 0.6 * scale, 0.0, 0.8 * scale).unwrap();
        let coordinates = rotation.quaternion().coords;
        assert!((coordinates - nalgebra::Vector4::new(0.0, 0.6, 0.0, 0.8)).amax() < 1e-15);
    }
    // Reading back what was written changes no bit.
    let mut rng = random::seeded(13);
    for _ in 0..1000 {
        let rotation = random::rotation(&mut rng) * random::rotation(&mut rng);
        let q = rotation.quaternion();
        assert_eq!(So3::from_quaternion_xyzw(q.i, q.j, q.k, q.w), Some(rotation));
    }
}

#[test]
fn matrices_round_trip_and_are_projected() {
    let mut rng = random::seeded(14);
    for _ in 0..200 {
        let rotation = random::rotation(&mut rng);
        let matrix = rotation.matrix();
        assert!((So3::from_matrix(&matrix).matrix() - matrix).amax() < 5e-15);
        // A symmetric positive stretch leaves the nearest rotation where it is.
        let root: Matrix3<f64> =
            Matrix3::from_fn(|_, _| random::normal_vector::<1>(&mut rng, 0.3).x);
        let stretch = Matrix3::identity() + root * root.transpose();
        assert!((So3::from_matrix(&(matrix * stretch)).matrix() - matrix).amax() < 1e-13);
        let p: Vector3<f64> = random::normal_vector(&mut rng, 1.0);
        assert!((rotation.rotate(&p) - matrix * p).amax() < 1e-14);
        assert!((rotation.inverse_rotate(&p) - matrix.transpose() * p).amax() < 1e-14);
    }
    assert_eq!(So3::from_matrix(&Matrix3::identity()).log(), Vector3::zeros());
    for half_turn in [Vector3::new(1.0, -1.0, -1.0), Vector3::new(-1.0, -1.0, 1.0)] {
        let matrix = Matrix3::from_diagonal(&half_turn);
        assert!((So3::from_matrix(&matrix).matrix() - matrix).amax() < 1e-15);
    }
    assert!(So3::from_matrix(&Matrix3::zeros()).is_finite());
    assert!(!So3::from_matrix(&Matrix3::repeat(f64::NAN)).is_finite());
}

#[test]
fn long_chains_stay_rotations() {
    let step = Se3::exp(&Vector6::new(0.01, 0.02, -0.01, 0.1, -0.2, 0.3));
    let turn = So2::exp(&Vector1::new(0.1));
    let (mut pose, mut heading) = (Se3::identity(), So2::identity());
    for _ in 0..100_000 {
        pose = pose * step;
        heading = heading * turn;
    }
    assert!((pose.rotation.quaternion().norm() - 1.0).abs() < 1e-15);
    assert!((heading.matrix().determinant() - 1.0).abs() < 1e-15);
}
