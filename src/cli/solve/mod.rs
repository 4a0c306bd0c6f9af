//! `covis solve`: reads a problem from a file and optimizes it.
//!
//! The clock of a solve starts when the file's numbers are in plain arrays: it includes building
//! the problem, initialization, ordering and thread start. The solvers' own clock starts at their
//! call; [`report::Report`] adds what came before. This module reads files, measures times and
//! writes reports; it solves nothing.
//!
//! | file | role |
//! |---|---|
//! | `bundle`, `rebuild` | bundle adjustment, and poses and points from the observations |
//! | `pose_graph`, `incremental` | files of graphs, as a whole or vertex by vertex |
//! | `arguments`, `kind`, `graph_file` | flags that both share; which of both a file is for; graphs by format |
//! | `report`, `residuals`, `graph_details`, `graph_page` | what is printed, and the pages |

mod arguments;
mod bundle;
mod graph_details;
mod graph_file;
mod graph_page;
mod incremental;
mod kind;
mod pose_graph;
mod rebuild;
mod report;
mod residuals;

use covis_solvers::optimizer::{self, Termination};

use super::config::Config;
pub(super) use kind::named;

/// Arguments of `covis solve`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    problem: Problem,
}

#[derive(Debug, clap::Subcommand)]
enum Problem {
    /// Bundle adjustment of a file of BAL, Bundler or OpenMVG, or of a folder with a COLMAP sparse model.
    Bundle(bundle::Args),
    /// A g2o or pyfg pose graph, SE2 or SE3; its first vertex (of g2o the lowest id) is held fixed.
    PoseGraph(pose_graph::Args),
}

/// Solves the file and reports, all on the worker threads: they are there before the clock of the
/// solve begins.
pub(super) fn run(args: Args, config: &Config) -> anyhow::Result<()> {
    optimizer::with_threads(Some(config.threads()), || {
        let termination = match args.problem {
            Problem::Bundle(args) => bundle::run(&args)?,
            Problem::PoseGraph(args) => pose_graph::run(&args)?,
        };
        if termination == Termination::NumericalFailure {
            // Nothing was solved, and a script must see that.
            anyhow::bail!("numerical failure: no step was possible");
        }
        Ok(())
    })?
}
