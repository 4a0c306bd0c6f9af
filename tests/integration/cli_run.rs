//! `covis run` on short written sequences: what it reads and what it must not, frames that are bad,
//! masks, messages, and a server of its own process.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;

use fs_err as fs;
use serde_json::Value;

use crate::cli_support::{Ran, Running, Workspace, number};
#[cfg(unix)]
use crate::process::{Process, Signal};

/// Draws `frames` frames of people who walk into the folder `name`.
fn walking(workspace: &Workspace, name: &str, frames: usize) -> PathBuf {
    let out = workspace.path(name);
    let arguments =
        format!("--log warn synth rgbd {{}} --scene walking --seed 2 --frames {frames}");
    let ran = workspace.run(&arguments, &[&out]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    out
}

/// Runs `tum:FOLDER` and gives the JSON object with standard error.
fn track(workspace: &Workspace, folder: &str, arguments: &str) -> (Value, String) {
    let arguments = format!("--log warn run tum:{folder} --json {arguments}");
    let ran = workspace.run(&arguments, &[]);
    assert_eq!(ran.code, Some(0), "{arguments}: {}", ran.stderr);
    (serde_json::from_str(&ran.stdout).unwrap(), ran.stderr)
}

/// All files below a folder with their bytes, by name.
fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() {
            let inside = files(&entry).into_iter();
            let name = PathBuf::from(entry.file_name().unwrap());
            all.extend(inside.map(|(path, bytes)| (name.join(path), bytes)));
        } else {
            all.push((entry.file_name().unwrap().into(), fs::read(&entry).unwrap()));
        }
    }
    all.sort();
    all
}

/// The PNGs of `rgb` or `depth`, in the order of time.
fn images(folder: &Path, kind: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder.join(kind)).unwrap();
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

/// A black image of 640 x 480 pixels: color, 16-bit depth, or a mask of one value.
fn png(path: &Path, color: png::ColorType, depth: png::BitDepth, byte: u8) {
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), 640, 480);
    encoder.set_color(color);
    encoder.set_depth(depth);
    let samples = color.samples() * if depth == png::BitDepth::Sixteen { 2 } else { 1 };
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&vec![byte; 640 * 480 * samples]).unwrap();
}

#[test]
fn the_truth_is_not_opened_and_threads_change_nothing() {
    let workspace = Workspace::new();
    let folder = walking(&workspace, "seq", 8);
    let (document, _) = track(&workspace, "seq", "--lock-step --out a --save-masks --threads 1");
    for key in ["frames", "tracked"] {
        assert_eq!(document[key], 8, "{key}");
    }
    assert_eq!((&document["lost"], &document["skipped"]), (&0.into(), &0.into()));
    assert!(number(&document, "keyframes") >= 1.0 && number(&document, "landmarks") >= 50.0);
    let track_stage = &document["stages"]["track"];
    let (p50, p99) = (number(track_stage, "p50_ms"), number(track_stage, "p99_ms"));
    assert!(p50 > 0.0 && p50 <= p99, "{track_stage}");
    let names: Vec<_> = files(&workspace.path("a")).into_iter().map(|(path, _)| path).collect();
    assert_eq!(names.iter().filter(|path| path.starts_with("masks")).count(), 8, "{names:?}");
    assert_eq!(names.len(), 8 + 3, "{names:?}");

    fs::remove_file(folder.join("groundtruth.txt")).unwrap();
    fs::remove_file(folder.join("mask.txt")).unwrap();
    fs::remove_dir_all(folder.join("mask")).unwrap();
    track(&workspace, "seq", "--lock-step --out b --save-masks --threads 2");
    assert!(files(&workspace.path("a")) == files(&workspace.path("b")), "the outputs differ");
}

#[cfg(unix)]
#[test]
fn a_run_that_is_interrupted_writes_what_there_is() {
    let workspace = Workspace::new();
    let mut command = workspace.command();
    command.args([
        "--log",
        "info",
        "run",
        "synthetic:walking",
        "--frames",
        "1000",
        "--out",
        "out",
        "--map",
        "cut",
    ]);
    let mut child = Process::spawn(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
    // A line after a tenth of the frames, where there is no terminal.
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    assert!(lines.by_ref().any(|line| line.unwrap().contains("frames: 100 of 1000")));
    child.signal(Signal::INT);
    let stderr: Vec<String> = lines.map(Result::unwrap).collect();
    let ran = Ran::of(child.output());
    assert_eq!(ran.code, Some(130), "{stderr:?}");
    assert!(stderr.iter().any(|line| line.contains("interrupt: the run ends")), "{stderr:?}");
    assert!(ran.stdout.contains("Ended early, by interrupt"), "{}", ran.stdout);
    let trajectory = fs::read_to_string(workspace.path("out/trajectory.txt")).unwrap();
    let poses = trajectory.lines().filter(|line| !line.starts_with('#')).count();
    assert!((100..1000).contains(&poses), "{poses} poses");
    let page = fs::read_to_string(workspace.path("out/report.html")).unwrap();
    assert!(page.contains("by interrupt"));
}

#[test]
fn bad_frames_are_skipped_and_reported() {
    let workspace = Workspace::new();
    let folder = walking(&workspace, "seq", 7);
    let colors = images(&folder, "rgb");
    fs::write(&colors[3], "no image").unwrap();
    // The line of the frame after next stands once more at the end, too late.
    let list = fs::read_to_string(folder.join("rgb.txt")).unwrap();
    let line = list.lines().filter(|line| !line.starts_with('#')).nth(4).unwrap();
    fs::write(folder.join("rgb.txt"), format!("{list}{line}\n")).unwrap();
    let (document, stderr) = track(&workspace, "seq", "--out out");
    let counts = ["frames", "skipped", "tracked", "lost"].map(|key| document[key].as_u64());
    assert_eq!(counts, [6, 2, 6, 0].map(Some), "{stderr}");
    let name = colors[3].file_name().unwrap().to_str().unwrap();
    assert_eq!(stderr.matches("frame skipped").count(), 2, "{stderr}");
    assert!(stderr.contains(name) && stderr.contains("does not follow"), "{stderr}");
}

#[test]
fn a_camera_that_sees_nothing_is_lost_and_found_again() {
    let workspace = Workspace::new();
    let folder = walking(&workspace, "seq", 13);
    for index in 6..9 {
        let (color, depth) = (images(&folder, "rgb"), images(&folder, "depth"));
        png(&color[index], png::ColorType::Rgb, png::BitDepth::Eight, 0);
        png(&depth[index], png::ColorType::Grayscale, png::BitDepth::Sixteen, 0);
    }
    let (document, stderr) = track(&workspace, "seq", "--out out");
    assert_eq!(document["frames"], 13);
    let (tracked, lost) = (number(&document, "tracked"), number(&document, "lost"));
    assert!(tracked + lost == 13.0 && lost >= 3.0, "{document}");
    assert!(stderr.contains("tracking is lost"), "{stderr}");
    // The last frame is tracked again.
    let trajectory = fs::read_to_string(workspace.path("out/trajectory.txt")).unwrap();
    let stamp = images(&folder, "rgb")[12].file_stem().unwrap().to_str().unwrap().to_owned();
    let last = trajectory.lines().last().unwrap().split(' ').next().unwrap();
    assert_eq!(last.parse::<f64>(), stamp.parse::<f64>());
}

#[test]
fn given_masks_are_in_the_masks_that_are_saved() {
    let workspace = Workspace::new();
    let folder = walking(&workspace, "seq", 3);
    fs::create_dir_all(workspace.path("given")).unwrap();
    let names: Vec<_> = images(&folder, "rgb");
    let given = workspace.path("given").join(names[1].file_name().unwrap());
    png(&given, png::ColorType::Grayscale, png::BitDepth::Eight, 255);
    track(&workspace, "seq", "--out out --save-masks --no-mask --mask-dir given");
    let saved = files(&workspace.path("out/masks"));
    assert_eq!(saved.len(), 3);
    // One mask is all white, the others, of which nothing is known, all black and alike.
    assert!(saved[0].1 == saved[2].1 && saved[0].1 != saved[1].1);
    let report = workspace.json("eval mask given out/masks --json", &[]);
    assert_eq!((&report["frames"], number(&report["iou"], "mean")), (&1.into(), 1.0));
}

#[test]
fn what_cannot_be_run_is_reported() {
    let workspace = Workspace::new();
    for (source, part) in [
        ("seq", "must be mcap:FILE, bag:FOLDER, tum:FOLDER, capture:FOLDER, synthetic:SCENE"),
        ("tum:", "must be mcap:FILE, bag:FOLDER, tum:FOLDER, capture:FOLDER, synthetic:SCENE"),
        ("mcap:", "must be mcap:FILE, bag:FOLDER, tum:FOLDER, capture:FOLDER, synthetic:SCENE"),
        ("synthetic:beach", "there is no scene `beach`"),
    ] {
        let ran = workspace.run(&format!("run {source}"), &[]);
        assert_eq!(ran.code, Some(2), "{source}");
        assert!(ran.stderr.contains(part), "{source}: {}", ran.stderr);
    }
    workspace.run("run tum:nowhere", &[]).expect_failure(&["nowhere", "cannot be read"]);
    fs::create_dir_all(workspace.path("empty")).unwrap();
    workspace.run("run tum:empty", &[]).expect_failure(&["empty", "rgb.txt"]);
    for bad in ["--readout-ms 101", "--readout-ms=-1", "--depth-late-ms -101"] {
        let ran = workspace.run(&format!("run synthetic:static --frames 1 {bad}"), &[]);
        assert_ne!(ran.code, Some(0), "{bad}");
        assert!(ran.stderr.contains("--readout-ms"), "{bad}: {}", ran.stderr);
    }
}

#[test]
fn a_server_of_its_own_process_holds_the_map() {
    let workspace = Workspace::new();
    walking(&workspace, "seq", 5);
    let server = Running::start(&workspace, &workspace.path("maps"));
    let arguments = format!("--out out --server {} --map office", server.url);
    let (document, _) = track(&workspace, "seq", &arguments);
    let show = workspace.json(&format!("map show office --json --server {}", server.url), &[]);
    assert_eq!(show["keyframes"], document["keyframes"]);
    assert_eq!(show["clients"][0]["client"], "frontend");
    // The map is there already.
    let again = format!("--log error run tum:seq --force {arguments}");
    workspace.run(&again, &[]).expect_failure(&["office", "--map names another"]);
}

#[test]
fn a_sequence_that_fails_does_not_stop_the_others() {
    let workspace = Workspace::new();
    walking(&workspace, "seq", 5);
    let ran = workspace.run("--log off bench-frontend tum:nowhere tum:seq --json --out bench", &[]);
    assert_eq!(ran.code, Some(1), "{}", ran.stderr);
    let document: Value = serde_json::from_str(&ran.stdout).unwrap();
    let [failed, measured] = [0, 1].map(|index| &document["sequences"][index]);
    assert!(failed["error"].as_str().unwrap().contains("nowhere"), "{failed}");
    assert_eq!((&failed["with_mask"], &measured["error"]), (&Value::Null, &Value::Null));
    for run in ["with_mask", "without_mask"] {
        assert_eq!(measured[run]["frames"], 5, "{measured}");
        assert_eq!(measured[run]["counts"], true, "{measured}");
        assert!(number(&measured[run], "ate_m") < 0.02, "{measured}");
        // Five frames are no second.
        assert_eq!(measured[run]["rpe_translation_m_per_s"], Value::Null);
    }
    assert!((0.0..=1.0).contains(&number(measured, "mask_iou")), "{measured}");
}
