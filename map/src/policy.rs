//! How a map is kept and optimized.
//!
//! A policy is part of the map's state and is stored in its first event, so that replaying a journal
//! needs no configuration. A policy from the wire is not checked here but at the edge.

use covis_solvers::geometry::Geodetic;
use covis_solvers::loss::Loss;
use covis_solvers::robust::{Kernel, default_threshold};

use super::MapLimits;

/// What happens to an item for which a full map has no room. Journals have the place in this order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WhenFull {
    /// It is refused; its stream ends.
    #[default]
    Reject,
    /// The oldest keyframe is marginalized: its information on its neighbors becomes constraints
    /// between them.
    Marginalize,
    /// The one of the oldest keyframes whose landmarks others see best is marginalized in the same way.
    Sparsify,
}

/// What fixes the map's frame where the measurements do not determine it. Journals have the place in
/// this order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Gauge {
    /// Priors; in each connected piece of the map that has none the keyframe that arrived first, which no
    /// solve and no other change moves.
    #[default]
    FirstKeyframeFixed,
    /// Priors, and the solver's damping. A pose graph needs more: there as above.
    Free,
    /// Priors, as [`Gauge::Free`].
    Priors,
    /// The first keyframe of each connected piece, also beside priors: a map marks no others.
    FixedPoses,
}

/// How false loop closures are distinguished from true ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosureRobustness {
    /// How weights follow from residuals; with `None` every closure counts as true.
    pub kernel: Option<Kernel>,
    /// The largest χ² of a true closure; `None` takes the 99 % quantile for its dimension.
    pub threshold: Option<f64>,
}

impl ClosureRobustness {
    /// Every closure counts as true.
    pub const NONE: Self = Self { kernel: None, threshold: None };

    /// The threshold for residuals of `dimension` numbers.
    pub fn threshold_of_dimension(&self, dimension: usize) -> f64 {
        self.threshold.unwrap_or_else(|| default_threshold(dimension))
    }
}

/// How a map is kept and optimized.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapPolicy {
    /// Whether each keyframe starts local bundle adjustment (true).
    pub local_bundle: bool,
    /// Whether odometry ties consecutive keyframes of a client (true).
    pub odometry: bool,
    /// Whether odometry measures lengths in its unit (true). That of one camera does not: its scale
    /// drifts, and each tie continues the scale that the map has there.
    pub metric_odometry: bool,
    /// Whether a loop-closure constraint or a prior starts pose-graph optimization (true).
    pub loop_closure: bool,
    /// Whether the places that closures join are compared and the whole map is adjusted after a pose
    /// graph with closures that count (true).
    pub closure_adjustment: bool,
    /// Whether the server looks for places that keyframes show again, and adds loop closures (true).
    pub place_recognition: bool,
    /// Keyframes that local bundle adjustment frees (20); twice as many where `odometry` is false.
    pub window_keyframes: usize,
    /// How loop-closure constraints are judged (truncated least squares, 99 % quantile). Frontends
    /// sometimes propose false closures, and one that is accepted distorts a map permanently: later
    /// estimates keep the distortion.
    pub loop_closure_robustness: ClosureRobustness,
    /// Landmarks that two keyframes must share to have an edge in the pose graph (15).
    pub min_shared_landmarks: usize,
    /// Loss of reprojection factors in local bundle adjustment (Geman and McClure, width 2): it lets go of
    /// what moves by itself and of wrong tracks.
    pub observation_loss: Loss,
    /// Loss of relative-pose constraints (trivial).
    pub constraint_loss: Loss,
    /// Iterations of a local bundle adjustment (10).
    pub max_local_iterations: usize,
    /// Limits of what the map holds (none).
    pub limits: MapLimits,
    /// What happens at a limit (refuse).
    pub when_full: WhenFull,
    /// Items of a client that may wait for the engine (the server's).
    pub max_queued_items: Option<u32>,
    /// What fixes the frame (priors, else the first keyframe).
    pub gauge: Gauge,
    /// Where the origin of the world is on the Earth; its axes point east, north and up there (none).
    pub geodetic_anchor: Option<Geodetic>,
}

impl Default for MapPolicy {
    fn default() -> Self {
        Self {
            local_bundle: true,
            odometry: true,
            metric_odometry: true,
            loop_closure: true,
            closure_adjustment: true,
            place_recognition: true,
            loop_closure_robustness: ClosureRobustness {
                kernel: Some(Kernel::TruncatedLeastSquares),
                threshold: None,
            },
            window_keyframes: 20,
            min_shared_landmarks: 15,
            observation_loss: Loss::GemanMcClure(2.0),
            constraint_loss: Loss::Trivial,
            max_local_iterations: 10,
            limits: MapLimits::default(),
            when_full: WhenFull::default(),
            max_queued_items: None,
            gauge: Gauge::default(),
            geodetic_anchor: None,
        }
    }
}
