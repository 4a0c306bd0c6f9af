//! What the report of a pose graph tells besides rows and costs: the start, the closures that were
//! switched off, and the certificate, which is never of the cost that stands beside it.

use clap::ValueEnum;
use covis_solvers::certificate::Certificate;
use covis_solvers::geometry::LieGroup;
use covis_solvers::loss::Loss;
use covis_solvers::problem::PoseGraph;
use covis_solvers::robust::RobustSummary;
use serde::Serialize;

use super::diagnosis::Diagnosis;
use super::pose_graph::{Init, MethodName, RobustName};
use super::report::Details;

/// Facts of a pose graph's solve.
#[derive(Debug, Serialize)]
pub(super) struct GraphDetails {
    pub(super) problem: &'static str,
    pub(super) group: &'static str,
    pub(super) method: MethodName,
    pub(super) init: Init,
    /// Absent with `--robust`, which looks for its start itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) init_seconds: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) robust: Option<RobustDetails>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) certificate: Option<CertificateDetails>,
    pub(super) vertices: usize,
    pub(super) edges: usize,
    #[serde(flatten)]
    pub(super) diagnosis: Diagnosis,
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
    kernel: RobustName,
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
    i: i64,
    j: i64,
    chi2: f64,
    weight: f64,
}

impl Details for GraphDetails {
    fn lines(&self) -> Vec<(&'static str, String)> {
        let size = format!("{}, {} vertices, {} edges", self.group, self.vertices, self.edges);
        let init = self.init.to_possible_value();
        let name = init.as_ref().map_or("", |value| value.get_name());
        let seconds = self.init_seconds.map(|seconds| format!(", {seconds:.6} s"));
        let start = format!("{name}{}", seconds.unwrap_or_default());
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
        kernel: RobustName,
        solved: &RobustSummary,
    ) -> Self {
        let off = solved.closures.iter().filter(|verdict| verdict.is_switched_off);
        let switched_off = off.map(|verdict| {
            let edge = &graph.edges[verdict.edge];
            let (i, j) = (graph.ids[edge.i], graph.ids[edge.j]);
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
