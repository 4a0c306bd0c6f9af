//! The variables of a problem as the passes read them: landmarks in the kernels' order, views as records.
//!
//! Landmarks live here while a system works and go back to the problem at the end. Nothing is
//! linearized and no step is computed here.

use std::sync::Arc;

use nalgebra::{SVector, Vector3};

use super::Checkpoint;
use super::eliminator::{Kernels, Pass};
use super::inner_iterations::{INNER_STIFFNESS, POINT};
use super::layout::{Layout, NO_BLOCK, View};
use super::observe::{Inputs, ViewRecord, view_record};
use super::state_factors;
use crate::geometry::{Camera, LieGroup, Se3};
use crate::interrupt::Interrupt;
use crate::optimizer::LoopState;
use crate::problem::BundleProblem;
use crate::simd::Class;

/// A problem and what its passes read.
pub(super) struct Variables<'a> {
    pub(super) problem: &'a mut BundleProblem,
    pub(super) layout: Arc<Layout>,
    pub(super) kernels: Kernels,
    pub(super) class: Class,
    pub(super) interrupt: Interrupt,
    /// Scales the loss; see [`System::set_stiffness`](crate::optimizer::System::set_stiffness).
    pub(super) stiffness: f64,
    records: Vec<ViewRecord>,
    points: Vec<f64>,
}

/// The variables before a trial step.
#[derive(Default)]
pub(super) struct Backup {
    poses: Vec<Se3>,
    cameras: Vec<Camera>,
    points: Vec<f64>,
}

/// A step of all variables.
pub(super) struct Move<'a> {
    /// Of poses and cameras.
    pub(super) step: &'a [f64],
    /// First unknown of each block of it.
    pub(super) offsets: &'a [usize],
    /// Of the landmarks, four numbers each, in the kernels' order.
    pub(super) points: &'a [f64],
}

impl<'a> Variables<'a> {
    pub(super) fn new(
        problem: &'a mut BundleProblem,
        layout: &Arc<Layout>,
        kernels: Kernels,
        class: Class,
        interrupt: Interrupt,
    ) -> Self {
        let order = &layout.sorted.order;
        // One more: eight numbers are read from any landmark on.
        let mut points = Vec::with_capacity((order.len() + 1) * POINT);
        for &landmark in order {
            let p = &problem.landmarks[landmark as usize];
            points.extend([p.x, p.y, p.z, 0.0]);
        }
        points.extend([0.0; POINT]);
        let layout = Arc::clone(layout);
        let (records, stiffness) = (Vec::new(), 1.0);
        Self { problem, layout, kernels, class, interrupt, stiffness, records, points }
    }

    /// How many numbers the landmarks take.
    pub(super) fn points_len(&self) -> usize {
        self.points.len()
    }

    /// What a pass reads, after [`Self::fill_records`].
    pub(super) fn pass(&self) -> Pass<'_> {
        let inputs = Inputs {
            sorted: &self.layout.sorted,
            records: &self.records,
            cameras: &self.problem.cameras,
            free_parameters: &self.problem.free_parameters,
            points: &self.points,
            loss: self.problem.observation_loss,
            stiffness: self.stiffness,
            model: self.kernels.model,
            view_cameras: &self.layout.view_cameras,
        };
        Pass { inputs, layout: &self.layout, class: self.class, interrupt: &self.interrupt }
    }

    /// Takes the poses and cameras as they are into the records of the views.
    pub(super) fn fill_records(&mut self) {
        let (poses, cameras) = (&self.problem.poses, &self.problem.cameras);
        let record = |v: &View| view_record(&poses[v.pose as usize], &cameras[v.camera as usize]);
        self.records.clear();
        self.records.extend(self.layout.views.iter().map(record));
    }

    /// ½ Σ ρ(r²) over all factors.
    pub(super) fn cost(&mut self) -> f64 {
        self.fill_records();
        (self.kernels.cost)(&self.pass()) + state_factors::cost(self.problem)
    }

    /// Moves the variables by `length` times a step.
    pub(super) fn move_by(&mut self, length: f64, by: &Move<'_>) {
        let (problem, layout) = (&mut *self.problem, &*self.layout);
        for (pose, &block) in problem.poses.iter_mut().zip(&layout.pose_block) {
            if block != NO_BLOCK {
                let step = &by.step[by.offsets[block as usize]..];
                *pose = pose.plus(&SVector::from_fn(|i, _| length * step[i]));
            }
        }
        for (camera, &(block, column)) in layout.camera_block.iter().enumerate() {
            if block != NO_BLOCK {
                let first = by.offsets[block as usize] + column;
                let step = &by.step[first..first + problem.camera_unknowns(camera)];
                let step = problem.free_parameters_of(camera).of_parameters(step);
                problem.cameras[camera].plus_parameters(&step.map(|x| length * x));
            }
        }
        for (x, delta) in self.points.iter_mut().zip(by.points) {
            *x += length * delta;
        }
    }

    /// Minimizes the landmarks at the poses and cameras as they are.
    pub(super) fn minimize_landmarks(&mut self) {
        self.fill_records();
        let mut points = std::mem::take(&mut self.points);
        let mut pass = self.pass();
        pass.inputs.stiffness = INNER_STIFFNESS;
        (self.kernels.minimize_landmarks)(&pass, &mut points);
        self.points = points;
    }

    /// The norm that a step is measured against: that of the poses' positions, in whose scene a
    /// landmark at infinity would make every step look short.
    pub(super) fn norm(&self) -> f64 {
        self.problem.poses.iter().map(|p| p.translation.norm_squared() + 1.0).sum::<f64>().sqrt()
    }

    /// The landmarks in the problem's order.
    pub(super) fn landmarks(&self) -> Vec<Vector3<f64>> {
        let mut landmarks = self.problem.landmarks.clone();
        self.put_back(&mut landmarks);
        landmarks
    }

    /// Puts the landmarks back into the problem.
    pub(super) fn finish(self) {
        let mut landmarks = std::mem::take(&mut self.problem.landmarks);
        self.put_back(&mut landmarks);
        self.problem.landmarks = landmarks;
    }

    fn put_back(&self, landmarks: &mut [Vector3<f64>]) {
        for (&landmark, point) in self.layout.sorted.order.iter().zip(self.points.chunks(POINT)) {
            landmarks[landmark as usize] = Vector3::new(point[0], point[1], point[2]);
        }
    }

    /// What a solve that goes on from here needs, besides its problem.
    pub(super) fn to_checkpoint(&self, state: LoopState, left_iterative: bool) -> Checkpoint {
        let BundleProblem { poses, cameras, .. } = &*self.problem;
        let (poses, cameras) = (poses.clone(), cameras.clone());
        Checkpoint { state, left_iterative, poses, landmarks: self.landmarks(), cameras }
    }

    pub(super) fn back_up(&self, backup: &mut Backup) {
        backup.poses.clone_from(&self.problem.poses);
        backup.cameras.clone_from(&self.problem.cameras);
        backup.points.clone_from(&self.points);
    }

    /// Goes back to what [`Self::back_up`] wrote.
    pub(super) fn restore(&mut self, backup: &Backup) {
        self.problem.poses.clone_from(&backup.poses);
        self.problem.cameras.clone_from(&backup.cameras);
        self.points.clone_from(&backup.points);
    }
}
