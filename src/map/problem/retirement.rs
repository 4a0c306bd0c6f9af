//! The problem whose marginal is the information of a keyframe, which is to be removed, on its
//! neighbors.
//!
//! The problem holds the keyframe first, then those that share most landmarks with it and those that a
//! constraint ties to it, and every landmark that it sees. Nothing is held constant: the result is
//! information, not a solution.

use std::cmp::Reverse;
use std::collections::BTreeSet;

use super::MapProblem;
use super::bundle::Builder;
use crate::map::{EntityId, Map};

/// Most neighbors by shared landmarks. The keyframe has little information on the others.
const NEIGHBORS: usize = 20;

/// The problem around `keyframe`, which is pose 0.
#[must_use]
pub fn retirement_problem(map: &Map, keyframe: EntityId) -> MapProblem {
    let mut near: Vec<(EntityId, u32)> = map.covisibility().neighbors(keyframe).collect();
    near.sort_by_key(|&(id, shared)| (Reverse(shared), id));
    near.truncate(NEIGHBORS);
    let tied = map.ties().of(keyframe).filter_map(|id| {
        let constraint = map.active_constraint(id)?;
        let is_i = constraint.keyframe_i == keyframe;
        Some(if is_i { constraint.keyframe_j } else { constraint.keyframe_i })
    });
    let neighbors: BTreeSet<EntityId> = near.into_iter().map(|(id, _)| id).chain(tied).collect();
    let mut builder = Builder::new(map, map.policy().observation_loss);
    builder.keyframe(keyframe, false);
    neighbors.into_iter().for_each(|id| builder.keyframe(id, false));
    let seen = map.keyframes().get(&keyframe).map(|k| &*k.observations).unwrap_or_default();
    let seen: BTreeSet<EntityId> = seen.iter().map(|o| o.landmark).collect();
    seen.into_iter().for_each(|id| builder.landmark(id));
    let mut problem = builder.finish(true);
    problem.problem.constant_poses.fill(false);
    problem
}
