//! How one map lies in another one: places of the source are searched in the target until enough of them
//! say the same.
//!
//! Nothing else is known of the two frames, so that one place proves nothing: a room may have a twin. The
//! places are taken from all over the source. Each one found says where the source lies; two agree where
//! what they say differs by no more than both maps can have drifted between them.
//!
//! A source that measures no lengths has a unit of its own. There each place says also how long it is, by
//! the landmarks that both maps have of it ([`similarity`]), and two places agree in it too
//! (decision 0034).

use std::collections::BTreeMap;

use covis_solvers::geometry::{LieGroup, Se3, Sim3};
use covis_solvers::interrupt::Interrupt;
use covis_solvers::relative_motion::PointEstimate;
use covis_solvers::similarity::{self, Pair};

use super::path::{DRIFT, LEAST, TURN_BY_LENGTH};
use super::{Located, QueryView, locate};
use crate::place::{Candidate, PlaceError};
use crate::{EntityId, Keyframe, Landmark, Link, Map, Surroundings};

/// Least number of places that agree: with two, one may be the twin of the other's neighbor.
const LEAST_AGREEING: usize = 3;
/// Places that are enough: the pose graph that follows is determined many times over.
const ENOUGH: usize = 30;
/// Most keyframes of the source that are searched, 10 to 100 ms each.
const MOST_SEARCHED: usize = 300;
/// Differences that agree, in standard deviations.
const SIGMAS: f64 = 3.0;
/// What is left of the scale at no way at all, and how it drifts by the length of the way, 1/m: three times
/// what monocular odometry with a window of bundle adjustment shows indoors.
const LEAST_OF_SCALE: f64 = 0.01;
const SCALE_BY_LENGTH: f64 = 0.005;
/// Largest standard deviation of the logarithm of a scale: one that is looser agrees with any.
const LOOSE_SCALE: f64 = 0.1;
/// Median distance of landmarks in a room, m: by it lengths of a map without scale become about meters.
const DEPTH_OF_A_ROOM: f64 = 2.5;

/// Where a map lies in another one.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    /// The source's world frame in the target's, by the place that most others agree with; without scale
    /// by the landmarks of all places that agree.
    pub target_from_source: Sim3,
    /// The places that agree.
    pub links: Vec<Link>,
}

/// Why it is not known where a map lies in another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{searched} keyframes of the source show {found} places of the target, and {agreeing} of these agree \
     where the source lies; {LEAST_AGREEING} and two thirds are needed"
)]
pub struct NotAligned {
    /// Keyframes of the source that were searched in the target.
    pub searched: usize,
    /// Places of the target that they show. A keyframe counts twice that shows two which do not agree.
    pub found: usize,
    /// The most of these that agree.
    pub agreeing: usize,
}

/// A keyframe of the source at a place of the target.
#[derive(Clone, Debug)]
struct AlignedKeyframe {
    link: Link,
    /// Pose of the source's keyframe in the source's world and in the target's.
    in_source: Se3,
    in_target: Se3,
    /// Pose of the target's keyframe.
    candidate: Se3,
    /// How long the source's unit is; `None` where both maps measure lengths.
    scale: Option<Scale>,
}

/// How long the source's unit is in the target, by one place.
#[derive(Clone, Debug)]
struct Scale {
    /// Its length.
    length: f64,
    /// Standard deviation of its logarithm.
    sigma: f64,
    /// The landmarks of source and target that say so.
    pairs: Vec<((EntityId, EntityId), Pair)>,
}

impl AlignedKeyframe {
    fn new(
        target: &Map,
        (source, keyframe): (EntityId, &Keyframe),
        located: &Located,
        scale: Option<Scale>,
    ) -> Option<Self> {
        Some(Self {
            link: Link {
                target: located.keyframe,
                source,
                target_from_source: located.verified.candidate_from_query,
                information: located.verified.information,
            },
            in_source: keyframe.world_from_camera,
            in_target: located.world_from_view,
            candidate: target.keyframes().get(&located.keyframe)?.world_from_camera,
            scale,
        })
    }

    fn scale(&self) -> f64 {
        self.scale.as_ref().map_or(1.0, |scale| scale.length)
    }

    fn target_from_source(&self) -> Sim3 {
        let (scale, rotation) = (self.scale(), self.in_target.rotation);
        let rotation = rotation.compose(&self.in_source.rotation.inverse());
        let origin = rotation.rotate(&self.in_source.translation) * scale;
        Sim3::new(rotation, self.in_target.translation - origin, scale)
    }

    /// Whether both say the same of the source's frame, as far as both maps may have drifted. `meter` is the
    /// length of a meter in the target, about.
    fn agrees(&self, other: &Self, meter: f64) -> bool {
        let expected = self.target_from_source().transform_pose(&other.in_source);
        let error = expected.inverse().compose(&other.in_target);
        let between = |a: &Se3, b: &Se3| (a.translation - b.translation).norm();
        let in_source = between(&self.in_source, &other.in_source) * self.scale();
        let way = (in_source + between(&self.candidate, &other.candidate)) / meter;
        let turn = LEAST.1 + TURN_BY_LENGTH * way;
        let scale = self.sigma_of_scale(other, way);
        let position = LEAST.0 + (DRIFT + turn / 2.0 + scale) * way;
        error.rotation.log().norm() <= SIGMAS * turn
            && error.translation.norm() <= SIGMAS * position * meter
            && (self.scale() / other.scale()).ln().abs() <= SIGMAS * scale
    }

    /// Standard deviation of the difference of both scales' logarithms, at the ends of a way.
    fn sigma_of_scale(&self, other: &Self, way: f64) -> f64 {
        let (Some(a), Some(b)) = (&self.scale, &other.scale) else { return 0.0 };
        (LEAST_OF_SCALE + SCALE_BY_LENGTH * way).hypot(a.sigma).hypot(b.sigma)
    }
}

/// Searches places of `source` in `target`; `candidates` asks the target's index.
///
/// # Errors
/// [`NotAligned`] where too few places agree, and where the interrupt is due.
pub fn align(
    target: &Map,
    source: &Map,
    candidates: impl Fn(&QueryView<'_>) -> Result<Vec<Candidate>, PlaceError>,
    interrupt: &Interrupt,
) -> Result<Alignment, NotAligned> {
    let is_scaled = !source.has_metric_scale();
    let meter = meter(target);
    let (mut searched, mut found, mut contradicted) = (0, Vec::new(), 0);
    let mut best = Vec::new();
    for (id, keyframe) in spread(source).into_iter().take(MOST_SEARCHED) {
        if interrupt.is_due() || best.len() >= ENOUGH {
            break;
        }
        searched += 1;
        // Calibrations of two maps are two.
        let view = QueryView::of_keyframe(source, keyframe)
            .map(|view| QueryView { camera_id: None, ..view });
        let Some(view) = view else { continue };
        let Ok(candidates) = candidates(&view) else { continue };
        let mut rest = candidates.as_slice();
        let mut places = std::iter::from_fn(|| {
            loop {
                let (_, located) =
                    locate(target, &view, rest, id.id as u64, interrupt, |_, _| Ok(()));
                let located = located?;
                let at =
                    rest.iter().position(|candidate| candidate.keyframe == located.keyframe)?;
                rest = &rest[at + 1..];
                if !is_scaled {
                    return AlignedKeyframe::new(target, (id, keyframe), &located, None);
                }
                let scale = scale_at(target, source, (id, keyframe), &located, interrupt);
                // A place that does not say how long the source's unit is says nothing.
                if scale.is_some() {
                    return AlignedKeyframe::new(target, (id, keyframe), &located, scale);
                }
            }
        });
        let Some(place) = places.next() else { continue };
        // A room may have a twin: which of both is found first says nothing.
        contradicted += usize::from(places.any(|other| !other.agrees(&place, meter)));
        found.push(place);
        best = most_agreeing(&found, meter);
    }
    let (found, agreeing) = (found.len() + contradicted, best.len());
    match best.first() {
        Some(first) if agreeing >= LEAST_AGREEING && 3 * agreeing >= 2 * found => Ok(Alignment {
            target_from_source: joint(&best).unwrap_or_else(|| first.target_from_source()),
            links: best.iter().map(|found| found.link).collect(),
        }),
        _ => Err(NotAligned { searched, found, agreeing }),
    }
}

/// The place that most others agree with, and these.
fn most_agreeing(found: &[AlignedKeyframe], meter: f64) -> Vec<AlignedKeyframe> {
    let mut best: Vec<&AlignedKeyframe> = Vec::new();
    for one in found {
        let is_other =
            |other: &&AlignedKeyframe| other.link != one.link && one.agrees(other, meter);
        let others = found.iter().filter(is_other);
        let agreeing: Vec<&AlignedKeyframe> = std::iter::once(one).chain(others).collect();
        if agreeing.len() > best.len() {
            best = agreeing;
        }
    }
    best.into_iter().cloned().collect()
}

/// How long the source's unit is at a place that a keyframe shows: by the landmarks that it sees, whose
/// twins in the target the verification has found.
fn scale_at(
    target: &Map,
    source: &Map,
    (id, keyframe): (EntityId, &Keyframe),
    located: &Located,
    interrupt: &Interrupt,
) -> Option<Scale> {
    let in_source = Surroundings::of_keyframe(source, id, interrupt);
    let in_target = Surroundings::of_keyframe(target, located.keyframe, interrupt);
    let pair = |&(twin, feature): &(EntityId, usize)| {
        let landmark = keyframe.observations.get(feature)?.landmark;
        let source = estimate(source, &in_source, landmark)?;
        Some(((landmark, twin), Pair { source, target: estimate(target, &in_target, twin)? }))
    };
    let pairs: Vec<_> = located.landmarks.iter().filter_map(pair).collect();
    let points: Vec<Pair> = pairs.iter().map(|&(_, pair)| pair).collect();
    let found = similarity::estimate(&points, id.id as u64)?;
    let pairs = found.inliers.iter().map(|&k| pairs[k]).collect();
    let sigma = found.covariance.matrix()[(6, 6)].sqrt();
    let length = found.target_from_source.scale;
    (sigma <= LOOSE_SCALE).then_some(Scale { length, sigma, pairs })
}

/// A landmark where the map has it, as uncertain as the keyframes around leave it.
fn estimate(map: &Map, around: &Surroundings<'_>, landmark: EntityId) -> Option<PointEstimate> {
    let index = around.landmarks.binary_search(&landmark).ok()?;
    let point = map.landmarks().get(&landmark)?.position?;
    Some(PointEstimate { point, ..around.points[index] })
}

/// What all landmarks of the places say together; `None` where both maps measure lengths.
fn joint(places: &[AlignedKeyframe]) -> Option<Sim3> {
    let scales = places.iter().filter_map(|found| found.scale.as_ref());
    let pairs: BTreeMap<(EntityId, EntityId), Pair> =
        scales.flat_map(|scale| scale.pairs.iter().copied()).collect();
    let pairs: Vec<Pair> = pairs.into_values().collect();
    Some(similarity::estimate(&pairs, 0)?.target_from_source)
}

/// The length of a meter in a map, about: 1, or by the median distance of landmarks where the map
/// measures no lengths.
pub(super) fn meter(map: &Map) -> f64 {
    if map.has_metric_scale() {
        return 1.0;
    }
    let distance = |landmark: &Landmark| {
        let keyframe = map.keyframes().get(&landmark.reference?)?;
        Some((landmark.position? - keyframe.world_from_camera.translation).norm())
    };
    let mut distances: Vec<f64> = map.landmarks().values().filter_map(distance).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let median = distances.get(distances.len() / 2).copied().filter(|&median| median > 0.0);
    median.map_or(1.0, |median| median / DEPTH_OF_A_ROOM)
}

/// The keyframes with descriptors in an order whose every beginning comes from all over the map: that of
/// the reversed bits of their numbers (van der Corput 1935).
fn spread(map: &Map) -> Vec<(EntityId, &Keyframe)> {
    let has_descriptor = |keyframe: &Keyframe| {
        keyframe.observations.iter().any(|observation| observation.descriptor.is_some())
    };
    let mut all: Vec<(EntityId, &Keyframe)> =
        map.keyframes().iter().map(|(&id, k)| (id, k)).filter(|(_, k)| has_descriptor(k)).collect();
    all.sort_unstable_by_key(|&(id, keyframe)| (id.client, keyframe.capture_time_ns, id));
    let bits = all.len().next_power_of_two().trailing_zeros();
    let reversed = |number: usize| match bits {
        0 => 0,
        bits => number.reverse_bits() >> (usize::BITS - bits),
    };
    let order = (0..1_usize << bits).map(reversed).filter(|&at| at < all.len());
    order.filter_map(|at| all.get(at).copied()).collect()
}
