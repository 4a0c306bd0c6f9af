//! One problem of a job: read, solved, and what is kept of it. The same for a server and for a worker.
//!
//! Bundle adjustment of BAL files and COLMAP models, after a reconstruction where one is asked for, and
//! pose graphs of g2o files, as `covis solve` does by default. A bundle is not interrupted inside of an
//! iteration: a large dense factorization that may be interrupted rounds in another order, and the cost
//! is to be that of `covis solve` to the last digit. Where files and checkpoints lie, and who sees the
//! progress, is not known here. Memory is reserved from the first byte that is read until the solution is
//! written: for reading, for the problem beside its solve, and for the solve.

use std::path::Path;
use std::sync::Arc;

use covis_solvers::bundle_adjustment::{self, solve_kept};
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::graph_optimization::{self, GraphPose, optimize};
use covis_solvers::initialization::Start;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::io::IoError;
use covis_solvers::io::bal::BalFile;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel, ColmapProblem};
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::io::reading::FileCounts;
use covis_solvers::optimizer::{self, Control};
use covis_solvers::pose_graph;
use covis_solvers::price::{Ceiling, Price};
use covis_solvers::problem::{BundleProblem, PoseGraph, SolveError};
use covis_solvers::reconstruction::{self, Progress, reconstruct};
use serde_json::{Value, json};

use super::checkpoints::Checkpoints;
use super::progress::{StagesLeft, TimeLeft};
use super::reading::admit;
use super::report;
use super::uploads::is_plain;
use crate::service::convert::count;
use crate::service::convert::solve::{
    add_costs, to_iteration, to_iterations, to_linear_solver, to_reconstruction, to_summary,
};
use crate::service::engine::{
    Account, Cancellation, EngineMeters, Estimate, Rebuilt, Reservation, Resource, SolveStep,
    SolverPool,
};
use crate::service::error::ServiceError;
use crate::service::graph_solve::to_graph_summary;
use crate::service::job_error::JobError;
use crate::wire::v1;

/// Most iterations of a solve, as of `covis solve`.
const MOST_ITERATIONS: usize = 100;

/// The format of a problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    /// A BAL file.
    Bal,
    /// A g2o file.
    Graph,
    /// Cameras, images and points of a COLMAP model, in this order.
    Colmap(ColmapEncoding),
}

/// One problem, and how it is solved.
#[derive(Clone, Debug)]
pub(super) struct Task {
    /// What the problem is called.
    pub(super) path: String,
    pub(super) format: Format,
    /// Path and length in bytes of each of its files.
    pub(super) files: Vec<(String, u64)>,
    pub(super) options: SolvingOptions,
    pub(super) ceiling: Ceiling,
}

/// How problems are solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SolvingOptions {
    /// Whether solutions are kept as files.
    pub(super) keep: bool,
    /// Whether poses and points are reconstructed first.
    pub(super) rebuild: bool,
}

/// With what a problem is solved.
pub(super) struct SolveContext<'a> {
    pub(super) pool: &'a Arc<SolverPool>,
    /// Whose turn it is in the pool.
    pub(super) account: Arc<Account>,
    pub(super) meters: &'a EngineMeters,
    /// Whether the solve is still wanted.
    pub(super) cancellation: Arc<Cancellation>,
    /// Who sees how far it is.
    pub(super) tell: Tell,
}

/// Shows progress: it is given what changes it.
pub(super) type Tell = Arc<dyn Fn(&mut dyn FnMut(&mut v1::JobProgress)) + Send + Sync>;

/// A problem as its files have it.
enum Source {
    Bal(Box<BalFile>),
    Colmap(Box<ColmapModel>, ColmapEncoding),
    Graph(Box<G2oGraph>),
}

/// What one problem gave.
pub(super) struct Solved {
    pub(super) summary: v1::SolveSummary,
    pub(super) reconstruction: Option<v1::Reconstruction>,
    pub(super) report: Value,
    /// The solved problem, if it is kept, by the names of its files.
    pub(super) files: Vec<(String, Vec<u8>)>,
    /// The memory of these files; none of a worker's.
    pub(super) held: Option<Reservation>,
}

/// A problem in memory.
struct Loaded {
    source: Source,
    problem: ColmapProblem,
    /// The expected cost of its solve.
    estimate: Estimate,
    /// The memory of both, and of the solution where it is kept.
    held: Reservation,
}

/// Reads and solves one problem; `read` gives the bytes of its files, of which there are `counts`, on a
/// thread that may block.
///
/// # Errors
/// Those of `read`, [`JobError::BadFile`], [`ServiceError::Unsolvable`], and RESOURCE_EXHAUSTED.
pub(super) async fn solve(
    task: &Task,
    context: &SolveContext<'_>,
    (counts, read): (
        FileCounts,
        impl FnOnce() -> Result<Vec<Vec<u8>>, ServiceError> + Send + 'static,
    ),
    mut kept: Checkpoints,
) -> Result<Solved, ServiceError> {
    let Task { path, options, ceiling, .. } = task;
    let (options, ceiling) = (*options, *ceiling);
    let Loaded { source, problem, estimate, held } = context.read(task, counts, read).await?;
    let cancellation = Arc::clone(&context.cancellation);
    (context.tell)(&mut |progress| progress.phase = format!("solves {path}"));
    let tell = Arc::clone(&context.tell);
    let mut left = TimeLeft::new(Some(MOST_ITERATIONS));
    let mut stages = StagesLeft::default();
    let path = path.clone();
    let (rebuilds, solves) = (format!("rebuilds {path}"), format!("solves {path}"));
    let mut tell = move |step: &SolveStep| {
        tell(&mut |progress| match step {
            SolveStep::Iteration(row) => {
                let time_left_s = left.after(row);
                progress.phase.clone_from(&solves);
                progress.iteration = Some(to_iteration(row));
                progress.time_left_s = time_left_s;
            }
            SolveStep::Reconstruction(step) => stages.show(step, &rebuilds, progress),
        });
    };
    let work = move || {
        let solved = match source {
            Source::Graph(graph) => {
                solve_graph(*graph, &path, options.keep, ceiling, &cancellation, &mut tell)
            }
            source @ (Source::Bal(_) | Source::Colmap(..)) => solve_bundle(
                (source, problem),
                (&path, options),
                &mut kept,
                ceiling,
                &cancellation,
                &mut tell,
            ),
        };
        solved.map(|solved| Solved { held: Some(held), ..solved })
    };
    context.pooled(estimate, work).await
}

impl SolveContext<'_> {
    /// Runs a solve on the pool, as a call's.
    async fn pooled<R: Send + 'static>(
        &self,
        estimate: Estimate,
        work: impl FnOnce() -> Result<R, ServiceError> + Send + 'static,
    ) -> Result<R, ServiceError> {
        let queued = self.meters.request_solve();
        let result = self.pool.run(&self.account, estimate, move || queued.run(work)).await;
        if result.is_err() {
            self.meters.solve_panics.increment();
        }
        result?
    }

    /// Reads the files of a problem, once there is memory for what they become.
    async fn read(
        &self,
        task: &Task,
        counts: FileCounts,
        read: impl FnOnce() -> Result<Vec<Vec<u8>>, ServiceError> + Send + 'static,
    ) -> Result<Loaded, ServiceError> {
        let price = counts.price(task.format.content());
        let (format, names, ceiling) = (task.format, task.files.clone(), task.ceiling);
        let bytes = admit("spec.solve_files", price.reading, &ceiling)?;
        let solution = if task.options.keep { price.solution } else { 0 };
        let account = Arc::clone(&self.account);
        let work = move || {
            let contents: Vec<(String, Vec<u8>)> =
                names.into_iter().map(|(path, _)| path).zip(read()?).collect();
            let source = parse(format, &contents).map_err(bad_file)?;
            drop(contents);
            let problem = source.to_problem().map_err(bad_file)?;
            let bound = source.price_bound(&problem).map_err(bad_file)?;
            let estimate = Estimate::new(bound, MOST_ITERATIONS, &ceiling);
            let bytes = price.problem.saturating_add(solution);
            let held = account.reserve_existing(Resource::RunningSolveBytes, bytes);
            Ok(Loaded { source, problem, estimate, held })
        };
        self.pooled(Estimate::new(bytes, 1, &ceiling), work).await
    }
}

fn parse(format: Format, files: &[(String, Vec<u8>)]) -> Result<Source, IoError> {
    let file = |index: usize| {
        files.get(index).map_or((Path::new(""), &[][..]), |(p, bytes)| (Path::new(p), &bytes[..]))
    };
    let (path, bytes) = file(0);
    Ok(match format {
        Format::Bal => Source::Bal(Box::new(BalFile::parse(bytes, path)?)),
        Format::Graph => Source::Graph(Box::new(G2oGraph::parse(bytes, path)?)),
        Format::Colmap(encoding) => {
            let contents = [file(0), file(1), file(2)].map(|(_, bytes)| bytes);
            let folder = path.parent().unwrap_or(path);
            Source::Colmap(Box::new(ColmapModel::parse(encoding, contents, folder)?), encoding)
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

    /// An upper bound of the price of its solve.
    fn price_bound(&self, problem: &ColmapProblem) -> Result<Price, IoError> {
        Ok(match self {
            Self::Bal(_) | Self::Colmap(..) => bundle_adjustment::price_bound(&problem.problem),
            Self::Graph(graph) => match &**graph {
                G2oGraph::Se2(file) => pose_graph::price_bound(&file.to_pose_graph()?),
                G2oGraph::Se3(file) => pose_graph::price_bound(&file.to_pose_graph()?),
            },
        })
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

/// The path of a file that a client writes below a folder of its own: relative, without "..". That of an
/// upload stays as it is.
fn kept_path(path: &str) -> String {
    let parts: Vec<&str> = path.split('/').filter(|part| is_plain(part)).collect();
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
    (path, options): (&str, SolvingOptions),
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
    let rebuilt = match options.rebuild {
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
    let solver_options =
        bundle_adjustment::Options { optimizer, ..bundle_adjustment::Options::default() };
    let from = kept.last();
    let solve = solve_kept(bundle, &solver_options, from.as_ref(), kept, &mut |row| {
        tell(&SolveStep::Iteration(*row));
        control()
    });
    let solve = solve.map_err(unsolvable)?;
    let after = bundle_cost(bundle);
    let mut summary = to_summary(&solve.solve, solver_options.optimizer.method);
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
    report::join(&mut document, report::reconstruction(rebuilt.as_ref()));
    report::join(&mut document, report::solve(Some(&summary), &to_iterations(&solve.solve, true)));
    let files =
        if options.keep { source.files(&solved, path).map_err(bad_file)? } else { Vec::new() };
    let reconstruction = rebuilt.as_ref().map(to_reconstruction);
    Ok(Solved { summary, reconstruction, report: document, files, held: None })
}

/// Puts poses and points that are found from the observations in place of those of a file, and leaves out
/// the observations that do not agree, as `covis solve bundle --rebuild` does.
fn reconstructed(
    bundle: &mut BundleProblem,
    ceiling: Ceiling,
    id: impl Fn(usize) -> i64,
    step: &mut reconstruction::Observer<'_>,
) -> Result<Rebuilt, ServiceError> {
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
    Ok(rebuilt)
}

fn solve_graph(
    mut file: G2oGraph,
    path: &str,
    keep: bool,
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
    Ok(Solved { summary, reconstruction: None, report: document, files, held: None })
}

fn optimize_graph<G: GraphPose<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    has_poses: bool,
    ceiling: Ceiling,
    cancellation: &Cancellation,
    tell: &mut (dyn FnMut(&SolveStep) + Send),
) -> Result<(v1::SolveSummary, Value, Vec<v1::IterationSummary>), ServiceError> {
    let marked = graph.constant.contains(&true);
    graph.hold_gauge();
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
        "landmarks": graph.landmarks.len(),
    });
    Ok((summary, document, to_iterations(&solved.solve, true)))
}
