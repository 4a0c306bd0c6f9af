//! `covis job` with the real binary.

use serde_json::Value;

use crate::cli_support::{Running, Workspace, golden, number};

fn json(workspace: &Workspace, server: &Running, arguments: &str) -> Value {
    workspace.json(&format!("job {arguments} --server {} --json", server.url), &[])
}

#[test]
fn a_file_is_solved_by_a_server_as_covis_solve_does_it() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("data"));
    let problems = [
        ("optimize-map", "bundle", golden("twins/window-6-80.txt")),
        ("optimize-map", "bundle", golden("twins/colmap-room")),
        ("optimize-pose-graph", "pose-graph", golden("twins/grid-200.g2o")),
    ];
    for (kind, command, path) in problems {
        let solved = workspace.json(&format!("solve {command} {{}} --json"), &[&path]);
        let arguments =
            format!("job submit {kind} --file {{}} --wait --json --server {}", server.url);
        let job = workspace.json(&arguments, &[&path]);
        assert_eq!(job["state"], "succeeded");
        let key = |job: &Value, key| number(job, key).to_bits();
        assert_eq!(key(&job, "cost_before"), key(&solved, "initial_cost"), "{path:?}");
        assert_eq!(key(&job, "cost_after"), key(&solved, "final_cost"), "{path:?}");
        assert_eq!(key(&job["report"], "final_cost"), key(&solved, "final_cost"), "{path:?}");
    }
    // The solution comes back, in the format in which the problem came.
    let (input, out) = (golden("twins/grid-200.g2o"), workspace.path("solved.g2o"));
    let arguments =
        format!("job submit solve --file {{}} --out {{}} --json --server {}", server.url);
    let job = workspace.json(&arguments, &[&input, &out]);
    let direct = workspace.path("direct.g2o");
    workspace.json("solve pose-graph {} --out {} --json", &[&input, &direct]);
    assert_eq!(fs_err::read(&out).unwrap(), fs_err::read(&direct).unwrap());
    assert_eq!(job["files"][1]["path"], "grid-200.g2o");
}

#[test]
fn jobs_on_a_map_are_submitted_listed_shown_and_deleted() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("data"));
    let graph = golden("twins/sphere-200.g2o");
    let import = format!("map import sphere {{}} --server {} --json", server.url);
    workspace.json(&import, &[&graph]);
    let job =
        json(&workspace, &server, "submit optimize-pose-graph --map sphere --id night --wait");
    assert_eq!((&job["id"], &job["state"]), (&"night".into(), &"succeeded".into()));
    assert!(number(&job, "cost_after") <= number(&job, "cost_before"));
    assert_eq!(job["report"]["map"], "sphere");
    let truth = workspace.path("truth.tum");
    let arguments = format!(
        "job submit export --map sphere --format tum --out {{}} --json --server {}",
        server.url
    );
    workspace.json(&arguments, &[&truth]);
    assert!(fs_err::read_to_string(&truth).unwrap().lines().count() > 200);
    let arguments = format!(
        "job submit evaluate --map sphere --truth {{}} --wait --json --server {}",
        server.url
    );
    let job = workspace.json(&arguments, &[&truth]);
    assert!(job["report"]["ape"]["translation_m"]["rmse"].as_f64().unwrap() < 1e-6);
    let job = json(&workspace, &server, "submit compact --map sphere --wait");
    assert_eq!(job["report"]["journal_dropped"], true);

    let list = json(&workspace, &server, "list");
    let kinds: Vec<_> = list.as_array().unwrap().iter().map(|job| &job["kind"]).collect();
    assert_eq!(kinds, ["compact", "evaluate", "export", "optimize-pose-graph"]);
    assert_eq!(json(&workspace, &server, "list --state failed"), serde_json::json!([]));
    let text = workspace.run(&format!("job list --server {}", server.url), &[]).stdout;
    assert_eq!(text.lines().count(), 5, "{text}");
    let shown = json(&workspace, &server, "show night");
    assert_eq!(shown["report"]["map"], "sphere");
    let text = workspace.run(&format!("job show night --server {}", server.url), &[]).stdout;
    assert!(text.contains("succeeded") && text.contains("report.json"), "{text}");
    let watched = workspace.run(&format!("job watch night --json --server {}", server.url), &[]);
    let last: Value = serde_json::from_str(watched.stdout.lines().last().unwrap()).unwrap();
    assert_eq!(last["state"], "succeeded");
    let out = workspace.path("fetched");
    let fetch = format!("job fetch night --out {{}} --json --server {}", server.url);
    workspace.json(&fetch, &[&out]);
    assert!(out.join("report.json").is_file());
    json(&workspace, &server, "delete night");
    let ran = workspace.run(&format!("job show night --server {}", server.url), &[]);
    ran.expect_failure(&["job \"night\" does not exist"]);
}

#[test]
fn a_job_that_does_not_converge_says_so() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("data"));
    let graph = golden("twins/sphere-200.g2o");
    workspace.json(&format!("map import sphere {{}} --server {} --json", server.url), &[&graph]);
    let ends = [
        ("optimize-map --max-iterations 1", "max iterations"),
        ("optimize-pose-graph --max-iterations 0", "max iterations"),
        // A solve takes longer than the millisecond to which this is rounded.
        ("optimize-map --time-limit 1e-9", "deadline"),
    ];
    for (number, (arguments, end)) in ends.into_iter().enumerate() {
        let submit = format!("submit {arguments} --map sphere --id job-{number} --wait");
        let job = json(&workspace, &server, &submit);
        assert_eq!((&job["state"], &job["not_converged"]), (&"succeeded".into(), &end.into()));
        assert_eq!(job["report"]["converged"], false, "{arguments}");
        let shown = format!("job show job-{number} --server {}", server.url);
        let text = workspace.run(&shown, &[]).stdout;
        assert!(text.contains(&format!(", not converged: {end}")), "{text}");
    }
    let job = json(&workspace, &server, "submit optimize-map --map sphere --wait");
    assert_eq!((&job["not_converged"], &job["report"]["converged"]), (&Value::Null, &true.into()));
    let refused =
        format!("job submit optimize-map --map sphere --time-limit 0 --server {}", server.url);
    assert_eq!(workspace.run(&refused, &[]).code, Some(2));
}

#[test]
fn what_cannot_be_done_is_said_in_one_line() {
    let workspace = Workspace::new();
    workspace
        .run("job list --server-wait 0 --server http://127.0.0.1:1", &[])
        .expect_failure(&["127.0.0.1:1"]);
    workspace.run("job list --server nonsense", &[]).expect_failure(&["nonsense"]);
    let server = Running::start(&workspace, &workspace.path("data"));
    let run =
        |arguments: &str| workspace.run(&format!("job {arguments} --server {}", server.url), &[]);
    run("show nothing").expect_failure(&["job \"nothing\" does not exist"]);
    run("watch nothing").expect_failure(&["job \"nothing\" does not exist"]);
    run("cancel nothing").expect_failure(&["job \"nothing\" does not exist"]);
    run("submit optimize-map --map nowhere").expect_failure(&["map \"nowhere\" does not exist"]);
    run("submit optimize-map").expect_failure(&["needs --map"]);
    run("submit export --map nowhere").expect_failure(&["needs --format"]);
    run("submit solve --file nowhere.bal").expect_failure(&["nowhere.bal"]);
    assert_eq!(run("submit everything --map nowhere").code, Some(2));
    // A job that fails is printed, and the exit code tells.
    workspace.file("bad.g2o", "VERTEX_SE2 0 0 0\n");
    let ran = workspace.run(
        &format!("job submit solve --file bad.g2o --wait --json --server {}", server.url),
        &[],
    );
    assert_eq!(ran.code, Some(1));
    let job: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(job["state"], "failed");
    assert!(job["failure"]["message"].as_str().unwrap().contains("bad.g2o"), "{job}");
}
