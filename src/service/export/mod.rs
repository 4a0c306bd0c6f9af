//! Exports: the files of a map in each format, made while they are read.
//!
//! An [`Export`] has one snapshot and a position in it, and makes the next chunk on request. It
//! never holds a whole file, however large the map and however slow the reader. `covis_solvers::io`
//! writes the records; `parts.rs` gives a map's entities ids and names that a format can contain.

mod colmap;
mod graph;
mod parts;
#[cfg(test)]
mod tests;

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;

use covis_solvers::io::colmap::ColmapEncoding;
use covis_solvers::io::ply::PlyEncoding;
use covis_solvers::io::trajectory::Trajectory;

use self::colmap::Numbers;
pub(super) use self::graph::GraphLines;
use self::parts::{Cursor, Part, PlyPath};
use super::convert::entities::clients_by_name;
use super::convert::{Path, Violations, convert};
use super::error::ServiceError;
use crate::map::{Map, Reason};
use crate::store::MAP_FILE;
use crate::wire::v1;

/// Most bytes of a file in one message. For a reader that does not read, the server holds a few of
/// them.
pub(super) const CHUNK_BYTES: usize = 1 << 18;
/// Color of landmarks.
const LANDMARK_COLOR: [u8; 3] = [120, 144, 180];
/// Color of keyframes.
const KEYFRAME_COLOR: [u8; 3] = [220, 80, 40];

/// A format of maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    /// COLMAP sparse model.
    Colmap(ColmapEncoding),
    /// TUM trajectories, one per client.
    Tum,
    /// Pose graph.
    G2o,
    /// Points and trajectories for viewers; is not imported.
    Ply,
    /// All of the map.
    Covis,
}

/// What an export writes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Choice {
    pub(super) format: Format,
    /// Of COLMAP's formats: also landmarks that fewer than two keyframes observe.
    pub(super) all_landmarks: bool,
}

/// What a request asks for.
pub(super) fn choice(request: &v1::ExportMapRequest) -> Result<Choice, ServiceError> {
    Ok(convert(|out| {
        let format = read_format(Path::root("format"), request.format, out)?;
        let all_landmarks = request.all_landmarks;
        if all_landmarks && !matches!(format, Format::Colmap(_)) {
            let text = "only COLMAP's formats leave landmarks out";
            return out.report(Path::root("all_landmarks"), Reason::Inconsistent, text);
        }
        Some(Choice { format, all_landmarks })
    })?)
}

/// The format that a field names.
pub(super) fn read_format(at: Path<'_>, value: i32, out: &mut Violations) -> Option<Format> {
    Some(match out.known(at, value)? {
        v1::MapFormat::Unspecified => return out.missing(at),
        v1::MapFormat::ColmapText => Format::Colmap(ColmapEncoding::Text),
        v1::MapFormat::ColmapBinary => Format::Colmap(ColmapEncoding::Binary),
        v1::MapFormat::Tum => Format::Tum,
        v1::MapFormat::G2o => Format::G2o,
        v1::MapFormat::Ply => Format::Ply,
        v1::MapFormat::Covis => Format::Covis,
    })
}

/// The part of an exported file that is not made yet.
struct File {
    path: String,
    parts: VecDeque<Part>,
}

/// An export in progress.
pub(super) struct Export {
    name: String,
    map: Arc<Map>,
    files: VecDeque<File>,
    /// Bytes of the first file that were sent.
    offset: usize,
    /// Bytes that were made and not sent yet: at most about one chunk.
    made: Vec<u8>,
}

impl Export {
    /// The export of `map`, which is called `name`. Blocks briefly.
    ///
    /// # Errors
    /// [`ServiceError::FormatCannotHoldMap`].
    pub(super) fn new(name: String, map: Arc<Map>, choice: Choice) -> Result<Self, ServiceError> {
        let files = match choice.format {
            Format::Colmap(encoding) => colmap(&map, encoding, choice.all_landmarks),
            Format::Tum => Ok(tum(&map)),
            Format::G2o => g2o(&map),
            Format::Ply => Ok(ply(&map)),
            Format::Covis => Ok(VecDeque::from([file(MAP_FILE, [Part::covis()])])),
        };
        match files {
            Ok(files) => Ok(Self { name, map, files, offset: 0, made: Vec::new() }),
            Err(reason) => Err(ServiceError::FormatCannotHoldMap { map: name, reason }),
        }
    }

    /// The same with the edges of a g2o file, which take longer to make: `lines` are those of the pose
    /// graph of the map.
    pub(super) fn with_graph(mut self, lines: GraphLines) -> Self {
        if let Some(file) = self.files.back_mut() {
            file.parts.push_back(Part::G2oGraph(lines));
        }
        self
    }

    /// The revision that is exported.
    pub(super) fn revision(&self) -> i64 {
        self.map.revision()
    }

    /// The paths of the remaining files, in order.
    pub(super) fn paths(&self) -> Vec<String> {
        self.files.iter().map(|file| file.path.clone()).collect()
    }

    /// Makes the next chunk; each file has at least one. Blocks briefly.
    ///
    /// # Errors
    /// [`ServiceError::FormatCannotHoldMap`].
    pub(super) fn next_chunk(&mut self) -> Result<Option<v1::FileChunk>, ServiceError> {
        let Some(file) = self.files.front_mut() else { return Ok(None) };
        // One byte more than a chunk shows that the chunk is not the last one.
        while self.made.len() <= CHUNK_BYTES
            && let Some(part) = file.parts.front_mut()
        {
            let put = part.put(&self.map, CHUNK_BYTES, &mut self.made);
            let has_more = put.map_err(|reason| {
                let map = self.name.clone();
                ServiceError::FormatCannotHoldMap { map, reason }
            })?;
            if !has_more {
                file.parts.pop_front();
            }
        }
        let rest = self.made.split_off(self.made.len().min(CHUNK_BYTES));
        let data = std::mem::replace(&mut self.made, rest);
        let last_chunk = self.made.is_empty() && file.parts.is_empty();
        let (path, offset) = (file.path.clone(), self.offset);
        self.offset += data.len();
        if last_chunk {
            self.files.pop_front();
            self.offset = 0;
        }
        let offset = super::convert::count(offset);
        Ok(Some(v1::FileChunk { path, offset, data, last_chunk }))
    }
}

fn file(path: impl Into<String>, parts: impl IntoIterator<Item = Part>) -> File {
    File { path: path.into(), parts: parts.into_iter().collect() }
}

/// Cameras, images and points are numbered from 1 in the map's order. The name of an image is
/// `client/keyframe`. Landmarks without a position are no points, and unless all are asked for neither are
/// those that fewer than two keyframes observe.
fn colmap(
    map: &Map,
    encoding: ColmapEncoding,
    all_landmarks: bool,
) -> Result<VecDeque<File>, String> {
    let numbers = Arc::new(Numbers::of(map, all_landmarks)?);
    let [cameras, images, points] = encoding.file_names();
    let mut heads = [const { Vec::new() }; 3];
    let [camera_head, image_head, point_head] = &mut heads;
    encoding.put_cameras_head(map.cameras().len(), camera_head);
    encoding.put_images_head(map.keyframes().len(), image_head);
    encoding.put_points_head(numbers.point_count(), point_head);
    let [camera_head, image_head, point_head] = heads.map(Part::Bytes);
    let start = Cursor::start;
    let image = Part::ColmapImages(encoding, Arc::clone(&numbers), start());
    let point = Part::ColmapPoints(encoding, Arc::clone(&numbers), start());
    Ok(VecDeque::from([
        file(cameras, [camera_head, Part::ColmapCameras(encoding, numbers, start())]),
        file(images, [image_head, image]),
        file(points, [point_head, point]),
    ]))
}

fn tum(map: &Map) -> VecDeque<File> {
    let mut files = VecDeque::new();
    for (name, client) in clients_by_name(map) {
        if parts::keyframe_count(map, client) > 0 {
            let head = Part::Bytes(Trajectory::HEAD.to_vec());
            files.push_back(file(format!("{name}.tum"), [head, Part::tum(client)]));
        }
    }
    files
}

/// Vertex ids are keyframe ids, which only works while no two clients share one.
fn g2o(map: &Map) -> Result<VecDeque<File>, String> {
    let mut ids = BTreeSet::new();
    for id in map.keyframes().keys() {
        if !ids.insert(id.id) {
            let text = "g2o names vertices by number only";
            return Err(format!("several clients have a keyframe {}: {text}", id.id));
        }
    }
    Ok(VecDeque::from([file("graph.g2o", [Part::G2oVertices(Cursor::start())])]))
}

fn ply(map: &Map) -> VecDeque<File> {
    let points = map.landmarks().values().filter(|l| l.position.is_some()).count();
    let (mut paths, mut vertices, mut edges) = (Vec::new(), points, 0);
    for (_, client) in clients_by_name(map) {
        let count = parts::keyframe_count(map, client);
        paths.push(PlyPath { client, first: vertices, count });
        vertices += count;
        edges += count.saturating_sub(1);
    }
    let mut head = Vec::new();
    PlyEncoding::Binary.put_head(vertices, edges, &mut head);
    let lines = paths.iter().map(|path| Part::ply(path.client));
    let mut parts = vec![Part::Bytes(head), Part::PlyPoints(Cursor::start())];
    parts.extend(lines);
    parts.push(Part::PlyEdges(paths));
    VecDeque::from([file("map.ply", parts)])
}
