//! The pose graph of a map: what was measured between its keyframes.
//!
//! Edges are
//!
//! - between the pairs of [`graph_pairs`](crate::map::graph_pairs), the relative pose that the landmarks
//!   of both keyframes give, with its information; where these do not determine it, the client's
//!   odometry;
//! - the stored constraints with their own information. A constraint of another kind than a loop closure
//!   takes the place of the measurement between its keyframes.
//!
//! No edge is made from the present estimates: they hold what earlier solves did, and with it the
//! closures that are to be judged. Odometry that comes without information has σ in proportion to the
//! motion, σ_t = 0.02 d + 0.002 d̄ and σ_r = 0.005 rad + 0.02 θ, with distance d, angle θ and the median
//! distance d̄ of consecutive keyframes, which carries the map's unknown scale.
//!
//! Both measurements and closures claim to be better than they are, each by a factor of its own for a
//! client; [`variance_factors`] finds them and they are taken out here.

use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::problem::PoseGraph;
use covis_solvers::relative_motion::RelativeMotion;
use covis_solvers::robust::{VarianceFactors, variance_factors};
use nalgebra::Vector6;

use super::{ClosureEdge, GraphProblem, priors};
use crate::map::keyframe_pairs::{graph_pairs, odometry};
use crate::map::{ClientIndex, ConstraintKind, EntityId, Gauge, Map};

/// Translation error over distance.
const DISTANCE_SHARE: f64 = 0.02;
/// Least translation error over the median distance of consecutive keyframes.
const MEDIAN_SHARE: f64 = 0.002;
/// Least rotation error in radians.
const LEAST_ANGLE_RAD: f64 = 0.005;
/// Rotation error over angle.
const ANGLE_SHARE: f64 = 0.02;

/// The pose graph over all keyframes, with all priors; the policy's gauge says what holds the pieces
/// without priors. `measured` tells the relative pose of a pair, where there is one.
#[must_use]
pub fn loop_problem(
    map: &Map,
    measured: impl Fn(EntityId, EntityId) -> Option<RelativeMotion>,
) -> GraphProblem {
    graph_problem(map, map.policy().gauge, measured)
}

/// As [`loop_problem`], with another gauge than the policy's.
#[must_use]
pub fn graph_problem(
    map: &Map,
    gauge: Gauge,
    measured: impl Fn(EntityId, EntityId) -> Option<RelativeMotion>,
) -> GraphProblem {
    let mut graph = PoseGraph::new();
    graph.loss = map.policy().constraint_loss;
    let keyframes: Vec<EntityId> = map.keyframes().keys().copied().collect();
    let numbers = numbers(map);
    let mut index_of = BTreeMap::new();
    for (keyframe, entity) in map.keyframes() {
        let number = numbers.get(keyframe).copied().unwrap_or_default();
        index_of.insert(*keyframe, graph.push_pose(number, entity.world_from_camera));
    }
    // The client whose trajectory each edge is part of.
    let mut owners = Vec::new();
    for (a, b, motion) in measured_edges(map, measured) {
        if let (Some(&i), Some(&j)) = (index_of.get(&a), index_of.get(&b)) {
            let (i_from_j, information) = motion;
            graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
            owners.push(Some(b.client));
        }
    }
    let mut closures = Vec::new();
    for (&id, constraint) in map.constraints() {
        let i = index_of.get(&constraint.keyframe_i);
        if let (Some(&i), Some(&j)) = (i, index_of.get(&constraint.keyframe_j)) {
            let i_from_j = constraint.keyframe_i_from_keyframe_j;
            let information = constraint.information;
            if constraint.kind == ConstraintKind::LoopClosure {
                let edge = graph.edges.len();
                let switched_off = map.switched_off().get(&id).copied();
                closures.push(ClosureEdge { edge, constraint: id, switched_off });
            }
            let loss = constraint.loss;
            graph.edges.push(RelativePose { i, j, i_from_j, information, loss });
            owners.push((constraint.kind == ConstraintKind::Odometry).then_some(id.client));
        }
    }
    let factors = factors(map, &graph, &closures);
    scale(&mut graph, &owners, &closures, &factors);
    let positions = priors::add(map, gauge, &index_of, &mut graph);
    GraphProblem { graph, keyframes, closures, positions, factors, start_revision: map.revision() }
}

/// A number for each keyframe: consecutive ones of a client in capture order have consecutive
/// numbers, no others.
fn numbers(map: &Map) -> BTreeMap<EntityId, i64> {
    let mut numbers = BTreeMap::new();
    let mut next = 0;
    for index in (0..).take(map.clients().len()) {
        for (id, _) in map.trajectory(ClientIndex(index)) {
            numbers.insert(id, next);
            next += 1;
        }
        next += 1;
    }
    numbers
}

/// The measured pairs that no constraint replaces: the pose of the second keyframe in the frame of the
/// first, with its information.
fn measured_edges(
    map: &Map,
    measured: impl Fn(EntityId, EntityId) -> Option<RelativeMotion>,
) -> Vec<(EntityId, EntityId, (Se3, Information<6>))> {
    let replaced: BTreeSet<(EntityId, EntityId)> = map
        .constraints()
        .values()
        .filter(|constraint| constraint.kind != ConstraintKind::LoopClosure)
        .map(|constraint| ordered(constraint.keyframe_i, constraint.keyframe_j))
        .collect();
    let pairs = graph_pairs(map);
    let median = median_distance(map, &pairs);
    let edge = |(a, b)| {
        let motion = match measured(a, b) {
            Some(motion) => (motion.a_from_b, motion.information),
            None => without_information(map, (a, b), median)?,
        };
        Some((a, b, motion))
    };
    let is_free = |&(a, b): &(EntityId, EntityId)| !replaced.contains(&ordered(a, b));
    pairs.into_iter().filter(is_free).filter_map(edge).collect()
}

/// The odometry between two keyframes of one client.
fn without_information(
    map: &Map,
    (a, b): (EntityId, EntityId),
    median_distance: f64,
) -> Option<(Se3, Information<6>)> {
    if a.client != b.client {
        return None;
    }
    let i_from_j = odometry(map.keyframes().get(&a)?, map.keyframes().get(&b)?);
    let distance = i_from_j.translation.norm();
    let angle = i_from_j.rotation.log().norm();
    let t = DISTANCE_SHARE * distance + MEDIAN_SHARE * median_distance;
    let r = LEAST_ANGLE_RAD + ANGLE_SHARE * angle;
    let information = Information::from_sigmas(&Vector6::new(t, t, t, r, r, r)).ok()?;
    Some((i_from_j, information))
}

/// The variance factors of each client that sent a closure or has a trajectory.
fn factors(
    map: &Map,
    graph: &PoseGraph<Se3, 6>,
    closures: &[ClosureEdge],
) -> BTreeMap<ClientIndex, VarianceFactors> {
    let clients: Vec<ClientIndex> = (0..).take(map.clients().len()).map(ClientIndex).collect();
    let of = |client: &ClientIndex| {
        let own = closures.iter().filter(|closure| closure.constraint.client == *client);
        own.map(|closure| closure.edge).collect()
    };
    let groups: Vec<Vec<usize>> = clients.iter().map(of).collect();
    clients.into_iter().zip(variance_factors(graph, &groups)).collect()
}

/// Divides information by the variance factors: that of a trajectory by its client's, that of closures
/// by that of who sent them.
fn scale(
    graph: &mut PoseGraph<Se3, 6>,
    owners: &[Option<ClientIndex>],
    closures: &[ClosureEdge],
    factors: &BTreeMap<ClientIndex, VarianceFactors>,
) {
    for (edge, owner) in graph.edges.iter_mut().zip(owners) {
        if let Some(factors) = owner.as_ref().and_then(|owner| factors.get(owner)) {
            edge.information = edge.information.scaled(1.0 / factors.odometry);
        }
    }
    for closure in closures {
        let factors = factors.get(&closure.constraint.client);
        if let (Some(edge), Some(factors)) = (graph.edges.get_mut(closure.edge), factors) {
            edge.information = edge.information.scaled(1.0 / factors.closures);
        }
    }
}

fn ordered(a: EntityId, b: EntityId) -> (EntityId, EntityId) {
    if a <= b { (a, b) } else { (b, a) }
}

/// The median distance of the pairs by odometry; 1 where it is negligible or there is none.
fn median_distance(map: &Map, pairs: &[(EntityId, EntityId)]) -> f64 {
    let mut distances: Vec<f64> = pairs
        .iter()
        .filter(|(a, b)| a.client == b.client)
        .filter_map(|(a, b)| Some(odometry(map.keyframes().get(a)?, map.keyframes().get(b)?)))
        .map(|motion| motion.translation.norm())
        .collect();
    distances.sort_by(f64::total_cmp);
    match distances.get(distances.len() / 2) {
        Some(&median) if median > 1e-9 => median,
        _ => 1.0,
    }
}
