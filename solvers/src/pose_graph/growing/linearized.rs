//! The terms of a growing graph's linear system: made where poses stood, made anew where they went.
//!
//! The bound on the error of a prediction is an inequality for each edge, from the poses where it was
//! linearized and where they are: cheap beside an elimination. Nothing is eliminated here: see
//! `linear`.

use std::f64::consts::PI;

use nalgebra::{SVector, Vector3};

use super::{Block, EdgeError, GrowingPoseGraph, Motion, Term};
use crate::factors::RelativePose;
use crate::geometry::RigidMotion;
use crate::linear::Updated;
use crate::loss::Loss;
use crate::pose_graph::assembly::pair_term;

/// Poses are linearized anew once the linear prediction of some residual may be off by this share of
/// the root mean square of all residuals; then, to be done with it, all whose prediction may be off
/// by the share [`ON_THE_WAY`] of that. The bound is loose: the cost stays within 1.01 of the optimum.
const NONLINEARITY: f64 = 0.2;
const ON_THE_WAY: f64 = 0.1;

/// Changes are not handed on where they count less than this share of it, counted in standard
/// deviations of a pose were all others fixed.
const CHANGE: f64 = 0.07;

/// Where the elimination took so many flops for each number of the factor, it took longer than a whole
/// back substitution, and small changes are handed on too.
const FLOPS_AN_ENTRY: f64 = 20.0;
const FINE_CHANGE: f64 = 0.017;

/// The edges of a pose are checked again once it changed by so many of it.
const RECHECK: f64 = 1.0;

/// Residuals of a ten-thousandth of their standard deviation are as good as zero.
const LEAST_RESIDUAL: f64 = 1e-4;

impl<G: RigidMotion<D, N>, const D: usize, const N: usize> GrowingPoseGraph<G, D, N> {
    /// The edge as a term of the linear system.
    pub(super) fn push_term(&mut self, number: usize) {
        let edge = self.graph.edges[number];
        let term = pair_term(&edge, self.linearized(&edge), Loss::Trivial);
        let (i, j) = (self.block_of(edge.i), self.block_of(edge.j));
        self.system.push_term(i, j, term);
        let omega = edge.information.matrix().diagonal();
        let stiffness = [omega.rows_range(..D).sum().sqrt(), omega.rows_range(D..).sum().sqrt()];
        let ends = [i, j].map(|block| block.map(|block| block as u32));
        let error = error(&edge, self.linearized(&edge));
        self.terms.push(Term { edge: number, ends, stiffness, error, checked_in: 0 });
    }

    /// Where the ends of an edge are linearized.
    fn linearized(&self, edge: &RelativePose<G, N>) -> (&G, &G) {
        let at = |pose: usize| match self.block_of(pose) {
            Some(block) => &self.blocks[block].world_from_pose,
            None => &self.graph.poses[pose],
        };
        (at(edge.i), at(edge.j))
    }

    /// One solve: poses that changed are moved. Where an edge left the range of its linearization,
    /// the blocks of all edges that are on their way out are returned, and the limit of the range.
    pub(super) fn step(&mut self, updated: &Updated) -> (Vec<usize>, f64) {
        let scalars = (N * self.system.term_count()) as f64;
        let mean_square = 2.0 * self.system.predicted_cost() / scalars;
        let residual = mean_square.max(LEAST_RESIDUAL * LEAST_RESIDUAL).sqrt();
        let is_cheap = updated.flops > FLOPS_AN_ENTRY * self.system.factor_entries() as f64;
        let change = if is_cheap { FINE_CHANGE } else { CHANGE };
        let far = self.move_poses(change * residual, RECHECK * residual);
        let limit = NONLINEARITY * residual;
        (self.left_range(&far, limit), limit)
    }

    /// Solves and moves the poses whose change counts more than `change`; the blocks that by now
    /// moved more than `recheck` since their edges were checked.
    fn move_poses(&mut self, change: f64, recheck: f64) -> Vec<usize> {
        // A copy: the list is the solver's own, and the solver is asked for each block.
        let changed = self.system.solve(change).to_vec();
        let mut far = Vec::new();
        for block in changed.into_iter().map(|block| block as usize) {
            let delta = self.system.delta(block);
            let Block { pose, world_from_pose, .. } = self.blocks[block];
            // Translation first: then it is as linear as the prediction.
            let (mut shift, mut turn) = (delta, delta);
            shift.rows_range_mut(D..).fill(0.0);
            turn.rows_range_mut(..D).fill(0.0);
            let moved = world_from_pose.plus(&shift).plus(&turn);
            self.graph.poses[pose] = moved;
            let position = moved.translation();
            let shift = position - world_from_pose.translation();
            let (turn, spin) = (turn.norm(), spin(&world_from_pose, &delta));
            self.motions[block] = Motion { position, shift, turn, spin };
            if self.system.counts(block, &(delta - self.checked[block])) > recheck {
                self.checked[block] = delta;
                far.push(block);
            }
        }
        far
    }

    /// Checks the edges of `far` blocks. If one may be off by more than `limit`, the blocks of all that
    /// may be off by a share of it.
    fn left_range(&mut self, far: &[usize], limit: f64) -> Vec<usize> {
        let mut left = Vec::new();
        let mut exceeds = false;
        self.checks += 1;
        for &block in far {
            for &term in self.system.terms_of(block) {
                let term = term as usize;
                if self.terms[term].checked_in == self.checks {
                    continue;
                }
                self.terms[term].checked_in = self.checks;
                let error = self.nonlinearity(term);
                exceeds |= error > limit || !error.is_finite();
                if error > ON_THE_WAY * limit || !error.is_finite() {
                    let ends = self.terms[term].ends.into_iter().flatten();
                    left.extend(ends.map(|block| block as usize));
                }
            }
        }
        if !exceeds {
            left.clear();
        }
        left.sort_unstable();
        left.dedup();
        left
    }

    /// At most how far a term's residual is from its linear prediction, in standard deviations.
    ///
    /// With d = t_j − t_i and φ the turn of pose i, Exp(−φ) d is predicted by d̄ + (d − d̄) − φ × d̄:
    /// off by at most ½ |φ|² |d| + |φ| |d − d̄|. The translation of the residual is V⁻¹(θ) e with the
    /// error e of that vector and the angle θ of the residual. Its prediction leaves out the product of
    /// both changes, at most ½ |Δθ| |Δe|, and the curvature of V⁻¹, at most ¼ |Δθ|² |e| within half a
    /// turn. Δθ is what the poses turned against each other: a piece that turns as a whole has none.
    /// Rotations in the plane are linear; in space their second-order term is at most half the product
    /// of the turns.
    fn nonlinearity(&self, term: usize) -> f64 {
        let Term { ends, stiffness, error, .. } = self.terms[term];
        let held = Motion::none(&self.graph.poses[0]);
        let at = |end: Option<u32>| end.map_or(&held, |block| &self.motions[block as usize]);
        let (i, j) = (at(ends[0]), at(ends[1]));
        let (between, change) = (j.position - i.position, j.shift - i.shift);
        let shift = 0.5 * i.turn * i.turn * between.norm() + i.turn * change.norm();
        let apart = (j.spin - i.spin).norm();
        let carried = (change - crossed(&i.spin, &(between - change))).norm() + shift;
        let coupled = 0.5 * apart * carried + 0.25 * apart * apart * error.distance;
        // Beyond half a turn the logarithm jumps by a whole one.
        if error.angle + apart > PI {
            return f64::INFINITY;
        }
        let turn = i.turn.max(j.turn);
        let rotation = if D > 2 { 0.5 * turn * turn } else { 0.0 };
        stiffness[0] * (shift + coupled) + stiffness[1] * rotation
    }

    /// Linearizes blocks anew where their poses stand now, and those at the other ends of edges that
    /// this would tear apart: what moved together is linearized together.
    pub(super) fn relinearize(&mut self, blocks: &mut Vec<usize>, limit: f64) {
        self.checks += 1;
        for &block in blocks.iter() {
            self.blocks[block].checked_in = self.checks;
        }
        let mut terms: Vec<u32> = Vec::new();
        let mut next = 0;
        while let Some(&block) = blocks.get(next) {
            next += 1;
            let pose = self.blocks[block].pose;
            self.blocks[block].world_from_pose = self.graph.poses[pose];
            self.motions[block] = Motion::none(&self.graph.poses[pose]);
            self.checked[block] = SVector::zeros();
            self.system.rebase(block);
            for k in 0..self.system.terms_of(block).len() {
                let term = self.system.terms_of(block)[k];
                terms.push(term);
                let [i, j] = self.terms[term as usize].ends.map(|end| end.map(|end| end as usize));
                let Some(other) = (if i == Some(block) { j } else { i }) else { continue };
                if self.blocks[other].checked_in != self.checks
                    && self.nonlinearity(term as usize) > limit
                {
                    self.blocks[other].checked_in = self.checks;
                    blocks.push(other);
                }
            }
        }
        terms.sort_unstable();
        terms.dedup();
        for term in terms {
            let edge = self.graph.edges[self.terms[term as usize].edge];
            let ends = self.linearized(&edge);
            let (made, error) = (pair_term(&edge, ends, Loss::Trivial), error(&edge, ends));
            self.terms[term as usize].error = error;
            self.system.set_term(term as usize, made);
        }
    }
}

impl<const D: usize> Motion<D> {
    /// That of a block at its linearization.
    pub(super) fn none<G: RigidMotion<D, N>, const N: usize>(world_from_pose: &G) -> Self {
        let position = world_from_pose.translation();
        Self { position, shift: SVector::zeros(), turn: 0.0, spin: Vector3::zeros() }
    }
}

/// How far an edge is off between two poses.
fn error<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    edge: &RelativePose<G, N>,
    (world_from_i, world_from_j): (&G, &G),
) -> EdgeError {
    let i_from_j = world_from_i.inverse().compose(world_from_j);
    let error = edge.i_from_j.inverse().compose(&i_from_j);
    EdgeError { distance: error.translation().norm(), angle: error.log().rows_range(D..).norm() }
}

/// The turn of `delta` in the world, about the axis z in the plane.
fn spin<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    world_from_pose: &G,
    delta: &SVector<f64, N>,
) -> Vector3<f64> {
    if D == 2 {
        return Vector3::new(0.0, 0.0, delta[D]);
    }
    let rotation = world_from_pose.rotation_matrix();
    Vector3::from_fn(|row, _| (0..D).map(|k| rotation[(row, k)] * delta[D + k]).sum())
}

/// spin × d.
fn crossed<const D: usize>(spin: &Vector3<f64>, d: &SVector<f64, D>) -> SVector<f64, D> {
    let whole = spin.cross(&Vector3::from_fn(|row, _| if row < D { d[row] } else { 0.0 }));
    SVector::from_fn(|row, _| whole[row])
}
