//! Which poses the factors leave open, and in which directions: the diagnosis of a singular graph.
//!
//! Directions without information are the null space of H. A few vectors of it come from inverse
//! iteration with H + εD and a Rayleigh-Ritz step over them (Parlett, "The symmetric eigenvalue
//! problem", 1980, chapters 4 and 11); a pose is open in the span of its blocks in them. D is a scalar
//! a pose, its largest information, so that "none" means none beside that. Graphs that definite
//! edges tie together are determined for certain and are not factored. Nothing here moves a pose.

use std::sync::Arc;

use nalgebra::{DMatrix, SVector};

use super::assembly::{Incidences, linearize_edges};
use super::landmarks;
use super::priors;
use super::ranges;
use super::rows::Rows;
use super::system::blocks_mut;
use crate::geometry::LieGroup;
use crate::interrupt::Interrupt;
use crate::linear::{BlockMatrix, Cholesky, PairTerm};
use crate::loss::Loss;
use crate::problem::{PoseGraph, SolveError};

/// ε; where rounding makes H + εD indefinite, it grows by tens up to the square root of this.
const SHIFT: f64 = 1e-12;

/// Steps of inverse iteration: each takes ε/(ε + μ) of a direction with information μ.
const ROUNDS: usize = 3;

/// A Ritz value below this share of the poses' information is none.
const NO_INFORMATION: f64 = 1e-12;

/// A pose that moves less than this share of the one that moves most stays where it is.
const STILL: f64 = 1e-5;

/// A pose or a landmark that the factors do not determine.
#[derive(Clone, Debug, PartialEq)]
pub struct Undetermined<const N: usize> {
    /// Its id.
    pub id: i64,
    /// Independent unit tangents (right perturbations, translation first) along which it can move,
    /// others perhaps with it, without a change of the cost to second order; along axes where possible.
    /// Of a landmark the first entries are its position in the world, and the rest are zero.
    pub directions: Vec<SVector<f64, N>>,
}

/// The poses of `graph`, then its landmarks, that its factors leave open where they are, in index order;
/// none in most graphs, which is found out in a fraction of a step's time.
///
/// Where no pose is constant and there are no priors, the one with the lowest id counts as held. A
/// loss counts with its weights at the poses.
///
/// # Errors
/// Those of [`PoseGraph::validate`]; [`SolveError::TooLarge`].
pub fn undetermined<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
) -> Result<Vec<Undetermined<N>>, SolveError> {
    graph.validate()?;
    // Tukey's weights may be zero, which takes an edge out of the graph.
    if graph.is_rigid() && !matches!(graph.loss, Loss::Tukey(_)) {
        return Ok(Vec::new());
    }
    let rows = Rows::new(graph);
    if rows.count() == 0 {
        return Ok(Vec::new());
    }
    let hessian = hessian(graph, &rows);
    let pattern = Arc::clone(hessian.pattern());
    let null_vectors = null_vectors::<N>(&hessian)?;
    let largest = null_vectors.iter().flatten().fold(0.0_f64, |max, x| max.max(x.abs()));
    let of_poses = rows.free_poses.iter().map(|&pose| graph.ids[pose]);
    let of_landmarks = rows.free_landmarks.iter().map(|&landmark| graph.landmarks.ids[landmark]);
    let open = of_poses.chain(of_landmarks).enumerate().filter_map(|(row, id)| {
        let range = pattern.offset(row)..pattern.offset(row + 1);
        let block = |vector: &Vec<f64>| {
            let own = &vector[range.clone()];
            SVector::from_fn(|axis, _| own.get(axis).copied().unwrap_or(0.0))
        };
        let directions = independent(null_vectors.iter().map(block).collect(), STILL * largest);
        (!directions.is_empty()).then_some(Undetermined { id, directions })
    });
    Ok(open.collect())
}

/// H at the graph's variables, a block row for each that may move.
pub(super) fn hessian<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    rows: &Rows,
) -> BlockMatrix {
    let pattern = Arc::new(rows.pattern(graph));
    let rows_of_edges = graph.free_indices_of_edges(&rows.of_pose);
    let incidences = Incidences::new(&pattern, rows.free_poses.len(), rows_of_edges);
    let mut blocks = vec![PairTerm::zeros(); graph.edges.len()];
    linearize_edges(&graph.edges, &graph.poses, graph.loss, &Interrupt::NEVER, &mut blocks);
    let mut hessian = BlockMatrix::new(pattern);
    let mut gradient = vec![0.0; hessian.pattern().dimension()];
    incidences.assemble(&blocks, &Interrupt::NEVER, &mut hessian, &mut gradient);
    priors::add(graph, &rows.of_pose, &mut hessian, &mut gradient);
    landmarks::add(graph, rows, &mut hessian, &mut gradient);
    ranges::add(graph, rows, &mut hessian, &mut gradient);
    hessian
}

/// At most N orthonormal vectors of the null space of `hessian`, in its largest directions.
fn null_vectors<const N: usize>(hessian: &BlockMatrix) -> Result<Vec<Vec<f64>>, SolveError> {
    let pattern = hessian.pattern();
    let dimension = pattern.dimension();
    let mut factor =
        Cholesky::new(Arc::clone(pattern)).map_err(|_error| SolveError::TooLarge { dimension })?;
    // D, in whose norm everything is measured.
    let mut scale = hessian.diagonal();
    for block in blocks_mut(pattern, &mut scale) {
        let largest = block.iter().fold(0.0_f64, |max, &h| max.max(h));
        block.fill(if largest > 0.0 { largest } else { 1.0 });
    }
    let mut shift = SHIFT;
    loop {
        let shifted: Vec<f64> = scale.iter().map(|scale| shift * scale).collect();
        if factor.factor(hessian, &shifted).is_ok() {
            break;
        }
        shift *= 10.0;
        if shift > SHIFT.sqrt() {
            // H is not positive semi-definite: no direction can be reported.
            return Ok(Vec::new());
        }
    }
    // y = √D x; H becomes D^-½ H D^-½.
    let roots: Vec<f64> = scale.iter().map(|scale| scale.sqrt()).collect();
    let mut basis: Vec<Vec<f64>> = (0..N.min(dimension)).map(|k| probe(k, dimension)).collect();
    for _ in 0..ROUNDS {
        for y in &mut basis {
            y.iter_mut().zip(&roots).for_each(|(y, root)| *y *= root);
            factor.solve(y);
            y.iter_mut().zip(&roots).for_each(|(y, root)| *y *= root);
        }
        orthonormalize(&mut basis);
    }
    let images: Vec<Vec<f64>> = basis.iter().map(|y| image(hessian, &roots, y)).collect();
    let count = basis.len();
    let ritz = DMatrix::from_fn(count, count, |r, c| {
        0.5 * (dot(&basis[r], &images[c]) + dot(&basis[c], &images[r]))
    });
    if !ritz.iter().all(|value| value.is_finite()) {
        return Ok(Vec::new());
    }
    let eigen = ritz.symmetric_eigen();
    let null = (0..count).filter(|&k| eigen.eigenvalues[k] <= NO_INFORMATION);
    let combine = |k: usize| {
        let mut vector = vec![0.0; dimension];
        for (y, weight) in basis.iter().zip(eigen.eigenvectors.column(k).iter()) {
            vector.iter_mut().zip(y).for_each(|(sum, y)| *sum += weight * y);
        }
        vector
    };
    Ok(null.map(combine).collect())
}

/// A vector without structure, the same every time: multiples of an irrational number, modulo 1.
fn probe(k: usize, dimension: usize) -> Vec<f64> {
    let irrational = (k as f64 + 2.0).sqrt() * std::f64::consts::E;
    (1..=dimension).map(|i| (i as f64 * i as f64 * irrational).fract() - 0.5).collect()
}

/// D^-½ H D^-½ y.
fn image(hessian: &BlockMatrix, roots: &[f64], y: &[f64]) -> Vec<f64> {
    let x: Vec<f64> = y.iter().zip(roots).map(|(y, root)| y / root).collect();
    let mut image = vec![0.0; y.len()];
    // 0 − H x; shapes agree, so that it cannot fail.
    let zeros = vec![0.0; y.len()];
    if hessian.residual(&[], &x, &zeros, &mut image).is_err() {
        image.fill(f64::NAN);
    }
    image.iter_mut().zip(roots).for_each(|(value, root)| *value /= -root);
    image
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Gram-Schmidt, twice for orthogonality to rounding.
fn orthonormalize(basis: &mut [Vec<f64>]) {
    for k in 0..basis.len() {
        let (before, rest) = basis.split_at_mut(k);
        let own = &mut rest[0];
        for _ in 0..2 {
            for other in before.iter() {
                let along = dot(other, own);
                own.iter_mut().zip(other).for_each(|(x, o)| *x -= along * o);
            }
            let norm = dot(own, own).sqrt();
            own.iter_mut().for_each(|x| *x /= norm);
        }
    }
}

/// Unit vectors that span `vectors` but for what is at most `threshold`: Gauss-Jordan elimination
/// with full pivoting, which finds axes where the span holds them.
fn independent<const N: usize>(
    mut vectors: Vec<SVector<f64, N>>,
    threshold: f64,
) -> Vec<SVector<f64, N>> {
    let mut found: Vec<(usize, SVector<f64, N>)> = Vec::new();
    loop {
        let entries = vectors
            .iter()
            .enumerate()
            .flat_map(|(v, vector)| (0..N).map(move |axis| (v, axis, vector[axis].abs())));
        let pivot =
            entries.fold((0, 0, 0.0), |best, entry| if entry.2 > best.2 { entry } else { best });
        let (index, axis, size) = pivot;
        if size <= threshold || size == 0.0 {
            break;
        }
        let vector = vectors.swap_remove(index);
        let vector = vector / vector[axis];
        for other in vectors.iter_mut().chain(found.iter_mut().map(|(_, other)| other)) {
            *other -= vector * other[axis];
        }
        found.push((axis, vector));
    }
    found.sort_by_key(|&(axis, _)| axis);
    let clean = |(_, vector): (usize, SVector<f64, N>)| {
        // Rounding errors must not be reported as a direction.
        vector.map(|x| if x.abs() <= STILL { 0.0 } else { x }).normalize()
    };
    found.into_iter().map(clean).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{SMatrix, SVector};

    use super::independent;

    #[test]
    fn axes_are_found_in_a_span() {
        let rotation = SMatrix::<f64, 2, 2>::new(0.8, -0.6, 0.6, 0.8);
        let vectors = (0..2)
            .map(|k| SVector::<f64, 3>::new(rotation[(0, k)], 1e-9, rotation[(1, k)]))
            .collect();
        let found = independent(vectors, 1e-5);
        assert_eq!(found, [SVector::<f64, 3>::x(), SVector::<f64, 3>::z()]);
        assert!(independent(vec![SVector::<f64, 3>::zeros()], 0.0).is_empty());
        let skew = SVector::<f64, 3>::new(3.0, 4.0, 0.0);
        assert_eq!(independent(vec![skew, skew * 2.0], 1e-12), [skew / 5.0]);
    }
}
