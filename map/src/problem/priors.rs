//! Priors in pose graphs, and what holds a piece of the map that has none.
//!
//! Priors on whole poses and on positions enter with their own information and loss. A position prior
//! that is switched off enters too, because it is judged again, and says where its piece is as the
//! others do: what is held does not depend on earlier verdicts. `gauge` decides what is held; a pose
//! graph has no other frame, so that it holds a keyframe of each piece without priors under any gauge.
//! Nothing is solved here.

use covis_solvers::factors::{PosePrior, PositionPrior};
use covis_solvers::geometry::Se3;
use covis_solvers::problem::{DisjointSets, PoseGraph};

use super::JudgedPosition;
use crate::gauge::held_poses;
use crate::{EntityId, Gauge, GraphPairs, Map, Prior};

/// Adds the priors of `map` to its graph, and holds the first keyframe of each piece that `gauge`
/// wants held. Returns the position priors in their order in the graph.
pub(super) fn add(
    map: &Map,
    gauge: Gauge,
    pairs: &GraphPairs<'_>,
    keyframes: &[EntityId],
    graph: &mut PoseGraph<Se3, 6>,
) -> Vec<JudgedPosition> {
    let mut positions = Vec::new();
    for (&id, prior) in map.priors() {
        let Some(pose) = pairs.index(prior.keyframe()) else { continue };
        match *prior {
            Prior::Pose { world_from_camera, information, loss, .. } => {
                let prior = PosePrior { pose, world_from_camera, information, loss };
                graph.pose_priors.push(prior);
            }
            Prior::Position { position_in_world, point_in_camera, information, loss, .. } => {
                graph.position_priors.push(PositionPrior {
                    pose,
                    position_in_world,
                    point_in_camera,
                    information,
                    loss,
                });
                let switched_off = map.switched_off().get(&id).copied();
                positions.push(JudgedPosition { prior: id, switched_off });
            }
        }
    }
    let mut pieces = DisjointSets::new(graph.poses.len());
    graph.edges.iter().for_each(|edge| _ = pieces.join(edge.i, edge.j));
    let whole = graph.pose_priors.iter().map(|prior| prior.pose);
    let placed = whole.chain(graph.position_priors.iter().map(|prior| prior.pose));
    for pose in held_poses(map, gauge, keyframes, pieces, placed) {
        graph.constant[pose] = true;
    }
    positions
}
