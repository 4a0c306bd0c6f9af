//! `covis demo`, `covis map` and what they write: the real binary, a shorter sequence.

use covis_solvers::io::trajectory::Trajectory;

use crate::cli_support::{Workspace, number};
use crate::common::{TestServer, run};

/// The words of the line of the demo's output that begins like this, after its label.
fn cells(stdout: &str, label: &str) -> Vec<f64> {
    let line = stdout.lines().find(|line| line.trim_start().starts_with(label));
    let line = line.unwrap_or_else(|| panic!("no {label} in {stdout}"));
    let words = line.split_whitespace();
    words.filter_map(|word| word.parse().ok()).collect()
}

#[test]
fn the_demo_tells_both_errors_and_writes_what_it_says() {
    let workspace = Workspace::new();
    let ran = workspace.run("--log warn demo --frames 12 --seed 2 --out walk", &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert_eq!(ran.stdout.matches("12 frames tracked, 0 lost").count(), 2, "{}", ran.stdout);
    assert!(ran.stdout.contains("Watch    http://127.0.0.1:"), "{}", ran.stdout);
    let names = ["truth.tum", "odometry.tum", "with_mask.tum", "without_mask.tum"];
    for name in names {
        assert!(ran.stdout.contains(name), "{}", ran.stdout);
        let trajectory = Trajectory::read(&workspace.path("walk").join(name)).unwrap();
        assert_eq!(trajectory.len(), 12, "{name}");
    }
    let ply = fs_err::read(workspace.path("walk").join("map.ply")).unwrap();
    assert!(ply.starts_with(b"ply\n"));
    assert!(!workspace.path("walk").join("map.ply.partial").exists());

    // Nothing comes back within 12 frames; the mask leaves people out of the map.
    assert_eq!(cells(&ran.stdout, "loops that the server found"), [0.0, 0.0], "{}", ran.stdout);
    let on_people = cells(&ran.stdout, "Measurements in the map that show people");
    assert!(on_people[1] > 1.0 && on_people[0] < on_people[1], "{}", ran.stdout);
    let before = cells(&ran.stdout, "Position error (APE, rmse) of tracking");
    let after = cells(&ran.stdout, "error after them, on the server's map");
    for (name, told) in names[1..].iter().zip([before[0], after[0], after[1]]) {
        let (truth, estimate) =
            (workspace.path("walk/truth.tum"), workspace.path("walk").join(name));
        let rmse = number(&workspace.json("eval ape {} {} --json", &[&truth, &estimate]), "rmse");
        assert!(rmse < 0.03, "{rmse} m");
        assert_eq!(format!("{told:.1}"), format!("{:.1}", rmse * 1e3), "{name}");
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
            let nobody = workspace.run("map list --server-wait 0 --server http://127.0.0.1:1", &[]);
            nobody.expect_failure(&["no server answers"]);
        })
        .await
        .unwrap();
    });
}
