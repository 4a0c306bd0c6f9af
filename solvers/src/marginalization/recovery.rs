//! Factors on a tree that say together what Δ says, as nearly as a tree can.
//!
//! The tree is spanned by the nodes of Δ and maximizes Σ log det Ω_ij, Ω_ij the information of the
//! motion from i to j when all other nodes are eliminated. In e = δ_j − Ad(X_j⁻¹ X_i) δ_i, the change
//! of that motion, Δ has no part along δ_i left, and Ω_ij is the block of j. The tree is chosen from
//! covariances, which need Δ + εI; the edges' information is then taken from Δ itself, halving the
//! tree and eliminating what a half does not touch: O(n³) for all. It reads Δ and the estimates, no
//! observation.

use nalgebra::{Cholesky, DMatrix, Matrix6};

use super::Marginal;
use super::blocks::{BLOCK, block, marginal, spectral};
use super::knowledge::{Knowledge, Node};
use crate::factors::{PosePrior, RelativePose};
use crate::geometry::{LieGroup, Se3};
use crate::information::Information;
use crate::loss::Loss;
use crate::problem::BundleProblem;

/// ε: what the covariances take for the information of a direction without any, relative to what
/// was measured there.
const REGULARIZATION: f64 = 1e-9;

/// An edge whose information is below this share of what was measured is left out.
const NEGLIGIBLE: f64 = 1e-9;

/// The least eigenvalue of an information, relative to its largest one.
const FLOOR: f64 = 1e-11;

/// The factors of the tree, negligible ones left out.
pub(super) fn on_a_tree(
    problem: &BundleProblem,
    removed: usize,
    knowledge: &Knowledge,
) -> Marginal {
    let pose = |slot: usize| match knowledge.nodes[slot] {
        Node::World => problem.poses[removed],
        Node::Pose(pose) => problem.poses[pose],
    };
    let edges = spanning_tree(knowledge, &pose);
    let slots: Vec<usize> = (0..knowledge.nodes.len()).collect();
    let mut blocks = Vec::with_capacity(edges.len());
    edge_blocks(&knowledge.scaled, &slots, &edges, &mut blocks);
    let mut result = Marginal::default();
    for (&(i, j), scaled) in edges.iter().zip(&blocks) {
        let Some(information) = information(knowledge, j, scaled) else { continue };
        // The world is the first node, so that no edge ends in it.
        let Node::Pose(j) = knowledge.nodes[j] else { continue };
        let world_from_j = problem.poses[j];
        match knowledge.nodes[i] {
            Node::World => {
                let world_from_camera = world_from_j;
                result.pose_priors.push(PosePrior {
                    pose: j,
                    world_from_camera,
                    information,
                    loss: Loss::Trivial,
                });
            }
            Node::Pose(i) => {
                let i_from_j = problem.poses[i].inverse().compose(&world_from_j);
                result.relative_poses.push(RelativePose {
                    i,
                    j,
                    i_from_j,
                    information,
                    loss: None,
                });
            }
        }
    }
    result.relative_poses.sort_by_key(|factor| (factor.i, factor.j));
    result.pose_priors.sort_by_key(|factor| factor.pose);
    result
}

/// The edges (i, j), i < j, of the tree with the greatest sum of log determinants (Prim).
fn spanning_tree(knowledge: &Knowledge, pose: &impl Fn(usize) -> Se3) -> Vec<(usize, usize)> {
    let count = knowledge.nodes.len();
    let regularized = &knowledge.scaled
        + DMatrix::from_diagonal_element(BLOCK * count, BLOCK * count, REGULARIZATION);
    // Without a factor, which rounding alone could prevent, every tree is as good.
    let covariance = Cholesky::new(regularized).map(|factor| factor.inverse());
    let weight = |i: usize, j: usize| {
        let covariance = covariance.as_ref()?;
        log_determinant(covariance, knowledge, [i, j], &pose(j).inverse().compose(&pose(i)))
    };
    let mut outside: Vec<(usize, usize, f64)> =
        (1..count).map(|j| (j, 0, f64::NEG_INFINITY)).collect();
    let mut edges = Vec::with_capacity(outside.len());
    let mut newest = 0;
    while !outside.is_empty() {
        for (node, parent, best) in &mut outside {
            let weight = weight(newest.min(*node), newest.max(*node)).unwrap_or(f64::NEG_INFINITY);
            if weight > *best {
                (*parent, *best) = (newest, weight);
            }
        }
        let heavier = |best: usize, k: usize| if outside[k].2 > outside[best].2 { k } else { best };
        let next = (1..outside.len()).fold(0, heavier);
        let (node, parent, _) = outside.remove(next);
        edges.push((parent.min(node), parent.max(node)));
        newest = node;
    }
    edges
}

/// log det Ω_ij from the scaled covariance of all nodes; `None` where rounding makes it indefinite.
fn log_determinant(
    covariance: &DMatrix<f64>,
    knowledge: &Knowledge,
    [i, j]: [usize; 2],
    j_from_i: &Se3,
) -> Option<f64> {
    let adjoint = j_from_i.adjoint();
    let scale = |slot: usize, k: usize| knowledge.scale[BLOCK * slot + k];
    let adjoint = Matrix6::from_fn(|r, c| scale(j, r) * adjoint[(r, c)] / scale(i, c));
    let cross = adjoint * block(covariance, i, j);
    let of_motion = block(covariance, j, j) - cross - cross.transpose()
        + adjoint * block(covariance, i, i) * adjoint.transpose();
    let factor = Cholesky::new((of_motion + of_motion.transpose()) * 0.5)?;
    let l = factor.l_dirty();
    Some((0..BLOCK).map(|k| 2.0 * (scale(j, k).ln() - l[(k, k)].ln())).sum())
}

/// Ω_ij of each edge, scaled as j is; `slots` are the nodes that `matrix` is over, in rising order.
fn edge_blocks(
    matrix: &DMatrix<f64>,
    slots: &[usize],
    edges: &[(usize, usize)],
    blocks: &mut Vec<Matrix6<f64>>,
) {
    if let ([_, _], [_]) = (slots, edges) {
        blocks.push(block(matrix, 1, 1));
        return;
    }
    let (first, second) = edges.split_at(edges.len() / 2);
    for half in [first, second].into_iter().filter(|half| !half.is_empty()) {
        let mut touched: Vec<usize> = half.iter().flat_map(|&(i, j)| [i, j]).collect();
        touched.sort_unstable();
        touched.dedup();
        let kept: Vec<usize> =
            (0..slots.len()).filter(|&k| touched.binary_search(&slots[k]).is_ok()).collect();
        edge_blocks(&marginal(matrix, &kept), &touched, half, blocks);
    }
}

/// The information of an edge that ends in slot `j`; `None` where it is negligible.
fn information(knowledge: &Knowledge, j: usize, scaled: &Matrix6<f64>) -> Option<Information<6>> {
    let (largest, _) = spectral(scaled, |value| value);
    if largest.is_nan() || largest <= NEGLIGIBLE {
        return None;
    }
    let (_, lifted) = spectral(scaled, |value| value.max(FLOOR * largest));
    let scale = |k: usize| knowledge.scale[BLOCK * j + k];
    let matrix = Matrix6::from_fn(|r, c| lifted[(r, c)] * (scale(r) * scale(c)));
    Information::new(&matrix).ok()
}
