//! Columns of a front: its elimination, and strips of columns that go to tasks.
//!
//! How columns are grouped and who works on them changes no bit; see `kernels`. It knows no plan.

use super::kernels::{BadPivot, Downdate, Factor, PANEL, Source, Start, Target};
use super::shape::Shape;
use crate::interrupt::Interrupt;
use crate::parallel;
use crate::simd::{Class, WIDTH};

/// Work of fewer flops is not dealt out.
pub(super) const PARALLEL_FLOPS: f64 = 1e6;

/// Columns that a task updates at a time.
pub(super) const COLUMNS_PER_TASK: usize = 24;

/// Columns of a panel that are factored at a time where it is dealt out, so that updates are soon in
/// parallel.
pub(super) const DEALT_PANEL: usize = 32;

/// Elements of a strip that one thread updates between two checks of the interrupt: with a panel of 64
/// columns some 30 million flops.
const STRIP: usize = 1 << 18;

/// How columns are cut into strips.
#[derive(Clone, Copy)]
pub(super) enum Cut {
    /// Strips of so many columns, which go to tasks.
    Dealt(usize),
    /// One after the other, of [`STRIP`] elements or so; groups of so many columns stay together.
    InTurn(usize),
}

/// Eliminates the pivots of a front whose panel holds the matrix's values: `lift` adds the children's
/// update matrices to some columns, the panel is factored, then the front's own update matrix is made.
/// Where `interrupt` is due it ends early, as one that went well.
#[inline]
pub(super) fn eliminate(
    class: Class,
    shape: Shape,
    panel: &mut [f64],
    update: &mut [f64],
    cut: Cut,
    interrupt: &Interrupt,
    lift: impl Fn(Target<'_>) + Sync,
) -> Result<(), BadPivot> {
    let Shape { pivots, stride, .. } = shape;
    strips(stride, 0, panel, cut, interrupt, |first_column, columns| {
        lift(Target { columns, stride, first_row: 0, first_column });
    });
    cholesky(class, panel, stride, pivots, matches!(cut, Cut::Dealt(_)), interrupt)?;
    let source = Source { columns: panel, stride };
    let (stride, first_row) = (shape.update_stride(), shape.update_row());
    strips(stride, pivots, update, cut, interrupt, |first_column, columns| {
        let target = Target { columns: &mut *columns, stride, first_row, first_column };
        class.run(Downdate { source, start: Start::Zero, target });
        lift(Target { columns, stride, first_row, first_column });
    });
    Ok(())
}

/// Zeros in all columns of a panel; in a large one memory may be touched for the first time.
pub(super) fn clear(stride: usize, panel: &mut [f64], cut: Cut, interrupt: &Interrupt) {
    strips(stride, 0, panel, cut, interrupt, |_first_column, columns| columns.fill(0.0));
}

/// Cholesky of the first `pivots` columns, all that `panel` holds; bad pivots count from its first.
fn cholesky(
    class: Class,
    panel: &mut [f64],
    stride: usize,
    pivots: usize,
    is_dealt: bool,
    interrupt: &Interrupt,
) -> Result<(), BadPivot> {
    let (width, cut) = match is_dealt {
        true => (DEALT_PANEL, Cut::Dealt(COLUMNS_PER_TASK)),
        false => (PANEL, Cut::InTurn(WIDTH)),
    };
    let mut first = 0;
    // Small panels, of which there are many, are not worth asking for.
    let is_long = panel.len() > STRIP;
    while first < pivots {
        if is_long && interrupt.is_due() {
            return Ok(());
        }
        let end = (first + width).min(pivots);
        let (head, rest) = panel.split_at_mut(end * stride);
        let columns = &mut head[first * stride..];
        class.run(Factor { columns: &mut *columns, stride, first })?;
        let source = Source { columns, stride };
        strips(stride, end, rest, cut, interrupt, |first_column, columns| {
            let target = Target { columns, stride, first_row: 0, first_column };
            class.run(Downdate { source, start: Start::Target, target });
        });
        first = end;
    }
    Ok(())
}

/// Runs `work` on strips of `columns`, which begin at column `first`, until `interrupt` is due.
#[inline]
fn strips(
    stride: usize,
    first: usize,
    columns: &mut [f64],
    cut: Cut,
    interrupt: &Interrupt,
    work: impl Fn(usize, &mut [f64]) + Sync,
) {
    match cut {
        _ if columns.is_empty() => {}
        Cut::Dealt(strip) => {
            parallel::for_each(columns.chunks_mut(strip * stride).enumerate(), |(k, columns)| {
                if !interrupt.is_due() {
                    work(first + k * strip, columns);
                }
            });
        }
        Cut::InTurn(_) if columns.len() <= STRIP => work(first, columns),
        Cut::InTurn(group) => {
            let strip = (STRIP / stride).next_multiple_of(group).max(group);
            for (k, columns) in columns.chunks_mut(strip * stride).enumerate() {
                if interrupt.is_due() {
                    return;
                }
                work(first + k * strip, columns);
            }
        }
    }
}
