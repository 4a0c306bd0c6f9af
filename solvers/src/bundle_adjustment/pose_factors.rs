//! Factors that touch poses only: relative poses, pose priors, position priors.
//!
//! They enter the reduced camera system directly. There are few of them, so they are summed in
//! order on one thread. Observations are not read here.

use std::sync::Arc;

use nalgebra::{SMatrix, SVector};

use super::layout::{Layout, NO_BLOCK};
use crate::factors::RelativePose;
use crate::geometry::Se3;
use crate::information::Information;
use crate::linear::{BlockMatrix, BlockPattern};
use crate::loss::Loss;
use crate::problem::BundleProblem;

/// Pairs of blocks that a relative-pose factor ties together.
pub(super) fn block_pairs(problem: &BundleProblem, layout: &Layout) -> Vec<(usize, usize)> {
    let block = |pose: usize| layout.pose_block[pose];
    problem
        .relative_poses
        .iter()
        .map(|f| (block(f.i), block(f.j)))
        .filter(|&(i, j)| i != NO_BLOCK && j != NO_BLOCK)
        .map(|(i, j)| (i as usize, j as usize))
        .collect()
}

/// Whether there is any.
pub(super) fn has_any(problem: &BundleProblem) -> bool {
    !(problem.relative_poses.is_empty()
        && problem.pose_priors.is_empty()
        && problem.position_priors.is_empty())
}

/// ½ Σ ρ over all pose factors.
pub(super) fn cost(problem: &BundleProblem) -> f64 {
    let poses = &problem.poses;
    let mut sum = 0.0;
    for factor in &problem.relative_poses {
        let residual = factor.residual(&poses[factor.i], &poses[factor.j]);
        let s = factor.information.squared_norm(&residual);
        sum += factor.loss.unwrap_or(problem.relative_pose_loss).evaluate(s).rho;
    }
    for factor in &problem.pose_priors {
        sum += factor.loss.evaluate(factor.chi2(&poses[factor.pose])).rho;
    }
    for factor in &problem.position_priors {
        sum += factor.loss.evaluate(factor.chi2(&poses[factor.pose])).rho;
    }
    0.5 * sum
}

/// A matrix for H of all pose factors: its diagonal and the blocks that `pairs` names.
pub(super) fn hessian(layout: &Layout, pairs: Vec<(usize, usize)>) -> BlockMatrix {
    BlockMatrix::new(Arc::new(BlockPattern::new(layout.block_sizes.clone(), pairs)))
}

/// H of all pose factors, set, and their gradient, added; `stiffness` as in [`super::observe::Inputs`].
pub(super) fn linearize(
    problem: &BundleProblem,
    layout: &Layout,
    hessian: &mut BlockMatrix,
    gradient: &mut [f64],
    stiffness: f64,
) {
    hessian.set_zero();
    let mut sink = Sink { layout, hessian, gradient, stiffness };
    for factor in &problem.relative_poses {
        sink.relative_pose(problem, factor);
    }
    for factor in &problem.pose_priors {
        let (residual, d_pose) = factor.linearize(&problem.poses[factor.pose]);
        sink.prior(factor.pose, (&factor.information, factor.loss), &residual, &d_pose);
    }
    for factor in &problem.position_priors {
        let (residual, d_pose) = factor.linearize(&problem.poses[factor.pose]);
        sink.prior(factor.pose, (&factor.information, factor.loss), &residual, &d_pose);
    }
}

struct Sink<'a> {
    layout: &'a Layout,
    hessian: &'a mut BlockMatrix,
    gradient: &'a mut [f64],
    stiffness: f64,
}

impl Sink<'_> {
    fn relative_pose(&mut self, problem: &BundleProblem, factor: &RelativePose<Se3, 6>) {
        let lin = factor.linearize(&problem.poses[factor.i], &problem.poses[factor.j]);
        let s = factor.information.squared_norm(&lin.residual);
        let loss = factor.loss.unwrap_or(problem.relative_pose_loss).evaluate(s);
        let omega = factor.information.matrix() * loss.weight;
        let (i, j) = (self.layout.pose_block[factor.i], self.layout.pose_block[factor.j]);
        let (left_i, left_j) = (lin.d_i.transpose() * omega, lin.d_j.transpose() * omega);
        let (g_i, g_j) = (left_i * lin.residual, left_j * lin.residual);
        self.add_gradient(i, &g_i);
        self.add_gradient(j, &g_j);
        // A factor's curvature is w JᵀΩJ − k g gᵀ.
        let k = loss.flattening(s, self.stiffness);
        let less = |mut block: SMatrix<f64, 6, 6>, a: &SVector<f64, 6>, b: &SVector<f64, 6>| {
            if k > 0.0 {
                block.ger(-k, a, b, 1.0);
            }
            block
        };
        self.add_block(i, i, &less(left_i * lin.d_i, &g_i, &g_i));
        self.add_block(j, j, &less(left_j * lin.d_j, &g_j, &g_j));
        if i == j {
            let cross = less(left_i * lin.d_j, &g_i, &g_j);
            self.add_block(i, i, &(cross + cross.transpose()));
        } else if i > j {
            self.add_block(i, j, &less(left_i * lin.d_j, &g_i, &g_j));
        } else {
            self.add_block(j, i, &less(left_j * lin.d_i, &g_j, &g_i));
        }
    }

    fn prior<const R: usize>(
        &mut self,
        pose: usize,
        (information, loss): (&Information<R>, Loss),
        residual: &SVector<f64, R>,
        d_pose: &SMatrix<f64, R, 6>,
    ) {
        let block = self.layout.pose_block[pose];
        let s = information.squared_norm(residual);
        let loss = loss.evaluate(s);
        let left = d_pose.transpose() * information.matrix() * loss.weight;
        let gradient = left * residual;
        let less = gradient * (loss.flattening(s, self.stiffness) * gradient.transpose());
        self.add_gradient(block, &gradient);
        self.add_block(block, block, &(left * d_pose - less));
    }

    fn add_gradient(&mut self, block: u32, values: &SVector<f64, 6>) {
        if block == NO_BLOCK {
            return;
        }
        let offset = self.hessian.pattern().offset(block as usize);
        for (entry, value) in self.gradient[offset..offset + 6].iter_mut().zip(values.iter()) {
            *entry += value;
        }
    }

    fn add_block(&mut self, row: u32, column: u32, values: &SMatrix<f64, 6, 6>) {
        if row == NO_BLOCK || column == NO_BLOCK {
            return;
        }
        let stride = self.layout.block_sizes[row as usize];
        if let Some(block) = self.hessian.block_mut(row as usize, column as usize) {
            for c in 0..6 {
                for r in 0..6 {
                    block[c * stride + r] += values[(r, c)];
                }
            }
        }
    }
}
