//! `MAP_FORMAT_COVIS` and `ImportMap`: a map that moves to another server, other formats, and each
//! code. What ends early or is damaged leaves no map.

use covis::map::MapLimits;
use covis::service::engine::AccountLimits;
use covis::wire::v1;
use proptest::prelude::*;
use tonic::{Code, Status};
use v1::ingest_request::Item;
use v1::{export_map_response, import_map_request};

use crate::common::{
    LANDMARKS, Stream, TestServer, check_field, check_retry, check_status, information3, keyframe,
    relative_pose, run,
};
use crate::durable::on_disk;

pub(crate) type File = (String, Vec<u8>);

/// The files of an export.
pub(crate) async fn export(server: &TestServer, map_id: &str, format: v1::MapFormat) -> Vec<File> {
    let request = v1::ExportMapRequest {
        map_id: map_id.to_owned(),
        format: format.into(),
        all_landmarks: false,
    };
    let mut stream = server.maps().export_map(request).await.unwrap().into_inner();
    let mut files: Vec<File> = Vec::new();
    while let Some(message) = stream.message().await.unwrap() {
        let Some(export_map_response::Content::Chunk(chunk)) = message.content else { continue };
        if chunk.offset == 0 {
            files.push((chunk.path, Vec::new()));
        }
        files.last_mut().unwrap().1.extend(chunk.data);
    }
    files
}

pub(crate) fn header(map_id: &str, format: v1::MapFormat) -> v1::ImportMapHeader {
    v1::ImportMapHeader { map_id: map_id.to_owned(), format: format.into(), ..Default::default() }
}

fn message(content: import_map_request::Content) -> v1::ImportMapRequest {
    v1::ImportMapRequest { content: Some(content) }
}

/// The messages of an upload, in chunks of some size.
pub(crate) fn upload(header: v1::ImportMapHeader, files: &[File]) -> Vec<v1::ImportMapRequest> {
    const SIZE: usize = 4_000;
    let mut messages = vec![message(import_map_request::Content::Header(header))];
    for (path, bytes) in files {
        let chunks: Vec<&[u8]> =
            if bytes.is_empty() { vec![&[]] } else { bytes.chunks(SIZE).collect() };
        for (index, data) in chunks.iter().enumerate() {
            messages.push(message(import_map_request::Content::Chunk(v1::FileChunk {
                path: path.clone(),
                offset: (index * SIZE) as i64,
                data: data.to_vec(),
                last_chunk: index + 1 == chunks.len(),
            })));
        }
    }
    messages
}

async fn send(server: &TestServer, messages: Vec<v1::ImportMapRequest>) -> Result<v1::Map, Status> {
    Ok(answer(server, messages).await?.map.unwrap())
}

pub(crate) async fn answer(
    server: &TestServer,
    messages: Vec<v1::ImportMapRequest>,
) -> Result<v1::ImportMapResponse, Status> {
    Ok(server.maps().import_map(tokio_stream::iter(messages)).await?.into_inner())
}

pub(crate) async fn import(
    server: &TestServer,
    header: v1::ImportMapHeader,
    files: &[File],
) -> Result<v1::Map, Status> {
    send(server, upload(header, files)).await
}

/// The map and its hash over the wire.
pub(crate) async fn get(server: &TestServer, map_id: &str) -> Result<(v1::Map, Vec<u8>), Status> {
    let request = v1::GetMapRequest { map_id: map_id.to_owned(), include_digests: true };
    let answer = server.maps().get_map(request).await?.into_inner();
    Ok((answer.map.unwrap(), answer.state_hash))
}

/// A map with two clients, constraints and a policy of its own.
pub(crate) async fn build(server: &TestServer) {
    let policy = v1::MapPolicy {
        window_keyframe_count: Some(7),
        limits: Some(v1::MapLimits { max_keyframe_count: Some(50), ..Default::default() }),
        ..Default::default()
    };
    server.create_map_with("room", policy).await;
    server.build_map("room", 4).await;
    let (stream, opened) = Stream::open(server, "room", "robot", 0).await;
    for (k, (i, j)) in [(0, 1), (1, 2), (0, 3)].into_iter().enumerate() {
        let mut constraint = relative_pose(k as i64, i, j);
        if (i, j) == (0, 3) {
            // Far from the truth: found false.
            constraint.kind = v1::ConstraintKind::LoopClosure.into();
            let pose = constraint.keyframe_i_from_keyframe_j.as_mut().unwrap();
            pose.translation.as_mut().unwrap().x += 5.0;
        }
        stream.send(opened.next_sequence + k as i64, Item::RelativePose(constraint)).await;
    }
    stream.finish().await.unwrap();
    let (stream, _) = Stream::open(server, "room", "drone", 0).await;
    stream.finish().await.unwrap();
}

/// A server with that map, and the map as a file of covis.
async fn exported() -> (TestServer, Vec<File>) {
    let server = TestServer::start().await;
    build(&server).await;
    let files = export(&server, "room", v1::MapFormat::Covis).await;
    (server, files)
}

#[test]
fn a_map_moves_to_another_server_as_it_is() {
    run(async {
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let paths = folders.each_ref().map(|folder| folder.path().to_owned());
        let start = async |k: usize| {
            TestServer::with(|config| config.data_dir = Some(paths[k].clone())).await
        };
        let (here, there) = (start(0).await, start(1).await);
        build(&here).await;
        let files = export(&here, "room", v1::MapFormat::Covis).await;
        assert_eq!(files.iter().map(|(path, _)| path.as_str()).collect::<Vec<_>>(), ["map.covis"]);
        let imported = import(&there, header("hall", v1::MapFormat::Covis), &files).await.unwrap();
        let (before, hash) = get(&here, "room").await.unwrap();
        let (after, other) = get(&there, "hall").await.unwrap();
        assert_eq!((&after, &other), (&imported, &hash));
        assert_eq!(before.counts.unwrap().switched_off_constraint_count, 1);
        let expected = v1::Map {
            map_id: "hall".to_owned(),
            uid: after.uid.clone(),
            create_time: after.create_time,
            update_time: after.update_time,
            ..before.clone()
        };
        assert_eq!(after, expected);
        assert_ne!(after.uid, before.uid);
        here.running.shutdown().await;
        there.running.shutdown().await;
        let hash = on_disk(&paths[0], "room").await.state_hash();
        assert_eq!(on_disk(&paths[1], "hall").await.state_hash(), hash, "revisions and items too");

        // It goes on: a re-sent item is known, a new one is taken, and a restart brings both back.
        let there = start(1).await;
        let (mut stream, opened) = Stream::open(&there, "hall", "robot", 0).await;
        let robot = before.clients.iter().find(|client| client.client_id == "robot").unwrap();
        assert_eq!(opened.next_sequence, robot.next_sequence);
        assert!(stream.put(2, Item::Keyframe(keyframe(0))).await.duplicate);
        let ack = stream.put(opened.next_sequence, Item::Keyframe(keyframe(4))).await;
        assert!(ack.violations.is_empty(), "{ack:?}");
        stream.finish().await.unwrap();
        there.running.shutdown().await;
        let there = start(1).await;
        let (map, _) = get(&there, "hall").await.unwrap();
        assert_eq!((map.counts.unwrap().keyframe_count, map.state()), (5, v1::MapState::Open));
    });
}

#[test]
fn an_import_can_have_another_name_and_policy() {
    run(async {
        let (server, files) = exported().await;
        let own = v1::ImportMapHeader {
            display_name: "Copy".to_owned(),
            policy: Some(v1::MapPolicy { max_iteration_count: Some(3), ..Default::default() }),
            ..header("copy", v1::MapFormat::Covis)
        };
        let map = import(&server, own, &files).await.unwrap();
        let policy = map.policy.unwrap();
        assert_eq!(map.display_name, "Copy");
        assert_eq!((policy.max_iteration_count, policy.window_keyframe_count), (Some(3), Some(20)));
        // Solves go on with it.
        let request = v1::OptimizeMapRequest { map_id: "copy".to_owned(), ..Default::default() };
        server.optimize_map(request).await.unwrap();
    });
}

#[test]
fn an_import_keeps_the_anchor_of_a_map_with_priors() {
    run(async {
        let server = TestServer::start().await;
        let place =
            |latitude_deg| Some(v1::GeodeticPosition { latitude_deg, ..Default::default() });
        let anchored = |latitude_deg| v1::MapPolicy {
            geodetic_anchor: place(latitude_deg),
            max_iteration_count: Some(3),
            ..Default::default()
        };
        server.create_map_with("room", anchored(40.0)).await;
        server.build_map("room", 1).await;
        let (mut stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        let prior = v1::PositionPrior {
            id: 1,
            keyframe: Some(v1::KeyframeRef { id: 0, ..Default::default() }),
            geodetic_point: place(40.0),
            information: Some(information3(1.0)),
            ..Default::default()
        };
        let ack = stream.put(opened.next_sequence, Item::PositionPrior(prior)).await;
        assert!(ack.violations.is_empty(), "{ack:?}");
        stream.finish().await.unwrap();
        let format = v1::MapFormat::Covis;
        let files = export(&server, "room", format).await;
        let with = |policy| v1::ImportMapHeader { policy: Some(policy), ..header("copy", format) };
        for policy in [anchored(41.0), v1::MapPolicy::default()] {
            let status = import(&server, with(policy), &files).await.unwrap_err();
            check_field(&status, "policy.geodetic_anchor", "INCONSISTENT");
        }
        let policy = import(&server, with(anchored(40.0)), &files).await.unwrap().policy.unwrap();
        assert_eq!((policy.geodetic_anchor, policy.max_iteration_count), (place(40.0), Some(3)));
    });
}

#[test]
fn models_of_other_programs_become_maps() {
    run(async {
        let server = TestServer::start().await;
        build(&server).await;
        for (name, format) in
            [("text", v1::MapFormat::ColmapText), ("binary", v1::MapFormat::ColmapBinary)]
        {
            let files = export(&server, "room", format).await;
            let map = import(&server, header(name, format), &files).await.unwrap();
            let counts = map.counts.unwrap();
            assert_eq!((counts.camera_count, counts.keyframe_count), (1, 4));
            assert_eq!(
                (counts.landmark_count, counts.observation_count),
                (LANDMARKS, 4 * LANDMARKS)
            );
            assert_eq!(map.clients[0].client_id, "import");
        }
        let files = export(&server, "room", v1::MapFormat::G2o).await;
        let named = v1::ImportMapHeader {
            client_id: "graph".to_owned(),
            ..header("graph", v1::MapFormat::G2o)
        };
        let map = import(&server, named, &files).await.unwrap();
        let counts = map.counts.unwrap();
        // What is switched off is not in the file; what the last two keyframes measure is.
        assert_eq!((counts.keyframe_count, counts.constraint_count), (4, 3));
        assert_eq!(map.clients[0].client_id, "graph");
        let files = export(&server, "room", v1::MapFormat::Tum).await;
        let map = import(&server, header("tum", v1::MapFormat::Tum), &files).await.unwrap();
        assert_eq!(map.clients[0].client_id, "robot");
        let request = |map_id: &str| v1::GetTrajectoryRequest {
            map_id: map_id.to_owned(),
            ..Default::default()
        };
        let mut poses = Vec::new();
        for map in ["room", "tum"] {
            let mut stream = server.maps().get_trajectory(request(map)).await.unwrap().into_inner();
            poses.push(stream.message().await.unwrap().unwrap().poses);
        }
        assert_eq!(poses[0].len(), poses[1].len());
        for (a, b) in poses[0].iter().zip(&poses[1]) {
            assert_eq!(a.capture_time, b.capture_time);
            let x =
                |pose: &v1::KeyframePose| pose.world_from_camera.unwrap().translation.unwrap().x;
            assert!((x(a) - x(b)).abs() < 1e-12);
        }
        // The new maps are maps like any other.
        let (stream, _) = Stream::open(&server, "binary", "robot", 0).await;
        stream.finish().await.unwrap();
    });
}

#[test]
fn bytes_that_are_damaged_or_too_new_are_named_and_make_no_map() {
    run(async {
        let (server, files) = exported().await;
        let format = v1::MapFormat::Covis;
        let (path, bytes) = &files[0];
        let mut damaged = bytes.clone();
        let middle = damaged.len() / 2;
        damaged[middle] ^= 1;
        let mut later = bytes.clone();
        later[8..16].copy_from_slice(&[9, 0, 0, 0, 9, 0, 0, 0]);
        let crc = crc32c::crc32c(&later[..16]).to_le_bytes();
        later[16..20].copy_from_slice(&crc);
        let cases: [(Vec<u8>, &str, &str); 4] = [
            (damaged, "INCONSISTENT", "map.covis: byte "),
            (bytes[..middle].to_vec(), "INCONSISTENT", "map.covis: byte "),
            (later, "UNKNOWN_VALUE", "map.covis: the file needs version 9"),
            (Vec::new(), "INCONSISTENT", "map.covis: byte 0"),
        ];
        for (bytes, reason, text) in cases {
            let files = [(path.clone(), bytes)];
            let status = import(&server, header("copy", format), &files).await.unwrap_err();
            check_field(&status, "chunk.data", reason);
            assert!(status.message().contains(text), "{}", status.message());
        }
        let mut models = export(&server, "room", v1::MapFormat::ColmapText).await;
        models[1].1.extend_from_slice(b"not a number\n");
        let colmap = header("copy", v1::MapFormat::ColmapText);
        let status = import(&server, colmap.clone(), &models).await.unwrap_err();
        check_field(&status, "chunk.data", "INCONSISTENT");
        assert!(status.message().contains("images.txt, line "), "{}", status.message());
        let status = import(&server, colmap, &models[..1]).await.unwrap_err();
        assert!(status.message().contains("images.txt is not among"), "{}", status.message());
        let status = get(&server, "copy").await.unwrap_err();
        check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
    });
}

#[test]
fn an_upload_that_breaks_the_order_or_ends_early_makes_no_map() {
    run(async {
        let (server, files) = exported().await;
        let format = v1::MapFormat::Covis;
        let whole = upload(header("copy", format), &files);
        assert!(whole.len() > 3, "{}", whole.len());
        let mut swapped = whole.clone();
        swapped.swap(1, 2);
        let twice = [&whole[..1], &whole[..]].concat();
        let other = [&whole[..], &whole[1..]].concat();
        let empty = [&whole[..1], &[v1::ImportMapRequest { content: None }]].concat();
        let cases = [
            (Vec::new(), "header"),
            (whole[1..].to_vec(), "header"),
            (whole[..1].to_vec(), "chunk"),
            (whole[..2].to_vec(), "chunk"),
            (swapped, "chunk.offset"),
            (twice, "header"),
            (other, "chunk.path"),
            (empty, "content"),
        ];
        for (messages, field) in cases {
            check_field(&send(&server, messages).await.unwrap_err(), field, "PROTOCOL");
        }
        // A caller that leaves.
        let (sender, receiver) = tokio::sync::mpsc::channel(1);
        let mut maps = server.maps();
        let stream = tokio_stream::wrappers::ReceiverStream::new(receiver);
        let call = tokio::spawn(async move { maps.import_map(stream).await });
        for message in &whole[..whole.len() - 1] {
            sender.send(message.clone()).await.unwrap();
        }
        call.abort();
        assert!(call.await.unwrap_err().is_cancelled());
        let status = get(&server, "copy").await.unwrap_err();
        check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
        assert!(send(&server, whole).await.is_ok(), "the name is free");
    });
}

#[test]
fn import_map_refuses_bad_requests() {
    run(async {
        let (server, files) = exported().await;
        let format = v1::MapFormat::Covis;
        let status = import(&server, header("room", format), &files).await.unwrap_err();
        check_status(&status, Code::AlreadyExists, "MAP_EXISTS");
        let good = || header("copy", format);
        let cases = [
            (header("", format), "map_id", "MISSING"),
            (header("A", format), "map_id", "OUT_OF_RANGE"),
            (header("copy", v1::MapFormat::Unspecified), "format", "MISSING"),
            (header("copy", v1::MapFormat::Ply), "format", "OUT_OF_RANGE"),
            (v1::ImportMapHeader { format: 99, ..good() }, "format", "UNKNOWN_VALUE"),
            (
                v1::ImportMapHeader { client_id: "No".to_owned(), ..good() },
                "client_id",
                "OUT_OF_RANGE",
            ),
            (
                v1::ImportMapHeader { display_name: "x".repeat(257), ..good() },
                "display_name",
                "TOO_LARGE",
            ),
            (
                v1::ImportMapHeader {
                    policy: Some(v1::MapPolicy {
                        max_iteration_count: Some(0),
                        ..Default::default()
                    }),
                    ..good()
                },
                "policy.max_iteration_count",
                "OUT_OF_RANGE",
            ),
        ];
        for (header, field, reason) in cases {
            check_field(&import(&server, header, &files).await.unwrap_err(), field, reason);
        }
    });
}

#[test]
fn an_import_never_exceeds_what_the_server_holds() {
    run(async {
        let (server, files) = exported().await;
        let format = v1::MapFormat::Covis;
        let models = export(&server, "room", v1::MapFormat::ColmapText).await;
        let small = TestServer::with(|config| {
            config.map_limits.landmarks = Some(LANDMARKS as u64 - 1);
        })
        .await;
        for (format, files) in [(format, &files), (v1::MapFormat::ColmapText, &models)] {
            let status = import(&small, header("copy", format), files).await.unwrap_err();
            check_status(&status, Code::ResourceExhausted, "MAP_LIMIT");
            check_retry(&status);
            let status = get(&small, "copy").await.unwrap_err();
            check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
        }
        let full = TestServer::with(|config| config.max_maps = Some(1)).await;
        assert!(import(&full, header("one", format), &files).await.is_ok());
        let status = import(&full, header("two", format), &files).await.unwrap_err();
        check_status(&status, Code::ResourceExhausted, "SERVER_LIMIT");
    });
}

#[test]
fn files_are_priced_before_they_are_parsed() {
    run(async {
        let server = TestServer::with(|config| {
            let held = MapLimits { bytes: Some(2 << 20), ..MapLimits::default() };
            config.server_limits = AccountLimits::of_maps(held);
        })
        .await;
        // Less than 300 kB each, and more than 2 MiB once they are parsed; the last line is damaged.
        let text = |line: &str, times| format!("{}x y\n", line.repeat(times)).into_bytes();
        let file = |path: &str, bytes: Vec<u8>| (path.to_owned(), bytes);
        let camera = b"1 PINHOLE 640 480 300 300 320 240\n".to_vec();
        let model = [
            file("cameras.txt", camera),
            file("images.txt", text("0 0 -1 ", 20_000)),
            file("points3D.txt", Vec::new()),
        ];
        let cases: [(v1::MapFormat, &[File]); 3] = [
            (v1::MapFormat::Tum, &[file("a.tum", text("1 0 0 0 0 0 0 1\n", 18_000))]),
            (v1::MapFormat::G2o, &[file("a.g2o", text("FIX 0\n", 40_000))]),
            (v1::MapFormat::ColmapText, &model),
        ];
        for (format, files) in cases {
            assert!(files.iter().all(|(_, bytes)| bytes.len() < 300_000), "{format:?}");
            let status = import(&server, header("copy", format), files).await.unwrap_err();
            check_status(&status, Code::ResourceExhausted, "SERVER_LIMIT");
            assert!(status.message().contains("max_size_bytes"), "{format:?}: {status}");
        }
        let short = [file("a.tum", b"1 0 0 0 0 0 0 1\n".to_vec())];
        import(&server, header("copy", v1::MapFormat::Tum), &short).await.unwrap();
    });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn a_changed_byte_never_makes_a_map(at in any::<prop::sample::Index>(), change in 1_u8..) {
        run(async {
            let server = TestServer::start().await;
            server.create_map("room").await;
            let format = v1::MapFormat::Covis;
            let mut files = export(&server, "room", format).await;
            let at = at.index(files[0].1.len());
            files[0].1[at] ^= change;
            let status = import(&server, header("copy", format), &files).await.unwrap_err();
            assert_eq!(status.code(), Code::InvalidArgument, "byte {at}: {status:?}");
            assert!(get(&server, "copy").await.is_err());
        });
    }
}
