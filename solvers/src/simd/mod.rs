//! Eight lanes of f64 under one name: AVX-512, AVX2 with FMA, NEON, or plain arrays.
//!
//! A kernel is written once over `Lanes` and compiled for each class; [`Class::detect`] picks the
//! widest that the processor has, at run time, or the one that [`VARIABLE`] names. Every class has eight
//! lanes, so that the order of operations is the same everywhere; the classes with fused multiply-add
//! give the same bits, the scalar one rounds products on their own. Nothing here knows what the numbers mean.

/// Methods of [`Lanes`] that map vectors to one, from a table `name(arguments) = value;`.
macro_rules! operations {
    ($($name:ident($($x:ident),*) = $value:expr;)*) => {$(
        #[inline(always)]
        fn $name(self, $($x: Self::V),*) -> Self::V {
            $value
        }
    )*};
}

/// An array of `count` values, each from its number, as a loop. A closure would do, but the compiler does
/// not always inline `std::array::from_fn`, and then each operation becomes a call.
macro_rules! each {
    ($i:ident < $count:expr, $first:expr => $value:expr) => {{
        let mut values = [$first; $count];
        for $i in 0..$count {
            values[$i] = $value;
        }
        values
    }};
}

#[cfg(target_arch = "aarch64")]
mod neon;
mod scalar;
#[cfg(test)]
mod tests;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::fmt;
use std::ops::{Deref, DerefMut};
use std::str::FromStr;
use std::sync::LazyLock;

pub(crate) use scalar::Scalar;

/// How many lanes a vector has, in every class.
pub(crate) const WIDTH: usize = 8;

/// One vector as memory holds it.
pub(crate) type Row = [f64; WIDTH];

/// A row that begins on a cache line: a 512-bit access that crosses a line costs two, so buffers that
/// kernels read and write again and again are made of these.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Line(pub(crate) Row);

impl Line {
    /// Eight zeros.
    pub(crate) const ZERO: Self = Self([0.0; WIDTH]);
}

impl Deref for Line {
    type Target = Row;

    #[inline(always)]
    fn deref(&self) -> &Row {
        &self.0
    }
}

impl DerefMut for Line {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut Row {
        &mut self.0
    }
}

/// Operations on vectors of eight lanes. The value proves that the processor has the class.
pub(crate) trait Lanes: Copy {
    /// A vector in registers.
    type V: Copy;
    /// Whether 24 vectors and a few operands stay in registers at a time.
    const MANY_REGISTERS: bool = false;
    /// Whether it is for processors without wide vectors only: nothing is compiled for it twice.
    const IS_FALLBACK: bool = false;

    /// `x` in every lane.
    fn splat(self, x: f64) -> Self::V;
    fn load(self, x: &Row) -> Self::V;
    fn store(self, v: Self::V, x: &mut Row);
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    fn div(self, a: Self::V, b: Self::V) -> Self::V;
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
    #[inline(always)]
    fn fnma_one(self, a: f64, b: f64, c: f64) -> f64 {
        (-a).mul_add(b, c)
    }
    /// The 8 × 8 matrix with `rows` as columns.
    fn transpose(self, rows: [Self::V; WIDTH]) -> [Self::V; WIDTH];
    /// Runs `work` as a function that is not inlined, compiled for the class.
    fn call<S: Subroutine<Self>>(self, work: S) -> S::Output;
}

/// Work that several kernels call and that is compiled once, not into each of them. `run` must be
/// `#[inline(always)]` down to the operations.
pub(crate) trait Subroutine<L: Lanes> {
    /// What it returns.
    type Output;
    /// Does the work.
    fn run(self, lanes: L) -> Self::Output;
}

/// Work that runs in one class. `run` must be `#[inline(always)]` down to the operations.
pub(crate) trait Kernel {
    type Output;
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

/// The environment variable that names the class to use, so that one machine can measure all that it has.
pub const VARIABLE: &str = "COVIS_SIMD";

impl Class {
    /// All classes, the widest first.
    pub const ALL: [Self; 4] = [Self::Avx512, Self::Avx2, Self::Neon, Self::Scalar];

    /// The class that [`VARIABLE`] names, or else the widest of this processor. The variable is read once;
    /// a name that is unknown, or of a class that this processor lacks, changes nothing.
    #[must_use]
    pub fn detect() -> Self {
        static DETECTED: LazyLock<Class> = LazyLock::new(|| {
            let named = std::env::var(VARIABLE).ok().and_then(|name| name.parse().ok());
            let mut classes = named.into_iter().chain(Class::ALL);
            classes.find(|class| class.is_available()).unwrap_or(Class::Scalar)
        });
        *DETECTED
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
            Self::Avx512 if let Some(lanes) = x86::Avx512::new() => lanes.run(kernel),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 if let Some(lanes) = x86::Avx2::new() => lanes.run(kernel),
            #[cfg(target_arch = "aarch64")]
            Self::Neon => kernel.run(neon::Neon),
            _ => kernel.run(Scalar),
        }
    }
}

/// The name of no [`Class`].
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("the instruction sets are avx512, avx2, neon and scalar")]
pub struct UnknownClass;

impl FromStr for Class {
    type Err = UnknownClass;

    fn from_str(name: &str) -> Result<Self, UnknownClass> {
        Self::ALL.into_iter().find(|class| class.to_string() == name).ok_or(UnknownClass)
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
