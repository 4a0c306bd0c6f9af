//! Whether a local solve may move a landmark.
//!
//! If two rays meet at less than about 1°, noise determines the depth of a point: a window would move
//! it far away or behind a camera, and neither later keyframes nor a solve of the whole map would
//! correct it. Such a landmark is left out of local bundle adjustment until it has more parallax; it
//! keeps the position that was sent and follows its reference keyframe. A measured depth alone is
//! enough. Whole-map solves include all landmarks.

use covis_solvers::geometry::Se3;
use nalgebra::Vector3;

use super::{EntityId, Landmark, Map};

/// Cosine of the least angle, 1°, between the ray of the first observer and another one.
const MIN_PARALLAX_COS: f64 = 0.999_847_695_156_391_3;

/// Whether a landmark of the map at `position` lies in front of all its observers and is seen from far
/// enough apart, or has a measured depth. `pose` gives each observer's `world_from_camera`.
pub(super) fn is_well_placed(
    map: &Map,
    id: EntityId,
    landmark: &Landmark,
    position: &Vector3<f64>,
    pose: impl Fn(EntityId) -> Option<Se3>,
) -> bool {
    if has_depth(map, id, landmark) {
        return true;
    }
    let mut first: Option<Vector3<f64>> = None;
    let mut has_parallax = false;
    for &observer in &landmark.observers {
        let Some(world_from_camera) = pose(observer) else { continue };
        if world_from_camera.inverse_transform(position).z <= 0.0 {
            return false;
        }
        let ray = (position - world_from_camera.translation).normalize();
        match &first {
            None => first = Some(ray),
            Some(first) => has_parallax |= first.dot(&ray) < MIN_PARALLAX_COS,
        }
    }
    has_parallax
}

/// Whether an observer measured the landmark's depth.
pub(super) fn has_depth(map: &Map, id: EntityId, landmark: &Landmark) -> bool {
    landmark.observers.iter().any(|keyframe| {
        let keyframe = map.keyframes().get(keyframe);
        keyframe.and_then(|k| k.observation_of(id)).is_some_and(|o| o.depth.is_some())
    })
}
