//! Lanes in arrays: loops of a fixed length, which the compiler vectorizes for what the function
//! around them may use. The reference that the other classes must equal to the bit.

use std::array::from_fn;

use super::{Lanes, WIDTH};

/// What every processor has.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Arrays;

type F = [f32; WIDTH];
type I = [i32; WIDTH];
type M = [bool; WIDTH];

/// 1.5 · 2²³: adding it leaves no room for a fraction.
const NO_FRACTION: f32 = 12_582_912.0;

impl Lanes for Arrays {
    type F = F;
    type I = I;
    type M = M;

    #[inline(always)]
    fn prefetch<T>(self, _: &T) {}
    #[inline(always)]
    fn splat(self, x: f32) -> F {
        [x; WIDTH]
    }
    #[inline(always)]
    fn splat_int(self, x: i32) -> I {
        [x; WIDTH]
    }
    #[inline(always)]
    fn load(self, x: &F) -> F {
        *x
    }
    #[inline(always)]
    fn store(self, v: F, x: &mut F) {
        *x = v;
    }
    #[inline(always)]
    fn add(self, a: F, b: F) -> F {
        from_fn(|i| a[i] + b[i])
    }
    #[inline(always)]
    fn sub(self, a: F, b: F) -> F {
        from_fn(|i| a[i] - b[i])
    }
    #[inline(always)]
    fn mul(self, a: F, b: F) -> F {
        from_fn(|i| a[i] * b[i])
    }
    #[inline(always)]
    fn fma(self, a: F, b: F, c: F) -> F {
        from_fn(|i| a[i].mul_add(b[i], c[i]))
    }
    #[inline(always)]
    fn fnma(self, a: F, b: F, c: F) -> F {
        from_fn(|i| (-a[i]).mul_add(b[i], c[i]))
    }
    #[inline(always)]
    fn div(self, a: F, b: F) -> F {
        from_fn(|i| a[i] / b[i])
    }
    #[inline(always)]
    fn to_bits(self, a: F) -> I {
        from_fn(|i| a[i].to_bits().cast_signed())
    }
    #[inline(always)]
    fn of_bits(self, a: I) -> F {
        from_fn(|i| f32::from_bits(a[i].cast_unsigned()))
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn abs(self, a: F) -> F {
        from_fn(|i| a[i].abs())
    }
    #[inline(always)]
    fn truncate(self, a: F) -> I {
        from_fn(|i| a[i] as i32)
    }
    #[inline(always)]
    fn round(self, a: F) -> I {
        from_fn(|i| {
            (a[i] + NO_FRACTION).to_bits().wrapping_sub(NO_FRACTION.to_bits()).cast_signed()
        })
    }
    #[inline(always)]
    fn float(self, a: I) -> F {
        from_fn(|i| a[i] as f32)
    }
    #[inline(always)]
    fn less(self, a: F, b: F) -> M {
        from_fn(|i| a[i] < b[i])
    }
    #[inline(always)]
    fn at_most(self, a: F, b: F) -> M {
        from_fn(|i| a[i] <= b[i])
    }
    #[inline(always)]
    fn select(self, mask: M, yes: F, no: F) -> F {
        from_fn(|i| if mask[i] { yes[i] } else { no[i] })
    }
    #[inline(always)]
    fn select_int(self, mask: M, yes: I, no: I) -> I {
        from_fn(|i| if mask[i] { yes[i] } else { no[i] })
    }
    #[inline(always)]
    fn add_int(self, a: I, b: I) -> I {
        from_fn(|i| a[i].wrapping_add(b[i]))
    }
    #[inline(always)]
    fn sub_int(self, a: I, b: I) -> I {
        from_fn(|i| a[i].wrapping_sub(b[i]))
    }
    #[inline(always)]
    fn mul_int(self, a: I, b: I) -> I {
        from_fn(|i| a[i].wrapping_mul(b[i]))
    }
    #[inline(always)]
    fn min_int(self, a: I, b: I) -> I {
        from_fn(|i| a[i].min(b[i]))
    }
    #[inline(always)]
    fn max_int(self, a: I, b: I) -> I {
        from_fn(|i| a[i].max(b[i]))
    }
    #[inline(always)]
    fn and_int(self, a: I, b: I) -> I {
        from_fn(|i| a[i] & b[i])
    }
    #[inline(always)]
    fn or_int(self, a: I, b: I) -> I {
        from_fn(|i| a[i] | b[i])
    }
    #[inline(always)]
    fn shift_up<const N: u32>(self, a: I) -> I {
        from_fn(|i| a[i] << N)
    }
    #[inline(always)]
    fn shift_down<const N: u32>(self, a: I) -> I {
        from_fn(|i| (a[i].cast_unsigned() >> N).cast_signed())
    }
    #[inline(always)]
    fn shift_down_signed<const N: u32>(self, a: I) -> I {
        from_fn(|i| a[i] >> N)
    }
    #[inline(always)]
    fn above_int(self, a: I, b: I) -> M {
        from_fn(|i| a[i] > b[i])
    }
    #[inline(always)]
    fn below_int(self, a: I, b: I) -> M {
        from_fn(|i| a[i].cast_unsigned() < b[i].cast_unsigned())
    }
    #[inline(always)]
    fn differ_int(self, a: I, b: I) -> M {
        from_fn(|i| a[i] != b[i])
    }
    #[inline(always)]
    fn both(self, a: M, b: M) -> M {
        from_fn(|i| a[i] & b[i])
    }
    #[inline(always)]
    fn either(self, a: M, b: M) -> M {
        from_fn(|i| a[i] | b[i])
    }
    #[inline(always)]
    fn but_not(self, a: M, b: M) -> M {
        from_fn(|i| a[i] & !b[i])
    }
    #[inline(always)]
    fn any(self, a: M) -> bool {
        a.iter().fold(false, |any, &lane| any | lane)
    }
    #[inline(always)]
    fn all(self, a: M) -> bool {
        a.iter().fold(true, |all, &lane| all & lane)
    }
    #[inline(always)]
    fn gather(self, table: &[u64], index: I, mask: M) -> (I, I) {
        let found: [u64; WIDTH] = from_fn(|i| {
            let entry = table.get(index[i].cast_unsigned() as usize).copied().unwrap_or(0);
            if mask[i] { entry } else { 0 }
        });
        (from_fn(|i| found[i] as u32 as i32), from_fn(|i| (found[i] >> 32) as u32 as i32))
    }
    #[inline(always)]
    fn load_i16(self, x: &[i16; WIDTH]) -> I {
        from_fn(|i| i32::from(x[i]))
    }
    #[inline(always)]
    fn store_i16(self, v: I, x: &mut [i16; WIDTH]) {
        *x = from_fn(|i| v[i] as i16);
    }
    #[inline(always)]
    fn load_u16(self, x: &[u16; WIDTH]) -> I {
        from_fn(|i| i32::from(x[i]))
    }
    #[inline(always)]
    fn store_u16(self, v: I, x: &mut [u16; WIDTH]) {
        *x = from_fn(|i| v[i] as u16);
    }
    #[inline(always)]
    fn load_bytes(self, x: &[[u8; 4]; WIDTH]) -> I {
        from_fn(|i| i32::from_le_bytes(x[i]))
    }
    #[inline(always)]
    fn store_bytes(self, v: I, x: &mut [[u8; 4]; WIDTH]) {
        *x = from_fn(|i| v[i].to_le_bytes());
    }
    #[inline(always)]
    fn load_colors(self, x: &[[u8; 3]; WIDTH]) -> I {
        from_fn(|i| i32::from_le_bytes([x[i][0], x[i][1], x[i][2], 0]))
    }
    #[inline(always)]
    fn store_pairs(self, low: I, high: I, x: &mut [u64; WIDTH]) {
        let half = |value: i32| u64::from(value.cast_unsigned());
        *x = from_fn(|i| half(low[i]) | half(high[i]) << 32);
    }
    #[inline(always)]
    fn color_difference(self, a: I, b: I) -> I {
        from_fn(|i| {
            let channel = |k: u32| (((a[i] >> k) & 255) - ((b[i] >> k) & 255)).abs();
            channel(0) + 2 * channel(8) + channel(16)
        })
    }
}
