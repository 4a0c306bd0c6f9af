//! The laws of every group over tiny, ordinary and nearly half-turn rotations, and the
//! exponentials against the matrix exponential.

use std::f64::consts::{FRAC_PI_2, PI};

use covis_solvers::geometry::{LieGroup, Se2, Se3, Sim3, So2, So3, hat};
use covis_solvers::testing::{assert_group_laws, assert_tangent_laws, random};
use nalgebra::{Matrix3, Matrix4, SVector, Vector1, Vector3, Vector6};

const TOLERANCE: f64 = 1e-13;
const NUMERIC: f64 = 2e-10;
const TRANSLATIONS: [f64; 5] = [0.0, 1e-9, 1.0, 300.0, 1e5];

/// From exact zero over both sides of every series threshold to just below π.
fn angles() -> Vec<f64> {
    let mut angles = vec![0.0];
    angles.extend((-12..=-3).map(|power| 10.0_f64.powi(power)));
    angles.extend([0.01, 0.1, 0.5, 0.99, 1.01, 1.41, 1.42, 2.0, 2.5, 3.0]);
    angles.extend([1e-2, 1e-4, 1e-6, 1e-9, 1e-12].map(|gap| PI - gap));
    angles
}

/// Asserts the laws of elements on triples drawn at several scales.
fn assert_sampled_laws<G: LieGroup<N>, const N: usize>(seed: u64) {
    let mut rng = random::seeded(seed);
    for sigma in [1e-9, 1e-4, 0.1, 1.0] {
        for _ in 0..200 {
            let a = random::element::<G, N>(&mut rng, sigma);
            let b = random::element::<G, N>(&mut rng, sigma);
            let c = random::element::<G, N>(&mut rng, sigma);
            assert_group_laws(&a, &b, &c, TOLERANCE);
        }
    }
}

#[test]
fn elements_obey_the_group_laws() {
    assert_sampled_laws::<So2, 1>(1);
    assert_sampled_laws::<Se2, 3>(2);
    assert_sampled_laws::<So3, 3>(3);
    assert_sampled_laws::<Se3, 6>(4);
    assert_sampled_laws::<Sim3, 7>(5);
}

#[test]
fn plane_tangents_obey_the_laws() {
    for angle in angles() {
        for signed in [angle, -angle] {
            assert_tangent_laws::<So2, 1>(&Vector1::new(signed), TOLERANCE, NUMERIC);
            for length in TRANSLATIONS {
                let tangent = Vector3::new(0.6 * length, -0.8 * length, signed);
                assert_tangent_laws::<Se2, 3>(&tangent, TOLERANCE, NUMERIC);
            }
        }
    }
}

#[test]
fn space_tangents_obey_the_laws() {
    let mut rng = random::seeded(6);
    for angle in angles() {
        let mut axes = vec![Vector3::x(), -Vector3::y(), Vector3::z()];
        axes.extend((0..4).map(|_| random::unit_vector(&mut rng)));
        for axis in axes {
            let phi = axis * angle;
            assert_tangent_laws::<So3, 3>(&phi, TOLERANCE, NUMERIC);
            for length in TRANSLATIONS {
                let rho = random::unit_vector(&mut rng) * length;
                let tangent = Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z);
                assert_tangent_laws::<Se3, 6>(&tangent, TOLERANCE, NUMERIC);
            }
        }
    }
}

#[test]
fn similarity_tangents_obey_the_laws() {
    let mut rng = random::seeded(7);
    for angle in angles() {
        for log_scale in [0.0, 1e-12, -1e-7, 1e-3, -0.1, 0.6, -0.99, 1.01, -2.0, 3.0] {
            let phi = random::unit_vector(&mut rng) * angle;
            for length in [0.0, 1.0, 300.0] {
                let rho = random::unit_vector(&mut rng) * length;
                let tangent = SVector::from([rho.x, rho.y, rho.z, phi.x, phi.y, phi.z, log_scale]);
                assert_tangent_laws::<Sim3, 7>(&tangent, TOLERANCE, 1e-9);
            }
        }
    }
}

#[test]
fn small_motions_keep_relative_accuracy() {
    for power in -200..=-1 {
        let size = 10.0_f64.powi(power);
        let planar = Vector3::new(0.3, -0.9, 0.7) * size;
        let error = (Se2::exp(&planar).log() - planar).amax() / size;
        assert!(error < 1e-15, "SE(2) at 1e{power}: {error:e}");
        let spatial = Vector6::new(0.3, -0.9, 0.7, 0.1, 0.8, -0.4) * size;
        let error = (Se3::exp(&spatial).log() - spatial).amax() / size;
        assert!(error < 1e-15, "SE(3) at 1e{power}: {error:e}");
    }
}

/// The 4 × 4 matrix [L t; 0 1], or [L t; 0 0] for the algebra.
fn homogeneous(linear: &Matrix3<f64>, column: &Vector3<f64>, corner: f64) -> Matrix4<f64> {
    let mut matrix = Matrix4::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(linear);
    matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(column);
    matrix[(3, 3)] = corner;
    matrix
}

#[test]
fn exponentials_are_the_matrix_exponential() {
    let mut rng = random::seeded(8);
    for angle in angles() {
        for log_scale in [0.0, 1e-5, -0.3, 1.5] {
            let rho = random::unit_vector(&mut rng) * 2.0;
            let phi = random::unit_vector(&mut rng) * angle;
            let algebra =
                homogeneous(&(hat(&phi) + Matrix3::identity() * log_scale), &rho, 0.0).exp();
            let similarity =
                Sim3::exp(&SVector::from([rho.x, rho.y, rho.z, phi.x, phi.y, phi.z, log_scale]));
            let linear = similarity.rotation.matrix() * similarity.scale;
            let error = homogeneous(&linear, &similarity.translation, 1.0) - algebra;
            assert!(error.amax() < 1e-13 * algebra.amax(), "angle {angle}, scale {log_scale}");
            if log_scale == 0.0 {
                let motion = Se3::exp(&Vector6::new(rho.x, rho.y, rho.z, phi.x, phi.y, phi.z));
                let matrix = homogeneous(&motion.rotation.matrix(), &motion.translation, 1.0);
                assert!((matrix - algebra).amax() < 1e-14 * algebra.amax().max(1.0), "{angle}");
            }
        }
    }
}

#[test]
fn logarithms_are_those_of_the_whole_group() {
    // A quarter circle of radius 1: the twist follows the arc, not the chord.
    let quarter = Se2::from_xy_angle(1.0, 1.0, FRAC_PI_2);
    let expected = Vector3::new(FRAC_PI_2, 0.0, FRAC_PI_2);
    assert!((quarter.log() - expected).amax() < 1e-15);
    let screw = Se3::new(So3::exp(&(Vector3::z() * FRAC_PI_2)), Vector3::new(1.0, 1.0, 7.0));
    let expected = Vector6::new(FRAC_PI_2, 0.0, 7.0, 0.0, 0.0, FRAC_PI_2);
    assert!((screw.log() - expected).amax() < 1e-15);
}

#[test]
fn planar_motions_are_spatial_motions_about_z() {
    for angle in angles() {
        let planar = Vector3::new(3.0, -4.0, angle);
        let spatial = Vector6::new(3.0, -4.0, 0.0, 0.0, 0.0, angle);
        let jacobian = Se3::right_jacobian_inverse(&spatial);
        let picked = Matrix3::from_fn(|i, j| jacobian[([0, 1, 5][i], [0, 1, 5][j])]);
        assert!((Se2::right_jacobian_inverse(&planar) - picked).amax() < 1e-14, "angle {angle}");
    }
}

#[test]
fn transforms_compose_and_invert() {
    let mut rng = random::seeded(9);
    for _ in 0..100 {
        let p: Vector3<f64> = random::normal_vector(&mut rng, 5.0);
        let a = random::element::<Sim3, 7>(&mut rng, 1.0);
        let b = random::element::<Sim3, 7>(&mut rng, 1.0);
        let scale = 1.0 + (a * b).transform(&p).amax() + a.transform(&p).amax() / a.scale;
        assert!(((a * b).transform(&p) - a.transform(&b.transform(&p))).amax() < 1e-13 * scale);
        assert!((a.inverse().transform(&a.transform(&p)) - p).amax() < 1e-13 * scale);
        let motion = Se3::new(a.rotation, a.translation);
        assert!((motion.inverse_transform(&motion.transform(&p)) - p).amax() < 1e-13);
        assert!((motion.inverse().transform(&motion.transform(&p)) - p).amax() < 1e-13);
        let flat = Se2::from_xy_angle(p.x, p.y, p.z);
        let q = p.xy();
        assert!((flat.inverse().transform(&flat.transform(&q)) - q).amax() < 1e-13);
    }
}

#[test]
fn not_finite_is_seen() {
    assert!(!So2::from_angle(f64::NAN).is_finite());
    assert!(!Se2::from_xy_angle(0.0, f64::INFINITY, 0.0).is_finite());
    assert!(!So3::exp(&Vector3::new(f64::NAN, 0.0, 0.0)).is_finite());
    assert!(!Se3::new(So3::identity(), Vector3::new(0.0, 0.0, f64::NAN)).is_finite());
    assert!(!Sim3::new(So3::identity(), Vector3::zeros(), f64::INFINITY).is_finite());
    // Must return at all: the halving of a tangent is bounded.
    let jacobian = Sim3::right_jacobian_inverse(&SVector::repeat(f64::INFINITY));
    assert!(!jacobian.iter().all(|v| v.is_finite()));
}
