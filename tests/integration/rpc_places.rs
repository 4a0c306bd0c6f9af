//! Loops that the server finds itself, by what keyframes look like: on a recorded desk and on walks that
//! are made from a seed. No client sends a closure here.

use std::collections::BTreeMap;

use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3};

use crate::common::{TestServer, run};
use crate::made_sequence::Course;
use crate::sequence::{Order, Sequence, ate, build, pose, state};
use crate::{closure_verdicts, loop_fusion, made_verdicts};

/// Common view of two keyframes from which a place is the same.
const SAME: f64 = 0.3;
/// Time after which a place is seen again, s.
const LATER_S: f64 = 3.0;

fn recognizing() -> v1::MapPolicy {
    let enabled = v1::PlaceRecognition { enabled: Some(true) };
    // Each closure would have the whole map adjusted before the next keyframe is taken.
    let closure_adjustment = Some(false);
    v1::MapPolicy { place_recognition: Some(enabled), closure_adjustment, ..Default::default() }
}

async fn searches(server: &TestServer, name: &str) -> Vec<v1::PlaceSearch> {
    let request = v1::ListPlaceSearchesRequest { map_id: name.to_owned(), ..Default::default() };
    let mut stream = server.maps().list_place_searches(request).await.unwrap().into_inner();
    let mut searches = Vec::new();
    while let Some(part) = stream.message().await.unwrap() {
        searches.extend(part.searches);
    }
    searches
}

async fn closures(server: &TestServer, name: &str) -> BTreeMap<i64, v1::RelativePoseConstraint> {
    let request = v1::ListConstraintsRequest { map_id: name.to_owned(), ..Default::default() };
    let mut stream = server.maps().list_constraints(request).await.unwrap().into_inner();
    let mut closures = BTreeMap::new();
    while let Some(part) = stream.message().await.unwrap() {
        for constraint in part.constraints {
            if let Some(v1::constraint::Constraint::RelativePose(c)) = constraint.constraint
                && c.kind() == v1::ConstraintKind::LoopClosure
            {
                closures.insert(c.id, c);
            }
        }
    }
    closures
}

/// What came of a sequence.
#[derive(Debug, Default)]
struct Outcome {
    /// Closures that were added.
    closures: usize,
    /// Those that are not switched off.
    counting: usize,
    /// Errors of the closures that count, m and degrees, largest of each.
    worst: (f64, f64),
    /// Closures that count and are further from the truth than 0.1 m or 5°.
    wrong: usize,
    /// Keyframes that have an earlier one of the same place.
    again: usize,
    /// Those of them that a closure joins with one.
    recalled: usize,
    reasons: BTreeMap<String, usize>,
}

/// Share of the points that `b` sees which `a` has in its image.
fn common_view(sequence: &Sequence, a: usize, b: usize) -> f64 {
    let a_from_b = sequence.truth[a].inverse().compose(&sequence.truth[b]);
    let seen = sequence.observations[b].iter().filter(|row| row[3] > 0.0);
    let (mut all, mut common) = (0, 0);
    for &[_, u, v, z, ..] in seen {
        let (x, y) = ((u - 319.5) / 525.0 * z, (v - 239.5) / 525.0 * z);
        let p = a_from_b.transform(&nalgebra::Vector3::new(x, y, z));
        let (u, v) = (525.0 * p.x / p.z + 319.5, 525.0 * p.y / p.z + 239.5);
        all += 1;
        let is_in_image = p.z > 0.1 && (0.0..640.0).contains(&u) && (0.0..480.0).contains(&v);
        common += usize::from(is_in_image);
    }
    f64::from(common as u32) / f64::from(all.max(1))
}

async fn outcome(server: &TestServer, name: &str, sequence: &Sequence) -> Outcome {
    let closures = closures(server, name).await;
    let searches = searches(server, name).await;
    let mut outcome = Outcome { closures: closures.len(), ..Outcome::default() };
    let mut joined = vec![false; sequence.truth.len()];
    for closure in closures.values().filter(|closure| closure.switched_off.is_none()) {
        let id = |keyframe: &Option<v1::KeyframeRef>| keyframe.as_ref().unwrap().id as usize;
        let (i, j) = (id(&closure.keyframe_i), id(&closure.keyframe_j));
        let measured = closure.keyframe_i_from_keyframe_j.as_ref().unwrap();
        let (t, q) = (measured.translation.unwrap(), measured.rotation.unwrap());
        let measured: Se3 = pose(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w]);
        let truth = sequence.truth[i].inverse().compose(&sequence.truth[j]);
        let error = truth.inverse().compose(&measured);
        let (m, deg) = (error.translation.norm(), error.rotation.log().norm().to_degrees());
        outcome.counting += 1;
        outcome.wrong += usize::from(m > 0.1 || deg > 5.0);
        outcome.worst = (outcome.worst.0.max(m), outcome.worst.1.max(deg));
        joined[j] = true;
    }
    for (k, joined) in joined.iter().enumerate() {
        let is_old = |&other: &usize| sequence.odometry[other].0 < sequence.odometry[k].0 - LATER_S;
        if (0..k).filter(is_old).any(|other| common_view(sequence, other, k) >= SAME) {
            outcome.again += 1;
            outcome.recalled += usize::from(*joined);
        }
    }
    for candidate in searches.iter().flat_map(|search| &search.candidates) {
        let reason = candidate.refusal.as_ref().map_or("closed", |refusal| &refusal.reason);
        *outcome.reasons.entry(reason.to_owned()).or_default() += 1;
    }
    outcome
}

/// Builds the map of a sequence and prints what came of it.
async fn walked(server: &TestServer, name: &str, sequence: &Sequence) -> (Outcome, f64, f64) {
    build(server, name, (sequence, &[]), Order::Streamed, recognizing()).await;
    let outcome = outcome(server, name, sequence).await;
    let state = state(server, name).await;
    let (before, after) =
        (ate(&sequence.poses(), &sequence.truth), ate(&state.poses, &sequence.truth));
    println!("{name}: {outcome:?}; ATE {before:.4} m by odometry, {after:.4} m");
    (outcome, before, after)
}

#[test]
fn a_recorded_desk_closes_its_loops_itself() {
    let Some(sequence) = closure_verdicts::read() else { return };
    run(async {
        let server = TestServer::lock_step().await;
        let (outcome, before, after) = walked(&server, "desk", &sequence).await;
        assert!(10 * outcome.recalled >= 6 * outcome.again, "{outcome:?}");
        assert!(2.0 * after <= before, "{after} of {before} m");
    });
}

#[test]
fn walks_through_made_buildings_are_closed() {
    run(async {
        let server = TestServer::lock_step().await;
        for (name, course) in [
            ("room", made_verdicts::room()),
            ("corridor", made_verdicts::corridor()),
            ("eight", made_verdicts::eight()),
        ] {
            let sequence = course.make(1).sequence;
            let (outcome, ..) = walked(&server, name, &sequence).await;
            assert_eq!(outcome.wrong, 0, "{name}: {outcome:?}");
            assert!(10 * outcome.recalled >= 8 * outcome.again, "{name}: {outcome:?}");
        }
    });
}

/// Around in a room, then through a door into one that looks exactly like it.
fn twins() -> Course {
    let around = |x: f64| {
        (0..=12).map(move |k| {
            let angle = f64::from(k) * std::f64::consts::FRAC_PI_6;
            [x + 1.2 * angle.cos(), 1.0 * angle.sin()]
        })
    };
    // A corridor below both rooms leads from one to the other.
    let way: Vec<[f64; 2]> = around(0.0)
        .chain([[0.0, -1.0], [0.0, -4.0], [8.0, -4.0], [8.0, -1.0]])
        .chain(around(8.0))
        .collect();
    let door = |a: [f64; 2], b: [f64; 2]| [a, b];
    let walls = vec![
        door([-2.5, 2.0], [2.5, 2.0]),
        door([-2.5, -2.0], [-2.5, 2.0]),
        door([2.5, -2.0], [2.5, 2.0]),
        door([-2.5, -2.0], [-0.6, -2.0]),
        door([0.6, -2.0], [2.5, -2.0]),
        // Of the corridor, which looks alike too.
        door([-2.5, -5.5], [5.5, -5.5]),
    ];
    Course {
        way,
        walls,
        copies: vec![[8.0, 0.0]],
        points_per_m: 60.0,
        step_m: 0.17,
        closure_step: 1000,
        calibration_error: 0.01,
    }
}

#[test]
fn two_rooms_that_look_alike_are_not_joined() {
    run(async {
        let server = TestServer::lock_step().await;
        let sequence = twins().make(1).sequence;
        let (outcome, before, after) = walked(&server, "twins", &sequence).await;
        assert_eq!(outcome.wrong, 0, "{outcome:?}");
        assert!(outcome.reasons.contains_key("improbable"), "{outcome:?}");
        assert!(after <= 1.1 * before, "{after} of {before} m");
    });
}

#[test]
fn a_walk_of_300_m_around_a_block_is_closed() {
    let sequence = loop_fusion::walk(5).sequence;
    run(async {
        let server = TestServer::lock_step().await;
        let (outcome, before, after) = walked(&server, "block", &sequence).await;
        assert_eq!(outcome.wrong, 0, "{outcome:?}");
        assert!(3.0 * after <= before, "{after} of {before} m");
    });
}
