//! Eight lanes in an array: the class that every processor has, and the twin that tests hold the
//! others against. Products round before they are added.

use super::{Lanes, Row, WIDTH};

/// Needs nothing of the processor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scalar;

impl Lanes for Scalar {
    type V = Row;

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
    #[inline(always)]
    fn add(self, a: Row, b: Row) -> Row {
        std::array::from_fn(|i| a[i] + b[i])
    }
    #[inline(always)]
    fn sub(self, a: Row, b: Row) -> Row {
        std::array::from_fn(|i| a[i] - b[i])
    }
    #[inline(always)]
    fn mul(self, a: Row, b: Row) -> Row {
        std::array::from_fn(|i| a[i] * b[i])
    }
    #[inline(always)]
    fn div(self, a: Row, b: Row) -> Row {
        std::array::from_fn(|i| a[i] / b[i])
    }
    #[inline(always)]
    fn sqrt(self, a: Row) -> Row {
        a.map(f64::sqrt)
    }
    #[inline(always)]
    fn max(self, a: Row, b: Row) -> Row {
        std::array::from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn min(self, a: Row, b: Row) -> Row {
        std::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn select(self, mask: Row, yes: Row, no: Row) -> Row {
        std::array::from_fn(|i| if mask[i] > 0.0 { yes[i] } else { no[i] })
    }
    #[inline(always)]
    fn fma(self, a: Row, b: Row, c: Row) -> Row {
        std::array::from_fn(|i| a[i] * b[i] + c[i])
    }
    #[inline(always)]
    fn fnma(self, a: Row, b: Row, c: Row) -> Row {
        std::array::from_fn(|i| c[i] - a[i] * b[i])
    }
    #[inline(always)]
    fn fnma_one(self, a: f64, b: f64, c: f64) -> f64 {
        c - a * b
    }
    #[inline(always)]
    fn transpose(self, rows: [Row; WIDTH]) -> [Row; WIDTH] {
        std::array::from_fn(|i| std::array::from_fn(|j| rows[j][i]))
    }
}
