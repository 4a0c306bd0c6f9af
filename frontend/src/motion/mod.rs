//! C. Detection of movement: which pixels show something that moves.
//!
//! | file | role |
//! |---|---|
//! | [`cells`] | a frame in cells of 4 × 4 pixels |
//! | [`gaussian`] | the dual-mode single Gaussian model of a cell |
//! | [`warp`] | models warped by the camera's motion |
//! | [`history`] | votes of earlier frames: space that was free, surfaces that were there |
//! | `witness` | what one of them says of each cell |
//! | [`regions`] | votes of cells spread along surfaces, and moving objects |
//!
//! Where depth is measured, earlier frames have most of the votes; where it is missing, the Gaussian
//! models have all. Uses poses and images, but not the map.

pub mod cells;
pub mod gaussian;
pub mod history;
pub mod regions;
pub mod warp;
mod witness;

use covis_solvers::geometry::{LieGroup, Se3};

use super::camera::FrameCamera;
use super::image::Image;
use cells::{CELL, CellRays, cell_rays, filled_depths, view_cells};
use gaussian::{CellView, DualMode, GaussianOptions};
use history::{Current, History, Neighbor};
use regions::{BLIND_VOTES, CellEvidence, GRAY_VOTES, moving_cells};
use warp::{CellWarp, Exposure, carry};

/// Models of the static scene, warped from frame to frame.
#[derive(Clone, Debug)]
pub struct MotionDetector {
    gaussian: GaussianOptions,
    rays: CellRays,
    modes: Image<DualMode>,
    history: History,
    odom_from_camera: Se3,
}

impl MotionDetector {
    /// A detector without any frame yet.
    #[must_use]
    pub fn new(camera: &FrameCamera) -> Self {
        let rays = cell_rays(camera);
        Self {
            gaussian: GaussianOptions::default(),
            modes: rays.map(|_| DualMode::default()),
            rays,
            history: History::default(),
            odom_from_camera: Se3::identity(),
        }
    }

    /// Detects movement in the next frame at an approximate pose: 255 where a pixel shows something
    /// that moves.
    pub fn detect(
        &mut self,
        camera: &FrameCamera,
        gray: &Image<u8>,
        depth_m: &Image<f32>,
        odom_from_camera: &Se3,
        exposure: Exposure,
        neighbors: &[Neighbor],
    ) -> Image<u8> {
        let views = view_cells(gray, depth_m);
        let gaussian = &self.gaussian;
        let motion = self.odom_from_camera.inverse().compose(odom_from_camera);
        let warp = CellWarp::new(camera, &self.rays, &motion);
        self.modes = carry(&warp, &self.modes, &filled_depths(&views), exposure, gaussian);
        let current =
            Current { camera, rays: &self.rays, cells: &views, odom_from_camera, exposure };
        let votes = self.history.ask(&current, neighbors);
        let mut evidence = Image::filled(views.width(), views.height(), CellEvidence::default());
        let cells = self.modes.pixels_mut().iter_mut().zip(evidence.pixels_mut());
        for (i, (modes, evidence)) in cells.enumerate() {
            let (view, mut votes) = (&views.pixels()[i], votes.pixels()[i]);
            let gray = if view.depth_m > 0.0 { GRAY_VOTES } else { BLIND_VOTES };
            match modes.is_foreground(view, gaussian) {
                Some(true) => votes.moves += gray.moves,
                Some(false) => votes.stands += gray.stands,
                None => {}
            }
            modes.update(view, gaussian);
            *evidence = CellEvidence { votes, depth_m: view.depth_m };
        }
        let moving = moving_cells(&evidence);
        let mask = pixels(&moving, &views, depth_m);
        self.history.push(&current, &moving);
        self.odom_from_camera = *odom_from_camera;
        mask
    }

    /// Keeps the last frame of [`Self::detect`] as a keyframe.
    pub fn keep(&mut self, keyframe: usize) {
        self.history.keep(keyframe);
    }

    /// Lets go of a keyframe.
    pub fn forget(&mut self, keyframe: usize) {
        self.history.forget(keyframe);
    }

    /// How many keyframes are kept.
    #[cfg(test)]
    pub(crate) fn kept(&self) -> usize {
        self.history.kept()
    }

    /// Corrects the pose of the last frame of [`Self::detect`].
    pub fn correct_newest(&mut self, odom_from_camera: &Se3) {
        self.history.correct_newest(odom_from_camera);
        self.odom_from_camera = *odom_from_camera;
    }
}

/// Turns the mask of cells into one of pixels; at its border, depth decides on which side a pixel is.
fn pixels(moving: &Image<bool>, views: &Image<CellView>, depth_m: &Image<f32>) -> Image<u8> {
    let (columns, rows) = moving.size();
    let mut mask = Image::filled(depth_m.width(), depth_m.height(), 0);
    for row in 0..rows {
        for column in 0..columns {
            let around = || {
                let (left, top) = (column.saturating_sub(1), row.saturating_sub(1));
                let (right, bottom) = ((column + 1).min(columns - 1), (row + 1).min(rows - 1));
                (top..=bottom).flat_map(move |r| (left..=right).map(move |c| (c, r)))
            };
            let is_moving = moving.at(column, row);
            let beside = || around().filter(|&(c, r)| moving.at(c, r));
            if beside().next().is_none() {
                continue;
            }
            let is_inside = is_moving && around().all(|(c, r)| moving.at(c, r));
            for v in row * CELL..(row + 1) * CELL {
                for u in column * CELL..(column + 1) * CELL {
                    let z = depth_m.at(u, v);
                    let is_near = |(c, r): (usize, usize)| {
                        let other = views.at(c, r).depth_m;
                        other > 0.0 && (z - other).abs() < 0.04 * other
                    };
                    let is_in =
                        if is_inside || z <= 0.0 { is_moving } else { beside().any(is_near) };
                    if is_in {
                        mask.set(u, v, 255);
                    }
                }
            }
        }
    }
    mask
}
