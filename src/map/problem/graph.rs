//! The pose graph of a loop closure.
//!
//! Edges are the stored constraints with their own information, and between consecutive keyframes
//! of a client as well as covisible ones the relative pose of the current estimates Z = X_i⁻¹ X_j.
//! Those estimates are local, so their error is taken to grow with the motion between the two:
//!
//! σ_t = (0.02 d + 0.002 d̄) s,  σ_r = (0.005 rad + 0.02 θ) s,  s = √(m / n) within 0.5 to 2
//!
//! with distance d, angle θ, the median distance d̄ of consecutive keyframes (which carries the map's
//! unknown scale), n shared landmarks and m the policy's `min_shared_landmarks`. A pair with a loop
//! closure gets no estimated edge: the estimate is what the closure corrects. A closure that is
//! switched off is still an edge, because it may be judged again, and its pair has both.

use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::problem::PoseGraph;
use nalgebra::Vector6;

use super::{ClosureEdge, GraphProblem, priors};
use crate::map::{ClientIndex, ConstraintKind, EntityId, Gauge, Map};

/// Translation error over distance.
const DISTANCE_SHARE: f64 = 0.02;
/// Least translation error over the median distance of consecutive keyframes.
const MEDIAN_SHARE: f64 = 0.002;
/// Least rotation error in radians.
const LEAST_ANGLE_RAD: f64 = 0.005;
/// Rotation error over angle.
const ANGLE_SHARE: f64 = 0.02;

/// The pose graph over all keyframes, with all priors; what holds the pieces without priors is said by
/// the policy's gauge.
#[must_use]
pub fn loop_problem(map: &Map) -> GraphProblem {
    graph_problem(map, map.policy().gauge)
}

/// As [`loop_problem`], with another gauge than the policy's.
#[must_use]
pub fn graph_problem(map: &Map, gauge: Gauge) -> GraphProblem {
    let mut graph = PoseGraph::new();
    graph.loss = map.policy().constraint_loss;
    let keyframes: Vec<EntityId> = map.keyframes().keys().copied().collect();
    let numbers = numbers(map);
    let mut index_of = BTreeMap::new();
    for (keyframe, entity) in map.keyframes() {
        let number = numbers.get(keyframe).copied().unwrap_or_default();
        index_of.insert(*keyframe, graph.push_pose(number, entity.world_from_camera));
    }
    for (a, b, information) in estimated_edges(map) {
        if let (Some(&i), Some(&j)) = (index_of.get(&a), index_of.get(&b)) {
            let i_from_j = graph.poses[i].inverse().compose(&graph.poses[j]);
            graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
        }
    }
    let mut closures = Vec::new();
    for (&id, constraint) in map.constraints() {
        let i = index_of.get(&constraint.keyframe_i);
        if let (Some(&i), Some(&j)) = (i, index_of.get(&constraint.keyframe_j)) {
            let i_from_j = constraint.keyframe_i_from_keyframe_j;
            let information = constraint.information;
            if constraint.kind == ConstraintKind::LoopClosure {
                let switched_off = map.switched_off().get(&id).copied();
                closures.push(ClosureEdge {
                    edge: graph.edges.len(),
                    constraint: id,
                    switched_off,
                });
            }
            let loss = constraint.loss;
            graph.edges.push(RelativePose { i, j, i_from_j, information, loss });
        }
    }
    let positions = priors::add(map, gauge, &index_of, &mut graph);
    GraphProblem { graph, keyframes, closures, positions, start_revision: map.revision() }
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

/// The pairs that are tied at their current estimates, with the information of the tie.
fn estimated_edges(map: &Map) -> Vec<(EntityId, EntityId, Information<6>)> {
    let consecutive = consecutive_pairs(map);
    let closed: BTreeSet<(EntityId, EntityId)> = map
        .active_constraints()
        .filter(|(_, c)| c.kind == ConstraintKind::LoopClosure)
        .map(|(_, c)| ordered(c.keyframe_i, c.keyframe_j))
        .collect();
    let covisibility = map.covisibility();
    let threshold = u32::try_from(map.policy().min_shared_landmarks.max(1)).unwrap_or(u32::MAX);
    let mut pairs: BTreeMap<(EntityId, EntityId), u32> = covisibility
        .pairs()
        .filter(|&(_, _, shared)| shared >= threshold)
        .map(|(a, b, shared)| ((a, b), shared))
        .collect();
    for &(a, b) in &consecutive {
        pairs.insert((a, b), covisibility.shared(a, b));
    }
    let median = median_distance(map, &consecutive);
    pairs
        .into_iter()
        .filter(|(pair, _)| !closed.contains(pair))
        .filter_map(|((a, b), shared)| {
            let spread = (f64::from(threshold) / f64::from(shared.max(1))).sqrt().clamp(0.5, 2.0);
            Some((a, b, information(&relative(map, a, b)?, median, spread)?))
        })
        .collect()
}

fn information(i_from_j: &Se3, median_distance: f64, spread: f64) -> Option<Information<6>> {
    let distance = i_from_j.translation.norm();
    let angle = i_from_j.rotation.log().norm();
    let t = (DISTANCE_SHARE * distance + MEDIAN_SHARE * median_distance) * spread;
    let r = (LEAST_ANGLE_RAD + ANGLE_SHARE * angle) * spread;
    Information::from_sigmas(&Vector6::new(t, t, t, r, r, r)).ok()
}

fn ordered(a: EntityId, b: EntityId) -> (EntityId, EntityId) {
    if a <= b { (a, b) } else { (b, a) }
}

fn relative(map: &Map, a: EntityId, b: EntityId) -> Option<Se3> {
    let (a, b) = (map.keyframes().get(&a)?, map.keyframes().get(&b)?);
    Some(a.world_from_camera.inverse().compose(&b.world_from_camera))
}

/// Neighbors in capture time, client by client, the lower id first.
fn consecutive_pairs(map: &Map) -> Vec<(EntityId, EntityId)> {
    let mut pairs = Vec::new();
    for index in (0..).take(map.clients().len()) {
        let trajectory = map.trajectory(ClientIndex(index));
        pairs.extend(trajectory.windows(2).map(|pair| ordered(pair[0].0, pair[1].0)));
    }
    pairs
}

/// The median distance of consecutive keyframes; 1 where it is negligible or there is none.
fn median_distance(map: &Map, consecutive: &[(EntityId, EntityId)]) -> f64 {
    let mut distances: Vec<f64> = consecutive
        .iter()
        .filter_map(|&(a, b)| relative(map, a, b))
        .map(|pose| pose.translation.norm())
        .collect();
    distances.sort_by(f64::total_cmp);
    match distances.get(distances.len() / 2) {
        Some(&median) if median > 1e-9 => median,
        _ => 1.0,
    }
}
