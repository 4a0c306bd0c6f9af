//! Hamming distances, compiled with the processor's instruction that counts bits where it has one.
//!
//! A kernel is written once; both builds give the same numbers. The only file of the room with `unsafe`.
//! Knows nothing of what descriptors are compared for.

#![allow(unsafe_code, reason = "an instruction of a processor that was asked for it")]

/// Work that is compiled with and without the instruction. `run` must be `#[inline(always)]`, and so
/// must what it calls in its loops.
pub(super) trait Kernel {
    /// What it returns.
    type Output;
    /// Does the work.
    fn run(self) -> Self::Output;
}

/// Runs a kernel with the best build that this processor can run.
pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "popcnt")]
        fn compiled<K: Kernel>(kernel: K) -> K::Output {
            kernel.run()
        }
        if is_x86_feature_detected!("popcnt") {
            // SAFETY: the processor was asked.
            return unsafe { compiled(kernel) };
        }
    }
    kernel.run()
}

/// Number of different bits of two descriptors of the same number of words.
#[inline(always)]
pub(super) fn distance(a: &[u64], b: &[u64]) -> u32 {
    // 256 bits is what most descriptors have; the loop over any number of words takes twice as long.
    if let (&[a0, a1, a2, a3], &[b0, b1, b2, b3]) = (a, b) {
        return (a0 ^ b0).count_ones()
            + (a1 ^ b1).count_ones()
            + (a2 ^ b2).count_ones()
            + (a3 ^ b3).count_ones();
    }
    a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct All<'a>(&'a [u64], &'a [u64]);

    impl Kernel for All<'_> {
        type Output = u32;
        #[inline(always)]
        fn run(self) -> u32 {
            distance(self.0, self.1)
        }
    }

    #[test]
    fn both_builds_count_the_same_bits() {
        for words in [2, 4, 8] {
            let a: Vec<u64> =
                (1..=words).map(|k: u64| k.wrapping_mul(0x9e37_79b9_7f4a_7c15)).collect();
            let b: Vec<u64> = a.iter().map(|x| x.rotate_left(7) ^ 0xff).collect();
            let by_bit: u32 = a
                .iter()
                .zip(&b)
                .flat_map(|(x, y)| (0..64).map(move |k| u32::from((x >> k) & 1 != (y >> k) & 1)))
                .sum();
            assert_eq!(run(All(&a, &b)), by_bit);
            assert_eq!(All(&a, &b).run(), by_bit);
        }
    }
}
