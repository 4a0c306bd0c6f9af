//! Hamming distances, compiled with the processor's instruction that counts bits where it has one.
//!
//! A kernel is written once; both builds give the same numbers. The only file of the room with `unsafe`.
//! Knows nothing of what descriptors are compared for.

#![allow(unsafe_code, reason = "an instruction of a processor that was asked for it")]

#[cfg(target_arch = "x86_64")]
use covis_solvers::simd::Class;

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
        if Class::detect() != Class::Scalar && is_x86_feature_detected!("popcnt") {
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

/// Descriptors that are compared at once, one in each lane of a vector.
pub(super) const LANES: usize = 8;

/// A number for each lane.
pub(super) type Row = [u64; LANES];

/// Above all ranks.
pub(super) const NONE: u64 = u64::MAX;

/// A distance, which comes first in the order, and an index: of equal distances the first index is least.
#[inline(always)]
fn rank(distance: u64, index: usize) -> u64 {
    (distance << 32) | index as u64
}

/// Descriptors in blocks of [`LANES`], the same word of each side by side.
pub(super) struct Blocks {
    words: usize,
    rows: Vec<Row>,
    /// What is added to the distances of the last block: much where a lane has no descriptor.
    absent: Row,
}

impl Blocks {
    /// Of descriptors of `words` words one behind the other.
    pub(super) fn new(descriptors: &[u64], words: usize) -> Self {
        let count = descriptors.len() / words;
        let blocks = count.div_ceil(LANES);
        let mut rows = vec![[0; LANES]; blocks * words];
        for (j, descriptor) in descriptors.chunks_exact(words).enumerate() {
            for (w, &word) in descriptor.iter().enumerate() {
                rows[j / LANES * words + w][j % LANES] = word;
            }
        }
        let absent = std::array::from_fn(|lane| {
            let is_absent = blocks.saturating_sub(1) * LANES + lane >= count;
            if is_absent { u64::from(u32::MAX) } else { 0 }
        });
        Self { words, rows, absent }
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.rows.len() / self.words
    }
}

/// The best and the second best rank in each lane of descriptor `number`, by distance to those of `b`, with
/// their indices. `nearest` has for each of `b` the least rank of the descriptors so far, by their numbers.
#[inline(always)]
pub(super) fn ranked(a: &[u64], number: usize, b: &Blocks, nearest: &mut [Row]) -> [Row; 2] {
    #[cfg(target_arch = "x86_64")]
    if Class::detect() == Class::Avx512 && is_x86_feature_detected!("avx512vpopcntdq") {
        // SAFETY: the processor was asked.
        return unsafe { avx512::ranked(a, number, b, nearest) };
    }
    one_by_one(a, number, b, nearest)
}

#[inline(always)]
fn one_by_one(a: &[u64], number: usize, b: &Blocks, nearest: &mut [Row]) -> [Row; 2] {
    let [mut best, mut second] = [[NONE; LANES]; 2];
    let blocks = nearest.len();
    for (block, (rows, nearest)) in b.rows.chunks_exact(b.words).zip(nearest).enumerate() {
        let mut distance = if block + 1 == blocks { b.absent } else { [0; LANES] };
        for (&word, row) in a.iter().zip(rows) {
            for lane in 0..LANES {
                distance[lane] += u64::from((word ^ row[lane]).count_ones());
            }
        }
        for lane in 0..LANES {
            let to_b = rank(distance[lane], block * LANES + lane);
            second[lane] = second[lane].min(best[lane].max(to_b));
            best[lane] = best[lane].min(to_b);
            nearest[lane] = nearest[lane].min(rank(distance[lane], number));
        }
    }
    [best, second]
}

/// The same with the processor's instruction that counts the bits of eight words, five times as fast.
#[cfg(target_arch = "x86_64")]
mod avx512 {
    use std::arch::x86_64::{
        __m512i, _mm512_add_epi64, _mm512_loadu_si512, _mm512_max_epu64, _mm512_min_epu64,
        _mm512_or_si512, _mm512_popcnt_epi64, _mm512_set1_epi64, _mm512_setr_epi64,
        _mm512_setzero_si512, _mm512_slli_epi64, _mm512_storeu_si512, _mm512_xor_si512,
    };

    use super::{Blocks, LANES, NONE, Row};

    #[target_feature(enable = "avx512f")]
    fn load(row: &Row) -> __m512i {
        // SAFETY: a row has the bytes of a vector, and the load needs no alignment.
        unsafe { _mm512_loadu_si512(row.as_ptr().cast()) }
    }

    #[target_feature(enable = "avx512f")]
    fn store(row: &mut Row, vector: __m512i) {
        // SAFETY: as in `load`.
        unsafe { _mm512_storeu_si512(row.as_mut_ptr().cast(), vector) }
    }

    #[target_feature(enable = "avx512f,avx512vpopcntdq")]
    pub(super) fn ranked(a: &[u64], number: usize, b: &Blocks, nearest: &mut [Row]) -> [Row; 2] {
        let lanes = _mm512_setr_epi64(0, 1, 2, 3, 4, 5, 6, 7);
        let own = _mm512_set1_epi64(number as i64);
        let [mut best, mut second] = [_mm512_set1_epi64(NONE as i64); 2];
        let blocks = nearest.len();
        for (block, (rows, nearest)) in b.rows.chunks_exact(b.words).zip(nearest).enumerate() {
            let is_last = block + 1 == blocks;
            let mut distance = if is_last { load(&b.absent) } else { _mm512_setzero_si512() };
            for (&word, row) in a.iter().zip(rows) {
                let different = _mm512_xor_si512(_mm512_set1_epi64(word as i64), load(row));
                distance = _mm512_add_epi64(distance, _mm512_popcnt_epi64(different));
            }
            let first = _mm512_slli_epi64::<32>(distance);
            let index = _mm512_add_epi64(lanes, _mm512_set1_epi64((block * LANES) as i64));
            let to_b = _mm512_or_si512(first, index);
            second = _mm512_min_epu64(second, _mm512_max_epu64(best, to_b));
            best = _mm512_min_epu64(best, to_b);
            let to_a = _mm512_min_epu64(load(nearest), _mm512_or_si512(first, own));
            store(nearest, to_a);
        }
        let mut found = [[0; LANES]; 2];
        store(&mut found[0], best);
        store(&mut found[1], second);
        found
    }
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
    fn lanes_are_ranked_as_one_by_one() {
        let word = |k: usize| (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(23);
        for (words, count) in [(2, 1), (4, 8), (4, 75), (64, 9)] {
            let a: Vec<u64> = (0..words * count).map(word).collect();
            let b: Vec<u64> = (0..words * count).map(|k| word(k) ^ word(k + 900)).collect();
            let b = Blocks::new(&b, words);
            let mut nearest = [vec![[NONE; LANES]; b.len()], vec![[NONE; LANES]; b.len()]];
            for (number, a) in a.chunks_exact(words).enumerate() {
                let [one, other] = &mut nearest;
                assert_eq!(ranked(a, number, &b, one), one_by_one(a, number, &b, other));
            }
            assert_eq!(nearest[0], nearest[1]);
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
