//! How the poses of a problem see their landmarks, at the present values: which of them are far off, and
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

impl MapProblem {
    /// Whether a free keyframe is far off, with more than half of its residuals beyond `width`.
    #[must_use]
    pub fn is_far_off(&self, width: f64) -> bool {
        let is_far = |views: &Views| {
            let beyond = views.squared.iter().filter(|&&squared| squared > width * width).count();
            beyond as f64 > FAR * views.squared.len() as f64
        };
        let constant = &self.problem.constant_poses;
        let views = Views::of(&self.problem);
        views.iter().zip(constant).any(|(views, constant)| !constant && is_far(views))
    }
}
