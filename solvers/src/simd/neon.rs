//! NEON, which every aarch64 processor has: eight lanes in four vectors of two.
//!
//! Built by a cross-check only; the scalar twin's test stands in for running it.

#![allow(unsafe_code, reason = "vector instructions that every aarch64 processor has")]

use std::arch::aarch64::*;

use super::{Lanes, Row, WIDTH};

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
        std::array::from_fn(|i| unsafe { vld1q_f64(x.as_ptr().add(2 * i)) })
    }
    #[inline(always)]
    fn store(self, v: Four, x: &mut Row) {
        for (i, part) in v.into_iter().enumerate() {
            unsafe { vst1q_f64(x.as_mut_ptr().add(2 * i), part) }
        }
    }
    #[inline(always)]
    fn add(self, a: Four, b: Four) -> Four {
        std::array::from_fn(|i| unsafe { vaddq_f64(a[i], b[i]) })
    }
    #[inline(always)]
    fn sub(self, a: Four, b: Four) -> Four {
        std::array::from_fn(|i| unsafe { vsubq_f64(a[i], b[i]) })
    }
    #[inline(always)]
    fn mul(self, a: Four, b: Four) -> Four {
        std::array::from_fn(|i| unsafe { vmulq_f64(a[i], b[i]) })
    }
    #[inline(always)]
    fn div(self, a: Four, b: Four) -> Four {
        std::array::from_fn(|i| unsafe { vdivq_f64(a[i], b[i]) })
    }
    #[inline(always)]
    fn sqrt(self, a: Four) -> Four {
        std::array::from_fn(|i| unsafe { vsqrtq_f64(a[i]) })
    }
    #[inline(always)]
    fn max(self, a: Four, b: Four) -> Four {
        std::array::from_fn(|i| unsafe { vbslq_f64(vcgtq_f64(a[i], b[i]), a[i], b[i]) })
    }
    #[inline(always)]
    fn min(self, a: Four, b: Four) -> Four {
        std::array::from_fn(|i| unsafe { vbslq_f64(vcltq_f64(a[i], b[i]), a[i], b[i]) })
    }
    #[inline(always)]
    fn select(self, mask: Four, yes: Four, no: Four) -> Four {
        std::array::from_fn(|i| unsafe { vbslq_f64(vcgtzq_f64(mask[i]), yes[i], no[i]) })
    }
    #[inline(always)]
    fn fma(self, a: Four, b: Four, c: Four) -> Four {
        std::array::from_fn(|i| unsafe { vfmaq_f64(c[i], a[i], b[i]) })
    }
    #[inline(always)]
    fn fnma(self, a: Four, b: Four, c: Four) -> Four {
        std::array::from_fn(|i| unsafe { vfmsq_f64(c[i], a[i], b[i]) })
    }
    #[inline(always)]
    fn fnma_one(self, a: f64, b: f64, c: f64) -> f64 {
        (-a).mul_add(b, c)
    }
    #[inline(always)]
    fn transpose(self, r: [Four; WIDTH]) -> [Four; WIDTH] {
        std::array::from_fn(|i| {
            std::array::from_fn(|j| unsafe {
                let (a, b) = (r[2 * j][i / 2], r[2 * j + 1][i / 2]);
                if i % 2 == 0 { vzip1q_f64(a, b) } else { vzip2q_f64(a, b) }
            })
        })
    }
}
