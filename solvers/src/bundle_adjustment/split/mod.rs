//! Bundle adjustment in sections that workers solve together: the result is the single solve's.
//!
//! The covisibility graph is cut into sections that meet in separators only (`partition`). A worker
//! eliminates a section's landmarks and all of its poses and cameras that no other section has; what
//! that leaves on the section's border is added to the separators' system, which the coordinator
//! factors; the separators' step goes back and each section follows. This is the elimination of the
//! single solve in another order: costs, gradients, damping and every decision of the loop are those of
//! the whole, up to rounding (Ni, Steedly and Dellaert, "Out-of-core bundle adjustment for large-scale
//! 3D reconstruction", 2007, has the same cut, and alternates instead).
//!
//! Workers are told plain values and answer with plain values (`message`). They may be threads of
//! this process or whatever answers over a stream (`frames`); the bits are the same, on any number of
//! workers, also where one is lost and started anew.

mod codec;
mod coordinator;
mod crew;
mod file;
mod frames;
mod kept;
mod message;
mod partition;
mod section;
mod separator;
mod summary;
#[cfg(test)]
mod tests;
mod worker;
mod workers;

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use crate::interrupt::Interrupt;
use crate::optimizer::{Control, IterationSummary, Observer, minimize, with_threads};
use crate::problem::{BundleProblem, SolveError};
use crate::simd::Class;

use super::{BundleSummary, LinearSolver, Options};
use coordinator::Coordinator;
use crew::Opening;
use partition::Partition;

pub use codec::CodecError;
pub use frames::{FrameError, serve};
pub use message::{
    Answer, BorderPart, Contribution, Linearize, Motion, Reply, Request, START, Source, StepPart,
    Version,
};
pub use partition::Members as Membership;
pub use section::{Section, Values};
pub use summary::{Round, SectionReport, SplitSummary, Task, WorkerReport};
pub use worker::{Worker, peak_bytes};
pub use workers::{Exchanged, Link, LocalWorkers, RemoteWorkers, Start, Workers};

/// Options of [`solve`].
#[derive(Clone, Debug, PartialEq)]
pub struct SplitOptions {
    /// Those of the single solve. The ceiling is that of one section and of the separators' system.
    pub bundle: Options,
    /// How many sections to cut the problem into; a graph that cannot be cut so often has fewer.
    pub sections: usize,
    /// A new file for the sections, which workers that can read files take them from. `None` sends them.
    pub file: Option<PathBuf>,
    /// Bytes of sections that a worker keeps ready, by their estimates; others are read and planned anew
    /// for each request, one at a time.
    pub keep_bytes: u64,
}

impl Default for SplitOptions {
    /// One section, sent, kept.
    fn default() -> Self {
        Self { bundle: Options::default(), sections: 1, file: None, keep_bytes: u64::MAX }
    }
}

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub enum SplitError {
    /// The problem cannot be solved as posed.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The file for the sections cannot be written.
    #[error("the sections cannot be written: {0}")]
    Write(#[from] io::Error),
    /// A worker cannot serve a request.
    #[error("worker {worker}: {reason}")]
    Refused {
        /// Its number.
        worker: usize,
        /// Its words.
        reason: String,
    },
    /// A worker is lost again and again at the same request.
    #[error("worker {worker} is lost again and again: {reason}")]
    Lost {
        /// Its number.
        worker: usize,
        /// The last time's reason.
        reason: String,
    },
    /// A worker cannot be started.
    #[error("worker {worker} cannot be started: {reason}")]
    Start {
        /// Its number.
        worker: usize,
        /// Why.
        reason: String,
    },
    /// A worker answers what was not asked.
    #[error("a worker's {what} does not fit the section")]
    Answer {
        /// What of the answer.
        what: &'static str,
    },
}

/// The sections that [`solve`] would make, each with what it has of the whole.
///
/// # Errors
/// As the problem's own check; [`SolveError::Interrupted`].
pub fn cut(
    problem: &BundleProblem,
    sections: usize,
    interrupt: &Interrupt,
) -> Result<Vec<(Section, Membership)>, SolveError> {
    problem.validate()?;
    let partition = Partition::new(problem, sections, interrupt).ok_or(SolveError::Interrupted)?;
    let numbers = 0..partition.sections.len();
    Ok(numbers.map(|s| (partition.section(problem, s), partition.sections[s].clone())).collect())
}

/// Minimizes the cost of `problem` in place as [`super::solve_until`] does, by workers.
///
/// Interrupted before the loop began, the answer is [`SolveError::Interrupted`].
///
/// # Errors
/// [`SplitError`]; conjugate gradients and dense factorizations as a wish are refused.
pub fn solve(
    problem: &mut BundleProblem,
    options: &SplitOptions,
    workers: &mut dyn Workers,
    interrupt: &Interrupt,
    observer: &mut Observer<'_>,
) -> Result<SplitSummary, SplitError> {
    let start = Instant::now();
    options.bundle.optimizer.validate()?;
    check(options)?;
    problem.validate()?;
    let interrupt = interrupt.or_after(start, options.bundle.optimizer.deadline);
    with_threads(options.bundle.optimizer.threads, || {
        run(problem, options, workers, (start, &interrupt), observer)
    })?
}

fn check(options: &SplitOptions) -> Result<(), SolveError> {
    if options.sections == 0 {
        let reason = "must be at least 1";
        return Err(SolveError::InvalidOption { field: "sections", reason });
    }
    match options.bundle.linear_solver {
        LinearSolver::Auto | LinearSolver::SparseSchur => Ok(()),
        LinearSolver::DenseSchur | LinearSolver::IterativeSchur => {
            let reason = "a split solve factors sections sparse";
            Err(SolveError::InvalidOption { field: "linear_solver", reason })
        }
    }
}

fn run(
    problem: &mut BundleProblem,
    options: &SplitOptions,
    workers: &mut dyn Workers,
    (start, interrupt): (Instant, &Interrupt),
    observer: &mut Observer<'_>,
) -> Result<SplitSummary, SplitError> {
    let clock = Instant::now();
    let partition = Partition::new(problem, options.sections, interrupt);
    let partition = partition.ok_or(SolveError::Interrupted)?;
    if partition.blocks.sizes.is_empty() && problem.constant_landmarks.iter().all(|&c| c) {
        return Err(SolveError::Empty("every variable is constant").into());
    }
    let partition_seconds = clock.elapsed().as_secs_f64();
    let clock = Instant::now();
    let sources = match &options.file {
        Some(path) if workers.read_files() => {
            let sections = (0..partition.sections.len()).map(|s| partition.section(problem, s));
            file::write_sections(path, sections)?
        }
        _ => Vec::new(),
    };
    let write_seconds = clock.elapsed().as_secs_f64();
    let clock = Instant::now();
    let class = options.bundle.class.unwrap_or_else(Class::detect);
    let optimizer = &options.bundle.optimizer;
    let opening = Opening { class, ceiling: optimizer.ceiling, keep_bytes: options.keep_bytes };
    let mut whole = Coordinator::new(problem, &partition, sources, workers, opening, interrupt);
    let failed = |whole: &mut Coordinator<'_>| {
        whole.crew.failure.take().unwrap_or_else(|| SolveError::Interrupted.into())
    };
    if whole.load().is_none() {
        return Err(failed(&mut whole));
    }
    // Rows that follow a failure are of no use to anybody.
    let has_failed = Arc::clone(&whole.crew.has_failed);
    let mut observe = |row: &IterationSummary| match has_failed.load(Ordering::Relaxed) {
        true => Control::Cancel,
        false => observer(row),
    };
    let solve = minimize(&mut whole, optimizer, (start, interrupt), None, &mut observe);
    let interrupted_at_start = interrupt.is_due() && !solve.initial_cost.is_finite();
    if whole.crew.failure.is_some() || interrupted_at_start {
        return Err(failed(&mut whole));
    }
    let seconds = clock.elapsed().as_secs_f64();
    let rounds = std::mem::take(&mut whole.crew.rounds);
    let reports = std::mem::take(&mut whole.crew.reports);
    let (separator_dimension, bytes) = (whole.separator_dimension(), whole.crew.section_bytes());
    let values = whole.into_values();
    problem.poses = values.poses;
    problem.cameras = values.cameras;
    problem.landmarks = values.landmarks;
    let sections = partition.sections.iter().zip(bytes).map(|(members, bytes)| SectionReport {
        poses: members.poses.len(),
        landmarks: members.landmarks.len(),
        observations: members.observations.len(),
        bytes,
    });
    let separates = |&&block: &&u32| {
        partition.is_separator.get(block as usize).is_some_and(|&is_separator| is_separator)
    };
    Ok(SplitSummary {
        bundle: BundleSummary {
            solve,
            linear_solver: LinearSolver::SparseSchur,
            behind_camera: problem.behind_camera_count(),
            class,
        },
        sections: sections.collect(),
        separator_poses: partition.blocks.of_pose.iter().filter(separates).count(),
        separator_dimension,
        workers: reports,
        partition_seconds,
        write_seconds,
        coordinator_seconds: seconds - rounds.iter().map(|round| round.seconds).sum::<f64>(),
        rounds,
    })
}
