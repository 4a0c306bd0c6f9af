//! Frames that a client may still believe in: where a solve or a merge has moved the newest keyframe of a
//! client by far, its next start estimates may be of the frame before.
//!
//! A robot learns of a correction a moment later than the map, and much later over a poor link. Small
//! corrections are left to bundle adjustment. After a large one, of the first closure with another robot's
//! keyframes for instance, a keyframe in the old frame would see its landmarks behind the camera. Its
//! start estimate says which frame it is of: in that one it follows from the newest keyframe and the
//! odometry. Nothing is estimated here.

use std::collections::BTreeMap;

use covis_solvers::geometry::{LieGroup, Se3};

use super::{ClientIndex, EntityId, Keyframe, Map, scaling};

/// Earlier frames of a client that are kept: a robot that is further behind has not been heard for long.
pub(super) const MOST_FRAMES: usize = 4;
/// Motion of a keyframe from which on its client's frame is another one, m and rad: below it bundle
/// adjustment converges from either.
const FAR: (f64, f64) = (0.5, 0.2);

/// Share of the cost of a start estimate as it was sent below which another one is plainly better.
const PLAINLY_BETTER: f64 = 0.5;

/// Keyframes of a client, the last by arrival, of which the one with the latest capture time is its
/// newest. Fewer may arrive late; where so many were captured before an earlier one, the clock went back
/// or that keyframe has a time in the future.
const LATE: usize = 16;

/// Keyframes that arrived last and were captured before an earlier one, [`LATE`] at least.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LateRun {
    /// The earlier keyframe.
    pub(super) before: EntityId,
    /// How many arrived since.
    pub(super) count: usize,
    /// How far the last of them by capture time was captured before it.
    pub(super) gap_ns: u64,
}

impl Map {
    /// The keyframe of a client with the latest capture time, then the highest id, of the 16 that
    /// arrived last. Those that arrived with the first of them, as in a merge, are among them.
    pub fn newest_keyframe(&self, client: ClientIndex) -> Option<(EntityId, &Keyframe)> {
        let (latest, later) = self.latest_keyframe(client)?;
        if later < LATE {
            return Some(latest);
        }
        let mut since = (ClientIndex(client.0.checked_add(1)?), i64::MIN, EntityId::MIN);
        for _ in 0..LATE {
            since = *self.by_arrival.entry_before(&since)?.0;
        }
        let last = self.arrivals_from(client, since.1);
        last.max_by_key(|&(id, keyframe)| (keyframe.capture_time_ns, id))
    }

    /// The keyframes that arrived since the latest one by capture time, where they are many.
    pub(super) fn late_run(&self, client: ClientIndex) -> Option<LateRun> {
        let ((before, latest), count) = self.latest_keyframe(client)?;
        let (_, last) = self.newest_keyframe(client).filter(|_| count >= LATE)?;
        Some(LateRun {
            before,
            count,
            gap_ns: latest.capture_time_ns.abs_diff(last.capture_time_ns),
        })
    }

    /// The keyframe with the latest capture time of all, and how many arrived later.
    fn latest_keyframe(&self, client: ClientIndex) -> Option<((EntityId, &Keyframe), usize)> {
        let id = self.last_keyframe(client)?;
        let latest = self.keyframes().get(&id)?;
        let later = self.arrivals_from(client, latest.added_revision.checked_add(1)?);
        Some(((id, latest), later.count()))
    }

    /// The keyframes of a client that were added with a revision or later.
    fn arrivals_from(
        &self,
        client: ClientIndex,
        revision: i64,
    ) -> impl Iterator<Item = (EntityId, &Keyframe)> {
        let own = self.by_arrival.entries_from((client, revision, EntityId::MIN));
        let own = own.map(|(&key, ())| key).take_while(move |key| key.0 == client);
        own.filter_map(|(_, _, id)| Some((id, self.keyframes().get(&id)?)))
    }

    /// The clients whose newest keyframe moves far with `poses`, and their frames until now,
    /// [`Keyframe::map_from_odom`].
    pub(super) fn left_frames(&self, poses: &BTreeMap<EntityId, Se3>) -> Vec<(ClientIndex, Se3)> {
        let left = |client: ClientIndex| {
            let (id, newest) = self.newest_keyframe(client)?;
            let motion = newest.world_from_camera.inverse().compose(poses.get(&id)?);
            let is_far = motion.translation.norm() > FAR.0 || motion.rotation.log().norm() > FAR.1;
            let frame = newest.map_from_odom();
            (is_far && frame.is_finite()).then_some((client, frame))
        };
        (0..).zip(self.clients()).filter_map(|(index, _)| left(ClientIndex(index))).collect()
    }

    /// What moves the start estimate of a client's next keyframe to where it belongs in the map, where that
    /// is not where it was sent. All poses are in the map's unit.
    ///
    /// A robot that sends its odometry as start estimates does not know of corrections, one that knows of them
    /// sends estimates in the map's frame, and one that was relocalized starts elsewhere. `cost` decides which
    /// it is: how badly a pose fits what the keyframe sees of the map; `None` where it sees too little of it.
    /// Then odometry decides: the estimate follows from the newest keyframe in the frame in which it is near.
    pub(super) fn start_motion(
        &self,
        client: ClientIndex,
        world_from_camera: &Se3,
        odom_from_camera: Option<&Se3>,
        cost: impl Fn(&Se3) -> Option<f64>,
    ) -> Option<Se3> {
        let (id, newest) = self.newest_keyframe(client)?;
        let present = match self.policy().metric_odometry {
            true => newest.map_from_odom(),
            // The frame in which the way from the newest keyframe has the map's scale.
            false => {
                let odom = odom_from_camera.unwrap_or(world_from_camera);
                let step = self.odometry_from((id, newest), odom);
                newest.world_from_camera.compose(&step).compose(&odom.inverse())
            }
        };
        let carried = match odom_from_camera {
            // The start estimate is odometry itself, of which the map has moved the frame.
            None => present,
            Some(odom) => present.compose(odom).compose(&world_from_camera.inverse()),
        };
        let earlier = &self.client(client)?.earlier_frames;
        let left = earlier.iter().map(|frame| present.compose(&frame.inverse()));
        let left = left.filter(Se3::is_finite);
        let carried = Some(carried).filter(Se3::is_finite);
        if let Some(as_sent) = cost(world_from_camera) {
            let moved = |motion: &Se3| cost(&motion.compose(world_from_camera));
            let motions = carried.into_iter().chain(left);
            let costs = motions.filter_map(|motion| Some((moved(&motion)?, motion)));
            let best = costs.min_by(|a, b| a.0.total_cmp(&b.0));
            // Poses that are no odometry follow the keyframe before them where that is plain.
            let most = if self.policy().odometry { as_sent } else { PLAINLY_BETTER * as_sent };
            return best.filter(|best| best.0 < most).map(|best| best.1);
        }
        let carried = carried.filter(|_| self.policy().odometry);
        let motions = carried.into_iter().chain(left);
        match odom_from_camera {
            None => {
                let step = |pose: &Se3| {
                    let step = newest.world_from_camera.inverse().compose(pose);
                    step.translation.norm() + step.rotation.log().norm()
                };
                let moved = |motion: &Se3| step(&motion.compose(world_from_camera));
                let nearest = motions.min_by(|a, b| moved(a).total_cmp(&moved(b)))?;
                (moved(&nearest) < step(world_from_camera)).then_some(nearest)
            }
            Some(odometry) => self.left_motion(earlier, &present, odometry, world_from_camera),
        }
    }

    /// What moves a start estimate of an earlier frame into the present one: by the odometry it is nearer to
    /// where that frame has it, unless odometry began anew.
    fn left_motion(
        &self,
        earlier: &[Se3],
        present: &Se3,
        odometry: &Se3,
        world_from_camera: &Se3,
    ) -> Option<Se3> {
        let distance = |frame: &Se3| {
            let error = frame.compose(odometry).inverse().compose(world_from_camera);
            error.translation.norm() + error.rotation.log().norm()
        };
        let nearest = earlier.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let is_nearer = distance(nearest) < distance(present).min(FAR.0 + FAR.1);
        is_nearer.then(|| present.compose(&nearest.inverse())).filter(Se3::is_finite)
    }
}

/// The earlier frames of a client whose map is scaled.
pub(super) fn scale(frames: &mut [Se3], scale: f64) {
    frames.iter_mut().for_each(|frame| *frame = scaling::pose(scale, frame));
}

/// Adds the frame that a client's start estimates may be of; the oldest one goes. One that overflows is
/// that of no start estimate.
pub(super) fn remember(frames: &mut Vec<Se3>, frame: Se3) {
    if !frame.is_finite() {
        return;
    }
    if frames.len() == MOST_FRAMES {
        frames.remove(0);
    }
    frames.push(frame);
}
