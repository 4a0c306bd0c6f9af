//! A file as a frontend's recording: cameras, keyframes in order, what each of them sees.
//!
//! A BAL file holds one camera a keyframe, ids are the file's indices. A COLMAP folder gives its own
//! ids to cameras, images and points; its images come in the natural order of their names. Neither
//! holds times: keyframe k is taken to be captured at k seconds.

use std::path::Path;

use covis_solvers::io::bal::BalFile;
use covis_solvers::io::colmap::ColmapModel;
use covis_solvers::problem::BundleProblem;

/// A file that can be streamed.
#[derive(Debug)]
pub(super) struct Recording {
    /// Start values and observations; one pose a keyframe, in order.
    pub(super) problem: BundleProblem,
    /// The id of each pose's keyframe.
    pub(super) keyframe_ids: Vec<i64>,
    /// The id of each camera.
    pub(super) camera_ids: Vec<i64>,
    /// Width and height of each camera's image in pixels, 0 where they are not known.
    pub(super) image_sizes: Vec<(i32, i32)>,
    /// The id of each landmark.
    pub(super) landmark_ids: Vec<i64>,
    /// The observations of each pose as indices into the problem's batch, in file order.
    pub(super) observations: Vec<Vec<usize>>,
    /// Observations left out because they stand twice: same keyframe, landmark and pixel.
    pub(super) repeated: usize,
}

impl Recording {
    /// Reads a BAL file or a COLMAP folder.
    pub(super) fn read(path: &Path) -> anyhow::Result<Self> {
        if path.is_dir() {
            let model = ColmapModel::read(path)?;
            let solved = model.to_problem()?;
            let size = |length: u64| i32::try_from(length).unwrap_or_default();
            let image_sizes =
                model.cameras.values().map(|c| (size(c.width), size(c.height))).collect();
            let mut landmark_ids = Vec::with_capacity(solved.point_ids.len());
            for &id in &solved.point_ids {
                landmark_ids.push(i64::try_from(id)?);
            }
            let ids = |ids: &[u32]| ids.iter().map(|&id| i64::from(id)).collect();
            let (keyframe_ids, camera_ids) = (ids(&solved.image_ids), ids(&solved.camera_ids));
            Ok(Self::new(solved.problem, keyframe_ids, camera_ids, image_sizes, landmark_ids))
        } else {
            let problem = BalFile::read(path)?.to_problem();
            let ids = |count: usize| (0..).take(count).collect::<Vec<i64>>();
            let (cameras, landmarks) = (problem.cameras.len(), problem.landmarks.len());
            let image_sizes = vec![(0, 0); cameras];
            let keyframe_ids = ids(problem.poses.len());
            Ok(Self::new(problem, keyframe_ids, ids(cameras), image_sizes, ids(landmarks)))
        }
    }

    fn new(
        problem: BundleProblem,
        keyframe_ids: Vec<i64>,
        camera_ids: Vec<i64>,
        image_sizes: Vec<(i32, i32)>,
        landmark_ids: Vec<i64>,
    ) -> Self {
        let mut observations = vec![Vec::new(); problem.poses.len()];
        let mut seen = std::collections::BTreeSet::new();
        let mut repeated = 0;
        let batch = &problem.reprojections;
        for (index, (&pose, &landmark)) in batch.poses.iter().zip(&batch.landmarks).enumerate() {
            let pixel = &batch.pixels[index];
            if seen.insert((pose, landmark, pixel.x.to_bits(), pixel.y.to_bits())) {
                observations[pose as usize].push(index);
            } else {
                repeated += 1;
            }
        }
        Self {
            problem,
            keyframe_ids,
            camera_ids,
            image_sizes,
            landmark_ids,
            observations,
            repeated,
        }
    }
}
