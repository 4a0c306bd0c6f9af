//! Which block row of H each variable of a pose graph has.
//!
//! Poses that may move come first, in index order, then the landmarks that may move. It lays out the
//! matrix and fills nothing in.

use crate::factors::RangeEnd;
use crate::geometry::LieGroup;
use crate::linear::BlockPattern;
use crate::problem::{PoseGraph, dimension_of_space};

/// The rows of a graph's variables.
#[derive(Debug)]
pub(super) struct Rows {
    /// The poses that may move, in row order.
    pub(super) free_poses: Vec<usize>,
    /// Row of each pose; `None` where it is held.
    pub(super) of_pose: Vec<Option<usize>>,
    /// The landmarks that may move, in row order.
    pub(super) free_landmarks: Vec<usize>,
    /// Row of each landmark; `None` where it is held.
    pub(super) of_landmark: Vec<Option<usize>>,
}

impl Rows {
    /// The rows of all that a solve of `graph` may move.
    pub(super) fn new<G: LieGroup<N>, const N: usize>(graph: &PoseGraph<G, N>) -> Self {
        let (free_poses, of_pose) = graph.free_poses_of_solve();
        let landmarks = &graph.landmarks;
        let free_landmarks: Vec<usize> =
            (0..landmarks.len()).filter(|&landmark| !landmarks.constant[landmark]).collect();
        let mut of_landmark = vec![None; landmarks.len()];
        for (row, &landmark) in free_landmarks.iter().enumerate() {
            of_landmark[landmark] = Some(free_poses.len() + row);
        }
        Self { free_poses, of_pose, free_landmarks, of_landmark }
    }

    /// How many rows there are.
    pub(super) fn count(&self) -> usize {
        self.free_poses.len() + self.free_landmarks.len()
    }

    /// Row of the variable at an end of a range; `None` where it is held.
    pub(super) fn of_end(&self, end: RangeEnd) -> Option<usize> {
        match end {
            RangeEnd::Pose(pose) => self.of_pose[pose],
            RangeEnd::Landmark(landmark) => self.of_landmark[landmark],
        }
    }

    /// The blocks that the factors of `graph` touch.
    pub(super) fn pattern<G: LieGroup<N>, const N: usize>(
        &self,
        graph: &PoseGraph<G, N>,
    ) -> BlockPattern {
        let mut sizes = vec![N; self.free_poses.len()];
        sizes.resize(self.count(), dimension_of_space(N));
        let edges = graph.free_indices_of_edges(&self.of_pose).filter_map(|(i, j)| i.zip(j));
        let seen = graph.landmarks.measurements.iter().filter_map(|measurement| {
            self.of_pose[measurement.pose?].zip(self.of_landmark[measurement.landmark])
        });
        let ranges = graph.ranges.iter().filter_map(|range| {
            let [a, b] = range.ends.map(|end| self.of_end(end));
            a.zip(b)
        });
        BlockPattern::new(sizes, edges.chain(seen).chain(ranges))
    }
}
