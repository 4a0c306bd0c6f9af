//! The stateless solves of `OptimizationService`: one pose, bundles and pose graphs of the call.

use covis::service::engine::{AccountLimits, Resource};
use covis::wire::v1;
use prost::Message;
use tonic::Code;
use v1::solve_pose_graph_request::Graph;

use crate::common::{
    LANDMARKS, TestServer, bundle, camera, check_field, check_retry, check_status, information3,
    information6, keyframe_position, landmark_position, occupy, pixel, run, shift, vector3,
};

fn loss(kind: v1::LossKind, width: f64) -> Option<v1::Loss> {
    Some(v1::Loss { kind: kind.into(), width: Some(width) })
}

/// A pose of keyframe 2 to be refined over the true landmarks.
fn refine_request() -> v1::RefinePoseRequest {
    let [x, y, z] = keyframe_position(2);
    let observations = (0..LANDMARKS).map(|k| v1::PointObservation {
        point_in_world: Some(vector3(landmark_position(k))),
        pixel: Some(pixel(2, k)),
        ..Default::default()
    });
    v1::RefinePoseRequest {
        camera: Some(camera(0)),
        world_from_camera: Some(shift([x + 0.1, y - 0.05, z + 0.08])),
        observations: observations.collect(),
        include_information: true,
        ..Default::default()
    }
}

/// How far a refined pose is from keyframe 2, in meters.
fn error(pose: Option<v1::RigidTransform>) -> f64 {
    let t = pose.unwrap().translation.unwrap();
    let [x, y, z] = keyframe_position(2);
    (t.x - x).hypot(t.y - y).hypot(t.z - z)
}

#[test]
fn refine_pose_finds_the_pose_and_the_outlier() {
    run(async {
        let server = TestServer::start().await;
        let mut client = server.optimization();
        let mut request = refine_request();
        request.observations[4].pixel.as_mut().unwrap().x += 40.0;
        request.observations[5].depth_m = Some(landmark_position(5)[2] - keyframe_position(2)[2]);
        request.observations[5].sigma_depth_m = Some(0.01);
        request.loss = loss(v1::LossKind::Cauchy, 1.0);
        let answer = client.refine_pose(request).await.unwrap().into_inner();
        assert!(error(answer.world_from_camera) < 1e-3);
        let summary = answer.summary.unwrap();
        assert!(summary.final_cost < summary.initial_cost);
        assert_eq!(summary.linear_solver(), v1::LinearSolver::DenseCholesky);
        assert_eq!((summary.free_pose_count, summary.factor_costs.len()), (1, 2));
        let inliers = answer.observations.iter().filter(|o| o.inlier).count();
        assert_eq!(inliers as i64, LANDMARKS - 1);
        assert!(!answer.observations[4].inlier && answer.observations[4].squared_error > 100.0);
        assert_eq!(answer.information.unwrap().upper_triangle.len(), 21);

        // A strong prior holds the pose where it says.
        let mut request = refine_request();
        request.prior = Some(v1::RefinePosePrior {
            world_from_camera: Some(shift([5.0, 0.0, 0.0])),
            information: Some(information6(1e12)),
        });
        let answer = client.refine_pose(request).await.unwrap().into_inner();
        let t = answer.world_from_camera.unwrap().translation.unwrap();
        assert!((t.x - 5.0).abs() < 0.1, "{t:?}");
        assert_eq!(answer.summary.unwrap().gauge(), v1::Gauge::Priors);
    });
}

#[test]
fn errors_of_a_pose_out_of_range_are_numbers() {
    run(async {
        let mut request = refine_request();
        let pose = request.world_from_camera.as_mut().unwrap();
        pose.translation = Some(vector3([0.0, 1.797e308, 1.797e308]));
        let server = TestServer::start().await;
        let answer = server.optimization().refine_pose(request).await.unwrap().into_inner();
        let errors = answer.observations.iter().map(|o| o.squared_error);
        assert!(errors.clone().all(f64::is_finite), "{:?}", errors.collect::<Vec<_>>());
    });
}

#[test]
fn problems_that_wait_for_their_solve_have_a_ceiling_in_bytes() {
    run(async {
        let bytes = 12 * refine_request().encoded_len() as u64;
        let server = TestServer::with(|config| {
            config.tenant_limits =
                AccountLimits::default().with(Resource::WaitingSolveBytes, 2 * bytes - 1);
        })
        .await;
        let pool = server.running.solver_pool();
        let waiting = || pool.accounts().tenant("").held(Resource::WaitingSolveBytes);
        let occupied = occupy(&server).await;
        let mut client = server.optimization();
        let first = tokio::spawn(async move { client.refine_pose(refine_request()).await });
        while waiting() == 0 {
            tokio::task::yield_now().await;
        }
        assert_eq!(waiting(), bytes);
        let mut client = server.optimization();
        let status = client.refine_pose(refine_request()).await.unwrap_err();
        check_status(&status, Code::ResourceExhausted, "TENANT_LIMIT");
        assert!(status.message().contains("tenant_max_waiting_solve_bytes"), "{status}");
        check_retry(&status);
        drop(occupied);
        first.await.unwrap().unwrap();
        assert_eq!(waiting(), 0);
        client.refine_pose(refine_request()).await.unwrap();
    });
}

#[test]
fn refine_pose_refuses_bad_fields() {
    run(async {
        let server = TestServer::start().await;
        type Edit = fn(&mut v1::RefinePoseRequest);
        let cases: [(Edit, &str, &str); 9] = [
            (|r| r.observations.truncate(2), "observations", "WRONG_LENGTH"),
            (|r| r.camera = None, "camera", "MISSING"),
            (|r| r.world_from_camera = None, "world_from_camera", "MISSING"),
            (
                |r| r.observations[1].pixel.as_mut().unwrap().y = f64::NAN,
                "observations[1].pixel.y",
                "NOT_FINITE",
            ),
            (
                |r| r.observations[1].sigma_depth_m = Some(1.0),
                "observations[1].sigma_depth_m",
                "INCONSISTENT",
            ),
            (|r| r.loss = Some(v1::Loss { kind: 88, width: None }), "loss.kind", "UNKNOWN_VALUE"),
            (
                |r| {
                    r.options = Some(v1::SolverOptions {
                        linear_solver: v1::LinearSolver::DenseSchur.into(),
                        ..Default::default()
                    });
                },
                "options.linear_solver",
                "INCONSISTENT",
            ),
            (|r| r.include_covariance = true, "include_covariance", "UNIMPLEMENTED"),
            (
                |r| r.camera.as_mut().unwrap().rolling_shutter_readout_ms = 1.0,
                "camera.rolling_shutter_readout_ms",
                "UNIMPLEMENTED",
            ),
        ];
        for (edit, field, reason) in cases {
            let mut request = refine_request();
            edit(&mut request);
            let status = server.optimization().refine_pose(request).await.unwrap_err();
            check_field(&status, field, reason);
        }
    });
}

pub(crate) fn bundle_request() -> v1::SolveBundleRequest {
    v1::SolveBundleRequest {
        problem: Some(bundle(5)),
        include_iterations: true,
        ..Default::default()
    }
}

#[test]
fn solve_bundle_solves_with_either_linear_system() {
    run(async {
        let server = TestServer::start().await;
        let mut answers = Vec::new();
        for solver in [v1::LinearSolver::DenseSchur, v1::LinearSolver::SparseSchur] {
            let mut request = bundle_request();
            // Poses 0 and 1 are held where they start; let them start at the truth.
            for k in 0..2i64 {
                let pose = &mut request.problem.as_mut().unwrap().poses[k as usize];
                pose.world_from_camera = Some(shift(keyframe_position(k)));
            }
            let options = v1::SolverOptions { linear_solver: solver.into(), ..Default::default() };
            request.options = Some(options);
            let answer = server.optimization().solve_bundle(request).await.unwrap().into_inner();
            let summary = answer.summary.unwrap();
            assert_eq!(summary.linear_solver(), solver);
            assert_eq!(summary.gauge(), v1::Gauge::FixedPoses);
            assert!(summary.final_cost < 1e-9 * summary.initial_cost, "{summary:?}");
            assert_eq!((summary.free_pose_count, summary.fixed_pose_count), (3, 2));
            assert_eq!(summary.free_landmark_count, LANDMARKS);
            assert!(summary.reprojection.unwrap().final_rmse_px < 1e-3);
            let [pixels] = &summary.residuals[..] else { panic!("{:?}", summary.residuals) };
            assert_eq!(pixels.kind(), v1::ResidualKind::Pixel);
            assert_eq!(pixels.factor_count, summary.factor_costs[0].factor_count);
            assert_eq!(pixels.redundant_count, pixels.factor_count);
            assert!(pixels.final_rms < 1e-3 && pixels.initial_rms.unwrap() > 1.0);
            // Pixels without noise have a sigma that is far too large.
            assert_eq!(pixels.sigma_judgment(), v1::SigmaJudgment::TooLarge);
            assert!(pixels.hint.contains("the sigmas are too large"));
            assert!(summary.linear_residual < 1e-6);
            assert_eq!(answer.iterations.len() as i32, summary.iteration_count + 1);
            assert_eq!(answer.iterations[0].cost, summary.initial_cost);
            let problem = answer.problem.unwrap();
            assert!(problem.observations.is_empty());
            let t = problem.poses[3].world_from_camera.unwrap().translation.unwrap();
            let truth = keyframe_position(3);
            assert!((t.x - truth[0]).abs() < 1e-5 && (t.y - truth[1]).abs() < 1e-5);
            answers.push(summary.final_cost);
        }
        assert_eq!(answers.len(), 2);
    });
}

#[test]
fn options_of_a_solve_are_held() {
    run(async {
        let server = TestServer::start().await;
        let solve = async |options: v1::SolverOptions| {
            let request = v1::SolveBundleRequest { options: Some(options), ..bundle_request() };
            server.optimization().solve_bundle(request).await.map(|a| a.into_inner())
        };
        // 0 iterations evaluate only.
        let options = v1::SolverOptions { max_iteration_count: Some(0), ..Default::default() };
        let answer = solve(options).await.unwrap();
        let summary = answer.summary.unwrap();
        assert_eq!(summary.termination(), v1::Termination::MaxIterations);
        assert_eq!(summary.initial_cost, summary.final_cost);
        assert_eq!(answer.iterations.len(), 1);
        let options = v1::SolverOptions { max_iteration_count: Some(2), ..Default::default() };
        assert!(solve(options).await.unwrap().iterations.len() <= 3);
        type Edit = fn(&mut v1::SolverOptions);
        let cases: [(Edit, &str, &str); 8] = [
            (
                |o| o.max_iteration_count = Some(10_001),
                "options.max_iteration_count",
                "OUT_OF_RANGE",
            ),
            (|o| o.method = 9, "options.method", "UNKNOWN_VALUE"),
            (|o| o.linear_solver = 4, "options.linear_solver", "INCONSISTENT"),
            (|o| o.thread_count = -1, "options.thread_count", "OUT_OF_RANGE"),
            (|o| o.function_tolerance = Some(-1.0), "options.function_tolerance", "OUT_OF_RANGE"),
            (|o| o.gradient_tolerance = Some(f64::NAN), "options.gradient_tolerance", "NOT_FINITE"),
            (|o| o.deadline_ms = Some(0), "options.deadline_ms", "OUT_OF_RANGE"),
            (|o| o.initial_damping = Some(0.0), "options.initial_damping", "OUT_OF_RANGE"),
        ];
        for (edit, field, reason) in cases {
            let mut options = v1::SolverOptions::default();
            edit(&mut options);
            check_field(&solve(options).await.unwrap_err(), field, reason);
        }
    });
}

#[test]
fn solve_bundle_refuses_bad_problems() {
    run(async {
        let server = TestServer::start().await;
        type Edit = fn(&mut v1::BundleProblem);
        let cases: [(Edit, &str, &str); 9] = [
            (|p| p.cameras.clear(), "problem.cameras", "MISSING"),
            (|p| p.observations.clear(), "problem.observations", "MISSING"),
            (|p| p.poses[1].camera_index = 3, "problem.poses[1].camera_index", "UNKNOWN_REFERENCE"),
            (
                |p| p.observations[17].pose_index = -1,
                "problem.observations[17].pose_index",
                "UNKNOWN_REFERENCE",
            ),
            (
                |p| p.observations[17].point_index = 1000,
                "problem.observations[17].point_index",
                "UNKNOWN_REFERENCE",
            ),
            (
                |p| p.observations[17].pixel.as_mut().unwrap().y = f64::NAN,
                "problem.observations[17].pixel.y",
                "NOT_FINITE",
            ),
            (|p| p.points[2].point_in_world = None, "problem.points[2].point_in_world", "MISSING"),
            (
                |p| p.poses[0].world_from_camera.as_mut().unwrap().rotation = None,
                "problem.poses[0].world_from_camera.rotation",
                "MISSING",
            ),
            (
                |p| p.cameras[0].rolling_shutter_readout_ms = 5.0,
                "problem.cameras[0].rolling_shutter_readout_ms",
                "UNIMPLEMENTED",
            ),
        ];
        for (edit, field, reason) in cases {
            let mut request = bundle_request();
            edit(request.problem.as_mut().unwrap());
            let status = server.optimization().solve_bundle(request).await.unwrap_err();
            check_field(&status, field, reason);
        }
        let request = v1::SolveBundleRequest::default();
        let status = server.optimization().solve_bundle(request).await.unwrap_err();
        check_field(&status, "problem", "MISSING");
        let request =
            v1::SolveBundleRequest { gauge: v1::Gauge::Priors.into(), ..bundle_request() };
        let status = server.optimization().solve_bundle(request).await.unwrap_err();
        check_field(&status, "gauge", "INCONSISTENT");
    });
}

/// A square of four vertices with true edges and bad starts.
fn square() -> v1::PoseGraphSe3 {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let edge = |i: usize, j: usize| {
        let [a, b] = [corners[i], corners[j]];
        v1::PoseGraphEdgeSe3 {
            vertex_i: i as i64,
            vertex_j: j as i64,
            vertex_i_from_vertex_j: Some(shift([b[0] - a[0], b[1] - a[1], 0.0])),
            information: Some(information6(10.0)),
            ..Default::default()
        }
    };
    let vertex = |id: usize| v1::PoseGraphVertexSe3 {
        id: id as i64,
        world_from_vertex: Some(shift(corners[id].map(|x| 1.1 * x))),
        fixed: false,
    };
    v1::PoseGraphSe3 {
        vertices: (0..4).map(vertex).collect(),
        edges: vec![edge(0, 1), edge(1, 2), edge(2, 3), edge(3, 0)],
    }
}

fn graph_request(graph: v1::PoseGraphSe3) -> v1::SolvePoseGraphRequest {
    v1::SolvePoseGraphRequest { graph: Some(Graph::Se3(graph)), ..Default::default() }
}

#[test]
fn solve_pose_graph_starts_from_vertices_or_a_tree() {
    run(async {
        let server = TestServer::start().await;
        for bare in [false, true] {
            let mut graph = square();
            if bare {
                graph.vertices.iter_mut().for_each(|v| v.world_from_vertex = None);
            }
            let request =
                v1::SolvePoseGraphRequest { include_iterations: true, ..graph_request(graph) };
            let answer =
                server.optimization().solve_pose_graph(request).await.unwrap().into_inner();
            let summary = answer.summary.unwrap();
            assert!(summary.final_cost < 1e-12, "{summary:?}");
            assert_eq!(summary.linear_solver(), v1::LinearSolver::SparseCholesky);
            assert_eq!(summary.gauge(), v1::Gauge::FirstKeyframeFixed);
            assert_eq!((summary.free_pose_count, summary.fixed_pose_count), (3, 1));
            assert!(!answer.iterations.is_empty());
            let Some(v1::solve_pose_graph_response::Graph::Se3(graph)) = answer.graph else {
                panic!("a graph in space");
            };
            assert!(graph.edges.is_empty());
            let t = graph.vertices[2].world_from_vertex.unwrap().translation.unwrap();
            assert!((t.x - 1.0).abs() < 1e-6 && (t.y - 1.0).abs() < 1e-6, "{t:?}");
        }
        // In the plane, with Gauss-Newton.
        let vertex = |id, x| v1::PoseGraphVertexSe2 {
            id,
            world_from_vertex: Some(v1::RigidTransform2 {
                translation: Some(v1::Vector2 { x, y: 0.0 }),
                angle_rad: 0.0,
            }),
            fixed: id == 1,
        };
        let edge = v1::PoseGraphEdgeSe2 {
            vertex_i: 1,
            vertex_j: 2,
            vertex_i_from_vertex_j: Some(v1::RigidTransform2 {
                translation: Some(v1::Vector2 { x: 2.0, y: 0.0 }),
                angle_rad: 0.5,
            }),
            information: Some(information3(1.0)),
            ..Default::default()
        };
        let graph =
            v1::PoseGraphSe2 { vertices: vec![vertex(1, 0.0), vertex(2, 1.0)], edges: vec![edge] };
        let options = v1::SolverOptions {
            method: v1::SolverMethod::GaussNewton.into(),
            ..Default::default()
        };
        let request = v1::SolvePoseGraphRequest {
            graph: Some(Graph::Se2(graph)),
            options: Some(options),
            ..Default::default()
        };
        let answer = server.optimization().solve_pose_graph(request).await.unwrap().into_inner();
        assert_eq!(answer.summary.unwrap().method(), v1::SolverMethod::GaussNewton);
        let Some(v1::solve_pose_graph_response::Graph::Se2(graph)) = answer.graph else {
            panic!("a graph in the plane");
        };
        let solved = graph.vertices[1].world_from_vertex.unwrap();
        assert!((solved.angle_rad - 0.5).abs() < 1e-9);
        assert!((solved.translation.unwrap().x - 2.0).abs() < 1e-9);
    });
}

#[test]
fn solve_pose_graph_refuses_bad_graphs_and_names_pieces() {
    run(async {
        let server = TestServer::start().await;
        let solve = async |graph| {
            let request = graph_request(graph);
            server.optimization().solve_pose_graph(request).await.unwrap_err()
        };
        let mut pieces = square();
        pieces.edges = vec![pieces.edges[0].clone(), pieces.edges[2].clone()];
        let status = solve(pieces).await;
        check_field(&status, "se3", "DISCONNECTED");
        assert!(status.message().contains("from 0 to 1"), "{}", status.message());
        assert!(status.message().contains("from 2 to 3"), "{}", status.message());

        type Edit = fn(&mut v1::PoseGraphSe3);
        let cases: [(Edit, &str, &str); 6] = [
            (|g| g.vertices[3].id = 2, "se3.vertices[3].id", "DUPLICATE"),
            (|g| g.edges[1].vertex_j = 9, "se3.edges[1].vertex_j", "UNKNOWN_REFERENCE"),
            (|g| g.edges[1].vertex_j = 1, "se3.edges[1].vertex_j", "DUPLICATE"),
            (|g| g.edges[1].information = None, "se3.edges[1].information", "MISSING"),
            (
                |g| g.edges[0].information = Some(information6(0.0)),
                "se3.edges[0].information.upper_triangle",
                "NOT_POSITIVE_DEFINITE",
            ),
            (|g| g.edges.clear(), "se3.edges", "MISSING"),
        ];
        for (edit, field, reason) in cases {
            let mut graph = square();
            edit(&mut graph);
            check_field(&solve(graph).await, field, reason);
        }
        let request = v1::SolvePoseGraphRequest::default();
        let status = server.optimization().solve_pose_graph(request).await.unwrap_err();
        check_field(&status, "graph", "MISSING");
        // A loss of one edge alone.
        let mut graph = square();
        graph.edges[1].loss = loss(v1::LossKind::Huber, 1.0);
        graph.edges[1].loss.as_mut().unwrap().width = Some(0.0);
        check_field(&solve(graph.clone()).await, "se3.edges[1].loss.width", "OUT_OF_RANGE");
        graph.edges[1].loss = loss(v1::LossKind::Huber, 1.0);
        let same = v1::SolvePoseGraphRequest {
            loss: loss(v1::LossKind::Huber, 1.0),
            ..graph_request(graph)
        };
        server.optimization().solve_pose_graph(same).await.unwrap();
        let mut graph = square();
        graph.vertices[1].world_from_vertex = None;
        let request = v1::SolvePoseGraphRequest {
            start: v1::PoseGraphStart::Vertices.into(),
            ..graph_request(graph)
        };
        let status = server.optimization().solve_pose_graph(request).await.unwrap_err();
        check_field(&status, "se3.vertices[1].world_from_vertex", "MISSING");
    });
}

#[test]
fn a_panic_in_a_stateless_solve_is_internal_and_the_server_lives() {
    run(async {
        let server = TestServer::with_fault("panic-in-solve").await;
        let mut client = server.optimization();
        let statuses = [
            client.refine_pose(refine_request()).await.unwrap_err(),
            client.solve_bundle(bundle_request()).await.unwrap_err(),
            client.solve_pose_graph(graph_request(square())).await.unwrap_err(),
        ];
        for status in statuses {
            check_status(&status, Code::Internal, "BUG");
        }
        server.create_map("room").await;
    });
}
