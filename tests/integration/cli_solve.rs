//! `covis solve` end to end: goldens of Ceres and GTSAM, `--out`, thread counts, bad input.
//!
//! A golden may lie 1e-9 above the optimum (its solver stops there), so covis has to come within
//! 1e-7 of it from above and may be lower.

use std::path::Path;

use covis_solvers::evaluation::{bundle_cost, pose_graph_cost};
use covis_solvers::io::bal::BalFile;
use covis_solvers::io::colmap::ColmapModel;
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::loss::Loss;
use serde_json::Value;

use crate::cli_support::{Workspace, close, data, golden, golden_json, number};

/// The independent evaluator's cost of a written file.
fn evaluated(kind: &str, path: &Path, loss: Loss) -> f64 {
    if kind == "pose-graph" {
        match G2oGraph::read(path).unwrap() {
            G2oGraph::Se2(file) => {
                let mut graph = file.to_pose_graph().unwrap();
                graph.loss = loss;
                pose_graph_cost(&graph).total
            }
            G2oGraph::Se3(file) => {
                let mut graph = file.to_pose_graph().unwrap();
                graph.loss = loss;
                pose_graph_cost(&graph).total
            }
        }
    } else {
        let mut problem = if path.is_dir() {
            ColmapModel::read(path).unwrap().to_problem().unwrap().problem
        } else {
            BalFile::read(path).unwrap().to_problem()
        };
        problem.observation_loss = loss;
        bundle_cost(&problem).total
    }
}

/// Solves, checks the report against itself and against the file that `--out` wrote.
fn solve(kind: &str, input: &Path, options: &str, loss: Loss) -> Value {
    let workspace = Workspace::new();
    let out = workspace.path("out");
    let arguments = format!("solve {kind} {{}} --json --out {{}} {options}");
    let report = workspace.json(&arguments, &[input, &out]);
    let final_cost = number(&report, "final_cost");
    let found = evaluated(kind, &out, loss);
    assert!(close(final_cost, found, 1e-9), "{input:?}: {final_cost} told, {found} written");
    check_rows(&report);
    report
}

pub(crate) fn check_rows(report: &Value) {
    let rows = report["iterations"].as_array().unwrap();
    assert_eq!(rows[0]["cost"], report["initial_cost"]);
    assert_eq!(rows.last().unwrap()["cost"], report["final_cost"]);
    for (k, pair) in rows.windows(2).enumerate() {
        assert_eq!(pair[1]["iteration"], k + 1);
        assert!(number(&pair[1], "seconds") >= number(&pair[0], "seconds"));
        match pair[1]["accepted"].as_bool().unwrap() {
            true => assert!(number(&pair[1], "cost") <= number(&pair[0], "cost")),
            false => assert_eq!(pair[1]["cost"], pair[0]["cost"]),
        }
    }
    assert!(number(report, "solve_seconds") >= number(rows.last().unwrap(), "seconds"));
    assert!(report["termination"].is_string());
}

/// Compares with the record of another solver.
fn check_golden(report: &Value, record: &str) {
    let record = golden_json(record);
    let (cost, reference) = (number(report, "final_cost"), number(&record, "final_cost"));
    assert!(cost <= reference * (1.0 + 1e-7), "{record}: covis ends at {cost}");
    // A start that is made is each solver's own.
    if report.get("init").is_none_or(|init| init == "given") {
        let start = number(report, "initial_cost");
        assert!(close(start, number(&record, "initial_cost"), 1e-8), "{record}: starts at {start}");
    }
}

#[test]
fn twins_reach_the_goldens_of_ceres_and_gtsam() {
    let check = |kind: &str, twin: &str, options: &str, record: &str| {
        let report = solve(kind, &golden("twins").join(twin), options, Loss::Trivial);
        check_golden(&report, record);
        let reference = number(&golden_json(record), "final_cost");
        assert!(close(number(&report, "final_cost"), reference, 1e-7), "{record}: another minimum");
    };
    check("bundle", "window-6-80.txt", "", "ceres/window-6-80-full.json");
    let fixed = "ceres/window-6-80-fixed-intrinsics.json";
    check("bundle", "window-6-80.txt", "--fix-intrinsics", fixed);
    check("bundle", "window-6-80.txt", "--fix-intrinsics --linear-solver sparse-schur", fixed);
    check("bundle", "window-6-80.txt", "--fix-intrinsics --linear-solver dense-schur", fixed);
    let colmap = "gtsam/colmap-room-fixed-intrinsics.json";
    check("bundle", "colmap-room", "--fix-intrinsics", colmap);
    check("pose-graph", "sphere-200.g2o", "", "ceres/sphere-200-file-start.json");
    check("pose-graph", "sphere-200.g2o", "--init given", "ceres/sphere-200-file-start.json");
    check(
        "pose-graph",
        "sphere-200.g2o",
        "--init given --method gn",
        "ceres/sphere-200-file-start.json",
    );
    for init in ["given", "odometry", "spanning-tree", "chordal", "auto"] {
        let options = format!("--init {init}");
        check("pose-graph", "grid-200.g2o", &options, "gtsam/grid-200-file-start.json");
    }
    let edges = "gtsam/grid-100-edges-odometry-start.json";
    check("pose-graph", "grid-100-edges.g2o", "", edges);
    check("pose-graph", "grid-100-edges.g2o", "--method gn", edges);
}

#[test]
fn the_report_says_what_was_solved() {
    let room = solve("bundle", &golden("twins/colmap-room"), "--fix-intrinsics", Loss::Trivial);
    assert_eq!((&room["poses"], &room["cameras"]), (&6.into(), &2.into()));
    assert_eq!((&room["observations"], &room["format"]), (&293.into(), &"colmap-text".into()));
    let pixels = &room["residuals"][0];
    let facts = (&pixels["quantity"], &pixels["unit"], &pixels["count"], &pixels["sigma"]);
    assert_eq!(facts, (&"pixel".into(), &"px".into(), &293.into(), &"plausible".into()));
    assert!(number(pixels, "final_rms") < number(pixels, "initial_rms"));
    assert!(number(pixels, "reduced_chi2") > 0.0);
    let options = "--linear-solver sparse-schur --threads 2 --max-iterations 2";
    let window = golden("twins/window-6-80.txt");
    let report = solve("bundle", &window, options, Loss::Trivial);
    assert_eq!((&report["linear_solver"], &report["threads"]), (&"sparse-schur".into(), &2.into()));
    assert_eq!(report["iterations"].as_array().unwrap().len(), 3);
    assert_eq!(
        (&report["termination"], &report["converged"]),
        (&"max iterations".into(), &false.into())
    );
    let edges = solve("pose-graph", &golden("twins/grid-100-edges.g2o"), "", Loss::Trivial);
    assert_eq!((&edges["init"], &edges["group"]), (&"chordal".into(), &"SE2".into()));
    let quantities = edges["residuals"].as_array().unwrap().iter().map(|row| &row["quantity"]);
    assert!(quantities.eq(["relative translation", "relative rotation"]));
    assert!(number(&edges, "init_seconds") <= number(&edges["iterations"][0], "seconds"));
}

#[test]
fn robust_solves_name_the_closures_that_they_switch_off() {
    let workspace = Workspace::new();
    let grid = std::fs::read_to_string(golden("twins/grid-200.g2o")).unwrap();
    let information = "500 0 0 500 0 500";
    let edges = grid.lines().filter(|line| line.starts_with("EDGE")).count();
    let input = workspace.path("false.g2o");
    let text = format!("{}\nEDGE_SE2 3 150 40 -40 2 {information}\n", grid.trim_end());
    std::fs::write(&input, text).unwrap();
    let off = |report: &Value| -> Vec<(u64, i64)> {
        let list = report["robust"]["switched_off"].as_array().unwrap();
        list.iter().map(|o| (o["edge"].as_u64().unwrap(), o["i"].as_i64().unwrap())).collect()
    };
    for kernel in ["gnc-tls", "gnc-gm"] {
        let arguments = format!("solve pose-graph {{}} --json --robust {kernel}");
        let clean = workspace.json(&arguments, &[&golden("twins/grid-200.g2o")]);
        let report = workspace.json(&arguments, &[&input]);
        let mut expected = off(&clean);
        expected.push((edges as u64, 3));
        assert_eq!(off(&report), expected, "{kernel}");
        if kernel == "gnc-tls" {
            let (cost, clean) = (number(&report, "final_cost"), number(&clean, "final_cost"));
            assert!(close(cost, clean, 1e-7), "{cost} {clean}");
        }
    }
}

#[test]
fn a_trusted_closure_is_never_switched_off() {
    let workspace = Workspace::new();
    let grid = std::fs::read_to_string(golden("twins/grid-200.g2o")).unwrap();
    let false_edge = "EDGE_SE2 3 150 40 -40 2 500 0 0 500 0 500\n";
    let input = workspace.file("false.g2o", &format!("{}\n{false_edge}", grid.trim_end()));
    let off = |options: &str| -> Vec<i64> {
        let arguments = format!("solve pose-graph {{}} --json --robust gnc-tls {options}");
        let report = workspace.json(&arguments, &[&input]);
        let list = report["robust"]["switched_off"].as_array().unwrap();
        list.iter().map(|closure| closure["i"].as_i64().unwrap()).collect()
    };
    assert!(off("").contains(&3));
    assert!(!off("--trusted 150,3").contains(&3), "in either direction");
    let ran = workspace.run("solve pose-graph {} --robust gnc-tls --trusted 3,151", &[&input]);
    ran.expect_failure(&["false.g2o", "--trusted 3,151", "no edge"]);
}

#[test]
fn a_certificate_is_of_the_chordal_optimum_and_the_log_cost_stands_beside_it() {
    let check = |input: &Path, options: &str, chordal: Option<(f64, f64)>, cost: Option<f64>| {
        let report = solve("pose-graph", input, options, Loss::Trivial);
        let certificate = &report["certificate"];
        assert_eq!(certificate["objective"], "chordal", "{input:?}");
        assert_eq!(certificate["certified"], true, "{input:?}: {certificate}");
        assert_eq!(certificate["ignores_loss"], false);
        let found = number(certificate, "cost");
        assert!(number(certificate, "gap") <= 1e-5 * found, "{certificate}");
        assert!(number(certificate, "min_eigenvalue") > -1e-6, "{certificate}");
        if let Some((expected, digits)) = chordal {
            assert!((found - expected).abs() <= digits, "{input:?}: {certificate}");
        }
        if let Some(cost) = cost {
            let found = number(&report, "final_cost");
            assert!(found <= cost * (1.0 + 1e-7), "{input:?}: {found}");
        }
        // Its time counts: row 0 is after it.
        let before = number(&report, "init_seconds") + number(certificate, "seconds");
        assert!(number(&report["iterations"][0], "seconds") >= before - 2e-6);
        report
    };
    let grid = golden("twins/grid-200.g2o");
    let gtsam = number(&golden_json("gtsam/grid-200-file-start.json"), "final_cost");
    assert_eq!(check(&grid, "--certify", None, Some(gtsam))["init"], "chordal");
    let given = check(&grid, "--certify --init given", None, Some(gtsam));
    assert_eq!(given["init"], "given");
    for (name, expected, digits, record) in [
        ("sphere2500", 1687.0, 0.5, "ceres/sphere2500-file-start.json"),
        ("CSAIL", 31.70, 5e-3, "gtsam/CSAIL-odometry-start.json"),
        ("intel", 52.35, 5e-3, "gtsam/intel-file-start.json"),
    ] {
        if let Some(input) = data(&format!("pose_graph/{name}.g2o")) {
            let cost = number(&golden_json(record), "final_cost");
            check(&input, "--certify", Some((expected, digits)), Some(cost));
        }
    }
}

#[test]
fn certificates_say_what_they_leave_out_and_where_there_is_none() {
    let workspace = Workspace::new();
    let grid = golden("twins/grid-200.g2o");
    let plain = workspace.json("solve pose-graph {} --json", &[&grid]);
    assert!(plain.get("certificate").is_none());
    let arguments = "solve pose-graph {} --json --certify --loss huber:0.5";
    let report = workspace.json(arguments, &[&grid]);
    assert_eq!(report["certificate"]["ignores_loss"], true);
    let arguments = "solve pose-graph {} --certify --loss huber:0.5";
    let text = workspace.run(arguments, &[&grid]).stdout;
    let line = text.lines().find(|line| line.contains("certificate: ")).unwrap();
    for part in ["the chordal optimum", "is certified", "loss ignored", "another objective's"] {
        assert!(line.contains(part), "{line}");
    }
    // Two gauges are one more than the chordal objective has.
    let fixed = std::fs::read_to_string(&grid).unwrap() + "FIX 0\nFIX 1\n";
    let fixed = workspace.file("fixed.g2o", &fixed);
    let ran = workspace.run("solve pose-graph {} --certify", &[&fixed]);
    ran.expect_failure(&["fixed.g2o", "certify", "several constant poses"]);
}

#[test]
fn the_closures_that_are_kept_are_certified() {
    let workspace = Workspace::new();
    let grid = golden("twins/grid-200.g2o");
    let false_edge = "EDGE_SE2 3 150 40 -40 2 500 0 0 500 0 500\n";
    let text = std::fs::read_to_string(&grid).unwrap();
    let input = workspace.file("false.g2o", &format!("{}\n{false_edge}", text.trim_end()));
    let run = |options: &str| {
        let arguments = format!("solve pose-graph {{}} --json --robust gnc-tls {options}");
        workspace.json(&arguments, &[&input])
    };
    let (robust, both) = (run(""), run("--certify"));
    assert_eq!(both["certificate"]["certified"], true, "{}", both["certificate"]);
    let (plain, certified) = (number(&robust, "final_cost"), number(&both, "final_cost"));
    assert!(close(certified, plain, 1e-7), "{certified} {plain}");
    let off = |report: &Value| -> Vec<u64> {
        let list = report["robust"]["switched_off"].as_array().unwrap();
        list.iter().map(|closure| closure["edge"].as_u64().unwrap()).collect()
    };
    assert_eq!(off(&both), off(&robust));
    assert!(!off(&both).is_empty());
}

#[test]
fn losses_lower_the_cost_and_are_evaluated_alike() {
    let (window, grid) = (golden("twins/window-6-80.txt"), golden("twins/grid-200.g2o"));
    for (text, loss) in [("huber:0.5", Loss::Huber(0.5)), ("cauchy:0.5", Loss::Cauchy(0.5))] {
        let report = solve("bundle", &window, &format!("--loss {text}"), loss);
        assert!(number(&report, "final_cost") < 62.0, "{text}");
        let report = solve("pose-graph", &grid, &format!("--loss {text}"), loss);
        assert!(number(&report, "final_cost") < 135.0, "{text}");
    }
}

#[test]
fn real_files_reach_the_goldens() {
    let check = |kind: &str, file: &str, options: &str, record: &str| {
        if let Some(input) = data(file) {
            check_golden(&solve(kind, &input, options, Loss::Trivial), record);
        }
    };
    check("pose-graph", "pose_graph/tinyGrid3D.g2o", "", "ceres/tinyGrid3D-file-start.json");
    check("pose-graph", "pose_graph/smallGrid3D.g2o", "", "ceres/smallGrid3D-file-start.json");
    check(
        "pose-graph",
        "pose_graph/parking-garage.g2o",
        "",
        "ceres/parking-garage-file-start.json",
    );
    check("pose-graph", "pose_graph/sphere2500.g2o", "", "ceres/sphere2500-file-start.json");
    check("pose-graph", "pose_graph/intel.g2o", "", "gtsam/intel-file-start.json");
    check("pose-graph", "pose_graph/CSAIL.g2o", "", "gtsam/CSAIL-odometry-start.json");
    check("pose-graph", "pose_graph/kitti_00.g2o", "", "gtsam/kitti_00-odometry-start.json");
    check("pose-graph", "pose_graph/M3500.g2o", "", "gtsam/M3500-file-start.json");
    check("pose-graph", "pose_graph/city10000.g2o", "", "gtsam/city10000-file-start.json");
    let ladybug = "ceres/ladybug-49-7776-fixed-intrinsics.json";
    check("bundle", "bal/ladybug-49-7776.txt", "--fix-intrinsics", ladybug);
    let trafalgar = "ceres/trafalgar-21-11315-full.json";
    check("bundle", "bal/trafalgar-21-11315.txt", "", trafalgar);
    if let Some(input) = data("bal/ladybug-49-7776.txt") {
        // The bound that is asked for: the valley is flat, Ceres needs 228 steps to the end of it.
        let report = solve("bundle", &input, "", Loss::Trivial);
        assert!(number(&report, "final_cost") <= 13344.30, "{}", report["final_cost"]);
    }
}

#[test]
fn observations_that_start_behind_their_camera_count_or_are_dropped() {
    let behind = |report: &Value| {
        ["behind_camera_at_start", "dropped_observations", "behind_camera_observations"]
            .map(|key| report[key].as_u64().unwrap())
    };
    let workspace = Workspace::new();
    let (window, out) = (golden("twins/window-6-80.txt"), workspace.path("out"));
    let report = solve("bundle", &window, "", Loss::Trivial);
    assert_eq!((&report["behind_camera"], behind(&report)), (&"count".into(), [2, 0, 0]));
    let arguments = "solve bundle {} --json --behind-camera drop --out {}";
    let report = workspace.json(arguments, &[&window, &out]);
    assert_eq!((&report["behind_camera"], behind(&report)), (&"drop".into(), [2, 2, 0]));
    assert_eq!(report["observations"], 360);
    // The cost is that of the observations that are left; the written file has them all.
    let (before, after) = (BalFile::read(&window).unwrap(), BalFile::read(&out).unwrap());
    assert_eq!(before.observations, after.observations);
    let (mut left, solved) = (before.to_problem(), after.to_problem());
    left.drop_behind_camera();
    assert!(close(number(&report, "initial_cost"), bundle_cost(&left).total, 1e-9));
    (left.poses, left.cameras) = (solved.poses, solved.cameras);
    left.landmarks = solved.landmarks;
    assert!(close(number(&report, "final_cost"), bundle_cost(&left).total, 1e-9));
    let text = workspace.run("solve bundle {} --behind-camera drop", &[&window]).stdout;
    assert!(text.contains("behind camera: 2 observations at the start (dropped), 0 at the end"));

    let Some(input) = data("bal/ladybug-49-7776.txt") else { return };
    let report = workspace.json("solve bundle {} --json", &[&input]);
    assert_eq!(behind(&report), [31, 0, 31]);
    assert!(close(number(&report, "final_cost"), 13344.24, 1e-6), "{}", report["final_cost"]);
    let report = workspace.json("solve bundle {} --json --behind-camera drop", &[&input]);
    assert_eq!(behind(&report), [31, 31, 0]);
    // GTSAM leaves an observation out whenever its point is behind: at the start these 31, and at
    // both ends of the valley the same. It stops 5e-7 above covis.
    check_golden(&report, "gtsam/ladybug-49-7776-full.json");
    let reference = number(&golden_json("gtsam/ladybug-49-7776-full.json"), "final_cost");
    assert!(close(number(&report, "final_cost"), reference, 1e-6), "{}", report["final_cost"]);
}

#[test]
fn the_written_file_has_the_same_bytes_at_any_thread_count() {
    let workspace = Workspace::new();
    let check = |kind: &str, input: &Path| {
        let written = [1, 2, 4].map(|threads| {
            let out = workspace.path(&format!("out-{threads}"));
            let arguments = format!(
                "solve {kind} {{}} --json --max-iterations 5 --threads {threads} --force --out {{}}"
            );
            workspace.json(&arguments, &[input, &out]);
            fs_err::read(out).unwrap()
        });
        assert!(!written[0].is_empty());
        assert_eq!(written[0], written[1], "{input:?}: 1 and 2 threads");
        assert_eq!(written[0], written[2], "{input:?}: 1 and 4 threads");
    };
    check("bundle", &golden("twins/window-6-80.txt"));
    check("pose-graph", &golden("twins/sphere-200.g2o"));
    check("pose-graph", &golden("twins/grid-100-edges.g2o"));
    for (kind, name) in
        [("bundle", "bal/ladybug-49-7776.txt"), ("pose-graph", "pose_graph/sphere2500.g2o")]
    {
        if let Some(input) = data(name) {
            check(kind, &input);
        }
    }
}

#[test]
fn a_person_gets_a_table() {
    let workspace = Workspace::new();
    let ran = workspace.run("solve bundle {}", &[&golden("twins/window-6-80.txt")]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    let head: Vec<&str> = ran.stdout.lines().next().unwrap().split_whitespace().collect();
    assert_eq!(head, ["iteration", "cost", "decrease", "damping", "quality", "time"]);
    for part in [
        "termination: converged",
        "linear solver: dense-schur",
        "362 observations",
        "pixel: 362 with rms",
    ] {
        assert!(ran.stdout.contains(part), "`{part}` in {}", ran.stdout);
    }
}

#[test]
fn bad_input_is_a_failure_that_names_the_place() {
    let workspace = Workspace::new();
    let check = |kind: &str, name: &str, text: &str, parts: &[&str]| {
        let path = workspace.file(name, text);
        workspace.run(&format!("solve {kind} {{}}"), &[&path]).expect_failure(parts);
    };
    let rest = "0 0 0 0 0 0\n500 0 0\n1 2 -3\n";
    check("bundle", "a.txt", &format!("1 1 1\n0 0 3.0 x\n{rest}"), &["a.txt, line 2"]);
    check("bundle", "b.txt", &format!("1 1 1\n0 7 3.0 4.0\n{rest}"), &["b.txt, line 2", "7"]);
    let cut = format!("1 1 1\n0 0 3.0 4.0\n{}", rest.trim_end_matches("-3\n"));
    check("bundle", "cut.txt", &cut, &["cut.txt, line 5", "point 0"]);
    check("bundle", "c.txt", "4000000000 1 1\n0 0 3.0 4.0\n", &["c.txt, line 1", "4000000000"]);
    check("bundle", "d.txt", "", &["d.txt"]);
    let edge = "1 0 0 1 0 0 1 0 1\n";
    let graph = format!("EDGE_SE2 0 1 {edge}EDGE_SE2 5 6 {edge}");
    check("pose-graph", "e.g2o", &graph, &["e.g2o", "2 pieces", "5"]);
    check("pose-graph", "f.g2o", "EDGE_SE2 0 1 1 0 nan 1 0 0 1 0 1\n", &["f.g2o, line 1"]);
    check("pose-graph", "g.g2o", "EDGE_SE2 0 1 1 0 0 1 0 0 -1 0 1\n", &["g.g2o, line 1"]);
    check("pose-graph", "h.g2o", "HELLO\n", &["h.g2o, line 1", "HELLO"]);
    let (nothing, folder) = (workspace.path("nothing"), workspace.path("."));
    workspace.run("solve bundle {}", &[&nothing]).expect_failure(&["nothing", "cannot be read"]);
    workspace.run("solve bundle {}", &[&folder]).expect_failure(&["cameras"]);
    let unwritable = workspace.path("no/such/folder.txt");
    let window = golden("twins/window-6-80.txt");
    let ran = workspace.run("solve bundle {} --json --out {}", &[&window, &unwritable]);
    ran.expect_failure(&["folder.txt", "cannot be written"]);
    assert_eq!(ran.stdout, "");
}

#[test]
fn wrong_usage_is_exit_code_2() {
    let workspace = Workspace::new();
    for arguments in [
        "",
        "solve",
        "solve bundle",
        "solve bundle x --loss huber:-1",
        "solve bundle x --linear-solver cg",
        "solve bundle x --behind-camera keep",
        "solve pose-graph x --method newton",
        "solve pose-graph x --trusted 3,150",
        "solve pose-graph x --robust gnc-tls --trusted 3-150",
        "solve bundle x --threads many",
        "frobnicate",
    ] {
        let ran = workspace.run(arguments, &[]);
        assert_eq!((ran.code, ran.stdout.as_str()), (Some(2), ""), "{arguments}");
    }
    assert_eq!(workspace.run("solve bundle --help", &[]).code, Some(0));
}

#[test]
fn a_camera_of_a_colmap_model_has_the_parameters_of_its_own_model() {
    for (name, optimum) in [("colmap_pinhole", 11.59872018), ("colmap_simple_pinhole", 10.97080636)]
    {
        let Some(path) = data(&format!("cases/{name}")) else { return };
        let report = solve("bundle", &path, "", Loss::Trivial);
        assert!(close(number(&report, "final_cost"), optimum, 1e-7), "{name}: {report}");
        let held = solve("bundle", &path, "--fix-intrinsics", Loss::Trivial);
        let workspace = Workspace::new();
        let focal = "solve bundle {} --free-intrinsics focal-length --json --out focal";
        let focal = workspace.json(focal, &[&path]);
        assert_eq!(focal["free_intrinsics"], serde_json::json!(["focal-length"]));
        let costs = [&report, &focal, &held].map(|report| number(report, "final_cost"));
        assert!(costs.is_sorted() && costs[0] < costs[2], "{name}: {costs:?}");
        let before = &ColmapModel::read(&path).unwrap().cameras[&1];
        let after = &ColmapModel::read(&workspace.path("focal")).unwrap().cameras[&1];
        assert_eq!(after.model, before.model);
        let focal_lengths = if name == "colmap_pinhole" { 2 } else { 1 };
        for (k, (before, after)) in before.parameters.iter().zip(&after.parameters).enumerate() {
            assert_eq!(before == after, k >= focal_lengths, "{name}, parameter {k}");
        }
    }
    let workspace = Workspace::new();
    let both = "solve bundle model --fix-intrinsics --free-intrinsics distortion";
    let run = workspace.run(both, &[]);
    assert_eq!(run.code, Some(2), "{}", run.stderr);
}
