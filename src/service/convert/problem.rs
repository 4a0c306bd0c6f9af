//! Problems that come with a call: bundle adjustment, pose graphs, one pose over known points.
//!
//! Bundles refer by index into their own lists, pose graphs by vertex id. The solver checks what
//! only the whole problem shows (a graph in pieces, a variable that nothing measures).

use std::collections::BTreeMap;

use covis_solvers::factors::{RelativePose, Reprojection};
use covis_solvers::geometry::{LieGroup, Se2, Se3};
use covis_solvers::initialization::Start;
use covis_solvers::loss::Loss;
use covis_solvers::pose_refinement::{PointObservation, Prior};
use covis_solvers::problem::{BundleProblem, PoseGraph};

use super::camera::camera;
use super::geometry::{
    information, rigid_transform, rigid_transform2, to_rigid_transform, to_vector3, vector2,
    vector3,
};
use super::ids::id;
use super::item::depth;
use super::solve::own_loss;
use super::{Path, Violations, all};
use crate::map::{Depth, Reason};
use crate::wire::v1;

/// Fewer observations do not determine a pose.
const MIN_OBSERVATIONS: usize = 3;

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
        let pose = index(at.field("pose_index"), m.pose_index, counts.1, out);
        let point = index(at.field("point_index"), m.point_index, counts.2, out);
        let pixel = vector2(at.field("pixel"), m.pixel.as_ref(), out);
        let sigma_px = out.positive(at.field("sigma_px"), m.sigma_px.unwrap_or(1.0));
        let depth = depth(at, m.depth_m, m.sigma_depth_m, out);
        Some((pose?, point?, pixel?, sigma_px?, depth?))
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
    for (pose, point, pixel, sigma_px, depth) in observations? {
        let camera = poses.get(pose as usize).map_or(0, |&(camera, _)| camera);
        let depth_m = depth.map(|Depth { depth_m, sigma_m }| (depth_m, sigma_m));
        let seen = Reprojection { pixel, sigma_px, depth_m };
        problem.push_observation(pose, camera, point, seen);
    }
    Some(problem)
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

/// A vertex of either group: its id, its pose, and whether it is fixed.
type WireVertex<'m, T> = (i64, Option<&'m T>, bool);

/// An edge of either group.
struct WireEdge<'m, T> {
    vertices: (i64, i64),
    i_from_j: Option<&'m T>,
    upper_triangle: Option<&'m Vec<f64>>,
    loss: Option<&'m v1::Loss>,
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
    let vertices = message.vertices.iter().map(|v| (v.id, v.world_from_vertex.as_ref(), v.fixed));
    let edges = message.edges.iter().map(|edge| WireEdge {
        vertices: (edge.vertex_i, edge.vertex_j),
        i_from_j: edge.vertex_i_from_vertex_j.as_ref(),
        upper_triangle: edge.information.as_ref().map(|m| &m.upper_triangle),
        loss: edge.loss.as_ref(),
        trusted: edge.trusted,
    });
    graph(Path::root("se3"), vertices, edges, rigid_transform, graph_loss, start, out)
}

/// A pose graph in the plane.
pub(in crate::service) fn graph_se2(
    message: &v1::PoseGraphSe2,
    graph_loss: Loss,
    start: i32,
    out: &mut Violations,
) -> Option<GraphToSolve<Se2, 3>> {
    let vertices = message.vertices.iter().map(|v| (v.id, v.world_from_vertex.as_ref(), v.fixed));
    let edges = message.edges.iter().map(|edge| WireEdge {
        vertices: (edge.vertex_i, edge.vertex_j),
        i_from_j: edge.vertex_i_from_vertex_j.as_ref(),
        upper_triangle: edge.information.as_ref().map(|m| &m.upper_triangle),
        loss: edge.loss.as_ref(),
        trusted: edge.trusted,
    });
    graph(Path::root("se2"), vertices, edges, rigid_transform2, graph_loss, start, out)
}

/// The graph of the messages in the field `at`; `read` reads a pose.
fn graph<'m, T: 'm, G: LieGroup<N>, const N: usize>(
    at: Path<'_>,
    vertices: impl ExactSizeIterator<Item = WireVertex<'m, T>>,
    edges: impl ExactSizeIterator<Item = WireEdge<'m, T>>,
    read: fn(Path<'_>, Option<&T>, &mut Violations) -> Option<G>,
    graph_loss: Loss,
    start: i32,
    out: &mut Violations,
) -> Option<GraphToSolve<G, N>> {
    let (vertex_list, edge_list) = (at.field("vertices"), at.field("edges"));
    let vertices = all(vertex_list, vertices, out, |at, (vertex, pose, fixed), out| {
        let field = at.field("world_from_vertex");
        let pose = pose.map(|pose| read(field, Some(pose), out));
        let id = id(at.field("id"), vertex, out);
        let world_from_vertex = match pose {
            Some(pose) => Some(pose?),
            None if fixed => return out.missing(field),
            None => None,
        };
        Some((id?, world_from_vertex, fixed))
    });
    if edges.len() == 0 {
        let _: Option<()> = out.missing(edge_list);
    }
    let edges = all(edge_list, edges, out, |at, edge, out| {
        let measured = read(at.field("vertex_i_from_vertex_j"), edge.i_from_j, out);
        let information = information(at.field("information"), edge.upper_triangle, out);
        let loss = own_loss(at, edge.loss, out);
        Some((edge.vertices, (measured?, information?, loss?), edge.trusted))
    });
    let (vertices, edges) = (vertices?, edges?);
    let start = out.known::<v1::PoseGraphStart>(Path::root("start"), start)?;
    let has_poses = vertices.iter().all(|(_, pose, _)| pose.is_some());
    let start = match start {
        v1::PoseGraphStart::Unspecified if !has_poses => Start::SpanningTree,
        v1::PoseGraphStart::Unspecified | v1::PoseGraphStart::Vertices => Start::Given,
        v1::PoseGraphStart::SpanningTree => Start::SpanningTree,
        v1::PoseGraphStart::Odometry => Start::Odometry,
        v1::PoseGraphStart::Chordal => Start::Chordal,
        v1::PoseGraphStart::Auto => Start::Auto,
    };
    let mut graph = PoseGraph { loss: graph_loss, ..PoseGraph::new() };
    let mut index_of = BTreeMap::new();
    for (k, (id, pose, fixed)) in vertices.into_iter().enumerate() {
        let at = vertex_list.index(k);
        if start == Start::Given && pose.is_none() {
            let _: Option<()> = out.missing(at.field("world_from_vertex"));
        }
        if index_of.insert(id, k).is_some() {
            let text = format!("{id} occurs twice");
            let _: Option<()> = out.report(at.field("id"), Reason::Duplicate, text);
        }
        graph.push_pose(id, pose.unwrap_or_else(G::identity));
        graph.constant[k] = fixed;
    }
    let mut trusted = Vec::new();
    for (k, ((i, j), (i_from_j, information, loss), is_trusted)) in edges.into_iter().enumerate() {
        let at = edge_list.index(k);
        let mut find = |name, id: i64| {
            let found = index_of.get(&id).copied();
            found.or_else(|| {
                let text = format!("there is no vertex {id}");
                out.report(at.field(name), Reason::UnknownReference, text)
            })
        };
        let (found_i, found_j) = (find("vertex_i", i), find("vertex_j", j));
        if i == j {
            let text = "an edge must connect two different vertices";
            let _: Option<()> = out.report(at.field("vertex_j"), Reason::Duplicate, text);
        }
        if let (Some(i), Some(j)) = (found_i, found_j) {
            graph.edges.push(RelativePose { i, j, i_from_j, information, loss });
        }
        if is_trusted {
            trusted.push(k);
        }
    }
    Some(GraphToSolve { graph, start, has_poses, trusted })
}

/// The points that one camera sees in `RefinePose`, at least three.
pub(in crate::service) fn point_observations(
    messages: &[v1::PointObservation],
    out: &mut Violations,
) -> Option<Vec<PointObservation>> {
    let at = Path::root("observations");
    if messages.len() < MIN_OBSERVATIONS {
        let text = format!("{} observations, at least 3 are needed", messages.len());
        return out.report(at, Reason::WrongLength, text);
    }
    all(at, messages, out, |at, m, out| {
        let point = vector3(at.field("point_in_world"), m.point_in_world.as_ref(), out);
        let pixel = vector2(at.field("pixel"), m.pixel.as_ref(), out);
        let sigma = out.positive(at.field("sigma_px"), m.sigma_px.unwrap_or(1.0));
        let depth = depth(at, m.depth_m, m.sigma_depth_m, out);
        Some(PointObservation {
            point_in_world: point?,
            pixel: pixel?,
            sigma_px: sigma?,
            depth_m: depth?.map(|d| (d.depth_m, d.sigma_m)),
        })
    })
}

/// What is expected of the pose, `None` within where nothing is.
pub(in crate::service) fn prior(
    message: Option<&v1::RefinePosePrior>,
    out: &mut Violations,
) -> Option<Option<Prior>> {
    let Some(message) = message else { return Some(None) };
    let at = Path::root("prior");
    let pose = message.world_from_camera.as_ref();
    let pose = rigid_transform(at.field("world_from_camera"), pose, out);
    let upper_triangle = message.information.as_ref().map(|m| &m.upper_triangle);
    let information = information(at.field("information"), upper_triangle, out);
    Some(Some(Prior { world_from_camera: pose?, information: information? }))
}
