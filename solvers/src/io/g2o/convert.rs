//! g2o files to pose graphs and back.
//!
//! Pose k of the graph is vertex k of the file; in a file of edges only it is the k-th lowest id.
//! `FIX` makes a pose constant; without it the gauge is the caller's (the lowest id, by convention).

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::{SMatrix, Vector3};

use super::super::rotation::{from_xyzw, to_xyzw};
use super::super::{IoError, Location};
use super::{G2oEdge, G2oFile, G2oSe2, G2oSe3, G2oVertex};
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

/// The symmetric matrix of an upper triangle, row by row.
pub(super) fn symmetric<const N: usize, const U: usize>(upper: &[f64; U]) -> SMatrix<f64, N, N> {
    let mut matrix = SMatrix::<f64, N, N>::zeros();
    let entries = (0..N).flat_map(|row| (row..N).map(move |column| (row, column)));
    for ((row, column), &entry) in entries.zip(upper) {
        matrix[(row, column)] = entry;
        matrix[(column, row)] = entry;
    }
    matrix
}

/// The upper triangle of a matrix, row by row.
pub(super) fn upper_triangle<const N: usize, const U: usize>(
    information: &Information<N>,
) -> [f64; U] {
    let mut upper = [0.0; U];
    let pairs = (0..N).flat_map(|row| (row..N).map(move |column| (row, column)));
    for (entry, at) in upper.iter_mut().zip(pairs) {
        *entry = information.matrix()[at];
    }
    upper
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
        let (i_from_j, information) = (i_from_j.to_numbers(), upper_triangle(information));
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
    /// The file of a graph, constant poses as `FIX`.
    ///
    /// # Errors
    /// [`IoError::OutOfRange`] where an edge names a pose that the graph does not hold.
    pub fn from_pose_graph<G: G2oPose<N, P>, const N: usize>(
        graph: &PoseGraph<G, N>,
    ) -> Result<Self, IoError> {
        let id = |index: usize, k: usize| {
            graph.ids.get(index).copied().ok_or_else(|| IoError::OutOfRange {
                location: Location::record(Path::new("edge"), k as u64),
                field: "pose".to_owned(),
                value: index as u64,
                count: graph.ids.len() as u64,
            })
        };
        let mut edges = Vec::with_capacity(graph.edges.len());
        for (k, edge) in graph.edges.iter().enumerate() {
            let (i, j) = (id(edge.i, k)?, id(edge.j, k)?);
            edges.push(G2oEdge::new(i, j, &edge.i_from_j, &edge.information));
        }
        let constant = graph.ids.iter().zip(&graph.constant).filter(|&(_, &constant)| constant);
        let fixed = constant.map(|(&id, _)| id).collect();
        Ok(Self { vertices: vertices(graph), edges, fixed })
    }

    /// Takes the poses of a graph that [`G2oSe2::to_pose_graph`] or [`G2oSe3::to_pose_graph`] made;
    /// edges stay the file's.
    ///
    /// # Errors
    /// [`IoError::SizeMismatch`] or [`IoError::UnknownId`] where the vertices differ.
    pub fn update_from<G: G2oPose<N, P>, const N: usize>(
        &mut self,
        graph: &PoseGraph<G, N>,
    ) -> Result<(), IoError> {
        let vertices: Vec<G2oVertex<P>> = vertices(graph);
        if self.has_vertices() {
            let (actual, expected) = (vertices.len(), self.vertices.len());
            if actual != expected {
                return Err(IoError::SizeMismatch { what: "vertices", actual, expected });
            }
            for (k, (new, old)) in vertices.iter().zip(&self.vertices).enumerate() {
                if new.id != old.id {
                    let location = Location::record(Path::new("vertex"), k as u64);
                    return Err(IoError::UnknownId {
                        location,
                        field: "vertex",
                        id: new.id.into(),
                    });
                }
            }
        }
        self.vertices = vertices;
        Ok(())
    }
}

fn to_pose_graph<G: G2oPose<N, P>, const N: usize, const P: usize, const U: usize>(
    file: &G2oFile<P, U>,
) -> Result<PoseGraph<G, N>, IoError> {
    let location = |kind: &str, k: usize| Location::record(Path::new(kind), k as u64);
    let element = |numbers: &[f64; P], kind: &str, k: usize| {
        let norm = numbers.iter().skip(3).map(|c| c * c).sum::<f64>().sqrt();
        G::from_numbers(numbers)
            .ok_or_else(|| IoError::BadQuaternion { location: location(kind, k), norm })
    };
    let mut graph = PoseGraph::new();
    let mut index_of = BTreeMap::new();
    for (k, vertex) in file.vertices.iter().enumerate() {
        let index = graph.push_pose(vertex.id, element(&vertex.pose, "vertex", k)?);
        if index_of.insert(vertex.id, index).is_some() {
            let (location, id) = (location("vertex", k), vertex.id);
            return Err(IoError::DuplicateId { location, field: "vertex", id: id.into() });
        }
    }
    if !file.has_vertices() {
        let ids: BTreeSet<i64> = file.edges.iter().flat_map(|e| [e.i, e.j]).collect();
        for id in ids {
            index_of.insert(id, graph.push_pose(id, G::identity()));
        }
    }
    let find = |id: i64, kind: &str, k: usize| {
        let unknown =
            || IoError::UnknownId { location: location(kind, k), field: "vertex", id: id.into() };
        index_of.get(&id).copied().ok_or_else(unknown)
    };
    for (k, &id) in file.fixed.iter().enumerate() {
        graph.constant[find(id, "FIX", k)?] = true;
    }
    graph.edges.reserve(file.edges.len());
    for (k, edge) in file.edges.iter().enumerate() {
        let (i, j) = (find(edge.i, "edge", k)?, find(edge.j, "edge", k)?);
        if i == j {
            return Err(IoError::SelfEdge { location: location("edge", k), id: edge.i });
        }
        let i_from_j = element(&edge.i_from_j, "edge", k)?;
        let matrix = symmetric(&edge.information);
        let information = Information::semidefinite(&matrix)
            .map_err(|error| refused(error, location("edge", k), (edge.i, edge.j), 1))?;
        graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
    }
    Ok(graph)
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
