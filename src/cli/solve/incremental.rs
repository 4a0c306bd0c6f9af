//! `covis solve pose-graph --incremental`: adds a file's vertices one by one, as a robot would send
//! them.
//!
//! Step k appends the k-th vertex in id order with all its edges to lower ids, and ends when the estimate of
//! all vertices so far is at a minimum. Whether it is the global one is not known; the report has the optimum
//! of the batch solver beside it. Of the file's poses only the first is used, which is held fixed. Rows are
//! computed between steps, outside of their time. The steps themselves are those of
//! `covis_solvers::pose_graph::GrowingPoseGraph`; this file brings the vertices and takes the times.

use std::time::Instant;

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::RigidMotion;
use covis_solvers::initialization::chordal;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_graph::{self, GrowingPoseGraph, Options};
use covis_solvers::price::Limits;
use covis_solvers::problem::PoseGraph;
use serde::Serialize;

use super::graph_details::Diagnosis;
use super::graph_file::{Naming, with_names};
use super::report::print_lines;
use crate::cli::html;
use crate::cli::output::print;
use crate::cli::progress::Progress;
use crate::report::{Labels, Line, Page, Span, histogram, lines, number};

/// A row every so many steps.
const ROW_EVERY: usize = 100;

/// What `--incremental` reports: the JSON object, or what the table and the lines under it say.
#[derive(Debug, Serialize)]
pub(super) struct Incremental {
    problem: &'static str,
    group: &'static str,
    vertices: usize,
    edges: usize,
    final_cost: f64,
    solve_seconds: f64,
    iterations: Vec<Row>,
    incremental: Steps,
    /// Of each step, for the page.
    #[serde(skip)]
    milliseconds: Vec<f64>,
    #[serde(flatten)]
    diagnosis: Diagnosis,
}

/// The estimate between two steps.
#[derive(Debug, Serialize)]
struct Row {
    /// Vertices so far.
    iteration: usize,
    cost: f64,
    /// The steps' time so far.
    seconds: f64,
}

/// The times of the steps; the first vertex is a step too.
#[derive(Debug, Serialize)]
struct Steps {
    steps: usize,
    median_ms: f64,
    p99_ms: f64,
    max_ms: f64,
    final_cost: f64,
    /// Poses linearized anew, counted each time.
    relinearized: usize,
    /// Steps in which the batch solver was called.
    batch_steps: usize,
    /// The lowest cost that the batch solver finds from the last estimate and from the chordal start.
    batch_cost: f64,
}

/// Feeds `graph` vertex by vertex and leaves the last estimate in it.
/// Fails for an invalid or disconnected graph, and one that holds another vertex fixed than the one
/// with the lowest id.
pub(super) fn solve<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    group: &'static str,
    mut diagnosis: Diagnosis,
    naming: Naming,
) -> anyhow::Result<Incremental> {
    graph.validate().map_err(|error| with_names(error, naming))?;
    let mut order: Vec<usize> = (0..graph.ids.len()).collect();
    order.sort_unstable_by_key(|&pose| graph.ids[pose]);
    let mut rank = vec![0; order.len()];
    for (k, &pose) in order.iter().enumerate() {
        rank[pose] = k;
    }
    if let Some(&pose) = order.iter().skip(1).find(|&&pose| graph.constant[pose]) {
        anyhow::bail!(
            "--incremental holds vertex {} fixed, and the file holds vertex {} (FIX, or its first pose)",
            naming(graph.ids[order[0]]),
            naming(graph.ids[pose])
        );
    }
    let mut due: Vec<Vec<RelativePose<G, N>>> = vec![Vec::new(); order.len()];
    for edge in &graph.edges {
        let (i, j) = (rank[edge.i], rank[edge.j]);
        due[i.max(j)].push(RelativePose { i, j, ..*edge });
    }
    let mut progress = Progress::new("vertices", order.len() as u64);
    let (mut growing, mut milliseconds, mut rows) = (None, Vec::new(), Vec::new());
    let (mut relinearized, mut batch_steps, mut seconds) = (0, 0, 0.0);
    for (k, &pose) in order.iter().enumerate() {
        let id = graph.ids[pose];
        let start = Instant::now();
        let growing = growing.get_or_insert_with(|| GrowingPoseGraph::new(id, graph.poses[pose]));
        if k > 0 {
            growing.push_pose(id)?;
        }
        for edge in due[k].drain(..) {
            growing.push_edge(edge)?;
        }
        let growth = growing.update()?;
        let elapsed = start.elapsed().as_secs_f64();
        milliseconds.push(1e3 * elapsed);
        seconds += elapsed;
        relinearized += growth.relinearized;
        batch_steps += usize::from(growth.is_batch);
        if (k + 1).is_multiple_of(ROW_EVERY) || k + 1 == order.len() {
            rows.push(Row { iteration: k + 1, cost: growing.cost(), seconds });
        }
        progress.advance(1);
    }
    progress.finish();
    let solved = growing.map(GrowingPoseGraph::into_graph);
    for (solved, &pose) in solved.iter().flat_map(|solved| &solved.poses).zip(&order) {
        graph.poses[pose] = *solved;
    }
    diagnosis.of_solution(graph)?;
    let batch_cost = batch_cost(graph);
    milliseconds.sort_unstable_by(f64::total_cmp);
    let at = |share: f64| {
        let index = (share * milliseconds.len().saturating_sub(1) as f64).round();
        milliseconds.get(index as usize).copied().unwrap_or(0.0)
    };
    let (steps, median_ms, p99_ms, max_ms) = (milliseconds.len(), at(0.5), at(0.99), at(1.0));
    let final_cost = rows.last().map_or(0.0, |row: &Row| row.cost);
    Ok(Incremental {
        problem: "pose-graph",
        group,
        vertices: graph.poses.len(),
        edges: graph.edges.len(),
        final_cost,
        solve_seconds: seconds,
        iterations: rows,
        milliseconds,
        incremental: Steps {
            steps,
            median_ms,
            p99_ms,
            max_ms,
            final_cost,
            relinearized,
            batch_steps,
            batch_cost,
        },
        diagnosis,
    })
}

/// The lower cost of the optima from the poses of `graph` and from the chordal start, outside of the
/// time of the steps.
fn batch_cost<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    graph: &PoseGraph<G, N>,
) -> f64 {
    let optimum = |mut graph: PoseGraph<G, N>| {
        let solved = pose_graph::solve(&mut graph, &Options::default(), &mut ignore_iterations);
        solved.map_or(f64::INFINITY, |summary| summary.final_cost)
    };
    let mut relaxed = graph.clone();
    let from_chordal = match chordal(&mut relaxed, Limits::NONE) {
        Ok(()) => optimum(relaxed),
        Err(_) => f64::INFINITY,
    };
    optimum(graph.clone()).min(from_chordal)
}

impl Incremental {
    /// Writes the table and its lines, or the JSON object.
    /// Fails where standard output cannot be written to.
    pub(super) fn print(&self, json: bool) -> anyhow::Result<()> {
        if json {
            return print(serde_json::to_string(self)?);
        }
        print(format_args!("{:>9}  {:>18}  {:>11}", "vertices", "cost", "time"))?;
        for Row { iteration, cost, seconds } in &self.iterations {
            print(format_args!("{iteration:>9}  {cost:>18.10e}  {seconds:>9.4} s"))?;
        }
        print_lines(&self.lines())
    }

    /// What came out, in a sentence.
    fn verdict(&self) -> String {
        let Steps { steps, median_ms, p99_ms, batch_cost, .. } = self.incremental;
        format!(
            "{steps} steps of {} ms (median) and {} ms (99 %): cost {}, that of a solve at once {}.",
            number(median_ms),
            number(p99_ms),
            number(self.final_cost),
            number(batch_cost)
        )
    }

    /// The page: how the cost grew with the graph, and how long steps took.
    pub(super) fn page(&self, title: &str) -> Page {
        let mut page = html::page(title, &self.verdict(), &self.lines());
        page.section("Steps");
        let labels = Labels {
            title: "Cost over vertices",
            description: "The cost of the graph as far as it had grown.",
            x: "vertices",
            y: "cost",
        };
        let points = self.iterations.iter().map(|row| (row.iteration as f64, row.cost)).collect();
        let line = Line { points, ..Line::default() };
        let times = Labels {
            title: "Time of a step",
            description: "Share of the steps, %, over the time that they took, ms.",
            x: "ms",
            y: "%",
        };
        page.row(
            &[lines(labels, Span::FromZero, &[line]), histogram(times, None, &self.milliseconds)],
            &[],
        );
        page
    }

    /// The last cost beside the optimum of the batch solver.
    fn beside(&self, batch_cost: f64) -> String {
        // Costs below this are rounding, as of a graph without loops.
        let share = match batch_cost > 1e-12 {
            true => format!(", the estimate has {:.4} times that", self.final_cost / batch_cost),
            false => String::new(),
        };
        format!("{batch_cost:.10e} from the estimate or the chordal start{share}")
    }

    /// Lines `name value` under the table.
    fn lines(&self) -> Vec<(&'static str, String)> {
        let Steps { steps, median_ms, p99_ms, max_ms, batch_steps, batch_cost, .. } =
            self.incremental;
        let mut lines = vec![
            ("cost", format!("{:.10e}", self.final_cost)),
            (
                "steps",
                format!(
                    "{steps}: median {median_ms:.3} ms, p99 {p99_ms:.3} ms, longest {max_ms:.3} ms"
                ),
            ),
            ("batch solves", batch_steps.to_string()),
            ("batch optimum", self.beside(batch_cost)),
            ("time", format!("{:.6} s", self.solve_seconds)),
            (
                "problem",
                format!("{}, {} vertices, {} edges", self.group, self.vertices, self.edges),
            ),
        ];
        lines.extend(self.diagnosis.lines());
        lines
    }
}
