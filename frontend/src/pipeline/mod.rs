//! Takes a frame through the stages of tracking, named as in the paper's section on visual odometry.
//!
//! | stage | file | gives |
//! |---|---|---|
//! | A. initial estimate of the pose | `initial` | `InitialPose` |
//! | B. matches of landmarks | `pose` | `MatchedPose` |
//! | C. detection of movement | `movement` | a mask |
//! | D. pose from the static matches | `pose` | `RefinedPose` |
//! | keyframe, and what the next frame needs | this | [`Outcome`] |
//!
//! `beginning` makes the first keyframe; `relocalization` asks for the pose after tracking was lost;
//! `odometry` follows what a robot measures of its motion.
//!
//! This is tracking, the first of the paper's four threads. Tracked frames are handed to dense mapping
//! (`crate::dense::thread`). The server does local mapping and loop closing: keyframes are sent and
//! corrections are received as values (`crate::mapping`), and nothing here depends on a server.
//!
//! Two frames of reference are kept apart: the map, which the server corrects, and odometry, which
//! drifts and never jumps. A correction moves the last frame along with its reference keyframe.

mod beginning;
mod initial;
mod movement;
mod odometry;
mod pose;
pub mod relocalization;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::time::Instant;

use covis_solvers::geometry::{LieGroup, Se3, So3};

use super::camera::FrameCamera;
use super::depth;
use super::image::{Image, RgbdFrame};
use super::input::SensorTiming;
use super::local_map::{CameraPose, Corrections, LocalMap, MOST_KEYFRAMES};
use super::motion::MotionDetector;
use super::pyramid::Pyramid;
use super::shutter::Shutter;
use super::tracking::keyframe::{self, NewKeyframe};
use super::tracking::local_matching::{CurrentView, Match};
use super::tracking::points::AlignmentPoint;
use super::tracking::points::select_points;
use super::tracking::rotation::SmallImage;
use super::tracking::surfaces::Surfaces;
use beginning::FirstFrame;
use movement::usable_mask;
use odometry::Odometry;
use pose::{FEW_INLIERS, LEAST_INLIERS};
use relocalization::{Asked, Question};

/// Levels of the pyramid.
const LEVELS: usize = 5;
/// A landmark that fitted in this many frames is known.
const KNOWN_TIMES: usize = 5;
/// Most frames in a row with a pose from the alignment alone, before tracking is lost.
const MOST_COASTED: usize = 5;
/// An alignment alone gives a pose only below this median residual, gray levels.
const COASTING_RESIDUAL: f32 = 25.0;

/// Options of a pipeline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PipelineOptions {
    /// Whether movement is detected; without it only what the user's masks cover is left out.
    pub removes_motion: bool,
    /// When rows and depth are taken.
    pub timing: SensorTiming,
    /// The most keyframes of the local map, at least 1: what lies outside has no images in memory.
    pub most_keyframes: usize,
    /// Whether the poses that frames are given are odometry: keyframes are sent with it, and it says where the
    /// camera is while tracking is lost. Otherwise tracking only starts from them.
    pub has_odometry: bool,
}

impl Default for PipelineOptions {
    fn default() -> Self {
        Self {
            removes_motion: true,
            timing: SensorTiming::default(),
            most_keyframes: MOST_KEYFRAMES,
            has_odometry: false,
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
    /// What is to be asked while tracking is lost; [`Pipeline::answer`] takes the answer.
    pub question: Option<Question>,
    /// 255 where a pixel shows something that moves, as detected or given; `None` without either.
    pub moving: Option<Image<u8>>,
    /// Depth at the time of the color image, where the frame's own depth was taken at another time.
    pub synchronized_depth_m: Option<Image<f32>>,
    /// How long it took.
    pub seconds: StageSeconds,
}

/// A motion of the camera and how long it took.
#[derive(Clone, Copy)]
struct Motion {
    first_from_second: Se3,
    /// 0 where the motion is not known.
    seconds: f64,
}

impl Motion {
    fn unknown() -> Self {
        Self { first_from_second: Se3::identity(), seconds: 0.0 }
    }
}

/// The previous frame.
struct LastFrame {
    timestamp_s: f64,
    pyramid: Arc<Pyramid>,
    small: SmallImage,
    moving: Option<Image<u8>>,
    points: Vec<AlignmentPoint>,
    /// Present until enough landmarks are known to distinguish the room from what moves in it.
    surfaces: Option<Surfaces>,
    pose: CameraPose,
    /// The motion that led to it.
    motion: Motion,
    /// What the source gives.
    given_pose: Option<Se3>,
}

impl LastFrame {
    /// A frame at a pose, without its surfaces.
    fn new(
        frame: &CurrentFrame<'_>,
        view: &CurrentView<'_>,
        pose: CameraPose,
        motion: Motion,
    ) -> Self {
        Self {
            timestamp_s: frame.rgbd.timestamp_s,
            small: SmallImage::new(&frame.pyramid),
            moving: view.moving.cloned(),
            points: select_points(view),
            surfaces: None,
            pyramid: Arc::clone(&frame.pyramid),
            pose,
            motion,
            given_pose: frame.rgbd.given_pose,
        }
    }
}

/// What is known of the camera's pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// The last frame has one.
    Tracking,
    /// Only an earlier frame has one.
    Lost,
    /// The last frame has one that was asked for; the local map need not show the place.
    Located,
    /// The last frame has one that landmarks confirmed; they must confirm the next one too.
    Confirmed,
}

/// The frame that is being tracked.
struct CurrentFrame<'a> {
    rgbd: &'a RgbdFrame,
    pyramid: Arc<Pyramid>,
    /// 255 where the user knows that something moves.
    given_mask: Option<&'a Image<u8>>,
    shutter: Shutter,
    /// Depth at the time of the color image, where it was taken at another time.
    synchronized_depth_m: Option<Image<f32>>,
}

impl<'a> CurrentFrame<'a> {
    /// A frame whose motion is not known: shutter and depth are not corrected.
    fn new(rgbd: &'a RgbdFrame, pyramid: Arc<Pyramid>, given_mask: Option<&'a Image<u8>>) -> Self {
        let (shutter, synchronized_depth_m) = (Shutter::default(), None);
        Self { rgbd, pyramid, given_mask, shutter, synchronized_depth_m }
    }

    /// The frame with the shutter and the depth of a camera that moved like this.
    fn synchronized(self, camera: &FrameCamera, timing: &SensorTiming, motion: &Motion) -> Self {
        let rate = motion.first_from_second.rotation.log() / motion.seconds;
        let turned = So3::exp(&(rate * -(self.rgbd.depth_delay_s + timing.depth_late_s)));
        Self {
            shutter: Shutter::new(camera, &rate, timing.readout_s),
            synchronized_depth_m: depth::synchronized(camera, &self.rgbd.depth_m, &turned),
            ..self
        }
    }

    fn depth_m(&self) -> &Image<f32> {
        self.synchronized_depth_m.as_ref().unwrap_or(&self.rgbd.depth_m)
    }

    fn view<'v>(
        &'v self,
        camera: &'v FrameCamera,
        moving: Option<&'v Image<u8>>,
    ) -> CurrentView<'v> {
        let (pyramid, depth_m) = (&*self.pyramid, self.depth_m());
        CurrentView { camera, pyramid, depth_m, shutter: self.shutter, moving: usable_mask(moving) }
    }
}

/// The pose that the stages found, and what it is based on.
struct FoundPose {
    pose: CameraPose,
    motion: Motion,
    /// None where the pose is from the alignment alone.
    inliers: Vec<Match>,
}

/// What the stages found out about a frame.
struct Findings<'a> {
    frame: CurrentFrame<'a>,
    /// `None` where tracking is lost.
    pose: Option<FoundPose>,
    moving: Option<Image<u8>>,
    seconds: StageSeconds,
}

/// Tracks a sequence.
pub struct Pipeline {
    camera: FrameCamera,
    options: PipelineOptions,
    map: LocalMap,
    detector: Option<MotionDetector>,
    /// Present where the source measures odometry.
    odometry: Option<Odometry>,
    first: Option<FirstFrame>,
    last: Option<LastFrame>,
    since_keyframe: usize,
    coasted: usize,
    state: State,
    asked: Option<Asked>,
    /// How many there were.
    questions: u64,
}

impl Pipeline {
    /// Starts with an empty map.
    #[must_use]
    pub fn new(camera: FrameCamera, options: PipelineOptions) -> Self {
        let detector = options.removes_motion.then(|| MotionDetector::new(&camera));
        let odometry = options.has_odometry.then(Odometry::default);
        let map = LocalMap::default();
        Self {
            camera,
            options,
            map,
            detector,
            odometry,
            first: None,
            last: None,
            since_keyframe: 0,
            coasted: 0,
            state: State::Tracking,
            asked: None,
            questions: 0,
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
        let before = self.map.reference().map(|keyframe| keyframe.world_from_camera);
        self.map.correct(corrections);
        let after = self.map.reference().map(|keyframe| keyframe.world_from_camera);
        if let (Some(last), Some(before), Some(after)) = (&mut self.last, before, after) {
            let keyframe_from_camera = before.inverse().compose(&last.pose.world_from_camera);
            last.pose.world_from_camera = after.compose(&keyframe_from_camera);
        }
    }

    /// Tracks the next frame. `mask` is 255 where its user knows that something moves.
    pub fn track(&mut self, frame: &RgbdFrame, mask: Option<&Image<u8>>) -> Outcome {
        let start = Instant::now();
        let mut outcome = Outcome::default();
        if frame.color.size() == self.camera.size() {
            let pyramid = Arc::new(Pyramid::new(frame.gray(), LEVELS));
            let mask = mask.filter(|mask| mask.size() == self.camera.size());
            let frame = CurrentFrame::new(frame, pyramid, mask);
            outcome = if self.last.is_some() { self.track_next(frame) } else { self.begin(frame) };
        }
        outcome.seconds.track = start.elapsed().as_secs_f64();
        outcome
    }

    /// A frame after the first.
    fn track_next(&mut self, frame: CurrentFrame<'_>) -> Outcome {
        if self.state == State::Lost {
            return Outcome { question: self.track_lost_frame(&frame), ..Outcome::default() };
        }
        let first_keyframe = self.begin_again(&frame);
        let mut findings = self.follow(frame);
        let mut question = None;
        if findings.pose.is_none() {
            let CurrentFrame { rgbd, pyramid, given_mask, .. } = findings.frame;
            findings.frame = CurrentFrame::new(rgbd, pyramid, given_mask);
            question = self.request_relocalization(&findings.frame);
        }
        let outcome = self.finish(findings, first_keyframe.is_none());
        Outcome { keyframe: outcome.keyframe.or(first_keyframe), question, ..outcome }
    }

    /// The stages A to D: the pose of a frame by its motion since the last one.
    fn follow<'a>(&mut self, frame: CurrentFrame<'a>) -> Findings<'a> {
        let mut seconds = StageSeconds::default();
        let mut stage = Instant::now();
        let initial = self.last.as_ref().and_then(|last| self.initial_pose(last, &frame));
        seconds.align = stage.elapsed().as_secs_f64();
        let (Some(last), Some(initial)) = (&self.last, initial) else {
            return Findings { frame, pose: None, moving: None, seconds };
        };
        let last_pose = last.pose;
        let start = last_pose.world_from_camera.compose(&initial.motion.first_from_second);
        let frame = frame.synchronized(&self.camera, &self.options.timing, &initial.motion);

        // B. Matches on moving objects are still included: only the right pose shows what moves.
        stage = Instant::now();
        let view = frame.view(&self.camera, frame.given_mask);
        let (near, matches) = match pose::match_map(&self.map, &view, &start) {
            Some(found) => (found.refined.world_from_camera, found.matches),
            None => (start, Vec::new()),
        };
        seconds.refine = stage.elapsed().as_secs_f64();

        stage = Instant::now();
        let moving = self.detect_movement(&frame, &last_pose.moved_to(&near), initial.exposure);
        seconds.mask = stage.elapsed().as_secs_f64();

        stage = Instant::now();
        let view = frame.view(&self.camera, moving.as_ref());
        let split = pose::without_moving(&view, matches);
        // Landmarks that move count as new from now on.
        for found in &split.moving {
            self.map.landmarks[found.landmark].times_tracked = 0;
        }
        let refined = pose::refine_static(&self.map, &view, &split.still, &near);
        seconds.refine += stage.elapsed().as_secs_f64();

        let is_confirmed = self.state == State::Confirmed;
        let least = if is_confirmed { FEW_INLIERS } else { LEAST_INLIERS };
        let found = match refined.filter(|refined| refined.inliers.len() >= least) {
            Some(refined) => {
                self.coasted = 0;
                Some((refined.world_from_camera, refined.inliers))
            }
            None if is_confirmed => None,
            None if initial.median_residual < COASTING_RESIDUAL && self.coasted < MOST_COASTED => {
                self.coasted += 1;
                Some((start, Vec::new()))
            }
            None => None,
        };
        let pose = found.map(|(world_from_camera, inliers)| {
            let first_from_second =
                last_pose.world_from_camera.inverse().compose(&world_from_camera);
            let motion = Motion { first_from_second, ..initial.motion };
            FoundPose { pose: last_pose.moved_to(&world_from_camera), motion, inliers }
        });
        Findings { frame, pose, moving, seconds }
    }

    /// Keeps what the next frame needs; makes the frame a keyframe where it may be one and one is due.
    fn finish(&mut self, findings: Findings<'_>, may_be_keyframe: bool) -> Outcome {
        let Findings { frame, pose, moving, seconds } = findings;
        let Some(FoundPose { pose, motion, inliers }) = pose else {
            return Outcome { moving, seconds, ..Outcome::default() };
        };
        self.map.tracked(inliers.iter().map(|found| found.landmark));
        let times = |found: &&Match| self.map.landmarks[found.landmark].times_tracked;
        let known = inliers.iter().filter(|found| times(found) >= KNOWN_TIMES).count();
        self.since_keyframe += 1;
        // A place that the local map does not show is mapped anew; what joins both is the server's to find.
        let is_elsewhere = self.state == State::Located && inliers.len() < LEAST_INLIERS;
        (self.state, self.asked) = (State::Tracking, None);
        // A source that gives poses may have few frames a second, each of which shows another place.
        let may_follow =
            self.since_keyframe >= keyframe::LEAST_FRAMES || frame.rgbd.given_pose.is_some();
        let is_due = self.map.reference().is_none_or(|reference| {
            may_be_keyframe
                && (is_elsewhere
                    || inliers.len() >= LEAST_INLIERS
                        && may_follow
                        && keyframe::is_due(reference, &pose.world_from_camera, &inliers))
        });
        if let Some(detector) = &mut self.detector {
            detector.correct_newest(&pose.odom_from_camera);
        }
        let view = frame.view(&self.camera, moving.as_ref());
        let timestamp_s = frame.rgbd.timestamp_s;
        let new = is_due.then(|| {
            keyframe::add_keyframe(
                &mut self.map,
                &view,
                &frame.pyramid,
                &pose,
                timestamp_s,
                &inliers,
            )
        });
        let new = new.map(|new| match &mut self.odometry {
            Some(odometry) => {
                let tracked = &new.odom_from_camera;
                let odom_from_camera = odometry.next(frame.rgbd.given_pose.as_ref(), tracked);
                NewKeyframe { odom_from_camera, ..new }
            }
            None => new,
        });
        if let Some(new) = &new {
            self.since_keyframe = 0;
            let left = self.map.trim(self.options.most_keyframes);
            if let Some(detector) = &mut self.detector {
                detector.keep(new.id);
                left.into_iter().for_each(|keyframe| detector.forget(keyframe));
            }
        }
        let reference = self.map.reference();
        let tracked = reference.map(|reference| TrackedFrame {
            timestamp_s,
            keyframe: reference.id,
            keyframe_from_camera: reference
                .world_from_camera
                .inverse()
                .compose(&pose.world_from_camera),
            world_from_camera: pose.world_from_camera,
            odom_from_camera: pose.odom_from_camera,
            inliers: inliers.len(),
        });
        let surfaces = (known < FEW_INLIERS).then(|| Surfaces::new(&view));
        self.last = Some(LastFrame { surfaces, ..LastFrame::new(&frame, &view, pose, motion) });
        Outcome {
            tracked,
            keyframe: new,
            question: None,
            moving,
            synchronized_depth_m: frame.synchronized_depth_m,
            seconds,
        }
    }
}
