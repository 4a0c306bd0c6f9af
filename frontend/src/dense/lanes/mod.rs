//! Vectors of sixteen lanes: AVX-512, or plain arrays that the compiler vectorizes for the processor.
//!
//! A kernel is written once over [`Lanes`] and compiled for each class; [`Class::detect`] picks the
//! widest that the processor has. All classes give the same bits: where products are fused with sums,
//! they are in all. Nothing here knows what the numbers mean.

mod arrays;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(super) use arrays::Arrays;

/// How many lanes a vector has.
pub(super) const WIDTH: usize = 16;

/// Operations on vectors of [`WIDTH`] numbers of 32 bits. The value proves that the processor has the
/// class.
pub(super) trait Lanes: Copy {
    /// Numbers with a fraction.
    type F: Copy;
    /// Whole numbers.
    type I: Copy;
    /// Yes or no.
    type M: Copy;

    /// Prefetches data that is needed soon, where the processor supports it.
    fn prefetch<T>(self, x: &T);
    /// `x` in every lane.
    fn splat(self, x: f32) -> Self::F;
    /// `x` in every lane.
    fn splat_int(self, x: i32) -> Self::I;
    /// From memory.
    fn load(self, x: &[f32; WIDTH]) -> Self::F;
    /// To memory.
    fn store(self, v: Self::F, x: &mut [f32; WIDTH]);
    /// a + b.
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    /// a − b.
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    /// a · b.
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// a · b + c, rounded once.
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// c − a · b, rounded once.
    fn fnma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// a / b.
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// The bits of a number.
    fn to_bits(self, a: Self::F) -> Self::I;
    /// The number of these bits.
    fn of_bits(self, a: Self::I) -> Self::F;
    /// The smaller one; b where either is NaN.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The larger one; b where either is NaN.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// |a|.
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
    /// `yes` where the mask says so.
    fn select_int(self, mask: Self::M, yes: Self::I, no: Self::I) -> Self::I;
    /// a + b, wrapping.
    fn add_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// a − b, wrapping.
    fn sub_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// a · b, wrapping.
    fn mul_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// The smaller one, signed.
    fn min_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// The larger one, signed.
    fn max_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// Bits of both.
    fn and_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// Bits of either.
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
    /// a ≠ b.
    fn differ_int(self, a: Self::I, b: Self::I) -> Self::M;
    /// Where both say yes.
    fn both(self, a: Self::M, b: Self::M) -> Self::M;
    /// Where any says yes.
    fn either(self, a: Self::M, b: Self::M) -> Self::M;
    /// Where `a` says yes and `b` no.
    fn but_not(self, a: Self::M, b: Self::M) -> Self::M;
    /// Whether any lane says yes.
    fn any(self, a: Self::M) -> bool;
    /// Whether all lanes say yes.
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

/// Work that runs in one class. `run` must be `#[inline(always)]` down to the operations.
pub(super) trait Kernel {
    /// What it returns.
    type Output;
    /// Does the work.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// An instruction set that kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Class {
    /// 512-bit vectors.
    Avx512,
    /// 256-bit vectors.
    Avx2,
    /// What every processor of the target has.
    Plain,
}

impl Class {
    /// All classes, the widest first.
    pub(super) const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Plain];

    /// The widest class of this processor.
    #[must_use]
    pub(super) fn detect() -> Self {
        Self::ALL.into_iter().find(|class| class.is_available()).unwrap_or(Self::Plain)
    }

    /// Whether this processor has it.
    #[must_use]
    pub(super) fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => x86::Avx512::new().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => x86::Avx2::new().is_some(),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
            Self::Plain => true,
        }
    }

    /// Runs `kernel` in this class, or in the plain one where the processor lacks it.
    pub(super) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        {
            if self == Self::Avx512
                && let Some(lanes) = x86::Avx512::new()
            {
                return lanes.run(kernel);
            }
            if self != Self::Plain
                && let Some(lanes) = x86::Avx2::new()
            {
                return lanes.run(kernel);
            }
        }
        kernel.run(Arrays)
    }
}

#[cfg(test)]
mod tests;
