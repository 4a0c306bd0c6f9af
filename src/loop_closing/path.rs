//! What the way between two keyframes says of their relative pose: the odometry drifts with it.
//!
//! The shortest way through the map, over keyframes that share landmarks and constraints that count, is
//! the longest that errors can have grown on. They are taken as systematic, so that they grow with the
//! way and not with its root: whoever is believed too much here refuses true closures. Where no way leads
//! from one to the other nothing is expected.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use covis_solvers::geometric_verification::Expected;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Covariance;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::relative_motion::MIN_MATCHES;
use nalgebra::Matrix6;

use crate::map::{EntityId, Map};

/// Drift of the position by the length of the way, where keyframes measure depth: several times what
/// visual odometry reaches (0.5 to 1 % in the KITTI benchmark), and what handheld cameras that shake do.
const DRIFT: f64 = 0.03;
/// The same without depth, where the scale drifts too.
const DRIFT_OF_SCALE: f64 = 0.2;
/// Drift of the rotation by the length of the way, rad/m, and by the angle that was turned: the former is
/// three times the 0.05°/m of good visual odometry, the latter an error of the focal length of 1 %.
const TURN_BY_LENGTH: f64 = 0.003;
const TURN_BY_ANGLE: f64 = 0.01;
/// What is left at no way at all, m and rad: two keyframes of one place are no better known.
const LEAST: (f64, f64) = (0.05, 0.02);
/// A turn of a radian counts as much as this many meters where the shortest way is searched.
const METERS_PER_RADIAN: f64 = 1.0;

/// Length of a way, m, and angles turned on it, rad.
#[derive(Clone, Copy, Debug, Default)]
struct Way {
    length: f64,
    angle: f64,
}

impl Way {
    fn and(self, motion: &Se3) -> Self {
        let length = self.length + motion.translation.norm();
        Self { length, angle: self.angle + motion.rotation.log().norm() }
    }

    fn cost(&self) -> f64 {
        self.length + METERS_PER_RADIAN * self.angle
    }
}

/// A number that is ordered, as the key of a queue.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cost(f64);

impl Eq for Cost {}

impl Ord for Cost {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl PartialOrd for Cost {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// The relative pose of two keyframes by their current estimates, and how far it may have drifted on the
/// way between them; `None` where no way leads from one to the other, and where the interrupt is due.
pub(super) fn expected(
    map: &Map,
    candidate: EntityId,
    query: EntityId,
    interrupt: &Interrupt,
) -> Option<Expected> {
    let way = shortest(map, candidate, query, interrupt)?;
    let (from, to) = (map.keyframes().get(&candidate)?, map.keyframes().get(&query)?);
    let candidate_from_query = from.world_from_camera.inverse().compose(&to.world_from_camera);
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
    Some(Expected { candidate_from_query, covariance })
}

/// The shortest way from one keyframe to another (Dijkstra 1959).
fn shortest(map: &Map, from: EntityId, to: EntityId, interrupt: &Interrupt) -> Option<Way> {
    let pose = |id: EntityId| map.keyframes().get(&id).map(|k| k.world_from_camera);
    let mut best: BTreeMap<EntityId, Way> = BTreeMap::from([(from, Way::default())]);
    let mut queue = BinaryHeap::from([Reverse((Cost(0.0), from))]);
    while let Some(Reverse((Cost(cost), id))) = queue.pop() {
        let way = *best.get(&id)?;
        if id == to {
            return Some(way);
        }
        if interrupt.is_due() {
            return None;
        }
        if cost > way.cost() {
            continue;
        }
        let here = pose(id)?.inverse();
        let shares = |&(_, shared): &(EntityId, u32)| shared as usize >= MIN_MATCHES;
        let near = map.covisibility().neighbors(id).filter(shares).map(|(other, _)| other);
        let tied = map.ties().of(id).filter_map(|tie| {
            let constraint = map.active_constraint(tie)?;
            let is_i = constraint.keyframe_i == id;
            Some(if is_i { constraint.keyframe_j } else { constraint.keyframe_i })
        });
        for other in near.chain(tied) {
            let Some(there) = pose(other) else { continue };
            let reached = way.and(&here.compose(&there));
            let is_shorter = best.get(&other).is_none_or(|known| reached.cost() < known.cost());
            // A pose that is not finite leads nowhere.
            if is_shorter && reached.cost().is_finite() {
                best.insert(other, reached);
                queue.push(Reverse((Cost(reached.cost()), other)));
            }
        }
    }
    None
}
