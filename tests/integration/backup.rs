//! `covis backup`: a copy that is made while the server writes opens, with all that was durable.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use covis::client::{Client, SessionOptions};
use covis::store::{Repair, back_up, check_up};
use covis::wire::v1;

use crate::cli_support::{Running, Workspace, golden};
use crate::common::{camera, keyframe, run};

#[test]
fn a_backup_of_a_running_server_is_served_again() {
    let workspace = Workspace::new();
    let folder = workspace.path("maps");
    let server = Running::start(&workspace, &folder);
    let file = golden("twins/window-6-80.txt");
    let command = format!("--log error replay {{}} --server {} --map twin --json", server.url);
    workspace.json(&command, &[&file]);
    let show = |url: &str| workspace.json(&format!("map show twin --server {url} --json"), &[]);
    let before = show(&server.url);
    // The last event may still be on its way to the disk.
    let (copy, json) = (0..100)
        .map(|attempt| {
            let copy = workspace.path(&format!("copy-{attempt}"));
            let json = workspace.json("backup {} {} --json", &[&folder, &copy]);
            (copy, json)
        })
        .find(|(_, json)| json["maps"][0]["revision"] == before["revision"])
        .unwrap();
    assert_eq!((&json["damaged_maps"], &json["maps"][0]["map"]), (&0.into(), &"twin".into()));
    let ran = workspace.run("backup {} {}", &[&folder, &copy]);
    ran.expect_failure(&["is not empty"]);
    workspace.run("backup nowhere elsewhere", &[]).expect_failure(&["nowhere"]);
    assert!(!workspace.path("elsewhere").exists());
    drop(server);
    let again = Running::start(&workspace, &copy);
    assert_eq!(show(&again.url), before);
}

#[test]
fn what_was_durable_when_a_backup_began_is_in_it_whatever_is_written_meanwhile() {
    run(async {
        let workspace = Workspace::new();
        let folder = workspace.path("maps");
        let server = Running::start(&workspace, &folder);
        let client = Client::connect(&server.url).await.unwrap();
        let durable = Arc::new(AtomicI64::new(0));
        let seen = Arc::clone(&durable);
        let options = SessionOptions::default().on_ack(move |ack| {
            if ack.status() == v1::AckStatus::Durable {
                seen.fetch_max(ack.sequence, Ordering::Relaxed);
            }
        });
        let policy =
            v1::MapPolicy { local_bundle_adjustment: Some(false), ..v1::MapPolicy::default() };
        client.create_map("house", Some(policy)).await.unwrap();
        let mut session = client.ingest("house", "robot", options).await.unwrap();
        session.send(camera(0)).await.unwrap();
        let writing = tokio::spawn(async move {
            for id in 0.. {
                let sent = v1::Keyframe { id, ..keyframe(id % 6) };
                if session.send(sent).await.is_err() {
                    return;
                }
            }
        });
        for round in 0..5 {
            let least = durable.load(Ordering::Relaxed);
            let copy = workspace.path(&format!("copy-{round}"));
            let (from, to) = (folder.clone(), copy.clone());
            let copied = tokio::task::spawn_blocking(move || back_up(&from, &to)).await.unwrap();
            let copied = copied.unwrap();
            assert!(!copied[0].is_damaged(), "{copied:?}");
            // The creation and the opening of the stream are events too.
            assert!(copied[0].revision >= u64::try_from(least).unwrap(), "{least}: {copied:?}");
            assert_eq!(check_up(&copy, Repair::No).unwrap(), copied);
        }
        writing.abort();
    });
}
