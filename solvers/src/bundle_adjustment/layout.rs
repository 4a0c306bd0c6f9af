//! Index work, done once a solve: views, blocks of the reduced system, observations in their order.
//!
//! A *view* is a pair (pose, camera) that occurs in an observation; its Jacobian has the columns
//! [pose 6 | camera]. A *block* is a diagonal block of the reduced system: a pose, a pose together
//! with the one camera that only it uses, or a camera that several poses share. Landmarks are sorted
//! by the first view that sees them and observations within a landmark by view, so that neighbors
//! touch the same blocks. Nothing here looks at values other than flags.

use std::ops::Range;

use crate::problem::{BundleProblem, SolveError};

/// Chunks of landmarks that accumulate on their own; fixed, so that sums do not depend on threads.
const MAX_CHUNKS: usize = 16;

/// Fewest observations worth a chunk.
const MIN_CHUNK_OBSERVATIONS: usize = 4096;

/// Padding of the sorted arrays, so that eight observations can be read from any place.
const PADDING: usize = 8;

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

/// The observations, sorted by landmark and view, as the kernels read them; padded by eight.
#[derive(Debug, Default)]
pub(super) struct Sorted {
    pub(super) views: Vec<u32>,
    /// Index of the landmark in the problem.
    pub(super) landmarks: Vec<u32>,
    pub(super) u: Vec<f64>,
    pub(super) v: Vec<f64>,
    /// 1/σ_px.
    pub(super) weights: Vec<f64>,
    pub(super) depths: Vec<f64>,
    /// 1/σ_d; 0 where there is no depth.
    pub(super) depth_weights: Vec<f64>,
}

/// A run of landmarks that one task handles.
#[derive(Clone, Debug)]
pub(super) struct Chunk {
    /// Positions in the sorted order of landmarks.
    pub(super) landmarks: Range<usize>,
    pub(super) observations: Range<usize>,
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
    pub(super) sorted: Sorted,
    /// Problem index of the landmark at each sorted position.
    pub(super) order: Vec<u32>,
    /// Observations `starts[k]..starts[k + 1]` see the landmark at sorted position k.
    pub(super) starts: Vec<u32>,
    pub(super) chunks: Vec<Chunk>,
    /// The longest track.
    pub(super) longest_track: usize,
    /// The most free parameters a camera has.
    pub(super) camera_parameters: usize,
}

impl Layout {
    pub(super) fn new(problem: &BundleProblem) -> Result<Self, SolveError> {
        let (views, view_of) = number_views(problem);
        let mut layout = Self {
            views: Vec::new(),
            block_sizes: Vec::new(),
            pose_block: vec![NO_BLOCK; problem.poses.len()],
            camera_block: vec![(NO_BLOCK, 0); problem.cameras.len()],
            sorted: Sorted::default(),
            order: Vec::new(),
            starts: Vec::new(),
            chunks: Vec::new(),
            longest_track: 0,
            camera_parameters: 0,
        };
        layout.number_blocks(problem, &views);
        if layout.block_sizes.is_empty() && problem.constant_landmarks.iter().all(|&c| c) {
            return Err(SolveError::Empty("every variable is constant"));
        }
        layout.views = views.iter().map(|&(p, c)| layout.view(problem, p, c)).collect();
        layout.sort(problem, &view_of);
        layout.cut_chunks();
        Ok(layout)
    }

    /// Gives each free pose a block, merges a camera into the pose that alone uses it, and appends
    /// shared cameras as blocks of their own.
    fn number_blocks(&mut self, problem: &BundleProblem, views: &[(u32, u32)]) {
        let mut used = vec![false; problem.poses.len()];
        let mut user = vec![None; problem.cameras.len()];
        let mut shared = vec![false; problem.cameras.len()];
        let mut merged = vec![None; problem.poses.len()];
        for &(pose, camera) in views {
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
        for &(pose, camera) in views {
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

    /// Sorts landmarks by their first view, observations by landmark and view.
    fn sort(&mut self, problem: &BundleProblem, view_of: &[u32]) {
        let plain = &problem.reprojections;
        let depth = &problem.depth_reprojections;
        let count = problem.landmarks.len();
        let landmark_of = |k: usize| match k.checked_sub(plain.len()) {
            None => plain.landmarks[k],
            Some(k) => depth.landmarks[k],
        };
        let mut first_view = vec![u32::MAX; count];
        for (k, &view) in view_of.iter().enumerate() {
            let first = &mut first_view[landmark_of(k) as usize];
            *first = view.min(*first);
        }
        // Landmarks that nobody sees come last.
        let key = |l: usize| (first_view[l] as usize).min(self.views.len());
        self.order = counting_sort(count, self.views.len() + 1, key);
        let mut position = vec![0; count];
        for (k, &l) in self.order.iter().enumerate() {
            position[l as usize] = k as u32;
        }
        let by_view = counting_sort(view_of.len(), self.views.len(), |k| view_of[k] as usize);
        let by_landmark = counting_sort(view_of.len(), count, |k| {
            position[landmark_of(by_view[k] as usize) as usize] as usize
        });
        self.starts = vec![0; count + 1];
        for k in 0..view_of.len() {
            self.starts[position[landmark_of(k) as usize] as usize + 1] += 1;
        }
        for k in 0..count {
            self.longest_track = self.longest_track.max(self.starts[k + 1] as usize);
            self.starts[k + 1] += self.starts[k];
        }
        let sorted: Vec<usize> =
            by_landmark.iter().map(|&k| by_view[k as usize] as usize).collect();
        let pad = sorted.last().copied().into_iter().cycle().take(PADDING);
        for k in sorted.iter().copied().chain(pad) {
            let s = &mut self.sorted;
            s.views.push(view_of[k]);
            s.landmarks.push(landmark_of(k));
            let (pixel, sigma, d, w) = match k.checked_sub(plain.len()) {
                None => (plain.pixels[k], plain.sigmas_px[k], 0.0, 0.0),
                Some(k) => {
                    let w = 1.0 / depth.sigmas_depth_m[k];
                    (depth.pixels[k], depth.sigmas_px[k], depth.depths_m[k], w)
                }
            };
            s.u.push(pixel.x);
            s.v.push(pixel.y);
            s.weights.push(1.0 / sigma);
            s.depths.push(d);
            s.depth_weights.push(w);
        }
    }

    fn cut_chunks(&mut self) {
        let landmarks = self.order.len();
        let total = self.starts[landmarks] as usize;
        let count = (total / MIN_CHUNK_OBSERVATIONS).clamp(1, MAX_CHUNKS);
        let mut begin = 0;
        for chunk in 1..=count {
            let target = (total * chunk / count) as u32;
            let end = if chunk == count {
                landmarks
            } else {
                self.starts.partition_point(|&s| s < target).clamp(begin, landmarks)
            };
            let observations = self.starts[begin] as usize..self.starts[end] as usize;
            self.chunks.push(Chunk { landmarks: begin..end, observations });
            begin = end;
        }
    }

    /// The sorted observations of the landmark at sorted position `k`.
    pub(super) fn track(&self, k: usize) -> Range<usize> {
        self.starts[k] as usize..self.starts[k + 1] as usize
    }

    /// Whether a view touches the reduced system.
    pub(super) fn is_active(&self, view: u32) -> bool {
        !self.views[view as usize].parts.is_empty()
    }
}

/// The views in rising order of (pose, camera), and the view of each observation.
fn number_views(problem: &BundleProblem) -> (Vec<(u32, u32)>, Vec<u32>) {
    let plain = &problem.reprojections;
    let depth = &problem.depth_reprojections;
    let pairs = || {
        let first = plain.poses.iter().zip(&plain.cameras);
        first.chain(depth.poses.iter().zip(&depth.cameras)).map(|(&p, &c)| (p, c))
    };
    // Most poses have one camera: remember it, and search only for the others.
    let mut only: Vec<Option<u32>> = vec![None; problem.poses.len()];
    let mut more = Vec::new();
    for (pose, camera) in pairs() {
        match only[pose as usize] {
            None => only[pose as usize] = Some(camera),
            Some(known) if known != camera => more.push((pose, camera)),
            Some(_) => {}
        }
    }
    let singles = only.iter().enumerate().filter_map(|(p, c)| c.map(|c| (p as u32, c)));
    let mut views: Vec<(u32, u32)> = singles.chain(more).collect();
    views.sort_unstable();
    views.dedup();
    let mut first_of_pose = vec![0; problem.poses.len()];
    for (index, &(pose, _)) in views.iter().enumerate().rev() {
        first_of_pose[pose as usize] = index;
    }
    let view_of = pairs()
        .map(|(pose, camera)| {
            let first = first_of_pose[pose as usize];
            let rest = views[first..].iter();
            first as u32 + rest.take_while(|v| v.0 == pose && v.1 != camera).count() as u32
        })
        .collect();
    (views, view_of)
}

/// Positions 0..count in stable order of their keys below `keys`.
fn counting_sort(count: usize, keys: usize, key: impl Fn(usize) -> usize) -> Vec<u32> {
    let mut next = vec![0_u32; keys + 1];
    for k in 0..count {
        next[key(k) + 1] += 1;
    }
    for k in 0..keys {
        next[k + 1] += next[k];
    }
    let mut order = vec![0; count];
    for k in 0..count {
        let slot = &mut next[key(k)];
        order[*slot as usize] = k as u32;
        *slot += 1;
    }
    order
}
