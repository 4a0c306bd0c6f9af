//! Normal equations of a pose graph, assembled by owner.
//!
//! Each edge is linearized once into its blocks w JᵀΩJ and w JᵀΩr (w = ρ' of the loss), in
//! parallel. Then each block row of H and g is summed by one task from the
//! edges at its pose, in edge order: the same bits at any thread count, and no locks. The first rows are
//! the poses that are not constant, in index order. Priors and landmarks are added by `priors` and
//! `landmarks`; nothing is factored here.

use nalgebra::{SMatrix, SMatrixViewMut, SVector};
use rayon::prelude::*;

use crate::factors::{FACTORS_PER_QUESTION, RelativePose};
use crate::geometry::LieGroup;
use crate::interrupt::{Interrupt, Steps};
use crate::linear::{BlockMatrix, BlockPattern, BlockRowMut, PairTerm};
use crate::lists::Lists;
use crate::loss::Loss;
use crate::parallel;

/// What `edge` adds to H and g at the two poses; `loss` is the graph's.
pub(super) fn pair_term<G: LieGroup<N>, const N: usize>(
    edge: &RelativePose<G, N>,
    (world_from_i, world_from_j): (&G, &G),
    loss: Loss,
) -> PairTerm<N> {
    let pair = edge.linearize(world_from_i, world_from_j);
    let omega = edge.information.matrix();
    let loss = edge.loss.unwrap_or(loss).evaluate(edge.information.squared_norm(&pair.residual));
    let omega_d_i = omega * pair.d_i * loss.weight;
    let omega_d_j = omega * pair.d_j * loss.weight;
    PairTerm {
        cost: 0.5 * loss.rho,
        h_ii: pair.d_i.tr_mul(&omega_d_i),
        h_ij: pair.d_i.tr_mul(&omega_d_j),
        h_jj: pair.d_j.tr_mul(&omega_d_j),
        g_i: omega_d_i.tr_mul(&pair.residual),
        g_j: omega_d_j.tr_mul(&pair.residual),
    }
}

/// Edges that a task linearizes at least: few, so that threads end at about the same time.
const MIN_EDGES_PER_TASK: usize = 32;

/// Linearizes every edge into `blocks`, which has one entry an edge afterwards. Once `interrupt` is due
/// the rest are zero.
///
/// A loop of its own: of those in `parallel`, each would write all this memory once more, to fill it.
pub(super) fn linearize_edges<G: LieGroup<N>, const N: usize>(
    edges: &[RelativePose<G, N>],
    poses: &[G],
    loss: Loss,
    interrupt: &Interrupt,
    blocks: &mut Vec<PairTerm<N>>,
) {
    let term = |steps: &mut Steps<'_>, edge: &RelativePose<G, N>| {
        if steps.is_due_after(1) {
            return PairTerm::zeros();
        }
        pair_term(edge, (&poses[edge.i], &poses[edge.j]), loss)
    };
    let steps = || interrupt.in_steps(FACTORS_PER_QUESTION);
    let edges = edges.par_iter().with_min_len(MIN_EDGES_PER_TASK);
    edges.map_init(steps, term).collect_into_vec(blocks);
}

/// An edge as the row of one of its poses sees it.
#[derive(Clone, Copy, Debug, Default)]
struct Incidence {
    edge: u32,
    /// Whether the row's pose is pose i of the edge (else pose j).
    is_i: bool,
    /// Where the row stores its block with the other pose, or [`NOT_STORED`].
    slot: u32,
}

/// The other pose is constant, or its own row stores the block.
const NOT_STORED: u32 = u32::MAX;

/// Block rows that a task sums.
const ROWS_PER_TASK: usize = 32;

/// Which edges each block row of a pose sums, and where; in edge order.
#[derive(Debug)]
pub(super) struct Incidences {
    lists: Lists<Incidence>,
    /// How many rows are those of poses: the first ones.
    pose_rows: usize,
}

impl Incidences {
    /// The first `pose_rows` rows are those of poses; `rows_of_edges` yields the rows of poses i and j of
    /// each edge, `None` for constant ones.
    /// An edge of a pose with itself has a constant residual and is left out.
    pub(super) fn new(
        pattern: &BlockPattern,
        pose_rows: usize,
        rows_of_edges: impl Iterator<Item = (Option<usize>, Option<usize>)> + Clone,
    ) -> Self {
        let edges = rows_of_edges.enumerate().filter(|(_, (i, j))| i != j);
        let ends = edges.flat_map(|(edge, (i, j))| [(edge, i, j, true), (edge, j, i, false)]);
        let mut counts = vec![0; pose_rows + 1];
        ends.clone().filter_map(|(_, own, ..)| own).for_each(|row| counts[row + 1] += 1);
        let incidences = ends.filter_map(|(edge, own, other, is_i)| {
            let row = own?;
            let slot = other
                .filter(|&other| other < row)
                .and_then(|other| pattern.row(row).binary_search(&(other as u32)).ok())
                .map_or(NOT_STORED, |slot| slot as u32);
            Some((row, Incidence { edge: edge as u32, is_i, slot }))
        });
        Self { lists: Lists::counted(counts, incidences), pose_rows }
    }

    /// Sums `blocks`, one an edge, into H and g. Once `interrupt` is due the rest stay as they are.
    pub(super) fn assemble<const N: usize>(
        &self,
        blocks: &[PairTerm<N>],
        interrupt: &Interrupt,
        hessian: &mut BlockMatrix,
        gradient: &mut [f64],
    ) {
        let mut rows = hessian.rows_mut();
        let (rows, of_landmarks) = rows.split_at_mut(self.pose_rows);
        of_landmarks.iter_mut().for_each(|row| row.values_mut().fill(0.0));
        let (gradient, of_landmarks) = gradient.split_at_mut(self.pose_rows * N);
        of_landmarks.fill(0.0);
        let runs = rows.chunks_mut(ROWS_PER_TASK).zip(gradient.chunks_mut(ROWS_PER_TASK * N));
        parallel::for_each(runs, |(rows, gradient)| {
            let mut steps = interrupt.in_steps(FACTORS_PER_QUESTION);
            for (row, gradient) in rows.iter_mut().zip(gradient.chunks_exact_mut(N)) {
                let edges = self.lists.of(row.index()).len();
                if !steps.is_due_after(edges as u32) {
                    self.assemble_row(blocks, row, gradient);
                }
            }
        });
    }

    fn assemble_row<const N: usize>(
        &self,
        blocks: &[PairTerm<N>],
        row: &mut BlockRowMut<'_>,
        gradient: &mut [f64],
    ) {
        row.values_mut().fill(0.0);
        let mut h = SMatrix::<f64, N, N>::zeros();
        let mut g = SVector::<f64, N>::zeros();
        for incidence in self.lists.of(row.index()) {
            let block = &blocks[incidence.edge as usize];
            if incidence.is_i {
                h += block.h_ii;
                g += block.g_i;
            } else {
                h += block.h_jj;
                g += block.g_j;
            }
            if incidence.slot != NOT_STORED {
                let values = row.slot_mut(incidence.slot as usize);
                let mut off_diagonal = SMatrixViewMut::<f64, N, N>::from_slice(values);
                if incidence.is_i {
                    off_diagonal += block.h_ij;
                } else {
                    off_diagonal += block.h_ij.transpose();
                }
            }
        }
        row.diagonal_mut().copy_from_slice(h.as_slice());
        gradient.copy_from_slice(g.as_slice());
    }
}
