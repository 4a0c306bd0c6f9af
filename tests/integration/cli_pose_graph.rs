//! `covis solve pose-graph` on graphs that are not in order: repaired, or named for what they lack.
//!
//! The solver's own tests hold what is right; these hold what a user is told, in text and in JSON.

use std::path::PathBuf;

use crate::cli_support::{Workspace, close, golden, number};

fn twin(name: &str) -> PathBuf {
    golden("twins").join(format!("{name}.g2o"))
}

const TRIANGLE: &str = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_SE2 2 1 1 0\n\
    EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 0 1 0 1 2 0 1 0 5\n\
    EDGE_SE2 0 2 1 1.1 0 2 0 0 -3 0 1\n";

#[test]
fn indefinite_information_is_refused_or_repaired_and_told() {
    let workspace = Workspace::new();
    let input = workspace.file("graph.g2o", TRIANGLE);
    let refused = workspace.run("solve pose-graph {}", &[&input]);
    refused.expect_failure(&["graph.g2o, line 5", "edge 1 to 2", "2 such", "--repair-information"]);

    let out = workspace.path("out.g2o");
    let arguments = "solve pose-graph {} --repair-information --json --out {}";
    let report = workspace.json(arguments, &[&input, &out]);
    let repaired = &report["repaired"];
    assert_eq!((&repaired["edges"], &repaired["first_line"]), (&2.into(), &5.into()));
    assert_eq!((&repaired["i"], &repaired["j"]), (&1.into(), &2.into()));
    assert!(close(number(repaired, "smallest_eigenvalue"), -1.0, 1e-12));
    // The written file is the repaired problem at its solution: there is nothing left to do.
    let again = workspace.json("solve pose-graph {} --json --init given", &[&out]);
    assert!(again.get("repaired").is_none());
    let (first, second) = (number(&report, "final_cost"), number(&again, "initial_cost"));
    assert!((first - second).abs() < 1e-12, "{first} {second}");

    let text = workspace.run("solve pose-graph {} --repair-information", &[&input]).stdout;
    for part in ["gauge: vertex 0 fixed", "repaired: 2 information matrices, the first in line 5"] {
        assert!(text.contains(part), "`{part}` in {text}");
    }
    let sound = workspace.json("solve pose-graph {} --repair-information --json", &[&out]);
    assert_eq!(sound["repaired"], serde_json::json!({ "edges": 0 }));
}

#[test]
fn vertices_without_information_are_named() {
    let workspace = Workspace::new();
    let edges = "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 0 1 0 1 0 0 1 0 0\n";
    let input = workspace.file("leaf.g2o", edges);
    for options in ["", "--method gn", "--init spanning-tree", "--loss huber:1"] {
        let arguments = format!("solve pose-graph {{}} --json {options}");
        let report = workspace.json(&arguments, &[&input]);
        let open = serde_json::json!([{ "id": 2, "directions": [[0.0, 0.0, 1.0]] }]);
        assert_eq!(
            (&report["undetermined"], &report["converged"]),
            (&open, &true.into()),
            "{options}"
        );
    }
    let text = workspace.run("solve pose-graph {}", &[&input]).stdout;
    assert!(text.contains("undetermined: vertex 2 (rotation)\n"), "{text}");
    let skew = "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 0 1 0 1 2 0 4 0 1\n";
    let text = workspace.run("solve pose-graph {}", &[&workspace.file("skew.g2o", skew)]).stdout;
    assert!(text.contains("undetermined: vertex 2 ([0.894, -0.447, 0.000])"), "{text}");
}

#[test]
fn a_graph_fed_vertex_by_vertex_ends_at_the_optimum() {
    let workspace = Workspace::new();
    for name in ["sphere-200", "grid-200", "grid-100-edges"] {
        let input = twin(name);
        let out = workspace.path("out.g2o");
        let report = workspace
            .json("solve pose-graph {} --incremental --force --json --out {}", &[&input, &out]);
        let incremental = &report["incremental"];
        assert_eq!(incremental["steps"], report["vertices"], "{name}");
        let cost = number(incremental, "final_cost");
        let times = ["median_ms", "p99_ms", "max_ms"].map(|key| number(incremental, key));
        assert!(times.is_sorted() && times[0] > 0.0, "{name}: {times:?}");
        let batch = workspace.json("solve pose-graph {} --json", &[&input]);
        let best = number(&batch, "final_cost");
        assert!(cost >= best * (1.0 - 1e-9) && cost <= 1.01 * best, "{name}: {cost} {best}");
        let beside = number(incremental, "batch_cost");
        assert!(close(beside, best, 1e-6), "{name}: {beside} {best}");
        // The written file is the estimate.
        let written = workspace.json("solve pose-graph {} --init given --json", &[&out]);
        assert!(close(number(&written, "initial_cost"), cost, 1e-9), "{name}");
    }
    let text = workspace.run("solve pose-graph {} --incremental", &[&twin("grid-200")]).stdout;
    for part in ["vertices", "steps: 200: median", "batch optimum: 1.35", "gauge: vertex 0 fixed"] {
        assert!(text.contains(part), "`{part}` in {text}");
    }
}

#[test]
fn what_incremental_does_not_do_is_refused() {
    let workspace = Workspace::new();
    for options in ["--robust gnc-tls", "--certify", "--init given", "--loss huber:1"] {
        let arguments = format!("solve pose-graph {{}} --incremental {options}");
        let ran = workspace.run(&arguments, &[&twin("grid-200")]);
        assert_eq!(ran.code, Some(2), "{options}: {}", ran.stderr);
    }
    let fixed = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nFIX 1\n";
    let input = workspace.file("fixed.g2o", fixed);
    let ran = workspace.run("solve pose-graph {} --incremental", &[&input]);
    ran.expect_failure(&["fixed.g2o", "vertex 1", "FIX"]);
}

/// g2o itself reads both files and solves them.
#[test]
fn quaternions_far_from_norm_1_and_edges_to_the_same_vertex_are_told() {
    let workspace = Workspace::new();
    let unit = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1";
    let text = format!(
        "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 1 0 0 0 0 0 2\n\
         EDGE_SE3:QUAT 0 0 1 0 0 0 0 0 1 {unit}\nEDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 {unit}\n\
         EDGE_SE3:QUAT 1 1 0 0 0 0 0 0 1 {unit}\n"
    );
    let input = workspace.file("graph.g2o", &text);
    let warnings = [
        "graph.g2o: quaternions far from norm 1 are normalized: 1, the first in line 2",
        "graph.g2o: edges from a vertex to itself are left out: 2, the first in line 3",
    ];
    let out = workspace.path("out.g2o");
    for (arguments, paths) in [
        ("solve pose-graph {} --json --out {} --force", [&*input, &*out]),
        ("convert {} {} --to g2o --force", [&*input, &*out]),
    ] {
        let ran = workspace.run(arguments, &paths);
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        for warning in warnings {
            assert_eq!(ran.stderr.matches(warning).count(), 1, "`{warning}` in {}", ran.stderr);
        }
        let written = fs_err::read_to_string(&out).unwrap();
        assert_eq!(written.matches("EDGE").count(), 1, "{written}");
        let again = workspace.json("solve pose-graph {} --json", &[&out]);
        assert!(again.get("normalized").is_none() && again.get("self_edges").is_none(), "{again}");
    }
    let report = workspace.json("solve pose-graph {} --json", &[&input]);
    assert_eq!(report["normalized"], serde_json::json!({"count": 1, "first_line": 2}));
    assert_eq!(report["self_edges"], serde_json::json!({"count": 2, "first_line": 3}));
    workspace.file("zero.g2o", "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 0\n");
    let zero = workspace.run("solve pose-graph zero.g2o", &[]);
    zero.expect_failure(&["zero.g2o, line 1", "norm 0"]);
}

#[test]
fn a_graph_with_landmarks_and_priors_is_solved_and_written_back_whole() {
    let workspace = Workspace::new();
    let out = workspace.path("out.g2o");
    for (name, fixed) in [("park-80", vec![1014]), ("hall-60", Vec::new())] {
        let arguments = "solve pose-graph {} --init given --force --json --out {}";
        let report = workspace.json(arguments, &[&twin(name), &out]);
        let record = golden(&format!("gtsam/{name}-file-start.json"));
        let record: serde_json::Value =
            serde_json::from_slice(&fs_err::read(record).unwrap()).unwrap();
        for cost in ["initial_cost", "final_cost"] {
            assert!(close(number(&report, cost), number(&record, cost), 1e-8), "{name}: {report}");
        }
        assert_eq!(report["gauge"], serde_json::json!(fixed), "{name}");
        assert!(report["landmarks"].as_u64() > Some(20), "{report}");
        let again = workspace.json("solve pose-graph {} --init given --json", &[&out]);
        assert!(close(number(&again, "initial_cost"), number(&report, "final_cost"), 1e-12));
        let tags = |path: &PathBuf| {
            let text = fs_err::read_to_string(path).unwrap();
            let mut tags: Vec<String> =
                text.lines().map(|line| line.split(' ').next().unwrap().to_owned()).collect();
            tags.sort_unstable();
            tags
        };
        assert_eq!(tags(&out), tags(&twin(name)), "{name}");
    }
    let text = workspace.run("solve pose-graph {}", &[&twin("hall-60")]).stdout;
    for part in ["37 landmarks, 298 measurements of them, 3 priors", "gauge: held by priors"] {
        assert!(text.contains(part), "`{part}` in {text}");
    }
    let input = twin("park-80");
    for (flag, reason) in [
        ("--robust gnc-tls", "landmarks or ranges cannot be judged"),
        ("--certify", "cannot be certified"),
        ("--incremental", "has landmarks, ranges or priors"),
    ] {
        let refused = workspace.run(&format!("solve pose-graph {{}} {flag}"), &[&input]);
        refused.expect_failure(&[reason]);
    }
}

#[test]
fn records_that_are_not_read_are_named_or_skipped_and_counted() {
    let workspace = Workspace::new();
    let text = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nROBOTLASER1 1 2\nVERTEX_CAM 7\n\
        ROBOTLASER1 3\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n";
    let input = workspace.file("graph.g2o", text);
    let refused = workspace.run("solve pose-graph {}", &[&input]);
    refused.expect_failure(&["line 3", "unknown tag `ROBOTLASER1`", "--skip-unknown"]);
    let report = workspace.json("solve pose-graph {} --skip-unknown --json", &[&input]);
    let lines = |count: u64, first: u64| serde_json::json!({ "count": count, "first_line": first });
    let skipped = serde_json::json!({ "ROBOTLASER1": lines(2, 3), "VERTEX_CAM": lines(1, 4) });
    assert_eq!(report["skipped"], skipped);
    let out = workspace.path("copy.g2o");
    let refused = workspace.run("convert {} {}", &[&input, &out]);
    refused.expect_failure(&["line 3", "unknown tag `ROBOTLASER1`", "--skip-unknown"]);
    let told = workspace.run("convert {} {} --skip-unknown", &[&input, &out]).stderr;
    assert!(told.contains("lines with the tag ROBOTLASER1 are skipped: 2"), "{told}");
    let again = workspace.json("solve pose-graph {} --json", &[&out]);
    assert_eq!((&again["vertices"], &again["edges"]), (&2.into(), &1.into()));
}
