//! `covis solve`: a file in, its optimum out.
//!
//! The clock of a solve starts when the file's numbers stand in plain arrays: building the problem,
//! initialization, ordering and thread start are counted. The solvers' own clock starts at their
//! call; [`report::Report`] adds what came before.

mod bundle;
mod diagnosis;
mod graph_details;
mod incremental;
mod loss;
mod pose_graph;
mod report;

use std::path::PathBuf;
use std::process::ExitCode;

use covis_solvers::loss::Loss;
use covis_solvers::optimizer::Termination;

use super::config::Config;

/// Arguments of `covis solve`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    problem: Problem,
}

#[derive(Debug, clap::Subcommand)]
enum Problem {
    /// Bundle adjustment of a BAL file or a folder with a COLMAP sparse model.
    Bundle(bundle::Args),
    /// A g2o pose graph, SE2 or SE3; its first vertex (lowest id) is held fixed.
    PoseGraph(pose_graph::Args),
}

/// What both kinds of problem share.
#[derive(Debug, clap::Args)]
struct Shared {
    /// Most iterations, rejected ones included.
    #[arg(long, value_name = "N", default_value_t = 100)]
    max_iterations: usize,
    /// Robust loss of every factor: trivial, huber:W or cauchy:W, W in standard deviations.
    #[arg(long, value_name = "LOSS", default_value = "trivial", value_parser = loss::parse)]
    loss: Loss,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
    /// Write the solved problem in the input's own format, with 17 digits.
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
}

/// Solves the file and reports.
pub(super) fn run(args: Args, config: &Config) -> anyhow::Result<ExitCode> {
    let termination = match args.problem {
        Problem::Bundle(args) => bundle::run(&args, config)?,
        Problem::PoseGraph(args) => pose_graph::run(&args, config)?,
    };
    if termination == Termination::NumericalFailure {
        // Nothing was solved, and a script must see that.
        anyhow::bail!("numerical failure: no step was possible");
    }
    Ok(ExitCode::SUCCESS)
}
