//! Maps from the files of COLMAP and TUM; g2o files have `graph.rs`.
//!
//! `covis_solvers::io` reads the files. What they hold becomes items of one client (of one client a
//! file for TUM), which the map checks and folds as it does those of a stream; no solve runs. So an
//! error names the file and the line or byte, or the record and what is wrong with it.

use std::fmt::Display;
use std::path::Path;

use covis_solvers::geometry::Se3;
use covis_solvers::io::IoError;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapImage, ColmapModel};
use covis_solvers::io::natural_cmp;
use covis_solvers::io::reading::{Content, FileCounts};
use covis_solvers::io::trajectory::{Trajectory, nanoseconds_of_seconds};

use super::{File, graph};
use crate::map::{
    Change, ClientIndex, EntityRef, Event, Item, ItemLandmark, ItemObservation, Map, MapError,
    MapPolicy, Reason, Usage,
};
use crate::service::engine::ImportRoom;
use crate::service::error::ServiceError;
use crate::service::export::Format;
use crate::service::names::is_name;
use crate::wire::v1;

/// Standard deviation of a pixel coordinate where a format has none, px.
const SIGMA_PX: f64 = 1.0;
/// Time between images that have none, ns.
pub(super) const IMAGE_STEP_NS: i64 = 1_000_000_000;
/// Landmarks in one item.
pub(super) const LANDMARKS: usize = 4096;

/// What is made of files.
pub(super) struct Built {
    pub(super) map: Map,
    pub(super) room: ImportRoom,
    /// What the map does not hold as the files have it.
    pub(super) warnings: Vec<v1::ImportWarning>,
}

/// The map that the files hold, of client `client` where the format has no clients. Blocks.
pub(super) fn build(
    format: Format,
    files: &[File],
    client: &str,
    skip_unknown: bool,
    policy: MapPolicy,
    room: ImportRoom,
) -> Result<Built, ServiceError> {
    let mut warnings = Vec::new();
    let mut building = Building::new(policy, room)?;
    building.kept = files.iter().map(|file| file.bytes.len() as u64).sum();
    match format {
        Format::Colmap(encoding) => colmap(&mut building, encoding, files, client)?,
        Format::G2o => warnings = graph::import(&mut building, files, client, skip_unknown)?,
        Format::Tum => tum(&mut building, files, client)?,
        // The first is read while it comes, the second is refused before.
        Format::Covis | Format::Ply => return Err(refused("this format is not made of items")),
    }
    Ok(Built { map: building.map, room: building.room, warnings })
}

/// A map that grows by items.
pub(super) struct Building {
    map: Map,
    room: ImportRoom,
    /// Bytes of the files, which stay in memory beside the map.
    kept: u64,
}

impl Building {
    fn new(policy: MapPolicy, room: ImportRoom) -> Result<Self, ServiceError> {
        let mut building = Self { map: Map::new(), room, kept: 0 };
        let created = Change::Created { policy, create_time_ns: 0, display_name: String::new() };
        building.apply("the map", created)?;
        Ok(building)
    }

    /// Reserves what files take once they are parsed: up to 32 times their bytes.
    pub(super) fn price(&mut self, content: Content, files: &[&[u8]]) -> Result<(), ServiceError> {
        let mut counts = FileCounts::default();
        for file in files {
            counts.add(file);
            counts.end_file();
        }
        Ok(self.room.set_aside(counts.price(content).problem)?)
    }

    pub(super) fn client(&mut self, name: &str) -> Result<ClientIndex, ServiceError> {
        self.apply(name, Change::ClientOpened { name: name.to_owned(), epoch: 1 })?;
        let opened = self.map.client_named(name);
        opened.ok_or_else(|| refused("a client that was opened is not in the map"))
    }

    /// Adds an item, which errors call `what`.
    pub(super) fn add(
        &mut self,
        client: ClientIndex,
        what: impl Display,
        item: &Item,
    ) -> Result<(), ServiceError> {
        if !item.has_valid_numbers() {
            return Err(refused(format!("{what}: a number is not finite or not positive")));
        }
        let change = self.map.check(client, item);
        let change = change.map_err(|rejection| refused(format!("{what}: {rejection}")))?;
        self.apply(what, change)
    }

    fn apply(&mut self, what: impl Display, change: Change) -> Result<(), ServiceError> {
        let revision = self.map.revision() + 1;
        let event = Event { revision, time_ns: 0, cause: None, change };
        let wrong = |error: MapError| refused(format!("{what}: {error}"));
        self.map.apply(&event).map_err(wrong)?;
        let usage = self.map.usage();
        self.room.reach(Usage { bytes: usage.bytes + self.kept, ..usage })?;
        Ok(())
    }
}

/// The error for files that are no map.
pub(super) fn refused(text: impl Into<String>) -> ServiceError {
    ServiceError::field("chunk.data", Reason::Inconsistent, text)
}

pub(super) fn unreadable(error: &IoError) -> ServiceError {
    refused(error.to_string())
}

/// The file with this name, in whatever folder.
fn named<'f>(files: &'f [File], name: &str) -> Result<&'f [u8], ServiceError> {
    let is_named = |file: &&File| file.path.rsplit('/').next() == Some(name);
    let file = files.iter().find(is_named);
    let file = file.ok_or_else(|| refused(format!("{name} is not among the files")))?;
    Ok(&file.bytes)
}

/// The id of an entity from a number of a file.
fn id_of(what: impl Display, number: u64) -> Result<i64, ServiceError> {
    i64::try_from(number).map_err(|_large| refused(format!("{what}: the id is above 2^63 - 1")))
}

/// Images become keyframes, a second apart in the natural order of their names; the format has no
/// times.
fn colmap(
    building: &mut Building,
    encoding: ColmapEncoding,
    files: &[File],
    client: &str,
) -> Result<(), ServiceError> {
    let [cameras, images, points] = encoding.file_names();
    let bytes = [named(files, cameras)?, named(files, images)?, named(files, points)?];
    let content = match encoding {
        ColmapEncoding::Text => Content::ColmapText,
        ColmapEncoding::Binary => Content::ColmapBinary,
    };
    building.price(content, &bytes)?;
    let model = ColmapModel::parse(encoding, bytes, Path::new(""));
    let model = model.map_err(|error| unreadable(&error))?;
    let client = building.client(client)?;
    for (&id, camera) in &model.cameras {
        let what = format!("{cameras}, camera {id}");
        let projection = camera.to_camera(id).map_err(|error| unreadable(&error))?;
        let size = |pixels: u64| {
            u32::try_from(pixels)
                .map_err(|_large| refused(format!("{what}: the image is too large")))
        };
        let (width_px, height_px) = (size(camera.width)?, size(camera.height)?);
        let item = Item::Camera { id: id.into(), camera: projection, width_px, height_px };
        building.add(client, &what, &item)?;
    }
    let ids: Vec<u64> = model.points.keys().copied().collect();
    for batch in ids.chunks(LANDMARKS) {
        let mut landmarks = Vec::with_capacity(batch.len());
        for number in batch {
            let id = id_of(format_args!("{points}, point {number}"), *number)?;
            let position = model.points.get(number).map(|point| point.position.into());
            landmarks.push(ItemLandmark { id, position });
        }
        let what = format!("{points}, points from {:?} on", batch.first());
        building.add(client, what, &Item::Landmarks { landmarks })?;
    }
    let mut ordered: Vec<(u32, &ColmapImage)> = model.images.iter().map(|(&i, m)| (i, m)).collect();
    ordered.sort_unstable_by(|a, b| natural_cmp(&a.1.name, &b.1.name).then(a.0.cmp(&b.0)));
    for (index, (id, image)) in (0..).zip(ordered) {
        let what = format!("{images}, image {id}");
        let pose = image.world_from_camera();
        let pose = pose.ok_or_else(|| refused(format!("{what}: the rotation has no norm")))?;
        let mut observations = Vec::new();
        for keypoint in &image.keypoints {
            let Some(point) = keypoint.point else { continue };
            observations.push(ItemObservation {
                landmark: EntityRef::own(id_of(&what, point)?),
                pixel: keypoint.pixel(),
                sigma_px: SIGMA_PX,
                depth: None,
                descriptor: None,
            });
        }
        let item = Item::Keyframe {
            id: id.into(),
            capture_time_ns: IMAGE_STEP_NS.saturating_mul(index),
            camera: Some(EntityRef::own(image.camera.into())),
            world_from_camera: pose,
            odom_from_camera: None,
            observations,
            landmarks: Vec::new(),
            global_descriptor: None,
        };
        building.add(client, what, &item)?;
    }
    Ok(())
}

/// A keyframe of which only the pose is known.
pub(super) fn keyframe(id: i64, capture_time_ns: i64, world_from_camera: Se3) -> Item {
    Item::Keyframe {
        id,
        capture_time_ns,
        camera: None,
        world_from_camera,
        odom_from_camera: None,
        observations: Vec::new(),
        landmarks: Vec::new(),
        global_descriptor: None,
    }
}

/// Each file is a client, called by the file's name where that is a name of a client.
fn tum(building: &mut Building, files: &[File], client: &str) -> Result<(), ServiceError> {
    if files.is_empty() {
        return Err(refused("no trajectory came"));
    }
    for file in files {
        let path = &file.path;
        building.price(Content::Trajectory, &[&file.bytes])?;
        let trajectory = Trajectory::parse(&file.bytes, Path::new(path));
        let trajectory = trajectory.map_err(|error| unreadable(&error))?;
        let name = path.rsplit('/').next().and_then(|name| name.strip_suffix(".tum"));
        let name = name.filter(|name| is_name(name)).unwrap_or(client);
        if building.map.client_named(name).is_some() {
            return Err(refused(format!("{path}: a file before it has the client {name:?} too")));
        }
        let client = building.client(name)?;
        let poses = trajectory.timestamps.iter().zip(&trajectory.world_from_body);
        for (id, (&seconds, &pose)) in (0..).zip(poses) {
            let what = format!("{path}, pose {id}");
            let time_ns = nanoseconds_of_seconds(seconds)
                .ok_or_else(|| refused(format!("{what}: the time is past 64-bit nanoseconds")))?;
            building.add(client, what, &keyframe(id, time_ns, pose))?;
        }
    }
    Ok(())
}
