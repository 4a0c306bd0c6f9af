//! `covis map edit`: the real binary changes a map that a server keeps on disk.

use covis::client::{Client, SessionOptions, WatchOptions};
use covis::wire::v1;
use serde_json::Value;
use v1::ingest_request::Item;

use crate::cli_support::{Ran, Running, Workspace};
use crate::common::{camera, keyframe, relative_pose, run};
use crate::durable::on_disk;

/// A map "house" with six keyframes and two constraints of the client "robot".
async fn build(url: &str) {
    let client = Client::connect(url).await.unwrap();
    client.create_map("house", None).await.unwrap();
    let mut session = client.ingest("house", "robot", SessionOptions::default()).await.unwrap();
    session.send(camera(0)).await.unwrap();
    for id in 0..6 {
        session.send(keyframe(id)).await.unwrap();
    }
    session.send(relative_pose(1, 0, 1)).await.unwrap();
    let kind = v1::ConstraintKind::LoopClosure.into();
    let closure = v1::RelativePoseConstraint { kind, ..relative_pose(2, 0, 5) };
    session.send(Item::RelativePose(closure)).await.unwrap();
    assert_eq!(session.finish().await.unwrap().rejected, 0);
}

#[test]
fn the_command_line_edits_a_map_on_disk() {
    let workspace = Workspace::new();
    let folder = workspace.path("maps");
    let mut server = Running::start(&workspace, &folder);
    let url = server.url.clone();
    run(async { build(&url).await });
    let edit = |words: &str| -> Ran {
        workspace.run(&format!("map edit house {words} --server {url}"), &[])
    };
    let json = |words: &str| -> Value {
        workspace.json(&format!("map edit house {words} --json --server {url}"), &[])
    };
    let ran = edit("remove-keyframe robot 4");
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    for part in [
        "map house, revision ",
        ", durable: keyframe 4 of robot is removed",
        "6 -> 5",
        "360 -> 300",
    ] {
        assert!(ran.stdout.contains(part), "`{part}` in {}", ran.stdout);
    }
    let done = json("revoke-constraint robot 2 --optimized");
    assert_eq!((&done["client"], &done["durable"]), (&"editor".into(), &true.into()));
    assert_eq!((&done["sequence"], &done["solves"]), (&2.into(), &1.into()));
    assert_eq!(
        (&done["before"]["constraints"], &done["after"]["constraints"]),
        (&2.into(), &1.into())
    );
    let done = json("remove-observations robot 3 10 robot/11");
    assert_eq!(done["after"]["observations"], 298);
    let done = json("fuse-landmarks robot 10 12 13 --client surveyor");
    assert_eq!((&done["client"], &done["sequence"]), (&"surveyor".into(), &1.into()));
    assert_eq!(done["after"]["landmarks"], 58);
    let done = json("remove-landmarks robot 20 21");
    assert_eq!((&done["after"]["landmarks"], &done["duplicate"]), (&56.into(), &false.into()));
    let snavely = "set-camera robot 0 snavely 480 -0.01 0.002";
    assert_eq!(json(snavely)["duplicate"], false);
    assert_eq!(json(snavely)["duplicate"], true, "it is so already");

    edit("remove-keyframe robot 4").expect_failure(&[
        "the server refuses the edit",
        "remove_keyframe.keyframe",
        "UNKNOWN_REFERENCE",
    ]);
    edit("set-camera robot 0 pinhole 500 500 320").expect_failure(&["3 numbers"]);
    edit("set-camera robot 0 pinhole 500 500 320 240 --size 640x9")
        .expect_failure(&["set_camera.height_px"]);
    let ran = edit("set-camera robot 0 pinhole 500 500 320 240 --size 640");
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
    let nowhere =
        workspace.run(&format!("map edit garden remove-keyframe robot 0 --server {url}"), &[]);
    nowhere.expect_failure(&["garden"]);

    run(async {
        let client = Client::connect(&url).await.unwrap();
        let mut watch = client.watch("house", WatchOptions::default()).await.unwrap();
        let mirror = watch.next().await.unwrap();
        let camera = &mirror.cameras[&("robot".to_owned(), 0)];
        assert_eq!((camera.width_px, camera.height_px), (640, 480), "as it was");
        assert!(matches!(camera.model, Some(v1::camera::Model::Snavely(_))));
        assert_eq!(mirror.keyframes.len(), 5);
    });
    server.kill();
    run(async {
        let map = on_disk(&folder, "house").await;
        assert_eq!((map.keyframes().len(), map.constraints().len()), (5, 1));
        assert_eq!(map.landmarks().len(), 56);
    });
}
