//! Which motions a measurement could notice.
//!
//! A solve that the map starts by itself looks at all of it, though a closure moves a part. What shifts the
//! views of a keyframe by less than they can be measured stays as it is: the event, the watchers and what
//! adjusts the surroundings of the closure then have that part alone to do with. Nothing adds up: the next
//! solve finds the whole shift again.

use std::collections::BTreeMap;

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Vector3;

use super::{AppliedSolve, EntityId, Keyframe, Map};

/// The least angle that is noticed, rad: a tenth of a pixel where the focal length is 500 pixels.
const LEAST_ANGLE: f64 = 2e-4;

/// How often that is far: two pixels. Bundle adjustment finds what is nearer by itself, and one that began before
/// a motion of that size is worth nothing.
const FAR: f64 = 20.0;

/// The motion of a keyframe as an angle at which its views see it, rad; infinite where it sees nothing.
fn shift(map: &Map, keyframe: &Keyframe, new: &Se3) -> f64 {
    let now = &keyframe.world_from_camera;
    if new == now {
        return 0.0;
    }
    let Some(distance) = map.view_distance(keyframe) else { return f64::INFINITY };
    let motion = now.inverse().compose(new);
    (motion.translation.norm() / distance).max(motion.rotation.log().norm())
}

/// Whether a new pose of a keyframe is far from the one that it has.
pub(super) fn is_far(map: &Map, keyframe: &Keyframe, new: &Se3) -> bool {
    shift(map, keyframe, new) > FAR * LEAST_ANGLE
}

/// Takes out what stays where it is as far as measurements can tell.
pub(super) fn keep_noticeable(
    map: &Map,
    poses: &mut BTreeMap<EntityId, Se3>,
    landmarks: &mut Vec<(EntityId, Vector3<f64>)>,
) {
    let is_noticed = |shift: f64| shift.is_nan() || shift > LEAST_ANGLE;
    poses.retain(|id, new| {
        map.keyframes().get(id).is_none_or(|known| is_noticed(shift(map, known, new)))
    });
    landmarks.retain(|(id, new)| {
        let Some(known) = map.landmarks().get(id) else { return true };
        let seen_by = known.reference.and_then(|reference| map.keyframes().get(&reference));
        let (Some(seen_by), Some(now)) = (seen_by, known.position) else { return true };
        let distance = (now - seen_by.world_from_camera.translation).norm();
        is_noticed((new - now).norm() / distance)
    });
}

impl Map {
    /// Whether the result of a solve moves a keyframe so far that a solve of it that began before is worth
    /// nothing.
    pub fn moves_far(&self, solve: &AppliedSolve, is_solved: impl Fn(EntityId) -> bool) -> bool {
        let solved = solve.poses.iter().filter(|(id, _)| is_solved(*id));
        let known = solved.filter_map(|(id, new)| Some((self.keyframes().get(id)?, new)));
        known.into_iter().any(|(known, new)| is_far(self, known, new))
    }
}
