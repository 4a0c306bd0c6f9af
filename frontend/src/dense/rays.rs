//! Casts the rays of a frame through the grid, and marks the blocks near the depth of each. Rays are as
//! dense as blocks require. Existing blocks are marked too.

use covis_solvers::geometry::Se3;

use super::options::IntegrationOptions;
use super::pixels::Scratch;
use super::ray_blocks::{Ray, RayBlocks};
use super::tiles::{Range, TILE};
use super::visibility::NEAREST_M;
use super::volume::VolumeOptions;
use crate::camera::FrameCamera;

/// The rays of a frame through the grid.
pub(super) struct Rays<'a> {
    ray_blocks: &'a RayBlocks,
    camera: &'a FrameCamera,
    options: &'a IntegrationOptions,
    /// The camera's center and axes in blocks, from the corner of `ray_blocks`.
    origin: [f32; 3],
    axes: [[f32; 3]; 3],
    /// Pixels that a block covers at one meter.
    block_px: f32,
    block_m: f32,
    truncation_m: f32,
}

impl<'a> Rays<'a> {
    pub(super) fn new(
        ray_blocks: &'a RayBlocks,
        camera: &'a FrameCamera,
        options: &'a IntegrationOptions,
        world_from_camera: &Se3,
        measures: &VolumeOptions,
    ) -> Self {
        let block_m = measures.block_m();
        let corner = ray_blocks.origin();
        let center = world_from_camera.translation / block_m;
        let rotation = world_from_camera.rotation.matrix();
        let model = camera.model();
        Self {
            ray_blocks,
            camera,
            options,
            origin: std::array::from_fn(|k| (center[k] - f64::from(corner[k])) as f32),
            axes: std::array::from_fn(|axis| {
                std::array::from_fn(|k| (rotation[(k, axis)] / block_m) as f32)
            }),
            block_px: (block_m * model.fx.min(model.fy)) as f32,
            block_m: block_m as f32,
            truncation_m: measures.truncation_m,
        }
    }

    /// Marks the blocks that the rays of a band reach: at least two rays per block along each axis of
    /// the image, more where depth is uneven.
    pub(super) fn mark(&self, first_row: usize, scratch: &Scratch, tiles: &[Range]) {
        let rays = self.camera.rays();
        let (width, height) = rays.size();
        let tiles_width = width.div_ceil(TILE);
        let mut before = [[i32::MIN; 3]; 2];
        for (i, &[nearest, farthest]) in tiles.iter().enumerate() {
            if farthest == 0.0 {
                continue;
            }
            let (left, top) = (i % tiles_width * TILE, i / tiles_width * TILE);
            let wide = self.block_px / farthest;
            let mut step = if wide >= 16.0 {
                8
            } else if wide >= 8.0 {
                4
            } else if wide >= 4.0 {
                2
            } else {
                1
            };
            if farthest - nearest > 0.5 * self.block_m {
                step = (step / 2).max(1);
            }
            for row in (top + step / 2..top + TILE).step_by(step) {
                if first_row + row >= height {
                    break;
                }
                let depth = scratch.row(row);
                let rays = rays.row(first_row + row);
                for u in (left + step / 2..(left + TILE).min(width)).step_by(step) {
                    if depth[u] > 0.0 {
                        before = self.mark_one(rays[u], depth[u], before);
                    }
                }
            }
        }
    }

    fn mark_one(&self, [a, b]: [f32; 2], depth: f32, before: [[i32; 3]; 2]) -> [[i32; 3]; 2] {
        let [x, y, z] = self.axes;
        let direction = std::array::from_fn(|k| a * x[k] + b * y[k] + z[k]);
        let behind = self.options.behind_m(depth, self.truncation_m);
        let ray = Ray { origin: self.origin, direction };
        let from = (depth - self.truncation_m).max(NEAREST_M);
        self.ray_blocks.mark(&ray, from, depth + behind, before)
    }
}
