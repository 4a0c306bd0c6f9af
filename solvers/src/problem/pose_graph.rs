//! A pose graph: poses of one group tied by relative-pose factors, some of them measured in the world.
//!
//! A factor between poses i and j with measurement Z = `i_from_j` has the residual
//! r = Log(Z⁻¹ · X_i⁻¹ · X_j) in the full group logarithm, X = `world_from_pose`. Priors measure one
//! pose, or the position of a point that is fixed to it; landmarks are points that poses measure. It
//! holds, checks and finds pieces; no residual is evaluated here.

use std::collections::BTreeMap;

use super::pose_factors::{check_priors, check_relative_poses};
use super::{DisjointSets, Landmarks, SolveError};
use crate::factors::{PosePrior, PositionPrior, Range, RangeEnd, RelativePose};
use crate::geometry::LieGroup;
use crate::lists::Lists;
use crate::loss::Loss;

/// Poses of one group and the factors between them.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseGraph<G, const N: usize> {
    /// The caller's id of each pose; errors name poses by it.
    pub ids: Vec<i64>,
    /// `world_from_pose`, the start of a solve and its result.
    pub poses: Vec<G>,
    /// Poses that stay where they are (the gauge); one flag a pose.
    pub constant: Vec<bool>,
    /// The factors between poses.
    pub edges: Vec<RelativePose<G, N>>,
    /// Measured poses.
    pub pose_priors: Vec<PosePrior<G, N>>,
    /// Measured positions of points that are fixed to poses.
    pub position_priors: Vec<PositionPrior>,
    /// Points beside the poses; none in most graphs.
    pub landmarks: Landmarks,
    /// Measured distances between poses and landmarks; none in most graphs.
    pub ranges: Vec<Range>,
    /// The loss of every edge, range and measurement of a landmark that has none of its own; priors have
    /// their own.
    pub loss: Loss,
}

/// A connected component of a graph.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Piece {
    /// The lowest id in it.
    pub lowest_id: i64,
    /// The highest id in it.
    pub highest_id: i64,
    /// How many poses it has.
    pub size: usize,
}

impl Piece {
    /// One readable line for a list of pieces, the first five spelled out.
    #[must_use]
    pub fn describe(pieces: &[Self]) -> String {
        Self::describe_as(pieces, |id| id.to_string())
    }

    /// As [`Self::describe`], with a name for each id.
    #[must_use]
    pub fn describe_as(pieces: &[Self], name: impl Fn(i64) -> String) -> String {
        let mut parts: Vec<String> = pieces
            .iter()
            .take(5)
            .map(|p| match p.size {
                1 => format!("vertex {}", name(p.lowest_id)),
                n => {
                    let (lowest, highest) = (name(p.lowest_id), name(p.highest_id));
                    format!("{n} vertices from {lowest} to {highest}")
                }
            })
            .collect();
        if pieces.len() > parts.len() {
            parts.push(format!("and {} more", pieces.len() - parts.len()));
        }
        parts.join("; ")
    }
}

impl<G: LieGroup<N>, const N: usize> PoseGraph<G, N> {
    /// A graph without poses, with trivial loss.
    #[must_use]
    pub fn new() -> Self {
        Self {
            ids: Vec::new(),
            poses: Vec::new(),
            constant: Vec::new(),
            edges: Vec::new(),
            pose_priors: Vec::new(),
            position_priors: Vec::new(),
            landmarks: Landmarks::default(),
            ranges: Vec::new(),
            loss: Loss::Trivial,
        }
    }

    /// Appends a pose that may move and returns its index.
    pub fn push_pose(&mut self, id: i64, world_from_pose: G) -> usize {
        self.ids.push(id);
        self.poses.push(world_from_pose);
        self.constant.push(false);
        self.poses.len() - 1
    }

    /// Holds the pose with the lowest id fixed, the convention for graph files.
    pub fn fix_lowest_id(&mut self) {
        if let Some(index) = self.lowest_id() {
            self.constant[index] = true;
        }
    }

    /// Whether there are landmarks or ranges beside the poses and their factors.
    #[must_use]
    pub fn has_measured(&self) -> bool {
        !(self.landmarks.is_empty() && self.ranges.is_empty())
    }

    /// Whether there is a prior of either kind.
    #[must_use]
    pub fn has_priors(&self) -> bool {
        !(self.pose_priors.is_empty() && self.position_priors.is_empty())
    }

    /// The poses that have a place in the world: the constant ones, then one entry a prior.
    pub fn placed(&self) -> impl Iterator<Item = usize> + '_ {
        let constant = (0..self.poses.len()).filter(|&pose| self.constant[pose]);
        let whole = self.pose_priors.iter().map(|prior| prior.pose);
        constant.chain(whole).chain(self.position_priors.iter().map(|prior| prior.pose))
    }

    /// Whether something besides constant poses gives the graph a place in the world: a prior, or a
    /// landmark that is constant or measured from the world.
    fn is_anchored(&self) -> bool {
        self.has_priors() || self.landmarks.are_anchored()
    }

    /// Holds the pose with the lowest id fixed where nothing else gives the graph a place in the
    /// world: no constant pose, no prior, and no landmark that is constant or measured from the world.
    pub fn hold_gauge(&mut self) {
        if !self.constant.contains(&true) && !self.is_anchored() {
            self.fix_lowest_id();
        }
    }

    /// The edges at each pose, in their order; one of a pose with itself is there twice.
    pub(crate) fn edges_of_poses(&self) -> Lists<usize> {
        let edges = self.edges.iter().enumerate();
        let ends = edges.flat_map(|(edge, factor)| [(factor.i, edge), (factor.j, edge)]);
        Lists::new(self.poses.len(), ends)
    }

    /// The index of the pose with the lowest id.
    fn lowest_id(&self) -> Option<usize> {
        (0..self.ids.len()).min_by_key(|&pose| self.ids[pose])
    }

    /// The poses that hold the gauge of the edges alone: the constant ones; without one, that with the
    /// lowest id.
    pub(crate) fn held(&self) -> Vec<usize> {
        let constant: Vec<usize> = (0..self.poses.len()).filter(|&i| self.constant[i]).collect();
        if constant.is_empty() { self.lowest_id().into_iter().collect() } else { constant }
    }

    /// The poses that [`Self::held`] leaves free, and the index of each pose among them.
    pub(crate) fn free_poses(&self) -> (Vec<usize>, Vec<Option<usize>>) {
        self.others(&self.held())
    }

    /// As [`Self::free_poses`] for all factors: priors hold no pose, and none is held beside them.
    pub(crate) fn free_poses_of_solve(&self) -> (Vec<usize>, Vec<Option<usize>>) {
        let has_constant = self.constant.contains(&true);
        if self.is_anchored() && !has_constant { self.others(&[]) } else { self.free_poses() }
    }

    /// The poses that are not in `held`, which rises, and the index of each pose among them.
    fn others(&self, held: &[usize]) -> (Vec<usize>, Vec<Option<usize>>) {
        let is_free = |pose: &usize| held.binary_search(pose).is_err();
        let poses: Vec<usize> = (0..self.poses.len()).filter(is_free).collect();
        let mut index_of = vec![None; self.poses.len()];
        for (index, &pose) in poses.iter().enumerate() {
            index_of[pose] = Some(index);
        }
        (poses, index_of)
    }

    /// The indices among the free poses of both poses of each edge.
    pub(crate) fn free_indices_of_edges<'a>(
        &'a self,
        index_of: &'a [Option<usize>],
    ) -> impl Iterator<Item = (Option<usize>, Option<usize>)> + Clone + 'a {
        self.edges.iter().map(|edge| (index_of[edge.i], index_of[edge.j]))
    }

    /// Checks that lengths and indices agree, ids are unique, every number is finite and the graph
    /// is in one piece (counting all constant poses and all that have a prior as one, since each of
    /// them has a place in the world, and all that landmarks and ranges tie together).
    ///
    /// # Errors
    /// The first [`SolveError`] found.
    pub fn validate(&self) -> Result<(), SolveError> {
        let count = self.poses.len();
        for (what, actual) in [("ids", self.ids.len()), ("constant", self.constant.len())] {
            if actual != count {
                return Err(SolveError::LengthMismatch { what, actual, expected: count });
            }
        }
        let is_measured = !(self.landmarks.measurements.is_empty() && self.ranges.is_empty());
        if self.edges.is_empty() && !self.has_priors() && !is_measured {
            return Err(SolveError::Empty("the graph has no edges"));
        }
        if !self.loss.is_valid() {
            return Err(SolveError::InvalidOption {
                field: "loss",
                reason: "the width must be finite and positive",
            });
        }
        let mut index_of = BTreeMap::new();
        for (index, (&id, pose)) in self.ids.iter().zip(&self.poses).enumerate() {
            if index_of.insert(id, index).is_some() {
                return Err(SolveError::DuplicateId { what: "pose", id });
            }
            if !pose.is_finite() {
                return Err(SolveError::NotFinite { what: "pose", index: id });
            }
        }
        check_relative_poses("edge", &self.edges, count)?;
        check_priors(&self.pose_priors, &self.position_priors, count)?;
        self.landmarks.validate(count, &index_of)?;
        self.check_ranges()?;
        let pieces = self.pieces();
        if pieces.len() > 1 {
            return Err(SolveError::Disconnected { pieces });
        }
        Ok(())
    }

    /// What measurements of landmarks and ranges tie together: sets of the poses, then the landmarks.
    /// Landmarks that are anchored are one with each other.
    pub(crate) fn ties(&self) -> DisjointSets {
        let poses = self.poses.len();
        let mut sets = DisjointSets::new(poses + self.landmarks.len());
        sets.join_all(self.landmarks.anchored().map(|landmark| poses + landmark));
        for measurement in &self.landmarks.measurements {
            if let Some(pose) = measurement.pose {
                sets.join(pose, poses + measurement.landmark);
            }
        }
        for range in &self.ranges {
            let [a, b] = range.ends.map(|end| match end {
                RangeEnd::Pose(pose) => pose,
                RangeEnd::Landmark(landmark) => poses + landmark,
            });
            sets.join(a, b);
        }
        sets
    }

    /// The connected components, the one with the lowest id first. Constant poses and those that have
    /// a prior hang together, and so do those that landmarks and ranges tie together.
    #[must_use]
    pub fn pieces(&self) -> Vec<Piece> {
        let mut sets = self.ties();
        for edge in &self.edges {
            sets.join(edge.i, edge.j);
        }
        sets.join_all(self.placed());
        let mut pieces: BTreeMap<usize, Piece> = BTreeMap::new();
        for (index, &id) in self.ids.iter().enumerate() {
            let piece = pieces.entry(sets.root(index)).or_insert(Piece {
                lowest_id: id,
                highest_id: id,
                size: 0,
            });
            piece.lowest_id = piece.lowest_id.min(id);
            piece.highest_id = piece.highest_id.max(id);
            piece.size += 1;
        }
        let mut pieces: Vec<Piece> = pieces.into_values().collect();
        pieces.sort_unstable_by_key(|p| p.lowest_id);
        pieces
    }
}

impl<G: LieGroup<N>, const N: usize> Default for PoseGraph<G, N> {
    fn default() -> Self {
        Self::new()
    }
}
