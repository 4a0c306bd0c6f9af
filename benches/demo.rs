//! What the demo finds, over several seeds: position errors with the mask of what moves and without.
//!
//! `cargo bench --bench demo -- [--seeds 1,2,3,4,5] [--frames N]`
//!
//! It runs `covis demo`, the program itself, once a seed, and takes the errors that it prints. Median and
//! range of all seeds end the table. In lock-step a seed has the same errors each time.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

use std::process::Command;

use anyhow::{Context, ensure};
use clap::Parser;

/// Errors of the demo over seeds.
#[derive(Parser)]
struct Args {
    /// Seeds of the scene and of all noise.
    #[arg(long, value_delimiter = ',', default_value = "1,2,3,4,5")]
    seeds: Vec<u64>,
    /// Frames, 30 a second; a round takes 180.
    #[arg(long, default_value_t = 360)]
    frames: u16,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// The lines of the demo's table, and what they are called here.
const LINES: [(&str, &str); 3] = [
    ("Position error (APE, rmse) of tracking", "tracking, mm"),
    ("loops that the server found", "loops"),
    ("error after them, on the server's map", "after the loops, mm"),
];

/// The two numbers of a line: with the mask, without it.
fn cells(stdout: &str, label: &str) -> anyhow::Result<[f64; 2]> {
    let line = stdout.lines().find(|line| line.trim_start().starts_with(label));
    let line = line.with_context(|| format!("no line {label:?} in {stdout}"))?;
    let numbers: Vec<f64> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    <[f64; 2]>::try_from(numbers.as_slice()).with_context(|| format!("not two numbers: {line}"))
}

/// Median, smallest and largest of the values.
fn spread(mut values: Vec<f64>) -> String {
    values.sort_by(f64::total_cmp);
    let at = |index: usize| values.get(index).copied().unwrap_or(f64::NAN);
    let last = values.len().saturating_sub(1);
    let median = 0.5 * (at(last / 2) + at(last.div_ceil(2)));
    format!("{median:.1} ({:.1} to {:.1})", at(0), at(last))
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let folder = tempfile::tempdir()?;
    let mut all: Vec<[[f64; 2]; 3]> = Vec::new();
    println!("{:>6}{:>28}{:>28}", "", "with mask", "without mask");
    for &seed in &args.seeds {
        let mut command = Command::new(env!("CARGO_BIN_EXE_covis"));
        command.args(["--log", "warn", "demo", "--out"]).arg(folder.path());
        command.args(["--seed", &seed.to_string(), "--frames", &args.frames.to_string()]);
        let output = command.output().context("covis demo")?;
        let stderr = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "covis demo, seed {seed}: {stderr}");
        let stdout = String::from_utf8_lossy(&output.stdout);
        let mut rows = [[0.0; 2]; 3];
        for (row, (label, _)) in rows.iter_mut().zip(LINES) {
            *row = cells(&stdout, label)?;
        }
        let [tracking, loops, after] = rows;
        let cell = |mask: usize| {
            format!("{:.1} -> {:.1}, {} loops", tracking[mask], after[mask], loops[mask])
        };
        println!("{:>6}{:>28}{:>28}", format!("seed {seed}"), cell(0), cell(1));
        all.push(rows);
    }
    println!("\nmedian (smallest to largest) of {} seeds", all.len());
    for (row, (_, name)) in LINES.iter().enumerate() {
        let of = |mask: usize| spread(all.iter().map(|seed| seed[row][mask]).collect());
        println!("{name:<20}{:>28}{:>28}", of(0), of(1));
    }
    Ok(())
}
