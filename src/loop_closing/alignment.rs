//! How one map lies in another one: places of the source are searched in the target until enough of them
//! say the same.
//!
//! Nothing else is known of the two frames, so that one place proves nothing: a room may have a twin. The
//! places are taken from all over the source. Each one found says where the source lies; two agree where
//! what they say differs by no more than both maps can have drifted between them.

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::interrupt::Interrupt;

use super::path::{DRIFT, LEAST, TURN_BY_LENGTH};
use super::{View, locate};
use crate::map::{EntityId, Keyframe, Link, Map};
use crate::place::{Candidate, PlaceError};

/// Least number of places that agree: with two, one may be the twin of the other's neighbor.
const LEAST_AGREEING: usize = 3;
/// Places that are enough: the pose graph that follows is determined many times over.
const ENOUGH: usize = 30;
/// Most keyframes of the source that are searched, 10 to 100 ms each.
const MOST_SEARCHED: usize = 300;
/// Differences that agree, in standard deviations.
const SIGMAS: f64 = 3.0;

/// Where a map lies in another one.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    /// The pose of the source's world frame in the target's, by the place that most others agree with.
    pub target_from_source: Se3,
    /// The places that agree.
    pub links: Vec<Link>,
}

/// Why it is not known where a map lies in another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "of {searched} keyframes of the source, {found} show a place of the target, and {agreeing} of these \
     agree where the source lies; {LEAST_AGREEING} and two thirds are needed"
)]
pub struct NotAligned {
    /// Keyframes of the source that were searched in the target.
    pub searched: usize,
    /// Those that were found.
    pub found: usize,
    /// The most of these that agree.
    pub agreeing: usize,
}

/// A keyframe of the source at a place of the target.
#[derive(Clone, Copy, Debug)]
struct Found {
    link: Link,
    /// Pose of the source's keyframe in the source's world and in the target's.
    in_source: Se3,
    in_target: Se3,
    /// Pose of the target's keyframe.
    candidate: Se3,
}

impl Found {
    fn target_from_source(&self) -> Se3 {
        self.in_target.compose(&self.in_source.inverse())
    }

    /// Whether both say the same of the source's frame, as far as both maps may have drifted.
    fn agrees(&self, other: &Self) -> bool {
        let expected = self.target_from_source().compose(&other.in_source);
        let error = expected.inverse().compose(&other.in_target);
        let between = |a: &Se3, b: &Se3| (a.translation - b.translation).norm();
        let way =
            between(&self.in_source, &other.in_source) + between(&self.candidate, &other.candidate);
        let turn = LEAST.1 + TURN_BY_LENGTH * way;
        let position = LEAST.0 + (DRIFT + turn / 2.0) * way;
        error.rotation.log().norm() <= SIGMAS * turn
            && error.translation.norm() <= SIGMAS * position
    }
}

/// Searches places of `source` in `target`; `candidates` asks the target's index.
///
/// # Errors
/// [`NotAligned`] where too few places agree, and where the interrupt is due.
pub fn align(
    target: &Map,
    source: &Map,
    candidates: impl Fn(&View<'_>) -> Result<Vec<Candidate>, PlaceError>,
    interrupt: &Interrupt,
) -> Result<Alignment, NotAligned> {
    let (mut searched, mut found) = (0, Vec::new());
    let mut best = Vec::new();
    for (id, keyframe) in spread(source).into_iter().take(MOST_SEARCHED) {
        if interrupt.is_due() || best.len() >= ENOUGH {
            break;
        }
        searched += 1;
        // Calibrations of two maps are two.
        let view = View::of_keyframe(source, keyframe).map(|view| View { camera_id: None, ..view });
        let Some(view) = view else { continue };
        let Ok(candidates) = candidates(&view) else { continue };
        let seed = (id.id as u64, interrupt);
        let (_, located) = locate(target, &view, &candidates, seed, |_, _| Ok(()));
        let Some(located) = located else { continue };
        let Some(candidate) = target.keyframes().get(&located.keyframe) else { continue };
        found.push(Found {
            link: Link {
                target: located.keyframe,
                source: id,
                target_from_source: located.verified.candidate_from_query,
                information: located.verified.information,
            },
            in_source: keyframe.world_from_camera,
            in_target: located.world_from_view,
            candidate: candidate.world_from_camera,
        });
        best = most_agreeing(&found);
    }
    let agreeing = best.len();
    let first =
        best.first().filter(|_| agreeing >= LEAST_AGREEING && 3 * agreeing >= 2 * found.len());
    match first {
        Some(first) => Ok(Alignment {
            target_from_source: first.target_from_source(),
            links: best.iter().map(|found| found.link).collect(),
        }),
        None => Err(NotAligned { searched, found: found.len(), agreeing }),
    }
}

/// The place that most others agree with, and these.
fn most_agreeing(found: &[Found]) -> Vec<Found> {
    let mut best: Vec<Found> = Vec::new();
    for one in found {
        let others = found.iter().filter(|other| other.link != one.link && one.agrees(other));
        let agreeing: Vec<Found> = std::iter::once(one).chain(others).copied().collect();
        if agreeing.len() > best.len() {
            best = agreeing;
        }
    }
    best
}

/// The keyframes with descriptors in an order whose every beginning comes from all over the map: that of
/// the reversed bits of their numbers (van der Corput 1935).
fn spread(map: &Map) -> Vec<(EntityId, &Keyframe)> {
    let has_descriptor = |keyframe: &Keyframe| {
        keyframe.observations.iter().any(|observation| observation.descriptor.is_some())
    };
    let mut all: Vec<(EntityId, &Keyframe)> =
        map.keyframes().iter().map(|(&id, k)| (id, k)).filter(|(_, k)| has_descriptor(k)).collect();
    all.sort_by_key(|&(id, keyframe)| (id.client, keyframe.capture_time_ns, id));
    let bits = all.len().next_power_of_two().trailing_zeros();
    let reversed = |number: usize| match bits {
        0 => 0,
        bits => number.reverse_bits() >> (usize::BITS - bits),
    };
    let order = (0..1_usize << bits).map(reversed).filter(|&at| at < all.len());
    order.filter_map(|at| all.get(at).copied()).collect()
}
