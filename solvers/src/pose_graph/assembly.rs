//! Normal equations of a pose graph, assembled by owner.
//!
//! Each edge is linearized once into its blocks w JᵀΩJ and w JᵀΩr (w = ρ' of the loss), in
//! parallel over fixed chunks. Then each block row of H and g is summed by one task from the
//! edges at its pose, in edge order: the same bits at any thread count, and no locks. Rows are the
//! poses that are not constant, in index order. Priors are added by `priors`; nothing is factored here.

use nalgebra::{SMatrix, SMatrixView, SMatrixViewMut, SVector, SVectorView};

use crate::factors::{FACTORS_PER_QUESTION, RelativePose};
use crate::geometry::LieGroup;
use crate::interrupt::Interrupt;
use crate::linear::{BlockMatrix, BlockPattern, BlockRowMut, PairTerm};
use crate::lists::Lists;
use crate::loss::Loss;
use crate::parallel;

/// What `edge` adds to H and g at the two poses; `loss` is the graph's.
pub(super) fn pair_term<G: LieGroup<N>, const N: usize>(
    edge: &RelativePose<G, N>,
    poses: (&G, &G),
    loss: Loss,
) -> PairTerm<N> {
    let mut term = PairTerm::zeros();
    let h = [&mut term.h_ii, &mut term.h_ij, &mut term.h_jj].map(SMatrix::as_mut_slice);
    let g = [&mut term.g_i, &mut term.g_j].map(SVector::as_mut_slice);
    term.cost = linearize_edge(edge, poses, loss, h, g);
    term
}

/// Writes what `edge` adds into its place, since a term of SE(3) is a kilobyte, too large to copy for each:
/// blocks (i, i), (i, j) and (j, j) of H, then those of g. Returns its cost.
fn linearize_edge<G: LieGroup<N>, const N: usize>(
    edge: &RelativePose<G, N>,
    (world_from_i, world_from_j): (&G, &G),
    loss: Loss,
    [h_ii, h_ij, h_jj]: [&mut [f64]; 3],
    [g_i, g_j]: [&mut [f64]; 2],
) -> f64 {
    let pair = edge.linearize(world_from_i, world_from_j);
    let omega = edge.information.matrix();
    let loss = edge.loss.unwrap_or(loss).evaluate(edge.information.squared_norm(&pair.residual));
    let omega_d_i = omega * pair.d_i * loss.weight;
    let omega_d_j = omega * pair.d_j * loss.weight;
    h_ii.copy_from_slice(pair.d_i.tr_mul(&omega_d_i).as_slice());
    h_ij.copy_from_slice(pair.d_i.tr_mul(&omega_d_j).as_slice());
    h_jj.copy_from_slice(pair.d_j.tr_mul(&omega_d_j).as_slice());
    g_i.copy_from_slice(omega_d_i.tr_mul(&pair.residual).as_slice());
    g_j.copy_from_slice(omega_d_j.tr_mul(&pair.residual).as_slice());
    0.5 * loss.rho
}

/// Edges that a task linearizes: few, so that threads end at about the same time in small graphs.
const EDGES_PER_TASK: usize = 32;

/// What each edge adds to H and g, one after the other: N columns of each of its three blocks of H, then one
/// of each of g.
///
/// Plain numbers, because memory of zeros is written first by the task that has the results.
#[derive(Debug, Default)]
pub(super) struct EdgeTerms<const N: usize>(Vec<f64>);

impl<const N: usize> EdgeTerms<N> {
    /// Scalars of a block of H, and of an edge.
    const BLOCK: usize = N * N;
    const TERM: usize = 3 * Self::BLOCK + 2 * N;
    /// Memory that an edge takes.
    pub(super) const BYTES_PER_EDGE: usize = size_of::<f64>() * Self::TERM;

    /// Linearizes every edge. Once `interrupt` is due the rest are zero.
    pub(super) fn linearize<G: LieGroup<N>>(
        &mut self,
        edges: &[RelativePose<G, N>],
        poses: &[G],
        loss: Loss,
        interrupt: &Interrupt,
    ) {
        if self.0.len() != edges.len() * Self::TERM {
            self.0 = vec![0.0; edges.len() * Self::TERM];
        }
        let runs = self.0.chunks_mut(EDGES_PER_TASK * Self::TERM);
        parallel::for_each(edges.chunks(EDGES_PER_TASK).zip(runs), |(edges, terms)| {
            if interrupt.is_due() {
                return terms.fill(0.0);
            }
            for (edge, term) in edges.iter().zip(terms.chunks_exact_mut(Self::TERM)) {
                let (h_ii, rest) = term.split_at_mut(Self::BLOCK);
                let (h_ij, rest) = rest.split_at_mut(Self::BLOCK);
                let (h_jj, rest) = rest.split_at_mut(Self::BLOCK);
                let (g_i, g_j) = rest.split_at_mut(N);
                let poses = (&poses[edge.i], &poses[edge.j]);
                linearize_edge(edge, poses, loss, [h_ii, h_ij, h_jj], [g_i, g_j]);
            }
        });
    }

    fn of(&self, edge: usize) -> &[f64] {
        &self.0[edge * Self::TERM..][..Self::TERM]
    }
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

/// Which edges each block row sums, and where; in edge order.
#[derive(Debug)]
pub(super) struct Incidences(Lists<Incidence>);

impl Incidences {
    /// `rows_of_edges` yields the rows of poses i and j of each edge, `None` for constant ones.
    /// An edge of a pose with itself has a constant residual and is left out.
    pub(super) fn new(
        pattern: &BlockPattern,
        rows_of_edges: impl Iterator<Item = (Option<usize>, Option<usize>)> + Clone,
    ) -> Self {
        let edges = rows_of_edges.enumerate().filter(|(_, (i, j))| i != j);
        let ends = edges.flat_map(|(edge, (i, j))| [(edge, i, j, true), (edge, j, i, false)]);
        let mut counts = vec![0; pattern.block_count() + 1];
        ends.clone().filter_map(|(_, own, ..)| own).for_each(|row| counts[row + 1] += 1);
        let incidences = ends.filter_map(|(edge, own, other, is_i)| {
            let row = own?;
            let slot = other
                .filter(|&other| other < row)
                .and_then(|other| pattern.row(row).binary_search(&(other as u32)).ok())
                .map_or(NOT_STORED, |slot| slot as u32);
            Some((row, Incidence { edge: edge as u32, is_i, slot }))
        });
        Self(Lists::counted(counts, incidences))
    }

    /// Sums the terms of the edges into H and g. Once `interrupt` is due the rest stay as they are.
    pub(super) fn assemble<const N: usize>(
        &self,
        terms: &EdgeTerms<N>,
        interrupt: &Interrupt,
        hessian: &mut BlockMatrix,
        gradient: &mut [f64],
    ) {
        let mut rows = hessian.rows_mut();
        let runs = rows.chunks_mut(ROWS_PER_TASK).zip(gradient.chunks_mut(ROWS_PER_TASK * N));
        parallel::for_each(runs, |(rows, gradient)| {
            let mut steps = interrupt.in_steps(FACTORS_PER_QUESTION);
            for (row, gradient) in rows.iter_mut().zip(gradient.chunks_exact_mut(N)) {
                let edges = self.0.of(row.index()).len();
                if !steps.is_due_after(edges as u32) {
                    self.assemble_row(terms, row, gradient);
                }
            }
        });
    }

    fn assemble_row<const N: usize>(
        &self,
        terms: &EdgeTerms<N>,
        row: &mut BlockRowMut<'_>,
        gradient: &mut [f64],
    ) {
        row.values_mut().fill(0.0);
        let mut h = SMatrix::<f64, N, N>::zeros();
        let mut g = SVector::<f64, N>::zeros();
        for incidence in self.0.of(row.index()) {
            let (blocks, shares) = terms.of(incidence.edge as usize).split_at(3 * N * N);
            let block = |k: usize| SMatrixView::<f64, N, N>::from_slice(&blocks[k * N * N..]);
            let (own, share) = if incidence.is_i { (0, 0) } else { (2, N) };
            h += block(own);
            g += SVectorView::<f64, N>::from_slice(&shares[share..]);
            if incidence.slot != NOT_STORED {
                let values = row.slot_mut(incidence.slot as usize);
                let mut off_diagonal = SMatrixViewMut::<f64, N, N>::from_slice(values);
                if incidence.is_i {
                    off_diagonal += block(1);
                } else {
                    off_diagonal += block(1).transpose();
                }
            }
        }
        row.diagonal_mut().copy_from_slice(h.as_slice());
        gradient.copy_from_slice(g.as_slice());
    }
}
