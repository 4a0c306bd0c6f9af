//! The JSON of `sfm_data.json`, as the serialization library cereal nests it.
//!
//! A map is a list of `{key, value}`. A value behind a pointer is in `ptr_wrapper.data`. Its type is a
//! number, whose name is written only where the type occurs for the first time: there the number's
//! highest bit is set. A base class may be nested as `value0`. Members that are not needed are skipped.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::super::error::excerpt;
use super::super::{IoError, Location};
use super::{OpenMvgFile, OpenMvgIntrinsic, OpenMvgPoint, OpenMvgPose, OpenMvgView};

/// The versions that are read; 0.3 lets views have types.
const VERSIONS: [&str; 2] = ["0.2", "0.3"];

/// The bit of a type's number that marks its first occurrence.
const FIRST: u32 = 1 << 31;

/// Longest message of the JSON parser that is passed on, characters: it may quote the file.
const REASON_LIMIT: usize = 120;

#[derive(Deserialize)]
struct Document {
    sfm_data_version: String,
    views: Vec<Entry<Pointer<OpenMvgView>>>,
    intrinsics: Vec<Entry<Pointer<Intrinsic>>>,
    extrinsics: Vec<Entry<OpenMvgPose>>,
    structure: Vec<Entry<Point>>,
    control_points: Vec<Entry<IgnoredAny>>,
}

#[derive(Deserialize)]
struct Entry<T> {
    key: u32,
    value: T,
}

#[derive(Deserialize)]
struct Pointer<T> {
    polymorphic_id: Option<u32>,
    polymorphic_name: Option<String>,
    ptr_wrapper: Wrapper<T>,
}

#[derive(Deserialize)]
struct Wrapper<T> {
    data: T,
}

#[derive(Deserialize)]
struct Intrinsic {
    width: Option<u32>,
    height: Option<u32>,
    focal_length: Option<f64>,
    principal_point: Option<[f64; 2]>,
    disto_k1: Option<[f64; 1]>,
    disto_k3: Option<[f64; 3]>,
    disto_t2: Option<[f64; 5]>,
    fisheye: Option<[f64; 4]>,
    value0: Option<Box<Self>>,
}

#[derive(Deserialize)]
struct Point {
    #[serde(rename = "X")]
    position: [f64; 3],
    observations: Vec<Entry<Observation>>,
}

#[derive(Deserialize)]
struct Observation {
    x: [f64; 2],
}

/// Parses a file's bytes.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<OpenMvgFile, IoError> {
    let document: Document =
        serde_json::from_slice(bytes).map_err(|error| refused(&error, path))?;
    let version = document.sfm_data_version.as_str();
    if !VERSIONS.contains(&version) {
        let location = Location::line(path, 1);
        let (field, found) = ("sfm_data_version".to_owned(), excerpt(version.as_bytes()));
        return Err(IoError::Malformed { location, field, found });
    }
    let mut models = BTreeMap::new();
    let views = by_key(document.views, "view", path, |_, view| {
        view.register(&mut models);
        Ok(view.ptr_wrapper.data)
    })?;
    let intrinsics = by_key(document.intrinsics, "intrinsic", path, |key, intrinsic| {
        intrinsic.register(&mut models);
        let id = intrinsic.polymorphic_id.unwrap_or_default();
        let Some(model) = models.get(&(id & !FIRST)) else {
            let location = Location::key(path, "intrinsic", key);
            let (field, found) = ("polymorphic_id without a name".to_owned(), id.to_string());
            return Err(IoError::Malformed { location, field, found });
        };
        Ok(intrinsic.ptr_wrapper.data.named(model.clone()))
    })?;
    let poses = by_key(document.extrinsics, "pose", path, |_, pose| Ok(pose))?;
    let points = by_key(document.structure, "point", path, |_, point| {
        let observations = point.observations.into_iter();
        let observations = observations.map(|entry| (entry.key, entry.value.x)).collect();
        Ok(OpenMvgPoint { position: point.position, observations })
    })?;
    let control_points = document.control_points.len();
    Ok(OpenMvgFile { views, intrinsics, poses, points, control_points })
}

impl<T> Pointer<T> {
    /// Takes the name of the type where it is written.
    fn register(&self, models: &mut BTreeMap<u32, String>) {
        if let (Some(id), Some(name)) = (self.polymorphic_id, &self.polymorphic_name) {
            models.insert(id & !FIRST, name.clone());
        }
    }
}

impl Intrinsic {
    /// Its members and those of its bases; an outer one hides one of a base.
    fn named(self, model: String) -> OpenMvgIntrinsic {
        let base = self.value0.map(|base| base.named(String::new())).unwrap_or_default();
        let size = self.width.zip(self.height).map(|(width, height)| [width, height]);
        OpenMvgIntrinsic {
            model,
            size_px: size.or(base.size_px),
            focal_length: self.focal_length.or(base.focal_length),
            principal_point: self.principal_point.or(base.principal_point),
            disto_k1: self.disto_k1.or(base.disto_k1),
            disto_k3: self.disto_k3.or(base.disto_k3),
            disto_t2: self.disto_t2.or(base.disto_t2),
            fisheye: self.fisheye.or(base.fisheye),
        }
    }
}

/// The entries of a map, each made into what the caller keeps.
fn by_key<T, U>(
    entries: Vec<Entry<T>>,
    kind: &'static str,
    path: &Path,
    mut keep: impl FnMut(u32, T) -> Result<U, IoError>,
) -> Result<BTreeMap<u32, U>, IoError> {
    let mut map = BTreeMap::new();
    for Entry { key, value } in entries {
        if map.insert(key, keep(key, value)?).is_some() {
            let location = Location::key(path, kind, key);
            return Err(IoError::DuplicateId { location, field: "key", id: key.into() });
        }
    }
    Ok(map)
}

/// The parser's error with the line as the location.
fn refused(error: &serde_json::Error, path: &Path) -> IoError {
    let text = error.to_string();
    let reason = text.rsplit_once(" at line ").map_or(&*text, |(reason, _)| reason);
    let reason = reason.chars().take(REASON_LIMIT).collect();
    IoError::Json { location: Location::line(path, error.line() as u64), reason }
}
