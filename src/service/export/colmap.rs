//! COLMAP records of a map's entities, and the numbers that name them in a file.
//!
//! Numbers are stored as runs of consecutive ids. Clients mostly number their entities
//! consecutively, so that a map of a million landmarks needs a few bytes. The bytes are made by
//! `covis_solvers::io`.

use std::collections::BTreeMap;

use covis_solvers::geometry::LieGroup;
use covis_solvers::io::colmap::{
    ColmapCamera, ColmapEncoding, ColmapImage, ColmapKeypoint, ColmapPoint,
};

use super::LANDMARK_COLOR;
use crate::map::{CameraEntity, EntityId, Keyframe, Landmark, Map};
use crate::service::convert::ids::client_name;

/// Consecutive ids.
struct Run {
    first: EntityId,
    count: u32,
    /// The number of the first id, from 1.
    number: u32,
}

/// Ids numbered from 1 in their order.
#[derive(Default)]
struct Numbering(Vec<Run>);

impl Numbering {
    fn of(ids: impl IntoIterator<Item = EntityId>) -> Self {
        let mut runs: Vec<Run> = Vec::new();
        let mut number: u32 = 1;
        for id in ids {
            match runs.last_mut().filter(|run| run.offset(id) == Some(run.count)) {
                Some(run) => run.count += 1,
                None => runs.push(Run { first: id, count: 1, number }),
            }
            number = number.saturating_add(1);
        }
        Self(runs)
    }

    fn get(&self, id: EntityId) -> Option<u32> {
        let at = self.0.partition_point(|run| run.first <= id).checked_sub(1)?;
        let run = self.0.get(at)?;
        let offset = run.offset(id).filter(|&offset| offset < run.count)?;
        Some(run.number + offset)
    }

    fn count(&self) -> usize {
        self.0.last().map_or(0, |run| (run.number + run.count - 1) as usize)
    }
}

impl Run {
    /// The distance of an id from the first one.
    fn offset(&self, id: EntityId) -> Option<u32> {
        let same = id.client == self.first.client;
        let offset = id.id.checked_sub(self.first.id).filter(|_| same)?;
        u32::try_from(offset).ok()
    }
}

/// The numbers of a map's entities in the files.
pub(super) struct Numbers {
    cameras: Numbering,
    images: Numbering,
    points: Numbering,
    /// For each keyframe, the indices of its observations whose landmark is not a point; mostly
    /// there are none.
    left_out: BTreeMap<EntityId, Vec<usize>>,
}

impl Numbers {
    /// The numbers of `map`.
    ///
    /// # Errors
    /// What the files cannot contain, as text for people.
    pub(super) fn of(map: &Map) -> Result<Self, String> {
        for (id, keyframe) in map.keyframes().iter() {
            let Some(view) = map.views(keyframe).next() else {
                return Err(format!("keyframe {} has no camera", image_name(map, *id)));
            };
            // The files have the inverse, whose translation sums up coordinates.
            let pose = view.world_from_camera.inverse();
            if !pose.translation.iter().all(|coordinate| coordinate.is_finite()) {
                let name = image_name(map, *id);
                return Err(format!("keyframe {name} is too far away for a pose of COLMAP"));
            }
        }
        let positioned = map.landmarks().iter().filter(|(_, l)| l.position.is_some());
        let mut numbers = Self {
            cameras: Numbering::of(map.cameras().keys().copied()),
            images: Numbering::of(map.keyframes().keys().copied()),
            points: Numbering::of(positioned.map(|(&id, _)| id)),
            left_out: BTreeMap::new(),
        };
        if numbers.point_count() < map.landmarks().len() {
            for (&id, keyframe) in map.keyframes().iter() {
                let observations = keyframe.observations.iter().enumerate();
                let left_out: Vec<_> = observations
                    .filter(|(_, o)| numbers.points.get(o.landmark).is_none())
                    .map(|(index, _)| index)
                    .collect();
                if !left_out.is_empty() {
                    numbers.left_out.insert(id, left_out);
                }
            }
        }
        Ok(numbers)
    }

    /// How many points the files have.
    pub(super) fn point_count(&self) -> usize {
        self.points.count()
    }

    pub(super) fn put_camera(
        &self,
        encoding: ColmapEncoding,
        id: EntityId,
        entity: &CameraEntity,
        out: &mut Vec<u8>,
    ) {
        let (width, height) = (u64::from(entity.width_px), u64::from(entity.height_px));
        let camera = ColmapCamera::from_camera(&entity.camera, width, height);
        encoding.put_camera(self.cameras.get(id).unwrap_or_default(), &camera, out);
    }

    pub(super) fn put_image(
        &self,
        encoding: ColmapEncoding,
        map: &Map,
        id: EntityId,
        keyframe: &Keyframe,
        out: &mut Vec<u8>,
    ) -> Result<(), String> {
        let name = image_name(map, id);
        let mut views = map.views(keyframe);
        let view = views.find_map(|view| Some((self.cameras.get(view.camera_id)?, view)));
        let Some((camera, view)) = view else {
            return Err(format!("keyframe {name} has no camera"));
        };
        let mut image = ColmapImage::new(name, camera, &view.world_from_camera);
        image.keypoints.extend(view.observations.iter().filter_map(|observation| {
            let point = self.points.get(observation.landmark)?;
            Some(ColmapKeypoint::new(&observation.pixel, Some(point.into())))
        }));
        let number = self.images.get(id).unwrap_or_default();
        encoding.put_image(number, &image, out).map_err(|error| error.to_string())
    }

    /// Writes nothing for a landmark without a position.
    pub(super) fn put_point(
        &self,
        encoding: ColmapEncoding,
        map: &Map,
        id: EntityId,
        landmark: &Landmark,
        out: &mut Vec<u8>,
    ) {
        let (Some(number), Some(position)) = (self.points.get(id), &landmark.position) else {
            return;
        };
        let mut point = ColmapPoint::new(position, LANDMARK_COLOR);
        let mut error_sum_px = 0.0;
        for observer in &landmark.observers {
            let (Some(keyframe), Some(image)) =
                (map.keyframes().get(observer), self.images.get(*observer))
            else {
                continue;
            };
            for view in map.views(keyframe) {
                let point_in_camera = view.world_from_camera.inverse_transform(position);
                let projected = view.camera.camera.project(&point_in_camera);
                for (index, observation) in view.observations.iter().enumerate() {
                    if observation.landmark == id {
                        point.track.push((image, self.keypoint(*observer, index)));
                        error_sum_px +=
                            projected.map_or(f64::NAN, |pixel| (pixel - observation.pixel).norm());
                    }
                }
            }
        }
        let mean_px = error_sum_px / point.track.len() as f64;
        if mean_px.is_finite() {
            point.error = mean_px;
        }
        encoding.put_point(number.into(), &point, out);
    }

    /// The keypoint of an observation; observations that are left out are not numbered.
    fn keypoint(&self, keyframe: EntityId, index: usize) -> u32 {
        let left_out = self
            .left_out
            .get(&keyframe)
            .map_or(0, |left_out| left_out.partition_point(|&at| at < index));
        u32::try_from(index - left_out).unwrap_or(u32::MAX)
    }
}

fn image_name(map: &Map, id: EntityId) -> String {
    format!("{}/{}", client_name(map, id), id.id)
}
