//! A growing graph beside the batch solver.
//!
//! Where the steps of an update do not settle, or went far, the damped solver runs over all blocks from
//! two starts: where the blocks stand, and the chordal start. The lower cost is taken. Poses that
//! one edge ties are not part of it.

use super::{GrowingPoseGraph, PoseState};
use crate::factors::{RelativePose, cost};
use crate::geometry::RigidMotion;
use crate::initialization::chordal;
use crate::interrupt::Interrupt;
use crate::loss::Loss;
use crate::optimizer::ignore_iterations;
use crate::pose_graph::{Options, solve};
use crate::price::Limits;
use crate::problem::{PoseGraph, SolveError};

/// A settled estimate is left only for a cost that is lower by more than this share: everything is
/// eliminated anew then.
const LEAST_GAIN: f64 = 1e-3;

impl<G: RigidMotion<D, N>, const D: usize, const N: usize> GrowingPoseGraph<G, D, N> {
    /// Moves the blocks to the lower of two optima: that from where they stand, and that from the chordal
    /// start. `is_settled` is whether the steps of the update ended, so that they may stay.
    pub(super) fn solve_batch(&mut self, is_settled: bool) -> Result<(), SolveError> {
        let (graph, number) = self.blocks_alone();
        let mut own = graph.clone();
        let mut best = optimum(&mut own).map(|cost| (cost, own.poses));
        let mut other = graph;
        let before = match is_settled {
            true => cost(&other.edges, &other.poses, Loss::Trivial, &Interrupt::NEVER),
            false => f64::INFINITY,
        };
        if chordal(&mut other, Limits::NONE).is_ok()
            && let Ok(cost) = optimum(&mut other)
            && !best.as_ref().is_ok_and(|(least, _)| *least <= cost)
        {
            best = Ok((cost, other.poses));
        }
        let (cost, poses) = match best {
            Err(_) if is_settled => return Ok(()),
            best => best?,
        };
        if cost >= (1.0 - LEAST_GAIN) * before {
            return Ok(());
        }
        for block in &self.blocks {
            self.graph.poses[block.pose] = poses[number[block.pose]];
        }
        let mut all: Vec<usize> = (0..self.blocks.len()).collect();
        self.relinearize(&mut all, f64::INFINITY);
        Ok(())
    }

    /// The graph of the held pose and the blocks, and the index there of each pose.
    fn blocks_alone(&self) -> (PoseGraph<G, N>, Vec<usize>) {
        let mut graph = PoseGraph::<G, N>::new();
        let mut number = vec![usize::MAX; self.states.len()];
        for (pose, state) in self.states.iter().enumerate() {
            if matches!(state, PoseState::Held | PoseState::Block(_)) {
                number[pose] = graph.push_pose(self.graph.ids[pose], self.graph.poses[pose]);
                graph.constant[number[pose]] = *state == PoseState::Held;
            }
        }
        let edges = self.terms.iter().map(|term| self.graph.edges[term.edge]);
        graph.edges = edges
            .map(|edge| RelativePose { i: number[edge.i], j: number[edge.j], ..edge })
            .collect();
        (graph, number)
    }
}

/// Solves; returns the cost.
fn optimum<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
) -> Result<f64, SolveError> {
    let summary = solve(graph, &Options::default(), &mut ignore_iterations)?;
    Ok(summary.final_cost)
}
