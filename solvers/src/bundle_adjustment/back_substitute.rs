//! The two passes after the reduced system: landmark steps, and the cost of a state.
//!
//! δ_l = −(L Lᵀ)⁻¹ (g_l + Σ J_lᵀ J_v δ_v) with the Jacobians of the linearization point computed anew,
//! which is cheaper than reading them back from memory.

use nalgebra::Vector3;

use crate::loss::Loss;
use crate::simd::{Kernel, Lanes, Row, WIDTH};

use super::accumulate::{Column, LandmarkRecord};
use super::layout::{Chunk, Layout};
use super::models::LaneModel;
use super::observe::{Inputs, PARAMETERS, linearize, squared_errors};

/// What the landmark steps of a chunk add to the step's figures.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StepSums {
    /// Σ δᵀ(λDδ − g).
    pub(super) decrease: f64,
    /// Σ ‖δ‖².
    pub(super) squared: f64,
}

/// Landmark steps of one chunk.
pub(super) struct BackSubstitute<'a, M, const D: usize, const Q: usize, const R: usize> {
    pub(super) inputs: Inputs<'a, M>,
    pub(super) layout: &'a Layout,
    pub(super) constant: &'a [bool],
    pub(super) chunk: &'a Chunk,
    pub(super) damping: f64,
    /// δ_v of each view, zero where constant.
    pub(super) view_steps: &'a [Column<Q>],
    pub(super) records: &'a [LandmarkRecord],
    /// One for each landmark of the chunk, in sorted order.
    pub(super) steps: &'a mut [Vector3<f64>],
}

impl<M: LaneModel, const D: usize, const Q: usize, const R: usize> Kernel
    for BackSubstitute<'_, M, D, Q, R>
{
    type Output = StepSums;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> StepSums {
        let first_landmark = self.chunk.landmarks.start;
        for step in self.steps.iter_mut() {
            *step = Vector3::zeros();
        }
        // Σ J_lᵀ J_v δ_v, gathered in the steps.
        let mut position = first_landmark;
        for first in self.chunk.observations.clone().step_by(WIDTH) {
            let products = self.products(l, first);
            let lanes = (self.chunk.observations.end - first).min(WIDTH);
            for lane in 0..lanes {
                while self.layout.starts[position + 1] as usize <= first + lane {
                    position += 1;
                }
                let step = &mut self.steps[position - first_landmark];
                step.x += products[0][lane];
                step.y += products[1][lane];
                step.z += products[2][lane];
            }
        }
        let mut sums = StepSums::default();
        for (i, (step, record)) in self.steps.iter_mut().zip(self.records).enumerate() {
            let k = first_landmark + i;
            if self.constant[self.layout.order[k] as usize] || self.layout.track(k).is_empty() {
                *step = Vector3::zeros();
                continue;
            }
            *step = landmark_step(record, step);
            for c in 0..3 {
                let delta = step[c];
                let damped = self.damping * record.scale[c] * delta;
                sums.decrease += delta * (damped - record.gradient[c]);
                sums.squared += delta * delta;
            }
        }
        sums
    }
}

impl<M: LaneModel, const D: usize, const Q: usize, const R: usize> BackSubstitute<'_, M, D, Q, R> {
    /// J_lᵀ J_v δ_v of eight observations.
    #[inline(always)]
    fn products<L: Lanes>(&self, l: L, first: usize) -> [Row; 3] {
        let lin = linearize::<L, M, R>(l, &self.inputs, first);
        let views: &[u32; WIDTH] =
            self.inputs.sorted.views[first..].first_chunk().unwrap_or(&[0; WIDTH]);
        let mut along = [l.splat(0.0); R];
        for q in 0..Q {
            let load = |i: usize| l.load(&self.view_steps[views[i] as usize][q]);
            let delta = l.transpose([
                load(0),
                load(1),
                load(2),
                load(3),
                load(4),
                load(5),
                load(6),
                load(7),
            ]);
            for (r, sum) in along.iter_mut().enumerate() {
                for (i, delta) in delta.iter().enumerate() {
                    let column = q * WIDTH + i;
                    if column < 6 {
                        *sum = l.fma(lin.pose[r][column], *delta, *sum);
                    } else if column < D && column - 6 < PARAMETERS {
                        *sum = l.fma(lin.camera[r][column - 6], *delta, *sum);
                    }
                }
            }
        }
        let mut products = [[0.0; WIDTH]; 3];
        for (c, product) in products.iter_mut().enumerate() {
            let mut sum = l.mul(lin.landmark[0][c], along[0]);
            for r in 1..R {
                sum = l.fma(lin.landmark[r][c], along[r], sum);
            }
            l.store(sum, product);
        }
        products
    }
}

/// −(L Lᵀ)⁻¹ (g + q).
fn landmark_step(record: &LandmarkRecord, q: &Vector3<f64>) -> Vector3<f64> {
    let [i00, l10, i11, l20, l21, i22] = record.factor;
    let a = (record.gradient[0] + q.x) * i00;
    let b = (record.gradient[1] + q.y - l10 * a) * i11;
    let c = (record.gradient[2] + q.z - l20 * a - l21 * b) * i22;
    let z = c * i22;
    let y = (b - l21 * z) * i11;
    let x = (a - l10 * y - l20 * z) * i00;
    -Vector3::new(x, y, z)
}

/// ½ Σ ρ of one chunk; infinite where an observation has no finite residual.
pub(super) struct Cost<'a, M, const R: usize> {
    pub(super) inputs: Inputs<'a, M>,
    pub(super) chunk: &'a Chunk,
}

impl<M: LaneModel, const R: usize> Kernel for Cost<'_, M, R> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> f64 {
        let loss = self.inputs.loss;
        let mut total = l.splat(0.0);
        let mut rest = 0.0;
        let mut row = [0.0; WIDTH];
        for first in self.chunk.observations.clone().step_by(WIDTH) {
            let squared = squared_errors::<L, M, R>(l, &self.inputs, first);
            let lanes = self.chunk.observations.end - first;
            if loss == Loss::Trivial && lanes >= WIDTH {
                total = l.add(total, squared);
                continue;
            }
            l.store(squared, &mut row);
            for s in &row[..lanes.min(WIDTH)] {
                rest += loss.evaluate(*s).rho;
            }
        }
        l.store(total, &mut row);
        let cost = 0.5 * (row.iter().sum::<f64>() + rest);
        if cost.is_finite() { cost } else { f64::INFINITY }
    }
}
