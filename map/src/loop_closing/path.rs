//! What the way between two keyframes says of their relative pose: the odometry drifts with it.
//!
//! The shortest way through the map, over keyframes of a client that follow each other and share landmarks
//! and over constraints that count, is the longest that errors can have grown on. What is expected is what
//! was measured on it, odometry and constraints: a keyframe that a client sends in a frame of its own is
//! where it is expected before any solve has moved it. Errors are taken as systematic, so that they grow with
//! the distance and not with its root: a path that is trusted too much refuses true closures. Where no way
//! leads from one to the other nothing is expected. It judges no closure.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use covis_solvers::geometric_verification::Expected;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Covariance;
use covis_solvers::interrupt::Interrupt;
use nalgebra::Matrix6;

use crate::{EntityId, Map, near_pairs};

/// Drift of the position by the length of the way, where keyframes measure depth: several times what
/// visual odometry reaches (0.5 to 1 % in the KITTI benchmark), and what handheld cameras that shake do.
pub(super) const DRIFT: f64 = 0.03;
/// The same without depth, where the scale drifts too.
const DRIFT_OF_SCALE: f64 = 0.2;
/// Drift of the rotation by the length of the way, rad/m, and by the angle that was turned: the former is
/// three times the 0.05°/m of good visual odometry, the latter an error of the focal length of 1 %.
pub(super) const TURN_BY_LENGTH: f64 = 0.003;
pub(super) const TURN_BY_ANGLE: f64 = 0.01;
/// What is left at no way at all, m and rad: two keyframes of one place are no better known.
pub(super) const LEAST: (f64, f64) = (0.05, 0.02);
/// A turn of a radian counts as much as a way of this length where the shortest one is searched, m; in a map
/// that measures no lengths, in its unit.
const METERS_PER_RADIAN: f64 = 1.0;

/// A way from a keyframe to another one.
#[derive(Clone, Copy, Debug)]
pub(super) struct OdometryPath {
    /// The pose of the other one in the frame of the first, as it was measured on the way.
    motion: Se3,
    /// Length, m.
    pub(super) length: f64,
    /// Angles turned, rad.
    pub(super) angle: f64,
}

impl OdometryPath {
    /// Of no length.
    fn none() -> Self {
        Self { motion: Se3::identity(), length: 0.0, angle: 0.0 }
    }

    fn and(self, motion: &Se3) -> Self {
        Self {
            motion: self.motion.compose(motion),
            length: self.length + motion.translation.norm(),
            angle: self.angle + motion.rotation.log().norm(),
        }
    }

    fn cost(&self) -> f64 {
        self.length + METERS_PER_RADIAN * self.angle
    }
}

/// The relative pose of two keyframes as it was measured on the way between them, and how far it may have
/// drifted on it; `None` where no way leads from one to the other, and where the interrupt is due.
pub(super) fn expected(
    map: &Map,
    candidate: EntityId,
    query: EntityId,
    interrupt: &Interrupt,
) -> Option<Expected> {
    let way = shortest(map, candidate, query, f64::INFINITY, interrupt)?;
    let (from, to) = (map.keyframes().get(&candidate)?, map.keyframes().get(&query)?);
    let measures_depth =
        [from, to].iter().all(|k| k.observations.iter().any(|o| o.depth.is_some()));
    let drift = if measures_depth { DRIFT } else { DRIFT_OF_SCALE };
    let turn = LEAST.1 + TURN_BY_LENGTH * way.length + TURN_BY_ANGLE * way.angle;
    // A turn somewhere on the way moves its end by at most the whole length.
    let along = LEAST.0 + drift * way.length;
    let position = along.hypot(turn * way.length / 2.0);
    let mut covariance = Matrix6::zeros();
    for axis in 0..3 {
        covariance[(axis, axis)] = position * position;
        covariance[(axis + 3, axis + 3)] = turn * turn;
    }
    let covariance = Covariance::new(&covariance).ok()?;
    Some(Expected { candidate_from_query: way.motion, covariance })
}

/// The shortest way from one keyframe to another (Dijkstra 1959), where one is no longer than `most` meters,
/// a radian counting as one.
pub(super) fn shortest(
    map: &Map,
    from: EntityId,
    to: EntityId,
    most: f64,
    interrupt: &Interrupt,
) -> Option<OdometryPath> {
    let odom = |id: EntityId| map.keyframes().get(&id).map(|k| k.odom_from_camera);
    let mut best: BTreeMap<EntityId, OdometryPath> = BTreeMap::from([(from, OdometryPath::none())]);
    // Costs by their bits: those of numbers that are not negative order as the numbers do.
    let mut queue = BinaryHeap::from([Reverse((0, from))]);
    while let Some(Reverse((cost, id))) = queue.pop() {
        let way = *best.get(&id)?;
        if id == to {
            return Some(way);
        }
        if interrupt.is_due() {
            return None;
        }
        if cost > way.cost().to_bits() {
            continue;
        }
        let here = odom(id)?.inverse();
        let near = near_pairs(map, id).into_iter().filter_map(|(a, b)| {
            let other = if a == id { b } else { a };
            Some((other, here.compose(&odom(other)?)))
        });
        let tied = map.ties().of(id).filter_map(|tie| {
            let constraint = map.active_constraint(tie)?;
            let i_from_j = constraint.keyframe_i_from_keyframe_j;
            Some(match constraint.keyframe_i == id {
                true => (constraint.keyframe_j, i_from_j),
                false => (constraint.keyframe_i, i_from_j.inverse()),
            })
        });
        for (other, motion) in near.chain(tied) {
            let reached = way.and(&motion);
            let is_shorter = best.get(&other).is_none_or(|known| reached.cost() < known.cost());
            // A pose that is not finite leads nowhere.
            if is_shorter && reached.cost().is_finite() && reached.cost() <= most {
                best.insert(other, reached);
                queue.push(Reverse((reached.cost().to_bits(), other)));
            }
        }
    }
    None
}
