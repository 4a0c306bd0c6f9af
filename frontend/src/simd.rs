//! Loops compiled for wider vectors than every processor has.
//!
//! A kernel is written once, as plain loops over slices; the compiler makes vectors of them, of 128
//! bits for any x86-64 processor and of 256 bits where the solvers' class has AVX2. Products and sums are
//! never fused and keep their order, so that results have the same bits everywhere. This file has the only
//! `unsafe` of the frontend. Knows nothing of what kernels compute.

#![allow(unsafe_code, reason = "instructions of a processor that was asked for them")]

#[cfg(target_arch = "x86_64")]
use covis_solvers::simd::Class;

/// Work that is compiled for several processors. `run` must be `#[inline(always)]`, and so must what
/// it calls in its loops.
pub trait Kernel {
    /// What it returns.
    type Output;
    /// Does the work.
    fn run(self) -> Self::Output;
}

/// Runs a kernel with the widest vectors that this processor has.
pub fn run<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn compiled<K: Kernel>(kernel: K) -> K::Output {
            kernel.run()
        }
        if matches!(Class::detect(), Class::Avx512 | Class::Avx2) {
            // SAFETY: the processor was asked, and both classes have AVX2.
            return unsafe { compiled(kernel) };
        }
    }
    kernel.run()
}

/// ⌊x⌋ where it is within ±2²², the bound on its side elsewhere and the lower bound for NaN. In a kernel's
/// loops it takes the place of `as i32`, which saturates and which x86 therefore does number by number.
#[inline(always)]
#[must_use]
pub fn floor(x: f32) -> i32 {
    const BOUND: f32 = 4_194_304.0;
    // Around 1.5 · 2²³ neighboring numbers are 1 apart, and so are their bits.
    const BASE: f32 = 12_582_912.0;
    #[expect(clippy::manual_clamp, reason = "`clamp` would keep NaN")]
    let x = x.max(-BOUND).min(BOUND);
    let shifted = x + BASE;
    let nearest = shifted.to_bits() as i32 - BASE.to_bits() as i32;
    nearest - i32::from(shifted - BASE > x)
}

/// Sums over the lanes of a vector, pairwise.
#[inline(always)]
#[must_use]
pub fn sum<const N: usize>(lanes: &[f32; N]) -> f32 {
    let mut lanes = *lanes;
    let mut left = N;
    while left > 1 {
        let half = left / 2;
        for i in 0..half {
            lanes[i] += lanes[left - 1 - i];
        }
        left -= half;
    }
    lanes[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floors_are_those_of_the_standard_library_and_bounded() {
        for x in [-0.0, 0.999_999_94, -0.1, 65_535.9, 4_194_303.5, -4_194_303.5] {
            assert_eq!(floor(x), x.floor() as i32, "{x}");
        }
        for i in -50_000_i32..=50_000 {
            let x = i as f32 * 0.37;
            assert_eq!(floor(x), x.floor() as i32, "{x}");
        }
        let most = 1 << 22;
        for (x, bound) in [(f32::INFINITY, most), (1e9, most), (-1e9, -most), (f32::NAN, -most)] {
            assert_eq!(floor(x), bound, "{x}");
        }
    }
}
