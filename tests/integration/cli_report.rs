//! `--report` with the real binary: every command that has it writes a page that loads nothing, says how it
//! was made, and takes hostile names for text.

use std::path::Path;

use fs_err as fs;

use crate::cli_support::{Running, Workspace, golden};

/// A name that would become markup and code where it is not escaped.
const HOSTILE: &str = "<script>alert('1')</script>&\"x";

/// Reads a page and checks what holds for each of them.
fn page(path: &Path) -> String {
    let html = fs::read_to_string(path).unwrap();
    assert!(html.starts_with("<!DOCTYPE html>") && html.ends_with("</html>\n"));
    for text in ["<script", "<link", "<img", "url(", "@import", "href=", "src="] {
        assert!(!html.contains(text), "{text} in {}", path.display());
    }
    assert!(html.contains("default-src 'none'"));
    // No picture without the words that stand for it, and no coordinate that is no number.
    let pictures = html.matches("<svg ").count();
    assert!(pictures > 0);
    assert_eq!(html.matches("<desc id=").count(), pictures);
    assert!(!html.contains("NaN"), "{}", path.display());
    assert!(html.contains("covis 0."));
    assert!(html.len() < 2_000_000, "{} bytes", html.len());
    html
}

fn sections(html: &str) -> Vec<&str> {
    html.split("<h2>").skip(1).filter_map(|rest| rest.split("</h2>").next()).collect()
}

#[test]
fn an_evaluation_shows_where_when_and_how_large_errors_are_with_the_same_bytes_each_time() {
    let workspace = Workspace::new();
    let line =
        |k: u32, y: f64| format!("{} {} {y} 0 0 0 0 1\n", f64::from(k) * 0.1, f64::from(k) * 0.2);
    let truth: String = (0..50).map(|k| line(k, 0.1 * f64::from(k * k % 7))).collect();
    let estimate: String =
        (0..50).map(|k| line(k, 0.1 * f64::from(k * k % 7) + 0.001 * f64::from(k % 3))).collect();
    workspace.file("truth.txt", &truth);
    workspace.file("estimate.txt", &estimate);
    for metric in ["ape", "rpe"] {
        let arguments = format!("eval {metric} truth.txt estimate.txt --report report.html");
        let ran = workspace.run(&arguments, &[]);
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        assert!(ran.stdout.ends_with("The report is report.html\n"), "{}", ran.stdout);
        let html = page(&workspace.path("report.html"));
        let mut expected =
            vec!["Summary", "Trajectory", "Errors over time", "How large the errors are"];
        // Relative errors have no common frame.
        expected.extend((metric == "ape").then_some("Position and orientation"));
        assert_eq!(sections(&html), expected);
        assert!(html.contains("<p class=\"verdict\">The rmse is "), "{html}");
        assert!(html.contains(&format!("<code>covis {arguments}</code>")));
        // With --json the page is the same and standard output is the object alone.
        let json = workspace.json(&format!("{arguments} --json"), &[]);
        let again = page(&workspace.path("report.html"));
        assert_eq!(again.replace(" --json</code>", "</code>"), html);
        let rmse = json["translation_m"]["rmse"].as_f64().unwrap();
        assert!(html.contains(&covis::report::number(rmse)), "{rmse} is not on the page");
    }
}

#[test]
fn solves_show_cost_residuals_before_and_after_and_the_state() {
    let workspace = Workspace::new();
    for (command, path, picture) in [
        ("bundle", golden("twins/window-6-80.txt"), "Cameras from above"),
        ("bundle", golden("twins/colmap-room"), "Cameras from above"),
        ("pose-graph", golden("twins/grid-200.g2o"), "Vertices from above"),
        ("pose-graph", golden("twins/sphere-200.g2o"), "Vertices from the side"),
    ] {
        let out = workspace.path("report.html");
        let arguments = format!("solve {command} {{}} --json --report {{}}");
        let solved = workspace.json(&arguments, &[&path, &out]);
        let html = page(&out);
        for section in ["Cost", "Residuals"] {
            assert!(sections(&html).contains(&section), "{path:?}: {section}");
        }
        assert!(html.contains(picture), "{path:?}");
        // Before and after, in the tables beside the pictures.
        assert!(html.contains(">before</th>") && html.contains(">after</th>"), "{path:?}");
        let cost = format!("{:.10e}", solved["final_cost"].as_f64().unwrap());
        assert!(html.contains(&cost), "{path:?}: {cost}");
    }
    let (graph, out) = (golden("twins/grid-200.g2o"), workspace.path("steps.html"));
    workspace.json("solve pose-graph {} --incremental --json --report {}", &[&graph, &out]);
    assert!(page(&out).contains("Time of a step"));
}

#[test]
fn false_closures_stand_first_among_the_verdicts() {
    let workspace = Workspace::new();
    // A loop of four, and a closure that contradicts it.
    let graph = "\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 2 0 0
VERTEX_SE2 3 3 0 0
VERTEX_SE2 4 4 0 0
EDGE_SE2 0 1 1 0 0 100 0 0 100 0 100
EDGE_SE2 1 2 1 0 0 100 0 0 100 0 100
EDGE_SE2 2 3 1 0 0 100 0 0 100 0 100
EDGE_SE2 3 4 1 0 0 100 0 0 100 0 100
EDGE_SE2 0 2 2 0 0 100 0 0 100 0 100
EDGE_SE2 0 4 0 9 1 100 0 0 100 0 100
";
    workspace.file("graph.g2o", graph);
    workspace.json("solve pose-graph graph.g2o --robust gnc-tls --json --report r.html", &[]);
    let html = page(&workspace.path("r.html"));
    let verdicts = html.split("Verdicts").nth(1).unwrap();
    let (first, second) = (verdicts.find("0 to 4").unwrap(), verdicts.find("0 to 2").unwrap());
    assert!(first < second && verdicts.contains("found false"), "{verdicts}");
    assert!(html.contains("1 closures count (green), 1 were found false (red, dashed)"));
}

#[test]
fn hostile_names_are_text() {
    let workspace = Workspace::new();
    let name = HOSTILE.replace('/', "_");
    let graph = fs::read_to_string(golden("twins/grid-200.g2o")).unwrap();
    let path = workspace.file(&name, &graph);
    let out = workspace.path("report.html");
    workspace.json("solve pose-graph {} --json --report {}", &[&path, &out]);
    let html = page(&out);
    assert!(html.contains("&lt;script&gt;alert(&#39;1&#39;)&lt;_script&gt;&amp;&quot;x"));
}

#[test]
fn a_job_shows_its_report() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("data"));
    let graph = golden("twins/sphere-200.g2o");
    workspace.json(&format!("map import sphere {{}} --server {} --json", server.url), &[&graph]);
    let job = |arguments: &str| {
        workspace.json(&format!("job {arguments} --server {} --json", server.url), &[])
    };
    job("submit optimize-pose-graph --map sphere --id night --wait");
    let shown = job("show night --report night.html");
    let html = page(&workspace.path("night.html"));
    let expected = ["Summary", "Report", "Keyframes of import", "Cost", "Residuals"];
    assert_eq!(sections(&html), expected);
    assert!(html.contains("<p class=\"verdict\">The job succeeded: cost "), "{html}");
    let moved = &shown["report"]["trajectories"][0];
    assert_eq!(moved["before"].as_array().map(Vec::len), Some(200));
    assert_ne!(moved["before"], moved["after"]);
    let cost = format!("{:.10e}", shown["cost_after"].as_f64().unwrap());
    assert!(html.contains(&cost) && html.contains("<h1>Job night</h1>"), "{cost}");
}

#[test]
fn a_run_ends_with_the_path_of_its_page() {
    let workspace = Workspace::new();
    workspace.room(8);
    let ran = workspace.run("--log warn run tum:seq --lock-step --out out", &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(ran.stdout.ends_with("The report is out/report.html\n"), "{}", ran.stdout);
    let html = page(&workspace.path("out/report.html"));
    let expected =
        ["Summary", "Trajectory", "Closures", "Cost", "Local solves", "Residuals", "Time"];
    let shown = sections(&html);
    for section in expected {
        assert!(shown.contains(&section), "{section} in {shown:?}");
    }
    // Scripts get what they ask for.
    workspace.json("--log warn run tum:seq --out json --json", &[]);
    assert!(!workspace.path("json/report.html").exists());
    let ran =
        workspace.run("--log warn run tum:seq --out json --force --report no/where.html", &[]);
    ran.expect_failure(&["no/where.html"]);
}
