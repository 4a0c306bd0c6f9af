//! NEON, which every aarch64 processor has: eight lanes in four vectors of two.
//!
//! Products are fused with sums, as in the classes of x86. Nothing is asked of the processor at run time.

#![allow(unsafe_code, reason = "vector instructions that every aarch64 processor has")]

use std::arch::aarch64::*;

use super::{Lanes, Row, Subroutine, WIDTH};

/// Needs nothing beyond aarch64.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Neon;

type Four = [float64x2_t; 4];

// Sound in every method: NEON is part of aarch64, and loads and stores go through references to
// eight f64.
impl Lanes for Neon {
    type V = Four;

    #[inline(always)]
    fn splat(self, x: f64) -> Four {
        unsafe { [vdupq_n_f64(x); 4] }
    }
    #[inline(always)]
    fn load(self, x: &Row) -> Four {
        unsafe { each!(i < 4, vdupq_n_f64(0.0) => vld1q_f64(x.as_ptr().add(2 * i))) }
    }
    #[inline(always)]
    fn store(self, v: Four, x: &mut Row) {
        for (i, part) in v.into_iter().enumerate() {
            unsafe { vst1q_f64(x.as_mut_ptr().add(2 * i), part) }
        }
    }
    operations! {
        add(a, b) = each!(i < 4, a[0] => unsafe { vaddq_f64(a[i], b[i]) });
        sub(a, b) = each!(i < 4, a[0] => unsafe { vsubq_f64(a[i], b[i]) });
        mul(a, b) = each!(i < 4, a[0] => unsafe { vmulq_f64(a[i], b[i]) });
        div(a, b) = each!(i < 4, a[0] => unsafe { vdivq_f64(a[i], b[i]) });
        sqrt(a) = each!(i < 4, a[0] => unsafe { vsqrtq_f64(a[i]) });
        max(a, b) = each!(i < 4, a[0] => unsafe { vbslq_f64(vcgtq_f64(a[i], b[i]), a[i], b[i]) });
        min(a, b) = each!(i < 4, a[0] => unsafe { vbslq_f64(vcltq_f64(a[i], b[i]), a[i], b[i]) });
        fma(a, b, c) = each!(i < 4, a[0] => unsafe { vfmaq_f64(c[i], a[i], b[i]) });
        fnma(a, b, c) = each!(i < 4, a[0] => unsafe { vfmsq_f64(c[i], a[i], b[i]) });
        select(mask, yes, no) =
            each!(i < 4, yes[0] => unsafe { vbslq_f64(vcgtzq_f64(mask[i]), yes[i], no[i]) });
    }
    #[inline(always)]
    fn transpose(self, r: [Four; WIDTH]) -> [Four; WIDTH] {
        each!(i < WIDTH, r[0] => each!(j < 4, r[0][0] => unsafe {
            let (a, b) = (r[2 * j][i / 2], r[2 * j + 1][i / 2]);
            if i % 2 == 0 { vzip1q_f64(a, b) } else { vzip2q_f64(a, b) }
        }))
    }
    #[inline(never)]
    fn call<S: Subroutine<Self>>(self, work: S) -> S::Output {
        work.run(self)
    }
}
