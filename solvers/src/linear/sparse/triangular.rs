//! Solves with the factor: L y = b up the tree, Lᵀ x = y down again.
//!
//! A node works on a short dense vector, its pivots followed by its rows. Eight columns are applied
//! at a time, so that the vector is read and written once for each eight of them. The factor is
//! streamed once in each direction. Nothing is allocated. It checks no solution.

use super::kernels::rows_at;
use super::plan::{Node, Plan, Run};
use super::shape::Shape;
use crate::interrupt::Interrupt;
use crate::simd::{Kernel, Lanes, Row, WIDTH};

/// Which way a solve goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sweep {
    /// Up and down again.
    Both,
    /// L y = b, up the tree.
    Up,
    /// Lᵀ x = y, down the tree.
    Down,
}

/// Solves in place, in elimination order.
pub(super) struct Triangular<'a> {
    pub(super) plan: &'a Plan,
    /// The nodes that were eliminated. Rows of the others take what these add to them on the way up, and
    /// are given on the way down.
    pub(super) nodes: &'a [Node],
    pub(super) sweep: Sweep,
    pub(super) factor: &'a [f64],
    pub(super) x: &'a mut [f64],
    /// At least as long as the longest column of a front.
    pub(super) front: &'a mut [f64],
    /// Once it is due the solve ends; `x` is then of no use.
    pub(super) interrupt: &'a Interrupt,
}

/// Entries of the factor between two questions to the interrupt: some ms.
const ENTRIES_PER_QUESTION: u32 = 1 << 20;

/// Steps of a node: the entries of its panel.
fn entries(node: &Node) -> u32 {
    u32::try_from(node.shape.panel_size()).unwrap_or(u32::MAX)
}

impl Kernel for Triangular<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { plan, nodes, sweep, factor, x, front, interrupt } = self;
        let up: &[Node] = if sweep == Sweep::Down { &[] } else { nodes };
        let down: &[Node] = if sweep == Sweep::Up { &[] } else { nodes };
        let mut steps = interrupt.in_steps(ENTRIES_PER_QUESTION);
        for node in up {
            if steps.is_due_after(entries(node)) {
                return;
            }
            let Shape { pivots, stride, .. } = node.shape;
            let panel = &factor[node.panel..][..node.shape.panel_size()];
            let front = &mut front[..stride];
            let (head, rows) = front.split_at_mut(pivots);
            head.copy_from_slice(&x[node.first..][..pivots]);
            rows.fill(0.0);
            forward(lanes, panel, stride, pivots, front);
            x[node.first..][..pivots].copy_from_slice(&front[..pivots]);
            for run in runs(plan, node) {
                let target = &mut x[run.to as usize..][..run.length as usize];
                let source = &front[run.from as usize..][..run.length as usize];
                for (t, s) in target.iter_mut().zip(source) {
                    *t += s;
                }
            }
        }
        for node in down.iter().rev() {
            if steps.is_due_after(entries(node)) {
                return;
            }
            let Shape { pivots, rows, stride } = node.shape;
            let panel = &factor[node.panel..][..node.shape.panel_size()];
            let front = &mut front[..stride];
            front[..pivots].copy_from_slice(&x[node.first..][..pivots]);
            for run in runs(plan, node) {
                front[run.from as usize..][..run.length as usize]
                    .copy_from_slice(&x[run.to as usize..][..run.length as usize]);
            }
            front[rows..].fill(0.0);
            backward(lanes, panel, stride, pivots, front);
            x[node.first..][..pivots].copy_from_slice(&front[..pivots]);
        }
    }
}

#[inline(always)]
fn runs<'a>(plan: &'a Plan, node: &Node) -> &'a [Run] {
    &plan.rows[node.row_runs.start as usize..node.row_runs.end as usize]
}

/// `W` columns from row `first` on.
#[inline(always)]
fn lines<const W: usize>(columns: &[f64], stride: usize, first: usize) -> [&[f64]; W] {
    let mut lines: [&[f64]; W] = [&[]; W];
    for w in 0..W {
        lines[w] = &columns[w * stride + first..(w + 1) * stride];
    }
    lines
}

/// Calls `$strip::<L, W>` for the width W at hand, at most eight.
macro_rules! strip {
    ($width:expr, $strip:ident($($argument:expr),*)) => {
        match $width {
            8 => $strip::<L, 8>($($argument),*),
            7 => $strip::<L, 7>($($argument),*),
            6 => $strip::<L, 6>($($argument),*),
            5 => $strip::<L, 5>($($argument),*),
            4 => $strip::<L, 4>($($argument),*),
            3 => $strip::<L, 3>($($argument),*),
            2 => $strip::<L, 2>($($argument),*),
            _ => $strip::<L, 1>($($argument),*),
        }
    };
}

/// front ← (L₁₁⁻¹ b, −L₂₁ L₁₁⁻¹ b).
#[inline(always)]
fn forward<L: Lanes>(lanes: L, panel: &[f64], stride: usize, pivots: usize, front: &mut [f64]) {
    let mut first = 0;
    while first < pivots {
        let width = (pivots - first).min(WIDTH);
        let columns = &panel[first * stride..(first + width) * stride];
        let (groups, _) = front[first..].as_chunks_mut::<WIDTH>();
        strip!(width, forward_strip(lanes, columns, stride, first, groups));
        first += width;
    }
}

/// `W` columns of [`forward`], whose diagonal begins at row `first`.
#[inline(always)]
fn forward_strip<L: Lanes, const W: usize>(
    lanes: L,
    columns: &[f64],
    stride: usize,
    first: usize,
    groups: &mut [Row],
) {
    let lines = lines::<W>(columns, stride, first);
    let Some((diagonal, groups)) = groups.split_first_mut() else { return };
    let mut solved = [0.0; W];
    let mut v = lanes.load(diagonal);
    for w in 0..W {
        lanes.store(v, diagonal);
        solved[w] = diagonal[w] * lines[w][w];
        v = lanes.fnma(lanes.load(rows_at(lines[w], 0)), lanes.splat(solved[w]), v);
    }
    lanes.store(v, diagonal);
    diagonal[..W].copy_from_slice(&solved);
    for (group, rows) in groups.iter_mut().enumerate() {
        let row = (group + 1) * WIDTH;
        let mut v = lanes.load(rows);
        for w in 0..W {
            v = lanes.fnma(lanes.load(rows_at(lines[w], row)), lanes.splat(solved[w]), v);
        }
        lanes.store(v, rows);
    }
}

/// The pivots of front ← L₁₁⁻ᵀ (b − L₂₁ᵀ x₂).
#[inline(always)]
pub(super) fn backward<L: Lanes>(
    lanes: L,
    panel: &[f64],
    stride: usize,
    pivots: usize,
    front: &mut [f64],
) {
    let mut end = pivots;
    while end > 0 {
        let first = (end - 1) & !(WIDTH - 1);
        let columns = &panel[first * stride..end * stride];
        let (groups, _) = front[first..].as_chunks_mut::<WIDTH>();
        strip!(end - first, backward_strip(lanes, columns, stride, first, groups));
        end = first;
    }
}

/// `W` columns of [`backward`], whose diagonal begins at row `first`.
#[inline(always)]
fn backward_strip<L: Lanes, const W: usize>(
    lanes: L,
    columns: &[f64],
    stride: usize,
    first: usize,
    groups: &mut [Row],
) {
    let lines = lines::<W>(columns, stride, first);
    let Some((diagonal, groups)) = groups.split_first_mut() else { return };
    let mut sums = [lanes.splat(0.0); WIDTH];
    for (group, rows) in groups.iter().enumerate() {
        let row = (group + 1) * WIDTH;
        let v = lanes.load(rows);
        for w in 0..W {
            sums[w] = lanes.fma(lanes.load(rows_at(lines[w], row)), v, sums[w]);
        }
    }
    let parts = lanes.transpose(sums);
    let mut total = parts[0];
    for part in 1..WIDTH {
        total = lanes.add(total, parts[part]);
    }
    let mut totals = [0.0; WIDTH];
    lanes.store(total, &mut totals);
    for w in (0..W).rev() {
        let mut value = diagonal[w] - totals[w];
        for r in w + 1..WIDTH {
            value -= lines[w][r] * diagonal[r];
        }
        diagonal[w] = value * lines[w][w];
    }
}
