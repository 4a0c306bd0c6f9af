//! The work of jobs on problem files: bundle adjustment of BAL files and COLMAP models, after a
//! reconstruction where one is asked for, and pose graphs of g2o files, as `covis solve` does by default.
//!
//! Files are read from the job's own, one problem at a time. A bundle is not interrupted inside of an
//! iteration: a large dense factorization that may be interrupted rounds in another order, and the cost
//! is to be that of `covis solve` to the last digit. A problem that is solved is written down, so that a
//! restart does not solve it again; one on its way goes on from its last checkpoint.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use covis_solvers::bundle_adjustment::{self, solve_kept};
use covis_solvers::evaluation::{ReferencePose, bundle_cost};
use covis_solvers::geometry::{LieGroup, RigidMotion, Se3};
use covis_solvers::graph_optimization::{self, optimize};
use covis_solvers::initialization::Start;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::io::IoError;
use covis_solvers::io::bal::BalFile;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel, ColmapProblem};
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::optimizer::{self, Control};
use covis_solvers::pose_graph;
use covis_solvers::price::{Ceiling, Price};
use covis_solvers::problem::{BundleProblem, PoseGraph, SolveError};
use covis_solvers::reconstruction::{self, Progress, reconstruct};
use serde_json::{Value, json};

use super::checkpoints::Checkpoints;
use super::progress::{StagesLeft, TimeLeft};
use super::run::{Made, Run, add_file, next_output};
use super::uploads::number;
use super::{JobError, report};
use crate::service::convert::count;
use crate::service::convert::solve::{
    add_costs, to_iteration, to_iterations, to_linear_solver, to_reconstruction, to_summary,
};
use crate::service::engine::{Cancellation, Estimate, Rebuilt, SolveStep};
use crate::service::error::ServiceError;
use crate::service::graph_solve::to_graph_summary;
use crate::store::{JobFile, JobUpload};
use crate::wire::v1;
use v1::job_result::Result as Kind;

/// Most iterations of a solve, as of `covis solve`.
const MOST_ITERATIONS: usize = 100;
/// Bytes in memory while a file is read, for each byte of it.
const READING: u64 = 3;

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

/// A problem as its files have it.
enum Source {
    Bal(Box<BalFile>),
    Colmap(Box<ColmapModel>, ColmapEncoding),
    Graph(Box<G2oGraph>),
}

/// What one problem gave.
struct Solved {
    summary: v1::SolveSummary,
    reconstruction: Option<v1::Reconstruction>,
    report: Value,
    /// The solved problem, if it is kept, by the names of its files.
    files: Vec<(String, Vec<u8>)>,
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
                    // Where its cameras are the whole model is told.
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

/// How problems are solved.
#[derive(Clone, Copy)]
struct How {
    /// Whether solutions are kept as files.
    keep: bool,
    /// Whether poses and points are reconstructed first.
    rebuild: bool,
}

/// What several problems gave: each of them, costs, reports.
type AllSolved = (Vec<v1::SolvedProblem>, Option<(f64, f64)>, Value);

/// Solves the files of an upload.
pub(super) async fn solve(run: &Run<'_>, spec: &v1::SolveFilesSpec) -> Result<Made, ServiceError> {
    let how = How { keep: spec.keep_solutions, rebuild: false };
    let (problems, costs, report) = solve_all(run, &spec.upload_id, spec.kind(), how).await?;
    let result = Kind::SolveFiles(v1::SolveFilesResult { problems });
    Ok(Made { result, costs, report })
}

/// Reconstructs the files of an upload, and solves what was found.
pub(super) async fn rebuild(
    run: &Run<'_>,
    spec: &v1::ReconstructSpec,
) -> Result<Made, ServiceError> {
    let how = How { keep: spec.keep_solutions, rebuild: true };
    let kind = v1::ProblemFileKind::Bundle;
    let (problems, costs, report) = solve_all(run, &spec.upload_id, kind, how).await?;
    let result = v1::ReconstructResult { problems, ..v1::ReconstructResult::default() };
    Ok(Made { result: Kind::Reconstruct(result), costs, report })
}

async fn solve_all(
    run: &Run<'_>,
    upload_id: &str,
    kind: v1::ProblemFileKind,
    how: How,
) -> Result<AllSolved, ServiceError> {
    let missing = || JobError::UploadNotFound { upload: upload_id.to_owned() };
    let upload = run.entry.upload.clone().ok_or_else(missing)?;
    let problems = problems(&upload, kind);
    let mut done = match run.entry.done().result {
        Some(Kind::SolveFiles(done)) => done.problems,
        _ => Vec::new(),
    };
    let all = problems.len();
    let mut reports = Vec::with_capacity(all);
    for (index, (path, problem)) in problems.into_iter().enumerate() {
        if index < done.len() {
            let bytes = part(run, index).await?;
            reports.push(serde_json::from_slice::<Value>(&bytes).unwrap_or_default());
            continue;
        }
        if index > 0 && run.context.config.holds("hold-problems") {
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
        let kept = Checkpoints::new(run.context, run.entry, number(index));
        let Solved { summary, reconstruction, mut report, files } =
            one(run, (&path, &problem), &upload, (how, kept)).await?;
        report["path"] = json!(path);
        let bytes = serde_json::to_vec(&report).unwrap_or_default();
        run.write(JobFile::Part(number(index)), bytes).await?;
        let mut kept = Vec::new();
        let mut shown = run.entry.job();
        for (path, bytes) in files {
            let size = count(bytes.len());
            run.write(next_output(&shown), bytes).await?;
            add_file(&mut shown, path.clone(), size);
            kept.push((path, size));
        }
        done.push(v1::SolvedProblem { path, summary: Some(summary), reconstruction });
        reports.push(report);
        let result = Kind::SolveFiles(v1::SolveFilesResult { problems: done.clone() });
        let change = run.change(|job, done| {
            kept.iter().for_each(|(path, size)| add_file(job, path.clone(), *size));
            done.result = Some(result.clone());
        });
        change.await?;
    }
    let sum = |cost: fn(&v1::SolveSummary) -> f64| {
        done.iter().filter_map(|problem| problem.summary.as_ref()).map(cost).sum::<f64>()
    };
    let costs = Some((sum(|summary| summary.initial_cost), sum(|summary| summary.final_cost)));
    let report = match <[Value; 1]>::try_from(reports) {
        Ok([report]) => report,
        Err(reports) => json!({ "problems": reports }),
    };
    Ok((done, costs, report))
}

/// The report of a problem that an earlier attempt solved.
async fn part(run: &Run<'_>, index: usize) -> Result<Vec<u8>, ServiceError> {
    let uid = run.entry.uid;
    let read = super::entry::on_disk(&run.context.jobs.files, move |files| {
        Ok(files.bytes(&uid, JobFile::Part(number(index)))?)
    });
    Ok(read.await?)
}

/// Reads and solves one problem.
async fn one(
    run: &Run<'_>,
    (path, problem): (&str, &Problem),
    upload: &JobUpload,
    (how, mut kept): (How, Checkpoints),
) -> Result<Solved, ServiceError> {
    let source = read(run, problem, upload).await?;
    let ceiling = run.context.config.engine.ceiling();
    let cancellation = Arc::clone(&run.entry.cancellation);
    run.tell(|progress| progress.phase = format!("solves {path}"));
    let entry = Arc::clone(run.entry);
    let context = Arc::clone(run.context);
    let mut left = TimeLeft::new(MOST_ITERATIONS);
    let mut stages = StagesLeft::default();
    let path = path.to_owned();
    let (rebuilds, solves) = (format!("rebuilds {path}"), format!("solves {path}"));
    let mut tell = move |step: &SolveStep| {
        entry.progress(context.jobs.now_ns(), |progress| match step {
            SolveStep::Iteration(row) => {
                let time_left_s = left.after(row);
                progress.phase.clone_from(&solves);
                progress.iteration = Some(to_iteration(row));
                progress.time_left_s = time_left_s;
            }
            SolveStep::Reconstruction(step) => stages.show(step, &rebuilds, progress),
        });
    };
    match source {
        Source::Graph(graph) => {
            let estimate = graph_estimate(&graph, &ceiling).map_err(bad_file)?;
            let work =
                move || solve_graph(*graph, (&path, how.keep), ceiling, &cancellation, &mut tell);
            pooled(run, estimate, work).await
        }
        source @ (Source::Bal(_) | Source::Colmap(..)) => {
            let prepare = move || source.to_problem().map(|problem| (source, problem));
            let prepared =
                crate::service::context::Context::blocking(move || prepare().map_err(bad_file));
            let (source, problem) = prepared.await?;
            let bound = bundle_adjustment::price_bound(&problem.problem);
            let estimate = Estimate::new(bound, MOST_ITERATIONS, &ceiling);
            let work = move || {
                let problem = (source, problem);
                solve_bundle(problem, (&path, how), &mut kept, ceiling, &cancellation, &mut tell)
            };
            pooled(run, estimate, work).await
        }
    }
}

/// Runs a solve on the pool, as a call's.
async fn pooled<R: Send + 'static>(
    run: &Run<'_>,
    estimate: Estimate,
    work: impl FnOnce() -> Result<R, ServiceError> + Send + 'static,
) -> Result<R, ServiceError> {
    let maps = &run.context.maps;
    let account = maps.pool().accounts().tenant(&run.entry.key.0);
    let queued = maps.meters().request_solve();
    let result = maps.pool().run(&account, estimate, move || queued.run(work)).await;
    if result.is_err() {
        maps.meters().solve_panics.increment();
    }
    result?
}

/// Reads the files of a problem.
async fn read(
    run: &Run<'_>,
    problem: &Problem,
    upload: &JobUpload,
) -> Result<Source, ServiceError> {
    let indices: Vec<usize> = match problem {
        Problem::Bal(index) | Problem::Graph(index) => vec![*index],
        Problem::Colmap(_, parts) => parts.to_vec(),
    };
    let names: Vec<(usize, String, u64)> = indices
        .into_iter()
        .filter_map(|index| upload.files.get(index).map(|(p, size)| (index, p.clone(), *size)))
        .collect();
    let bytes = names.iter().map(|(_, _, size)| *size).sum::<u64>().saturating_mul(READING);
    let (files, uid) = (Arc::clone(&run.context.jobs.files), run.entry.uid);
    let problem = problem.clone();
    let work = move || {
        let mut contents = Vec::with_capacity(names.len());
        for (index, path, _) in names {
            let bytes = files.bytes(&uid, JobFile::Input(number(index))).map_err(JobError::from)?;
            contents.push((path, bytes));
        }
        parse(&problem, &contents).map_err(bad_file)
    };
    // Reading is counted as the memory that it takes.
    let price = Price { bytes, flops_per_iteration: 0.0 };
    pooled(run, Estimate::new(price, 1, &Ceiling::NONE), work).await
}

fn parse(problem: &Problem, files: &[(String, Vec<u8>)]) -> Result<Source, IoError> {
    let file = |index: usize| {
        files.get(index).map_or((Path::new(""), &[][..]), |(p, bytes)| (Path::new(p), &bytes[..]))
    };
    let (path, bytes) = file(0);
    Ok(match problem {
        Problem::Bal(_) => Source::Bal(Box::new(BalFile::parse(bytes, path)?)),
        Problem::Graph(_) => Source::Graph(Box::new(G2oGraph::parse(bytes, path)?)),
        Problem::Colmap(encoding, _) => {
            let contents = [file(0), file(1), file(2)].map(|(_, bytes)| bytes);
            let folder = path.parent().unwrap_or(path);
            Source::Colmap(Box::new(ColmapModel::parse(*encoding, contents, folder)?), *encoding)
        }
    })
}

impl Source {
    fn to_problem(&self) -> Result<ColmapProblem, IoError> {
        match self {
            Self::Bal(file) => {
                Ok(ColmapProblem { problem: file.to_problem(), ..ColmapProblem::default() })
            }
            Self::Colmap(model, _) => model.to_problem(),
            Self::Graph(_) => Ok(ColmapProblem::default()),
        }
    }

    /// Name of the format in reports.
    fn format(&self) -> &'static str {
        match self {
            Self::Bal(_) => "bal",
            Self::Colmap(_, ColmapEncoding::Text) => "colmap-text",
            Self::Colmap(_, ColmapEncoding::Binary) => "colmap-binary",
            Self::Graph(_) => "g2o",
        }
    }

    /// The files of the solved problem.
    fn files(
        &mut self,
        solved: &ColmapProblem,
        path: &str,
    ) -> Result<Vec<(String, Vec<u8>)>, IoError> {
        match self {
            Self::Bal(file) => {
                file.update_from(&solved.problem)?;
                Ok(vec![(kept_path(path), file.to_bytes())])
            }
            Self::Colmap(model, encoding) => {
                model.update_from(solved)?;
                let files = model.to_files(*encoding)?.into_iter();
                Ok(files
                    .map(|(name, bytes)| (kept_path(&format!("{path}/{name}")), bytes))
                    .collect())
            }
            Self::Graph(_) => Ok(Vec::new()),
        }
    }
}

/// The path of a file that a client writes below a folder of its own: relative, without "..".
fn kept_path(path: &str) -> String {
    let is_plain = |part: &&str| !matches!(*part, "" | "." | "..") && !part.contains(['\\', ':']);
    let parts: Vec<&str> = path.split('/').filter(is_plain).collect();
    if parts.is_empty() { "problem".to_owned() } else { parts.join("/") }
}

fn bad_file(error: IoError) -> ServiceError {
    JobError::BadFile { text: error.to_string() }.into()
}

fn unsolvable(error: SolveError) -> ServiceError {
    ServiceError::Unsolvable { field: "spec.solve_files", error }
}

fn solve_bundle(
    (mut source, mut solved): (Source, ColmapProblem),
    (path, how): (&str, How),
    kept: &mut Checkpoints,
    ceiling: Ceiling,
    cancellation: &Cancellation,
    tell: &mut (dyn FnMut(&SolveStep) + Send),
) -> Result<Solved, ServiceError> {
    let control = || match cancellation.is_canceled() {
        true => Control::Cancel,
        false => Control::Continue,
    };
    let images = &solved.image_ids;
    let id = |pose: usize| images.get(pose).map_or(pose as i64, |&image| image.into());
    let bundle = &mut solved.problem;
    let reconstruction = match how.rebuild {
        false => None,
        true => {
            let mut step = |step: &Progress| {
                tell(&SolveStep::Reconstruction(*step));
                control()
            };
            Some(reconstructed(bundle, ceiling, id, &mut step)?)
        }
    };
    let before = bundle_cost(bundle);
    let behind_at_start = bundle.behind_camera_count();
    let optimizer = optimizer::Options {
        max_iterations: MOST_ITERATIONS,
        ceiling,
        ..optimizer::Options::default()
    };
    let options = bundle_adjustment::Options { optimizer, ..bundle_adjustment::Options::default() };
    let from = kept.last();
    let solve = solve_kept(bundle, &options, from.as_ref(), kept, &mut |row| {
        tell(&SolveStep::Iteration(*row));
        control()
    });
    let solve = solve.map_err(unsolvable)?;
    let after = bundle_cost(bundle);
    let mut summary = to_summary(&solve.solve, options.optimizer.method);
    add_costs(&mut summary, &before, &after);
    summary.linear_solver = to_linear_solver(solve.linear_solver).into();
    summary.gauge = v1::Gauge::Free.into();
    summary.free_pose_count = count(bundle.poses.len());
    summary.free_landmark_count = count(bundle.landmarks.len());
    let mut document = json!({
        "problem": "bundle",
        "format": source.format(),
        "poses": bundle.poses.len(),
        "cameras": bundle.cameras.len(),
        "landmarks": bundle.landmarks.len(),
        "observations": bundle.observation_count(),
        "behind_camera_at_start": behind_at_start,
        "behind_camera_observations": solve.behind_camera,
    });
    report::join(&mut document, report::reconstruction(reconstruction.as_ref()));
    report::join(&mut document, report::solve(Some(&summary), &to_iterations(&solve.solve, true)));
    let files = if how.keep { source.files(&solved, path).map_err(bad_file)? } else { Vec::new() };
    Ok(Solved { summary, reconstruction, report: document, files })
}

/// Puts poses and points that are found from the observations in place of those of a file, and leaves out
/// the observations that do not agree, as `covis solve bundle --rebuild` does.
fn reconstructed(
    bundle: &mut BundleProblem,
    ceiling: Ceiling,
    id: impl Fn(usize) -> i64,
    step: &mut reconstruction::Observer<'_>,
) -> Result<v1::Reconstruction, ServiceError> {
    bundle.poses.fill(Se3::identity());
    bundle.landmarks.fill(Default::default());
    let options = reconstruction::Options {
        optimizer: optimizer::Options { ceiling, ..optimizer::Options::default() },
        ..reconstruction::Options::default()
    };
    let found = reconstruct(bundle, &options, &Interrupt::NEVER, step).map_err(unsolvable)?;
    let rebuilt = Rebuilt::new(&found, |pose| (String::new(), id(pose)));
    let rebuilt = rebuilt.map_err(unsolvable)?;
    found.apply_to(bundle);
    Ok(to_reconstruction(&rebuilt))
}

/// The expected cost of a graph's solve.
fn graph_estimate(graph: &G2oGraph, ceiling: &Ceiling) -> Result<Estimate, IoError> {
    let bound = match graph {
        G2oGraph::Se2(file) => pose_graph::price_bound(&file.to_pose_graph()?),
        G2oGraph::Se3(file) => pose_graph::price_bound(&file.to_pose_graph()?),
    };
    Ok(Estimate::new(bound, MOST_ITERATIONS, ceiling))
}

fn solve_graph(
    mut file: G2oGraph,
    (path, keep): (&str, bool),
    ceiling: Ceiling,
    cancellation: &Cancellation,
    tell: &mut (dyn FnMut(&SolveStep) + Send),
) -> Result<Solved, ServiceError> {
    let has_poses = file.has_vertices();
    let (group, solved) = match &mut file {
        G2oGraph::Se2(file) => {
            let mut graph = file.to_pose_graph().map_err(bad_file)?;
            let solved = optimize_graph(&mut graph, has_poses, ceiling, cancellation, tell)?;
            file.update_from(&graph).map_err(bad_file)?;
            ("SE2", solved)
        }
        G2oGraph::Se3(file) => {
            let mut graph = file.to_pose_graph().map_err(bad_file)?;
            let solved = optimize_graph(&mut graph, has_poses, ceiling, cancellation, tell)?;
            file.update_from(&graph).map_err(bad_file)?;
            ("SE3", solved)
        }
    };
    let (summary, mut document, rows) = solved;
    document["group"] = json!(group);
    report::join(&mut document, report::solve(Some(&summary), &rows));
    let files = if keep { vec![(kept_path(path), file.to_bytes())] } else { Vec::new() };
    Ok(Solved { summary, reconstruction: None, report: document, files })
}

fn optimize_graph<G: ReferencePose<N> + RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    has_poses: bool,
    ceiling: Ceiling,
    cancellation: &Cancellation,
    tell: &mut (dyn FnMut(&SolveStep) + Send),
) -> Result<(v1::SolveSummary, Value, Vec<v1::IterationSummary>), ServiceError> {
    let marked = graph.constant.contains(&true);
    if !marked {
        graph.fix_lowest_id();
    }
    let mut options =
        graph_optimization::Options { start: Start::Auto, costs: true, ..Default::default() };
    options.optimizer.max_iterations = MOST_ITERATIONS;
    options.optimizer.ceiling = ceiling;
    let interrupt = cancellation.interrupt();
    let solved = optimize(graph, has_poses, &options, &interrupt, &mut |row| {
        tell(&SolveStep::Iteration(*row));
        Control::Continue
    });
    let solved = solved.map_err(unsolvable)?;
    let summary = to_graph_summary(graph, &solved, &options.optimizer, marked);
    let document = json!({
        "problem": "pose-graph",
        "format": "g2o",
        "vertices": graph.poses.len(),
        "edges": graph.edges.len(),
    });
    Ok((summary, document, to_iterations(&solved.solve, true)))
}
