//! Dense kernels of a front: Cholesky of its pivot columns, and the product that updates the rest.
//!
//! A front is column-major with a stride that is a multiple of eight, so that every group of eight
//! rows is one vector. Everything is a sum over pivot columns in ascending order,
//! `a(r, c) − Σ_p l(r, p) l(c, p)`, held in registers for up to 24 rows × 8 columns at a time; how
//! rows and columns are grouped changes no bit. The reciprocal of a pivot stands in its place on
//! the diagonal. Above the diagonal, within a group of eight rows, there may be any numbers, which
//! nothing reads. Each [`Kernel`] is one function per instruction set with everything inlined. They
//! know no blocks, no tree and no threads.

use crate::simd::{Kernel, Lanes, Row, WIDTH};

/// Columns that are factored together before the columns after them are updated: 64 columns of 24
/// rows fit the first cache beside eight columns of the other operand.
pub(super) const PANEL: usize = 64;

/// A pivot that cannot be divided by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BadPivot {
    /// Column in elimination order.
    pub(super) column: usize,
    /// Whether the pivot is a number, zero or below.
    pub(super) is_finite: bool,
}

impl BadPivot {
    /// The same pivot where `first` columns stand before.
    pub(super) fn after(self, first: usize) -> Self {
        Self { column: first + self.column, ..self }
    }
}

/// Rows `row..row + 8` of a column.
#[inline(always)]
pub(super) fn rows_at(column: &[f64], row: usize) -> &Row {
    // The lengths agree by construction; a front that is too short reads as zeros.
    column.get(row..).and_then(|tail| tail.first_chunk()).unwrap_or(&[0.0; WIDTH])
}

/// Rows `row..row + 8` of a column, to be written.
#[inline(always)]
fn store_at<L: Lanes>(lanes: L, column: &mut [f64], row: usize, v: L::V) {
    if let Some(rows) = column.get_mut(row..).and_then(|tail| tail.first_chunk_mut()) {
        lanes.store(v, rows);
    }
}

/// acc −= L(rows, ·) L(column.., ·)ᵀ over the columns of L in `source`.
#[inline(always)]
fn subtract<L: Lanes, const R: usize, const W: usize>(
    lanes: L,
    Source { columns, stride }: Source<'_>,
    row: usize,
    column: usize,
    acc: &mut [[L::V; R]; W],
) {
    let mut rest = columns;
    while rest.len() >= stride {
        let (current, tail) = rest.split_at(stride);
        rest = tail;
        let (Some(rows), Some(factors)) =
            (current.get(row..row + R * WIDTH), current.get(column..column + W))
        else {
            return;
        };
        let mut a = [lanes.splat(0.0); R];
        for r in 0..R {
            a[r] = lanes.load(rows_at(rows, r * WIDTH));
        }
        for w in 0..W {
            let b = lanes.splat(factors[w]);
            for r in 0..R {
                acc[w][r] = lanes.fnma(a[r], b, acc[w][r]);
            }
        }
    }
}

/// Calls `$strip::<L, W>` with the widest strip that fits `$width` columns: up to eight where they
/// stay in registers, up to six elsewhere. The value is the width taken and the result.
macro_rules! widest {
    ($lanes:ty, $width:expr, $strip:ident($($argument:expr),*)) => {
        if <$lanes>::MANY_REGISTERS {
            match $width {
                8.. => (8, $strip::<$lanes, 8>($($argument),*)),
                6..8 => (6, $strip::<$lanes, 6>($($argument),*)),
                4..6 => (4, $strip::<$lanes, 4>($($argument),*)),
                3 => (3, $strip::<$lanes, 3>($($argument),*)),
                2 => (2, $strip::<$lanes, 2>($($argument),*)),
                ..2 => (1, $strip::<$lanes, 1>($($argument),*)),
            }
        } else {
            match $width {
                6 | 7 | 9.. => (6, $strip::<$lanes, 6>($($argument),*)),
                4.. => (4, $strip::<$lanes, 4>($($argument),*)),
                2..4 => (2, $strip::<$lanes, 2>($($argument),*)),
                ..2 => (1, $strip::<$lanes, 1>($($argument),*)),
            }
        }
    };
}

/// Calls `$tile::<L, R, W>` for all groups of rows from `$row` to the end of a column.
macro_rules! groups {
    ($lanes:ty, $columns:ident, $row:expr, $stride:expr, $tile:ident($($argument:expr),*)) => {
        let mut row = $row;
        if <$lanes>::MANY_REGISTERS {
            while row + 3 * WIDTH <= $stride {
                $tile::<$lanes, 3, $columns>($($argument),*, row);
                row += 3 * WIDTH;
            }
            if row + 2 * WIDTH <= $stride {
                $tile::<$lanes, 2, $columns>($($argument),*, row);
                row += 2 * WIDTH;
            }
        }
        while row + WIDTH <= $stride {
            $tile::<$lanes, 1, $columns>($($argument),*, row);
            row += WIDTH;
        }
    };
}

/// What a tile starts from.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Start {
    /// Zero: the target holds nothing yet.
    Zero,
    /// What stands in the target.
    Target,
}

/// Columns of a front that receive an update.
pub(super) struct Target<'a> {
    /// Whole columns.
    pub(super) columns: &'a mut [f64],
    /// From one column to the next.
    pub(super) stride: usize,
    /// The front's row that the first element of a column stands for; a multiple of eight.
    pub(super) first_row: usize,
    /// The front's column that the first column is.
    pub(super) first_column: usize,
}

/// Columns of L.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    /// Whole columns.
    pub(super) columns: &'a [f64],
    /// From one column to the next.
    pub(super) stride: usize,
}

/// The first `W` columns of a [`Downdate`].
#[inline(always)]
fn strip<L: Lanes, const W: usize>(
    lanes: L,
    source: Source<'_>,
    start: Start,
    mut target: Target<'_>,
) {
    let row = target.first_column & !(WIDTH - 1);
    groups!(L, W, row, source.stride, tile(lanes, source, start, &mut target));
}

/// `R` vectors of rows of [`strip`].
#[inline(always)]
fn tile<L: Lanes, const R: usize, const W: usize>(
    lanes: L,
    source: Source<'_>,
    start: Start,
    target: &mut Target<'_>,
    row: usize,
) {
    let at = row - target.first_row;
    let mut acc = [[lanes.splat(0.0); R]; W];
    if start == Start::Target {
        for w in 0..W {
            for r in 0..R {
                acc[w][r] = lanes.load(rows_at(target.columns, w * target.stride + at + r * WIDTH));
            }
        }
    }
    subtract(lanes, source, row, target.first_column, &mut acc);
    for w in 0..W {
        for r in 0..R {
            store_at(lanes, target.columns, w * target.stride + at + r * WIDTH, acc[w][r]);
        }
    }
}

/// Factors the first `W` of `columns`, which are the front's from column `first` on.
#[inline(always)]
fn factor_strip<L: Lanes, const W: usize>(
    lanes: L,
    before: Source<'_>,
    columns: &mut [f64],
    first: usize,
) -> Result<(), BadPivot> {
    let stride = before.stride;
    // The group of rows with the diagonal: the factor's rows as scalars for what comes below.
    let (top, lane) = (first & !(WIDTH - 1), first % WIDTH);
    let mut acc = [[lanes.splat(0.0); 1]; W];
    for w in 0..W {
        acc[w][0] = lanes.load(rows_at(columns, w * stride + top));
    }
    subtract(lanes, before, top, first, &mut acc);
    let mut factors = [[0.0; W]; W];
    for w in 0..W {
        let mut column: Row = [0.0; WIDTH];
        lanes.store(acc[w][0], &mut column);
        let Some(rows) = column.get(lane..lane + W) else { return Ok(()) };
        factors[w].copy_from_slice(rows);
    }
    factor_block(lanes, &mut factors)
        .map_err(|(w, is_finite)| BadPivot { column: first + w, is_finite })?;
    solve(lanes, &factors, &mut acc);
    for w in 0..W {
        store_at(lanes, columns, w * stride + top, acc[w][0]);
        if let Some(diagonal) = columns.get_mut(w * stride + first + w) {
            *diagonal = factors[w][w];
        }
    }
    groups!(L, W, top + WIDTH, stride, factor_tile(lanes, before, columns, first, &factors));
    Ok(())
}

/// `R` vectors of rows below the diagonal of [`factor_strip`].
#[inline(always)]
fn factor_tile<L: Lanes, const R: usize, const W: usize>(
    lanes: L,
    before: Source<'_>,
    columns: &mut [f64],
    first: usize,
    factors: &[[f64; W]; W],
    row: usize,
) {
    let stride = before.stride;
    let mut acc = [[lanes.splat(0.0); R]; W];
    for w in 0..W {
        for r in 0..R {
            acc[w][r] = lanes.load(rows_at(columns, w * stride + row + r * WIDTH));
        }
    }
    subtract(lanes, before, row, first, &mut acc);
    solve(lanes, factors, &mut acc);
    for w in 0..W {
        for r in 0..R {
            store_at(lanes, columns, w * stride + row + r * WIDTH, acc[w][r]);
        }
    }
}

/// The block for each constant `$w` below `$count`: the compiler leaves triangular loops rolled,
/// and arrays that are indexed by a variable in memory.
macro_rules! unrolled {
    ($w:ident < $count:ident, $body:block) => {
        unrolled!(@ $w $count $body 0 1 2 3 4 5 6 7)
    };
    (@ $w:ident $count:ident $body:block $($index:literal)*) => {
        $(if $index < $count {
            let $w: usize = $index;
            $body
        })*
    };
}

/// Rows of A₂₁ to rows of L₂₁ = A₂₁ L₁₁⁻ᵀ; `factors` are the columns of L₁₁.
#[inline(always)]
fn solve<L: Lanes, const R: usize, const W: usize>(
    lanes: L,
    factors: &[[f64; W]; W],
    acc: &mut [[L::V; R]; W],
) {
    unrolled!(w < W, {
        let reciprocal = lanes.splat(factors[w][w]);
        for r in 0..R {
            acc[w][r] = lanes.mul(acc[w][r], reciprocal);
        }
        for later in 0..W {
            if later > w {
                let factor = lanes.splat(factors[w][later]);
                for r in 0..R {
                    acc[later][r] = lanes.fnma(acc[w][r], factor, acc[later][r]);
                }
            }
        }
    });
}

/// Cholesky of a small block, column by column; an error is the pivot and whether it is finite.
#[inline(always)]
fn factor_block<L: Lanes, const W: usize>(
    lanes: L,
    columns: &mut [[f64; W]; W],
) -> Result<(), (usize, bool)> {
    let mut block = *columns;
    let mut good = true;
    let mut pivots = [0.0; W];
    unrolled!(w < W, {
        let pivot = block[w][w];
        pivots[w] = pivot;
        good &= pivot > 0.0 && pivot < f64::INFINITY;
        let reciprocal = 1.0 / pivot.sqrt();
        block[w][w] = reciprocal;
        for r in 0..W {
            if r > w {
                block[w][r] *= reciprocal;
            }
        }
        unrolled!(later < W, {
            if later > w {
                let factor = block[w][later];
                for r in 0..W {
                    if r >= later {
                        block[later][r] = lanes.fnma_one(block[w][r], factor, block[later][r]);
                    }
                }
            }
        });
    });
    *columns = block;
    if good {
        return Ok(());
    }
    let is_bad = |pivot: &f64| !(*pivot > 0.0 && *pivot < f64::INFINITY);
    let first = pivots.iter().position(is_bad).unwrap_or(0);
    Err((first, pivots.get(first).is_some_and(|pivot| pivot.is_finite())))
}

/// Cholesky in place of up to [`PANEL`] columns, which begin at the front's column `first`; the
/// columns before them have been subtracted.
pub(super) struct Factor<'a> {
    pub(super) columns: &'a mut [f64],
    pub(super) stride: usize,
    pub(super) first: usize,
}

impl Kernel for Factor<'_> {
    type Output = Result<(), BadPivot>;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Self::Output {
        let Self { columns, stride, first } = self;
        let count = columns.len() / stride.max(1);
        let mut done = 0;
        while done < count {
            let (before, rest) = columns.split_at_mut(done * stride);
            let before = Source { columns: before, stride };
            // A strip ends where its group of eight rows does.
            let column = first + done;
            let width = (count - done).min(WIDTH - column % WIDTH);
            let (width, outcome) = widest!(L, width, factor_strip(lanes, before, rest, column));
            outcome?;
            done += width;
        }
        Ok(())
    }
}

/// target −= L Lᵀ in its lower triangle; the target is first taken as zero if so wished.
pub(super) struct Downdate<'a> {
    pub(super) source: Source<'a>,
    pub(super) start: Start,
    pub(super) target: Target<'a>,
}

impl Kernel for Downdate<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { source: Source { columns, stride: source_stride }, mut start, target } = self;
        let Target { columns: target, stride, first_row, first_column } = target;
        let mut sources = columns;
        while !sources.is_empty() || start == Start::Zero {
            let (current, tail) = sources.split_at(sources.len().min(PANEL * source_stride));
            sources = tail;
            let source = Source { columns: current, stride: source_stride };
            let (mut rest, mut first_column) = (&mut *target, first_column);
            while stride > 0 && rest.len() >= stride {
                let target = Target { columns: &mut *rest, stride, first_row, first_column };
                let width = target.columns.len() / stride;
                let (width, ()) = widest!(L, width, strip(lanes, source, start, target));
                rest = rest.split_at_mut(width * stride).1;
                first_column += width;
            }
            start = Start::Target;
        }
    }
}
