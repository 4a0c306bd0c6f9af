//! g2o files to pose graphs and back.
//!
//! Pose k of the graph is vertex k of the file; in a file of edges only it is the k-th lowest id.
//! `FIX` makes a pose or a landmark constant; without it and without priors the gauge is the caller's (the
//! lowest id, by convention).

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::Vector3;

use super::super::rotation::{from_xyzw, to_xyzw};
use super::super::symmetric::{symmetric, upper_triangle};
use super::super::{IoError, Location};
use super::landmarks::{add_measurements, put_measurements};
use super::{G2oEdge, G2oFile, G2oPoint, G2oSe2, G2oSe3, G2oVertex};
use crate::factors::RelativePose;
use crate::geometry::{LieGroup, Se2, Se3};
use crate::information::{Information, InformationError};
use crate::problem::PoseGraph;

/// A group whose elements a g2o file writes with `P` numbers.
pub trait G2oPose<const N: usize, const P: usize>: LieGroup<N> {
    /// The element that the numbers stand for; `None` where a quaternion's norm is off by more than 1e-3.
    fn from_numbers(numbers: &[f64; P]) -> Option<Self>;

    /// The numbers of this element.
    fn to_numbers(&self) -> [f64; P];
}

impl G2oPose<3, 3> for Se2 {
    fn from_numbers(&[x, y, theta]: &[f64; 3]) -> Option<Self> {
        Some(Self::from_xy_angle(x, y, theta))
    }

    fn to_numbers(&self) -> [f64; 3] {
        [self.translation.x, self.translation.y, self.rotation.angle()]
    }
}

impl G2oPose<6, 7> for Se3 {
    fn from_numbers(&[x, y, z, qx, qy, qz, qw]: &[f64; 7]) -> Option<Self> {
        let rotation = from_xyzw(&[qx, qy, qz, qw], || Location::record(Path::new(""), 0)).ok()?;
        Some(Self::new(rotation, Vector3::new(x, y, z)))
    }

    fn to_numbers(&self) -> [f64; 7] {
        let ([x, y, z], [qx, qy, qz, qw]) = (self.translation.into(), to_xyzw(&self.rotation));
        [x, y, z, qx, qy, qz, qw]
    }
}

impl<const P: usize> G2oVertex<P> {
    /// The vertex `id` at `pose`.
    pub fn new<G: G2oPose<N, P>, const N: usize>(id: i64, pose: &G) -> Self {
        Self { id, pose: pose.to_numbers() }
    }
}

impl<const P: usize, const U: usize> G2oEdge<P, U> {
    /// The edge from vertex `i` to vertex `j`.
    pub fn new<G: G2oPose<N, P>, const N: usize>(
        i: i64,
        j: i64,
        i_from_j: &G,
        information: &Information<N>,
    ) -> Self {
        let information = upper_triangle(information.matrix());
        let i_from_j = i_from_j.to_numbers();
        Self { i, j, i_from_j, information }
    }
}

impl G2oSe2 {
    /// The pose graph; poses are the identity where the file has edges only.
    ///
    /// # Errors
    /// For a file that was not parsed but filled by hand: the first record that a parse would
    /// refuse or change, by its number.
    pub fn to_pose_graph(&self) -> Result<PoseGraph<Se2, 3>, IoError> {
        to_pose_graph(self)
    }
}

impl G2oSe3 {
    /// The pose graph; poses are the identity where the file has edges only.
    ///
    /// # Errors
    /// For a file that was not parsed but filled by hand: the first record that a parse would
    /// refuse or change, by its number.
    pub fn to_pose_graph(&self) -> Result<PoseGraph<Se3, 6>, IoError> {
        to_pose_graph(self)
    }
}

impl<const P: usize, const U: usize> G2oFile<P, U> {
    /// The file of a graph, constant poses and landmarks as `FIX`.
    ///
    /// # Errors
    /// [`IoError::OutOfRange`] where a factor names a variable that the graph does not hold;
    /// [`IoError::UnwritableFactor`] for what g2o has no record of: ranges, a bearing in space, and a
    /// measured position of another point than a pose's origin.
    pub fn from_pose_graph<G: G2oPose<N, P>, const N: usize>(
        graph: &PoseGraph<G, N>,
    ) -> Result<Self, IoError> {
        let id = |index: usize, k: usize| id_at(&graph.ids, index, "pose", "edge", k);
        let mut edges = Vec::with_capacity(graph.edges.len());
        for (k, edge) in graph.edges.iter().enumerate() {
            let (i, j) = (id(edge.i, k)?, id(edge.j, k)?);
            edges.push(G2oEdge::new(i, j, &edge.i_from_j, &edge.information));
        }
        let poses = graph.ids.iter().zip(&graph.constant);
        let landmarks = graph.landmarks.ids.iter().zip(&graph.landmarks.constant);
        let constant = poses.chain(landmarks).filter(|&(_, &constant)| constant);
        let fixed = constant.map(|(&id, _)| id).collect();
        let (vertices, points) = (vertices(graph), points(graph));
        let mut file = Self { vertices, edges, fixed, points, ..Self::default() };
        put_measurements(graph, &mut file)?;
        Ok(file)
    }

    /// Takes the poses and landmarks of a graph that [`G2oSe2::to_pose_graph`] or
    /// [`G2oSe3::to_pose_graph`] made; what was measured stays the file's.
    ///
    /// # Errors
    /// [`IoError::SizeMismatch`] or [`IoError::UnknownId`] where the vertices differ.
    pub fn update_from<G: G2oPose<N, P>, const N: usize>(
        &mut self,
        graph: &PoseGraph<G, N>,
    ) -> Result<(), IoError> {
        let vertices: Vec<G2oVertex<P>> = vertices(graph);
        let points = points(graph);
        if self.has_vertices() {
            let ids = self.vertices.iter().map(|vertex| vertex.id);
            check_ids("vertices", vertices.iter().map(|vertex| vertex.id), ids)?;
            let ids = self.points.iter().map(|point| point.id);
            check_ids("landmarks", points.iter().map(|point| point.id), ids)?;
        }
        (self.vertices, self.points) = (vertices, points);
        Ok(())
    }
}

/// Refuses ids of a graph that are not those of its file.
fn check_ids(
    what: &'static str,
    graph: impl ExactSizeIterator<Item = i64>,
    file: impl ExactSizeIterator<Item = i64>,
) -> Result<(), IoError> {
    let (actual, expected) = (graph.len(), file.len());
    if actual != expected {
        return Err(IoError::SizeMismatch { what, actual, expected });
    }
    match graph.zip(file).enumerate().find(|(_, (new, old))| new != old) {
        Some((k, (id, _))) => {
            let location = Location::record(Path::new("vertex"), k as u64);
            Err(IoError::UnknownId { location, field: "vertex", id: id.into() })
        }
        None => Ok(()),
    }
}

/// The id of the variable that factor `k` of a kind names.
pub(super) fn id_at(
    ids: &[i64],
    index: usize,
    variable: &str,
    factor: &str,
    k: usize,
) -> Result<i64, IoError> {
    ids.get(index).copied().ok_or_else(|| IoError::OutOfRange {
        location: Location::record(Path::new(factor), k as u64),
        field: variable.to_owned(),
        value: index as u64,
        count: ids.len() as u64,
    })
}

/// The element of a group that numbers of record `k` of a kind stand for.
pub(super) fn element<G: G2oPose<N, P>, const N: usize, const P: usize>(
    numbers: &[f64; P],
    kind: &str,
    k: usize,
) -> Result<G, IoError> {
    let norm = numbers.iter().skip(3).map(|c| c * c).sum::<f64>().sqrt();
    let location = || Location::record(Path::new(kind), k as u64);
    G::from_numbers(numbers).ok_or_else(|| IoError::BadQuaternion { location: location(), norm })
}

/// The information matrix of record `k` of a kind, between these ids.
pub(super) fn information_of<const N: usize, const U: usize>(
    upper: &[f64; U],
    kind: &str,
    k: usize,
    ends: (i64, i64),
) -> Result<Information<N>, IoError> {
    let location = Location::record(Path::new(kind), k as u64);
    Information::semidefinite(&symmetric(upper)).map_err(|error| refused(error, location, ends, 1))
}

/// Indices of poses and landmarks by id.
pub(super) struct Indices {
    pub(super) poses: BTreeMap<i64, usize>,
    pub(super) landmarks: BTreeMap<i64, usize>,
}

impl Indices {
    /// The index of the pose that record `k` of a kind names.
    pub(super) fn pose(&self, id: i64, kind: &str, k: usize) -> Result<usize, IoError> {
        let location = || Location::record(Path::new(kind), k as u64);
        let unknown =
            || IoError::UnknownId { location: location(), field: "vertex", id: id.into() };
        self.poses.get(&id).copied().ok_or_else(unknown)
    }
}

fn to_pose_graph<G: G2oPose<N, P>, const N: usize, const P: usize, const U: usize>(
    file: &G2oFile<P, U>,
) -> Result<PoseGraph<G, N>, IoError> {
    let location = |kind: &str, k: usize| Location::record(Path::new(kind), k as u64);
    let twice = |k: usize, id: i64| {
        let location = location("vertex", k);
        Err(IoError::DuplicateId { location, field: "vertex", id: id.into() })
    };
    let mut graph = PoseGraph::new();
    let mut indices = Indices { poses: BTreeMap::new(), landmarks: BTreeMap::new() };
    for (k, vertex) in file.vertices.iter().enumerate() {
        let index = graph.push_pose(vertex.id, element(&vertex.pose, "vertex", k)?);
        if indices.poses.insert(vertex.id, index).is_some() {
            return twice(k, vertex.id);
        }
    }
    for (k, point) in file.points.iter().enumerate() {
        let index = graph.landmarks.push(point.id, point.position.into());
        let is_pose = indices.poses.contains_key(&point.id);
        if indices.landmarks.insert(point.id, index).is_some() || is_pose {
            return twice(k, point.id);
        }
    }
    if !file.has_vertices() {
        for id in file.ids_of_poses() {
            indices.poses.insert(id, graph.push_pose(id, G::identity()));
        }
        for id in file.sightings.iter().map(|seen| seen.point).collect::<BTreeSet<i64>>() {
            let add = || graph.landmarks.push(id, Vector3::zeros());
            indices.landmarks.entry(id).or_insert_with(add);
        }
    }
    for (k, &id) in file.fixed.iter().enumerate() {
        match indices.landmarks.get(&id) {
            Some(&landmark) => graph.landmarks.constant[landmark] = true,
            None => graph.constant[indices.pose(id, "FIX", k)?] = true,
        }
    }
    graph.edges.reserve(file.edges.len());
    for (k, edge) in file.edges.iter().enumerate() {
        let (i, j) = (indices.pose(edge.i, "edge", k)?, indices.pose(edge.j, "edge", k)?);
        if i == j {
            return Err(IoError::SelfEdge { location: location("edge", k), id: edge.i });
        }
        let i_from_j = element(&edge.i_from_j, "edge", k)?;
        let information = information_of(&edge.information, "edge", k, (edge.i, edge.j))?;
        graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
    }
    add_measurements(file, &indices, &mut graph)?;
    Ok(graph)
}

impl<const P: usize, const U: usize> G2oFile<P, U> {
    /// The ids of poses that records other than vertices name.
    fn ids_of_poses(&self) -> BTreeSet<i64> {
        let edges = self.edges.iter().flat_map(|edge| [edge.i, edge.j]);
        let seen_from = self.sightings.iter().map(|sighting| sighting.pose);
        let priors = self.pose_priors.iter().map(|prior| prior.id);
        edges.chain(seen_from).chain(priors).collect()
    }
}

/// The refusal of the first of `count` information matrices, that of edge (i, j).
pub(super) fn refused(
    error: InformationError,
    first: Location,
    (i, j): (i64, i64),
    count: usize,
) -> IoError {
    match error {
        InformationError::Indefinite { smallest_eigenvalue } => {
            IoError::IndefiniteInformation { first, i, j, smallest_eigenvalue, count }
        }
        // A triangle is symmetric.
        InformationError::NotFinite { .. }
        | InformationError::NotSymmetric { .. }
        | InformationError::NotPositiveDefinite => {
            IoError::NotFinite { location: first, field: "information".to_owned() }
        }
    }
}

/// The vertex lines of a graph.
fn vertices<G: G2oPose<N, P>, const N: usize, const P: usize>(
    graph: &PoseGraph<G, N>,
) -> Vec<G2oVertex<P>> {
    graph.ids.iter().zip(&graph.poses).map(|(&id, pose)| G2oVertex::new(id, pose)).collect()
}

/// The lines of landmarks of a graph.
fn points<G, const N: usize>(graph: &PoseGraph<G, N>) -> Vec<G2oPoint> {
    let landmarks = graph.landmarks.ids.iter().zip(&graph.landmarks.positions);
    landmarks.map(|(&id, &position)| G2oPoint { id, position: position.into() }).collect()
}
