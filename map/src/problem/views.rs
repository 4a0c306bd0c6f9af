//! How the poses of a problem see their landmarks, at the present values: which of them start far off, and
//! what the check of a result compares. Nothing is solved here.

use covis_solvers::problem::BundleProblem;

use super::MapProblem;
use crate::numbers::median;

/// Share of a keyframe's observations beyond the width of a loss from which on it starts so far off that a loss
/// which lets go may let go of the truth.
const FAR: f64 = 0.5;

/// How a pose sees its landmarks.
#[derive(Clone, Debug, Default)]
pub(super) struct Views {
    /// Squared residuals; infinite where there is none.
    pub(super) squared: Vec<f64>,
    /// Landmarks behind the camera.
    pub(super) behind: usize,
}

impl Views {
    /// Of each pose of a problem.
    pub(super) fn of(bundle: &BundleProblem) -> Vec<Self> {
        let mut views = vec![Self::default(); bundle.poses.len()];
        for observation in bundle.observations() {
            let pose = observation.pose as usize;
            let residual = bundle.residual(&observation);
            views[pose].squared.push(residual.map_or(f64::INFINITY, |r| r.norm_squared()));
            let point = &bundle.landmarks[observation.landmark as usize];
            let is_behind = bundle.poses[pose].inverse_transform(point).z <= 0.0;
            views[pose].behind += usize::from(is_behind);
        }
        views
    }

    /// The median residual.
    pub(super) fn median(&self) -> f64 {
        median(self.squared.clone()).unwrap_or(0.0).sqrt()
    }
}

/// What places a keyframe that starts far off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FarStart {
    /// Odometry, which may be right.
    ByOdometry,
    /// Nothing but its views.
    Open,
}

impl MapProblem {
    /// What places the free keyframe that starts far off, with more than half of its residuals beyond `width`:
    /// one that nothing places before others. `None` where none does.
    #[must_use]
    pub fn far_start(&self, width: f64) -> Option<FarStart> {
        let start = |(pose, views): (usize, Views)| {
            let beyond = views.squared.iter().filter(|&&squared| squared > width * width).count();
            let is_far = beyond as f64 > FAR * views.squared.len() as f64;
            let is_free = !self.problem.constant_poses[pose];
            (is_free && is_far).then(|| match self.is_held_by_odometry(pose) {
                true => FarStart::ByOdometry,
                false => FarStart::Open,
            })
        };
        Views::of(&self.problem).into_iter().enumerate().filter_map(start).max()
    }
}
