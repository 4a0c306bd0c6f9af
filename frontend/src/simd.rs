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
