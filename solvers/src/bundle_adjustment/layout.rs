//! Index work, done once a solve: views, blocks of the reduced system, the order of observations.
//!
//! A *view* is a pair (pose, camera) that occurs in an observation; its Jacobian has the columns
//! [pose 6 | unknowns of the camera]. A *block* is a diagonal block of the reduced system: a pose, a pose
//! together with the one camera that only it uses, or a camera that several poses share.
//! Nothing here looks at values other than flags; the order itself is made in `sorted`.

use std::ops::Range;

use crate::problem::{BundleProblem, SolveError};

use super::sorted::{Chunk, Sorted, Tile};
use super::state_factors::{self, Variable};

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

/// Where a variable is in the reduced system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// The block.
    pub(super) block: usize,
    /// First of the variable's columns in it.
    pub(super) column: usize,
}

/// A pair (pose, camera) with its free columns.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub(super) pose: u32,
    pub(super) camera: u32,
    /// At most two: merged, or pose and camera apart; none where both are constant.
    pub(super) parts: Vec<Part>,
}

/// The diagonal blocks of the reduced system: which variables they hold, and how large they are.
#[derive(Clone, Debug)]
pub(super) struct Blocks {
    /// Size of each block.
    pub(super) sizes: Vec<usize>,
    /// Block that starts with pose i's six unknowns, or [`NO_BLOCK`].
    pub(super) of_pose: Vec<u32>,
    /// Block and first column in it of camera i's unknowns, or [`NO_BLOCK`].
    pub(super) of_camera: Vec<(u32, usize)>,
}

impl Blocks {
    /// Gives each free pose a block, merges a camera into the pose that alone uses it unless it is
    /// marked in `is_apart`, and appends all other cameras as blocks of their own. `views` ascend.
    pub(super) fn new(problem: &BundleProblem, views: &[(u32, u32)], is_apart: &[bool]) -> Self {
        let mut blocks = Self {
            sizes: Vec::new(),
            of_pose: vec![NO_BLOCK; problem.poses.len()],
            of_camera: vec![(NO_BLOCK, 0); problem.cameras.len()],
        };
        let mut used = vec![false; problem.poses.len()];
        let mut user = vec![None; problem.cameras.len()];
        let mut shared = vec![false; problem.cameras.len()];
        let mut merged = vec![None; problem.poses.len()];
        for (shared, &is_apart) in shared.iter_mut().zip(is_apart) {
            *shared = is_apart;
        }
        for &(pose, camera) in views {
            used[pose as usize] = true;
            let user = &mut user[camera as usize];
            shared[camera as usize] |= user.is_some_and(|other| other != pose);
            *user = Some(pose);
        }
        for Variable::Pose(pose) in state_factors::all(problem).flat_map(|f| f.variables()) {
            used[pose] = true;
        }
        for &(pose, camera) in views {
            let (pose, camera) = (pose as usize, camera as usize);
            let free = !problem.constant_poses[pose] && problem.camera_unknowns(camera) > 0;
            if free && !shared[camera] && merged[pose].is_none() {
                merged[pose] = Some(camera);
            }
        }
        for pose in 0..problem.poses.len() {
            if problem.constant_poses[pose] || !used[pose] {
                continue;
            }
            let block = blocks.sizes.len() as u32;
            blocks.of_pose[pose] = block;
            let mut size = 6;
            if let Some(camera) = merged[pose] {
                blocks.of_camera[camera] = (block, 6);
                size += problem.camera_unknowns(camera);
            }
            blocks.sizes.push(size);
        }
        for camera in 0..problem.cameras.len() {
            let unknowns = problem.camera_unknowns(camera);
            let is_free = unknowns > 0 && user[camera].is_some();
            if is_free && blocks.of_camera[camera].0 == NO_BLOCK {
                blocks.of_camera[camera] = (blocks.sizes.len() as u32, 0);
                blocks.sizes.push(unknowns);
            }
        }
        blocks
    }
}

/// The index structure of a problem.
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) views: Vec<View>,
    /// The camera of each view.
    pub(super) view_cameras: Vec<u32>,
    /// Whether each view touches the reduced system.
    pub(super) active: Vec<bool>,
    /// Size of each block.
    pub(super) block_sizes: Vec<usize>,
    /// Block that starts with pose i's six unknowns, or [`NO_BLOCK`].
    pub(super) pose_block: Vec<u32>,
    /// Block and first column in it of camera i's unknowns, or [`NO_BLOCK`].
    pub(super) camera_block: Vec<(u32, usize)>,
    /// Observations and landmarks in the order of the kernels.
    pub(super) sorted: Sorted,
    /// The most unknowns that a camera has.
    pub(super) camera_unknowns: usize,
    /// Whether a camera has fewer unknowns than parameters.
    pub(super) is_restricted: bool,
}

impl Layout {
    pub(super) fn new(problem: &BundleProblem) -> Result<Self, SolveError> {
        let layout = Self::with_apart(problem, &[]);
        if layout.block_sizes.is_empty() && problem.constant_landmarks.iter().all(|&c| c) {
            return Err(SolveError::Empty("every variable is constant"));
        }
        Ok(layout)
    }

    /// The same, also where every variable is constant; no camera that is marked in `is_apart` is merged
    /// into a pose.
    pub(super) fn with_apart(problem: &BundleProblem, is_apart: &[bool]) -> Self {
        let (views, view_of) = number_views(problem);
        let blocks = Blocks::new(problem, &views, is_apart);
        let mut free: Vec<usize> = (0..problem.cameras.len()).collect();
        free.retain(|&camera| blocks.of_camera[camera].0 != NO_BLOCK);
        let unknowns = |camera: &usize| problem.camera_unknowns(*camera);
        let mut layout = Self {
            views: Vec::new(),
            view_cameras: views.iter().map(|&(_, camera)| camera).collect(),
            active: Vec::new(),
            camera_unknowns: free.iter().map(unknowns).max().unwrap_or(0),
            is_restricted: free
                .iter()
                .any(|camera| unknowns(camera) < problem.cameras[*camera].parameter_count()),
            sorted: Sorted::new(problem, &view_of, views.len()),
            block_sizes: blocks.sizes,
            pose_block: blocks.of_pose,
            camera_block: blocks.of_camera,
        };
        layout.views = views.iter().map(|&(p, c)| layout.view(problem, p, c)).collect();
        layout.active = layout.views.iter().map(|view| !view.parts.is_empty()).collect();
        layout
    }

    fn view(&self, problem: &BundleProblem, pose: u32, camera: u32) -> View {
        let pose_block = self.pose_block[pose as usize];
        let (camera_block, _) = self.camera_block[camera as usize];
        let unknowns = problem.camera_unknowns(camera as usize);
        let mut parts = Vec::new();
        if pose_block != NO_BLOCK {
            let merged = pose_block == camera_block;
            let size = if merged { 6 + unknowns } else { 6 };
            parts.push(Part { block: pose_block, column: 0, size });
        }
        if camera_block != NO_BLOCK && camera_block != pose_block {
            parts.push(Part { block: camera_block, column: 6, size: unknowns });
        }
        View { pose, camera, parts }
    }

    /// Where the variable of a state factor is, `None` where it is constant.
    pub(super) fn place(&self, variable: Variable) -> Option<Place> {
        let (block, column) = match variable {
            Variable::Pose(pose) => (self.pose_block[pose], 0),
        };
        (block != NO_BLOCK).then_some(Place { block: block as usize, column })
    }

    /// The chunks of landmarks.
    pub(super) fn chunks(&self) -> &[Chunk] {
        &self.sorted.chunks
    }

    /// The tiles of a chunk, each with its number.
    pub(super) fn tiles(&self, chunk: &Chunk) -> impl Iterator<Item = (usize, Tile)> {
        chunk.tiles.clone().map(|t| (t, self.sorted.tile(t)))
    }

    /// The sorted observations of the landmark at sorted position `k`.
    pub(super) fn track(&self, k: usize) -> Range<usize> {
        self.sorted.track(k)
    }
}

/// The views in rising order of (pose, camera), and the view of each observation.
pub(super) fn number_views(problem: &BundleProblem) -> (Vec<(u32, u32)>, Vec<u32>) {
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
