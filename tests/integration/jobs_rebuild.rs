//! Jobs that find poses and points anew, from observations alone; and a map's solve whose job was killed
//! before it was written down.

use std::path::Path;

use covis::client::Client;
use covis::wire::v1;
use tonic::Code;
use v1::JobState;
use v1::ingest_request::Item;
use v1::job_result::Result as Kind;
use v1::job_spec::Spec;

use crate::cli_support::Workspace;
use crate::common::{
    LANDMARKS, Stream, TestServer, camera, check_status, keyframe, keyframe_position,
    landmark_position, occupy, run, shift, vector3,
};
use crate::job_support::{BUNDLE, Jobs, optimize, state_hash, twin};
use crate::jobs_restart::spawn;

/// Keyframes of the scene.
const KEYFRAMES: i64 = 10;
/// A keyframe that observes nothing.
const BLIND: i64 = 99;

fn rebuild(map_id: &str) -> Spec {
    Spec::Reconstruct(v1::ReconstructSpec { map_id: map_id.to_owned(), ..Default::default() })
}

/// A pose far from the true one.
fn wrong(id: i64) -> v1::RigidTransform {
    let (sin, cos) = (0.35 * id as f64 + 0.8).sin_cos();
    v1::RigidTransform {
        translation: Some(vector3([4.0 * sin, -3.0 * cos, id as f64 - 7.0])),
        rotation: Some(v1::Quaternion { x: 0.0, y: sin, z: 0.0, w: cos }),
    }
}

/// A map whose client sent wrong poses of some keyframes, no landmark's position, and depths where it has
/// them.
async fn lost_map(server: &TestServer, is_wrong: impl Fn(i64) -> bool, has_depth: bool) {
    let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
    server.create_map_with("room", policy).await;
    let (stream, _) = Stream::open(server, "room", "robot", 0).await;
    stream.send(1, Item::Camera(camera(0))).await;
    for id in 0..KEYFRAMES {
        let truth = shift(keyframe_position(id));
        let mut item = v1::Keyframe {
            world_from_camera: Some(if is_wrong(id) { wrong(id) } else { truth }),
            ..keyframe(id)
        };
        item.landmarks.iter_mut().for_each(|landmark| landmark.point_in_world = None);
        if has_depth {
            for (index, observation) in item.observations.iter_mut().enumerate() {
                let depth = landmark_position(index as i64)[2] - keyframe_position(id)[2];
                (observation.depth_m, observation.sigma_depth_m) = (Some(depth), Some(0.01));
            }
        }
        stream.send(id + 2, Item::Keyframe(item)).await;
    }
    let blind = v1::Keyframe { id: BLIND, observations: Vec::new(), ..keyframe(KEYFRAMES) };
    stream.send(KEYFRAMES + 2, Item::Keyframe(blind)).await;
    for ack in stream.finish().await.unwrap() {
        assert!(ack.violations.is_empty(), "{ack:?}");
    }
}

/// Positions of a map's keyframes by id.
fn positions(map: &v1::MapDelta) -> Vec<(i64, [f64; 3])> {
    let position = |keyframe: &v1::KeyframePose| {
        let pose = keyframe.world_from_camera.as_ref().unwrap();
        let at = pose.translation.as_ref().unwrap();
        let reference = keyframe.keyframe.as_ref().unwrap();
        (reference.id, [at.x, at.y, at.z])
    };
    map.keyframes.iter().map(position).collect()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

fn result(job: &v1::Job) -> v1::ReconstructResult {
    let Some(Kind::Reconstruct(result)) = job.result.clone().unwrap().result else {
        panic!("{job:?}")
    };
    result
}

#[test]
fn a_map_with_depth_whose_poses_are_all_wrong_is_rebuilt() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        lost_map(&server, |_| true, true).await;
        let before = server.watched("room").await;
        let blind_before = positions(&before).pop().unwrap();
        jobs.create("night", rebuild("room")).await.unwrap();
        let job = jobs.success("night").await;
        let result = result(&job);
        let found = result.reconstruction.unwrap();
        assert_eq!(found.length_unit(), v1::LengthUnit::Depth);
        assert_eq!((found.keyframe_count, found.placed_keyframe_count), (11, 10));
        assert_eq!(found.placed_landmark_count, LANDMARKS);
        assert_eq!(found.agreeing_observation_count, KEYFRAMES * LANDMARKS);
        let [unplaced] = &found.unplaced_keyframes[..] else { panic!("{found:?}") };
        assert_eq!((unplaced.client_id.as_str(), unplaced.id), ("robot", BLIND));
        assert_eq!(unplaced.reason, "it has no observations");
        assert!(job.cost_after.unwrap() < 1e-9 * (1.0 + job.cost_before.unwrap()), "{job:?}");

        let map = server.watched("room").await;
        assert_eq!(positions(&map).pop().unwrap(), blind_before, "it keeps its pose");
        let first = |map: &v1::MapDelta| map.keyframes[0].world_from_camera;
        assert_eq!(first(&map), first(&before), "the gauge holds the first keyframe");
        assert_eq!(result.summary.unwrap().gauge(), v1::Gauge::FirstKeyframeFixed);
        let truth = (0..KEYFRAMES).map(|id| v1::KeyframePose {
            capture_time: keyframe(id).capture_time,
            world_from_camera: Some(shift(keyframe_position(id))),
            ..Default::default()
        });
        let evaluation = v1::EvaluateTrajectorySpec {
            map_id: "room".to_owned(),
            client_id: "robot".to_owned(),
            truth: truth.collect(),
            ..Default::default()
        };
        jobs.create("truth", Spec::EvaluateTrajectory(evaluation)).await.unwrap();
        let Some(Kind::EvaluateTrajectory(ape)) =
            jobs.success("truth").await.result.unwrap().result
        else {
            panic!()
        };
        assert_eq!(ape.matched_pose_count, KEYFRAMES);
        assert!(ape.absolute_translation_rmse_m < 1e-4, "{ape:?}");
    });
}

#[test]
fn a_map_without_depth_keeps_the_frame_and_the_scale_of_most_of_its_poses() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        lost_map(&server, |id| id % 4 == 2, false).await;
        jobs.create("night", rebuild("room")).await.unwrap();
        let result = result(&jobs.success("night").await);
        let found = result.reconstruction.unwrap();
        assert_eq!(found.length_unit(), v1::LengthUnit::Given);
        assert_eq!(found.placed_keyframe_count, KEYFRAMES);
        let map = server.watched("room").await;
        for (id, at) in positions(&map).into_iter().filter(|&(id, _)| id != BLIND) {
            let off = distance(at, keyframe_position(id));
            assert!(off < 1e-3, "keyframe {id} is {off} m off");
        }
        for landmark in &map.landmarks {
            let at = landmark.point_in_world.as_ref().unwrap();
            let off = distance([at.x, at.y, at.z], landmark_position(landmark.id));
            assert!(off < 1e-2, "landmark {} is {off} m off", landmark.id);
        }
        let report = jobs.report("night").await;
        assert_eq!(report["rebuilt"]["scale"], "that of the given poses");
        assert_eq!(report["rebuilt"]["unplaced"][0]["id"], BLIND);
        assert_eq!(report["revision"], result.revision);
        // Frontends go on where they are: a keyframe that comes now fits.
        let (stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.send(KEYFRAMES + 3, Item::Keyframe(keyframe(KEYFRAMES + 1))).await;
        for ack in stream.finish().await.unwrap() {
            assert!(ack.violations.is_empty(), "{ack:?}");
        }
    });
}

#[test]
fn a_rebuild_that_is_canceled_leaves_the_map_as_it_was() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        lost_map(&server, |_| true, true).await;
        let before = state_hash(&server, "room").await;
        let occupied = occupy(&server).await;
        jobs.create("night", rebuild("room")).await.unwrap();
        jobs.until("night", |job| job.state() == JobState::Running).await;
        jobs.cancel("night").await.unwrap();
        assert_eq!(jobs.end("night").await.state(), JobState::Cancelled);
        drop(occupied);
        // The optimization waits for what the canceled one left behind.
        jobs.create("next", rebuild("room")).await.unwrap();
        assert_eq!(state_hash(&server, "room").await, before);
        jobs.success("next").await;
        assert_ne!(state_hash(&server, "room").await, before);
    });
}

#[test]
fn what_cannot_be_rebuilt_is_refused_or_fails_with_the_reason() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        let spec = |map_id: &str, upload_id: &str, keep_solutions| {
            let (map_id, upload_id) = (map_id.to_owned(), upload_id.to_owned());
            Spec::Reconstruct(v1::ReconstructSpec { map_id, upload_id, keep_solutions })
        };
        let id = "0123456789abcdef0123456789abcdef";
        for (spec, code, reason) in [
            (spec("", "", false), Code::InvalidArgument, "MISSING"),
            (spec("room", id, false), Code::InvalidArgument, "INCONSISTENT"),
            (spec("room", "", true), Code::InvalidArgument, "INCONSISTENT"),
            (spec("", "x", false), Code::InvalidArgument, "OUT_OF_RANGE"),
            (spec("", id, false), Code::NotFound, "UPLOAD_NOT_FOUND"),
            (spec("nowhere", "", false), Code::NotFound, "MAP_NOT_FOUND"),
        ] {
            check_status(&jobs.create("bad", spec).await.unwrap_err(), code, reason);
        }
        // A map without observations.
        server.create_map_with("empty", v1::MapPolicy::default()).await;
        jobs.create("empty", rebuild("empty")).await.unwrap();
        let job = jobs.end("empty").await;
        assert_eq!(job.state(), JobState::Failed);
        let failure = job.failure.unwrap();
        assert_eq!(failure.code, Code::FailedPrecondition as i32);
        assert!(failure.message.contains("the problem has no observations"), "{failure:?}");
        // Pose graphs have no observations.
        let upload = jobs.upload(&[("graph.g2o", twin("grid-200.g2o"))]).await.unwrap();
        jobs.create("graph", spec("", &upload, false)).await.unwrap();
        assert_eq!(jobs.end("graph").await.state(), JobState::Failed);
    });
}

#[test]
fn files_are_rebuilt_to_the_digits_of_covis_solve() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        let workspace = Workspace::new();
        let out = workspace.path("out.txt");
        let path = crate::cli_support::golden("twins").join(BUNDLE);
        let solved = workspace.json("solve bundle {} --rebuild --json --out {}", &[&path, &out]);
        let upload_id = jobs.upload(&[(BUNDLE, twin(BUNDLE))]).await.unwrap();
        let spec = v1::ReconstructSpec { upload_id, keep_solutions: true, ..Default::default() };
        jobs.create("file", Spec::Reconstruct(spec)).await.unwrap();
        let job = jobs.success("file").await;
        for (cost, key) in [(job.cost_before, "initial_cost"), (job.cost_after, "final_cost")] {
            let wanted = solved[key].as_f64().unwrap();
            assert_eq!(cost.unwrap().to_bits(), wanted.to_bits(), "{key}");
        }
        let result = result(&job);
        assert_eq!(result.problems[0].path, BUNDLE);
        assert_eq!(result.problems[0].reconstruction.as_ref().unwrap().placed_keyframe_count, 6);
        let report = jobs.report("file").await;
        for key in ["keyframes", "placed", "dropped_observations", "scale", "relative_poses"] {
            assert_eq!(report["rebuilt"][key], solved["rebuilt"][key], "{key}");
        }
        let kept = jobs.download("file", BUNDLE).await.unwrap();
        assert_eq!(kept[0].1, fs_err::read(&out).unwrap());
    });
}

/// A server in this process on a folder that others use before and after.
async fn server(folder: &Path) -> TestServer {
    TestServer::with(|config| config.data_dir = Some(folder.to_owned())).await
}

#[cfg(unix)]
#[test]
fn a_rebuild_that_kill_9_cuts_off_comes_to_one_result() {
    run(async {
        let workspace = Workspace::new();
        let (folder, other) = (workspace.path("data"), workspace.path("other"));
        let first = server(&folder).await;
        lost_map(&first, |_| true, true).await;
        let revision = first.watched("room").await.revision;
        first.running.shutdown().await;
        let undisturbed = server(&other).await;
        lost_map(&undisturbed, |_| true, true).await;
        let jobs = Jobs::of(&undisturbed);
        jobs.create("night", rebuild("room")).await.unwrap();
        jobs.success("night").await;
        let wanted = undisturbed.watched("room").await;
        undisturbed.running.shutdown().await;

        // The reconstruction has begun, and does not go on.
        let mut killed = spawn(&workspace, &folder, "hold-reconstruction");
        let client = Client::connect(&killed.url).await.unwrap();
        let arguments = "job submit rebuild --map room --id night --json --server";
        workspace.json(&format!("{arguments} {}", killed.url), &[]);
        loop {
            let job = client.job("night").await.unwrap();
            assert!(job.end_time.is_none(), "{job:?}");
            // A share comes with the first step of the solve.
            if job.progress.is_some_and(|progress| progress.share.is_some()) {
                break;
            }
            tokio::task::yield_now().await;
        }
        killed.kill();
        let mut again = spawn(&workspace, &folder, "");
        let client = Client::connect(&again.url).await.unwrap();
        let job = client.watch_job("night", |_| {}).await.unwrap();
        assert_eq!(job.state(), JobState::Succeeded, "{job:?}");
        again.kill();
        let last = server(&folder).await;
        let found = last.watched("room").await;
        assert_eq!(found.revision, revision + 1, "applied once");
        assert_eq!(found.keyframes, wanted.keyframes, "to the bit");
        assert_eq!(found.landmarks, wanted.landmarks);
        last.running.shutdown().await;
    });
}

#[cfg(unix)]
#[test]
fn a_result_that_was_applied_before_kill_9_is_not_applied_again() {
    run(async {
        for spec in [rebuild("room"), optimize("room")] {
            let workspace = Workspace::new();
            let folder = workspace.path("data");
            let first = server(&folder).await;
            lost_map(&first, |id| id == 3, true).await;
            let revision = first.watched("room").await.revision;
            first.running.shutdown().await;
            let mut held = spawn(&workspace, &folder, "hold-applied");
            let client = Client::connect(&held.url).await.unwrap();
            let spec = Some(v1::JobSpec { spec: Some(spec) });
            let job_id = "night".to_owned();
            client.create_job(v1::CreateJobRequest { job_id, spec, priority: 0 }).await.unwrap();
            loop {
                let job = client.job("night").await.unwrap();
                assert!(job.end_time.is_none(), "{job:?}");
                if job.progress.unwrap_or_default().phase == "held by a test" {
                    break;
                }
                tokio::task::yield_now().await;
            }
            held.kill();
            let server = spawn(&workspace, &folder, "");
            let client = Client::connect(&server.url).await.unwrap();
            let job = client.watch_job("night", |_| {}).await.unwrap();
            assert_eq!((job.state(), job.attempt_count), (JobState::Succeeded, 2), "{job:?}");
            assert_eq!(client.get_map("room").await.unwrap().revision, revision + 1);
            let result = job.result.unwrap().result.unwrap();
            let found = if let Kind::Reconstruct(result) = result {
                result.revision
            } else if let Kind::OptimizeMap(result) = result {
                result.revision
            } else {
                panic!("{result:?}")
            };
            assert_eq!(found, revision + 1);
            assert!(job.cost_after.unwrap() <= job.cost_before.unwrap());
            let report: serde_json::Value =
                serde_json::from_slice(&client.job_file("night", "report.json").await.unwrap())
                    .unwrap();
            assert!(report["note"].as_str().unwrap().contains("applied before"), "{report}");
        }
    });
}
