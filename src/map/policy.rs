//! How a map is kept and optimized.
//!
//! A policy is part of the map's state and travels in its first event, so that replaying a journal
//! needs no configuration. Nothing here checks a policy that came over the wire; the edge does.

use covis_solvers::loss::Loss;

/// Limits of what a map holds; `None` is unlimited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ceilings {
    /// Keyframes.
    pub max_keyframes: Option<u64>,
    /// Landmarks.
    pub max_landmarks: Option<u64>,
    /// Observations.
    pub max_observations: Option<u64>,
}

/// How a map is kept and optimized.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapPolicy {
    /// Whether each keyframe starts local bundle adjustment (true).
    pub local_bundle: bool,
    /// Whether a loop-closure constraint starts pose-graph optimization (true).
    pub loop_closure: bool,
    /// Keyframes that local bundle adjustment frees (20).
    pub window_keyframes: usize,
    /// Landmarks that two keyframes must share to be tied in the pose graph (15).
    pub min_shared_landmarks: usize,
    /// Loss of reprojection factors in local bundle adjustment (Huber, width 2).
    pub observation_loss: Loss,
    /// Loss of relative-pose constraints (trivial).
    pub constraint_loss: Loss,
    /// Iterations of a local bundle adjustment (10).
    pub max_local_iterations: usize,
    /// Limits of what the map holds (none).
    pub ceilings: Ceilings,
}

impl Default for MapPolicy {
    fn default() -> Self {
        Self {
            local_bundle: true,
            loop_closure: true,
            window_keyframes: 20,
            min_shared_landmarks: 15,
            observation_loss: Loss::Huber(2.0),
            constraint_loss: Loss::Trivial,
            max_local_iterations: 10,
            ceilings: Ceilings::default(),
        }
    }
}
