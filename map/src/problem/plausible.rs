//! Whether what a solve of a window found is plausible.
//!
//! A window may leave a direction open that nothing measures: a keyframe with few landmarks left, all of
//! them ahead of it. Least squares walks along it, by meters or by light-years, and the cost falls a
//! little. What such a solve found looks converged; as an estimate it is worth nothing. Each free pose is
//! therefore compared with where it started:
//!
//! - *behind*: landmarks that lay ahead of the camera now lie behind it;
//! - *worse*: half of what it sees fits much worse than at the start, and badly, and odometry does not hold it;
//! - *undetermined*: it moved by more than the window is wide, and the factors do not know its place along
//!   that way better than by a third of it.
//!
//! The window as a whole may also change its *scale*, where nothing measures that. Nothing is solved here.

use covis_solvers::bundle_adjustment::pose_covariances;
use covis_solvers::geometry::Se3;
use covis_solvers::problem::BundleProblem;
use nalgebra::{UnitVector3, Vector3};

use super::MapProblem;
use super::views::Views;
use crate::numbers::median;
use crate::odometry;

/// Share of the landmarks of a keyframe that may go behind its camera: wrong ones do.
const BEHIND_SHARE: f64 = 0.1;
/// How much worse the median residual may get.
const WORSE: f64 = 2.0;
/// Observations from which on a median counts.
const LEAST_SEEN: usize = 6;
/// Share of the median distance of landmarks that a pose may move unasked, where a window is narrow.
const DISTANCE_SHARE: f64 = 0.01;
/// Share of its way by which a pose may be uncertain along it.
const UNCERTAIN_SHARE: f64 = 1.0 / 3.0;
/// By how much a window may grow or shrink that measures no length.
const MOST_SCALE: f64 = 3.0;

/// Why a window holds a keyframe that it was to move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Held {
    /// Too little measures it.
    Unmeasured,
    /// Landmarks went behind its camera.
    Behind,
    /// What it sees fits much worse than before.
    Worse,
    /// It went far along what nothing measures.
    Undetermined,
    /// Its window grew or shrank, and nothing measures its scale.
    Scale,
}

impl std::fmt::Display for Held {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Unmeasured => "too little measures a keyframe",
            Self::Behind => "landmarks would lie behind a camera",
            Self::Worse => "a keyframe's observations would fit much worse than before",
            Self::Undetermined => "a keyframe would move far in a direction that nothing measures",
            Self::Scale => "its scale would change, which nothing measures",
        })
    }
}

/// The values from which a solve started.
#[derive(Clone, Debug)]
pub struct Start {
    poses: Vec<Se3>,
    landmarks: Vec<Vector3<f64>>,
    views: Vec<Views>,
}

impl MapProblem {
    /// The values as they are, before a solve moves them.
    #[must_use]
    pub fn start(&self) -> Start {
        let BundleProblem { poses, landmarks, .. } = &self.problem;
        let (poses, landmarks) = (poses.clone(), landmarks.clone());
        Start { poses, landmarks, views: Views::of(&self.problem) }
    }

    /// Goes back to the values before a solve, and holds these poses there.
    pub fn restart(&mut self, start: &Start, held: &[(usize, Held)]) {
        self.problem.poses.clone_from(&start.poses);
        self.problem.landmarks.clone_from(&start.landmarks);
        for &(pose, why) in held {
            self.problem.constant_poses[pose] = true;
            self.held.push((self.keyframes[pose], why));
        }
    }

    /// The free poses that are not plausible, by their place.
    #[must_use]
    pub fn implausible(&self, start: &Start) -> Vec<(usize, Held)> {
        let bundle = &self.problem;
        let free = (0..bundle.poses.len()).filter(|&pose| !bundle.constant_poses[pose]);
        if self.lost_scale(start) {
            return free.map(|pose| (pose, Held::Scale)).collect();
        }
        let views = Views::of(bundle);
        let mut found = Vec::new();
        let mut far = Vec::new();
        let reach = self.reach(start);
        for pose in free {
            let (before, after) = (&start.views[pose], &views[pose]);
            let seen = after.squared.len();
            let allowed = before.behind as f64 + (BEHIND_SHARE * seen as f64).max(1.0);
            let is_worse = || {
                let most = WORSE * before.median().max(self.width());
                after.median() > most && !self.is_held_by_odometry(pose)
            };
            if after.behind as f64 > allowed {
                found.push((pose, Held::Behind));
            } else if seen >= LEAST_SEEN && is_worse() {
                found.push((pose, Held::Worse));
            } else if (bundle.poses[pose].translation - start.poses[pose].translation).norm()
                > reach
            {
                far.push(pose);
            }
        }
        found.extend(self.undetermined(start, &far));
        found.sort_unstable();
        found
    }

    /// Whether odometry agrees with where a pose is: then most of what it sees may move with it, as a car
    /// ahead does.
    #[must_use]
    pub fn is_held_by_odometry(&self, pose: usize) -> bool {
        let bundle = &self.problem;
        let ties = self.odometry.iter().filter_map(|&index| bundle.relative_poses.get(index));
        let mut ties = ties.filter(|tie| tie.i == pose || tie.j == pose);
        ties.any(|tie| odometry::holds(tie.chi2(&bundle.poses[tie.i], &bundle.poses[tie.j])))
    }

    /// The residual beyond which an observation counts little.
    fn width(&self) -> f64 {
        self.problem.observation_loss.width().unwrap_or(1.0)
    }

    /// How far a pose may move before what knows its place is asked: as far as the poses are apart, and a
    /// share of the way to the landmarks.
    fn reach(&self, start: &Start) -> f64 {
        let bundle = &self.problem;
        let center = start.poses.iter().map(|pose| pose.translation).sum::<Vector3<f64>>()
            / start.poses.len().max(1) as f64;
        let wide = start.poses.iter().map(|pose| (pose.translation - center).norm());
        let seen = bundle.observations().map(|seen| {
            (start.poses[seen.pose as usize].translation - start.landmarks[seen.landmark as usize])
                .norm()
        });
        wide.fold(0.0, f64::max) + DISTANCE_SHARE * median(seen.collect()).unwrap_or(0.0)
    }

    /// Those of `far` whose place the factors do not know.
    fn undetermined(&self, start: &Start, far: &[usize]) -> Vec<(usize, Held)> {
        if far.is_empty() {
            return Vec::new();
        }
        let covariances = pose_covariances(&self.problem, far);
        let is_known = |at: usize| {
            let covariance = covariances.as_ref()?.get(at)?;
            let (before, after) = (&start.poses[far[at]], &self.problem.poses[far[at]]);
            let way = after.rotation.inverse_rotate(&(after.translation - before.translation));
            let length = way.norm();
            let Some(along) = UnitVector3::try_new(way, 1e-12) else { return Some(()) };
            let variance = covariance.fixed_view::<3, 3>(0, 0).into_owned();
            let deviation = along.dot(&(variance * along.into_inner())).sqrt();
            (deviation <= UNCERTAIN_SHARE * length).then_some(())
        };
        let open = (0..far.len()).filter(|&at| is_known(at).is_none());
        open.map(|at| (far[at], Held::Undetermined)).collect()
    }

    /// Whether the window grew or shrank while nothing in it measures a length.
    fn lost_scale(&self, start: &Start) -> bool {
        let bundle = &self.problem;
        let constant = bundle.constant_poses.iter().filter(|&&constant| constant).count();
        let has_scale = constant > 1
            || !bundle.relative_poses.is_empty()
            || !bundle.pose_priors.is_empty()
            || !bundle.position_priors.is_empty()
            || !bundle.depth_reprojections.landmarks.is_empty();
        let length = |poses: &[Se3]| -> f64 {
            let pairs = poses.windows(2).map(|pair| pair[1].translation - pair[0].translation);
            pairs.map(|step| step.norm()).sum()
        };
        let (before, after) = (length(&start.poses), length(&bundle.poses));
        !has_scale && before > 0.0 && !(before / MOST_SCALE..=before * MOST_SCALE).contains(&after)
    }
}
