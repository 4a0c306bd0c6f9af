//! Takes a frame through all stages of tracking.
//!
//! | file | role |
//! |---|---|
//! | this | the stages in order; the state between frames |
//! | `beginning` | the first keyframe |
//! | `initial` | A. the initial pose |
//! | `pose` | B. and D.: matches, and the pose that fits the static ones |
//! | `relocalization` | the pose after tracking was lost |
//!
//! This is tracking, the first of the paper's four threads. Tracked frames are handed to dense mapping
//! (`crate::dense::thread`). The server does local mapping and loop closing: keyframes are sent and
//! corrections are received as values (`crate::mapping`), and nothing here depends on a server.
//!
//! Two frames of reference are kept apart: the map, which the server corrects, and odometry, which
//! drifts and never jumps. A correction moves the last frame along with its reference keyframe.

mod beginning;
mod initial;
mod pose;
mod relocalization;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::time::Instant;

use covis_solvers::geometry::{LieGroup, Se3, So3};

use super::camera::FrameCamera;
use super::depth;
use super::image::{Image, RgbdFrame};
use super::input::SensorTiming;
use super::local_map::{Corrections, LocalMap};
use super::motion::history::Neighbor;
use super::motion::warp::Exposure;
use super::motion::{MotionDetector, MotionOptions};
use super::pyramid::Pyramid;
use super::shutter::Shutter;
use super::tracking::alignment::{AlignmentOptions, AlignmentPoint};
use super::tracking::keyframe::{self, KeyframeOptions, NewKeyframe};
use super::tracking::local_matching::{Match, MatchOptions, View};
use super::tracking::points::select_points;
use super::tracking::refinement::RefinedPose;
use super::tracking::rotation::SmallImage;
use super::tracking::surfaces::Surfaces;
use beginning::First;
use initial::InitialPose;
use pose::{FEW_INLIERS, LEAST_INLIERS, find_pose, pose_without_moving};

/// Levels of the pyramid.
const LEVELS: usize = 5;
/// A landmark that fitted in this many frames is known.
const KNOWN_TIMES: usize = 5;
/// Most frames in a row with a pose from the alignment alone, before tracking is lost.
const MOST_COASTED: usize = 5;
/// An alignment alone gives a pose only below this median residual, gray levels.
const COASTING_RESIDUAL: f32 = 25.0;
/// Landmarks that the first keyframe needs.
const LEAST_LANDMARKS: usize = 50;
/// A mask that leaves a smaller share of the pixels than this is ignored.
const LEAST_STILL_SHARE: f64 = 0.25;
/// Free space is looked up in keyframes that are at least this old, seconds.
const NEIGHBOR_AGE_S: f64 = 0.7;
/// How many such keyframes are looked up, and the time between them, seconds.
const NEIGHBORS: (usize, f64) = (4, 0.5);
/// Largest rotation to such a keyframe, rad, and how many rad a meter of distance counts as.
const NEIGHBOR_REACH: (f64, f64) = (0.5, 0.3);

/// Options of all stages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PipelineOptions {
    /// A. Initial pose.
    pub alignment: AlignmentOptions,
    /// B. Matching.
    pub matching: MatchOptions,
    /// C. Detection of movement; `None` leaves out this stage only.
    pub motion: Option<MotionOptions>,
    /// Keyframes.
    pub keyframes: KeyframeOptions,
    /// When rows and depth are taken.
    pub timing: SensorTiming,
}

impl Default for PipelineOptions {
    fn default() -> Self {
        Self {
            alignment: AlignmentOptions::default(),
            matching: MatchOptions::default(),
            motion: Some(MotionOptions::default()),
            keyframes: KeyframeOptions::default(),
            timing: SensorTiming::default(),
        }
    }
}

/// A frame whose pose is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedFrame {
    /// When it was captured, seconds.
    pub timestamp_s: f64,
    /// Its reference keyframe.
    pub keyframe: usize,
    /// Its pose relative to that keyframe.
    pub keyframe_from_camera: Se3,
    /// Its pose in the map at that time.
    pub world_from_camera: Se3,
    /// Its pose in the odometry frame.
    pub odom_from_camera: Se3,
    /// Matches that fit; 0 where the pose is from the alignment alone.
    pub inliers: usize,
}

/// How long the parts of a frame took, seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageSeconds {
    /// All of tracking, including the stages below.
    pub track: f64,
    /// A. Initial pose.
    pub align: f64,
    /// C. Detection of movement.
    pub mask: f64,
    /// B. and D. Matching and refinement.
    pub refine: f64,
}

/// The result of tracking a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Its pose; `None` where tracking is lost.
    pub tracked: Option<TrackedFrame>,
    /// The new keyframe, if there is one.
    pub keyframe: Option<NewKeyframe>,
    /// 255 where a pixel shows something that moves, as detected or given; `None` without either.
    pub moving: Option<Image<u8>>,
    /// Depth at the time of the color image, where the frame's own depth was taken at another time.
    pub synchronized_depth_m: Option<Image<f32>>,
    /// How long it took.
    pub seconds: StageSeconds,
}

/// The previous frame.
struct Last {
    timestamp_s: f64,
    pyramid: Arc<Pyramid>,
    small: SmallImage,
    moving: Option<Image<u8>>,
    points: Vec<AlignmentPoint>,
    /// Present until enough landmarks are known to distinguish the room from what moves in it.
    surfaces: Option<Surfaces>,
    keyframe: usize,
    world_from_camera: Se3,
    odom_from_camera: Se3,
    /// last_from_next, if the camera keeps moving as before, and the duration of the motion, seconds.
    motion: (Se3, f64),
}

/// The frame that is being tracked.
struct Now<'a> {
    frame: &'a RgbdFrame,
    pyramid: Arc<Pyramid>,
    /// Depth at the time of the color image.
    depth_m: &'a Image<f32>,
    shutter: Shutter,
}

/// Tracks a sequence.
pub struct Pipeline {
    camera: FrameCamera,
    options: PipelineOptions,
    map: LocalMap,
    detector: Option<MotionDetector>,
    first: Option<First>,
    last: Option<Last>,
    since_keyframe: usize,
    coasted: usize,
}

impl Pipeline {
    /// Starts with an empty map.
    #[must_use]
    pub fn new(camera: FrameCamera, options: PipelineOptions) -> Self {
        let detector = options.motion.map(|motion| MotionDetector::new(&camera, motion));
        let map = LocalMap::default();
        Self {
            camera,
            options,
            map,
            detector,
            first: None,
            last: None,
            since_keyframe: 0,
            coasted: 0,
        }
    }

    /// The lens.
    #[must_use]
    pub fn camera(&self) -> &FrameCamera {
        &self.camera
    }

    /// The frontend's copy of the map.
    #[must_use]
    pub fn map(&self) -> &LocalMap {
        &self.map
    }

    /// Applies the server's corrections to the map. Odometry does not change.
    pub fn correct(&mut self, corrections: &Corrections) {
        let Some(last) = &mut self.last else { return self.map.correct(corrections) };
        let before = self.map.keyframes[last.keyframe].world_from_camera;
        self.map.correct(corrections);
        let after = self.map.keyframes[last.keyframe].world_from_camera;
        last.world_from_camera = after.compose(&before.inverse().compose(&last.world_from_camera));
    }

    /// Tracks the next frame. `mask` is 255 where its user knows that something moves.
    pub fn track(&mut self, frame: &RgbdFrame, mask: Option<&Image<u8>>) -> Outcome {
        let start = Instant::now();
        let mut outcome = Outcome::default();
        if frame.color.size() == self.camera.size() {
            let pyramid = Arc::new(Pyramid::new(frame.gray(), LEVELS));
            if self.last.is_some() {
                self.track_next(frame, pyramid, mask, &mut outcome);
            } else {
                self.begin(frame, pyramid, mask, &mut outcome);
            }
        }
        outcome.seconds.track = start.elapsed().as_secs_f64();
        outcome
    }

    /// The shutter of a frame, and its depth at the time of the color image, from a motion that took
    /// `elapsed_s`. The depth is `None` where it needs no correction.
    fn synchronize(
        &self,
        frame: &RgbdFrame,
        motion: &Se3,
        elapsed_s: f64,
    ) -> (Shutter, Option<Image<f32>>) {
        let timing = &self.options.timing;
        let rate = motion.rotation.log() / elapsed_s;
        let shutter = Shutter::new(&self.camera, &rate, timing.readout_s);
        let turned = So3::exp(&(rate * -(frame.depth_delay_s + timing.depth_late_s)));
        (shutter, depth::synchronized(&self.camera, &frame.depth_m, &turned))
    }

    /// A frame after the first.
    fn track_next(
        &mut self,
        frame: &RgbdFrame,
        pyramid: Arc<Pyramid>,
        mask: Option<&Image<u8>>,
        outcome: &mut Outcome,
    ) {
        if let Some(mut first) = self.first.take() {
            self.begin_again(&mut first, (&pyramid, frame));
            outcome.keyframe = first.keyframe;
        }
        let Some(last) = &self.last else { return };
        let timing = self.options.timing;
        let stage = Instant::now();
        let elapsed_s = frame.timestamp_s - last.timestamp_s;
        let initial = initial::initial_pose(
            &self.camera,
            last,
            &pyramid,
            frame,
            &timing,
            &self.options.alignment,
        );
        outcome.seconds.align = stage.elapsed().as_secs_f64();
        let Some(InitialPose { last_from_camera, exposure, median_residual }) = initial else {
            return self.relocalize(frame, pyramid, outcome);
        };
        let (world, odom) = (last.world_from_camera, last.odom_from_camera);
        let (shutter, synchronized) = self.synchronize(frame, &last_from_camera, elapsed_s);
        let depth_m = synchronized.as_ref().unwrap_or(&frame.depth_m);
        let start = world.compose(&last_from_camera);

        let stage = Instant::now();
        let now = Now { frame, pyramid, depth_m, shutter };
        let given = mask.filter(|mask| mask.size() == self.camera.size());
        let view = now.view(&self.camera, usable_mask(given));
        // B. Matches on moving objects are still included: only the right pose shows what moves.
        let found = find_pose(&self.map, &view, &start, &self.options.matching);
        let (at, matches) =
            found.map_or((start, Vec::new()), |(found, all)| (found.world_from_camera, all));
        outcome.seconds.refine = stage.elapsed().as_secs_f64();

        let stage = Instant::now();
        let odom_at = odom.compose(&world.inverse().compose(&at));
        let images = (&*now.pyramid, depth_m);
        outcome.moving = self.moving(frame, images, &odom_at, Some((&at, exposure)), mask);
        outcome.seconds.mask = stage.elapsed().as_secs_f64();

        let stage = Instant::now();
        let view = now.view(&self.camera, usable_mask(outcome.moving.as_ref()));
        let matching = &self.options.matching;
        let refined = pose_without_moving(&mut self.map, &view, matches, &at, matching);
        outcome.seconds.refine += stage.elapsed().as_secs_f64();
        let (pose, inliers) = match refined {
            Some(refined) => {
                self.coasted = 0;
                (refined.world_from_camera, refined.inliers)
            }
            None if median_residual < COASTING_RESIDUAL && self.coasted < MOST_COASTED => {
                self.coasted += 1;
                (start, Vec::new())
            }
            None => {
                let pyramid = Arc::clone(&now.pyramid);
                return self.relocalize(frame, pyramid, outcome);
            }
        };
        let motion = world.inverse().compose(&pose);
        let poses = (pose, odom.compose(&motion));
        self.finish_frame(&now, outcome, poses, (motion, elapsed_s), &inliers, false);
        outcome.synchronized_depth_m = synchronized;
    }

    /// The mask of what moves, as detected at an approximate pose and as given by the user.
    fn moving(
        &mut self,
        frame: &RgbdFrame,
        (pyramid, depth_m): (&Pyramid, &Image<f32>),
        odom_from_camera: &Se3,
        start: Option<(&Se3, Exposure)>,
        mask: Option<&Image<u8>>,
    ) -> Option<Image<u8>> {
        let given = mask.filter(|mask| mask.size() == self.camera.size());
        let Some(detector) = &mut self.detector else { return given.cloned() };
        let neighbors = start
            .map_or_else(Vec::new, |(world, _)| neighbors(&self.map, world, frame.timestamp_s));
        let exposure = start.map_or(Exposure::SAME, |(_, exposure)| exposure);
        let images = (pyramid.level(0), depth_m);
        let mut moving =
            detector.detect(&self.camera, images, odom_from_camera, exposure, &neighbors);
        if let Some(given) = given {
            for (pixel, &given) in moving.pixels_mut().iter_mut().zip(given.pixels()) {
                *pixel = (*pixel).max(if given > 127 { 255 } else { 0 });
            }
        }
        Some(moving)
    }

    /// Keeps what the next frame needs; makes the frame a keyframe where one is due.
    fn finish_frame(
        &mut self,
        now: &Now<'_>,
        outcome: &mut Outcome,
        (world_from_camera, odom_from_camera): (Se3, Se3),
        motion: (Se3, f64),
        inliers: &[Match],
        is_first: bool,
    ) {
        for found in inliers {
            self.map.landmarks[found.landmark].times_tracked += 1;
        }
        let options = &self.options.keyframes;
        let reference = self.last.as_ref().map_or(0, |last| last.keyframe);
        self.since_keyframe += 1;
        let is_due = is_first
            || outcome.keyframe.is_none()
                && inliers.len() >= LEAST_INLIERS
                && self.since_keyframe >= options.least_frames
                && keyframe::is_due(
                    options,
                    &self.map.keyframes[reference],
                    &world_from_camera,
                    inliers,
                );
        let view = now.view(&self.camera, usable_mask(outcome.moving.as_ref()));
        let timestamp_s = now.frame.timestamp_s;
        if let Some(detector) = &mut self.detector {
            detector.correct_newest(&odom_from_camera);
        }
        if is_due {
            self.since_keyframe = 0;
            let poses = (&world_from_camera, &odom_from_camera);
            let new = keyframe::add_keyframe(
                &mut self.map,
                &view,
                &now.pyramid,
                poses,
                timestamp_s,
                inliers,
                options,
            );
            if let Some(detector) = &mut self.detector {
                detector.keep(new.id);
            }
            outcome.keyframe = Some(new);
        }
        let keyframe = outcome.keyframe.as_ref().map_or(reference, |new| new.id);
        let world_from_keyframe = self.map.keyframes[keyframe].world_from_camera;
        outcome.tracked = Some(TrackedFrame {
            timestamp_s,
            keyframe,
            keyframe_from_camera: world_from_keyframe.inverse().compose(&world_from_camera),
            world_from_camera,
            odom_from_camera,
            inliers: inliers.len(),
        });
        let times = |found: &Match| self.map.landmarks[found.landmark].times_tracked;
        let known = inliers.iter().filter(|found| times(found) >= KNOWN_TIMES);
        self.last = Some(Last {
            timestamp_s,
            small: SmallImage::new(&now.pyramid),
            moving: usable_mask(outcome.moving.as_ref()).cloned(),
            points: select_points(&view),
            surfaces: (known.count() < FEW_INLIERS).then(|| Surfaces::new(&view)),
            pyramid: Arc::clone(&now.pyramid),
            keyframe,
            world_from_camera,
            odom_from_camera,
            motion,
        });
    }

    /// Relocalizes a frame whose motion is not known.
    fn relocalize(&mut self, frame: &RgbdFrame, pyramid: Arc<Pyramid>, outcome: &mut Outcome) {
        let now = Now { frame, pyramid, depth_m: &frame.depth_m, shutter: Shutter::default() };
        let view = now.view(&self.camera, usable_mask(outcome.moving.as_ref()));
        let Some(start) = relocalization::locate(&self.map, &view) else { return };
        let refined = find_pose(&self.map, &view, &start, &self.options.matching);
        let Some((RefinedPose { world_from_camera, inliers, .. }, _)) = refined else { return };
        if inliers.len() < FEW_INLIERS {
            return;
        }
        let Some(last) = &self.last else { return };
        // Odometry continues by the motion in the map, without a gap.
        let motion = last.world_from_camera.inverse().compose(&world_from_camera);
        let odom_from_camera = last.odom_from_camera.compose(&motion);
        self.coasted = 0;
        let poses = (world_from_camera, odom_from_camera);
        self.finish_frame(&now, outcome, poses, (Se3::identity(), 0.0), &inliers, false);
    }
}

impl Now<'_> {
    fn view<'a>(&'a self, camera: &'a FrameCamera, moving: Option<&'a Image<u8>>) -> View<'a> {
        let (pyramid, depth_m, shutter) = (&*self.pyramid, self.depth_m, self.shutter);
        View { camera, pyramid, depth_m, shutter, moving }
    }
}

/// The mask, unless it leaves too few pixels for tracking.
fn usable_mask(moving: Option<&Image<u8>>) -> Option<&Image<u8>> {
    moving.filter(|mask| {
        let pixels = mask.pixels();
        let still = pixels.iter().filter(|&&pixel| pixel <= 127).count();
        still as f64 >= LEAST_STILL_SHARE * pixels.len() as f64
    })
}

/// Older keyframes that show most of what a camera at a pose sees, the closest first.
fn neighbors(map: &LocalMap, world_from_camera: &Se3, timestamp_s: f64) -> Vec<Neighbor> {
    let mut all = Vec::new();
    for (id, keyframe) in map.keyframes.iter().enumerate() {
        let keyframe_from_camera = keyframe.world_from_camera.inverse().compose(world_from_camera);
        let distance = keyframe_from_camera.translation.norm();
        let away = keyframe_from_camera.rotation.log().norm() + NEIGHBOR_REACH.1 * distance;
        if timestamp_s - keyframe.timestamp_s > NEIGHBOR_AGE_S && away < NEIGHBOR_REACH.0 {
            all.push((away, Neighbor { keyframe: id, keyframe_from_camera }));
        }
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let time = |neighbor: &Neighbor| map.keyframes[neighbor.keyframe].timestamp_s;
    let mut chosen: Vec<Neighbor> = Vec::new();
    for (_, neighbor) in all {
        let is_apart = |other: &Neighbor| (time(other) - time(&neighbor)).abs() > NEIGHBORS.1;
        if chosen.len() < NEIGHBORS.0 && chosen.iter().all(is_apart) {
            chosen.push(neighbor);
        }
    }
    chosen
}
