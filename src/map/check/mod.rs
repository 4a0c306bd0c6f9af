//! Detects bad input: checks an item against the map that it is meant for.
//!
//! [`Map::check`] collects every violation of an item, with the path of the field, and otherwise
//! returns the change that the item makes. Nothing is changed here. An observation whose landmark
//! is behind its camera is a fact about the estimate and is accepted; only a projection that is not
//! finite (a point in the camera's center plane) is refused.

mod fields;
mod observations;

use std::fmt::Display;

use covis_solvers::geometry::Se3;
use covis_solvers::information::Information;
use nalgebra::SMatrix;

use self::fields::Fields;
use super::digest::{self, Content};
use super::{
    CameraEntity, Change, ClientIndex, Constraint, EntityId, EntityRef, Item, Map, NewLandmark,
    Observation, Prior, Reason, Rejection,
};

impl Map {
    /// Checks an item of `client` against the map and returns the change that it makes.
    ///
    /// An item whose entity the map holds already is refused here, even with equal content; ask
    /// [`Map::holds`] first to tell the two apart.
    ///
    /// # Errors
    /// [`Rejection`] with the path and reason of each bad field. Whether the map has room for the
    /// change is another question: [`Map::growth`].
    pub fn check(&self, client: ClientIndex, item: &Item) -> Result<Change, Rejection> {
        let mut check = Check { map: self, client, fields: Fields::default() };
        if self.client(client).is_none() {
            check.fields.add("client", Reason::UnknownReference, "the client has no stream");
            return Err(check.fields.rejection);
        }
        let change = check.item(item);
        match change {
            Some(change) if check.fields.rejection.is_empty() => Ok(change),
            _ => Err(check.fields.rejection),
        }
    }

    /// Whether the map already holds exactly what the item adds, as it was sent: the item is a
    /// duplicate and needs no event, however much solves have changed the entities since.
    #[must_use]
    pub fn holds(&self, client: ClientIndex, item: &Item) -> bool {
        // References and numbers are compared by digest alone, so violations do not matter here.
        let mut check = Check { map: self, client, fields: Fields::default() };
        let known = |kind, id: i64, change: Option<Change>| {
            let stored = self.contents.get(&(kind, EntityId::new(client, id)));
            matches!((stored, change), (Some(s), Some(c)) if *s == digest::content(&c))
        };
        match item {
            Item::Camera { id, .. } => known(Content::Camera, *id, check.item(item)),
            Item::Keyframe { id, .. } => {
                let id = *id;
                self.contents.contains_key(&(Content::Keyframe, EntityId::new(client, id)))
                    && known(Content::Keyframe, id, check.item(item))
            }
            Item::RelativePose { id, .. }
            | Item::PosePrior { id, .. }
            | Item::PositionPrior { id, .. } => known(Content::Constraint, *id, check.item(item)),
            Item::Landmarks { landmarks } => {
                !landmarks.is_empty()
                    && landmarks.iter().all(|l| {
                        let stored = self.landmarks.get(&EntityId::new(client, l.id));
                        stored.is_some_and(|s| s.sent_position == l.position)
                    })
            }
            Item::Observations { keyframe, observations } => {
                let Some(keyframe) = check.resolve(keyframe).and_then(|id| self.keyframes.get(&id))
                else {
                    return false;
                };
                !observations.is_empty()
                    && observations.iter().all(|sent| {
                        let landmark = check.resolve(&sent.landmark);
                        let stored = landmark.and_then(|id| keyframe.observation_of(id));
                        stored.is_some_and(|s| {
                            (s.pixel, s.sigma_px, s.depth, &s.descriptor)
                                == (sent.pixel, sent.sigma_px, sent.depth, &sent.descriptor)
                        })
                    })
            }
        }
    }
}

/// The check of one item.
struct Check<'a> {
    map: &'a Map,
    client: ClientIndex,
    fields: Fields,
}

impl Check<'_> {
    /// The change that the item makes; `None` where a reference cannot be resolved.
    fn item(&mut self, item: &Item) -> Option<Change> {
        match item {
            Item::Camera { id, camera, width_px, height_px } => {
                let id = self.own("camera.id", *id);
                if self.map.cameras.contains_key(&id) {
                    self.duplicate("camera.id", "camera", id);
                }
                self.fields.camera(camera);
                let entity =
                    CameraEntity { camera: *camera, width_px: *width_px, height_px: *height_px };
                Some(Change::CameraSet { id, camera: entity })
            }
            Item::Keyframe { .. } => self.keyframe(item),
            Item::Landmarks { landmarks } => {
                let path = "landmarks.landmarks";
                self.fields.not_empty(path, landmarks.len());
                let landmarks = self.landmarks(path, landmarks);
                Some(Change::LandmarksAdded { landmarks })
            }
            Item::Observations { keyframe, observations } => {
                self.fields.not_empty("observations.observations", observations.len());
                let keyframe = self.keyframe_ref("observations.keyframe", keyframe);
                let observations =
                    self.added_observations("observations.observations", keyframe, observations)?;
                Some(Change::ObservationsAdded { keyframe: keyframe?, observations })
            }
            Item::RelativePose {
                id,
                kind,
                keyframe_i,
                keyframe_j,
                keyframe_i_from_keyframe_j,
                information,
            } => {
                let id = self.new_constraint("relative_pose.id", *id);
                let i = self.keyframe_ref("relative_pose.keyframe_i", keyframe_i);
                let j = self.keyframe_ref("relative_pose.keyframe_j", keyframe_j);
                if i.is_some() && i == j {
                    let text = "the keyframe is keyframe_i itself";
                    self.fields.add("relative_pose.keyframe_j", Reason::Inconsistent, text);
                }
                let measured = keyframe_i_from_keyframe_j;
                self.fields.pose("relative_pose.keyframe_i_from_keyframe_j", measured);
                let information = self.information("relative_pose.information", information)?;
                let constraint = Constraint {
                    kind: *kind,
                    keyframe_i: i?,
                    keyframe_j: j?,
                    keyframe_i_from_keyframe_j: *measured,
                    information,
                };
                Some(Change::ConstraintAdded { id, constraint })
            }
            Item::PosePrior { id, keyframe, world_from_camera, information } => {
                let id = self.new_constraint("pose_prior.id", *id);
                let keyframe = self.keyframe_ref("pose_prior.keyframe", keyframe);
                self.fields.pose("pose_prior.world_from_camera", world_from_camera);
                let information = self.information("pose_prior.information", information)?;
                let world_from_camera: Se3 = *world_from_camera;
                let prior = Prior::Pose { keyframe: keyframe?, world_from_camera, information };
                Some(Change::PriorAdded { id, prior })
            }
            Item::PositionPrior { id, keyframe, position_in_world, information } => {
                let id = self.new_constraint("position_prior.id", *id);
                let keyframe = self.keyframe_ref("position_prior.keyframe", keyframe);
                self.fields.vector("position_prior.point_in_world", position_in_world);
                let information = self.information("position_prior.information", information)?;
                let position_in_world = *position_in_world;
                let prior = Prior::Position { keyframe: keyframe?, position_in_world, information };
                Some(Change::PriorAdded { id, prior })
            }
        }
    }

    fn keyframe(&mut self, item: &Item) -> Option<Change> {
        let Item::Keyframe {
            id,
            capture_time_ns,
            camera,
            world_from_camera,
            odom_from_camera,
            observations,
            landmarks,
        } = item
        else {
            return None;
        };
        let id = self.own("keyframe.id", *id);
        if self.map.keyframes.contains_key(&id) {
            self.duplicate("keyframe.id", "keyframe", id);
        }
        let camera_id = self.camera_ref("keyframe.camera_id", camera.as_ref());
        if camera.is_none() && !observations.is_empty() {
            let text = "required where there are observations";
            self.fields.add("keyframe.camera_id", Reason::Missing, text);
        }
        self.fields.pose("keyframe.world_from_camera", world_from_camera);
        if let Some(pose) = odom_from_camera {
            self.fields.pose("keyframe.odom_from_camera", pose);
        }
        let new = self.landmarks("keyframe.landmarks", landmarks);
        let view = self::observations::Viewpoint {
            camera: camera_id.flatten().and_then(|c| self.map.cameras.get(&c)).copied(),
            world_from_camera: *world_from_camera,
            new_landmarks: &new,
            present: &[],
        };
        let observations =
            self.observations("keyframe.observations", observations, &view).into_iter().collect();
        Some(Change::KeyframeAdded {
            id,
            capture_time_ns: *capture_time_ns,
            camera: camera_id?,
            world_from_camera: *world_from_camera,
            odom_from_camera: odom_from_camera.unwrap_or(*world_from_camera),
            observations,
            landmarks: new,
        })
    }

    fn added_observations(
        &mut self,
        path: &str,
        keyframe: Option<EntityId>,
        sent: &[super::ItemObservation],
    ) -> Option<Vec<Observation>> {
        let keyframe = self.map.keyframes.get(&keyframe?)?;
        if keyframe.camera.is_none() {
            let text = "the keyframe has no camera to observe with";
            self.fields.add("observations.keyframe", Reason::Inconsistent, text);
        }
        let view = self::observations::Viewpoint {
            camera: keyframe.camera.and_then(|c| self.map.cameras.get(&c)).copied(),
            world_from_camera: keyframe.world_from_camera,
            new_landmarks: &[],
            present: &keyframe.observations,
        };
        Some(self.observations(path, sent, &view))
    }

    /// An entity of the sender itself.
    fn own(&mut self, field: impl Display, id: i64) -> EntityId {
        if id < 0 {
            self.fields.add(field, Reason::OutOfRange, format!("{id} is negative"));
        }
        EntityId::new(self.client, id)
    }

    fn new_constraint(&mut self, field: &str, id: i64) -> EntityId {
        let id = self.own(field, id);
        if self.map.constraints.contains_key(&id) || self.map.priors.contains_key(&id) {
            self.duplicate(field, "constraint", id);
        }
        id
    }

    fn duplicate(&mut self, field: impl Display, kind: &str, id: EntityId) {
        let text = format!("{kind} {} exists already with other content", id.id);
        self.fields.add(field, Reason::AlreadyExists, text);
    }

    /// What a reference names, whether or not the map holds it; `None` for an unknown client.
    fn resolve(&self, reference: &EntityRef) -> Option<EntityId> {
        let client = match &reference.client {
            None => self.client,
            Some(name) => self.map.client_named(name)?,
        };
        Some(EntityId::new(client, reference.id))
    }

    fn unknown(&mut self, field: impl Display, kind: &str, reference: &EntityRef) {
        let owner = match &reference.client {
            None => String::new(),
            Some(name) => format!(" of client {name:?}"),
        };
        let text = format!("{kind} {}{owner} is not in the map", reference.id);
        self.fields.add(field, Reason::UnknownReference, text);
    }

    /// The camera that is named, `None` within where none is.
    fn camera_ref(
        &mut self,
        field: &str,
        reference: Option<&EntityRef>,
    ) -> Option<Option<EntityId>> {
        let Some(reference) = reference else { return Some(None) };
        let id = self.resolve(reference).filter(|id| self.map.cameras.contains_key(id));
        if id.is_none() {
            self.unknown(field, "camera", reference);
        }
        id.map(Some)
    }

    fn keyframe_ref(&mut self, field: &str, reference: &EntityRef) -> Option<EntityId> {
        let id = self.resolve(reference).filter(|id| self.map.keyframes.contains_key(id));
        if id.is_none() {
            self.unknown(field, "keyframe", reference);
        }
        id
    }

    fn information<const N: usize>(
        &mut self,
        field: &str,
        matrix: &SMatrix<f64, N, N>,
    ) -> Option<Information<N>> {
        match Information::new(matrix) {
            Ok(information) => Some(information),
            Err(error) => {
                self.fields.information(field, &error);
                None
            }
        }
    }

    fn landmarks(&mut self, path: &str, sent: &[super::ItemLandmark]) -> Vec<NewLandmark> {
        let ids = sent.iter().enumerate().map(|(index, l)| (l.id, Some(index)));
        for (index, id) in repeated(ids.collect()) {
            let text = format!("landmark {id} occurs twice");
            self.fields.add(format_args!("{path}[{index}].id"), Reason::Duplicate, text);
        }
        for (index, landmark) in sent.iter().enumerate() {
            let at = format_args!("{path}[{index}]");
            let id = self.own(format_args!("{at}.id"), landmark.id);
            if let Some(position) = &landmark.position {
                self.fields.vector(format_args!("{at}.point_in_world"), position);
            }
            let known = self.map.landmarks.get(&id);
            if known.is_some_and(|known| known.sent_position != landmark.position) {
                self.duplicate(format_args!("{at}.id"), "landmark", id);
            }
        }
        sent.iter()
            .map(|l| NewLandmark { id: EntityId::new(self.client, l.id), position: l.position })
            .collect()
    }
}

/// The indices of keys that occur earlier in the list too, sorted, each with its key. A key without an
/// index is one that the map has already.
fn repeated<K: Ord>(mut keyed: Vec<(K, Option<usize>)>) -> Vec<(usize, K)> {
    keyed.sort_unstable();
    let mut repeated = Vec::new();
    let mut last: Option<K> = None;
    for (key, index) in keyed {
        match index {
            Some(index) if last.as_ref() == Some(&key) => repeated.push((index, key)),
            _ => last = Some(key),
        }
    }
    repeated.sort_unstable();
    repeated
}
