//! The ends of solves: what they moved becomes an event, and the engine acknowledges the items that they
//! cover. Nothing is solved here.

use std::sync::Arc;

use super::Actor;
use crate::map::{
    AppliedSolve, Change, ClientIndex, EntityId, Held, Map, Reach, SolveKind, SwitchedOff, applied,
};
use crate::service::engine::outcome::{HeldKeyframe, Moved, Outcome, Solution};
use crate::service::engine::pool::Ended;
use crate::service::engine::solving::Running;
use crate::service::engine::{EngineError, Fault, OptimizeOutcome, SolveReport};

impl Actor {
    /// Starts the solves that are due and may run.
    pub(crate) async fn start_solves(&mut self) {
        if self.is_held() {
            return;
        }
        let is_lock_step = self.ingest.is_lock_step();
        while let Some(triggers) = self.solving.start_next(&self.map, is_lock_step).await {
            self.optimized(&triggers, 0, &SolveReport::Nothing);
        }
    }

    /// Closes triggers and sends the OPTIMIZED acks that this completes.
    fn optimized(&mut self, triggers: &[u64], solve_id: i64, report: &SolveReport) {
        let schedule = &mut self.solving.schedule;
        let marks = schedule.close(triggers);
        let followed = |(client, sequence)| (client, sequence, schedule.is_waiting(client));
        let marks: Vec<_> = marks.into_iter().map(followed).collect();
        self.ingest.acknowledge_optimized(marks, self.map.revision(), solve_id, report);
    }

    /// Handles the end of a solve.
    pub(crate) async fn solved(&mut self, (running, ended): (Running, Ended<Outcome>)) {
        let outcome = match ended {
            Ended::Made(outcome) => outcome,
            Ended::Dropped => {
                self.solving.dropped(&running);
                return self.shared.meters.superseded.increment();
            }
            Ended::Panicked { panicked, is_stale } => {
                let bug = self.lost(&panicked);
                if is_stale {
                    return self.shared.meters.superseded.increment();
                }
                // What a request covers besides is solved by the map's own solves.
                return match running.is_job {
                    true => self.solving.answer_job(Err(bug)),
                    false => {
                        let report = SolveReport::Lost { bug };
                        self.optimized(&running.triggers, running.id, &report);
                    }
                };
            }
        };
        let (id, map) = (running.id, self.shared.name.clone());
        let answer = match (outcome, running.is_job) {
            (outcome, true) if !self.solving.commits_job() => {
                self.pool.discard(outcome);
                Err(EngineError::Cancelled { map })
            }
            (Err(error), true) => Err(EngineError::Solve(error)),
            (Ok(None), true) => Err(EngineError::NothingToSolve { map }),
            (Err(error), false) => {
                return self.optimized(&running.triggers, id, &SolveReport::Failed { error });
            }
            (Ok(None), false) => {
                return self.optimized(&running.triggers, 0, &SolveReport::Nothing);
            }
            // The job is kept while its result is applied, so that a bug there ends it with an
            // error.
            (Ok(Some(solution)), _) => self.apply(&running, solution).await,
        };
        if running.kind == SolveKind::PoseGraph {
            // Before the next pose graph: where closures keep coming, there is no other gap.
            self.start_background().await;
        }
        if running.is_job {
            self.solving.answer_job(answer);
        }
    }

    /// Commits a solution as the map's newest revision and acknowledges it. A result that is not possible
    /// is acknowledged as refused; if the journal fails, the streams end.
    async fn apply(
        &mut self,
        running: &Running,
        solution: Solution,
    ) -> Result<OptimizeOutcome, EngineError> {
        let Solution { moved, mut certificate, counts, proof, rebuilt, refused } = solution;
        if let Some(why) = refused {
            self.pool.discard(moved);
            let reason = format!("the window has no plausible result: {why}");
            let report = SolveReport::Refused { reason: reason.clone() };
            self.optimized(&running.triggers, running.id, &report);
            let (map, change) = (self.shared.name.clone(), "solve_applied");
            return Err(EngineError::Refused { map, change, reason });
        }
        certificate.held = self.held(&moved);
        let costs = (certificate.solve.initial_cost, certificate.solve.final_cost);
        if costs.1.is_finite() {
            let covered = self.solving.schedule.preview(&running.triggers);
            let reach = match running.kind {
                SolveKind::PoseGraph if !running.is_job => {
                    Reach::Noticeable { if_contradicted: !running.moves }
                }
                SolveKind::PoseGraph | SolveKind::LocalBundle | SolveKind::Global => Reach::All,
            };
            let result = self.result(moved, running.kind, covered, costs, reach).await;
            let applied = match result {
                Ok(mut solve) => {
                    solve.request = self.solving.request_of(running);
                    if self.shared.config.injects(Fault::ImpossibleResult) {
                        let poses = solve.poses.iter_mut();
                        poses.for_each(|(_, pose)| pose.translation.x = f64::INFINITY);
                    }
                    self.commit(None, Change::SolveApplied { solve }).await
                }
                Err(error) => Err(error),
            };
            if let Err(error) = applied {
                if let EngineError::Refused { reason, .. } = &error {
                    let report = SolveReport::Refused { reason: reason.clone() };
                    self.optimized(&running.triggers, running.id, &report);
                    return Err(error);
                }
                if let EngineError::Bug { .. } = error {
                    let report = SolveReport::Lost { bug: error.clone() };
                    self.optimized(&running.triggers, running.id, &report);
                    return Err(error);
                }
                tracing::warn!(%error, solve = running.id, "a solve could not be applied");
                self.ingest.end_all(&error);
                self.solving.schedule.clear();
                return Err(error);
            }
        } else {
            // The map keeps its estimates; the certificate reports the numerical failure.
            self.pool.discard(moved);
        }
        let certificate = Arc::new(certificate);
        let report = SolveReport::Solved(Arc::clone(&certificate));
        self.optimized(&running.triggers, running.id, &report);
        let switched_off = match running.is_job {
            true => self.compute(switched_off).await,
            false => Vec::new(),
        };
        let (revision, solve_id) = (self.map.revision(), running.id);
        Ok(OptimizeOutcome {
            certificate,
            revision,
            solve_id,
            counts,
            proof,
            switched_off,
            rebuilt,
        })
    }

    /// The result of a solve as it is to be journaled.
    ///
    /// # Errors
    /// [`EngineError::Refused`]: it would move what the map's gauge holds. [`EngineError::Bug`]. The map
    /// stays as it is.
    pub(crate) async fn result(
        &self,
        moved: Moved,
        kind: SolveKind,
        covered: Vec<(ClientIndex, i64)>,
        costs: (f64, f64),
        reach: Reach,
    ) -> Result<AppliedSolve, EngineError> {
        let panics = self.shared.config.injects(Fault::PanicInResult);
        let solve = move |map: &Map| {
            if panics {
                std::panic::panic_any("staged by a test");
            }
            let solved = moved.solved();
            let solve = applied(map, solved, kind, covered, costs, reach);
            let kept = map.keeps_gauge(solved.gauge(map), &solve);
            (solve, kept)
        };
        let (solve, kept) = self.attempt(solve).await?;
        match kept {
            Ok(()) => Ok(solve),
            Err(error) => {
                let change = Change::SolveApplied { solve };
                Err(self.refuse(&change, false, error.to_string()))
            }
        }
    }

    /// The keyframes that a window was to move and holds.
    pub(crate) fn held(&self, moved: &Moved) -> Vec<HeldKeyframe> {
        let Moved::Bundle(problem) = moved else { return Vec::new() };
        let named = |&(keyframe, reason): &(EntityId, Held)| {
            let client = self.map.client(keyframe.client)?.name.clone();
            Some(HeldKeyframe { client, id: keyframe.id, reason })
        };
        problem.held.iter().filter_map(named).collect()
    }
}

/// The constraints that are switched off, sorted by client name, then id.
pub(crate) fn switched_off(map: &Map) -> Vec<(String, i64, SwitchedOff)> {
    let named = map.switched_off().iter().map(|(id, &off)| {
        let client = map.client(id.client).map(|client| client.name.clone());
        (client.unwrap_or_default(), id.id, off)
    });
    let mut named: Vec<_> = named.collect();
    named.sort_unstable_by(|a, b| (&a.0, a.1).cmp(&(&b.0, b.1)));
    named
}
