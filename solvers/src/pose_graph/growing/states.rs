//! Which poses of a growing graph are in its linear system.
//!
//! A new pose waits until an edge ties it to the others. With one edge it is a pendant pose: the edge
//! tells where it is, and it is not in the linear system. It enters the system, with the pendant poses between,
//! once a second edge ties it. A pendant pose costs nothing and is exact: the residual of its edge is
//! zero. It places new poses on their edges and linearizes nothing.

use nalgebra::SVector;

use super::{Block, GrowingPoseGraph, Motion, PoseState};
use crate::geometry::RigidMotion;

/// Neighbors in time of the poses that new edges touch, to each side: the next edges will touch them.
const SOON: usize = 3;

impl<G: RigidMotion<D, N>, const D: usize, const N: usize> GrowingPoseGraph<G, D, N> {
    /// Finds a place for what fresh edges tie; the blocks that got new terms and their neighbors in
    /// time.
    pub(super) fn place(&mut self) -> Vec<usize> {
        let mut queue = std::mem::take(&mut self.fresh);
        // The start of a new pose is best read off its nearest predecessor.
        let distance = |&edge: &usize| {
            let edge = &self.graph.edges[edge];
            self.graph.ids[edge.i].abs_diff(self.graph.ids[edge.j])
        };
        queue.sort_by_key(distance);
        let mut touched = Vec::new();
        let mut next = 0;
        while next < queue.len() {
            let number = queue[next];
            next += 1;
            let (i, j) = (self.graph.edges[number].i, self.graph.edges[number].j);
            match (self.states[i], self.states[j]) {
                (PoseState::Waiting, PoseState::Waiting) => self.is_parked[number] = true,
                (PoseState::Waiting, _) => self.attach(i, number, &mut queue),
                (_, PoseState::Waiting) => self.attach(j, number, &mut queue),
                _ => {
                    self.enter(i);
                    self.enter(j);
                    self.push_term(number);
                    touched.extend([i, j]);
                }
            }
        }
        let blocks = touched.iter().filter_map(|&pose| self.block_of(pose));
        let around = |block: usize| block.saturating_sub(SOON)..=block + SOON;
        let mut around: Vec<usize> = blocks.flat_map(around).collect();
        around.sort_unstable();
        around.dedup();
        around.retain(|&block| block < self.blocks.len());
        around
    }

    pub(super) fn block_of(&self, pose: usize) -> Option<usize> {
        match self.states[pose] {
            PoseState::Block(block) => Some(block),
            PoseState::Waiting | PoseState::Held | PoseState::Pendant(_) => None,
        }
    }

    /// Hangs a waiting pose on an edge; its edges that were parked come into the queue.
    fn attach(&mut self, pose: usize, edge: usize, queue: &mut Vec<usize>) {
        self.states[pose] = PoseState::Pendant(edge);
        self.pendant.push(pose);
        self.graph.poses[pose] = self.hung(pose, edge);
        let parked = self.edges_of[pose].iter().copied();
        queue.extend(parked.filter(|&edge| std::mem::take(&mut self.is_parked[edge])));
    }

    /// Where an edge says that a pose stands.
    fn hung(&self, pose: usize, edge: usize) -> G {
        let edge = &self.graph.edges[edge];
        if pose == edge.j {
            self.graph.poses[edge.i].compose(&edge.i_from_j)
        } else {
            self.graph.poses[edge.j].compose(&edge.i_from_j.inverse())
        }
    }

    /// Makes a pendant pose a block, with the pendant poses between it and the system.
    fn enter(&mut self, pose: usize) {
        let mut chain = Vec::new();
        let mut at = pose;
        while let PoseState::Pendant(edge) = self.states[at] {
            chain.push((at, edge));
            let edge = &self.graph.edges[edge];
            at = if edge.i == at { edge.j } else { edge.i };
        }
        if chain.is_empty() {
            return;
        }
        for &(pose, edge) in chain.iter().rev() {
            let block = self.system.push_block();
            self.states[pose] = PoseState::Block(block);
            let world_from_pose = self.graph.poses[pose];
            self.blocks.push(Block { pose, world_from_pose, checked_in: 0 });
            self.motions.push(Motion::none(&world_from_pose));
            self.checked.push(SVector::zeros());
            self.push_term(edge);
        }
        self.pendant.retain(|&pose| matches!(self.states[pose], PoseState::Pendant(_)));
    }

    /// Moves the pendant poses along with the poses that their edges tie them to.
    pub(super) fn carry_pendant(&mut self) {
        for k in 0..self.pendant.len() {
            let pose = self.pendant[k];
            if let PoseState::Pendant(edge) = self.states[pose] {
                self.graph.poses[pose] = self.hung(pose, edge);
            }
        }
    }
}
