//! What the page about a pose graph shows beside its cost: residuals of the edges, the vertices in space with
//! the closures, and the closures' verdicts. Lengths are the evaluator's.

use covis_solvers::evaluation::{ReferencePose, edge_lengths};
use covis_solvers::problem::PoseGraph;
use covis_solvers::robust::ClosureVerdict;
use nalgebra::Vector3;

use super::graph_file::Naming;
use crate::cli::html::solve::{Residuals, residuals};
use crate::report::{Link, Page, Plan, Table, number, views};

/// A graph as it stands.
pub(super) struct GraphPage {
    positions: Vec<[f64; 3]>,
    lengths: Vec<f64>,
}

impl GraphPage {
    pub(super) fn of<G: ReferencePose<N>, const N: usize>(graph: &PoseGraph<G, N>) -> Self {
        let position = |pose: &G| pose.reference_point(&Vector3::zeros()).into();
        Self { positions: graph.poses.iter().map(position).collect(), lengths: edge_lengths(graph) }
    }

    /// Adds the sections about the solved graph; `given` is the file's own.
    pub(super) fn show<G: ReferencePose<N>, const N: usize>(
        &self,
        given: Option<&Self>,
        graph: &PoseGraph<G, N>,
        verdicts: &[ClosureVerdict],
        naming: Naming,
        page: &mut Page,
    ) {
        let kind = Residuals {
            name: "edges",
            unit: "standard deviations",
            before: given.map(|given| &given.lengths[..]),
            after: &self.lengths,
        };
        residuals(page, &[kind]);

        page.section("Vertices");
        // In the order of the ids, which is a robot's way as a rule.
        let mut order: Vec<usize> = (0..graph.ids.len()).collect();
        order.sort_unstable_by_key(|&vertex| graph.ids[vertex]);
        let ordered = |positions: &[[f64; 3]]| order.iter().map(|&v| positions[v]).collect();
        let positions: Vec<[f64; 3]> = ordered(&self.positions);
        let before: Option<Vec<[f64; 3]>> = given.map(|given| ordered(&given.positions));
        // All edges count but the closures that were found false.
        let mut counts = vec![true; graph.edges.len()];
        verdicts.iter().for_each(|verdict| counts[verdict.edge] = !verdict.is_switched_off);
        let mut worst = vec![0.0_f64; graph.poses.len()];
        let mut links = Vec::new();
        for ((edge, &length), counts) in graph.edges.iter().zip(&self.lengths).zip(counts) {
            for vertex in [edge.i, edge.j].into_iter().filter(|_| counts) {
                worst[vertex] = worst[vertex].max(length);
            }
            let [i, j] = [edge.i, edge.j].map(|vertex| self.positions[vertex]);
            if graph.ids[edge.i].abs_diff(graph.ids[edge.j]) != 1 {
                links.push(Link { from: i, to: j, counts });
            }
        }
        let errors: Vec<f64> = order.iter().map(|&vertex| worst[vertex]).collect();
        let landmarks: Vec<[f64; 3]> =
            graph.landmarks.positions.iter().map(|&position| position.into()).collect();
        let plan = Plan {
            name: "Vertices",
            positions: &positions,
            errors: &errors,
            error_name: "largest residual of an edge that counts, standard deviations",
            is_path: true,
            reference: before.as_deref().map(|before| ("the file's own vertices", before)),
            points: &landmarks,
            links: &links,
        };
        page.row(&views(&plan), &[]);

        if verdicts.is_empty() {
            return;
        }
        page.section("Closures");
        let row = |verdict: &ClosureVerdict| {
            let edge = &graph.edges[verdict.edge];
            let name = match (verdict.is_switched_off, verdict.is_provisional) {
                (false, _) => "counts",
                (true, false) => "found false",
                (true, true) => "found false, contradicted by odometry only",
            };
            vec![
                format!("{} to {}", naming(graph.ids[edge.i]), naming(graph.ids[edge.j])),
                number(verdict.chi2),
                number(verdict.weight),
                name.to_owned(),
            ]
        };
        // Those that were found false first, the worst of them at the top.
        let mut sorted: Vec<&ClosureVerdict> = verdicts.iter().collect();
        sorted.sort_by(|a, b| {
            b.is_switched_off.cmp(&a.is_switched_off).then(b.chi2.total_cmp(&a.chi2))
        });
        let rows = sorted.into_iter().map(row).collect();
        page.table(&Table::new("Verdicts", &["closure", "chi2", "weight", "verdict"], rows));
    }
}
