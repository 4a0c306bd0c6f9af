//! First positions of landmarks that a client sent without one.
//!
//! Every keyframe that sees the landmark is a view; the solver crate finds the point and refuses it for
//! too little parallax, for lying behind a camera or for views that contradict each other. A refused
//! landmark is not part of a solve, so that a wrong match cannot affect the poses. Its observations
//! stay, and it is tried again with the next keyframe that sees it, at the poses of that time. With a
//! measured depth one view is enough. Landmarks with a position are never changed.

use covis_solvers::initialization::{TriangulationOptions, View, triangulate as triangulate_views};
use nalgebra::Vector3;

use super::numbers::is_finite;
use super::{EntityId, Map};

/// Whether `keyframe` sees a landmark without position.
#[must_use]
pub fn has_unplaced(map: &Map, keyframe: EntityId) -> bool {
    let observations = map.keyframes().get(&keyframe).map(|k| &*k.observations);
    let mut seen =
        observations.unwrap_or_default().iter().map(|o| map.landmarks().get(&o.landmark));
    seen.any(|landmark| landmark.is_some_and(|l| l.position.is_none()))
}

/// Positions for those landmarks of `keyframe` that have none and can be triangulated now, by id.
#[must_use]
pub fn triangulate(map: &Map, keyframe: EntityId) -> Vec<(EntityId, Vector3<f64>)> {
    let Some(keyframe) = map.keyframes().get(&keyframe) else { return Vec::new() };
    let options = TriangulationOptions::default();
    let mut positions: Vec<(EntityId, Vector3<f64>)> = keyframe
        .observations
        .iter()
        .filter_map(|observation| {
            let id = observation.landmark;
            let landmark = map.landmarks().get(&id).filter(|l| l.position.is_none())?;
            let views: Vec<View> = landmark
                .observers
                .iter()
                .filter_map(|observer| map.keyframes().get(observer))
                .flat_map(|keyframe| map.views(keyframe))
                .filter_map(|view| view.of(id))
                .collect();
            let point = triangulate_views(&views, &options).ok()?.point_in_world;
            is_finite(&point).then_some((id, point))
        })
        .collect();
    positions.sort_by_key(|&(id, _)| id);
    positions
}
