//! `covis convert`, and trajectories of other formats wherever TUM's are read or written.

use std::path::Path;

use covis_solvers::io::bundler::BundlerFile;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel, ColmapPoint};
use covis_solvers::io::format::FORMATS;
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat};
use nalgebra::{Vector2, Vector3};

use crate::cli_support::{Running, Workspace, data, golden, number};

const TRUTH: &str = "twins/walk-truth.txt";
const ESTIMATE: &str = "twins/walk-estimate.txt";

#[test]
fn a_trajectory_is_scored_alike_in_every_format() {
    let workspace = Workspace::new();
    let (truth, estimate) = (golden(TRUTH), golden(ESTIMATE));
    let before = workspace.json("eval ape {} {} --json", &[&truth, &estimate]);
    for (name, path) in [("truth.csv", &truth), ("estimate.csv", &estimate)] {
        let told = workspace.json(&format!("convert {{}} {name} --json"), &[path]);
        assert_eq!((&told["from"], &told["to"]), (&"tum".into(), &"euroc".into()));
    }
    let after = workspace.json("eval ape truth.csv estimate.csv --json", &[]);
    assert!((number(&before, "rmse") - number(&after, "rmse")).abs() < 1e-9, "{before} {after}");
    // By number both trajectories must have as many poses.
    workspace.json("convert {} a.kitti --json", &[&truth]);
    let same = workspace.json("eval ape a.kitti a.kitti --json", &[]);
    assert!(number(&same, "rmse") < 1e-12, "{same}");
    let mixed = workspace.run("eval ape {} a.kitti", &[&truth]);
    mixed.expect_failure(&["a.kitti", "no times", "covis convert a.kitti OUT.txt --times FILE"]);
    let folder = golden(TRUTH);
    let fused = workspace.run("fuse synthetic:static --poses a.kitti --out dense", &[]);
    fused.expect_failure(&["a.kitti", "holds no times"]);
    let forced = workspace.run("eval ape {} {} --format euroc", &[&folder, &estimate]);
    forced.expect_failure(&["walk-truth.txt, line", "looks like a TUM trajectory (tum)"]);
}

#[test]
fn kitti_gets_its_times_from_a_file_beside_it() {
    let workspace = Workspace::new();
    workspace.file("poses.txt", "1 0 0 5 0 1 0 6 0 0 1 7\n1 0 0 6 0 1 0 6 0 0 1 7\n");
    workspace.file("times.txt", "0.5\n1.5e0\n");
    let told = workspace.json("convert poses.txt out.txt --times times.txt --json", &[]);
    assert_eq!(told["from"], "kitti");
    assert_eq!(told["times"], serde_json::Value::Null);
    let read = Trajectory::read(&workspace.path("out.txt")).unwrap();
    assert_eq!(read.timestamps, [0.5, 1.5]);
    let numbered = workspace.run("convert poses.txt out.csv", &[]);
    assert!(numbered.stdout.contains("times are the numbers of rows"), "{}", numbered.stdout);
    workspace.file("times.txt", "0.5\n");
    workspace
        .run("convert poses.txt out.txt --times times.txt --force", &[])
        .expect_failure(&["times.txt", "1 times, but poses.txt has 2 poses"]);
}

#[test]
fn a_model_goes_from_bal_to_colmap_to_bundler_and_keeps_its_cost() {
    let workspace = Workspace::new();
    let bal = golden("twins/window-6-80.txt");
    let cost = |path: &Path| {
        let report =
            workspace.json("solve bundle {} --fix-intrinsics --max-iterations 0 --json", &[path]);
        number(&report, "initial_cost")
    };
    let before = cost(&bal);
    workspace.json("convert {} model --json", &[&bal]);
    let model = workspace.path("model");
    assert_eq!(ColmapEncoding::of_folder(&model), Some(ColmapEncoding::Binary));
    assert!((cost(&model) - before).abs() <= 1e-9 * before, "{before}");
    workspace.json("convert model text --to colmap-text --json", &[]);
    let read = |name: &str| ColmapModel::read(&workspace.path(name)).unwrap();
    assert_eq!(read("text"), read("model"));
    let told = workspace.json("convert text bundle.out --json", &[]);
    let file = BundlerFile::read(&workspace.path("bundle.out")).unwrap();
    assert_eq!(told["poses"], file.cameras.len());
    assert_eq!(file.image_names[0], "image000001");
    workspace.json("convert bundle.out back.txt --json", &[]);
    assert!((cost(&workspace.path("back.txt")) - before).abs() <= 1e-9 * before, "{before}");
    workspace.json("convert back.txt path.txt --to tum --json", &[]);
    let path = Trajectory::read(&workspace.path("path.txt")).unwrap();
    assert_eq!(path.len(), file.cameras.len());
    workspace.json("convert back.txt picture.ply --json", &[]);
    let picture = fs_err::read(workspace.path("picture.ply")).unwrap();
    let vertices = format!("element vertex {}\n", file.points.len() + file.cameras.len());
    assert!(String::from_utf8_lossy(&picture[..200]).contains(&vertices));
}

#[test]
fn a_pose_graph_becomes_a_trajectory_by_its_ids() {
    let workspace = Workspace::new();
    let graph = "VERTEX_SE2 7 1 2 0.5\nVERTEX_SE2 3 0 0 0\nEDGE_SE2 3 7 1 2 0.5 1 0 0 1 0 1\n";
    workspace.file("graph.g2o", graph);
    let told = workspace.json("convert graph.g2o path.txt --json", &[]);
    assert_eq!(told["times"], "the ids of vertices");
    let path = Trajectory::read(&workspace.path("path.txt")).unwrap();
    assert_eq!(path.timestamps, [3.0, 7.0]);
    assert_eq!(path.world_from_body[1].translation.y, 2.0);
    let turn = path.world_from_body[1].rotation.matrix()[(1, 0)].asin();
    assert!((turn - 0.5).abs() < 1e-12);
    workspace
        .run("convert graph.g2o model --to bal", &[])
        .expect_failure(&["bal (images and points) cannot be made from g2o (pose graph)"]);
}

#[test]
fn landmarks_of_a_graph_are_points_for_viewers() {
    let workspace = Workspace::new();
    let (input, out) = (golden("twins").join("park-80.g2o"), workspace.path("park.ply"));
    let document = workspace.json("convert {} {} --json", &[&input, &out]);
    let counts = ["poses", "landmarks", "observations"].map(|field| document[field].as_u64());
    assert_eq!(counts, [Some(80), Some(24), Some(342)]);
    let head = fs_err::read(&out).unwrap();
    let head = String::from_utf8_lossy(&head[..200]).into_owned();
    assert!(head.contains("element vertex 104\n"), "{head}");
}

#[test]
fn ids_that_are_no_exact_times_do_not_become_times() {
    let workspace = Workspace::new();
    // As GTSAM's keys x0 to x3.
    let vertices = (0..4).map(|k| {
        let id = 8_646_911_284_551_352_320_u64 + k;
        format!("VERTEX_SE2 {id} {k} 0 0\n")
    });
    workspace.file("graph.g2o", &vertices.collect::<String>());
    let told = workspace.json("convert graph.g2o path.txt --json", &[]);
    assert!(told["times"].as_str().unwrap().starts_with("the numbers of vertices"), "{told}");
    let path = Trajectory::read(&workspace.path("path.txt")).unwrap();
    assert_eq!(path.timestamps, [0.0, 1.0, 2.0, 3.0]);
    assert_eq!(path.world_from_body[3].translation.x, 3.0);
}

#[test]
fn what_cannot_be_converted_is_told_with_what_to_do() {
    let workspace = Workspace::new();
    let truth = golden(TRUTH);
    workspace
        .run("convert {} out", &[&truth])
        .expect_failure(&["out: the format does not follow", "--to"]);
    workspace.run("convert none.txt out.csv", &[]).expect_failure(&["none.txt"]);
    fs_err::create_dir(workspace.path("empty")).unwrap();
    workspace.run("convert empty out.csv", &[]).expect_failure(&["empty", "cameras.bin"]);
    workspace.file("broken.txt", "1 2 3 4 0 0 0 1\n2 3\n");
    workspace
        .run("convert broken.txt out.csv", &[])
        .expect_failure(&["broken.txt, line 2", "translation[1] is missing"]);
    assert!(!workspace.path("out.csv").exists());
    workspace.file("graph.g2o", "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n");
    workspace
        .run("eval ape graph.g2o {}", &[&truth])
        .expect_failure(&["graph.g2o: is not a trajectory but pose graph", "covis convert"]);
    workspace.run("convert graph.g2o out.tum", &[]).expect_failure(&["edges only", "pose-graph"]);
}

#[test]
fn a_map_is_exported_and_imported_as_kitti_and_euroc() {
    let workspace = Workspace::new();
    let folder = workspace.path("data");
    let server = Running::start(&workspace, &folder);
    let truth = golden(TRUTH);
    workspace.json("convert {} walk.csv --json", &[&truth]);
    let on = format!("--server {}", server.url);
    workspace.json(&format!("map import walk walk.csv {on} --json"), &[]);
    let out = format!("map export walk --format euroc --out out.csv {on} --json");
    workspace.json(&out, &[]);
    let read =
        |name: &str, format| Trajectory::read_any(&workspace.path(name), Some(format)).unwrap().0;
    let given = Trajectory::read(&truth).unwrap();
    let euroc = read("out.csv", TrajectoryFormat::Euroc);
    assert_eq!(euroc.len(), given.len());
    for (a, b) in euroc.timestamps.iter().zip(&given.timestamps) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    fs_err::create_dir(workspace.path("folder")).unwrap();
    let exported =
        workspace.json(&format!("map export walk --format kitti --out folder {on} --json"), &[]);
    let file = exported["files"][0].as_str().unwrap();
    assert!(file.ends_with(".kitti"), "{file}");
    let kitti = read(file, TrajectoryFormat::Kitti);
    assert_eq!(kitti.world_from_body.len(), given.len());
    let left: Vec<_> = fs_err::read_dir(workspace.path("folder")).unwrap().collect();
    assert_eq!(left.len(), 1, "the server's own form is not left behind");
}

/// COLMAP's bundle adjustment ends the process at a track of one view.
#[test]
fn a_map_is_exported_to_colmap_without_points_of_one_view_and_nothing_else_loses_them() {
    let workspace = Workspace::new();
    let mut model = ColmapModel::read(&golden("twins/colmap-room")).unwrap();
    let (count, image) = (model.points.len(), *model.images.keys().next().unwrap());
    model.points.insert(9999, ColmapPoint::new(&Vector3::new(0.5, 0.25, 4.0), [1, 2, 3]));
    model.push_observation(image, &Vector2::new(20.0, 30.0), 9999).unwrap();
    model.write(&workspace.path("model"), ColmapEncoding::Text).unwrap();
    let told = workspace.json("convert model binary --to colmap-binary --json", &[]);
    assert_eq!(told["single_view_points"], 1);
    assert_eq!(ColmapModel::read(&workspace.path("binary")).unwrap(), model);
    let told = workspace.run("convert model binary --to colmap-binary --force", &[]).stdout;
    assert!(told.contains("; 1 points in fewer than two images"), "{told}");

    let folder = workspace.path("data");
    let server = Running::start(&workspace, &folder);
    let on = format!("--server {}", server.url);
    workspace.json(&format!("map import room model {on} --json"), &[]);
    let export = format!("map export room --format colmap-binary {on} --json --out");
    let exported = |name: &str| {
        workspace.json(&format!("{export} {name}"), &[]);
        ColmapModel::read(&workspace.path(name.split(' ').next().unwrap())).unwrap()
    };
    let keypoints = |model: &ColmapModel| -> usize {
        model.images.values().map(|image| image.keypoints.len()).sum()
    };
    let (some, all) = (exported("some"), exported("all --all-points"));
    assert_eq!((some.points.len(), all.points.len()), (count, count + 1));
    assert_eq!((some.single_view_points(), all.single_view_points()), (0, 1));
    assert_eq!(keypoints(&some), keypoints(&all), "a keypoint without its point stays");
    assert!(all.points.values().all(|point| point.error >= 0.0), "each has its error");
    workspace
        .run(&format!("map export room --format tum --out out.tum --all-points {on}"), &[])
        .expect_failure(&["all_landmarks", "only COLMAP's formats leave landmarks out"]);
}

#[test]
fn docs_formats_has_the_list_of_formats() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/formats.md");
    let text = fs_err::read_to_string(path).unwrap();
    let rows: Vec<String> = FORMATS
        .iter()
        .map(|entry| {
            let endings: Vec<String> =
                entry.extensions.iter().map(|ending| format!("`.{ending}`")).collect();
            let endings =
                if endings.is_empty() { "a folder".to_owned() } else { endings.join(", ") };
            let ways = match (entry.is_read, entry.is_written) {
                (true, true) => "read and written",
                (true, false) => "read",
                (false, _) => "written",
            };
            format!(
                "| `{}` | {} | {} | {endings} | {ways} |",
                entry.name,
                entry.title,
                entry.content.name()
            )
        })
        .collect();
    let table: Vec<&str> = text.lines().filter(|line| line.starts_with("| `")).collect();
    assert_eq!(table[..rows.len()], rows, "docs/formats.md has another table");
}

#[test]
fn commas_between_seconds_are_read_as_tums() {
    let Some(truth) = data("cases/commas_truth.txt") else { return };
    let Some(estimate) = data("cases/commas_estimate.txt") else { return };
    let workspace = Workspace::new();
    // evo, on the same numbers with blanks.
    let check = |report: &serde_json::Value| {
        let angle = number(&report["angle_deg"], "rmse");
        assert!((angle - 1.001468).abs() < 1e-6, "{report}");
    };
    check(&workspace.json("eval ape {} {} --json", &[&truth, &estimate]));
    for (name, path) in [("truth.csv", &truth), ("estimate.csv", &estimate)] {
        fs_err::copy(path, workspace.path(name)).unwrap();
    }
    check(&workspace.json("eval ape truth.csv estimate.csv --json", &[]));
    let told = workspace.json("convert truth.csv back.txt --json", &[]);
    assert_eq!(told["from"], "tum");
    check(&workspace.json("eval ape back.txt {} --json", &[&estimate]));
    let limited = "eval ape {} {} --max-time-difference 0.0001";
    workspace.run(limited, &[&truth, &estimate]).expect_failure(&["0.0001"]);
}

#[test]
fn a_file_without_poses_is_told_by_what_is_wrong_with_it() {
    let workspace = Workspace::new();
    let truth = golden(TRUTH);
    workspace.file("empty.txt", "");
    workspace.file("comments.txt", "# timestamp tx ty tz qx qy qz qw\n");
    workspace.file("cr.txt", "# t\r1.5 1 2 3 0 0 0 1\r");
    workspace.file("rows.tum", "1 0 0 5 0 1 0 6 0 0 1 7\n");
    for (name, parts) in [
        ("empty.txt", ["empty.txt: there is no pose", "the file is empty"]),
        ("comments.txt", ["comments.txt: there is no pose", "only comments"]),
        ("cr.txt", ["cr.txt: the lines end in CR only", "LF"]),
        ("rows.tum", ["rows.tum, line 1", "looks like KITTI odometry poses (kitti)"]),
    ] {
        workspace.run(&format!("eval ape {{}} {name}"), &[&truth]).expect_failure(&parts);
        workspace.run(&format!("eval ape {name} {{}}"), &[&truth]).expect_failure(&parts);
    }
    // What gzip begins with, and a comma.
    fs_err::write(workspace.path("problem.txt.gz"), b"\x1f\x8b\x08\x00,\n,,").unwrap();
    for command in ["solve bundle", "solve pose-graph"] {
        let run = workspace.run(&format!("{command} problem.txt.gz"), &[]);
        run.expect_failure(&["problem.txt.gz: is compressed (gzip); `gunzip"]);
        assert!(!run.stderr.contains("EuRoC"), "{}", run.stderr);
    }
    let run = workspace.run("eval ape problem.txt.gz {}", &[&truth]);
    run.expect_failure(&["problem.txt.gz: is compressed (gzip)"]);
}
