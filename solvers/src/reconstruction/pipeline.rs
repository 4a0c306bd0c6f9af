//! The stages of a reconstruction in their order, with one clock, one interrupt and one observer.
//!
//! No stage is done here. A stage that is cut short leaves the estimate as it was before it, and the run
//! ends with what there is.

use std::time::Instant;

use super::bearings::Bearings;
use super::frame;
use super::positions::global_positions;
use super::relative_poses::{Edge, Measuring};
use super::rotations;
use super::view_graph::{self, Candidate};
use super::{
    Estimate, Frame, Observer, Options, Placement, Progress, Reconstruction, Scale, Stage,
    Unplaced, ViewGraph,
};
use crate::bundle_adjustment::BundleSummary;
use crate::geometry::Se3;
use crate::interrupt::{Interrupt, Interruption};
use crate::optimizer::Control;
use crate::price::Limits;
use crate::problem::{BundleProblem, DisjointSets, SolveError};

/// Rounds of averaging and leaving out false edges.
const ROTATION_ROUNDS: usize = 5;

/// A run.
pub(super) struct Run<'a, 'o> {
    pub(super) problem: &'a BundleProblem,
    pub(super) options: &'a Options,
    pub(super) interrupt: Interrupt,
    pub(super) report: Report<'a, 'o>,
    pub(super) bearings: Bearings,
    pub(super) estimate: Estimate,
    pub(super) view_graph: ViewGraph,
    pub(super) adjustment: Option<BundleSummary>,
    /// Of each keyframe without a pose.
    pub(super) reasons: Vec<Unplaced>,
    /// Keyframes that are placed by relative poses.
    pub(super) is_strung: Vec<bool>,
}

/// The observer, with the clock and whether it canceled.
pub(super) struct Report<'a, 'o> {
    observer: &'a mut Observer<'o>,
    begin: Instant,
    is_cancelled: bool,
}

impl Report<'_, '_> {
    /// Tells how far a stage is; whether the work goes on.
    pub(super) fn tell(
        &mut self,
        stage: Stage,
        done: usize,
        total: usize,
        cost: Option<f64>,
    ) -> Control {
        let seconds = self.begin.elapsed().as_secs_f64();
        let progress = Progress { stage, done, total, cost, seconds };
        self.is_cancelled |= (self.observer)(&progress) == Control::Cancel;
        if self.is_cancelled { Control::Cancel } else { Control::Continue }
    }
}

impl<'a, 'o> Run<'a, 'o> {
    pub(super) fn new(
        problem: &'a BundleProblem,
        options: &'a Options,
        interrupt: &Interrupt,
        observer: &'a mut Observer<'o>,
    ) -> Self {
        let begin = Instant::now();
        let bearings = Bearings::new(problem);
        let estimate = Estimate {
            poses: vec![None; problem.poses.len()],
            points: vec![None; problem.landmarks.len()],
            cameras: problem.cameras.clone(),
            used: vec![false; bearings.all.len()],
        };
        Self {
            problem,
            options,
            interrupt: interrupt.or_after(begin, options.optimizer.deadline),
            report: Report { observer, begin, is_cancelled: false },
            bearings,
            estimate,
            view_graph: ViewGraph::default(),
            adjustment: None,
            reasons: vec![Unplaced::Interrupted; problem.poses.len()],
            is_strung: vec![false; problem.poses.len()],
        }
    }

    pub(super) fn run(mut self) -> Result<Reconstruction, SolveError> {
        self.stages()?;
        let has_depth = self.has_depth();
        let scale = self.choose_frame_and_scale(has_depth);
        Ok(self.finish(scale))
    }

    fn stages(&mut self) -> Result<(), SolveError> {
        let edges = self.view_graph_edges();
        if self.is_due() || !self.place_globally(&edges)? {
            return Ok(());
        }
        self.adjust_narrowing()?;
        self.resect_all()?;
        self.string_along_relative_poses()?;
        self.adjust_last()
    }

    pub(super) fn is_due(&self) -> bool {
        self.report.is_cancelled || self.interrupt.is_due()
    }

    /// Stages 1 and 2.
    fn view_graph_edges(&mut self) -> Vec<Edge> {
        let count = self.problem.poses.len();
        self.report.tell(Stage::ViewGraph, 0, count, None);
        if self.is_due() {
            return Vec::new();
        }
        let candidates =
            view_graph::candidates(&self.bearings, self.options.min_common, &self.interrupt);
        let mut chosen = view_graph::selected(&candidates, count, self.options.max_neighbors);
        self.report.tell(Stage::ViewGraph, count, count, None);
        let pairs: Vec<Candidate> = chosen.iter().map(|&index| candidates[index]).collect();
        let mut edges = self.measure(&pairs, 0);
        if self.is_due() {
            return Vec::new();
        }
        // Pairs that join what is apart so far.
        let further = view_graph::between_pieces(&candidates, &chosen, &edges, count);
        let pairs: Vec<Candidate> = further.iter().map(|&index| candidates[index]).collect();
        edges.extend(self.measure(&pairs, chosen.len()));
        chosen.extend(further);
        self.view_graph = ViewGraph {
            pairs: candidates.len(),
            measured: chosen.len(),
            edges: edges.len(),
            agreeing: 0,
        };
        if !self.is_due() {
            let measured: Vec<Candidate> = chosen.iter().map(|&index| candidates[index]).collect();
            self.explain(&measured, &edges);
        }
        edges
    }

    fn measure(&mut self, pairs: &[Candidate], before: usize) -> Vec<Edge> {
        let measuring = Measuring {
            bearings: &self.bearings,
            cameras: &self.problem.cameras,
            allowance: self.options.sigma_allowance,
            min_common: self.options.min_common,
            seed: self.options.seed,
        };
        let (report, total) = (&mut self.report, before + pairs.len());
        let mut done = |count: usize| {
            report.tell(Stage::RelativePoses, before + count, total, None) == Control::Continue
        };
        measuring.all(pairs, &self.interrupt, &mut done)
    }

    /// The reasons of keyframes that the view graph leaves alone.
    fn explain(&mut self, measured: &[Candidate], edges: &[Edge]) {
        let count = self.problem.poses.len();
        let mut pairs = vec![0; count];
        measured.iter().for_each(|c| [c.a, c.b].iter().for_each(|&pose| pairs[pose] += 1));
        let mut sets = DisjointSets::new(count);
        edges.iter().for_each(|edge| _ = sets.join(edge.a, edge.b));
        let mut sizes = vec![0_usize; count];
        (0..count).for_each(|pose| sizes[sets.root(pose)] += 1);
        for pose in 0..count {
            let needed = self.options.min_common;
            let others = sizes[sets.root(pose)] - 1;
            self.reasons[pose] = if self.bearings.of_pose[pose].is_empty() {
                Unplaced::NoObservations
            } else if pairs[pose] == 0 {
                let most = view_graph::most_common(&self.bearings, pose);
                Unplaced::TooFewCommon { most, needed }
            } else if others == 0 {
                Unplaced::NoRelativePose { pairs: pairs[pose] }
            } else {
                Unplaced::Disconnected { others }
            };
        }
    }

    /// Stages 3 and 4; whether there is anything to go on with.
    fn place_globally(&mut self, edges: &[Edge]) -> Result<bool, SolveError> {
        let count = self.problem.poses.len();
        let ceiling = self.options.optimizer.ceiling;
        let mut kept: Vec<&Edge> = edges.iter().collect();
        let mut averaged = vec![None; count];
        for round in 0..ROTATION_ROUNDS {
            self.report.tell(Stage::Rotations, round, ROTATION_ROUNDS, None);
            if self.is_due() {
                return Ok(false);
            }
            let piece = rotations::largest_piece(&kept, count);
            if piece.len() < 2 {
                return Ok(false);
            }
            let limits = Limits { ceiling, interrupt: &self.interrupt };
            let Some(found) = rotations::average(&kept, &piece, count, limits)? else {
                return Ok(false);
            };
            let before = kept.len();
            // Edges of other pieces are not looked at any more.
            kept.retain(|edge| rotations::agrees(edge, &found));
            averaged = found;
            if kept.len() == before {
                break;
            }
        }
        let piece = rotations::largest_piece(&kept, count);
        for (pose, rotation) in averaged.iter_mut().enumerate() {
            if piece.binary_search(&pose).is_err() {
                *rotation = None;
            } else {
                self.reasons[pose] =
                    Unplaced::Inconsistent { agreeing: 0, needed: self.options.min_observations };
            }
        }
        self.view_graph.agreeing = kept.len();
        // A keyframe that nothing sees from elsewhere has no position.
        let mut has_parallax = vec![false; count];
        for edge in kept.iter().filter(|edge| edge.has_parallax) {
            (has_parallax[edge.a], has_parallax[edge.b]) = (true, true);
        }
        for &pose in &piece {
            if !has_parallax[pose] {
                averaged[pose] = None;
                self.reasons[pose] = Unplaced::NoParallax;
            }
        }
        let mut votes = vec![0_i32; self.bearings.all.len()];
        for edge in &kept {
            for &(s, t, agrees) in &edge.votes {
                let vote = if agrees { 1 } else { -1 };
                votes[s as usize] += vote;
                votes[t as usize] += vote;
            }
        }
        let used: Vec<bool> = votes.iter().map(|&votes| votes >= 0).collect();
        let (report, total) = (&mut self.report, super::positions::MAX_ITERATIONS);
        let mut row = |done: usize, cost: f64| {
            report.tell(Stage::Positions, done, total, Some(cost)) == Control::Continue
        };
        let seed = self.options.seed;
        let (bearings, interrupt) = (&self.bearings, &self.interrupt);
        let limits = Limits { ceiling, interrupt };
        let found = global_positions(bearings, &averaged, &used, seed, limits, &mut row)?;
        let Some(positions) = found else {
            return Ok(false);
        };
        for (pose, (rotation, center)) in averaged.iter().zip(&positions.centers).enumerate() {
            self.estimate.poses[pose] = rotation.zip(*center).map(|(r, c)| Se3::new(r, c));
        }
        self.estimate.points = positions.points;
        Ok(true)
    }

    pub(super) fn placed(&self) -> usize {
        self.estimate.poses.iter().flatten().count()
    }

    pub(super) fn has_depth(&self) -> bool {
        let mut used = self.bearings.all.iter().zip(&self.estimate.used);
        used.any(|(bearing, used)| *used && bearing.seen.depth_m.is_some())
    }

    /// Stage 7.
    fn choose_frame_and_scale(&mut self, has_depth: bool) -> Scale {
        let mut scale = if has_depth { Some(Scale::Depth) } else { None };
        if scale.is_none()
            && let Some(factor) = frame::scale_by_relative_poses(self.problem, &self.estimate)
        {
            frame::rescale(&mut self.estimate, factor);
            scale = Some(Scale::RelativePoses);
        }
        if self.options.frame == Frame::Given {
            let given = frame::to_given(&self.problem.poses, &mut self.estimate, scale.is_some());
            return scale.unwrap_or(if given { Scale::Given } else { Scale::Convention });
        }
        frame::to_own(&self.bearings, &mut self.estimate, scale.is_some());
        scale.unwrap_or(Scale::Convention)
    }

    fn finish(self, scale: Scale) -> Reconstruction {
        let placement = |pose: usize| match (self.estimate.poses[pose], self.is_strung[pose]) {
            (Some(_), false) => Placement::Views,
            (Some(_), true) => Placement::RelativePoses,
            (None, _) => Placement::Unplaced(self.reasons[pose]),
        };
        let placements = (0..self.problem.poses.len()).map(placement).collect();
        let (plain, depth) = self.estimate.used.split_at(self.problem.reprojections.len());
        let cancelled = self.report.is_cancelled.then_some(Interruption::Cancelled);
        Reconstruction {
            placements,
            reprojections: plain.to_vec(),
            depth_reprojections: depth.to_vec(),
            poses: self.estimate.poses,
            landmarks: self.estimate.points,
            cameras: self.estimate.cameras,
            scale,
            view_graph: self.view_graph,
            adjustment: self.adjustment,
            ended: cancelled.or_else(|| self.interrupt.reason()),
            seconds: self.report.begin.elapsed().as_secs_f64(),
        }
    }
}
