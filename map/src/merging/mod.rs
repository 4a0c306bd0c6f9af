//! Maps that become one, and apart again: what the event of a merge holds, and how it is made.
//!
//! Ids never collide: an entity is named by its client, and a client is in one map only. The content of the
//! source comes as values in the target's frame; from then on it is like that of any other client. To undo a
//! merge, the clients that came with it leave with all that is theirs, wherever solves have moved it
//! meanwhile. How the frames of both maps were found is not known here.

mod moving;
mod renaming;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use covis_solvers::geometry::{LieGroup, Se3, Sim3};
use covis_solvers::information::Information;

use super::frames;
use super::numbers::is_similarity;
use super::scaling;
use super::{
    Client, ClientIndex, Constraint, Content, Duplicates, EntityId, Map, MapError, MapPolicy,
    SharedMap,
};
use moving::{inverted, is_finite, move_by};
pub(super) use renaming::Renaming;

/// A map that became part of this one.
#[derive(Clone, Debug, PartialEq)]
pub struct MergedMap {
    /// Its name, under which its clients still find it.
    pub name: String,
    /// When it was created, Unix time in nanoseconds by the server's clock.
    pub create_time_ns: i64,
    /// Its last revision.
    pub revision: i64,
    /// Its free text for people.
    pub display_name: String,
    /// How it was kept.
    pub policy: MapPolicy,
    /// The pose of its world frame in this map's, as it was at the merge, and the length here of its unit.
    pub target_from_source: Sim3,
    /// The clients that came with it.
    pub clients: Vec<MergedClient>,
    /// The keyframe that the gauge of the map held, where it has no priors: its id in this map, and its
    /// `world_from_camera` in the map's own frame and unit before the merge.
    pub first: Option<(EntityId, Se3)>,
}

/// A client that came with a merged map.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MergedClient {
    /// Its position in this map.
    pub index: ClientIndex,
    /// Its name in the map that it came from.
    pub name: String,
}

/// What a merge adds to a map.
#[derive(Clone, Debug, PartialEq)]
pub struct Merge {
    /// The name of the source.
    pub name: String,
    /// The content of the source in the frame and unit of the target; its clients have their names in the target.
    pub content: Arc<Map>,
    /// The pose of the source's world frame in the target's, and the length there of the source's unit.
    pub target_from_source: Sim3,
    /// Where each client of the content stands in the target, and its name in the source.
    pub clients: Vec<MergedClient>,
    /// Loop closures between both, with ids of the target.
    pub closures: Vec<(EntityId, Constraint)>,
    /// The keyframe that the gauge of the map held, where it has no priors: its id in the target, and its
    /// `world_from_camera` in the map's own frame and unit before the merge.
    pub first: Option<(EntityId, Se3)>,
}

/// A relative pose between a keyframe of the target and one of the source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// The keyframe of the target.
    pub target: EntityId,
    /// The keyframe of the source, by the source's ids.
    pub source: EntityId,
    /// The pose of the latter in the frame of the former, in the target's unit.
    pub target_from_source: Se3,
    /// Information of its error, translation first.
    pub information: Information<6>,
}

/// Why two maps cannot become one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum MergeError {
    /// A client has content in both.
    #[error("client {client:?} is in both maps: give it another name by renamed_clients")]
    ClientInBoth { client: String },
    /// A new name is given to a client that the source does not have.
    #[error("renamed_clients names {client:?}, which the source does not have")]
    UnknownClient { client: String },
    /// Two clients of the source get one name.
    #[error("renamed_clients gives the name {client:?} to two clients")]
    NameTwice { client: String },
    /// The source has priors, of another place on the Earth.
    #[error("the source holds priors and the geodetic anchors of both maps differ")]
    Anchors,
    /// The source has measured its lengths.
    #[error(
        "the source measures lengths (by depths or priors): its scale is 1 and cannot become {scale}"
    )]
    Scaled { scale: String },
    /// Only the source has measured lengths, and it is the source that would be scaled.
    #[error(
        "the source measures lengths (by depths or priors) and the target does not: merge the target \
         into the source, which scales the target"
    )]
    OnlySourceIsMetric,
    /// Numbers overflow.
    #[error("a number is out of range in the target's frame and unit")]
    OutOfRange,
    /// The content does not fit, a bug.
    #[error("the source cannot be moved into the target: {0}")]
    Content(#[from] MapError),
}

impl Map {
    /// The maps that became part of this one and were not taken out again, in the order of the merges.
    pub fn merged(&self) -> &[MergedMap] {
        &self.parts.merged
    }

    /// The map that became part of this one as `name`.
    pub fn merged_as(&self, name: &str) -> Option<&MergedMap> {
        self.merged().iter().find(|merged| merged.name == name)
    }

    /// Whether `target`, of which a map became part as `merged` says, has all that clients ever sent to
    /// this map: it is then what is left of the other one. Revisions do not tell, since a map that was
    /// taken out again has a later one.
    pub fn is_within(&self, target: &Self, merged: &MergedMap) -> bool {
        let has_all = |client: &Client| {
            let known = merged.clients.iter().find(|known| known.name == client.name);
            let there = known.and_then(|known| target.client(known.index));
            client.next_sequence <= there.map_or(1, |there| there.next_sequence)
        };
        self.create_time_ns() == merged.create_time_ns && self.clients().iter().all(has_all)
    }

    /// What merges `source`, whose name is `name`, into this map: its world frame and unit are at
    /// `target_from_source`, `renamed` has new names of its clients, `links` become loop closures.
    ///
    /// # Errors
    /// [`MergeError`].
    pub fn merge_of(
        &self,
        (name, source): (&str, &Self),
        target_from_source: impl Into<Sim3>,
        renamed: &BTreeMap<String, String>,
        links: &[Link],
    ) -> Result<Merge, MergeError> {
        let clients = self.joining(source, renamed)?;
        let target_from_source: Sim3 = target_from_source.into();
        let scale = target_from_source.scale;
        if scale != 1.0 && source.has_metric_scale() {
            return Err(MergeError::Scaled { scale: scale.to_string() });
        }
        let mut parts = source.to_parts();
        for (client, index) in parts.clients.iter_mut().zip((0..).map(ClientIndex)) {
            if let Some((_, newest)) = source.newest_keyframe(index) {
                frames::remember(&mut client.earlier_frames, newest.map_from_odom());
            }
        }
        // Clients that left the source stay behind.
        let mut present = 0;
        let positions = parts.clients.iter().map(|client| {
            let index = ClientIndex(present);
            present += u32::from(!client.has_left);
            index
        });
        let positions: Vec<ClientIndex> = positions.collect();
        let mut parts = Renaming::new(&parts, &positions).apply(parts);
        parts.clients.retain(|client| !client.has_left);
        for (client, (_, name)) in parts.clients.iter_mut().zip(&clients) {
            client.name.clone_from(name);
        }
        let keeps_priors = has_anchor(self.policy(), source.policy());
        move_by(&target_from_source, &mut parts, keeps_priors)?;
        for client in &mut parts.clients {
            client.scale *= scale;
        }
        // What was merged into the source before is where both merges put it.
        let inner = parts.merged.iter().map(|inner| inner.target_from_source);
        let mut inner = inner.map(|inner| target_from_source.compose(&inner));
        if !(target_from_source.is_finite()
            && is_finite(&parts)
            && inner.all(|i| is_similarity(&i)))
        {
            return Err(MergeError::OutOfRange);
        }
        let content = Arc::new(Self::from_parts(parts)?);
        let clients: Vec<MergedClient> = clients.into_iter().map(|(client, _)| client).collect();
        let positions: Vec<ClientIndex> = clients.iter().map(|client| client.index).collect();
        let mut closures = Vec::new();
        let renaming = Renaming::of_clients(&positions);
        let held = source.held_keyframes(source.policy().gauge).into_iter().next();
        let first = held.filter(|_| source.priors().is_empty()).and_then(|id| {
            Some((renaming.entity(id), source.keyframes().get(&id)?.world_from_camera))
        });
        for link in links {
            let source = renaming.entity(link.source);
            let id = EntityId::own(source.client, self.revision() + 1, closures.len());
            let closure = link.closure(source);
            if !closure.keyframe_i_from_keyframe_j.is_finite() {
                return Err(MergeError::OutOfRange);
            }
            closures.push((id, closure));
        }
        Ok(Merge { name: name.to_owned(), content, target_from_source, clients, closures, first })
    }

    /// Where each client of `source` would stand in this map, and its name here.
    ///
    /// # Errors
    /// [`MergeError`]: why the maps cannot become one, wherever they lie.
    pub fn joining(
        &self,
        source: &Self,
        renamed: &BTreeMap<String, String>,
    ) -> Result<Vec<(MergedClient, String)>, MergeError> {
        let is_present = |index| source.client(index).is_some_and(|client| !client.has_left);
        let is_client = |name: &&String| !source.client_named(name).is_some_and(is_present);
        if let Some(client) = renamed.keys().find(is_client) {
            return Err(MergeError::UnknownClient { client: client.clone() });
        }
        let anchor = self.policy().geodetic_anchor;
        let is_other = anchor != source.policy().geodetic_anchor;
        if is_other
            && !source.priors().is_empty()
            && (anchor.is_some() || !self.priors().is_empty())
        {
            return Err(MergeError::Anchors);
        }
        let (mut clients, mut names, mut next) =
            (Vec::new(), BTreeSet::new(), self.clients().len());
        for client in source.clients().iter().filter(|client| !client.has_left) {
            let name = renamed.get(&client.name).unwrap_or(&client.name);
            if !names.insert(name.clone()) {
                return Err(MergeError::NameTwice { client: name.clone() });
            }
            let index = match self.client_named(name) {
                // It left with a merge that was undone.
                Some(index) if self.has_never_sent(index) => index,
                Some(_) => return Err(MergeError::ClientInBoth { client: name.clone() }),
                None => {
                    next += 1;
                    ClientIndex(u32::try_from(next - 1).unwrap_or(u32::MAX))
                }
            };
            clients.push((MergedClient { index, name: client.name.clone() }, name.clone()));
        }
        Ok(clients)
    }

    fn has_never_sent(&self, index: ClientIndex) -> bool {
        let sent = self.client(index).is_some_and(|client| client.next_sequence > 1);
        !sent && self.is_without_content(index)
    }

    /// Whether a client has nothing in the map but its name.
    pub(super) fn is_without_content(&self, index: ClientIndex) -> bool {
        let own = index.ids();
        self.cameras().range(own.clone()).next().is_none()
            && self.keyframes().range(own.clone()).next().is_none()
            && self.landmarks().range(own.clone()).next().is_none()
            && self.constraints().range(own.clone()).next().is_none()
            && self.priors().range(own).next().is_none()
    }

    /// The map that was merged as `name`, as it is taken out again: its clients with all that is theirs,
    /// in the frame that it had, in which the keyframe that its gauge held is where it was. Observations of
    /// landmarks that stay here are left out, and constraints between what goes and what stays.
    ///
    /// # Errors
    /// [`MergeError::OutOfRange`], and [`MergeError::Content`], a bug.
    pub fn taken_out(&self, name: &str) -> Result<Option<Self>, MergeError> {
        let Some(index) = self.merged().iter().position(|merged| merged.name == name) else {
            return Ok(None);
        };
        let merged = &self.merged()[index];
        let going: BTreeMap<ClientIndex, u32> =
            merged.clients.iter().map(|client| client.index).zip(0..).collect();
        let goes = |id: EntityId| going.contains_key(&id.client);
        let mut parts = self.to_parts();
        parts.cameras.retain(|&id, _| goes(id));
        parts.keyframes = kept(&parts.keyframes, goes);
        for keyframe in parts.keyframes.values_mut() {
            let own = keyframe.observations.iter().filter(|o| goes(o.landmark)).cloned();
            keyframe.observations = own.collect();
            keyframe.camera = keyframe.camera.filter(|&camera| goes(camera));
            if keyframe.camera.is_none() {
                keyframe.observations = Default::default();
            }
        }
        parts.landmarks = kept(&parts.landmarks, goes);
        let sees = |keyframe: &EntityId, landmark| {
            let keyframe = parts.keyframes.get(keyframe);
            keyframe.is_some_and(|keyframe| keyframe.observation_of(landmark).is_some())
        };
        // As where a keyframe is removed: the lowest of those that still see it.
        let references: Vec<_> = parts
            .landmarks
            .iter()
            .filter_map(|(&id, landmark)| {
                let reference = landmark.reference.filter(|reference| !sees(reference, id))?;
                let left = landmark.observers.iter().copied().find(|other| sees(other, id));
                (left != Some(reference)).then_some((id, left))
            })
            .collect();
        for (id, reference) in references {
            if let Some(landmark) = parts.landmarks.get_mut(&id) {
                landmark.reference = reference;
            }
        }
        let is_inside = |c: &Constraint| goes(c.keyframe_i) && goes(c.keyframe_j);
        let inside = parts.constraints.iter().filter(|(id, c)| goes(**id) && is_inside(c));
        parts.constraints = inside.map(|(&id, &c)| (id, c)).collect();
        let inside = parts.priors.iter().filter(|(id, p)| goes(**id) && goes(p.keyframe()));
        parts.priors = inside.map(|(&id, &prior)| (id, prior)).collect();
        let holds =
            |id: &EntityId| parts.constraints.contains_key(id) || parts.priors.contains_key(id);
        parts.switched_off.retain(|id, _| holds(id));
        let mut duplicates = Duplicates::default();
        duplicates.extend(
            parts.duplicates.pairs().filter(|&(a, b, closure)| {
                goes(a) && goes(b) && closure.is_none_or(|id| parts.constraints.contains_key(&id))
            }),
            parts.duplicates.compared().iter().copied().filter(|id| holds(id)),
        );
        parts.duplicates = duplicates;
        let searches = &mut parts.place_searches;
        searches.pending = kept(&searches.pending, goes);
        searches.done = kept(&searches.done, goes);
        for search in searches.done.values_mut() {
            search.candidates.retain(|candidate| goes(candidate.keyframe));
            search.closure = search.closure.filter(|id| goes(*id));
        }
        // A reader of the map as it was must see that it is another state.
        parts.revision = self.revision().max(merged.revision.saturating_add(1));
        // What the other map's keyframes bent is straightened by the closures that are left.
        parts.place_searches.unsolved = parts.revision;
        parts.contents = kept(&parts.contents, |(kind, id)| {
            goes(id) && (kind != Content::Constraint || holds(&id))
        });
        let inner = self.merged()[..index].iter();
        let inner = inner.filter(|inner| inner.is_among(|client| going.contains_key(&client)));
        parts.merged = inner.cloned().collect();
        let mut positions = vec![ClientIndex(0); self.clients().len()];
        going.iter().for_each(|(old, &new)| positions[old.0 as usize] = ClientIndex(new));
        let renaming = Renaming::new(&parts, &positions);
        let first = merged.first.filter(|_| parts.priors.is_empty());
        let first = first.and_then(|(id, was)| {
            Some((renaming.entity(id), was, parts.keyframes.get(&id)?.world_from_camera))
        });
        let mut parts = renaming.apply(parts);
        let clients = merged.clients.iter().filter_map(|client| {
            let known = parts.clients.get(client.index.0 as usize)?;
            let mut left = Client { name: client.name.clone(), ..known.clone() };
            if let Some((_, newest)) = self.newest_keyframe(client.index) {
                frames::remember(&mut left.earlier_frames, newest.map_from_odom());
            }
            Some(left)
        });
        parts.clients = clients.collect();
        let mut source_from_target = merged.target_from_source.inverse();
        if let Some((_, was, is)) = first {
            // Solves may have moved it since the merge.
            let scale = source_from_target.scale;
            let motion = was.compose(&scaling::pose(scale, &is).inverse());
            source_from_target = Sim3 { scale, ..motion.into() };
        }
        for inner in &mut parts.merged {
            inner.target_from_source = source_from_target.compose(&inner.target_from_source);
        }
        let keeps_priors = has_anchor(self.policy(), &merged.policy);
        move_by(&source_from_target, &mut parts, keeps_priors)?;
        if let Some((id, was, _)) = first
            && let Some(keyframe) = parts.keyframes.get_mut(&id)
        {
            keyframe.world_from_camera = was;
        }
        for client in &mut parts.clients {
            // By division, so that a scale that was 1 is 1 again.
            client.scale /= merged.target_from_source.scale;
        }
        parts.create_time_ns = merged.create_time_ns;
        parts.display_name.clone_from(&merged.display_name);
        parts.policy = merged.policy;
        parts.frozen = false;
        if !is_finite(&parts) {
            return Err(MergeError::OutOfRange);
        }
        Ok(Some(Self::from_parts(parts)?))
    }
}

impl MergedMap {
    /// The names in `map`, which it became part of, of the clients that have another one there.
    pub fn renamed(&self, map: &Map) -> BTreeMap<String, String> {
        let renamed = self.clients.iter().filter_map(|client| {
            let here = &map.client(client.index)?.name;
            (*here != client.name).then(|| (client.name.clone(), here.clone()))
        });
        renamed.collect()
    }

    /// Whether it leaves with the clients that go: it has some, and all of them do.
    pub(super) fn is_among(&self, goes: impl Fn(ClientIndex) -> bool) -> bool {
        !self.clients.is_empty() && self.clients.iter().all(|client| goes(client.index))
    }
}

impl Merge {
    /// The id in the target of a camera, keyframe, landmark or constraint of the content.
    pub fn id_of(&self, id: EntityId) -> EntityId {
        let client = self.clients.get(id.client.0 as usize);
        EntityId { client: client.map_or(id.client, |client| client.index), ..id }
    }
}

impl Link {
    /// The link that a measurement the other way says, of the target's keyframe in the frame of the source's.
    ///
    /// # Errors
    /// [`MergeError::OutOfRange`] where numbers overflow.
    pub fn from_source(
        target: EntityId,
        source: EntityId,
        source_from_target: &Se3,
        information: &Information<6>,
    ) -> Result<Self, MergeError> {
        let information = inverted(information, source_from_target)?;
        Ok(Self { target, source, target_from_source: source_from_target.inverse(), information })
    }

    /// The loop closure that it becomes, `source` being the id of its second keyframe in the target.
    fn closure(&self, source: EntityId) -> Constraint {
        Constraint {
            kind: super::ConstraintKind::LoopClosure,
            keyframe_i: self.target,
            keyframe_j: source,
            keyframe_i_from_keyframe_j: self.target_from_source,
            information: self.information,
            loss: None,
        }
    }
}

/// Entries whose key is wanted.
fn kept<K: Ord + Copy, V: Clone>(
    entries: &SharedMap<K, V>,
    is_kept: impl Fn(K) -> bool,
) -> SharedMap<K, V> {
    let entries = entries.iter().filter(|(key, _)| is_kept(**key));
    entries.map(|(&key, value)| (key, value.clone())).collect()
}

/// Whether priors of two maps are in one frame: that of one anchor on the Earth.
fn has_anchor(policy: &MapPolicy, other: &MapPolicy) -> bool {
    policy.geodetic_anchor.is_some() && policy.geodetic_anchor == other.geodetic_anchor
}
