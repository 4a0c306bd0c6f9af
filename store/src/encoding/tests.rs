//! Encoding is exact for every kind of change and for whole maps; what is not known is refused.

mod examples;
mod fields;

use proptest::prelude::*;
use prost::Message;

use super::{EncodingError, compare_map, decode_event, decode_map, encode_event, encode_map, v1};
use covis_map::{
    Affected, Change, Client, EntityId, Event, Map, MapParts, PendingSolve, SharedMap, SolveRequest,
};

pub(crate) use examples::every_change;
use examples::id;

fn bytes_of(event: &Event) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode_event(event, &mut bytes);
    bytes
}

fn replayed() -> Map {
    Map::replay(every_change().iter()).unwrap()
}

#[test]
fn every_change_comes_back_bit_for_bit() {
    for event in every_change() {
        let bytes = bytes_of(&event);
        let decoded = decode_event(&bytes).unwrap();
        assert_eq!(decoded, event);
        // Equality takes -0 for 0; the bytes do not.
        assert_eq!(bytes_of(&decoded), bytes, "{event:?}");
    }
    let kinds: std::collections::HashSet<_> =
        every_change().iter().map(|event| std::mem::discriminant(&event.change)).collect();
    assert_eq!(kinds.len(), 23, "each kind of change is in the list");
    let decoded =
        every_change().iter().map(|e| decode_event(&bytes_of(e)).unwrap()).collect::<Vec<_>>();
    assert_eq!(Map::replay(decoded.iter()).unwrap().state_hash(), replayed().state_hash());
}

#[test]
fn a_policy_of_an_early_journal_is_read_as_an_update_of_the_map() {
    let is_policy = |event: &Event| {
        let Change::MapUpdated { display_name, policy, frozen } = &event.change else {
            return false;
        };
        display_name.is_none() && policy.is_some() && frozen.is_none()
    };
    let event = every_change().into_iter().find(is_policy).unwrap();
    let mut message = v1::Event::decode(&*bytes_of(&event)).unwrap();
    let Some(v1::event::Change::MapUpdated(update)) = message.change else { panic!("an update") };
    message.change = update.policy.map(v1::event::Change::PolicySet);
    assert_eq!(decode_event(&message.encode_to_vec()).unwrap(), event);
}

#[test]
fn a_map_comes_back_bit_for_bit_after_every_event() {
    let mut map = Map::new();
    for event in every_change() {
        map.apply(&event).unwrap();
        let mut bytes = Vec::new();
        encode_map(&map, &mut bytes).unwrap();
        let decoded = decode_map(&mut &bytes[..]).unwrap();
        assert_eq!(decoded, map, "after revision {}", event.revision);
        assert_eq!(decoded.state_hash(), map.state_hash());
        assert_eq!(compare_map(&mut &bytes[..], &map), Ok(()));
        // It goes on as the original does.
        assert_eq!((decoded.solve_count(), decoded.create_time_ns()), (map.solve_count(), -5));
    }
}

#[test]
fn what_is_to_be_solved_for_a_client_comes_back() {
    let edited = |graph, keyframes| SolveRequest::Edited(Affected { graph, keyframes });
    for request in [
        SolveRequest::Views(id(3)),
        SolveRequest::LoopClosure,
        SolveRequest::Prior,
        edited(true, Vec::new()),
        edited(false, vec![id(10), id(3)]),
    ] {
        let mut parts = replayed().to_parts();
        parts.clients[0].pending_solve = Some(PendingSolve { sequence: 4, request });
        let map = Map::from_parts(parts).unwrap();
        let mut bytes = Vec::new();
        encode_map(&map, &mut bytes).unwrap();
        assert_eq!(decode_map(&mut &bytes[..]).unwrap(), map);
    }
}

#[test]
fn a_map_that_is_cut_or_changed_is_refused() {
    let mut bytes = Vec::new();
    encode_map(&replayed(), &mut bytes).unwrap();
    for cut in 0..bytes.len() {
        assert!(decode_map(&mut &bytes[..cut]).is_err(), "{cut} of {}", bytes.len());
    }
    let position = 1.0_f64.to_bits().to_le_bytes();
    let at = bytes.windows(8).rposition(|window| window == position).unwrap();
    bytes[at] ^= 1;
    assert_eq!(decode_map(&mut &bytes[..]).unwrap_err(), EncodingError::Hash);
}

#[test]
fn a_map_that_differs_from_its_file_in_one_thing_is_told() {
    // As far as it has one of everything.
    let full = |map: &Map| {
        let lists = [map.switched_off().len(), map.priors().len(), map.constraints().len()];
        lists.iter().all(|&len| len > 0) && !map.clients()[0].items.is_empty()
    };
    let mut map = Map::new();
    for event in every_change() {
        if !full(&map) {
            map.apply(&event).unwrap();
        }
    }
    assert!(full(&map));
    type Difference = (&'static str, fn(&mut MapParts));
    let differences: [Difference; 22] = [
        ("revision", |p| p.revision += 1),
        ("creation", |p| p.create_time_ns -= 1),
        ("update", |p| p.update_time_ns += 1),
        ("name", |p| p.display_name.push('x')),
        ("policy", |p| p.policy.window_keyframes += 1),
        ("state", |p| p.frozen ^= true),
        ("solves", |p| p.solve_count += 1),
        ("epoch", |p| p.clients[0].epoch += 1),
        ("an outstanding solve", |p| {
            p.clients[0].pending_solve =
                Some(PendingSolve { sequence: 1, request: SolveRequest::Prior });
        }),
        ("a client", |p| {
            let client = Client { items: SharedMap::default(), ..p.clients[0].clone() };
            p.clients.push(client);
        }),
        ("an item", |p| *p.clients[0].items.values_mut().last().unwrap() = [9; 32]),
        ("one item less", |p| _ = p.clients[0].items.pop_first()),
        ("a camera", |p| p.cameras.values_mut().last().unwrap().width_px += 1),
        ("a keyframe", |p| p.keyframes.values_mut().last().unwrap().capture_time_ns += 1),
        ("a landmark", |p| p.landmarks.values_mut().last().unwrap().added_revision += 1),
        ("a constraint", |p| {
            let constraint = p.constraints.values_mut().last().unwrap();
            constraint.keyframe_i_from_keyframe_j.translation.x += 1.0;
        }),
        ("a closure", |p| p.switched_off.values_mut().last().unwrap().chi2 += 1.0),
        ("one closure less", |p| _ = p.switched_off.pop_last()),
        ("a prior", |p| {
            let (&id, &prior) = p.priors.last_key_value().unwrap();
            p.priors.insert(EntityId::new(id.client, id.id + 1), prior);
        }),
        ("one prior less", |p| _ = p.priors.pop_first()),
        ("a digest", |p| *p.contents.values_mut().last().unwrap() = [9; 32]),
        ("one digest less", |p| _ = p.contents.pop_first()),
    ];
    for (what, differ) in differences {
        let mut parts = map.to_parts();
        differ(&mut parts);
        let other = Map::from_parts(parts).unwrap();
        for (written, held) in [(&map, &other), (&other, &map)] {
            let mut bytes = Vec::new();
            encode_map(written, &mut bytes).unwrap();
            let told = compare_map(&mut &bytes[..], held);
            assert!(matches!(told, Err(EncodingError::Different { .. })), "{what}: {told:?}");
        }
    }
    let mut bytes = Vec::new();
    encode_map(&map, &mut bytes).unwrap();
    for cut in 0..bytes.len() {
        assert!(compare_map(&mut &bytes[..cut], &map).is_err(), "{cut} of {}", bytes.len());
    }
}

#[test]
fn what_a_later_version_added_is_refused() {
    let event = &every_change()[5];
    // Field 60, a number: no version knows it yet.
    let unknown = [0xe0, 0x03, 0x01];
    let later = [&bytes_of(event)[..], &unknown].concat();
    assert_eq!(decode_event(&later), Err(EncodingError::Later));
    // The same inside of a message.
    let cause_end = [&[0x12, 3][..], &unknown].concat();
    assert!(decode_event(&[&[0x08, 1][..], &cause_end].concat()).is_err());
    assert_eq!(decode_event(&[0x08, 1]), Err(EncodingError::Missing("the change")));
}

proptest! {
    #[test]
    fn arbitrary_bytes_are_refused_or_encode_to_themselves(
        bytes in proptest::collection::vec(any::<u8>(), 0..300),
    ) {
        let _maybe = decode_event(&bytes);
        let _maybe = decode_map(&mut &bytes[..]);
    }

    #[test]
    fn a_changed_event_is_refused_or_another_event(
        which in any::<prop::sample::Index>(),
        at in any::<prop::sample::Index>(),
        value in any::<u8>(),
    ) {
        let events = every_change();
        let mut bytes = bytes_of(&events[which.index(events.len())]);
        let at = at.index(bytes.len());
        bytes[at] = value;
        let _maybe = decode_event(&bytes);
    }
}
