//! The files of an export: which bytes stand for a map in each format.
//!
//! Writers are those of `covis_solvers::io`; here a map's entities get the ids and names that a
//! format has room for. COLMAP: cameras, images and points are numbered from 1 in the map's order,
//! an image is called `client/keyframe`; landmarks without a position are left out. g2o: vertex ids
//! are keyframe ids, which only works while no two clients share one.

use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::Se3;
use covis_solvers::io::colmap::{
    ColmapCamera, ColmapEncoding, ColmapImage, ColmapModel, ColmapPoint,
};
use covis_solvers::io::g2o::G2oSe3;
use covis_solvers::io::ply::{PlyEncoding, PlyFile};
use covis_solvers::io::trajectory::Trajectory;
use covis_solvers::problem::PoseGraph;

use super::convert::entities::clients_by_name;
use super::convert::ids::client_name;
use super::error::ServiceError;
use crate::map::{EntityId, Map, Reason};
use crate::wire::v1;

/// Most bytes of a file in one message.
pub(super) const CHUNK_BYTES: usize = 1 << 20;
/// Color of landmarks.
const LANDMARK_COLOR: [u8; 3] = [120, 144, 180];
/// Color of keyframes.
const KEYFRAME_COLOR: [u8; 3] = [220, 80, 40];

/// A file of an export.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct File {
    /// Path below the folder of the export.
    pub path: String,
    /// What it holds.
    pub bytes: Vec<u8>,
}

/// A format that is served.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    /// COLMAP sparse model.
    Colmap(ColmapEncoding),
    /// TUM trajectories, one a client.
    Tum,
    /// Pose graph.
    G2o,
    /// Points and trajectories for viewers.
    Ply,
}

/// The format of a request.
pub(super) fn format(value: i32) -> Result<Format, ServiceError> {
    match v1::MapFormat::try_from(value) {
        Ok(v1::MapFormat::Unspecified) => {
            Err(ServiceError::field("format", Reason::Missing, "required"))
        }
        Ok(v1::MapFormat::ColmapText) => Ok(Format::Colmap(ColmapEncoding::Text)),
        Ok(v1::MapFormat::ColmapBinary) => Ok(Format::Colmap(ColmapEncoding::Binary)),
        Ok(v1::MapFormat::Tum) => Ok(Format::Tum),
        Ok(v1::MapFormat::G2o) => Ok(Format::G2o),
        Ok(v1::MapFormat::Ply) => Ok(Format::Ply),
        Ok(v1::MapFormat::Covis) => Err(ServiceError::Unserved { what: "MAP_FORMAT_COVIS" }),
        Err(_unknown) => {
            let text = format!("unknown value {value}");
            Err(ServiceError::field("format", Reason::UnknownValue, text))
        }
    }
}

/// The files of `map`, which is called `name`.
pub(super) fn files(name: &str, map: &Map, format: Format) -> Result<Vec<File>, ServiceError> {
    let unfit = |reason: String| ServiceError::FormatCannotHoldMap { map: name.to_owned(), reason };
    match format {
        Format::Colmap(encoding) => {
            let files = colmap(map)
                .and_then(|model| model.to_files(encoding).map_err(|error| error.to_string()));
            let files = files.map_err(unfit)?.into_iter();
            Ok(files.map(|(path, bytes)| File { path: path.to_owned(), bytes }).collect())
        }
        Format::Tum => Ok(tum(map)),
        Format::G2o => {
            let bytes = g2o(map).map_err(unfit)?;
            Ok(vec![File { path: "graph.g2o".to_owned(), bytes }])
        }
        Format::Ply => Ok(vec![File { path: "map.ply".to_owned(), bytes: ply(map) }]),
    }
}

/// Numbers entities from 1 in the map's order.
fn numbered<'a>(ids: impl IntoIterator<Item = &'a EntityId>) -> BTreeMap<EntityId, u32> {
    ids.into_iter().copied().zip(1u32..).collect()
}

fn colmap(map: &Map) -> Result<ColmapModel, String> {
    let cameras = numbered(map.cameras().keys());
    let images = numbered(map.keyframes().keys());
    let points =
        numbered(map.landmarks().iter().filter(|(_, l)| l.position.is_some()).map(|(id, _)| id));
    let mut model = ColmapModel::default();
    for (id, entity) in map.cameras() {
        let (width, height) = (u64::from(entity.width_px), u64::from(entity.height_px));
        let camera = ColmapCamera::from_camera(&entity.camera, width, height);
        model.cameras.insert(cameras.get(id).copied().unwrap_or_default(), camera);
    }
    for (id, landmark) in map.landmarks() {
        if let (Some(&number), Some(position)) = (points.get(id), &landmark.position) {
            model.points.insert(number.into(), ColmapPoint::new(position, LANDMARK_COLOR));
        }
    }
    for (id, keyframe) in map.keyframes() {
        let image = images.get(id).copied().unwrap_or_default();
        let name = format!("{}/{}", client_name(map, *id), id.id);
        let camera = keyframe.camera.and_then(|id| cameras.get(&id)).copied();
        let camera = camera.ok_or_else(|| format!("keyframe {name} has no camera"))?;
        model.images.insert(image, ColmapImage::new(name, camera, &keyframe.world_from_camera));
        for observation in keyframe.observations.iter() {
            if let Some(&point) = points.get(&observation.landmark) {
                let pushed = model.push_observation(image, &observation.pixel, point.into());
                pushed.map_err(|error| error.to_string())?;
            }
        }
    }
    Ok(model)
}

fn tum(map: &Map) -> Vec<File> {
    let clients = clients_by_name(map).into_iter();
    clients
        .filter_map(|(name, client)| {
            let mut trajectory = Trajectory::default();
            for (_, keyframe) in map.trajectory(client) {
                let seconds = keyframe.capture_time_ns as f64 * 1e-9;
                trajectory.push(seconds, keyframe.world_from_camera);
            }
            let path = format!("{name}.tum");
            (!trajectory.is_empty()).then(|| File { path, bytes: trajectory.to_bytes() })
        })
        .collect()
}

fn g2o(map: &Map) -> Result<Vec<u8>, String> {
    let mut ids = BTreeSet::new();
    for id in map.keyframes().keys() {
        if !ids.insert(id.id) {
            let text = "g2o names vertices by number only";
            return Err(format!("several clients have a keyframe {}: {text}", id.id));
        }
    }
    let index: BTreeMap<EntityId, usize> = map.keyframes().keys().copied().zip(0..).collect();
    let mut graph = PoseGraph::<Se3, 6>::new();
    for (id, keyframe) in map.keyframes() {
        graph.push_pose(id.id, keyframe.world_from_camera);
    }
    // A file cannot mark what is switched off, and its reader would be bent by it.
    for (_, constraint) in map.active_constraints() {
        let ends = (index.get(&constraint.keyframe_i), index.get(&constraint.keyframe_j));
        if let (Some(&i), Some(&j)) = ends {
            let i_from_j = constraint.keyframe_i_from_keyframe_j;
            graph.edges.push(RelativePose { i, j, i_from_j, information: constraint.information });
        }
    }
    let file = G2oSe3::from_pose_graph(&graph).map_err(|error| error.to_string())?;
    Ok(file.to_bytes())
}

fn ply(map: &Map) -> Vec<u8> {
    let mut file = PlyFile::default();
    let landmarks = map.landmarks().values().filter_map(|l| l.position.as_ref());
    file.push_points(landmarks, LANDMARK_COLOR);
    for (_, client) in clients_by_name(map) {
        let trajectory = map.trajectory(client);
        let positions = trajectory.iter().map(|(_, k)| &k.world_from_camera.translation);
        file.push_polyline(positions, KEYFRAME_COLOR);
    }
    file.to_bytes(PlyEncoding::Binary)
}

/// The chunks of a file, at least one.
pub(super) fn chunks(file: &File) -> impl Iterator<Item = v1::FileChunk> + '_ {
    let count = file.bytes.len().div_ceil(CHUNK_BYTES).max(1);
    (0..count).map(move |index| {
        let offset = index * CHUNK_BYTES;
        let end = file.bytes.len().min(offset + CHUNK_BYTES);
        v1::FileChunk {
            path: file.path.clone(),
            offset: super::convert::count(offset),
            data: file.bytes[offset..end].to_vec(),
            last_chunk: index + 1 == count,
        }
    })
}
