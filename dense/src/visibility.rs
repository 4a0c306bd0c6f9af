//! Where blocks lie in an image, and whether its depth concerns them. Answers are conservative: a block
//! that is reported as not seen is not seen. It reads depth by tiles, no pixels.

use covis_solvers::geometry::{LieGroup, PinholeRadialTangential, Se3};
use nalgebra::{Matrix3, Vector3};

use super::block::{BlockKey, EDGE};
use super::tiles::{Range, Tiles};
use crate::camera::FrameCamera;

/// Voxels nearer than this to the camera's plane are not updated, meters.
pub(super) const NEAREST_M: f32 = 0.05;
/// From a block's center to its farthest voxel, in voxels, and a little more.
const RADIUS: f32 = 6.1;
/// How far distortion may extend the image of a block beyond its corners, as a share of its size.
const BEND: f32 = 0.1;

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
    largest_tangent: f32,
    pub(super) is_pinhole: bool,
    /// Columns and rows.
    pub(super) size: [f32; 2],
    /// Least and greatest x/z, least and greatest y/z of the pixels' rays.
    pub(super) field: [f32; 4],
}

/// A camera at a pose, and a grid.
#[derive(Clone, Debug)]
pub(super) struct Visibility {
    pub(super) lens: Lens,
    /// camera_from_world, meters.
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    block_m: f64,
    voxel_m: f32,
    /// From a block's first voxel to its center, in the camera's axes, meters.
    to_center: [f32; 3],
    /// From the first voxel to the eight outermost voxels, axis by axis.
    corners: [[f32; 8]; 3],
}

/// How a frame sees a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum BlockVisibility {
    /// It lies outside the image or behind all measured depth.
    No,
    /// It lies in front of all measured depth. The range is as for `Near`.
    Through(Range),
    /// Measured depth may be in it. Space nearer than the range, meters, is free, and beyond it nothing
    /// is seen.
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
            largest_tangent: (largest * 1.02 + 1e-4).sqrt(),
            is_pinhole: distortion == [0.0; 5],
            size: [width as f32, height as f32],
            field,
        }
    }

    /// Columns and rows of points in front of the camera. Points outside the valid range of the lens
    /// are moved to its border.
    #[inline(always)]
    fn pixels(&self, x: &[f32; 8], y: &[f32; 8], z: &[f32; 8]) -> [[f32; 8]; 2] {
        let [k1, k2, k3, p1, p2] = self.distortion;
        let mut out = [[0.0; 8]; 2];
        for i in 0..8 {
            let per_z = 1.0 / z[i];
            let (mut a, mut b) = (x[i] * per_z, y[i] * per_z);
            if !self.is_pinhole {
                let tangent = (a * a + b * b).sqrt();
                let inside = if tangent > self.largest_tangent {
                    self.largest_tangent / tangent
                } else {
                    1.0
                };
                (a, b) = (a * inside, b * inside);
                let r2 = a * a + b * b;
                let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                (a, b) = (
                    a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a),
                    b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b,
                );
            }
            out[0][i] = self.fx * a + self.cx;
            out[1][i] = self.fy * b + self.cy;
        }
        out
    }
}

impl Visibility {
    pub(super) fn new(lens: Lens, world_from_camera: &Se3, block_m: f64) -> Self {
        let camera_from_world = world_from_camera.inverse();
        let half = 0.5 * (EDGE - 1) as f64 * block_m / EDGE as f64;
        let to_center = camera_from_world.rotation.matrix() * Vector3::repeat(half);
        let edge = 2.0 * half;
        let corners = std::array::from_fn::<_, 8, _>(|i| {
            let bits = Vector3::new(i & 1, i >> 1 & 1, i >> 2).map(|bit| bit as f64);
            camera_from_world.rotation.matrix() * (bits * edge)
        });
        Self {
            lens,
            corners: std::array::from_fn(|k| corners.map(|corner| corner[k] as f32)),
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

    /// How the depth of `tiles` sees the block with this corner. Voxels are updated up to
    /// `truncation_m` behind a surface; space more than that in front of it is free.
    #[inline(always)]
    pub(super) fn look(
        &self,
        corner: [f32; 3],
        tiles: &Tiles,
        truncation_m: f32,
    ) -> BlockVisibility {
        let lens = &self.lens;
        let [x, y, z] = std::array::from_fn(|k| corner[k] + self.to_center[k]);
        let radius = RADIUS * self.voxel_m;
        // Most blocks lie outside of the cone around the image.
        let away = (x * x + y * y).sqrt() - radius;
        if z + radius < NEAREST_M || away > lens.largest_tangent * (z + radius) {
            return BlockVisibility::No;
        }
        let coordinate =
            |k: usize| -> [f32; 8] { std::array::from_fn(|i| corner[k] + self.corners[k][i]) };
        let [x, y, z] = [coordinate(0), coordinate(1), coordinate(2)];
        let [nearest_z, farthest_z] = extent(&z);
        let [mut left, mut top] = [0.0_f32; 2];
        let [mut right, mut bottom] = lens.size.map(|size| size - 1.0);
        if nearest_z > NEAREST_M {
            let pixels = lens.pixels(&x, &y, &z);
            let [columns, rows] = [extent(&pixels[0]), extent(&pixels[1])];
            // Distortion bends the edges between the corners.
            let bend = if lens.is_pinhole { 0.0 } else { BEND };
            let margins = [columns, rows].map(|[low, high]| 1.0 + bend * (high - low));
            left = left.max(columns[0] - margins[0]);
            right = right.min(columns[1] + margins[0]);
            top = top.max(rows[0] - margins[1]);
            bottom = bottom.min(rows[1] + margins[1]);
            if left > right || top > bottom {
                return BlockVisibility::No;
            }
        }
        let [nearest, farthest] =
            tiles.range(left as usize, top as usize, right as usize, bottom as usize);
        let range = [nearest - truncation_m, farthest + truncation_m];
        if nearest_z > range[1] {
            BlockVisibility::No
        } else if farthest_z < range[0] {
            BlockVisibility::Through(range)
        } else {
            BlockVisibility::Near(range)
        }
    }
}

/// The least and the greatest.
#[inline(always)]
fn extent(x: &[f32; 8]) -> [f32; 2] {
    let mut out = [x[0]; 2];
    for &x in x {
        out = [if x < out[0] { x } else { out[0] }, if x > out[1] { x } else { out[1] }];
    }
    out
}

/// The frustum of a camera: space between four planes through its center, up to a depth. A box that is
/// reported outside is not seen.
#[derive(Clone, Debug)]
pub(super) struct Frustum {
    /// Inward normals, and offsets that are added to the product with a point.
    planes: [(Vector3<f64>, f64); 6],
}

impl Frustum {
    /// The frustum of a camera. `field` has the least and greatest x/z, then y/z of its rays, and
    /// `wider` is added on each side; the largest depth is in meters.
    pub(super) fn new(
        field: [f32; 4],
        wider: f64,
        world_from_camera: &Se3,
        farthest_m: f64,
    ) -> Self {
        let [left, right, top, bottom] = field.map(f64::from);
        let planes = [
            ([1.0, 0.0, wider - left], 0.0),
            ([-1.0, 0.0, wider + right], 0.0),
            ([0.0, 1.0, wider - top], 0.0),
            ([0.0, -1.0, wider + bottom], 0.0),
            ([0.0, 0.0, 1.0], 0.0),
            ([0.0, 0.0, -1.0], farthest_m),
        ];
        Self {
            planes: planes.map(|(normal, offset)| {
                let normal = world_from_camera.rotation.matrix() * Vector3::from(normal);
                (normal, offset - normal.dot(&world_from_camera.translation))
            }),
        }
    }

    /// Whether a box along the world's axes may intersect it, by its center and half its edge, meters.
    pub(super) fn meets(&self, center: &Vector3<f64>, half_m: f64) -> bool {
        self.planes.iter().all(|(normal, offset)| {
            normal.dot(center) + offset + half_m * normal.abs().sum() >= 0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::So3;

    use super::*;

    #[test]
    fn what_a_pixel_sees_is_met_and_what_lies_behind_is_not() {
        let turn = So3::exp(&Vector3::new(0.4, -1.1, 0.3));
        let pose = Se3 { rotation: turn, translation: Vector3::new(1.0, 2.0, -3.0) };
        let frustum = Frustum::new([-0.6, 0.5, -0.4, 0.45], 0.02, &pose, 4.0);
        for i in 0..1000 {
            let share = |k: usize| (i / 10_usize.pow(k as u32) % 10) as f64 / 9.0;
            let (a, b, z) = (-0.6 + 1.1 * share(0), -0.4 + 0.85 * share(1), 3.99 * share(2));
            let seen = pose.transform(&Vector3::new(a * z, b * z, z));
            assert!(frustum.meets(&seen, 0.0), "{a} {b} {z}");
            assert!(frustum.meets(&(seen + Vector3::repeat(0.3)), 0.3));
        }
        for away in [[0.0, 0.0, -0.1], [0.0, 0.0, 4.1], [-3.0, 0.0, 4.0], [0.0, 2.1, 4.0]] {
            assert!(!frustum.meets(&pose.transform(&Vector3::from(away)), 0.001), "{away:?}");
        }
    }
}
