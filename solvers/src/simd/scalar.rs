//! Eight lanes in an array: the class that every processor has, and the twin that tests hold the
//! others against. Products round before they are added. No intrinsics here.

use super::{Lanes, Row, Subroutine, WIDTH};

/// Needs nothing of the processor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scalar;

impl Lanes for Scalar {
    type V = Row;
    const IS_FALLBACK: bool = true;

    #[inline(always)]
    fn splat(self, x: f64) -> Row {
        [x; WIDTH]
    }
    #[inline(always)]
    fn load(self, x: &Row) -> Row {
        *x
    }
    #[inline(always)]
    fn store(self, v: Row, x: &mut Row) {
        *x = v;
    }
    operations! {
        add(a, b) = each!(i < WIDTH, 0.0 => a[i] + b[i]);
        sub(a, b) = each!(i < WIDTH, 0.0 => a[i] - b[i]);
        mul(a, b) = each!(i < WIDTH, 0.0 => a[i] * b[i]);
        div(a, b) = each!(i < WIDTH, 0.0 => a[i] / b[i]);
        sqrt(a) = each!(i < WIDTH, 0.0 => a[i].sqrt());
        max(a, b) = each!(i < WIDTH, 0.0 => if a[i] > b[i] { a[i] } else { b[i] });
        min(a, b) = each!(i < WIDTH, 0.0 => if a[i] < b[i] { a[i] } else { b[i] });
        fma(a, b, c) = each!(i < WIDTH, 0.0 => a[i] * b[i] + c[i]);
        fnma(a, b, c) = each!(i < WIDTH, 0.0 => c[i] - a[i] * b[i]);
        select(mask, yes, no) = each!(i < WIDTH, 0.0 => if mask[i] > 0.0 { yes[i] } else { no[i] });
    }
    #[inline(always)]
    fn fnma_one(self, a: f64, b: f64, c: f64) -> f64 {
        c - a * b
    }
    #[inline(always)]
    fn transpose(self, rows: [Row; WIDTH]) -> [Row; WIDTH] {
        each!(i < WIDTH, [0.0; WIDTH] => each!(j < WIDTH, 0.0 => rows[j][i]))
    }
    #[inline(never)]
    fn call<S: Subroutine<Self>>(self, work: S) -> S::Output {
        work.run(self)
    }
}
