//! `covis replay`: the real binary against a server on a loopback port.
//!
//! Costs are compared with Ceres' at fixed intrinsics (tests/golden), on twins and, where it is
//! present, on the shared data.

use std::path::Path;

use serde_json::Value;

use crate::cli_support::{Workspace, close, data, golden, golden_json, number};
use crate::common::{TestServer, run};

/// Replays a file onto a server of its own with so many solver threads.
async fn replay(path: &Path, threads: usize, max_message_bytes: usize) -> (Value, TestServer) {
    let server = TestServer::with(|config| {
        config.threads = threads;
        config.max_message_bytes = max_message_bytes;
    })
    .await;
    let (path, url) = (path.to_owned(), format!("http://{}", server.running.local_addr()));
    let json = tokio::task::spawn_blocking(move || {
        let command = format!("--log error replay {{}} --server {url} --map twin --json");
        Workspace::new().json(&command, &[&path])
    });
    (json.await.unwrap(), server)
}

const LIMIT: usize = 4 << 20;

#[test]
fn a_replayed_file_ends_where_ceres_ends() {
    run(async {
        let (json, server) = replay(&golden("twins/window-6-80.txt"), 2, LIMIT).await;
        let keys: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
        let mut expected = vec![
            "map",
            "cameras",
            "landmarks",
            "observations",
            "sent",
            "acknowledged",
            "rejected",
            "received",
            "durable",
            "optimized",
            "cost_before",
            "cost_after",
            "rmse_px_before",
            "rmse_px_after",
        ];
        expected.sort_unstable();
        assert_eq!(keys, expected);
        assert_eq!((&json["map"], &json["cameras"]), (&"twin".into(), &6.into()));
        assert_eq!((&json["landmarks"], &json["rejected"]), (&80.into(), &0.into()));
        assert_eq!((&json["sent"], &json["acknowledged"]), (&12.into(), &12.into()));
        assert_eq!((&json["received"], &json["optimized"]), (&6.into(), &6.into()));
        assert_eq!(json["durable"], 0, "this server keeps its maps in memory");
        let ceres = golden_json("ceres/window-6-80-fixed-intrinsics.json");
        let (after, limit) = (number(&json, "cost_after"), number(&ceres, "final_cost"));
        assert!(after <= limit * 1.0001, "{after} against {limit}");
        let path = golden("twins/window-6-80.txt");
        let solve = "solve bundle {} --fix-intrinsics --json";
        let solved = number(&Workspace::new().json(solve, &[&path]), "final_cost");
        assert!(close(after, solved, 1e-6), "{after} against {solved} of the file");
        let rmse = (2.0 * after / number(&json, "observations")).sqrt();
        assert!(close(number(&json, "rmse_px_after"), rmse, 1e-9));
        let mut maps = server.maps();
        let map = maps.get_map(covis::wire::v1::GetMapRequest {
            map_id: "twin".into(),
            ..Default::default()
        });
        let counts = map.await.unwrap().into_inner().map.unwrap().counts.unwrap();
        assert_eq!((counts.keyframe_count, counts.landmark_count), (6, 80));
    });
}

#[test]
fn the_bits_do_not_depend_on_the_threads() {
    run(async {
        let mut trajectories = Vec::new();
        for threads in [1, 2, 4] {
            let (json, server) = replay(&golden("twins/window-6-80.txt"), threads, LIMIT).await;
            let url = format!("http://{}", server.running.local_addr());
            let client = covis::client::Client::connect(&url).await.unwrap();
            let trajectory = client.trajectory("twin", None).await.unwrap();
            let landmarks = client.landmarks("twin").await.unwrap();
            trajectories.push((threads, json, trajectory, landmarks));
        }
        let (_, json, trajectory, landmarks) = &trajectories[0];
        for (threads, other, poses, points) in &trajectories[1..] {
            assert_eq!(other, json, "{threads} threads");
            assert_eq!((poses, points), (trajectory, landmarks), "{threads} threads");
        }
    });
}

#[test]
fn a_keyframe_that_does_not_fit_a_message_is_split() {
    run(async {
        let path = golden("twins/window-6-80.txt");
        let (whole, _) = replay(&path, 1, LIMIT).await;
        let (split, _) = replay(&path, 1, 4096).await;
        assert!(number(&split, "sent") > number(&whole, "sent"), "{split}");
        assert_eq!(split["acknowledged"], split["sent"]);
        assert_eq!(split["rejected"], 0);
        assert_eq!(split["observations"], whole["observations"]);
        assert!(close(number(&split, "cost_after"), number(&whole, "cost_after"), 1e-6), "{split}");
    });
}

#[test]
fn a_map_that_is_not_empty_is_left_alone_unless_told_otherwise() {
    run(async {
        let path = golden("twins/window-6-80.txt");
        let (first, server) = replay(&path, 1, LIMIT).await;
        let url = format!("http://{}", server.running.local_addr());
        tokio::task::spawn_blocking(move || {
            let workspace = Workspace::new();
            let command =
                |more: &str| format!("--log error replay {{}} --server {url} --map twin {more}");
            let refused = workspace.run(&command(""), &[&path]);
            refused.expect_failure(&["twin", "not empty", "--append", "--replace"]);
            // The same file again is recognized item by item.
            let table = workspace.run(&command("--append"), &[&path]);
            assert_eq!(table.code, Some(0), "{}", table.stderr);
            assert!(table.stdout.contains("12 of them known already"), "{}", table.stdout);
            let replaced = workspace.json(&command("--replace --json"), &[&path]);
            assert_eq!(replaced, first);
            let both = workspace.run(&command("--replace --append"), &[&path]);
            assert_eq!(both.code, Some(2), "{}", both.stderr);
        })
        .await
        .unwrap();
    });
}

#[test]
fn a_colmap_folder_replays_in_the_natural_order_of_its_images() {
    run(async {
        let (json, _) = replay(&golden("twins/colmap-room"), 2, LIMIT).await;
        assert_eq!(json["rejected"], 0);
        assert!(number(&json, "cost_after") <= number(&json, "cost_before"), "{json}");
        assert!(number(&json, "rmse_px_after") < 2.0, "{json}");
    });
}

#[test]
fn refused_items_are_shown_and_are_a_failure() {
    run(async {
        let server = TestServer::start().await;
        let url = format!("http://{}", server.running.local_addr());
        tokio::task::spawn_blocking(move || {
            let workspace = Workspace::new();
            // Camera 1 has a focal length of 0, which no server takes.
            let header = "2 3 6\n0 0 1 1\n0 1 2 1\n0 2 1 3\n1 0 1 1\n1 1 2 1\n1 2 1 3\n";
            let cameras = "0 0 0 0 0 0 500 0 0\n0 0 0 -1 0 0 0 0 0\n";
            let points = "0 0 -5\n1 0 -6\n0 1 -7\n";
            let file = workspace.file("bad.txt", &format!("{header}{cameras}{points}"));
            let ran = workspace.run(&format!("replay {{}} --server {url} --json"), &[&file]);
            assert_eq!(ran.code, Some(1), "{}", ran.stderr);
            assert!(ran.stderr.contains("camera.snavely.focal"), "{}", ran.stderr);
            let missing = workspace.run(&format!("replay none.txt --server {url}"), &[]);
            missing.expect_failure(&["none.txt"]);
        })
        .await
        .unwrap();
    });
}

#[test]
fn real_files_end_where_ceres_ends() {
    run(async {
        for (name, cameras, observations) in
            [("ladybug-49-7776", 49, 31_843), ("trafalgar-21-11315", 21, 36_455)]
        {
            let Some(path) = data(&format!("bal/{name}.txt")) else { continue };
            let (json, _) = replay(&path, 2, LIMIT).await;
            assert_eq!((&json["cameras"], &json["rejected"]), (&cameras.into(), &0.into()));
            assert_eq!(json["observations"], observations);
            let ceres = golden_json(&format!("ceres/{name}-fixed-intrinsics.json"));
            let (after, limit) = (number(&json, "cost_after"), number(&ceres, "final_cost"));
            assert!(after <= limit * 1.0001, "{name}: {after} against {limit}");
        }
        if let Some(path) = data("colmap/room50") {
            let (json, _) = replay(&path, 2, LIMIT).await;
            assert_eq!((&json["landmarks"], &json["rejected"]), (&5255.into(), &0.into()));
            // Many images see a point at two pixels; all of it is taken.
            assert_eq!(json["observations"], 55_090);
            // The file stands at its minimum.
            let after = number(&json, "cost_after");
            assert!(after <= 67_079.147_397_02 * 1.0001, "room50: {after}");
        }
    });
}
