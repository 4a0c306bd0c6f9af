//! AVX-512 and AVX2 with FMA.
//!
//! This file and `neon` have the only `unsafe` of the crate: a value of [`Avx512`] or [`Avx2`] exists
//! only after the processor was asked, so that the instructions behind its methods are there.

#![allow(
    unsafe_code,
    clippy::undocumented_unsafe_blocks,
    reason = "vector instructions; one reason for all blocks: the value proves the feature"
)]

use std::arch::x86_64::*;

use super::{Kernel, Lanes, Row, Subroutine, WIDTH};

/// Proof that the processor has AVX-512 F and DQ.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx512(());

/// Proof that the processor has AVX2 and FMA.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(());

impl Avx512 {
    pub(crate) fn new() -> Option<Self> {
        let more = is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq");
        (more && Avx2::new().is_some()).then_some(Self(()))
    }

    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "avx512f,avx512dq,avx2,fma")]
        fn compiled<K: Kernel>(lanes: Avx512, kernel: K) -> K::Output {
            kernel.run(lanes)
        }
        // Sound: `self` proves that the processor has these features.
        unsafe { compiled(self, kernel) }
    }
}

impl Avx2 {
    pub(crate) fn new() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self(()))
    }

    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "avx2,fma")]
        fn compiled<K: Kernel>(lanes: Avx2, kernel: K) -> K::Output {
            kernel.run(lanes)
        }
        // Sound: `self` proves that the processor has these features.
        unsafe { compiled(self, kernel) }
    }
}

// Sound in every method below: `self` proves the feature, and loads and stores go through
// references to eight f64.
impl Lanes for Avx512 {
    type V = __m512d;
    const MANY_REGISTERS: bool = true;

    #[inline(always)]
    fn splat(self, x: f64) -> __m512d {
        unsafe { _mm512_set1_pd(x) }
    }
    #[inline(always)]
    fn load(self, x: &Row) -> __m512d {
        unsafe { _mm512_loadu_pd(x.as_ptr()) }
    }
    #[inline(always)]
    fn store(self, v: __m512d, x: &mut Row) {
        unsafe { _mm512_storeu_pd(x.as_mut_ptr(), v) }
    }
    operations! {
        add(a, b) = unsafe { _mm512_add_pd(a, b) };
        sub(a, b) = unsafe { _mm512_sub_pd(a, b) };
        mul(a, b) = unsafe { _mm512_mul_pd(a, b) };
        div(a, b) = unsafe { _mm512_div_pd(a, b) };
        sqrt(a) = unsafe { _mm512_sqrt_pd(a) };
        max(a, b) = unsafe { _mm512_max_pd(a, b) };
        min(a, b) = unsafe { _mm512_min_pd(a, b) };
        fma(a, b, c) = unsafe { _mm512_fmadd_pd(a, b, c) };
        fnma(a, b, c) = unsafe { _mm512_fnmadd_pd(a, b, c) };
    }
    #[inline(always)]
    fn select(self, mask: __m512d, yes: __m512d, no: __m512d) -> __m512d {
        unsafe {
            let positive = _mm512_cmp_pd_mask::<_CMP_GT_OQ>(mask, _mm512_setzero_pd());
            _mm512_mask_blend_pd(positive, no, yes)
        }
    }
    #[inline(always)]
    fn call<S: Subroutine<Self>>(self, work: S) -> S::Output {
        #[target_feature(enable = "avx512f,avx512dq,avx2,fma")]
        #[inline(never)]
        fn compiled<S: Subroutine<Avx512>>(lanes: Avx512, work: S) -> S::Output {
            work.run(lanes)
        }
        unsafe { compiled(self, work) }
    }
    #[inline(always)]
    fn transpose(self, r: [__m512d; WIDTH]) -> [__m512d; WIDTH] {
        unsafe {
            // Pairs of lanes, then 128-bit quarters twice.
            let t0 = _mm512_unpacklo_pd(r[0], r[1]);
            let t1 = _mm512_unpackhi_pd(r[0], r[1]);
            let t2 = _mm512_unpacklo_pd(r[2], r[3]);
            let t3 = _mm512_unpackhi_pd(r[2], r[3]);
            let t4 = _mm512_unpacklo_pd(r[4], r[5]);
            let t5 = _mm512_unpackhi_pd(r[4], r[5]);
            let t6 = _mm512_unpacklo_pd(r[6], r[7]);
            let t7 = _mm512_unpackhi_pd(r[6], r[7]);
            let a0 = _mm512_shuffle_f64x2::<0x88>(t0, t2);
            let a1 = _mm512_shuffle_f64x2::<0x88>(t1, t3);
            let a2 = _mm512_shuffle_f64x2::<0xdd>(t0, t2);
            let a3 = _mm512_shuffle_f64x2::<0xdd>(t1, t3);
            let b0 = _mm512_shuffle_f64x2::<0x88>(t4, t6);
            let b1 = _mm512_shuffle_f64x2::<0x88>(t5, t7);
            let b2 = _mm512_shuffle_f64x2::<0xdd>(t4, t6);
            let b3 = _mm512_shuffle_f64x2::<0xdd>(t5, t7);
            [
                _mm512_shuffle_f64x2::<0x88>(a0, b0),
                _mm512_shuffle_f64x2::<0x88>(a1, b1),
                _mm512_shuffle_f64x2::<0x88>(a2, b2),
                _mm512_shuffle_f64x2::<0x88>(a3, b3),
                _mm512_shuffle_f64x2::<0xdd>(a0, b0),
                _mm512_shuffle_f64x2::<0xdd>(a1, b1),
                _mm512_shuffle_f64x2::<0xdd>(a2, b2),
                _mm512_shuffle_f64x2::<0xdd>(a3, b3),
            ]
        }
    }
}

impl Avx2 {
    #[inline(always)]
    fn transpose4(self, r: [__m256d; 4]) -> [__m256d; 4] {
        unsafe {
            let t0 = _mm256_unpacklo_pd(r[0], r[1]);
            let t1 = _mm256_unpackhi_pd(r[0], r[1]);
            let t2 = _mm256_unpacklo_pd(r[2], r[3]);
            let t3 = _mm256_unpackhi_pd(r[2], r[3]);
            [
                _mm256_permute2f128_pd::<0x20>(t0, t2),
                _mm256_permute2f128_pd::<0x20>(t1, t3),
                _mm256_permute2f128_pd::<0x31>(t0, t2),
                _mm256_permute2f128_pd::<0x31>(t1, t3),
            ]
        }
    }
}

type Pair = [__m256d; 2];

impl Lanes for Avx2 {
    type V = Pair;

    #[inline(always)]
    fn splat(self, x: f64) -> Pair {
        unsafe { [_mm256_set1_pd(x); 2] }
    }
    #[inline(always)]
    fn load(self, x: &Row) -> Pair {
        unsafe { [_mm256_loadu_pd(x.as_ptr()), _mm256_loadu_pd(x.as_ptr().add(4))] }
    }
    #[inline(always)]
    fn store(self, v: Pair, x: &mut Row) {
        unsafe {
            _mm256_storeu_pd(x.as_mut_ptr(), v[0]);
            _mm256_storeu_pd(x.as_mut_ptr().add(4), v[1]);
        }
    }
    operations! {
        add(a, b) = unsafe { [_mm256_add_pd(a[0], b[0]), _mm256_add_pd(a[1], b[1])] };
        sub(a, b) = unsafe { [_mm256_sub_pd(a[0], b[0]), _mm256_sub_pd(a[1], b[1])] };
        mul(a, b) = unsafe { [_mm256_mul_pd(a[0], b[0]), _mm256_mul_pd(a[1], b[1])] };
        div(a, b) = unsafe { [_mm256_div_pd(a[0], b[0]), _mm256_div_pd(a[1], b[1])] };
        sqrt(a) = unsafe { [_mm256_sqrt_pd(a[0]), _mm256_sqrt_pd(a[1])] };
        max(a, b) = unsafe { [_mm256_max_pd(a[0], b[0]), _mm256_max_pd(a[1], b[1])] };
        min(a, b) = unsafe { [_mm256_min_pd(a[0], b[0]), _mm256_min_pd(a[1], b[1])] };
        fma(a, b, c) =
            unsafe { [_mm256_fmadd_pd(a[0], b[0], c[0]), _mm256_fmadd_pd(a[1], b[1], c[1])] };
        fnma(a, b, c) =
            unsafe { [_mm256_fnmadd_pd(a[0], b[0], c[0]), _mm256_fnmadd_pd(a[1], b[1], c[1])] };
    }
    #[inline(always)]
    fn select(self, mask: Pair, yes: Pair, no: Pair) -> Pair {
        unsafe {
            let zero = _mm256_setzero_pd();
            [
                _mm256_blendv_pd(no[0], yes[0], _mm256_cmp_pd::<_CMP_GT_OQ>(mask[0], zero)),
                _mm256_blendv_pd(no[1], yes[1], _mm256_cmp_pd::<_CMP_GT_OQ>(mask[1], zero)),
            ]
        }
    }
    #[inline(always)]
    fn call<S: Subroutine<Self>>(self, work: S) -> S::Output {
        #[target_feature(enable = "avx2,fma")]
        #[inline(never)]
        fn compiled<S: Subroutine<Avx2>>(lanes: Avx2, work: S) -> S::Output {
            work.run(lanes)
        }
        unsafe { compiled(self, work) }
    }
    #[inline(always)]
    fn transpose(self, r: [Pair; WIDTH]) -> [Pair; WIDTH] {
        // Written out: a closure that is called four times is not compiled for the class.
        let a = self.transpose4([r[0][0], r[1][0], r[2][0], r[3][0]]);
        let b = self.transpose4([r[4][0], r[5][0], r[6][0], r[7][0]]);
        let c = self.transpose4([r[0][1], r[1][1], r[2][1], r[3][1]]);
        let d = self.transpose4([r[4][1], r[5][1], r[6][1], r[7][1]]);
        [
            [a[0], b[0]],
            [a[1], b[1]],
            [a[2], b[2]],
            [a[3], b[3]],
            [c[0], d[0]],
            [c[1], d[1]],
            [c[2], d[2]],
            [c[3], d[3]],
        ]
    }
}
