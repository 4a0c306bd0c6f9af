//! Index work, done once a solve: views, blocks of the reduced system, observations by landmark.
//!
//! A *view* is a pair (pose, camera) that occurs in an observation; its Jacobian has the columns
//! [pose 6 | camera]. A *block* is a diagonal block of the reduced system: a pose, a pose together
//! with the one camera that only it uses, or a camera that several poses share. Nothing here looks
//! at values other than flags.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::problem::{BundleProblem, SolveError};

/// Chunks of landmarks that accumulate on their own; fixed, so that sums do not depend on threads.
const MAX_CHUNKS: usize = 16;

/// Fewest observations worth a chunk.
const MIN_CHUNK_OBSERVATIONS: usize = 512;

/// Marks a variable that is not in the reduced system.
pub(super) const NO_BLOCK: u32 = u32::MAX;

/// Columns of a view's Jacobian that belong to one block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    /// The block.
    pub(super) block: u32,
    /// First column in the view's Jacobian.
    pub(super) column: usize,
    /// Number of columns: the block's size, or its leading 6 for a second camera on the pose.
    pub(super) size: usize,
}

/// A pair (pose, camera) with its free columns.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub(super) pose: u32,
    pub(super) camera: u32,
    /// At most two: merged, or pose and camera apart; none where both are constant.
    pub(super) parts: Vec<Part>,
}

/// One observation: its view, and its place in the batches (plain ones first, then depth).
#[derive(Clone, Copy, Debug)]
pub(super) struct Observation {
    pub(super) view: u32,
    pub(super) factor: u32,
}

/// The index structure of a problem.
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) views: Vec<View>,
    /// Size of each block.
    pub(super) block_sizes: Vec<usize>,
    /// Block that starts with pose i's six unknowns, or [`NO_BLOCK`].
    pub(super) pose_block: Vec<u32>,
    /// Block and first column in it of camera i's parameters, or [`NO_BLOCK`].
    pub(super) camera_block: Vec<(u32, usize)>,
    /// Observations, sorted by landmark.
    pub(super) observations: Vec<Observation>,
    /// `observations[starts[l]..starts[l + 1]]` see landmark l.
    pub(super) starts: Vec<u32>,
    /// Landmark of each sorted observation.
    pub(super) landmark_of: Vec<u32>,
    /// Sorted observations that touch each block, in landmark order.
    pub(super) block_observations: Vec<Vec<u32>>,
    /// Landmark ranges of about equal numbers of observations.
    pub(super) chunks: Vec<Range<usize>>,
    /// The most free parameters a camera has.
    pub(super) camera_parameters: usize,
}

impl Layout {
    pub(super) fn new(problem: &BundleProblem) -> Result<Self, SolveError> {
        let plain = &problem.reprojections;
        let depth = &problem.depth_reprojections;
        let pairs = || {
            let first = plain.poses.iter().zip(&plain.cameras);
            first.chain(depth.poses.iter().zip(&depth.cameras)).map(|(&p, &c)| (p, c))
        };
        let mut view_of: BTreeMap<(u32, u32), u32> = pairs().map(|pair| (pair, 0)).collect();
        for (index, view) in view_of.values_mut().enumerate() {
            *view = index as u32;
        }
        let mut layout = Self {
            views: Vec::new(),
            block_sizes: Vec::new(),
            pose_block: vec![NO_BLOCK; problem.poses.len()],
            camera_block: vec![(NO_BLOCK, 0); problem.cameras.len()],
            observations: Vec::new(),
            starts: Vec::new(),
            landmark_of: Vec::new(),
            block_observations: Vec::new(),
            chunks: Vec::new(),
            camera_parameters: 0,
        };
        layout.number_blocks(problem, view_of.keys().copied());
        if layout.block_sizes.is_empty() && problem.constant_landmarks.iter().all(|&c| c) {
            return Err(SolveError::Empty("every variable is constant"));
        }
        layout.views = view_of.keys().map(|&(p, c)| layout.view(problem, p, c)).collect();
        let views: Vec<u32> = pairs().map(|pair| view_of[&pair]).collect();
        layout.sort_observations(problem, &views);
        layout.list_block_observations();
        layout.cut_chunks();
        Ok(layout)
    }

    /// Gives each free pose a block, merges a camera into the pose that alone uses it, and appends
    /// shared cameras as blocks of their own.
    fn number_blocks(
        &mut self,
        problem: &BundleProblem,
        views: impl Iterator<Item = (u32, u32)> + Clone,
    ) {
        let mut used = vec![false; problem.poses.len()];
        let mut user = vec![None; problem.cameras.len()];
        let mut shared = vec![false; problem.cameras.len()];
        let mut merged = vec![None; problem.poses.len()];
        for (pose, camera) in views.clone() {
            used[pose as usize] = true;
            let user = &mut user[camera as usize];
            shared[camera as usize] |= user.is_some_and(|other| other != pose);
            *user = Some(pose);
        }
        let pose_factors = problem.relative_poses.iter().flat_map(|f| [f.i, f.j]);
        let priors = problem.pose_priors.iter().map(|f| f.pose);
        let positions = problem.position_priors.iter().map(|f| f.pose);
        for pose in pose_factors.chain(priors).chain(positions) {
            used[pose] = true;
        }
        for (pose, camera) in views {
            let (pose, camera) = (pose as usize, camera as usize);
            let free = !problem.constant_poses[pose] && !problem.constant_cameras[camera];
            if free && !shared[camera] && merged[pose].is_none() {
                merged[pose] = Some(camera);
            }
        }
        for pose in 0..problem.poses.len() {
            if problem.constant_poses[pose] || !used[pose] {
                continue;
            }
            let block = self.block_sizes.len() as u32;
            self.pose_block[pose] = block;
            let mut size = 6;
            if let Some(camera) = merged[pose] {
                self.camera_block[camera] = (block, 6);
                size += problem.cameras[camera].parameter_count();
            }
            self.block_sizes.push(size);
        }
        for camera in 0..problem.cameras.len() {
            if problem.constant_cameras[camera] || user[camera].is_none() {
                continue;
            }
            let count = problem.cameras[camera].parameter_count();
            self.camera_parameters = self.camera_parameters.max(count);
            if self.camera_block[camera].0 == NO_BLOCK {
                self.camera_block[camera] = (self.block_sizes.len() as u32, 0);
                self.block_sizes.push(count);
            }
        }
    }

    fn view(&self, problem: &BundleProblem, pose: u32, camera: u32) -> View {
        let pose_block = self.pose_block[pose as usize];
        let (camera_block, _) = self.camera_block[camera as usize];
        let parameters = problem.cameras[camera as usize].parameter_count();
        let mut parts = Vec::new();
        if pose_block != NO_BLOCK {
            let merged = pose_block == camera_block;
            let size = if merged { 6 + parameters } else { 6 };
            parts.push(Part { block: pose_block, column: 0, size });
        }
        if camera_block != NO_BLOCK && camera_block != pose_block {
            parts.push(Part { block: camera_block, column: 6, size: parameters });
        }
        View { pose, camera, parts }
    }

    fn sort_observations(&mut self, problem: &BundleProblem, views: &[u32]) {
        let landmarks =
            || problem.reprojections.landmarks.iter().chain(&problem.depth_reprojections.landmarks);
        let count = problem.landmarks.len();
        self.starts = vec![0; count + 1];
        for &landmark in landmarks() {
            self.starts[landmark as usize + 1] += 1;
        }
        for landmark in 0..count {
            self.starts[landmark + 1] += self.starts[landmark];
        }
        let mut next = self.starts.clone();
        self.observations = vec![Observation { view: 0, factor: 0 }; views.len()];
        self.landmark_of = vec![0; views.len()];
        for (factor, (&landmark, &view)) in landmarks().zip(views).enumerate() {
            let slot = next[landmark as usize] as usize;
            next[landmark as usize] += 1;
            self.observations[slot] = Observation { view, factor: factor as u32 };
            self.landmark_of[slot] = landmark;
        }
    }

    fn list_block_observations(&mut self) {
        self.block_observations = vec![Vec::new(); self.block_sizes.len()];
        for (index, observation) in self.observations.iter().enumerate() {
            for part in &self.views[observation.view as usize].parts {
                self.block_observations[part.block as usize].push(index as u32);
            }
        }
    }

    fn cut_chunks(&mut self) {
        let total = self.observations.len();
        let count = (total / MIN_CHUNK_OBSERVATIONS).clamp(1, MAX_CHUNKS);
        let landmarks = self.starts.len() - 1;
        let mut begin = 0;
        for chunk in 1..=count {
            let target = (total * chunk / count) as u32;
            let end = if chunk == count {
                landmarks
            } else {
                self.starts.partition_point(|&s| s < target).clamp(begin, landmarks)
            };
            self.chunks.push(begin..end);
            begin = end;
        }
    }

    /// The sorted observations of landmark `l`.
    pub(super) fn track(&self, l: usize) -> Range<usize> {
        self.starts[l] as usize..self.starts[l + 1] as usize
    }

    /// The sorted observations of a range of landmarks.
    pub(super) fn tracks(&self, landmarks: &Range<usize>) -> Range<usize> {
        self.starts[landmarks.start] as usize..self.starts[landmarks.end] as usize
    }
}
