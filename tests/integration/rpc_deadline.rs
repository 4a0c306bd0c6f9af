//! Deadlines of stateless solves: of the request, and of the call. Both end a solve with its best state, and the
//! answer says so.

use std::time::Duration;

use covis::wire::v1;
use tonic::Request;

use crate::common::{TestServer, bundle, occupy, run};
use crate::rpc_optimization::bundle_request;

#[test]
fn the_deadline_of_a_call_stops_its_solve_with_the_best_state() {
    run(async {
        let server = TestServer::start().await;
        // Its first linearization takes longer than the deadline.
        let long = v1::SolveBundleRequest {
            problem: Some(bundle(300)),
            include_iterations: true,
            ..bundle_request()
        };
        let solve = async |deadline_ms| {
            let options = Some(v1::SolverOptions { deadline_ms, ..Default::default() });
            let request = v1::SolveBundleRequest { options, ..long.clone() };
            server.optimization().solve_bundle(request).await.unwrap().into_inner()
        };
        let (cut, whole) = (solve(Some(1)).await, solve(None).await);
        let (stopped, done) = (cut.summary.unwrap(), whole.summary.unwrap());
        assert_eq!(stopped.termination(), v1::Termination::Deadline, "{stopped:?}");
        assert_ne!(done.termination(), v1::Termination::Deadline, "{done:?}");
        assert!(cut.iterations.len() < whole.iterations.len(), "{stopped:?}");
        assert_eq!(stopped.initial_cost, done.initial_cost);
        assert!(done.final_cost < stopped.final_cost, "{stopped:?}");
        let best = cut.iterations.iter().map(|row| row.cost).fold(f64::INFINITY, f64::min);
        assert_eq!(stopped.final_cost, best, "the best state so far");
        assert_eq!(cut.problem.unwrap().poses.len(), 300);

        // The call's deadline, grpc-timeout: it passes while the solve waits for a thread, and the answer
        // is the start.
        let busy = occupy(&server).await;
        let mut request = Request::new(bundle_request());
        request.set_timeout(Duration::from_secs(4));
        let answer = server.optimization().solve_bundle(request).await.unwrap().into_inner();
        let summary = answer.summary.unwrap();
        assert_eq!(summary.termination(), v1::Termination::Deadline, "{summary:?}");
        assert_eq!((summary.iteration_count, summary.final_cost), (0, summary.initial_cost));
        let start = bundle_request().problem.unwrap().poses;
        let positions = |poses: &[v1::BundlePose]| -> Vec<_> {
            poses.iter().map(|pose| pose.world_from_camera.unwrap().translation).collect()
        };
        assert_eq!(positions(&answer.problem.unwrap().poses), positions(&start));
        drop(busy);
        // A generous one is no obstacle.
        let mut request = Request::new(bundle_request());
        request.set_timeout(Duration::from_secs(60));
        let answer = server.optimization().solve_bundle(request).await.unwrap().into_inner();
        assert_ne!(answer.summary.unwrap().termination(), v1::Termination::Deadline);
    });
}
