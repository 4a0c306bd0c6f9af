//! COLMAP records of a map's entities, and the numbers that name them in a file.
//!
//! Numbers are stored as runs of consecutive ids. Clients mostly number their entities
//! consecutively, so that a map of a million landmarks needs a few bytes. The bytes are made by
//! `covis_solvers::io`.

use covis_solvers::geometry::LieGroup;
use covis_solvers::io::colmap::{
    ColmapCamera, ColmapEncoding, ColmapImage, ColmapKeypoint, ColmapPoint, ColmapPointError,
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
}

impl Numbers {
    /// The numbers of `map`. Landmarks with a position are points: all, or those that two keyframes
    /// observe, since COLMAP's bundle adjustment refuses a point with a single view.
    ///
    /// # Errors
    /// What the files cannot contain, as text for people.
    pub(super) fn of(map: &Map, all_landmarks: bool) -> Result<Self, String> {
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
        let is_point = |(_, landmark): &(&EntityId, &Landmark)| {
            landmark.position.is_some() && (all_landmarks || landmark.observers.len() > 1)
        };
        let points = map.landmarks().iter().filter(is_point);
        Ok(Self {
            cameras: Numbering::of(map.cameras().keys().copied()),
            images: Numbering::of(map.keyframes().keys().copied()),
            points: Numbering::of(points.map(|(&id, _)| id)),
        })
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
        // A keypoint for each observation, so that the index of one is that of the other.
        image.keypoints.extend(view.observations.iter().map(|observation| {
            let point = self.points.get(observation.landmark);
            ColmapKeypoint::new(&observation.pixel, point.map(u64::from))
        }));
        let number = self.images.get(id).unwrap_or_default();
        encoding.put_image(number, &image, out).map_err(|error| error.to_string())
    }

    /// Writes nothing for a landmark that is no point.
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
        let mut error = ColmapPointError::default();
        for observer in &landmark.observers {
            let (Some(keyframe), Some(image)) =
                (map.keyframes().get(observer), self.images.get(*observer))
            else {
                continue;
            };
            for view in map.views(keyframe) {
                let point_in_camera = view.world_from_camera.inverse_transform(position);
                for (index, observation) in (0..).zip(view.observations.iter()) {
                    if observation.landmark == id {
                        point.track.push((image, index));
                        error.add(&view.camera.camera, &point_in_camera, &observation.pixel);
                    }
                }
            }
        }
        point.error = error.mean_px();
        encoding.put_point(number.into(), &point, out);
    }
}

fn image_name(map: &Map, id: EntityId) -> String {
    format!("{}/{}", client_name(map, id), id.id)
}
