//! `covis solve bundle --blocks`: worker processes of this program solve blocks of one problem.
//!
//! A worker is this program again, `covis solve bundle-worker`, that answers on its standard output what
//! its standard input asks. Blocks are written to a scratch file once, which workers read from. A worker
//! that dies is started again and told its blocks anew. Blocks are cut and solved by the solver crate;
//! this file has processes, the scratch file and the report.

use std::io;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context;
use covis_solvers::bundle_adjustment::split::{
    self, Link, RemoteWorkers, SplitOptions, SplitSummary, Task, peak_bytes,
};
use covis_solvers::bundle_adjustment::{self, BundleSummary};
use covis_solvers::interrupt::Interrupt;
use covis_solvers::optimizer::Observer;
use covis_solvers::problem::BundleProblem;
use serde::Serialize;

/// Arguments of a split solve.
#[derive(Debug, clap::Args)]
pub(super) struct SplitArgs {
    /// Cut the problem by covisibility into so many blocks, which worker processes solve together.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), conflicts_with = "linear_solver")]
    blocks: Option<u32>,
    /// Worker processes [default: a thread each, at most one a block].
    #[arg(long, value_name = "W", value_parser = clap::value_parser!(u32).range(1..), requires = "blocks")]
    workers: Option<u32>,
    /// Memory for blocks that a worker keeps ready; others are read from the scratch file whenever they
    /// are needed, one at a time [default: all are kept].
    #[arg(long, value_name = "MIB", requires = "blocks")]
    worker_memory_mib: Option<u64>,
    /// Folder for the scratch file [default: that of the system].
    #[arg(long, value_name = "DIR", requires = "blocks")]
    scratch: Option<PathBuf>,
}

/// What the JSON object has of a split.
#[derive(Debug, Serialize)]
pub(super) struct Split {
    blocks: Vec<Block>,
    /// Poses that several blocks have, and unknowns of the system that ties the blocks together.
    separator_poses: usize,
    separator_dimension: usize,
    workers: Vec<WorkerProcess>,
    coordinator_peak_bytes: u64,
    seconds: Seconds,
}

#[derive(Debug, Serialize)]
struct Block {
    poses: usize,
    landmarks: usize,
    observations: usize,
    estimated_bytes: u64,
}

#[derive(Debug, Serialize)]
struct WorkerProcess {
    blocks: Vec<usize>,
    peak_bytes: u64,
    busy_seconds: f64,
    restarts: usize,
}

/// Wall-clock seconds of the phases; the last is the coordinator's own work between them.
#[derive(Debug, Serialize)]
struct Seconds {
    partition: f64,
    write: f64,
    load: f64,
    cost: f64,
    eliminate: f64,
    step: f64,
    coordinator: f64,
}

impl SplitArgs {
    /// Whether a split was asked for.
    pub(super) fn is_wanted(&self) -> bool {
        self.blocks.is_some()
    }
}

/// Solves as [`bundle_adjustment::solve`] does, by worker processes.
pub(super) fn solve(
    problem: &mut BundleProblem,
    options: bundle_adjustment::Options,
    args: &SplitArgs,
    observer: &mut Observer<'_>,
) -> anyhow::Result<(BundleSummary, Split)> {
    let blocks = args.blocks.unwrap_or(1) as usize;
    let threads = rayon::current_num_threads();
    let count = args.workers.map_or(threads, |workers| workers as usize).clamp(1, blocks);
    let scratch = Scratch::new(args.scratch.clone())?;
    let of_each = (threads / count).max(1);
    let start = Box::new(move |_worker: usize| start_worker(of_each));
    let mut workers = RemoteWorkers::start(count, start).context("a worker cannot be started")?;
    let keep_bytes = args.worker_memory_mib.map_or(u64::MAX, |mib| mib.saturating_mul(1 << 20));
    let options = SplitOptions {
        bundle: options,
        sections: blocks,
        file: Some(scratch.path.join("blocks")),
        keep_bytes,
    };
    let summary = split::solve(problem, &options, &mut workers, &Interrupt::NEVER, observer)?;
    let split = Split::of(&summary);
    Ok((summary.bundle, split))
}

/// A folder of its own, gone with this value.
struct Scratch {
    path: PathBuf,
}

impl Scratch {
    fn new(parent: Option<PathBuf>) -> anyhow::Result<Self> {
        let parent = parent.unwrap_or_else(std::env::temp_dir);
        // The process' number is its own while it lives; a folder that is there was left by another.
        let path = parent.join(format!("covis-blocks-{}", std::process::id()));
        let _absent = fs_err::remove_dir_all(&path);
        fs_err::create_dir(&path)?;
        Ok(Self { path })
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // Whoever cleans temporary folders finds what is left.
        let _left = fs_err::remove_dir_all(&self.path);
    }
}

fn start_worker(threads: usize) -> io::Result<Link> {
    let mut child = Command::new(std::env::current_exe()?)
        .args(["solve", "--threads", &threads.to_string(), "bundle-worker"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()?;
    tracing::debug!(process = child.id(), threads, "a worker was started");
    let streams = child.stdin.take().zip(child.stdout.take());
    let (requests, answers) = streams.ok_or_else(|| io::Error::other("a worker has no pipes"))?;
    let child = Arc::new(Mutex::new(child));
    let end = Box::new(move || {
        let mut child: std::sync::MutexGuard<'_, Child> =
            child.lock().unwrap_or_else(PoisonError::into_inner);
        // One that has ended already is only waited for.
        let _ended = child.kill();
        let _status = child.wait();
    });
    Ok(Link { answers: Box::new(answers), requests: Box::new(requests), end })
}

/// What a worker's process does: answers until its standard input ends.
pub(super) fn serve() -> anyhow::Result<()> {
    let (mut input, mut output) = (io::stdin().lock(), io::stdout().lock());
    Ok(split::serve(&mut input, &mut output)?)
}

impl Split {
    fn of(summary: &SplitSummary) -> Self {
        let blocks = summary.sections.iter().map(|section| Block {
            poses: section.poses,
            landmarks: section.landmarks,
            observations: section.observations,
            estimated_bytes: section.bytes,
        });
        let workers = summary.workers.iter().map(|worker| WorkerProcess {
            blocks: worker.sections.clone(),
            peak_bytes: worker.peak_bytes,
            busy_seconds: worker.busy_seconds,
            restarts: worker.restarts,
        });
        Self {
            blocks: blocks.collect(),
            separator_poses: summary.separator_poses,
            separator_dimension: summary.separator_dimension,
            workers: workers.collect(),
            coordinator_peak_bytes: peak_bytes(),
            seconds: Seconds {
                partition: summary.partition_seconds,
                write: summary.write_seconds,
                load: summary.seconds_of(Task::Load),
                cost: summary.seconds_of(Task::Cost),
                eliminate: summary.seconds_of(Task::Contribute),
                step: summary.seconds_of(Task::Move),
                coordinator: summary.coordinator_seconds,
            },
        }
    }

    /// Lines under the table.
    pub(super) fn lines(&self) -> Vec<(&'static str, String)> {
        let mib = |bytes: u64| format!("{} MiB", bytes.div_ceil(1 << 20));
        let sizes = self.blocks.iter().map(|block| block.observations);
        let (least, most) = (sizes.clone().min().unwrap_or(0), sizes.max().unwrap_or(0));
        let blocks = format!(
            "{} of {least} to {most} observations, {} poses between them ({} unknowns)",
            self.blocks.len(),
            self.separator_poses,
            self.separator_dimension
        );
        let peaks: Vec<String> = self.workers.iter().map(|w| mib(w.peak_bytes)).collect();
        let restarts: usize = self.workers.iter().map(|worker| worker.restarts).sum();
        let workers = format!(
            "{}, peak memory {}, coordinator {}; {restarts} restarted",
            self.workers.len(),
            peaks.join(", "),
            mib(self.coordinator_peak_bytes)
        );
        let Seconds { partition, write, load, cost, eliminate, step, coordinator } = self.seconds;
        let phases = format!(
            "cut {partition:.2} s, write {write:.2}, load {load:.2}, costs {cost:.2}, eliminate {eliminate:.2}, steps {step:.2}, between them {coordinator:.2}"
        );
        vec![("blocks", blocks), ("workers", workers), ("phases", phases)]
    }
}
