//! The page of a job: what is known of it, and its report: figures, the cost over iterations and time,
//! residuals before and after, of each problem that it solved.
//!
//! Works on the report's JSON as the server wrote it: a key that is not there leaves its part out.

use serde::Deserialize;
use serde_json::Value;

use super::document::{Document, lines};
use crate::cli::html;
use crate::cli::html::solve::{Iteration, cost};
use crate::report::{Page, Plan, Table, number, views};

/// The page of a job.
pub(super) fn page(job: &Document) -> Page {
    let mut page = html::page(&format!("Job {}", job.id), &verdict(job), &lines(job));
    let Some(report) = &job.report else {
        page.note("A job has a report once it has succeeded.");
        return page;
    };
    match report["problems"].as_array() {
        Some(problems) => problems.iter().for_each(|problem| of_problem(&mut page, problem)),
        None => of_problem(&mut page, report),
    }
    page
}

/// What came out, in a sentence.
fn verdict(job: &Document) -> String {
    let mut text = format!("The job {}", job.state);
    if job.state == "pending" || job.state == "running" || job.state == "cancelled" {
        text = format!("The job is {}", job.state);
    }
    if let (Some(before), Some(after)) = (job.cost_before, job.cost_after) {
        text.push_str(&format!(": cost {} → {}", number(before), number(after)));
    }
    if let Some(ended) = &job.not_converged {
        text.push_str(&format!("; not converged: {ended}"));
    }
    text.push('.');
    text
}

/// A key as words, with its unit behind a comma.
fn words(key: &str) -> String {
    const UNITS: [(&str, &str); 7] = [
        ("_seconds", "s"),
        ("_ms", "ms"),
        ("_s", "s"),
        ("_m", "m"),
        ("_px", "px"),
        ("_deg", "deg"),
        ("_bytes", "bytes"),
    ];
    let unit = UNITS.iter().find_map(|(ending, unit)| Some((key.strip_suffix(ending)?, unit)));
    match unit {
        Some((name, unit)) => format!("{}, {unit}", name.replace('_', " ")),
        None => key.replace('_', " "),
    }
}

fn of_problem(page: &mut Page, report: &Value) {
    page.section(report["path"].as_str().unwrap_or("Report"));
    let mut figures = Vec::new();
    flatten("", report, &mut figures);
    page.table(&Table::new("Figures", &["name", "value"], figures));
    trajectories(page, report);
    let list = |key: &str| report[key].as_array().map_or(&[][..], Vec::as_slice);
    let row = |row: &Value| Iteration::deserialize(row).ok();
    let iterations: Vec<Iteration> = list("iterations").iter().filter_map(row).collect();
    if !iterations.is_empty() {
        cost(page, &iterations);
    }
    let rows = list("residuals").iter().map(|kind| {
        let figure = |key: &str| kind[key].as_f64().map_or_else(|| "–".to_owned(), number);
        let text = |key: &str| kind[key].as_str().unwrap_or_default();
        vec![
            format!("{}, {}", text("quantity"), text("unit")),
            figure("count"),
            figure("initial_rms"),
            figure("final_rms"),
            figure("reduced_chi2"),
            figure("outlier_share"),
        ]
    });
    let rows: Vec<_> = rows.collect();
    if !rows.is_empty() {
        page.section("Residuals");
        let head = ["residuals", "count", "rms before", "rms after", "reduced chi2", "outliers"];
        page.table(&Table::new("Before and after the solve", &head, rows));
    }
}

/// Where the keyframes of each client were, and where they are, colored by how far they moved.
fn trajectories(page: &mut Page, report: &Value) {
    let clients = report["trajectories"].as_array().map_or(&[][..], Vec::as_slice);
    for client in clients {
        let positions = |key: &str| Vec::<[f64; 3]>::deserialize(&client[key]).ok();
        let Some((before, after)) = positions("before").zip(positions("after")) else { continue };
        let moved = before.iter().zip(&after).map(|(a, b)| {
            let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
            squares.sum::<f64>().sqrt()
        });
        let moved: Vec<f64> = moved.collect();
        let name = client["client"].as_str().unwrap_or_default();
        page.section(&format!("Keyframes of {name}"));
        let plan = Plan {
            name: "Keyframes after the job",
            positions: &after,
            errors: &moved,
            error_name: "how far they moved, m",
            is_path: true,
            reference: Some(("where they were before", &before)),
            points: &[],
            links: &[],
        };
        page.row(&views(&plan), &[]);
    }
}

/// Rows of all that is a single value, their keys as words; those of objects within objects follow theirs.
fn flatten(prefix: &str, value: &Value, rows: &mut Vec<Vec<String>>) {
    let Value::Object(object) = value else { return };
    for (key, value) in object {
        let name = format!("{prefix}{}", words(key));
        match value {
            Value::Object(_) => flatten(&format!("{name}: "), value, rows),
            Value::String(text) => rows.push(vec![name, text.clone()]),
            Value::Number(figure) => {
                let figure = figure.as_f64().map_or_else(|| figure.to_string(), number);
                rows.push(vec![name, figure]);
            }
            Value::Bool(is) => rows.push(vec![name, if *is { "yes" } else { "no" }.to_owned()]),
            // Lists have pictures and tables of their own.
            Value::Array(_) | Value::Null => {}
        }
    }
}
