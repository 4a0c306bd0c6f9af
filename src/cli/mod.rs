//! The command line: one file a subcommand.
//!
//! [`run`] parses the arguments, layers the configuration (flags over `COVIS_*` environment over
//! `covis.toml` over defaults), starts logging and hands over to the subcommand. Exit codes: 0 for
//! success, 1 for a failure with one line on standard error, 2 for wrong usage. No mathematics
//! here.
//!
//! | module | role |
//! |---|---|
//! | `serve`, `worker`, `health` | servers and workers |
//! | `map`, `job`, `replay`, `load` | what calls a server |
//! | `solve`, `convert`, `eval`, `synth` | files in, files out |
//! | `run`, `fuse`, `volume`, `bench_frontend`, `demo` | the reference frontend and surfaces; `volume` has `mesh` and `grid` |
//! | `record` | MCAP recordings |
//! | `data_dir` | `doctor` and `backup` |
//! | `config`, `policy`, `choices`, `formats` | settings, policies of maps, values of flags, formats of files |
//! | `connect`, `signals` | the connection; interrupts |
//! | `output`, `overwrite`, `progress`, `logging`, `spans`, `advice` | what a user reads |
//! | `html` | what `--report` of several commands shares |
//! | `completions`, `facts` | completions of shells; facts of the build |

mod advice;
mod bench_frontend;
mod choices;
mod completions;
pub mod config;
mod connect;
mod convert;
mod data_dir;
mod demo;
mod eval;
mod facts;
mod formats;
mod fuse;
mod health;
mod html;
mod job;
pub mod load;
mod logging;
mod map;
mod output;
mod overwrite;
pub(crate) mod policy;
mod progress;
mod record;
mod replay;
mod run;
mod serve;
mod signals;
mod solve;
mod spans;
mod synth;
mod volume;
mod worker;

use std::ffi::OsStr;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use config::{CONNECTION, Config, Environment, LOG, Texts, flags};

/// Under the help of the program.
const EXIT_CODES: &str = "Exit codes: 0 success; 1 failure, with one line on standard error that says what \
    happened, to what, and what to do next, or a result that is bad (damage found, items refused, a job \
    that failed); 2 wrong usage; 130 and 143 a run that ctrl-c or SIGTERM ended, after it wrote what it had.";

/// An optimization-centric SLAM backend: keyframes in over gRPC, optimized maps out.
#[derive(Debug, Parser)]
#[command(name = "covis", version, long_version = facts::LONG_VERSION, about, max_term_width = 100, after_help = EXIT_CODES)]
struct Cli {
    /// Configuration file instead of ./covis.toml [env: COVIS_CONFIG].
    #[arg(long, global = true, value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve maps over gRPC until SIGTERM or ctrl-c.
    Serve,
    /// Solve problem files of servers' jobs until SIGTERM or ctrl-c, in builds with the feature `cluster`.
    Worker,
    /// Check whether a server is ready; the exit code is 0 if it is.
    Health(health::Args),
    /// Stream a BAL file or a COLMAP folder to a server, as a frontend would, then optimize the
    /// map.
    Replay(replay::Args),
    /// Solve a file: bundle adjustment or pose graph. `covis solve FILE` sees which it is.
    Solve(solve::Args),
    /// List, show, create, change, copy, restore, export, import or delete the maps of a server.
    Map(map::Args),
    /// Submit, list, show, watch, cancel or delete the jobs of a server.
    Job(job::Args),
    /// Record a map as MCAP, for Foxglove and Rerun.
    Record(record::Args),
    /// Check a data directory without a server: verify, report, repair.
    Doctor(data_dir::DoctorArgs),
    /// Copy a data directory, even while a server uses it.
    Backup(data_dir::BackupArgs),
    /// Put a server under load: several maps, each with a client that sends keyframes at a fixed rate.
    Load(load::Args),
    /// Write a file in another format: trajectories, bundle adjustment, pose graphs.
    Convert(convert::Args),
    /// Compare trajectories: absolute (APE) or relative pose error (RPE).
    Eval(eval::Args),
    /// Track an RGB-D sequence with the reference frontend, through a server.
    Run(run::Args),
    /// Fuse recorded depth and color images into a surface, at given poses.
    Fuse(fuse::Args),
    /// Write the surface of a stored volume as PLY or GLB.
    Mesh(volume::MeshArgs),
    /// Write a navigation grid from a stored volume: occupancy (PGM, YAML) or distances (PFM).
    Grid(volume::GridArgs),
    /// Measure the reference frontend on sequences with ground truth, with and without the mask.
    BenchFrontend(bench_frontend::Args),
    /// Track a camera in a synthetic room in which people walk, with and without the mask, on its
    /// own server.
    Demo(demo::Args),
    /// Write synthetic data with ground truth.
    Synth(synth::Args),
    /// Write the completions of a shell, for its startup file or its folder of completions.
    Completions(completions::Args),
}

/// The arguments, settings included: each command has the flags of those that it uses. Man pages and
/// completions are made of it.
#[must_use]
pub fn command() -> clap::Command {
    let mut command = Cli::command().args(flags(|setting| setting.get_help_heading() == Some(LOG)));
    for name in ["health", "job", "load", "map", "record", "replay", "run"] {
        let settings = flags(|setting| {
            // Health answers for this moment.
            let is_taken = name != "health" || setting.get_id() != "server_wait";
            is_taken && setting.get_help_heading() == Some(CONNECTION)
        });
        command = command.mut_subcommand(name, |client| client.args(settings));
    }
    let of_server = flags(|setting| setting.get_help_heading().is_none());
    const OF_WORKERS: [&str; 6] = [
        "accept_unsynced_replicas",
        "lease_seconds",
        "nats",
        "nats_monitoring",
        "nats_replicas",
        "threads",
    ];
    let of_workers = flags(|setting| OF_WORKERS.contains(&setting.get_id().as_str()));
    let of_solvers = flags(|setting| setting.get_id() == "threads");
    // `run` starts a server of its own unless a flag names one.
    const SERVER_OF_RUN: &str = "The server's URL; this command ignores COVIS_SERVER and \
        covis.toml here [default: a server in this process]";
    command
        .mut_subcommand("run", |run| run.mut_arg("server", |server| server.help(SERVER_OF_RUN)))
        .mut_subcommand("serve", |server| server.args(of_server))
        .mut_subcommand("worker", |worker| worker.args(of_workers))
        .mut_subcommand("solve", |solver| solver.args(of_solvers))
}

/// Whether an argument is the name of a command.
fn is_command(argument: &OsStr) -> bool {
    Cli::command().get_subcommands().any(|command| argument == command.get_name())
        || argument == "help"
}

/// Runs the program with the process' arguments and environment.
#[must_use]
pub fn run() -> ExitCode {
    let command = command();
    let arguments = solve::named(std::env::args_os().collect());
    let parsed = command.clone().try_get_matches_from(arguments).and_then(|matches| {
        Ok((Cli::from_arg_matches(&matches)?, config::given(&command, &matches)))
    });
    match parsed {
        Ok((cli, settings)) => output::exit_code(dispatch(cli, settings)),
        Err(error) => {
            // Help and version go to standard output and are a success; wrong usage is 2.
            let _ = error.print();
            ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2))
        }
    }
}

fn dispatch(cli: Cli, settings: Texts) -> anyhow::Result<()> {
    let environment = Environment::new(std::env::vars_os());
    let (config, warnings) = Config::load(settings, cli.config, environment)?;
    // Spans are exported until the command has ended.
    let is_server = matches!(cli.command, Command::Serve | Command::Worker);
    let collector = config.otlp_endpoint.as_deref();
    let collector = collector.filter(|_| matches!(cli.command, Command::Serve));
    let _exporter = logging::start(&config, is_server, collector)?;
    for warning in warnings {
        tracing::warn!("{warning}");
    }
    match cli.command {
        Command::Serve => serve::run(&config),
        Command::Worker => worker::run(&config),
        Command::Health(args) => health::run(&args, &config),
        Command::Replay(args) => replay::run(args, &config),
        Command::Solve(args) => solve::run(args, &config),
        Command::Job(args) => job::run(args, &config),
        Command::Load(args) => load::run(&args, &config),
        Command::Map(args) => map::run(args, &config),
        Command::Record(args) => record::run(&args, &config),
        Command::Doctor(args) => data_dir::doctor(&args),
        Command::Backup(args) => data_dir::backup(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Eval(args) => eval::run(&args),
        Command::Run(args) => run::run(&args, &config),
        Command::Fuse(args) => fuse::run(&args),
        Command::Mesh(args) => volume::mesh(&args),
        Command::Grid(args) => volume::grid(&args),
        Command::BenchFrontend(args) => bench_frontend::run(&args, &config),
        Command::Demo(args) => demo::run(args, &config),
        Command::Synth(args) => synth::run(&args),
        Command::Completions(args) => completions::run(&args),
    }
}

#[cfg(test)]
mod tests {
    use super::command;

    #[test]
    fn the_arguments_contradict_each_other_nowhere() {
        command().debug_assert();
    }

    #[test]
    fn only_a_flag_names_the_server_of_a_run() {
        let command = command();
        let help = |name: &str| {
            let of = command.find_subcommand(name).unwrap();
            let flag = of.get_arguments().find(|flag| flag.get_id() == "server").unwrap();
            flag.get_help().unwrap().to_string()
        };
        assert!(help("map").ends_with("[env: COVIS_SERVER]"), "{}", help("map"));
        assert!(help("run").ends_with("[default: a server in this process]"), "{}", help("run"));
    }
}
