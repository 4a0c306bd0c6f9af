//! `ExportMap` as g2o: the file is the pose graph that `OptimizeMap` solves.
//!
//! The scene: a camera with depth goes along a wall and back. Landmarks of the way back have new ids, so
//! that loop closures alone join the two ways; one of them is false. Errors are a fixed pattern.

use std::path::Path;

use covis::service::engine::Resource;
use covis::wire::v1;
use covis_solvers::evaluation::pose_graph_cost;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::io::g2o::{G2oGraph, G2oSe3};
use covis_solvers::optimizer;
use covis_solvers::pose_graph;
use nalgebra::Vector6;
use v1::ingest_request::Item;

use crate::common::{Stream, TestServer, camera, information6, occupy, run};
use crate::rpc_export::export;
use crate::sequence::{pose, transform};

/// Keyframes of one way.
const WAY: i64 = 24;
/// The landmarks that a keyframe sees are this far from it along the wall, in landmarks.
const SIGHT: i64 = 10;
/// The false closure, and its ends.
const FALSE: (i64, i64, i64) = (99, 3, 2 * WAY - 12);

fn wave(phase: i64) -> f64 {
    (1.7 * phase as f64).sin()
}

/// Where keyframe `k` is along the wall, in landmarks; they are 0.1 m apart.
fn place(k: i64) -> i64 {
    let k = if k < WAY { k } else { 2 * WAY - 1 - k };
    2 * k
}

fn true_pose(k: i64) -> Se3 {
    let turn = 0.02 * wave(k);
    Se3::exp(&Vector6::new(0.1 * place(k) as f64, 0.02 * wave(2 * k), 0.0, 0.0, turn, 0.0))
}

/// Where odometry has the keyframes: each step turns too far.
fn odometry() -> Vec<Se3> {
    let mut poses = vec![true_pose(0)];
    for k in 1..2 * WAY {
        let step = true_pose(k - 1).inverse().compose(&true_pose(k));
        let error = Vector6::new(0.004, 0.0, 0.002 * wave(k), 0.0, 0.004, 0.0);
        poses.push(poses[poses.len() - 1].compose(&step).plus(&error));
    }
    poses
}

fn keyframe(k: i64, odometry: &Se3) -> Item {
    let (pose, first) = (true_pose(k), if k < WAY { 0 } else { 1000 });
    let near = place(k) - SIGHT..place(k) + SIGHT;
    let mut landmarks = Vec::new();
    let observations = near.clone().flat_map(|l| [(l, 0), (l, 1)]).map(|(l, row)| {
        let id = first + 2 * (l + SIGHT) + row;
        let at = nalgebra::Vector3::new(
            0.1 * l as f64,
            row as f64 - 0.4 + 0.3 * wave(3 * l),
            3.0 + 0.4 * wave(5 * l + row),
        );
        let seen = pose.inverse().act(&at);
        landmarks.push(v1::Landmark { id, ..Default::default() });
        v1::Observation {
            landmark: Some(v1::LandmarkRef { id, ..Default::default() }),
            pixel: Some(v1::Vector2 {
                x: 500.0 * seen.x / seen.z + 319.5 + 0.4 * wave(7 * l + 3 * k),
                y: 500.0 * seen.y / seen.z + 239.5 + 0.4 * wave(11 * l + 5 * k),
            }),
            depth_m: Some(seen.z + 0.01 * wave(13 * l + 7 * k)),
            sigma_depth_m: Some(0.01),
            ..Default::default()
        }
    });
    let observations = observations.collect();
    // The map knows those that the keyframes before saw.
    let is_start = k % WAY == 0;
    let is_new = |id: i64| {
        let l = (id - first) / 2 - SIGHT;
        let before = place(k - 1) - SIGHT..place(k - 1) + SIGHT;
        is_start || !before.contains(&l)
    };
    landmarks.retain(|landmark| is_new(landmark.id));
    Item::Keyframe(v1::Keyframe {
        id: k,
        capture_time: Some(prost_types::Timestamp { seconds: 100 + k, nanos: 0 }),
        sensor: Some(v1::keyframe::Sensor::CameraId(0)),
        world_from_camera: Some(transform(odometry)),
        observations,
        landmarks,
        ..Default::default()
    })
}

fn closure(id: i64, i: i64, j: i64, i_from_j: &Se3) -> Item {
    let keyframe = |id| Some(v1::KeyframeRef { id, ..Default::default() });
    Item::RelativePose(v1::RelativePoseConstraint {
        id,
        keyframe_i: keyframe(i),
        keyframe_j: keyframe(j),
        keyframe_i_from_keyframe_j: Some(transform(i_from_j)),
        information: Some(information6(1e4)),
        kind: v1::ConstraintKind::LoopClosure.into(),
        ..Default::default()
    })
}

/// The map as it was sent: nothing is solved before it is asked for.
async fn build(server: &TestServer) {
    let policy = v1::MapPolicy {
        local_bundle_adjustment: Some(false),
        loop_closure_optimization: Some(false),
        // An adjustment after the requested solve would move the poses before they are exported.
        closure_adjustment: Some(false),
        ..Default::default()
    };
    server.create_map_with("wall", policy).await;
    let mut items = vec![Item::Camera(camera(0))];
    items.extend((0..).zip(&odometry()).map(|(k, pose)| keyframe(k, pose)));
    for i in (0..WAY - 4).step_by(3) {
        let j = 2 * WAY - 1 - i;
        let measured = true_pose(i).inverse().compose(&true_pose(j));
        let error = Vector6::repeat(0.005 * wave(i));
        items.push(closure(i, i, j, &measured.plus(&error)));
    }
    let (id, i, j) = FALSE;
    items.push(closure(id, i, j, &Se3::exp(&Vector6::new(0.1, 0.0, 0.0, 0.0, 0.0, 0.3))));
    let (stream, _) = Stream::open(server, "wall", "robot", 0).await;
    for (sequence, item) in (1..).zip(items) {
        stream.send(sequence, item).await;
    }
    for ack in stream.finish().await.unwrap() {
        assert!(ack.violations.is_empty(), "{ack:?}");
    }
}

async fn exported(server: &TestServer) -> G2oSe3 {
    let (_, files) = export(server, "wall", v1::MapFormat::G2o).await.unwrap();
    let G2oGraph::Se3(file) = G2oGraph::parse(&files[0].1, Path::new("wall")).unwrap() else {
        panic!("a graph in space");
    };
    file
}

/// The largest difference of the poses of a graph and of a map, in meters and radians.
fn apart(poses: &[Se3], map: &v1::MapDelta) -> f64 {
    assert_eq!(poses.len(), map.keyframes.len());
    let pairs = poses.iter().zip(&map.keyframes);
    let between = pairs.map(|(a, b)| {
        let b = b.world_from_camera.unwrap();
        let (t, q) = (b.translation.unwrap(), b.rotation.unwrap());
        a.inverse().compose(&pose(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w])).log().amax()
    });
    between.fold(0.0, f64::max)
}

#[test]
fn a_solved_g2o_export_has_the_poses_of_optimize_map() {
    run(async {
        let server = TestServer::start().await;
        build(&server).await;
        // Both solves go on to the optimum, so that they agree to what the file's digits, the
        // conditioning of the graph and the last step leave.
        let request = v1::OptimizeMapRequest {
            map_id: "wall".to_owned(),
            problem: v1::MapProblem::PoseGraph.into(),
            options: Some(v1::SolverOptions {
                function_tolerance: Some(1e-14),
                ..Default::default()
            }),
            ..Default::default()
        };
        let (_, result) = server.optimize_map(request).await.unwrap();
        let off = &result.switched_off_constraints;
        assert_eq!(off.len(), 1, "{off:?}");
        assert_eq!(off[0].constraint.as_ref().unwrap().id, FALSE.0);
        let map = server.watched("wall").await;

        let file = exported(&server).await;
        assert!(file.edges.iter().all(|edge| (edge.i, edge.j) != (FALSE.1, FALSE.2)));
        assert_eq!(file.edges.len() as i64, result.constraint_count - 1);
        assert_eq!(file.fixed, [0]);
        let mut graph = file.to_pose_graph().unwrap();
        assert!(apart(&graph.poses, &map) < 1e-12);
        let cost = pose_graph_cost(&graph).total;
        let solved = result.summary.unwrap().final_cost;
        assert!((cost - solved).abs() < 1e-9 * solved, "{cost} {solved}");

        // From odometry, which is far off.
        graph.poses = odometry();
        let start = apart(&graph.poses, &map);
        assert!(start > 0.1, "{start}");
        let optimizer = optimizer::Options { cost_tolerance: 1e-14, ..Default::default() };
        let options = pose_graph::Options { optimizer };
        pose_graph::solve(&mut graph, &options, &mut optimizer::ignore_iterations).unwrap();
        let end = apart(&graph.poses, &map);
        assert!(end < 1e-6, "{end}");
    });
}

#[test]
fn a_reader_that_leaves_a_g2o_export_gives_its_place_back_at_once() {
    run(async {
        let server = TestServer::start().await;
        build(&server).await;
        let pool = server.running.solver_pool();
        let exports = || pool.accounts().tenant("").held(Resource::Exports);
        // The pose graph waits for a thread.
        let busy = occupy(&server).await;
        let request = v1::ExportMapRequest {
            map_id: "wall".to_owned(),
            format: v1::MapFormat::G2o.into(),
            all_landmarks: false,
        };
        let mut maps = server.maps();
        let reader = tokio::spawn(async move {
            let mut stream = maps.export_map(request).await.unwrap().into_inner();
            stream.message().await.unwrap()
        });
        while exports() == 0 {
            server.watched("wall").await;
        }
        reader.abort();
        while exports() > 0 {
            server.watched("wall").await;
        }
        drop(busy);
        assert!(!exported(&server).await.edges.is_empty());
    });
}
