//! What the map tests share: a journal that grows with its map, and a street of keyframes.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use std::collections::{BTreeMap, BTreeSet};

use covis::map::{
    AppliedSolve, Cause, Change, ClientIndex, ConstraintKind, Counted, Edit, EntityId, EntityRef,
    Event, Gauge, GraphPairs, GraphProblem, Item, ItemLandmark, ItemObservation, Map, MapPolicy,
    MeasuredPosition, Rejection, SolveKind, Window, choose_window, measured_graph,
};
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3, So3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::relative_motion::RelativeMotion;
use nalgebra::{Matrix3, Matrix6, Vector2, Vector3};
use sprs::{CsMat, TriMat};

/// A map and the events that made it.
#[derive(Clone)]
pub(crate) struct Journal {
    pub(crate) map: Map,
    pub(crate) events: Vec<Event>,
    sequence: i64,
}

pub(crate) const ROBOT: ClientIndex = ClientIndex(0);

impl Journal {
    /// A map with one client, "robot", and its camera 0.
    pub(crate) fn new(policy: MapPolicy) -> Self {
        let mut journal = Self { map: Map::new(), events: Vec::new(), sequence: 0 };
        journal.push(Change::Created { policy, create_time_ns: 1, display_name: String::new() });
        journal.push(Change::ClientOpened { name: "robot".to_owned(), epoch: 1 });
        journal.send(ROBOT, &camera_item(0)).unwrap();
        journal
    }

    pub(crate) fn push(&mut self, change: Change) {
        self.append(change, None);
    }

    fn append(&mut self, change: Change, cause: Option<Cause>) {
        let event = Event { revision: self.map.revision() + 1, time_ns: 0, cause, change };
        self.map.apply(&event).unwrap();
        self.events.push(event);
    }

    /// Whatever is sent in any test adds no more than was said before.
    pub(crate) fn send(&mut self, client: ClientIndex, item: &Item) -> Result<(), Rejection> {
        let change = self.map.check(client, item)?;
        let before = self.map.usage();
        let (growth, bound) = (self.map.growth(&change), self.map.growth_bound(&change));
        self.sequence += 1;
        let digest = [self.sequence as u8; 32];
        let epoch = self.map.client(client).unwrap().epoch;
        self.append(change, Some(Cause { client, epoch, sequence: self.sequence, digest }));
        let added = self.map.usage() - before;
        let removes = matches!(
            item,
            Item::Edit(
                Edit::RemoveKeyframe { .. }
                    | Edit::RemoveLandmarks { .. }
                    | Edit::RemoveObservations { .. }
                    | Edit::RevokeConstraint { .. }
            )
        );
        // A removal is taken whatever it adds for landmarks with many observers.
        for counted in Counted::ALL.into_iter().filter(|c| !removes || *c != Counted::Bytes) {
            let [added, growth, bound] = [added, growth, bound].map(|usage| usage.of(counted));
            assert!(added <= growth && growth <= bound, "{counted:?}: {added} {growth} {bound}");
        }
        Ok(())
    }
}

pub(crate) fn id(id: i64) -> EntityId {
    EntityId::new(ROBOT, id)
}

pub(crate) fn pinhole() -> Camera {
    Camera::Pinhole(PinholeRadialTangential {
        fx: 500.0,
        fy: 500.0,
        cx: 320.0,
        cy: 240.0,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    })
}

pub(crate) fn camera_item(id: i64) -> Item {
    Item::Camera { id, camera: pinhole(), width_px: 640, height_px: 480 }
}

/// A camera at `x` along the street, looking at the houses (z forward).
pub(crate) fn pose_at(x: f64) -> Se3 {
    Se3::new(So3::identity(), Vector3::new(x, 0.0, 0.0))
}

/// A corner of a house: x along the street, the rest by a fixed scramble of the index.
pub(crate) fn corner(index: i64) -> Vector3<f64> {
    let scramble = |k: i64| ((index * 7919 + k * 104_729) % 1000) as f64 / 1000.0;
    Vector3::new(index as f64 * 0.1, scramble(1) * 4.0 - 2.0, 6.0 + 3.0 * scramble(2))
}

/// The observation of a landmark at `point` from `pose`, exact.
pub(crate) fn observe(landmark: i64, pose: &Se3, point: &Vector3<f64>) -> ItemObservation {
    let pixel = pinhole().project(&pose.inverse_transform(point)).unwrap();
    ItemObservation {
        landmark: EntityRef::own(landmark),
        pixel,
        sigma_px: 1.0,
        depth: None,
        descriptor: None,
    }
}

pub(crate) fn landmark(id: i64) -> ItemLandmark {
    ItemLandmark { id, position: Some(corner(id)) }
}

/// Keyframe `id` at x = `id` meters, seeing corners 10 id − 20 to 10 id + 20 (those from 0 on).
/// `start` is the pose that the client claims; observations are exact for the true one.
pub(crate) fn street_keyframe(id: i64, start: Se3, known: &Map) -> Item {
    let pose = pose_at(id as f64);
    let seen: Vec<i64> = (10 * id - 20..10 * id + 20).filter(|&k| k >= 0).collect();
    let landmarks = seen
        .iter()
        .filter(|&&k| !known.landmarks().contains_key(&self::id(k)))
        .map(|&k| landmark(k))
        .collect();
    Item::Keyframe {
        id,
        capture_time_ns: id * 1_000_000,
        camera: Some(EntityRef::own(0)),
        world_from_camera: start,
        odom_from_camera: None,
        observations: seen.iter().map(|&k| observe(k, &pose, &corner(k))).collect(),
        landmarks,
        global_descriptor: None,
    }
}

/// A street of `count` keyframes at their true poses.
pub(crate) fn street(count: i64, policy: MapPolicy) -> Journal {
    let mut journal = Journal::new(policy);
    for index in 0..count {
        let item = street_keyframe(index, pose_at(index as f64), &journal.map);
        journal.send(ROBOT, &item).unwrap();
    }
    journal
}

pub(crate) fn relative_pose(id: i64, kind: ConstraintKind, i: i64, j: i64, measured: Se3) -> Item {
    Item::RelativePose {
        id,
        kind,
        keyframe_i: EntityRef::own(i),
        keyframe_j: EntityRef::own(j),
        keyframe_i_from_keyframe_j: measured,
        information: Information::new(&(Matrix6::identity() * 1e4)).unwrap(),
        loss: None,
    }
}

/// A fix of the origin of keyframe `keyframe`, with σ = 0.01 m.
pub(crate) fn fix(id: i64, keyframe: i64, point_in_world: Vector3<f64>) -> Item {
    Item::PositionPrior {
        id,
        keyframe: EntityRef::own(keyframe),
        position: MeasuredPosition::InWorld(point_in_world),
        point_in_camera: Vector3::zeros(),
        information: Information::new(&(Matrix3::identity() * 1e4)).unwrap(),
        loss: Loss::Trivial,
    }
}

pub(crate) fn pixel(u: f64, v: f64) -> Vector2<f64> {
    Vector2::new(u, v)
}

/// The pose graph of a whole map; `measured` tells the relative pose of a pair, where there is one.
pub(crate) fn graph_problem(
    map: &Map,
    gauge: Gauge,
    measured: impl Fn(EntityId, EntityId) -> Option<RelativeMotion>,
) -> GraphProblem {
    let pairs = GraphPairs::of(map);
    let motions: Vec<_> = pairs.ids().map(|(a, b)| measured(a, b)).collect();
    measured_graph(map, gauge, &pairs, &motions)
}

/// The pose graph of a whole map with the policy's gauge.
pub(crate) fn loop_problem(
    map: &Map,
    measured: impl Fn(EntityId, EntityId) -> Option<RelativeMotion>,
) -> GraphProblem {
    graph_problem(map, map.policy().gauge, measured)
}

/// A solve of this kind that changes nothing.
pub(crate) fn solve_of(kind: SolveKind) -> AppliedSolve {
    AppliedSolve { initial_cost: 1.0, final_cost: 0.5, ..AppliedSolve::unchanged(kind) }
}

/// The window around keyframes while none waits for one.
pub(crate) fn window_around(map: &Map, keyframes: &[EntityId]) -> Window {
    choose_window(map, keyframes, &BTreeSet::new())
}

pub(crate) fn pose_error(a: &Se3, b: &Se3) -> f64 {
    a.minus(b).norm()
}

/// The counts of shared landmarks from scratch: AᵀA of the observation matrix A (landmarks × keyframes,
/// entries 0 or 1) for landmarks of at most 33 observers; each observer of another one counts with the
/// 32 that were added before it and the 32 after it.
pub(crate) fn assert_covisibility(map: &Map) {
    let ids: Vec<EntityId> = map.keyframes().keys().copied().collect();
    let column = |id: &EntityId| ids.binary_search(id).unwrap();
    let mut expected: BTreeMap<(EntityId, EntityId), u32> = BTreeMap::new();
    let mut a = TriMat::new((map.landmarks().len(), ids.len()));
    for (row, landmark) in map.landmarks().values().enumerate() {
        if landmark.observers.len() <= 33 {
            landmark.observers.iter().for_each(|id| a.add_triplet(row, column(id), 1_u32));
            continue;
        }
        let age = |id: &EntityId| (map.keyframes().get(id).unwrap().added_revision, *id);
        let mut observers: Vec<_> = landmark.observers.iter().map(age).collect();
        observers.sort_unstable();
        for (index, &(_, a)) in observers.iter().enumerate() {
            for &(_, b) in observers[index + 1..].iter().take(32) {
                *expected.entry((a.min(b), a.max(b))).or_default() += 1;
            }
        }
    }
    let a: CsMat<u32> = a.to_csc();
    let product: CsMat<u32> = &a.transpose_view() * &a;
    for (&count, (i, j)) in product.iter().filter(|(count, (i, j))| i < j && **count > 0) {
        *expected.entry((ids[i], ids[j])).or_default() += count;
    }
    let pairs = map.keyframes().keys().flat_map(|&a| {
        let neighbors = map.covisibility().neighbors(a).filter(move |&(b, _)| a < b);
        neighbors.map(move |(b, count)| ((a, b), count))
    });
    let kept: Vec<_> = pairs.collect();
    assert_eq!(kept, expected.into_iter().collect::<Vec<_>>());
    assert_eq!(map.covisibility().entry_count(), 2 * kept.len() as u64);
}
