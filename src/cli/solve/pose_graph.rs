//! `covis solve pose-graph`: a g2o file in SE(2) or SE(3).
//!
//! Minimizes ½ Σ ρ(rᵀΩr), r = Log(Z⁻¹ · X_i⁻¹ · X_j), with the lowest id fixed, or the `FIX` lines
//! of the file where it has some. The time that the start takes is counted.

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
use serde::Serialize;

use super::Shared;
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
    init_seconds: f64,
    vertices: usize,
    edges: usize,
}

impl Details for GraphDetails {
    fn lines(&self) -> Vec<(&'static str, String)> {
        let size = format!("{}, {} vertices, {} edges", self.group, self.vertices, self.edges);
        let init = self.init.to_possible_value();
        let name = init.as_ref().map_or("", |value| value.get_name());
        let start = format!("{name}, {:.6} s", self.init_seconds);
        vec![("start", start), ("problem", size)]
    }
}

/// Reads, solves, writes, reports, all on the worker threads: they are there before the clock of
/// the solve begins.
pub(super) fn run(args: &Args, config: &Config) -> anyhow::Result<Termination> {
    optimizer::with_threads(Some(config.threads), || run_on_threads(args))?
}

fn run_on_threads(args: &Args) -> anyhow::Result<Termination> {
    let mut file = G2oGraph::read(&args.input)?;
    let start = Instant::now();
    let from_file = file.has_vertices();
    let name = || args.input.display().to_string();
    let outcome = match &mut file {
        G2oGraph::Se2(file) => {
            let mut graph = file.to_pose_graph().with_context(name)?;
            let run = Run { args, start, from_file, group: "SE2" };
            let outcome = run.solve(&mut graph)?;
            file.update_from(&graph)?;
            outcome
        }
        G2oGraph::Se3(file) => {
            let mut graph = file.to_pose_graph().with_context(name)?;
            let run = Run { args, start, from_file, group: "SE3" };
            let outcome = run.solve(&mut graph)?;
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
    ) -> anyhow::Result<Outcome> {
        let shared = &self.args.shared;
        let name = || self.args.input.display().to_string();
        graph.loss = shared.loss;
        if !graph.constant.contains(&true) {
            graph.fix_lowest_id();
        }
        let before = self.start.elapsed();
        let init = initialize(graph, self.args.init.into(), self.from_file).with_context(name)?;
        let init_seconds = (self.start.elapsed() - before).as_secs_f64();
        let mut options = Options::default();
        options.optimizer.max_iterations = shared.max_iterations;
        options.optimizer.threads = None;
        options.optimizer.method = match self.args.method {
            MethodName::Lm => Method::LevenbergMarquardt,
            MethodName::Gn => Method::GaussNewton,
        };
        let mut report = Report::start(shared.json, self.start.elapsed())?;
        let mut observer = |row: &optimizer::IterationSummary| report.observe(row);
        let summary = pose_graph::solve(graph, &options, &mut observer).with_context(name)?;
        let details = GraphDetails {
            problem: "pose-graph",
            group: self.group,
            method: self.args.method,
            init: taken(init),
            init_seconds,
            vertices: graph.poses.len(),
            edges: graph.edges.len(),
        };
        Ok(Outcome { report, summary, details })
    }
}
