//! What earlier frames say of the depth of this one: space that was seen to be free.
//!
//! A point of the current frame is looked up in frames of the last second. Where such a frame saw
//! something clearly behind the point, the space was free then, so that the point has moved there:
//! no occlusion explains it. Where it saw the same depth and the same gray level, the point may have
//! stood there all along.

use std::collections::{BTreeMap, VecDeque};

use covis_solvers::geometry::{LieGroup, Se3};

use super::cells::CellRays;
use super::gaussian::CellView;
use super::warp::{CellWarp, Exposure};
use crate::frontend::camera::FrameCamera;
use crate::frontend::image::Image;

/// Parameters of the comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HistoryOptions {
    /// How many frames back it looks.
    pub lags: [usize; 5],
    /// How far behind a point free space must reach, meters.
    pub free_m: f32,
    /// The same, relative to its depth.
    pub free_share: f32,
    /// Gray levels by which a cell's mean may differ and still be the same.
    pub same_gray: f32,
    /// Range of gray levels from which they tell one place from the next.
    pub textured_gray: f32,
    /// Least change of a gray level that is another one.
    pub other_gray: f32,
}

impl Default for HistoryOptions {
    fn default() -> Self {
        Self {
            lags: [2, 5, 10, 18, 30],
            free_m: 0.05,
            free_share: 0.03,
            same_gray: 14.0,
            textured_gray: 20.0,
            other_gray: 12.0,
        }
    }
}

/// A frame that was.
#[derive(Clone, Debug)]
struct Snapshot {
    odom_from_camera: Se3,
    depths_m: Image<f32>,
    means: Image<f32>,
    /// From its gray levels to those of the newest frame.
    exposure: Exposure,
}

/// What the frames before say of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Testimony {
    /// Frames that saw free space where it is.
    pub free: u8,
    /// Frames that saw the same thing there.
    pub same: u8,
    /// The farthest back of them, frames.
    pub oldest_same: u8,
    /// Frames that showed the place at all.
    pub shown: u8,
    /// Frames of the last third of a second that could tell its gray level from those around it.
    pub textured: u8,
    /// Those of them where it was another one.
    pub other_gray: u8,
}

/// A keyframe that shows about what the current frame shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbor {
    /// Its id.
    pub keyframe: usize,
    /// Where the current camera is beside it.
    pub keyframe_from_camera: Se3,
}

/// The frames of the last second, newest first, and the depths of all keyframes.
#[derive(Clone, Debug, Default)]
pub struct History {
    frames: VecDeque<Snapshot>,
    keyframes: BTreeMap<usize, Image<f32>>,
}

/// The current frame, which is not part of the history yet.
#[derive(Clone, Copy, Debug)]
pub struct Current<'a> {
    /// Its lens.
    pub camera: &'a FrameCamera,
    /// The rays of its cells.
    pub rays: &'a CellRays,
    /// What its cells show.
    pub cells: &'a Image<CellView>,
    /// About where it is.
    pub odom_from_camera: &'a Se3,
    /// The change from the frame before it.
    pub exposure: Exposure,
}

impl History {
    /// Adds the current frame.
    pub fn push(&mut self, current: &Current<'_>, options: &HistoryOptions) {
        for frame in &mut self.frames {
            frame.exposure = current.exposure.after(&frame.exposure);
        }
        self.frames.push_front(Snapshot {
            odom_from_camera: *current.odom_from_camera,
            depths_m: current.cells.map(|cell| cell.depth_m),
            means: current.cells.map(|cell| cell.mean),
            exposure: Exposure::SAME,
        });
        self.frames.truncate(options.lags.iter().copied().max().unwrap_or(1));
    }

    /// Corrects the pose of the newest frame.
    pub fn settle(&mut self, odom_from_camera: &Se3) {
        if let Some(newest) = self.frames.front_mut() {
            newest.odom_from_camera = *odom_from_camera;
        }
    }

    /// Keeps the newest frame as a keyframe.
    pub fn keep(&mut self, keyframe: usize) {
        if let Some(newest) = self.frames.front() {
            self.keyframes.insert(keyframe, newest.depths_m.clone());
        }
    }

    /// What the frames, and the keyframes beside it, say of each cell of the current one.
    #[must_use]
    pub fn ask(
        &self,
        current: &Current<'_>,
        neighbors: &[Neighbor],
        options: &HistoryOptions,
    ) -> Image<Testimony> {
        let (columns, rows) = current.cells.size();
        let mut testimony = Image::filled(columns, rows, Testimony::default());
        for &lag in &options.lags {
            let Some(frame) = lag.checked_sub(1).and_then(|index| self.frames.get(index)) else {
                continue;
            };
            let motion = frame.odom_from_camera.inverse().compose(current.odom_from_camera);
            let exposure = current.exposure.after(&frame.exposure);
            let is_gray = |x: f32, y: f32, mean: f32| {
                between(&frame.means, x, y)
                    .is_some_and(|gray| (exposure.apply(gray) - mean).abs() < options.same_gray)
            };
            let witness = Witness { depths_m: &frame.depths_m, motion, age: lag as u8 };
            witness.testify(current, is_gray, options, &mut testimony);
            if lag <= 10 {
                witness.compare(current, &frame.means, exposure, options, &mut testimony);
            }
        }
        for neighbor in neighbors {
            let Some(depths_m) = self.keyframes.get(&neighbor.keyframe) else { continue };
            let motion = neighbor.keyframe_from_camera;
            let witness = Witness { depths_m, motion, age: u8::MAX };
            witness.testify(current, |_, _, _| true, options, &mut testimony);
        }
        testimony
    }
}

/// A frame that is asked.
struct Witness<'a> {
    depths_m: &'a Image<f32>,
    /// Its own frame from the current camera's.
    motion: Se3,
    age: u8,
}

enum Look {
    Free,
    Same,
    Unclear,
}

impl Witness<'_> {
    /// Adds what the frame says of each cell.
    fn testify(
        &self,
        current: &Current<'_>,
        is_gray: impl Fn(f32, f32, f32) -> bool,
        options: &HistoryOptions,
        testimony: &mut Image<Testimony>,
    ) {
        let warp = CellWarp::new(current.camera, current.rays, &self.motion);
        for (i, said) in testimony.pixels_mut().iter_mut().enumerate() {
            let cell = &current.cells.pixels()[i];
            if cell.depth_m <= 0.0 {
                continue;
            }
            let Some((x, y, expected)) = warp.place(i, cell.depth_m) else { continue };
            let is_gray = || is_gray(x, y, cell.mean);
            match self.look(x, y, expected, is_gray, options) {
                None => {}
                Some(Look::Free) => {
                    said.free += 1;
                    said.shown += 1;
                }
                Some(Look::Same) => {
                    said.same += 1;
                    said.shown += 1;
                    said.oldest_same = said.oldest_same.max(self.age);
                }
                Some(Look::Unclear) => said.shown += 1,
            }
        }
    }

    /// Adds where gray levels that stand out from those around them have changed.
    fn compare(
        &self,
        current: &Current<'_>,
        means: &Image<f32>,
        exposure: Exposure,
        options: &HistoryOptions,
        testimony: &mut Image<Testimony>,
    ) {
        let warp = CellWarp::new(current.camera, current.rays, &self.motion);
        for (i, said) in testimony.pixels_mut().iter_mut().enumerate() {
            let cell = &current.cells.pixels()[i];
            if cell.depth_m <= 0.0 {
                continue;
            }
            let Some((x, y, _)) = warp.place(i, cell.depth_m) else { continue };
            let Some(was) = between(means, x, y) else { continue };
            let (column, row) = ((x + 0.5) as usize, (y + 0.5) as usize);
            if column < 1 || row < 1 || column + 1 >= means.width() || row + 1 >= means.height() {
                continue;
            }
            let (mut least, mut largest) = (f32::MAX, f32::MIN);
            for v in row - 1..=row + 1 {
                for &mean in &means.row(v)[column - 1..=column + 1] {
                    least = least.min(mean);
                    largest = largest.max(mean);
                }
            }
            let range = exposure.gain * (largest - least);
            let away = (exposure.apply(was) - cell.mean).abs();
            if range.max(away) >= options.textured_gray {
                said.textured += 1;
                said.other_gray += u8::from(away >= 0.4 * range && away >= options.other_gray);
            }
        }
    }

    /// What the frame saw at a place, within a cell of it: edges of depth and of color differ.
    fn look(
        &self,
        x: f32,
        y: f32,
        expected: f32,
        is_gray: impl Fn() -> bool,
        options: &HistoryOptions,
    ) -> Option<Look> {
        let (width, height) = self.depths_m.size();
        let (column, row) = ((x + 0.5).floor(), (y + 0.5).floor());
        if !(column >= 1.0 && row >= 1.0) {
            return None;
        }
        let (column, row) = (column as usize, row as usize);
        if column + 1 >= width || row + 1 >= height {
            return None;
        }
        let sigma = 0.0012 + 0.0019 * (expected - 0.4).max(0.0).powi(2);
        let margin = options.free_m + options.free_share * expected + 3.0 * sigma;
        let (mut known, mut behind, mut same) = (0, 0, false);
        for v in row - 1..=row + 1 {
            for u in column - 1..=column + 1 {
                let depth = self.depths_m.at(u, v);
                if depth > 0.0 {
                    known += 1;
                    behind += usize::from(depth > expected + margin);
                    same |= (depth - expected).abs() < margin;
                }
            }
        }
        Some(match known {
            0..6 => Look::Unclear,
            _ if behind == known => Look::Free,
            _ if same && is_gray() => Look::Same,
            _ => Look::Unclear,
        })
    }
}

/// The value at a place between four cells.
fn between(image: &Image<f32>, x: f32, y: f32) -> Option<f32> {
    if !(x >= 0.0 && y >= 0.0)
        || x as usize + 1 >= image.width()
        || y as usize + 1 >= image.height()
    {
        return None;
    }
    let (left, top) = (x as usize, y as usize);
    let (s, t) = (x - left as f32, y - top as f32);
    let upper = (1.0 - s) * image.at(left, top) + s * image.at(left + 1, top);
    let lower = (1.0 - s) * image.at(left, top + 1) + s * image.at(left + 1, top + 1);
    Some((1.0 - t) * upper + t * lower)
}
