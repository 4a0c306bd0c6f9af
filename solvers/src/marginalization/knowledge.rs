//! Δ: what the factors of the removed pose say of the others, and nothing else says.
//!
//! A landmark is eliminated by projection (`views`): S = Jᵀ(I − QQᵀ)J, with Q a basis of the columns
//! of its Jacobian. The terms JᵀJ of the poses that stay are the same with and without the removed
//! one; they cancel and are not formed, except on the diagonal that gives the scale. It recovers no
//! factors: see `recovery`.

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, SVector};

use super::blocks::{BLOCK, marginal, symmetrize};
use super::views::{WhitenedObservation, orthonormalize, tracks, views};
use crate::problem::{BundleProblem, SolveError};

/// No diagonal entry that scales the matrix is below this share of the largest in its unit.
const LEAST_SCALE: f64 = 1e-9;

/// Who a block of Δ belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Node {
    /// The world, as it is tied to the removed pose by priors: its frame is that pose, held.
    World,
    /// A pose that stays, by its index.
    Pose(usize),
}

/// Δ over the nodes that the removed pose is tied to.
pub(super) struct Knowledge {
    /// The world, where there is a prior; then poses, by rising index.
    pub(super) nodes: Vec<Node>,
    /// s: √ of the diagonal that the nodes had before anything was eliminated, raised where tiny.
    pub(super) scale: DVector<f64>,
    /// Δ_ab / (s_a s_b), a block of 6 rows for each node.
    pub(super) scaled: DMatrix<f64>,
}

impl Knowledge {
    pub(super) fn of(problem: &BundleProblem, removed: usize) -> Result<Self, SolveError> {
        let views = views(problem, removed);
        let tracks = tracks(&views, removed);
        let has_prior = problem.pose_priors.iter().any(|p| p.pose == removed)
            || problem.position_priors.iter().any(|p| p.pose == removed);
        let mut tied = vec![false; problem.poses.len()];
        tracks.iter().copied().flatten().for_each(|view| tied[view.pose] = true);
        for factor in problem.relative_poses.iter().filter(|f| f.i == removed || f.j == removed) {
            tied[factor.i] = true;
            tied[factor.j] = true;
        }
        tied[removed] = false;
        let mut nodes = if has_prior { vec![Node::World] } else { Vec::new() };
        nodes.extend((0..tied.len()).filter(|&pose| tied[pose]).map(Node::Pose));
        let mut sums = Sums::new(problem.poses.len(), &nodes, removed);
        for track in tracks {
            sums.add_landmark(track, removed);
        }
        sums.add_relative_poses(problem, removed);
        sums.add_priors(problem, removed);
        let (hessian, scale) = sums.scaled();
        if !hessian.iter().chain(scale.iter()).all(|x| x.is_finite()) {
            return Err(SolveError::NotFinite {
                what: "information of pose",
                index: removed as i64,
            });
        }
        let kept: Vec<usize> = (0..nodes.len()).collect();
        let scaled = marginal(&hessian, &kept);
        let scale = scale.rows(0, BLOCK * nodes.len()).into_owned();
        Ok(Self { nodes, scale, scaled })
    }
}

/// Sums over factors: a block for each node and one for the removed pose, which is the last.
struct Sums {
    /// The block of each pose.
    slots: Vec<usize>,
    /// Δ before the removed pose is eliminated; blocks on and below the diagonal.
    hessian: DMatrix<f64>,
    /// The diagonal of JᵀΩJ over all factors.
    diagonal: DVector<f64>,
    /// Uᵀ of each view of a track, U = JᵀQ.
    projected: Vec<SMatrix<f64, 3, 6>>,
    basis: Vec<Matrix3<f64>>,
}

impl Sums {
    fn new(poses: usize, nodes: &[Node], removed: usize) -> Self {
        let mut slots = vec![usize::MAX; poses];
        for (slot, node) in nodes.iter().enumerate() {
            if let Node::Pose(pose) = *node {
                slots[pose] = slot;
            }
        }
        slots[removed] = nodes.len();
        let side = BLOCK * (nodes.len() + 1);
        let (hessian, diagonal) = (DMatrix::zeros(side, side), DVector::zeros(side));
        Self { slots, hessian, diagonal, projected: Vec::new(), basis: Vec::new() }
    }

    fn add_block(&mut self, row: usize, column: usize, values: &SMatrix<f64, 6, 6>) {
        let mut block = self.hessian.fixed_view_mut::<BLOCK, BLOCK>(BLOCK * row, BLOCK * column);
        block += values;
    }

    fn add_diagonal(&mut self, slot: usize, values: &SVector<f64, 6>) {
        let mut entries = self.diagonal.fixed_rows_mut::<BLOCK>(BLOCK * slot);
        entries += values;
    }

    /// Adds what a landmark says with the removed pose's views, less what it says without them.
    fn add_landmark(&mut self, track: &[WhitenedObservation], removed: usize) {
        for view in track {
            let information = view.d_pose.transpose() * view.d_pose;
            self.add_diagonal(self.slots[view.pose], &information.diagonal());
            if view.pose == removed {
                self.add_block(self.slots[removed], self.slots[removed], &information);
            }
        }
        self.add_projection(track.iter(), -1.0);
        self.add_projection(track.iter().filter(|view| view.pose != removed), 1.0);
    }

    /// Adds `sign` · JᵀQQᵀJ.
    fn add_projection<'a>(
        &mut self,
        views: impl Iterator<Item = &'a WhitenedObservation> + Clone,
        sign: f64,
    ) {
        self.basis.clear();
        self.basis.extend(views.clone().map(|view| view.d_landmark));
        orthonormalize(&mut self.basis);
        self.projected.clear();
        let turned = views.clone().zip(&self.basis).map(|(view, q)| q.transpose() * view.d_pose);
        self.projected.extend(turned);
        for (a, view_a) in views.clone().enumerate() {
            let left = self.projected[a].transpose() * sign;
            for (b, view_b) in views.clone().enumerate() {
                let (row, column) = (self.slots[view_a.pose], self.slots[view_b.pose]);
                if row >= column {
                    self.add_block(row, column, &(left * self.projected[b]));
                }
            }
        }
    }

    fn add_relative_poses(&mut self, problem: &BundleProblem, removed: usize) {
        for factor in &problem.relative_poses {
            if factor.i == factor.j || (factor.i != removed && factor.j != removed) {
                continue;
            }
            let lin = factor.linearize(&problem.poses[factor.i], &problem.poses[factor.j]);
            let s = factor.information.squared_norm(&lin.residual);
            let weight = factor.loss.unwrap_or(problem.relative_pose_loss).evaluate(s).weight;
            let omega = factor.information.matrix() * weight;
            let (i, j) = (self.slots[factor.i], self.slots[factor.j]);
            self.add_pair([i, j], [&lin.d_i, &lin.d_j], &omega);
        }
    }

    /// A prior is a factor between the removed pose and the world, which moves against it.
    fn add_priors(&mut self, problem: &BundleProblem, removed: usize) {
        let (world, slot, pose) = (0, self.slots[removed], &problem.poses[removed]);
        for prior in problem.pose_priors.iter().filter(|p| p.pose == removed) {
            let (_, d_pose) = prior.linearize(pose);
            let omega = prior.information.matrix() * prior.loss.evaluate(prior.chi2(pose)).weight;
            self.add_pair([world, slot], [&-d_pose, &d_pose], &omega);
        }
        for prior in problem.position_priors.iter().filter(|p| p.pose == removed) {
            let (_, d_pose) = prior.linearize(pose);
            let omega = prior.information.matrix() * prior.loss.evaluate(prior.chi2(pose)).weight;
            self.add_pair([world, slot], [&-d_pose, &d_pose], &omega);
        }
    }

    /// Adds JᵀΩJ of a factor between two blocks.
    fn add_pair<const R: usize>(
        &mut self,
        slots: [usize; 2],
        jacobians: [&SMatrix<f64, R, 6>; 2],
        omega: &SMatrix<f64, R, R>,
    ) {
        for (&row, left) in slots.iter().zip(jacobians) {
            let left = left.transpose() * omega;
            for (&column, right) in slots.iter().zip(jacobians) {
                let values = left * right;
                if row >= column {
                    self.add_block(row, column, &values);
                }
                if row == column {
                    self.add_diagonal(row, &values.diagonal());
                }
            }
        }
    }

    /// The whole matrix scaled, and the scale. Meters and radians have each their least scale.
    fn scaled(self) -> (DMatrix<f64>, DVector<f64>) {
        let largest = |first: usize| {
            let unit = |k: &usize| k % BLOCK / 3 == first;
            (0..self.diagonal.len()).filter(unit).fold(0.0_f64, |m, k| m.max(self.diagonal[k]))
        };
        let largest = [largest(0), largest(1)];
        let scale = DVector::from_fn(self.diagonal.len(), |k, _| {
            let largest = largest[k % BLOCK / 3];
            if largest > 0.0 { self.diagonal[k].max(LEAST_SCALE * largest).sqrt() } else { 1.0 }
        });
        let mut hessian = self.hessian;
        for column in 0..hessian.ncols() {
            for row in 0..hessian.nrows() {
                hessian[(row, column)] = if row / BLOCK >= column / BLOCK {
                    hessian[(row, column)] / scale[row] / scale[column]
                } else {
                    // Not stored; its mirror image is scaled already.
                    hessian[(column, row)]
                };
            }
        }
        symmetrize(&mut hessian);
        (hessian, scale)
    }
}
