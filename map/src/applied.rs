//! From a solved problem back to a change of the map, which may have grown meanwhile.
//!
//! Every solved keyframe that the map still holds gets its new pose. Entities that arrived after the
//! solve began move rigidly with their reference keyframe, T_new = ref_new · ref_now⁻¹ · T_now: a
//! keyframe with the one before it in capture time of the same client (else the one after it, else the
//! one that it shares most landmarks with), a landmark with its first observer. Landmarks that were not
//! in the solve but belong to a keyframe that moved follow it in the same way, as do those that a local
//! solve moved behind a camera or left without parallax (`window`).
//!
//! What a window moved since the solve began goes along with the motion that was found for it
//! (`meanwhile`). Solves of the map's own are applied as far as it matters ([`Reach`]).
//!
//! A keyframe that the gauge holds never moves (`gauge`), also where it became the first one meanwhile.
//!
//! What a client edited meanwhile stays as the client left it: an entity that was removed gets nothing,
//! one that was added again under the same id counts as new, a camera that was replaced keeps its new
//! intrinsics, and a verdict holds for the very closure that was judged.

use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::geometry::{Camera, LieGroup, Se3};
use nalgebra::Vector3;

use super::gauge::keep_gauge;
use super::meanwhile::caught_up;
use super::noticeable::keep_noticeable;
use super::numbers::is_finite;
use super::window::is_well_placed;
use super::{
    AppliedSolve, ClientIndex, ClosureEdge, ConstraintKind, EntityId, Gauge, GraphProblem,
    Keyframe, Landmark, Map, MapProblem, Noise, SolveKind, SwitchedOff,
};

/// A problem whose values a solver has moved.
#[derive(Clone, Copy, Debug)]
pub enum Solved<'a> {
    /// Bundle adjustment.
    Bundle(&'a MapProblem),
    /// Pose-graph optimization.
    Graph(&'a GraphProblem),
}

impl Solved<'_> {
    fn start_revision(&self) -> i64 {
        match self {
            Self::Bundle(p) => p.start_revision,
            Self::Graph(p) => p.start_revision,
        }
    }

    /// The gauge under which its result is applied to `map`: the one that was asked for, else that of the
    /// map's policy.
    pub fn gauge(&self, map: &Map) -> Gauge {
        let asked = match self {
            Self::Bundle(p) => p.gauge,
            Self::Graph(p) => p.gauge,
        };
        asked.unwrap_or(map.policy().gauge)
    }

    /// The poses that were free to move: where each started, and where it was found.
    pub(super) fn poses(&self) -> Vec<(EntityId, Se3, Se3)> {
        let (ids, starts, poses, constant) = match self {
            Self::Bundle(p) => {
                (&p.keyframes, &p.start_poses, &p.problem.poses, &p.problem.constant_poses)
            }
            Self::Graph(p) => (&p.keyframes, &p.start_poses, &p.graph.poses, &p.graph.constant),
        };
        let all = ids.iter().zip(starts).zip(poses).zip(constant);
        let free = all.filter(|&(_, &constant)| !constant);
        free.map(|(((&id, &start), &found), _)| (id, start, found)).collect()
    }

    /// The landmarks that were free to move, each with those that are one with it: where they started, and
    /// where they were found.
    pub(super) fn landmarks(&self) -> Vec<(Vec<EntityId>, Vector3<f64>, Vector3<f64>)> {
        let Self::Bundle(p) = self else { return Vec::new() };
        let (starts, found) = (&p.start_landmarks, &p.problem.landmarks);
        let mut points: Vec<_> = p.landmarks.iter().map(|&id| vec![id]).collect();
        for &(id, at) in &p.duplicates {
            if let Some(point) = points.get_mut(at) {
                point.push(id);
            }
        }
        let all = points.into_iter().zip(starts).zip(found).zip(&p.problem.constant_landmarks);
        let free = all.filter(|&(_, &constant)| !constant);
        free.map(|(((ids, &start), &found), _)| (ids, start, found)).collect()
    }

    /// The intrinsics of cameras that were free and that the map still has as they were.
    fn cameras(&self, map: &Map) -> Vec<(EntityId, Camera)> {
        match self {
            Self::Bundle(p) => {
                let all = p.cameras.iter().zip(&p.start_cameras).zip(&p.problem.cameras);
                let free = all.zip(&p.problem.constant_cameras).filter(|&(_, &constant)| !constant);
                let kept = free.filter(|(((id, start), _), _)| {
                    map.cameras().get(id).is_some_and(|known| known.camera == **start)
                });
                kept.map(|(((&id, _), &camera), _)| (id, camera)).collect()
            }
            Self::Graph(_) => Vec::new(),
        }
    }
}

/// Which closures and position priors a solve switched off and which on again, without those revoked
/// meanwhile.
type Verdicts = (Vec<(EntityId, SwitchedOff)>, Vec<EntityId>);

/// Whether the map still holds the closure that was judged: a client may have revoked it and sent
/// another one under its id.
fn is_held(map: &Map, problem: &GraphProblem, closure: &ClosureEdge) -> bool {
    let (Some(known), Some(edge)) =
        (map.constraints().get(&closure.constraint), problem.graph.edges.get(closure.edge))
    else {
        return false;
    };
    let ends = [edge.i, edge.j].map(|pose| problem.keyframes.get(pose));
    known.kind == ConstraintKind::LoopClosure
        && ends == [Some(&known.keyframe_i), Some(&known.keyframe_j)]
        && known.keyframe_i_from_keyframe_j == edge.i_from_j
}

fn verdicts(map: &Map, solved: Solved<'_>) -> Verdicts {
    let Solved::Graph(problem) = solved else { return Verdicts::default() };
    let (mut off, mut on) = Verdicts::default();
    let held = problem.closures.iter().filter(|closure| is_held(map, problem, closure));
    let closures = held.map(|closure| (closure.constraint, closure.switched_off));
    let known = problem.positions.iter().filter(|of| map.priors().contains_key(&of.prior));
    let positions = known.map(|position| (position.prior, position.switched_off));
    for (id, switched_off) in closures.chain(positions) {
        match switched_off {
            Some(verdict) => off.push((id, verdict)),
            None if map.switched_off().contains_key(&id) => on.push(id),
            None => {}
        }
    }
    (off, on)
}

/// The variance factors of closures that a pose graph found and that differ from the map's.
fn closure_variances(map: &Map, solved: Solved<'_>) -> Vec<(ClientIndex, f64)> {
    let Solved::Graph(problem) = solved else { return Vec::new() };
    let found = problem.factors.iter().map(|(&client, factors)| (client, factors.closures));
    let known = |client| map.client(client).map(|client| client.closure_variance);
    found.filter(|&(client, variance)| known(client) != Some(variance)).collect()
}

/// What a window found of the noise of clients.
fn noise(map: &Map, solved: Solved<'_>) -> Vec<(ClientIndex, Noise)> {
    let Solved::Bundle(problem) = solved else { return Vec::new() };
    let found = problem.noise.iter().filter(|&(client, noise)| {
        problem.start_noise.get(client) != Some(noise) && map.client(*client).is_some()
    });
    found.map(|(&client, &noise)| (client, noise)).collect()
}

/// How much of a result is applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// All of it.
    All,
    /// What measurements could notice (`noticeable`): for solves of the whole map that nobody asked for.
    Noticeable {
        /// Nothing where no closure contradicts the map ([`GraphProblem::contradicts`]).
        if_contradicted: bool,
    },
}

/// The change that a solved problem makes to the map as it is now, as far as `reach` says.
///
/// `covered` names the sequences that the solve covers; `costs` are ½ Σ ρ before and after it.
#[must_use]
pub fn applied(
    map_now: &Map,
    solved: Solved<'_>,
    kind: SolveKind,
    covered: Vec<(ClientIndex, i64)>,
    costs: (f64, f64),
    reach: Reach,
) -> AppliedSolve {
    let (mut poses, mut landmarks) = caught_up(map_now, solved, kind, solved.start_revision());
    keep_gauge(map_now, solved.gauge(map_now), kind, &mut poses, &mut landmarks);
    if let Reach::Noticeable { if_contradicted } = reach {
        let contradicts = || matches!(solved, Solved::Graph(graph) if graph.contradicts(map_now));
        if if_contradicted && !contradicts() {
            poses.clear();
            landmarks.clear();
        }
        keep_noticeable(map_now, &mut poses, &mut landmarks);
    }
    let late = late_poses(map_now, solved, &poses);
    // What waits for a window may have become the first keyframe.
    let ids: BTreeSet<EntityId> = late.iter().map(|&(id, _)| id).collect();
    poses.extend(late);
    for held in map_now.held_among(solved.gauge(map_now), &ids) {
        poses.remove(&held);
    }

    // If a window moved a landmark out of sight, the sent position is better.
    if kind == SolveKind::LocalBundle {
        let pose =
            |id, keyframe: &Keyframe| poses.get(&id).copied().unwrap_or(keyframe.world_from_camera);
        landmarks.retain(|(id, position)| {
            let known = map_now.landmarks().get(id);
            known.is_some_and(|known| is_well_placed(map_now, *id, known, position, pose))
        });
    }
    let followers = followers(map_now, &poses, &landmarks);
    if landmarks.is_empty() {
        landmarks = followers;
    } else {
        landmarks.extend(followers);
        // Two parts that are sorted: this takes one pass.
        landmarks.sort_by_key(|&(id, _)| id);
    }

    let (switched_off, switched_on) = verdicts(map_now, solved);
    let left_frames = match kind {
        // A window moves little.
        SolveKind::LocalBundle => Vec::new(),
        SolveKind::PoseGraph | SolveKind::Global => map_now.left_frames(&poses),
    };
    AppliedSolve {
        kind,
        poses: poses.into_iter().collect(),
        landmarks,
        cameras: solved.cameras(map_now),
        switched_off,
        switched_on,
        closure_variances: closure_variances(map_now, solved),
        noise: noise(map_now, solved),
        left_frames,
        covered,
        initial_cost: costs.0,
        final_cost: costs.1,
        request: None,
    }
}

/// The motion of a keyframe in the world, `new · now⁻¹`; `None` where it stays.
fn motion(now: &Keyframe, new: Option<&Se3>) -> Option<Se3> {
    let new = new.filter(|&&new| new != now.world_from_camera)?;
    Some(new.compose(&now.world_from_camera.inverse()))
}

/// Where a motion takes a landmark; `None` where that overflows, so that a landmark near the largest numbers
/// stays and holds up no other.
fn carried(motion: &Se3, position: &Vector3<f64>) -> Option<Vector3<f64>> {
    let moved = motion.transform(position);
    is_finite(&moved).then_some(moved)
}

/// New poses of the keyframes that arrived after the solve began, and of those that wait for another one.
fn late_poses(
    map: &Map,
    solved: Solved<'_>,
    poses: &BTreeMap<EntityId, Se3>,
) -> Vec<(EntityId, Se3)> {
    let start = solved.start_revision();
    let carried = match solved {
        Solved::Bundle(problem) => problem.carried.clone(),
        Solved::Graph(_) => BTreeSet::new(),
    };
    let since = (start.saturating_add(1), EntityId::MIN);
    let arrived = map.by_age.entries_from(since).map(|(&(_, id), ())| id);
    let late: BTreeSet<EntityId> = arrived.chain(carried).collect();
    let key = |&id: &EntityId| Some((id.client, map.keyframes().get(&id)?.capture_time_ns, id));
    let mut order: Vec<_> = late.iter().filter_map(key).collect();
    order.sort_unstable();
    // Those behind each other follow the same one.
    let mut references: BTreeMap<EntityId, EntityId> = BTreeMap::new();
    let mut moved = Vec::new();
    for (_, _, id) in order {
        let before = map.keyframe_before(id).map(|(before, _)| before);
        let before = before.and_then(|id| {
            if late.contains(&id) { references.get(&id).copied() } else { Some(id) }
        });
        let reference =
            before.or_else(|| first_after(map, id, &late)).or_else(|| most_shared(map, id, start));
        let Some(reference) = reference else { continue };
        references.insert(id, reference);
        let (Some(keyframe), Some(known)) =
            (map.keyframes().get(&id), map.keyframes().get(&reference))
        else {
            continue;
        };
        if let Some(motion) = motion(known, poses.get(&reference)) {
            moved.push((id, motion.compose(&keyframe.world_from_camera)));
        }
    }
    moved
}

/// The first keyframe behind `id` in its trajectory that is not late.
fn first_after(map: &Map, id: EntityId, late: &BTreeSet<EntityId>) -> Option<EntityId> {
    let mut after = map.keyframe_after(id)?.0;
    while late.contains(&after) {
        after = map.keyframe_after(after)?.0;
    }
    Some(after)
}

/// The keyframe known at the start that shares most landmarks with `keyframe`, then the lowest id.
fn most_shared(map: &Map, keyframe: EntityId, start_revision: i64) -> Option<EntityId> {
    let is_known =
        |id| map.keyframes().get(&id).is_some_and(|k| k.added_revision <= start_revision);
    let known = map.covisibility().neighbors(keyframe).filter(|&(id, _)| is_known(id));
    known.max_by_key(|&(id, shared)| (shared, std::cmp::Reverse(id))).map(|(id, _)| id)
}

/// New positions of the landmarks that are not solved and whose reference keyframe moves, by rising id;
/// `solved` is sorted too.
fn followers(
    map: &Map,
    poses: &BTreeMap<EntityId, Se3>,
    solved: &[(EntityId, Vector3<f64>)],
) -> Vec<(EntityId, Vector3<f64>)> {
    let is_solved = |id: &EntityId| solved.binary_search_by_key(id, |&(id, _)| id).is_ok();
    let motion =
        |(&id, new): (&EntityId, &Se3)| Some((id, motion(map.keyframes().get(&id)?, Some(new))?));
    let motions = poses.iter().filter_map(motion);
    // Where most keyframes move, one pass over all landmarks is several times faster than to look up
    // those of each observation.
    if 2 * poses.len() > map.keyframes().len() {
        let motions: BTreeMap<EntityId, Se3> = motions.collect();
        // Neighbors by id often have the same reference.
        let mut last: Option<(EntityId, Option<&Se3>)> = None;
        let moved = |(&id, landmark): (&EntityId, &Landmark)| {
            let (reference, position) = (landmark.reference?, landmark.position?);
            let motion = match last {
                Some((known, motion)) if known == reference => motion,
                _ => motions.get(&reference),
            };
            last = Some((reference, motion));
            (!is_solved(&id)).then_some(())?;
            Some((id, carried(motion?, &position)?))
        };
        let mut all = Vec::with_capacity(map.landmarks().len());
        all.extend(map.landmarks().iter().filter_map(moved));
        return all;
    }
    let mut moved = Vec::new();
    for (id, motion) in motions {
        let seen = map.keyframes().get(&id).into_iter().flat_map(|k| k.observations.iter());
        for observation in seen {
            let Some(landmark) = map.landmarks().get(&observation.landmark) else { continue };
            if landmark.reference == Some(id)
                && !is_solved(&observation.landmark)
                && let Some(position) = &landmark.position
                && let Some(position) = carried(&motion, position)
            {
                moved.push((observation.landmark, position));
            }
        }
    }
    moved.sort_by_key(|&(id, _)| id);
    // A keyframe may see a landmark twice.
    moved.dedup_by_key(|&mut (id, _)| id);
    moved
}
