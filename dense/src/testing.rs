//! Volumes of known shapes, for tests: distances from a formula instead of from frames.
//!
//! Built for tests only. Uses nothing but blocks and volumes.

use super::block::{Block, BlockKey, DISTANCE_ONE, EDGE, VOXELS, WEIGHT_ONE};
use super::volume::{Volume, VolumeOptions};

/// The content of a voxel: distance in meters, weight in observations, color; `None` where it was not
/// seen.
pub(super) type Shown = Option<(f32, f32, [u8; 3])>;

/// The voxels of the blocks from `lowest` to `highest`, both included.
pub(super) fn volume(
    options: VolumeOptions,
    lowest: [i32; 3],
    highest: [i32; 3],
    shape: impl Fn([f32; 3]) -> Shown,
) -> Volume {
    let mut volume = Volume::new(options);
    for z in lowest[2]..=highest[2] {
        for y in lowest[1]..=highest[1] {
            for x in lowest[0]..=highest[0] {
                let key = BlockKey { x, y, z };
                volume.insert(key, block(options, key, &shape));
            }
        }
    }
    volume
}

/// One block of a shape.
pub(super) fn block(
    options: VolumeOptions,
    key: BlockKey,
    shape: &impl Fn([f32; 3]) -> Shown,
) -> Block {
    let mut block = Block::EMPTY;
    for i in 0..VOXELS {
        let voxel = [i % EDGE, i / EDGE % EDGE, i / (EDGE * EDGE)];
        let first = [key.x, key.y, key.z];
        let point = std::array::from_fn(|axis| {
            (first[axis] * EDGE as i32 + voxel[axis] as i32) as f32 * options.voxel_m
        });
        if let Some((distance_m, weight, [r, g, b])) = shape(point) {
            let distance = (distance_m / options.truncation_m).clamp(-1.0, 1.0);
            block.distances[i] = (distance * DISTANCE_ONE).round() as i16;
            block.weights[i] = (weight * f32::from(WEIGHT_ONE)) as u16;
            block.colors[i] = [r, g, b, 0];
        }
    }
    block
}

/// Voxels of 1 cm, distances up to 8 of them.
pub(super) const CENTIMETER: VolumeOptions = VolumeOptions { voxel_m: 0.01, truncation_m: 0.08 };

/// Distance to a sphere.
pub(super) fn sphere(point: [f32; 3], center: [f32; 3], radius: f32) -> f32 {
    (0..3).map(|i| (point[i] - center[i]).powi(2)).sum::<f32>().sqrt() - radius
}

/// A reproducible number from a place.
pub(super) fn noise(seed: usize) -> u64 {
    let mixed = (seed as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed ^ mixed >> 31).wrapping_mul(0xbf58_476d_1ce4_e5b9).rotate_left(23)
}
