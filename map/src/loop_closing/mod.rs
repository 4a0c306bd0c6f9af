//! Loop closing: which of the candidates for the place of a view are that place.
//!
//! Between the index of places ([`crate::place`]), the map and the geometric verification of
//! `covis-solvers`: a view's descriptors go to the index, what it finds is verified against the landmarks
//! around each candidate, and the first one that holds is the place. A verdict is a function of map,
//! view and candidates. Decision 0025 says what is believed of the odometry. No async and no clock;
//! nothing is changed here.
//!
//! | file | role |
//! |---|---|
//! | this | the place of a view, and the closure that a keyframe makes |
//! | `localization` | where a lost camera is |
//! | `alignment` | where one map lies in another |
//! | `path` | what the way between two keyframes excludes |

mod alignment;
mod localization;
mod path;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;

use covis_solvers::geometric_verification::{
    self as verification, Feature, Input, InputError, Options, Proposed, Refusal, Verdict, Verified,
};
use covis_solvers::geometry::{Camera, LieGroup, Se3};
use covis_solvers::interrupt::Interrupt;
use covis_solvers::point_matching::Likeness;
use covis_solvers::relative_motion::PointEstimate;

pub use alignment::{Alignment, NotAligned, align};
pub use localization::{Localization, localize};

use crate::place::{self, Candidate, DESCRIPTOR_BYTES, PlaceError};
use crate::{
    Constraint, ConstraintKind, Descriptor, DescriptorKind, EntityId, Keyframe, Map, Observation,
    PlaceCandidate, PlaceRefusal, PlaceSearch, Surroundings, View, likeness,
};

/// Keyframes of a client before another one that are not candidates: it has hardly left their place.
const RECENT: usize = 10;

/// Most keyframes that count as observers of a landmark where matches are weighted: one seen so often is
/// no more stable than the next.
const MOST_OBSERVERS: usize = 10;

/// What a camera sees.
#[derive(Clone, Debug)]
pub struct QueryView<'a> {
    /// The camera.
    pub camera: Camera,
    /// Its id in the map, where it is one of the map's.
    pub camera_id: Option<EntityId>,
    /// What it measures.
    pub features: Vec<Feature>,
    /// What each feature looks like, where that is known.
    pub descriptors: Vec<Option<&'a Descriptor>>,
    /// What the whole image looks like, where that is known.
    pub image: Option<&'a Descriptor>,
}

impl<'a> QueryView<'a> {
    /// What a keyframe sees; `None` where it has no camera.
    #[must_use]
    pub fn of_keyframe(map: &'a Map, keyframe: &'a Keyframe) -> Option<Self> {
        let view = map.views(keyframe).next()?;
        let feature = |seen: &Observation| Feature {
            pixel: seen.pixel,
            sigma_px: seen.sigma_px,
            depth_m: seen.depth.map(|depth| (depth.depth_m, depth.sigma_m)),
        };
        Some(Self {
            camera: view.camera.camera,
            camera_id: Some(view.camera_id),
            features: view.observations.iter().map(feature).collect(),
            descriptors: view.observations.iter().map(|o| o.descriptor.as_deref()).collect(),
            image: keyframe.global_descriptor.as_deref(),
        })
    }

    /// The features that the index of places compares, and their indices among [`QueryView::features`].
    pub fn searchable(&self) -> (Vec<usize>, Vec<place::Feature<'a>>) {
        searchable(self.descriptors.iter().copied())
    }
}

/// The descriptor of a whole image, as the index of places compares it.
#[must_use]
pub fn comparable(image: Option<&Descriptor>) -> Option<place::Feature<'_>> {
    let Descriptor { kind, name, data } = image?;
    (*kind == DescriptorKind::Float32).then_some(place::Feature { name, data })
}

/// The descriptors that the index of places can hold, and their indices in a list.
fn searchable<'a>(
    all: impl Iterator<Item = Option<&'a Descriptor>>,
) -> (Vec<usize>, Vec<place::Feature<'a>>) {
    let feature = |(at, descriptor): (usize, Option<&'a Descriptor>)| {
        let Descriptor { kind, name, data } = descriptor?;
        let fits = *kind == DescriptorKind::Binary && DESCRIPTOR_BYTES.contains(&data.len());
        fits.then_some((at, place::Feature { name, data }))
    };
    all.enumerate().filter_map(feature).unzip()
}

/// The features of a keyframe as the index holds them, and their indices among its observations.
#[must_use]
pub fn indexed(keyframe: &Keyframe) -> (Vec<usize>, Vec<place::Feature<'_>>) {
    searchable(keyframe.observations.iter().map(|seen| seen.descriptor.as_deref()))
}

/// The keyframes that are no candidates for the place of `keyframe`: itself, the last ones of its client
/// before it, those that the pose graph or a closure joins with it already.
#[must_use]
pub fn excluded(map: &Map, keyframe: EntityId) -> BTreeSet<EntityId> {
    let mut excluded = BTreeSet::from([keyframe]);
    let Some(query) = map.keyframes().get(&keyframe) else { return excluded };
    let threshold = u32::try_from(map.policy().min_shared_landmarks.max(1)).unwrap_or(u32::MAX);
    let sharing = map.covisibility().neighbors(keyframe);
    excluded.extend(sharing.filter(|&(_, shared)| shared >= threshold).map(|(id, _)| id));
    let ties = map.ties().of(keyframe).filter_map(|tie| map.constraints().get(&tie));
    excluded.extend(ties.flat_map(|constraint| [constraint.keyframe_i, constraint.keyframe_j]));
    let time = (query.capture_time_ns, keyframe);
    let before =
        map.keyframes().range(keyframe.client.ids()).map(|(&id, k)| (k.capture_time_ns, id));
    let mut before: Vec<(i64, EntityId)> = before.filter(|&other| other < time).collect();
    let first = before.len().saturating_sub(RECENT);
    if first > 0 {
        before.select_nth_unstable(first);
    }
    excluded.extend(before[first..].iter().map(|&(_, id)| id));
    excluded
}

/// The place of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Located {
    /// The keyframe that shows it.
    pub keyframe: EntityId,
    /// The pose of the view in the world, by the keyframe's current estimate.
    pub world_from_view: Se3,
    /// The pose of the view in the frame of that keyframe, and what it rests on.
    pub verified: Verified,
    /// The landmarks of the inliers with the features that show them.
    pub landmarks: Vec<(EntityId, usize)>,
    /// Of each of these landmarks, the keyframe that determines where it is.
    pub sources: Vec<EntityId>,
}

/// Verifies the candidates for the place of a view in their order, until one holds. `seed` of the random
/// numbers, beside the candidate's id.
#[must_use]
pub fn locate(
    map: &Map,
    view: &QueryView<'_>,
    candidates: &[Candidate],
    seed: u64,
    interrupt: &Interrupt,
    accept: impl Fn(EntityId, &Verified) -> Result<(), Refusal>,
) -> (Vec<PlaceCandidate>, Option<Located>) {
    let (indices, _) = view.searchable();
    let mut verified = Vec::new();
    for candidate in candidates.iter().take(PlaceSearch::MOST_CANDIDATES) {
        let Some(keyframe) = map.keyframes().get(&candidate.keyframe) else { continue };
        let id = candidate.keyframe;
        let found = judge_candidate(map, view, &indices, candidate, keyframe, seed, interrupt);
        let found = found.and_then(|(located, doubt)| {
            doubt.map_or(Ok(()), Err)?;
            accept(id, &located.verified).map_err(|refusal| refused(&refusal))?;
            Ok(located)
        });
        let (located, refusal) = match found {
            Ok(located) => (Some(located), None),
            Err(refusal) => (None, Some(refusal)),
        };
        verified.push(listed(candidate, refusal));
        if located.is_some() {
            return (verified, located);
        }
    }
    (verified, None)
}

/// A candidate as it is kept, with its verdict.
fn listed(candidate: &Candidate, refusal: Option<PlaceRefusal>) -> PlaceCandidate {
    let Candidate { keyframe, score, matches, .. } = candidate;
    let matches = u32::try_from(matches.len()).unwrap_or(u32::MAX);
    PlaceCandidate { keyframe: *keyframe, score: *score, matches, refusal }
}

fn refused(refusal: &Refusal) -> PlaceRefusal {
    PlaceRefusal::new(refusal.name(), &refusal.to_string())
}

/// What the map or a client holds is not possible as input: numbers that overflow, for instance.
fn unusable(error: &InputError) -> PlaceRefusal {
    PlaceRefusal::new("refinement_failed", &error.to_string())
}

/// The pose of the view by a candidate, and what makes it doubtful that this is the place.
fn judge_candidate(
    map: &Map,
    view: &QueryView<'_>,
    indices: &[usize],
    candidate: &Candidate,
    keyframe: &Keyframe,
    seed: u64,
    interrupt: &Interrupt,
) -> Result<(Located, Option<PlaceRefusal>), PlaceRefusal> {
    // Most candidates are none, and to know what is around them takes longer than to see that.
    let (found, needed) = (candidate.matches.len(), verification::MIN_INLIERS);
    if found < needed {
        return Err(refused(&Refusal::TooFewMatches { matches: found, needed }));
    }
    let around = Surroundings::of_keyframe(map, candidate.keyframe, interrupt);
    let camera_from_world = keyframe.world_from_camera.inverse();
    let turn = camera_from_world.rotation.matrix();
    let point = |estimate: &PointEstimate| PointEstimate {
        point: camera_from_world.transform(&estimate.point),
        covariance: turn * estimate.covariance * turn.transpose(),
    };
    let points: Vec<PointEstimate> = around.points.iter().map(point).collect();
    let (at_candidate, _) = indexed(keyframe);
    let mut matches: Vec<Proposed> = Vec::new();
    let mut taken = BTreeSet::new();
    for found in &candidate.matches {
        let Some(&feature) = indices.get(found.query) else { continue };
        let observation = at_candidate.get(found.candidate);
        let Some(seen) = observation.and_then(|&at| keyframe.observations.get(at)) else {
            continue;
        };
        let Ok(point) = around.landmarks.binary_search(&seen.landmark) else { continue };
        // Two features may show one landmark.
        if taken.insert(point) {
            let observers = map.landmarks().get(&seen.landmark).map_or(1, |l| l.observers.len());
            let weight = observers.clamp(1, MOST_OBSERVERS) as f64;
            matches.push(Proposed { point, feature, weight });
        }
    }
    let calibration = verification::Options::default().calibration;
    let is_same = |candidate: View<'_>| view.camera_id == Some(candidate.camera_id);
    let same_camera = map.views(keyframe).any(is_same);
    let options = Options {
        calibration: covis_solvers::relative_motion::Calibration { same_camera, ..calibration },
        ..Options::default()
    };
    let input = Input {
        camera: &view.camera,
        features: &view.features,
        points: &points,
        matches: &matches,
        expected: None,
        seed: seed ^ (candidate.keyframe.id as u64).rotate_left(32),
    };
    let likeness = |point: usize, feature: usize| {
        let pair = around.descriptors[point].zip(view.descriptors[feature]);
        pair.map_or(Likeness::Unknown, |(a, b)| likeness(a, b))
    };
    let verdict = verification::verify(&input, &likeness, &options);
    let (verified, doubt) = match verdict.map_err(|error| unusable(&error))? {
        Verdict::Refused(refusal) => return Err(refused(&refusal)),
        Verdict::Doubtful(verified, doubt) => (*verified, Some(refused(&doubt))),
        Verdict::Accepted(verified) => (*verified, None),
    };
    let landmark = |&(point, feature): &(usize, usize)| (around.landmarks[point], feature);
    let landmarks = verified.inliers.iter().map(landmark).collect();
    let sources = verified.inliers.iter().map(|&(point, _)| around.keyframes[point]).collect();
    let world_from_view = keyframe.world_from_camera.compose(&verified.candidate_from_query);
    let keyframe = candidate.keyframe;
    Ok((Located { keyframe, world_from_view, verified, landmarks, sources }, doubt))
}

/// Judges the candidates for the place of a keyframe, in their order, and makes a loop closure of the first
/// one that holds, where the way that the robot went does not exclude it. The closure has no id yet.
#[must_use]
pub fn find_loop_closure(
    map: &Map,
    keyframe: EntityId,
    view: &QueryView<'_>,
    candidates: &[Candidate],
    interrupt: &Interrupt,
) -> (PlaceSearch, Option<Constraint>) {
    let accept = |candidate, verified: &Verified| {
        path::expected(map, candidate, keyframe, interrupt)
            .map_or(Ok(()), |expected| expected.is_met_by(verified))
    };
    let seed = keyframe.id as u64;
    let (candidates, located) = locate(map, view, candidates, seed, interrupt, accept);
    let closure = located.map(|located| Constraint {
        kind: ConstraintKind::LoopClosure,
        keyframe_i: located.keyframe,
        keyframe_j: keyframe,
        keyframe_i_from_keyframe_j: located.verified.candidate_from_query,
        information: located.verified.information,
        loss: None,
    });
    (PlaceSearch { candidates, ..PlaceSearch::default() }, closure)
}

/// Why the index cannot take the descriptors of a keyframe.
#[must_use]
pub fn not_indexed(error: &PlaceError) -> PlaceRefusal {
    PlaceRefusal::new("descriptors", &error.to_string())
}
