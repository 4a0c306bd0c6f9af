//! `covis map` with the real binary: import, constraints, freeze, and a map that moves by a file.

use serde_json::Value;

use crate::cli_support::{Running, Workspace};

/// Four poses on a line: odometry, and one closure.
const GRAPH: &str = "\
VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 1 0 0 0 0 0 1
VERTEX_SE3:QUAT 2 2 0 0 0 0 0 1
VERTEX_SE3:QUAT 3 3 0 0 0 0 0 1
EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 10 0 0 0 0 0 10 0 0 0 0 10 0 0 0 10 0 0 10 0 10
EDGE_SE3:QUAT 1 2 1 0 0 0 0 0 1 10 0 0 0 0 0 10 0 0 0 0 10 0 0 0 10 0 0 10 0 10
EDGE_SE3:QUAT 2 3 1 0 0 0 0 0 1 10 0 0 0 0 0 10 0 0 0 0 10 0 0 0 10 0 0 10 0 10
EDGE_SE3:QUAT 0 3 3 0 0 0 0 0 1 10 0 0 0 0 0 10 0 0 0 0 10 0 0 0 10 0 0 10 0 10
";

/// `covis map` on a server.
fn map(workspace: &Workspace, server: &Running, arguments: &str) -> crate::cli_support::Ran {
    workspace.run(&format!("map --server {} {arguments}", server.url), &[])
}

fn json(workspace: &Workspace, server: &Running, arguments: &str) -> Value {
    workspace.json(&format!("map --server {} --json {arguments}", server.url), &[])
}

#[test]
fn a_merge_of_maps_with_one_client_names_the_flag_that_renames_it() {
    let workspace = Workspace::new();
    workspace.file("graph.g2o", GRAPH);
    let server = Running::start(&workspace, &workspace.path("data"));
    for name in ["here", "there"] {
        json(&workspace, &server, &format!("import {name} graph.g2o --client survey"));
    }
    map(&workspace, &server, "merge here there")
        .expect_failure(&["\"survey\" is in both maps", "--rename CLIENT=NEW"]);
}

#[test]
fn a_map_is_imported_frozen_and_moved_to_another_server() {
    let workspace = Workspace::new();
    workspace.file("graph.g2o", GRAPH);
    let folders = [workspace.path("here"), workspace.path("there")];
    let here = Running::start(&workspace, &folders[0]);
    let imported = json(&workspace, &here, "import line graph.g2o --client survey");
    assert_eq!((&imported["keyframes"], &imported["constraints"]), (&4.into(), &4.into()));
    assert_eq!(imported["clients"][0]["client"], "survey");

    let listed = json(&workspace, &here, "constraints line");
    let rows = listed["constraints"].as_array().unwrap();
    let kinds: Vec<_> = rows.iter().map(|row| row["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["odometry", "odometry", "odometry", "loop closure"]);
    assert_eq!(rows[3]["keyframes"], serde_json::json!([["survey", 0], ["survey", 3]]));
    assert_eq!(rows[3]["switched_off"], false);
    let text = map(&workspace, &here, "constraints line").stdout;
    assert_eq!(text.lines().count(), 5, "{text}");
    assert!(text.lines().nth(4).unwrap().contains("survey/0 - survey/3"), "{text}");

    assert_eq!(json(&workspace, &here, "freeze line")["state"], "frozen");
    assert_eq!(map(&workspace, &here, "unfreeze line").stdout, "map line is open\n");

    let exported = json(&workspace, &here, "export line --format covis --out line.covis");
    assert_eq!(exported["files"], serde_json::json!(["line.covis"]));
    let there = Running::start(&workspace, &folders[1]);
    json(&workspace, &there, "import copy line.covis");
    let shown = [json(&workspace, &here, "show line"), json(&workspace, &there, "show copy")];
    for key in ["state_hash", "keyframe_ids_digest", "revision", "clients"] {
        assert_eq!(shown[0][key], shown[1][key], "{key}");
    }
    map(&workspace, &there, "import copy line.covis").expect_failure(&["exists already"]);
}

#[test]
fn an_import_says_what_is_wrong_with_a_file() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("maps"));
    let run = |arguments: &str| map(&workspace, &server, arguments);
    run("import a none.g2o").expect_failure(&["none.g2o"]);
    workspace.file("map.xyz", "");
    run("import a map.xyz").expect_failure(&["map.xyz", "--format"]);
    fs_err::create_dir(workspace.path("empty")).unwrap();
    run("import a empty").expect_failure(&["empty", "nothing"]);
    workspace.file("bad.g2o", "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 x\n");
    run("import a bad.g2o").expect_failure(&["bad.g2o", "line 1"]);
    workspace.file("bad.covis", "covis");
    run("import a bad.covis").expect_failure(&["bad.covis", "byte 0"]);
    assert_eq!(run("list").stdout, "no maps\n");
}

#[test]
fn a_trajectory_becomes_a_map_of_its_client() {
    let workspace = Workspace::new();
    workspace.file("drone.tum", "# time\n1.5 0 0 0 0 0 0 1\n2.5 1 0 0 0 0 0 1\n");
    let server = Running::start(&workspace, &workspace.path("maps"));
    let map = json(&workspace, &server, "import path drone.tum");
    assert_eq!((&map["keyframes"], &map["clients"][0]["client"]), (&2.into(), &"drone".into()));
}

#[test]
fn show_names_what_the_data_look_like_and_what_is_pending() {
    let workspace = Workspace::new();
    fs_err::create_dir(workspace.path("model")).unwrap();
    // The images were halved, the pixels were not.
    workspace.file("model/cameras.txt", "1 PINHOLE 100 100 100 100 50 50\n");
    let pixels: Vec<String> = (0..60).map(|k| format!("{} 50 {}", 120 + k, k + 1)).collect();
    let image = format!("1 1 0 0 0 0 0 0 1 a.png\n{}\n", pixels.join(" "));
    workspace.file("model/images.txt", &image);
    let points = (0..60).map(|k| format!("{} {} 0 5 9 9 9 1 1 {k}\n", k + 1, 0.05 * f64::from(k)));
    workspace.file("model/points3D.txt", &points.collect::<String>());
    let server = Running::start(&workspace, &workspace.path("maps"));
    json(&workspace, &server, "import room model");
    let shown = json(&workspace, &server, "show room");
    assert_eq!(shown["hints"][0]["hint"], "pixels_outside_image", "{shown}");
    assert_eq!(shown["hints"][0]["client"], "import");
    assert_eq!(shown["pending"]["place_searches"], 0);
    let text = map(&workspace, &server, "show room").stdout;
    assert!(text.contains("\nhint          pixels_outside_image (import): "), "{text}");
    assert!(!text.contains("pending"), "{text}");
}

#[test]
fn a_map_is_created_set_and_renamed_by_command_and_its_policy_goes_around() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("maps"));
    workspace.file("small.toml", "odometry = false\n\n[limits]\nmax_keyframe_count = 10\n");
    let made = json(&workspace, &server, "create room --display-name Hall --policy small.toml");
    assert_eq!((&made["map"], &made["display_name"]), (&"room".into(), &"Hall".into()));
    map(&workspace, &server, "create room").expect_failure(&["\"room\" exists already"]);

    // What `show` prints is what `set` takes, and changes nothing.
    let policy = map(&workspace, &server, "show room --policy").stdout;
    assert!(policy.contains("odometry = false\n"), "{policy}");
    assert!(policy.contains("[limits]\nmax_keyframe_count = 10\n"), "{policy}");
    workspace.file("policy.toml", &policy);
    let revision = json(&workspace, &server, "show room")["revision"].clone();
    assert_eq!(map(&workspace, &server, "set room --policy policy.toml").stdout, policy);
    assert_eq!(json(&workspace, &server, "show room")["revision"], revision);
    json(&workspace, &server, "create twin --policy policy.toml");
    assert_eq!(map(&workspace, &server, "show twin --policy").stdout, policy);

    // A file changes what it names; a field is reset by its name.
    workspace.file("part.toml", "window_keyframe_count = 7\ngauge = \"free\"\n");
    let set =
        json(&workspace, &server, "set room --policy part.toml --reset limits.max_keyframe_count");
    assert_eq!((&set["window_keyframe_count"], &set["gauge"]), (&7.into(), &"free".into()));
    assert_eq!(
        (&set["odometry"], &set["limits"]["max_keyframe_count"]),
        (&false.into(), &100_000.into())
    );
    let renamed = json(&workspace, &server, "rename room Attic");
    assert_eq!((&renamed["map"], &renamed["display_name"]), (&"room".into(), &"Attic".into()));

    for (text, line, part) in [
        ("windows = 7\n", 1, "windows"),
        ("\ngauge = \"loose\"\n", 2, "first-keyframe-fixed"),
        ("odometry = true\nwindow_keyframe_count = 1\n", 2, "policy.window_keyframe_count"),
        ("[limits]\n# none\nmax_prior_count = 0\n", 3, "policy.limits.max_prior_count"),
    ] {
        workspace.file("bad.toml", text);
        for command in ["set room --policy bad.toml", "create other --policy bad.toml"] {
            let at = format!("bad.toml, line {line}: ");
            map(&workspace, &server, command).expect_failure(&[&at, part]);
        }
    }
    workspace.file("empty.toml", "");
    map(&workspace, &server, "set room --policy empty.toml")
        .expect_failure(&["empty.toml: it names no field of a policy"]);
    assert_eq!(map(&workspace, &server, "set room").code, Some(2));
    assert_eq!(json(&workspace, &server, "list").as_array().unwrap().len(), 2);
}

#[test]
fn a_map_is_copied_as_it_is_and_restored_as_it_was_by_command() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("maps"));
    json(&workspace, &server, "create room");
    let before = json(&workspace, &server, "rename room Before");
    json(&workspace, &server, "rename room After");
    let kept = json(&workspace, &server, "snapshot room kept");
    assert_eq!((&kept["new"]["state"], &kept["revision"]), (&"frozen".into(), &3.into()));
    let revision = before["revision"].as_i64().unwrap();
    let restored = json(&workspace, &server, &format!("restore room old --at {revision}"));
    assert_eq!(
        (&restored["new"]["state"], &restored["revision"]),
        (&"open".into(), &revision.into())
    );
    assert_eq!(restored["new"]["display_name"], "Before");
    assert_ne!(restored["new"]["uid"], before["uid"]);
    let time = restored["time"].as_str().unwrap();
    let text = map(&workspace, &server, &format!("restore room older --at {time}")).stdout;
    assert_eq!(text, format!("map older (open) shows map room at revision 2, of {time}\n"));
    assert_eq!(json(&workspace, &server, "show room")["display_name"], "After");
    map(&workspace, &server, "restore room none --at 4")
        .expect_failure(&["can be restored at revisions 1 to 3, that is at times 2"]);
    map(&workspace, &server, "restore room old --at 1").expect_failure(&["exists already"]);
    assert_eq!(map(&workspace, &server, "restore room none --at noon").code, Some(2));
}
