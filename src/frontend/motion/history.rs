//! What earlier frames say of this one: space that was seen to be free, surfaces that were there.
//!
//! A point of the current frame is looked up in frames of the last second and in older keyframes.
//! Where such a witness saw something clearly behind the point, the space was free then, so that the
//! point has moved there: no occlusion explains it. Where it saw the same depth, gray levels say
//! whether it is the same surface. What moved when it was seen does not testify that it stands.

use std::collections::{BTreeMap, VecDeque};

use covis_solvers::geometry::{LieGroup, Se3};

use super::cells::CellRays;
use super::gaussian::CellView;
use super::warp::{CellWarp, Exposure};
use crate::frontend::camera::FrameCamera;
use crate::frontend::depth::sigma_m;
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
    /// Gray levels beyond those around a place from which on it is another surface.
    pub other_gray: f32,
    /// How far back gray levels count against a cell, frames: exposures add up beyond.
    pub other_lag: usize,
    /// From how far back on the same surface counts in full, frames: what is slow seems to stand.
    pub full_lag: usize,
    /// Votes of a witness of free space; one that saw the same surface has one.
    pub free_votes: f32,
    /// Votes of a witness of another surface.
    pub other_votes: f32,
}

impl Default for HistoryOptions {
    fn default() -> Self {
        Self {
            lags: [2, 5, 10, 18, 30],
            free_m: 0.05,
            free_share: 0.03,
            other_gray: 15.0,
            other_lag: 10,
            full_lag: 10,
            free_votes: 2.0,
            other_votes: 2.0,
        }
    }
}

/// The range of what a frame shows within a cell of each: edges of depth and of color differ.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Around {
    /// Least depth, meters; 0 where too little was measured.
    nearest_m: f32,
    /// Largest depth, meters.
    farthest_m: f32,
    /// Least mean, gray levels.
    darkest: f32,
    /// Largest mean, gray levels.
    brightest: f32,
    /// Whether something moved there.
    is_moving: bool,
}

/// A frame that was.
#[derive(Clone, Debug)]
struct Snapshot {
    odom_from_camera: Se3,
    around: Image<Around>,
    /// From its gray levels to those of the newest frame.
    exposure: Exposure,
}

/// What the witnesses say of a cell together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Votes {
    /// That it moves.
    pub moves: f32,
    /// That it stands still.
    pub stands: f32,
}

/// A keyframe that shows about what the current frame shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbor {
    /// Its id.
    pub keyframe: usize,
    /// Where the current camera is beside it.
    pub keyframe_from_camera: Se3,
}

/// The frames of the last second, newest first, and all keyframes.
#[derive(Clone, Debug, Default)]
pub struct History {
    frames: VecDeque<Snapshot>,
    keyframes: BTreeMap<usize, Image<Around>>,
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
    /// Adds the current frame, in which those cells move.
    pub fn push(&mut self, current: &Current<'_>, moving: &Image<bool>, options: &HistoryOptions) {
        for frame in &mut self.frames {
            frame.exposure = current.exposure.after(&frame.exposure);
        }
        self.frames.push_front(Snapshot {
            odom_from_camera: *current.odom_from_camera,
            around: around(current.cells, moving),
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
            self.keyframes.insert(keyframe, newest.around.clone());
        }
    }

    /// What the frames, and the keyframes beside it, say of each cell of the current one.
    #[must_use]
    pub fn ask(
        &self,
        current: &Current<'_>,
        neighbors: &[Neighbor],
        options: &HistoryOptions,
    ) -> Image<Votes> {
        let mut votes = current.cells.map(|_| Votes::default());
        for &lag in &options.lags {
            let Some(frame) = lag.checked_sub(1).and_then(|index| self.frames.get(index)) else {
                continue;
            };
            let witness = Witness {
                around: &frame.around,
                motion: frame.odom_from_camera.inverse().compose(current.odom_from_camera),
                exposure: Some(current.exposure.after(&frame.exposure)),
                other_votes: if lag <= options.other_lag { options.other_votes } else { 0.0 },
                same_votes: (lag as f32 / options.full_lag as f32).min(1.0),
            };
            witness.testify(current, options, &mut votes);
        }
        for neighbor in neighbors {
            let Some(around) = self.keyframes.get(&neighbor.keyframe) else { continue };
            let motion = neighbor.keyframe_from_camera;
            let witness =
                Witness { around, motion, exposure: None, other_votes: 0.0, same_votes: 1.0 };
            witness.testify(current, options, &mut votes);
        }
        votes
    }
}

/// A frame that is asked.
struct Witness<'a> {
    around: &'a Image<Around>,
    /// Its own frame from the current camera's.
    motion: Se3,
    /// From its gray levels to the current ones; `None` where they do not compare.
    exposure: Option<Exposure>,
    other_votes: f32,
    same_votes: f32,
}

/// What a witness saw where a cell is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Look {
    Free,
    Same,
    Other,
    Unclear,
}

impl Witness<'_> {
    /// Adds what the frame says of each cell.
    fn testify(&self, current: &Current<'_>, options: &HistoryOptions, votes: &mut Image<Votes>) {
        let (columns, rows) = self.around.size();
        let warp = CellWarp::new(current.camera, current.rays, &self.motion);
        let cells = votes.pixels_mut().iter_mut().zip(current.cells.pixels());
        for (i, (votes, cell)) in cells.enumerate() {
            if cell.depth_m <= 0.0 {
                continue;
            }
            let Some((x, y, expected_m)) = warp.place(i, cell.depth_m) else { continue };
            let (x, y) = (x + 0.5, y + 0.5);
            if !(x >= 0.0 && y >= 0.0 && x < columns as f32 && y < rows as f32) {
                continue;
            }
            let around = self.around.at(x as usize, y as usize);
            match look(&around, cell, expected_m, self.exposure, options) {
                Look::Free => votes.moves += options.free_votes,
                Look::Other => votes.moves += self.other_votes,
                Look::Same if !around.is_moving => votes.stands += self.same_votes,
                Look::Same | Look::Unclear => {}
            }
        }
    }
}

/// What a witness saw around the place where a cell, if it stood still, was at a depth.
fn look(
    around: &Around,
    cell: &CellView,
    expected_m: f32,
    exposure: Option<Exposure>,
    options: &HistoryOptions,
) -> Look {
    /// Mean gray level of a cell from which on part of it may have been saturated.
    const BRIGHT: f32 = 245.0;
    if around.nearest_m <= 0.0 {
        return Look::Unclear;
    }
    let sigma_m = sigma_m(f64::from(expected_m)) as f32;
    let margin_m = options.free_m + options.free_share * expected_m + 3.0 * sigma_m;
    if around.nearest_m > expected_m + margin_m {
        return Look::Free;
    }
    if expected_m > around.farthest_m + margin_m || expected_m < around.nearest_m - margin_m {
        return Look::Unclear;
    }
    let Some(exposure) = exposure else { return Look::Same };
    if cell.is_saturated() || around.brightest >= BRIGHT {
        return Look::Same;
    }
    let limit = |gray: f32| options.other_gray + exposure.doubt(gray);
    let is_same = cell.mean > exposure.apply(around.darkest) - limit(around.darkest)
        && cell.mean < exposure.apply(around.brightest) + limit(around.brightest);
    if is_same { Look::Same } else { Look::Other }
}

/// The ranges around each cell.
fn around(cells: &Image<CellView>, moving: &Image<bool>) -> Image<Around> {
    /// Of nine cells, how many must be measured.
    const LEAST_KNOWN: usize = 6;
    let (columns, rows) = cells.size();
    let mut all = cells.map(|_| Around::default());
    for row in 1..rows.saturating_sub(1) {
        for column in 1..columns.saturating_sub(1) {
            let mut range = Around { nearest_m: f32::MAX, darkest: f32::MAX, ..Around::default() };
            let mut known = 0;
            for r in row - 1..=row + 1 {
                let near = column - 1..=column + 1;
                for (cell, is_moving) in cells.row(r)[near.clone()].iter().zip(&moving.row(r)[near])
                {
                    if cell.depth_m > 0.0 {
                        known += 1;
                        range.nearest_m = range.nearest_m.min(cell.depth_m);
                        range.farthest_m = range.farthest_m.max(cell.depth_m);
                    }
                    range.darkest = range.darkest.min(cell.mean);
                    range.brightest = range.brightest.max(cell.mean);
                    range.is_moving |= is_moving;
                }
            }
            if known >= LEAST_KNOWN {
                all.set(column, row, range);
            }
        }
    }
    all
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

    /// The votes on the middle cell of a frame 0.1 m to the right of one that saw a wall at 2 m of
    /// gray level 100, ten frames before.
    fn vote(seen: CellView, was_moving: bool, exposure: Exposure) -> Votes {
        let camera = camera();
        let rays = cell_rays(&camera);
        let options = HistoryOptions { lags: [10; 5], ..HistoryOptions::default() };
        let wall = rays.map(|_| view(100.0, 2.0));
        let moving = rays.map(|_| was_moving);
        let mut history = History::default();
        let origin = Se3::identity();
        let frame = Current {
            camera: &camera,
            rays: &rays,
            cells: &wall,
            odom_from_camera: &origin,
            exposure: Exposure::SAME,
        };
        (0..10).for_each(|_| history.push(&frame, &moving, &options));
        let cells = rays.map(|_| seen);
        let right = Se3::new(origin.rotation, Vector3::new(0.1, 0.0, 0.0));
        let frame = Current { cells: &cells, odom_from_camera: &right, exposure, ..frame };
        history.ask(&frame, &[], &options).at(20, 15)
    }

    #[test]
    fn a_cell_before_a_wall_has_moved_and_one_on_it_stands_unless_it_looks_otherwise() {
        let say = |seen| vote(seen, false, Exposure::SAME);
        assert_eq!(say(view(100.0, 1.5)), Votes { moves: 10.0, stands: 0.0 });
        assert_eq!(say(view(100.0, 1.98)), Votes { moves: 0.0, stands: 5.0 });
        assert_eq!(say(view(140.0, 2.02)), Votes { moves: 10.0, stands: 0.0 });
        // Hidden by the wall, or without depth: nobody knows.
        assert_eq!(say(view(100.0, 2.5)), Votes::default());
        assert_eq!(say(view(100.0, 0.0)), Votes::default());
        // Too bright to tell.
        assert_eq!(say(view(250.0, 2.0)), Votes { moves: 0.0, stands: 5.0 });
    }

    #[test]
    fn gray_levels_compare_at_the_same_exposure() {
        let brighter = Exposure { gain: 1.0, offset: 60.0 };
        let stands = Votes { moves: 0.0, stands: 5.0 };
        assert_eq!(vote(view(160.0, 2.0), false, brighter), stands);
        // 60 gray levels of change are known to 30, with 15 for the surface.
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
        let options = HistoryOptions::default();
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
        history.push(&frame, &still, &options);
        history.keep(7);
        let now = Current { cells: &chair, ..frame };
        (0..40).for_each(|_| history.push(&now, &still, &options));
        assert_eq!(history.ask(&now, &[], &options).at(20, 15).moves, 0.0);
        let neighbor = |keyframe| Neighbor { keyframe, keyframe_from_camera: origin };
        assert_eq!(history.ask(&now, &[neighbor(7)], &options).at(20, 15).moves, 2.0);
        assert_eq!(history.ask(&now, &[neighbor(8)], &options).at(20, 15).moves, 0.0);
    }
}
