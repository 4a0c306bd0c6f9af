//! The work of jobs on problem files: which problems an upload has, one after the other.
//!
//! Files are read from the job's own, one problem at a time. A problem is solved by a worker where there is
//! one (`remote`), else here (`solving`). One that is solved is written down, so that a restart does not
//! solve it again; one that was interrupted continues from its last checkpoint.

use std::collections::BTreeMap;
use std::sync::Arc;

use covis_solvers::io::colmap::ColmapEncoding;
use serde_json::json;

use super::checkpoints::{Checkpoints, OnDisk};
use super::run::{Made, Report, Run, add_file, next_output};
use super::solving::{self, Format, SolveContext, Solved, SolvingOptions, Task, Tell};
use super::uploads::number;
use super::{answer, reading, remote, report};
use crate::service::convert::count;
use crate::service::error::ServiceError;
use crate::service::job_error::JobError;
use crate::store::{JobFile, JobUpload};
use crate::wire::v1;
use v1::job_result::Result as Kind;

/// A problem among the files of an upload.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Problem {
    /// A BAL file.
    Bal(usize),
    /// A g2o file.
    Graph(usize),
    /// Cameras, images and points of a COLMAP model.
    Colmap(ColmapEncoding, [usize; 3]),
}

/// Folder and name of a path.
fn split(path: &str) -> (&str, &str) {
    path.rsplit_once('/').unwrap_or(("", path))
}

/// The problems of an upload, in the order of its files.
fn problems(upload: &JobUpload, kind: v1::ProblemFileKind) -> Vec<(String, Problem)> {
    let mut models: BTreeMap<(&str, &'static str), [Option<usize>; 3]> = BTreeMap::new();
    let encodings = [ColmapEncoding::Binary, ColmapEncoding::Text];
    let part = |name: &str| {
        encodings.into_iter().find_map(|encoding| {
            let names = encoding.file_names();
            Some((encoding, names.iter().position(|&wanted| wanted == name)?))
        })
    };
    for (index, (path, _)) in upload.files.iter().enumerate() {
        let (folder, name) = split(path);
        if let Some((encoding, part)) = part(name) {
            let first = encoding.file_names()[0];
            models.entry((folder, first)).or_default()[part] = Some(index);
        }
    }
    let mut found = Vec::new();
    for (index, (path, _)) in upload.files.iter().enumerate() {
        let (folder, name) = split(path);
        let problem = match (part(name), kind) {
            (
                Some((encoding, part)),
                v1::ProblemFileKind::Bundle | v1::ProblemFileKind::Unspecified,
            ) => {
                let first = encoding.file_names()[0];
                match models.get(&(folder, first)) {
                    // The file of cameras stands for the whole model; its other files are skipped.
                    Some(&[Some(cameras), Some(images), Some(points)]) if part == 0 => {
                        Problem::Colmap(encoding, [cameras, images, points])
                    }
                    Some([Some(_), Some(_), Some(_)]) => continue,
                    Some(_) | None => Problem::Bal(index),
                }
            }
            (_, v1::ProblemFileKind::PoseGraph) => Problem::Graph(index),
            (_, v1::ProblemFileKind::Bundle) => Problem::Bal(index),
            (_, v1::ProblemFileKind::Unspecified) if name.ends_with(".g2o") => {
                Problem::Graph(index)
            }
            (_, v1::ProblemFileKind::Unspecified) => Problem::Bal(index),
        };
        let name = match &problem {
            Problem::Colmap(..) if folder.is_empty() => ".".to_owned(),
            Problem::Colmap(..) => folder.to_owned(),
            Problem::Bal(_) | Problem::Graph(_) => path.clone(),
        };
        found.push((name, problem));
    }
    found
}

/// What several problems gave: each of them, costs, and how many reports there are.
type AllSolved = (Vec<v1::SolvedProblem>, Option<(f64, f64)>, Report);

/// Solves the files of an upload.
pub(super) async fn solve(run: &Run<'_>, spec: &v1::SolveFilesSpec) -> Result<Made, ServiceError> {
    let options = SolvingOptions { keep: spec.keep_solutions, rebuild: false };
    let (done, costs, report) = solve_all(run, &spec.upload_id, spec.kind(), options).await?;
    let (problems, shortened) = answer::solved(done, "result.solve_files.problems");
    let result = Kind::SolveFiles(v1::SolveFilesResult { problems });
    Ok(Made { result, shortened, costs, report })
}

/// Reconstructs the files of an upload, and solves what was found.
pub(super) async fn rebuild(
    run: &Run<'_>,
    spec: &v1::ReconstructSpec,
) -> Result<Made, ServiceError> {
    let options = SolvingOptions { keep: spec.keep_solutions, rebuild: true };
    let kind = v1::ProblemFileKind::Bundle;
    let (done, costs, report) = solve_all(run, &spec.upload_id, kind, options).await?;
    let (problems, shortened) = answer::solved(done, "result.reconstruct.problems");
    let result = v1::ReconstructResult { problems, ..v1::ReconstructResult::default() };
    Ok(Made { result: Kind::Reconstruct(result), shortened, costs, report })
}

async fn solve_all(
    run: &Run<'_>,
    upload_id: &str,
    kind: v1::ProblemFileKind,
    options: SolvingOptions,
) -> Result<AllSolved, ServiceError> {
    let missing = || JobError::UploadNotFound { upload: upload_id.to_owned() };
    let upload = run.entry.upload.clone().ok_or_else(missing)?;
    let problems = problems(&upload, kind);
    let mut done = match run.entry.done().result {
        Some(Kind::SolveFiles(done)) => done.problems,
        _ => Vec::new(),
    };
    let all = problems.len();
    for (index, (path, problem)) in problems.into_iter().enumerate() {
        if index < done.len() {
            continue;
        }
        if index > 0 && run.jobs.context.config.holds("hold-problems") {
            run.phase("held by a test");
            run.entry.cancellation.canceled().await;
        }
        let share = (all > 1).then_some(index as f64 / all as f64);
        run.tell(|progress| {
            *progress = v1::JobProgress {
                phase: format!("reads {path}"),
                share,
                ..v1::JobProgress::default()
            };
        });
        let (task, inputs) = task(run, (&path, &problem), &upload, options);
        // What a worker made is kept for this server until it is written down.
        let (solved, _outstanding) = one(run, &task, inputs, number(index)).await?;
        let Solved { summary, reconstruction, mut report, files, held } = solved;
        report["path"] = json!(path);
        run.write(JobFile::Part(number(index)), report::to_text(&report)).await?;
        let mut kept = Vec::new();
        let mut made = run.entry.files();
        for (path, bytes) in files {
            let size = count(bytes.len());
            run.write(next_output(&made), bytes).await?;
            add_file(&mut made, path.clone(), size);
            kept.push((path, size));
        }
        drop(held);
        let solved = v1::SolvedProblem { path, summary: Some(summary), reconstruction };
        answer::add_solved(&mut done, solved, all);
        let result = Kind::SolveFiles(v1::SolveFilesResult { problems: done.clone() });
        let change = run.change(|job, done| {
            kept.iter().for_each(|(path, size)| add_file(&mut job.files, path.clone(), *size));
            done.result = Some(result.clone());
        });
        change.await?;
    }
    let sum = |cost: fn(&v1::SolveSummary) -> f64| {
        done.iter().filter_map(|problem| problem.summary.as_ref()).map(cost).sum::<f64>()
    };
    let costs = Some((sum(|summary| summary.initial_cost), sum(|summary| summary.final_cost)));
    Ok((done, costs, Report::OfParts(number(all))))
}

/// A problem as it is solved, and the numbers of its files among those of the job.
fn task(
    run: &Run<'_>,
    (path, problem): (&str, &Problem),
    upload: &JobUpload,
    options: SolvingOptions,
) -> (Task, Vec<u32>) {
    let (format, indices) = match problem {
        Problem::Bal(index) => (Format::Bal, vec![*index]),
        Problem::Graph(index) => (Format::Graph, vec![*index]),
        Problem::Colmap(encoding, parts) => (Format::Colmap(*encoding), parts.to_vec()),
    };
    let files = indices.iter().filter_map(|&index| upload.files.get(index).cloned()).collect();
    let ceiling = run.jobs.context.config.engine.ceiling();
    let task = Task { path: path.to_owned(), format, files, options, ceiling };
    (task, indices.into_iter().map(number).collect())
}

/// Solves one problem: by a worker, or here.
async fn one(
    run: &Run<'_>,
    task: &Task,
    inputs: Vec<u32>,
    index: u32,
) -> Result<(Solved, Option<remote::Outstanding>), ServiceError> {
    if let Some((solved, outstanding)) = remote::solve(run, task, &inputs, index).await? {
        return Ok((solved, Some(outstanding)));
    }
    let jobs = run.jobs;
    // More jobs may run than solves where workers do them.
    let closed = |_| ServiceError::Draining;
    let _permit = jobs.solves_here.acquire().await.map_err(closed)?;
    let counts = reading::count(&jobs.files, run.entry.uid, inputs.clone()).await?;
    let (files, uid) = (Arc::clone(&jobs.files), run.entry.uid);
    let read = move || {
        let read = |input| Ok(files.bytes(&uid, JobFile::Input(input)).map_err(JobError::from)?);
        inputs.into_iter().map(read).collect()
    };
    let maps = &jobs.context.maps;
    let solve_context = SolveContext {
        pool: maps.pool(),
        account: jobs.account(&run.entry.key.0),
        meters: maps.meters(),
        cancellation: Arc::clone(&run.entry.cancellation),
        tell: teller(run),
    };
    let on_disk = OnDisk::new(jobs, run.entry, index);
    let holds = jobs.context.config.holds("hold-checkpoint");
    let kept = Checkpoints::new(on_disk, holds, &solve_context);
    Ok((solving::solve(task, &solve_context, (counts, read), kept).await?, None))
}

/// Shows progress as the job's.
fn teller(run: &Run<'_>) -> Tell {
    let (jobs, entry) = (Arc::clone(run.jobs), Arc::clone(run.entry));
    Arc::new(move |change| entry.progress(jobs.now_ns(), change))
}
