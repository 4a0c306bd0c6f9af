//! Relative-pose factors against numeric differentiation, residuals large and small; those of priors
//! are in `priors.rs`.

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se2, Se3, Sim3};
use covis_solvers::information::Information;
use covis_solvers::testing::assert_jacobian;
use covis_solvers::testing::random::{element, seeded, uniform_vector};
use nalgebra::SVector;

/// Past this angle the numeric steps come too near the logarithm's jump at π.
const MAX_ANGLE: f64 = 2.8;

/// Sweeps residuals from nearly zero to `MAX_ANGLE`; `angle` reads a residual's rotation.
fn sweep<G: LieGroup<N>, const N: usize>(seed: u64, angle: impl Fn(&SVector<f64, N>) -> f64) {
    let mut rng = seeded(seed);
    let mut largest = 0.0_f64;
    for size in [0.0, 1e-9, 1e-5, 1e-2, 0.3, 1.0, 1.8] {
        for _ in 0..30 {
            let x_i: G = element(&mut rng, 0.8);
            let error: SVector<f64, N> = uniform_vector(&mut rng, size);
            let i_from_j: G = element(&mut rng, 0.8);
            let x_j = x_i.compose(&i_from_j).plus(&error);
            let factor = RelativePose {
                i: 0,
                j: 1,
                i_from_j,
                information: Information::identity(),
                loss: None,
            };
            let pair = factor.linearize(&x_i, &x_j);
            if angle(&pair.residual) > MAX_ANGLE {
                continue;
            }
            largest = largest.max(angle(&pair.residual));
            assert_eq!(pair.residual, factor.residual(&x_i, &x_j));
            assert!((G::exp(&pair.residual).minus(&G::exp(&error))).norm() < 1e-9);
            assert_jacobian("d_i", |d| factor.residual(&x_i.plus(d), &x_j), &pair.d_i, 1e-8);
            assert_jacobian("d_j", |d| factor.residual(&x_i, &x_j.plus(d)), &pair.d_j, 1e-8);
        }
    }
    assert!(largest > 1.5, "the sweep reached {largest} rad only");
}

#[test]
fn relative_pose_in_the_plane() {
    sweep::<Se2, 3>(1, |r| r[2].abs());
}

#[test]
fn relative_pose_in_space() {
    sweep::<Se3, 6>(2, |r| r.fixed_rows::<3>(3).norm());
}

#[test]
fn relative_pose_of_similarities() {
    sweep::<Sim3, 7>(3, |r| r.fixed_rows::<3>(3).norm());
}
