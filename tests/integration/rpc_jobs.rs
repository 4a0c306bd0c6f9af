//! `JobService` over a loopback port: each kind to its end, each code, cancels.

use covis::service::Clock;
use covis::wire::v1;
use tokio::sync::watch;
use tonic::Code;
use v1::job_result::Result as Kind;
use v1::job_spec::Spec;
use v1::{JobState, MapFormat};

use crate::common::{TestServer, check_field, check_status, keyframe_position, occupy, run, shift};
use crate::job_support::{
    BUNDLE, GRAPH, Jobs, compact, export, optimize, pose_graph, solve, state_hash, twin,
    unsolved_map,
};

async fn freeze(server: &TestServer, map_id: &str) {
    let request = v1::UpdateMapRequest {
        map_id: map_id.to_owned(),
        state: v1::MapState::Frozen.into(),
        update_mask: Some(prost_types::FieldMask { paths: vec!["state".to_owned()] }),
        ..Default::default()
    };
    server.maps().update_map(request).await.unwrap();
}

/// The true trajectory of the scene's first keyframes.
fn truth(keyframes: i64) -> Vec<v1::KeyframePose> {
    (0..keyframes)
        .map(|id| v1::KeyframePose {
            capture_time: Some(prost_types::Timestamp { seconds: 100 + id, nanos: 500_000_000 }),
            world_from_camera: Some(shift(keyframe_position(id))),
            ..Default::default()
        })
        .collect()
}

fn evaluate(map_id: &str, client_id: &str, truth: Vec<v1::KeyframePose>) -> Spec {
    Spec::EvaluateTrajectory(v1::EvaluateTrajectorySpec {
        map_id: map_id.to_owned(),
        client_id: client_id.to_owned(),
        truth,
        ..Default::default()
    })
}

#[test]
fn a_map_is_optimized_as_the_call_does_it() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        for map_id in ["called", "job"] {
            unsolved_map(&server, map_id, 6).await;
        }
        let request = v1::OptimizeMapRequest { map_id: "called".to_owned(), ..Default::default() };
        let (rows, called) = server.optimize_map(request).await.unwrap();
        let created = jobs.create("night", optimize("job")).await.unwrap();
        assert_eq!(created.job_id, "night");
        let job = jobs.success("night").await;
        let Some(Kind::OptimizeMap(result)) = job.result.clone().unwrap().result else {
            panic!("{job:?}")
        };
        let (wanted, found) = (called.summary.unwrap(), result.summary.unwrap());
        assert_eq!(found.final_cost.to_bits(), wanted.final_cost.to_bits());
        assert_eq!(job.cost_before.unwrap().to_bits(), wanted.initial_cost.to_bits());
        assert_eq!(job.cost_after.unwrap().to_bits(), wanted.final_cost.to_bits());
        assert!(job.cost_after < job.cost_before);
        assert_eq!(job.attempt_count, 1);
        for time in [job.create_time, job.start_time, job.end_time, job.expire_time] {
            assert!(time.is_some(), "{job:?}");
        }
        let last = job.progress.unwrap().iteration.unwrap();
        assert_eq!(last.cost.to_bits(), rows.last().unwrap().cost.to_bits());
        let (a, b) = (server.watched("called").await, server.watched("job").await);
        assert_eq!(a.keyframes, b.keyframes, "the same poses");

        let report = jobs.report("night").await;
        assert_eq!(report["final_cost"].as_f64().unwrap().to_bits(), wanted.final_cost.to_bits());
        assert_eq!(report["iterations"].as_array().unwrap().len(), rows.len());
        assert_eq!(report["map"], "job");
    });
}

#[test]
fn pose_graphs_exports_evaluations_and_compactions_run_to_their_ends() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 8).await;
        jobs.create("graph", pose_graph("house")).await.unwrap();
        let job = jobs.success("graph").await;
        assert!(job.cost_after.unwrap() <= job.cost_before.unwrap());
        assert_eq!(jobs.report("graph").await["keyframes"], 8);

        jobs.create("adjust", optimize("house")).await.unwrap();
        jobs.success("adjust").await;
        jobs.create("truth", evaluate("house", "robot", truth(8))).await.unwrap();
        let job = jobs.success("truth").await;
        assert!(job.spec.is_some());
        let Some(Kind::EvaluateTrajectory(result)) = job.result.unwrap().result else { panic!() };
        assert_eq!(result.matched_pose_count, 8);
        assert!(result.absolute_translation_rmse_m < 1e-3, "{result:?}");
        let report = jobs.report("truth").await;
        let ape = report["ape"]["translation_m"]["rmse"].as_f64().unwrap();
        assert_eq!(ape, result.absolute_translation_rmse_m);
        // The same truth as a file.
        let lines: Vec<String> = (0..8)
            .map(|id| {
                let [x, y, z] = keyframe_position(id);
                format!("{}.5 {x} {y} {z} 0 0 0 1\n", 100 + id)
            })
            .collect();
        let upload = jobs.upload(&[("truth.tum", lines.concat().into_bytes())]).await.unwrap();
        let Spec::EvaluateTrajectory(spec) = evaluate("house", "robot", Vec::new()) else {
            panic!()
        };
        let spec = v1::EvaluateTrajectorySpec { truth_upload_id: upload, ..spec };
        jobs.create("file", Spec::EvaluateTrajectory(spec)).await.unwrap();
        let Some(Kind::EvaluateTrajectory(again)) =
            jobs.success("file").await.result.unwrap().result
        else {
            panic!()
        };
        assert!((again.absolute_translation_rmse_m - ape).abs() < 1e-12);

        for format in [MapFormat::Covis, MapFormat::G2o, MapFormat::Tum, MapFormat::ColmapBinary] {
            let id = format!("export-{}", i32::from(format));
            jobs.create(&id, export("house", format)).await.unwrap();
            let job = jobs.success(&id).await;
            let made = jobs.download(&id, "").await.unwrap();
            let paths: Vec<&str> = made.iter().map(|(path, _)| path.as_str()).collect();
            assert_eq!(paths, job.files.iter().map(|f| f.path.as_str()).collect::<Vec<_>>());
            assert_eq!(paths[0], "report.json");
            let request = v1::ExportMapRequest {
                map_id: "house".to_owned(),
                format: format.into(),
                all_landmarks: false,
            };
            let mut stream = server.maps().export_map(request).await.unwrap().into_inner();
            let mut called: Vec<(String, Vec<u8>)> = Vec::new();
            while let Some(message) = stream.message().await.unwrap() {
                if let Some(v1::export_map_response::Content::Chunk(chunk)) = message.content {
                    if chunk.offset == 0 {
                        called.push((chunk.path, Vec::new()));
                    }
                    called.last_mut().unwrap().1.extend(chunk.data);
                }
            }
            assert_eq!(made[1..], called, "{format:?}");
        }

        // Every landmark is seen by all: all keyframes but the newest two are redundant.
        jobs.create("small", compact("house", Some(0.5))).await.unwrap();
        let Some(Kind::CompactMap(result)) = jobs.success("small").await.result.unwrap().result
        else {
            panic!()
        };
        let (before, after) = (result.counts_before.unwrap(), result.counts_after.unwrap());
        assert_eq!(before.keyframe_count, 8);
        assert_eq!(after.keyframe_count, 8 - result.retired_keyframe_count);
        assert!(result.retired_keyframe_count > 0, "{result:?}");
        assert!(after.keyframe_count >= 3, "three others see what goes: {result:?}");
    });
}

#[test]
fn files_are_solved_to_the_digits_of_covis_solve() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        let workspace = crate::cli_support::Workspace::new();
        for (index, (name, kind)) in
            [(BUNDLE, "bundle"), (GRAPH, "pose-graph"), ("sphere-200.g2o", "pose-graph")]
                .into_iter()
                .enumerate()
        {
            let path = crate::cli_support::golden("twins").join(name);
            let solved = workspace.json(&format!("solve {kind} {{}} --json"), &[&path]);
            let upload = jobs.upload(&[(name, twin(name))]).await.unwrap();
            let id = format!("file-{index}");
            jobs.create(&id, solve(&upload)).await.unwrap();
            let job = jobs.success(&id).await;
            for (cost, key) in [(job.cost_before, "initial_cost"), (job.cost_after, "final_cost")] {
                let wanted = solved[key].as_f64().unwrap();
                assert_eq!(cost.unwrap().to_bits(), wanted.to_bits(), "{name} {key}");
            }
            let report = jobs.report(&id).await;
            for key in ["initial_cost", "final_cost", "termination", "gradient_max_norm"] {
                assert_eq!(report[key], solved[key], "{name} {key}");
            }
            assert_eq!(report["path"], name);
        }
    });
}

#[test]
fn the_same_job_again_is_the_job_that_is_there() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 4).await;
        let occupied = occupy(&server).await;
        let first = jobs.create("a", optimize("house")).await.unwrap();
        let again = jobs.create("a", optimize("house")).await.unwrap();
        assert_eq!((&first.job_id, first.create_time), (&again.job_id, again.create_time));
        let status = jobs.create("a", pose_graph("house")).await.unwrap_err();
        check_status(&status, Code::AlreadyExists, "JOB_EXISTS");
        // Another one that changes the map is refused until the first has ended; one that reads is not.
        let status = jobs.create("b", pose_graph("house")).await.unwrap_err();
        check_status(&status, Code::Aborted, "JOB_RUNNING");
        jobs.create("c", export("house", MapFormat::Tum)).await.unwrap();
        drop(occupied);
        jobs.success("a").await;
        jobs.success("c").await;
        // Also after its end, and when the map is frozen meanwhile.
        freeze(&server, "house").await;
        let ended = jobs.create("a", optimize("house")).await.unwrap();
        assert_eq!(ended.state(), JobState::Succeeded);
        let status = jobs.create("b", pose_graph("house")).await.unwrap_err();
        check_status(&status, Code::FailedPrecondition, "MAP_FROZEN");
        jobs.create("d", export("house", MapFormat::Tum)).await.unwrap();
        jobs.success("d").await;
    });
}

#[test]
fn what_is_known_to_be_wrong_is_reported_when_a_job_is_created() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 3).await;
        let status = jobs.create("no such name", optimize("house")).await.unwrap_err();
        check_field(&status, "job_id", "OUT_OF_RANGE");
        let status = jobs.create_with("a", optimize("house"), 101).await.unwrap_err();
        check_field(&status, "priority", "OUT_OF_RANGE");
        let status = jobs.create("a", optimize("")).await.unwrap_err();
        check_field(&status, "spec.optimize_map.map_id", "MISSING");
        let status = jobs.create("a", optimize("nowhere")).await.unwrap_err();
        check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
        let status = jobs.create("a", compact("house", Some(1.5))).await.unwrap_err();
        check_field(&status, "spec.compact_map.redundant_share", "OUT_OF_RANGE");
        let status = jobs.create("a", export("house", MapFormat::Unspecified)).await.unwrap_err();
        check_field(&status, "spec.export_map.format", "MISSING");
        let status = jobs.create("a", evaluate("house", "robot", truth(2))).await.unwrap_err();
        check_field(&status, "spec.evaluate_trajectory.truth", "MISSING");
        let mut bad = truth(3);
        bad[1].world_from_camera.as_mut().unwrap().translation.as_mut().unwrap().x = f64::NAN;
        let status = jobs.create("a", evaluate("house", "robot", bad)).await.unwrap_err();
        let field = "spec.evaluate_trajectory.truth[1].world_from_camera.translation.x";
        check_field(&status, field, "NOT_FINITE");
        let status = jobs.create("a", evaluate("house", "nobody", truth(3))).await.unwrap_err();
        check_status(&status, Code::NotFound, "CLIENT_NOT_FOUND");
        let status = jobs.create("a", solve("short")).await.unwrap_err();
        check_field(&status, "spec.solve_files.upload_id", "OUT_OF_RANGE");
        let status = jobs.create("a", solve(&"0".repeat(32))).await.unwrap_err();
        check_status(&status, Code::NotFound, "UPLOAD_NOT_FOUND");
        let rebuild = Spec::RebuildMap(v1::RebuildMapSpec {
            source_map_id: "house".to_owned(),
            target_map_id: "other".to_owned(),
            policy: None,
        });
        let status = jobs.create("a", rebuild).await.unwrap_err();
        check_field(&status, "spec.rebuild_map", "UNIMPLEMENTED");
        for status in [
            jobs.get("a").await.unwrap_err(),
            jobs.cancel("a").await.unwrap_err(),
            jobs.delete("a").await.unwrap_err(),
            jobs.download("a", "").await.unwrap_err(),
            jobs.watch("a").await.unwrap().message().await.unwrap_err(),
        ] {
            check_status(&status, Code::NotFound, "JOB_NOT_FOUND");
        }
        for status in [
            jobs.get("").await.unwrap_err(),
            jobs.cancel("").await.unwrap_err(),
            jobs.delete("").await.unwrap_err(),
        ] {
            check_field(&status, "job_id", "MISSING");
        }
        assert_eq!(jobs.list(Default::default()).await.unwrap().jobs, []);
    });
}

#[test]
fn a_job_that_cannot_be_done_says_why() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        server.create_map("empty").await;
        jobs.create("nothing", optimize("empty")).await.unwrap();
        let job = jobs.end("nothing").await;
        assert_eq!(job.state(), JobState::Failed);
        let failure = job.failure.unwrap();
        assert_eq!(failure.reason, "NOTHING_TO_SOLVE");
        assert_eq!(failure.code, Code::FailedPrecondition as i32);
        assert!(job.files.is_empty() && job.result.is_none() && job.cost_after.is_none());
        let garbage = jobs.upload(&[("a.g2o", b"EDGE_SE2 0 1 what\n".to_vec())]).await.unwrap();
        jobs.create("garbage", solve(&garbage)).await.unwrap();
        let failure = jobs.end("garbage").await.failure.unwrap();
        assert_eq!(failure.code, Code::InvalidArgument as i32);
        assert!(failure.message.contains("a.g2o") && failure.message.contains("line 1"));
        // A deleted map.
        unsolved_map(&server, "house", 3).await;
        let occupied = occupy(&server).await;
        jobs.create("first", optimize("empty")).await.unwrap();
        jobs.create("late", export("house", MapFormat::Tum)).await.unwrap();
        let delete = v1::DeleteMapRequest { map_id: "house".to_owned() };
        server.maps().delete_map(delete).await.unwrap();
        drop(occupied);
        assert_eq!(jobs.end("late").await.failure.unwrap().reason, "MAP_NOT_FOUND");
    });
}

#[test]
fn a_panic_ends_its_job_and_nothing_else() {
    run(async {
        let server = TestServer::with_fault("panic-in-solve").await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 3).await;
        jobs.create("bug", optimize("house")).await.unwrap();
        let failure = jobs.end("bug").await.failure.unwrap();
        assert_eq!(failure.code, Code::Internal as i32);
        unsolved_map(&server, "other", 3).await;
        jobs.create("fine", export("other", MapFormat::Tum)).await.unwrap();
        jobs.success("fine").await;
    });
}

#[test]
fn a_canceled_job_leaves_its_map_as_it_was() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 5).await;
        let before = state_hash(&server, "house").await;
        let occupied = occupy(&server).await;
        jobs.create("runs", optimize("house")).await.unwrap();
        jobs.until("runs", |job| job.state() == JobState::Running).await;
        // Its solve waits for a thread that nobody gives it: the cancel does not wait for that.
        let canceled = jobs.cancel("runs").await.unwrap();
        assert!(canceled.cancel_requested);
        let job = jobs.end("runs").await;
        assert_eq!((job.state(), job.result), (JobState::Cancelled, None));
        let status = jobs.cancel("runs").await.unwrap_err();
        check_status(&status, Code::FailedPrecondition, "JOB_ENDED");
        assert_eq!(state_hash(&server, "house").await, before);
        drop(occupied);
        // The solver notices, drops what it has, and the map takes the next one.
        jobs.create("next", optimize("house")).await.unwrap();
        let next = jobs.success("next").await;
        assert!(next.cost_after < next.cost_before);
        assert_ne!(state_hash(&server, "house").await, before);
    });
}

#[test]
fn a_job_that_waits_for_its_turn_is_canceled_at_once() {
    run(async {
        let server = TestServer::with_fault("hold-jobs").await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 3).await;
        unsolved_map(&server, "other", 3).await;
        jobs.create("first", optimize("house")).await.unwrap();
        jobs.until("first", |job| job.state() == JobState::Running).await;
        jobs.create("second", optimize("other")).await.unwrap();
        assert_eq!(jobs.cancel("second").await.unwrap().state(), JobState::Cancelled);
        let status = jobs.delete("first").await.unwrap_err();
        check_status(&status, Code::FailedPrecondition, "JOB_NOT_ENDED");
        jobs.delete("second").await.unwrap();
        check_status(&jobs.get("second").await.unwrap_err(), Code::NotFound, "JOB_NOT_FOUND");
        // A call may optimize the map meanwhile; a job's cancel ends its own work only.
        jobs.cancel("first").await.unwrap();
        assert_eq!(jobs.end("first").await.state(), JobState::Cancelled);
    });
}

#[test]
fn what_waits_begins_by_priority_then_age() {
    run(async {
        let server = TestServer::with_fault("hold-jobs").await;
        let jobs = Jobs::of(&server);
        for map_id in ["a", "b", "c", "d"] {
            unsolved_map(&server, map_id, 2).await;
        }
        jobs.create("first", optimize("a")).await.unwrap();
        jobs.until("first", |job| job.state() == JobState::Running).await;
        jobs.create("low", optimize("b")).await.unwrap();
        jobs.create_with("high", optimize("c"), 7).await.unwrap();
        jobs.create("same", optimize("d")).await.unwrap();
        for (ends, begins) in [("first", "high"), ("high", "low"), ("low", "same")] {
            jobs.cancel(ends).await.unwrap();
            jobs.until(begins, |job| job.state() == JobState::Running).await;
        }
    });
}

#[test]
fn lists_have_pages_and_filters() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 2).await;
        unsolved_map(&server, "shed", 2).await;
        for index in 0..5 {
            let map_id = if index == 2 { "shed" } else { "house" };
            let id = format!("job-{index}");
            jobs.create(&id, export(map_id, MapFormat::Tum)).await.unwrap();
            jobs.success(&id).await;
        }
        let ids = |list: &v1::ListJobsResponse| {
            list.jobs.iter().map(|job| job.job_id.clone()).collect::<Vec<_>>()
        };
        let all = jobs.list(Default::default()).await.unwrap();
        assert_eq!(ids(&all), ["job-4", "job-3", "job-2", "job-1", "job-0"]);
        assert_eq!(all.next_page_token, "");
        let mut request = v1::ListJobsRequest { page_size: 2, ..Default::default() };
        let mut seen = Vec::new();
        loop {
            let page = jobs.list(request.clone()).await.unwrap();
            assert!(page.jobs.len() <= 2);
            seen.extend(ids(&page));
            if page.next_page_token.is_empty() {
                break;
            }
            request.page_token = page.next_page_token;
        }
        assert_eq!(seen, ids(&all));
        let of_map =
            |map_id: &str| v1::ListJobsRequest { map_id: map_id.to_owned(), ..Default::default() };
        assert_eq!(ids(&jobs.list(of_map("shed")).await.unwrap()), ["job-2"]);
        let failed =
            v1::ListJobsRequest { states: vec![JobState::Failed.into()], ..Default::default() };
        assert_eq!(jobs.list(failed).await.unwrap().jobs, []);
        // A token is of its list alone.
        let other = v1::ListJobsRequest { page_token: request.page_token, ..of_map("shed") };
        check_field(&jobs.list(other).await.unwrap_err(), "page_token", "OUT_OF_RANGE");
        let unknown = v1::ListJobsRequest { states: vec![99], ..Default::default() };
        check_field(&jobs.list(unknown).await.unwrap_err(), "states[0]", "UNKNOWN_VALUE");
        let states = vec![JobState::Running.into(); 17];
        let many = v1::ListJobsRequest { states, ..Default::default() };
        check_field(&jobs.list(many).await.unwrap_err(), "states", "TOO_LARGE");
        let large = v1::ListJobsRequest { page_size: 1001, ..Default::default() };
        check_field(&jobs.list(large).await.unwrap_err(), "page_size", "OUT_OF_RANGE");
    });
}

#[test]
fn jobs_expire_and_watchers_of_a_deleted_one_are_reported() {
    run(async {
        let (clock, time) = watch::channel(1_000_000_i64);
        let server = TestServer::with(|config| config.clock = Clock::Manual(time)).await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 2).await;
        jobs.create("old", export("house", MapFormat::Tum)).await.unwrap();
        let job = jobs.success("old").await;
        assert_eq!(job.expire_time.unwrap().seconds, 1_000_000 + 7 * 24 * 3600);
        let upload = jobs.upload(&[(GRAPH, twin(GRAPH))]).await.unwrap();
        clock.send_replace(1_000_000 + 24 * 3600);
        // An upload that nobody took is gone after a day.
        let status = jobs.create("late", solve(&upload)).await.unwrap_err();
        check_status(&status, Code::NotFound, "UPLOAD_NOT_FOUND");
        clock.send_replace(1_000_000 + 7 * 24 * 3600);
        while jobs.get("old").await.is_ok() {
            tokio::task::yield_now().await;
        }
        check_status(&jobs.get("old").await.unwrap_err(), Code::NotFound, "JOB_NOT_FOUND");
    });
}
