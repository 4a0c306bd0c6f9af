//! Loops that the server finds itself, by what keyframes look like: on a recorded desk and on walks that
//! are made from a seed. No client sends a closure here.

use std::collections::{BTreeMap, BTreeSet};

use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::testing::data;
use nalgebra::{Matrix6, Vector3};

use crate::common::{TestServer, run};
use crate::made_sequence::{Course, Made};
use crate::sequence::{Order, Sequence, ate, build, pose, state};
use crate::{closure_verdicts, loop_fusion, made_verdicts};

/// Common view of two keyframes from which a place is the same.
const SAME: f64 = 0.3;
/// The same, below which it is another place.
const OTHER: f64 = 0.1;
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
    /// Closures that count.
    counting: usize,
    /// Largest errors of those, m and degrees.
    worst: (f64, f64),
    /// Those that count and are off by more than 0.1 m or 5°.
    far: usize,
    /// Those of them whose information excludes the error.
    wrong: usize,
    /// Keyframes that have an earlier one of the same place.
    again: usize,
    /// Those of them that a closure joins with one.
    recalled: usize,
    /// How often each verdict was given.
    verdicts: BTreeMap<String, usize>,
    /// Precision and recall by score alone.
    curve: String,
}

/// χ² of six degrees of freedom that one error in 10,000 exceeds.
const EXCLUDED: f64 = 27.86;

/// The share of what keyframe `b` sees that `a` saw.
type CommonView<'a> = &'a dyn Fn(usize, usize) -> f64;

async fn outcome(
    server: &TestServer,
    name: &str,
    sequence: &Sequence,
    common: CommonView<'_>,
) -> Outcome {
    let closures = closures(server, name).await;
    let mut outcome = Outcome::default();
    let mut joined = vec![false; sequence.truth.len()];
    for closure in closures.values().filter(|closure| closure.switched_off.is_none()) {
        let id = |keyframe: &Option<v1::KeyframeRef>| keyframe.as_ref().unwrap().id as usize;
        let (i, j) = (id(&closure.keyframe_i), id(&closure.keyframe_j));
        let measured = closure.keyframe_i_from_keyframe_j.as_ref().unwrap();
        let (t, q) = (measured.translation.unwrap(), measured.rotation.unwrap());
        let measured: Se3 = pose(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w]);
        let truth = sequence.truth[i].inverse().compose(&sequence.truth[j]);
        let error = measured.inverse().compose(&truth);
        let (m, deg) = (error.translation.norm(), error.rotation.log().norm().to_degrees());
        let information = matrix(&closure.information.as_ref().unwrap().upper_triangle);
        let (error, is_far) = (error.log(), m > 0.1 || deg > 5.0);
        outcome.counting += 1;
        outcome.far += usize::from(is_far);
        outcome.wrong += usize::from(is_far && error.dot(&(information * error)) > EXCLUDED);
        outcome.worst = (outcome.worst.0.max(m), outcome.worst.1.max(deg));
        joined[j] = true;
    }
    let times: Vec<f64> = sequence.odometry.iter().map(|&(time, _)| time).collect();
    let mut is_again = Vec::new();
    for (k, joined) in joined.iter().enumerate() {
        let mut earlier = (0..k).filter(|&other| times[other] < times[k] - LATER_S);
        is_again.push(earlier.any(|other| common(other, k) >= SAME));
        outcome.again += usize::from(is_again[k]);
        outcome.recalled += usize::from(is_again[k] && *joined);
    }
    let mut best = Vec::new();
    for search in searches(server, name).await {
        for candidate in &search.candidates {
            let reason = candidate.refusal.as_ref().map_or("closed", |refusal| &refusal.reason);
            *outcome.verdicts.entry(reason.to_owned()).or_default() += 1;
        }
        if let Some(candidate) = search.candidates.first() {
            let id = |keyframe: &Option<v1::KeyframeRef>| keyframe.as_ref().unwrap().id as usize;
            let (i, j) = (id(&candidate.keyframe), id(&search.keyframe));
            best.push((candidate.score, common(i, j) >= OTHER, is_again[j]));
        }
    }
    outcome.curve = curve(best, outcome.again);
    outcome
}

/// Precision and recall of best candidates, from the highest score on: (score, whether it is right,
/// whether its keyframe sees a place again).
fn curve(mut best: Vec<(f64, bool, bool)>, again: usize) -> String {
    best.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (mut right, mut recalled, mut points) = (0, 0, Vec::new());
    for (count, (_, is_right, is_again)) in (1..).zip(best) {
        right += u32::from(is_right);
        recalled += u32::from(is_right && is_again);
        let recall = f64::from(recalled) / again as f64;
        points.push(format!("{:.3},{recall:.3}", f64::from(right) / f64::from(count)));
    }
    points.join(" ")
}

/// The matrix of an upper triangle.
fn matrix(upper: &[f64]) -> Matrix6<f64> {
    let mut matrix = Matrix6::zeros();
    let places = (0..6).flat_map(|row| (row..6).map(move |column| (row, column)));
    for ((row, column), &value) in places.zip(upper) {
        (matrix[(row, column)], matrix[(column, row)]) = (value, value);
    }
    matrix
}

/// Builds the map of a sequence and prints what came of it: with the errors of the trajectory before and
/// after, m.
#[allow(clippy::print_stdout, reason = "docs/benchmarking.md has these figures")]
async fn walked(
    server: &TestServer,
    name: &str,
    sequence: &Sequence,
    common: CommonView<'_>,
) -> (Outcome, f64, f64) {
    build(server, name, (sequence, &[]), Order::Streamed, recognizing()).await;
    let outcome = outcome(server, name, sequence, common).await;
    let state = state(server, name).await;
    let (before, after) =
        (ate(&sequence.poses(), &sequence.truth), ate(&state.poses, &sequence.truth));
    let Outcome { counting, worst, far, wrong, again, recalled, verdicts, curve } = &outcome;
    println!(
        "{name}: {again} see a place again, {recalled} of them joined; {counting} closures count, {far} \
         far off, {wrong} wrong, at most {:.3} m and {:.2} deg; {verdicts:?}; ATE {before:.4} m by \
         odometry, {after:.4} m\n{name}, precision,recall by score alone: {curve}",
        worst.0, worst.1
    );
    (outcome, before, after)
}

/// The share of the points of `b` that `a` sees.
fn common_points(made: &Made) -> impl Fn(usize, usize) -> f64 {
    let seen = |rows: &Vec<[f64; 6]>| -> BTreeSet<usize> {
        rows.iter().map(|row| made.point_of[&(row[0] as i64)]).collect()
    };
    let seen: Vec<BTreeSet<usize>> = made.sequence.observations.iter().map(seen).collect();
    move |a, b| seen[a].intersection(&seen[b]).count() as f64 / seen[b].len().max(1) as f64
}

/// Where motion capture has the camera at a time, s: between two of its poses.
fn captured(capture: &[(f64, Se3)], time: f64) -> Se3 {
    let after = capture.partition_point(|&(stamp, _)| stamp < time).clamp(1, capture.len() - 1);
    let ((from, a), (to, b)) = (capture[after - 1], capture[after]);
    let share = ((time - from) / (to - from)).clamp(0.0, 1.0);
    a.compose(&Se3::exp(&(a.inverse().compose(&b).log() * share)))
}

/// The truth by motion capture, whose clock is not the camera's: the turns of the odometry from one
/// keyframe to the next fit best where the stamps of the images are taken to be late by some 20 ms. The
/// closures have no part in that. Answers the offset, s.
fn clocked(sequence: &mut Sequence, capture: &[(f64, Se3)]) -> f64 {
    let misfit = |offset: f64| -> f64 {
        let turn = |pair: &[(f64, Se3)]| {
            let [(from, a), (to, b)] = pair else { unreachable!() };
            let truth =
                captured(capture, from + offset).inverse().compose(&captured(capture, to + offset));
            let error = a.inverse().compose(b).inverse().compose(&truth);
            error.rotation.log().norm_squared()
        };
        sequence.odometry.windows(2).map(turn).sum()
    };
    let offsets = (-12..=12).map(|step| 0.005 * f64::from(step));
    let best = offsets.min_by(|a, b| misfit(*a).total_cmp(&misfit(*b))).unwrap();
    for (truth, &(time, _)) in sequence.truth.iter_mut().zip(&sequence.odometry) {
        *truth = captured(capture, time + best);
    }
    best
}

#[test]
fn a_recorded_desk_closes_its_loops_itself() {
    let Some(mut sequence) = closure_verdicts::read() else { return };
    let Some(recording) = data("rgbd/tum_fr1_rpy") else { return };
    let capture = fs_err::read_to_string(recording.join("groundtruth.txt")).unwrap();
    let numbers = |line: &str| -> Vec<f64> {
        line.split_whitespace().map(|word| word.parse().unwrap()).collect()
    };
    let lines = capture.lines().filter(|line| !line.starts_with('#')).map(numbers);
    let capture: Vec<(f64, Se3)> = lines.map(|row| (row[0], pose(&row[1..]))).collect();
    let offset = clocked(&mut sequence, &capture);
    assert!((-0.03..=-0.01).contains(&offset), "{offset} s");
    run(async {
        let server = TestServer::lock_step().await;
        // By the depth of what was seen, and a camera without distortion.
        let common = |a: usize, b: usize| {
            let a_from_b = sequence.truth[a].inverse().compose(&sequence.truth[b]);
            let seen = sequence.observations[b].iter().filter(|row| row[3] > 0.0);
            let is_in_image = |&&[_, u, v, z, ..]: &&[f64; 6]| {
                let (x, y) = ((u - 318.6) / 517.3 * z, (v - 255.3) / 516.5 * z);
                let p = a_from_b.transform(&Vector3::new(x, y, z));
                let (u, v) = (517.3 * p.x / p.z + 318.6, 516.5 * p.y / p.z + 255.3);
                p.z > 0.1 && (0.0..640.0).contains(&u) && (0.0..480.0).contains(&v)
            };
            seen.clone().filter(is_in_image).count() as f64 / seen.count().max(1) as f64
        };
        let (outcome, before, after) = walked(&server, "desk", &sequence, &common).await;
        assert!(outcome.again > 50 && 10 * outcome.recalled >= 9 * outcome.again, "{outcome:?}");
        // One image of a fast turn: its rows are taken over 2°.
        assert!(outcome.far <= 1, "{outcome:?}");
        assert!(outcome.worst.0 < 0.12 && outcome.worst.1 < 6.0, "{outcome:?}");
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
            let made = course.make(1);
            let common = common_points(&made);
            let (outcome, ..) = walked(&server, name, &made.sequence, &common).await;
            assert_eq!(outcome.wrong, 0, "{name}: {outcome:?}");
            assert!(10 * outcome.recalled >= 9 * outcome.again, "{name}: {outcome:?}");
        }
    });
}

/// Around in the room whose middle is at x, m.
pub(crate) fn around(x: f64) -> impl Iterator<Item = [f64; 2]> {
    (0..=12).map(move |k| {
        let angle = f64::from(k) * std::f64::consts::FRAC_PI_6;
        [x + 1.2 * angle.cos(), 1.0 * angle.sin()]
    })
}

/// Around in a room, then through a door into one that looks exactly like it.
pub(crate) fn twins() -> Course {
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
        let made = twins().make(1);
        let common = common_points(&made);
        let (outcome, before, after) = walked(&server, "twins", &made.sequence, &common).await;
        assert_eq!(outcome.wrong, 0, "{outcome:?}");
        assert!(outcome.verdicts.contains_key("improbable"), "{outcome:?}");
        // A single false closure would bend it by meters; true ones carry the error of the calibration.
        assert!(after <= before + 0.02, "{after} of {before} m");
    });
}

#[test]
fn a_walk_of_300_m_around_a_block_is_closed() {
    let made = loop_fusion::walk(5);
    run(async {
        let server = TestServer::lock_step().await;
        let common = common_points(&made);
        let (outcome, before, after) = walked(&server, "block", &made.sequence, &common).await;
        assert_eq!((outcome.far, outcome.wrong), (0, 0), "{outcome:?}");
        assert!(10 * outcome.recalled >= 9 * outcome.again, "{outcome:?}");
        assert!(3.0 * after <= before, "{after} of {before} m");
    });
}
