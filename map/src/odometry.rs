//! Odometry as a measurement: how two consecutive keyframes of a client lie to each other.
//!
//! What a client sends as `odom_from_camera`, or as the start pose where it sends none, drifts and does not
//! jump. Two keyframes that follow each other in capture time are therefore tied by
//! Z = odom_i⁻¹ · odom_j, unless the client sent an ODOMETRY constraint of the pair, which takes its place.
//! Along each axis the deviation of the translation is a share of the way between them, that of the rotation
//! grows with a large turn.
//!
//! Where odometry has no metric scale, as that of one camera, a tie says the direction of the translation.
//! Its length continues the scale that the map has there: the steps of the keyframes before it in the map over
//! those by odometry.
//!
//! Both deviations are found from the map's own residuals, as variance components by expectation and maximization
//! (Dempster, Laird and Rubin 1977): a window that has residuals r̂ with covariance C expects
//! E[r rᵀ] = r̂ r̂ᵀ + C. They begin small: odometry counts until views contradict it, and views that
//! determine little, or that see what moves with the camera, do not.
//!
//! Nothing is solved here.

use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::bundle_adjustment::{PairEstimate, pair_covariances};
use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use nalgebra::{SMatrix, Vector3, Vector6};

use super::numbers::{is_positive, median};
use super::{ClientIndex, ConstraintKind, EntityId, Keyframe, Map, MapProblem, scaling};

/// A way below which the deviation falls no more, in the client's unit: a robot at rest is not known
/// to the atom.
const LEAST_WAY: f64 = 1e-3;
/// Share of the distance of what a keyframe sees below which its way makes no difference.
const DISTANCE_SHARE: f64 = 0.02;
/// Usual steps of a client above which that distance makes no difference: what is far away measures no way,
/// and odometry does.
const USUAL_STEPS: f64 = 2.0;
/// The turn from which on the noise of a rotation grows with it, rad: 5°.
const TURN: f64 = 0.087;
/// Deviation of the length of a translation without metric scale, as a share of the way. It holds the scale
/// where nothing else does; a window of views knows it ten times better.
const SCALE_SHARE: f64 = 0.1;
/// Pairs of keyframes that say what scale a map has, and how long a client's steps are.
const RECENT_PAIRS: usize = 15;
/// Past this many deviations odometry loses its hold: it jumped, or a wheel slipped.
pub(super) const LOSS: Loss = Loss::GemanMcClure(10.0);
/// Weight below which odometry has lost its hold.
const LET_GO: f64 = 0.25;
/// Pairs that the noise before any residual counts as.
const PRIOR_PAIRS: f64 = 20.0;
/// Pairs that the noise remembers: what a robot drives on changes.
const MOST_PAIRS: f64 = 200.0;
/// What the deviations may become.
const SHARES: std::ops::RangeInclusive<f64> = 1e-4..=10.0;
const ANGLES: std::ops::RangeInclusive<f64> = 1e-5..=1.0;

/// How uncertain the odometry of a client is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometryNoise {
    /// Standard deviation of the translation along each axis, as a share of the way between two keyframes.
    pub translation_share: f64,
    /// Standard deviation of the rotation about each axis between two keyframes, rad.
    pub rotation_rad: f64,
    /// How many pairs of keyframes say so.
    pub pairs: f64,
}

impl Default for OdometryNoise {
    /// 1 % of the way and 0.05°, as of 20 pairs: what wheels and inertia of a car do.
    fn default() -> Self {
        Self { translation_share: 0.01, rotation_rad: 9e-4, pairs: PRIOR_PAIRS }
    }
}

impl OdometryNoise {
    /// Whether a map may have it.
    pub(super) fn is_possible(&self) -> bool {
        SHARES.contains(&self.translation_share)
            && ANGLES.contains(&self.rotation_rad)
            && is_positive(self.pairs)
            && self.pairs <= MOST_PAIRS
    }

    /// Whether residuals had a part in it.
    pub(super) fn is_found(&self) -> bool {
        self.pairs > PRIOR_PAIRS
    }

    /// The information of the relative pose of two keyframes, whose way counts as `floor` at least.
    fn information(&self, relative: &Se3, floor: f64, is_metric: bool) -> Option<Information<6>> {
        let way = way(relative, floor);
        let (shift, angle) = (self.translation_share * way, self.rotation_rad * turn(relative));
        let deviations = Vector6::new(shift, shift, shift, angle, angle, angle);
        let diagonal = deviations.map(|s| 1.0 / (s * s));
        let mut information = SMatrix::<f64, 6, 6>::from_diagonal(&diagonal);
        if let Some(direction) = direction(relative).filter(|_| !is_metric) {
            let length = SCALE_SHARE.max(self.translation_share) * way;
            let mut translation = information.fixed_view_mut::<3, 3>(0, 0);
            translation +=
                direction * direction.transpose() * ((length * length).recip() - diagonal.x);
        }
        Information::new(&information).ok()
    }

    /// The noise after it was seen in these pairs, whose information is of the noise `start`.
    fn after(&self, pairs: &[Pair], start: &Self, is_metric: bool) -> Self {
        let (mut share, mut angle) = (0.0, 0.0);
        for Pair { relative, information, estimate: PairEstimate { residual, covariance, .. } } in
            pairs
        {
            let expected = residual * residual.transpose() + covariance;
            let trace = |at: usize| {
                let (information, expected) = (
                    information.matrix().fixed_view::<3, 3>(at, at),
                    expected.fixed_view::<3, 3>(at, at),
                );
                (information * expected).trace()
            };
            // A length without scale says nothing of the noise.
            let across = match direction(relative).filter(|_| !is_metric) {
                None => trace(0) / 3.0,
                Some(d) => {
                    let along =
                        |matrix: &SMatrix<f64, 6, 6>| d.dot(&(matrix.fixed_view::<3, 3>(0, 0) * d));
                    (trace(0) - along(information.matrix()) * along(&expected)) / 2.0
                }
            };
            share += start.translation_share * start.translation_share * across;
            angle += start.rotation_rad * start.rotation_rad * trace(3) / 3.0;
        }
        let seen = pairs.len() as f64;
        let before = self.pairs.min(MOST_PAIRS - seen).max(0.0);
        let mean = |old: f64, sum: f64| ((old * old * before + sum) / (before + seen)).sqrt();
        Self {
            translation_share: mean(self.translation_share, share)
                .clamp(*SHARES.start(), *SHARES.end()),
            rotation_rad: mean(self.rotation_rad, angle).clamp(*ANGLES.start(), *ANGLES.end()),
            pairs: (before + seen).min(MOST_PAIRS),
        }
    }
}

/// The way that the noise of a translation is a share of. A camera that hardly moves is still only known as well
/// as its views say.
fn way(relative: &Se3, floor: f64) -> f64 {
    relative.translation.norm().hypot(LEAST_WAY).hypot(floor)
}

/// The direction of a translation as the residual of a relative pose has it, in the second keyframe.
fn direction(relative: &Se3) -> Option<Vector3<f64>> {
    relative.rotation.inverse_rotate(&relative.translation).try_normalize(LEAST_WAY)
}

/// How much more uncertain a rotation is for its size.
fn turn(relative: &Se3) -> f64 {
    1.0_f64.hypot(relative.rotation.log().norm() / TURN)
}

/// Whether odometry holds a pair of keyframes whose residual has this squared norm.
pub(super) fn holds(squared: f64) -> bool {
    LOSS.evaluate(squared).weight > LET_GO
}

/// Two keyframes that odometry tied in a solved problem.
struct Pair {
    relative: Se3,
    information: Information<6>,
    estimate: PairEstimate,
}

/// A measured relative pose of the keyframe before and this one.
pub(super) struct Tie {
    /// The keyframe before.
    pub(super) before: EntityId,
    /// Its relative pose Z.
    pub(super) before_from_keyframe: Se3,
    /// Its information.
    pub(super) information: Information<6>,
}

impl Map {
    /// What odometry says of a keyframe and the one before it; `None` where it is the first, where the client
    /// measured the pair itself, and where the policy leaves odometry out.
    pub(super) fn odometry_tie(&self, keyframe: EntityId) -> Option<Tie> {
        if !self.policy().odometry {
            return None;
        }
        let (before, previous) = self.keyframe_before(keyframe)?;
        if self.has_own_odometry(before, keyframe) {
            return None;
        }
        let now = self.keyframes().get(&keyframe)?;
        let before_from_keyframe = self.odometry_from((before, previous), &now.odom_from_camera);
        let noise = self.client(keyframe.client)?.noise.odometry;
        let steps = self.recent_steps(keyframe).map(|(_, by_odometry)| by_odometry);
        let usual = median(steps.collect()).unwrap_or(0.0);
        let distance = self.view_distance(now).unwrap_or(0.0);
        let floor = (DISTANCE_SHARE * distance).min(USUAL_STEPS * usual);
        let is_metric = self.policy().metric_odometry;
        let information = noise.information(&before_from_keyframe, floor, is_metric)?;
        Some(Tie { before, before_from_keyframe, information })
    }

    /// The relative pose of a keyframe and one that its client has at `odom_from_camera`, by odometry in the
    /// scale that the map has there.
    pub(super) fn odometry_from(&self, from: (EntityId, &Keyframe), odom_from_camera: &Se3) -> Se3 {
        let (id, keyframe) = from;
        let relative = keyframe.odom_from_camera.inverse().compose(odom_from_camera);
        match self.policy().metric_odometry {
            true => relative,
            false => scaling::pose(self.odometry_scale(id), &relative),
        }
    }

    /// How much longer the steps to a keyframe are in the map than by odometry, at the median, since odometry
    /// may have begun anew; 1 where there is none.
    pub(super) fn odometry_scale(&self, keyframe: EntityId) -> f64 {
        let ratios = self.recent_steps(keyframe).map(|(in_map, by_odometry)| in_map / by_odometry);
        median(ratios.filter(|ratio| ratio.is_normal()).collect()).unwrap_or(1.0)
    }

    /// How long the last steps to a keyframe and before are, in the map and by odometry.
    fn recent_steps(&self, keyframe: EntityId) -> impl Iterator<Item = (f64, f64)> {
        let distance = |a: &Se3, b: &Se3| (a.translation - b.translation).norm();
        let ids = std::iter::successors(Some(keyframe), |&id| Some(self.keyframe_before(id)?.0));
        let step = move |id: EntityId| {
            let (now, (_, before)) = (self.keyframes().get(&id)?, self.keyframe_before(id)?);
            let in_map = distance(&now.world_from_camera, &before.world_from_camera);
            Some((in_map, distance(&now.odom_from_camera, &before.odom_from_camera)))
        };
        ids.map_while(step).take(RECENT_PAIRS)
    }

    fn has_own_odometry(&self, a: EntityId, b: EntityId) -> bool {
        let ties = self.ties().of(b).filter_map(|id| self.active_constraint(id));
        ties.into_iter().any(|constraint| {
            let ends = [constraint.keyframe_i, constraint.keyframe_j];
            constraint.kind == ConstraintKind::Odometry && (ends == [a, b] || ends == [b, a])
        })
    }

    /// The keyframes before and after these in the trajectories of their clients, without these.
    pub(super) fn beside(&self, keyframes: &BTreeSet<EntityId>) -> BTreeSet<EntityId> {
        let beside = |&id: &EntityId| [self.keyframe_before(id), self.keyframe_after(id)];
        let beside = keyframes.iter().flat_map(beside).flatten().map(|(id, _)| id);
        beside.filter(|id| !keyframes.contains(id)).collect()
    }
}

impl MapProblem {
    /// Finds the noise of odometry anew, from the residuals of the solved problem.
    pub fn learn_odometry_noise(&mut self) {
        let bundle = &self.problem;
        let is_free = |pose: usize| bundle.constant_poses.get(pose) == Some(&false);
        let ties = self.odometry.iter().filter_map(|&index| {
            let factor = bundle.relative_poses.get(index)?;
            (is_free(factor.i) && is_free(factor.j)).then_some((index, factor))
        });
        let (indices, factors): (Vec<usize>, Vec<&RelativePose<Se3, 6>>) = ties.unzip();
        let Some(estimates) = pair_covariances(bundle, &indices) else { return };
        let mut pairs: BTreeMap<ClientIndex, Vec<Pair>> = BTreeMap::new();
        for (factor, estimate) in factors.into_iter().zip(estimates) {
            // What lost its hold is a jump and no noise.
            if holds(factor.information.squared_norm(&estimate.residual)) {
                let client = self.keyframes[factor.j].client;
                let (relative, information) = (factor.i_from_j, factor.information);
                let pair = Pair { relative, information, estimate };
                pairs.entry(client).or_default().push(pair);
            }
        }
        for (client, pairs) in pairs {
            let start = self.start_noise.get(&client);
            let (Some(noise), Some(start)) = (self.noise.get_mut(&client), start) else { continue };
            let after = noise.odometry.after(&pairs, &start.odometry, self.metric_odometry);
            if after.is_possible() {
                noise.odometry = after;
            }
        }
    }
}
