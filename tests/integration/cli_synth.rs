//! `covis synth`: what it writes, and what it says to a scene that does not exist.

use std::path::Path;

use covis::frontend::input::{FolderOptions, open_folder};
use covis::frontend::synthetic::{SceneName, Sequence, SequenceOptions};

use crate::cli_support::Workspace;

fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in fs_err::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() {
            all.extend(files(&entry));
        } else {
            let name = entry.strip_prefix(folder).unwrap().display().to_string();
            all.push((name, fs_err::read(&entry).unwrap()));
        }
    }
    all.sort();
    all
}

#[test]
fn a_sequence_is_written_as_a_folder_that_reads_back() {
    let workspace = Workspace::new();
    let out = workspace.path("walk");
    let arguments = "synth rgbd {} --scene walking --seed 3 --frames 2";
    let ran = workspace.run(arguments, &[&out]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(ran.stdout.ends_with("2 frames of walking, seed 3\n"), "{}", ran.stdout);
    let options = SequenceOptions { frames: 2, seed: 3, ..SequenceOptions::default() };
    let sequence = Sequence::new(SceneName::Walking, &options);
    let mut source = open_folder(&out, FolderOptions::default()).unwrap().source;
    assert_eq!(source.camera(), sequence.camera());
    for index in 0..2 {
        assert_eq!(source.next_frame().unwrap().unwrap(), sequence.frame(index));
    }
    let again = workspace.path("again");
    assert_eq!(workspace.run(arguments, &[&again]).code, Some(0));
    assert_eq!(files(&out), files(&again));
}

#[test]
fn an_unknown_scene_is_wrong_usage_and_lists_the_scenes() {
    let workspace = Workspace::new();
    let ran = workspace.run("synth rgbd out --scene beach", &[]);
    assert_eq!(ran.code, Some(2));
    assert!(ran.stderr.contains("static, walking, sitting, pushed"), "{}", ran.stderr);
    assert!(!workspace.path("out").exists());
}

#[test]
fn a_folder_that_cannot_be_made_is_named() {
    let workspace = Workspace::new();
    let file = workspace.file("taken", "");
    let ran = workspace.run("synth rgbd {} --force --scene static --frames 1", &[&file]);
    assert_eq!(ran.code, Some(1));
    assert!(ran.stderr.contains("taken") && ran.stderr.contains("cannot be written"));
}
