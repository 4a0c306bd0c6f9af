//! Where a lost camera is told to be: a recorded desk, and made rooms whose furniture is repeated.
//!
//! An answer is wrong where it is further from the truth than five of its standard deviations, in position
//! or in rotation. The truth of the made rooms is exact.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
#![allow(clippy::print_stdout, reason = "a test shows what it measured")]

mod recorded;
mod room;

use std::collections::BTreeMap;
use std::sync::Arc;

use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3};
use nalgebra::{Matrix3, Vector2, Vector3, Vector6};

use super::*;
use crate::place::PlaceIndex;
use crate::{CameraEntity, Change, ClientIndex, Depth, Event, MapPolicy, NewLandmark};

/// A map, its index of places, and the true poses of its keyframes.
struct Mapped {
    map: Map,
    index: PlaceIndex,
    truth: BTreeMap<EntityId, Se3>,
}

/// What a camera sees of a scene.
#[derive(Clone, Debug)]
struct Sight {
    landmark: i64,
    feature: Feature,
    descriptor: Descriptor,
}

fn id(id: i64) -> EntityId {
    EntityId::new(ClientIndex(0), id)
}

fn orb(data: Vec<u8>) -> Descriptor {
    Descriptor { kind: DescriptorKind::Binary, name: "orb".to_owned(), data }
}

impl Mapped {
    fn new(camera: Camera) -> Self {
        let (map, index, truth) = (Map::new(), PlaceIndex::default(), BTreeMap::new());
        let mut made = Self { map, index, truth };
        let (policy, display_name) = (MapPolicy::default(), String::new());
        made.apply(Change::Created { policy, create_time_ns: 1, display_name });
        made.apply(Change::ClientOpened { name: "robot".to_owned(), epoch: 1 });
        let camera = CameraEntity { camera, width_px: 640, height_px: 480 };
        made.apply(Change::CameraSet { id: id(0), camera });
        made
    }

    fn apply(&mut self, change: Change) {
        let event = Event { revision: self.map.revision() + 1, time_ns: 0, cause: None, change };
        self.map.apply(&event).unwrap();
    }

    /// Adds a keyframe at `odom_from_camera`.
    fn add(&mut self, number: i64, odometry: &Se3, truth: &Se3, seen: &[Sight]) {
        let new = |sight: &&Sight| !self.map.landmarks().contains_key(&id(sight.landmark));
        let landmarks = seen.iter().filter(new);
        let landmarks = landmarks.map(|s| NewLandmark { id: id(s.landmark), position: None });
        let observation = |sight: &Sight| Observation {
            landmark: id(sight.landmark),
            pixel: sight.feature.pixel,
            sigma_px: sight.feature.sigma_px,
            depth: sight.feature.depth_m.map(|(depth_m, sigma_m)| Depth { depth_m, sigma_m }),
            descriptor: Some(Arc::new(sight.descriptor.clone())),
        };
        let change = Change::KeyframeAdded {
            id: id(number),
            capture_time_ns: 100_000_000 * number,
            camera: Some(id(0)),
            world_from_camera: *odometry,
            odom_from_camera: *odometry,
            observations: seen.iter().map(observation).collect(),
            landmarks: landmarks.collect(),
            motion: None,
            global_descriptor: None,
        };
        self.apply(change);
        let keyframe = self.map.keyframes().get(&id(number)).unwrap();
        let (_, features) = indexed(keyframe);
        self.index.add(id(number), 100_000_000 * number, &features).unwrap();
        self.truth.insert(id(number), *truth);
    }

    /// What is answered to a camera that sees this.
    fn ask(&self, camera: Camera, seen: &[Sight], with_depth: bool) -> Localization {
        let feature = |sight: &Sight| Feature {
            depth_m: sight.feature.depth_m.filter(|_| with_depth),
            ..sight.feature
        };
        let view = QueryView {
            camera,
            camera_id: None,
            features: seen.iter().map(feature).collect(),
            descriptors: seen.iter().map(|sight| Some(&sight.descriptor)).collect(),
            image: None,
        };
        let (_, features) = view.searchable();
        let count = PlaceSearch::MOST_CANDIDATES;
        let candidates = self.index.query(&features, None, count, |_| false).unwrap();
        localize(&self.map, &view, &candidates, &Interrupt::default())
    }
}

/// An answer beside the truth.
struct Answer {
    /// m and degrees.
    error: (f64, f64),
    /// The error of the position or of the rotation, the larger one, in standard deviations.
    sigmas: f64,
    /// rᵀΩr/6.
    nees: f64,
}

impl Answer {
    /// `slack`: standard deviation of the truth, m and rad.
    fn new(located: &Located, candidate_from_query: &Se3, slack: f64) -> Self {
        let answer = &located.verified;
        let error = answer.candidate_from_query.minus(candidate_from_query);
        let covariance = answer.information.covariance().unwrap();
        let sigmas = |at: usize| {
            let own: Matrix3<f64> = covariance.matrix().fixed_view::<3, 3>(at, at).into_owned();
            let error: Vector3<f64> = error.fixed_rows::<3>(at).into_owned();
            let sum = own + Matrix3::identity() * (slack * slack);
            error.dot(&sum.cholesky().unwrap().solve(&error)).sqrt()
        };
        let off = candidate_from_query.inverse().compose(&answer.candidate_from_query);
        Self {
            error: (off.translation.norm(), off.rotation.log().norm().to_degrees()),
            sigmas: sigmas(0).max(sigmas(3)),
            nees: answer.information.squared_norm(&error) / 6.0,
        }
    }
}

/// How cameras at places that the map shows (`known`) and elsewhere were answered.
#[derive(Debug, Default)]
struct Tally {
    known: usize,
    answered: usize,
    elsewhere: usize,
    answered_elsewhere: usize,
    ambiguous: usize,
    /// Errors of answers that are further off than five of their standard deviations, m and degrees.
    wrong: Vec<(f64, f64)>,
    /// Those of the others.
    right: Vec<(f64, f64)>,
    nees: Vec<f64>,
}

impl Tally {
    fn add(&mut self, is_known: bool, found: &Localization, answer: Option<Answer>) {
        self.known += usize::from(is_known);
        self.elsewhere += usize::from(!is_known);
        self.ambiguous += usize::from(!found.rivals.is_empty());
        assert!(found.rivals.is_empty() || found.located.is_none());
        let Some(Answer { error, sigmas, nees }) = answer else { return };
        self.answered += usize::from(is_known);
        self.answered_elsewhere += usize::from(!is_known);
        if sigmas > 5.0 {
            println!("wrong by {error:?} m and degrees, {sigmas:.1} standard deviations");
            self.wrong.push(error);
        } else {
            self.right.push(error);
            self.nees.push(nees);
        }
    }

    fn text(&self) -> String {
        let median = |numbers: &mut dyn Iterator<Item = f64>| {
            let mut numbers: Vec<f64> = numbers.collect();
            numbers.sort_by(f64::total_cmp);
            numbers.get(numbers.len() / 2).copied().unwrap_or(0.0)
        };
        let m = median(&mut self.right.iter().map(|error| error.0));
        let deg = median(&mut self.right.iter().map(|error| error.1));
        let nees = median(&mut self.nees.iter().copied());
        format!(
            "{} of {} at known places answered, {} of {} elsewhere, {} ambiguous, {} wrong; medians \
             {m:.3} m, {deg:.2} deg, NEES/6 {nees:.2}",
            self.answered,
            self.known,
            self.answered_elsewhere,
            self.elsewhere,
            self.ambiguous,
            self.wrong.len()
        )
    }
}
