//! A job as `covis job` prints it: a row of a table, a page of details, a line while it runs, or JSON.
//!
//! Only converts what the server answered; asks nothing and prints nothing itself.

use serde::Serialize;
use serde_json::Value;

use super::super::choices::name_of;
use super::super::output;
use super::STATES;
use crate::service::{escaped, kind_of_job, maps_of_job};
use crate::wire::v1;

/// A job in `--json`.
#[derive(Debug, Serialize)]
pub(super) struct Document {
    pub(super) id: String,
    kind: &'static str,
    pub(super) state: &'static str,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    maps: Vec<String>,
    priority: i32,
    attempts: i32,
    cancel_requested: bool,
    create_time: Option<String>,
    start_time: Option<String>,
    end_time: Option<String>,
    expire_time: Option<String>,
    phase: Option<String>,
    share: Option<f64>,
    iteration: Option<i32>,
    cost: Option<f64>,
    time_left_s: Option<f64>,
    pub(super) cost_before: Option<f64>,
    pub(super) cost_after: Option<f64>,
    /// Why solves ended that did not converge.
    pub(super) not_converged: Option<String>,
    failure: Option<Failure>,
    files: Vec<File>,
    /// Lists of which the server answered the first entries.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    shortened_lists: Vec<ShortenedList>,
    /// The report of a job that succeeded; absent in lists.
    pub(super) report: Option<Value>,
}

#[derive(Debug, Serialize)]
struct Failure {
    code: i32,
    reason: String,
    message: String,
}

#[derive(Debug, Serialize)]
struct File {
    path: String,
    size_bytes: i64,
}

#[derive(Debug, Serialize)]
struct ShortenedList {
    field: String,
    entries: i64,
    file: String,
}

impl From<v1::Job> for Document {
    fn from(job: v1::Job) -> Self {
        let state = name_of(STATES, &job.state());
        let spec = job.spec.unwrap_or_default();
        let time = |time: Option<prost_types::Timestamp>| time.map(|time| time.to_string());
        let progress = job.progress.unwrap_or_default();
        let row = progress.iteration;
        Self {
            id: job.job_id,
            kind: kind_of_job(&spec),
            state,
            maps: maps_of_job(&spec).into_iter().map(str::to_owned).collect(),
            priority: job.priority,
            attempts: job.attempt_count,
            cancel_requested: job.cancel_requested,
            create_time: time(job.create_time),
            start_time: time(job.start_time),
            end_time: time(job.end_time),
            expire_time: time(job.expire_time),
            phase: Some(progress.phase).filter(|phase| !phase.is_empty()),
            share: progress.share,
            iteration: row.map(|row| row.iteration),
            cost: row.map(|row| row.cost),
            time_left_s: progress.time_left_s,
            cost_before: job.cost_before,
            cost_after: job.cost_after,
            not_converged: job.result.and_then(not_converged),
            failure: job.failure.map(|failure| Failure {
                code: failure.code,
                reason: failure.reason,
                message: failure.message,
            }),
            files: job
                .files
                .into_iter()
                .map(|file| File { path: file.path, size_bytes: file.size_bytes })
                .collect(),
            shortened_lists: job
                .shortened_lists
                .into_iter()
                .map(|list| ShortenedList {
                    field: list.field_path,
                    entries: list.entry_count,
                    file: list.file_path,
                })
                .collect(),
            report: None,
        }
    }
}

/// How the solves of a job ended that did not converge.
fn not_converged(result: v1::JobResult) -> Option<String> {
    use v1::Termination::{ConvergedFunction, ConvergedGradient, ConvergedParameter, Unspecified};
    use v1::job_result::Result as Kind;
    let (whole, problems) = match result.result? {
        Kind::OptimizeMap(result) => (result.summary, Vec::new()),
        Kind::Reconstruct(result) => (result.summary, result.problems),
        Kind::SolveFiles(result) => (None, result.problems),
        Kind::MergeMaps(_)
        | Kind::RebuildMap(_)
        | Kind::CompactMap(_)
        | Kind::EvaluateTrajectory(_)
        | Kind::ExportMap(_) => return None,
    };
    // Of a solve whose certificate is lost it is not known.
    let converged = [ConvergedFunction, ConvergedGradient, ConvergedParameter, Unspecified];
    let summaries = whole.into_iter().chain(problems.into_iter().filter_map(|p| p.summary));
    let mut ends: Vec<String> = summaries
        .filter(|summary| !converged.contains(&summary.termination()))
        .map(|summary| summary.description)
        .collect();
    ends.sort_unstable();
    ends.dedup();
    (!ends.is_empty()).then(|| ends.join("; "))
}

fn costs(job: &Document) -> String {
    let (Some(before), Some(after)) = (job.cost_before, job.cost_after) else {
        return String::new();
    };
    let ended = job.not_converged.as_ref().map(|ended| format!(", not converged: {ended}"));
    format!("{before:.10e} -> {after:.10e}{}", ended.unwrap_or_default())
}

/// Jobs below each other.
pub(super) fn table(jobs: &[Document]) -> String {
    if jobs.is_empty() {
        return "no jobs".to_owned();
    }
    let row = |job: &Document| {
        [
            job.id.clone(),
            job.kind.to_owned(),
            job.state.to_owned(),
            job.maps.join(", "),
            costs(job),
            job.create_time.clone().unwrap_or_default(),
        ]
    };
    output::table(["JOB", "KIND", "STATE", "MAPS", "COST", "CREATED"], jobs.iter().map(row))
}

/// Where a job stands, in one line.
pub(super) fn line(job: &Document) -> String {
    let mut text = format!("{} {}", job.id, job.state);
    if let (Some(phase), "running") = (&job.phase, job.state) {
        text.push_str(&format!(": {phase}"));
    }
    if let Some(share) = job.share {
        text.push_str(&format!(", {:.0} %", 100.0 * share));
    }
    if let (Some(iteration), Some(cost)) = (job.iteration, job.cost) {
        text.push_str(&format!(", iteration {iteration}, cost {cost:.10e}"));
    }
    if let Some(left) = job.time_left_s {
        text.push_str(&format!(", {left:.1} s left"));
    }
    if let Some(failure) = &job.failure {
        text.push_str(&format!(": {} ({})", failure.message, failure.reason));
    }
    escaped(&text, &[]).into_owned()
}

/// What is known of one job, below each other.
pub(super) fn details(job: &Document) -> String {
    let lines = lines(job).into_iter().map(|(name, value)| format!("{name:>10}: {value}"));
    lines.collect::<Vec<_>>().join("\n")
}

/// The same as name and value.
pub(super) fn lines(job: &Document) -> Vec<(&'static str, String)> {
    let mut lines = vec![
        ("job", job.id.clone()),
        ("kind", job.kind.to_owned()),
        ("state", job.state.to_owned()),
        ("maps", job.maps.join(", ")),
        ("cost", costs(job)),
        ("created", job.create_time.clone().unwrap_or_default()),
        ("started", job.start_time.clone().unwrap_or_default()),
        ("ended", job.end_time.clone().unwrap_or_default()),
        ("kept until", job.expire_time.clone().unwrap_or_default()),
        ("phase", job.phase.clone().unwrap_or_default()),
    ];
    if let Some(failure) = &job.failure {
        lines.push(("failure", format!("{} ({})", failure.message, failure.reason)));
    }
    lines.extend(job.files.iter().map(|f| ("file", format!("{}, {} bytes", f.path, f.size_bytes))));
    lines.extend(job.shortened_lists.iter().map(|list| {
        let ShortenedList { field, entries, file } = list;
        let place = if file.is_empty() { String::new() } else { format!(", all in {file}") };
        ("cut", format!("{field}: {entries} entries{place}"))
    }));
    lines.retain(|(_, value)| !value.is_empty());
    // A value is one line, also where a name within it breaks it.
    for (_, value) in &mut lines {
        *value = escaped(value, &[]).into_owned();
    }
    lines
}
