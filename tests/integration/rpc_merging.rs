//! Many runs, one map: robots that began at different places of one floor, each with a map of its own, or
//! all in one. Nobody says where they began; the server finds it by what they see.

use std::collections::BTreeSet;
use std::path::PathBuf;

use covis::client::{Client, SessionOptions, WatchOptions};
use covis::wire::v1;
use nalgebra::Vector3;
use tonic::Code;

use crate::common::{
    Stream, TestServer, check_field, check_status, keyframe, keyframe_position, run, shift,
};
use crate::merge_support::{
    all_done, copy, get, merge, on_disk, poses, quickly, robot, walk, walker,
};
use crate::sequence::{Sequence, adjusted};

/// How far the frames of the robots are from each other, m: the largest root mean square of the others'
/// positions where the first robot's positions are aligned with the truth.
async fn between_frames(server: &TestServer, map: &str, walks: &[Sequence]) -> f64 {
    let poses = poses(server, map).await;
    let of = |number: usize| -> Vec<Vector3<f64>> {
        let keyframes = 0..walks[number].truth.len() as i64;
        keyframes.map(|id| poses[&(robot(number), id)].translation).collect()
    };
    let truth = |number: usize| -> Vec<Vector3<f64>> {
        walks[number].truth.iter().map(|pose| pose.translation).collect()
    };
    let mean = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let (a, b) = (of(0), truth(0));
    let (mean_a, mean_b) = (mean(&a), mean(&b));
    let correlation: nalgebra::Matrix3<f64> =
        a.iter().zip(&b).map(|(a, b)| (b - mean_b) * (a - mean_a).transpose()).sum();
    let svd = correlation.svd(true, true);
    let (u, v) = (svd.u.unwrap(), svd.v_t.unwrap());
    let sign = Vector3::new(1.0, 1.0, (u * v).determinant().signum());
    let rotation = u * nalgebra::Matrix3::from_diagonal(&sign) * v;
    let error = |number: usize| {
        let pairs = of(number).into_iter().zip(truth(number));
        let squares: Vec<f64> =
            pairs.map(|(a, b)| (b - mean_b - rotation * (a - mean_a)).norm_squared()).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    (1..walks.len()).map(error).fold(0.0, f64::max)
}

#[test]
#[allow(clippy::print_stdout, reason = "docs/benchmarking.md has this figure")]
fn two_robots_of_one_floor_become_one_map() {
    run(async {
        let server = TestServer::lock_step().await;
        let walks = [walker(0, 1), walker(5, 2)].map(|made| made.sequence);
        for (number, walked) in walks.iter().enumerate() {
            server.create_map(&format!("run-{number}")).await;
            walk(&server, &format!("run-{number}"), &robot(number), walked).await;
        }
        let before = get(&server, "run-1").await;
        let merged = server.maps().merge_maps(merge("run-0", "run-1")).await.unwrap().into_inner();
        assert!(merged.closure_count >= 3, "{merged:?}");
        let map = merged.map.unwrap();
        assert_eq!((map.map_id.as_str(), map.clients.len()), ("run-0", 2));
        assert_eq!(map.merged_maps[0].map_id, "run-1");
        assert_eq!(map.merged_maps[0].client_ids, ["robot-1"]);
        adjusted(&server, "run-0").await;
        let error = between_frames(&server, "run-0", &walks).await;
        println!("two robots merged: {error:.4} m between their frames");
        assert!(error <= 0.03, "{error} m");
        // By either name, and listed once.
        assert_eq!(get(&server, "run-1").await.map_id, "run-0");
        let list = server.maps().list_maps(v1::ListMapsRequest::default()).await.unwrap();
        assert_eq!(list.into_inner().maps.len(), 1);
        // Asked again by one who did not get the answer.
        let again = server.maps().merge_maps(merge("run-0", "run-1")).await.unwrap().into_inner();
        assert_eq!(again.target_from_source, merged.target_from_source);
        // And apart again.
        let undo =
            v1::UndoMergeRequest { map_id: "run-0".to_owned(), source_map_id: "run-1".to_owned() };
        let undone = server.maps().undo_merge(undo.clone()).await.unwrap().into_inner();
        let (map, source) = (undone.map.unwrap(), undone.source.unwrap());
        assert_eq!(map.counts.unwrap().keyframe_count, walks[0].truth.len() as i64);
        assert_eq!((source.map_id.as_str(), &source.uid), ("run-1", &before.uid));
        assert_eq!(source.state(), v1::MapState::Open);
        let counts = |map: &v1::Map| {
            let counts = map.counts.unwrap();
            [counts.keyframe_count, counts.landmark_count, counts.observation_count]
        };
        assert_eq!(counts(&source), counts(&before));
        assert_eq!(get(&server, "run-1").await.map_id, "run-1");
        let status = server.maps().undo_merge(undo).await.unwrap_err();
        check_status(&status, Code::NotFound, "NOT_MERGED");
        // The robot goes on where it was.
        let (stream, opened) = Stream::open(&server, "run-1", "robot-1", 0).await;
        assert_eq!(opened.next_sequence, before.clients[0].next_sequence);
        drop(stream);
    });
}

#[test]
#[allow(clippy::print_stdout, reason = "docs/benchmarking.md has this figure")]
fn eight_maps_become_one_at_once() {
    run(async {
        let server = TestServer::lock_step().await;
        let walks: Vec<Sequence> = (0..8).map(|k| walker(3 * k, 10 + k as u64).sequence).collect();
        for (number, walked) in walks.iter().enumerate() {
            let name = format!("run-{number}");
            server.create_map(&name).await;
            walk(&server, &name, &robot(number), walked).await;
        }
        let merges = (1..8).map(|number| {
            let mut maps = server.maps();
            async move { maps.merge_maps(merge("run-0", &format!("run-{number}"))).await.unwrap() }
        });
        futures_util::future::join_all(merges).await;
        let map = get(&server, "run-0").await;
        assert_eq!((map.clients.len(), map.merged_maps.len()), (8, 7));
        adjusted(&server, "run-0").await;
        let error = between_frames(&server, "run-0", &walks).await;
        println!("eight robots merged: at most {error:.4} m between their frames");
        assert!(error <= 0.03, "{error} m");
    });
}

#[test]
#[allow(clippy::print_stdout, reason = "docs/benchmarking.md has this figure")]
fn eight_robots_that_write_one_map_from_eight_starts_find_each_other() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("floor").await;
        let walks: Vec<Sequence> = (0..8).map(|k| walker(3 * k, 10 + k as u64).sequence).collect();
        let writes = walks.iter().enumerate().map(|(number, walked)| {
            let server = &server;
            async move { walk(server, "floor", &robot(number), walked).await }
        });
        futures_util::future::join_all(writes).await;
        all_done(&server, "floor", &robot(0)).await;
        let error = between_frames(&server, "floor", &walks).await;
        println!("eight robots in one map: at most {error:.4} m between their frames");
        assert!(error <= 0.03, "{error} m");
    });
}

#[test]
fn a_robot_goes_on_while_its_map_becomes_part_of_another_one_and_leaves_it() {
    run(async {
        let server = TestServer::start().await;
        let client =
            Client::connect(&format!("http://{}", server.running.local_addr())).await.unwrap();
        for map in ["floor", "run"] {
            server.create_map(map).await;
        }
        let options = || SessionOptions { retry: quickly(), ..SessionOptions::default() };
        let mut other = client.ingest("floor", "other", options()).await.unwrap();
        let mut session = client.ingest("run", "robot", options()).await.unwrap();
        let watched = WatchOptions { retry: quickly(), ..WatchOptions::default() };
        let mut watch = client.watch("run", watched).await.unwrap();
        for session in [&mut other, &mut session] {
            session.send(crate::common::camera(0)).await.unwrap();
            for id in 0..4 {
                session.send(keyframe(id)).await.unwrap();
            }
            session.flush().await.unwrap();
        }
        let request = v1::MergeMapsRequest {
            target_from_source: Some(shift([10.0, 0.0, 0.0])),
            ..merge("floor", "run")
        };
        server.maps().merge_maps(request).await.unwrap();
        // It need not know: its next keyframes are in the other map, under the sequences that follow.
        for id in 4..6 {
            session.send(keyframe(id)).await.unwrap();
        }
        session.flush().await.unwrap();
        let counts = get(&server, "floor").await.counts.unwrap();
        assert_eq!((counts.keyframe_count, counts.camera_count), (10, 2));
        // Sent in the frame of its own map, they are where they belong in this one.
        let found = poses(&server, "floor").await;
        let x = |id: i64| found[&("robot".to_owned(), id)].translation.x;
        for id in 4..6 {
            let expected = 10.0 + keyframe_position(id)[0];
            assert!((x(id) - expected).abs() < 0.05, "{} for {expected}", x(id));
        }
        // Its watch tells it where its frame lies now.
        let x = |watch: &covis::client::MapWatch| {
            let frame = watch.mirror().client_frames.get("robot")?;
            Some(frame.map_from_odom?.translation?.x)
        };
        while x(&watch).is_none_or(|x| x < 5.0) {
            watch.next().await.unwrap();
        }
        let undo =
            v1::UndoMergeRequest { map_id: "floor".to_owned(), source_map_id: "run".to_owned() };
        server.maps().undo_merge(undo).await.unwrap();
        session.send(keyframe(6)).await.unwrap();
        let report = session.finish().await.unwrap();
        assert_eq!((report.rejected, report.unanswered()), (0, 0));
        assert_eq!(get(&server, "run").await.counts.unwrap().keyframe_count, 7);
        assert_eq!(get(&server, "floor").await.counts.unwrap().keyframe_count, 4);
        while x(&watch).is_none_or(|x| x > 5.0) {
            watch.next().await.unwrap();
        }
        other.finish().await.unwrap();
    });
}

#[test]
fn what_a_robot_sends_again_after_a_merge_is_known_by_its_sequence() {
    run(async {
        let server = TestServer::start().await;
        for map in ["floor", "run"] {
            server.create_map(map).await;
        }
        server.build_map("run", 4).await;
        let request = v1::MergeMapsRequest {
            target_from_source: Some(shift([10.0, 0.0, 0.0])),
            ..merge("floor", "run")
        };
        server.maps().merge_maps(request).await.unwrap();
        let (mut stream, opened) = Stream::open(&server, "run", "robot", 0).await;
        // Its link broke before it heard of the last ack.
        let again = stream.put(opened.next_sequence - 1, keyframe_item(3)).await;
        assert!(again.duplicate && again.violations.is_empty(), "{again:?}");
        // Other content under that sequence is not.
        let (mut stream, opened) = Stream::open(&server, "run", "robot", 0).await;
        let other = stream.put(opened.next_sequence - 1, keyframe_item(4)).await;
        assert_eq!(other.status(), v1::AckStatus::Rejected, "{other:?}");
        assert_eq!(get(&server, "floor").await.counts.unwrap().keyframe_count, 4);
    });
}

#[test]
fn what_cannot_be_merged_is_refused_by_name_and_stays_as_it_was() {
    run(async {
        let server = TestServer::start().await;
        for map in ["a", "b"] {
            server.create_map(map).await;
            server.build_map(map, 4).await;
        }
        let refused = async |request: v1::MergeMapsRequest| {
            server.maps().merge_maps(request).await.unwrap_err()
        };
        check_field(&refused(merge("a", "a")).await, "source_map_id", "DUPLICATE");
        check_field(&refused(merge("", "b")).await, "target_map_id", "MISSING");
        check_status(&refused(merge("a", "none")).await, Code::NotFound, "MAP_NOT_FOUND");
        check_status(&refused(merge("a", "b")).await, Code::FailedPrecondition, "CLIENT_IN_BOTH");
        let placed = v1::MergeMapsRequest {
            target_from_source: Some(shift([1.0, 0.0, 0.0])),
            ..merge("a", "b")
        };
        check_status(&refused(placed.clone()).await, Code::FailedPrecondition, "CLIENT_IN_BOTH");
        let client = |from: &str, to: &str| v1::RenamedClient {
            client_id: from.to_owned(),
            new_client_id: to.to_owned(),
        };
        let renamed = |renamed_clients| v1::MergeMapsRequest { renamed_clients, ..placed.clone() };
        // These keyframes have no descriptors.
        let unplaced = v1::MergeMapsRequest {
            target_from_source: None,
            ..renamed(vec![client("robot", "robot-b")])
        };
        check_status(&refused(unplaced).await, Code::FailedPrecondition, "NOT_ALIGNED");
        let status = refused(renamed(vec![client("nobody", "x")])).await;
        check_field(&status, "renamed_clients", "INCONSISTENT");
        let status = refused(renamed(vec![client("robot", "x"), client("robot", "y")])).await;
        check_field(&status, "renamed_clients[1].client_id", "DUPLICATE");
        let status = refused(renamed(vec![client("robot", "X")])).await;
        check_field(&status, "renamed_clients[0].new_client_id", "OUT_OF_RANGE");
        let mut constraint = crate::common::relative_pose(0, 0, 99);
        let status = refused(v1::MergeMapsRequest {
            constraints: vec![constraint.clone()],
            ..placed.clone()
        });
        check_field(&status.await, "constraints[0].keyframe_i.client_id", "MISSING");
        for keyframe in [&mut constraint.keyframe_i, &mut constraint.keyframe_j] {
            keyframe.as_mut().unwrap().client_id = "robot".to_owned();
        }
        let constraints = vec![constraint];
        let status = refused(v1::MergeMapsRequest { constraints, ..placed.clone() }).await;
        check_field(&status, "constraints", "UNKNOWN_REFERENCE");
        // Nothing has changed: both take items.
        for map in ["a", "b"] {
            assert_eq!(get(&server, map).await.state(), v1::MapState::Open);
            let (mut stream, opened) = Stream::open(&server, map, "robot", 0).await;
            let ack = stream.put(opened.next_sequence, keyframe_item(9)).await;
            assert!(ack.violations.is_empty(), "{ack:?}");
        }
        // Under another name it fits; then its map is no map of its own any more.
        let request = renamed(vec![client("robot", "robot-b")]);
        server.maps().merge_maps(request).await.unwrap();
        let delete = v1::DeleteMapRequest { map_id: "b".to_owned() };
        let status = server.maps().delete_map(delete).await.unwrap_err();
        check_status(&status, Code::FailedPrecondition, "MAP_MERGED");
        let create = v1::CreateMapRequest { map_id: "b".to_owned(), ..Default::default() };
        let status = server.maps().create_map(create.clone()).await.unwrap_err();
        check_status(&status, Code::AlreadyExists, "MAP_EXISTS");
        // The robot that wrote it has its own items, by the name that it knows.
        let (mut stream, opened) = Stream::open(&server, "b", "robot", 0).await;
        let ack = stream.put(opened.next_sequence, keyframe_item(10)).await;
        assert!(ack.violations.is_empty(), "{ack:?}");
        let clients = get(&server, "a").await.clients;
        let next = |name: &str| clients.iter().find(|c| c.client_id == name).unwrap().next_sequence;
        assert!(next("robot-b") > next("robot"));
        // With the map its other name goes.
        let delete = v1::DeleteMapRequest { map_id: "a".to_owned() };
        server.maps().delete_map(delete).await.unwrap();
        server.maps().create_map(create).await.unwrap();
    });
}

fn keyframe_item(id: i64) -> v1::ingest_request::Item {
    v1::ingest_request::Item::Keyframe(keyframe(id))
}

async fn names(server: &TestServer) -> Vec<String> {
    let list = server.maps().list_maps(v1::ListMapsRequest::default()).await.unwrap();
    list.into_inner().maps.into_iter().map(|map| map.map_id).collect()
}

async fn set_frozen(server: &TestServer, map: &str) {
    let request = v1::UpdateMapRequest {
        map_id: map.to_owned(),
        state: v1::MapState::Frozen.into(),
        update_mask: Some(prost_types::FieldMask { paths: vec!["state".to_owned()] }),
        ..Default::default()
    };
    server.maps().update_map(request).await.unwrap();
}

#[test]
fn merged_maps_are_found_after_a_restart_and_what_a_merge_left_behind_is_cleared() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let (data, aside) = (folder.path().join("data"), folder.path().join("aside"));
        let server = on_disk(&data).await;
        let folders = || -> BTreeSet<PathBuf> {
            let entries = std::fs::read_dir(data.join("maps")).unwrap();
            entries.map(|entry| entry.unwrap().path()).collect()
        };
        server.create_map("floor").await;
        let other = folders();
        server.create_map("run").await;
        let run = folders().difference(&other).next().unwrap().clone();
        for map in ["floor", "run"] {
            server.build_map(map, 4).await;
        }
        server.running.shutdown().await;
        copy(&run, &aside.join("same"));
        let server = on_disk(&data).await;
        let (mut stream, opened) = Stream::open(&server, "run", "robot", 0).await;
        stream.put(opened.next_sequence, keyframe_item(4)).await;
        drop(stream);
        // The rest of a merge may be frozen, and so may a map that is not.
        set_frozen(&server, "run").await;
        server.running.shutdown().await;
        copy(&run, &aside.join("more"));
        std::fs::remove_dir_all(&run).unwrap();
        copy(&aside.join("same"), &run);
        let server = on_disk(&data).await;
        let renamed = v1::RenamedClient {
            client_id: "robot".to_owned(),
            new_client_id: "robot-b".to_owned(),
        };
        let request = v1::MergeMapsRequest {
            target_from_source: Some(shift([1.0, 0.0, 0.0])),
            renamed_clients: vec![renamed],
            ..merge("floor", "run")
        };
        server.maps().merge_maps(request).await.unwrap();
        let merged = get(&server, "floor").await;
        server.running.shutdown().await;
        // As if the server had died before it deleted the source.
        copy(&aside.join("same"), &run);
        let server = on_disk(&data).await;
        assert_eq!(names(&server).await, ["floor"]);
        assert!(!run.exists());
        let found = get(&server, "run").await;
        assert_eq!((found.uid, found.counts), (merged.uid, merged.counts));
        server.running.shutdown().await;
        // A map of this name with an item that the other one has not stays.
        copy(&aside.join("more"), &run);
        let server = on_disk(&data).await;
        assert_eq!(names(&server).await, ["floor", "run"]);
        server.running.shutdown().await;
        std::fs::remove_dir_all(&run).unwrap();
        let server = on_disk(&data).await;
        let undo =
            v1::UndoMergeRequest { map_id: "floor".to_owned(), source_map_id: "run".to_owned() };
        server.maps().undo_merge(undo).await.unwrap();
        server.running.shutdown().await;
        let server = on_disk(&data).await;
        assert_eq!(names(&server).await, ["floor", "run"]);
        assert_eq!(get(&server, "run").await.counts.unwrap().keyframe_count, 4);
    });
}
