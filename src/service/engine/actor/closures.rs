//! What follows a loop closure: the engine starts the comparison of places and the adjustment of the map, and
//! journals what they made. Items are accepted meanwhile.

use super::Actor;
use crate::map::{AppliedSolve, Change, Map, Reach, SolveKind};
use crate::service::engine::EngineError;
use crate::service::engine::outcome::{Outcome, Solution};
use crate::service::engine::pool::Ended;
use crate::service::engine::solving::after_closures::{Done, Task};

impl Actor {
    /// Whether nothing runs in the background, or what is due there has to wait.
    pub(crate) fn is_background_idle(&self) -> bool {
        let is_idle = self.recognition.is_idle(&self.map) && self.background.is_idle();
        is_idle || !self.closing.is_empty() || self.is_held()
    }

    /// Starts the next background task, if one is due.
    pub(crate) async fn start_background(&mut self) {
        if !self.background.may_start() || self.check_open().is_err() {
            return;
        }
        let has_duplicates = !self.background.is_off() && !self.map.duplicates().is_empty();
        let split = match has_duplicates {
            true => self.attempt(Map::false_duplicates).await,
            false => Ok(Default::default()),
        };
        if split.is_err() {
            self.background.turn_off();
        }
        if let Ok((closures, landmarks)) = split
            && !closures.is_empty()
        {
            let split = Change::DuplicatesSplit { closures, landmarks };
            if !self.commit_in_background(split).await {
                return;
            }
        }
        let is_lock_step = self.ingest.is_lock_step();
        let searches = is_lock_step && !self.recognition.is_idle(&self.map);
        let leaves_room = self.solving.leaves_room(is_lock_step);
        if leaves_room && !is_lock_step && self.background.has_nothing_to_adjust(&self.map) {
            self.background.rest();
            self.commit_in_background(Change::SolveApplied {
                solve: AppliedSolve::unchanged(SolveKind::Global),
            })
            .await;
        } else if (leaves_room || !is_lock_step) && !searches {
            self.background.start(&self.map, is_lock_step, leaves_room);
        }
    }

    /// Handles the end of the background task.
    pub(crate) async fn background_ended(&mut self, (task, ended): (Task, Ended<Done>)) {
        self.background.ended();
        let done = match ended {
            Ended::Made(done) => done,
            Ended::Dropped => return self.background.dropped(task),
            Ended::Panicked { panicked, .. } => {
                self.lost(&panicked);
                self.background.turn_off();
                return;
            }
        };
        let change = match done {
            Done::Compared(mut comparisons) => {
                comparisons.retain_mut(|comparison| self.map.keeps(comparison));
                if comparisons.is_empty() {
                    return;
                }
                Change::DuplicatesFound { comparisons }
            }
            Done::Adjusted(outcome) => match self.adjustment(&task, *outcome).await {
                Some(change) => change,
                None => return self.background.dropped(task),
            },
        };
        if !self.commit_in_background(change).await {
            self.background.dropped(task);
        }
    }

    /// Commits a change for which no client waits. Where the journal does not take it, nothing is lost:
    /// what is due is found again. An adjustment whose result is not possible is not tried again before the
    /// next pose graph. Returns whether it is committed.
    async fn commit_in_background(&mut self, change: Change) -> bool {
        let is_whole = matches!(
            &change,
            Change::SolveApplied { solve } if solve.kind == SolveKind::Global
        );
        let committed = self.commit(None, change).await;
        if let Err(error) = &committed {
            if is_whole && matches!(error, EngineError::Refused { .. }) {
                self.background.give_up();
            }
            let map = &self.shared.name;
            tracing::warn!(%error, %map, "the work after a loop closure waits for the journal");
            self.background.wait_for_journal();
        }
        committed.is_ok()
    }

    /// The change that an adjustment in the background makes, if there is one.
    async fn adjustment(&mut self, task: &Task, outcome: Outcome) -> Option<Change> {
        let solution = outcome.unwrap_or_else(|error| {
            let map = &self.shared.name;
            tracing::warn!(%error, %map, "the map could not be adjusted after a closure");
            None
        });
        let is_sound = |solution: &Solution| {
            solution.refused.is_none() && solution.certificate.solve.final_cost.is_finite()
        };
        let Some(Solution { moved, certificate, .. }) = solution.filter(is_sound) else {
            self.background.give_up();
            return None;
        };
        // It moves what the window holds.
        self.solving.supersede_window();
        let costs = (certificate.solve.initial_cost, certificate.solve.final_cost);
        let (kind, reach) = (SolveKind::Global, Reach::Noticeable { if_contradicted: false });
        let solve = self.result(moved, kind, Vec::new(), costs, reach).await.ok();
        if solve.is_none() {
            self.background.give_up();
        }
        let mut solve = solve?;
        if task.is_overtaken || self.map.uncompared_closures().next().is_some() {
            // What the pose graph moved, or a comparison will join, is still to be adjusted.
            solve.kind = SolveKind::LocalBundle;
        }
        Some(Change::SolveApplied { solve })
    }
}
