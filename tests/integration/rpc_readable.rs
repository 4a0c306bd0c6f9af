//! What a server has accepted it reads again: values at the edge of what a number holds, through merges,
//! imports and restarts. No answered call leaves a map that does not open.

use std::path::Path;

use covis::wire::v1;
use tonic::Code;
use v1::ingest_request::Item;

use crate::common::{
    Stream, TestServer, camera, check_status, information3, keyframe, relative_pose, run, shift,
    vector3,
};
use crate::merge_support::{get, merge};

async fn at(folder: &Path) -> TestServer {
    let folder = folder.to_owned();
    TestServer::with(move |config| {
        config.engine.lock_step = true;
        config.data_dir = Some(folder);
    })
    .await
}

/// A map with four keyframes of a client.
async fn street(server: &TestServer, map: &str, client: &str, more: Vec<Item>) {
    server.create_map(map).await;
    let (stream, _) = Stream::open(server, map, client, 0).await;
    let items = (0..4).map(|id| Item::Keyframe(keyframe(id)));
    let items = [Item::Camera(camera(0))].into_iter().chain(items).chain(more);
    for (sequence, item) in (1..).zip(items) {
        stream.send(sequence, item).await;
    }
    for ack in stream.finish().await.unwrap() {
        assert!(ack.violations.is_empty(), "{ack:?}");
    }
}

/// A restart gives the same maps, open; solves that a merge asked for may go on there.
async fn is_read_again(server: TestServer, folder: &Path, maps: &[&str]) -> TestServer {
    let mut before = Vec::new();
    for map in maps {
        before.push(get(&server, map).await.counts.unwrap());
    }
    server.running.shutdown().await;
    let again = at(folder).await;
    for (map, before) in maps.iter().zip(before) {
        let found = get(&again, map).await;
        assert_eq!((found.state(), found.state_reason.as_str()), (v1::MapState::Open, ""), "{map}");
        let counts = found.counts.unwrap();
        let entities = |counts: v1::MapCounts| {
            [counts.keyframe_count, counts.landmark_count, counts.constraint_count]
        };
        assert_eq!(entities(counts), entities(before), "{map}");
    }
    again
}

/// As far away as in UTM, and turned.
fn far() -> v1::RigidTransform {
    let (x, w) = (0.6_f64.sin(), 0.6_f64.cos());
    let rotation = v1::Quaternion { x: 0.6 * x, y: 0.0, z: 0.8 * x, w };
    v1::RigidTransform { translation: Some(vector3([3e5, 4e5, 5e5])), rotation: Some(rotation) }
}

fn upper(diagonal: [f64; 6]) -> v1::InformationMatrix6 {
    let rows = diagonal.iter().enumerate();
    let row =
        |(k, &value): (usize, &f64)| std::iter::once(value).chain(std::iter::repeat_n(0.0, 5 - k));
    v1::InformationMatrix6 { upper_triangle: rows.flat_map(row).collect() }
}

#[test]
fn a_merge_by_a_measurement_from_far_away_is_read_again() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let server = at(folder.path()).await;
        street(&server, "floor", "a", Vec::new()).await;
        street(&server, "run", "b", Vec::new()).await;
        let of =
            |client_id: &str, id| Some(v1::KeyframeRef { client_id: client_id.to_owned(), id });
        let constraint = v1::RelativePoseConstraint {
            keyframe_i: of("b", 1),
            keyframe_j: of("a", 2),
            keyframe_i_from_keyframe_j: Some(far()),
            information: Some(upper([1e6, 1e6, 1e6, 1.0, 1.0, 1.0])),
            ..relative_pose(7, 0, 1)
        };
        let request =
            v1::MergeMapsRequest { constraints: vec![constraint], ..merge("floor", "run") };
        server.maps().merge_maps(request).await.unwrap();
        let again = is_read_again(server, folder.path(), &["floor"]).await;
        assert_eq!(get(&again, "run").await.counts.unwrap().keyframe_count, 8);
    });
}

#[test]
fn fixes_that_know_little_but_the_height_are_read_again_after_a_merge_that_turns_them() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let server = at(folder.path()).await;
        street(&server, "floor", "a", Vec::new()).await;
        let fixes = (0..20).map(|k| {
            let little = 10_f64.powi(-13 - k);
            Item::PositionPrior(v1::PositionPrior {
                id: i64::from(k),
                keyframe: Some(v1::KeyframeRef { id: i64::from(k % 4), ..Default::default() }),
                point_in_world: Some(vector3([0.0, 0.0, 0.1])),
                information: Some(v1::InformationMatrix3 {
                    upper_triangle: vec![little, 0.0, 0.0, little, 0.0, 100.0],
                }),
                ..Default::default()
            })
        });
        street(&server, "run", "b", fixes.collect()).await;
        let mut place = far();
        place.translation = Some(vector3([1.0, 2.0, 3.0]));
        let request =
            v1::MergeMapsRequest { target_from_source: Some(place), ..merge("floor", "run") };
        server.maps().merge_maps(request).await.unwrap();
        is_read_again(server, folder.path(), &["floor"]).await;
    });
}

#[test]
fn a_landmark_near_the_largest_number_holds_up_no_solve() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let server = at(folder.path()).await;
        let mut seen = keyframe(4);
        let pixel = Some(v1::Vector2 { x: 319.5, y: 239.5 });
        seen.landmarks.push(v1::Landmark {
            id: 99,
            point_in_world: Some(vector3([0.0, 0.0, f64::MAX])),
            ..Default::default()
        });
        let mut observation = seen.observations[0].clone();
        (observation.landmark, observation.pixel) =
            (Some(v1::LandmarkRef { id: 99, ..Default::default() }), pixel);
        seen.observations.push(observation);
        let fix = |id: i64, x: f64| {
            Item::PositionPrior(v1::PositionPrior {
                id,
                keyframe: Some(v1::KeyframeRef { id: 4 * id, ..Default::default() }),
                point_in_world: Some(vector3([x, 5.0, -3.0])),
                information: Some(information3(1e6)),
                ..Default::default()
            })
        };
        street(&server, "floor", "a", vec![Item::Keyframe(seen), fix(0, 7.0), fix(1, 9.0)]).await;
        assert_eq!(get(&server, "floor").await.state(), v1::MapState::Open);
        is_read_again(server, folder.path(), &["floor"]).await;
    });
}

#[test]
fn the_loser_of_two_opposite_merges_reads_where_its_target_went() {
    run(async {
        let server = TestServer::lock_step().await;
        for (map, client) in [("a", "robot-a"), ("b", "robot-b")] {
            street(&server, map, client, Vec::new()).await;
        }
        let place = Some(shift([10.0, 0.0, 0.0]));
        let placed = |target, source| v1::MergeMapsRequest {
            target_from_source: place,
            ..merge(target, source)
        };
        server.maps().merge_maps(placed("a", "b")).await.unwrap();
        let status = server.maps().merge_maps(placed("b", "a")).await.unwrap_err();
        assert!(status.message().contains("map \"b\" was merged into map \"a\""), "{status}");
        check_status(&status, Code::FailedPrecondition, "MAP_MERGED");
    });
}

#[test]
fn the_clients_of_a_map_that_was_taken_out_are_out_and_it_may_become_the_target() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let server = at(folder.path()).await;
        for (map, client) in [("a", "robot-a"), ("b", "robot-b")] {
            street(&server, map, client, Vec::new()).await;
        }
        let place = Some(shift([10.0, 0.0, 0.0]));
        let placed = |target, source| v1::MergeMapsRequest {
            target_from_source: place,
            ..merge(target, source)
        };
        let undo = |map: &str, source: &str| v1::UndoMergeRequest {
            map_id: map.to_owned(),
            source_map_id: source.to_owned(),
        };
        let clients = |map: v1::Map| -> Vec<String> {
            map.clients.into_iter().map(|client| client.client_id).collect()
        };
        for _ in 0..2 {
            server.maps().merge_maps(placed("a", "b")).await.unwrap();
            assert_eq!(clients(get(&server, "a").await), ["robot-a", "robot-b"]);
            server.maps().undo_merge(undo("a", "b")).await.unwrap();
            assert_eq!(clients(get(&server, "a").await), ["robot-a"]);
            assert_eq!(clients(get(&server, "b").await), ["robot-b"]);
            // The other way.
            server.maps().merge_maps(placed("b", "a")).await.unwrap();
            assert_eq!(clients(get(&server, "b").await), ["robot-a", "robot-b"]);
            server.maps().undo_merge(undo("b", "a")).await.unwrap();
            assert_eq!(clients(get(&server, "b").await), ["robot-b"]);
        }
        let again = is_read_again(server, folder.path(), &["a", "b"]).await;
        // A name that left is free.
        let (mut stream, opened) = Stream::open(&again, "a", "robot-b", 0).await;
        assert_eq!(opened.next_sequence, 1);
        let ack = stream.put(1, Item::Camera(camera(5))).await;
        assert_eq!(ack.status(), v1::AckStatus::Received);
        assert_eq!(clients(get(&again, "a").await), ["robot-a", "robot-b"]);
    });
}

#[test]
fn a_graph_with_edges_that_know_little_or_nothing_is_imported_and_read_again() {
    run(async {
        let folder = tempfile::tempdir().unwrap();
        let server = at(folder.path()).await;
        let zero = vec![0.0; 21];
        let direction = [0.6, -0.3, 0.2, 0.1, 0.5, 0.4];
        let rank_one = (0..6).flat_map(|i| (i..6).map(move |k| direction[i] * direction[k]));
        let mut text = String::new();
        for id in 0..3 {
            text.push_str(&format!("VERTEX_SE3:QUAT {id} {id} 0 0 0 0 0 1\n"));
        }
        for (i, information) in [zero, rank_one.collect()].into_iter().enumerate() {
            let upper: Vec<String> = information.iter().map(f64::to_string).collect();
            text.push_str(&format!(
                "EDGE_SE3:QUAT {i} {} 1 0 0 0 0 0 1 {}\n",
                i + 1,
                upper.join(" ")
            ));
        }
        let content = |content| v1::ImportMapRequest { content: Some(content) };
        let header = v1::ImportMapHeader {
            map_id: "graph".to_owned(),
            format: v1::MapFormat::G2o.into(),
            client_id: "survey".to_owned(),
            ..Default::default()
        };
        let chunk = v1::FileChunk {
            path: "graph.g2o".to_owned(),
            data: text.into_bytes(),
            last_chunk: true,
            ..Default::default()
        };
        let messages = [
            content(v1::import_map_request::Content::Header(header)),
            content(v1::import_map_request::Content::Chunk(chunk)),
        ];
        server.maps().import_map(tokio_stream::iter(messages)).await.unwrap();
        let again = is_read_again(server, folder.path(), &["graph"]).await;
        assert_eq!(get(&again, "graph").await.counts.unwrap().constraint_count, 2);
    });
}
