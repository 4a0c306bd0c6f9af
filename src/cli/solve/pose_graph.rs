//! `covis solve pose-graph`: a g2o file in SE(2) or SE(3).
//!
//! Minimizes ½ Σ ρ(rᵀΩr), r = Log(Z⁻¹ · X_i⁻¹ · X_j), with the lowest id fixed, or the `FIX` lines
//! of the file where it has some. The start is the file's, or a spanning tree of its edges where it
//! has no vertices.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context;
use covis_solvers::geometry::LieGroup;
use covis_solvers::initialization::spanning_tree;
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
}

#[derive(Clone, Copy, Debug, clap::ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum MethodName {
    Lm,
    Gn,
}

#[derive(Debug, Serialize)]
struct GraphDetails {
    problem: &'static str,
    group: &'static str,
    method: MethodName,
    init: &'static str,
    vertices: usize,
    edges: usize,
}

impl Details for GraphDetails {
    fn lines(&self) -> Vec<(&'static str, String)> {
        let size = format!("{}, {} vertices, {} edges", self.group, self.vertices, self.edges);
        vec![("start", self.init.replace('_', " ")), ("problem", size)]
    }
}

/// Reads, solves, writes, reports.
pub(super) fn run(args: &Args, config: &Config) -> anyhow::Result<Termination> {
    let mut file = G2oGraph::read(&args.input)?;
    let start = Instant::now();
    let from_file = file.has_vertices();
    let name = || args.input.display().to_string();
    let outcome = match &mut file {
        G2oGraph::Se2(file) => {
            let mut graph = file.to_pose_graph().with_context(name)?;
            let run = Run { args, config, start, from_file, group: "SE2" };
            let outcome = run.solve(&mut graph)?;
            file.update_from(&graph)?;
            outcome
        }
        G2oGraph::Se3(file) => {
            let mut graph = file.to_pose_graph().with_context(name)?;
            let run = Run { args, config, start, from_file, group: "SE3" };
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
    config: &'a Config,
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
    fn solve<G: LieGroup<N>, const N: usize>(
        &self,
        graph: &mut PoseGraph<G, N>,
    ) -> anyhow::Result<Outcome> {
        let shared = &self.args.shared;
        let name = || self.args.input.display().to_string();
        graph.loss = shared.loss;
        if !graph.constant.contains(&true) {
            graph.fix_lowest_id();
        }
        if !self.from_file {
            spanning_tree(graph).with_context(name)?;
        }
        let mut options = Options::default();
        options.optimizer.max_iterations = shared.max_iterations;
        options.optimizer.threads = Some(self.config.threads);
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
            init: if self.from_file { "file" } else { "spanning_tree" },
            vertices: graph.poses.len(),
            edges: graph.edges.len(),
        };
        Ok(Outcome { report, summary, details })
    }
}
