//! Where blocks lie in an image, and whether its depth can say anything about them.

use covis_solvers::geometry::{LieGroup, PinholeRadialTangential, Se3};
use nalgebra::{Matrix3, Vector3};

use super::block::{BlockKey, EDGE};
use super::tiles::{Range, Tiles};
use crate::frontend::camera::FrameCamera;

/// Voxels that lie nearer than this to the camera's plane are not looked at, meters.
pub(super) const NEAREST_M: f32 = 0.05;
/// From a block's center to its farthest voxel, in voxels, and a little more.
const RADIUS: f32 = 6.1;
/// Lenses do not stretch the image more than this, compared with a pinhole.
const STRETCH: f32 = 1.5;

/// A lens in single precision.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lens {
    pub(super) fx: f32,
    pub(super) fy: f32,
    pub(super) cx: f32,
    pub(super) cy: f32,
    /// k1, k2, k3, p1, p2.
    pub(super) distortion: [f32; 5],
    /// Points farther from the axis than this, as a tangent squared, are not seen.
    pub(super) largest_tangent2: f32,
    pub(super) is_pinhole: bool,
    /// Columns and rows.
    pub(super) size: [f32; 2],
    /// Least and greatest x/z, least and greatest y/z of the pixels' rays.
    pub(super) field: [f32; 4],
}

/// A camera at its place over a grid.
#[derive(Clone, Debug)]
pub(super) struct Sight {
    pub(super) lens: Lens,
    /// Camera from blocks: axes and the grid's origin, meters.
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    block_m: f64,
    voxel_m: f32,
    /// From a block's first voxel to its center, in the camera's axes, meters.
    to_center: [f32; 3],
}

/// What a frame can say about a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Seen {
    /// It lies outside of the image or behind all that is seen.
    No,
    /// It lies before all that is seen. The range as for `Near`.
    Through(Range),
    /// Depth may be in it. Nearer than the range, meters, space is free, and beyond it nothing is seen.
    Near(Range),
}

impl Lens {
    pub(super) fn new(camera: &FrameCamera) -> Self {
        let model: &PinholeRadialTangential = camera.model();
        let PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 } = *model;
        let distortion = [k1, k2, k3, p1, p2].map(|x| x as f32);
        let (width, height) = camera.size();
        let mut field = [f32::INFINITY, f32::NEG_INFINITY, f32::INFINITY, f32::NEG_INFINITY];
        let mut largest = 0.0_f32;
        for &[a, b] in camera.rays().pixels() {
            field = [field[0].min(a), field[1].max(a), field[2].min(b), field[3].max(b)];
            largest = largest.max(a * a + b * b);
        }
        let [fx, fy, cx, cy] = [fx, fy, cx, cy].map(|x| x as f32);
        Self {
            fx,
            fy,
            cx,
            cy,
            distortion,
            // Half a pixel beyond the outermost centers, and a little more.
            largest_tangent2: largest * 1.02 + 1e-4,
            is_pinhole: distortion == [0.0; 5],
            size: [width as f32, height as f32],
            field,
        }
    }

    /// The pixel on a ray (a, b, 1).
    fn pixel(&self, a: f32, b: f32) -> [f32; 2] {
        let [k1, k2, k3, p1, p2] = self.distortion;
        let r2 = a * a + b * b;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let x = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a);
        let y = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b;
        [self.fx * x + self.cx, self.fy * y + self.cy]
    }
}

impl Sight {
    pub(super) fn new(lens: Lens, world_from_camera: &Se3, block_m: f64) -> Self {
        let camera_from_world = world_from_camera.inverse();
        let half = 0.5 * (EDGE - 1) as f64 * block_m / EDGE as f64;
        let to_center = camera_from_world.rotation.matrix() * Vector3::repeat(half);
        Self {
            lens,
            to_center: to_center.map(|x| x as f32).into(),
            rotation: camera_from_world.rotation.matrix().into_owned(),
            translation: camera_from_world.translation,
            block_m,
            voxel_m: (block_m / EDGE as f64) as f32,
        }
    }

    /// From a voxel to the next along each axis of the grid, in the camera's axes, meters.
    pub(super) fn steps(&self) -> [[f32; 3]; 3] {
        let voxel_m = self.block_m / EDGE as f64;
        std::array::from_fn(|axis| {
            std::array::from_fn(|k| (self.rotation[(k, axis)] * voxel_m) as f32)
        })
    }

    /// A block's first voxel in the camera's axes, meters.
    pub(super) fn corner(&self, key: BlockKey) -> [f32; 3] {
        let at = Vector3::new(f64::from(key.x), f64::from(key.y), f64::from(key.z)) * self.block_m;
        let at = self.rotation * at + self.translation;
        [at.x as f32, at.y as f32, at.z as f32]
    }

    /// What the depth of `tiles` can say about the block with this corner; `behind_m` is how far
    /// behind a surface voxels are looked at, and `before_m` how far before it space is surely free.
    pub(super) fn look(
        &self,
        corner: [f32; 3],
        tiles: &Tiles,
        behind_m: f32,
        before_m: f32,
    ) -> Seen {
        let lens = &self.lens;
        let [x, y, z] = std::array::from_fn(|k| corner[k] + self.to_center[k]);
        let radius = RADIUS * self.voxel_m;
        if z + radius < NEAREST_M {
            return Seen::No;
        }
        let [width, height] = lens.size;
        let (mut box_low, mut box_high) = ([0.0; 2], [width - 1.0, height - 1.0]);
        if z - radius > NEAREST_M {
            let (a, b) = (x / z, y / z);
            // How far the ball's outline is from its center, as a tangent.
            let spread = radius * (1.0 + a * a + b * b).sqrt() / (z - radius);
            let (tangent, largest) = ((a * a + b * b).sqrt(), lens.largest_tangent2.sqrt());
            if tangent > largest + spread {
                return Seen::No;
            }
            // A lens is known inside of the image only: what is centered outside is not culled.
            if lens.is_pinhole || tangent < largest {
                let stretch = if lens.is_pinhole { 1.0 } else { STRETCH };
                let center = lens.pixel(a, b);
                let focal = [lens.fx, lens.fy];
                for axis in 0..2 {
                    let reach = focal[axis] * spread * stretch + 1.0;
                    box_low[axis] = (center[axis] - reach).max(0.0);
                    box_high[axis] = (center[axis] + reach).min(box_high[axis]);
                    if box_low[axis] > box_high[axis] {
                        return Seen::No;
                    }
                }
            }
        }
        let [left, top] = box_low.map(|x| x as usize);
        let [right, bottom] = box_high.map(|x| x as usize);
        let [nearest, farthest] = tiles.range(left, top, right, bottom);
        let range = [nearest - before_m, farthest + behind_m];
        if z - radius > range[1] {
            Seen::No
        } else if z + radius < range[0] {
            Seen::Through(range)
        } else {
            Seen::Near(range)
        }
    }
}
