//! Whether a pose graph has anything to correct.
//!
//! A pose graph and bundle adjustment do not agree to the last millimeter: one has the relative poses of
//! pairs, the other all observations. If each pose graph moved the map to its own optimum, it would undo the
//! adjustment before it, everywhere, and all would have to be adjusted again. So closures that come to a map
//! which they fit are judged, and move nothing; where one is off by little, bundle adjustment of what it
//! joins, which has it as a factor, brings both together. For a robot in known places that is all.

use covis_solvers::geometry::LieGroup;
use covis_solvers::robust::default_threshold;

use super::{ClosureEdge, GraphProblem};
use crate::Map;
use crate::noticeable::is_far;

impl GraphProblem {
    /// Whether the map as it is contradicts the solved graph: a closure is judged otherwise than before, or one
    /// that counts fits worse in the map than noise explains and joins its keyframes so far from where they
    /// are that bundle adjustment might not find there.
    #[must_use]
    pub fn contradicts(&self, map: &Map) -> bool {
        self.closures.iter().any(|closure| self.contradicts_by(map, closure).unwrap_or(false))
    }

    /// `None` where the map has not got it any more.
    fn contradicts_by(&self, map: &Map, closure: &ClosureEdge) -> Option<bool> {
        let was_off = map.switched_off().contains_key(&closure.constraint);
        if was_off || closure.switched_off.is_some() {
            return Some(was_off != closure.switched_off.is_some());
        }
        let edge = self.graph.edges.get(closure.edge)?;
        let ends = [edge.i, edge.j];
        let [found_i, found_j] = ends.map(|pose| self.graph.poses.get(pose));
        let [i, j] = ends.map(|pose| map.keyframes().get(self.keyframes.get(pose)?));
        let (found_i, found_j, i, j) = (found_i?, found_j?, i?, j?);
        let now = edge.chi2(&i.world_from_camera, &j.world_from_camera);
        if now <= edge.chi2(found_i, found_j) + default_threshold(6) {
            return Some(false);
        }
        let i_from_j = found_i.inverse().compose(found_j);
        Some(is_far(map, j, &i.world_from_camera.compose(&i_from_j)))
    }
}
