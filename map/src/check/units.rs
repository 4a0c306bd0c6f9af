//! Lengths in the sender's unit as lengths in the map's, on their way into the map.
//!
//! A number that is out of range in the map's unit is a violation of its field. A keyframe of an earlier
//! frame is moved into the present one, in the map's unit; the event keeps it as it was sent, and what
//! moves it. What a scale does to a value is for [`scaling`] to say.

use std::fmt::{Arguments, Display};

use covis_solvers::geometry::{Camera, LieGroup, Se3, Sim3};
use covis_solvers::information::Information;
use nalgebra::{Vector2, Vector3};

use super::Check;
use crate::numbers::is_finite;
use crate::{Depth, EntityId, ItemObservation, NewLandmark, Reason, scaling};

const OVERFLOWS: &str = "it is out of range in the map's unit of length";

/// Points of the map that a keyframe must see to tell where it is.
const LEAST_SEEN: usize = 10;
/// The most that one of them counts against a pose, squared deviations.
const MOST_MISFIT: f64 = 100.0;

/// A point of the map and where a keyframe sees it.
struct Sight {
    point: Vector3<f64>,
    pixel: Vector2<f64>,
    sigma_px: f64,
}

/// How badly a pose fits what a keyframe sees.
fn misfit(camera: &Camera, seen: &[Sight], world_from_camera: &Se3) -> f64 {
    let of = |sight: &Sight| {
        let at = camera.project(&world_from_camera.inverse_transform(&sight.point));
        let squared = at.map(|at| ((at - sight.pixel) / sight.sigma_px).norm_squared());
        squared.filter(|squared| *squared < MOST_MISFIT).unwrap_or(MOST_MISFIT)
    };
    seen.iter().map(of).sum()
}

impl Check<'_> {
    /// Length in the map of the sender's unit of length.
    pub(super) fn scale(&self) -> f64 {
        self.map.scale_of(self.client)
    }

    /// What moves the start estimate of a keyframe and its landmarks into the sender's present frame and
    /// the map's unit.
    pub(super) fn motion(
        &mut self,
        world_from_camera: &Se3,
        odom_from_camera: Option<&Se3>,
        landmarks: &[NewLandmark],
        camera: Option<EntityId>,
        observations: &[ItemObservation],
    ) -> Option<Sim3> {
        let scale = self.scale();
        let is_within = |motion: &Sim3| {
            let pose = motion.transform_pose(world_from_camera).is_finite();
            let points = landmarks.iter().filter_map(|new| new.position);
            pose && points.map(|p| motion.transform(&p)).all(|p| is_finite(&p))
        };
        let odometry = odom_from_camera.map(|odom| self.scaled("keyframe.odom_from_camera", odom));
        let start = self.scaled("keyframe.world_from_camera", world_from_camera);
        let seen = self.seen_again(camera, observations);
        let cost = |pose: &Se3| seen.as_ref().map(|(camera, seen)| misfit(camera, seen, pose));
        let motion = self.map.start_motion(self.client, &start, odometry.as_ref(), cost);
        let motion = motion.map(|motion| Sim3 { scale, ..motion.into() });
        // A frame in which it overflows is not the one that it is of.
        let motion = motion.filter(is_within);
        motion.or_else(|| (scale != 1.0).then(|| scaling::similarity(scale)))
    }

    /// The camera of a keyframe, and what it sees of the map: pixels with their deviation, and points that
    /// are there.
    fn seen_again(
        &self,
        camera: Option<EntityId>,
        observations: &[ItemObservation],
    ) -> Option<(Camera, Vec<Sight>)> {
        let camera = self.map.cameras().get(&camera?)?.camera;
        let sight = |sent: &ItemObservation| {
            let landmark = self.map.landmarks().get(&self.resolve(&sent.landmark)?)?;
            let is_known = !landmark.observers.is_empty() && sent.sigma_px > 0.0;
            let point = landmark.position.filter(|_| is_known)?;
            Some(Sight { point, pixel: sent.pixel, sigma_px: sent.sigma_px })
        };
        let seen: Vec<Sight> = observations.iter().filter_map(sight).collect();
        (seen.len() >= LEAST_SEEN).then_some((camera, seen))
    }

    /// A pose in the map's unit.
    pub(super) fn scaled(&mut self, field: &str, sent: &Se3) -> Se3 {
        Se3::new(sent.rotation, self.scaled_point(field, &sent.translation))
    }

    pub(super) fn scaled_point(
        &mut self,
        field: impl Display,
        sent: &Vector3<f64>,
    ) -> Vector3<f64> {
        let scaled = sent * self.scale();
        // One that could not be read is not finite before.
        if sent.iter().zip(&scaled).any(|(sent, scaled)| sent.is_finite() && !scaled.is_finite()) {
            self.add(field, Reason::OutOfRange, OVERFLOWS);
        }
        scaled
    }

    pub(super) fn depth(&self, sent: &ItemObservation) -> Option<Depth> {
        scaling::depth(self.scale(), sent.depth?)
    }

    /// Information of an error with lengths in the sender's unit.
    pub(super) fn information<const N: usize>(
        &mut self,
        field: &str,
        sent: &Information<N>,
    ) -> Option<Information<N>> {
        let scaled = scaling::information(self.scale(), sent);
        if scaled.is_none() {
            self.add(field, Reason::OutOfRange, OVERFLOWS);
        }
        scaled
    }

    /// The depth of an observation in the map's unit.
    pub(super) fn scaled_depth(
        &mut self,
        at: Arguments<'_>,
        sent: &ItemObservation,
    ) -> Option<Depth> {
        let depth = self.depth(sent);
        // One that could not be read was reported before.
        let was_positive = |sent: Depth| sent.depth_m > 0.0 && sent.sigma_m > 0.0;
        if depth.is_none() && sent.depth.is_some_and(was_positive) {
            self.add(format_args!("{at}.depth_m"), Reason::OutOfRange, OVERFLOWS);
        }
        depth
    }
}
