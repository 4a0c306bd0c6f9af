//! `covis solve pose-graph`: a g2o file in SE(2) or SE(3).
//!
//! Minimizes ½ Σ ρ(rᵀΩr), r = Log(Z⁻¹ · X_i⁻¹ · X_j), with the lowest id fixed, or the `FIX` lines
//! of the file where it has some. With `--repair-information` Ω is the nearest positive semi-definite
//! matrix, and that is what `--out` writes. The time that the start takes is counted. With `--robust` the cost
//! is that of odometry and the loop closures at their weights, and the rows are those of the last solve.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context;
use clap::ValueEnum;
use covis_solvers::geometry::RigidMotion;
use covis_solvers::initialization::{Start, initialize};
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::optimizer::{self, Method, SolveSummary, Termination};
use covis_solvers::pose_graph::{self, Options};
use covis_solvers::problem::PoseGraph;
use covis_solvers::robust::{self, Kernel, RobustSummary};
use serde::Serialize;

use super::Shared;
use super::diagnosis::{self, Diagnosis};
use super::report::{Details, Report};
use crate::cli::config::Config;

/// Arguments of `covis solve pose-graph`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// A g2o file with SE2 or SE3 records.
    #[arg(value_name = "FILE")]
    input: PathBuf,
    #[command(flatten)]
    pub(super) shared: Shared,
    /// Levenberg-Marquardt or Gauss-Newton.
    #[arg(long, value_enum, default_value_t = MethodName::Lm)]
    method: MethodName,
    /// Where the poses come from that the solve starts with.
    #[arg(long, value_enum, default_value_t = Init::Auto)]
    init: Init,
    /// Find false loop closures (edges between ids that are not consecutive) and leave them out:
    /// graduated non-convexity to truncated least squares or to Geman-McClure.
    #[arg(long, value_enum, default_value_t = RobustName::None)]
    robust: RobustName,
    /// Largest χ² of a true closure [default: the 99 % quantile, 11.3 in SE2 and 16.8 in SE3].
    #[arg(long, value_name = "CHI2")]
    robust_threshold: Option<f64>,
    /// Take the nearest positive semi-definite matrix for each information matrix that has negative
    /// eigenvalues, which is an error otherwise; --out writes them so.
    #[arg(long)]
    repair_information: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum RobustName {
    None,
    GncTls,
    GncGm,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum MethodName {
    Lm,
    Gn,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Init {
    /// The vertices of the file.
    Given,
    /// Measurements strung together between consecutive ids; closures only where those end.
    Odometry,
    /// Measurements strung together, as few as possible to each vertex.
    SpanningTree,
    /// Relaxed rotations, then positions.
    Chordal,
    /// The vertices of the file or the chordal start, whichever has the lower cost.
    Auto,
}

impl From<Init> for Start {
    fn from(init: Init) -> Self {
        match init {
            Init::Given => Self::Given,
            Init::Odometry => Self::Odometry,
            Init::SpanningTree => Self::SpanningTree,
            Init::Chordal => Self::Chordal,
            Init::Auto => Self::Auto,
        }
    }
}

/// The start that a solve took.
fn taken(start: Start) -> Init {
    match start {
        Start::Given => Init::Given,
        Start::Odometry => Init::Odometry,
        Start::SpanningTree => Init::SpanningTree,
        Start::Chordal => Init::Chordal,
        Start::Auto => Init::Auto,
    }
}

#[derive(Debug, Serialize)]
struct GraphDetails {
    problem: &'static str,
    group: &'static str,
    method: MethodName,
    init: Init,
    /// Absent with `--robust`, which looks for its start itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    init_seconds: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    robust: Option<RobustDetails>,
    vertices: usize,
    edges: usize,
    #[serde(flatten)]
    diagnosis: Diagnosis,
}

/// What `--robust` found.
#[derive(Debug, Serialize)]
struct RobustDetails {
    kernel: RobustName,
    threshold: f64,
    closures: usize,
    solves: usize,
    switched_off: Vec<SwitchedOff>,
}

/// A closure that was found false.
#[derive(Debug, Serialize)]
struct SwitchedOff {
    /// Position among the file's edges, from 0.
    edge: usize,
    i: i64,
    j: i64,
    chi2: f64,
    weight: f64,
}

impl Details for GraphDetails {
    fn lines(&self) -> Vec<(&'static str, String)> {
        let size = format!("{}, {} vertices, {} edges", self.group, self.vertices, self.edges);
        let init = self.init.to_possible_value();
        let name = init.as_ref().map_or("", |value| value.get_name());
        let seconds = self.init_seconds.map(|seconds| format!(", {seconds:.6} s"));
        let start = format!("{name}{}", seconds.unwrap_or_default());
        let mut lines = vec![("start", start), ("problem", size)];
        if let Some(robust) = &self.robust {
            let off = robust.switched_off.len();
            let text = format!(
                "{} of {} switched off (χ² above {:.1}), {} solves; --json lists them",
                off, robust.closures, robust.threshold, robust.solves
            );
            lines.push(("closures", text));
        }
        lines.extend(self.diagnosis.lines());
        lines
    }
}

/// Reads, solves, writes, reports, all on the worker threads: they are there before the clock of
/// the solve begins.
pub(super) fn run(args: &Args, config: &Config) -> anyhow::Result<Termination> {
    optimizer::with_threads(Some(config.threads), || run_on_threads(args))?
}

fn run_on_threads(args: &Args) -> anyhow::Result<Termination> {
    let (mut file, diagnosis) = diagnosis::read(&args.input, args.repair_information)?;
    let start = Instant::now();
    let from_file = file.has_vertices();
    let name = || args.input.display().to_string();
    let outcome = match &mut file {
        G2oGraph::Se2(file) => {
            let mut graph = file.to_pose_graph().with_context(name)?;
            let run = Run { args, start, from_file, group: "SE2" };
            let outcome = run.solve(&mut graph, diagnosis)?;
            file.update_from(&graph)?;
            outcome
        }
        G2oGraph::Se3(file) => {
            let mut graph = file.to_pose_graph().with_context(name)?;
            let run = Run { args, start, from_file, group: "SE3" };
            let outcome = run.solve(&mut graph, diagnosis)?;
            file.update_from(&graph)?;
            outcome
        }
    };
    let Outcome { mut report, summary, details } = outcome;
    report.check_reader()?;
    if let Some(out) = &args.shared.out {
        file.write(out)?;
    }
    report.finish(&summary, &details)?;
    Ok(summary.termination)
}

/// A solve of either group.
struct Run<'a> {
    args: &'a Args,
    start: Instant,
    from_file: bool,
    group: &'static str,
}

struct Outcome {
    report: Report,
    summary: SolveSummary,
    details: GraphDetails,
}

impl Run<'_> {
    fn solve<G: RigidMotion<D, N>, const D: usize, const N: usize>(
        &self,
        graph: &mut PoseGraph<G, N>,
        diagnosis: Diagnosis,
    ) -> anyhow::Result<Outcome> {
        let shared = &self.args.shared;
        let name = || self.args.input.display().to_string();
        graph.loss = shared.loss;
        if !graph.constant.contains(&true) {
            graph.fix_lowest_id();
        }
        let mut options = Options::default();
        options.optimizer.max_iterations = shared.max_iterations;
        options.optimizer.threads = None;
        options.optimizer.method = match self.args.method {
            MethodName::Lm => Method::LevenbergMarquardt,
            MethodName::Gn => Method::GaussNewton,
        };
        let mut details = GraphDetails {
            problem: "pose-graph",
            group: self.group,
            method: self.args.method,
            init: self.args.init,
            init_seconds: None,
            robust: None,
            vertices: graph.poses.len(),
            edges: graph.edges.len(),
            diagnosis,
        };
        let kernel = match self.args.robust {
            RobustName::None => None,
            RobustName::GncTls => Some(Kernel::TruncatedLeastSquares),
            RobustName::GncGm => Some(Kernel::GemanMcClure),
        };
        let start = Start::from(self.args.init);
        let (mut report, summary);
        if let Some(kernel) = kernel {
            report = Report::start(shared.json, self.start.elapsed())?;
            let mut observer = |row: &optimizer::IterationSummary| report.observe(row);
            let threshold = self.args.robust_threshold;
            let options = robust::Options {
                threshold,
                start,
                pose_graph: options,
                ..robust::Options::new(kernel)
            };
            let solved = robust::solve(graph, self.from_file, &options, &mut observer);
            let solved = solved.with_context(name)?;
            details.init = taken(solved.start);
            details.robust = Some(robust_details(graph, self.args.robust, &solved));
            summary = solved.solve;
        } else {
            let before = self.start.elapsed();
            details.init = taken(initialize(graph, start, self.from_file).with_context(name)?);
            details.init_seconds = Some((self.start.elapsed() - before).as_secs_f64());
            report = Report::start(shared.json, self.start.elapsed())?;
            let mut observer = |row: &optimizer::IterationSummary| report.observe(row);
            summary = pose_graph::solve(graph, &options, &mut observer).with_context(name)?;
        }
        details.diagnosis.of_solution(graph).with_context(name)?;
        Ok(Outcome { report, summary, details })
    }
}

fn robust_details<G, const N: usize>(
    graph: &PoseGraph<G, N>,
    kernel: RobustName,
    solved: &RobustSummary,
) -> RobustDetails {
    let off = solved.closures.iter().filter(|verdict| verdict.is_switched_off);
    let switched_off = off.map(|verdict| {
        let edge = &graph.edges[verdict.edge];
        let (i, j) = (graph.ids[edge.i], graph.ids[edge.j]);
        SwitchedOff { edge: verdict.edge, i, j, chi2: verdict.chi2, weight: verdict.weight }
    });
    RobustDetails {
        kernel,
        threshold: solved.threshold,
        closures: solved.closures.len(),
        solves: solved.solves,
        switched_off: switched_off.collect(),
    }
}
