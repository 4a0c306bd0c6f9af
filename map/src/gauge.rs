//! Which keyframes the gauge of a map holds. Whatever moves poses asks here.
//!
//! Where no prior places a piece of the map in the world, measurements leave its frame open: all its
//! poses may move together. The first keyframe of the piece then stays where it is, to the bit. The
//! first is the one that arrived first, whatever its capture time; of keyframes that came with one
//! event, as in a merge, the one with the lowest id. When it leaves the map, the next one is held where
//! it is at that moment.
//!
//! A piece is what landmarks, constraints and odometry tie together. Odometry ties all keyframes of a
//! client, so that a piece is a set of clients. Closures and priors that are switched off count here:
//! what is held does not depend on verdicts. A problem may be in more pieces than the map, because it
//! leaves out some of these ties; [`held_poses`] holds the oldest keyframe of each.

use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::problem::DisjointSets;
use nalgebra::Vector3;

use super::{AppliedSolve, ClientIndex, EntityId, Gauge, Keyframe, Map, MapError, SolveKind};

impl Gauge {
    /// Whether it holds the first keyframe of a piece without priors.
    fn holds_first(self) -> bool {
        match self {
            Self::FirstKeyframeFixed | Self::FixedPoses => true,
            Self::Free | Self::Priors => false,
        }
    }

    /// Whether a prior takes the place of the first keyframe.
    fn yields_to_priors(self) -> bool {
        self != Self::FixedPoses
    }
}

impl Map {
    /// The keyframe that arrived before all others, of those that came with one event the one with the
    /// lowest id.
    pub fn first_keyframe(&self) -> Option<EntityId> {
        self.by_age.keys().next().map(|&(_, id)| id)
    }

    /// The keyframes that `gauge` holds: at most one for each piece of the map, by age.
    pub fn held_keyframes(&self, gauge: Gauge) -> Vec<EntityId> {
        let clients = (0..).zip(self.clients()).map(|(index, _)| ClientIndex(index));
        self.held(gauge, clients.collect(), |_| true)
    }

    /// The keyframes of `keyframes` that `gauge` holds, by age.
    pub fn held_among(&self, gauge: Gauge, keyframes: &BTreeSet<EntityId>) -> Vec<EntityId> {
        let clients = keyframes.iter().map(|id| id.client).collect();
        self.held(gauge, clients, |id| keyframes.contains(id))
    }

    fn held(
        &self,
        gauge: Gauge,
        mut clients: BTreeSet<ClientIndex>,
        is_asked: impl Fn(&EntityId) -> bool,
    ) -> Vec<EntityId> {
        let mut held = Vec::new();
        if !gauge.holds_first() {
            return held;
        }
        // The first keyframe of a piece is the oldest one of its client.
        for &(_, id) in self.by_age.keys() {
            if clients.is_empty() {
                break;
            }
            if clients.remove(&id.client) && is_asked(&id) && self.is_held(gauge, id) {
                held.push(id);
            }
        }
        held
    }

    /// Whether the oldest keyframe of a client is the first of its piece, and no prior takes its place.
    fn is_held(&self, gauge: Gauge, oldest: EntityId) -> bool {
        let has_priors = gauge.yields_to_priors() && !self.priors().is_empty();
        if self.first_keyframe() == Some(oldest) && !has_priors {
            return true;
        }
        let age = |id: EntityId, keyframe: &Keyframe| (keyframe.added_revision, id);
        let Some(first) = self.keyframes().get(&oldest).map(|known| age(oldest, known)) else {
            return false;
        };
        let mut is_held = true;
        self.visit_piece(oldest.client, |id, keyframe| {
            let is_prior = |tie| self.priors().contains_key(&tie);
            let is_placed = has_priors && self.ties().of(id).any(is_prior);
            is_held = age(id, keyframe) >= first && !is_placed;
            is_held
        });
        is_held
    }

    /// Visits the keyframes of a client and of those that belong to the same piece, until `visit`
    /// answers `false`. Returns the clients that were found.
    fn visit_piece(
        &self,
        client: ClientIndex,
        mut visit: impl FnMut(EntityId, &Keyframe) -> bool,
    ) -> BTreeSet<ClientIndex> {
        let (mut piece, mut next) = (BTreeSet::from([client]), vec![client]);
        while let Some(client) = next.pop() {
            for (&id, keyframe) in self.keyframes().range(client.ids()) {
                if !visit(id, keyframe) {
                    return piece;
                }
                let constraints = self.ties().of(id).filter_map(|id| self.constraints().get(&id));
                let tied = constraints.flat_map(|c| [c.keyframe_i.client, c.keyframe_j.client]);
                let sharing = self.covisibility().neighbors(id).map(|(other, _)| other.client);
                next.extend(sharing.chain(tied).filter(|&other| piece.insert(other)));
            }
        }
        piece
    }

    /// Whether the result of a solve under `gauge` leaves where they are the keyframes that the gauge
    /// holds. [`applied`](super::applied()) makes no other result.
    ///
    /// # Errors
    /// [`MapError::GaugeMoved`] with the keyframe that would move.
    pub fn keeps_gauge(&self, gauge: Gauge, solve: &AppliedSolve) -> Result<(), MapError> {
        let moved: BTreeSet<EntityId> = solve.poses.iter().map(|&(id, _)| id).collect();
        let held = self.held_among(gauge, &moved);
        let moves = |&&(id, pose): &&(EntityId, Se3)| {
            let known = self.keyframes().get(&id).map(|known| known.world_from_camera);
            held.contains(&id) && known != Some(pose)
        };
        match solve.poses.iter().find(moves) {
            Some(&(keyframe, _)) => Err(MapError::GaugeMoved { keyframe }),
            None => Ok(()),
        }
    }
}

/// Takes out of the result of a solve what `gauge` holds in the map as it is now.
///
/// A solve holds the keyframe that was the first when it began. Another one may be the first when it
/// ends, because the former left the map; and a reconstruction, which looks at no estimate, holds none.
/// The result of a solve of the whole map is then moved rigidly, piece by piece, so that the keyframe
/// that is held stays. In a window, whose surroundings are held, that keyframe alone keeps its pose: the
/// next window that sees it brings the others to it.
pub(super) fn keep_gauge(
    map: &Map,
    gauge: Gauge,
    kind: SolveKind,
    poses: &mut BTreeMap<EntityId, Se3>,
    landmarks: &mut [(EntityId, Vector3<f64>)],
) {
    let moved: BTreeSet<EntityId> = poses.keys().copied().collect();
    for held in map.held_among(gauge, &moved) {
        let (Some(result), Some(known)) = (poses.remove(&held), map.keyframes().get(&held)) else {
            continue;
        };
        if kind == SolveKind::LocalBundle || result == known.world_from_camera {
            continue;
        }
        let motion = known.world_from_camera.compose(&result.inverse());
        let piece = map.visit_piece(held.client, |_, _| true);
        let own = poses.iter_mut().filter(|(id, _)| piece.contains(&id.client));
        own.for_each(|(_, pose)| *pose = motion.compose(pose));
        for (id, position) in landmarks.iter_mut() {
            let reference = map.landmarks().get(id).and_then(|landmark| landmark.reference);
            if reference.is_some_and(|reference| piece.contains(&reference.client)) {
                *position = motion.transform(position);
            }
        }
    }
}

/// The poses that hold the frame of a problem of the whole map, by index: what `gauge` holds in the map,
/// and the oldest keyframe of every other piece of the problem that no prior places.
///
/// `keyframes` are those of the poses, sorted; `pieces` are of poses that factors of the problem tie
/// together, and `placed` are the poses with priors.
pub(super) fn held_poses(
    map: &Map,
    gauge: Gauge,
    keyframes: &[EntityId],
    mut pieces: DisjointSets,
    placed: impl Iterator<Item = usize>,
) -> Vec<usize> {
    let mut is_settled = vec![false; keyframes.len()];
    if gauge.yields_to_priors() {
        placed.for_each(|pose| is_settled[pieces.root(pose)] = true);
    }
    let held = map.held_keyframes(gauge).into_iter();
    let mut held: Vec<usize> = held.filter_map(|id| keyframes.binary_search(&id).ok()).collect();
    held.iter().for_each(|&pose| is_settled[pieces.root(pose)] = true);
    let mut oldest: BTreeMap<usize, (i64, usize)> = BTreeMap::new();
    for (pose, id) in keyframes.iter().enumerate() {
        let root = pieces.root(pose);
        let Some(known) = map.keyframes().get(id).filter(|_| !is_settled[root]) else { continue };
        let age = (known.added_revision, pose);
        oldest.entry(root).and_modify(|first| *first = age.min(*first)).or_insert(age);
    }
    held.extend(oldest.into_values().map(|(_, pose)| pose));
    held
}
