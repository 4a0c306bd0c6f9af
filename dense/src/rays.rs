//! Finds the blocks that a frame reaches: those that its rays pass near the measured depth.
//!
//! There is one bit per block in a box around all that the camera can see. Rays, as dense as blocks
//! require, set bits in parallel, in any order; existing blocks clear theirs, and the remaining bits
//! are new blocks. It marks bits; `integrate` allocates the blocks.

use std::sync::atomic::{AtomicU64, Ordering};

use covis_solvers::geometry::Se3;

use super::block::BlockKey;
use super::pixels::Scratch;
use super::tiles::{Range, TILE};
use super::visibility::NEAREST_M;
use super::volume::VolumeOptions;
use crate::camera::FrameCamera;

/// Most blocks along an axis.
const MOST_ALONG: usize = 2048;
/// Most bits.
const MOST_BITS: usize = 1 << 31;

/// Bits of blocks in a box.
#[derive(Debug, Default)]
pub(super) struct RayBlocks {
    origin: [i32; 3],
    size: [usize; 3],
    words: Vec<AtomicU64>,
}

/// A ray: points origin + z · direction, z in meters, in blocks from the box's corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) origin: [f32; 3],
    pub(super) direction: [f32; 3],
}

impl RayBlocks {
    /// Resets the box to the blocks of these points, in blocks, and all between them. `None` where
    /// those are too many or too far away for a key.
    pub(super) fn begin(&mut self, points: &[[f64; 3]]) -> Option<()> {
        for axis in 0..3 {
            let along = points.iter().map(|point| point[axis]);
            let low = along.clone().fold(f64::INFINITY, f64::min).floor() - 1.0;
            let high = along.fold(f64::NEG_INFINITY, f64::max).floor() + 1.0;
            let limit = f64::from(i32::MAX / 16);
            if !(low > -limit && high < limit && high - low < MOST_ALONG as f64) {
                return None;
            }
            self.origin[axis] = low as i32;
            self.size[axis] = (high - low) as usize + 1;
        }
        // A row is whole words.
        let words = self.row_words() * self.size[1] * self.size[2];
        if words * 64 > MOST_BITS {
            return None;
        }
        self.words.truncate(words);
        for word in &mut self.words {
            *word.get_mut() = 0;
        }
        self.words.resize_with(words, AtomicU64::default);
        Some(())
    }

    fn row_words(&self) -> usize {
        self.size[0].div_ceil(64)
    }

    /// The box's corner, in blocks.
    pub(super) fn origin(&self) -> [i32; 3] {
        self.origin
    }

    /// The word and the bit of a block, counted from the corner; `None` outside of the box.
    fn bit(&self, cell: [i32; 3]) -> Option<(&AtomicU64, u64)> {
        let inside = |axis: usize| {
            let at = usize::try_from(cell[axis]).ok()?;
            (at < self.size[axis]).then_some(at)
        };
        let (x, y, z) = (inside(0)?, inside(1)?, inside(2)?);
        let word = (z * self.size[1] + y) * self.row_words() + x / 64;
        self.words.get(word).map(|word| (word, 1 << (x % 64)))
    }

    fn set(&self, cell: [i32; 3]) {
        if let Some((word, bit)) = self.bit(cell)
            && word.load(Ordering::Relaxed) & bit == 0
        {
            word.fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// Marks the blocks that a ray passes between two depths (Amanatides and Woo, Eurographics 1987),
    /// and returns the first and the last of them. Where those equal `before`, as for most neighboring
    /// rays, the blocks between are marked already, except for corners that are just touched.
    pub(super) fn mark(
        &self,
        ray: &Ray,
        from_m: f32,
        to_m: f32,
        before: [[i32; 3]; 2],
    ) -> [[i32; 3]; 2] {
        let at = |z: f32| -> [i32; 3] {
            std::array::from_fn(|axis| floor(ray.origin[axis] + z * ray.direction[axis]))
        };
        let [first, last] = [at(from_m), at(to_m)];
        if [first, last] == before {
            return before;
        }
        let (mut step, mut left) = ([0; 3], 0);
        let (mut next, mut between) = ([f32::INFINITY; 3], [f32::INFINITY; 3]);
        for axis in 0..3 {
            let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
            left += first[axis].abs_diff(last[axis]);
            if first[axis] != last[axis] {
                let forward = direction > 0.0;
                step[axis] = if forward { 1 } else { -1 };
                between[axis] = 1.0 / direction.abs();
                let border = if forward { first[axis] + 1 } else { first[axis] };
                next[axis] = (border as f32 - origin) / direction;
            }
        }
        let mut cell = first;
        self.set(cell);
        for _ in 0..left {
            let axis = if next[0] <= next[1] && next[0] <= next[2] {
                0
            } else if next[1] <= next[2] {
                1
            } else {
                2
            };
            cell[axis] += step[axis];
            next[axis] += between[axis];
            self.set(cell);
        }
        [first, last]
    }

    /// Clears a block's bit.
    pub(super) fn clear(&self, key: BlockKey) {
        let cell = [key.x, key.y, key.z];
        let cell = std::array::from_fn(|axis| cell[axis].wrapping_sub(self.origin[axis]));
        if let Some((word, bit)) = self.bit(cell)
            && word.load(Ordering::Relaxed) & bit != 0
        {
            word.fetch_and(!bit, Ordering::Relaxed);
        }
    }

    /// The blocks whose bits are set, in the order of z, y, x.
    pub(super) fn for_each(&self, mut block: impl FnMut(BlockKey)) {
        let row_words = self.row_words();
        for (index, word) in self.words.iter().enumerate() {
            let mut bits = word.load(Ordering::Relaxed);
            while bits != 0 {
                let x = index % row_words * 64 + bits.trailing_zeros() as usize;
                let row = index / row_words;
                block(BlockKey {
                    x: self.origin[0] + x as i32,
                    y: self.origin[1] + (row % self.size[1]) as i32,
                    z: self.origin[2] + (row / self.size[1]) as i32,
                });
                bits &= bits - 1;
            }
        }
    }
}

/// Rounds down. `f32::floor` is a function call where the processor may lack the instruction.
fn floor(x: f32) -> i32 {
    let whole = x as i32;
    whole - i32::from(x < whole as f32)
}

/// The rays of a frame through the grid.
pub(super) struct Rays<'a> {
    ray_blocks: &'a RayBlocks,
    camera: &'a FrameCamera,
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
            let steps = [(16.0, 8), (8.0, 4), (4.0, 2)];
            let mut step =
                steps.iter().find(|(least, _)| wide >= *least).map_or(1, |found| found.1);
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
                        let ([a, b], [x, y, z]) = (rays[u], self.axes);
                        let direction = std::array::from_fn(|k| a * x[k] + b * y[k] + z[k]);
                        let ray = Ray { origin: self.origin, direction };
                        let from = (depth[u] - self.truncation_m).max(NEAREST_M);
                        let to = depth[u] + self.truncation_m;
                        before = self.ray_blocks.mark(&ray, from, to, before);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_marks_each_block_that_it_passes_once() {
        let mut ray_blocks = RayBlocks::default();
        ray_blocks.begin(&[[-3.0, -200.0, 5.0], [80.5, -180.0, 9.0]]).unwrap();
        let corner = ray_blocks.origin();
        let direction = [0.83, 0.19, -0.04];
        let start = [0.3_f32, -199.7, 8.6];
        let origin = std::array::from_fn(|k| start[k] - corner[k] as f32);
        let none = [[i32::MIN; 3]; 2];
        let ends = ray_blocks.mark(&Ray { origin, direction }, 0.5, 80.0, none);
        assert_eq!(ray_blocks.mark(&Ray { origin, direction }, 0.5, 80.0, ends), ends);
        let mut marked = Vec::new();
        ray_blocks.for_each(|key| marked.push(key));
        let mut passed: Vec<BlockKey> = (0..=100_000)
            .map(|i| {
                let z = 0.5 + 79.5 * i as f32 / 100_000.0;
                let at: [f32; 3] = std::array::from_fn(|k| (start[k] + z * direction[k]).floor());
                let [x, y, z] = at.map(|x| x as i32);
                BlockKey { x, y, z }
            })
            .collect();
        passed.dedup();
        passed.sort_unstable_by_key(|key| (key.z, key.y, key.x));
        assert!(passed.len() > 80);
        let wrong = marked.iter().filter(|key| !passed.contains(key)).count()
            + passed.iter().filter(|key| !marked.contains(key)).count();
        // Rounding errors at a corner.
        assert!(wrong <= 2, "{wrong}");
        for key in marked {
            ray_blocks.clear(key);
        }
        ray_blocks.clear(BlockKey { x: i32::MAX, y: i32::MIN, z: 0 });
        ray_blocks.for_each(|key| panic!("{key:?}"));
    }

    #[test]
    fn boxes_that_are_too_large_or_too_far_are_refused() {
        let mut ray_blocks = RayBlocks::default();
        for far in [1e4, -1e9, 1e300, f64::INFINITY] {
            assert_eq!(ray_blocks.begin(&[[0.0; 3], [0.0, far, 0.0]]), None, "{far}");
        }
        let all = f64::from(i32::MAX);
        assert_eq!(ray_blocks.begin(&[[all; 3], [all; 3]]), None);
        assert_eq!(ray_blocks.begin(&[[0.0; 3], [2000.0; 3]]), None);
    }
}
