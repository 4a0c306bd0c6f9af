//! The constraints and priors of each keyframe.
//!
//! An index that the fold keeps, so that the cost of a window or of a removed keyframe depends on its
//! own constraints, not on those of the whole map. Constraints and priors share one id space; those
//! that are switched off are included.

use super::{Constraint, EntityId, Map, Prior, SharedMap};

/// Constraints and priors by keyframe.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ties(SharedMap<(EntityId, EntityId), ()>);

impl Ties {
    /// Those of a whole map.
    pub(super) fn new(
        constraints: &SharedMap<EntityId, Constraint>,
        priors: &SharedMap<EntityId, Prior>,
    ) -> Self {
        let of_constraints = constraints.iter().flat_map(|(&id, constraint)| {
            [constraint.keyframe_i, constraint.keyframe_j].map(|keyframe| (keyframe, id))
        });
        let of_priors = priors.iter().map(|(&id, prior)| (prior.keyframe(), id));
        let mut ties: Vec<_> = of_constraints.chain(of_priors).collect();
        ties.sort_unstable();
        Self(ties.into_iter().map(|tie| (tie, ())).collect())
    }

    /// The ids of the constraints and priors of a keyframe, rising.
    pub fn of(&self, keyframe: EntityId) -> impl Iterator<Item = EntityId> + '_ {
        let all = (keyframe, EntityId::MIN)..=(keyframe, EntityId::MAX);
        self.0.range(all).map(|(&(_, id), ())| id)
    }

    pub(super) fn add(&mut self, keyframe: EntityId, id: EntityId) {
        self.0.insert((keyframe, id), ());
    }

    pub(super) fn remove(&mut self, keyframe: EntityId, id: EntityId) {
        self.0.remove(&(keyframe, id));
    }
}

impl Map {
    /// The keyframes that constraints which count join with one.
    pub(super) fn tied(&self, keyframe: EntityId) -> impl Iterator<Item = EntityId> + '_ {
        let constraints = self.ties.of(keyframe).filter_map(|id| self.active_constraint(id));
        constraints.map(move |constraint| {
            let is_i = constraint.keyframe_i == keyframe;
            if is_i { constraint.keyframe_j } else { constraint.keyframe_i }
        })
    }
}
