//! Compares a frame with earlier ones: space that was seen to be free, surfaces that were there.
//!
//! A point of the current frame is looked up in frames of the last second and in older keyframes. Where
//! such a witness saw something clearly behind the point, the space was free then: the point has moved
//! there, because no occlusion explains it. Where the witness saw the same depth, gray levels decide
//! whether it is the same surface. A place that moved in the witness gives no vote for standing still.
//! It votes for each cell alone; which cells make an object is decided in `regions`.

use std::collections::{BTreeMap, VecDeque};

use covis_solvers::geometry::{LieGroup, Se3};

use super::cells::CellRays;
use super::gaussian::CellView;
use super::warp::Exposure;
use super::witness::{Around, Tally, Witness};
use crate::camera::FrameCamera;
use crate::image::Image;
use crate::simd::{self, Kernel};

/// How many frames back each witness is.
const LAGS: [usize; 5] = [2, 5, 10, 18, 30];
/// Gray levels vote for movement up to this many frames back: the errors of exposure add up.
const OTHER_LAG: usize = 10;
/// The same surface counts in full from this many frames back on: slow objects seem to stand still.
const FULL_LAG: usize = 10;
/// Votes of a witness that saw another surface.
const OTHER_VOTES: f32 = 2.0;

/// An earlier frame.
#[derive(Clone, Debug)]
struct Snapshot {
    odom_from_camera: Se3,
    around: Image<Around>,
    /// From its gray levels to those of the newest frame.
    exposure: Exposure,
}

/// The sum of the witnesses' votes on a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Votes {
    /// That it moves.
    pub moves: f32,
    /// That it stands still.
    pub stands: f32,
}

/// A keyframe with about the same view as the current frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbor {
    /// Its id.
    pub keyframe: usize,
    /// The pose of the current camera relative to it.
    pub keyframe_from_camera: Se3,
}

/// The frames of the last second, newest first, and the keyframes that are kept.
#[derive(Clone, Debug)]
pub struct History {
    /// How many frames back each witness is.
    lags: [usize; 5],
    frames: VecDeque<Snapshot>,
    keyframes: BTreeMap<usize, Image<Around>>,
}

impl Default for History {
    fn default() -> Self {
        Self { lags: LAGS, frames: VecDeque::new(), keyframes: BTreeMap::new() }
    }
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
    /// Its approximate pose.
    pub odom_from_camera: &'a Se3,
    /// The change from the frame before it.
    pub exposure: Exposure,
}

impl History {
    /// Adds the current frame with the mask of cells that move.
    pub fn push(&mut self, current: &Current<'_>, moving: &Image<bool>) {
        for frame in &mut self.frames {
            frame.exposure = current.exposure.after(&frame.exposure);
        }
        self.frames.push_front(Snapshot {
            odom_from_camera: *current.odom_from_camera,
            around: around(current.cells, moving),
            exposure: Exposure::SAME,
        });
        self.frames.truncate(self.lags.iter().copied().max().unwrap_or(1));
    }

    /// Corrects the pose of the newest frame.
    pub fn correct_newest(&mut self, odom_from_camera: &Se3) {
        if let Some(newest) = self.frames.front_mut() {
            newest.odom_from_camera = *odom_from_camera;
        }
    }

    /// Keeps the newest frame as a keyframe.
    pub fn keep(&mut self, keyframe: usize) {
        if let Some(newest) = self.frames.front() {
            self.keyframes.insert(keyframe, newest.around.clone());
        }
    }

    /// Lets go of a keyframe.
    pub fn forget(&mut self, keyframe: usize) {
        self.keyframes.remove(&keyframe);
    }

    /// How many keyframes are kept.
    #[cfg(test)]
    pub(super) fn kept(&self) -> usize {
        self.keyframes.len()
    }

    /// The votes of earlier frames and of neighboring keyframes on each cell of the current frame.
    #[must_use]
    pub fn ask(&self, current: &Current<'_>, neighbors: &[Neighbor]) -> Image<Votes> {
        let mut tally = Tally::of(current.cells);
        for &lag in &self.lags {
            let Some(frame) = lag.checked_sub(1).and_then(|index| self.frames.get(index)) else {
                continue;
            };
            let witness = Witness {
                around: &frame.around,
                motion: frame.odom_from_camera.inverse().compose(current.odom_from_camera),
                exposure: Some(current.exposure.after(&frame.exposure)),
                other_votes: if lag <= OTHER_LAG { OTHER_VOTES } else { 0.0 },
                same_votes: (lag as f32 / FULL_LAG as f32).min(1.0),
            };
            witness.testify(current, &mut tally);
        }
        for neighbor in neighbors {
            let Some(around) = self.keyframes.get(&neighbor.keyframe) else { continue };
            let motion = neighbor.keyframe_from_camera;
            let witness =
                Witness { around, motion, exposure: None, other_votes: 0.0, same_votes: 1.0 };
            witness.testify(current, &mut tally);
        }
        let mut votes = current.cells.map(|_| Votes::default());
        let sums = tally.moves.iter().zip(&tally.stands);
        for (votes, (&moves, &stands)) in votes.pixels_mut().iter_mut().zip(sums) {
            *votes = Votes { moves, stands };
        }
        votes
    }
}

/// The ranges around each cell.
fn around(cells: &Image<CellView>, moving: &Image<bool>) -> Image<Around> {
    let mut all = cells.map(|_| Around::default());
    simd::run(Ranging { cells, moving, all: &mut all });
    all
}

struct Ranging<'a> {
    cells: &'a Image<CellView>,
    moving: &'a Image<bool>,
    all: &'a mut Image<Around>,
}

/// The range over three cells, or over three such ranges.
#[derive(Clone, Copy, Default)]
struct Range {
    nearest_m: f32,
    farthest_m: f32,
    darkest: f32,
    brightest: f32,
    known: u8,
    is_moving: bool,
}

impl Range {
    #[inline(always)]
    fn of(cell: &CellView, is_moving: bool) -> Self {
        let is_known = cell.depth_m > 0.0;
        Self {
            nearest_m: if is_known { cell.depth_m } else { f32::MAX },
            farthest_m: cell.depth_m,
            darkest: cell.mean,
            brightest: cell.mean,
            known: u8::from(is_known),
            is_moving,
        }
    }

    #[inline(always)]
    fn and(&self, other: &Self) -> Self {
        Self {
            nearest_m: self.nearest_m.min(other.nearest_m),
            farthest_m: self.farthest_m.max(other.farthest_m),
            darkest: self.darkest.min(other.darkest),
            brightest: self.brightest.max(other.brightest),
            known: self.known + other.known,
            is_moving: self.is_moving | other.is_moving,
        }
    }
}

impl Kernel for Ranging<'_> {
    type Output = ();

    /// Joins three cells of a column, then three of these ranges along the row.
    #[inline(always)]
    fn run(self) {
        /// Least number of the nine cells with measured depth.
        const LEAST_KNOWN: u8 = 6;
        let Self { cells, moving, all } = self;
        let (columns, rows) = cells.size();
        let mut down = vec![Range::default(); columns];
        for row in 1..rows.saturating_sub(1) {
            for (column, down) in down.iter_mut().enumerate() {
                let range =
                    |row: usize| Range::of(&cells.row(row)[column], moving.row(row)[column]);
                *down = range(row - 1).and(&range(row)).and(&range(row + 1));
            }
            for (out, three) in all.row_mut(row)[1..].iter_mut().zip(down.windows(3)) {
                let range = three[0].and(&three[1]).and(&three[2]);
                let rounded = |value: f32, most: i32| simd::floor(value + 0.5).min(most) as u32;
                let millimeters = |meters: f32| rounded(meters * 1e3, 0xffff);
                let grays = rounded(range.darkest, 0xff) | rounded(range.brightest, 0xff) << 8;
                let around = Around {
                    depths: millimeters(range.nearest_m) | millimeters(range.farthest_m) << 16,
                    grays: grays | u32::from(range.is_moving) << 16,
                };
                let is_known = range.known >= LEAST_KNOWN;
                *out = if is_known { around } else { Around::default() };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::PinholeRadialTangential;
    use nalgebra::Vector3;

    use super::super::cells::cell_rays;
    use super::*;

    fn camera() -> FrameCamera {
        let lens = PinholeRadialTangential {
            fx: 100.0,
            fy: 100.0,
            cx: 79.5,
            cy: 59.5,
            k1: 0.0,
            k2: 0.0,
            p1: 0.0,
            p2: 0.0,
            k3: 0.0,
        };
        FrameCamera::new(lens, 160, 120).unwrap()
    }

    fn view(mean: f32, depth_m: f32) -> CellView {
        CellView { mean, least: mean, largest: mean, depth_m }
    }

    /// The votes on the middle cell of a frame. Ten frames before, a camera 0.1 m to the left saw a
    /// wall at 2 m with gray level 100.
    fn vote(seen: CellView, was_moving: bool, exposure: Exposure) -> Votes {
        let camera = camera();
        let rays = cell_rays(&camera);
        let wall = rays.map(|_| view(100.0, 2.0));
        let moving = rays.map(|_| was_moving);
        let mut history = History { lags: [10; 5], ..History::default() };
        let origin = Se3::identity();
        let frame = Current {
            camera: &camera,
            rays: &rays,
            cells: &wall,
            odom_from_camera: &origin,
            exposure: Exposure::SAME,
        };
        (0..10).for_each(|_| history.push(&frame, &moving));
        let cells = rays.map(|_| seen);
        let right = Se3::new(origin.rotation, Vector3::new(0.1, 0.0, 0.0));
        let frame = Current { cells: &cells, odom_from_camera: &right, exposure, ..frame };
        history.ask(&frame, &[]).at(20, 15)
    }

    #[test]
    fn a_cell_before_a_wall_has_moved_and_one_on_it_stands_unless_it_looks_otherwise() {
        let say = |seen| vote(seen, false, Exposure::SAME);
        assert_eq!(say(view(100.0, 1.5)), Votes { moves: 10.0, stands: 0.0 });
        assert_eq!(say(view(100.0, 1.98)), Votes { moves: 0.0, stands: 5.0 });
        assert_eq!(say(view(140.0, 2.02)), Votes { moves: 10.0, stands: 0.0 });
        // Hidden by the wall, or without depth: no vote.
        assert_eq!(say(view(100.0, 2.5)), Votes::default());
        assert_eq!(say(view(100.0, 0.0)), Votes::default());
        // Saturated: gray levels are ignored.
        assert_eq!(say(view(250.0, 2.0)), Votes { moves: 0.0, stands: 5.0 });
    }

    #[test]
    fn gray_levels_compare_at_the_same_exposure() {
        let brighter = Exposure { gain: 1.0, offset: 60.0 };
        let stands = Votes { moves: 0.0, stands: 5.0 };
        assert_eq!(vote(view(160.0, 2.0), false, brighter), stands);
        // A change of 60 gray levels is uncertain by 30, plus 15 for the surface.
        assert_eq!(vote(view(110.0, 2.0), false, brighter).moves, 10.0);
        assert_eq!(vote(view(120.0, 2.0), false, brighter), stands);
    }

    #[test]
    fn what_moved_does_not_testify_that_it_stands() {
        assert_eq!(vote(view(100.0, 2.0), true, Exposure::SAME), Votes::default());
        assert_eq!(vote(view(100.0, 1.5), true, Exposure::SAME).moves, 10.0);
    }

    #[test]
    fn a_keyframe_says_what_was_free_long_ago() {
        let camera = camera();
        let rays = cell_rays(&camera);
        let origin = Se3::identity();
        let (wall, chair) = (rays.map(|_| view(100.0, 2.0)), rays.map(|_| view(30.0, 1.2)));
        let frame = Current {
            camera: &camera,
            rays: &rays,
            cells: &wall,
            odom_from_camera: &origin,
            exposure: Exposure::SAME,
        };
        let still = rays.map(|_| false);
        let mut history = History::default();
        history.push(&frame, &still);
        history.keep(7);
        let now = Current { cells: &chair, ..frame };
        (0..40).for_each(|_| history.push(&now, &still));
        assert_eq!(history.ask(&now, &[]).at(20, 15).moves, 0.0);
        let neighbor = |keyframe| Neighbor { keyframe, keyframe_from_camera: origin };
        assert_eq!(history.ask(&now, &[neighbor(7)]).at(20, 15).moves, 2.0);
        assert_eq!(history.ask(&now, &[neighbor(8)]).at(20, 15).moves, 0.0);
    }
}
