//! Parts of a file, each with its position in the map: a run of records of one kind.
//!
//! A part writes until a chunk is full and continues from there at the next call. What was written
//! is not kept here.

use std::sync::Arc;

use covis_solvers::io::colmap::ColmapEncoding;
use covis_solvers::io::g2o::{G2oSe3, G2oVertex};
use covis_solvers::io::ply::{PlyEncoding, PlyVertex};
use covis_solvers::io::trajectory::Trajectory;

use super::colmap::Numbers;
use super::graph::GraphLines;
use super::{KEYFRAME_COLOR, LANDMARK_COLOR};
use crate::map::{ClientIndex, EntityId, Keyframe, Map, SharedMap};
use crate::store::MapFileWriter;

/// A position in a table: the id where it continues, `None` at the end.
pub(super) struct Cursor(Option<EntityId>);

/// The last id of all.
const LAST: EntityId = EntityId { client: ClientIndex(u32::MAX), id: i64::MAX };

impl Cursor {
    pub(super) fn start() -> Self {
        Self(Some(EntityId::new(ClientIndex(0), i64::MIN)))
    }

    /// Writes entries until `out` has more than `most` bytes; returns whether there may be more.
    fn put<'m, V: 'm, I: Iterator<Item = (&'m EntityId, &'m V)>>(
        &mut self,
        entries: impl FnOnce(EntityId) -> I,
        most: usize,
        out: &mut Vec<u8>,
        mut write: impl FnMut(EntityId, &'m V, &mut Vec<u8>) -> Result<(), String>,
    ) -> Result<bool, String> {
        let Some(first) = self.0 else { return Ok(false) };
        for (&id, value) in entries(first) {
            if out.len() > most {
                self.0 = Some(id);
                return Ok(true);
            }
            write(id, value, out)?;
        }
        self.0 = None;
        Ok(false)
    }
}

/// The entries of a table from `first` on.
fn from<'m, V>(table: &'m SharedMap<EntityId, V>) -> impl FnOnce(EntityId) -> Entries<'m, V> {
    |first| Box::new(table.range(first..=LAST))
}

type Entries<'m, V> = Box<dyn Iterator<Item = (&'m EntityId, &'m V)> + 'm>;

/// How many keyframes `client` has.
pub(super) fn keyframe_count(map: &Map, client: ClientIndex) -> usize {
    let range = EntityId::new(client, i64::MIN)..=EntityId::new(client, i64::MAX);
    map.keyframes().range(range).count()
}

/// The keyframes of a client in the order of their capture.
pub(super) struct Path {
    client: ClientIndex,
    /// Their ids, once the part has begun.
    order: Option<std::vec::IntoIter<EntityId>>,
}

impl Path {
    fn put(
        &mut self,
        map: &Map,
        most: usize,
        out: &mut Vec<u8>,
        write: impl Fn(&Keyframe, &mut Vec<u8>),
    ) -> bool {
        let client = self.client;
        let order = self.order.get_or_insert_with(|| {
            let ids: Vec<_> = map.trajectory(client).into_iter().map(|(id, _)| id).collect();
            ids.into_iter()
        });
        while out.len() <= most {
            let Some(id) = order.next() else { return false };
            if let Some(keyframe) = map.keyframes().get(&id) {
                write(keyframe, out);
            }
        }
        true
    }
}

/// The polyline of a client: which vertices it joins.
pub(super) struct PlyPath {
    pub(super) client: ClientIndex,
    /// The number of its first vertex.
    pub(super) first: usize,
    /// How many vertices it has.
    pub(super) count: usize,
}

/// Records of one kind.
pub(super) enum Part {
    Bytes(Vec<u8>),
    ColmapCameras(ColmapEncoding, Arc<Numbers>, Cursor),
    ColmapImages(ColmapEncoding, Arc<Numbers>, Cursor),
    ColmapPoints(ColmapEncoding, Arc<Numbers>, Cursor),
    Tum(Path),
    G2oVertices(Cursor),
    G2oGraph(GraphLines),
    PlyPoints(Cursor),
    PlyLine(Path),
    PlyEdges(Vec<PlyPath>),
    Covis(MapFileWriter),
}

impl Part {
    pub(super) fn tum(client: ClientIndex) -> Self {
        Self::Tum(Path { client, order: None })
    }

    pub(super) fn covis() -> Self {
        Self::Covis(MapFileWriter::default())
    }

    pub(super) fn ply(client: ClientIndex) -> Self {
        Self::PlyLine(Path { client, order: None })
    }

    /// Appends records to `out` until it has more than `most` bytes; returns whether there may be
    /// more.
    pub(super) fn put(
        &mut self,
        map: &Map,
        most: usize,
        out: &mut Vec<u8>,
    ) -> Result<bool, String> {
        match self {
            Self::Bytes(bytes) => {
                out.append(bytes);
                Ok(false)
            }
            Self::ColmapCameras(encoding, numbers, at) => {
                let cameras = |first| map.cameras().range(first..=LAST);
                at.put(cameras, most, out, |id, camera, out| {
                    numbers.put_camera(*encoding, id, camera, out);
                    Ok(())
                })
            }
            Self::ColmapImages(encoding, numbers, at) => {
                at.put(from(map.keyframes()), most, out, |id, keyframe, out| {
                    numbers.put_image(*encoding, map, id, keyframe, out)
                })
            }
            Self::ColmapPoints(encoding, numbers, at) => {
                at.put(from(map.landmarks()), most, out, |id, landmark, out| {
                    numbers.put_point(*encoding, map, id, landmark, out);
                    Ok(())
                })
            }
            Self::Tum(path) => Ok(path.put(map, most, out, |keyframe, out| {
                Trajectory::put_pose(keyframe.capture_time_ns, &keyframe.world_from_camera, out);
            })),
            Self::G2oVertices(at) => at.put(from(map.keyframes()), most, out, |id, k, out| {
                G2oSe3::put_vertex(&G2oVertex::new(id.id, &k.world_from_camera), out);
                Ok(())
            }),
            Self::G2oGraph(lines) => Ok(lines.put(most, out)),
            Self::PlyPoints(at) => at.put(from(map.landmarks()), most, out, |_, landmark, out| {
                if let Some(position) = landmark.position {
                    let vertex = PlyVertex { position, color: LANDMARK_COLOR };
                    PlyEncoding::Binary.put_vertex(&vertex, out);
                }
                Ok(())
            }),
            Self::PlyLine(path) => Ok(path.put(map, most, out, |keyframe, out| {
                let position = keyframe.world_from_camera.translation;
                let vertex = PlyVertex { position, color: KEYFRAME_COLOR };
                PlyEncoding::Binary.put_vertex(&vertex, out);
            })),
            Self::PlyEdges(paths) => Ok(edges(paths, most, out)),
            Self::Covis(file) => Ok(file.put(map, most, out)),
        }
    }
}

/// Writes the segments of polylines, and removes from each what was written.
fn edges(paths: &mut [PlyPath], most: usize, out: &mut Vec<u8>) -> bool {
    for path in paths.iter_mut() {
        while path.count > 1 {
            if out.len() > most {
                return true;
            }
            let index = u32::try_from(path.first).unwrap_or(u32::MAX);
            PlyEncoding::Binary.put_edge([index, index.saturating_add(1)], out);
            path.first += 1;
            path.count -= 1;
        }
    }
    false
}
