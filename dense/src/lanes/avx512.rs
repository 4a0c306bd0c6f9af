//! AVX-512: sixteen lanes in a vector.
//!
//! This file, `avx2` and `neon` have the only `unsafe` of the crate: a value of [`Avx512`] exists only
//! after the processor was asked, so that the instructions behind its methods are there.

#![allow(unsafe_code, reason = "vector instructions; each block says why it is sound")]
#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "one reason for all: the value proves the feature, pointers come from references"
)]

use std::arch::x86_64::*;

use super::{Kernel, Lanes, WIDTH, operations};

/// Proof that the processor has AVX-512 F, BW, DQ and VL.
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx512(());

impl Avx512 {
    pub(super) fn new() -> Option<Self> {
        (is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl"))
        .then_some(Self(()))
    }

    pub(super) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
        fn compiled<K: Kernel>(lanes: Avx512, kernel: K) -> K::Output {
            kernel.run(lanes)
        }
        // Sound: `self` proves that the processor has these features.
        unsafe { compiled(self, kernel) }
    }
}

/// Prefetches data that is needed soon.
#[inline(always)]
pub(super) fn prefetch<T>(x: &T) {
    for line in (0..size_of::<T>()).step_by(64) {
        let line = std::ptr::from_ref(x).cast::<i8>().wrapping_add(line);
        // Sound whatever the pointer: nothing is read.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(line) }
    }
}

type F = __m512;
type I = __m512i;
type M = __mmask16;

/// Lane i of a is lane i, lane i of b is lane 16 + i.
const EVEN: [i32; WIDTH] = [0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30];
const ODD: [i32; WIDTH] = [1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31];
const FIRST_PAIRS: [i32; WIDTH] = [0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23];
const LAST_PAIRS: [i32; WIDTH] = [8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31];
/// Twelve bytes for each quarter.
const QUARTERS: [i32; WIDTH] = [0, 1, 2, 2, 3, 4, 5, 5, 6, 7, 8, 8, 9, 10, 11, 11];
/// Three bytes to four; a negative index gives zero.
const SPREAD: [i32; 4] = [
    i32::from_le_bytes([0, 1, 2, 128]),
    i32::from_le_bytes([3, 4, 5, 128]),
    i32::from_le_bytes([6, 7, 8, 128]),
    i32::from_le_bytes([9, 10, 11, 128]),
];

// Sound in every method below: `self` proves the features; loads and stores go through references to
// all that they touch; `gather` reads only what lies inside of its table.
impl Lanes for Avx512 {
    type F = F;
    type I = I;
    type M = M;

    #[inline(always)]
    fn prefetch<T>(self, x: &T) {
        prefetch(x);
    }

    operations! {
        splat(x: f32) -> F = unsafe { _mm512_set1_ps(x) };
        splat_int(x: i32) -> I = unsafe { _mm512_set1_epi32(x) };
        load(x: &[f32; WIDTH]) -> F = unsafe { _mm512_loadu_ps(x.as_ptr()) };
        store(v: F, x: &mut [f32; WIDTH]) = unsafe { _mm512_storeu_ps(x.as_mut_ptr(), v) };
        add(a: F, b: F) -> F = unsafe { _mm512_add_ps(a, b) };
        sub(a: F, b: F) -> F = unsafe { _mm512_sub_ps(a, b) };
        mul(a: F, b: F) -> F = unsafe { _mm512_mul_ps(a, b) };
        fma(a: F, b: F, c: F) -> F = unsafe { _mm512_fmadd_ps(a, b, c) };
        fnma(a: F, b: F, c: F) -> F = unsafe { _mm512_fnmadd_ps(a, b, c) };
        div(a: F, b: F) -> F = unsafe { _mm512_div_ps(a, b) };
        to_bits(a: F) -> I = unsafe { _mm512_castps_si512(a) };
        of_bits(a: I) -> F = unsafe { _mm512_castsi512_ps(a) };
        min(a: F, b: F) -> F = unsafe { _mm512_min_ps(a, b) };
        max(a: F, b: F) -> F = unsafe { _mm512_max_ps(a, b) };
        abs(a: F) -> F = unsafe { _mm512_abs_ps(a) };
        truncate(a: F) -> I = unsafe { _mm512_cvttps_epi32(a) };
        round(a: F) -> I = unsafe { _mm512_cvtps_epi32(a) };
        float(a: I) -> F = unsafe { _mm512_cvtepi32_ps(a) };
        less(a: F, b: F) -> M = unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b) };
        at_most(a: F, b: F) -> M = unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b) };
        select(mask: M, yes: F, no: F) -> F = unsafe { _mm512_mask_blend_ps(mask, no, yes) };
        select_int(mask: M, yes: I, no: I) -> I = unsafe { _mm512_mask_blend_epi32(mask, no, yes) };
        add_int(a: I, b: I) -> I = unsafe { _mm512_add_epi32(a, b) };
        sub_int(a: I, b: I) -> I = unsafe { _mm512_sub_epi32(a, b) };
        mul_int(a: I, b: I) -> I = unsafe { _mm512_mullo_epi32(a, b) };
        min_int(a: I, b: I) -> I = unsafe { _mm512_min_epi32(a, b) };
        max_int(a: I, b: I) -> I = unsafe { _mm512_max_epi32(a, b) };
        and_int(a: I, b: I) -> I = unsafe { _mm512_and_si512(a, b) };
        or_int(a: I, b: I) -> I = unsafe { _mm512_or_si512(a, b) };
        shift_up<N>(a: I) -> I = unsafe { _mm512_slli_epi32::<N>(a) };
        shift_down<N>(a: I) -> I = unsafe { _mm512_srli_epi32::<N>(a) };
        shift_down_signed<N>(a: I) -> I = unsafe { _mm512_srai_epi32::<N>(a) };
        above_int(a: I, b: I) -> M = unsafe { _mm512_cmpgt_epi32_mask(a, b) };
        below_int(a: I, b: I) -> M = unsafe { _mm512_cmplt_epu32_mask(a, b) };
        differ_int(a: I, b: I) -> M = unsafe { _mm512_cmpneq_epi32_mask(a, b) };
        both(a: M, b: M) -> M = a & b;
        either(a: M, b: M) -> M = a | b;
        but_not(a: M, b: M) -> M = a & !b;
        any(a: M) -> bool = a != 0;
        all(a: M) -> bool = a == !0;
        load_i16(x: &[i16; WIDTH]) -> I =
            unsafe { _mm512_cvtepi16_epi32(_mm256_loadu_si256(x.as_ptr().cast())) };
        store_i16(v: I, x: &mut [i16; WIDTH]) =
            unsafe { _mm256_storeu_si256(x.as_mut_ptr().cast(), _mm512_cvtepi32_epi16(v)) };
        load_u16(x: &[u16; WIDTH]) -> I =
            unsafe { _mm512_cvtepu16_epi32(_mm256_loadu_si256(x.as_ptr().cast())) };
        store_u16(v: I, x: &mut [u16; WIDTH]) =
            unsafe { _mm256_storeu_si256(x.as_mut_ptr().cast(), _mm512_cvtepi32_epi16(v)) };
        load_bytes(x: &[[u8; 4]; WIDTH]) -> I = unsafe { _mm512_loadu_si512(x.as_ptr().cast()) };
        store_bytes(v: I, x: &mut [[u8; 4]; WIDTH]) =
            unsafe { _mm512_storeu_si512(x.as_mut_ptr().cast(), v) };
    }

    #[inline(always)]
    fn gather(self, table: &[u64], index: I, mask: M) -> (I, I) {
        unsafe {
            let Some(last) = table.len().checked_sub(1) else {
                return (_mm512_setzero_si512(), _mm512_setzero_si512());
            };
            // Whatever the index, what is read lies in the table. Loads one by one, in pairs, are
            // twice as fast as the processor's own gather.
            let last = _mm512_set1_epi32(last.min(i32::MAX as usize) as i32);
            let inside = _mm512_cmple_epu32_mask(index, last);
            let mut at = [0_u32; WIDTH];
            _mm512_storeu_si512(at.as_mut_ptr().cast(), _mm512_min_epu32(index, last));
            let from: *const f64 = table.as_ptr().cast();
            let pair = |i: usize| {
                let low = _mm_load_sd(from.add(at[i] as usize));
                _mm_loadh_pd(low, from.add(at[i + 1] as usize))
            };
            let four = |i| _mm256_set_m128d(pair(i + 2), pair(i));
            let eight = |i| {
                let low = _mm512_castpd256_pd512(four(i));
                _mm512_castpd_si512(_mm512_insertf64x4::<1>(low, four(i + 4)))
            };
            let (first, last, mask) = (eight(0), eight(8), mask & inside);
            let (even, odd) =
                (_mm512_loadu_si512(EVEN.as_ptr().cast()), _mm512_loadu_si512(ODD.as_ptr().cast()));
            (
                _mm512_maskz_permutex2var_epi32(mask, first, even, last),
                _mm512_maskz_permutex2var_epi32(mask, first, odd, last),
            )
        }
    }

    #[inline(always)]
    fn load_colors(self, x: &[[u8; 3]; WIDTH]) -> I {
        unsafe {
            let bytes = _mm512_maskz_loadu_epi32(0x0fff, x.as_ptr().cast());
            let quarters = _mm512_loadu_si512(QUARTERS.as_ptr().cast());
            let spread = _mm512_broadcast_i32x4(_mm_loadu_si128(SPREAD.as_ptr().cast()));
            _mm512_shuffle_epi8(_mm512_permutexvar_epi32(quarters, bytes), spread)
        }
    }

    #[inline(always)]
    fn store_pairs(self, low: I, high: I, x: &mut [u64; WIDTH]) {
        unsafe {
            let first = _mm512_loadu_si512(FIRST_PAIRS.as_ptr().cast());
            let last = _mm512_loadu_si512(LAST_PAIRS.as_ptr().cast());
            let to = x.as_mut_ptr();
            _mm512_storeu_si512(to.cast(), _mm512_permutex2var_epi32(low, first, high));
            _mm512_storeu_si512(to.add(8).cast(), _mm512_permutex2var_epi32(low, last, high));
        }
    }

    #[inline(always)]
    fn color_difference(self, a: I, b: I) -> I {
        unsafe {
            let apart = _mm512_or_si512(_mm512_subs_epu8(a, b), _mm512_subs_epu8(b, a));
            let share = _mm512_set1_epi32(i32::from_le_bytes([1, 2, 1, 0]));
            let pairs = _mm512_maddubs_epi16(apart, share);
            _mm512_madd_epi16(pairs, _mm512_set1_epi16(1))
        }
    }
}
