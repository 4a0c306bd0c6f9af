//! Every kind of solve on every kind of map: none is a bug, whatever the map lacks, and none poisons it.
//! Windows and first positions come with the items, places with the merges.

use covis::wire::v1;
use tonic::Code;
use v1::ingest_request::Item;
use v1::job_spec::Spec;

use crate::cli_support::golden;
use crate::common::{
    LANDMARKS, Stream, TestServer, camera, information3, keyframe, keyframe_position,
    relative_pose, run, shift, vector3,
};
use crate::job_support::Jobs;
use crate::metrics::Page;
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

/// A keyframe that sees one landmark.
fn seeing_one(id: i64) -> Item {
    let mut seeing = keyframe(id);
    seeing.observations.truncate(1);
    seeing.landmarks.truncate(1);
    Item::Keyframe(seeing)
}

/// The same with landmarks of which nobody knows where they are.
fn unplaced(mut items: Vec<Item>) -> Vec<Item> {
    for item in &mut items {
        if let Item::Keyframe(seeing) = item {
            seeing.landmarks.iter_mut().for_each(|landmark| landmark.point_in_world = None);
        }
    }
    items
}

/// Keyframes `ids` that see half of the landmarks, which no others see.
fn apart(ids: std::ops::Range<i64>, half: std::ops::Range<usize>) -> Vec<Item> {
    let see = |id: i64| {
        let mut seeing = keyframe(id);
        seeing.observations = seeing.observations[half.clone()].to_vec();
        seeing.landmarks = match id == ids.start {
            true => half.clone().map(|id| crate::common::landmark(id as i64)).collect(),
            false => Vec::new(),
        };
        Item::Keyframe(seeing)
    };
    ids.clone().map(see).collect()
}

/// The maps by name, each by what a client sends.
fn maps() -> Vec<(&'static str, Vec<Item>)> {
    let blind = |ids: std::ops::Range<i64>| ids.map(blind).collect::<Vec<Item>>();
    let chain = |ids: std::ops::Range<i64>| ids.map(|id| tied(id - 1, id)).collect::<Vec<Item>>();
    let landmarks = v1::LandmarkBatch { landmarks: (0..3).map(crate::common::landmark).collect() };
    let camera = || vec![Item::Camera(camera(0))];
    vec![
        ("empty", Vec::new()),
        ("camera-alone", camera()),
        ("one-blind-keyframe", blind(0..1)),
        ("blind-keyframes", blind(0..5)),
        ("landmarks-without-observers", vec![Item::Landmarks(landmarks)]),
        ("one-keyframe", seeing(0..1)),
        ("one-landmark", [camera(), (0..5).map(seeing_one).collect()].concat()),
        ("keyframes", seeing(0..5)),
        ("keyframes-and-constraints", [seeing(0..5), chain(1..5), vec![tied(0, 4)]].concat()),
        ("unplaced-landmarks", unplaced(seeing(0..5))),
        ("odometry", [blind(0..300), chain(1..300)].concat()),
        ("odometry-and-a-closure", [blind(0..300), chain(1..300), vec![tied(0, 299)]].concat()),
        ("two-pieces", [blind(0..9), chain(1..5), chain(6..9)].concat()),
        ("pieces-that-see", [camera(), apart(0..4, 0..30), apart(4..8, 30..60)].concat()),
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

/// The jobs on a map that solve something.
fn jobs_on(map_id: &str) -> Vec<Spec> {
    let mut specs: Vec<Spec> = solves(map_id).into_iter().take(4).map(Spec::OptimizeMap).collect();
    let map_id = map_id.to_owned();
    specs.push(Spec::Reconstruct(v1::ReconstructSpec {
        map_id: map_id.clone(),
        ..Default::default()
    }));
    // Retires what others see too.
    specs.push(Spec::CompactMap(v1::CompactMapSpec {
        map_id,
        redundant_share: Some(0.1),
        ..Default::default()
    }));
    specs
}

/// A server, its jobs, and whether it met bugs.
struct Fixture {
    server: TestServer,
    jobs: Jobs,
}

impl Fixture {
    async fn new() -> Self {
        let server = crate::metrics::start(|_config| {}).await;
        let jobs = Jobs::of(&server);
        Self { server, jobs }
    }

    /// No bug was caught, and the map takes changes.
    async fn check(&self, map_id: &str, what: &str) {
        let page = Page::of(&self.server.running).await;
        for place in ["engine", "solve", "rpc"] {
            let panics = page.get(&format!("covis_panics_total{{where=\"{place}\"}}"));
            assert_eq!(panics, 0.0, "{what}: a bug in {place}");
        }
        let get = v1::GetMapRequest { map_id: map_id.to_owned(), ..Default::default() };
        let map = self.server.maps().get_map(get).await.unwrap().into_inner().map.unwrap();
        assert_eq!(map.state(), v1::MapState::Open, "{what}");
    }

    /// Sends items, behind those that were sent, and waits for their solves.
    async fn send(&self, map_id: &str, items: Vec<Item>) -> Vec<v1::IngestAck> {
        let (stream, opened) = Stream::open(&self.server, map_id, "robot", 0).await;
        for (sequence, item) in (opened.next_sequence..).zip(items) {
            stream.send(sequence, item).await;
        }
        let acks = stream.finish().await.unwrap();
        self.check(map_id, &format!("the windows of {map_id}")).await;
        acks
    }

    /// Solves a map in every way, by calls and by jobs.
    async fn solve_all(&self, map_id: &str) {
        for request in solves(map_id) {
            let what = format!("{map_id}: {request:?}");
            match self.server.optimize_map(request).await {
                Ok((_, result)) => {
                    let summary = result.summary.unwrap();
                    let (before, after) = (summary.initial_cost, summary.final_cost);
                    assert!(after <= before * (1.0 + 1e-9) + 1e-9, "{what}: {before} to {after}");
                }
                Err(status) => assert!(is_reason(status.code() as i32), "{what}: {status:?}"),
            }
            self.check(map_id, &what).await;
        }
        for (k, spec) in jobs_on(map_id).into_iter().enumerate() {
            let (what, id) = (format!("{map_id}: {spec:?}"), format!("{map_id}-{k}"));
            self.jobs.create(&id, spec).await.unwrap();
            let job = self.jobs.end(&id).await;
            let failure = job.failure.as_ref().map(|failure| failure.code);
            assert!(failure.is_none_or(is_reason), "{what}: {job:?}");
            self.check(map_id, &what).await;
        }
    }

    /// Joins the map into another one.
    async fn merge(&self, map_id: &str) {
        let target = format!("{map_id}-target");
        self.server.create_map(&target).await;
        let (stream, _) = Stream::open(&self.server, &target, "host", 0).await;
        for (sequence, item) in (1..).zip(seeing(0..3)) {
            stream.send(sequence, item).await;
        }
        stream.finish().await.unwrap();
        // By places, which most of these maps do not show, then where it lies anyway.
        let by_places = crate::merge_support::merge(&target, map_id);
        let request = v1::MergeMapsRequest {
            target_from_source: Some(shift([0.0, 0.0, 1.0])),
            ..by_places.clone()
        };
        if let Err(status) = self.server.maps().merge_maps(by_places).await {
            assert!(is_reason(status.code() as i32), "{map_id}: {status:?}");
            self.check(map_id, &format!("{map_id} is aligned")).await;
            self.server.maps().merge_maps(request).await.unwrap();
        }
        self.check(&target, &format!("{map_id} is merged")).await;
        let whole = v1::OptimizeMapRequest { map_id: target.clone(), ..Default::default() };
        self.server.optimize_map(whole).await.unwrap();
        self.check(&target, &format!("{map_id} and its target are solved")).await;
    }
}

/// Whether an answer says that the map holds nothing that could be solved.
fn is_reason(code: i32) -> bool {
    [Code::FailedPrecondition, Code::InvalidArgument].contains(&Code::from(code))
}

/// The ids of the keyframes among items.
fn keyframes_of(items: &[Item]) -> Vec<i64> {
    let id = |item: &Item| if let Item::Keyframe(seen) = item { Some(seen.id) } else { None };
    items.iter().filter_map(id).collect()
}

#[test]
fn every_kind_of_solve_answers_on_every_kind_of_map() {
    run(async {
        let fixture = Fixture::new().await;
        for (name, items) in maps() {
            fixture.server.create_map(name).await;
            let keyframes = keyframes_of(&items);
            for ack in fixture.send(name, items).await {
                assert!(ack.violations.is_empty(), "{name}: {ack:?}");
            }
            fixture.solve_all(name).await;
            // The first holds the frame, and what is left may hold nothing.
            let ends = [keyframes.first(), keyframes.last()].into_iter().flatten();
            let remove = |&id: &i64| {
                let keyframe = Some(v1::KeyframeRef { id, ..Default::default() });
                Item::RemoveKeyframe(v1::RemoveKeyframe { keyframe })
            };
            fixture.send(name, ends.map(remove).collect()).await;
            fixture.merge(name).await;
        }
        // What a lidar frontend sends: poses and constraints, more than fit one dense block.
        let graph = fs_err::read(golden("twins/sphere-200.g2o")).unwrap();
        let files = [("graph.g2o".to_owned(), graph)];
        let header = header("sphere", v1::MapFormat::G2o);
        import(&fixture.server, header, &files).await.unwrap();
        fixture.solve_all("sphere").await;
    });
}

#[test]
fn every_kind_of_map_makes_room() {
    run(async {
        let fixture = Fixture::new().await;
        for (name, items) in maps() {
            for (k, when_full) in
                [v1::WhenFull::Marginalize, v1::WhenFull::Sparsify].into_iter().enumerate()
            {
                let map_id = format!("{name}-{k}");
                let limits = v1::MapLimits { max_keyframe_count: Some(4), ..Default::default() };
                let (limits, when_full) = (Some(limits), when_full.into());
                let policy = v1::MapPolicy { limits, when_full, ..Default::default() };
                fixture.server.create_map_with(&map_id, policy).await;
                // Constraints of keyframes that are gone are refused.
                fixture.send(&map_id, items.clone()).await;
                let whole = solves(&map_id).into_iter().step_by(2);
                for request in whole.take(2) {
                    let _none_left = fixture.server.optimize_map(request).await;
                    fixture.check(&map_id, &format!("what stays of {map_id}")).await;
                }
            }
        }
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
