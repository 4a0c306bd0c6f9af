//! The Gaussian models carried along by the camera: the previous frame's, as this frame should see
//! them.
//!
//! Each cell of the current frame looks back: its point, by pose and depth, lies among four cells of
//! the previous frame, whose models are mixed by how much of it they cover.

use covis_solvers::geometry::Se3;

use super::cells::{CELL, CellRays};
use super::gaussian::{DualMode, GaussianOptions, Mode, mix};
use crate::frontend::camera::FrameCamera;
use crate::frontend::image::Image;

/// How gray levels changed between two frames: later = gain · earlier + offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Factor.
    pub gain: f32,
    /// Gray levels.
    pub offset: f32,
}

impl Exposure {
    /// None.
    pub const SAME: Self = Self { gain: 1.0, offset: 0.0 };

    /// What a gray level has become.
    #[must_use]
    pub fn apply(&self, gray: f32) -> f32 {
        self.gain * gray + self.offset
    }

    /// Standard deviation of that, gray levels: half of the change, which is no straight line.
    #[must_use]
    pub fn doubt(&self, gray: f32) -> f32 {
        0.5 * (self.apply(gray) - gray).abs()
    }

    /// From the earliest to the latest of three frames: this after `before`.
    #[must_use]
    pub fn after(&self, before: &Self) -> Self {
        Self { gain: self.gain * before.gain, offset: self.apply(before.offset) }
    }
}

/// Places of the cells of one frame in the image of another, in cells.
pub struct CellWarp<'a> {
    camera: &'a FrameCamera,
    rays: &'a CellRays,
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
}

impl<'a> CellWarp<'a> {
    /// For a motion.
    #[must_use]
    pub fn new(camera: &'a FrameCamera, rays: &'a CellRays, other_from_current: &Se3) -> Self {
        let rotation = other_from_current.rotation.matrix();
        let row = |i: usize| [0, 1, 2].map(|j| rotation[(i, j)] as f32);
        let t = other_from_current.translation;
        let translation = [t.x as f32, t.y as f32, t.z as f32];
        Self { camera, rays, rotation: [row(0), row(1), row(2)], translation }
    }

    /// Where the middle of cell `index` at a depth lies, and how deep it is there.
    #[must_use]
    pub fn place(&self, index: usize, depth_m: f32) -> Option<(f32, f32, f32)> {
        let [a, b] = self.rays.pixels()[index];
        let (x, y) = (a * depth_m, b * depth_m);
        let [p, q, r] = [0, 1, 2].map(|i| {
            let row = self.rotation[i];
            row[0] * x + row[1] * y + row[2] * depth_m + self.translation[i]
        });
        let (u, v) = self.camera.project_fast(p, q, r)?;
        let cell = |coordinate: f32| (coordinate + 0.5) / CELL as f32 - 0.5;
        Some((cell(u), cell(v), r))
    }
}

/// Carries the models of the previous frame over; `depths_m` has a depth for every cell, measured
/// or not. A cell that the previous frame did not show has models of age 0.
#[must_use]
pub fn carry(
    warp: &CellWarp<'_>,
    previous: &Image<DualMode>,
    depths_m: &Image<f32>,
    exposure: Exposure,
    options: &GaussianOptions,
) -> Image<DualMode> {
    let mut carried = Image::filled(depths_m.width(), depths_m.height(), DualMode::default());
    for (i, modes) in carried.pixels_mut().iter_mut().enumerate() {
        let place = warp.place(i, depths_m.pixels()[i]);
        let Some((shares, around)) = place.and_then(|(x, y, _)| around(previous, x, y)) else {
            continue;
        };
        let mixed = |of: fn(&DualMode) -> Mode| {
            mixed(&shares, &around.map(|modes| of(&modes)), exposure, options)
        };
        *modes = DualMode {
            background: mixed(|modes| modes.background),
            candidate: mixed(|modes| modes.candidate),
        };
    }
    carried
}

/// The four cells around a place with the shares of it that they cover.
fn around(modes: &Image<DualMode>, x: f32, y: f32) -> Option<([f32; 4], [DualMode; 4])> {
    let (right, bottom) = ((modes.width() - 1) as f32, (modes.height() - 1) as f32);
    if !(x > -0.5 && y > -0.5 && x < right + 0.5 && y < bottom + 0.5) {
        return None;
    }
    let (x, y) = (x.clamp(0.0, right), y.clamp(0.0, bottom));
    let (left, top) = (x as usize, y as usize);
    let (s, t) = (x - left as f32, y - top as f32);
    let (next, below) = ((left + 1).min(modes.width() - 1), (top + 1).min(modes.height() - 1));
    let shares = [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t];
    let around =
        [modes.at(left, top), modes.at(next, top), modes.at(left, below), modes.at(next, below)];
    Some((shares, around))
}

fn mixed(
    shares: &[f32; 4],
    modes: &[Mode; 4],
    exposure: Exposure,
    options: &GaussianOptions,
) -> Mode {
    let parts: [(f32, Mode); 4] =
        std::array::from_fn(|i| (if modes[i].age > 0.0 { shares[i] } else { 0.0 }, modes[i]));
    let Some(mut mode) = mix(&parts, options) else { return Mode::default() };
    // What is covered in part is not known for as long.
    mode.age *= parts.iter().map(|part| part.0).sum::<f32>().min(1.0);
    let doubt = exposure.doubt(mode.mean);
    mode.mean = exposure.apply(mode.mean);
    mode.variance = exposure.gain * exposure.gain * mode.variance + doubt * doubt;
    mode
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
        // Gray levels that grow by ten from column to column tell where a model came from.
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
    fn exposures_follow_each_other_and_a_large_change_is_doubtful() {
        let (first, second) =
            (Exposure { gain: 2.0, offset: 3.0 }, Exposure { gain: 0.5, offset: -1.0 });
        let both = second.after(&first);
        assert_eq!(both.apply(10.0), second.apply(first.apply(10.0)));
        assert_eq!(Exposure::SAME.doubt(200.0), 0.0);
        assert_eq!(first.doubt(10.0), 6.5);
    }
}
