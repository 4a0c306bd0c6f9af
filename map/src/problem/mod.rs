//! The only place that turns a map into a solver problem.
//!
//! A problem remembers which entity each of its variables is and the revision that it was built
//! from; [`applied`](super::applied) turns it back into a change once a solver has moved its
//! values. Nothing is solved here.
//!
//! | file | role |
//! |---|---|
//! | `bundle`, `region` | windows, whole maps, and what closures moved |
//! | `graph`, `priors`, `contradiction` | pose graphs, and whether one has anything to correct |
//! | `reconstructed` | what a reconstruction found |
//! | `views`, `plausible` | how poses see their landmarks, before and after |

mod bundle;
mod contradiction;
mod graph;
mod plausible;
mod priors;
mod reconstructed;
mod region;
mod views;

use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{Camera, Se3};
use covis_solvers::loss::Loss;
use covis_solvers::problem::{BundleProblem, PoseGraph};
use covis_solvers::robust::VarianceFactors;
use nalgebra::Vector3;

use super::{ClientIndex, EntityId, Gauge, Noise, SwitchedOff};

pub use bundle::{global_problem, local_problem, observation_problem, retirement_problem};
pub use graph::measured_graph;
pub use plausible::{Held, Start};
pub use reconstructed::Compared;
pub use region::region_problem;

/// A bundle adjustment problem with the names of its variables.
#[derive(Clone, Debug, PartialEq)]
pub struct MapProblem {
    /// The problem; a solve moves its values in place.
    pub problem: BundleProblem,
    /// The keyframe of each pose.
    pub keyframes: Vec<EntityId>,
    /// The map's id of each camera.
    pub cameras: Vec<EntityId>,
    /// The map's intrinsics of each camera, which a solve does not move.
    pub start_cameras: Vec<Camera>,
    /// The map's id of each landmark.
    pub landmarks: Vec<EntityId>,
    /// The relative poses that odometry measured, by their place in the problem.
    pub odometry: Vec<usize>,
    /// Whether they measure lengths, see [`MapPolicy::metric_odometry`](crate::MapPolicy::metric_odometry).
    pub metric_odometry: bool,
    /// How uncertain what its clients send counts as; [`MapProblem::learn_odometry_noise`] and
    /// [`MapProblem::learn_view_noise`] change it.
    pub noise: BTreeMap<ClientIndex, Noise>,
    /// The noise that the solve starts from.
    pub start_noise: BTreeMap<ClientIndex, Noise>,
    /// Keyframes that wait for a solve of their own and are not in the problem: they go with the keyframe
    /// before them.
    pub carried: BTreeSet<EntityId>,
    /// Keyframes that a window was to move and holds, and why.
    pub held: Vec<(EntityId, Held)>,
    /// Landmarks that are one with another one of the problem, and that one's place.
    pub duplicates: Vec<(EntityId, usize)>,
    /// The poses that the solve starts from.
    pub start_poses: Vec<Se3>,
    /// The positions that the solve starts from.
    pub start_landmarks: Vec<Vector3<f64>>,
    /// The map's revision that it was built from.
    pub start_revision: i64,
    /// The gauge that was asked for; `None` where the map's policy decides.
    pub gauge: Option<Gauge>,
    /// What fixes its frame.
    pub frame: Gauge,
}

impl MapProblem {
    /// Whether there is something to move and something to measure it by; otherwise a solver would
    /// refuse the problem as empty, which for a young map is no error.
    pub fn is_solvable(&self) -> bool {
        let problem = &self.problem;
        let has_factors = problem.observation_count() > 0 || !problem.relative_poses.is_empty();
        has_factors
            && (problem.constant_poses.iter().any(|&c| !c)
                || problem.constant_landmarks.iter().any(|&c| !c))
    }
}

/// What a whole-map bundle adjustment minimizes and holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlobalOptions {
    /// Loss of the observations (trivial); constraints take the policy's.
    pub loss: Loss,
    /// Whether intrinsics stay as they are (true).
    pub fix_intrinsics: bool,
    /// What fixes the frame (priors, else the first keyframe of each piece).
    pub gauge: Gauge,
}

impl Default for GlobalOptions {
    fn default() -> Self {
        Self { loss: Loss::Trivial, fix_intrinsics: true, gauge: Gauge::default() }
    }
}

/// A pose graph with the names of its poses.
#[derive(Clone, Debug, PartialEq)]
pub struct GraphProblem {
    /// The graph; a solve moves its poses in place. Ids count the keyframes client by client in
    /// capture order, with a gap between clients: consecutive keyframes have consecutive ids.
    pub graph: PoseGraph<Se3, 6>,
    /// The keyframe of each pose, sorted.
    pub keyframes: Vec<EntityId>,
    /// The edges that are loop closures, rising; a solve leaves its verdicts here.
    pub closures: Vec<ClosureEdge>,
    /// The position priors in the graph's order; a solve leaves its verdicts here.
    pub positions: Vec<JudgedPosition>,
    /// By what the information of each client's measurements and closures was divided.
    pub factors: BTreeMap<ClientIndex, VarianceFactors>,
    /// The poses that the solve starts from.
    pub start_poses: Vec<Se3>,
    /// The map's revision that it was built from.
    pub start_revision: i64,
    /// The gauge that was asked for; `None` where the map's policy decides.
    pub gauge: Option<Gauge>,
}

/// An edge of a pose graph that is a loop closure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosureEdge {
    /// Its position among the edges.
    pub edge: usize,
    /// The constraint that it came from.
    pub constraint: EntityId,
    /// Present where it does not count.
    pub switched_off: Option<SwitchedOff>,
}

/// A position prior of a pose graph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JudgedPosition {
    /// Its id in the map.
    pub prior: EntityId,
    /// Present where it does not count.
    pub switched_off: Option<SwitchedOff>,
}

impl GraphProblem {
    /// The edges that are no loop closures, rising.
    pub fn trusted(&self) -> Vec<usize> {
        let mut closures = self.closures.iter().map(|closure| closure.edge).peekable();
        (0..self.graph.edges.len()).filter(|edge| closures.next_if_eq(edge).is_none()).collect()
    }

    /// What fixes the frame of a graph that was built for `gauge`: a first keyframe that it holds and that
    /// an edge ties to others, else the priors that count.
    pub fn frame(&self, gauge: Gauge) -> Gauge {
        let constant = &self.graph.constant;
        let holds = |edge: &RelativePose<Se3, 6>| constant[edge.i] || constant[edge.j];
        let counts = |position: &JudgedPosition| position.switched_off.is_none();
        let has_priors = !self.graph.pose_priors.is_empty() || self.positions.iter().any(counts);
        match () {
            () if self.graph.edges.iter().any(holds) => match gauge {
                Gauge::FixedPoses => Gauge::FixedPoses,
                Gauge::FirstKeyframeFixed | Gauge::Free | Gauge::Priors => {
                    Gauge::FirstKeyframeFixed
                }
            },
            () if has_priors => Gauge::Priors,
            () => Gauge::Free,
        }
    }

    /// Whether there is an edge or a prior and a pose that may move.
    pub fn is_solvable(&self) -> bool {
        (self.graph.has_priors() || !self.graph.edges.is_empty())
            && self.graph.constant.iter().any(|&c| !c)
    }
}
