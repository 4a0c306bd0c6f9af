//! `covis solve bundle --rebuild`: reconstructs poses and points from the observations, in place of
//! the file's.
//!
//! The reconstruction is the start of the solve that follows, over the observations that agree.
//! Progress is one line per stage and second, and none with `--json`. The solver crate decides
//! which observations agree.

use anyhow::Context;
use covis_solvers::bundle_adjustment::LinearSolver;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::interrupt::Interrupt;
use covis_solvers::optimizer::{self, Control};
use covis_solvers::problem::BundleProblem;
use covis_solvers::reconstruction::{
    Options, Placement, Progress, Reconstruction, Stage, reconstruct,
};
use serde::Serialize;

use super::report::print_or_cancel;

/// What a report says of a reconstruction.
#[derive(Debug, Serialize)]
pub(super) struct Rebuilt {
    keyframes: usize,
    placed: usize,
    unplaced: Vec<UnplacedKeyframe>,
    landmarks: usize,
    placed_landmarks: usize,
    observations: usize,
    /// Those that do not agree, or whose keyframe or landmark is not placed.
    dropped_observations: usize,
    pairs: usize,
    measured_pairs: usize,
    relative_poses: usize,
    scale: &'static str,
    seconds: f64,
}

#[derive(Debug, Serialize)]
struct UnplacedKeyframe {
    /// The image's id in a COLMAP model, the camera's index in a BAL file.
    id: u64,
    reason: String,
}

impl Rebuilt {
    /// Lines `name value` for a person.
    pub(super) fn lines(&self) -> Vec<(&'static str, String)> {
        /// Keyframes without a pose that are named; `--json` has all of them.
        const NAMED: usize = 10;
        let size = format!(
            "{} of {} keyframes, {} of {} landmarks, {} of {} observations, {:.3} s",
            self.placed,
            self.keyframes,
            self.placed_landmarks,
            self.landmarks,
            self.observations - self.dropped_observations,
            self.observations,
            self.seconds
        );
        let graph = format!(
            "{} pairs, {} measured, {} with a relative pose",
            self.pairs, self.measured_pairs, self.relative_poses
        );
        let mut lines =
            vec![("rebuilt", size), ("view graph", graph), ("scale", self.scale.to_owned())];
        for keyframe in self.unplaced.iter().take(NAMED) {
            lines.push(("not placed", format!("{}: {}", keyframe.id, keyframe.reason)));
        }
        if self.unplaced.len() > NAMED {
            lines.push(("not placed", format!("{} more", self.unplaced.len() - NAMED)));
        }
        lines
    }
}

/// Throws poses and landmarks of `problem` away and puts reconstructed ones in; observations that do not
/// agree are removed. `id` names a keyframe for the user. Variables that are not placed are zero.
///
/// # Errors
/// Where no two keyframes could be placed, or standard output cannot be written to.
pub(super) fn rebuild(
    problem: &mut BundleProblem,
    id: impl Fn(usize) -> u64,
    linear_solver: LinearSolver,
    json: bool,
) -> anyhow::Result<Rebuilt> {
    problem.poses.fill(Se3::identity());
    problem.landmarks.fill(Default::default());
    let options = Options {
        optimizer: optimizer::Options { threads: None, ..optimizer::Options::default() },
        linear_solver,
        ..Options::default()
    };
    let mut lines = Lines { json, last: None, failure: None };
    let found = reconstruct(problem, &options, &Interrupt::NEVER, &mut |p| lines.tell(p))?;
    if let Some(failure) = lines.failure {
        return Err(failure);
    }
    let observations = problem.observation_count();
    let unplaced = unplaced(&found, &id);
    if found.placed() == 0 {
        let first =
            unplaced.first().map(|keyframe| format!("{}: {}", keyframe.id, keyframe.reason));
        return Err(anyhow::anyhow!(first.unwrap_or_default()))
            .context("no keyframe could be placed by its observations");
    }
    let dropped_observations = found.apply_to(problem);
    Ok(Rebuilt {
        keyframes: found.poses.len(),
        placed: found.placed(),
        unplaced,
        landmarks: found.landmarks.len(),
        placed_landmarks: found.landmarks.iter().flatten().count(),
        observations,
        dropped_observations,
        pairs: found.view_graph.pairs,
        measured_pairs: found.view_graph.measured,
        relative_poses: found.view_graph.edges,
        scale: found.scale.name(),
        seconds: (found.seconds * 1e6).round() / 1e6,
    })
}

fn unplaced(found: &Reconstruction, id: &impl Fn(usize) -> u64) -> Vec<UnplacedKeyframe> {
    let named = found.placements.iter().enumerate().filter_map(|(index, placement)| {
        let Placement::Unplaced(reason) = placement else { return None };
        Some(UnplacedKeyframe { id: id(index), reason: reason.to_string() })
    });
    named.collect()
}

/// Progress for a person.
struct Lines {
    json: bool,
    /// The last line's stage and time.
    last: Option<(Stage, f64)>,
    failure: Option<anyhow::Error>,
}

impl Lines {
    fn tell(&mut self, progress: &Progress) -> Control {
        let &Progress { stage, done, total, cost, seconds } = progress;
        let is_due = self.last.is_none_or(|(last, at)| last != stage || seconds >= at + 1.0);
        if self.json || !is_due {
            return Control::Continue;
        }
        self.last = Some((stage, seconds));
        let (name, unit) = (stage.name(), stage.unit());
        let cost = cost.map(|cost| format!(", cost {cost:.6e}")).unwrap_or_default();
        let line = format_args!("{name:>17}: {done} of {total} {unit}{cost}, {seconds:.3} s");
        print_or_cancel(line, &mut self.failure)
    }
}
