//! What the report of a pose graph contains besides rows and costs: the start, the closures that
//! were switched off, the certificate, which is never of the cost that is printed beside it, and
//! the diagnosis of the graph itself: gauge, repairs, what stays open.
//!
//! The diagnosis is made at the solution and after the clock has stopped.

use covis_solvers::certificate::Certificate;
use covis_solvers::geometry::LieGroup;
use covis_solvers::io::g2o::{ChangedLines, G2oChanges, RepairedEdges};
use covis_solvers::loss::Loss;
use covis_solvers::pose_graph::{self, Undetermined};
use covis_solvers::problem::{PoseGraph, SolveError};
use covis_solvers::robust::RobustSummary;
use serde::Serialize;
use std::collections::BTreeMap;

use super::graph_file::{Naming, Vertex};
use super::report::Details;

/// Facts of a pose graph's solve.
#[derive(Debug, Serialize)]
pub(super) struct GraphDetails {
    pub(super) problem: &'static str,
    pub(super) group: &'static str,
    pub(super) method: &'static str,
    pub(super) init: &'static str,
    /// Absent with `--robust`, which looks for its start itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) init_seconds: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) robust: Option<RobustDetails>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) certificate: Option<CertificateDetails>,
    pub(super) vertices: usize,
    pub(super) edges: usize,
    #[serde(skip_serializing_if = "is_zero")]
    pub(super) landmarks: usize,
    #[serde(skip_serializing_if = "is_zero")]
    pub(super) landmark_measurements: usize,
    #[serde(skip_serializing_if = "is_zero")]
    pub(super) ranges: usize,
    /// On poses and their positions; those on landmarks are measurements of them.
    #[serde(skip_serializing_if = "is_zero")]
    pub(super) priors: usize,
    #[serde(flatten)]
    pub(super) diagnosis: Diagnosis,
}

/// Whether a count is left out.
fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// What `--certify` proved.
#[derive(Debug, Serialize)]
pub(super) struct CertificateDetails {
    objective: &'static str,
    certified: bool,
    min_eigenvalue: f64,
    /// No state has a chordal cost below `cost` - `gap`.
    gap: f64,
    /// Without a factor 1/2, as SE-Sync has it.
    cost: f64,
    lifts: usize,
    ignores_loss: bool,
    seconds: f64,
}

/// What `--robust` found.
#[derive(Debug, Serialize)]
pub(super) struct RobustDetails {
    kernel: &'static str,
    threshold: f64,
    closures: usize,
    solves: usize,
    switched_off: Vec<SwitchedOff>,
}

/// A closure that was found false.
#[derive(Debug, Serialize)]
struct SwitchedOff {
    /// Position among the file's edges, from 0.
    edge: usize,
    i: Vertex,
    j: Vertex,
    chi2: f64,
    weight: f64,
}

impl Details for GraphDetails {
    fn lines(&self) -> Vec<(&'static str, String)> {
        let mut size = format!("{}, {} vertices, {} edges", self.group, self.vertices, self.edges);
        if self.landmarks > 0 {
            let (landmarks, measured) = (self.landmarks, self.landmark_measurements);
            size += &format!(", {landmarks} landmarks, {measured} measurements of them");
        }
        if self.ranges > 0 {
            size += &format!(", {} ranges", self.ranges);
        }
        if self.priors > 0 {
            size += &format!(", {} priors", self.priors);
        }
        let seconds = self.init_seconds.map(|seconds| format!(", {seconds:.6} s"));
        let start = format!("{}{}", self.init, seconds.unwrap_or_default());
        let mut lines = vec![("start", start), ("problem", size)];
        if let Some(robust) = &self.robust {
            let off = robust.switched_off.len();
            let text = format!(
                "{} of {} switched off (χ² above {:.1}), {} solves; --json lists them",
                off, robust.closures, robust.threshold, robust.solves
            );
            lines.push(("closures", text));
        }
        if let Some(certificate) = &self.certificate {
            lines.push(("certificate", certificate.line()));
        }
        lines.extend(self.diagnosis.lines());
        lines
    }
}

impl RobustDetails {
    pub(super) fn new<G: LieGroup<N>, const N: usize>(
        graph: &PoseGraph<G, N>,
        kernel: &'static str,
        solved: &RobustSummary,
        naming: Naming,
    ) -> Self {
        let off = solved.closures.iter().filter(|verdict| verdict.is_switched_off);
        let switched_off = off.map(|verdict| {
            let edge = &graph.edges[verdict.edge];
            let (i, j) = (naming(graph.ids[edge.i]), naming(graph.ids[edge.j]));
            // At the poses that are reported, which `--certify` may have moved since the verdict.
            let chi2 = edge.chi2(&graph.poses[edge.i], &graph.poses[edge.j]);
            SwitchedOff { edge: verdict.edge, i, j, chi2, weight: verdict.weight }
        });
        Self {
            kernel,
            threshold: solved.threshold,
            closures: solved.closures.len(),
            solves: solved.solves,
            switched_off: switched_off.collect(),
        }
    }
}

impl CertificateDetails {
    pub(super) fn new(certificate: &Certificate, loss: Loss, seconds: f64) -> Self {
        Self {
            objective: "chordal",
            certified: certificate.certified,
            min_eigenvalue: certificate.min_eigenvalue,
            gap: certificate.gap,
            cost: certificate.cost,
            lifts: certificate.lifts,
            ignores_loss: loss != Loss::Trivial,
            seconds,
        }
    }

    fn line(&self) -> String {
        let verdict = match self.certified {
            true => format!("the chordal optimum {:.6e} is certified", self.cost),
            false => format!("the chordal cost {:.6e} is NOT proved to be the lowest", self.cost),
        };
        let loss = if self.ignores_loss { ", loss ignored" } else { "" };
        format!(
            "{verdict} (gap {:.1e}, smallest eigenvalue {:.1e}{loss}, {:.6} s); the cost above is \
             another objective's",
            self.gap, self.min_eigenvalue, self.seconds
        )
    }
}

/// Poses that a line of text names.
const NAMED: usize = 3;

/// Names of a tangent's entries, by its dimension.
const PLANE: [&str; 3] = ["x", "y", "rotation"];
const SPACE: [&str; 6] = ["x", "y", "z", "rotation x", "rotation y", "rotation z"];

/// Part of the report's details.
#[derive(Debug, Serialize)]
pub(super) struct Diagnosis {
    /// The vertices that were held fixed.
    gauge: Vec<Vertex>,
    /// Lines whose quaternion was far from norm 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    normalized: Option<Changed>,
    /// Edges from a vertex to itself, which are left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    self_edges: Option<Changed>,
    /// With `--skip-unknown`, by tag.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    skipped: BTreeMap<String, Changed>,
    /// With `--repair-information`.
    #[serde(skip_serializing_if = "Option::is_none")]
    repaired: Option<Repaired>,
    /// Vertices that the edges leave open.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    undetermined: Vec<Open>,
    /// Whether nothing holds the graph in the world: no vertex and no prior.
    #[serde(skip)]
    is_free: bool,
    /// Of the file.
    #[serde(skip)]
    naming: Naming,
}

/// Lines that the reader changed.
#[derive(Debug, Serialize)]
struct Changed {
    count: usize,
    first_line: u64,
}

/// Information matrices that were replaced.
#[derive(Debug, Serialize)]
struct Repaired {
    edges: usize,
    #[serde(flatten)]
    first: Option<FirstRepaired>,
}

/// The first of them.
#[derive(Debug, Serialize)]
struct FirstRepaired {
    first_line: u64,
    i: i64,
    j: i64,
    smallest_eigenvalue: f64,
}

/// A vertex and the tangent directions in which it has no information.
#[derive(Debug, Serialize)]
struct Open {
    id: Vertex,
    directions: Vec<Vec<f64>>,
}

impl Repaired {
    fn new(repaired: Option<RepairedEdges>) -> Self {
        let edges = repaired.map_or(0, |repaired| repaired.count);
        let first =
            repaired.map(|RepairedEdges { first_line, i, j, smallest_eigenvalue, .. }| {
                FirstRepaired { first_line, i, j, smallest_eigenvalue }
            });
        Self { edges, first }
    }
}

impl Diagnosis {
    /// What the reader changed in a file that calls its vertices so.
    pub(super) fn new(changes: &G2oChanges, repair: bool, naming: Naming) -> Self {
        let changed = |ChangedLines { count, first_line }| Changed { count, first_line };
        let skipped = changes.skipped.iter().map(|(tag, lines)| (tag.clone(), changed(*lines)));
        Self {
            normalized: changes.normalized.map(changed),
            self_edges: changes.self_edges.map(changed),
            skipped: skipped.collect(),
            repaired: repair.then(|| Repaired::new(changes.repaired)),
            gauge: Vec::new(),
            is_free: false,
            undetermined: Vec::new(),
            naming,
        }
    }

    /// Adds what can be seen in the solved graph.
    pub(super) fn of_solution<G: LieGroup<N>, const N: usize>(
        &mut self,
        graph: &PoseGraph<G, N>,
    ) -> Result<(), SolveError> {
        let poses = graph.ids.iter().zip(&graph.constant);
        let landmarks = graph.landmarks.ids.iter().zip(&graph.landmarks.constant);
        let held = poses.chain(landmarks).filter(|&(_, &constant)| constant);
        self.gauge = held.map(|(&id, _)| (self.naming)(id)).collect();
        let is_anchored = graph.has_priors() || graph.landmarks.are_anchored();
        self.is_free = self.gauge.is_empty() && !is_anchored;
        let open = pose_graph::undetermined(graph)?.into_iter();
        self.undetermined = open
            .map(|Undetermined { id, directions }| Open {
                id: (self.naming)(id),
                directions: directions.iter().map(|d| d.as_slice().to_vec()).collect(),
            })
            .collect();
        Ok(())
    }

    /// Lines `name value` of the summary.
    pub(super) fn lines(&self) -> Vec<(&'static str, String)> {
        let gauge = match self.gauge.as_slice() {
            [] if self.is_free => "free, nothing holds the graph".to_owned(),
            [] => "held by priors".to_owned(),
            [id] => format!("vertex {id} fixed"),
            ids => format!("{} vertices fixed", ids.len()),
        };
        let mut lines = vec![("gauge", gauge)];
        if let Some(Repaired { edges, first }) = &self.repaired {
            let first = first.as_ref().map(|first| {
                format!(
                    ", the first in line {}, edge {} to {}, smallest eigenvalue {:.3e}",
                    first.first_line, first.i, first.j, first.smallest_eigenvalue
                )
            });
            let text = format!("{edges} information matrices{}", first.unwrap_or_default());
            lines.push(("repaired", text));
        }
        if !self.undetermined.is_empty() {
            let named = self.undetermined.iter().take(NAMED).map(Open::describe);
            let named = named.collect::<Vec<_>>().join("; ");
            let more = match self.undetermined.len().saturating_sub(NAMED) {
                0 => String::new(),
                more => format!("; and {more} more, which --json lists"),
            };
            lines.push(("undetermined", format!("{named}{more}")));
        }
        lines
    }
}

impl Open {
    /// `vertex 7 (x, rotation z)`: axes by name, other directions by their coordinates.
    fn describe(&self) -> String {
        let directions = self.directions.iter().map(|direction| {
            let names: &[&str] = if direction.len() == PLANE.len() { &PLANE } else { &SPACE };
            let mut moving = direction.iter().zip(names).filter(|&(&x, _)| x != 0.0);
            match (moving.next(), moving.next()) {
                (Some((_, name)), None) => (*name).to_owned(),
                _ => format!("{direction:.3?}"),
            }
        });
        format!("vertex {} ({})", self.id, directions.collect::<Vec<_>>().join(", "))
    }
}
