//! `covis doctor`: the real binary on a data directory that a real server left, whole and damaged.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::cli_support::{Running, Workspace, golden};

/// A data directory with the map "twin", six keyframes; its server was killed.
fn left(workspace: &Workspace) -> PathBuf {
    let folder = workspace.path("maps");
    let server = Running::start(workspace, &folder);
    replay(workspace, &server.url, "");
    let ran = workspace.run("doctor {}", &[&folder]);
    ran.expect_failure(&["in use by another server"]);
    folder
}

fn replay(workspace: &Workspace, url: &str, more: &str) -> Value {
    let file = golden("twins/window-6-80.txt");
    let command = format!("--log error replay {{}} --server {url} --map twin --json {more}");
    workspace.json(&command, &[&file])
}

/// The one journal file.
fn journal(folder: &Path) -> PathBuf {
    let map = fs_err::read_dir(folder.join("maps")).unwrap().next().unwrap().unwrap().path();
    map.join("00000000000000000001.log")
}

fn doctor(workspace: &Workspace, folder: &Path, more: &str) -> (Option<i32>, Value) {
    let ran = workspace.run(&format!("--log off doctor {{}} --json {more}"), &[folder]);
    assert!(!ran.stdout.is_empty(), "{}", ran.stderr);
    (ran.code, serde_json::from_str(&ran.stdout).unwrap())
}

#[test]
fn a_whole_directory_is_reported_as_whole() {
    let workspace = Workspace::new();
    let folder = left(&workspace);
    let (code, json) = doctor(&workspace, &folder, "");
    assert_eq!((code, &json["damaged_maps"]), (Some(0), &0.into()), "{json}");
    let map = &json["maps"][0];
    assert_eq!((&map["map"], &map["snapshot"]), (&"twin".into(), &Value::Null));
    assert!(map["revision"].as_i64() > Some(10) && map["damage"] == Value::Array(vec![]), "{json}");
    assert_eq!(map["segments"][0], "00000000000000000001.log");
    let ran = workspace.run("doctor {}", &[&folder]);
    assert!(ran.stdout.contains("1 maps, 0 of them damaged"), "{}", ran.stdout);
    workspace.run("doctor nowhere", &[]).expect_failure(&["nowhere"]);
    assert!(!workspace.path("nowhere").exists());
}

#[test]
fn damage_is_named_set_aside_and_the_map_goes_on() {
    let hurts: [fn(&mut Vec<u8>); 2] = [
        |bytes| {
            let at = bytes.len() / 2;
            bytes[at] ^= 4;
        },
        |bytes| bytes.truncate(bytes.len() * 2 / 3),
    ];
    for hurt in hurts {
        let workspace = Workspace::new();
        let folder = left(&workspace);
        let (_, whole) = doctor(&workspace, &folder, "");
        let last = whole["maps"][0]["revision"].as_i64().unwrap();
        let log = journal(&folder);
        let mut bytes = fs_err::read(&log).unwrap();
        hurt(&mut bytes);
        fs_err::write(&log, &bytes).unwrap();

        let (code, json) = doctor(&workspace, &folder, "");
        let map = &json["maps"][0];
        let revision = map["revision"].as_i64().unwrap();
        assert!(code == Some(1) && 0 < revision && revision < last, "{json}");
        let damage = &map["damage"][0];
        assert_eq!(damage["file"], log.display().to_string());
        assert_eq!(damage["first_lost"], revision + 1);
        assert!(damage["byte"].as_u64() > Some(0) && damage["last_lost"].as_i64() <= Some(last));
        assert_eq!(fs_err::read(&log).unwrap(), bytes, "looking changes nothing");

        let (code, json) = doctor(&workspace, &folder, "--repair");
        assert_eq!(code, Some(1), "{json}");
        let aside = log.with_extension("log.bad");
        assert_eq!(json["maps"][0]["set_aside"][0], aside.display().to_string());
        assert_eq!(fs_err::read(&aside).unwrap(), bytes);
        let (code, json) = doctor(&workspace, &folder, "");
        assert_eq!((code, &json["maps"][0]["revision"]), (Some(0), &revision.into()), "{json}");
        assert_eq!(json["maps"][0]["snapshot"], revision);

        // What was lost can be sent again.
        let server = Running::start(&workspace, &folder);
        let json = replay(&workspace, &server.url, "--append");
        assert_eq!((&json["received"], &json["rejected"]), (&6.into(), &0.into()), "{json}");
        let map = workspace.json(&format!("map show twin --json --server {}", server.url), &[]);
        assert_eq!((&map["state"], &map["keyframes"]), (&"open".into(), &6.into()));
    }
}
