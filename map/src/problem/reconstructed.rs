//! What a reconstruction found, as values of the map's problem.
//!
//! What it could not place is held: the map keeps its values. Nothing is reconstructed here.

use covis_solvers::evaluation::{CostReport, bundle_cost};
use covis_solvers::problem::BundleProblem;
use covis_solvers::reconstruction::Reconstruction;

use super::MapProblem;

/// The observations by which a map before and after a reconstruction is compared: those that agree with it,
/// and that had a finite residual before.
#[derive(Clone, Debug)]
pub struct Compared {
    problem: BundleProblem,
}

impl Compared {
    /// Of `problem`, which has the map's values still. `had_position` says which of its landmarks had one.
    #[must_use]
    pub fn new(problem: &MapProblem, found: &Reconstruction, had_position: &[bool]) -> Self {
        let MapProblem { problem, .. } = problem;
        let mut compared = BundleProblem {
            relative_poses: Vec::new(),
            pose_priors: Vec::new(),
            position_priors: Vec::new(),
            ..problem.clone()
        };
        let has_residual = |pose: u32, camera: u32, landmark: u32| {
            let (pose, camera, landmark) = (pose as usize, camera as usize, landmark as usize);
            let point = problem.poses[pose].inverse_transform(&problem.landmarks[landmark]);
            had_position.get(landmark) == Some(&true)
                && problem.cameras[camera].project(&point).is_some()
        };
        let (plain, depth) = (&problem.reprojections, &problem.depth_reprojections);
        compared.reprojections.retain(|k| {
            found.reprojections[k]
                && has_residual(plain.poses[k], plain.cameras[k], plain.landmarks[k])
        });
        compared.depth_reprojections.retain(|k| {
            found.depth_reprojections[k]
                && has_residual(depth.poses[k], depth.cameras[k], depth.landmarks[k])
        });
        Self { problem: compared }
    }

    /// The cost of the values that it has.
    pub fn cost(&self) -> CostReport {
        bundle_cost(&self.problem)
    }

    /// Takes the values of the problem that it was made of.
    pub fn update(&mut self, problem: &MapProblem) {
        self.problem.poses.clone_from(&problem.problem.poses);
        self.problem.landmarks.clone_from(&problem.problem.landmarks);
        self.problem.cameras.clone_from(&problem.problem.cameras);
    }
}

impl MapProblem {
    /// Takes over what was found, leaves out the observations that do not agree, and holds what has no
    /// place.
    pub fn take_over(&mut self, found: &Reconstruction) {
        found.apply_to(&mut self.problem);
        let unplaced = found.poses.iter().map(Option::is_none);
        self.problem.constant_poses = unplaced.collect();
        self.problem.constant_landmarks = found.landmarks.iter().map(Option::is_none).collect();
    }
}
