//! Compares a stream of parts with a map in memory, without a second map beside it.
//!
//! Parts come in the order in which they were written, which is the order of ids. Each is decoded,
//! compared and let go. What a map computes from its parts (observers, covisibility) is not read.

use std::collections::{BTreeMap, btree_map};
use std::io::Read;
use std::mem;

use super::EncodingError;
use super::joined::each_part;
use covis_map::{
    CameraEntity, Constraint, Content, Digest, EntityId, Keyframe, Landmark, Map, MapParts, Prior,
    SharedMap, SwitchedOff, shared_map,
};

/// Reads the parts of a map and compares them with it.
///
/// # Errors
/// [`EncodingError`] where the parts are damaged; [`EncodingError::Different`] where they are those of
/// another map.
pub(crate) fn compare_map(input: &mut dyn Read, map: &Map) -> Result<(), EncodingError> {
    let mut rest = Remaining::of(map);
    let mut head = each_part(input, &mut |parts| rest.follow(parts, false))?;
    rest.follow(&mut head, true)?;
    same(is_head(&head, map), "the head and the clients")
}

/// What is still to come of each list of a map.
struct Remaining<'a> {
    items: Vec<shared_map::Iter<'a, i64, Digest>>,
    cameras: btree_map::Iter<'a, EntityId, CameraEntity>,
    keyframes: shared_map::Iter<'a, EntityId, Keyframe>,
    landmarks: shared_map::Iter<'a, EntityId, Landmark>,
    constraints: shared_map::Iter<'a, EntityId, Constraint>,
    switched_off: btree_map::Iter<'a, EntityId, SwitchedOff>,
    priors: shared_map::Iter<'a, EntityId, Prior>,
    contents: shared_map::Iter<'a, (Content, EntityId), Digest>,
}

impl<'a> Remaining<'a> {
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
            let read = &mem::take(&mut client.items);
            next_are(expected, read, PartialEq::eq, end, "the items of a client")?;
        }
        let read = &mem::take(&mut parts.cameras);
        next_are(&mut self.cameras, read, PartialEq::eq, end, "the cameras")?;
        let read = &mem::take(&mut parts.keyframes);
        next_are(&mut self.keyframes, read, PartialEq::eq, end, "the keyframes")?;
        let read = &mem::take(&mut parts.landmarks);
        next_are(&mut self.landmarks, read, is_landmark, end, "the landmarks")?;
        let read = &mem::take(&mut parts.constraints);
        next_are(&mut self.constraints, read, PartialEq::eq, end, "the constraints")?;
        let read = &mem::take(&mut parts.switched_off);
        let what = "the closures that are off";
        next_are(&mut self.switched_off, read, PartialEq::eq, end, what)?;
        let read = &mem::take(&mut parts.priors);
        next_are(&mut self.priors, read, PartialEq::eq, end, "the priors")?;
        let read = &mem::take(&mut parts.contents);
        next_are(&mut self.contents, read, PartialEq::eq, end, "the digests")
    }
}

fn same(is_same: bool, part: &'static str) -> Result<(), EncodingError> {
    if is_same { Ok(()) } else { Err(EncodingError::Different { part }) }
}

/// What was `read` must be the next of `expected`, and the last at the `end`.
fn next_are<'a, 'b, K: PartialEq + 'a + 'b, V: 'a + 'b>(
    expected: &mut impl Iterator<Item = (&'a K, &'a V)>,
    read: impl IntoIterator<Item = (&'b K, &'b V)>,
    is: fn(&V, &V) -> bool,
    end: bool,
    what: &'static str,
) -> Result<(), EncodingError> {
    let is_next = |(key, value)| expected.next().is_some_and(|(k, v)| k == key && is(value, v));
    same(read.into_iter().all(is_next) && !(end && expected.next().is_some()), what)
}

/// Observers aside, which are not read.
fn is_landmark(read: &Landmark, expected: &Landmark) -> bool {
    *read == Landmark { observers: read.observers.clone(), ..expected.clone() }
}

/// What is no list, and the clients without their items.
fn is_head(read: &MapParts, map: &Map) -> bool {
    let mut clients = map.clients().to_vec();
    clients.iter_mut().for_each(|client| client.items = SharedMap::default());
    // What was read of the lists has been compared and let go.
    let expected = MapParts {
        clients,
        cameras: BTreeMap::new(),
        keyframes: SharedMap::default(),
        landmarks: SharedMap::default(),
        constraints: SharedMap::default(),
        switched_off: BTreeMap::new(),
        priors: SharedMap::default(),
        contents: SharedMap::default(),
        ..map.to_parts()
    };
    *read == expected
}
