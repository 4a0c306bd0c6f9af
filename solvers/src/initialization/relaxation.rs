//! Relaxed rotations of a pose graph with landmarks.
//!
//! Edges alone know no closure that landmarks make, so that rotations which edges relax drift as the
//! odometry does. Here row a of every rotation, component a of every position and component a of every
//! landmark are relaxed together: with R_i as a free matrix, the chordal cost of the edges and
//! Σ τ ‖l − t_i − R_i z‖² of the sighted landmarks are linear least squares with one matrix for all a. Each
//! information is replaced by its [`IsotropicPrecision`], without which the rows would not part. Bearings,
//! ranges and priors take no part. It must not look at the start values of what may move.

use std::sync::Arc;

use nalgebra::{SMatrix, SVector, Vector4};

use super::chordal::{IsotropicPrecision, Linear, Rows, inverse_trace};
use crate::factors::{LandmarkMeasurement, Sighting};
use crate::geometry::RigidMotion;
use crate::linear::BlockPattern;
use crate::price::Limits;
use crate::problem::{PoseGraph, SolveError};

/// τ of a measured position and the position; `None` where it does not bound every direction.
pub(super) fn sighted<const D: usize>(
    measurement: &LandmarkMeasurement,
) -> Option<(f64, SVector<f64, D>)> {
    let Sighting::Position(position) = measurement.sighting else { return None };
    let omega = measurement.information.matrix();
    let precision = D as f64 / inverse_trace(&SMatrix::<f64, D, D>::from_fn(|r, c| omega[(r, c)]));
    (precision > 0.0).then(|| (precision, SVector::from_fn(|axis, _| position[axis])))
}

/// A variable in a linear residual: what it is multiplied with, and where it is.
#[derive(Clone, Copy)]
enum Term<const D: usize> {
    /// A block of unknowns with as many coefficients as it has rows.
    Unknown { block: usize, coefficients: Vector4<f64> },
    /// Its value for each row of the world.
    Known(SVector<f64, D>),
}

/// Matrices near the rotations of the poses that move, in row order.
pub(super) fn relaxed_rotations<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &PoseGraph<G, N>,
    rows: &Rows,
    limits: Limits<'_>,
) -> Result<Vec<SMatrix<f64, D, D>>, SolveError> {
    let mut sizes = vec![D + 1; rows.poses.len()];
    sizes.resize(rows.len(), 1);
    let pattern = Arc::new(BlockPattern::new(sizes, rows.pairs(graph)));
    let mut system = Linear::new(pattern, limits)?;
    let mut right = vec![vec![0.0; system.dimension()]; D];
    // A pose is (row a of R, component a of t).
    let pose = |pose: usize, rotation: SVector<f64, D>, translation: f64| match rows.of[pose] {
        Some(block) => {
            let mut coefficients = Vector4::zeros();
            coefficients.rows_mut(0, D).copy_from(&rotation);
            coefficients[D] = translation;
            Term::Unknown { block, coefficients }
        }
        None => {
            let held = &graph.poses[pose];
            Term::Known(held.rotation_matrix() * rotation + held.translation() * translation)
        }
    };
    let none = SVector::<f64, D>::zeros();
    for edge in graph.edges.iter().filter(|edge| edge.i != edge.j) {
        let precision = IsotropicPrecision::of::<D, N>(&edge.information);
        let z = edge.i_from_j.rotation_matrix();
        for axis in 0..D {
            let mut unit = none;
            unit[axis] = 1.0;
            let column: SVector<f64, D> = z.column(axis).into_owned();
            let terms = [pose(edge.i, -column, 0.0), pose(edge.j, unit, 0.0)];
            system.add(&mut right, precision.rotation, terms);
        }
        let t = edge.i_from_j.translation();
        let terms = [pose(edge.i, -t, -1.0), pose(edge.j, none, 1.0)];
        system.add(&mut right, precision.translation, terms);
    }
    for measurement in &graph.landmarks.measurements {
        let Some((precision, z)) = sighted::<D>(measurement) else { continue };
        let from = measurement.pose.map_or(Term::Known(-z), |from| pose(from, -z, -1.0));
        let landmark = match rows.of_landmark[measurement.landmark] {
            Some(block) => Term::Unknown { block, coefficients: Vector4::x() },
            None => {
                let held = &graph.landmarks.positions[measurement.landmark];
                Term::Known(SVector::from_fn(|axis, _| held[axis]))
            }
        };
        system.add(&mut right, precision, [from, landmark]);
    }
    system.factor(graph, rows, "rotation of pose")?;
    right.iter_mut().try_for_each(|right| system.solve(right))?;
    let matrix = |row: usize| SMatrix::from_fn(|r, c| right[r][(D + 1) * row + c]);
    Ok((0..rows.poses.len()).map(matrix).collect())
}

impl Linear<'_> {
    /// Adds weight · (sum of the terms)² for each row of the world.
    fn add<const D: usize>(&mut self, right: &mut [Vec<f64>], weight: f64, terms: [Term<D>; 2]) {
        let mut known = SVector::<f64, D>::zeros();
        for term in &terms {
            if let Term::Known(value) = term {
                known += value;
            }
        }
        for one in &terms {
            let Term::Unknown { block, coefficients } = *one else { continue };
            let (offset, height) = {
                let pattern = self.matrix.pattern();
                (pattern.offset(block), pattern.sizes()[block])
            };
            for (right, known) in right.iter_mut().zip(known.iter()) {
                let entries = right[offset..offset + height].iter_mut();
                entries.zip(&coefficients).for_each(|(entry, c)| *entry -= weight * c * known);
            }
            for other in &terms {
                let Term::Unknown { block: column, coefficients: others } = *other else {
                    continue;
                };
                // The lower triangle alone is stored.
                if column > block {
                    continue;
                }
                let Some(values) = self.matrix.block_mut(block, column) else { continue };
                for (values, other) in values.chunks_exact_mut(height).zip(&others) {
                    let entries = values.iter_mut().zip(&coefficients);
                    entries.for_each(|(value, c)| *value += weight * c * other);
                }
            }
        }
    }
}
