//! AVX2: sixteen lanes in two vectors of eight.
//!
//! A value of [`Avx2`] exists only after the processor was asked, so that the instructions behind its
//! methods are there. Each method gives the bits of the plain arrays.

#![allow(unsafe_code, reason = "vector instructions; each block says why it is sound")]
#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "one reason for all: the value proves the feature, pointers come from references"
)]

use std::arch::x86_64::*;

use super::avx512::prefetch;
use super::{Kernel, Lanes, WIDTH, operations};

/// Proof that the processor has AVX2 and FMA.
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx2(());

impl Avx2 {
    pub(super) fn new() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self(()))
    }

    pub(super) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "avx2,fma")]
        fn compiled<K: Kernel>(lanes: Avx2, kernel: K) -> K::Output {
            kernel.run(lanes)
        }
        // Sound: `self` proves that the processor has these features.
        unsafe { compiled(self, kernel) }
    }
}

type F = [__m256; 2];
type I = [__m256i; 2];
/// All bits of a lane, or none.
type M = [__m256i; 2];

/// The same of both vectors. A closure would do, but the compiler does not always inline
/// `std::array::from_fn`, and then each instruction becomes a call.
macro_rules! pair {
    ($i:ident => $value:expr) => {
        [
            {
                let $i = 0;
                $value
            },
            {
                let $i = 1;
                $value
            },
        ]
    };
}

/// Three bytes to four, from the first of sixteen bytes; a negative index gives zero.
const SPREAD: [i8; 16] = [0, 1, 2, -1, 3, 4, 5, -1, 6, 7, 8, -1, 9, 10, 11, -1];
/// As [`SPREAD`], from the fifth byte.
const SPREAD_LAST: [i8; 16] = [4, 5, 6, -1, 7, 8, 9, -1, 10, 11, 12, -1, 13, 14, 15, -1];

// Sound in every method below: `self` proves the features; loads and stores go through references to
// all that they touch; `gather` reads only what lies inside of its table.
impl Lanes for Avx2 {
    type F = F;
    type I = I;
    type M = M;

    #[inline(always)]
    fn prefetch<T>(self, x: &T) {
        prefetch(x);
    }

    operations! {
        splat(x: f32) -> F = unsafe { [_mm256_set1_ps(x); 2] };
        splat_int(x: i32) -> I = unsafe { [_mm256_set1_epi32(x); 2] };
        load(x: &[f32; WIDTH]) -> F = pair!(i => unsafe { _mm256_loadu_ps(x.as_ptr().add(8 * i)) });
        store(v: F, x: &mut [f32; WIDTH]) = unsafe {
            _mm256_storeu_ps(x.as_mut_ptr(), v[0]);
            _mm256_storeu_ps(x.as_mut_ptr().add(8), v[1]);
        };
        add(a: F, b: F) -> F = pair!(i => unsafe { _mm256_add_ps(a[i], b[i]) });
        sub(a: F, b: F) -> F = pair!(i => unsafe { _mm256_sub_ps(a[i], b[i]) });
        mul(a: F, b: F) -> F = pair!(i => unsafe { _mm256_mul_ps(a[i], b[i]) });
        fma(a: F, b: F, c: F) -> F = pair!(i => unsafe { _mm256_fmadd_ps(a[i], b[i], c[i]) });
        fnma(a: F, b: F, c: F) -> F = pair!(i => unsafe { _mm256_fnmadd_ps(a[i], b[i], c[i]) });
        div(a: F, b: F) -> F = pair!(i => unsafe { _mm256_div_ps(a[i], b[i]) });
        to_bits(a: F) -> I = pair!(i => unsafe { _mm256_castps_si256(a[i]) });
        of_bits(a: I) -> F = pair!(i => unsafe { _mm256_castsi256_ps(a[i]) });
        min(a: F, b: F) -> F = pair!(i => unsafe { _mm256_min_ps(a[i], b[i]) });
        max(a: F, b: F) -> F = pair!(i => unsafe { _mm256_max_ps(a[i], b[i]) });
        abs(a: F) -> F = pair!(i => unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), a[i]) });
        truncate(a: F) -> I = pair!(i => unsafe { _mm256_cvttps_epi32(a[i]) });
        round(a: F) -> I = pair!(i => unsafe { _mm256_cvtps_epi32(a[i]) });
        float(a: I) -> F = pair!(i => unsafe { _mm256_cvtepi32_ps(a[i]) });
        less(a: F, b: F) -> M = pair!(i => unsafe {
            _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(a[i], b[i]))
        });
        at_most(a: F, b: F) -> M = pair!(i => unsafe {
            _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LE_OQ>(a[i], b[i]))
        });
        select(mask: M, yes: F, no: F) -> F = pair!(i => unsafe {
            _mm256_blendv_ps(no[i], yes[i], _mm256_castsi256_ps(mask[i]))
        });
        select_int(mask: M, yes: I, no: I) -> I =
            pair!(i => unsafe { _mm256_blendv_epi8(no[i], yes[i], mask[i]) });
        add_int(a: I, b: I) -> I = pair!(i => unsafe { _mm256_add_epi32(a[i], b[i]) });
        sub_int(a: I, b: I) -> I = pair!(i => unsafe { _mm256_sub_epi32(a[i], b[i]) });
        mul_int(a: I, b: I) -> I = pair!(i => unsafe { _mm256_mullo_epi32(a[i], b[i]) });
        min_int(a: I, b: I) -> I = pair!(i => unsafe { _mm256_min_epi32(a[i], b[i]) });
        max_int(a: I, b: I) -> I = pair!(i => unsafe { _mm256_max_epi32(a[i], b[i]) });
        and_int(a: I, b: I) -> I = pair!(i => unsafe { _mm256_and_si256(a[i], b[i]) });
        or_int(a: I, b: I) -> I = pair!(i => unsafe { _mm256_or_si256(a[i], b[i]) });
        shift_up<N>(a: I) -> I = pair!(i => unsafe { _mm256_sll_epi32(a[i], count(N)) });
        shift_down<N>(a: I) -> I = pair!(i => unsafe { _mm256_srl_epi32(a[i], count(N)) });
        shift_down_signed<N>(a: I) -> I = pair!(i => unsafe { _mm256_sra_epi32(a[i], count(N)) });
        above_int(a: I, b: I) -> M = pair!(i => unsafe { _mm256_cmpgt_epi32(a[i], b[i]) });
        // The comparison is signed: both are moved by half of the range.
        below_int(a: I, b: I) -> M = pair!(i => unsafe {
            let half = _mm256_set1_epi32(i32::MIN);
            _mm256_cmpgt_epi32(_mm256_xor_si256(b[i], half), _mm256_xor_si256(a[i], half))
        });
        differ_int(a: I, b: I) -> M = pair!(i => unsafe {
            _mm256_xor_si256(_mm256_cmpeq_epi32(a[i], b[i]), _mm256_set1_epi32(-1))
        });
        both(a: M, b: M) -> M = pair!(i => unsafe { _mm256_and_si256(a[i], b[i]) });
        either(a: M, b: M) -> M = pair!(i => unsafe { _mm256_or_si256(a[i], b[i]) });
        but_not(a: M, b: M) -> M = pair!(i => unsafe { _mm256_andnot_si256(b[i], a[i]) });
        any(a: M) -> bool = unsafe { _mm256_movemask_epi8(_mm256_or_si256(a[0], a[1])) != 0 };
        all(a: M) -> bool = unsafe { _mm256_movemask_epi8(_mm256_and_si256(a[0], a[1])) == -1 };
        load_i16(x: &[i16; WIDTH]) -> I =
            pair!(i => unsafe { _mm256_cvtepi16_epi32(half(x, i)) });
        store_i16(v: I, x: &mut [i16; WIDTH]) =
            unsafe { _mm256_storeu_si256(x.as_mut_ptr().cast(), low_halves(v)) };
        load_u16(x: &[u16; WIDTH]) -> I =
            pair!(i => unsafe { _mm256_cvtepu16_epi32(half(x, i)) });
        store_u16(v: I, x: &mut [u16; WIDTH]) =
            unsafe { _mm256_storeu_si256(x.as_mut_ptr().cast(), low_halves(v)) };
        load_bytes(x: &[[u8; 4]; WIDTH]) -> I =
            pair!(i => unsafe { _mm256_loadu_si256(x.as_ptr().add(8 * i).cast()) });
        store_bytes(v: I, x: &mut [[u8; 4]; WIDTH]) = unsafe {
            _mm256_storeu_si256(x.as_mut_ptr().cast(), v[0]);
            _mm256_storeu_si256(x.as_mut_ptr().add(8).cast(), v[1]);
        };
    }

    #[inline(always)]
    fn gather(self, table: &[u64], index: I, mask: M) -> (I, I) {
        unsafe {
            let Some(last) = table.len().checked_sub(1) else {
                return ([_mm256_setzero_si256(); 2], [_mm256_setzero_si256(); 2]);
            };
            // Whatever the index, what is read lies in the table.
            let last = _mm256_set1_epi32(last.min(i32::MAX as usize) as i32);
            let from = table.as_ptr();
            let first = gather_eight(from, last, index[0], mask[0]);
            let second = gather_eight(from, last, index[1], mask[1]);
            ([first.0, second.0], [first.1, second.1])
        }
    }

    #[inline(always)]
    fn load_colors(self, x: &[[u8; 3]; WIDTH]) -> I {
        unsafe {
            // Twelve bytes are four lanes; sixteen from the last twelve would end behind the colors.
            let bytes: *const u8 = x.as_ptr().cast();
            let spread = _mm256_broadcastsi128_si256(_mm_loadu_si128(SPREAD.as_ptr().cast()));
            let spread_last = _mm_loadu_si128(SPREAD_LAST.as_ptr().cast());
            let first = _mm256_loadu2_m128i(bytes.add(12).cast(), bytes.cast());
            let third = _mm_loadu_si128(bytes.add(24).cast());
            let third = _mm_shuffle_epi8(third, _mm256_castsi256_si128(spread));
            let last = _mm_shuffle_epi8(_mm_loadu_si128(bytes.add(32).cast()), spread_last);
            [_mm256_shuffle_epi8(first, spread), _mm256_set_m128i(last, third)]
        }
    }

    #[inline(always)]
    fn store_pairs(self, low: I, high: I, x: &mut [u64; WIDTH]) {
        unsafe {
            for i in 0..2 {
                let outer = _mm256_unpacklo_epi32(low[i], high[i]);
                let inner = _mm256_unpackhi_epi32(low[i], high[i]);
                let to = x.as_mut_ptr().add(8 * i);
                _mm256_storeu_si256(to.cast(), _mm256_permute2x128_si256::<0x20>(outer, inner));
                let to = to.add(4);
                _mm256_storeu_si256(to.cast(), _mm256_permute2x128_si256::<0x31>(outer, inner));
            }
        }
    }

    #[inline(always)]
    fn color_difference(self, a: I, b: I) -> I {
        pair!(i => unsafe {
            let apart = _mm256_or_si256(_mm256_subs_epu8(a[i], b[i]), _mm256_subs_epu8(b[i], a[i]));
            let share = _mm256_set1_epi32(i32::from_le_bytes([1, 2, 1, 0]));
            _mm256_madd_epi16(_mm256_maddubs_epi16(apart, share), _mm256_set1_epi16(1))
        })
    }
}

/// A number of bits to shift by. It is constant, so that shifts have it in the instruction.
#[inline(always)]
fn count(bits: u32) -> __m128i {
    unsafe { _mm_cvtsi32_si128(bits.cast_signed()) }
}

/// The low and the high halves of `from[index]` of eight lanes; 0 where the mask says no or the index is
/// above `last`.
///
/// # Safety
/// From 0 to `last`, `from` can be read.
#[inline(always)]
unsafe fn gather_eight(
    from: *const u64,
    last: __m256i,
    index: __m256i,
    mask: __m256i,
) -> (__m256i, __m256i) {
    unsafe {
        let inside = _mm256_min_epu32(index, last);
        let mask = _mm256_and_si256(mask, _mm256_cmpeq_epi32(inside, index));
        let mut at = [0_u32; 8];
        _mm256_storeu_si256(at.as_mut_ptr().cast(), inside);
        let outer = _mm256_set_m128d(two(from, at[4], at[5]), two(from, at[0], at[1]));
        let inner = _mm256_set_m128d(two(from, at[6], at[7]), two(from, at[2], at[3]));
        let (outer, inner) = (_mm256_castpd_ps(outer), _mm256_castpd_ps(inner));
        let low = _mm256_castps_si256(_mm256_shuffle_ps::<0x88>(outer, inner));
        let high = _mm256_castps_si256(_mm256_shuffle_ps::<0xdd>(outer, inner));
        (_mm256_and_si256(low, mask), _mm256_and_si256(high, mask))
    }
}

/// Two elements of a table.
///
/// # Safety
/// Both can be read.
#[inline(always)]
unsafe fn two(from: *const u64, i: u32, j: u32) -> __m128d {
    let from: *const f64 = from.cast();
    unsafe { _mm_loadh_pd(_mm_load_sd(from.add(i as usize)), from.add(j as usize)) }
}

/// The first or the last eight numbers, of 16 bits each.
#[inline(always)]
fn half<T>(x: &[T; WIDTH], which: usize) -> __m128i {
    const { assert!(size_of::<T>() == 2, "two bytes each") };
    unsafe { _mm_loadu_si128(x.as_ptr().add(8 * which).cast()) }
}

/// The low halves of all lanes, in their order.
#[inline(always)]
fn low_halves(v: I) -> __m256i {
    unsafe {
        let low = _mm256_set1_epi32(0xffff);
        let (a, b) = (_mm256_and_si256(v[0], low), _mm256_and_si256(v[1], low));
        // Packing goes by quarters of the vectors.
        _mm256_permute4x64_epi64::<0xd8>(_mm256_packus_epi32(a, b))
    }
}
