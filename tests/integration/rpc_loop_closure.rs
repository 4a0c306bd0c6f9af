//! Loop closing with false closures: none bends the map, and readers are told which they are.

use covis::wire::v1;
use v1::ingest_request::Item;

use crate::common::{Stream, TestServer, check_field, check_status, information6, run, vector3};

/// Keyframes of a lap.
const LAP: i64 = 20;
/// The false closure.
const FALSE: i64 = 99;

/// Where keyframe `k` of two laps of a circle is; with `drift` m a keyframe, where odometry has it.
fn pose(k: i64, drift: f64) -> v1::RigidTransform {
    let turn = std::f64::consts::TAU / LAP as f64;
    let (angle, radius) = (k as f64 * turn, 1.0 / turn);
    let (x, y) = (radius * angle.sin(), radius * (1.0 - angle.cos()));
    v1::RigidTransform {
        translation: Some(vector3([x + drift * k as f64, y, 0.0])),
        rotation: Some(v1::Quaternion {
            x: 0.0,
            y: 0.0,
            z: (angle / 2.0).sin(),
            w: (angle / 2.0).cos(),
        }),
    }
}

/// A keyframe that sees nothing: its neighbors and its constraints place it.
fn keyframe(k: i64) -> Item {
    Item::Keyframe(v1::Keyframe {
        id: k,
        capture_time: Some(prost_types::Timestamp { seconds: 100 + k, nanos: 0 }),
        world_from_camera: Some(pose(k, 0.01)),
        ..Default::default()
    })
}

/// A closure between keyframes of the two laps that says `meters` ahead.
fn closure(id: i64, i: i64, j: i64, meters: f64, kind: v1::ConstraintKind) -> Item {
    let turn = std::f64::consts::TAU / LAP as f64 * (j - i - LAP) as f64;
    let measured = v1::RigidTransform {
        translation: Some(vector3([meters, 0.0, 0.0])),
        rotation: Some(v1::Quaternion {
            x: 0.0,
            y: 0.0,
            z: (turn / 2.0).sin(),
            w: (turn / 2.0).cos(),
        }),
    };
    let keyframe = |id| Some(v1::KeyframeRef { id, ..Default::default() });
    Item::RelativePose(v1::RelativePoseConstraint {
        id,
        keyframe_i: keyframe(i),
        keyframe_j: keyframe(j),
        keyframe_i_from_keyframe_j: Some(measured),
        information: Some(information6(1e4)),
        kind: kind.into(),
        ..Default::default()
    })
}

const LOOP: v1::ConstraintKind = v1::ConstraintKind::LoopClosure;

/// A map of two laps with `items` on top, each solved before the next is taken.
async fn build(
    server: &TestServer,
    map_id: &str,
    kernel: v1::RobustKernel,
    items: Vec<Item>,
) -> v1::Map {
    let robustness = v1::ClosureRobustness { kernel: kernel.into(), threshold: None };
    let policy = v1::MapPolicy { loop_closure_robustness: Some(robustness), ..Default::default() };
    server.create_map_with(map_id, policy).await;
    let (stream, _) = Stream::open(server, map_id, "robot", 0).await;
    let keyframes = (0..2 * LAP).map(keyframe);
    for (sequence, item) in (1..).zip(keyframes.chain(items)) {
        stream.send(sequence, item).await;
    }
    for ack in stream.finish().await.unwrap() {
        assert!(ack.violations.is_empty(), "{ack:?}");
    }
    let request = v1::GetMapRequest { map_id: map_id.to_owned(), ..Default::default() };
    server.maps().get_map(request).await.unwrap().into_inner().map.unwrap()
}

/// Ids and verdicts of the constraints of a delta.
fn verdicts(delta: &v1::MapDelta) -> Vec<(i64, Option<v1::SwitchedOff>)> {
    let relative = |c: &v1::Constraint| match &c.constraint {
        Some(v1::constraint::Constraint::RelativePose(c)) => Some((c.id, c.switched_off)),
        _ => None,
    };
    delta.constraints.iter().filter_map(relative).collect()
}

/// The largest distance between the keyframes of two maps, in meters.
fn apart(a: &v1::MapDelta, b: &v1::MapDelta) -> f64 {
    let at = |k: &v1::KeyframePose| k.world_from_camera.unwrap().translation.unwrap();
    let pairs = a.keyframes.iter().zip(&b.keyframes).map(|(a, b)| (at(a), at(b)));
    pairs.map(|(a, b)| (a.x - b.x).hypot(a.y - b.y).hypot(a.z - b.z)).fold(0.0, f64::max)
}

/// True closures around the first quarter of the lap, the false one in their midst.
fn closures(with_false: bool) -> Vec<Item> {
    let mut items: Vec<Item> = (0..5).map(|k| closure(k, k, k + LAP, 0.0, LOOP)).collect();
    if with_false {
        items.insert(2, closure(FALSE, 4, 12, 7.0, LOOP));
    }
    items
}

#[test]
fn a_false_closure_bends_nothing_and_is_reported() {
    run(async {
        let server = TestServer::lock_step().await;
        let off = v1::RobustKernel::None;
        for kernel in [v1::RobustKernel::Unspecified, v1::RobustKernel::GncGm] {
            let name = kernel.as_str_name().to_lowercase();
            let (clean, dirty) = (format!("clean-{name}"), format!("dirty-{name}"));
            let map = build(&server, &clean, kernel, closures(false)).await;
            assert_eq!(map.counts.unwrap().switched_off_constraint_count, 0);
            let robustness = map.policy.unwrap().loop_closure_robustness.unwrap();
            assert!((robustness.threshold.unwrap() - 16.8).abs() < 0.1);
            let map = build(&server, &dirty, kernel, closures(true)).await;
            let counts = map.counts.unwrap();
            assert_eq!((counts.constraint_count, counts.switched_off_constraint_count), (6, 1));
            let (clean, dirty) = (server.watched(&clean).await, server.watched(&dirty).await);
            assert!(apart(&clean, &dirty) < 0.05, "{kernel:?}: {}", apart(&clean, &dirty));
            for (id, verdict) in verdicts(&dirty) {
                assert_eq!(verdict.is_some(), id == FALSE, "{kernel:?}: {id}");
                if let Some(off) = verdict {
                    assert!(off.chi2 > 1000.0 && off.weight < 0.01, "{off:?}");
                }
            }
        }
        // Without robustness it is believed, and bends.
        build(&server, "clean", off, closures(false)).await;
        let map = build(&server, "dirty", off, closures(true)).await;
        assert_eq!(map.counts.unwrap().switched_off_constraint_count, 0);
        assert!(apart(&server.watched("clean").await, &server.watched("dirty").await) > 0.5);
    });
}

#[test]
fn watchers_hear_of_a_closure_that_goes_off_and_comes_back() {
    run(async {
        let server = TestServer::lock_step().await;
        let default = v1::RobustKernel::Unspecified;
        // Far more drift than odometry has: alone against it the closure is not believed.
        let first = vec![closure(FALSE, 4, 4 + LAP, 5.0, LOOP)];
        build(&server, "room", default, first).await;
        let begin = server.watched("room").await;
        let [(FALSE, Some(off))] = verdicts(&begin)[..] else { panic!("{:?}", begin.constraints) };
        assert!(off.chi2 > 1000.0, "{off:?}");
        let request = v1::WatchMapRequest {
            map_id: "room".to_owned(),
            from_revision: Some(begin.revision),
            ..Default::default()
        };
        let mut watch = server.maps().watch_map(request).await.unwrap().into_inner();
        // A measurement that is trusted says the same.
        let (stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        let other = v1::ConstraintKind::Other;
        stream.send(opened.next_sequence, closure(100, 4, 4 + LAP, 5.0, other)).await;
        stream.finish().await.unwrap();
        let (rows, result) = server.optimize_map(request_of("room", false)).await.unwrap();
        assert!(result.switched_off_constraints.is_empty(), "{result:?}");
        assert!(result.chordal_certificate.is_none());
        assert_eq!(rows.len() as i32, result.summary.unwrap().iteration_count + 1);
        let mut told = Vec::new();
        loop {
            let delta = watch.message().await.unwrap().unwrap().delta.unwrap();
            told.extend(verdicts(&delta));
            if delta.revision == result.revision {
                break;
            }
        }
        assert!(told.contains(&(FALSE, None)), "{told:?}");
    });
}

fn request_of(map_id: &str, certify: bool) -> v1::OptimizeMapRequest {
    v1::OptimizeMapRequest {
        map_id: map_id.to_owned(),
        problem: v1::MapProblem::PoseGraph.into(),
        certify,
        ..Default::default()
    }
}

#[test]
fn a_map_is_certified_on_request_and_says_what_is_off() {
    run(async {
        let server = TestServer::lock_step().await;
        build(&server, "room", v1::RobustKernel::Unspecified, closures(true)).await;
        let before = server.watched("room").await;
        let (_, result) = server.optimize_map(request_of("room", true)).await.unwrap();
        let certificate = result.chordal_certificate.unwrap();
        assert!(certificate.certified, "{certificate:?}");
        assert!(certificate.gap >= 0.0 && certificate.duration_us > 0);
        let off = &result.switched_off_constraints[..];
        assert_eq!(off.len(), 1);
        let name = off[0].constraint.clone().unwrap();
        assert_eq!((name.client_id.as_str(), name.id), ("robot", FALSE));
        assert!(off[0].switched_off.unwrap().chi2 > 1000.0);
        assert_eq!(result.keyframe_count, 2 * LAP);
        assert!(apart(&before, &server.watched("room").await) < 0.05);
        let summary = result.summary.unwrap();
        // The closure has optimized the map: both are at the optimum, to the tolerance of a solve.
        assert!(summary.final_cost <= summary.initial_cost * (1.0 + 1e-6), "{summary:?}");
        // A bundle is nothing to certify.
        let bad = v1::OptimizeMapRequest {
            problem: v1::MapProblem::Full.into(),
            ..request_of("room", true)
        };
        let answer = server.optimization().optimize_map(bad).await;
        let status = match answer {
            Err(status) => status,
            Ok(answer) => answer.into_inner().message().await.unwrap_err(),
        };
        check_field(&status, "certify", "INCONSISTENT");
    });
}

#[test]
fn a_map_in_pieces_has_no_certificate() {
    run(async {
        let server = TestServer::lock_step().await;
        server.create_map("room").await;
        for client in ["one", "two"] {
            let (stream, _) = Stream::open(&server, "room", client, 0).await;
            for k in 0..3 {
                stream.send(k + 1, keyframe(k)).await;
            }
            stream.finish().await.unwrap();
        }
        let mut answer = server
            .optimization()
            .optimize_map(request_of("room", true))
            .await
            .unwrap()
            .into_inner();
        let status = answer.message().await.unwrap_err();
        check_status(&status, tonic::Code::FailedPrecondition, "OUT_OF_RANGE");
        assert!(status.message().contains("several constant poses"), "{}", status.message());
    });
}
