//! The pose graph of a map: what was measured between its keyframes.
//!
//! Edges are
//!
//! - between the pairs of [`GraphPairs`], the relative pose that the landmarks
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
//! Both measurements and closures state covariances that are too small, each by a factor of its own for a
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
use crate::numbers::median;
use crate::{
    ClientIndex, Constraint, ConstraintKind, EntityId, Gauge, GraphPairs, Keyframe, Map, scaling,
};

/// Translation error over distance.
const DISTANCE_SHARE: f64 = 0.02;
/// Least translation error over the median distance of consecutive keyframes.
const MEDIAN_SHARE: f64 = 0.002;
/// Least rotation error in radians.
const LEAST_ANGLE_RAD: f64 = 0.005;
/// Rotation error over angle.
const ANGLE_SHARE: f64 = 0.02;

/// The pose graph over all keyframes, with all priors; `gauge` says what holds the pieces without
/// priors. `pairs` are those of the map, `motions` the relative pose of each, where there is one.
#[must_use]
pub fn measured_graph(
    map: &Map,
    gauge: Gauge,
    pairs: &GraphPairs<'_>,
    motions: &[Option<RelativeMotion>],
) -> GraphProblem {
    let mut graph = PoseGraph::new();
    graph.loss = map.policy().constraint_loss;
    let keyframes: Vec<EntityId> = pairs.keyframes.iter().map(|&(id, _)| id).collect();
    for ((_, keyframe), &number) in pairs.keyframes.iter().zip(&pairs.numbers) {
        graph.push_pose(number, keyframe.world_from_camera);
    }
    // The client whose trajectory each edge is part of.
    let mut owners = Vec::with_capacity(pairs.pairs.len());
    graph.edges.reserve(pairs.pairs.len() + map.constraints().len());
    for ([i, j], (i_from_j, information)) in measured_edges(map, pairs, motions) {
        graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
        owners.push(Some(keyframes[j].client));
    }
    let mut closures = Vec::new();
    for (&id, constraint) in map.constraints() {
        let i = pairs.index(constraint.keyframe_i);
        if let (Some(i), Some(j)) = (i, pairs.index(constraint.keyframe_j)) {
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
    let positions = priors::add(map, gauge, pairs, &keyframes, &mut graph);
    GraphProblem {
        start_poses: graph.poses.clone(),
        graph,
        keyframes,
        closures,
        positions,
        factors,
        start_revision: map.revision(),
        gauge: Some(gauge),
    }
}

/// The edges between pairs that no constraint replaces: the pose of the second keyframe in the frame of
/// the first, with its information.
fn measured_edges(
    map: &Map,
    pairs: &GraphPairs<'_>,
    motions: &[Option<RelativeMotion>],
) -> Vec<([usize; 2], (Se3, Information<6>))> {
    let replaced: BTreeSet<(EntityId, EntityId)> = map
        .constraints()
        .values()
        .filter(|constraint| constraint.kind != ConstraintKind::LoopClosure)
        .map(Constraint::pair)
        .collect();
    let by_odometry: Vec<Option<Se3>> =
        pairs.pairs.iter().map(|&pair| pair_odometry(map, pairs, pair)).collect();
    let median = median_distance(&by_odometry);
    let edge = |((&pair, motion), by_odometry): ((&[usize; 2], &Option<RelativeMotion>), _)| {
        let [a, b] = pair.map(|at| pairs.keyframes[at].0);
        if !replaced.is_empty() && replaced.contains(&(a.min(b), a.max(b))) {
            return None;
        }
        let motion = match motion {
            Some(motion) => in_map_scale(map, pairs.keyframes[pair[0]], motion)?,
            None => without_information(by_odometry, median)?,
        };
        Some((pair, motion))
    };
    pairs.pairs.iter().zip(motions).zip(by_odometry).filter_map(edge).collect()
}

/// The odometry between two keyframes, where they are of one client.
fn pair_odometry(map: &Map, pairs: &GraphPairs<'_>, pair: [usize; 2]) -> Option<Se3> {
    let [(a, first), (b, second)] = pair.map(|at| pairs.keyframes[at]);
    (a.client == b.client).then(|| map.odometry_from((a, first), &second.odom_from_camera))
}

/// A measured motion in the scale that the map has at its first keyframe. Landmarks without depth were placed
/// by odometry, which may have another one.
fn in_map_scale(
    map: &Map,
    from: (EntityId, &Keyframe),
    motion: &RelativeMotion,
) -> Option<(Se3, Information<6>)> {
    let has_depth = || from.1.observations.iter().any(|seen| seen.depth.is_some());
    if map.policy().metric_odometry || has_depth() {
        return Some((motion.a_from_b, motion.information));
    }
    let scale = map.odometry_scale(from.0);
    let information = scaling::information(scale, &motion.information)?;
    Some((scaling::pose(scale, &motion.a_from_b), information))
}

/// The odometry with an information that is in proportion to the motion.
fn without_information(
    by_odometry: Option<Se3>,
    median_distance: f64,
) -> Option<(Se3, Information<6>)> {
    let i_from_j = by_odometry?;
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

/// The median distance of the pairs by odometry; 1 where it is negligible or there is none.
fn median_distance(by_odometry: &[Option<Se3>]) -> f64 {
    let motions = by_odometry.iter().flatten();
    let distances = motions.map(|motion| motion.translation.norm()).collect();
    median(distances).filter(|&median| median > 1e-9).unwrap_or(1.0)
}
