//! Checks an item against the map that it is meant for: references, duplicates, projections.
//!
//! [`Map::check`] collects every violation of an item, with the path of the field, and otherwise
//! returns the change that the item makes. Nothing is changed here. Numbers were checked when the item
//! was converted. Lengths in the sender's unit become lengths in the map's (`units`). Paths are the
//! wire's names, written out only where there is a violation: most items have none.

mod edits;
mod units;

use std::fmt::{Arguments, Display};

use covis_solvers::geometry::{LieGroup, LocalFrame, Se3, Sim3};
use nalgebra::Vector3;

use super::digest::{self, Content};
use super::numbers::is_finite;
use super::{
    CameraEntity, Change, ClientIndex, Constraint, EntityId, EntityRef, Item, ItemLandmark,
    ItemObservation, Map, MeasuredPosition, NewLandmark, Observation, Prior, Reason, Rejection,
};

/// Side of the largest image in pixels, where the camera does not say how large its images are.
const LARGEST_IMAGE: f64 = 65_536.0;

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
        let mut check = Check { map: self, client, rejection: Rejection::default() };
        if self.client(client).is_none() {
            check.add("client", Reason::UnknownReference, "the client has no stream");
            return Err(check.rejection);
        }
        match check.item(item) {
            Some(change) if check.rejection.is_empty() => Ok(change),
            _ => Err(check.rejection),
        }
    }

    /// Whether the map already holds exactly what the item adds, as it was sent: the item is a
    /// duplicate and needs no event, however much solves have changed the entities since.
    pub fn holds(&self, client: ClientIndex, item: &Item) -> bool {
        let mut check = Check { map: self, client, rejection: Rejection::default() };
        let (kind, id) = match item {
            Item::Camera { id, .. } => (Content::Camera, *id),
            Item::Keyframe { id, .. } => (Content::Keyframe, *id),
            Item::RelativePose { id, .. }
            | Item::PosePrior { id, .. }
            | Item::PositionPrior { id, .. } => (Content::Constraint, *id),
            Item::Landmarks { landmarks } => {
                let is_known = |l: &ItemLandmark| {
                    let stored = self.landmarks().get(&EntityId::new(client, l.id));
                    stored.is_some_and(|s| s.sent_position == l.position)
                };
                return !landmarks.is_empty() && landmarks.iter().all(is_known);
            }
            Item::Observations { keyframe, observations } => {
                let keyframe = check.resolve(keyframe).and_then(|id| self.keyframes().get(&id));
                let is_known = |sent: &ItemObservation| {
                    let landmark = check.resolve(&sent.landmark);
                    let stored = landmark.and_then(|id| keyframe?.observation_of(id));
                    let depth = check.depth(sent);
                    stored.is_some_and(|s| {
                        (s.pixel, s.sigma_px, s.depth, &s.descriptor)
                            == (sent.pixel, sent.sigma_px, depth, &sent.descriptor)
                    })
                };
                return !observations.is_empty() && observations.iter().all(is_known);
            }
            Item::Edit(edit) => return check.is_done(edit),
        };
        let Some(stored) = self.contents().get(&(kind, EntityId::new(client, id))) else {
            return false;
        };
        // Contents are compared by digest alone, so violations do not matter here.
        let change = check.item(item);
        change.is_some_and(|mut change| {
            // Earlier versions kept none.
            if let Change::KeyframeAdded { id, global_descriptor, .. } = &mut change
                && self.keyframes().get(id).is_some_and(|known| known.global_descriptor.is_none())
            {
                *global_descriptor = None;
            }
            *stored == digest::content(&change)
        })
    }
}

/// The check of one item.
struct Check<'a> {
    map: &'a Map,
    client: ClientIndex,
    rejection: Rejection,
}

/// Where observations are made from.
struct Viewpoint<'a> {
    /// `None` where the camera is unknown or missing, which is a violation of its own.
    camera: Option<&'a CameraEntity>,
    world_from_camera: &'a Se3,
    /// Landmarks of the same item.
    new_landmarks: &'a [NewLandmark],
    /// Observations that the keyframe has already.
    present: &'a [Observation],
}

impl Check<'_> {
    /// The change that the item makes; `None` where a reference cannot be resolved.
    fn item(&mut self, item: &Item) -> Option<Change> {
        match item {
            &Item::Camera { id, camera, width_px, height_px } => {
                let id = self.own("camera.id", id);
                if self.map.cameras().contains_key(&id) {
                    self.duplicate("camera.id", "camera", id);
                }
                let camera = CameraEntity { camera, width_px, height_px };
                Some(Change::CameraSet { id, camera })
            }
            Item::Keyframe {
                id,
                capture_time_ns,
                camera,
                world_from_camera,
                odom_from_camera,
                observations,
                landmarks,
                global_descriptor,
            } => {
                let id = self.own("keyframe.id", *id);
                if self.map.keyframes().contains_key(&id) {
                    self.duplicate("keyframe.id", "keyframe", id);
                }
                let path = "keyframe.camera_id";
                let camera_id = camera.as_ref().map(|camera| {
                    self.known(path, "camera", camera, |map, id| map.cameras().contains_key(id))
                });
                if camera.is_none() && !observations.is_empty() {
                    self.add(path, Reason::Missing, "required where there are observations");
                }
                let landmarks = self.landmarks("keyframe.landmarks", landmarks);
                let odom = odom_from_camera.as_ref();
                let camera = camera_id.flatten();
                let motion = self.motion(world_from_camera, odom, &landmarks, camera, observations);
                let moved = |pose: &Se3| motion.map_or(*pose, |m: Sim3| m.transform_pose(pose));
                let new_landmarks: Vec<NewLandmark> =
                    landmarks.iter().map(|new| new.moved_by(motion.as_ref())).collect();
                let view = Viewpoint {
                    camera: camera.and_then(|id| self.map.cameras().get(&id)),
                    world_from_camera: &moved(world_from_camera),
                    new_landmarks: &new_landmarks,
                    present: &[],
                };
                let observations = self.observations("keyframe.observations", observations, &view);
                Some(Change::KeyframeAdded {
                    id,
                    capture_time_ns: *capture_time_ns,
                    camera: camera_id.map_or(Some(None), |id| id.map(Some))?,
                    world_from_camera: *world_from_camera,
                    odom_from_camera: odom_from_camera.unwrap_or(*world_from_camera),
                    observations,
                    landmarks,
                    global_descriptor: global_descriptor.clone(),
                    motion,
                })
            }
            Item::Landmarks { landmarks } => {
                let path = "landmarks.landmarks";
                self.not_empty(path, landmarks.len());
                let landmarks = self.landmarks(path, landmarks);
                Some(Change::LandmarksAdded { landmarks, scale: self.scale() })
            }
            Item::Observations { keyframe, observations } => {
                let path = "observations.observations";
                self.not_empty(path, observations.len());
                let id = self.keyframe("observations.keyframe", keyframe)?;
                let keyframe = self.map.keyframes().get(&id)?;
                let image = self.map.views(keyframe).next();
                if image.is_none() {
                    let text = "the keyframe has no camera to observe with";
                    self.add("observations.keyframe", Reason::Inconsistent, text);
                }
                let pose = image.map_or(keyframe.world_from_camera, |i| i.world_from_camera);
                let view = Viewpoint {
                    camera: image.map(|image| image.camera),
                    world_from_camera: &pose,
                    new_landmarks: &[],
                    present: &keyframe.observations,
                };
                let observations = self.observations(path, observations, &view);
                Some(Change::ObservationsAdded { keyframe: id, observations })
            }
            Item::RelativePose {
                id,
                kind,
                keyframe_i,
                keyframe_j,
                keyframe_i_from_keyframe_j,
                information,
                loss,
            } => {
                let id = self.new_constraint("relative_pose.id", *id);
                let i = self.keyframe("relative_pose.keyframe_i", keyframe_i);
                let j = self.keyframe("relative_pose.keyframe_j", keyframe_j);
                if i.is_some() && i == j {
                    let text = "the keyframe is keyframe_i itself";
                    self.add("relative_pose.keyframe_j", Reason::Inconsistent, text);
                }
                let constraint = Constraint {
                    kind: *kind,
                    keyframe_i: i?,
                    keyframe_j: j?,
                    keyframe_i_from_keyframe_j: self.scaled(
                        "relative_pose.keyframe_i_from_keyframe_j",
                        keyframe_i_from_keyframe_j,
                    ),
                    information: self.information("relative_pose.information", information)?,
                    loss: *loss,
                };
                Some(Change::ConstraintAdded { id, constraint })
            }
            &Item::PosePrior { id, ref keyframe, world_from_camera, information, loss } => {
                let id = self.new_constraint("pose_prior.id", id);
                let keyframe = self.keyframe("pose_prior.keyframe", keyframe)?;
                let information = self.information("pose_prior.information", &information)?;
                let field = "pose_prior.world_from_camera";
                let world_from_camera = self.scaled(field, &world_from_camera);
                let prior = Prior::Pose { keyframe, world_from_camera, information, loss };
                Some(Change::PriorAdded { id, prior })
            }
            &Item::PositionPrior {
                id,
                ref keyframe,
                position,
                point_in_camera,
                information,
                loss,
            } => {
                let id = self.new_constraint("position_prior.id", id);
                let keyframe = self.keyframe("position_prior.keyframe", keyframe);
                let position_in_world = self.position_in_world(position)?;
                let information = match position {
                    MeasuredPosition::InWorld(_) => {
                        self.information("position_prior.information", &information)?
                    }
                    MeasuredPosition::OnEarth(_) => information,
                };
                let prior = Prior::Position {
                    keyframe: keyframe?,
                    position_in_world,
                    point_in_camera: self
                        .scaled_point("position_prior.point_in_camera", &point_in_camera),
                    information,
                    loss,
                };
                Some(Change::PriorAdded { id, prior })
            }
            Item::Edit(edit) => self.edit(edit),
        }
    }

    /// A measured position in the world frame.
    fn position_in_world(&mut self, position: MeasuredPosition) -> Option<Vector3<f64>> {
        match position {
            MeasuredPosition::InWorld(point) => {
                Some(self.scaled_point("position_prior.point_in_world", &point))
            }
            MeasuredPosition::OnEarth(point) => {
                let frame = self.map.policy().geodetic_anchor.as_ref().map(LocalFrame::new);
                if frame.is_none() {
                    let text = "the map's policy has no geodetic_anchor";
                    self.add("position_prior.geodetic_point", Reason::Inconsistent, text);
                }
                frame.map(|frame| frame.point_in_local(&point))
            }
        }
    }

    fn add(&mut self, field: impl Display, reason: Reason, description: impl Into<String>) {
        self.rejection.push(field.to_string(), reason, description);
    }

    fn not_empty(&mut self, path: &str, length: usize) {
        if length == 0 {
            self.add(path, Reason::Missing, "at least one is needed");
        }
    }

    /// An entity of the sender itself.
    fn own(&mut self, field: impl Display, id: i64) -> EntityId {
        if id < 0 {
            self.add(field, Reason::OutOfRange, format!("{id} is negative"));
        }
        EntityId::new(self.client, id)
    }

    fn new_constraint(&mut self, field: &str, id: i64) -> EntityId {
        let id = self.own(field, id);
        if self.map.has_constraint(id) {
            self.duplicate(field, "constraint", id);
        }
        id
    }

    fn duplicate(&mut self, field: impl Display, kind: &str, id: EntityId) {
        let text = format!("{kind} {} exists already with other content", id.id);
        self.add(field, Reason::AlreadyExists, text);
    }

    /// What a reference names, whether or not the map holds it; `None` for an unknown client.
    fn resolve(&self, reference: &EntityRef) -> Option<EntityId> {
        let client = match &reference.client {
            None => self.client,
            Some(name) => self.map.client_named(name)?,
        };
        Some(EntityId::new(client, reference.id))
    }

    /// What a reference names, where the map `has` it.
    fn known(
        &mut self,
        field: impl Display,
        kind: &str,
        reference: &EntityRef,
        has: impl Fn(&Map, &EntityId) -> bool,
    ) -> Option<EntityId> {
        let id = self.resolve(reference).filter(|id| has(self.map, id));
        if id.is_none() {
            self.unknown(field, kind, reference);
        }
        id
    }

    fn keyframe(&mut self, field: impl Display, reference: &EntityRef) -> Option<EntityId> {
        self.known(field, "keyframe", reference, |map, id| map.keyframes().contains_key(id))
    }

    fn unknown(&mut self, field: impl Display, kind: &str, reference: &EntityRef) {
        let owner = match &reference.client {
            None => String::new(),
            Some(name) => format!(" of client {name:?}"),
        };
        let text = format!("{kind} {}{owner} is not in the map", reference.id);
        self.add(field, Reason::UnknownReference, text);
    }

    fn landmarks(&mut self, path: &str, sent: &[ItemLandmark]) -> Vec<NewLandmark> {
        let ids = sent.iter().enumerate().map(|(index, l)| (l.id, Some(index)));
        for (index, id) in repeated(ids.collect()) {
            let text = format!("landmark {id} occurs twice");
            self.add(format_args!("{path}[{index}].id"), Reason::Duplicate, text);
        }
        let mut landmarks = Vec::with_capacity(sent.len());
        for (index, &ItemLandmark { id, position }) in sent.iter().enumerate() {
            let field = format_args!("{path}[{index}].id");
            let id = self.own(field, id);
            let known = self.map.landmarks().get(&id);
            if known.is_some_and(|known| known.sent_position != position) {
                self.duplicate(field, "landmark", id);
            }
            if let Some(position) = &position {
                self.scaled_point(format_args!("{path}[{index}].position"), position);
            }
            landmarks.push(NewLandmark { id, position });
        }
        landmarks
    }

    /// Checks the observations and returns those whose landmark is named by a known client.
    fn observations(
        &mut self,
        path: &str,
        sent: &[ItemObservation],
        view: &Viewpoint<'_>,
    ) -> Vec<Observation> {
        let camera = view.camera;
        let mut new: Vec<&NewLandmark> = view.new_landmarks.iter().collect();
        new.sort_by_key(|landmark| landmark.id);
        let mut keys: Vec<_> = view.present.iter().map(|known| (known.key(), None)).collect();
        let mut observations = Vec::with_capacity(sent.len());
        for (index, sent) in sent.iter().enumerate() {
            let at = format_args!("{path}[{index}]");
            self.pixel(at, sent, camera);
            let Some(landmark) = self.resolve(&sent.landmark) else {
                self.unknown(format_args!("{at}.landmark"), "landmark", &sent.landmark);
                continue;
            };
            // The map's estimate is the better one where it knows the landmark already.
            let position = match self.map.landmarks().get(&landmark) {
                Some(known) => known.position,
                None => match new.binary_search_by_key(&landmark, |new| new.id) {
                    Ok(index) => new[index].position,
                    Err(_absent) => {
                        self.unknown(format_args!("{at}.landmark"), "landmark", &sent.landmark);
                        None
                    }
                },
            };
            if let (Some(camera), Some(position)) = (camera, &position)
                && !is_projected(camera, view.world_from_camera, position)
            {
                let text =
                    format!("landmark {} has no finite projection at the start", landmark.id);
                self.add(format_args!("{at}.landmark"), Reason::ProjectionNotFinite, text);
            }
            let depth = self.scaled_depth(at, sent);
            let observation = Observation {
                landmark,
                pixel: sent.pixel,
                sigma_px: sent.sigma_px,
                depth,
                descriptor: sent.descriptor.clone(),
            };
            // A pixel that could not be read is NaN.
            if is_finite(&sent.pixel) {
                keys.push((observation.key(), Some(index)));
            }
            observations.push(observation);
        }
        for (index, (landmark, ..)) in repeated(keys) {
            let text = format!("landmark {} is observed twice at this pixel", landmark.id);
            self.add(format_args!("{path}[{index}].landmark"), Reason::Duplicate, text);
        }
        observations
    }

    fn pixel(&mut self, at: Arguments<'_>, sent: &ItemObservation, camera: Option<&CameraEntity>) {
        let sizes = camera.map_or([0, 0], |c| [c.width_px, c.height_px]);
        for ((name, value), size) in ["x", "y"].into_iter().zip(sent.pixel.iter()).zip(sizes) {
            if let Some(size) = far_outside(*value, size) {
                let text = format!("{value} is far outside an image of at most {size} pixels");
                self.add(format_args!("{at}.pixel.{name}"), Reason::OutOfRange, text);
            }
        }
    }
}

/// The size of an image, if a coordinate of a pixel lies farther outside of it than that. Refined
/// features may lie a little outside the image; a whole image away is no feature.
fn far_outside(value: f64, size_px: u32) -> Option<f64> {
    let size = if size_px > 0 { f64::from(size_px) } else { LARGEST_IMAGE };
    (value < -size || value > 2.0 * size).then_some(size)
}

/// Whether a landmark has a finite projection. One behind the camera passes: it is a fact about the
/// estimate; one in the camera's center plane does not. A pose that could not be read is NaN and says
/// nothing.
fn is_projected(camera: &CameraEntity, pose: &Se3, position: &Vector3<f64>) -> bool {
    let pixel = || camera.camera.project(&pose.inverse_transform(position));
    !pose.is_finite() || pixel().is_some_and(|pixel| is_finite(&pixel))
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
