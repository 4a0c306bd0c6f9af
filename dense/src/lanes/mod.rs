//! Vectors of sixteen lanes: AVX-512, AVX2, NEON, or plain arrays that the compiler vectorizes.
//!
//! A kernel is written once over [`Lanes`] and compiled for each class of the solvers' [`Class`]. All
//! classes give the same bits: where products are fused with sums, they are in all. Nothing here knows
//! what the numbers mean.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "aarch64")]
mod neon;
#[cfg(test)]
mod tests;

use covis_solvers::simd::Class;

/// How many lanes a vector has.
pub(super) const WIDTH: usize = 16;

/// Operations on vectors of [`WIDTH`] numbers of 32 bits. The value proves that the processor has the
/// class.
pub(super) trait Lanes: Copy {
    /// Numbers with a fraction.
    type F: Copy;
    /// Whole numbers, signed; sums and products wrap.
    type I: Copy;
    /// Yes or no.
    type M: Copy;

    /// Prefetches data that is needed soon, where the processor supports it.
    fn prefetch<T>(self, x: &T);
    /// `x` in every lane.
    fn splat(self, x: f32) -> Self::F;
    fn splat_int(self, x: i32) -> Self::I;
    fn load(self, x: &[f32; WIDTH]) -> Self::F;
    fn store(self, v: Self::F, x: &mut [f32; WIDTH]);
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// a · b + c, rounded once.
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// c − a · b, rounded once.
    fn fnma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// The bits of a number.
    fn to_bits(self, a: Self::F) -> Self::I;
    /// The number of these bits.
    fn of_bits(self, a: Self::I) -> Self::F;
    /// The smaller one; b where either is NaN.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The larger one; b where either is NaN.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    fn abs(self, a: Self::F) -> Self::F;
    /// Without the fraction; any number where it does not fit.
    fn truncate(self, a: Self::F) -> Self::I;
    /// To the nearest, ties to even; any number where it is not below 2²² in size.
    fn round(self, a: Self::F) -> Self::I;
    /// As a number with a fraction.
    fn float(self, a: Self::I) -> Self::F;
    /// a < b; no where either is NaN.
    fn less(self, a: Self::F, b: Self::F) -> Self::M;
    /// a ≤ b; no where either is NaN.
    fn at_most(self, a: Self::F, b: Self::F) -> Self::M;
    /// `yes` where the mask says so.
    fn select(self, mask: Self::M, yes: Self::F, no: Self::F) -> Self::F;
    fn select_int(self, mask: Self::M, yes: Self::I, no: Self::I) -> Self::I;
    fn add_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn sub_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn mul_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn min_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn max_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn and_int(self, a: Self::I, b: Self::I) -> Self::I;
    fn or_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// Towards higher bits.
    fn shift_up<const N: u32>(self, a: Self::I) -> Self::I;
    /// Towards lower bits, zeros from above.
    fn shift_down<const N: u32>(self, a: Self::I) -> Self::I;
    /// Towards lower bits, the sign from above.
    fn shift_down_signed<const N: u32>(self, a: Self::I) -> Self::I;
    /// a > b, signed.
    fn above_int(self, a: Self::I, b: Self::I) -> Self::M;
    /// a < b, without sign.
    fn below_int(self, a: Self::I, b: Self::I) -> Self::M;
    fn differ_int(self, a: Self::I, b: Self::I) -> Self::M;
    fn both(self, a: Self::M, b: Self::M) -> Self::M;
    fn either(self, a: Self::M, b: Self::M) -> Self::M;
    /// Where `a` says yes and `b` no.
    fn but_not(self, a: Self::M, b: Self::M) -> Self::M;
    fn any(self, a: Self::M) -> bool;
    fn all(self, a: Self::M) -> bool;
    /// The low and the high halves of `table[index]`; 0 where the mask says no or the table ends.
    fn gather(self, table: &[u64], index: Self::I, mask: Self::M) -> (Self::I, Self::I);
    /// From memory, with sign.
    fn load_i16(self, x: &[i16; WIDTH]) -> Self::I;
    /// The low halves to memory.
    fn store_i16(self, v: Self::I, x: &mut [i16; WIDTH]);
    /// From memory.
    fn load_u16(self, x: &[u16; WIDTH]) -> Self::I;
    /// The low halves to memory.
    fn store_u16(self, v: Self::I, x: &mut [u16; WIDTH]);
    /// Four bytes a lane, the first in the lowest bits.
    fn load_bytes(self, x: &[[u8; 4]; WIDTH]) -> Self::I;
    /// Four bytes a lane.
    fn store_bytes(self, v: Self::I, x: &mut [[u8; 4]; WIDTH]);
    /// Three bytes a lane, the first in the lowest bits.
    fn load_colors(self, x: &[[u8; 3]; WIDTH]) -> Self::I;
    /// Two whole numbers a lane, the first in the low half.
    fn store_pairs(self, low: Self::I, high: Self::I, x: &mut [u64; WIDTH]);
    /// |Δr| + 2 |Δg| + |Δb| of colors in the three lowest bytes.
    fn color_difference(self, a: Self::I, b: Self::I) -> Self::I;
}

/// Methods of [`Lanes`] that are one expression each, as a table. They are inlined into the kernel.
macro_rules! operations {
    ($($name:ident $(<$n:ident>)? ($($x:ident: $t:ty),*) $(-> $out:ty)? = $body:expr;)*) => {$(
        #[inline(always)]
        fn $name $(<const $n: u32>)? (self, $($x: $t),*) $(-> $out)? {
            $body
        }
    )*};
}
use operations;

/// Work that runs in one class. `run` must be `#[inline(always)]` down to the operations.
pub(super) trait Kernel {
    /// What it returns.
    type Output;
    /// Does the work.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// Runs `kernel` in this class, or in a narrower one where the processor lacks it.
pub(super) fn run<K: Kernel>(class: Class, kernel: K) -> K::Output {
    match class {
        #[cfg(target_arch = "x86_64")]
        Class::Avx512 if let Some(lanes) = avx512::Avx512::new() => lanes.run(kernel),
        #[cfg(target_arch = "x86_64")]
        Class::Avx512 | Class::Avx2 if let Some(lanes) = avx2::Avx2::new() => lanes.run(kernel),
        #[cfg(target_arch = "aarch64")]
        Class::Neon => kernel.run(neon::Neon),
        #[cfg(not(target_arch = "aarch64"))]
        Class::Neon => kernel.run(Arrays),
        Class::Avx512 | Class::Avx2 | Class::Scalar => kernel.run(Arrays),
    }
}

/// The same of all lanes, as a loop. A closure would do, but the compiler does not always inline
/// `std::array::from_fn`, and then each operation becomes a call.
macro_rules! each {
    ($i:ident => $value:expr) => {{
        let mut lanes = [Default::default(); WIDTH];
        for $i in 0..WIDTH {
            lanes[$i] = $value;
        }
        lanes
    }};
}

/// What every processor has: loops of a fixed length, which the compiler vectorizes for what the
/// function around them may use. The reference that the other classes must equal to the bit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrays;

type F = [f32; WIDTH];
type I = [i32; WIDTH];
type M = [bool; WIDTH];

/// 1.5 · 2²³: adding it leaves no room for a fraction.
const NO_FRACTION: f32 = 12_582_912.0;

impl Lanes for Arrays {
    type F = F;
    type I = I;
    type M = M;

    operations! {
        splat(x: f32) -> F = [x; WIDTH];
        splat_int(x: i32) -> I = [x; WIDTH];
        load(x: &F) -> F = *x;
        store(v: F, x: &mut F) = *x = v;
        add(a: F, b: F) -> F = each!(i => a[i] + b[i]);
        sub(a: F, b: F) -> F = each!(i => a[i] - b[i]);
        mul(a: F, b: F) -> F = each!(i => a[i] * b[i]);
        fma(a: F, b: F, c: F) -> F = each!(i => a[i].mul_add(b[i], c[i]));
        fnma(a: F, b: F, c: F) -> F = each!(i => (-a[i]).mul_add(b[i], c[i]));
        div(a: F, b: F) -> F = each!(i => a[i] / b[i]);
        to_bits(a: F) -> I = each!(i => a[i].to_bits().cast_signed());
        of_bits(a: I) -> F = each!(i => f32::from_bits(a[i].cast_unsigned()));
        min(a: F, b: F) -> F = each!(i => if a[i] < b[i] { a[i] } else { b[i] });
        max(a: F, b: F) -> F = each!(i => if a[i] > b[i] { a[i] } else { b[i] });
        abs(a: F) -> F = each!(i => a[i].abs());
        truncate(a: F) -> I = each!(i => a[i] as i32);
        round(a: F) -> I = each!(i => {
            (a[i] + NO_FRACTION).to_bits().wrapping_sub(NO_FRACTION.to_bits()).cast_signed()
        });
        float(a: I) -> F = each!(i => a[i] as f32);
        less(a: F, b: F) -> M = each!(i => a[i] < b[i]);
        at_most(a: F, b: F) -> M = each!(i => a[i] <= b[i]);
        select(mask: M, yes: F, no: F) -> F = each!(i => if mask[i] { yes[i] } else { no[i] });
        select_int(mask: M, yes: I, no: I) -> I = each!(i => if mask[i] { yes[i] } else { no[i] });
        add_int(a: I, b: I) -> I = each!(i => a[i].wrapping_add(b[i]));
        sub_int(a: I, b: I) -> I = each!(i => a[i].wrapping_sub(b[i]));
        mul_int(a: I, b: I) -> I = each!(i => a[i].wrapping_mul(b[i]));
        min_int(a: I, b: I) -> I = each!(i => a[i].min(b[i]));
        max_int(a: I, b: I) -> I = each!(i => a[i].max(b[i]));
        and_int(a: I, b: I) -> I = each!(i => a[i] & b[i]);
        or_int(a: I, b: I) -> I = each!(i => a[i] | b[i]);
        shift_up<N>(a: I) -> I = each!(i => a[i] << N);
        shift_down<N>(a: I) -> I = each!(i => (a[i].cast_unsigned() >> N).cast_signed());
        shift_down_signed<N>(a: I) -> I = each!(i => a[i] >> N);
        above_int(a: I, b: I) -> M = each!(i => a[i] > b[i]);
        below_int(a: I, b: I) -> M = each!(i => a[i].cast_unsigned() < b[i].cast_unsigned());
        differ_int(a: I, b: I) -> M = each!(i => a[i] != b[i]);
        both(a: M, b: M) -> M = each!(i => a[i] & b[i]);
        either(a: M, b: M) -> M = each!(i => a[i] | b[i]);
        but_not(a: M, b: M) -> M = each!(i => a[i] & !b[i]);
        any(a: M) -> bool = a.iter().fold(false, |any, &lane| any | lane);
        all(a: M) -> bool = a.iter().fold(true, |all, &lane| all & lane);
        load_i16(x: &[i16; WIDTH]) -> I = each!(i => i32::from(x[i]));
        store_i16(v: I, x: &mut [i16; WIDTH]) = *x = each!(i => v[i] as i16);
        load_u16(x: &[u16; WIDTH]) -> I = each!(i => i32::from(x[i]));
        store_u16(v: I, x: &mut [u16; WIDTH]) = *x = each!(i => v[i] as u16);
        load_bytes(x: &[[u8; 4]; WIDTH]) -> I = each!(i => i32::from_le_bytes(x[i]));
        store_bytes(v: I, x: &mut [[u8; 4]; WIDTH]) = *x = each!(i => v[i].to_le_bytes());
        load_colors(x: &[[u8; 3]; WIDTH]) -> I =
            each!(i => i32::from_le_bytes([x[i][0], x[i][1], x[i][2], 0]));
    }

    #[inline(always)]
    fn prefetch<T>(self, _: &T) {}

    #[inline(always)]
    fn gather(self, table: &[u64], index: I, mask: M) -> (I, I) {
        let found: [u64; WIDTH] = each!(i => {
            let entry = table.get(index[i].cast_unsigned() as usize).copied().unwrap_or(0);
            if mask[i] { entry } else { 0 }
        });
        (each!(i => found[i] as u32 as i32), each!(i => (found[i] >> 32) as u32 as i32))
    }

    #[inline(always)]
    fn store_pairs(self, low: I, high: I, x: &mut [u64; WIDTH]) {
        let half = |value: i32| u64::from(value.cast_unsigned());
        *x = each!(i => half(low[i]) | half(high[i]) << 32);
    }

    #[inline(always)]
    fn color_difference(self, a: I, b: I) -> I {
        each!(i => {
            let channel = |k: u32| (((a[i] >> k) & 255) - ((b[i] >> k) & 255)).abs();
            channel(0) + 2 * channel(8) + channel(16)
        })
    }
}
