//! A whole map as a stream of parts; `joined` reads them back to the same bits.
//!
//! Each part is a `MapPart` behind its length, small enough that neither side holds the map twice.
//! The head carries the state hash; a reader that does not arrive at it refuses what it read.

use std::io::Write;

use super::clients::encode_client;
use super::entities::{
    encode_camera_set, encode_constraint, encode_descriptor, encode_id, encode_observations,
    encode_policy, encode_pose, encode_prior, encode_switched_off, encode_vector,
};
use super::merging::encode_merged;
use super::places::{encode_pending, encode_search};
use super::{EncodingError, encode, v1};
use covis_map::{ClientIndex, Content, Digest, EntityId, Keyframe, Landmark, Map};

/// Entries of one kind in one part: what a part takes in memory is not to be seen beside a small map.
const PART: usize = 1024;
/// Keyframes in one part: each holds hundreds of observations.
const KEYFRAMES: usize = 16;

pub(super) fn stream(error: std::io::Error) -> EncodingError {
    EncodingError::Stream(error.to_string())
}

/// Writes the parts of a map.
///
/// # Errors
/// [`EncodingError::Stream`] where `out` fails.
pub(crate) fn encode_map(map: &Map, out: &mut dyn Write) -> Result<(), EncodingError> {
    let mut parts = Parts::default();
    while let Some(buffer) = parts.next(map) {
        out.write_all(&(buffer.len() as u64).to_le_bytes()).map_err(stream)?;
        out.write_all(&buffer).map_err(stream)?;
    }
    Ok(())
}

/// The parts of a map, made one after the other: where the next one begins.
#[derive(Debug, Default)]
pub(crate) struct Parts(At);

#[derive(Clone, Copy, Debug, Default)]
enum At {
    #[default]
    Head,
    Clients,
    /// The items of a client, from a sequence on.
    Items(u32, i64),
    Cameras(EntityId),
    Landmarks(EntityId),
    Keyframes(EntityId),
    Constraints(EntityId),
    SwitchedOff(EntityId),
    Priors(EntityId),
    Duplicates((EntityId, EntityId)),
    Compared(EntityId),
    Searches(EntityId),
    PendingSearches(EntityId),
    Contents((Content, EntityId)),
    End,
}

/// The first id of all.
const FIRST: EntityId = EntityId { client: ClientIndex(0), id: i64::MIN };

impl Parts {
    /// The bytes of the next part; `None` after the last one. The map is the same at each call.
    pub(crate) fn next(&mut self, map: &Map) -> Option<Vec<u8>> {
        loop {
            if let At::End = self.0 {
                return None;
            }
            let (part, next) = self.0.part(map);
            self.0 = next;
            if let Some(part) = part {
                return Some(encode(&part));
            }
        }
    }
}

impl At {
    /// The part that begins here, if there is one, and where the next one begins.
    fn part(self, map: &Map) -> (Option<v1::MapPart>, Self) {
        let part = v1::MapPart::default();
        match self {
            Self::Head => (Some(v1::MapPart { head: Some(head(map)), ..part }), Self::Clients),
            Self::Clients => {
                let clients = map.clients().iter().map(encode_client).collect();
                (Some(v1::MapPart { clients, ..part }), Self::Items(0, i64::MIN))
            }
            Self::Items(index, first) => {
                let Some(client) = map.client(ClientIndex(index)) else {
                    return (None, Self::Cameras(FIRST));
                };
                let entries = client.items.entries_from(first);
                let (entries, next) = chunk(entries, PART, |sequence, digest| (sequence, *digest));
                let next = next.map_or(Self::Items(index + 1, i64::MIN), |n| Self::Items(index, n));
                let items = v1::ClientItems {
                    client: index,
                    sequences: entries.iter().map(|&(sequence, _)| sequence).collect(),
                    digests: entries.iter().flat_map(|&(_, digest)| digest).collect(),
                };
                let part = v1::MapPart { items: vec![items], ..part };
                (Some(part).filter(|_| !entries.is_empty()), next)
            }
            Self::Cameras(first) => {
                let (cameras, next) = chunk(map.cameras().range(first..), PART, encode_camera_set);
                let next = next.map_or(Self::Landmarks(FIRST), Self::Cameras);
                (filled(v1::MapPart { cameras, ..part }), next)
            }
            Self::Landmarks(first) => {
                let entries = map.landmarks().entries_from(first);
                let (landmarks, next) = chunk(entries, PART, encode_landmark);
                let next = next.map_or(Self::Keyframes(FIRST), Self::Landmarks);
                (filled(v1::MapPart { landmarks, ..part }), next)
            }
            Self::Keyframes(first) => {
                let entries = map.keyframes().entries_from(first);
                let (keyframes, next) = chunk(entries, KEYFRAMES, encode_keyframe);
                let next = next.map_or(Self::Constraints(FIRST), Self::Keyframes);
                (filled(v1::MapPart { keyframes, ..part }), next)
            }
            Self::Constraints(first) => {
                let entries = map.constraints().entries_from(first);
                let (constraints, next) = chunk(entries, PART, encode_constraint);
                let next = next.map_or(Self::SwitchedOff(FIRST), Self::Constraints);
                (filled(v1::MapPart { constraints, ..part }), next)
            }
            Self::SwitchedOff(first) => {
                let entries = map.switched_off().range(first..);
                let (switched_off, next) = chunk(entries, PART, encode_switched_off);
                let next = next.map_or(Self::Priors(FIRST), Self::SwitchedOff);
                (filled(v1::MapPart { switched_off, ..part }), next)
            }
            Self::Priors(first) => {
                let (priors, next) = chunk(map.priors().entries_from(first), PART, encode_prior);
                let next = next.map_or(Self::Duplicates((FIRST, FIRST)), Self::Priors);
                (filled(v1::MapPart { priors, ..part }), next)
            }
            Self::Duplicates(first) => {
                let entries = map.duplicates().pairs_from(first);
                let (duplicates, next) = chunk(entries, PART, encode_duplicate);
                let next = next.map_or(Self::Compared(FIRST), Self::Duplicates);
                (filled(v1::MapPart { duplicates, ..part }), next)
            }
            Self::Compared(first) => {
                let entries = map.duplicates().compared().range(first..).map(|id| (id, &()));
                let (compared, next) = chunk(entries, PART, |id, ()| encode_id(id));
                let next = next.map_or(Self::Searches(FIRST), Self::Compared);
                (filled(v1::MapPart { compared, ..part }), next)
            }
            Self::Searches(first) => {
                let entries = map.place_searches().done.entries_from(first);
                let (searches, next) = chunk(entries, PART, encode_search);
                let next = next.map_or(Self::PendingSearches(FIRST), Self::Searches);
                (filled(v1::MapPart { searches, ..part }), next)
            }
            Self::PendingSearches(first) => {
                let entries = map.place_searches().pending.entries_from(first);
                let (pending_searches, next) = chunk(entries, PART, encode_pending);
                let contents = Self::Contents((Content::Camera, FIRST));
                let next = next.map_or(contents, Self::PendingSearches);
                (filled(v1::MapPart { pending_searches, ..part }), next)
            }
            Self::Contents(first) => {
                let entries = map.contents().entries_from(first);
                let (contents, next) = chunk(entries, PART, encode_content);
                (filled(v1::MapPart { contents, ..part }), next.map_or(Self::End, Self::Contents))
            }
            Self::End => (None, Self::End),
        }
    }
}

/// A part, unless it is empty.
fn filled(part: v1::MapPart) -> Option<v1::MapPart> {
    (part != v1::MapPart::default()).then_some(part)
}

/// The messages of at most `count` entries, and the key of the first one after them.
fn chunk<'a, K: Copy + 'a, V: 'a, M>(
    entries: impl Iterator<Item = (&'a K, &'a V)>,
    count: usize,
    encode: impl Fn(K, &V) -> M,
) -> (Vec<M>, Option<K>) {
    let mut messages = Vec::new();
    for (&key, value) in entries {
        if messages.len() == count {
            return (messages, Some(key));
        }
        messages.push(encode(key, value));
    }
    (messages, None)
}

fn head(map: &Map) -> v1::MapHead {
    v1::MapHead {
        revision: map.revision(),
        create_time_ns: map.create_time_ns(),
        update_time_ns: map.update_time_ns(),
        display_name: map.display_name().to_owned(),
        policy: Some(encode_policy(map.policy())),
        solve_count: map.solve_count(),
        state_hash: map.state_hash().to_vec(),
        frozen: map.is_frozen(),
        adjustment_due: map.is_adjustment_due(),
        unsolved_closures: map.place_searches().unsolved,
        merged: map.merged().iter().map(encode_merged).collect(),
        last_request: map.last_request().map(|request| v1::LastRequest {
            id: request.id.to_vec(),
            revision: request.revision,
            initial_cost: request.initial_cost.to_bits(),
            final_cost: request.final_cost.to_bits(),
        }),
    }
}

fn encode_content((kind, id): (Content, EntityId), digest: &Digest) -> v1::Content {
    v1::Content { kind: kind as u32 + 1, id: Some(encode_id(id)), digest: digest.to_vec() }
}

fn encode_duplicate((a, b): (EntityId, EntityId), closure: &Option<EntityId>) -> v1::DuplicatePair {
    let (a, b) = (Some(encode_id(a)), Some(encode_id(b)));
    v1::DuplicatePair { a, b, closure: closure.map(encode_id) }
}

fn encode_landmark(id: EntityId, landmark: &Landmark) -> v1::Landmark {
    let Landmark {
        position,
        sent_position,
        reference,
        observers: _,
        added_revision,
        positioned_revision,
    } = landmark;
    v1::Landmark {
        client: id.client.0,
        id: id.id,
        position: position.as_ref().map(encode_vector),
        sent_position: sent_position.as_ref().map(encode_vector),
        reference: reference.map(encode_id),
        added_revision: *added_revision,
        positioned_revision: *positioned_revision,
    }
}

fn encode_keyframe(id: EntityId, keyframe: &Keyframe) -> v1::Keyframe {
    let Keyframe {
        capture_time_ns,
        camera,
        world_from_camera,
        odom_from_camera,
        observations,
        global_descriptor,
        added_revision,
    } = keyframe;
    v1::Keyframe {
        id: Some(encode_id(id)),
        capture_time_ns: *capture_time_ns,
        camera: camera.map(encode_id),
        world_from_camera: Some(encode_pose(world_from_camera)),
        odom_from_camera: Some(encode_pose(odom_from_camera)),
        observations: encode_observations(observations),
        global_descriptor: global_descriptor.as_deref().map(encode_descriptor),
        added_revision: *added_revision,
    }
}
