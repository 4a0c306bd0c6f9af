//! Jobs beside calls that change the same map, a job that merges maps, and jobs in copies of data
//! directories.

use covis::wire::v1;
use tonic::Code;
use v1::ingest_request::Item;
use v1::job_result::Result as Kind;
use v1::job_spec::Spec;

use crate::cli_support::{Running, Workspace, golden};
use crate::common::{Stream, TestServer, camera, check_status, keyframe, occupy, run, shift};
use crate::job_support::{Jobs, optimize, unsolved_map};
use crate::rpc_optimize_map::one_of_two;

#[test]
fn optimize_map_is_aborted_beside_a_job_and_a_job_waits_for_optimize_map() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 6).await;
        let busy = occupy(&server).await;
        jobs.create("night", optimize("house")).await.unwrap();
        jobs.until("night", |job| {
            job.progress.as_ref().is_some_and(|progress| progress.phase == "optimizes the map")
        })
        .await;
        // The job's request is on its way to the engine. Of it and two calls one has the map, and at least
        // one call is refused; where it is a call that has the map, the job waits for it.
        let mut other = one_of_two(&server, "house").await;
        drop(busy);
        loop {
            match other.message().await {
                Ok(Some(_)) => {}
                Ok(None) => break,
                Err(status) => {
                    check_status(&status, Code::Aborted, "OPTIMIZATION_RUNNING");
                    break;
                }
            }
        }
        jobs.success("night").await;

        // Now the call comes first for certain.
        let busy = occupy(&server).await;
        let mut first = one_of_two(&server, "house").await;
        jobs.create("after", optimize("house")).await.unwrap();
        jobs.until("after", |job| {
            let progress = job.progress.as_ref();
            progress.is_some_and(|progress| progress.phase.contains("waits for another"))
        })
        .await;
        drop(busy);
        while first.message().await.unwrap().is_some() {}
        jobs.success("after").await;
    });
}

#[test]
fn a_merge_runs_as_a_job_to_its_end() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 3).await;
        server.create_map("shed").await;
        let (stream, _) = Stream::open(&server, "shed", "other", 0).await;
        stream.send(1, Item::Camera(camera(0))).await;
        for id in 0..3 {
            stream.send(id + 2, Item::Keyframe(keyframe(id))).await;
        }
        stream.finish().await.unwrap();
        let spec = Spec::MergeMaps(v1::MergeMapsRequest {
            target_map_id: "house".to_owned(),
            source_map_id: "shed".to_owned(),
            target_from_source: Some(shift([0.0; 3])),
            ..Default::default()
        });
        jobs.create("one", spec).await.unwrap();
        let job = jobs.success("one").await;
        let Some(Kind::MergeMaps(result)) = job.result.unwrap().result else { panic!() };
        let map = result.map.unwrap();
        assert_eq!((map.map_id.as_str(), map.counts.unwrap().keyframe_count), ("house", 6));
        assert_eq!(map.merged_maps[0].map_id, "shed");
        let report = jobs.report("one").await;
        assert_eq!((&report["source"], &report["target"]), (&"shed".into(), &"house".into()));
        let cancel = jobs.cancel("one").await.unwrap_err();
        check_status(&cancel, Code::FailedPrecondition, "JOB_ENDED");
    });
}

#[test]
fn backups_have_jobs_and_the_doctor_finds_their_damage() {
    let workspace = Workspace::new();
    let folder = workspace.path("data");
    let mut server = Running::start(&workspace, &folder);
    let url = server.url.clone();
    let graph = golden("twins/sphere-200.g2o");
    workspace.json(&format!("map import sphere {{}} --server {url} --json"), &[&graph]);
    let submit = "job submit export --map sphere --format tum --id kept --wait --json --server";
    let job = workspace.json(&format!("{submit} {url}"), &[]);
    let copy = workspace.path("copy");
    let json = workspace.json("backup {} {} --json", &[&folder, &copy]);
    assert_eq!((&json["damaged_jobs"], &json["jobs"][0]["job"]), (&0.into(), &"kept".into()));
    assert_eq!(server.terminate(), Some(0));
    let again = Running::start(&workspace, &copy);
    let shown = workspace.json(&format!("job show kept --json --server {}", again.url), &[]);
    for key in ["state", "files", "report", "end_time"] {
        assert_eq!(shown[key], job[key], "{key}");
    }
    drop(again);

    let looked = workspace.json("doctor {} --json", &[&folder]);
    assert_eq!((&looked["damaged_jobs"], &looked["jobs"][0]["job"]), (&0.into(), &"kept".into()));
    let place = std::path::PathBuf::from(looked["jobs"][0]["folder"].as_str().unwrap());
    let file = place.join("0000000001.out");
    let mut bytes = fs_err::read(&file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs_err::write(&file, &bytes).unwrap();
    let ran = workspace.run("doctor {}", &[&folder]);
    assert_eq!(ran.code, Some(1));
    assert!(ran.stdout.contains("0000000001.out: "), "{}", ran.stdout);
    assert!(ran.stdout.contains("1 jobs, 1 of them damaged"), "{}", ran.stdout);
    assert_eq!(fs_err::read(&file).unwrap(), bytes, "a look changes nothing");
}
