//! Columns of a front: the Cholesky of a panel, and strips of columns that go to tasks.
//!
//! How columns are grouped and who works on them changes no bit; see `kernels`. It knows no plan.

use rayon::prelude::*;

use super::kernels::{BadPivot, Downdate, Factor, PANEL, Source, Start, Target};
use crate::interrupt::Interrupt;
use crate::simd::{Class, WIDTH};

/// Columns that a task updates at a time.
pub(super) const COLUMNS_PER_TASK: usize = 24;

/// Columns of a panel that are factored at a time where it is dealt out, so that updates are soon in
/// parallel.
const DEALT_PANEL: usize = 32;

/// Elements of a strip that one thread updates before it asks whether to go on: with a panel of 64
/// columns some 30 million flops.
const STRIP: usize = 1 << 18;

/// Cholesky of the first `pivots` columns, all that `panel` holds; bad pivots count from its first.
/// Where `interrupt` is due it ends early, as one that went well.
pub(super) fn cholesky(
    class: Class,
    panel: &mut [f64],
    (stride, pivots): (usize, usize),
    is_dealt: bool,
    interrupt: &Interrupt,
) -> Result<(), BadPivot> {
    let (width, strip) = match is_dealt {
        true => (DEALT_PANEL, Some(COLUMNS_PER_TASK)),
        false => (PANEL, None),
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
        strips((stride, end), rest, (strip, interrupt), |first_column, columns| {
            let target = Target { columns, stride, first_row: 0, first_column };
            class.run(Downdate { source, start: Start::Target, target });
        });
        first = end;
    }
    Ok(())
}

/// Runs `work` on `columns`, which begin at column `first`: on strips of so many in parallel, or on
/// one thread; until `interrupt` is due.
pub(super) fn strips(
    (stride, first): (usize, usize),
    columns: &mut [f64],
    (strip, interrupt): (Option<usize>, &Interrupt),
    work: impl Fn(usize, &mut [f64]) + Sync,
) {
    if columns.is_empty() {
        return;
    }
    let Some(strip) = strip else {
        if columns.len() <= STRIP {
            work(first, columns);
            return;
        }
        // Whole groups of the eight columns that kernels take at a time.
        let strip = (STRIP / stride).next_multiple_of(WIDTH).max(WIDTH);
        for (k, columns) in columns.chunks_mut(strip * stride).enumerate() {
            if interrupt.is_due() {
                return;
            }
            work(first + k * strip, columns);
        }
        return;
    };
    columns.par_chunks_mut(strip * stride).enumerate().for_each(|(k, columns)| {
        if !interrupt.is_due() {
            work(first + k * strip, columns);
        }
    });
}
