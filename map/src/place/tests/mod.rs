//! Tests of place recognition: what an index promises whatever it holds, a walk of two laps, and a
//! recorded sequence.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod flood;
mod recorded;
mod walk;

use super::*;

/// 32 bytes that a seed decides.
fn descriptor(seed: u64) -> Vec<u8> {
    let word = |k: u64| {
        let mut z = (seed * 4 + k + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    (0..4).flat_map(|k| word(k).to_le_bytes()).collect()
}

fn id(client: u32, id: i64) -> EntityId {
    EntityId::new(ClientIndex(client), id)
}

fn orb(data: &[Vec<u8>]) -> Vec<Feature<'_>> {
    data.iter().map(|data| Feature { name: "orb", data }).collect()
}

/// The descriptors of a place, 40 of them its own and 10 that all places have.
fn place(number: u64) -> Vec<Vec<u8>> {
    (0..40).map(|k| descriptor(1000 + 40 * number + k)).chain((0..10).map(descriptor)).collect()
}

fn filled(places: impl IntoIterator<Item = u64>) -> PlaceIndex {
    let mut index = PlaceIndex::default();
    for number in places {
        let keyframe = id(0, number as i64);
        index.add(keyframe, number as i64 * 1_000, &orb(&place(number))).unwrap();
    }
    index
}

#[test]
fn an_answer_is_a_function_of_what_is_held() {
    let straight = filled(0..40);
    // Others came and went, and the order was another one.
    let mut winding = filled((60..90).chain((0..40).rev()));
    assert!((60..90).all(|number| winding.remove(id(0, number))));
    for number in 0..40 {
        let query = place(number);
        let own = |keyframe: EntityId| keyframe.id == 39;
        let answers =
            [&straight, &winding].map(|index| index.query(&orb(&query), None, 5, own).unwrap());
        assert_eq!(answers[0], answers[1], "place {number}");
        if number != 39 {
            assert_eq!(answers[0][0].keyframe, id(0, number as i64));
            // Of the ten that all places have a match in the same place tells nothing.
            assert_eq!(answers[0][0].matches.len(), 50);
        }
        assert!(answers[0].iter().all(|candidate| candidate.keyframe != id(0, 39)));
    }
}

#[test]
fn equal_scores_are_ordered_by_id() {
    let mut index = PlaceIndex::default();
    // Far from each other in time, or of another client: islands of their own.
    for keyframe in [id(1, 7), id(0, 30), id(0, 4)] {
        index.add(keyframe, keyframe.id * 1_000, &orb(&place(1))).unwrap();
    }
    for number in 100..120 {
        index.add(id(0, number - 92), (number - 92) * 1_000, &orb(&place(number as u64))).unwrap();
    }
    let answer = index.query(&orb(&place(1)), None, 3, |_| false).unwrap();
    let told: Vec<EntityId> = answer.iter().map(|candidate| candidate.keyframe).collect();
    assert_eq!(told, [id(0, 4), id(0, 30), id(1, 7)]);
    assert!(answer.windows(2).all(|pair| pair[0].score == pair[1].score));
    assert_eq!(answer[0].island.client, ClientIndex(0));
    assert!(answer[0].island.last_ns < answer[1].island.first_ns);
}

#[test]
fn what_all_places_have_counts_less() {
    let index = filled(0..30);
    let rare: Vec<Vec<u8>> = place(3)[..10].to_vec();
    let common: Vec<Vec<u8>> = place(3)[40..].to_vec();
    let score = |query: &[Vec<u8>]| index.query(&orb(query), None, 1, |_| false).unwrap()[0].score;
    assert!(score(&rare) > 0.9, "{}", score(&rare));
    assert!(score(&common) < 0.3, "{}", score(&common));
}

#[test]
fn a_keyframe_whose_image_looks_alike_is_compared_too() {
    let mut index = filled(0..40);
    let image = |number: u64| {
        let turn = 0.1 * number as f32;
        [turn.cos(), turn.sin()].iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>()
    };
    for number in 0..40 {
        let data = image(number);
        let seen = Feature { name: "vlad", data: &data };
        index.add_image(id(0, number as i64), number as i64 * 1_000, &seen).unwrap();
    }
    // Most features are of place 30, some of place 3.
    let query: Vec<Vec<u8>> = place(30).into_iter().take(30).chain(place(3)).take(45).collect();
    let keyframes = |image: Option<&Feature<'_>>, out: i64| {
        let found = index.query(&orb(&query), image, 1, |id| id.id == out).unwrap();
        found.iter().map(|candidate| candidate.keyframe).collect::<Vec<_>>()
    };
    assert_eq!(keyframes(None, -1), [id(0, 30)]);
    let data = image(3);
    let like_3 = Feature { name: "vlad", data: &data };
    assert_eq!(keyframes(Some(&like_3), -1), [id(0, 30), id(0, 3)]);
    assert!(!keyframes(Some(&like_3), 3).contains(&id(0, 3)), "what is excluded is no candidate");
    // What cannot be compared changes nothing.
    assert_eq!(keyframes(Some(&Feature { data: &data[1..], ..like_3 }), -1), [id(0, 30)]);
    let known = index.add_image(id(0, 3), 0, &like_3);
    assert_eq!(known, Err(PlaceError::Known(id(0, 3))));
}

#[test]
fn memory_comes_back() {
    let empty = PlaceIndex::default().bytes();
    let mut index = filled(0..300);
    let full = index.bytes();
    assert!(full > 300 * 50 * 32, "{full}");
    assert!((10..300).all(|number| index.remove(id(0, number))));
    let rest = index.bytes();
    assert!(rest < full / 5 && rest <= 2 * filled(0..10).bytes(), "{full} then {rest}");
    assert!((0..10).all(|number| index.remove(id(0, number))));
    assert!(!index.remove(id(0, 3)), "it went");
    assert_eq!(index.bytes(), empty);
}

#[test]
fn a_flood_of_equal_descriptors_hides_no_place() {
    let mut index = filled(0..10);
    let flood = vec![descriptor(5); 500];
    for number in 100..300 {
        index.add(id(1, number), number, &orb(&flood)).unwrap();
    }
    let without: usize = 200 * 500 * 34;
    assert!(index.bytes() < without + filled(0..10).bytes() + 200_000, "{}", index.bytes());
    let answer = index.query(&orb(&place(4)), None, 1, |_| false).unwrap();
    assert_eq!(answer[0].keyframe, id(0, 4));
    // In a keyframe full of equal descriptors no match is clear.
    let answer = index.query(&orb(&flood), None, 5, |_| false).unwrap();
    assert!(answer.iter().all(|candidate| candidate.matches.len() <= 1), "{answer:?}");
    assert!((100..300).all(|number| index.remove(id(1, number))));
    // A list may be shorter than the one that grew by doubling.
    assert!(index.bytes() <= filled(0..10).bytes());
}

#[test]
fn descriptors_of_different_types_are_not_compared() {
    let mut index = PlaceIndex::default();
    let data = place(1);
    index.add(id(0, 1), 0, &orb(&data)).unwrap();
    let named = |name| data.iter().map(|data| Feature { name, data }).collect::<Vec<_>>();
    assert!(index.query(&named("brief"), None, 5, |_| false).unwrap().is_empty());
    let short: Vec<Vec<u8>> = data.iter().map(|data| data[..16].to_vec()).collect();
    assert!(index.query(&orb(&short), None, 5, |_| false).unwrap().is_empty());
    // A keyframe with two types of descriptors is listed once, its features by their numbers in the list.
    let mut both = named("brief");
    both.extend(orb(&short));
    index.add(id(0, 2), 0, &both).unwrap();
    let answer = index.query(&both, None, 5, |_| false).unwrap();
    assert_eq!((answer.len(), answer[0].keyframe), (1, id(0, 2)));
    let places: Vec<(usize, usize)> =
        answer[0].matches.iter().map(|matched| (matched.query, matched.candidate)).collect();
    assert_eq!(places, (0..100).map(|k| (k, k)).collect::<Vec<_>>());
    assert!(index.remove(id(0, 2)) && !index.contains(id(0, 2)) && index.contains(id(0, 1)));
}

#[test]
fn what_is_refused_leaves_the_index_as_it_was() {
    let mut index = filled([1]);
    let bytes = index.bytes();
    let mut refused = |keyframe, features: &[Feature<'_>], text: &str| {
        let error = index.add(keyframe, 0, features).unwrap_err();
        assert!(error.to_string().contains(text), "{error}");
        assert_eq!(index.bytes(), bytes);
    };
    let data = place(2);
    refused(id(0, 1), &orb(&data), "keyframe 1 of client 0 is in the index already");
    let mut short = data.clone();
    short[3].truncate(15);
    refused(id(0, 2), &orb(&short), "descriptor 3 has 15 bytes");
    short[3] = vec![0; 513];
    refused(id(0, 2), &orb(&short), "descriptor 3 has 513 bytes");
    refused(id(0, 2), &orb(&vec![descriptor(1); 4097]), "4097 descriptors named \"orb\"");
    refused(id(0, 2), &orb(&vec![descriptor(1); 65_537]), "65537 descriptors");
    let lengths: Vec<Vec<u8>> = (16..32).map(|bytes| vec![1; bytes]).collect();
    refused(id(0, 2), &orb(&lengths), "17th type");
    assert!(index.query(&orb(&short), None, 1, |_| false).is_err());
    assert!(index.query(&[], None, 1, |_| false).unwrap().is_empty(), "nothing is asked");
    index.add(id(0, 9), 0, &[]).unwrap();
    assert!(!index.contains(id(0, 9)), "one without descriptors cannot be found");
}

#[test]
fn every_length_of_descriptor_is_found() {
    for bytes in [16, 17, 32, 48, 61, 64, 512] {
        let data: Vec<Vec<u8>> = (0..30)
            .map(|seed| (0..16).flat_map(|k| descriptor(100 * seed + k)).take(bytes).collect())
            .collect();
        let mut index = PlaceIndex::default();
        index.add(id(0, 1), 0, &orb(&data)).unwrap();
        let mut query = data.clone();
        query.iter_mut().for_each(|data| data[bytes - 1] ^= 0x81);
        let answer = index.query(&orb(&query), None, 1, |_| false).unwrap();
        assert_eq!(answer[0].matches.len(), 30, "{bytes} bytes");
        assert!(answer[0].matches.iter().all(|matched| matched.distance == 2));
    }
}

/// The best answer to a query.
struct Best {
    score: f64,
    /// Whether the query shows a place that the index holds.
    is_again: bool,
    is_right: bool,
}

/// Share of the queries in known places whose best candidate is right, with a score above that of every
/// best candidate that is wrong.
fn recall_at_precision_1(told: &[Best]) -> f64 {
    let wrong =
        told.iter().filter(|best| !best.is_right).map(|best| best.score).fold(0.0, f64::max);
    let right = told.iter().filter(|best| best.is_again && best.is_right && best.score > wrong);
    right.count() as f64 / told.iter().filter(|best| best.is_again).count() as f64
}
