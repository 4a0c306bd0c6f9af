//! Makes room in a full map: chooses the keyframe to remove, and keeps its information.
//!
//! The keyframe's observations and constraints are marginalized into relative-pose constraints between
//! its neighbors (`covis_solvers::marginalization`). A new constraint between a pair replaces the one
//! that an earlier keyframe left there: Ω = Ω₁ + Ω₂, Z = Z₁ · Exp(Ω⁻¹ Ω₂ Log(Z₁⁻¹ Z₂)). Landmarks
//! without observers are removed with the keyframe, and so are older landmarks that never had an
//! observer. The map is only read; the event that comes of it changes it.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::marginalization::{Marginal, marginalize_pose};

use super::problem::{MapProblem, retirement_problem};
use super::{Constraint, ConstraintKind, EntityId, Keyframe, Map, Prior, Retired, WhenFull};

/// Newest keyframes of each client that are never removed: the client is still adding to them.
const PROTECTED: usize = 2;

/// The best seen keyframe is chosen among this many of the oldest ones.
const CANDIDATES: usize = 32;

/// Observers besides a keyframe that make one of its landmarks well seen.
const OTHER_OBSERVERS: usize = 3;

/// Most landmarks without any observer that are removed with one keyframe.
const UNSEEN: usize = 4096;

/// The keyframe that the map's policy removes, with the constraints and priors that replace it; `None`
/// where none may be removed.
#[must_use]
pub fn retire(map: &Map) -> Option<Retired> {
    let keyframe = match map.policy().when_full {
        WhenFull::Reject => return None,
        WhenFull::Marginalize => candidates(map).next()?,
        WhenFull::Sparsify => {
            let oldest = (0..CANDIDATES).zip(candidates(map));
            // The share of well seen landmarks in 1/1000, then age.
            let best = oldest.max_by_key(|&(age, id)| (well_seen(map, id), Reverse(age)));
            best.map(|(_age, id)| id)?
        }
    };
    let entity = map.keyframes().get(&keyframe)?;
    Some(retired(map, keyframe, entity))
}

/// What the removal of a keyframe leaves.
fn retired(map: &Map, keyframe: EntityId, entity: &Keyframe) -> Retired {
    let mut retired = Retired {
        keyframe,
        landmarks: orphans(map, keyframe, entity),
        revoked: Vec::new(),
        constraints: Vec::new(),
        priors: Vec::new(),
    };
    let problem = retirement_problem(map, keyframe);
    match marginalize_pose(&problem.problem, 0) {
        Ok(marginal) => keep(map, &problem, marginal, &mut retired),
        // Without a linearization no information is kept; the keyframe is removed all the same.
        Err(error) => {
            tracing::debug!(?keyframe, %error, "the information of a removed keyframe is lost")
        }
    }
    retired
}

/// The keyframes of which at least `share` of the landmarks are seen by enough others, the oldest
/// first; the newest of each client are never among them.
#[must_use]
pub fn redundant_keyframes(map: &Map, share: f64) -> Vec<EntityId> {
    candidates(map).filter(|&id| is_redundant(map, id, share)).collect()
}

/// What the removal of a keyframe leaves, where it may be removed and is redundant as
/// [`redundant_keyframes`] says.
#[must_use]
pub fn retire_redundant(map: &Map, keyframe: EntityId, share: f64) -> Option<Retired> {
    let is_protected =
        || map.keyframes().range(keyframe.client.ids()).take(PROTECTED + 1).count() <= PROTECTED;
    let entity = map.keyframes().get(&keyframe)?;
    (is_redundant(map, keyframe, share) && !is_protected()).then(|| retired(map, keyframe, entity))
}

fn is_redundant(map: &Map, id: EntityId, share: f64) -> bool {
    map.sees(id) && well_seen(map, id) as f64 >= 1000.0 * share
}

/// The keyframes that may be removed, oldest first.
fn candidates(map: &Map) -> impl Iterator<Item = EntityId> + '_ {
    let mut gone: BTreeMap<_, usize> = BTreeMap::new();
    map.by_age.keys().map(|&(_, id)| id).filter(move |id| {
        let gone = gone.entry(id.client).or_default();
        let needed = PROTECTED + *gone + 1;
        let may_go = map.keyframes().range(id.client.ids()).take(needed).count() == needed;
        *gone += usize::from(may_go);
        may_go
    })
}

/// The share of the keyframe's landmarks that enough other keyframes see, in 1/1000.
fn well_seen(map: &Map, id: EntityId) -> usize {
    let Some(keyframe) = map.keyframes().get(&id) else { return 0 };
    let observers = |id| map.landmarks().get(&id).map_or(0, |l| l.observers.len());
    let seen = keyframe.observations.iter().map(|o| observers(o.landmark));
    let well = seen.filter(|&observers| observers > OTHER_OBSERVERS).count();
    1000 * well / keyframe.observations.len().max(1)
}

/// The landmarks that are removed with a keyframe, sorted.
fn orphans(map: &Map, id: EntityId, keyframe: &Keyframe) -> Vec<EntityId> {
    let only =
        |landmark: &EntityId| map.landmarks().get(landmark).is_some_and(|l| *l.observers == [id]);
    let seen = keyframe.observations.iter().map(|o| o.landmark).filter(only);
    let unseen = map.unseen.keys().take(UNSEEN);
    let unseen = unseen.take_while(|&&(added, _)| added < keyframe.added_revision);
    let mut orphans: Vec<EntityId> = seen.chain(unseen.map(|&(_, id)| id)).collect();
    orphans.sort_unstable();
    orphans.dedup();
    orphans
}

/// Turns the marginal into constraints and priors of the map.
fn keep(map: &Map, problem: &MapProblem, marginal: Marginal, retired: &mut Retired) {
    let revision = map.revision() + 1;
    let mut numbers = 0..EntityId::OWN_PER_REVISION;
    let earlier = earlier(map, problem);
    for edge in marginal.relative_poses {
        let (i, j) = (problem.keyframes[edge.i], problem.keyframes[edge.j]);
        let Some(number) = numbers.next() else { return };
        let mut constraint = Constraint {
            kind: ConstraintKind::Marginal,
            keyframe_i: i,
            keyframe_j: j,
            keyframe_i_from_keyframe_j: edge.i_from_j,
            information: edge.information,
            loss: edge.loss,
        };
        if let Some(&before) = earlier.get(&(i.min(j), i.max(j)))
            && let Some(known) = map.constraints().get(&before)
            && let Some(joined) = joined(known, &edge, (i, j))
        {
            retired.revoked.push(before);
            constraint = joined;
        }
        retired.constraints.push((EntityId::own(i.client, revision, number), constraint));
    }
    for prior in marginal.pose_priors {
        let keyframe = problem.keyframes[prior.pose];
        let Some(number) = numbers.next() else { return };
        let prior = Prior::Pose {
            keyframe,
            world_from_camera: prior.world_from_camera,
            information: prior.information,
            loss: prior.loss,
        };
        retired.priors.push((EntityId::own(keyframe.client, revision, number), prior));
    }
}

/// The constraints that removed keyframes left between the keyframes of the problem, by pair.
fn earlier(map: &Map, problem: &MapProblem) -> BTreeMap<(EntityId, EntityId), EntityId> {
    let held: BTreeSet<EntityId> = problem.keyframes.iter().copied().collect();
    let tied: BTreeSet<EntityId> = held.iter().flat_map(|&id| map.ties().of(id)).collect();
    let pair = |id: EntityId| {
        let constraint = map.constraints().get(&id)?;
        let (i, j) = constraint.pair();
        let is_earlier = constraint.kind == ConstraintKind::Marginal;
        (is_earlier && held.contains(&i) && held.contains(&j)).then_some(((i, j), id))
    };
    tied.into_iter().filter_map(pair).collect()
}

/// Joins both measurements of a pair, in the direction of the known one.
fn joined(
    known: &Constraint,
    edge: &RelativePose<Se3, 6>,
    (i, j): (EntityId, EntityId),
) -> Option<Constraint> {
    if (known.keyframe_i, known.keyframe_j) != (i, j) {
        // The information of a new one in the other direction would have to be transformed; two
        // constraints of one pair are as good, and there are at most two directions.
        return None;
    }
    let sum = known.information.matrix() + edge.information.matrix();
    let apart = known.keyframe_i_from_keyframe_j.inverse().compose(&edge.i_from_j).log();
    let step = sum.cholesky()?.solve(&(edge.information.matrix() * apart));
    Some(Constraint {
        keyframe_i_from_keyframe_j: known.keyframe_i_from_keyframe_j.compose(&Se3::exp(&step)),
        information: Information::new(&sum).ok()?,
        ..*known
    })
}
