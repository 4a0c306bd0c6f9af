//! Bundle adjustment in sections against the single solve, and against consensus, on BAL files.
//!
//! usage: `cargo bench -p covis-solvers --bench split -- FILE... [--consensus] [--max-iterations N]`
//!
//! Each file is solved whole and in 1, 2 and 4 sections, by one worker process at a time, which is this
//! program again. From the measured time of every task follows what so many workers of one core each
//! would take: in each round the last one counts, and the coordinator's own time is added. Whole and
//! sections run on one thread. `--consensus` also solves by consensus over the cameras that sections
//! share (alternating directions; Zhang, Zhu, Fang and Quan, "Distributed very large scale bundle
//! adjustment by global camera consensus", 2017), with known intrinsics on both sides.

#![allow(clippy::unwrap_used, reason = "a file that cannot be solved has no time")]
#![allow(clippy::print_stdout, reason = "what it measures is its output")]

use std::io::{stdin, stdout};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use covis_solvers::bundle_adjustment::split::{
    self, Link, Membership, RemoteWorkers, Section, SplitOptions, cut, peak_bytes,
};
use covis_solvers::bundle_adjustment::{self, Options};
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::factors::PosePrior;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::io::bal::BalFile;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{self, ignore_iterations};
use covis_solvers::problem::BundleProblem;
use nalgebra::SVector;

/// In its environment a program knows that it is a worker.
const WORKER: &str = "COVIS_SPLIT_BENCH_WORKER";

/// Rounds of consensus, and steps of each section in one.
const ROUNDS: usize = 60;
const STEPS: usize = 3;

fn main() {
    if std::env::var_os(WORKER).is_some() {
        let serve = || split::serve(&mut stdin().lock(), &mut stdout().lock());
        return optimizer::with_threads(Some(1), serve).unwrap().unwrap();
    }
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let has = |name: &str| arguments.iter().any(|argument| argument == name);
    let index = arguments.iter().position(|argument| argument == "--max-iterations");
    let max_iterations =
        index.and_then(|k| arguments.get(k + 1)).map_or(100, |n| n.parse().unwrap());
    let is_file = |argument: &&String| Path::new(argument.as_str()).is_file();
    for file in arguments.iter().filter(is_file) {
        let mut problem = BalFile::read(Path::new(file)).unwrap().to_problem();
        println!("{file}");
        let optimizer =
            optimizer::Options { max_iterations, threads: Some(1), ..Default::default() };
        let options = Options { optimizer, ..Options::default() };
        whole(&problem, &options);
        for sections in [1, 2, 4] {
            in_sections(&problem, &options, sections);
        }
        if has("--consensus") {
            problem.constant_cameras.fill(true);
            let best = whole(&problem, &options);
            in_sections(&problem, &options, 4);
            consensus(&problem, &options, best);
        }
    }
}

fn whole(problem: &BundleProblem, options: &Options) -> f64 {
    let mut problem = problem.clone();
    let start = Instant::now();
    let summary = bundle_adjustment::solve(&mut problem, options, &mut ignore_iterations).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    let (solve, solver) = (&summary.solve, summary.linear_solver);
    println!(
        "  whole, {solver:?}: {seconds:.2} s, {} iterations, cost {:.8e} ({})",
        solve.iterations.len() - 1,
        solve.final_cost,
        solve.termination,
    );
    solve.final_cost
}

fn in_sections(problem: &BundleProblem, options: &Options, sections: usize) {
    let mut problem = problem.clone();
    let mut workers = RemoteWorkers::start(1, Box::new(|_| Ok(process()))).unwrap();
    let options = SplitOptions { bundle: *options, sections, ..SplitOptions::default() };
    let start = Instant::now();
    let never = Interrupt::NEVER;
    let summary =
        split::solve(&mut problem, &options, &mut workers, &never, &mut ignore_iterations).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    let solve = &summary.bundle.solve;
    let mib = |bytes: u64| bytes >> 20;
    println!(
        "  {} sections: {seconds:.2} s, {} iterations, cost {:.8e} ({}), separators {} poses ({} unknowns), worker {} MiB, coordinator {} MiB",
        summary.sections.len(),
        solve.iterations.len() - 1,
        solve.final_cost,
        solve.termination,
        summary.separator_poses,
        summary.separator_dimension,
        mib(summary.workers[0].peak_bytes),
        mib(peak_bytes()),
    );
    let one = summary.scheduled_seconds(1);
    for count in [1, 2, 4].into_iter().filter(|&count| count <= summary.sections.len()) {
        let scheduled = summary.scheduled_seconds(count);
        println!(
            "    {count} workers by the measured tasks: {scheduled:.2} s, efficiency {:.2} (coordinator {:.2} s)",
            one / scheduled / count as f64,
            summary.coordinator_seconds,
        );
    }
}

/// This program as a worker.
fn process() -> Link {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .env(WORKER, "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let (requests, answers) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    let end = Box::new(move || {
        let _ended = child.kill();
        let _status = child.wait();
    });
    Link { answers: Box::new(answers), requests: Box::new(requests), end }
}

/// Prints how far consensus comes; `best` is the single solve's cost.
fn consensus(problem: &BundleProblem, options: &Options, best: f64) {
    let mut parts = cut(problem, 4, &Interrupt::NEVER).unwrap();
    let mut mean = problem.poses.clone();
    let mut duals: Vec<Vec<SVector<f64, 6>>> = parts
        .iter()
        .map(|(section, _)| vec![SVector::zeros(); section.problem.poses.len()])
        .collect();
    // The curvature of a pose by its own observations, so that the penalty is of its size.
    let weight = 100.0 * problem.observation_count() as f64 / problem.poses.len() as f64;
    let information =
        Information::from_sigmas(&SVector::<f64, 6>::repeat(1.0 / weight.sqrt())).unwrap();
    let inner = optimizer::Options { max_iterations: STEPS, ..options.optimizer };
    let inner = Options { optimizer: inner, ..*options };
    let (start, mut task_seconds) = (Instant::now(), 0.0);
    for round in 1..=ROUNDS {
        let mut longest = 0.0_f64;
        for ((section, members), duals) in parts.iter_mut().zip(&duals) {
            pull(section, members, &mean, duals, information);
            let clock = Instant::now();
            bundle_adjustment::solve(&mut section.problem, &inner, &mut ignore_iterations).unwrap();
            longest = longest.max(clock.elapsed().as_secs_f64());
        }
        task_seconds += longest;
        agree(&parts, &mut mean, &mut duals);
        if [1, 5, 10, 20, 40, ROUNDS].contains(&round) {
            let mut found = problem.clone();
            found.poses.clone_from(&mean);
            for (section, members) in &parts {
                for (point, &id) in section.problem.landmarks.iter().zip(&members.landmarks) {
                    found.landmarks[id as usize] = *point;
                }
            }
            println!(
                "    consensus, round {round}: cost {:.6} of the single solve's, {:.2} s, {task_seconds:.2} s by four workers",
                bundle_cost(&found).total / best,
                start.elapsed().as_secs_f64(),
            );
        }
    }
}

/// Priors that pull the border of a section to the mean.
fn pull(
    section: &mut Section,
    members: &Membership,
    mean: &[Se3],
    duals: &[SVector<f64, 6>],
    information: Information<6>,
) {
    section.problem.pose_priors.clear();
    for (pose, &id) in members.poses.iter().enumerate().filter(|&(k, _)| section.border_poses[k]) {
        section.problem.pose_priors.push(PosePrior {
            pose,
            world_from_camera: mean[id as usize].plus(&-duals[pose]),
            information,
            loss: Loss::Trivial,
        });
    }
}

/// The mean of the sections' borders, and how far each is from it.
fn agree(parts: &[(Section, Membership)], mean: &mut [Se3], duals: &mut [Vec<SVector<f64, 6>>]) {
    let mut sums = vec![(SVector::<f64, 6>::zeros(), 0.0); mean.len()];
    for ((section, members), duals) in parts.iter().zip(duals.iter()) {
        for (k, &id) in members.poses.iter().enumerate() {
            let id = id as usize;
            if section.border_poses[k] {
                sums[id].0 +=
                    mean[id].inverse().compose(&section.problem.poses[k]).log() + duals[k];
                sums[id].1 += 1.0;
            } else {
                mean[id] = section.problem.poses[k];
            }
        }
    }
    for (pose, (sum, count)) in mean.iter_mut().zip(&sums).filter(|(_, sum)| sum.1 > 0.0) {
        *pose = pose.plus(&(sum / *count));
    }
    for ((section, members), duals) in parts.iter().zip(duals) {
        for (k, &id) in members.poses.iter().enumerate() {
            if section.border_poses[k] {
                duals[k] += mean[id as usize].inverse().compose(&section.problem.poses[k]).log();
            }
        }
    }
}
