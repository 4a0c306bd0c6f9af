//! NEON, which every aarch64 processor has: sixteen lanes in four vectors of four.
//!
//! Nothing is asked of the processor at run time. Each method gives the bits of the plain arrays.

#![allow(unsafe_code, reason = "vector instructions that every aarch64 processor has")]
#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "one reason for all: NEON is part of aarch64, pointers come from references"
)]

use std::arch::aarch64::*;
use std::arch::asm;

use super::{Lanes, WIDTH, operations};

/// Needs nothing beyond aarch64.
#[derive(Clone, Copy, Debug)]
pub(super) struct Neon;

type F = [float32x4_t; 4];
type I = [int32x4_t; 4];
/// All bits of a lane, or none.
type M = [uint32x4_t; 4];

/// The same of all four vectors. A closure would do, but the compiler does not always inline
/// `std::array::from_fn`, and then each instruction becomes a call.
macro_rules! four {
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
            {
                let $i = 2;
                $value
            },
            {
                let $i = 3;
                $value
            },
        ]
    };
}

/// Three bytes to four, from the first of sixteen bytes; an index past the last gives zero.
const SPREAD: [u8; 16] = [0, 1, 2, 255, 3, 4, 5, 255, 6, 7, 8, 255, 9, 10, 11, 255];
/// As [`SPREAD`], from the fifth byte.
const SPREAD_LAST: [u8; 16] = [4, 5, 6, 255, 7, 8, 9, 255, 10, 11, 12, 255, 13, 14, 15, 255];
/// What each byte of a color counts for in a difference.
const SHARE: [u8; 16] = [1, 2, 1, 0, 1, 2, 1, 0, 1, 2, 1, 0, 1, 2, 1, 0];

// Sound in every method below: NEON is part of aarch64; loads and stores go through references to all
// that they touch; `gather` reads only what lies inside of its table.
impl Lanes for Neon {
    type F = F;
    type I = I;
    type M = M;

    #[inline(always)]
    fn prefetch<T>(self, x: &T) {
        for line in (0..size_of::<T>()).step_by(64) {
            let line = std::ptr::from_ref(x).cast::<u8>().wrapping_add(line);
            // Sound whatever the pointer: nothing is read. The intrinsic for it is not stable.
            unsafe {
                asm!("prfm pldl1keep, [{0}]", in(reg) line, options(readonly, nostack, preserves_flags));
            }
        }
    }

    operations! {
        splat(x: f32) -> F = unsafe { [vdupq_n_f32(x); 4] };
        splat_int(x: i32) -> I = unsafe { [vdupq_n_s32(x); 4] };
        load(x: &[f32; WIDTH]) -> F = four!(i => unsafe { vld1q_f32(x.as_ptr().add(4 * i)) });
        store(v: F, x: &mut [f32; WIDTH]) =
            for i in 0..4 { unsafe { vst1q_f32(x.as_mut_ptr().add(4 * i), v[i]) } };
        add(a: F, b: F) -> F = four!(i => unsafe { vaddq_f32(a[i], b[i]) });
        sub(a: F, b: F) -> F = four!(i => unsafe { vsubq_f32(a[i], b[i]) });
        mul(a: F, b: F) -> F = four!(i => unsafe { vmulq_f32(a[i], b[i]) });
        fma(a: F, b: F, c: F) -> F = four!(i => unsafe { vfmaq_f32(c[i], a[i], b[i]) });
        fnma(a: F, b: F, c: F) -> F = four!(i => unsafe { vfmsq_f32(c[i], a[i], b[i]) });
        div(a: F, b: F) -> F = four!(i => unsafe { vdivq_f32(a[i], b[i]) });
        to_bits(a: F) -> I = four!(i => unsafe { vreinterpretq_s32_f32(a[i]) });
        of_bits(a: I) -> F = four!(i => unsafe { vreinterpretq_f32_s32(a[i]) });
        // The processor's own minimum and maximum are NaN where either number is.
        min(a: F, b: F) -> F =
            four!(i => unsafe { vbslq_f32(vcltq_f32(a[i], b[i]), a[i], b[i]) });
        max(a: F, b: F) -> F =
            four!(i => unsafe { vbslq_f32(vcgtq_f32(a[i], b[i]), a[i], b[i]) });
        abs(a: F) -> F = four!(i => unsafe { vabsq_f32(a[i]) });
        truncate(a: F) -> I = four!(i => unsafe { vcvtq_s32_f32(a[i]) });
        round(a: F) -> I = four!(i => unsafe { vcvtnq_s32_f32(a[i]) });
        float(a: I) -> F = four!(i => unsafe { vcvtq_f32_s32(a[i]) });
        less(a: F, b: F) -> M = four!(i => unsafe { vcltq_f32(a[i], b[i]) });
        at_most(a: F, b: F) -> M = four!(i => unsafe { vcleq_f32(a[i], b[i]) });
        select(mask: M, yes: F, no: F) -> F =
            four!(i => unsafe { vbslq_f32(mask[i], yes[i], no[i]) });
        select_int(mask: M, yes: I, no: I) -> I =
            four!(i => unsafe { vbslq_s32(mask[i], yes[i], no[i]) });
        add_int(a: I, b: I) -> I = four!(i => unsafe { vaddq_s32(a[i], b[i]) });
        sub_int(a: I, b: I) -> I = four!(i => unsafe { vsubq_s32(a[i], b[i]) });
        mul_int(a: I, b: I) -> I = four!(i => unsafe { vmulq_s32(a[i], b[i]) });
        min_int(a: I, b: I) -> I = four!(i => unsafe { vminq_s32(a[i], b[i]) });
        max_int(a: I, b: I) -> I = four!(i => unsafe { vmaxq_s32(a[i], b[i]) });
        and_int(a: I, b: I) -> I = four!(i => unsafe { vandq_s32(a[i], b[i]) });
        or_int(a: I, b: I) -> I = four!(i => unsafe { vorrq_s32(a[i], b[i]) });
        // Shifts by a constant vector become shifts with the number in the instruction. Negative ones
        // go towards lower bits.
        shift_up<N>(a: I) -> I =
            four!(i => unsafe { vshlq_s32(a[i], vdupq_n_s32(N.cast_signed())) });
        shift_down<N>(a: I) -> I = four!(i => unsafe {
            let by = vdupq_n_s32(-N.cast_signed());
            vreinterpretq_s32_u32(vshlq_u32(vreinterpretq_u32_s32(a[i]), by))
        });
        shift_down_signed<N>(a: I) -> I =
            four!(i => unsafe { vshlq_s32(a[i], vdupq_n_s32(-N.cast_signed())) });
        above_int(a: I, b: I) -> M = four!(i => unsafe { vcgtq_s32(a[i], b[i]) });
        below_int(a: I, b: I) -> M = four!(i => unsafe {
            vcltq_u32(vreinterpretq_u32_s32(a[i]), vreinterpretq_u32_s32(b[i]))
        });
        differ_int(a: I, b: I) -> M = four!(i => unsafe { vmvnq_u32(vceqq_s32(a[i], b[i])) });
        both(a: M, b: M) -> M = four!(i => unsafe { vandq_u32(a[i], b[i]) });
        either(a: M, b: M) -> M = four!(i => unsafe { vorrq_u32(a[i], b[i]) });
        but_not(a: M, b: M) -> M = four!(i => unsafe { vbicq_u32(a[i], b[i]) });
        any(a: M) -> bool = unsafe {
            vmaxvq_u32(vorrq_u32(vorrq_u32(a[0], a[1]), vorrq_u32(a[2], a[3]))) != 0
        };
        all(a: M) -> bool = unsafe {
            vminvq_u32(vandq_u32(vandq_u32(a[0], a[1]), vandq_u32(a[2], a[3]))) != 0
        };
        load_i16(x: &[i16; WIDTH]) -> I =
            four!(i => unsafe { vmovl_s16(vld1_s16(x.as_ptr().add(4 * i))) });
        store_i16(v: I, x: &mut [i16; WIDTH]) =
            for i in 0..4 { unsafe { vst1_s16(x.as_mut_ptr().add(4 * i), vmovn_s32(v[i])) } };
        load_u16(x: &[u16; WIDTH]) -> I = four!(i => unsafe {
            vreinterpretq_s32_u32(vmovl_u16(vld1_u16(x.as_ptr().add(4 * i))))
        });
        store_u16(v: I, x: &mut [u16; WIDTH]) = for i in 0..4 {
            unsafe {
                let low = vmovn_u32(vreinterpretq_u32_s32(v[i]));
                vst1_u16(x.as_mut_ptr().add(4 * i), low);
            }
        };
        load_bytes(x: &[[u8; 4]; WIDTH]) -> I = four!(i => unsafe {
            vreinterpretq_s32_u8(vld1q_u8(x.as_ptr().add(4 * i).cast()))
        });
        store_bytes(v: I, x: &mut [[u8; 4]; WIDTH]) = for i in 0..4 {
            unsafe { vst1q_u8(x.as_mut_ptr().add(4 * i).cast(), vreinterpretq_u8_s32(v[i])) }
        };
    }

    #[inline(always)]
    fn gather(self, table: &[u64], index: I, mask: M) -> (I, I) {
        let Some(last) = table.len().checked_sub(1) else {
            return (self.splat_int(0), self.splat_int(0));
        };
        // Whatever the index, what is read lies in the table.
        let last = u32::try_from(last).unwrap_or(u32::MAX);
        let from = table.as_ptr();
        let found = four!(i => unsafe { gather_four(from, last, index[i], mask[i]) });
        (four!(i => found[i].0), four!(i => found[i].1))
    }

    #[inline(always)]
    fn load_colors(self, x: &[[u8; 3]; WIDTH]) -> I {
        unsafe {
            // Twelve bytes are four lanes; sixteen from the last twelve would end behind the colors.
            let bytes: *const u8 = x.as_ptr().cast();
            let (spread, spread_last) = (vld1q_u8(SPREAD.as_ptr()), vld1q_u8(SPREAD_LAST.as_ptr()));
            [
                vreinterpretq_s32_u8(vqtbl1q_u8(vld1q_u8(bytes), spread)),
                vreinterpretq_s32_u8(vqtbl1q_u8(vld1q_u8(bytes.add(12)), spread)),
                vreinterpretq_s32_u8(vqtbl1q_u8(vld1q_u8(bytes.add(24)), spread)),
                vreinterpretq_s32_u8(vqtbl1q_u8(vld1q_u8(bytes.add(32)), spread_last)),
            ]
        }
    }

    #[inline(always)]
    fn store_pairs(self, low: I, high: I, x: &mut [u64; WIDTH]) {
        for i in 0..4 {
            unsafe { vst2q_s32(x.as_mut_ptr().add(4 * i).cast(), int32x4x2_t(low[i], high[i])) }
        }
    }

    #[inline(always)]
    fn color_difference(self, a: I, b: I) -> I {
        four!(i => unsafe {
            let apart = vabdq_u8(vreinterpretq_u8_s32(a[i]), vreinterpretq_u8_s32(b[i]));
            let share = vld1q_u8(SHARE.as_ptr());
            let first = vmull_u8(vget_low_u8(apart), vget_low_u8(share));
            let last = vmull_high_u8(apart, share);
            // Pairs of bytes, then pairs of pairs.
            vreinterpretq_s32_u32(vpaddlq_u16(vpaddq_u16(first, last)))
        })
    }
}

/// The low and the high halves of `from[index]` of four lanes; 0 where the mask says no or the index is
/// above `last`.
///
/// # Safety
/// From 0 to `last`, `from` can be read.
#[inline(always)]
unsafe fn gather_four(
    from: *const u64,
    last: u32,
    index: int32x4_t,
    mask: uint32x4_t,
) -> (int32x4_t, int32x4_t) {
    unsafe {
        let index = vreinterpretq_u32_s32(index);
        let inside = vminq_u32(index, vdupq_n_u32(last));
        let mask = vandq_u32(mask, vceqq_u32(inside, index));
        let mut at = [0; 4];
        vst1q_u32(at.as_mut_ptr(), inside);
        let (first, second) = (two(from, at[0], at[1]), two(from, at[2], at[3]));
        let (low, high) = (vuzp1q_u32(first, second), vuzp2q_u32(first, second));
        (vreinterpretq_s32_u32(vandq_u32(low, mask)), vreinterpretq_s32_u32(vandq_u32(high, mask)))
    }
}

/// Two elements of a table.
///
/// # Safety
/// Both can be read.
#[inline(always)]
unsafe fn two(from: *const u64, i: u32, j: u32) -> uint32x4_t {
    unsafe {
        let (first, second) = (vld1_u64(from.add(i as usize)), vld1_u64(from.add(j as usize)));
        vreinterpretq_u32_u64(vcombine_u64(first, second))
    }
}
