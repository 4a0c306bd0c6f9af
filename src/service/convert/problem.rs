//! Problems that come with a call: bundle adjustment, pose graphs, one pose over known points.
//!
//! Bundles refer by index into their own lists, pose graphs by vertex id. The solver checks what
//! only the whole problem shows (a graph in pieces, a variable that nothing measures).

use std::collections::BTreeMap;

use covis_solvers::factors::{DepthReprojection, RelativePose};
use covis_solvers::geometry::{LieGroup, Se2, Se3};
use covis_solvers::information::Information;
use covis_solvers::initialization::Start;
use covis_solvers::loss::Loss;
use covis_solvers::problem::{BundleProblem, PoseGraph};

use super::camera::camera;
use super::geometry::{
    information3, information6, rigid_transform, rigid_transform2, to_rigid_transform, to_vector3,
    vector2, vector3,
};
use super::ids::id;
use super::item::depth;
use super::solve::loss;
use super::{Path, Violations, all};
use crate::map::Reason;
use crate::wire::v1;

/// The bundle problem of a request, with `loss` on all observations.
pub(in crate::service) fn bundle(
    message: Option<&v1::BundleProblem>,
    loss: Loss,
    refine_intrinsics: bool,
    out: &mut Violations,
) -> Option<BundleProblem> {
    let at = Path::root("problem");
    let message = out.required(at, message)?;
    out.not_empty(at.field("cameras"), &message.cameras);
    out.not_empty(at.field("poses"), &message.poses);
    out.not_empty(at.field("points"), &message.points);
    out.not_empty(at.field("observations"), &message.observations);
    let counts = (message.cameras.len(), message.poses.len(), message.points.len());
    let cameras = all(at.field("cameras"), &message.cameras, out, camera)?;
    let poses = all(at.field("poses"), &message.poses, out, |at, pose, out| {
        let camera = index(at.field("camera_index"), pose.camera_index, counts.0, out);
        let start = at.field("world_from_camera");
        let start = rigid_transform(start, pose.world_from_camera.as_ref(), out);
        Some((camera?, start?))
    });
    let points = all(at.field("points"), &message.points, out, |at, point, out| {
        vector3(at.field("point_in_world"), point.point_in_world.as_ref(), out)
    });
    let observations = all(at.field("observations"), &message.observations, out, |at, m, out| {
        observation(at, m, (counts.1, counts.2), out)
    });
    let poses = poses?;
    let mut problem = BundleProblem {
        cameras: cameras.iter().map(|c| c.camera).collect(),
        constant_cameras: vec![!refine_intrinsics; counts.0],
        poses: poses.iter().map(|&(_, pose)| pose).collect(),
        constant_poses: message.poses.iter().map(|p| p.fixed).collect(),
        landmarks: points?,
        constant_landmarks: message.points.iter().map(|p| p.fixed).collect(),
        observation_loss: loss,
        ..BundleProblem::default()
    };
    for observation in observations? {
        let camera = poses.get(observation.pose as usize).map_or(0, |&(camera, _)| camera);
        observation.push(camera, &mut problem);
    }
    Some(problem)
}

/// One observation of a bundle in the domain's terms.
struct Seen {
    pose: u32,
    point: u32,
    pixel: nalgebra::Vector2<f64>,
    sigma_px: f64,
    depth: Option<crate::map::Depth>,
}

impl Seen {
    fn push(self, camera: u32, problem: &mut BundleProblem) {
        let (pixel, sigma_px) = (self.pixel, self.sigma_px);
        match self.depth {
            None => {
                problem.reprojections.push(self.pose, camera, self.point, pixel, sigma_px);
            }
            Some(depth) => {
                let (depth_m, sigma_depth_m) = (depth.depth_m, depth.sigma_m);
                let factor = DepthReprojection { pixel, depth_m, sigma_px, sigma_depth_m };
                problem.depth_reprojections.push(self.pose, camera, self.point, factor);
            }
        }
    }
}

fn observation(
    at: Path<'_>,
    message: &v1::BundleObservation,
    (poses, points): (usize, usize),
    out: &mut Violations,
) -> Option<Seen> {
    let pose = index(at.field("pose_index"), message.pose_index, poses, out);
    let point = index(at.field("point_index"), message.point_index, points, out);
    let pixel = vector2(at.field("pixel"), message.pixel.as_ref(), out);
    let sigma = out.positive(at.field("sigma_px"), message.sigma_px.unwrap_or(1.0));
    let depth = depth(at, message.depth_m, message.sigma_depth_m, out);
    Some(Seen { pose: pose?, point: point?, pixel: pixel?, sigma_px: sigma?, depth: depth? })
}

/// An index into a list of `count` entries.
fn index(at: Path<'_>, value: i32, count: usize, out: &mut Violations) -> Option<u32> {
    match u32::try_from(value) {
        Ok(index) if (index as usize) < count => Some(index),
        _ => {
            let text = format!("{value} names nothing, there are {count}");
            out.report(at, Reason::UnknownReference, text)
        }
    }
}

/// Fixes the variables that the gauge of a bundle requires.
pub(in crate::service) fn hold_gauge(
    gauge: i32,
    problem: &mut BundleProblem,
    out: &mut Violations,
) -> Option<v1::Gauge> {
    let at = Path::root("gauge");
    let marked = problem.constant_poses.contains(&true);
    match out.known::<v1::Gauge>(at, gauge)? {
        v1::Gauge::Unspecified | v1::Gauge::FirstKeyframeFixed if marked => {
            Some(v1::Gauge::FixedPoses)
        }
        v1::Gauge::Unspecified | v1::Gauge::FirstKeyframeFixed => {
            if let Some(first) = problem.constant_poses.first_mut() {
                *first = true;
            }
            Some(v1::Gauge::FirstKeyframeFixed)
        }
        v1::Gauge::Free if marked => Some(v1::Gauge::FixedPoses),
        v1::Gauge::Free => Some(v1::Gauge::Free),
        v1::Gauge::FixedPoses if marked => Some(v1::Gauge::FixedPoses),
        v1::Gauge::FixedPoses => out.report(at, Reason::Inconsistent, "no pose is marked fixed"),
        v1::Gauge::Priors => out.report(at, Reason::Inconsistent, "the problem has no priors"),
    }
}

/// The solved values in the order of the request, observations left out.
pub(in crate::service) fn to_bundle(
    request: v1::BundleProblem,
    solved: &BundleProblem,
) -> v1::BundleProblem {
    let mut answer = v1::BundleProblem { observations: Vec::new(), ..request };
    for (message, camera) in answer.cameras.iter_mut().zip(&solved.cameras) {
        message.model = Some(super::camera::to_model(camera));
    }
    for (message, pose) in answer.poses.iter_mut().zip(&solved.poses) {
        message.world_from_camera = Some(to_rigid_transform(pose));
    }
    for (message, point) in answer.points.iter_mut().zip(&solved.landmarks) {
        message.point_in_world = Some(to_vector3(point));
    }
    answer
}

/// A vertex of either group.
struct Vertex<G> {
    id: i64,
    world_from_vertex: Option<G>,
    fixed: bool,
}

/// An edge of either group.
struct Edge<G, const N: usize> {
    vertices: (i64, i64),
    i_from_j: G,
    information: Information<N>,
    trusted: bool,
}

/// A graph and the start that the request chooses.
pub(in crate::service) struct GraphToSolve<G, const N: usize> {
    /// The graph; poses that the request left out are the identity.
    pub graph: PoseGraph<G, N>,
    /// Where the solve is to start.
    pub start: Start,
    /// Whether every vertex has a pose in the request.
    pub has_poses: bool,
    /// The edges that are never switched off, in increasing order.
    pub trusted: Vec<usize>,
}

/// A pose graph in space.
pub(in crate::service) fn graph_se3(
    message: &v1::PoseGraphSe3,
    graph_loss: Loss,
    start: i32,
    out: &mut Violations,
) -> Option<GraphToSolve<Se3, 6>> {
    let at = Path::root("se3");
    let vertices = all(at.field("vertices"), &message.vertices, out, |at, m, out| {
        let pose = m.world_from_vertex.as_ref();
        let place = at.field("world_from_vertex");
        let pose = pose.map(|p| rigid_transform(place, Some(p), out));
        vertex(at, m.id, pose, m.fixed, out)
    });
    let edges = all(at.field("edges"), &message.edges, out, |at, m, out| {
        let measured = m.vertex_i_from_vertex_j.as_ref();
        let measured = rigid_transform(at.field("vertex_i_from_vertex_j"), measured, out);
        let information = information6(at.field("information"), m.information.as_ref(), out);
        edge_loss(at, m.loss.as_ref(), graph_loss, out)?;
        let (vertices, i_from_j) = ((m.vertex_i, m.vertex_j), measured?);
        Some(Edge { vertices, i_from_j, information: information?, trusted: m.trusted })
    });
    out.not_empty(at.field("edges"), &message.edges);
    assemble(at, vertices?, edges?, graph_loss, start, out)
}

/// A pose graph in the plane.
pub(in crate::service) fn graph_se2(
    message: &v1::PoseGraphSe2,
    graph_loss: Loss,
    start: i32,
    out: &mut Violations,
) -> Option<GraphToSolve<Se2, 3>> {
    let at = Path::root("se2");
    let vertices = all(at.field("vertices"), &message.vertices, out, |at, m, out| {
        let pose = m.world_from_vertex.as_ref();
        let place = at.field("world_from_vertex");
        let pose = pose.map(|p| rigid_transform2(place, Some(p), out));
        vertex(at, m.id, pose, m.fixed, out)
    });
    let edges = all(at.field("edges"), &message.edges, out, |at, m, out| {
        let measured = m.vertex_i_from_vertex_j.as_ref();
        let measured = rigid_transform2(at.field("vertex_i_from_vertex_j"), measured, out);
        let information = information3(at.field("information"), m.information.as_ref(), out);
        edge_loss(at, m.loss.as_ref(), graph_loss, out)?;
        let (vertices, i_from_j) = ((m.vertex_i, m.vertex_j), measured?);
        Some(Edge { vertices, i_from_j, information: information?, trusted: m.trusted })
    });
    out.not_empty(at.field("edges"), &message.edges);
    assemble(at, vertices?, edges?, graph_loss, start, out)
}

fn vertex<G>(
    at: Path<'_>,
    vertex: i64,
    pose: Option<Option<G>>,
    fixed: bool,
    out: &mut Violations,
) -> Option<Vertex<G>> {
    let id = id(at.field("id"), vertex, out);
    let world_from_vertex = match pose {
        Some(pose) => Some(pose?),
        None if fixed => return out.missing(at.field("world_from_vertex")),
        None => None,
    };
    Some(Vertex { id: id?, world_from_vertex, fixed })
}

/// A loss of a single edge: not served yet, unless it is the graph's.
fn edge_loss(
    at: Path<'_>,
    message: Option<&v1::Loss>,
    graph_loss: Loss,
    out: &mut Violations,
) -> Option<()> {
    let at = at.field("loss");
    match loss(at, message, out)? {
        None => Some(()),
        Some(own) if own == graph_loss => Some(()),
        Some(_) => out.unimplemented(at),
    }
}

fn assemble<G: LieGroup<N>, const N: usize>(
    at: Path<'_>,
    vertices: Vec<Vertex<G>>,
    edges: Vec<Edge<G, N>>,
    graph_loss: Loss,
    start: i32,
    out: &mut Violations,
) -> Option<GraphToSolve<G, N>> {
    let start = out.known::<v1::PoseGraphStart>(Path::root("start"), start)?;
    let has_poses = vertices.iter().all(|v| v.world_from_vertex.is_some());
    let start = match start {
        v1::PoseGraphStart::Unspecified if !has_poses => Start::SpanningTree,
        v1::PoseGraphStart::Unspecified | v1::PoseGraphStart::Vertices => Start::Given,
        v1::PoseGraphStart::SpanningTree => Start::SpanningTree,
        v1::PoseGraphStart::Odometry => Start::Odometry,
        v1::PoseGraphStart::Chordal => Start::Chordal,
        v1::PoseGraphStart::Auto => Start::Auto,
    };
    let list = at.field("vertices");
    let mut graph = PoseGraph { loss: graph_loss, ..PoseGraph::new() };
    let mut index_of = BTreeMap::new();
    for (k, vertex) in vertices.into_iter().enumerate() {
        let at = list.index(k);
        if start == Start::Given && vertex.world_from_vertex.is_none() {
            let _: Option<()> = out.missing(at.field("world_from_vertex"));
        }
        if index_of.insert(vertex.id, k).is_some() {
            let text = format!("{} stands twice", vertex.id);
            let _: Option<()> = out.report(at.field("id"), Reason::Duplicate, text);
        }
        graph.push_pose(vertex.id, vertex.world_from_vertex.unwrap_or_else(G::identity));
        graph.constant[k] = vertex.fixed;
    }
    let list = at.field("edges");
    let trusted = edges.iter().enumerate().filter(|(_, edge)| edge.trusted).map(|(k, _)| k);
    let trusted = trusted.collect();
    for (k, edge) in edges.into_iter().enumerate() {
        let at = list.index(k);
        let (i, j) = edge.vertices;
        let mut find = |name, id: i64| {
            let found = index_of.get(&id).copied();
            found.or_else(|| {
                let text = format!("there is no vertex {id}");
                out.report(at.field(name), Reason::UnknownReference, text)
            })
        };
        let (found_i, found_j) = (find("vertex_i", i), find("vertex_j", j));
        if i == j {
            let text = "an edge ties two different vertices";
            let _: Option<()> = out.report(at.field("vertex_j"), Reason::Duplicate, text);
        }
        if let (Some(i), Some(j)) = (found_i, found_j) {
            let (i_from_j, information) = (edge.i_from_j, edge.information);
            graph.edges.push(RelativePose { i, j, i_from_j, information });
        }
    }
    Some(GraphToSolve { graph, start, has_poses, trusted })
}
