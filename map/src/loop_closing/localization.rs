//! Where a camera is that nobody knows anything of: every candidate is verified, and no two of those that
//! hold may contradict each other.
//!
//! A room may have two places that look the same. Each of them passes the geometric verification; that
//! both do shows that neither is known to be the place. A pose counts by its matches that are evidence of
//! their own. Nothing is changed here.

use std::cmp::Reverse;

use covis_solvers::geometry::LieGroup;
use covis_solvers::information::Information;
use covis_solvers::interrupt::Interrupt;
use nalgebra::{Matrix3, Matrix6, Vector6};

use super::alignment::meter;
use super::path::{self, DRIFT, LEAST, TURN_BY_ANGLE, TURN_BY_LENGTH};
use super::{Located, QueryView, judge_candidate, listed};
use crate::place::Candidate;
use crate::{Map, PlaceCandidate, PlaceRefusal, PlaceSearch};

/// Differences that agree, in standard deviations.
const SIGMAS: f64 = 3.0;
/// Share of the best pose's evidence from which a pose that contradicts it makes the place ambiguous: the
/// same share as between two poses of one candidate.
const RIVAL: f64 = 0.6;

/// Longest way along which a map may have drifted between two keyframes of one place, m: about a room. On a
/// longer one any two places would be one.
const LONGEST_WAY: f64 = 15.0;

/// Where a camera is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Localization {
    /// The candidates that were verified. The place is the last one, where there is one.
    pub candidates: Vec<PlaceCandidate>,
    /// The place; `None` where no candidate holds, or where some that hold contradict each other.
    pub located: Option<Located>,
    /// The poses that contradict each other, the one with most evidence first.
    pub rivals: Vec<Located>,
}

/// A candidate, and the pose that it gives. One that has a refusal is doubtful.
type Judged = (PlaceCandidate, Option<Located>);

fn evidence((_, located): &Judged) -> usize {
    located.as_ref().map_or(0, |located| located.verified.independent)
}

/// Verifies the candidates for the place of a view. The one with most evidence is the place, unless
/// another one, be it doubtful, has about as much for another pose.
#[must_use]
pub fn localize(
    map: &Map,
    view: &QueryView<'_>,
    candidates: &[Candidate],
    interrupt: &Interrupt,
) -> Localization {
    let (indices, _) = view.searchable();
    let meter = meter(map);
    let mut found: Vec<Judged> = Vec::new();
    let mut most = 0;
    for candidate in candidates.iter().take(PlaceSearch::MOST_CANDIDATES) {
        let Some(keyframe) = map.keyframes().get(&candidate.keyframe) else { continue };
        let matches = candidate.matches.len();
        // One with too few matches to contradict what was found is not worth a search for its pose.
        if !is_rival(matches, most) {
            found.push((listed(candidate, Some(outweighed(matches, most))), None));
            continue;
        }
        let judged = judge_candidate(map, view, &indices, candidate, keyframe, 0, interrupt);
        let (located, refusal) = match judged {
            Ok((located, doubt)) => (Some(drifting(map, located, meter)), doubt),
            Err(refusal) => (None, Some(refusal)),
        };
        let judged = (listed(candidate, refusal), located);
        if judged.0.refusal.is_none() {
            most = most.max(evidence(&judged));
        }
        found.push(judged);
    }
    // The order of the candidates stays among those with equal evidence.
    found.sort_by_key(|judged| (judged.0.refusal.is_some(), Reverse(evidence(judged))));
    let is_place = |(candidate, _): &&Judged| candidate.refusal.is_none();
    let Some(best) = found.first().filter(is_place).and_then(|(_, located)| located.clone()) else {
        let candidates = found.into_iter().map(|(candidate, _)| candidate).collect();
        return Localization { candidates, ..Localization::default() };
    };
    let most = best.verified.independent;
    let mut rivals = Vec::new();
    for (candidate, located) in &mut found {
        let Some(other) = located.take_if(|other| !agree(map, &best, other, meter, interrupt))
        else {
            continue;
        };
        let own = other.verified.independent;
        if is_rival(own, most) {
            candidate.refusal = Some(ambiguous(own, most));
            rivals.push(other);
        } else if candidate.refusal.is_none() {
            candidate.refusal = Some(outweighed(own, most));
        }
    }
    rivals.sort_by_key(|rival| Reverse(rival.verified.independent));
    let located = match rivals.first().map(|rival| rival.verified.independent) {
        None => Some(best),
        Some(other) => {
            let agreeing = found.iter_mut().filter(|(c, _)| c.refusal.is_none());
            agreeing.for_each(|(c, _)| c.refusal = Some(ambiguous(most, other)));
            rivals.insert(0, best);
            None
        }
    };
    // The best one becomes the last.
    found.rotate_left(1);
    let candidates = found.into_iter().map(|(candidate, _)| candidate).collect();
    Localization { candidates, located, rivals }
}

fn is_rival(evidence: usize, most: usize) -> bool {
    evidence as f64 >= RIVAL * most as f64
}

fn ambiguous(own: usize, other: usize) -> PlaceRefusal {
    let text =
        format!("another candidate has a pose elsewhere with {other} inliers, this one has {own}");
    PlaceRefusal::new("ambiguous", &text)
}

fn outweighed(own: usize, most: usize) -> PlaceRefusal {
    let text = format!("{own} matches or inliers, and another candidate has {most} inliers");
    PlaceRefusal::new("outweighed", &text)
}

/// The answer with a covariance that includes how far the keyframe may have drifted from those that determine
/// where the landmarks are: all landmarks of one have the same error, which no number of them makes less.
fn drifting(map: &Map, mut located: Located, meter: f64) -> Located {
    let pose = |id| map.keyframes().get(&id).map(|keyframe| keyframe.world_from_camera);
    let Some(from) = pose(located.keyframe).map(|pose| pose.inverse()) else { return located };
    let (mut length, mut angle) = (0.0, 0.0);
    for motion in located.sources.iter().filter_map(|&id| Some(from.compose(&pose(id)?))) {
        length += motion.translation.norm();
        angle += motion.rotation.log().norm();
    }
    let count = located.sources.len().max(1) as f64;
    let (length, angle) = (length / count, angle / count);
    let (position, turn) =
        (DRIFT * length, TURN_BY_LENGTH * length / meter + TURN_BY_ANGLE * angle);
    let sigmas = Vector6::new(position, position, position, turn, turn, turn);
    // An error of the landmarks in the frame of the keyframe, as one of the pose in its own.
    let moved = located.verified.candidate_from_query.inverse().adjoint();
    let drift = moved * Matrix6::from_diagonal(&sigmas.map(|sigma| sigma * sigma));
    let with_drift = located
        .verified
        .information
        .covariance()
        .ok()
        .and_then(|covariance| (covariance.matrix() + drift * moved.transpose()).cholesky())
        .map(|cholesky| cholesky.inverse())
        .and_then(|inverse| Information::new(&((inverse + inverse.transpose()) * 0.5)).ok());
    if let Some(information) = with_drift {
        located.verified.information = information;
    }
    located
}

/// Whether two answers are one place, as far as they are known and as the map may have drifted between
/// their keyframes. `meter` is the length of a meter in the map, about.
fn agree(map: &Map, a: &Located, b: &Located, meter: f64, interrupt: &Interrupt) -> bool {
    let sigma = |located: &Located, at: usize| {
        let covariance = located.verified.information.covariance().ok()?;
        let block: Matrix3<f64> = covariance.matrix().fixed_view::<3, 3>(at, at).into_owned();
        Some(block.symmetric_eigenvalues().max().max(0.0).sqrt())
    };
    let sigmas = |at: usize| Some(sigma(a, at)?.hypot(sigma(b, at)?));
    let Some((by_pose, by_turn)) = sigmas(0).zip(sigmas(3)) else { return false };
    let error = a.world_from_view.inverse().compose(&b.world_from_view);
    let (position, rotation) = (error.translation.norm(), error.rotation.log().norm());
    let is_within = |way: f64, angle: f64| {
        let turn = LEAST.1 + TURN_BY_LENGTH * way + TURN_BY_ANGLE * angle;
        let drift = (LEAST.0 + (DRIFT + turn / 2.0) * way) * meter;
        position <= SIGMAS * drift.hypot(by_pose) && rotation <= SIGMAS * turn.hypot(by_turn)
    };
    let pose = |located: &Located| Some(map.keyframes().get(&located.keyframe)?.world_from_camera);
    let Some((from, to)) = pose(a).zip(pose(b)) else { return false };
    let motion = from.inverse().compose(&to);
    // The shortest way that there can be takes no search.
    is_within(motion.translation.norm() / meter, motion.rotation.log().norm())
        || path::shortest(map, a.keyframe, b.keyframe, LONGEST_WAY * meter, interrupt)
            .is_some_and(|way| is_within(way.length / meter, way.angle))
}
