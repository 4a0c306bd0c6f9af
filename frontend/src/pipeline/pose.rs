//! B. and D. Matches of a frame with landmarks, and the pose that fits the static ones.
//!
//! Landmarks are matched before movement is detected, as in the paper: movement is visible only from
//! approximately the right pose. No keyframe is made here, and the map is only read.

use covis_solvers::geometry::Se3;

use crate::local_map::LocalMap;
use crate::tracking::local_matching::{CurrentView, Match, match_landmarks};
use crate::tracking::refinement::{RefinedPose, refine_pose};

/// Fewer matches than this do not determine a pose.
pub(super) const LEAST_INLIERS: usize = 12;
/// With fewer inliers than this, coarser patches are matched, which reach farther.
pub(super) const FEW_INLIERS: usize = 40;
/// The level of these coarser patches.
const COARSE: usize = 2;

/// A pose with all matches near it, outliers included.
pub(super) struct MatchedPose {
    pub(super) refined: RefinedPose,
    pub(super) matches: Vec<Match>,
}

/// Matches by what they show.
pub(super) struct SplitMatches {
    pub(super) moving: Vec<Match>,
    pub(super) still: Vec<Match>,
}

/// B. Matches landmarks near a pose and refines the pose. Where the start is too far off for fine
/// patches, coarse ones are matched first.
pub(super) fn match_map(
    map: &LocalMap,
    view: &CurrentView<'_>,
    start: &Se3,
) -> Option<MatchedPose> {
    let pose = |start: &Se3, finest: usize| {
        let matches = match_landmarks(view, map, start, finest);
        let refined = refine_pose(view.camera, map, &matches, start, LEAST_INLIERS)?;
        Some(MatchedPose { refined, matches })
    };
    let fine = pose(start, 0);
    if fine.as_ref().is_some_and(|fine| fine.refined.inliers.len() >= FEW_INLIERS) {
        return fine;
    }
    let coarse = pose(start, COARSE);
    let again = coarse.as_ref().and_then(|coarse| pose(&coarse.refined.world_from_camera, 0));
    [fine, coarse, again].into_iter().flatten().max_by_key(|found| found.refined.inliers.len())
}

/// D. Tells the matches that move from those that stand still.
pub(super) fn without_moving(view: &CurrentView<'_>, matches: Vec<Match>) -> SplitMatches {
    let (moving, still) = matches.into_iter().partition(|found| view.is_moving(&found.pixel));
    SplitMatches { moving, still }
}

/// D. The pose that fits the static matches; where few fit, the local map is matched again.
pub(super) fn refine_static(
    map: &LocalMap,
    view: &CurrentView<'_>,
    still: &[Match],
    start: &Se3,
) -> Option<RefinedPose> {
    let refined = refine_pose(view.camera, map, still, start, LEAST_INLIERS);
    if refined.as_ref().is_some_and(|refined| refined.inliers.len() >= FEW_INLIERS) {
        return refined;
    }
    let again = match_map(map, view, start).map(|again| again.refined);
    [refined, again].into_iter().flatten().max_by_key(|refined| refined.inliers.len())
}
