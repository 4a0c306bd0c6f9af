//! A map from its observations alone: the body of a solve whose start is no estimate.
//!
//! The reconstruction is that of the solver crate, in the frame of the poses that are there; what it could
//! not place keeps its values. Costs before and after are of the same observations, those that agree with
//! the result.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use covis_solvers::bundle_adjustment::BundleSummary;
use covis_solvers::optimizer::Control;
use covis_solvers::problem::SolveError;
use covis_solvers::reconstruction::{
    self, Frame, Placement, Progress, Reconstruction, reconstruct,
};

use crate::map::{ClientIndex, Compared, Map, observation_problem};
use crate::service::engine::GaugeKind;
use crate::service::engine::outcome::{
    Moved, OptimizeCounts, OptimizeOptions, Outcome, Solution, SolveCertificate, SolveStep,
    SolverKind, Tell,
};
use crate::service::engine::outcome::{Rebuilt, UnplacedKeyframe};
use crate::service::engine::solving::whole::interrupt;

/// Why a reconstruction that placed nothing ends.
const NOTHING_PLACED: &str = "no keyframe can be placed by what it observes";

impl Rebuilt {
    /// What was found; `name` names a keyframe by client and id.
    ///
    /// # Errors
    /// [`SolveError::Interrupted`] where it ended early, [`SolveError::Empty`] where nothing was placed.
    pub fn new(
        found: &Reconstruction,
        name: impl Fn(usize) -> (String, i64),
    ) -> Result<Self, SolveError> {
        if found.ended.is_some() {
            return Err(SolveError::Interrupted);
        }
        if found.placed() == 0 {
            return Err(SolveError::Empty(NOTHING_PLACED));
        }
        let unplaced = found.placements.iter().enumerate().filter_map(|(index, placement)| {
            let Placement::Unplaced(reason) = placement else { return None };
            let (client, id) = name(index);
            Some(UnplacedKeyframe { client, id, reason: reason.to_string() })
        });
        let agrees = || found.reprojections.iter().chain(&found.depth_reprojections);
        Ok(Self {
            keyframes: found.poses.len(),
            placed: found.placed(),
            unplaced: unplaced.collect(),
            landmarks: found.landmarks.len(),
            placed_landmarks: found.landmarks.iter().flatten().count(),
            observations: agrees().count(),
            agreeing: agrees().filter(|&&agrees| agrees).count(),
            view_graph: found.view_graph,
            scale: found.scale,
        })
    }
}

/// Rebuilds the whole map.
pub(crate) fn rebuild_map(
    map: Arc<Map>,
    options: &OptimizeOptions,
    tell: &mut Tell<'_>,
    cancel: &Arc<AtomicBool>,
) -> Outcome {
    let mut problem = observation_problem(&map);
    let has_position = |id| map.landmarks().get(id).is_some_and(|known| known.position.is_some());
    let had_position: Vec<bool> = problem.landmarks.iter().map(has_position).collect();
    let clients: Vec<String> = map.clients().iter().map(|client| client.name.clone()).collect();
    problem.gauge = options.gauge;
    let gauge = options.gauge.unwrap_or(map.policy().gauge);
    let held = map.held_keyframes(gauge);
    drop(map);
    let options = reconstruction::Options {
        frame: Frame::Given,
        optimizer: options.optimizer,
        linear_solver: options.linear_solver,
        ..reconstruction::Options::default()
    };
    let interrupt = interrupt(None, cancel);
    let mut observer = |progress: &Progress| {
        tell(SolveStep::Reconstruction(*progress));
        Control::Continue
    };
    let found = reconstruct(&problem.problem, &options, &interrupt, &mut observer)?;
    let name = |index: usize| {
        let id = problem.keyframes[index];
        let ClientIndex(client) = id.client;
        (clients.get(client as usize).cloned().unwrap_or_default(), id.id)
    };
    let rebuilt = Rebuilt::new(&found, name)?;
    // The result is moved so that what the gauge holds stays where it is.
    let mut placed = problem.keyframes.iter().zip(&found.poses).filter(|(_, pose)| pose.is_some());
    let is_held = placed.any(|(id, _)| held.contains(id));
    let Some(BundleSummary { mut solve, linear_solver, .. }) = found.adjustment.clone() else {
        return Err(SolveError::Empty(NOTHING_PLACED));
    };
    let mut compared = Compared::new(&problem, &found, &had_position);
    let before = compared.cost();
    problem.take_over(&found);
    compared.update(&problem);
    let after = compared.cost();
    (solve.initial_cost, solve.final_cost) = (before.total, after.total);
    solve.solve_seconds = found.seconds;
    let fixed_poses = rebuilt.keyframes - rebuilt.placed;
    let certificate = SolveCertificate {
        solve,
        method: options.optimizer.method,
        linear_solver: SolverKind::Schur(linear_solver),
        before,
        after,
        gauge: if is_held { gauge } else { GaugeKind::Free },
        free_poses: rebuilt.placed,
        fixed_poses,
        free_landmarks: rebuilt.placed_landmarks,
        closures: None,
        held: Vec::new(),
    };
    let counts = OptimizeCounts::of(&problem);
    let (moved, rebuilt) = (Moved::Bundle(Box::new(problem)), Some(rebuilt));
    Ok(Some(Solution { moved, certificate, counts, proof: None, rebuilt, refused: None }))
}
