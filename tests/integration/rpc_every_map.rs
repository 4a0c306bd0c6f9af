//! Every kind of solve on every kind of map: none is a bug, whatever the map lacks, and none poisons it.

use covis::wire::v1;
use tonic::Code;
use v1::ingest_request::Item;
use v1::job_spec::Spec;

use crate::cli_support::golden;
use crate::common::{
    LANDMARKS, Stream, TestServer, camera, information3, keyframe, keyframe_position,
    relative_pose, run, vector3,
};
use crate::job_support::Jobs;
use crate::rpc_import::{header, import};

/// A keyframe that sees nothing.
fn blind(id: i64) -> Item {
    Item::Keyframe(v1::Keyframe {
        observations: Vec::new(),
        landmarks: Vec::new(),
        sensor: None,
        ..keyframe(id)
    })
}

fn tied(i: i64, j: i64) -> Item {
    Item::RelativePose(relative_pose(1000 * i + j, i, j))
}

fn prior(keyframe: i64) -> Item {
    Item::PositionPrior(v1::PositionPrior {
        id: 9000 + keyframe,
        keyframe: Some(v1::KeyframeRef { id: keyframe, ..Default::default() }),
        point_in_world: Some(vector3(keyframe_position(keyframe))),
        information: Some(information3(100.0)),
        ..Default::default()
    })
}

/// Keyframes that see all landmarks, `ids` of them; the first one brings them along.
fn seeing(ids: std::ops::Range<i64>) -> Vec<Item> {
    let first = ids.start;
    let bring = |id: i64| {
        let mut seeing = keyframe(id);
        if id == first {
            seeing.landmarks = (0..LANDMARKS).map(crate::common::landmark).collect();
        }
        Item::Keyframe(seeing)
    };
    std::iter::once(Item::Camera(camera(0))).chain(ids.map(bring)).collect()
}

/// The maps by name, each by what a client sends.
fn maps() -> Vec<(&'static str, Vec<Item>)> {
    let blind = |ids: std::ops::Range<i64>| ids.map(blind).collect::<Vec<Item>>();
    let chain = |ids: std::ops::Range<i64>| ids.map(|id| tied(id - 1, id)).collect::<Vec<Item>>();
    let landmarks = v1::LandmarkBatch { landmarks: (0..3).map(crate::common::landmark).collect() };
    vec![
        ("empty", Vec::new()),
        ("camera-alone", vec![Item::Camera(camera(0))]),
        ("one-blind-keyframe", blind(0..1)),
        ("blind-keyframes", blind(0..5)),
        ("landmarks-without-observers", vec![Item::Landmarks(landmarks)]),
        ("one-keyframe", seeing(0..1)),
        ("keyframes", seeing(0..5)),
        ("odometry", [blind(0..300), chain(1..300)].concat()),
        ("odometry-and-a-closure", [blind(0..300), chain(1..300), vec![tied(0, 299)]].concat()),
        ("two-pieces", [blind(0..9), chain(1..5), chain(6..9)].concat()),
        ("a-piece-that-sees", [seeing(0..5), blind(5..9), chain(6..9)].concat()),
        ("priors-alone", [blind(0..5), (0..5).map(prior).collect()].concat()),
        ("one-prior", [seeing(0..2), vec![prior(1)]].concat()),
    ]
}

/// Every solve of a whole map that can be asked for.
fn solves(map_id: &str) -> Vec<v1::OptimizeMapRequest> {
    let gauges = [v1::Gauge::FirstKeyframeFixed, v1::Gauge::Free, v1::Gauge::Priors];
    let mut solves = Vec::new();
    for gauge in gauges {
        let base = v1::OptimizeMapRequest {
            map_id: map_id.to_owned(),
            gauge: gauge.into(),
            ..Default::default()
        };
        let graph = v1::MapProblem::PoseGraph.into();
        solves.push(base.clone());
        solves.push(v1::OptimizeMapRequest { refine_intrinsics: true, ..base.clone() });
        solves.push(v1::OptimizeMapRequest { problem: graph, ..base.clone() });
        solves.push(v1::OptimizeMapRequest { problem: graph, certify: true, ..base });
    }
    solves
}

/// Solves a map in every way, by calls and by jobs.
async fn solve_all(server: &TestServer, jobs: &Jobs, map_id: &str) {
    for (k, request) in solves(map_id).into_iter().enumerate() {
        let what = format!("{map_id}: {request:?}");
        match server.optimize_map(request.clone()).await {
            Ok((_, result)) => {
                let summary = result.summary.unwrap();
                let (before, after) = (summary.initial_cost, summary.final_cost);
                assert!(after <= before * (1.0 + 1e-9) + 1e-9, "{what}: {before} to {after}");
            }
            Err(status) => {
                let is_reason = [Code::FailedPrecondition, Code::InvalidArgument];
                assert!(is_reason.contains(&status.code()), "{what}: {status:?}");
            }
        }
        if k < 4 {
            let id = format!("{map_id}-{k}");
            jobs.create(&id, Spec::OptimizeMap(request)).await.unwrap();
            let job = jobs.end(&id).await;
            let code = job.failure.as_ref().map_or(0, |failure| failure.code);
            assert!(
                ![Code::Internal as i32, Code::Unknown as i32].contains(&code),
                "{what}: {job:?}"
            );
        }
        let get = v1::GetMapRequest { map_id: map_id.to_owned(), ..Default::default() };
        let map = server.maps().get_map(get).await.unwrap().into_inner().map.unwrap();
        assert_eq!(map.state(), v1::MapState::Open, "{what}");
    }
}

#[test]
fn every_kind_of_solve_answers_on_every_kind_of_map() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        for (name, items) in maps() {
            server.create_map(name).await;
            let (stream, _) = Stream::open(&server, name, "robot", 0).await;
            for (sequence, item) in (1..).zip(items) {
                stream.send(sequence, item).await;
            }
            for ack in stream.finish().await.unwrap() {
                assert!(ack.violations.is_empty(), "{name}: {ack:?}");
            }
            solve_all(&server, &jobs, name).await;
        }
        // What a lidar frontend sends: poses and constraints, more than fit one dense block.
        let graph = fs_err::read(golden("twins/sphere-200.g2o")).unwrap();
        let files = [("graph.g2o".to_owned(), graph)];
        import(&server, header("sphere", v1::MapFormat::G2o), &files).await.unwrap();
        solve_all(&server, &jobs, "sphere").await;
    });
}

#[test]
fn a_job_tells_the_cost_of_the_map_that_was() {
    run(async {
        let server = TestServer::start().await;
        let jobs = Jobs::of(&server);
        let graph = fs_err::read(golden("twins/sphere-200.g2o")).unwrap();
        let files = [("graph.g2o".to_owned(), graph)];
        import(&server, header("sphere", v1::MapFormat::G2o), &files).await.unwrap();
        let request = v1::OptimizeMapRequest {
            map_id: "sphere".to_owned(),
            problem: v1::MapProblem::PoseGraph.into(),
            ..Default::default()
        };
        let mut costs = Vec::new();
        for id in ["first", "second"] {
            jobs.create(id, Spec::OptimizeMap(request.clone())).await.unwrap();
            let job = jobs.success(id).await;
            costs.push((job.cost_before.unwrap(), job.cost_after.unwrap()));
        }
        let [(before, after), (again, _)] = costs[..] else { panic!("{costs:?}") };
        assert!(before > 10.0 * after, "{costs:?}");
        assert!((again / after - 1.0).abs() < 1e-6, "{costs:?}");
    });
}
