//! Seeds of the wire: a small stream with every kind of item, and requests of every kind.

use covis_solvers::geometry::{LieGroup as _, Se3};
use nalgebra::{Vector3, Vector6};
use prost::Message as _;

use crate::wire::v1;
use v1::ingest_request::Item;
use v1::solve_pose_graph_request::Graph;

type Named = Vec<(&'static str, Vec<u8>)>;

fn stream(items: Vec<Item>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (sequence, item) in (1..).zip(items) {
        let request = v1::IngestRequest { sequence, item: Some(item) };
        request.encode_length_delimited(&mut bytes).unwrap();
    }
    bytes
}

fn vector3(v: Vector3<f64>) -> Option<v1::Vector3> {
    Some(v1::Vector3 { x: v.x, y: v.y, z: v.z })
}

fn pose(pose: &Se3) -> Option<v1::RigidTransform> {
    let q = pose.rotation.quaternion();
    let rotation = Some(v1::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w });
    Some(v1::RigidTransform { translation: vector3(pose.translation), rotation })
}

/// Camera k of a row, looking along z.
fn pose_of(k: i64) -> Se3 {
    Se3::exp(&(Vector6::new(0.2, 0.01, 0.0, 0.0, 0.02, 0.0) * k as f64))
}

fn point(k: i64) -> Vector3<f64> {
    Vector3::new((k % 3) as f64 - 1.0, (k / 3) as f64 - 1.0, 4.0)
}

fn pixel(seen_from: i64, k: i64) -> Option<v1::Vector2> {
    let p = pose_of(seen_from).inverse_transform(&point(k));
    Some(v1::Vector2 { x: 320.0 + 500.0 * p.x / p.z, y: 240.0 + 500.0 * p.y / p.z })
}

fn camera(id: i64) -> v1::Camera {
    use v1::camera::Model;
    let model = match id {
        0 => Model::PinholeRadialTangential(v1::PinholeRadialTangential {
            fx: 500.0,
            fy: 500.0,
            cx: 320.0,
            cy: 240.0,
            ..Default::default()
        }),
        1 => Model::KannalaBrandt(v1::KannalaBrandt {
            fx: 300.0,
            fy: 301.0,
            cx: 320.0,
            cy: 240.0,
            k1: 0.01,
            ..Default::default()
        }),
        _ => Model::Snavely(v1::Snavely { focal: 400.0, k1: -0.01, k2: 1e-4 }),
    };
    v1::Camera { id, width_px: 640, height_px: 480, model: Some(model), ..Default::default() }
}

fn observation(keyframe: i64, landmark: i64) -> v1::Observation {
    let reference = v1::LandmarkRef { client_id: String::new(), id: landmark };
    v1::Observation {
        landmark: Some(reference),
        pixel: pixel(keyframe, landmark),
        sigma_px: (landmark % 2 == 0).then_some(0.5),
        ..Default::default()
    }
}

fn landmark(id: i64, placed: bool) -> v1::Landmark {
    let point_in_world = if placed { vector3(point(id)) } else { None };
    v1::Landmark { id, point_in_world, ..Default::default() }
}

fn keyframe(id: i64, landmarks: std::ops::Range<i64>, new: bool) -> v1::Keyframe {
    v1::Keyframe {
        id,
        capture_time: Some(prost_types::Timestamp { seconds: 100 + id, nanos: 5 }),
        sensor: Some(v1::keyframe::Sensor::CameraId(0)),
        world_from_camera: pose(&pose_of(id)),
        odom_from_camera: if id == 1 { pose(&pose_of(0)) } else { None },
        observations: landmarks.clone().map(|k| observation(id, k)).collect(),
        landmarks: landmarks.filter(|_| new).map(|k| landmark(k, k % 4 != 3)).collect(),
        ..Default::default()
    }
}

fn identity<const N: usize>() -> Vec<f64> {
    (0..N).flat_map(|i| (i..N).map(move |j| if i == j { 100.0 } else { 0.0 })).collect()
}

fn keyframe_ref(id: i64) -> Option<v1::KeyframeRef> {
    Some(v1::KeyframeRef { client_id: String::new(), id })
}

fn information6() -> Option<v1::InformationMatrix6> {
    Some(v1::InformationMatrix6 { upper_triangle: identity::<6>() })
}

fn relative(id: i64, kind: v1::ConstraintKind) -> Item {
    Item::RelativePose(v1::RelativePoseConstraint {
        id,
        keyframe_i: keyframe_ref(0),
        keyframe_j: keyframe_ref(1),
        keyframe_i_from_keyframe_j: pose(&pose_of(1)),
        information: information6(),
        kind: kind.into(),
        ..Default::default()
    })
}

pub(super) fn items() -> Named {
    let walk = |count: i64| -> Vec<Item> {
        let frames = (0..count).map(|k| Item::Keyframe(keyframe(k, 0..9, k == 0)));
        std::iter::once(Item::Camera(camera(0))).chain(frames).collect()
    };
    let mut rich = observation(0, 0);
    rich.depth_m = Some(4.0);
    rich.sigma_depth_m = Some(0.1);
    rich.descriptor = Some(v1::Descriptor {
        kind: v1::DescriptorKind::Binary.into(),
        name: "orb".to_owned(),
        data: vec![7; 32],
    });
    let mut bare = keyframe(0, 0..0, false);
    bare.sensor = None;
    let rich_frame = v1::Keyframe { observations: vec![rich], ..keyframe(0, 0..1, true) };
    let batch = v1::LandmarkBatch { landmarks: (20..24).map(|k| landmark(k, true)).collect() };
    let seen =
        v1::ObservationBatch { keyframe: keyframe_ref(0), observations: vec![observation(0, 20)] };
    let prior = v1::PosePrior {
        id: 8,
        keyframe: keyframe_ref(0),
        world_from_camera: pose(&pose_of(0)),
        information: information6(),
        ..Default::default()
    };
    let position = v1::PositionPrior {
        id: 9,
        keyframe: keyframe_ref(1),
        point_in_world: vector3(point(1)),
        information: Some(v1::InformationMatrix3 { upper_triangle: identity::<3>() }),
        ..Default::default()
    };
    let mut all = walk(2);
    all.extend((1..3).map(|k| Item::Camera(camera(k))));
    all.extend([
        Item::Landmarks(batch),
        Item::Observations(seen),
        relative(1, v1::ConstraintKind::Odometry),
        relative(2, v1::ConstraintKind::LoopClosure),
        Item::PosePrior(prior),
        Item::PositionPrior(position),
    ]);
    let wrong = keyframe(0, 0..2, false);
    vec![
        ("walk", stream(walk(4))),
        ("every-item", stream(all)),
        ("rich-observation", stream(vec![Item::Camera(camera(0)), Item::Keyframe(rich_frame)])),
        ("last-sequence", {
            let item = Some(Item::Camera(camera(0)));
            v1::IngestRequest { sequence: i64::MAX, item }.encode_length_delimited_to_vec()
        }),
        ("bare-keyframe", stream(vec![Item::Keyframe(bare)])),
        ("unknown-references", stream(vec![Item::Keyframe(wrong)])),
        ("repeated", stream(vec![Item::Camera(camera(0)), Item::Camera(camera(0))])),
        ("not-served", stream(vec![Item::Rig(v1::Rig::default())])),
        ("edits", stream(walk(4).into_iter().chain(edits()).collect())),
    ]
}

/// Every edit, on the map of a walk.
fn edits() -> Vec<Item> {
    let landmark = |id| v1::LandmarkRef { client_id: String::new(), id };
    let observation = v1::ObservationRef {
        keyframe: keyframe_ref(1),
        landmark: Some(landmark(0)),
        camera_index: 0,
    };
    let constraint = Some(v1::ConstraintRef { client_id: String::new(), id: 2 });
    vec![
        relative(2, v1::ConstraintKind::LoopClosure),
        Item::RemoveObservations(v1::RemoveObservations { observations: vec![observation] }),
        Item::FuseLandmarks(v1::FuseLandmarks {
            kept: Some(landmark(1)),
            absorbed: vec![landmark(2), landmark(3)],
        }),
        Item::RemoveLandmarks(v1::RemoveLandmarks { landmarks: vec![landmark(4), landmark(5)] }),
        Item::SetCamera(camera(0)),
        Item::SetCamera(v1::Camera { id: 0, ..camera(1) }),
        Item::RevokeConstraint(v1::RevokeConstraint { constraint }),
        Item::RemoveKeyframe(v1::RemoveKeyframe { keyframe: keyframe_ref(2) }),
        Item::RemoveKeyframe(v1::RemoveKeyframe { keyframe: keyframe_ref(2) }),
    ]
}

fn request(kind: u8, message: &impl prost::Message) -> Vec<u8> {
    [&[kind][..], &message.encode_to_vec()].concat()
}

fn bundle() -> v1::SolveBundleRequest {
    let poses = (0..3).map(|k| v1::BundlePose {
        camera_index: 0,
        world_from_camera: pose(&pose_of(k)),
        fixed: k == 0,
    });
    let points = (0..9).map(|k| {
        let point = point(k) + Vector3::new(0.01, 0.02, -0.03);
        v1::BundlePoint { point_in_world: vector3(point), fixed: false }
    });
    let seen = (0..3).flat_map(|pose| (0..9).map(move |point| (pose, point)));
    let observations = seen.map(|(pose, point)| v1::BundleObservation {
        pose_index: pose,
        point_index: point,
        pixel: pixel(pose.into(), point.into()),
        sigma_px: None,
        depth_m: (point == 4).then_some(4.0),
        sigma_depth_m: (point == 4).then_some(0.1),
    });
    let problem = v1::BundleProblem {
        cameras: vec![camera(0)],
        poses: poses.collect(),
        points: points.collect(),
        observations: observations.collect(),
    };
    let loss = v1::Loss { kind: v1::LossKind::Huber.into(), width: Some(2.0) };
    v1::SolveBundleRequest {
        problem: Some(problem),
        loss: Some(loss),
        refine_intrinsics: true,
        include_iterations: true,
        ..Default::default()
    }
}

fn graph_se3() -> v1::PoseGraphSe3 {
    let vertices = (0..3).map(|id| v1::PoseGraphVertexSe3 {
        id,
        world_from_vertex: pose(&pose_of(id)),
        fixed: id == 0,
    });
    let edges = [(0, 1), (1, 2), (2, 0)].map(|(vertex_i, vertex_j)| v1::PoseGraphEdgeSe3 {
        vertex_i,
        vertex_j,
        vertex_i_from_vertex_j: pose(&pose_of(1)),
        information: information6(),
        loss: None,
        trusted: vertex_j == 1,
    });
    v1::PoseGraphSe3 { vertices: vertices.collect(), edges: edges.into() }
}

fn graph_se2() -> v1::PoseGraphSe2 {
    let measured =
        v1::RigidTransform2 { translation: Some(v1::Vector2 { x: 1.0, y: 0.1 }), angle_rad: 2.0 };
    let edges = [(0, 1), (1, 2), (2, 0)].map(|(vertex_i, vertex_j)| v1::PoseGraphEdgeSe2 {
        vertex_i,
        vertex_j,
        vertex_i_from_vertex_j: Some(measured),
        information: Some(v1::InformationMatrix3 { upper_triangle: identity::<3>() }),
        loss: None,
        trusted: false,
    });
    let vertices =
        (0..3).map(|id| v1::PoseGraphVertexSe2 { id, world_from_vertex: None, fixed: false });
    v1::PoseGraphSe2 { vertices: vertices.collect(), edges: edges.into() }
}

pub(super) fn requests() -> Named {
    let options = |linear: v1::LinearSolver, method: v1::SolverMethod| {
        Some(v1::SolverOptions {
            linear_solver: linear.into(),
            method: method.into(),
            ..Default::default()
        })
    };
    let gauss = v1::SolverMethod::GaussNewton;
    let iterative = options(v1::LinearSolver::IterativeSchur, gauss);
    let robust =
        v1::ClosureRobustness { kernel: v1::RobustKernel::GncTls.into(), threshold: Some(3.0) };
    let graph = |graph| v1::SolvePoseGraphRequest { graph: Some(graph), ..Default::default() };
    let se3 = graph(Graph::Se3(graph_se3()));
    let seen = (0..6).map(|k| v1::PointObservation {
        point_in_world: vector3(point(k)),
        pixel: pixel(1, k),
        ..Default::default()
    });
    let refine = v1::RefinePoseRequest {
        camera: Some(camera(0)),
        world_from_camera: pose(&pose_of(0)),
        observations: seen.collect(),
        prior: Some(v1::RefinePosePrior {
            world_from_camera: pose(&pose_of(1)),
            information: information6(),
        }),
        include_information: true,
        ..Default::default()
    };
    let policy = v1::MapPolicy {
        observation_loss: Some(v1::Loss { kind: v1::LossKind::Cauchy.into(), width: Some(1.5) }),
        constraint_loss: Some(v1::Loss { kind: v1::LossKind::Trivial.into(), width: None }),
        window_keyframe_count: Some(5),
        local_bundle_adjustment: Some(false),
        limits: Some(v1::MapLimits { max_keyframe_count: Some(7), ..Default::default() }),
        loop_closure_robustness: Some(robust),
        ..Default::default()
    };
    let create = v1::CreateMapRequest {
        map_id: "house".to_owned(),
        display_name: "Haus".to_owned(),
        policy: Some(policy),
    };
    let optimize = v1::OptimizeMapRequest {
        map_id: "house".to_owned(),
        options: options(v1::LinearSolver::DenseSchur, gauss),
        ..Default::default()
    };
    let copy = v1::CopyMapRequest {
        source_map_id: "house".to_owned(),
        new_map_id: "house-2".to_owned(),
        at: Some(v1::copy_map_request::At::Time(prost_types::Timestamp { seconds: 1, nanos: 5 })),
        state: v1::MapState::Frozen.into(),
    };
    let list = v1::ListMapsRequest { page_size: 3, page_token: "house".to_owned() };
    vec![
        ("bundle", request(0, &bundle())),
        (
            "bundle-iterative",
            request(0, &v1::SolveBundleRequest { options: iterative, ..bundle() }),
        ),
        ("graph-se3", request(1, &se3)),
        ("graph-se2", request(1, &graph(Graph::Se2(graph_se2())))),
        (
            "graph-robust",
            request(1, &v1::SolvePoseGraphRequest { robust: Some(robust), ..se3.clone() }),
        ),
        ("graph-certified", request(1, &v1::SolvePoseGraphRequest { certify: true, ..se3 })),
        ("refine", request(2, &refine)),
        ("create", request(3, &create)),
        ("optimize", request(4, &optimize)),
        ("list", request(5, &list)),
        ("copy", request(6, &copy)),
    ]
}
