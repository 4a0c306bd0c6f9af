//! Recorded folders of other scales and layouts through the command line: `--depth-scale`, JPEG, and
//! the truth of 7-Scenes.

use std::path::{Path, PathBuf};

use covis::frontend::image::Image;
use covis::frontend::input::{decode, encode};
use fs_err as fs;

use crate::cli_support::{Workspace, close, number};

const FUSE: &str = "--log warn fuse --voxel 0.05 --json";

/// The images of `rgb` or `depth`, in the order of time.
fn images(folder: &Path, kind: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder.join(kind)).unwrap();
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

/// A depth image of 5000 units a meter in millimeters.
fn millimeters(depth: &Path) -> Vec<u8> {
    let units = decode::depth(&fs::read(depth).unwrap()).unwrap();
    encode::gray16(&units.map(|value| (value + 2) / 5)).unwrap()
}

/// Fuses `folder` at the poses of `poses`; the number of triangles and standard error.
fn fuse(workspace: &Workspace, folder: &str, poses: &str, more: &str) -> (f64, String) {
    let arguments =
        format!("{FUSE} tum:{folder} --poses {poses} --out {folder}-fused --force {more}");
    let ran = workspace.run(&arguments, &[]);
    assert_eq!(ran.code, Some(0), "{arguments}: {}", ran.stderr);
    let document: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    (number(&document["mesh"], "triangles"), ran.stderr)
}

#[test]
fn a_recording_in_millimeters_gives_a_warning_and_is_read_with_a_depth_scale() {
    let workspace = Workspace::new();
    let folder = workspace.room(3);
    let (expected, said) = fuse(&workspace, "seq", "seq/groundtruth.txt", "");
    assert!(!said.contains("--depth-scale"), "{said}");

    for depth in images(&folder, "depth") {
        fs::write(&depth, millimeters(&depth)).unwrap();
    }
    let (wrong, said) = fuse(&workspace, "seq", "seq/groundtruth.txt", "");
    assert!(said.contains("at 5000 units a meter") && said.contains("--depth-scale"), "{said}");
    assert!(wrong < 0.5 * expected, "five times too small: {wrong} of {expected}");
    let given = "--depth-scale 1000";
    let (found, said) = fuse(&workspace, "seq", "seq/groundtruth.txt", given);
    assert!(!said.contains("--depth-scale"), "{said}");
    assert!(close(found, expected, 0.02), "{found} triangles, not {expected}");

    let run = "--log warn run tum:seq --out run --force --no-mask --json";
    let ran = workspace.run(run, &[]);
    assert!(ran.stderr.contains("--depth-scale"), "{}", ran.stderr);
    let document = workspace.json(&format!("{run} {given}"), &[]);
    assert_eq!((&document["frames"], &document["lost"]), (&3.into(), &0.into()));
}

#[test]
fn a_depth_scale_that_is_no_scale_is_refused() {
    let workspace = Workspace::new();
    for bad in ["0", "-1000", "nan", "inf", "mm"] {
        let ran = workspace.run(&format!("run tum:seq --depth-scale={bad}"), &[]);
        assert_eq!(ran.code, Some(2), "{bad}: {}", ran.stderr);
        assert!(ran.stderr.contains("--depth-scale"), "{bad}: {}", ran.stderr);
    }
    let ran = workspace.run("--log error run synthetic:static --depth-scale 1000", &[]);
    ran.expect_failure(&["--depth-scale is for recorded folders"]);
}

/// The folder `seven`: the frames of `seq` in the layout of 7-Scenes, with the true poses.
fn seven_scenes(workspace: &Workspace, frames: usize) -> PathBuf {
    let from = workspace.room(frames);
    let folder = workspace.path("seven");
    fs::create_dir(&folder).unwrap();
    let truth = fs::read_to_string(from.join("groundtruth.txt")).unwrap();
    let poses = truth.lines().filter(|line| !line.starts_with('#'));
    let pairs = images(&from, "rgb").into_iter().zip(images(&from, "depth"));
    for (number, ((color, depth), pose)) in pairs.zip(poses).enumerate() {
        let file = |kind: &str| folder.join(format!("frame-{number:06}.{kind}"));
        fs::copy(&color, file("color.png")).unwrap();
        fs::write(file("depth.png"), millimeters(&depth)).unwrap();
        fs::write(file("pose.txt"), matrix(pose)).unwrap();
    }
    fs::copy(from.join("camera.txt"), folder.join("camera.txt")).unwrap();
    folder
}

/// The 4x4 matrix of a line of a TUM trajectory.
fn matrix(line: &str) -> String {
    let numbers: Vec<f64> = line.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let [_, x, y, z, i, j, k, w] = numbers[..] else { panic!("{line}") };
    let rows = [
        [1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j - k * w), 2.0 * (i * k + j * w), x],
        [2.0 * (i * j + k * w), 1.0 - 2.0 * (i * i + k * k), 2.0 * (j * k - i * w), y],
        [2.0 * (i * k - j * w), 2.0 * (j * k + i * w), 1.0 - 2.0 * (i * i + j * j), z],
        [0.0, 0.0, 0.0, 1.0],
    ];
    let row = |row: &[f64; 4]| row.map(|value| format!("{value:.7e}\t ")).concat() + "\n";
    rows.iter().map(row).collect()
}

#[test]
fn the_truth_of_7_scenes_is_a_trajectory_to_compare_with_and_to_fuse_at() {
    let workspace = Workspace::new();
    let folder = seven_scenes(&workspace, 4);
    let (found, said) = fuse(&workspace, "seven", "seven", "");
    assert!(!said.contains("--depth-scale"), "{said}");
    let (expected, _) = fuse(&workspace, "seq", "seq", "");
    assert!(close(found, expected, 0.02), "{found} triangles, not {expected}");

    // As a file for other programs, at the times that a run gives its frames.
    let document = workspace.json("eval truth seven truth.txt --json", &[]);
    assert_eq!(document["poses"], 4);
    let times = |name: &str| -> Vec<String> {
        let text = fs::read_to_string(workspace.path(name)).unwrap();
        let lines = text.lines().filter(|line| !line.starts_with('#'));
        lines.map(|line| line.split(' ').next().unwrap().to_owned()).collect()
    };
    workspace.json("--log warn run tum:seven --out run --no-mask --json", &[]);
    assert_eq!(times("truth.txt"), times("run/trajectory.txt"));
    for truth in ["seven", "truth.txt"] {
        let errors = workspace.json(&format!("eval ape {truth} run/trajectory.txt --json"), &[]);
        assert_eq!(errors["pairs"], 4);
        assert!(number(&errors, "rmse") < 0.01, "{truth}: {errors}");
    }

    // A pose that the data set does not know is left out, one that is no pose is named.
    fs::write(folder.join("frame-000002.pose.txt"), "-inf ".repeat(16)).unwrap();
    assert_eq!(workspace.json("eval truth seven truth.txt --force --json", &[])["poses"], 3);
    fs::write(folder.join("frame-000001.pose.txt"), "1 2 3").unwrap();
    workspace
        .run("--log error eval truth seven truth.txt --force", &[])
        .expect_failure(&["frame-000001.pose.txt", "element (0, 3) is missing"]);
    fs::create_dir(workspace.path("empty")).unwrap();
    workspace
        .run("--log error eval ape empty truth.txt", &[])
        .expect_failure(&["neither groundtruth.txt nor frame-000000.pose.txt"]);
}

#[test]
fn color_of_7_scenes_may_be_jpeg() {
    let workspace = Workspace::new();
    let folder = seven_scenes(&workspace, 2);
    let jpeg =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("frontend/src/input/decode/tests/orange.jpg");
    let size = decode::color(&fs::read(&jpeg).unwrap()).unwrap().size();
    let depth = encode::gray16(&Image::filled(size.0, size.1, 2000)).unwrap();
    for number in 0..2 {
        fs::remove_file(folder.join(format!("frame-{number:06}.color.png"))).unwrap();
        fs::copy(&jpeg, folder.join(format!("frame-{number:06}.color.jpg"))).unwrap();
        fs::write(folder.join(format!("frame-{number:06}.depth.png")), &depth).unwrap();
    }
    let arguments = format!("{FUSE} tum:seven --poses seven --out fused --camera 500,500,4,3");
    let document = workspace.json(&arguments, &[]);
    assert_eq!((&document["frames"], &document["skipped"]), (&2.into(), &0.into()));
}
