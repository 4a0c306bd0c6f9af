//! pyfg files to pose graphs and back, and to g2o's files and back.
//!
//! Pose k of the graph is pose k of the file, and its id that of its name ([`PyfgName::id`]). A covariance Σ
//! becomes the information Σ⁻¹. A file has no record that holds a variable: where nothing else gives the
//! graph a place in the world, the first pose of the file is constant. g2o's ids are positions in the file.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Matrix2, Vector3};

use super::super::g2o::{G2oFile, G2oGraph, G2oPose};
use super::super::symmetric::{symmetric, upper_triangle};
use super::super::{IoError, Location};
use super::{
    PyfgEdge, PyfgFile, PyfgGraph, PyfgLandmark, PyfgLandmarkPrior, PyfgName, PyfgPose,
    PyfgPosePrior, PyfgRange, PyfgSe2, PyfgSe3, PyfgSighting, PyfgTime,
};
use crate::factors::{LandmarkMeasurement, PosePrior, Range, RangeEnd, RelativePose, Sighting};
use crate::geometry::{Se2, Se3};
use crate::information::{Covariance, Information};
use crate::loss::Loss;
use crate::problem::{PoseGraph, SolveError};

/// The information of a covariance; `None` where that is not positive definite or has no finite inverse.
pub(super) fn information<const N: usize, const U: usize>(
    covariance: &[f64; U],
) -> Option<Information<N>> {
    let information = Covariance::<N>::new(&symmetric(covariance)).ok()?.information().ok()?;
    // Rounding leaves an inverse not quite symmetric.
    let matrix = information.matrix() * 0.5 + information.matrix().transpose() * 0.5;
    Information::new(&matrix).ok()
}

/// As [`information`], of a position in the plane, whose z has none, or in space.
pub(super) fn position_information(covariance: &[f64; 6], space: usize) -> Option<Information<3>> {
    if space == 3 {
        return information(covariance);
    }
    let [xx, xy, _, yy, ..] = *covariance;
    let plane = information::<2, 3>(&[xx, xy, yy])?;
    Information::semidefinite(&plane.matrix().fixed_resize::<3, 3>(0.0)).ok()
}

/// 1/σ² of a variance; `None` where either is not positive and finite.
pub(super) fn precision(variance: f64) -> Option<f64> {
    let is_positive = |value: &f64| value.is_finite() && *value > 0.0;
    Some(variance).filter(is_positive).map(|variance| 1.0 / variance).filter(is_positive)
}

/// The upper triangle of the covariance of a position, zero where the plane has no z.
fn position_covariance(information: &Information<3>, space: usize) -> Option<[f64; 6]> {
    let covariance = if space == 3 {
        *information.covariance().ok()?.matrix()
    } else {
        let plane: Matrix2<f64> = information.matrix().fixed_view::<2, 2>(0, 0).into_owned();
        let covariance = Information::new(&plane).ok()?.covariance().ok()?;
        covariance.matrix().fixed_resize::<3, 3>(0.0)
    };
    let upper = upper_triangle::<3, 6>(&covariance);
    position_information(&upper, space).map(|_| upper)
}

/// Where a record is of a file that was filled by hand.
fn at(kind: &str, k: usize) -> Location {
    Location::record(Path::new(kind), k as u64)
}

impl PyfgSe2 {
    /// The pose graph.
    ///
    /// # Errors
    /// For a file that was not parsed but filled by hand: the first record that a parse would refuse, by
    /// its number.
    pub fn to_pose_graph(&self) -> Result<PoseGraph<Se2, 3>, IoError> {
        to_pose_graph(self)
    }
}

impl PyfgSe3 {
    /// The pose graph.
    ///
    /// # Errors
    /// For a file that was not parsed but filled by hand: the first record that a parse would refuse, by
    /// its number.
    pub fn to_pose_graph(&self) -> Result<PoseGraph<Se3, 6>, IoError> {
        to_pose_graph(self)
    }
}

impl PyfgGraph {
    /// The same graph as a g2o file. Its ids are the positions of the poses in the file, then those of the
    /// landmarks.
    ///
    /// # Errors
    /// [`IoError::UnwritableFactor`] for a range, which g2o does not have.
    pub fn to_g2o(&self) -> Result<G2oGraph, IoError> {
        fn made<G, const N: usize, const P: usize, const U: usize>(
            mut graph: PoseGraph<G, N>,
        ) -> Result<G2oFile<P, U>, IoError>
        where
            G: G2oPose<N, P>,
        {
            let ids = graph.ids.iter_mut().chain(&mut graph.landmarks.ids);
            ids.zip(0..).for_each(|(id, number)| *id = number);
            G2oFile::from_pose_graph(&graph)
        }
        Ok(match self {
            Self::Se2(file) => G2oGraph::Se2(made::<_, 3, 3, 6>(file.to_pose_graph()?)?),
            Self::Se3(file) => G2oGraph::Se3(made::<_, 6, 7, 21>(file.to_pose_graph()?)?),
        })
    }

    /// A g2o file as one of this format: pose 12 is `A12` at 12 s, landmark 3 is `L3`.
    ///
    /// # Errors
    /// [`IoError::Empty`] for a file of edges only; [`IoError::UnwritableFactor`] for what this format does
    /// not have: bearings, priors on positions of poses, variables that are fixed beside the first pose,
    /// information without an inverse, ids that are negative or at least 2^48.
    pub fn from_g2o(graph: &G2oGraph) -> Result<Self, IoError> {
        if !graph.has_vertices() {
            return Err(IoError::Empty { path: "g2o".into(), what: "vertex" });
        }
        Ok(match graph {
            G2oGraph::Se2(file) => {
                Self::Se2(PyfgSe2::from_pose_graph(&named(file.to_pose_graph()?)?)?)
            }
            G2oGraph::Se3(file) => {
                Self::Se3(PyfgSe3::from_pose_graph(&named(file.to_pose_graph()?)?)?)
            }
        })
    }
}

/// The graph with ids of names in place of numbers.
fn named<G, const N: usize>(mut graph: PoseGraph<G, N>) -> Result<PoseGraph<G, N>, IoError> {
    for (letter, factor, ids) in
        [('A', "pose", &mut graph.ids), ('L', "landmark", &mut graph.landmarks.ids)]
    {
        for (index, id) in ids.iter_mut().enumerate() {
            let name = u64::try_from(*id).ok().and_then(|number| PyfgName::new(letter, number));
            let reason = "pyfg has numbers from 0 to 2^48 - 1 only";
            *id = name.ok_or(IoError::UnwritableFactor { factor, index, reason })?.id();
        }
    }
    Ok(graph)
}

impl<const P: usize, const U: usize> PyfgFile<P, U> {
    /// The letters of the poses, rising.
    #[must_use]
    pub fn robots(&self) -> Vec<char> {
        let mut letters: Vec<char> = self.poses.iter().map(|pose| pose.name.letter()).collect();
        letters.sort_unstable();
        letters.dedup();
        letters
    }

    /// The file of a graph whose ids are those of names. Times are the numbers of the first name of a
    /// record, in seconds.
    ///
    /// # Errors
    /// [`IoError::UnwritableFactor`] for what the format does not have: an id that no name has, bearings,
    /// priors on positions of poses, constant variables other than the first pose of a graph that nothing
    /// else holds, information without an inverse.
    pub fn from_pose_graph<G: G2oPose<N, P>, const N: usize>(
        graph: &PoseGraph<G, N>,
    ) -> Result<Self, IoError> {
        let unwritable =
            |factor, index, reason| IoError::UnwritableFactor { factor, index, reason };
        // A graph in pieces or without factors is a file all the same.
        let is_file = |error: &SolveError| {
            matches!(error, SolveError::Disconnected { .. } | SolveError::Empty(_))
        };
        if graph.validate().is_err_and(|error| !is_file(&error)) {
            return Err(unwritable("graph", 0, "it is not valid"));
        }
        let name = |ids: &[i64], index: usize, kind| {
            PyfgName::from_id(ids[index])
                .ok_or_else(|| unwritable(kind, index, "its id is not that of a name"))
        };
        let pose_name = |pose| name(&graph.ids, pose, "pose");
        let landmark_name = |landmark| name(&graph.landmarks.ids, landmark, "landmark");
        let time = |name: PyfgName| PyfgTime::from(name.number() as i64);
        let no_covariance = "its information has no inverse";
        let covariance = |information: &Information<N>, factor, k| {
            let covariance = information.covariance().ok();
            let upper = covariance.map(|covariance| upper_triangle::<N, U>(covariance.matrix()));
            upper
                .filter(|upper| self::information::<N, U>(upper).is_some())
                .ok_or_else(|| unwritable(factor, k, no_covariance))
        };
        let held =
            |factor, k| unwritable(factor, k, "pyfg has no fixed variables but the first pose");
        let is_anchored = graph.has_priors() || graph.landmarks.are_anchored();
        let mut file = Self::default();
        for (k, (pose, &constant)) in graph.poses.iter().zip(&graph.constant).enumerate() {
            if constant && (k > 0 || is_anchored) {
                return Err(held("pose", k));
            }
            let name = pose_name(k)?;
            file.poses.push(PyfgPose { time: time(name), name, pose: pose.to_numbers() });
        }
        for (k, &position) in graph.landmarks.positions.iter().enumerate() {
            if graph.landmarks.constant[k] {
                return Err(held("landmark", k));
            }
            file.landmarks
                .push(PyfgLandmark { name: landmark_name(k)?, position: position.into() });
        }
        if !graph.position_priors.is_empty() {
            let reason = "pyfg has no priors on positions of poses";
            return Err(unwritable("prior on a position", 0, reason));
        }
        for (k, prior) in graph.pose_priors.iter().enumerate() {
            let name = pose_name(prior.pose)?;
            let world_from_pose = prior.world_from_camera.to_numbers();
            let covariance = covariance(&prior.information, "prior on a pose", k)?;
            let prior = PyfgPosePrior { time: time(name), name, world_from_pose, covariance };
            file.pose_priors.push(prior);
        }
        for (k, measured) in graph.landmarks.measurements.iter().enumerate() {
            let factor = "measurement of a landmark";
            let Sighting::Position(position) = measured.sighting else {
                return Err(unwritable(factor, k, "pyfg has no bearings"));
            };
            let landmark = landmark_name(measured.landmark)?;
            let covariance = position_covariance(&measured.information, Self::SPACE)
                .ok_or_else(|| unwritable(factor, k, no_covariance))?;
            let position = position.into();
            match measured.pose.map(pose_name).transpose()? {
                Some(pose) => {
                    let time = time(pose);
                    let seen = PyfgSighting { time, pose, landmark, position, covariance };
                    file.sightings.push(seen);
                }
                None => {
                    let (time, name) = (time(landmark), landmark);
                    let prior = PyfgLandmarkPrior { time, name, position, covariance };
                    file.landmark_priors.push(prior);
                }
            }
        }
        for (k, edge) in graph.edges.iter().enumerate() {
            let (i, j) = (pose_name(edge.i)?, pose_name(edge.j)?);
            if i == j {
                return Err(unwritable("edge", k, "it connects a pose to itself"));
            }
            let covariance = covariance(&edge.information, "edge", k)?;
            let i_from_j = edge.i_from_j.to_numbers();
            file.edges.push(PyfgEdge { time: time(i), i, j, i_from_j, covariance });
        }
        for (k, range) in graph.ranges.iter().enumerate() {
            let end = |end| match end {
                RangeEnd::Pose(pose) => pose_name(pose),
                RangeEnd::Landmark(landmark) => landmark_name(landmark),
            };
            let ends = [end(range.ends[0])?, end(range.ends[1])?];
            let variance =
                precision(range.precision).ok_or_else(|| unwritable("range", k, no_covariance))?;
            let (time, distance_m) = (time(ends[0]), range.distance_m);
            file.ranges.push(PyfgRange { time, ends, distance_m, variance });
        }
        Ok(file)
    }

    /// Takes the poses and landmarks of a graph that [`PyfgSe2::to_pose_graph`] or
    /// [`PyfgSe3::to_pose_graph`] made; names, times and what was measured stay the file's.
    ///
    /// # Errors
    /// [`IoError::SizeMismatch`] where the graph has other variables.
    pub fn update_from<G: G2oPose<N, P>, const N: usize>(
        &mut self,
        graph: &PoseGraph<G, N>,
    ) -> Result<(), IoError> {
        let landmarks = &graph.landmarks;
        for (what, actual, expected) in [
            ("poses", graph.poses.len(), self.poses.len()),
            ("landmarks", landmarks.len(), self.landmarks.len()),
        ] {
            if actual != expected {
                return Err(IoError::SizeMismatch { what, actual, expected });
            }
        }
        for (own, pose) in self.poses.iter_mut().zip(&graph.poses) {
            own.pose = pose.to_numbers();
        }
        for (own, &position) in self.landmarks.iter_mut().zip(&landmarks.positions) {
            own.position = position.into();
        }
        Ok(())
    }
}

/// Indices of variables by name.
#[derive(Default)]
struct Indices(BTreeMap<PyfgName, RangeEnd>);

impl Indices {
    fn insert(&mut self, name: PyfgName, end: RangeEnd, k: usize) -> Result<(), IoError> {
        match self.0.insert(name, end) {
            None => Ok(()),
            Some(_) => Err(unfit("vertex", name, "occurs twice", at("vertex", k))),
        }
    }

    fn pose(&self, name: PyfgName, kind: &str, k: usize) -> Result<usize, IoError> {
        match self.0.get(&name) {
            Some(RangeEnd::Pose(pose)) => Ok(*pose),
            Some(RangeEnd::Landmark(_)) | None => {
                Err(unfit("pose", name, "does not exist", at(kind, k)))
            }
        }
    }

    fn landmark(&self, name: PyfgName, kind: &str, k: usize) -> Result<usize, IoError> {
        match self.0.get(&name) {
            Some(RangeEnd::Landmark(landmark)) => Ok(*landmark),
            Some(RangeEnd::Pose(_)) | None => {
                Err(unfit("landmark", name, "does not exist", at(kind, k)))
            }
        }
    }
}

fn unfit(field: &'static str, name: PyfgName, reason: &'static str, location: Location) -> IoError {
    IoError::Name { location, field, name: name.to_string(), reason }
}

fn element<G: G2oPose<N, P>, const N: usize, const P: usize>(
    numbers: &[f64; P],
    kind: &str,
    k: usize,
) -> Result<G, IoError> {
    let norm = numbers.iter().skip(3).map(|c| c * c).sum::<f64>().sqrt();
    G::from_numbers(numbers).ok_or_else(|| IoError::BadQuaternion { location: at(kind, k), norm })
}

fn to_pose_graph<G: G2oPose<N, P>, const N: usize, const P: usize, const U: usize>(
    file: &PyfgFile<P, U>,
) -> Result<PoseGraph<G, N>, IoError> {
    let space = PyfgFile::<P, U>::SPACE;
    let covariance =
        |kind: &str, k: usize| IoError::Covariance { location: at(kind, k), field: "covariance" };
    let mut graph = PoseGraph::new();
    let mut indices = Indices::default();
    for (k, PyfgPose { name, pose, .. }) in file.poses.iter().enumerate() {
        let index = graph.push_pose(name.id(), element(pose, "vertex", k)?);
        indices.insert(*name, RangeEnd::Pose(index), k)?;
    }
    for (k, PyfgLandmark { name, position }) in file.landmarks.iter().enumerate() {
        let index = graph.landmarks.push(name.id(), Vector3::from(*position));
        indices.insert(*name, RangeEnd::Landmark(index), k)?;
    }
    for (k, prior) in file.pose_priors.iter().enumerate() {
        let kind = "prior on a pose";
        graph.pose_priors.push(PosePrior {
            pose: indices.pose(prior.name, kind, k)?,
            world_from_camera: element(&prior.world_from_pose, kind, k)?,
            information: information(&prior.covariance).ok_or_else(|| covariance(kind, k))?,
            loss: Loss::Trivial,
        });
    }
    let measured = |position: [f64; 3], upper: &[f64; 6], kind: &str, k: usize| {
        let information = position_information(upper, space).ok_or_else(|| covariance(kind, k))?;
        Ok::<_, IoError>((Sighting::Position(position.into()), information))
    };
    for (k, prior) in file.landmark_priors.iter().enumerate() {
        let kind = "prior on a landmark";
        let (sighting, information) = measured(prior.position, &prior.covariance, kind, k)?;
        let landmark = indices.landmark(prior.name, kind, k)?;
        let loss = Some(Loss::Trivial);
        let prior = LandmarkMeasurement { pose: None, landmark, sighting, information, loss };
        graph.landmarks.measurements.push(prior);
    }
    for (k, seen) in file.sightings.iter().enumerate() {
        let kind = "measurement of a landmark";
        let (sighting, information) = measured(seen.position, &seen.covariance, kind, k)?;
        let pose = Some(indices.pose(seen.pose, kind, k)?);
        let landmark = indices.landmark(seen.landmark, kind, k)?;
        let seen = LandmarkMeasurement { pose, landmark, sighting, information, loss: None };
        graph.landmarks.measurements.push(seen);
    }
    for (k, edge) in file.edges.iter().enumerate() {
        let (i, j) = (indices.pose(edge.i, "edge", k)?, indices.pose(edge.j, "edge", k)?);
        if i == j {
            return Err(unfit("name", edge.i, "is at both ends", at("edge", k)));
        }
        let i_from_j = element(&edge.i_from_j, "edge", k)?;
        let information = information(&edge.covariance).ok_or_else(|| covariance("edge", k))?;
        graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
    }
    for (k, range) in file.ranges.iter().enumerate() {
        let end = |name: PyfgName| {
            let end = indices.0.get(&name).copied();
            end.ok_or_else(|| unfit("pose or landmark", name, "does not exist", at("range", k)))
        };
        let [a, b] = range.ends;
        if a == b {
            return Err(unfit("name", a, "is at both ends", at("range", k)));
        }
        let precision = precision(range.variance)
            .ok_or_else(|| IoError::Covariance { location: at("range", k), field: "variance" })?;
        let (ends, distance_m) = ([end(a)?, end(b)?], range.distance_m);
        graph.ranges.push(Range { ends, distance_m, precision, loss: None });
    }
    if !graph.has_priors()
        && !graph.landmarks.are_anchored()
        && let Some(first) = graph.constant.first_mut()
    {
        *first = true;
    }
    Ok(graph)
}
