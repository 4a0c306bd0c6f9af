//! A frame through all stages of tracking.
//!
//! Two frames of reference are kept apart: the map, which the server corrects, and odometry, which
//! drifts and never jumps. A correction moves the last frame along with its reference keyframe.
//! Knows no server: keyframes go out and corrections come in as values.

use std::sync::Arc;

use covis_solvers::geometry::{LieGroup, Se3, So3};

use super::camera::FrameCamera;
use super::depth;
use super::image::{Image, RgbdFrame};
use super::local_map::{Corrections, LocalMap};
use super::motion::history::Neighbor;
use super::motion::warp::Exposure;
use super::motion::{MotionDetector, MotionOptions};
use super::pyramid::Pyramid;
use super::shutter::Shutter;
use super::tracking::alignment::{AlignmentOptions, AlignmentPoint, align};
use super::tracking::keyframe::{self, KeyframeOptions, NewKeyframe};
use super::tracking::local_matching::{Match, MatchOptions, View, match_landmarks};
use super::tracking::points::select_points;
use super::tracking::refinement::refine_pose;
use super::tracking::rotation::SmallImage;

/// Levels of the pyramid.
const LEVELS: usize = 5;

/// Options of all stages.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PipelineOptions {
    /// A. Initial pose.
    pub alignment: AlignmentOptions,
    /// B. Matching.
    pub matching: MatchOptions,
    /// Keyframes.
    pub keyframes: KeyframeOptions,
    /// C. Detection of movement.
    pub motion: MotionOptions,
    /// Whether what moves is left out.
    pub removes_motion: bool,
}

/// A frame whose pose is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedFrame {
    /// When it was captured, seconds.
    pub timestamp_s: f64,
    /// The keyframe that it is tied to.
    pub keyframe: usize,
    /// Its pose beside that keyframe.
    pub keyframe_from_camera: Se3,
    /// Its pose in the map at that time.
    pub world_from_camera: Se3,
    /// Its pose in the odometry frame.
    pub odom_from_camera: Se3,
    /// Matches that fit.
    pub inliers: usize,
}

/// What became of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Its pose; `None` where tracking is lost.
    pub tracked: Option<TrackedFrame>,
    /// The keyframe that it became.
    pub keyframe: Option<NewKeyframe>,
    /// 255 where a pixel shows something that moves; empty without detection.
    pub moving: Option<Image<u8>>,
}

/// The frame before.
struct Last {
    timestamp_s: f64,
    small: SmallImage,
    moving: Option<Image<u8>>,
    pyramid: Arc<Pyramid>,
    points: Vec<AlignmentPoint>,
    keyframe: usize,
    world_from_camera: Se3,
    odom_from_camera: Se3,
    /// last_from_next, if the camera goes on as it did.
    motion: Se3,
}

/// Tracks a sequence.
pub struct Pipeline {
    camera: FrameCamera,
    options: PipelineOptions,
    map: LocalMap,
    last: Option<Last>,
    since_keyframe: usize,
    motion: Option<MotionDetector>,
}

impl Pipeline {
    /// Starts with an empty map.
    #[must_use]
    pub fn new(camera: FrameCamera, options: PipelineOptions) -> Self {
        Self { map: LocalMap::default(), last: None, since_keyframe: 0, motion: options.removes_motion.then(|| MotionDetector::new(&camera, options.motion)), camera, options }
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

    /// Takes what the server corrected.
    pub fn correct(&mut self, corrections: &Corrections) {
        let Some(last) = &mut self.last else { return self.map.correct(corrections) };
        let before = self.map.keyframes[last.keyframe].world_from_camera;
        self.map.correct(corrections);
        let after = self.map.keyframes[last.keyframe].world_from_camera;
        last.world_from_camera = after.compose(&before.inverse().compose(&last.world_from_camera));
    }

    /// Tracks the next frame.
    pub fn track(&mut self, frame: &RgbdFrame) -> Outcome {
        let pyramid = Arc::new(Pyramid::new(frame.gray(), LEVELS));
        let Some(last) = &self.last else { return self.begin(frame, pyramid) };
        let start = last.motion.inverse();
        let images = (&*last.pyramid, &*pyramid);
        let readout: f64 = std::env::var("READOUT").ok().and_then(|s| s.parse().ok()).unwrap_or(0.0);
        let elapsed = frame.timestamp_s - last.timestamp_s;
        let predicted = Shutter::new(&self.camera, &(last.motion.rotation.log() / elapsed), readout);
        let small = SmallImage::new(&pyramid);
        let still = |pixel: &nalgebra::Vector2<f64>| last.moving.as_ref().is_some_and(|mask| mask.at((pixel.x as usize).min(mask.width()-1), (pixel.y as usize).min(mask.height()-1)) > 0);
        let mut starts = vec![start, Se3::identity()];
        if let Some(rotation) = last.small.rotation_to(&small, &self.camera, &start.rotation, still) { starts.insert(0, Se3::new(rotation, start.translation)); }
        let Some(aligned) = starts.iter().filter_map(|start| align((&self.camera, &predicted), images, &last.points, start, &self.options.alignment)).min_by(|a,b| a.median_residual.total_cmp(&b.median_residual))
        else {
            return Outcome::default();
        };
        let last_from_camera = aligned.current_from_reference.inverse();
        let initial = last.world_from_camera.compose(&last_from_camera);
        let shutter = Shutter::new(&self.camera, &(last_from_camera.rotation.log() / elapsed), readout);
        let turned = last_from_camera.rotation.log() * (frame.depth_delay_s / (frame.timestamp_s - last.timestamp_s));
        let depth_from_color = So3::exp(&-turned);
        let synchronized = depth::synchronized(&self.camera, &frame.depth_m, &depth_from_color);
        let depth_m = synchronized.as_ref().unwrap_or(&frame.depth_m);
        let exposure = Exposure { gain: aligned.gain as f32, offset: aligned.offset as f32 };
        let moving = self.motion.as_mut().map(|motion| motion.detect(&self.camera, (pyramid.level(0), depth_m), &last.odom_from_camera.compose(&last_from_camera), exposure, &neighbors(&self.map, &initial, frame.timestamp_s)));
        let view = View {
            camera: &self.camera,
            pyramid: &pyramid,
            depth_m,
            shutter,
            moving: moving.as_ref(),
        };
        let matches = match_landmarks(&view, &mut self.map, &initial, &self.options.matching);
        let mut refined = refine_pose(&self.camera, &self.map, &matches, &initial, 12);
        if refined.as_ref().is_none_or(|r| r.inliers.len() < 40) {
            let coarse = MatchOptions { finest: 2, ..self.options.matching };
            let matches = match_landmarks(&view, &mut self.map, &initial, &coarse);
            if let Some(rough) = refine_pose(&self.camera, &self.map, &matches, &initial, 12) {
                let matches = match_landmarks(&view, &mut self.map, &rough.world_from_camera, &self.options.matching);
                let again = refine_pose(&self.camera, &self.map, &matches, &rough.world_from_camera, 12);
                let best = again.unwrap_or(rough);
                if refined.as_ref().is_none_or(|r| r.inliers.len() < best.inliers.len()) { refined = Some(best); }
            }
        }
        if std::env::var("V").is_ok() { eprintln!("{:.2} pts {} vis {} med {:.1} gain {:.2} off {:.1} matches {} inl {:?}", frame.timestamp_s, last.points.len(), aligned.visible, aligned.median_residual, aligned.gain, aligned.offset, matches.len(), refined.as_ref().map(|r| (r.inliers.len(), r.scale))); }
        if refined.is_none() && (aligned.median_residual > 25.0) { return Outcome::default(); }
        let inlier_matches = refined.as_ref().map(|r| r.inliers.clone()).unwrap_or_default();
        let world_from_camera = refined.as_ref().map_or(initial, |r| r.world_from_camera);
        let motion = last.world_from_camera.inverse().compose(&world_from_camera);
        let odom_from_camera = last.odom_from_camera.compose(&motion);
        if let Some(motion) = &mut self.motion {
            motion.settle(&odom_from_camera);
        }
        let reference = last.keyframe;
        self.since_keyframe += 1;
        let mut depths: Vec<f64> =
            inlier_matches.iter().filter_map(|m| m.depth_m.map(|(z, _)| z)).collect();
        depths.sort_by(f64::total_cmp);
        let median_depth_m = depths.get(depths.len() / 2).copied().unwrap_or(2.0);
        let is_due = self.since_keyframe >= self.options.keyframes.least_frames
            && keyframe::is_due(
                &self.options.keyframes,
                &self.map.keyframes[reference],
                &world_from_camera,
                inlier_matches.len(),
                median_depth_m,
            );
        let poses = (&world_from_camera, &odom_from_camera);
        let new = is_due.then(|| {
            self.since_keyframe = 0;
            add(&mut self.map, &view, &pyramid, poses, frame.timestamp_s, &inlier_matches, &self.options.keyframes)
        });
        if let (Some(motion), Some(new)) = (&mut self.motion, &new) {
            motion.keep(new.id);
        }
        let keyframe = new.as_ref().map_or(reference, |new| new.id);
        let points = select_points(&view, pyramid.level(0));
        let inliers = inlier_matches.len();
        self.last = Some(Last { timestamp_s: frame.timestamp_s, small, moving: moving.clone(), pyramid, points, keyframe, world_from_camera, odom_from_camera, motion });
        let world_from_keyframe = self.map.keyframes[keyframe].world_from_camera;
        Outcome {
            tracked: Some(TrackedFrame {
                timestamp_s: frame.timestamp_s,
                keyframe,
                keyframe_from_camera: world_from_keyframe.inverse().compose(&world_from_camera),
                world_from_camera,
                odom_from_camera,
                inliers,
            }),
            keyframe: new,
            moving,
        }
    }

    /// The first frame is the first keyframe, and its camera the origin of both frames.
    fn begin(&mut self, frame: &RgbdFrame, pyramid: Arc<Pyramid>) -> Outcome {
        let view = View {
            camera: &self.camera,
            pyramid: &pyramid,
            depth_m: &frame.depth_m,
            shutter: Shutter::default(),
            moving: None,
        };
        let origin = Se3::identity();
        let exposure = Exposure { gain: 1.0, offset: 0.0 };
        let moving = self.motion.as_mut().map(|motion| motion.detect(&self.camera, (pyramid.level(0), &frame.depth_m), &origin, exposure, &[]));
        let points = select_points(&view, pyramid.level(0));
        let new = add(&mut self.map, &view, &pyramid, (&origin, &origin), frame.timestamp_s, &[], &self.options.keyframes);
        let tracked = TrackedFrame {
            timestamp_s: frame.timestamp_s,
            keyframe: new.id,
            keyframe_from_camera: origin,
            world_from_camera: origin,
            odom_from_camera: origin,
            inliers: new.observations.len(),
        };
        self.last = Some(Last {
            timestamp_s: frame.timestamp_s,
            small: SmallImage::new(&pyramid),
            moving: None,
            pyramid,
            points,
            keyframe: new.id,
            world_from_camera: origin,
            odom_from_camera: origin,
            motion: origin,
        });
        Outcome { tracked: Some(tracked), keyframe: Some(new), moving }
    }
}

/// The keyframes of some time ago that show most of what a camera at a pose sees.
fn neighbors(map: &LocalMap, world_from_camera: &Se3, timestamp_s: f64) -> Vec<Neighbor> {
    let mut all = Vec::new();
    for (id, keyframe) in map.keyframes.iter().enumerate() {
        let keyframe_from_camera = keyframe.world_from_camera.inverse().compose(world_from_camera);
        let away = keyframe_from_camera.rotation.log().norm() + 0.3 * keyframe_from_camera.translation.norm();
        if timestamp_s - keyframe.timestamp_s > 0.7 && away < 0.5 {
            all.push((away, Neighbor { keyframe: id, keyframe_from_camera }));
        }
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut chosen: Vec<Neighbor> = Vec::new();
    for (_, neighbor) in all {
        let is_apart = |other: &Neighbor| (map.keyframes[other.keyframe].timestamp_s - map.keyframes[neighbor.keyframe].timestamp_s).abs() > 0.5;
        if chosen.len() < 4 && chosen.iter().all(is_apart) {
            chosen.push(neighbor);
        }
    }
    chosen
}

fn add(
    map: &mut LocalMap,
    view: &View<'_>,
    pyramid: &Arc<Pyramid>,
    poses: (&Se3, &Se3),
    timestamp_s: f64,
    matches: &[Match],
    options: &KeyframeOptions,
) -> NewKeyframe {
    let corners = keyframe::free_corners(view, pyramid.level(0), matches, options.cell_px);
    let pyramid = Arc::clone(pyramid);
    keyframe::add_keyframe(map, view, pyramid, &corners, poses, timestamp_s, matches)
}
