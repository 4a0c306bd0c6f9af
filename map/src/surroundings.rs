//! What is around a keyframe: landmarks of it and of the keyframes that share most with it, as points
//! with covariances and descriptors.
//!
//! The keyframes are held together as they are. A landmark has a point by the first of them that
//! determines it, and the descriptor of that view. Both the comparison of places that a closure joins
//! and the verification of candidates use it. Nothing is estimated or changed here.

use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::interrupt::Interrupt;
use covis_solvers::point_matching::Likeness;
use covis_solvers::relative_motion::PointEstimate;

use super::keyframe_pairs::point_in;
use super::{Descriptor, DescriptorKind, EntityId, Keyframe, Map};

/// Keyframes besides the one in the middle: those of a second of video, in which odometry hardly drifts.
const NEIGHBORS: usize = 10;

/// Most points, those of the keyframes nearest to the middle: the work grows with their number.
const MOST_POINTS: usize = 10_000;

/// Largest share of different bits of one point's binary descriptors: between the two thresholds of
/// ORB-SLAM (Mur-Artal et al., 2015), 50 and 100 of 256.
const MOST_BITS: f64 = 0.3;

/// Landmarks with points in the world frame, by id.
#[derive(Debug, Default)]
pub struct Surroundings<'a> {
    /// Their ids.
    pub landmarks: Vec<EntityId>,
    /// Where they are, m.
    pub points: Vec<PointEstimate>,
    /// What they look like, where a client said.
    pub descriptors: Vec<Option<&'a Descriptor>>,
    /// The keyframes that determine where they are.
    pub keyframes: Vec<EntityId>,
}

/// The keyframe and those that share most landmarks with it, none of `others`.
pub(super) fn keyframes_around<'a>(
    map: &'a Map,
    keyframe: EntityId,
    others: &BTreeSet<EntityId>,
) -> Vec<(EntityId, &'a Keyframe)> {
    if others.contains(&keyframe) {
        return Vec::new();
    }
    let near = map.covisibility().neighbors(keyframe).filter(|(id, _)| !others.contains(id));
    let mut near: Vec<(EntityId, u32)> = near.collect();
    near.sort_unstable_by_key(|&(id, shared)| (std::cmp::Reverse(shared), id));
    near.truncate(NEIGHBORS);
    let ids = std::iter::once(keyframe).chain(near.into_iter().map(|(id, _)| id));
    ids.filter_map(|id| Some((id, map.keyframes().get(&id)?))).collect()
}

/// The landmarks that keyframes see.
pub(super) fn seen(keyframes: &[(EntityId, &Keyframe)]) -> BTreeSet<EntityId> {
    keyframes.iter().flat_map(|(_, k)| k.observations.iter().map(|seen| seen.landmark)).collect()
}

impl<'a> Surroundings<'a> {
    /// The landmarks around a keyframe of the map.
    #[must_use]
    pub fn of_keyframe(map: &'a Map, keyframe: EntityId, interrupt: &Interrupt) -> Self {
        let keyframes = keyframes_around(map, keyframe, &BTreeSet::new());
        Self::of(map, &keyframes, &BTreeSet::new(), interrupt)
    }

    /// The landmarks that `keyframes` see and that are not in `common`, each by the first keyframe that
    /// determines its point.
    pub(super) fn of(
        map: &Map,
        keyframes: &[(EntityId, &'a Keyframe)],
        common: &BTreeSet<EntityId>,
        interrupt: &Interrupt,
    ) -> Self {
        let mut found: BTreeMap<EntityId, (PointEstimate, Option<&'a Descriptor>, EntityId)> =
            BTreeMap::new();
        'side: for &(id, keyframe) in keyframes {
            for observation in keyframe.observations.iter() {
                if found.len() == MOST_POINTS || interrupt.is_due() {
                    break 'side;
                }
                let landmark = observation.landmark;
                if found.contains_key(&landmark) || common.contains(&landmark) {
                    continue;
                }
                if let Some(estimate) = point_in(map, (id, keyframe), landmark) {
                    let pose = &keyframe.world_from_camera;
                    let turn = pose.rotation.matrix();
                    let point = pose.transform(&estimate.point);
                    let covariance = turn * estimate.covariance * turn.transpose();
                    let estimate = PointEstimate { point, covariance };
                    found.insert(landmark, (estimate, observation.descriptor.as_deref(), id));
                }
            }
        }
        let mut side = Self::default();
        for (landmark, (point, descriptor, keyframe)) in found {
            side.landmarks.push(landmark);
            side.points.push(point);
            side.descriptors.push(descriptor);
            side.keyframes.push(keyframe);
        }
        side
    }
}

/// How alike two descriptors of one make are: binary ones by the share of different bits, others by
/// their distance.
#[must_use]
pub fn likeness(a: &Descriptor, b: &Descriptor) -> Likeness {
    let is_same = a.kind == b.kind && a.name == b.name && a.data.len() == b.data.len();
    if !is_same || a.data.is_empty() {
        return Likeness::Unknown;
    }
    match a.kind {
        DescriptorKind::Binary => {
            let ((a_words, a_rest), (b_words, b_rest)) =
                (a.data.as_chunks::<8>(), b.data.as_chunks::<8>());
            let mut different = 0;
            for (x, y) in a_words.iter().zip(b_words) {
                different += (u64::from_ne_bytes(*x) ^ u64::from_ne_bytes(*y)).count_ones();
            }
            for (x, y) in a_rest.iter().zip(b_rest) {
                different += (x ^ y).count_ones();
            }
            let share = f64::from(different) / (8 * a.data.len()) as f64;
            if share <= MOST_BITS { Likeness::Distance(share) } else { Likeness::Different }
        }
        DescriptorKind::Float32 => {
            let (a, b) = (a.data.as_chunks::<4>().0, b.data.as_chunks::<4>().0);
            let number = |bytes: &[u8; 4]| f64::from(f32::from_le_bytes(*bytes));
            euclidean(a.iter().zip(b).map(|(x, y)| number(x) - number(y)))
        }
        DescriptorKind::Uint8 => {
            euclidean(a.data.iter().zip(&b.data).map(|(&x, &y)| f64::from(x) - f64::from(y)))
        }
    }
}

/// A client may send numbers that are not finite.
fn euclidean(differences: impl Iterator<Item = f64>) -> Likeness {
    let distance = differences.map(|difference| difference * difference).sum::<f64>().sqrt();
    if distance.is_finite() { Likeness::Distance(distance) } else { Likeness::Unknown }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn descriptor(kind: DescriptorKind, data: &[u8]) -> Descriptor {
        Descriptor { kind, name: "test".to_owned(), data: data.to_vec() }
    }

    #[test]
    fn descriptors_are_compared_by_their_kind() {
        let compare =
            |kind, a: &[u8], b: &[u8]| likeness(&descriptor(kind, a), &descriptor(kind, b));
        let binary = DescriptorKind::Binary;
        // Three of 80 bits, one of them behind the whole words.
        let (mut a, b) = ([0_u8; 10], [0_u8; 10]);
        (a[0], a[9]) = (0b11, 0b1000);
        assert_eq!(compare(binary, &a, &b), Likeness::Distance(3.0 / 80.0));
        assert_eq!(compare(binary, &[0xff; 10], &b), Likeness::Different);
        assert_eq!(compare(binary, &[0; 8], &b), Likeness::Unknown, "of different length");
        assert_eq!(compare(binary, &[], &[]), Likeness::Unknown);
        assert_eq!(compare(DescriptorKind::Uint8, &[3, 0], &[0, 4]), Likeness::Distance(5.0));
        let floats = |x: f32| x.to_le_bytes();
        let float = DescriptorKind::Float32;
        assert_eq!(compare(float, &floats(1.5), &floats(-0.5)), Likeness::Distance(2.0));
        assert_eq!(compare(float, &floats(f32::NAN), &floats(0.0)), Likeness::Unknown);
        let other = Descriptor { name: "other".to_owned(), ..descriptor(binary, &a) };
        assert_eq!(likeness(&descriptor(binary, &a), &other), Likeness::Unknown, "of another make");
    }
}
