//! B. and D. Matches of a frame with landmarks, and the pose that fits the static ones.
//!
//! Landmarks are matched before movement is detected, as in the paper: movement is visible only from
//! approximately the right pose.

use covis_solvers::geometry::Se3;

use crate::local_map::LocalMap;
use crate::tracking::local_matching::{Match, MatchOptions, View, match_landmarks};
use crate::tracking::refinement::{RefinedPose, refine_pose};

/// Fewer matches than this do not determine a pose.
pub(super) const LEAST_INLIERS: usize = 12;
/// With fewer inliers than this, coarser patches are matched, which reach farther.
pub(super) const FEW_INLIERS: usize = 40;

/// B. and D. Matches landmarks near a pose and refines the pose. Where the start is too far off for
/// fine patches, coarse ones are matched first. Also returns all matches, outliers included.
pub(super) fn find_pose(
    map: &LocalMap,
    view: &View<'_>,
    start: &Se3,
    options: &MatchOptions,
) -> Option<(RefinedPose, Vec<Match>)> {
    let pose = |start: &Se3, options: &MatchOptions| {
        let matches = match_landmarks(view, map, start, options);
        let refined = refine_pose(view.camera, map, &matches, start, LEAST_INLIERS)?;
        Some((refined, matches))
    };
    let fine = pose(start, options);
    if fine.as_ref().is_some_and(|(fine, _)| fine.inliers.len() >= FEW_INLIERS) {
        return fine;
    }
    let coarse = pose(start, &MatchOptions { finest: 2, ..*options });
    let again = coarse.as_ref().and_then(|(coarse, _)| pose(&coarse.world_from_camera, options));
    [fine, coarse, again].into_iter().flatten().max_by_key(|(found, _)| found.inliers.len())
}

/// D. The pose that fits the static matches. Landmarks that move count as new from now on.
pub(super) fn pose_without_moving(
    map: &mut LocalMap,
    view: &View<'_>,
    matches: Vec<Match>,
    start: &Se3,
    options: &MatchOptions,
) -> Option<RefinedPose> {
    let (moving, still): (Vec<Match>, Vec<Match>) =
        matches.into_iter().partition(|found| view.is_moving(&found.pixel));
    for found in moving {
        map.landmarks[found.landmark].times_tracked = 0;
    }
    let refined = refine_pose(view.camera, map, &still, start, LEAST_INLIERS);
    if refined.as_ref().is_some_and(|refined| refined.inliers.len() >= FEW_INLIERS) {
        return refined;
    }
    let again = find_pose(map, view, start, options).map(|(again, _)| again);
    [refined, again].into_iter().flatten().max_by_key(|refined| refined.inliers.len())
}
