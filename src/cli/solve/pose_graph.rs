//! `covis solve pose-graph`: a g2o or pyfg file in SE(2) or SE(3).
//!
//! Minimizes ½ Σ ρ(rᵀΩr), r = Log(Z⁻¹ · X_i⁻¹ · X_j), and the cost of priors, measured landmarks and
//! ranges. The lowest id (of pyfg the first pose) is fixed unless the file has `FIX` lines or priors, which
//! hold the graph then. With `--repair-information` Ω is the nearest positive
//! semi-definite matrix, and that is what `--out` writes. The reported time includes the start.
//! With `--robust` the cost is over odometry and the loop closures at their weights, and the rows
//! are of the last solve. With `--certify` that solve starts from the optimum of the chordal
//! objective, to which the certificate applies: the reported cost is still of the Log objective and
//! has no proof. `covis_solvers::graph_optimization` has the stages and their order.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, ensure};
use covis_solvers::evaluation::pose_graph_cost;
use covis_solvers::factors::RelativePose;
use covis_solvers::graph_optimization::{GraphPose, Judging, Optimized, Options, optimize};
use covis_solvers::initialization::Start;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::io::IoError;
use covis_solvers::io::g2o::{G2oGraph, G2oReading, Indefinite};
use covis_solvers::io::pyfg::PyfgGraph;
use covis_solvers::optimizer::{IterationSummary, Method, Termination, Tolerance};
use covis_solvers::problem::PoseGraph;

use super::arguments::{KERNELS, METHODS, Robust, STARTS, Shared};
use super::graph_details::{CertificateDetails, Diagnosis, GraphDetails, RobustDetails};
use super::graph_file::{GraphFile, Naming, Vertex, with_names};
use super::graph_page::GraphPage;
use super::incremental;
use super::report::{Report, Solved};
use super::residuals;
use crate::cli::choices::{choice, name_of};
use crate::cli::output::writable;
use crate::cli::progress::Working;

/// Arguments of `covis solve pose-graph`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// A g2o or pyfg file with SE2 or SE3 records, landmarks, ranges and priors.
    #[arg(value_name = "FILE")]
    input: PathBuf,
    #[command(flatten)]
    shared: Shared,
    /// Levenberg-Marquardt or Gauss-Newton.
    #[arg(long, value_parser = choice(METHODS), default_value = "lm")]
    method: Method,
    /// Initial poses of the solve.
    #[arg(long, value_parser = choice(STARTS), default_value = "auto")]
    init: Start,
    /// Find false loop closures (edges between ids that are not consecutive) and leave them out:
    /// graduated non-convexity to truncated least squares or to Geman-McClure.
    #[arg(long, value_parser = choice(KERNELS), default_value = "none")]
    robust: Robust,
    /// Largest χ² of a true closure [default: the 99 % quantile, 11.3 in SE2 and 16.8 in SE3].
    #[arg(long, value_name = "CHI2")]
    robust_threshold: Option<f64>,
    /// A loop closure that `--robust` must trust, by the ids or names of its two vertices; may be repeated.
    #[arg(long, value_name = "FROM,TO", value_parser = ends, requires = "robust")]
    trusted: Vec<(i64, i64)>,
    /// Start from the optimum of SE-Sync's chordal objective (no loss, isotropic weights) and prove
    /// that it is the global one. The proof does not cover the cost that the solve then reaches.
    #[arg(long)]
    certify: bool,
    /// Replace each information matrix that has negative eigenvalues by the nearest positive
    /// semi-definite matrix; --out writes the replacements. Without this flag such a matrix is an
    /// error.
    #[arg(long)]
    repair_information: bool,
    /// Skip the lines that covis does not read, and say how many of each tag; --out does not have them.
    /// Without this flag such a line is an error.
    #[arg(long)]
    skip_unknown: bool,
    /// Add the vertices one by one in id order, each with its edges to lower ids, and optimize
    /// after each; reports how long a step takes.
    #[arg(long, conflicts_with_all = ["robust", "certify", "init", "method", "loss"])]
    incremental: bool,
}

/// Reads, solves, writes, reports.
pub(super) fn run(args: &Args) -> anyhow::Result<Termination> {
    writable(args.shared.out.as_deref())?;
    args.shared.out.iter().try_for_each(|out| args.shared.overwrite.allow(out))?;
    let working = Working::new(format_args!("reading {}", args.input.display()));
    let indefinite = if args.repair_information { Indefinite::Repair } else { Indefinite::Refuse };
    let reading = G2oReading { indefinite, skip_unknown: args.skip_unknown };
    let (file, changes) = GraphFile::read(&args.input, reading)?;
    let naming = file.naming();
    let diagnosis = Diagnosis::new(&changes, args.repair_information, naming);
    drop(working);
    let (start, from_file) = (Instant::now(), file.has_vertices());
    let run = |group| Run { args, start, from_file, group, naming };
    let name = || args.input.display().to_string();
    match file {
        GraphFile::G2o(G2oGraph::Se2(mut file)) => {
            let graph = file.to_pose_graph().with_context(name)?;
            run("SE2").solve(graph, diagnosis, |graph, out| {
                file.update_from(graph)?;
                file.write(out)
            })
        }
        GraphFile::G2o(G2oGraph::Se3(mut file)) => {
            let graph = file.to_pose_graph().with_context(name)?;
            run("SE3").solve(graph, diagnosis, |graph, out| {
                file.update_from(graph)?;
                file.write(out)
            })
        }
        GraphFile::Pyfg(PyfgGraph::Se2(mut file)) => {
            let graph = file.to_pose_graph().with_context(name)?;
            run("SE2").solve(graph, diagnosis, |graph, out| {
                file.update_from(graph)?;
                file.write(out)
            })
        }
        GraphFile::Pyfg(PyfgGraph::Se3(mut file)) => {
            let graph = file.to_pose_graph().with_context(name)?;
            run("SE3").solve(graph, diagnosis, |graph, out| {
                file.update_from(graph)?;
                file.write(out)
            })
        }
    }
}

/// A solve of either group.
struct Run<'a> {
    args: &'a Args,
    start: Instant,
    from_file: bool,
    group: &'static str,
    naming: Naming,
}

impl Run<'_> {
    /// Solves and reports; `write` puts the solved graph into a file.
    fn solve<G: GraphPose<D, N>, const D: usize, const N: usize>(
        &self,
        mut graph: PoseGraph<G, N>,
        mut diagnosis: Diagnosis,
        write: impl FnOnce(&PoseGraph<G, N>, &Path) -> Result<(), IoError>,
    ) -> anyhow::Result<Termination> {
        let shared = &self.args.shared;
        let title = format!("Pose graph {}", self.name());
        let graph = &mut graph;
        graph.loss = shared.loss;
        graph.hold_gauge();
        if self.args.incremental {
            let is_plain = !graph.has_measured() && !graph.has_priors();
            ensure!(is_plain, "--incremental: {} has landmarks, ranges or priors", self.name());
            let solved = incremental::solve(graph, self.group, diagnosis, self.naming);
            let incremental = solved.with_context(|| self.name())?;
            shared.out.as_deref().map_or(Ok(()), |out| write(graph, out))?;
            shared.report.write(|| incremental.page(&title))?;
            incremental.print(shared.json)?;
            shared.report.tell(shared.json)?;
            return Ok(Termination::Converged(Tolerance::Cost));
        }
        let kernel = self.args.robust;
        let judging = |kernel| {
            let trusted = trusted(graph, &self.args.trusted, self.naming);
            let trusted = trusted.with_context(|| self.name())?;
            let threshold = self.args.robust_threshold;
            anyhow::Ok(Judging { kernel, threshold, trusted, trust_odometry: false })
        };
        let judging = kernel.map(judging).transpose()?;
        // What is to be proved is best started near itself.
        let proves = self.args.certify && kernel.is_none();
        let is_auto = self.args.init == Start::Auto;
        let start = if proves && is_auto { Start::Chordal } else { self.args.init };
        let mut options =
            Options { start, judging, certify: self.args.certify, ..Options::default() };
        options.optimizer.max_iterations = shared.max_iterations;
        options.optimizer.threads = None;
        options.optimizer.method = self.args.method;
        let wants_page = shared.report.path.is_some();
        // A file without vertices has no start to compare with.
        let given = (wants_page && self.from_file).then(|| GraphPage::of(graph));
        let mut report = Report::start(shared.json, self.start.elapsed());
        let rows = &mut |row: &IterationSummary| report.observe(row);
        let optimized = optimize(graph, self.from_file, &options, &Interrupt::NEVER, rows)
            .map_err(|error| with_names(error, self.naming))
            .with_context(|| self.name())?;
        let Optimized { solve: summary, start, start_seconds, judged, proof, .. } = optimized;
        // Of all edges, those that are judged false included: their share shows.
        let residuals = residuals::rows(None, &pose_graph_cost(graph));
        let verdicts = judged.as_ref().map_or(&[][..], |judged| &judged.closures).to_vec();
        diagnosis.of_solution(graph).with_context(|| self.name())?;
        let details = GraphDetails {
            problem: "pose-graph",
            group: self.group,
            method: name_of(METHODS, &self.args.method),
            init: name_of(STARTS, &start),
            init_seconds: start_seconds,
            robust: judged.map(|judged| {
                RobustDetails::new(graph, name_of(KERNELS, &kernel), &judged, self.naming)
            }),
            certificate: proof.map(|proof| {
                CertificateDetails::new(&proof.certificate, graph.loss, proof.seconds)
            }),
            vertices: graph.poses.len(),
            edges: graph.edges.len(),
            landmarks: graph.landmarks.len(),
            landmark_measurements: graph.landmarks.measurements.len(),
            ranges: graph.ranges.len(),
            priors: graph.pose_priors.len() + graph.position_priors.len(),
            diagnosis,
        };
        let outcome = Solved { summary, residuals, details };
        report.check_reader()?;
        shared.out.as_deref().map_or(Ok(()), |out| write(graph, out))?;
        shared.report.write(|| {
            let mut page = report.page(&title, &outcome);
            GraphPage::of(graph).show(given.as_ref(), graph, &verdicts, self.naming, &mut page);
            page
        })?;
        report.finish(&outcome)?;
        shared.report.tell(shared.json)?;
        Ok(outcome.summary.termination)
    }

    fn name(&self) -> String {
        self.args.input.display().to_string()
    }
}

/// Reads `FROM,TO`, each an id or a name.
fn ends(text: &str) -> Result<(i64, i64), String> {
    let ends = text
        .split_once(',')
        .and_then(|(from, to)| Some((Vertex::id_of(from.trim())?, Vertex::id_of(to.trim())?)));
    ends.ok_or_else(|| format!("`{text}` is not two ids or names with a comma between them"))
}

/// The edges between the given ids, in either direction.
fn trusted<G, const N: usize>(
    graph: &PoseGraph<G, N>,
    pairs: &[(i64, i64)],
    naming: Naming,
) -> anyhow::Result<Vec<usize>> {
    let mut trusted = BTreeSet::new();
    for &(from, to) in pairs {
        let ties = |(_, edge): &(usize, &RelativePose<G, N>)| {
            let ids = (graph.ids[edge.i], graph.ids[edge.j]);
            ids == (from, to) || ids == (to, from)
        };
        let found: Vec<usize> =
            graph.edges.iter().enumerate().filter(ties).map(|(index, _)| index).collect();
        let (from, to) = (naming(from), naming(to));
        ensure!(!found.is_empty(), "--trusted {from},{to}: no edge connects these two");
        trusted.extend(found);
    }
    Ok(trusted.into_iter().collect())
}
