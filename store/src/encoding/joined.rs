//! The parts of a map that `snapshot` wrote, read and put together again.
//!
//! A part is refused where it is damaged, and where it has fields of a later version unless the reader
//! skips these. A map that does not have the state hash of its head is another one than was written.

use std::io::Read;

use super::change::decode_request;
use super::clients::decode_client;
use super::entities::{
    decode_camera_set, decode_constraint, decode_descriptor, decode_id, decode_kind,
    decode_observations, decode_policy, decode_pose, decode_prior, decode_switched_off,
    decode_vector, required_id,
};
use super::event::decode_digest;
use super::merging::decode_merged;
use super::places::{decode_pending, decode_search};
use super::snapshot::stream;
use super::{EncodingError, decode, decode_known, required, v1};
use covis_map::{
    ClientIndex, Content, Digest, EntityId, Keyframe, Landmark, LastRequest, Map, MapParts,
    Observers, Usage,
};

/// A longer part is damage, not a map.
const LONGEST_PART: u64 = 1 << 30;

/// Reads the parts of a map and puts it together.
///
/// # Errors
/// [`EncodingError`] where the parts are damaged, of a later version, or another map than was
/// written.
pub(crate) fn decode_map(input: &mut dyn Read) -> Result<Map, EncodingError> {
    let mut parts = PartsReader::default();
    read_parts(input, &mut |part| parts.take(part).map(|_counts| ()))?;
    parts.finish(true)
}

/// The parts of a map that were read so far.
#[derive(Debug, Default)]
pub(crate) struct PartsReader {
    parts: MapParts,
    state_hash: Option<Digest>,
    counted: Usage,
}

impl PartsReader {
    /// Takes the bytes of the next part. Skips fields of a later version where it `may_be_later`.
    /// Returns what the parts hold so far, without an estimate of memory.
    ///
    /// # Errors
    /// [`EncodingError`] where the part is damaged, or of a later version.
    pub(crate) fn add(&mut self, bytes: &[u8], may_be_later: bool) -> Result<Usage, EncodingError> {
        self.take(if may_be_later { decode_known(bytes)? } else { decode(bytes)? })
    }

    fn take(&mut self, part: v1::MapPart) -> Result<Usage, EncodingError> {
        if let Some(head) = &part.head {
            self.state_hash = Some(decode_digest(&head.state_hash)?);
        }
        let seen: usize = part.keyframes.iter().map(|keyframe| keyframe.observations.len()).sum();
        let count = |length: usize| length as u64;
        let more = Usage {
            clients: count(part.clients.len()),
            cameras: count(part.cameras.len()),
            keyframes: count(part.keyframes.len()),
            landmarks: count(part.landmarks.len()),
            observations: count(seen),
            constraints: count(part.constraints.len()),
            priors: count(part.priors.len()),
            bytes: 0,
        };
        self.counted = self.counted + more;
        take_part(&mut self.parts, part)?;
        Ok(self.counted)
    }

    /// The map, whose state hash is the written one where it `is_same_version`.
    ///
    /// # Errors
    /// [`EncodingError`] where the parts do not fit each other.
    pub(crate) fn finish(self, is_same_version: bool) -> Result<Map, EncodingError> {
        let state_hash = required(self.state_hash, "the map's head")?;
        let map = Map::from_parts(self.parts)?;
        if is_same_version && map.state_hash() != state_hash {
            return Err(EncodingError::Hash);
        }
        Ok(map)
    }
}

/// Reads the parts of a map one after the other, each of which `take` may take away; answers what it
/// left.
///
/// # Errors
/// [`EncodingError`] where a part is damaged or of a later version, and those of `take`.
pub(super) fn each_part(
    input: &mut dyn Read,
    take: &mut dyn FnMut(&mut MapParts) -> Result<(), EncodingError>,
) -> Result<MapParts, EncodingError> {
    let mut parts = MapParts::default();
    read_parts(input, &mut |part| {
        take_part(&mut parts, part)?;
        take(&mut parts)
    })?;
    Ok(parts)
}

fn read_parts(
    input: &mut dyn Read,
    each: &mut dyn FnMut(v1::MapPart) -> Result<(), EncodingError>,
) -> Result<(), EncodingError> {
    let mut buffer = Vec::new();
    while let Some(length) = read_length(input)? {
        if length > LONGEST_PART {
            return Err(EncodingError::Invalid("the length of a part"));
        }
        buffer.clear();
        // Grows with what is really there, whatever the length says.
        let read = input.take(length).read_to_end(&mut buffer).map_err(stream)?;
        if read as u64 != length {
            return Err(EncodingError::Stream("a part is cut off".to_owned()));
        }
        each(decode(&buffer)?)?;
    }
    Ok(())
}

/// The length of the next part; `None` at the end.
fn read_length(input: &mut dyn Read) -> Result<Option<u64>, EncodingError> {
    let mut bytes = Vec::with_capacity(8);
    input.take(8).read_to_end(&mut bytes).map_err(stream)?;
    match <[u8; 8]>::try_from(&bytes[..]) {
        Ok(length) => Ok(Some(u64::from_le_bytes(length))),
        Err(_) if bytes.is_empty() => Ok(None),
        Err(_) => Err(EncodingError::Stream("a part's length is cut off".to_owned())),
    }
}

fn take_part(parts: &mut MapParts, part: v1::MapPart) -> Result<(), EncodingError> {
    if let Some(head) = part.head {
        parts.revision = head.revision;
        parts.create_time_ns = head.create_time_ns;
        parts.update_time_ns = head.update_time_ns.max(head.create_time_ns);
        parts.display_name = head.display_name;
        parts.policy = decode_policy(head.policy)?;
        parts.solve_count = head.solve_count;
        parts.frozen = head.frozen;
        parts.adjustment_due = head.adjustment_due;
        parts.last_request = match head.last_request {
            None => None,
            Some(request) => {
                let costs = [request.initial_cost, request.final_cost].map(f64::from_bits);
                let id = decode_request(&request.id)?;
                Some(LastRequest::new(id, request.revision, costs.into()))
            }
        };
        parts.place_searches.unsolved = head.unsolved_closures;
        parts.merged = head.merged.into_iter().map(decode_merged).collect::<Result<_, _>>()?;
    }
    for client in part.clients {
        parts.clients.push(decode_client(client)?);
    }
    for items in part.items {
        let client = parts.clients.get_mut(items.client as usize);
        let client = required(client, "a client")?;
        if items.digests.len() != 32 * items.sequences.len() {
            return Err(EncodingError::Invalid("digests of items"));
        }
        for (sequence, digest) in items.sequences.into_iter().zip(items.digests.chunks(32)) {
            client.items.insert(sequence, decode_digest(digest)?);
        }
    }
    take(&mut parts.cameras, part.cameras, decode_camera_set)?;
    take(&mut parts.landmarks, part.landmarks, |landmark| Ok(decode_landmark(landmark)))?;
    take(&mut parts.keyframes, part.keyframes, decode_keyframe)?;
    take(&mut parts.constraints, part.constraints, decode_constraint)?;
    take(&mut parts.switched_off, part.switched_off, decode_switched_off)?;
    take(&mut parts.priors, part.priors, decode_prior)?;
    for v1::DuplicatePair { a, b, closure } in part.duplicates {
        let (a, b) = (required_id(a, "a landmark")?, required_id(b, "a landmark")?);
        if a >= b {
            return Err(EncodingError::Invalid("a pair of landmarks"));
        }
        parts.duplicates.extend([(a, b, closure.map(decode_id))], []);
    }
    parts.duplicates.extend([], part.compared.into_iter().map(decode_id));
    take(&mut parts.place_searches.done, part.searches, decode_search)?;
    take(&mut parts.place_searches.pending, part.pending_searches, decode_pending)?;
    for v1::Content { kind, id, digest } in part.contents {
        let kinds = [Content::Camera, Content::Keyframe, Content::Constraint];
        let kind = decode_kind(&kinds, kind, "the kind of a content")?;
        let id = required_id(id, "an entity's id")?;
        parts.contents.insert((kind, id), decode_digest(&digest)?);
    }
    Ok(())
}

/// Decodes entities and adds them to their list.
fn take<M, V>(
    list: &mut impl Extend<(EntityId, V)>,
    messages: Vec<M>,
    decode: impl Fn(M) -> Result<(EntityId, V), EncodingError>,
) -> Result<(), EncodingError> {
    messages.into_iter().try_for_each(|message| {
        list.extend([decode(message)?]);
        Ok(())
    })
}

fn decode_landmark(landmark: v1::Landmark) -> (EntityId, Landmark) {
    let id = EntityId::new(ClientIndex(landmark.client), landmark.id);
    let landmark = Landmark {
        position: landmark.position.map(decode_vector),
        sent_position: landmark.sent_position.map(decode_vector),
        reference: landmark.reference.map(decode_id),
        observers: Observers::default(),
        added_revision: landmark.added_revision,
        positioned_revision: landmark.positioned_revision,
    };
    (id, landmark)
}

fn decode_keyframe(keyframe: v1::Keyframe) -> Result<(EntityId, Keyframe), EncodingError> {
    let id = required_id(keyframe.id, "a keyframe's id")?;
    let keyframe = Keyframe {
        capture_time_ns: keyframe.capture_time_ns,
        camera: keyframe.camera.map(decode_id),
        world_from_camera: decode_pose(keyframe.world_from_camera, "world_from_camera")?,
        odom_from_camera: decode_pose(keyframe.odom_from_camera, "odom_from_camera")?,
        observations: decode_observations(keyframe.observations)?.into(),
        global_descriptor: keyframe.global_descriptor.map(decode_descriptor).transpose()?,
        added_revision: keyframe.added_revision,
    };
    Ok((id, keyframe))
}
