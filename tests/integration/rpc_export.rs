//! `ExportMap`: every format reads back as the map, in chunks, also from a poisoned map.

use std::path::Path;

use covis::wire::v1;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel};
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::io::trajectory::Trajectory;
use tonic::{Code, Status};
use v1::export_map_response::Content;
use v1::ingest_request::Item;

use crate::common::{
    LANDMARKS, Stream, TestServer, camera, check_field, check_status, keyframe, landmark,
    relative_pose, run, vector3,
};

/// Exports a map and puts its files together.
pub(crate) async fn export(
    server: &TestServer,
    map_id: &str,
    format: v1::MapFormat,
) -> Result<(v1::ExportMapHeader, Vec<(String, Vec<u8>)>), Status> {
    let request = v1::ExportMapRequest {
        map_id: map_id.to_owned(),
        format: format.into(),
        all_landmarks: false,
    };
    let mut stream = server.maps().export_map(request).await?.into_inner();
    let first = stream.message().await?.and_then(|m| m.content);
    let Some(Content::Header(header)) = first else { panic!("the header comes first: {first:?}") };
    let mut files: Vec<(String, Vec<u8>)> = Vec::new();
    let mut is_open = false;
    while let Some(message) = stream.message().await? {
        let Some(Content::Chunk(chunk)) = message.content else { panic!("chunks follow") };
        assert!(chunk.data.len() <= 1 << 20);
        if !is_open {
            files.push((chunk.path.clone(), Vec::new()));
        }
        let (path, bytes) = files.last_mut().unwrap();
        assert_eq!((path.as_str(), bytes.len() as i64), (chunk.path.as_str(), chunk.offset));
        bytes.extend(chunk.data);
        is_open = !chunk.last_chunk;
    }
    assert!(!is_open, "every file ends with its last chunk");
    let paths: Vec<_> = files.iter().map(|(path, _)| path.clone()).collect();
    assert_eq!(header.paths, paths);
    assert_eq!(header.format(), format);
    Ok((header, files))
}

#[test]
fn colmap_text_and_binary_hold_the_same_model() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 3).await;
        let mut models = Vec::new();
        for (format, encoding) in [
            (v1::MapFormat::ColmapText, ColmapEncoding::Text),
            (v1::MapFormat::ColmapBinary, ColmapEncoding::Binary),
        ] {
            let (header, files) = export(&server, "room", format).await.unwrap();
            assert_eq!(header.paths, encoding.file_names());
            let [cameras, images, points] = files.as_slice() else { panic!("three files") };
            let bytes = [&*cameras.1, &*images.1, &*points.1];
            models.push(ColmapModel::parse(encoding, bytes, Path::new("room")).unwrap());
        }
        assert_eq!(models[0], models[1]);
        let model = &models[0];
        assert_eq!((model.cameras.len(), model.images.len()), (1, 3));
        assert_eq!(model.points.len() as i64, LANDMARKS);
        assert_eq!(model.images[&1].name, "robot/0");
        let problem = model.to_problem().unwrap().problem;
        assert_eq!(problem.observation_count() as i64, 3 * LANDMARKS);
        let cost = covis_solvers::evaluation::bundle_cost(&problem);
        assert!(cost.rmse_px < 0.1, "pixels meet the optimized map: {}", cost.rmse_px);
    });
}

#[test]
fn tum_has_a_file_for_each_client() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let (header, files) = export(&server, "room", v1::MapFormat::Tum).await.unwrap();
        assert!(header.paths.is_empty() && files.is_empty());
        server.build_map("room", 3).await;
        let (header, files) = export(&server, "room", v1::MapFormat::Tum).await.unwrap();
        assert_eq!(header.paths, ["robot.tum"]);
        let trajectory = Trajectory::parse(&files[0].1, Path::new("robot.tum")).unwrap();
        assert_eq!(trajectory.timestamps, [100.5, 101.5, 102.5]);
    });
}

#[test]
fn g2o_has_keyframes_and_the_edges_of_the_pose_graph() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 3).await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.put(10, Item::RelativePose(relative_pose(0, 0, 1))).await;
        stream.put(11, Item::RelativePose(relative_pose(1, 1, 2))).await;
        let (_, files) = export(&server, "room", v1::MapFormat::G2o).await.unwrap();
        assert_eq!(files[0].0, "graph.g2o");
        let G2oGraph::Se3(graph) = G2oGraph::parse(&files[0].1, Path::new("g")).unwrap() else {
            panic!("a graph in space");
        };
        let ids: Vec<_> = graph.vertices.iter().map(|v| v.id).collect();
        assert_eq!(ids, [0, 1, 2]);
        assert_eq!(graph.fixed, [0]);
        // Odometry that a client sent stands for what the keyframes measure. Without a loop closure
        // its covariance is taken four times: twice its sigmas.
        let edges: Vec<_> = graph.edges.iter().map(|e| (e.i, e.j, e.information[0])).collect();
        let [(0, 1, first), (1, 2, second)] = edges[..] else { panic!("{edges:?}") };
        assert!((first - 25.0).abs() < 1e-9 && (second - 25.0).abs() < 1e-9, "{edges:?}");

        // A second client with the same keyframe ids: vertices could not be told apart.
        let (mut stream, _) = Stream::open(&server, "room", "drone", 0).await;
        stream.put(1, Item::Camera(camera(0))).await;
        let mut frame = keyframe(0);
        frame.observations.clear();
        frame.landmarks.clear();
        stream.put(2, Item::Keyframe(frame)).await;
        let status = export(&server, "room", v1::MapFormat::G2o).await.unwrap_err();
        check_status(&status, Code::FailedPrecondition, "FORMAT_CANNOT_HOLD_MAP");
        assert!(status.message().contains("keyframe 0"), "{}", status.message());
    });
}

#[test]
fn a_pose_whose_inverse_is_no_number_is_not_written_for_colmap() {
    run(async {
        let server = TestServer::start().await;
        let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
        server.create_map_with("room", policy).await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.put(1, Item::Camera(camera(0))).await;
        let far = v1::RigidTransform {
            translation: Some(vector3([1.7e308, 1.7e308, 0.0])),
            // Half of a right angle about z: the inverse has the sum of both.
            rotation: Some(v1::Quaternion {
                w: (std::f64::consts::PI / 8.0).cos(),
                z: (std::f64::consts::PI / 8.0).sin(),
                ..Default::default()
            }),
        };
        let frame = v1::Keyframe {
            world_from_camera: Some(far),
            observations: Vec::new(),
            landmarks: Vec::new(),
            ..keyframe(7)
        };
        let ack = stream.put(2, Item::Keyframe(frame)).await;
        assert!(ack.violations.is_empty(), "{ack:?}");
        for format in [v1::MapFormat::ColmapText, v1::MapFormat::ColmapBinary] {
            let status = export(&server, "room", format).await.unwrap_err();
            check_status(&status, Code::FailedPrecondition, "FORMAT_CANNOT_HOLD_MAP");
            assert!(status.message().contains("keyframe robot/7"), "{status}");
        }
        assert!(export(&server, "room", v1::MapFormat::Tum).await.is_ok());
    });
}

#[test]
fn a_large_file_comes_in_chunks() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let (mut stream, _) = Stream::open(&server, "room", "robot", 0).await;
        let landmarks =
            (0..50_000).map(|id| v1::Landmark { id, ..landmark(id % 60) }).collect::<Vec<_>>();
        stream.put(1, Item::Landmarks(v1::LandmarkBatch { landmarks })).await;
        let (_, files) = export(&server, "room", v1::MapFormat::Ply).await.unwrap();
        let (path, bytes) = &files[0];
        assert_eq!(path, "map.ply");
        assert!(bytes.len() > 1 << 20, "{}", bytes.len());
        let text = String::from_utf8_lossy(&bytes[..200]);
        assert!(text.starts_with("ply\nformat binary_little_endian 1.0"), "{text}");
        assert!(text.contains("element vertex 50000"), "{text}");
    });
}

#[test]
fn export_map_refuses_bad_requests() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let status = export(&server, "room", v1::MapFormat::Unspecified).await.unwrap_err();
        check_field(&status, "format", "MISSING");
        let status = export(&server, "none", v1::MapFormat::Tum).await.unwrap_err();
        check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
        let status = export(&server, "", v1::MapFormat::Tum).await.unwrap_err();
        check_field(&status, "map_id", "MISSING");
        let request =
            v1::ExportMapRequest { map_id: "room".to_owned(), format: 99, all_landmarks: false };
        let mut stream = server.maps().export_map(request).await.unwrap().into_inner();
        check_field(&stream.message().await.unwrap_err(), "format", "UNKNOWN_VALUE");
        let format = v1::MapFormat::Covis.into();
        let request =
            v1::ExportMapRequest { map_id: "room".to_owned(), format, all_landmarks: true };
        let mut stream = server.maps().export_map(request).await.unwrap().into_inner();
        check_field(&stream.message().await.unwrap_err(), "all_landmarks", "INCONSISTENT");
    });
}

#[test]
fn a_poisoned_map_can_still_be_exported() {
    run(async {
        let server = TestServer::with_poisoned_map("room").await;
        let request = v1::GetMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let map = server.maps().get_map(request).await.unwrap().into_inner().map.unwrap();
        assert_eq!(map.state(), v1::MapState::Poisoned);
        let (_, files) = export(&server, "room", v1::MapFormat::ColmapText).await.unwrap();
        assert_eq!(files.len(), 3);
    });
}
