//! The surface that a run has fused, as a message of a recording. Only converts.

use super::scene::{MAP, identity, timestamp};
use super::schemas::foxglove as fx;
use crate::frontend::dense::surface::Mesh;

/// A scene that has the mesh in the frame of the map.
pub(super) fn surface(mesh: &Mesh, time_ns: u64) -> fx::SceneUpdate {
    let point =
        |[x, y, z]: &[f32; 3]| fx::Point3 { x: f64::from(*x), y: f64::from(*y), z: f64::from(*z) };
    let color = |color: &[u8; 3]| {
        let [r, g, b] = color.map(|channel| f64::from(channel) / 255.0);
        fx::Color { r, g, b, a: 1.0 }
    };
    let triangles = fx::TriangleListPrimitive {
        pose: Some(identity()),
        points: mesh.positions.iter().map(point).collect(),
        colors: mesh.colors.iter().map(color).collect(),
        indices: mesh.triangles.iter().flatten().copied().collect(),
    };
    let entity = fx::SceneEntity {
        timestamp: Some(timestamp(time_ns)),
        frame_id: MAP.to_owned(),
        id: "mesh".to_owned(),
        frame_locked: true,
        triangles: vec![triangles],
        ..fx::SceneEntity::default()
    };
    fx::SceneUpdate { deletions: Vec::new(), entities: vec![entity] }
}
