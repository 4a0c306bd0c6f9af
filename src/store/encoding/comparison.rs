//! Whether a stream of parts is a map that stands in memory, without a second map beside it.
//!
//! Parts come in the order in which they were written, which is the order of ids. Each is decoded,
//! compared and let go. What a map computes from its parts (observers, covisibility) is not read.

use std::collections::btree_map;
use std::io::Read;
use std::mem;

use super::EncodingError;
use super::joined::each_part;
use crate::map::{
    CameraEntity, Client, Constraint, Content, Digest, EntityId, Keyframe, Landmark, Map, MapParts,
    Prior, SwitchedOff, shared_map,
};

/// Reads the parts of a map and compares them with it.
///
/// # Errors
/// [`EncodingError`] where the parts are damaged; [`EncodingError::Different`] where they are those of
/// another map.
pub(in crate::store) fn compare_map(input: &mut dyn Read, map: &Map) -> Result<(), EncodingError> {
    let mut rest = Rest::of(map);
    let mut head = each_part(input, &mut |parts| rest.follow(parts, false))?;
    rest.follow(&mut head, true)?;
    same(is_head(&head, map), "the head and the clients")
}

/// What is still to come of each list of a map.
struct Rest<'a> {
    items: Vec<shared_map::Iter<'a, i64, Digest>>,
    cameras: btree_map::Iter<'a, EntityId, CameraEntity>,
    keyframes: shared_map::Iter<'a, EntityId, Keyframe>,
    landmarks: shared_map::Iter<'a, EntityId, Landmark>,
    constraints: shared_map::Iter<'a, EntityId, Constraint>,
    switched_off: btree_map::Iter<'a, EntityId, SwitchedOff>,
    priors: shared_map::Iter<'a, EntityId, Prior>,
    contents: shared_map::Iter<'a, (Content, EntityId), Digest>,
}

impl<'a> Rest<'a> {
    fn of(map: &'a Map) -> Self {
        Self {
            items: map.clients().iter().map(|client| client.items.iter()).collect(),
            cameras: map.cameras().iter(),
            keyframes: map.keyframes().iter(),
            landmarks: map.landmarks().iter(),
            constraints: map.constraints().iter(),
            switched_off: map.switched_off().iter(),
            priors: map.priors().iter(),
            contents: map.contents().iter(),
        }
    }

    /// Takes what was read out of `parts` and compares it with what comes next, which is nothing more
    /// at the `end`.
    fn follow(&mut self, parts: &mut MapParts, end: bool) -> Result<(), EncodingError> {
        for (client, expected) in parts.clients.iter_mut().zip(&mut self.items) {
            let read = mem::take(&mut client.items);
            next_are(expected, read.iter(), PartialEq::eq, end, "the items of a client")?;
        }
        let read = mem::take(&mut parts.cameras);
        next_are(&mut self.cameras, read.iter(), PartialEq::eq, end, "the cameras")?;
        let read = mem::take(&mut parts.keyframes);
        next_are(&mut self.keyframes, read.iter(), PartialEq::eq, end, "the keyframes")?;
        let read = mem::take(&mut parts.landmarks);
        next_are(&mut self.landmarks, read.iter(), is_landmark, end, "the landmarks")?;
        let read = mem::take(&mut parts.constraints);
        next_are(&mut self.constraints, read.iter(), PartialEq::eq, end, "the constraints")?;
        let read = mem::take(&mut parts.switched_off);
        next_are(
            &mut self.switched_off,
            read.iter(),
            PartialEq::eq,
            end,
            "the closures that are off",
        )?;
        let read = mem::take(&mut parts.priors);
        next_are(&mut self.priors, read.iter(), PartialEq::eq, end, "the priors")?;
        let read = mem::take(&mut parts.contents);
        next_are(&mut self.contents, read.iter(), PartialEq::eq, end, "the digests")
    }
}

fn same(is_same: bool, part: &'static str) -> Result<(), EncodingError> {
    if is_same { Ok(()) } else { Err(EncodingError::Different { part }) }
}

/// What was `read` must be the next of `expected`, and the last at the `end`.
fn next_are<'a, 'b, K: PartialEq + 'a + 'b, V: 'a + 'b>(
    expected: &mut impl Iterator<Item = (&'a K, &'a V)>,
    mut read: impl Iterator<Item = (&'b K, &'b V)>,
    is: fn(&V, &V) -> bool,
    end: bool,
    what: &'static str,
) -> Result<(), EncodingError> {
    let is_next = |(key, value)| expected.next().is_some_and(|(k, v)| k == key && is(value, v));
    same(read.all(is_next) && !(end && expected.next().is_some()), what)
}

/// Observers aside, which are not read.
fn is_landmark(read: &Landmark, expected: &Landmark) -> bool {
    let Landmark {
        position,
        sent_position,
        reference,
        observers: _,
        added_revision,
        positioned_revision,
    } = read;
    *position == expected.position
        && *sent_position == expected.sent_position
        && *reference == expected.reference
        && *added_revision == expected.added_revision
        && *positioned_revision == expected.positioned_revision
}

/// What is no list, and the clients without their items.
fn is_head(read: &MapParts, map: &Map) -> bool {
    let client = |(a, b): (&Client, &Client)| {
        let Client {
            name,
            epoch,
            next_sequence,
            optimized_sequence,
            pending_solve,
            closure_variance,
            earlier_frames,
            scale,
            items: _,
        } = a;
        *name == b.name
            && *epoch == b.epoch
            && *next_sequence == b.next_sequence
            && *optimized_sequence == b.optimized_sequence
            && *pending_solve == b.pending_solve
            && *closure_variance == b.closure_variance
            && *earlier_frames == b.earlier_frames
            && *scale == b.scale
    };
    read.revision == map.revision()
        && read.create_time_ns == map.create_time_ns()
        && read.update_time_ns == map.update_time_ns()
        && read.display_name == map.display_name()
        && read.policy == *map.policy()
        && read.frozen == map.is_frozen()
        && read.solve_count == map.solve_count()
        && read.duplicates == *map.duplicates()
        && read.adjustment_due == map.is_adjustment_due()
        && read.last_request.as_ref() == map.last_request()
        && read.place_searches == *map.place_searches()
        && read.merged == map.merged()
        && read.clients.len() == map.clients().len()
        && read.clients.iter().zip(map.clients()).all(client)
}
