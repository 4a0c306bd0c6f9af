//! Solves that cost far more than their bytes.
//!
//! Each is a legal request whose linear system is large: its price must be known before it is solved.

use std::time::{Duration, Instant};

use covis::wire::v1;
use tonic::Request;
use tonic::transport::Channel;
use v1::optimization_service_client::OptimizationServiceClient;

use crate::Target;
use crate::maps::bearing;
use crate::street::{camera, scatter};

/// Poses of the dense solve: 24,000 unknowns are a matrix of 4.6 GB.
const DENSE_POSES: i32 = 4000;
/// Vertices and edges of the graph that fills up.
const FILL: (i64, i64) = (4000, 12_000);

async fn service(target: &Target) -> Option<OptimizationServiceClient<Channel>> {
    let channel = crate::maps::channel(target).await?;
    Some(OptimizationServiceClient::new(channel).max_decoding_message_size(64 << 20))
}

fn pose(x: f64) -> v1::RigidTransform {
    v1::RigidTransform {
        translation: Some(v1::Vector3 { x, ..Default::default() }),
        rotation: Some(v1::Quaternion { w: 1.0, ..Default::default() }),
    }
}

/// SolveBundle with DENSE_SCHUR: two observations a pose.
pub(crate) async fn dense(target: Target) {
    let points = [[0.0, 0.0], [1.0, 0.5], [-1.0, 0.5], [0.5, -1.0]];
    let point = |[x, y]: [f64; 2]| v1::BundlePoint {
        point_in_world: Some(v1::Vector3 { x, y, z: 8.0 }),
        fixed: false,
    };
    let observation = |pose_index: i32, point_index: i32| {
        let [x, y] = points[point_index as usize];
        let seed = i64::from(pose_index * 8 + point_index);
        let pixel = v1::Vector2 {
            x: 320.0 + 500.0 * x / 8.0 + scatter(seed, 1),
            y: 240.0 + 500.0 * y / 8.0 + scatter(seed, 2),
        };
        let pixel = Some(pixel);
        v1::BundleObservation { pose_index, point_index, pixel, ..Default::default() }
    };
    let problem = v1::BundleProblem {
        cameras: vec![camera()],
        poses: (0..DENSE_POSES)
            .map(|k| v1::BundlePose {
                camera_index: 0,
                world_from_camera: Some(pose(0.0)),
                fixed: k < 2,
            })
            .collect(),
        points: points.map(point).to_vec(),
        observations: (0..DENSE_POSES)
            .flat_map(|k| [observation(k, k % 4), observation(k, (k + 1) % 4)])
            .collect(),
    };
    let options = v1::SolverOptions {
        linear_solver: v1::LinearSolver::DenseSchur.into(),
        ..Default::default()
    };
    let request = v1::SolveBundleRequest {
        problem: Some(problem),
        options: Some(options),
        gauge: v1::Gauge::FixedPoses.into(),
        ..Default::default()
    };
    loop {
        let Some(mut service) = service(&target).await else { return };
        let mut request: Request<_> = bearing("foe", request.clone());
        request.set_timeout(Duration::from_millis(500));
        let begin = Instant::now();
        let answer = service.solve_bundle(request).await;
        let late = begin.elapsed() > Duration::from_millis(600);
        if !target.tally.count(&answer) || late {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }
}

/// SolvePoseGraph over a graph whose edges join anything with anything.
pub(crate) async fn fill(target: Target) {
    let (vertices, edges) = FILL;
    let place = |k: i64| pose(k as f64);
    let information = (0..6)
        .flat_map(|row| (row..6).map(move |column| if row == column { 100.0 } else { 0.0 }))
        .collect::<Vec<f64>>();
    let edge = |i: i64, j: i64| v1::PoseGraphEdgeSe3 {
        vertex_i: i,
        vertex_j: j,
        vertex_i_from_vertex_j: Some(pose((j - i) as f64 + 0.01 * scatter(i * 7 + j, 3))),
        information: Some(v1::InformationMatrix6 { upper_triangle: information.clone() }),
        ..Default::default()
    };
    let any = |k: i64, axis| ((scatter(k, axis) + 1.0) * 0.5 * (vertices - 1) as f64) as i64;
    let random = (0..edges).map(|k| (any(k, 5), any(k, 6))).filter(|(i, j)| i != j);
    let graph = v1::PoseGraphSe3 {
        vertices: (0..vertices)
            .map(|id| v1::PoseGraphVertexSe3 {
                id,
                world_from_vertex: Some(place(id)),
                fixed: id == 0,
            })
            .collect(),
        edges: (1..vertices).map(|j| (j - 1, j)).chain(random).map(|(i, j)| edge(i, j)).collect(),
    };
    let request = v1::SolvePoseGraphRequest {
        graph: Some(v1::solve_pose_graph_request::Graph::Se3(graph)),
        ..Default::default()
    };
    loop {
        let Some(mut service) = service(&target).await else { return };
        let mut request: Request<_> = bearing("foe", request.clone());
        request.set_timeout(Duration::from_millis(500));
        let answer = service.solve_pose_graph(request).await;
        if !target.tally.count(&answer) {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }
}

/// OptimizeMap of the large map.
pub(crate) async fn whole_map(target: Target) {
    loop {
        let Some(mut service) = service(&target).await else { return };
        let request = v1::OptimizeMapRequest { map_id: "large".to_owned(), ..Default::default() };
        let answer = service.optimize_map(bearing("foe", request)).await;
        let is_taken = target.tally.count(&answer);
        if let Ok(answer) = answer {
            let mut parts = answer.into_inner();
            while let Ok(Some(_)) = parts.message().await {}
        }
        if !is_taken {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }
}
