//! The pose graph of a map as lines of a g2o file.
//!
//! The edges are those that a solve counts, with the information that they have there: measurements between
//! keyframes, and constraints except for switched-off closures. The format has no priors and no losses. A
//! `FIX` line holds the lowest keyframe of each piece, as a solve does where no prior says where the piece
//! is.

use std::collections::BTreeSet;

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::Se3;
use covis_solvers::io::g2o::{G2oEdge, G2oSe3};
use covis_solvers::problem::DisjointSets;

use crate::map::GraphProblem;

/// The lines of a g2o file besides its vertices, in the order in which they are written.
#[derive(Debug, Default)]
pub(in crate::service) struct GraphLines {
    fixed: std::vec::IntoIter<i64>,
    edges: std::vec::IntoIter<G2oEdge<7, 21>>,
}

impl GraphLines {
    /// The lines of a pose graph as a solve of the map begins.
    pub(in crate::service) fn of(problem: GraphProblem) -> Self {
        let GraphProblem { graph, keyframes, closures, .. } = problem;
        let switched_off: BTreeSet<usize> =
            closures.iter().filter(|c| c.switched_off.is_some()).map(|c| c.edge).collect();
        let edges = graph.edges.iter().enumerate();
        let counted = edges.filter(|(edge, _)| !switched_off.contains(edge)).map(|(_, edge)| edge);
        let mut pieces = DisjointSets::new(keyframes.len());
        counted.clone().for_each(|edge| _ = pieces.join(edge.i, edge.j));
        let ids: Vec<i64> = keyframes.into_iter().map(|keyframe| keyframe.id).collect();
        let line = |edge: &RelativePose<Se3, 6>| {
            G2oEdge::new(ids[edge.i], ids[edge.j], &edge.i_from_j, &edge.information)
        };
        let edges: Vec<G2oEdge<7, 21>> = counted.map(line).collect();
        let fixed: Vec<i64> = pieces.roots().into_iter().map(|lowest| ids[lowest]).collect();
        Self { fixed: fixed.into_iter(), edges: edges.into_iter() }
    }

    /// Appends lines to `out` until it has more than `most` bytes; returns whether there may be more.
    pub(super) fn put(&mut self, most: usize, out: &mut Vec<u8>) -> bool {
        while out.len() <= most {
            if let Some(id) = self.fixed.next() {
                G2oSe3::put_fixed(id, out);
            } else if let Some(edge) = self.edges.next() {
                G2oSe3::put_edge(&edge, out);
            } else {
                return false;
            }
        }
        true
    }
}
