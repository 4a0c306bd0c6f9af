//! Seeded sampling of vectors and group elements.
//!
//! Everything draws from a ChaCha8 stream, whose output is fixed by its seed on every platform.
//! Nothing here may touch an operating-system source of randomness.

use nalgebra::{SVector, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::geometry::{LieGroup, So3};

/// The generator of a seed.
pub fn seeded(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// A vector of independent normal numbers with standard deviation `sigma`.
pub fn normal_vector<const N: usize>(rng: &mut impl Rng, sigma: f64) -> SVector<f64, N> {
    SVector::from_fn(|_, _| sigma * rng.sample::<f64, _>(StandardNormal))
}

/// A vector with entries uniform in [−`half_width`, `half_width`).
pub fn uniform_vector<const N: usize>(rng: &mut impl Rng, half_width: f64) -> SVector<f64, N> {
    SVector::from_fn(|_, _| half_width * (2.0 * rng.random::<f64>() - 1.0))
}

/// A direction uniform on the unit sphere.
pub fn unit_vector(rng: &mut impl Rng) -> Vector3<f64> {
    loop {
        let direction: Vector3<f64> = normal_vector(rng, 1.0);
        let norm = direction.norm();
        if norm > 1e-3 {
            return direction / norm;
        }
    }
}

/// A rotation uniform over the group (a normalized normal 4-vector as quaternion).
pub fn rotation(rng: &mut impl Rng) -> So3 {
    loop {
        let q: SVector<f64, 4> = normal_vector(rng, 1.0);
        if let Some(rotation) = So3::from_quaternion_xyzw(q[0], q[1], q[2], q[3]) {
            return rotation;
        }
    }
}

/// `mean` ⊞ δ with δ normal, entry i with standard deviation `sigmas[i]`.
pub fn perturbed<G: LieGroup<N>, const N: usize>(
    rng: &mut impl Rng,
    mean: &G,
    sigmas: &SVector<f64, N>,
) -> G {
    let delta: SVector<f64, N> = normal_vector(rng, 1.0);
    mean.plus(&delta.component_mul(sigmas))
}

/// Exp(δ) with δ normal of standard deviation `sigma` in every entry.
pub fn element<G: LieGroup<N>, const N: usize>(rng: &mut impl Rng, sigma: f64) -> G {
    perturbed(rng, &G::identity(), &SVector::repeat(sigma))
}
