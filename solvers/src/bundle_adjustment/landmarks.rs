//! The pass over landmarks: residuals, Jacobians, weights, landmark blocks and view blocks.
//!
//! With J_v the view's and J_l the landmark's whitened Jacobian and w = ρ'(‖r‖²), a chunk of
//! landmarks sums H_ll = Σ w J_lᵀJ_l, g_l = Σ w J_lᵀr for each landmark and H_vv, g_v for each view,
//! and keeps W = w J_vᵀJ_l for each observation. The Jacobians themselves are not kept.

use std::ops::Range;

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::layout::Layout;
use crate::factors::Linearization;
use crate::problem::BundleProblem;

/// H_vv (lower and upper) and g_v of one view.
#[derive(Clone, Debug)]
pub(super) struct ViewBlock<const D: usize> {
    pub(super) hessian: SMatrix<f64, D, D>,
    pub(super) gradient: SVector<f64, D>,
}

impl<const D: usize> ViewBlock<D> {
    pub(super) fn zero() -> Self {
        Self { hessian: SMatrix::zeros(), gradient: SVector::zeros() }
    }
}

/// H_ll and g_l of one landmark.
#[derive(Clone, Copy, Debug)]
pub(super) struct LandmarkBlock {
    pub(super) hessian: Matrix3<f64>,
    pub(super) gradient: Vector3<f64>,
}

impl LandmarkBlock {
    pub(super) const ZERO: Self = Self {
        hessian: Matrix3::new(0., 0., 0., 0., 0., 0., 0., 0., 0.),
        gradient: Vector3::new(0., 0., 0.),
    };
}

/// What one chunk of landmarks writes.
pub(super) struct ChunkOutput<'a, const D: usize> {
    pub(super) landmarks: &'a mut [LandmarkBlock],
    pub(super) cross: &'a mut [SMatrix<f64, D, 3>],
    pub(super) views: &'a mut [ViewBlock<D>],
}

/// ½ Σ ρ over the observations of a range of landmarks; infinite where one has no finite residual.
pub(super) fn cost(problem: &BundleProblem, layout: &Layout, landmarks: &Range<usize>) -> f64 {
    let plain = problem.reprojections.len();
    let mut sum = 0.0;
    for index in layout.tracks(landmarks) {
        let observation = layout.observations[index];
        let view = &layout.views[observation.view as usize];
        let pose = &problem.poses[view.pose as usize];
        let camera = &problem.cameras[view.camera as usize];
        let point = &problem.landmarks[layout.landmark_of[index] as usize];
        let factor = observation.factor as usize;
        let squared = if factor < plain {
            let factor = problem.reprojections.factor(factor);
            factor.residual(pose, camera, point).map(|r| r.norm_squared())
        } else {
            let factor = problem.depth_reprojections.factor(factor - plain);
            factor.residual(pose, camera, point).map(|r| r.norm_squared())
        };
        match squared {
            Some(s) if s.is_finite() => sum += problem.observation_loss.evaluate(s).rho,
            _ => return f64::INFINITY,
        }
    }
    0.5 * sum
}

/// Linearizes the observations of a range of landmarks into `output`, which is overwritten.
pub(super) fn linearize<const D: usize>(
    problem: &BundleProblem,
    layout: &Layout,
    landmarks: &Range<usize>,
    output: &mut ChunkOutput<'_, D>,
) {
    output.landmarks.fill(LandmarkBlock::ZERO);
    output.views.fill(ViewBlock::zero());
    output.cross.fill(SMatrix::zeros());
    let plain = problem.reprojections.len();
    let first = layout.tracks(landmarks).start;
    for index in layout.tracks(landmarks) {
        let observation = layout.observations[index];
        let view = &layout.views[observation.view as usize];
        let pose = &problem.poses[view.pose as usize];
        let camera = &problem.cameras[view.camera as usize];
        let landmark = layout.landmark_of[index] as usize;
        let point = &problem.landmarks[landmark];
        let sink = Sink {
            loss: problem.observation_loss,
            landmark: &mut output.landmarks[landmark - landmarks.start],
            cross: &mut output.cross[index - first],
            view: &mut output.views[observation.view as usize],
        };
        let factor = observation.factor as usize;
        // A residual that is not finite makes the cost infinite, so that the loop never stands on
        // such a state; skipping it here only avoids spreading NaN in between.
        if factor < plain {
            let factor = problem.reprojections.factor(factor);
            if let Some(linearization) = factor.linearize(pose, camera, point) {
                sink.add(&linearization);
            }
        } else {
            let factor = problem.depth_reprojections.factor(factor - plain);
            if let Some(linearization) = factor.linearize(pose, camera, point) {
                sink.add(&linearization);
            }
        }
    }
}

/// Where one observation's products go.
struct Sink<'a, const D: usize> {
    loss: crate::loss::Loss,
    landmark: &'a mut LandmarkBlock,
    cross: &'a mut SMatrix<f64, D, 3>,
    view: &'a mut ViewBlock<D>,
}

impl<const D: usize> Sink<'_, D> {
    fn add<const R: usize>(self, linearization: &Linearization<R>) {
        let residual = &linearization.residual;
        let weight = self.loss.evaluate(residual.norm_squared()).weight;
        let mut d_view = SMatrix::<f64, R, D>::zeros();
        d_view.fixed_columns_mut::<6>(0).copy_from(&linearization.d_pose);
        for column in 6..D {
            d_view.column_mut(column).copy_from(&linearization.d_camera.column(column - 6));
        }
        let weighted_view = d_view.transpose() * weight;
        let d_landmark = &linearization.d_landmark;
        let weighted_landmark = d_landmark.transpose() * weight;
        self.landmark.hessian += weighted_landmark * d_landmark;
        self.landmark.gradient += weighted_landmark * residual;
        *self.cross = weighted_view * d_landmark;
        self.view.hessian += weighted_view * d_view;
        self.view.gradient += weighted_view * residual;
    }
}
