//! How far away is what a keyframe sees: the scale on which its motions are large or small, and its odometry
//! is uncertain.

use super::numbers::median;
use super::{Keyframe, Map};

/// Most landmarks of a keyframe that are asked for their distance.
const MOST_ASKED: usize = 16;

impl Map {
    /// The median distance of what a keyframe sees of the map, from about 16 of its landmarks; `None` where it
    /// sees nothing.
    pub(super) fn view_distance(&self, keyframe: &Keyframe) -> Option<f64> {
        let step = keyframe.observations.len().div_ceil(MOST_ASKED).max(1);
        let asked = keyframe.observations.iter().step_by(step);
        let positions = asked.filter_map(|seen| self.landmarks().get(&seen.landmark)?.position);
        let at = keyframe.world_from_camera.translation;
        let distances = positions.map(|position| (position - at).norm());
        median(distances.filter(|distance| distance.is_finite()).collect())
    }
}
