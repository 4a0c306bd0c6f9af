//! The first keyframe of a map over the wire: it stays where it was put while a robot walks a loop again
//! and again and landmarks of its visits are united, and answers say what was held.

use covis::wire::v1;
use covis_solvers::geometry::Se3;

use crate::common::{Stream, TestServer, run};
use crate::made_sequence::Course;
use crate::made_verdicts::room;
use crate::merge_support::poses;
use crate::sequence::{Order, ate, items, without_recognition};

/// Of the points of the room and of the noise.
const SEED: u64 = 3;

/// Root mean square of the positions' errors as they are.
fn error_as_it_is(poses: &[Se3], truth: &[Se3]) -> f64 {
    let squares =
        poses.iter().zip(truth).map(|(a, b)| (a.translation - b.translation).norm_squared());
    (squares.sum::<f64>() / poses.len() as f64).sqrt()
}

/// The numbers of a transform, by their bits.
fn bits(transform: &v1::RigidTransform) -> [u64; 7] {
    let (t, q) = (transform.translation.as_ref().unwrap(), transform.rotation.as_ref().unwrap());
    [t.x, t.y, t.z, q.x, q.y, q.z, q.w].map(f64::to_bits)
}

/// Every pose of keyframe 0 that a watcher is told, until the map is deleted.
async fn told_of_the_first(mut watch: tonic::Streaming<v1::WatchMapResponse>) -> Vec<[u64; 7]> {
    let mut told = Vec::new();
    while let Ok(Some(message)) = watch.message().await {
        for changed in message.delta.unwrap().keyframes {
            if changed.keyframe.unwrap().id == 0 {
                told.push(bits(changed.world_from_camera.as_ref().unwrap()));
            }
        }
    }
    told
}

/// The map as a new watcher gets it.
async fn read(server: &TestServer) -> (Vec<v1::KeyframePose>, Vec<v1::Landmark>) {
    let request = v1::WatchMapRequest { map_id: "room".to_owned(), ..Default::default() };
    let mut watch = server.maps().watch_map(request).await.unwrap().into_inner();
    let (mut keyframes, mut landmarks) = (Vec::new(), Vec::new());
    loop {
        let delta = watch.message().await.unwrap().unwrap().delta.unwrap();
        keyframes.extend(delta.keyframes);
        landmarks.extend(delta.landmarks);
        if delta.last_part {
            return (keyframes, landmarks);
        }
    }
}

async fn first(server: &TestServer) -> [u64; 7] {
    let (keyframes, _) = read(server).await;
    let is_first = |keyframe: &&v1::KeyframePose| keyframe.keyframe.as_ref().unwrap().id == 0;
    bits(keyframes.iter().find(is_first).unwrap().world_from_camera.as_ref().unwrap())
}

async fn optimized(
    server: &TestServer,
    problem: v1::MapProblem,
    gauge: v1::Gauge,
) -> (v1::Gauge, [u64; 7]) {
    let request = v1::OptimizeMapRequest {
        map_id: "room".to_owned(),
        problem: problem.into(),
        gauge: gauge.into(),
        ..Default::default()
    };
    let (_, result) = server.optimize_map(request).await.unwrap();
    (result.summary.unwrap().gauge(), first(server).await)
}

#[test]
#[allow(clippy::print_stdout, reason = "a test shows what it measured")]
fn a_robot_that_walks_a_loop_again_and_again_leaves_the_first_keyframe_where_it_was_put() {
    let course = Course { closure_step: 10, calibration_error: 0.0, ..room() };
    let walk = course.make(SEED).sequence;
    run(async {
        let server = TestServer::lock_step().await;
        let policy = without_recognition(v1::MapPolicy::default());
        server.create_map_with("room", policy).await;
        let request = v1::WatchMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let watch = server.maps().watch_map(request).await.unwrap().into_inner();
        let watcher = tokio::spawn(told_of_the_first(watch));
        let (stream, _) = Stream::open(&server, "room", "robot", 0).await;
        for (sequence, item) in (1..).zip(items(&walk, &walk.closures, Order::Streamed)) {
            stream.send(sequence, item).await;
        }
        let acks = stream.finish().await.unwrap();
        let gauges = acks.iter().filter_map(|ack| Some(ack.solve_summary.as_ref()?.gauge()));
        let gauges: Vec<v1::Gauge> = gauges.collect();
        for gauge in [v1::Gauge::FixedPoses, v1::Gauge::FirstKeyframeFixed] {
            assert!(gauges.contains(&gauge), "windows or pose graphs under {gauge:?}");
        }
        assert!(!gauges.contains(&v1::Gauge::Free));

        let (_, landmarks) = read(&server).await;
        let united = landmarks.iter().filter(|landmark| landmark.duplicate_of.is_some()).count();
        let solved: Vec<Se3> = poses(&server, "room").await.into_values().collect();
        let (aligned, as_it_is) = (ate(&solved, &walk.truth), error_as_it_is(&solved, &walk.truth));
        println!(
            "{} keyframes, {} closures, {united} of {} landmarks united; error {aligned:.4} m aligned, \
             {as_it_is:.4} m as it is",
            solved.len(),
            walk.closures.len(),
            landmarks.len()
        );
        assert!(united > 100, "{united}");
        assert!(as_it_is < 0.02, "{as_it_is} m, {aligned} m aligned");

        let put = first(&server).await;
        for problem in [v1::MapProblem::Full, v1::MapProblem::PoseGraph] {
            for gauge in [v1::Gauge::Unspecified, v1::Gauge::FirstKeyframeFixed] {
                let (used, pose) = optimized(&server, problem, gauge).await;
                assert_eq!(used, v1::Gauge::FirstKeyframeFixed, "{problem:?}");
                assert_eq!(pose, put, "{problem:?}, {gauge:?}");
            }
        }
        let (used, _) = optimized(&server, v1::MapProblem::Full, v1::Gauge::FixedPoses).await;
        assert_eq!(used, v1::Gauge::FixedPoses);
        // Whoever asks for no gauge gets none.
        let (used, _) = optimized(&server, v1::MapProblem::Full, v1::Gauge::Priors).await;
        assert_eq!(used, v1::Gauge::Free);

        let request = v1::DeleteMapRequest { map_id: "room".to_owned() };
        server.maps().delete_map(request).await.unwrap();
        let told = watcher.await.unwrap();
        // The last solve alone held nothing.
        let before: Vec<_> = told.iter().filter(|&&pose| pose != put).collect();
        assert!(told.contains(&put) && before.len() <= 1, "{} poses were told", told.len());
    });
}
