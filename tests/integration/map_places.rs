//! Which places are to be searched, and what is kept of what was found.

use covis::map::{
    AppliedSolve, Change, ClientIndex, Constraint, ConstraintKind, Descriptor, DescriptorKind,
    Edit, EntityId, EntityRef, Item, Map, MapPolicy, PlaceCandidate, PlaceRefusal, PlaceSearch,
    Reason, SolveKind, SolveRequest,
};
use covis_solvers::information::Information;
use std::sync::Arc;

use crate::map_support::{Journal, ROBOT, id, pose_at, solve_of, street_keyframe};

fn described(id: i64, known: &Map) -> Item {
    let mut item = street_keyframe(id, pose_at(id as f64), known);
    if let Item::Keyframe { observations, .. } = &mut item {
        for observation in observations {
            let (name, data) = ("orb".to_owned(), vec![id as u8; 32]);
            let descriptor = Descriptor { kind: DescriptorKind::Binary, name, data };
            observation.descriptor = Some(Arc::new(descriptor));
        }
    }
    item
}

fn street(policy: MapPolicy) -> Journal {
    let mut journal = Journal::new(policy);
    for id in 0..4 {
        let item = described(id, &journal.map);
        journal.send(ROBOT, &item).unwrap();
    }
    journal
}

fn pending(map: &Map) -> Vec<i64> {
    map.place_searches().pending.keys().map(|keyframe| keyframe.id).collect()
}

/// Keyframe 3 is found to show the place of keyframe 0.
fn found(journal: &mut Journal) -> EntityId {
    let closure = EntityId::new(ROBOT, -(journal.map.revision() + 1) * 4096);
    let refusal = PlaceRefusal { reason: "ambiguous".to_owned(), text: "two poses".to_owned() };
    let candidate = |keyframe, refusal| PlaceCandidate {
        keyframe: id(keyframe),
        score: 0.5,
        matches: 40,
        refusal,
    };
    let search = PlaceSearch {
        candidates: vec![candidate(1, Some(refusal)), candidate(0, None)],
        closure: Some(closure),
        refusal: None,
    };
    let constraint = Constraint {
        kind: ConstraintKind::LoopClosure,
        keyframe_i: id(0),
        keyframe_j: id(3),
        keyframe_i_from_keyframe_j: pose_at(3.0),
        information: Information::identity(),
        loss: None,
    };
    journal.push(Change::PlacesSearched {
        searches: vec![(id(3), search)],
        closures: vec![(closure, constraint)],
    });
    closure
}

#[test]
fn a_keyframe_with_descriptors_waits_for_its_search_until_it_is_done() {
    let mut journal = street(MapPolicy::default());
    assert_eq!(pending(&journal.map), [0, 1, 2, 3]);
    let closure = found(&mut journal);
    assert_eq!(pending(&journal.map), [0, 1, 2]);
    let search = &journal.map.place_searches().done.get(&id(3)).unwrap();
    assert_eq!(search.closure, Some(closure));
    assert!(journal.map.constraints().contains_key(&closure));
    // A snapshot goes on from there, and so does a replayed journal.
    let parts = Map::from_parts(journal.map.to_parts()).unwrap();
    assert_eq!(parts, journal.map);
    journal.map.check_sound().unwrap();
    assert_eq!(Map::replay(journal.events.iter()).unwrap(), journal.map);
}

#[test]
fn without_recognition_nothing_waits() {
    let policy = MapPolicy { place_recognition: false, ..MapPolicy::default() };
    assert!(pending(&street(policy).map).is_empty());
    let mut journal = street(MapPolicy::default());
    let change = Change::MapUpdated { display_name: None, policy: Some(policy), frozen: None };
    journal.push(change);
    assert!(pending(&journal.map).is_empty());
}

/// A pose graph that covers the server's closures up to a revision and moves nothing.
fn covering(revision: i64) -> Change {
    let solve = AppliedSolve {
        covered: vec![(ClientIndex::SERVER, revision)],
        ..solve_of(SolveKind::PoseGraph)
    };
    Change::SolveApplied { solve }
}

#[test]
fn a_closure_of_the_server_asks_for_a_pose_graph_until_one_has_covered_it() {
    let mut journal = street(MapPolicy::default());
    found(&mut journal);
    let revision = journal.map.revision();
    let of_server = |map: &Map| {
        let pending = map.pending_solves().into_iter();
        pending.filter(|(client, _)| *client == ClientIndex::SERVER).collect::<Vec<_>>()
    };
    let asked = of_server(&journal.map);
    assert_eq!(asked.len(), 1);
    assert_eq!((asked[0].1.sequence, &asked[0].1.request), (revision, &SolveRequest::LoopClosure));
    // A pose graph that began before it does not cover it.
    journal.push(covering(revision - 1));
    assert_eq!(of_server(&journal.map), asked);
    journal.push(covering(revision));
    assert!(of_server(&journal.map).is_empty());
}

#[test]
fn a_closure_of_the_server_can_be_revoked_and_goes_with_its_keyframe() {
    let mut journal = street(MapPolicy::default());
    let closure = found(&mut journal);
    let constraint = EntityRef::own(closure.id);
    journal.send(ROBOT, &Item::Edit(Edit::RevokeConstraint { constraint })).unwrap();
    assert!(!journal.map.constraints().contains_key(&closure));
    // What was found stays, so that nobody wonders what the closure was.
    assert!(journal.map.place_searches().done.contains_key(&id(3)));
    let keyframe = EntityRef::own(3);
    journal.send(ROBOT, &Item::Edit(Edit::RemoveKeyframe { keyframe })).unwrap();
    assert!(journal.map.place_searches().done.is_empty());
    assert_eq!(pending(&journal.map), [0, 1, 2]);
}

#[test]
fn what_stands_for_a_retired_keyframe_is_not_revoked() {
    let mut journal = street(MapPolicy::default());
    let closure = found(&mut journal);
    let marginal = EntityId::new(ROBOT, closure.id + 1);
    let kept = Constraint {
        kind: ConstraintKind::Marginal,
        ..*journal.map.constraints().get(&closure).unwrap()
    };
    journal.push(Change::ConstraintAdded { id: marginal, constraint: kept });
    let revoke =
        |id: EntityId| Item::Edit(Edit::RevokeConstraint { constraint: EntityRef::own(id.id) });
    let rejection = journal.send(ROBOT, &revoke(marginal)).unwrap_err();
    assert_eq!(rejection.violations[0].reason, Reason::UnknownReference);
    journal.send(ROBOT, &revoke(closure)).unwrap();
}

#[test]
fn a_reason_is_short() {
    let text = "é".repeat(PlaceRefusal::LONGEST);
    let refusal = PlaceRefusal::new("no_room", &text);
    assert_eq!((refusal.reason.as_str(), refusal.text.len()), ("no_room", PlaceRefusal::LONGEST));
    let with = |refusal| {
        let mut parts = street(MapPolicy::default()).map.to_parts();
        let search = PlaceSearch { refusal: Some(refusal), ..PlaceSearch::default() };
        parts.place_searches.done.insert(id(0), search);
        Map::from_parts(parts).unwrap()
    };
    with(refusal).check_sound().unwrap();
    // In a file from outside it takes memory that nobody counts.
    let long = PlaceRefusal { reason: "no_room".to_owned(), text };
    with(long).check_sound().unwrap_err();
}
