//! A map without measured lengths that becomes part of one in another unit: what comes with it, what its
//! robot sends from then on, and what it is when it leaves again.

use std::collections::BTreeMap;

use covis::map::{
    Change, ClientIndex, Constraint, ConstraintKind, Depth, EntityId, EntityRef, Item,
    ItemLandmark, Link, Map, MapPolicy, MeasuredPosition, MergeError, Prior, Reason,
};
use covis_solvers::geometry::{LieGroup, Se3, Sim3, So3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use nalgebra::{Matrix3, SMatrix, Vector3};

use crate::map_support::{
    Journal, ROBOT, corner, fix, id, landmark, observe, pixel, pose_at, pose_error, relative_pose,
    street, street_keyframe,
};

/// Length of a meter in the robot's unit.
const UNIT: f64 = 0.37;
/// Where the robot's client stands in the merged map.
const GUEST: ClientIndex = ClientIndex(1);

fn guest(id: i64) -> EntityId {
    EntityId::new(GUEST, id)
}

fn in_unit(pose: &Se3) -> Se3 {
    Se3::new(pose.rotation, pose.translation * UNIT)
}

/// An item of the street as a robot sends it that measures in its own unit.
fn sent(item: Item) -> Item {
    let scaled = |landmarks: Vec<ItemLandmark>| {
        let of = |l: ItemLandmark| ItemLandmark { position: l.position.map(|p| p * UNIT), ..l };
        landmarks.into_iter().map(of).collect()
    };
    let Item::Keyframe {
        id,
        capture_time_ns,
        camera,
        world_from_camera,
        odom_from_camera,
        observations,
        landmarks,
        global_descriptor,
    } = item
    else {
        return item;
    };
    Item::Keyframe {
        id,
        capture_time_ns,
        camera,
        world_from_camera: in_unit(&world_from_camera),
        odom_from_camera: odom_from_camera.map(|odom| in_unit(&odom)),
        observations,
        landmarks: scaled(landmarks),
        global_descriptor,
    }
}

fn target_from_source() -> Sim3 {
    let turn = So3::exp(&Vector3::new(0.1, -0.4, 1.2));
    Sim3::new(turn, Vector3::new(10.0, -3.0, 0.5), 1.0 / UNIT)
}

/// Information without a structure that a mistake could hide behind.
fn information<const N: usize>() -> Information<N> {
    let root = SMatrix::<f64, N, N>::from_fn(|i, j| {
        if i == j { 20.0 + i as f64 } else { ((3 * i + 5 * j) % 7) as f64 - 3.0 }
    });
    let matrix = root * root.transpose();
    Information::new(&((matrix + matrix.transpose()) * 0.5)).unwrap()
}

/// Five keyframes with a constraint and a prior that do not fit exactly.
fn source() -> Journal {
    let mut journal = Journal::new(MapPolicy::default());
    for index in 0..5 {
        let start = pose_at(index as f64 + 0.01 * (index * index) as f64);
        let item = sent(street_keyframe(index, start, &journal.map));
        journal.send(ROBOT, &item).unwrap();
    }
    let mut tie = relative_pose(7, ConstraintKind::Odometry, 0, 4, in_unit(&pose_at(5.0)));
    let Item::RelativePose { information: of, .. } = &mut tie else { panic!() };
    *of = information();
    journal.send(ROBOT, &tie).unwrap();
    let mut at = fix(8, 2, Vector3::new(2.2, 0.1, -0.1) * UNIT);
    let Item::PositionPrior { information: of, point_in_camera, .. } = &mut at else { panic!() };
    (*of, *point_in_camera) = (information(), Vector3::new(0.1, -0.2, 0.3) * UNIT);
    journal.send(ROBOT, &at).unwrap();
    journal
}

fn renamed() -> BTreeMap<String, String> {
    BTreeMap::from([("robot".to_owned(), "guest".to_owned())])
}

/// The street of a robot that measures meters, and the one above as its guest.
fn merged() -> (Journal, Map) {
    let mut target = street(4, MapPolicy::default());
    let source = source().map;
    let links = [Link {
        target: id(1),
        source: id(3),
        target_from_source: pose_at(0.25),
        information: Information::identity(),
    }];
    let merge =
        target.map.merge_of(("run", &source), target_from_source(), &renamed(), &links).unwrap();
    target.push(Change::MapMerged { merge: Box::new(merge) });
    (target, source)
}

/// What the guest sends.
fn give(target: &mut Journal, item: &Item) {
    let change = target.map.check(GUEST, item).unwrap();
    target.push(change);
}

/// χ² of a constraint at the map's poses.
fn tension(map: &Map, constraint: &Constraint) -> f64 {
    let pose = |id| map.keyframes().get(&id).unwrap().world_from_camera;
    let predicted = pose(constraint.keyframe_i).inverse().compose(&pose(constraint.keyframe_j));
    constraint.information.squared_norm(&predicted.minus(&constraint.keyframe_i_from_keyframe_j))
}

/// χ² of a prior at the map's pose.
fn strain(map: &Map, prior: &Prior) -> f64 {
    let pose = map.keyframes().get(&prior.keyframe()).unwrap().world_from_camera;
    match prior {
        Prior::Pose { world_from_camera, information, .. } => {
            information.squared_norm(&pose.minus(world_from_camera))
        }
        Prior::Position { position_in_world, point_in_camera, information, .. } => {
            information.squared_norm(&(pose.transform(point_in_camera) - position_in_world))
        }
    }
}

#[test]
fn what_comes_is_in_the_frame_and_unit_of_the_target() {
    let (target, source) = merged();
    let map = &target.map;
    map.check_sound().unwrap();
    assert_eq!([ROBOT, GUEST].map(|client| map.scale_of(client)), [1.0, 1.0 / UNIT]);
    let at = target_from_source();
    for (&old, keyframe) in source.keyframes() {
        let new = map.keyframes().get(&guest(old.id)).unwrap();
        let expected = at.transform_pose(&keyframe.world_from_camera);
        assert!(pose_error(&new.world_from_camera, &expected) < 1e-12);
        // What the robot walked is as long as in the world.
        let (odom, way) = (&new.odom_from_camera, keyframe.odom_from_camera.translation / UNIT);
        assert!((odom.translation - way).norm() < 1e-12);
    }
    for (&old, landmark) in source.landmarks() {
        let new = map.landmarks().get(&guest(old.id)).unwrap();
        let expected = at.transform(&landmark.position.unwrap());
        assert!((new.position.unwrap() - expected).norm() < 1e-12);
        assert_eq!(new.sent_position, landmark.sent_position);
    }
    // The closure was measured in the target's unit.
    let closure = map.constraints().values().find(|c| c.keyframe_i == id(1)).unwrap();
    assert_eq!(closure.keyframe_i_from_keyframe_j, pose_at(0.25));
}

#[test]
fn what_was_measured_is_as_far_from_the_map_in_standard_deviations_as_before() {
    let (target, source) = merged();
    let tie = |map: &Map, id| *map.constraints().get(&id).unwrap();
    let (before, after) = (tie(&source, id(7)), tie(&target.map, guest(7)));
    let chi2 = tension(&source, &before);
    assert!(chi2 > 1.0, "{chi2}");
    assert!((tension(&target.map, &after) / chi2 - 1.0).abs() < 1e-9);
    let prior = |map: &Map, id| *map.priors().get(&id).unwrap();
    let chi2 = strain(&source, &prior(&source, id(8)));
    assert!(chi2 > 1.0, "{chi2}");
    assert!((strain(&target.map, &prior(&target.map, guest(8))) / chi2 - 1.0).abs() < 1e-9);
    // A covariance of lengths grows with the square of the unit, one of angles stays.
    let covariance = |c: &Constraint| *c.information.covariance().unwrap().matrix();
    let (before, after) = (covariance(&before), covariance(&after));
    for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
        let lengths = i32::from(i < 3) + i32::from(j < 3);
        let expected = before[(i, j)] * UNIT.powi(-lengths);
        assert!((after[(i, j)] - expected).abs() < 1e-9 * after.amax(), "{i} {j}");
    }
}

/// All that a robot sends has the length in the map that it has in the world.
#[test]
fn a_robot_goes_on_in_its_own_unit() {
    let (mut target, _) = merged();
    let at = target_from_source();
    let rigid = at.rigid();
    // It has not heard of the merge, then it has.
    for (index, knows) in [(5, false), (6, true)] {
        let pose = pose_at(index as f64);
        let mut item = sent(street_keyframe(index, pose, &Map::new()));
        let Item::Keyframe { world_from_camera, odom_from_camera, landmarks, observations, .. } =
            &mut item
        else {
            panic!()
        };
        *odom_from_camera = Some(in_unit(&pose));
        if knows {
            // As a watch tells it: the frame in its own unit.
            let newest = target.map.newest_keyframe(GUEST).unwrap().1.map_from_odom();
            let frame = Se3::new(newest.rotation, newest.translation * UNIT);
            *world_from_camera = frame.compose(&in_unit(&pose));
            for landmark in landmarks.iter_mut() {
                landmark.position = landmark.position.map(|point| frame.transform(&point));
            }
        }
        // What the map has already is repeated as it was sent.
        landmarks.retain(|new| !target.map.landmarks().contains_key(&guest(new.id)));
        let again = ItemLandmark { id: 21, position: landmark(21).position.map(|p| p * UNIT) };
        landmarks.push(again);
        let depth = Depth { depth_m: 7.0 * UNIT, sigma_m: 0.1 * UNIT };
        observations[0].depth = Some(depth);
        give(&mut target, &item);
        let map = &target.map;
        assert!(map.holds(GUEST, &item));
        let keyframe = map.keyframes().get(&guest(index)).unwrap();
        let expected = rigid.compose(&pose);
        assert!(pose_error(&keyframe.world_from_camera, &expected) < 0.05, "{index}: {knows}");
        assert!(pose_error(&keyframe.odom_from_camera, &pose) < 1e-12);
        let depth = keyframe.observations[0].depth.unwrap();
        assert!((depth.depth_m - 7.0).abs() + (depth.sigma_m - 0.1).abs() < 1e-12);
        let last = keyframe.observations.iter().map(|seen| seen.landmark).max().unwrap();
        let position = map.landmarks().get(&last).unwrap().position.unwrap();
        assert!((position - rigid.transform(&corner(last.id))).norm() < 0.05);
    }
    let alone = ItemLandmark { id: 900, position: Some(Vector3::new(1.0, 2.0, 3.0) * UNIT) };
    give(&mut target, &Item::Landmarks { landmarks: vec![alone] });
    let position = target.map.landmarks().get(&guest(900)).unwrap().position.unwrap();
    assert!((position - Vector3::new(1.0, 2.0, 3.0)).norm() < 1e-12);
    let mut tie = relative_pose(50, ConstraintKind::Other, 4, 5, in_unit(&pose_at(1.1)));
    let Item::RelativePose { information: of, .. } = &mut tie else { panic!() };
    *of = information();
    give(&mut target, &tie);
    let tie = target.map.constraints().get(&guest(50)).unwrap();
    assert!(pose_error(&tie.keyframe_i_from_keyframe_j, &pose_at(1.1)) < 1e-12);
    let weight = information::<6>().matrix()[(0, 0)];
    assert!((tie.information.matrix()[(0, 0)] / (weight * UNIT * UNIT) - 1.0).abs() < 1e-12);
    assert_eq!(tie.information.matrix()[(4, 5)], information::<6>().matrix()[(4, 5)]);
    let prior = Item::PosePrior {
        id: 51,
        keyframe: EntityRef::own(5),
        world_from_camera: in_unit(&pose_at(3.0)),
        information: information(),
        loss: Loss::Trivial,
    };
    give(&mut target, &prior);
    give(&mut target, &fix(52, 5, Vector3::new(4.0, 5.0, 6.0) * UNIT));
    let prior = |id| *target.map.priors().get(&guest(id)).unwrap();
    let Prior::Pose { world_from_camera, information: of, .. } = prior(51) else { panic!() };
    assert!(pose_error(&world_from_camera, &pose_at(3.0)) < 1e-12);
    assert!((of.matrix()[(0, 0)] / (weight * UNIT * UNIT) - 1.0).abs() < 1e-12);
    let Prior::Position { position_in_world, information: of, .. } = prior(52) else { panic!() };
    assert!((position_in_world - Vector3::new(4.0, 5.0, 6.0)).norm() < 1e-12);
    assert!((of.matrix() - Matrix3::identity() * (1e4 * UNIT * UNIT)).norm() < 1e-8);
    target.map.check_sound().unwrap();
    // The robot that measures meters is not touched.
    target.send(ROBOT, &street_keyframe(4, pose_at(4.0), &target.map.clone())).unwrap();
    let own = target.map.keyframes().get(&id(4)).unwrap();
    assert_eq!(own.odom_from_camera, pose_at(4.0));
    assert_eq!(Map::replay(target.events.iter()).unwrap().state_hash(), target.map.state_hash());
}

#[test]
fn an_undo_gives_the_map_back_in_its_own_unit() {
    let (mut target, source) = merged();
    let pose = pose_at(5.0);
    let mut item = sent(street_keyframe(5, pose, &Map::new()));
    let Item::Keyframe { landmarks, observations, .. } = &mut item else { panic!() };
    landmarks.retain(|new| !source.landmarks().contains_key(&id(new.id)));
    observations[0].depth = Some(Depth { depth_m: 2.5, sigma_m: 0.1 });
    give(&mut target, &item);
    let out = target.map.taken_out("run").unwrap().unwrap();
    out.check_sound().unwrap();
    assert_eq!(out.scale_of(ROBOT), 1.0);
    for (id, keyframe) in source.keyframes() {
        let new = out.keyframes().get(id).unwrap();
        assert!(pose_error(&new.world_from_camera, &keyframe.world_from_camera) < 1e-12);
        assert!(pose_error(&new.odom_from_camera, &keyframe.odom_from_camera) < 1e-12);
    }
    for (id, landmark) in source.landmarks() {
        let new = out.landmarks().get(id).unwrap();
        assert!((new.position.unwrap() - landmark.position.unwrap()).norm() < 1e-12);
        assert_eq!(new.sent_position, landmark.sent_position);
    }
    let new = out.keyframes().get(&id(5)).unwrap();
    assert!(pose_error(&new.world_from_camera, &in_unit(&pose)) < 0.02);
    let depth = new.observations[0].depth.unwrap();
    assert!((depth.depth_m - 2.5).abs() < 1e-12 && (depth.sigma_m - 0.1).abs() < 1e-12);
    let chi2 = |map: &Map| {
        let (tie, prior) = (map.constraints().get(&id(7)), map.priors().get(&id(8)));
        tension(map, tie.unwrap()) + strain(map, prior.unwrap())
    };
    assert!((chi2(&out) / chi2(&source) - 1.0).abs() < 1e-9);
    target.push(Change::MapTakenOut { name: "run".to_owned(), clients_leave: true });
    assert_eq!(target.map.scale_of(GUEST), 1.0);
    assert_eq!(Map::replay(target.events.iter()).unwrap(), target.map);
    // It goes on in its own map as ever: what it repeats is what it sent.
    let again = ItemLandmark { id: 21, position: landmark(21).position.map(|p| p * UNIT) };
    let change = out.check(ROBOT, &Item::Landmarks { landmarks: vec![again] }).unwrap();
    assert!(matches!(change, Change::LandmarksAdded { scale, .. } if scale == 1.0));
}

#[test]
fn scales_of_maps_in_maps_multiply() {
    let (middle, _) = merged();
    let mut outer = Journal::new(MapPolicy::default());
    let names = BTreeMap::from([("robot".to_owned(), "host".to_owned())]);
    let twice = Sim3 { scale: 2.0, ..Sim3::identity() };
    let merge = outer.map.merge_of(("floor", &middle.map), twice, &names, &[]).unwrap();
    outer.push(Change::MapMerged { merge: Box::new(merge) });
    assert_eq!([1, 2].map(|k| outer.map.scale_of(ClientIndex(k))), [2.0, 2.0 / UNIT]);
    let [inner, _] = outer.map.merged() else { panic!() };
    assert!((inner.target_from_source.scale * UNIT - 2.0).abs() < 1e-12);
    let out = outer.map.taken_out("floor").unwrap().unwrap();
    let run = out.merged_as("run").unwrap();
    assert!(run.target_from_source.minus(&target_from_source()).norm() < 1e-12);
    assert_eq!([ROBOT, GUEST].map(|client| out.scale_of(client)), [1.0, 1.0 / UNIT]);
}

#[test]
fn lengths_that_were_measured_keep_their_scale() {
    let target = street(2, MapPolicy::default()).map;
    let scaled = Sim3 { scale: 1.01, ..Sim3::identity() };
    let merge =
        |source: &Map, at: Sim3| target.merge_of(("run", source), at, &renamed(), &[]).map(drop);
    let refused = Err(MergeError::Scaled { scale: "1.01".to_owned() });
    let mut journal = street(3, MapPolicy::default());
    assert!(!journal.map.has_metric_scale());
    // One position holds the frame and measures no length, nor do two that may be one.
    for (number, x) in [(0, 0.0), (1, 0.01)] {
        journal.send(ROBOT, &fix(number, number, Vector3::new(x, 0.0, 0.0))).unwrap();
        assert_eq!(merge(&journal.map, scaled), Ok(()));
    }
    journal.send(ROBOT, &fix(2, 2, Vector3::new(2.0, 0.0, 0.0))).unwrap();
    assert!(journal.map.has_metric_scale());
    assert_eq!(merge(&journal.map, scaled), refused);
    assert_eq!(merge(&journal.map, Sim3::identity()), Ok(()));
    let mut journal = street(3, MapPolicy::default());
    let mut seen = observe(55, &pose_at(2.0), &corner(55));
    seen.pixel = pixel(seen.pixel.x + 1.0, seen.pixel.y);
    seen.landmark = EntityRef::own(5);
    seen.depth = Some(Depth { depth_m: 7.0, sigma_m: 0.1 });
    let keyframe = EntityRef::own(0);
    journal.send(ROBOT, &Item::Observations { keyframe, observations: vec![seen] }).unwrap();
    assert_eq!(merge(&journal.map, scaled), refused);
}

#[test]
fn scales_and_numbers_that_overflow_are_refused() {
    let source = source().map;
    let mut target = street(2, MapPolicy::default());
    for scale in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e10, 1e-10] {
        let at = Sim3 { scale, ..Sim3::identity() };
        let refused = target.map.merge_of(("run", &source), at, &renamed(), &[]);
        assert_eq!(refused.map(drop), Err(MergeError::OutOfRange), "{scale}");
    }
    let at = Sim3 { scale: 1e6, ..Sim3::identity() };
    let merge = target.map.merge_of(("run", &source), at, &renamed(), &[]).unwrap();
    target.push(Change::MapMerged { merge: Box::new(merge) });
    let far = Vector3::new(1e303, 0.0, 0.0);
    let field = |item: &Item| {
        let refused = target.map.check(GUEST, item).unwrap_err();
        let violation = &refused.violations[0];
        assert_eq!(violation.reason, Reason::OutOfRange);
        violation.field.clone()
    };
    let landmarks = vec![ItemLandmark { id: 901, position: Some(far) }];
    assert_eq!(field(&Item::Landmarks { landmarks }), "landmarks.landmarks[0].position");
    let keyframe = |pose: Vector3<f64>, odom: Vector3<f64>| Item::Keyframe {
        id: 99,
        capture_time_ns: 99,
        camera: None,
        world_from_camera: Se3::new(So3::identity(), pose),
        odom_from_camera: Some(Se3::new(So3::identity(), odom)),
        observations: Vec::new(),
        landmarks: Vec::new(),
        global_descriptor: None,
    };
    assert_eq!(field(&keyframe(far, Vector3::zeros())), "keyframe.world_from_camera");
    assert_eq!(field(&keyframe(Vector3::zeros(), far)), "keyframe.odom_from_camera");
    let at = Se3::new(So3::identity(), far);
    let tie = relative_pose(60, ConstraintKind::Other, 0, 1, at);
    assert_eq!(field(&tie), "relative_pose.keyframe_i_from_keyframe_j");
    let mut tie = relative_pose(60, ConstraintKind::Other, 0, 1, pose_at(1.0));
    let Item::RelativePose { information: of, .. } = &mut tie else { panic!() };
    *of = of.scaled(1e-320);
    assert_eq!(field(&tie), "relative_pose.information");
    assert_eq!(field(&fix(61, 0, far)), "position_prior.point_in_world");
    let mut at = fix(61, 0, Vector3::zeros());
    let Item::PositionPrior { point_in_camera, .. } = &mut at else { panic!() };
    *point_in_camera = far;
    assert_eq!(field(&at), "position_prior.point_in_camera");
}

/// A place on the Earth is in meters, whatever the robot's unit.
#[test]
fn a_geodetic_position_is_not_scaled() {
    let point = covis_solvers::geometry::Geodetic {
        latitude_deg: 48.0,
        longitude_deg: 9.0,
        height_m: 400.0,
    };
    let policy = MapPolicy { geodetic_anchor: Some(point), ..MapPolicy::default() };
    let mut target = street(2, policy);
    let source = street(2, policy).map;
    let at = target_from_source();
    let merge = target.map.merge_of(("run", &source), at, &renamed(), &[]).unwrap();
    target.push(Change::MapMerged { merge: Box::new(merge) });
    let mut item = fix(9, 1, Vector3::zeros());
    let Item::PositionPrior { position: at, .. } = &mut item else { panic!() };
    let higher = covis_solvers::geometry::Geodetic { height_m: 410.0, ..point };
    *at = MeasuredPosition::OnEarth(higher);
    give(&mut target, &item);
    let prior = target.map.priors().get(&guest(9)).unwrap();
    let Prior::Position { position_in_world, information, .. } = prior else { panic!() };
    assert!((position_in_world - Vector3::new(0.0, 0.0, 10.0)).norm() < 1e-6);
    assert!((information.matrix() - Matrix3::identity() * 1e4).norm() < 1e-8);
}
