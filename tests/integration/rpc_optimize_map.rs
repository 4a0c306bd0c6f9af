//! `OptimizeMap`: iterations as they come, one revision, and the ends that its comment lists.

use covis::wire::v1;
use tonic::{Code, Streaming};
use v1::ingest_request::Item;

use crate::common::{
    LANDMARKS, Stream, TestServer, camera, check_field, check_status, information3, keyframe,
    keyframe_position, landmark_position, occupy, run, vector3,
};

fn optimize(map_id: &str) -> v1::OptimizeMapRequest {
    v1::OptimizeMapRequest { map_id: map_id.to_owned(), ..Default::default() }
}

#[test]
fn optimize_map_streams_iterations_and_applies_the_result() {
    run(async {
        let server = TestServer::start().await;
        let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
        server.create_map_with("room", policy).await;
        server.build_map("room", 5).await;
        let request = v1::OptimizeMapRequest {
            observation_loss: Some(v1::Loss { kind: v1::LossKind::Trivial.into(), width: None }),
            ..optimize("room")
        };
        let (rows, result) = server.optimize_map(request).await.unwrap();
        let summary = result.summary.unwrap();
        assert_eq!(rows.len() as i32, summary.iteration_count + 1);
        assert_eq!((rows[0].iteration, rows[0].cost), (0, summary.initial_cost));
        assert!(summary.final_cost < 1e-3 * summary.initial_cost);
        assert_eq!((result.camera_count, result.keyframe_count), (1, 5));
        assert_eq!((result.landmark_count, result.observation_count), (LANDMARKS, 5 * LANDMARKS));
        let request = v1::GetMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let map = server.maps().get_map(request).await.unwrap().into_inner().map.unwrap();
        assert_eq!(map.revision, result.revision);
    });
}

#[test]
fn a_step_of_which_the_model_expects_nothing_has_a_quality_of_zero() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        server.build_map("room", 5).await;
        let request = v1::OptimizeMapRequest {
            options: Some(v1::SolverOptions {
                // The step is 0.
                initial_damping: Some(1e300),
                max_iteration_count: Some(30),
                function_tolerance: Some(0.0),
                gradient_tolerance: Some(0.0),
                parameter_tolerance: Some(0.0),
                ..Default::default()
            }),
            problem: v1::MapProblem::PoseGraph.into(),
            ..optimize("room")
        };
        let (rows, result) = server.optimize_map(request).await.unwrap();
        assert!(rows.len() > 1, "{result:?}");
        for row in rows {
            assert!(row.step_quality.is_finite(), "{row:?}");
        }
    });
}

#[test]
fn optimize_map_refuses_what_it_cannot_solve() {
    run(async {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let end = async |request| server.optimize_map(request).await.unwrap_err();
        check_status(&end(optimize("room")).await, Code::FailedPrecondition, "NOTHING_TO_SOLVE");
        check_status(&end(optimize("none")).await, Code::NotFound, "MAP_NOT_FOUND");
        check_field(&end(optimize("")).await, "map_id", "MISSING");
        let cases: [(v1::OptimizeMapRequest, &str, &str); 6] = [
            (
                v1::OptimizeMapRequest {
                    observation_loss: Some(v1::Loss {
                        kind: v1::LossKind::Huber.into(),
                        width: Some(2.0),
                    }),
                    problem: v1::MapProblem::PoseGraph.into(),
                    ..optimize("room")
                },
                "observation_loss",
                "INCONSISTENT",
            ),
            (
                v1::OptimizeMapRequest {
                    refine_intrinsics: true,
                    problem: v1::MapProblem::PoseGraph.into(),
                    ..optimize("room")
                },
                "refine_intrinsics",
                "INCONSISTENT",
            ),
            (v1::OptimizeMapRequest { problem: 9, ..optimize("room") }, "problem", "UNKNOWN_VALUE"),
            (v1::OptimizeMapRequest { gauge: 9, ..optimize("room") }, "gauge", "UNKNOWN_VALUE"),
            (
                v1::OptimizeMapRequest {
                    constraint_loss: Some(v1::Loss {
                        kind: v1::LossKind::Huber.into(),
                        width: Some(-1.0),
                    }),
                    ..optimize("room")
                },
                "constraint_loss.width",
                "OUT_OF_RANGE",
            ),
            (
                v1::OptimizeMapRequest {
                    options: Some(v1::SolverOptions {
                        max_iteration_count: Some(-1),
                        ..Default::default()
                    }),
                    ..optimize("room")
                },
                "options.max_iteration_count",
                "OUT_OF_RANGE",
            ),
        ];
        for (request, field, reason) in cases {
            check_field(&end(request).await, field, reason);
        }
    });
}

/// Asks for two optimizations of one map, of which one is refused; returns the other.
pub(crate) async fn one_of_two(
    server: &TestServer,
    map_id: &str,
) -> Streaming<v1::OptimizeMapResponse> {
    let mut client = server.optimization();
    let mut one = client.optimize_map(optimize(map_id)).await.unwrap().into_inner();
    let mut two = client.optimize_map(optimize(map_id)).await.unwrap().into_inner();
    let (refused, waiting) = tokio::select! {
        refused = one.message() => (refused, two),
        refused = two.message() => (refused, one),
    };
    check_status(&refused.unwrap_err(), Code::Aborted, "OPTIMIZATION_RUNNING");
    waiting
}

#[test]
fn a_second_optimization_of_a_map_is_aborted() {
    run(async {
        let server = TestServer::start().await;
        let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
        server.create_map_with("room", policy).await;
        server.build_map("room", 20).await;
        let busy = occupy(&server).await;
        let mut running = one_of_two(&server, "room").await;
        drop(busy);
        while running.message().await.unwrap().is_some() {}
        // Once it has ended another one may run.
        server.optimize_map(optimize("room")).await.unwrap();
    });
}

#[test]
fn deleting_a_map_ends_its_optimization_with_not_found() {
    run(async {
        let server = TestServer::start().await;
        let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
        server.create_map_with("room", policy).await;
        server.build_map("room", 3).await;
        // The pool is taken: one of two waits in the map, which the refusal of the other proves.
        let busy = occupy(&server).await;
        let mut waiting = one_of_two(&server, "room").await;
        let delete = v1::DeleteMapRequest { map_id: "room".to_owned() };
        server.maps().delete_map(delete).await.unwrap();
        check_status(&waiting.message().await.unwrap_err(), Code::NotFound, "MAP_NOT_FOUND");
        drop(busy);
    });
}

#[test]
fn a_bug_in_optimize_map_is_internal_and_costs_that_solve_only() {
    run(async {
        let server = TestServer::with_fault("panic-in-solve").await;
        let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
        server.create_map_with("room", policy).await;
        server.build_map("room", 2).await;
        let status = server.optimize_map(optimize("room")).await.unwrap_err();
        check_status(&status, Code::Internal, "BUG");
        let status = server.optimize_map(optimize("room")).await.unwrap_err();
        check_status(&status, Code::Internal, "BUG");
        // The map goes on.
        let (stream, opened) = Stream::open(&server, "room", "robot", 0).await;
        stream.send(opened.next_sequence, Item::Keyframe(keyframe(2))).await;
        assert!(stream.finish().await.unwrap().iter().all(|ack| ack.violations.is_empty()));
    });
}

#[test]
fn a_canceled_optimization_leaves_the_map_as_it_was() {
    run(async {
        let server = TestServer::start().await;
        let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
        server.create_map_with("room", policy).await;
        server.build_map("room", 5).await;
        let revision = async || {
            let request = v1::GetMapRequest { map_id: "room".to_owned(), ..Default::default() };
            server.maps().get_map(request).await.unwrap().into_inner().map.unwrap().revision
        };
        // The cancellation travels: it may come too late, but not every time.
        let mut stopped = false;
        for _ in 0..50 {
            let before = revision().await;
            let busy = occupy(&server).await;
            let stream = server.optimization().optimize_map(optimize("room")).await.unwrap();
            drop(stream);
            // An answer on the same connection comes behind the cancellation.
            revision().await;
            drop(busy);
            // The pool's queue is in order: once this runs, the optimization has.
            drop(occupy(&server).await);
            stopped |= revision().await == before;
        }
        assert!(stopped, "no optimization was stopped");
        let before = revision().await;
        let (mut stream, _) = Stream::open(&server, "room", "drone", 0).await;
        stream.put(1, Item::Camera(camera(0))).await;
        let after = revision().await;
        assert_eq!(after, before + 2, "opening and the camera, no solve");
    });
}

#[test]
fn a_camera_whose_focal_lengths_are_off_is_calibrated() {
    run(async {
        let server = TestServer::start().await;
        let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
        server.create_map_with("room", policy).await;
        let mut off = camera(0);
        let Some(v1::camera::Model::PinholeRadialTangential(model)) = &mut off.model else {
            panic!("{off:?}")
        };
        let (fx, fy) = (model.fx, model.fy);
        (model.fx, model.fy) = (1.03 * fx, 0.98 * fy);
        let (stream, _) = Stream::open(&server, "room", "robot", 0).await;
        stream.send(1, Item::Camera(off)).await;
        for id in 0..12 {
            // Depths and fixes tell how far the camera went and how far the points are.
            let mut item = keyframe(id);
            let [x, y, z] = keyframe_position(id);
            for seen in &mut item.observations {
                let landmark = seen.landmark.as_ref().unwrap().id;
                seen.depth_m = Some(landmark_position(landmark)[2] - z);
                seen.sigma_depth_m = Some(0.01);
            }
            stream.send(2 * id + 2, Item::Keyframe(item)).await;
            let fix = v1::PositionPrior {
                id,
                keyframe: Some(v1::KeyframeRef { id, ..Default::default() }),
                point_in_world: Some(vector3([x, y, z])),
                information: Some(information3(1e6)),
                ..Default::default()
            };
            stream.send(2 * id + 3, Item::PositionPrior(fix)).await;
        }
        for ack in stream.finish().await.unwrap() {
            assert!(ack.violations.is_empty(), "{ack:?}");
        }
        let request = v1::OptimizeMapRequest { refine_intrinsics: true, ..optimize("room") };
        let (_, result) = server.optimize_map(request).await.unwrap();
        assert_eq!(result.camera_count, 1);
        let delta = server.watched("room").await;
        let Some(v1::camera::Model::PinholeRadialTangential(found)) = delta.cameras[0].model else {
            panic!("{delta:?}")
        };
        assert!(
            (found.fx / fx - 1.0).abs() < 0.005 && (found.fy / fy - 1.0).abs() < 0.01,
            "{found:?}"
        );
    });
}
