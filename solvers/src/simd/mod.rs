//! Eight lanes of f64 under one name: AVX-512, AVX2 with FMA, NEON, or plain arrays.
//!
//! A kernel is written once over [`Lanes`] and compiled for each class; [`Class::detect`] picks the
//! widest that the processor has, at run time. Every class has eight lanes, so that the order of
//! operations is the same everywhere; the classes with fused multiply-add give the same bits, the
//! scalar one rounds products on their own. Nothing here knows what the numbers mean.

mod line;
#[cfg(target_arch = "aarch64")]
mod neon;
mod scalar;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::fmt;
use std::sync::atomic::{AtomicU8, Ordering};

pub(crate) use line::Line;
pub(crate) use scalar::Scalar;

/// How many lanes a vector has, in every class.
pub(crate) const WIDTH: usize = 8;

/// One vector as memory holds it.
pub(crate) type Row = [f64; WIDTH];

/// Operations on vectors of eight lanes. The value proves that the processor has the class.
pub(crate) trait Lanes: Copy {
    /// A vector in registers.
    type V: Copy;
    /// Whether 24 vectors and a few operands stay in registers at a time.
    const MANY_REGISTERS: bool = false;

    /// `x` in every lane.
    fn splat(self, x: f64) -> Self::V;
    /// A vector from memory.
    fn load(self, x: &Row) -> Self::V;
    /// A vector to memory.
    fn store(self, v: Self::V, x: &mut Row);
    /// a + b.
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    /// a − b.
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    /// a · b.
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    /// a / b.
    fn div(self, a: Self::V, b: Self::V) -> Self::V;
    /// √a.
    fn sqrt(self, a: Self::V) -> Self::V;
    /// The larger one; b where either is not a number.
    fn max(self, a: Self::V, b: Self::V) -> Self::V;
    /// The smaller one; b where either is not a number.
    fn min(self, a: Self::V, b: Self::V) -> Self::V;
    /// `yes` where `mask` is positive, `no` elsewhere.
    fn select(self, mask: Self::V, yes: Self::V, no: Self::V) -> Self::V;
    /// a · b + c, fused where the class can.
    fn fma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// c − a · b, fused where the class can.
    fn fnma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// c − a · b of single numbers, rounded as in [`Self::fnma`].
    fn fnma_one(self, a: f64, b: f64, c: f64) -> f64;
    /// The 8 × 8 matrix with `rows` as columns.
    fn transpose(self, rows: [Self::V; WIDTH]) -> [Self::V; WIDTH];
}

/// Work that runs in one class. `run` must be `#[inline(always)]` down to the operations.
pub(crate) trait Kernel {
    /// What it returns.
    type Output;
    /// Does the work.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// An instruction set that kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// 512-bit vectors.
    Avx512,
    /// 256-bit vectors with fused multiply-add.
    Avx2,
    /// 128-bit vectors of aarch64.
    Neon,
    /// What every processor has.
    Scalar,
}

/// Detected once; 0 means not yet.
static DETECTED: AtomicU8 = AtomicU8::new(0);

impl Class {
    const ALL: [Self; 4] = [Self::Avx512, Self::Avx2, Self::Neon, Self::Scalar];

    /// The widest class of this processor.
    #[must_use]
    pub fn detect() -> Self {
        let known = DETECTED.load(Ordering::Relaxed);
        if known > 0 {
            return Self::ALL[usize::from(known - 1)];
        }
        let index = Self::ALL.iter().position(|c| c.is_available()).unwrap_or(Self::ALL.len() - 1);
        DETECTED.store(index as u8 + 1, Ordering::Relaxed);
        Self::ALL[index]
    }

    /// Whether this processor has it.
    #[must_use]
    pub fn is_available(self) -> bool {
        match self {
            Self::Scalar => true,
            Self::Neon => cfg!(target_arch = "aarch64"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => x86::Avx512::new().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => x86::Avx2::new().is_some(),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
        }
    }

    /// Runs `kernel` in this class, or in the scalar one where the processor lacks it.
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => match x86::Avx512::new() {
                Some(lanes) => lanes.run(kernel),
                None => kernel.run(Scalar),
            },
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => match x86::Avx2::new() {
                Some(lanes) => lanes.run(kernel),
                None => kernel.run(Scalar),
            },
            #[cfg(target_arch = "aarch64")]
            Self::Neon => kernel.run(neon::Neon),
            _ => kernel.run(Scalar),
        }
    }
}

impl fmt::Display for Class {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Avx512 => "avx512",
            Self::Avx2 => "avx2",
            Self::Neon => "neon",
            Self::Scalar => "scalar",
        })
    }
}
