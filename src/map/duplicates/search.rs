//! Finds the landmarks that are one point on both sides of a loop closure.
//!
//! Each side is the closure's keyframe with those that share most landmarks with it, held together as
//! they are. A landmark has a point with a covariance, from its view nearest to the closure. The
//! closure's own uncertainty bounds where a landmark of one side may lie on the other; the best match
//! inside, by descriptor where there are some, aligns the sides, which narrows the bound, until the
//! matches stay. What remains are pairs that are each other's best match, within the 99 % quantile of
//! χ² with three degrees of freedom, and not ambiguous. Nothing is changed.

use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::relative_motion::PointEstimate;
use covis_solvers::robust::default_threshold;
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};

use super::super::keyframe_pairs::point_in;
use super::super::{Descriptor, DescriptorKind, EntityId, Map};
use super::Comparison;

/// Keyframes of a side besides the closure's own: those of a second of video, in which odometry hardly
/// drifts.
const NEIGHBORS: usize = 10;

/// Fewest matches that align two sides: three determine an alignment; so many more agree by chance in
/// one of some thousand places, if a tenth of all matches fits by chance.
const MIN_MATCHES: usize = 10;

/// Rounds of matching and aligning.
const MAX_ROUNDS: usize = 8;

/// Steps of an alignment.
const MAX_STEPS: usize = 10;

/// A step shorter than this many standard deviations ends an alignment.
const STEP_TOLERANCE: f64 = 1e-3;

/// Width of Huber's loss on the Mahalanobis distance, as in the measurement of relative poses.
const HUBER_WIDTH: f64 = 2.795;

/// Largest share of different bits of one point's binary descriptors. Descriptors of different points
/// differ in half of their bits, with a standard deviation of 1/32 for 256 independent bits; those of
/// one point in 10 to 20 %.
const MOST_BITS: f64 = 0.3;

/// The best match must be closer than the second best by this factor: by descriptor as Lowe (IJCV 2004)
/// has it; without one, in standard deviations, three times, since positions alone say little.
const RATIO: f64 = 0.8;
const RATIO_OF_POSITIONS: f64 = 1.0 / 3.0;

/// Largest variance factor of an alignment: errors of more than three times what the points claim have
/// a reason that is not known here.
const MOST_VARIANCE: f64 = 9.0;

/// A landmark as one side sees it.
struct Point<'a> {
    id: EntityId,
    position: Vector3<f64>,
    covariance: Matrix3<f64>,
    descriptor: Option<&'a Descriptor>,
}

/// Where side j is moved to: world_from_world = T_j Exp(ξ) T_j⁻¹, with the covariance of ξ.
struct Alignment {
    world_from_j: Se3,
    j_from_j: Se3,
    covariance: Matrix6<f64>,
    /// By what the covariances of the points are multiplied, at least 1.
    variance_factor: f64,
}

impl Alignment {
    fn apply(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.world_from_j.transform(&self.j_from_j.transform(&self.in_j(point)))
    }

    fn in_j(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.world_from_j.inverse_transform(point)
    }

    fn rotation(&self) -> Matrix3<f64> {
        self.world_from_j.compose(&self.j_from_j).rotation.matrix()
    }

    /// ∂ moved point / ∂ξ of a right perturbation.
    fn jacobian(&self, point: &Vector3<f64>) -> Matrix3x6<f64> {
        let mut local = Matrix3x6::zeros();
        local.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
        local.fixed_view_mut::<3, 3>(0, 3).copy_from(&-self.in_j(point).cross_matrix());
        self.rotation() * local
    }

    /// Covariance of the moved point, with that of the alignment.
    fn covariance_of(&self, point: &Point<'_>) -> Matrix3<f64> {
        let jacobian = self.jacobian(&point.position);
        self.turned(&point.covariance) * self.variance_factor
            + jacobian * self.covariance * jacobian.transpose()
    }

    /// Covariance of the moved point itself.
    fn turned(&self, covariance: &Matrix3<f64>) -> Matrix3<f64> {
        let turn = self.rotation() * self.world_from_j.rotation.inverse().matrix();
        turn * covariance * turn.transpose()
    }
}

/// Compares the places that a loop closure joins; `None` where the map does not hold it.
#[must_use]
pub fn find_duplicates(map: &Map, closure: EntityId) -> Option<Comparison> {
    let constraint = map.active_constraint(closure)?;
    let (i, j) = (constraint.keyframe_i, constraint.keyframe_j);
    let side_i = side(map, i, &BTreeSet::new());
    let side_j = side(map, j, &side_i.iter().copied().collect());
    let (mut points_i, mut points_j) = (points(map, &side_i), points(map, &side_j));
    let common: BTreeSet<EntityId> =
        points_i.keys().filter(|id| points_j.contains_key(id)).copied().collect();
    points_i.retain(|id, _| !common.contains(id));
    points_j.retain(|id, _| !common.contains(id));
    let (mut points_i, points_j): (Vec<Point<'_>>, Vec<Point<'_>>) =
        (points_i.into_values().collect(), points_j.into_values().collect());
    points_i.sort_by(|a, b| a.position.x.total_cmp(&b.position.x));
    let variance = map.client(closure.client).map_or(1.0, |client| client.closure_variance);
    let covariance = constraint.information.matrix().try_inverse()? * variance;
    let world_from_j = map.keyframes().get(&j)?.world_from_camera;
    let start =
        Alignment { world_from_j, j_from_j: Se3::identity(), covariance, variance_factor: 1.0 };
    let pairs = compare(&points_i, &points_j, start).unwrap_or_default();
    let pair = |(a, b): (usize, usize)| (points_i[a].id, points_j[b].id);
    Some(Comparison { closure, pairs: pairs.into_iter().map(pair).collect() })
}

/// The keyframe and those that share most landmarks with it, none of `others`.
fn side(map: &Map, keyframe: EntityId, others: &BTreeSet<EntityId>) -> Vec<EntityId> {
    if others.contains(&keyframe) {
        return Vec::new();
    }
    let near = map.covisibility().neighbors(keyframe).filter(|(id, _)| !others.contains(id));
    let mut near: Vec<(EntityId, u32)> = near.collect();
    near.sort_by_key(|&(id, shared)| (std::cmp::Reverse(shared), id));
    near.truncate(NEIGHBORS);
    std::iter::once(keyframe).chain(near.into_iter().map(|(id, _)| id)).collect()
}

/// The points that the keyframes of a side see, each by the first keyframe that determines it.
fn points<'a>(map: &'a Map, side: &[EntityId]) -> BTreeMap<EntityId, Point<'a>> {
    let mut points = BTreeMap::new();
    let seen = side.iter().filter_map(|&id| Some((id, map.keyframes().get(&id)?)));
    for (id, keyframe) in seen {
        for observation in keyframe.observations.iter() {
            let landmark = observation.landmark;
            if points.contains_key(&landmark) {
                continue;
            }
            let Some(PointEstimate { point, covariance }) = point_in(map, (id, keyframe), landmark)
            else {
                continue;
            };
            let pose = &keyframe.world_from_camera;
            let turn = pose.rotation.matrix();
            points.insert(
                landmark,
                Point {
                    id: landmark,
                    position: pose.transform(&point),
                    covariance: turn * covariance * turn.transpose(),
                    descriptor: observation.descriptor.as_deref(),
                },
            );
        }
    }
    points
}

/// The pairs of the aligned sides; `None` where they cannot be aligned.
fn compare(a: &[Point<'_>], b: &[Point<'_>], start: Alignment) -> Option<Vec<(usize, usize)>> {
    let prior = start.covariance.try_inverse()?;
    let mut alignment = start;
    let candidates = candidates(a, b, &alignment);
    let mut matches = find_matches(a, b, &candidates, &alignment);
    for _ in 0..MAX_ROUNDS {
        if matches.len() < MIN_MATCHES {
            return None;
        }
        alignment = align(a, b, &matches, alignment, &prior)?;
        let next = find_matches(a, b, &candidates, &alignment);
        if next == matches {
            break;
        }
        matches = next;
    }
    (matches.len() >= MIN_MATCHES).then_some(matches)
}

/// Two points that may be one.
struct Candidate {
    a: usize,
    b: usize,
    /// Distance of their descriptors, if these can be compared.
    look: Option<f64>,
}

/// The pairs that are near each other at the start, where the bound is widest, and do not look
/// different. `a` is sorted by x.
fn candidates(a: &[Point<'_>], b: &[Point<'_>], start: &Alignment) -> Vec<Candidate> {
    let threshold = default_threshold(3);
    // What the bound needs, in one piece of memory.
    let near = |point: &Point<'_>| {
        let position = &point.position;
        [position.x, position.y, position.z, point.covariance.trace()]
    };
    let a_near: Vec<[f64; 4]> = a.iter().map(near).collect();
    let widest = a_near.iter().map(|point| point[3]).fold(0.0, f64::max);
    let mut candidates = Vec::new();
    for (at_b, point_b) in b.iter().enumerate() {
        // No direction has a larger variance than the trace.
        let trace_b = start.covariance_of(point_b).trace();
        let (center, radius) = (&point_b.position, (threshold * (widest + trace_b)).sqrt());
        let first = a_near.partition_point(|point| point[0] < center.x - radius);
        let last = a_near.partition_point(|point| point[0] <= center.x + radius);
        for (at_a, [x, y, z, trace_a]) in (first..last).zip(&a_near[first..last]) {
            let squared = (Vector3::new(*x, *y, *z) - center).norm_squared();
            if squared > threshold * (trace_a + trace_b) {
                continue;
            }
            let descriptors = a[at_a].descriptor.zip(point_b.descriptor);
            let look = descriptors.and_then(|(a, b)| distance(a, b));
            if !look.is_some_and(f64::is_infinite) {
                candidates.push(Candidate { a: at_a, b: at_b, look });
            }
        }
    }
    candidates
}

/// The best match of a point, and the distance of the second best.
#[derive(Clone, Copy)]
struct Best {
    other: usize,
    /// Distance of the descriptors, or of the points in standard deviations.
    distance: f64,
    by_position: bool,
    second: f64,
}

impl Best {
    fn add(best: &mut Option<Self>, other: usize, distance: f64, by_position: bool) {
        *best = Some(match *best {
            None => Self { other, distance, by_position, second: f64::INFINITY },
            Some(first) if distance < first.distance => {
                Self { other, distance, by_position, second: first.distance }
            }
            Some(first) => Self { second: first.second.min(distance), ..first },
        });
    }

    fn is_clear(&self) -> bool {
        let ratio = if self.by_position { RATIO_OF_POSITIONS } else { RATIO };
        self.distance <= ratio * self.second
    }
}

/// Candidates that are each other's best match, neither of them ambiguous.
fn find_matches(
    a: &[Point<'_>],
    b: &[Point<'_>],
    candidates: &[Candidate],
    alignment: &Alignment,
) -> Vec<(usize, usize)> {
    let threshold = default_threshold(3);
    let mut best_of_a: Vec<Option<Best>> = vec![None; a.len()];
    let mut best_of_b: Vec<Option<Best>> = vec![None; b.len()];
    let moved =
        |point: &Point<'_>| (alignment.apply(&point.position), alignment.covariance_of(point));
    let moved: Vec<(Vector3<f64>, Matrix3<f64>)> = b.iter().map(moved).collect();
    for candidate in candidates {
        let (point_a, (position, of_b)) = (&a[candidate.a], &moved[candidate.b]);
        let difference = point_a.position - position;
        let covariance = point_a.covariance * alignment.variance_factor + of_b;
        let Some(cholesky) = covariance.cholesky() else { continue };
        let chi2 = difference.dot(&cholesky.solve(&difference));
        if chi2 <= threshold {
            let distance = candidate.look.unwrap_or_else(|| chi2.sqrt());
            let by_position = candidate.look.is_none();
            Best::add(&mut best_of_a[candidate.a], candidate.b, distance, by_position);
            Best::add(&mut best_of_b[candidate.b], candidate.a, distance, by_position);
        }
    }
    let mutual = |(at_a, best): (usize, &Option<Best>)| {
        let best = best.filter(Best::is_clear)?;
        let back = best_of_b[best.other].filter(Best::is_clear)?;
        (back.other == at_a).then_some((at_a, best.other))
    };
    best_of_a.iter().enumerate().filter_map(mutual).collect()
}

/// Distance of two descriptors of one make: of binary ones the share of different bits, ∞ above
/// [`MOST_BITS`]. `None` where they cannot be compared.
fn distance(a: &Descriptor, b: &Descriptor) -> Option<f64> {
    let is_same = a.kind == b.kind && a.name == b.name && a.data.len() == b.data.len();
    if !is_same || a.data.is_empty() {
        return None;
    }
    let squares = |differences: &mut dyn Iterator<Item = f64>| {
        differences.map(|difference| difference * difference).sum::<f64>().sqrt()
    };
    Some(match a.kind {
        DescriptorKind::Binary => {
            let ((a_words, a_rest), (b_words, b_rest)) =
                (a.data.as_chunks::<8>(), b.data.as_chunks::<8>());
            let of_words = a_words
                .iter()
                .zip(b_words)
                .map(|(x, y)| (u64::from_ne_bytes(*x) ^ u64::from_ne_bytes(*y)).count_ones());
            let of_rest = a_rest.iter().zip(b_rest).map(|(x, y)| (x ^ y).count_ones());
            let different: u32 = of_words.chain(of_rest).sum();
            let share = f64::from(different) / (8 * a.data.len()) as f64;
            if share <= MOST_BITS { share } else { f64::INFINITY }
        }
        DescriptorKind::Float32 => {
            let number = |bytes: &[u8]| {
                <[u8; 4]>::try_from(bytes).map_or(0.0, |bytes| f64::from(f32::from_le_bytes(bytes)))
            };
            let pairs = a.data.chunks_exact(4).zip(b.data.chunks_exact(4));
            squares(&mut pairs.map(|(x, y)| number(x) - number(y)))
        }
        DescriptorKind::Uint8 => {
            let pairs = a.data.iter().zip(&b.data);
            squares(&mut pairs.map(|(&x, &y)| f64::from(x) - f64::from(y)))
        }
    })
}

/// Aligns side j with the matches, from `start` and with the closure's information as prior.
fn align(
    a: &[Point<'_>],
    b: &[Point<'_>],
    matches: &[(usize, usize)],
    start: Alignment,
    prior: &Matrix6<f64>,
) -> Option<Alignment> {
    let mut alignment = start;
    let (mut hessian, mut weighted) = (*prior, 0.0);
    for _ in 0..MAX_STEPS {
        let mut gradient = prior * alignment.j_from_j.log();
        (hessian, weighted) = (*prior, 0.0);
        for &(at_a, at_b) in matches {
            let (point_a, point_b) = (&a[at_a], &b[at_b]);
            let difference = alignment.apply(&point_b.position) - point_a.position;
            let covariance = point_a.covariance + alignment.turned(&point_b.covariance);
            let information = covariance.cholesky()?.inverse();
            let chi2 = difference.dot(&(information * difference));
            let norm = chi2.max(0.0).sqrt();
            let weight = if norm <= HUBER_WIDTH { 1.0 } else { HUBER_WIDTH / norm };
            let jacobian = alignment.jacobian(&point_b.position);
            hessian += weight * jacobian.transpose() * information * jacobian;
            gradient += weight * jacobian.transpose() * information * difference;
            weighted += weight * chi2;
        }
        let step: Vector6<f64> = -hessian.cholesky()?.solve(&gradient);
        let length = step.dot(&(hessian * step)).max(0.0).sqrt();
        alignment.j_from_j = alignment.j_from_j.compose(&Se3::exp(&step));
        if length < STEP_TOLERANCE {
            break;
        }
    }
    let freedom = (3 * matches.len()).checked_sub(6).filter(|&freedom| freedom > 0)?;
    alignment.variance_factor = (weighted / freedom as f64).max(1.0);
    alignment.covariance = hessian.try_inverse()? * alignment.variance_factor;
    let is_sound = alignment.variance_factor <= MOST_VARIANCE && alignment.j_from_j.is_finite();
    is_sound.then_some(alignment)
}
