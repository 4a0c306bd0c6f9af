//! Marginalization: exact on small graphs, against a dense reference, in a room, on bad input.
//!
//! The reference here forms the whole Hessian over poses and landmarks and eliminates by
//! pseudo-inverses; it shares the factors' Jacobians with the code under test and nothing else.

mod exact;
mod robustness;
mod room;

use covis_solvers::factors::{PosePrior, PositionPrior, RelativePose};
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::problem::BundleProblem;
use covis_solvers::testing::random::normal_vector;
use nalgebra::{DMatrix, Matrix6, SMatrix, SVector, Vector3};
use rand::Rng;

/// An information with standard deviations of 1 to 10 in each unit and correlations.
fn random_information<const N: usize>(rng: &mut impl Rng) -> Information<N> {
    let mut matrix = SMatrix::<f64, N, N>::identity() * 0.3;
    for _ in 0..2 * N {
        let direction: SVector<f64, N> = normal_vector(rng, 1.0);
        matrix += direction * direction.transpose();
    }
    Information::new(&matrix).unwrap()
}

/// A factor whose residual is zero at the poses.
fn relative_pose(
    problem: &BundleProblem,
    (i, j): (usize, usize),
    rng: &mut impl Rng,
) -> RelativePose<Se3, 6> {
    let i_from_j = problem.poses[i].inverse().compose(&problem.poses[j]);
    RelativePose { i, j, i_from_j, information: random_information(rng), loss: None }
}

/// A prior whose residual is zero at the pose.
fn pose_prior(problem: &BundleProblem, pose: usize, rng: &mut impl Rng) -> PosePrior {
    let world_from_camera = problem.poses[pose];
    PosePrior { pose, world_from_camera, information: random_information(rng), loss: Loss::Trivial }
}

/// A prior whose residual is zero at the pose.
fn position_prior(problem: &BundleProblem, pose: usize, rng: &mut impl Rng) -> PositionPrior {
    let position_in_world = problem.poses[pose].translation;
    PositionPrior {
        pose,
        position_in_world,
        information: random_information(rng),
        point_in_camera: Vector3::zeros(),
        loss: Loss::Trivial,
    }
}

/// H of all factors that `keep` takes, by their poses: 6 rows a pose, then 3 a landmark.
fn hessian(problem: &BundleProblem, keep: &dyn Fn(&[usize]) -> bool) -> DMatrix<f64> {
    let poses = problem.poses.len();
    let side = 6 * poses + 3 * problem.landmarks.len();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    let mut push = |parts: &[(usize, DMatrix<f64>)]| {
        for r in 0..parts[0].1.nrows() {
            let mut row = vec![0.0; side];
            for (offset, part) in parts {
                (0..part.ncols()).for_each(|c| row[offset + c] += part[(r, c)]);
            }
            rows.push(row);
        }
    };
    fn dense<const R: usize, const C: usize>(matrix: SMatrix<f64, R, C>) -> DMatrix<f64> {
        DMatrix::from_fn(R, C, |r, c| matrix[(r, c)])
    }
    for o in problem.observations().filter(|o| keep(&[o.pose as usize])) {
        let (x, p) = (&problem.poses[o.pose as usize], &problem.landmarks[o.landmark as usize]);
        let lin = o.seen.linearize(x, &problem.cameras[o.camera as usize], p).unwrap();
        let weight = problem.observation_loss.evaluate(lin.residual.norm_squared()).weight.sqrt();
        push(&[
            (6 * o.pose as usize, dense(lin.d_pose * weight)),
            (6 * poses + 3 * o.landmark as usize, dense(lin.d_landmark * weight)),
        ]);
    }
    for f in problem.relative_poses.iter().filter(|f| keep(&[f.i, f.j])) {
        let lin = f.linearize(&problem.poses[f.i], &problem.poses[f.j]);
        let s = f.information.squared_norm(&lin.residual);
        let root = *f.information.sqrt().unwrap().matrix()
            * problem.relative_pose_loss.evaluate(s).weight.sqrt();
        push(&[(6 * f.i, dense(root * lin.d_i)), (6 * f.j, dense(root * lin.d_j))]);
    }
    for f in problem.pose_priors.iter().filter(|f| keep(&[f.pose])) {
        let root = *f.information.sqrt().unwrap().matrix();
        push(&[(6 * f.pose, dense(root * f.linearize(&problem.poses[f.pose]).1))]);
    }
    for f in problem.position_priors.iter().filter(|f| keep(&[f.pose])) {
        let root = *f.information.sqrt().unwrap().matrix();
        push(&[(6 * f.pose, dense(root * f.linearize(&problem.poses[f.pose]).1))]);
    }
    let jacobian = DMatrix::from_fn(rows.len(), side, |r, c| rows[r][c]);
    jacobian.transpose() * jacobian
}

/// Eliminates the rows `gone`, in one step, by the pseudo-inverse.
fn schur(hessian: &DMatrix<f64>, kept: &[usize], gone: &[usize]) -> DMatrix<f64> {
    let pick = |rows: &[usize], columns: &[usize]| {
        DMatrix::from_fn(rows.len(), columns.len(), |r, c| hessian[(rows[r], columns[c])])
    };
    let root: Vec<f64> = gone
        .iter()
        .map(|&k| if hessian[(k, k)] > 0.0 { hessian[(k, k)].sqrt().recip() } else { 1.0 })
        .collect();
    let root = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(root));
    let eigen = (&root * pick(gone, gone) * &root).symmetric_eigen();
    let inverse = eigen.eigenvalues.map(|v| if v > 1e-11 { 1.0 / v } else { 0.0 });
    let cross = pick(kept, gone) * root * &eigen.eigenvectors;
    pick(kept, kept) - &cross * DMatrix::from_diagonal(&inverse) * cross.transpose()
}

/// Δ over all poses but `removed`, in their order, by the definition.
fn dense_delta(problem: &BundleProblem, removed: usize) -> DMatrix<f64> {
    let poses = problem.poses.len();
    let side = 6 * poses + 3 * problem.landmarks.len();
    let is_removed = |k: usize| k < 6 * poses && k / 6 == removed;
    let kept: Vec<usize> = (0..6 * poses).filter(|&k| !is_removed(k)).collect();
    let gone: Vec<usize> = (0..side).filter(|&k| k >= 6 * poses || is_removed(k)).collect();
    let with = schur(&hessian(problem, &|_| true), &kept, &gone);
    with - schur(&hessian(problem, &|of| !of.contains(&removed)), &kept, &gone)
}

/// The row of `pose` in a matrix without the removed pose.
fn row_of(pose: usize, removed: usize) -> usize {
    6 * (pose - usize::from(pose > removed))
}

/// Covariance of the change of `i_from_j` where Δ knows relative poses only: pose i is held.
fn relative_covariance(delta: &DMatrix<f64>, i: usize, j: usize) -> Matrix6<f64> {
    let rest: Vec<usize> = (0..delta.nrows()).filter(|k| !(i..i + 6).contains(k)).collect();
    let held = DMatrix::from_fn(rest.len(), rest.len(), |r, c| delta[(rest[r], rest[c])]);
    let covariance = held.cholesky().unwrap().inverse();
    let j = if j > i { j - 6 } else { j };
    covariance.fixed_view::<6, 6>(j, j).into_owned()
}

fn assert_close(actual: &Matrix6<f64>, expected: &Matrix6<f64>, tolerance: f64, what: &str) {
    let error = (actual - expected).amax() / expected.amax();
    assert!(error < tolerance, "{what}: {error:e}\n{actual}{expected}");
}

/// Whether `edges` between `count` nodes have no cycle.
fn is_forest(edges: impl Iterator<Item = (usize, usize)>, count: usize) -> bool {
    let mut label: Vec<usize> = (0..count).collect();
    for (i, j) in edges {
        let (a, b) = (label[i], label[j]);
        if a == b {
            return false;
        }
        label.iter_mut().filter(|l| **l == a).for_each(|l| *l = b);
    }
    true
}
