//! Columns of a front: the Cholesky of a panel, and strips of columns that go to tasks.
//!
//! How columns are grouped and who works on them changes no bit; see `kernels`. It knows no plan.

use rayon::prelude::*;

use super::kernels::{BadPivot, Downdate, Factor, PANEL, Source, Start, Target};
use crate::simd::Class;

/// Columns that a task updates at a time.
pub(super) const COLUMNS_PER_TASK: usize = 24;

/// Columns of a panel that are factored at a time where it is dealt out, so that updates are soon in
/// parallel.
const DEALT_PANEL: usize = 32;

/// Cholesky of the first `pivots` columns, all that `panel` holds; bad pivots count from its first.
pub(super) fn cholesky(
    class: Class,
    panel: &mut [f64],
    (stride, pivots): (usize, usize),
    is_dealt: bool,
) -> Result<(), BadPivot> {
    let (width, strip) = match is_dealt {
        true => (DEALT_PANEL, Some(COLUMNS_PER_TASK)),
        false => (PANEL, None),
    };
    let mut first = 0;
    while first < pivots {
        let end = (first + width).min(pivots);
        let (head, rest) = panel.split_at_mut(end * stride);
        let columns = &mut head[first * stride..];
        class.run(Factor { columns: &mut *columns, stride, first })?;
        let source = Source { columns, stride };
        strips((stride, end), rest, strip, |first_column, columns| {
            let target = Target { columns, stride, first_row: 0, first_column };
            class.run(Downdate { source, start: Start::Target, target });
        });
        first = end;
    }
    Ok(())
}

/// Runs `work` on `columns`, which begin at column `first`: on strips of so many in parallel, or on
/// all at once.
pub(super) fn strips(
    (stride, first): (usize, usize),
    columns: &mut [f64],
    strip: Option<usize>,
    work: impl Fn(usize, &mut [f64]) + Sync,
) {
    if columns.is_empty() {
        return;
    }
    let Some(strip) = strip else {
        work(first, columns);
        return;
    };
    columns
        .par_chunks_mut(strip * stride)
        .enumerate()
        .for_each(|(k, columns)| work(first + k * strip, columns));
}
