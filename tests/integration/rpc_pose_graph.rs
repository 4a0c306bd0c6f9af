//! `SolvePoseGraph` with false closures, trusted ones, and a certificate of the chordal optimum.

use covis::wire::v1;
use v1::solve_pose_graph_request::Graph;

use crate::common::{TestServer, check_field, information3, run};

/// Vertices of a lap.
const LAP: usize = 12;

fn transform(x: f64, y: f64, angle_rad: f64) -> v1::RigidTransform2 {
    v1::RigidTransform2 { translation: Some(v1::Vector2 { x, y }), angle_rad }
}

fn edge(i: usize, j: usize, measured: v1::RigidTransform2) -> v1::PoseGraphEdgeSe2 {
    v1::PoseGraphEdgeSe2 {
        vertex_i: i as i64,
        vertex_j: j as i64,
        vertex_i_from_vertex_j: Some(measured),
        information: Some(information3(400.0)),
        ..Default::default()
    }
}

/// Three laps with a true closure to each vertex of the lap before, and a false one at the end.
fn laps() -> v1::PoseGraphSe2 {
    let turn = std::f64::consts::TAU / LAP as f64;
    let steps = (1..3 * LAP).map(|j| edge(j - 1, j, transform(1.0, 0.002, turn + 0.001)));
    let closures = (LAP..3 * LAP).map(|j| edge(j - LAP, j, transform(0.01, -0.01, 0.0)));
    let mut edges: Vec<_> = steps.chain(closures).collect();
    edges.push(edge(2, 18, transform(9.0, 5.0, 1.0)));
    let vertices =
        (0..3 * LAP).map(|id| v1::PoseGraphVertexSe2 { id: id as i64, ..Default::default() });
    v1::PoseGraphSe2 { vertices: vertices.collect(), edges }
}

fn request(graph: v1::PoseGraphSe2, kernel: v1::RobustKernel) -> v1::SolvePoseGraphRequest {
    v1::SolvePoseGraphRequest {
        graph: Some(Graph::Se2(graph)),
        robust: Some(v1::ClosureRobustness { kernel: kernel.into(), threshold: None }),
        ..Default::default()
    }
}

async fn solved(
    server: &TestServer,
    request: v1::SolvePoseGraphRequest,
) -> v1::SolvePoseGraphResponse {
    server.optimization().solve_pose_graph(request).await.unwrap().into_inner()
}

fn off(answer: &v1::SolvePoseGraphResponse) -> Vec<i32> {
    answer.switched_off_edges.iter().map(|edge| edge.edge_index).collect()
}

fn vertices(answer: &v1::SolvePoseGraphResponse) -> Vec<v1::Vector2> {
    let Some(v1::solve_pose_graph_response::Graph::Se2(graph)) = &answer.graph else {
        panic!("a graph in the plane");
    };
    graph.vertices.iter().map(|v| v.world_from_vertex.unwrap().translation.unwrap()).collect()
}

fn apart(a: &[v1::Vector2], b: &[v1::Vector2]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a.x - b.x).hypot(a.y - b.y)).fold(0.0, f64::max)
}

#[test]
fn false_closures_are_named_and_trusted_ones_are_not_judged() {
    run(async {
        let server = TestServer::start().await;
        let last = laps().edges.len() as i32 - 1;
        let mut clean = laps();
        clean.edges.pop();
        let clean = solved(&server, request(clean, v1::RobustKernel::None)).await;
        for kernel in [v1::RobustKernel::GncTls, v1::RobustKernel::GncGm] {
            let answer = solved(&server, request(laps(), kernel)).await;
            assert_eq!(off(&answer), [last], "{kernel:?}");
            let why = answer.switched_off_edges[0].switched_off.unwrap();
            assert!(why.chi2 > 1000.0 && why.weight < 0.01, "{why:?}");
            assert!(apart(&vertices(&answer), &vertices(&clean)) < 0.02);
            let summary = answer.summary.unwrap();
            let evaluated = summary.factor_costs[0].final_cost;
            assert!((evaluated / summary.final_cost - 1.0).abs() < 1e-9, "{summary:?}");
        }
        let plain = solved(&server, request(laps(), v1::RobustKernel::Unspecified)).await;
        assert!(off(&plain).is_empty());
        assert!(apart(&vertices(&plain), &vertices(&clean)) > 0.5);
        let mut trusted = laps();
        trusted.edges[last as usize].trusted = true;
        let answer = solved(&server, request(trusted, v1::RobustKernel::GncTls)).await;
        assert!(!off(&answer).contains(&last));

        let mut bad = request(laps(), v1::RobustKernel::GncTls);
        bad.robust.as_mut().unwrap().threshold = Some(0.0);
        let status = server.optimization().solve_pose_graph(bad).await.unwrap_err();
        check_field(&status, "robust.threshold", "OUT_OF_RANGE");
        let mut bad = request(laps(), v1::RobustKernel::GncTls);
        bad.robust.as_mut().unwrap().kernel = 17;
        let status = server.optimization().solve_pose_graph(bad).await.unwrap_err();
        check_field(&status, "robust.kernel", "UNKNOWN_VALUE");
    });
}

#[test]
fn the_chordal_optimum_of_what_is_kept_is_certified() {
    run(async {
        let server = TestServer::start().await;
        for kernel in [v1::RobustKernel::None, v1::RobustKernel::GncTls] {
            let mut graph = laps();
            if kernel == v1::RobustKernel::None {
                graph.edges.pop();
            }
            let without = solved(&server, request(graph.clone(), kernel)).await;
            assert!(without.chordal_certificate.is_none());
            let certify = v1::SolvePoseGraphRequest {
                certify: true,
                include_iterations: true,
                ..request(graph, kernel)
            };
            let answer = solved(&server, certify).await;
            let certificate = answer.chordal_certificate.unwrap();
            assert!(certificate.certified, "{certificate:?}");
            assert!(certificate.gap <= 1e-5 * certificate.cost, "{certificate:?}");
            assert_eq!(off(&answer), off(&without));
            assert!(apart(&vertices(&answer), &vertices(&without)) < 1e-4);
            // Its time counts.
            assert!(answer.iterations[0].elapsed_us >= certificate.duration_us);
        }
        let mut several = laps();
        for vertex in &mut several.vertices[..2] {
            vertex.world_from_vertex = Some(transform(0.0, 0.0, 0.0));
            vertex.fixed = true;
        }
        let request =
            v1::SolvePoseGraphRequest { certify: true, ..request(several, v1::RobustKernel::None) };
        let status = server.optimization().solve_pose_graph(request).await.unwrap_err();
        check_field(&status, "certify", "INCONSISTENT");
    });
}
