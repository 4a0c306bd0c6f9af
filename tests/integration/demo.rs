//! `covis demo`, `covis map` and what they write: the real binary, a shorter sequence.

use covis_solvers::io::trajectory::Trajectory;

use crate::cli_support::{Workspace, number};
use crate::common::{TestServer, run};

#[test]
fn the_demo_tells_both_errors_and_writes_what_it_says() {
    let workspace = Workspace::new();
    let ran = workspace.run("--log warn demo --frames 8 --seed 2 --out walk", &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert_eq!(ran.stdout.matches("8 frames tracked, 0 lost").count(), 2, "{}", ran.stdout);
    // Eight frames are no second.
    assert!(ran.stdout.contains("drift a second (RPE), rmse           - mm"), "{}", ran.stdout);
    for name in ["truth.tum", "with_mask.tum", "without_mask.tum"] {
        assert!(ran.stdout.contains(name), "{}", ran.stdout);
        let trajectory = Trajectory::read(&workspace.path("walk").join(name)).unwrap();
        assert_eq!(trajectory.len(), 8, "{name}");
    }
    let ply = fs_err::read(workspace.path("walk").join("map.ply")).unwrap();
    assert!(ply.starts_with(b"ply\n"));
    assert!(!workspace.path("walk").join("map.ply.partial").exists());

    let position = ran.stdout.lines().find(|line| line.contains("position")).unwrap();
    for estimate in ["walk/with_mask.tum", "walk/without_mask.tum"] {
        let (truth, estimate) = (workspace.path("walk/truth.tum"), workspace.path(estimate));
        let rmse = number(&workspace.json("eval ape {} {} --json", &[&truth, &estimate]), "rmse");
        assert!(rmse < 0.02, "{rmse} m");
        assert!(position.contains(&format!("{:.1} mm", rmse * 1e3)), "{position}, not {rmse} m");
    }
}

#[test]
fn maps_are_listed_shown_exported_and_deleted() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 4).await;
        let url = format!("http://{}", server.running.local_addr());
        tokio::task::spawn_blocking(move || {
            let workspace = Workspace::new();
            let command = |arguments: &str| format!("map {arguments} --server {url}");
            let list = workspace.json(&command("list --json"), &[]);
            assert_eq!(list[0]["map"], "room");
            let show = workspace.json(&command("show room --json"), &[]);
            assert_eq!((&show["keyframes"], &show["observations"]), (&4.into(), &240.into()));
            assert_eq!(show["clients"][0]["client"], "robot");
            assert!(workspace.run(&command("show room"), &[]).stdout.contains("landmarks"));

            let files = |format: &str, out: &str| {
                let export = command(&format!("export room --format {format} --out {out} --json"));
                let json = workspace.json(&export, &[]);
                let files: Vec<String> = serde_json::from_value(json["files"].clone()).unwrap();
                for file in &files {
                    assert!(fs_err::metadata(workspace.path(file)).unwrap().len() > 0, "{file}");
                }
                files
            };
            assert_eq!(files("ply", "room.ply"), ["room.ply"]);
            assert_eq!(files("tum", "room.tum"), ["room.tum"]);
            assert_eq!(files("g2o", "room.g2o"), ["room.g2o"]);
            assert_eq!(files("colmap-binary", "binary").len(), 3);
            assert_eq!(files("colmap-text", "text").len(), 3);

            let missing = workspace.run(&command("show attic"), &[]);
            missing.expect_failure(&["attic", "NotFound"]);
            assert_eq!(workspace.json(&command("delete room --json"), &[])["deleted"], true);
            let list = workspace.json(&command("list --json"), &[]);
            assert_eq!(list, serde_json::json!([]));
            let nobody = workspace.run("map list --server http://127.0.0.1:1", &[]);
            nobody.expect_failure(&["no server answers"]);
        })
        .await
        .unwrap();
    });
}
