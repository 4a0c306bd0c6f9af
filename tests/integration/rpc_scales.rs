//! Maps of cameras without depth: each has a unit of its own, and merging finds how long it is. The robot
//! goes on in its unit, through the real client.

use std::collections::BTreeMap;

use covis::client::{Client, IngestSession, MapWatch, SessionOptions, WatchOptions};
use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::relative_motion::PointEstimate;
use covis_solvers::similarity::{Pair, Similarity, estimate};
use nalgebra::{Matrix3, Vector3};
use tonic::Code;
use v1::ingest_request::Item;

use crate::common::{TestServer, check_field, check_status, run, shift};
use crate::made_sequence::{Course, Made};
use crate::merge_support::{
    POINTS, all_done, copy, get, merge, poses, quickly, ring, robot, walk, walk_in, walker,
};
use crate::rpc_places::{around, twins};
use crate::sequence::{Order, Sequence, items, pose, transform};

/// What a camera without depth makes of a sequence: its meter has `unit` of its lengths.
fn monocular(mut made: Made, unit: f64) -> Made {
    for row in made.sequence.observations.iter_mut().flatten() {
        row[3] = 0.0;
    }
    in_unit(&mut made.sequence, unit);
    made
}

/// As of a robot that takes `unit` for a meter.
fn in_unit(sequence: &mut Sequence, unit: f64) {
    for (_, pose) in &mut sequence.odometry {
        pose.translation *= unit;
    }
    for row in sequence.observations.iter_mut().flatten() {
        row[3] *= unit;
        row[5] *= unit;
    }
}

/// The positions of a map's landmarks by client and id.
async fn landmarks(server: &TestServer, map: &str) -> BTreeMap<(String, i64), Vector3<f64>> {
    let request = v1::WatchMapRequest { map_id: map.to_owned(), ..Default::default() };
    let mut watch = server.maps().watch_map(request).await.unwrap().into_inner();
    let mut landmarks = BTreeMap::new();
    loop {
        let delta = watch.message().await.unwrap().unwrap().delta.unwrap();
        for landmark in delta.landmarks {
            let Some(v1::Vector3 { x, y, z }) = landmark.point_in_world else { continue };
            landmarks.insert((landmark.client_id, landmark.id), Vector3::new(x, y, z));
        }
        if delta.last_part {
            return landmarks;
        }
    }
}

/// The similarity that takes most of some points to others within 3 cm.
fn aligned(points: &[(Vector3<f64>, Vector3<f64>)]) -> Similarity {
    let exact = |point: Vector3<f64>| PointEstimate { point, covariance: Matrix3::zeros() };
    let pair = |&(source, target): &(Vector3<f64>, Vector3<f64>)| Pair {
        source: exact(source),
        target: PointEstimate { point: target, covariance: Matrix3::identity() * 0.015 * 0.015 },
    };
    estimate(&points.iter().map(pair).collect::<Vec<_>>(), 1).unwrap()
}

/// Median distance of each robot's landmarks from the truth, m, after one similarity of all of them.
async fn errors<const N: usize>(server: &TestServer, map: &str, made: [&Made; N]) -> [f64; N] {
    let truth = ring(0).positions(POINTS);
    let found = landmarks(server, map).await;
    let of = |number: usize| -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let own = found.iter().filter(|((client, _), _)| *client == robot(number));
        own.map(|((_, id), &at)| (at, truth[made[number].point_of[id]])).collect()
    };
    let pairs: [_; N] = std::array::from_fn(of);
    let truth_from_map = aligned(&pairs.concat()).target_from_source;
    pairs.map(|pairs| {
        let distance = |(at, truth): &(Vector3<f64>, Vector3<f64>)| {
            (truth_from_map.transform(at) - truth).norm()
        };
        let mut distances: Vec<f64> = pairs.iter().map(distance).collect();
        distances.sort_by(f64::total_cmp);
        distances[distances.len() / 2]
    })
}

/// How long a meter is in a map, by the positions of a robot's keyframes.
async fn unit_of(server: &TestServer, map: &str, client: &str, made: &Made) -> f64 {
    unit_in(&poses(server, map).await, client, made)
}

/// The same of one revision of a map.
fn unit_in(poses: &BTreeMap<(String, i64), Se3>, client: &str, made: &Made) -> f64 {
    let own = poses.iter().filter(|((name, _), _)| name == client);
    let pairs: Vec<_> = own
        .map(|((_, id), pose)| (pose.translation, made.sequence.truth[*id as usize].translation))
        .collect();
    1.0 / aligned(&pairs).target_from_source.scale
}

/// A robot at work, which knows the map as its watch tells it.
struct AtWork {
    session: IngestSession,
    watch: MapWatch,
    name: String,
}

impl AtWork {
    async fn on(server: &TestServer, map: &str, name: &str) -> Self {
        let address = format!("http://{}", server.running.local_addr());
        let client = Client::connect(&address).await.unwrap();
        let options = SessionOptions { retry: quickly(), ..SessionOptions::default() };
        let session = client.ingest(map, name, options).await.unwrap();
        let options = WatchOptions { retry: quickly(), ..WatchOptions::default() };
        let watch = client.watch(map, options).await.unwrap();
        Self { session, watch, name: name.to_owned() }
    }

    /// Sends items of its own unit, each keyframe from where `frame` says that it is.
    async fn send(&mut self, items: &[Item], frame: Option<&Se3>) {
        for item in items {
            let mut item = item.clone();
            if let (Item::Keyframe(keyframe), Some(frame)) = (&mut item, frame) {
                let odometry = se3(keyframe.odom_from_camera.as_ref().unwrap());
                keyframe.world_from_camera = Some(transform(&frame.compose(&odometry)));
            }
            self.session.send(item).await.unwrap();
        }
        self.session.flush().await.unwrap();
    }

    /// Waits until its watch tells it of a scale that is `wanted`; the frame and the scale then.
    async fn told(&mut self, wanted: impl Fn(f64) -> bool) -> (Se3, f64) {
        loop {
            let mirror = self.watch.mirror();
            if let (Some(frame), scale) =
                (mirror.map_from_odom(&self.name), mirror.scale(&self.name))
                && wanted(scale)
            {
                return (se3(frame), scale);
            }
            self.watch.next().await.unwrap();
        }
    }
}

fn se3(message: &v1::RigidTransform) -> Se3 {
    let (t, q) = (message.translation.unwrap(), message.rotation.unwrap());
    pose(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w])
}

const UNIT: f64 = 0.37;

/// A robot without depth whose map becomes part of that of another robot while both are at work, and
/// leaves it again.
#[allow(clippy::print_stdout, reason = "decision 34 has these figures")]
async fn merged_with(host: &Made) {
    let server = TestServer::lock_step().await;
    for map in ["run-0", "run-1"] {
        server.create_map(map).await;
    }
    walk(&server, "run-0", &robot(0), &host.sequence).await;
    let guest = monocular(walker(5, 2), UNIT);
    let items = items(&guest.sequence, &[], Order::Streamed);
    let mut at_work = AtWork::on(&server, "run-1", &robot(1)).await;
    let (first, then, last) = (items.len() / 2, items.len() / 2 + 3, items.len() - 3);
    at_work.send(&items[..first], None).await;
    assert_eq!(at_work.told(|_| true).await.1, 1.0);
    // Local bundle adjustment without depth drifts in scale: a meter has another length at each end of the
    // guest's way. This is the length that fits its keyframes best.
    let before = unit_of(&server, "run-1", &robot(1), &guest).await;
    let [alone] = errors(&server, "run-0", [host]).await;
    println!("landmarks of the host alone: {:.1} mm", 1e3 * alone);
    let in_host = unit_of(&server, "run-0", &robot(0), host).await;
    let merged = server.maps().merge_maps(merge("run-0", "run-1")).await.unwrap().into_inner();
    let (scale, expected) = (merged.scale, in_host / before);
    println!("scale {scale:.4} of {expected:.4}, {} closures", merged.closure_count);
    println!("a meter is {in_host:.4} long in the host, {before:.4} in the guest");
    assert!((scale / expected - 1.0).abs() < 0.025, "{scale} {expected}");
    assert!(merged.closure_count >= 3, "{merged:?}");
    let map = merged.map.unwrap();
    assert_eq!(map.merged_maps[0].scale, merged.scale);
    let scales: Vec<f64> = map.clients.iter().map(|client| client.scale).collect();
    assert_eq!(scales, [1.0, merged.scale]);
    // Keyframes of the frame before, then of what it was told.
    at_work.send(&items[first..then], None).await;
    let (frame, told) = at_work.told(|scale| scale != 1.0).await;
    assert_eq!(told, merged.scale);
    at_work.send(&items[then..last], Some(&frame)).await;
    all_done(&server, "run-0", &robot(0)).await;
    let [own, other] = errors(&server, "run-0", [host, &guest]).await;
    println!("landmarks: {:.1} mm of the host, {:.1} mm of the guest", 1e3 * own, 1e3 * other);
    assert!(own < 1.2 * alone && other < 1.2 * alone, "{own} {other} of {alone} m");
    // Both robots' keyframes are in one unit: landmarks that both see say more than the places at the merge.
    // They are read at once: the next adjustment may move both.
    let poses = poses(&server, "run-0").await;
    let units = [unit_in(&poses, &robot(0), host), unit_in(&poses, &robot(1), &guest)];
    println!("a meter is {:.4} and {:.4} long", units[0], units[1]);
    assert!((units[1] / units[0] - 1.0).abs() < 0.005, "{units:?}");
    let undo =
        v1::UndoMergeRequest { map_id: "run-0".to_owned(), source_map_id: "run-1".to_owned() };
    server.maps().undo_merge(undo).await.unwrap();
    let (frame, _) = at_work.told(|scale| scale == 1.0).await;
    at_work.send(&items[last..], Some(&frame)).await;
    let after = unit_of(&server, "run-1", &robot(1), &guest).await;
    println!("a meter of the guest is {before:.4} long before and {after:.4} after");
    // Lengths that nothing measures drift; the unit is the one before, and not that of the host.
    assert!((after / before - 1.0).abs() < 0.02, "{after}");
    let report = at_work.session.finish().await.unwrap();
    assert_eq!((report.rejected, report.unanswered()), (0, 0));
    let counts = get(&server, "run-1").await.counts.unwrap();
    assert_eq!(counts.keyframe_count, guest.sequence.truth.len() as i64);
}

#[test]
fn a_robot_without_depth_joins_one_with_depth_and_goes_on_in_its_own_unit() {
    run(merged_with(&walker(0, 1)));
}

#[test]
fn two_robots_without_depth_become_one_map() {
    run(merged_with(&monocular(walker(0, 1), 1.0)));
}

/// Creates a map of what a robot saw.
async fn build(server: &TestServer, map: &str, client: &str, made: &Made) {
    server.create_map(map).await;
    walk(server, map, client, &made.sequence).await;
}

#[test]
fn the_scale_of_two_maps_with_depth_is_an_error_and_no_freedom() {
    run(async {
        let server = TestServer::lock_step().await;
        build(&server, "run-0", &robot(0), &walker(0, 1)).await;
        let mut wrong = walker(5, 2);
        in_unit(&mut wrong.sequence, 0.8);
        build(&server, "run-1", &robot(1), &wrong).await;
        build(&server, "run-2", &robot(2), &monocular(walker(8, 3), 1.0)).await;
        let refused = async |request| server.maps().merge_maps(request).await.unwrap_err();
        let status = refused(merge("run-0", "run-1")).await;
        check_status(&status, Code::FailedPrecondition, "NOT_ALIGNED");
        // Only a map that measures no lengths is scaled.
        let status = refused(merge("run-2", "run-1")).await;
        check_status(&status, Code::FailedPrecondition, "TARGET_WITHOUT_SCALE");
        assert!(status.message().contains("into the source"), "{status:?}");
        let placed = |source: &str, scale| v1::MergeMapsRequest {
            target_from_source: Some(shift([1.0, 0.0, 0.0])),
            scale,
            ..merge("run-0", source)
        };
        let status = refused(placed("run-1", 1.25)).await;
        check_status(&status, Code::FailedPrecondition, "SCALE_MEASURED");
        for scale in [-1.0, 1e-7, 1e7, 1e300, f64::NAN, f64::INFINITY, f64::MIN_POSITIVE] {
            check_field(&refused(placed("run-2", scale)).await, "scale", "OUT_OF_RANGE");
        }
        let found = v1::MergeMapsRequest { scale: 2.0, ..merge("run-0", "run-2") };
        check_field(&refused(found).await, "scale", "INCONSISTENT");
        // Who knows better says so.
        let merged = server.maps().merge_maps(placed("run-2", 2.0)).await.unwrap().into_inner();
        assert_eq!((merged.scale, merged.closure_count), (2.0, 0));
        let again = server.maps().merge_maps(merge("run-0", "run-2")).await.unwrap().into_inner();
        assert_eq!(again.scale, 2.0);
    });
}

#[test]
fn constraints_of_the_caller_are_in_the_unit_of_the_target() {
    run(async {
        let server = TestServer::lock_step().await;
        build(&server, "run-0", &robot(0), &walker(0, 1)).await;
        let guest = monocular(walker(0, 2), UNIT);
        build(&server, "run-1", &robot(1), &guest).await;
        // Both walked the same way.
        let named = |number: usize, id| Some(v1::KeyframeRef { client_id: robot(number), id });
        let constraint = v1::RelativePoseConstraint {
            keyframe_i: named(0, 20),
            keyframe_j: named(1, 20),
            keyframe_i_from_keyframe_j: Some(shift([0.0; 3])),
            information: Some(crate::common::information6(1e4)),
            ..Default::default()
        };
        let request = v1::MergeMapsRequest {
            constraints: vec![constraint],
            scale: 1.0 / UNIT,
            ..merge("run-0", "run-1")
        };
        let merged = server.maps().merge_maps(request).await.unwrap().into_inner();
        assert_eq!((merged.scale, merged.closure_count), (1.0 / UNIT, 1));
        let found = poses(&server, "run-0").await;
        for id in [0, 10, 30] {
            let [a, b] = [0, 1].map(|number| found[&(robot(number), id)]);
            assert!((a.translation - b.translation).norm() < 0.1, "{id}: {a:?} {b:?}");
        }
    });
}

/// A room is in each of its twins as well, with a scale or without.
#[test]
fn a_map_is_not_merged_where_two_rooms_look_alike() {
    run(async {
        let server = TestServer::lock_step().await;
        let floor = Course { calibration_error: 0.0, ..twins() };
        // Its keyframes stand between those of the floor in either room.
        let room = Course { way: around(0.0).collect(), step_m: 0.13, ..floor.clone() };
        let (host, guest) = (walk_in(&floor, 1), walk_in(&room, 2));
        build(&server, "floor", &robot(0), &host).await;
        build(&server, "room", &robot(1), &guest).await;
        build(&server, "unscaled-room", &robot(2), &monocular(guest, UNIT)).await;
        build(&server, "unscaled-floor", &robot(3), &monocular(host, 1.0)).await;
        for (target, source) in
            [("floor", "room"), ("floor", "unscaled-room"), ("unscaled-floor", "unscaled-room")]
        {
            let status = server.maps().merge_maps(merge(target, source)).await.unwrap_err();
            check_status(&status, Code::FailedPrecondition, "NOT_ALIGNED");
        }
    });
}

/// A server that dies finds all of it in its journal: scale, content and what came since, to the bit.
#[test]
fn a_scaled_map_is_the_same_after_a_server_died() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let (data, after) = (folder.path().join("data"), folder.path().join("after"));
        let server = lock_step(&data).await;
        for (number, map) in ["floor", "run"].into_iter().enumerate() {
            server.create_map(map).await;
            let mut at_work = AtWork::on(&server, map, &robot(number)).await;
            let items: Vec<Item> = std::iter::once(Item::Camera(crate::common::camera(0)))
                .chain((0..4).map(|id| Item::Keyframe(crate::common::keyframe(id))))
                .collect();
            at_work.send(&items, None).await;
            at_work.session.finish().await.unwrap();
        }
        let request = v1::MergeMapsRequest {
            target_from_source: Some(shift([10.0, 0.0, 0.0])),
            scale: 2.5,
            ..merge("floor", "run")
        };
        server.maps().merge_maps(request).await.unwrap();
        let mut at_work = AtWork::on(&server, "run", &robot(1)).await;
        let later: Vec<Item> =
            (4..6).map(|id| Item::Keyframe(crate::common::keyframe(id))).collect();
        at_work.send(&later, None).await;
        at_work.session.finish().await.unwrap();
        let state = async |server: &TestServer| {
            let request = v1::GetMapRequest { map_id: "floor".to_owned(), ..Default::default() };
            let answer = server.maps().get_map(request).await.unwrap().into_inner();
            let scale = answer.map.unwrap().clients[1].scale;
            (answer.state_hash, scale)
        };
        let expected = state(&server).await;
        assert_eq!(expected.1, 2.5);
        // What a server leaves that is killed now.
        copy(&data, &after);
        let again = lock_step(&after).await;
        assert_eq!(state(&again).await, expected);
        // Without the client's scale it would be another map.
        let undo =
            v1::UndoMergeRequest { map_id: "floor".to_owned(), source_map_id: "run".to_owned() };
        again.maps().undo_merge(undo).await.unwrap();
        let apart = get(&again, "run").await;
        assert_eq!((apart.clients[0].scale, apart.counts.unwrap().keyframe_count), (1.0, 6));
    });
}

async fn lock_step(folder: &std::path::Path) -> TestServer {
    let folder = folder.to_owned();
    TestServer::with(|config| {
        config.data_dir = Some(folder);
        config.engine.lock_step = true;
    })
    .await
}
