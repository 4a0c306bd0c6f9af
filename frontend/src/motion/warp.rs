//! Warps the Gaussian models of the previous frame into the current one.
//!
//! The point of each cell, by pose and depth, is projected into the previous frame. The models of the
//! four cells around it are mixed by how much of the cell they cover. What moves is not decided here.

use covis_solvers::geometry::Se3;

use super::cells::{CELL, CellRays};
use super::gaussian::{DualMode, GaussianOptions, Mode, ModeLanes, mix};
use crate::camera::FrameCamera;
use crate::image::Image;
use crate::simd::{self, Kernel};

/// How gray levels changed between two frames: later = gain · earlier + offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Factor.
    pub gain: f32,
    /// Gray levels.
    pub offset: f32,
}

impl Exposure {
    /// No change.
    pub const SAME: Self = Self { gain: 1.0, offset: 0.0 };

    /// The later value of a gray level.
    #[inline(always)]
    #[must_use]
    pub fn apply(&self, gray: f32) -> f32 {
        self.gain * gray + self.offset
    }

    /// Standard deviation of [`Self::apply`], gray levels: half of the change, because the true change
    /// is not linear.
    #[inline(always)]
    #[must_use]
    pub fn sigma(&self, gray: f32) -> f32 {
        0.5 * (self.apply(gray) - gray).abs()
    }

    /// The change from the first to the last of three frames: `before`, then this one.
    #[must_use]
    pub fn after(&self, before: &Self) -> Self {
        Self { gain: self.gain * before.gain, offset: self.apply(before.offset) }
    }
}

/// Positions of the cells of one frame in the image of another, in cells.
pub struct CellWarp<'a> {
    camera: &'a FrameCamera,
    rays: &'a CellRays,
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
}

impl<'a> CellWarp<'a> {
    /// The warp of a motion.
    #[must_use]
    pub fn new(camera: &'a FrameCamera, rays: &'a CellRays, other_from_current: &Se3) -> Self {
        let rotation = other_from_current.rotation.matrix();
        let row = |i: usize| [0, 1, 2].map(|j| rotation[(i, j)] as f32);
        let t = other_from_current.translation;
        let translation = [t.x as f32, t.y as f32, t.z as f32];
        Self { camera, rays, rotation: [row(0), row(1), row(2)], translation }
    }

    /// The positions of the centers of all cells, given one depth per cell.
    pub fn positions(&self, depths_m: impl Iterator<Item = f32>) -> CellPositions {
        let mut positions = CellPositions::of(depths_m);
        simd::run(Placing { warp: self, positions: &mut positions });
        positions
    }
}

/// Where cells lie in another image; NaN where it cannot show them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CellPositions {
    /// Columns of cells.
    pub x: Vec<f32>,
    /// Rows of cells.
    pub y: Vec<f32>,
    /// Their depth in that camera, meters.
    pub depth_m: Vec<f32>,
}

impl CellPositions {
    fn of(depths_m: impl Iterator<Item = f32>) -> Self {
        let depth_m: Vec<f32> = depths_m.collect();
        Self { x: vec![0.0; depth_m.len()], y: vec![0.0; depth_m.len()], depth_m }
    }
}

/// Finds the positions of cells whose depths are given.
struct Placing<'a> {
    warp: &'a CellWarp<'a>,
    positions: &'a mut CellPositions,
}

impl Kernel for Placing<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let CellWarp { camera, rays, rotation, translation } = *self.warp;
        let lens = camera.fast();
        let CellPositions { x, y, depth_m } = self.positions;
        let cell = |coordinate: f32| (coordinate + 0.5) / CELL as f32 - 0.5;
        let cells = x.iter_mut().zip(y).zip(depth_m).zip(rays.pixels());
        for (((x, y), z), &[a, b]) in cells {
            let ray = [a * *z, b * *z, *z];
            let mut point = translation;
            for (value, row) in point.iter_mut().zip(&rotation) {
                *value += row[0] * ray[0] + row[1] * ray[1] + row[2] * ray[2];
            }
            let [u, v] = lens.project(point);
            (*x, *y, *z) = (cell(u), cell(v), point[2]);
        }
    }
}

/// Warps the models of the previous frame into the current one; `depths_m` has a depth for every cell,
/// measured or not. A cell that the previous frame did not show has models of age 0.
#[must_use]
pub fn carry(
    warp: &CellWarp<'_>,
    previous: &Image<DualMode>,
    depths_m: &Image<f32>,
    exposure: Exposure,
    options: &GaussianOptions,
) -> Image<DualMode> {
    let mut carried = Image::filled(depths_m.width(), depths_m.height(), DualMode::default());
    let positions = warp.positions(depths_m.pixels().iter().copied());
    simd::run(Carrying {
        previous,
        positions: &positions,
        exposure,
        options,
        carried: &mut carried,
    });
    carried
}

struct Carrying<'a> {
    previous: &'a Image<DualMode>,
    positions: &'a CellPositions,
    exposure: Exposure,
    options: &'a GaussianOptions,
    carried: &'a mut Image<DualMode>,
}

impl Kernel for Carrying<'_> {
    type Output = ();

    /// Batch by batch: first looks up the models of the cells, then mixes them.
    #[inline(always)]
    fn run(self) {
        const LANES: usize = 32;
        let Self { previous, positions, exposure, options, carried } = self;
        let positions = positions.x.chunks(LANES).zip(positions.y.chunks(LANES));
        for (carried, (x, y)) in carried.pixels_mut().chunks_mut(LANES).zip(positions) {
            let mut weights = [[0.0; LANES]; 4];
            let mut background = [ModeLanes::<LANES>::NONE; 4];
            let mut candidate = [ModeLanes::<LANES>::NONE; 4];
            for (lane, (&x, &y)) in x.iter().zip(y).enumerate() {
                let Some((shares, cells)) = around(previous.size(), x, y) else { continue };
                for corner in 0..4 {
                    let modes = &previous.pixels()[cells[corner]];
                    weights[corner][lane] = shares[corner];
                    background[corner].set(lane, &modes.background);
                    candidate[corner].set(lane, &modes.candidate);
                }
            }
            let (background, candidate) = (mix(&weights, &background), mix(&weights, &candidate));
            for (lane, modes) in carried.iter_mut().enumerate() {
                let exposed = |mut mode: Mode| {
                    if mode.age <= 0.0 {
                        return Mode::default();
                    }
                    mode.fade(options);
                    let sigma = exposure.sigma(mode.mean);
                    mode.mean = exposure.apply(mode.mean);
                    mode.variance = exposure.gain * exposure.gain * mode.variance + sigma * sigma;
                    mode
                };
                modes.background = exposed(background.get(lane));
                modes.candidate = exposed(candidate.get(lane));
            }
        }
    }
}

/// The four cells around a position, and the share of it that each covers.
#[inline(always)]
fn around((columns, rows): (usize, usize), x: f32, y: f32) -> Option<([f32; 4], [usize; 4])> {
    let (right, bottom) = ((columns - 1) as f32, (rows - 1) as f32);
    if !(x > -0.5 && y > -0.5 && x < right + 0.5 && y < bottom + 0.5) {
        return None;
    }
    let (x, y) = (x.clamp(0.0, right), y.clamp(0.0, bottom));
    let (left, top) = (x as usize, y as usize);
    let (s, t) = (x - left as f32, y - top as f32);
    let (next, below) = ((left + 1).min(columns - 1), (top + 1).min(rows - 1));
    let shares = [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t];
    let (top, below) = (top * columns, below * columns);
    Some((shares, [top + left, top + next, below + left, below + next]))
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::{LieGroup, PinholeRadialTangential, So3};
    use nalgebra::Vector3;

    use super::super::cells::cell_rays;
    use super::*;

    #[test]
    fn models_are_carried_by_a_known_rotation_to_within_a_fraction_of_a_cell() {
        let [k1, k2, p1, p2, k3] = [0.0; 5];
        let (fx, fy, cx, cy) = (160.0, 160.0, 79.5, 59.5);
        let lens = PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 };
        let camera = FrameCamera::new(lens, 160, 120).unwrap();
        let rays = cell_rays(&camera);
        // Gray levels grow by ten from column to column, to show where a model came from.
        let mut models = rays.map(|_| DualMode::default());
        for row in 0..30 {
            for column in 0..40 {
                let background = Mode { mean: 10.0 * column as f32, variance: 4.0, age: 8.0 };
                models.set(column, row, DualMode { background, ..DualMode::default() });
            }
        }
        let angle = 0.08;
        let turn = Se3::new(So3::exp(&Vector3::new(0.0, angle, 0.0)), Vector3::zeros());
        let warp = CellWarp::new(&camera, &rays, &turn);
        let exposure = Exposure { gain: 1.0, offset: 6.0 };
        let options = GaussianOptions::default();
        let carried = carry(&warp, &models, &rays.map(|_| 2.0), exposure, &options);
        for column in 2..34 {
            let middle = 4.0 * column as f64 + 1.5;
            let from = cx + fx * (((middle - cx) / fx).atan() + angle).tan();
            let expected = 10.0 * ((from as f32 + 0.5) / 4.0 - 0.5) + 6.0;
            let mode = carried.at(column, 15).background;
            assert!((mode.mean - expected).abs() < 0.5, "{column}: {} {expected}", mode.mean);
            assert!((mode.age - 8.0).abs() < 1e-3);
        }
        // The last columns were not seen before.
        assert_eq!(carried.at(39, 15), DualMode::default());
    }

    #[test]
    fn exposures_follow_each_other_and_a_large_change_is_uncertain() {
        let (first, second) =
            (Exposure { gain: 2.0, offset: 3.0 }, Exposure { gain: 0.5, offset: -1.0 });
        let both = second.after(&first);
        assert_eq!(both.apply(10.0), second.apply(first.apply(10.0)));
        assert_eq!(Exposure::SAME.sigma(200.0), 0.0);
        assert_eq!(first.sigma(10.0), 6.5);
    }
}
