//! Rotation averaging: the rotations of all keyframes from relative ones, some of which are false.
//!
//! Minimizes Σ ρ(ωᵀ Λ ω) with ω = Log(R_bᵀ R_a Zᵀ) for each edge Z = `b_from_a` by iteratively reweighted
//! least squares in the tangent spaces: ρ is first the root, which a false edge cannot move far
//! (Chatterjee and Govindu, "Efficient and robust large-scale rotation averaging", 2013), then
//! Geman-McClure's. Λ is what the two views tell of their turn (Zhang, Larsson and Barath, "Revisiting
//! rotation averaging: uncertainties and robust losses", 2023), with a floor of the variance for what they do
//! not know of: the lens. It starts from a spanning tree of the edges with most inliers. Positions are
//! not known here.

use std::cmp::Reverse;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::planned;
use super::relative_poses::Edge;
use crate::geometry::{LieGroup, So3};
use crate::linear::{BlockMatrix, BlockPattern};
use crate::order;
use crate::price::Limits;
use crate::problem::{DisjointSets, SolveError};

/// Standard deviation of a relative rotation that no number of landmarks makes smaller, rad.
const FLOOR_RAD: f64 = 5e-4;
/// Iterations with each loss.
const ITERATIONS: usize = 30;
/// Width of Geman-McClure's loss, in standard deviations.
const WIDTH: f64 = 4.0;
/// The iteration ends when no rotation moves further, rad.
const STEP_TOLERANCE: f64 = 1e-7;
/// An edge that is off by more than both in the result is false: rad, and standard deviations.
const FALSE_RAD: f64 = 0.09;
const FALSE_SIGMAS: f64 = 8.0;

/// The poses of the largest piece that edges tie together, rising; the one with the lowest pose among
/// equals.
pub(super) fn largest_piece(edges: &[&Edge], poses: usize) -> Vec<usize> {
    let mut sets = DisjointSets::new(poses);
    edges.iter().for_each(|edge| _ = sets.join(edge.a, edge.b));
    let mut sizes = vec![0_usize; poses];
    (0..poses).for_each(|pose| sizes[sets.root(pose)] += 1);
    let Some(root) = (0..poses).max_by_key(|&pose| (sizes[pose], Reverse(pose))) else {
        return Vec::new();
    };
    (0..poses).filter(|&pose| sets.root(pose) == root).collect()
}

/// Averages the rotations of the poses that `edges` tie together, `world_from_camera`, by pose; the
/// lowest pose has the identity. `None` where a system cannot be solved, or the interrupt is due.
///
/// # Errors
/// [`SolveError::TooExpensive`], [`SolveError::TooLarge`].
pub(super) fn average(
    edges: &[&Edge],
    piece: &[usize],
    poses: usize,
    limits: Limits<'_>,
) -> Result<Option<Vec<Option<So3>>>, SolveError> {
    let interrupt = limits.interrupt;
    let mut rotations = tree(edges, piece, poses);
    let mut row_of = vec![None; poses];
    piece.iter().skip(1).enumerate().for_each(|(row, &pose)| row_of[pose] = Some(row));
    let inside: Vec<&Edge> =
        edges.iter().copied().filter(|edge| rotations[edge.a].is_some()).collect();
    let rows = piece.len() - 1;
    if rows == 0 {
        return Ok(Some(rotations));
    }
    let pairs = inside.iter().filter_map(|edge| Some((row_of[edge.a]?, row_of[edge.b]?)));
    let pattern = Arc::new(BlockPattern::new(vec![3; rows], pairs));
    let mut matrix = BlockMatrix::new(Arc::clone(&pattern));
    let Some(mut factor) = planned(&pattern, limits)? else { return Ok(None) };
    let weights: Vec<Matrix3<f64>> = inside.iter().map(|edge| floored(&edge.information)).collect();
    for robust in [false, true] {
        for _ in 0..ITERATIONS {
            if interrupt.is_due() {
                return Ok(None);
            }
            matrix.set_zero();
            let mut right = vec![0.0; 3 * rows];
            for (edge, information) in inside.iter().zip(&weights) {
                let Some(error) = error(edge, &rotations) else { continue };
                let s = error.dot(&(information * error));
                let weight = if robust {
                    (WIDTH * WIDTH / (WIDTH * WIDTH + s)).powi(2)
                } else {
                    1.0 / s.sqrt().max(1.0)
                };
                let weighted = information * weight;
                // ω changes by Z δ_a − δ_b.
                let turn = edge.rotation.matrix();
                if let Some(row) = row_of[edge.b] {
                    matrix.add_block(row, row, &weighted);
                    add_vector(&mut right, row, &(weighted * error));
                }
                if let Some(row) = row_of[edge.a] {
                    matrix.add_block(row, row, &(turn.transpose() * weighted * turn));
                    add_vector(&mut right, row, &-(turn.transpose() * weighted * error));
                }
                if let (Some(a), Some(b)) = (row_of[edge.a], row_of[edge.b]) {
                    matrix.add_block(a, b, &-(turn.transpose() * weighted));
                }
            }
            // A rotation that hardly an edge holds must not stop the others.
            let damping: Vec<f64> =
                matrix.diagonal().iter().map(|entry| 1e-9 * entry + 1e-3).collect();
            if factor.factor_until(&matrix, &damping, interrupt).is_err() {
                return Ok(None);
            }
            factor.solve(&mut right);
            let mut longest: f64 = 0.0;
            for (&pose, step) in piece.iter().skip(1).zip(right.chunks_exact(3)) {
                let mut step = Vector3::from_column_slice(step);
                longest = longest.max(step.norm());
                if step.norm() > 1.0 {
                    step /= step.norm();
                }
                let Some(rotation) = rotations[pose].as_mut() else { continue };
                *rotation = rotation.compose(&So3::exp(&step));
                if !rotation.is_finite() {
                    return Ok(None);
                }
            }
            if longest < STEP_TOLERANCE {
                break;
            }
        }
    }
    Ok(Some(rotations))
}

/// Whether an edge agrees with the averaged rotations of its poses.
pub(super) fn agrees(edge: &Edge, rotations: &[Option<So3>]) -> bool {
    error(edge, rotations).is_some_and(|error| {
        let sigmas = error.dot(&(floored(&edge.information) * error)).sqrt();
        error.norm() < FALSE_RAD || sigmas < FALSE_SIGMAS
    })
}

fn error(edge: &Edge, rotations: &[Option<So3>]) -> Option<Vector3<f64>> {
    let (a, b) = (rotations[edge.a]?, rotations[edge.b]?);
    Some(b.inverse().compose(&a).compose(&edge.rotation.inverse()).log())
}

/// (Λ⁻¹ + σ² I)⁻¹, written so that Λ may be singular.
fn floored(information: &Matrix3<f64>) -> Matrix3<f64> {
    let with_floor = Matrix3::identity() + information * (FLOOR_RAD * FLOOR_RAD);
    let floored = with_floor.try_inverse().map_or(*information, |inverse| inverse * information);
    (floored + floored.transpose()) * 0.5
}

/// Rotations along the spanning tree of the edges with most inliers that agree with most triangles.
fn tree(edges: &[&Edge], piece: &[usize], poses: usize) -> Vec<Option<So3>> {
    let mut order: Vec<usize> = (0..edges.len()).collect();
    order::sort_by(&mut order, &mut |a, b| edges[b].inliers.cmp(&edges[a].inliers));
    let mut sets = DisjointSets::new(poses);
    let mut neighbors: Vec<Vec<usize>> = vec![Vec::new(); poses];
    for k in order {
        if sets.join(edges[k].a, edges[k].b) {
            neighbors[edges[k].a].push(k);
            neighbors[edges[k].b].push(k);
        }
    }
    let mut rotations = vec![None; poses];
    let Some(&root) = piece.first() else { return rotations };
    rotations[root] = Some(So3::identity());
    let mut frontier = vec![root];
    while let Some(from) = frontier.pop() {
        let Some(rotation) = rotations[from] else { continue };
        for &k in &neighbors[from] {
            let edge = edges[k];
            let (to, from_to) = if edge.a == from {
                (edge.b, edge.rotation.inverse())
            } else {
                (edge.a, edge.rotation)
            };
            if rotations[to].is_none() {
                rotations[to] = Some(rotation.compose(&from_to));
                frontier.push(to);
            }
        }
    }
    rotations
}

fn add_vector(right: &mut [f64], row: usize, vector: &Vector3<f64>) {
    right[3 * row..].iter_mut().zip(vector.iter()).for_each(|(value, added)| *value += added);
}
