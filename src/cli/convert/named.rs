//! A graph of named variables (pyfg) as `covis convert` takes it: paths by robot, landmarks, counts.
//!
//! A name begins with the letter of its robot. A trajectory is of one robot; a picture shows all of them.

use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use covis_solvers::geometry::Se3;
use covis_solvers::io::pyfg::{PyfgFile, PyfgGraph, PyfgName, PyfgTime};
use covis_solvers::io::trajectory::Trajectory;
use nalgebra::Vector3;

use super::in_space;
use crate::cli::formats::joined;

/// A file, and what is asked of it.
pub(super) struct NamedGraph {
    /// The name of the file, for errors.
    path: PathBuf,
    graph: PyfgGraph,
    /// The robot whose trajectory is wanted.
    robot: Option<char>,
    /// Poses of that robot, else of all, by name.
    poses: Vec<(PyfgName, PyfgTime, Se3)>,
    pub(super) points: Vec<Vector3<f64>>,
    measured: usize,
}

impl NamedGraph {
    /// Fails where the robot has no pose.
    pub(super) fn new(path: &Path, graph: PyfgGraph, robot: Option<char>) -> anyhow::Result<Self> {
        let (mut poses, points, measured) = match &graph {
            PyfgGraph::Se2(file) => {
                parts(file, file.to_pose_graph()?.poses.iter().map(in_space).collect())
            }
            PyfgGraph::Se3(file) => parts(file, file.to_pose_graph()?.poses),
        };
        let letters = letters(&poses);
        if let Some(robot) = robot {
            poses.retain(|(name, ..)| name.letter() == robot);
            ensure!(
                !poses.is_empty(),
                "{}: no pose has the letter of --robot {robot}, only {}",
                path.display(),
                spelled(&letters)
            );
        }
        Ok(Self { path: path.to_owned(), graph, robot, poses, points, measured })
    }

    /// Poses, landmarks, measurements of landmarks and ranges.
    pub(super) fn counts(&self) -> (usize, usize, usize) {
        (self.poses.len(), self.points.len(), self.measured)
    }

    /// Fails where a robot was chosen, for outputs that have all of them.
    pub(super) fn whole(&self) -> anyhow::Result<&PyfgGraph> {
        ensure!(self.robot.is_none(), "--robot is for outputs that are trajectories");
        Ok(&self.graph)
    }

    /// The trajectory of the only robot or the chosen one, by rising number.
    /// Fails for several robots, without poses, and where `needs_times` for times that do not rise.
    pub(super) fn trajectory(&self, needs_times: bool) -> anyhow::Result<Trajectory> {
        let path = self.path.display();
        match letters(&self.poses)[..] {
            [] => bail!("{path}: the file has no poses"),
            [_] => {}
            ref several => bail!(
                "{path}: the file has the robots {}, and a trajectory is of one: choose it with --robot",
                spelled(several)
            ),
        }
        let falls =
            |pair: &&[(PyfgName, PyfgTime, Se3)]| pair[1].1.seconds() <= pair[0].1.seconds();
        if let Some([(before, t0, _), (after, t1, _)]) =
            self.poses.windows(2).find(falls).filter(|_| needs_times)
        {
            bail!(
                "{path}: times do not rise: {before} is at {t0} s, {after} at {t1} s; `--to kitti` writes the \
                 poses without times"
            );
        }
        Ok(joined(self.poses.iter().map(|(_, time, pose)| (time.seconds(), *pose))))
    }

    /// The path of each robot.
    pub(super) fn paths(&self) -> impl Iterator<Item = Vec<Vector3<f64>>> {
        let robots = self.poses.chunk_by(|a, b| a.0.letter() == b.0.letter());
        robots.map(|poses| poses.iter().map(|(.., pose)| pose.translation).collect())
    }
}

type Parts = (Vec<(PyfgName, PyfgTime, Se3)>, Vec<Vector3<f64>>, usize);

/// Poses by name, landmarks, and how many measurements and ranges there are.
fn parts<const P: usize, const U: usize>(file: &PyfgFile<P, U>, poses: Vec<Se3>) -> Parts {
    let named = file.poses.iter().zip(poses);
    let mut poses: Vec<_> = named.map(|(own, pose)| (own.name, own.time.clone(), pose)).collect();
    poses.sort_by_key(|(name, ..)| *name);
    let points = file.landmarks.iter().map(|landmark| landmark.position.into()).collect();
    (poses, points, file.sightings.len() + file.ranges.len())
}

/// The letters of poses that are sorted.
fn letters(poses: &[(PyfgName, PyfgTime, Se3)]) -> Vec<char> {
    let mut letters: Vec<char> = poses.iter().map(|(name, ..)| name.letter()).collect();
    letters.dedup();
    letters
}

fn spelled(letters: &[char]) -> String {
    letters.iter().map(char::to_string).collect::<Vec<_>>().join(", ")
}
