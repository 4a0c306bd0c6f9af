//! Valid requests of every method, on maps, jobs and uploads that a run has made: what is changed in them
//! then reaches what a random message never would.

use covis::wire::v1;
use prost::Message;
use v1::ingest_request::Item;
use v1::job_spec::Spec;

use super::draw::Draw;
use crate::common::{
    bundle, camera, diagonal, information3, information6, keyframe, open_item, pixel,
    relative_pose, shift, vector3,
};
use crate::job_support::{twin, upload};

/// Maps that a run makes.
pub(super) const MAPS: [&str; 5] = ["m0", "m1", "m2", "m3", "m4"];
/// Keyframes of a map that is made anew.
const KEYFRAMES: i64 = 4;

/// What the calls so far may have made.
#[derive(Default)]
pub(super) struct World {
    /// Numbers of items, ids of what is added, and names of jobs: each is used once.
    next: i64,
    pub(super) uploads: Vec<String>,
    jobs: i64,
}

impl World {
    fn number(&mut self) -> i64 {
        self.next += 1;
        self.next
    }
}

/// The client that has keyframes 0 to 3 of a map, once the map has any.
fn robot(map: &str) -> String {
    format!("robot-{map}")
}

/// A valid request, or the stream of requests, of the method with this name.
pub(super) fn requests(method: &str, world: &mut World, draw: &mut Draw) -> Vec<Vec<u8>> {
    let map_id = draw.one(&MAPS).to_owned();
    let one = |request: &dyn Fn() -> Vec<u8>| vec![request()];
    match method {
        "CreateMap" => {
            let policy = Some(policy(draw));
            vec![v1::CreateMapRequest { map_id, policy, ..Default::default() }.encode_to_vec()]
        }
        "GetMap" => one(&|| {
            v1::GetMapRequest { map_id: map_id.clone(), include_digests: true }.encode_to_vec()
        }),
        "UpdateMap" => vec![update(map_id, draw).encode_to_vec()],
        "DeleteMap" => vec![v1::DeleteMapRequest { map_id }.encode_to_vec()],
        "CopyMap" => {
            let at = match draw.below(3) {
                0 => None,
                1 => Some(v1::copy_map_request::At::Revision(1 + draw.below(40) as i64)),
                _ => Some(v1::copy_map_request::At::Time(prost_types::Timestamp {
                    seconds: draw.one(&[0, 4_000_000_000]),
                    nanos: 0,
                })),
            };
            // The names of maps are mostly taken.
            let new_map_id = format!("copy-{}", world.number());
            let state = draw.below(3) as i32;
            let request = v1::CopyMapRequest { source_map_id: map_id, new_map_id, at, state };
            vec![request.encode_to_vec()]
        }
        "MergeMaps" => vec![merge(map_id, draw).encode_to_vec()],
        "UndoMerge" => {
            let source_map_id = draw.one(&MAPS).to_owned();
            vec![v1::UndoMergeRequest { map_id, source_map_id }.encode_to_vec()]
        }
        "ExportMap" => {
            let format = 1 + draw.below(6) as i32;
            vec![v1::ExportMapRequest { map_id, format, all_landmarks: false }.encode_to_vec()]
        }
        "ImportMap" => import(map_id, draw),
        "GetTrajectory" => {
            vec![v1::GetTrajectoryRequest { map_id, ..Default::default() }.encode_to_vec()]
        }
        // The lists have the same first fields.
        "ListKeyframes" | "ListLandmarks" | "ListConstraints" | "ListPlaceSearches" => {
            let page_size = draw.one(&[0, 1, 100]);
            let request = v1::ListKeyframesRequest { map_id, page_size, ..Default::default() };
            vec![request.encode_to_vec()]
        }
        "WatchMap" => vec![v1::WatchMapRequest { map_id, ..Default::default() }.encode_to_vec()],
        "Ingest" => ingest(&map_id, world, draw),
        "OptimizeMap" => vec![optimize(map_id, draw).encode_to_vec()],
        "Localize" => vec![localize(map_id).encode_to_vec()],
        "RefinePose" => vec![refine().encode_to_vec()],
        "SolveBundle" => {
            let problem = Some(bundle(3));
            vec![v1::SolveBundleRequest { problem, ..Default::default() }.encode_to_vec()]
        }
        "SolvePoseGraph" => vec![pose_graph(draw).encode_to_vec()],
        "CreateJob" => {
            world.jobs += 1;
            let (job_id, spec) = (format!("j{}", world.jobs), Some(job(map_id, world, draw)));
            let spec = Some(v1::JobSpec { spec });
            vec![v1::CreateJobRequest { job_id, spec, priority: 0 }.encode_to_vec()]
        }
        "UploadJobFiles" => {
            let name = draw.one(&["window-6-80.txt", "grid-100-edges.g2o"]);
            upload(&[(name, twin(name))]).iter().map(Message::encode_to_vec).collect()
        }
        "GetJob" | "CancelJob" | "DeleteJob" | "WatchJob" | "DownloadJobFiles" => {
            let job_id = format!("j{}", 1 + draw.below(1 + world.jobs as usize));
            vec![v1::DownloadJobFilesRequest { job_id, ..Default::default() }.encode_to_vec()]
        }
        // These need nothing.
        _ => vec![Vec::new()],
    }
}

fn policy(draw: &mut Draw) -> v1::MapPolicy {
    let anchor = v1::GeodeticPosition { latitude_deg: 50.0, longitude_deg: 7.0, height_m: 100.0 };
    let loss = |draw: &mut Draw| {
        let kind = 1 + draw.below(5) as i32;
        Some(v1::Loss { kind, width: (kind > 1).then_some(2.0) })
    };
    v1::MapPolicy {
        observation_loss: if draw.chance(0.3) { loss(draw) } else { None },
        constraint_loss: if draw.chance(0.3) { loss(draw) } else { None },
        local_bundle_adjustment: draw.chance(0.3).then(|| draw.chance(0.5)),
        gauge: draw.one(&[0, 1]),
        geodetic_anchor: draw.chance(0.2).then_some(anchor),
        ..Default::default()
    }
}

fn update(map_id: String, draw: &mut Draw) -> v1::UpdateMapRequest {
    let paths = draw.one(&["display_name", "policy", "state"]);
    let state = if draw.chance(0.8) { v1::MapState::Open } else { v1::MapState::Frozen };
    v1::UpdateMapRequest {
        map_id,
        display_name: "room".to_owned(),
        policy: Some(policy(draw)),
        state: state.into(),
        update_mask: Some(prost_types::FieldMask { paths: vec![paths.to_owned()] }),
        ..Default::default()
    }
}

fn transform(draw: &mut Draw) -> v1::RigidTransform {
    let [x, y, z, w] = draw.rotation();
    let translation = [(); 3].map(|()| draw.finite());
    let rotation = Some(v1::Quaternion { x, y, z, w });
    v1::RigidTransform { translation: Some(vector3(translation)), rotation }
}

/// A constraint of any scale between two keyframes.
fn constraint(
    id: i64,
    i: (&str, i64),
    j: (&str, i64),
    draw: &mut Draw,
) -> v1::RelativePoseConstraint {
    let named =
        |(client, id): (&str, i64)| Some(v1::KeyframeRef { client_id: client.to_owned(), id });
    let usual = relative_pose(id, i.1, j.1);
    let upper_triangle = if draw.chance(0.5) { diagonal(6, 100.0) } else { draw.triangle(6) };
    v1::RelativePoseConstraint {
        keyframe_i: named(i),
        keyframe_j: named(j),
        keyframe_i_from_keyframe_j: match draw.chance(0.5) {
            true => usual.keyframe_i_from_keyframe_j,
            false => Some(transform(draw)),
        },
        information: Some(v1::InformationMatrix6 { upper_triangle }),
        kind: 1 + draw.below(3) as i32,
        ..usual
    }
}

fn merge(target: String, draw: &mut Draw) -> v1::MergeMapsRequest {
    let source = draw.one(&MAPS).to_owned();
    let (a, b) = (robot(&target), robot(&source));
    let placed = draw.chance(0.5);
    let count = if placed { 0 } else { 1 + draw.below(3) };
    let constraints = (0..count as i64).map(|id| {
        let (i, j) = (draw.below(4) as i64, draw.below(4) as i64);
        let between = constraint(id, (&a, i), (&b, j), draw);
        v1::RelativePoseConstraint { kind: v1::ConstraintKind::LoopClosure.into(), ..between }
    });
    let constraints = constraints.collect();
    v1::MergeMapsRequest {
        constraints,
        target_from_source: placed.then(|| transform(draw)),
        scale: draw.one(&[0.0, 0.0, 1.0, 2.5]),
        target_map_id: target,
        source_map_id: source,
        ..Default::default()
    }
}

/// A file of a trajectory or a pose graph, with numbers of any size.
fn import(map_id: String, draw: &mut Draw) -> Vec<Vec<u8>> {
    use v1::import_map_request::Content;
    let mut text = String::new();
    let is_graph = draw.chance(0.5);
    let pose = |k: usize, draw: &mut Draw| {
        let [x, y, z, w] = draw.rotation();
        let far = draw.chance(0.4);
        let [a, b, c] = [(); 3].map(|()| if far { draw.finite() } else { k as f64 });
        format!("{a:e} {b:e} {c:e} {x} {y} {z} {w}")
    };
    for k in 0..4 {
        let pose = pose(k, draw);
        text += &match is_graph {
            true => format!("VERTEX_SE3:QUAT {k} {pose}\n"),
            false => format!("{k} {pose}\n"),
        };
    }
    for k in (1..4).filter(|_| is_graph) {
        let triangle: Vec<_> = match draw.chance(0.7) {
            true => diagonal(6, 10.0),
            false => draw.triangle(6),
        };
        let triangle: Vec<_> = triangle.iter().map(|number| format!("{number:e}")).collect();
        let pose = pose(1, draw);
        text += &format!("EDGE_SE3:QUAT {} {k} {pose} {}\n", k - 1, triangle.join(" "));
    }
    let format = if is_graph { v1::MapFormat::G2o } else { v1::MapFormat::Tum };
    let client_id = robot(&map_id);
    let header =
        v1::ImportMapHeader { map_id, client_id, format: format.into(), ..Default::default() };
    let path = if is_graph { "graph.g2o" } else { "walk.tum" }.to_owned();
    let chunk = v1::FileChunk { path, offset: 0, data: text.into_bytes(), last_chunk: true };
    let message = |content| v1::ImportMapRequest { content: Some(content) }.encode_to_vec();
    vec![message(Content::Header(header)), message(Content::Chunk(chunk))]
}

/// What a run begins with: maps with keyframes.
pub(super) fn beginning(world: &mut World) -> Vec<(&'static str, Vec<Vec<u8>>)> {
    let mut calls = Vec::new();
    for map in &MAPS[..3] {
        let request = v1::CreateMapRequest { map_id: (*map).to_owned(), ..Default::default() };
        calls.push(("CreateMap", vec![request.encode_to_vec()]));
        calls.push(("Ingest", stream(map, scene(), world)));
    }
    calls
}

/// A camera and the keyframes that each map has.
fn scene() -> Vec<Item> {
    let keyframes = (0..KEYFRAMES).map(|id| Item::Keyframe(keyframe(id)));
    std::iter::once(Item::Camera(camera(0))).chain(keyframes).collect()
}

/// A stream that adds keyframes where there are none, and then items of every kind.
fn ingest(map: &str, world: &mut World, draw: &mut Draw) -> Vec<Vec<u8>> {
    let mut items = scene();
    for _ in 0..1 + draw.below(4) {
        items.push(item(&robot(map), world.number(), draw));
    }
    stream(map, items, world)
}

fn stream(map: &str, items: Vec<Item>, world: &mut World) -> Vec<Vec<u8>> {
    let client = robot(map);
    let mut messages =
        vec![v1::IngestRequest { sequence: 0, item: Some(open_item(map, &client, 0)) }];
    messages.extend(
        items
            .into_iter()
            .map(|item| v1::IngestRequest { sequence: world.number(), item: Some(item) }),
    );
    messages.iter().map(Message::encode_to_vec).collect()
}

fn item(client: &str, id: i64, draw: &mut Draw) -> Item {
    let (i, j) = (draw.below(4) as i64, draw.below(4) as i64);
    let of = |id| Some(v1::KeyframeRef { client_id: String::new(), id });
    let landmark = |id| v1::LandmarkRef { client_id: String::new(), id };
    match draw.below(11) {
        0 | 1 => Item::RelativePose(constraint(id, (client, i), (client, j), draw)),
        2 => Item::PosePrior(v1::PosePrior {
            id,
            keyframe: of(i),
            world_from_camera: Some(transform(draw)),
            information: Some(information6(100.0)),
            ..Default::default()
        }),
        3 => Item::PositionPrior(v1::PositionPrior {
            id,
            keyframe: of(i),
            point_in_world: Some(vector3([(); 3].map(|()| draw.finite()))),
            information: Some(information3(4.0)),
            ..Default::default()
        }),
        4 => {
            let landmark = crate::common::landmark(1000 + id);
            Item::Landmarks(v1::LandmarkBatch { landmarks: vec![landmark] })
        }
        5 => {
            let observations = vec![crate::common::observation(i, 1000 + id)];
            Item::Observations(v1::ObservationBatch { keyframe: of(i), observations })
        }
        // Somewhere, with nothing but a pose.
        6 => Item::Keyframe(v1::Keyframe {
            id: 1000 + id,
            world_from_camera: Some(transform(draw)),
            sensor: None,
            observations: Vec::new(),
            ..keyframe(1)
        }),
        7 => Item::SetCamera(camera(0)),
        8 => Item::FuseLandmarks(v1::FuseLandmarks {
            kept: Some(landmark(i)),
            absorbed: vec![landmark(10 + j)],
        }),
        9 => Item::RemoveLandmarks(v1::RemoveLandmarks { landmarks: vec![landmark(20 + i)] }),
        _ => Item::RemoveKeyframe(v1::RemoveKeyframe { keyframe: of(1000 + j) }),
    }
}

fn optimize(map_id: String, draw: &mut Draw) -> v1::OptimizeMapRequest {
    let problem = draw.one(&[v1::MapProblem::Full, v1::MapProblem::PoseGraph]);
    v1::OptimizeMapRequest {
        map_id,
        problem: problem.into(),
        certify: problem == v1::MapProblem::PoseGraph && draw.chance(0.3),
        gauge: draw.one(&[0, 1]),
        ..Default::default()
    }
}

fn localize(map_id: String) -> v1::LocalizeRequest {
    let feature = |k: i64| v1::Feature {
        pixel: Some(pixel(0, k)),
        descriptor: Some(v1::Descriptor {
            kind: v1::DescriptorKind::Binary.into(),
            name: "orb".to_owned(),
            data: vec![k as u8; 32],
        }),
        ..Default::default()
    };
    let features = (0..20).map(feature).collect();
    v1::LocalizeRequest { map_id, camera: Some(camera(0)), features, ..Default::default() }
}

fn refine() -> v1::RefinePoseRequest {
    let observation = |k: i64| v1::PointObservation {
        point_in_world: Some(vector3(crate::common::landmark_position(k))),
        pixel: Some(pixel(1, k)),
        ..Default::default()
    };
    v1::RefinePoseRequest {
        camera: Some(camera(0)),
        world_from_camera: Some(shift([0.1, 0.0, 0.0])),
        observations: (0..12).map(observation).collect(),
        include_information: true,
        ..Default::default()
    }
}

fn pose_graph(draw: &mut Draw) -> v1::SolvePoseGraphRequest {
    use v1::solve_pose_graph_request::Graph;
    let graph = if draw.chance(0.5) {
        let vertices = (0..5).map(|id| v1::PoseGraphVertexSe3 {
            id,
            world_from_vertex: Some(shift([id as f64, 0.0, 0.0])),
            ..Default::default()
        });
        let edges = (1..6).map(|j| v1::PoseGraphEdgeSe3 {
            vertex_i: j - 1,
            vertex_j: j % 5,
            vertex_i_from_vertex_j: Some(shift([if j < 5 { 1.0 } else { -4.0 }, 0.1, 0.0])),
            information: Some(information6(10.0)),
            ..Default::default()
        });
        Graph::Se3(v1::PoseGraphSe3 { vertices: vertices.collect(), edges: edges.collect() })
    } else {
        let moved = |x| v1::RigidTransform2 {
            translation: Some(v1::Vector2 { x, y: 0.1 }),
            angle_rad: 0.1,
        };
        let vertices = (0..5).map(|id| v1::PoseGraphVertexSe2 { id, ..Default::default() });
        let edges = (1..6).map(|j| v1::PoseGraphEdgeSe2 {
            vertex_i: j - 1,
            vertex_j: j % 5,
            vertex_i_from_vertex_j: Some(moved(if j < 5 { 1.0 } else { -4.0 })),
            information: Some(information3(10.0)),
            ..Default::default()
        });
        Graph::Se2(v1::PoseGraphSe2 { vertices: vertices.collect(), edges: edges.collect() })
    };
    let kernel = draw.below(4) as i32;
    v1::SolvePoseGraphRequest {
        graph: Some(graph),
        start: draw.below(6) as i32,
        robust: draw.chance(0.5).then_some(v1::ClosureRobustness { kernel, threshold: None }),
        certify: draw.chance(0.3),
        ..Default::default()
    }
}

fn job(map_id: String, world: &World, draw: &mut Draw) -> Spec {
    let upload_id = match world.uploads.is_empty() {
        true => String::new(),
        false => draw.one(&world.uploads),
    };
    match draw.below(8) {
        0 => Spec::OptimizeMap(optimize(map_id, draw)),
        1 => Spec::MergeMaps(merge(map_id, draw)),
        2 => {
            let target_map_id = draw.one(&MAPS).to_owned();
            let policy = Some(policy(draw));
            Spec::RebuildMap(v1::RebuildMapSpec { source_map_id: map_id, target_map_id, policy })
        }
        3 => {
            let redundant_share = draw.chance(0.5).then_some(0.9);
            Spec::CompactMap(v1::CompactMapSpec { map_id, redundant_share, drop_old_journal: true })
        }
        4 => Spec::ExportMap(v1::ExportMapRequest {
            map_id,
            format: 1 + draw.below(6) as i32,
            all_landmarks: false,
        }),
        5 => Spec::SolveFiles(v1::SolveFilesSpec { upload_id, kind: 0, keep_solutions: true }),
        6 => Spec::Reconstruct(v1::ReconstructSpec { map_id, ..Default::default() }),
        _ => {
            let truth = (0..4).map(|id| v1::KeyframePose {
                capture_time: keyframe(id).capture_time,
                world_from_camera: keyframe(id).world_from_camera,
                ..Default::default()
            });
            let client_id = robot(&map_id);
            Spec::EvaluateTrajectory(v1::EvaluateTrajectorySpec {
                map_id,
                client_id,
                truth: truth.collect(),
                ..Default::default()
            })
        }
    }
}
