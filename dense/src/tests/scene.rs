//! Scenes of a few solids with exact distances, rays through them, and the surface of a volume.

use covis_solvers::geometry::{LieGroup, PinholeRadialTangential, Se3, So3};
use nalgebra::Vector3;

use crate::block::{Block, BlockKey, DISTANCE_ONE, EDGE};
use crate::camera::FrameCamera;
use crate::depth::sigma_m;
use crate::image::Image;
use crate::volume::Volume;

/// A solid in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shape {
    /// The inside of a box around the origin, by its half edges, m.
    Room(Vector3<f64>),
    /// Center and half edges, m.
    Box(Vector3<f64>, Vector3<f64>),
    /// Center and radius, m.
    Ball(Vector3<f64>, f64),
}

impl Shape {
    /// Distance of a point from the surface, m; negative inside of what is solid.
    pub(crate) fn distance(&self, point: &Vector3<f64>) -> f64 {
        let outside = |q: Vector3<f64>| q.sup(&Vector3::zeros()).norm() + q.max().min(0.0);
        match self {
            Self::Room(half) => -outside(point.abs() - half),
            Self::Box(center, half) => outside((point - center).abs() - half),
            Self::Ball(center, radius) => (point - center).norm() - radius,
        }
    }

    /// The first z of origin + z · direction on the surface.
    fn hit(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        match self {
            Self::Room(half) => Some(slabs(half, origin, direction).1),
            Self::Box(center, half) => {
                let (enter, leave) = slabs(half, &(origin - center), direction);
                (enter < leave && enter > 0.05).then_some(enter)
            }
            Self::Ball(center, radius) => {
                let from = origin - center;
                let (a, b) = (direction.norm_squared(), direction.dot(&from));
                let root = b * b - a * (from.norm_squared() - radius * radius);
                let z = (-b - root.max(0.0).sqrt()) / a;
                (root > 0.0 && z > 0.05).then_some(z)
            }
        }
    }
}

/// Where a ray enters and leaves a box around the origin.
fn slabs(half: &Vector3<f64>, origin: &Vector3<f64>, direction: &Vector3<f64>) -> (f64, f64) {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    for k in 0..3 {
        let a = (-half[k] - origin[k]) / direction[k];
        let b = (half[k] - origin[k]) / direction[k];
        (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
    }
    (enter, leave)
}

/// Solids and their colors.
pub(crate) type Scene = Vec<(Shape, [u8; 3])>;

/// Distance of a point from the nearest surface, m.
pub(crate) fn distance(scene: &Scene, point: &Vector3<f64>) -> f64 {
    scene.iter().map(|(shape, _)| shape.distance(point).abs()).fold(f64::INFINITY, f64::min)
}

/// A room of 4 × 4 × 2.4 m.
pub(crate) fn room() -> Scene {
    vec![(Shape::Room(Vector3::new(2.0, 2.0, 1.2)), [120, 90, 60])]
}

/// The room with a box on the floor and a ball in the air.
pub(crate) fn furnished() -> Scene {
    let mut scene = room();
    scene.push((
        Shape::Box(Vector3::new(0.9, 0.3, -0.9), Vector3::new(0.2, 0.3, 0.3)),
        [200, 30, 30],
    ));
    scene.push((Shape::Ball(Vector3::new(0.8, -0.6, 0.0), 0.35), [30, 60, 200]));
    scene
}

/// What a camera sees: depth, color, and the number of the solid.
pub(crate) struct Rendered {
    pub(crate) depth_m: Image<f32>,
    pub(crate) color: Image<[u8; 3]>,
    pub(crate) solid: Image<u8>,
}

/// 320 × 240 pixels.
pub(crate) fn camera() -> FrameCamera {
    let lens = PinholeRadialTangential::undistorted(262.0, 262.0, 159.5, 119.5);
    FrameCamera::new(lens, 320, 240).unwrap()
}

/// The same with a lens that bends.
pub(crate) fn distorted_camera() -> FrameCamera {
    let mut lens = PinholeRadialTangential::undistorted(262.0, 260.0, 161.0, 122.0);
    (lens.k1, lens.k2, lens.p1, lens.p2) = (0.12, -0.2, -0.003, 0.002);
    FrameCamera::new(lens, 320, 240).unwrap()
}

/// A camera at a position that looks along +x, turned to the left and up, z up.
pub(crate) fn looking(position: [f64; 3], left_rad: f64, up_rad: f64) -> Se3 {
    let forward = So3::exp(&Vector3::new(-std::f64::consts::FRAC_PI_2, 0.0, 0.0));
    let forward = So3::exp(&Vector3::new(0.0, 0.0, -std::f64::consts::FRAC_PI_2)).compose(&forward);
    let turn = So3::exp(&Vector3::new(0.0, 0.0, left_rad))
        .compose(&So3::exp(&Vector3::new(0.0, -up_rad, 0.0)));
    Se3 { rotation: turn.compose(&forward), translation: Vector3::from(position) }
}

/// A slow walk around a position, looking at the far end of the room.
pub(crate) fn path(frame: usize) -> Se3 {
    let t = frame as f64 / 30.0;
    let position =
        [-1.2 + 0.2 * (0.9 * t).sin(), 0.4 * (0.7 * t).sin(), 0.3 + 0.1 * (1.3 * t).cos()];
    looking(position, 0.15 * (1.1 * t).sin(), -0.12 + 0.05 * t.sin())
}

/// Depth is exact, or with a Kinect's noise from a seed.
pub(crate) fn render(
    scene: &Scene,
    camera: &FrameCamera,
    pose: &Se3,
    noise: Option<u64>,
) -> Rendered {
    let (width, height) = camera.size();
    let mut view = Rendered {
        depth_m: Image::filled(width, height, 0.0),
        color: Image::filled(width, height, [0; 3]),
        solid: Image::filled(width, height, 0),
    };
    let mut random = Random(noise.unwrap_or(0));
    for v in 0..height {
        for u in 0..width {
            let [a, b] = camera.rays().at(u, v).map(f64::from);
            let direction = pose.rotation.matrix() * Vector3::new(a, b, 1.0);
            let hits = scene.iter().enumerate().filter_map(|(i, (shape, color))| {
                Some((shape.hit(&pose.translation, &direction)?, i, *color))
            });
            let Some((z, solid, color)) = hits.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            let error = if noise.is_some() { random.normal() * sigma_m(z) } else { 0.0 };
            let level = if noise.is_some() { random.normal() * 3.0 } else { 0.0 };
            view.depth_m.set(u, v, (z + error) as f32);
            view.color.set(u, v, color.map(|c| (f64::from(c) + level) as u8));
            view.solid.set(u, v, solid as u8);
        }
    }
    view
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// A voxel: distance in truncations, weight, color.
pub(crate) fn voxel(block: &Block, x: usize, y: usize, z: usize) -> (f64, u16, [u8; 4]) {
    let i = Block::index(x, y, z);
    (f64::from(block.distances[i]) / f64::from(DISTANCE_ONE), block.weights[i], block.colors[i])
}

/// Points in the world where the distance is zero between neighbors, with the color nearby. Jumps
/// from free space to behind a surface are none.
pub(crate) fn surface(volume: &Volume) -> Vec<(Vector3<f64>, [u8; 4])> {
    let voxel_m = f64::from(volume.options().voxel_m);
    let steepest = 4.0 * voxel_m / f64::from(volume.options().truncation_m);
    let mut points = Vec::new();
    for (&key, block) in volume.keys().iter().zip(volume.blocks().iter()) {
        for i in 0..EDGE * EDGE * EDGE {
            let at = [i % EDGE, i / EDGE % EDGE, i / EDGE / EDGE];
            let (a, weight, color) = voxel(block, at[0], at[1], at[2]);
            if weight == 0 {
                continue;
            }
            for axis in 0..3 {
                let mut next = at;
                next[axis] += 1;
                let mut other = key;
                if next[axis] == EDGE {
                    next[axis] = 0;
                    *[&mut other.x, &mut other.y, &mut other.z][axis] += 1;
                }
                let Some(block) = volume.block(other) else { continue };
                let (b, weight, _) = voxel(block, next[0], next[1], next[2]);
                if weight == 0 || (a > 0.0) == (b > 0.0) || (a - b).abs() > steepest {
                    continue;
                }
                let BlockKey { x, y, z } = key;
                let mut point = Vector3::new(x, y, z).map(|k| f64::from(k) * EDGE as f64);
                point += Vector3::from(at).map(|k| k as f64);
                point[axis] += a / (a - b);
                points.push((point * voxel_m, color));
            }
        }
    }
    points
}

/// Root of the mean square of points' distances from a scene, m.
pub(crate) fn rmse_m(scene: &Scene, volume: &Volume) -> f64 {
    let points = surface(volume);
    assert!(points.len() > 1000, "there is a surface");
    let sum: f64 = points.iter().map(|(point, _)| distance(scene, point).powi(2)).sum();
    (sum / points.len() as f64).sqrt()
}
