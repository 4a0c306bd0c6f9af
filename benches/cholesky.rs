//! The sparse Cholesky factorization of this crate beside faer's, on the Hessians of pose graphs.
//!
//! usage: `cargo bench -p covis-solvers --bench cholesky -- FILE.g2o... [--rounds N]`
//!
//! Each file is linearized once, at its vertices, its lowest index held. Both get the same matrix, on one
//! thread, in turn; milliseconds are medians over the rounds. "order" is ordering and planning, once a
//! structure; "factor" and "solve" are once an iteration. faer's own ordering is minimum degree; its memory
//! for the factor is new in each round, as its interface has it. Why there is one of our own is in
//! docs/decisions/0008-own-sparse-cholesky.md. The last columns are counted, not timed: Mflop of a
//! factorization of ours, and these over its longest chain of steps, which bounds what threads can gain.

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use covis_solvers::interrupt::Interrupt;
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::linear::{BlockMatrix, Cholesky};
use covis_solvers::testing::{lower_triangle, normal_equations};
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Side};

type Failure = Box<dyn std::error::Error>;

/// Milliseconds of ordering and planning, of a factorization, of a solve.
type Times = [f64; 3];

fn main() -> Result<(), Failure> {
    // Cargo passes a flag of its own.
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    let (mut files, mut rounds) = (Vec::new(), 9);
    while let Some(argument) = arguments.next() {
        if argument == "--rounds" {
            rounds = arguments.next().ok_or("--rounds needs a number")?.parse::<usize>()?.max(1);
        } else {
            files.push(argument);
        }
    }
    if files.is_empty() {
        return Err("usage: cargo bench -p covis-solvers --bench cholesky -- FILE.g2o...".into());
    }
    println!(
        "milliseconds: order, factor, solve; covis' factor over faer's; Mflop, work over span"
    );
    for file in files {
        let (matrix, gradient) = match G2oGraph::read(Path::new(&file))? {
            G2oGraph::Se2(graph) => normal_equations(&graph.to_pose_graph()?),
            G2oGraph::Se3(graph) => normal_equations(&graph.to_pose_graph()?),
        };
        let name = Path::new(&file).file_stem().unwrap_or_default().display().to_string();
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        for _ in 0..rounds {
            let (times, x) = by_covis(&matrix, &gradient)?;
            ours.push(times);
            let (times, y) = by_faer(&matrix, &gradient)?;
            theirs.push(times);
            let scale = y.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
            if !x.iter().zip(&y).all(|(x, y)| (x - y).abs() <= 1e-6 * scale) {
                return Err(format!("{name}: the solutions differ").into());
            }
        }
        let (ours, theirs) = (medians(&ours), medians(&theirs));
        let row = |[order, factor, solve]: Times| format!("{order:8.2} {factor:8.2} {solve:7.2}");
        let ratio = ours[1] / theirs[1];
        let ordered = Cholesky::order(matrix.pattern(), &Interrupt::NEVER)?;
        let planned = Cholesky::ordered(Arc::clone(matrix.pattern()), ordered)?;
        let (work, span) = planned.work_and_span();
        let counted = format!("{:8.1} {:5.1}", work * 1e-6, work / span);
        println!("{name:>15}   covis {}   faer {}   {ratio:.2} {counted}", row(ours), row(theirs));
    }
    Ok(())
}

fn by_covis(matrix: &BlockMatrix, rhs: &[f64]) -> Result<(Times, Vec<f64>), Failure> {
    let begin = Instant::now();
    let ordered = Cholesky::order(matrix.pattern(), &Interrupt::NEVER)?;
    let mut cholesky = Cholesky::ordered(Arc::clone(matrix.pattern()), ordered)?;
    let order = milliseconds(begin);
    let begin = Instant::now();
    cholesky.factor(matrix, &[])?;
    let factor = milliseconds(begin);
    let mut x = rhs.to_vec();
    let begin = Instant::now();
    cholesky.solve(&mut x);
    Ok(([order, factor, milliseconds(begin)], x))
}

fn by_faer(matrix: &BlockMatrix, rhs: &[f64]) -> Result<(Times, Vec<f64>), Failure> {
    let n = rhs.len();
    let entries = lower_triangle(matrix).into_iter().map(|(r, c, value)| Triplet::new(r, c, value));
    let entries: Vec<_> = entries.collect();
    let lower = SparseColMat::<usize, f64>::try_new_from_triplets(n, n, &entries)
        .map_err(|error| format!("{error:?}"))?;
    let begin = Instant::now();
    let symbolic = SymbolicLlt::try_new(lower.symbolic(), Side::Lower)
        .map_err(|error| format!("{error:?}"))?;
    let order = milliseconds(begin);
    let begin = Instant::now();
    let llt = Llt::try_new_with_symbolic(symbolic, lower.as_ref(), Side::Lower)
        .map_err(|error| format!("{error:?}"))?;
    let factor = milliseconds(begin);
    let rhs = Mat::from_fn(n, 1, |i, _| rhs[i]);
    let begin = Instant::now();
    let x = llt.solve(rhs);
    let solve = milliseconds(begin);
    Ok(([order, factor, solve], (0..n).map(|i| x[(i, 0)]).collect()))
}

fn milliseconds(begin: Instant) -> f64 {
    begin.elapsed().as_secs_f64() * 1e3
}

fn medians(times: &[Times]) -> Times {
    std::array::from_fn(|stage| {
        let mut of_stage: Vec<f64> = times.iter().map(|times| times[stage]).collect();
        of_stage.sort_unstable_by(f64::total_cmp);
        of_stage[of_stage.len() / 2]
    })
}
