//! Ray-cast RGB-D sequences of an indoor scene: the truth of camera and motion is known exactly.
//!
//! A sequence is a function of scene, seed and frame number, on any number of threads; frames can be drawn in
//! any order. `scene` defines what is static and what moves, `render` casts the rays, `sensor` adds what a
//! Kinect does to them, `writer` keeps a sequence in the TUM layout.
//! `corridor` draws nothing: its views are points along a wall, for loads on a server.
//!
//! | file | role |
//! |---|---|
//! | `scene`, `room`, `figure`, `motion` | solids, people and how the camera moves |
//! | `solid`, `material`, `render` | shapes, surfaces, rays |
//! | `sensor`, `writer` | noise and gaps; a TUM folder with the truth |
//! | `random` | randomness as a hash of the place |
//! | `corridor` | views without images |

pub mod corridor;
mod figure;
mod material;
mod motion;
mod random;
mod render;
mod room;
mod scene;
mod sensor;
mod solid;
mod writer;

use covis_solvers::geometry::{LieGroup, PinholeRadialTangential, Se3};

pub use scene::{SceneName, UnknownScene};
pub use writer::{WriteError, write_sequence};

use crate::image::{Image, RgbdFrame};
use crate::input::{FrameError, FrameSource, SensorTiming};
use render::{Picture, RenderCamera, Surface};
use scene::Scene;
use sensor::FrameNoise;

/// Frames a second.
pub const RATE_HZ: f64 = 30.0;
/// The time of the first frame, s.
const FIRST_S: f64 = 1.0;
/// What moves less than this from frame to frame rests, m.
const RESTS_M: f64 = 0.001;

/// How a sequence is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SequenceOptions {
    /// Columns; the field of view stays the same. At least 1.
    pub width: usize,
    /// Rows. At least 1.
    pub height: usize,
    /// How many frames, 30 a second.
    pub frames: usize,
    /// The same seed gives the same bits.
    pub seed: u64,
    /// Whether color and depth have a Kinect's noise and gaps; otherwise depth is exact everywhere.
    pub noise: bool,
}

impl Default for SequenceOptions {
    fn default() -> Self {
        Self { width: 640, height: 480, frames: 300, seed: 0, noise: true }
    }
}

/// A sequence of one scene.
#[derive(Clone, Debug)]
pub struct Sequence {
    options: SequenceOptions,
    camera: PinholeRadialTangential,
    scene: Scene,
}

impl Sequence {
    /// Makes a scene's random choices; frames are drawn when they are asked for.
    #[must_use]
    pub fn new(scene: SceneName, options: &SequenceOptions) -> Self {
        let options = SequenceOptions {
            width: options.width.max(1),
            height: options.height.max(1),
            ..*options
        };
        let (width, height) = (options.width as f64, options.height as f64);
        let focal = 525.0 * width / 640.0;
        let (cx, cy) = (0.5 * (width - 1.0), 0.5 * (height - 1.0));
        let duration_s = options.frames.saturating_sub(1) as f64 / RATE_HZ;
        Self {
            options,
            camera: PinholeRadialTangential::undistorted(focal, focal, cx, cy),
            scene: Scene::new(scene, options.seed, duration_s),
        }
    }

    /// The camera of color and depth, px.
    #[must_use]
    pub fn camera(&self) -> &PinholeRadialTangential {
        &self.camera
    }

    /// How many frames there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.options.frames
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The time of frame `index`, s; a whole number of microseconds.
    #[must_use]
    pub fn timestamp_s(&self, index: usize) -> f64 {
        ((FIRST_S + scene_time_s(index)) * 1e6).round() / 1e6
    }

    /// Where the camera truly is at frame `index`; the world's z points up.
    #[must_use]
    pub fn world_from_camera(&self, index: usize) -> Se3 {
        self.scene.world_from_camera(scene_time_s(index))
    }

    /// What the camera delivers at frame `index`.
    #[must_use]
    pub fn frame(&self, index: usize) -> RgbdFrame {
        self.frame_and_mask(index).0
    }

    /// 255 where frame `index` shows something that moves between it and the frame before; a thing or
    /// a limb that rests is not in it.
    #[must_use]
    pub fn moving_mask(&self, index: usize) -> Image<u8> {
        let solids = self.scene.solids(scene_time_s(index));
        let surfaces = Picture::new(&solids, self.view(index)).surfaces();
        self.mask(index, &surfaces)
    }

    /// Both at once: the rays are cast once.
    #[must_use]
    pub fn frame_and_mask(&self, index: usize) -> (RgbdFrame, Image<u8>) {
        let time_s = scene_time_s(index);
        let timestamp_s = self.timestamp_s(index);
        let SequenceOptions { width, height, seed, noise, .. } = self.options;
        if self.scene.is_covered(time_s) {
            let color = Image::filled(width, height, [0; 3]);
            let depth_m = Image::filled(width, height, 0.0);
            let mask = Image::filled(width, height, 0);
            return (
                RgbdFrame { timestamp_s, depth_delay_s: 0.0, color, depth_m, given_pose: None },
                mask,
            );
        }
        let solids = self.scene.solids(time_s);
        let picture = Picture::new(&solids, self.view(index));
        let surfaces = picture.surfaces();
        let noise = noise.then(|| FrameNoise::new(seed, index));
        let light = picture.colors(&surfaces);
        let color = sensor::color(&light, self.scene.exposure(time_s), noise);
        let depth_m = sensor::depth(&surfaces, noise);
        let mask = self.mask(index, &surfaces);
        (RgbdFrame { timestamp_s, depth_delay_s: 0.0, color, depth_m, given_pose: None }, mask)
    }

    fn view(&self, index: usize) -> RenderCamera {
        let SequenceOptions { width, height, .. } = self.options;
        let world_from_camera = self.world_from_camera(index);
        RenderCamera { camera: self.camera, world_from_camera, size: (width, height) }
    }

    fn mask(&self, index: usize, surfaces: &Image<Surface>) -> Image<u8> {
        let moving = self.moving(index);
        let covered = self.scene.is_covered(scene_time_s(index));
        surfaces.map(|surface| {
            let moves = moving.get(usize::from(surface.solid)).is_some_and(|&moves| moves);
            if moves && !covered { 255 } else { 0 }
        })
    }

    /// Which solids move between a frame and the one before.
    fn moving(&self, index: usize) -> Vec<bool> {
        let time_s = scene_time_s(index);
        let before = self.scene.solids(time_s - 1.0 / RATE_HZ);
        let now = self.scene.solids(time_s);
        let moves = now.iter().zip(&before).map(|(now, before)| {
            let motion = before.world_from_solid.inverse() * now.world_from_solid;
            let turned_m = motion.rotation.log().norm() * now.shape.bounding_radius();
            motion.translation.norm() + turned_m > RESTS_M
        });
        moves.collect()
    }
}

/// The scene's time at a frame, s from the first.
fn scene_time_s(index: usize) -> f64 {
    index as f64 / RATE_HZ
}

/// A sequence's frames as a source.
#[derive(Clone, Debug)]
pub struct SyntheticSource {
    sequence: Sequence,
    next: usize,
}

impl SyntheticSource {
    /// From the first frame on.
    #[must_use]
    pub fn new(sequence: Sequence) -> Self {
        Self { sequence, next: 0 }
    }
}

impl FrameSource for SyntheticSource {
    fn camera(&self) -> &PinholeRadialTangential {
        self.sequence.camera()
    }

    fn timing(&self) -> SensorTiming {
        SensorTiming::default()
    }

    fn len(&self) -> usize {
        self.sequence.len()
    }

    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>> {
        if self.next >= self.sequence.len() {
            return None;
        }
        self.next += 1;
        Some(Ok(self.sequence.frame(self.next - 1)))
    }
}

#[cfg(test)]
mod tests;
