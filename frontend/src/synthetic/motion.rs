//! How the camera moves: carried by a hand that sways, or once around the room.
//!
//! Sums of sinusoids with random phases, so that position and orientation are smooth at any time. Knows
//! nothing of the room.

use std::f64::consts::TAU;

use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::{Matrix3, Vector3};

use super::random;

/// Sway of a hand: amplitude and rate (Hz) of x, y, z (m) and yaw, pitch, roll (rad), and of the
/// tremor on top of each.
const SWAY: [[(f64, f64); 2]; 6] = [
    [(0.22, 0.19), (0.0012, 2.3)],
    [(0.12, 0.16), (0.0012, 2.6)],
    [(0.09, 0.27), (0.0012, 2.9)],
    [(0.28, 0.23), (0.003, 1.7)],
    [(0.10, 0.31), (0.003, 2.1)],
    [(0.07, 0.37), (0.003, 1.9)],
];

/// A hand's motion about a position and a direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hand {
    seed: u64,
    /// 1 is [`SWAY`].
    strength: f64,
}

impl Hand {
    pub(super) fn new(seed: u64, strength: f64) -> Self {
        Self { seed, strength }
    }

    /// Displacement (m) and yaw, pitch, roll (rad) at a time.
    fn offsets(&self, time_s: f64) -> [f64; 6] {
        let mut index = 0;
        SWAY.map(|waves| {
            waves.map(|(amplitude, rate_hz)| {
                let phase = TAU * random::uniform(random::number(self.seed, index));
                index += 1;
                self.strength * amplitude * (TAU * rate_hz * time_s + phase).sin()
            })
        })
        .map(|waves| waves.iter().sum())
    }

    /// World from camera: about `position`, looking along `yaw` (from the world's y, clockwise seen from
    /// above) and `pitch` (up).
    pub(super) fn held(&self, position: Vector3<f64>, yaw: f64, pitch: f64, time_s: f64) -> Se3 {
        let [x, y, z, yaw_offset, pitch_offset, roll] = self.offsets(time_s);
        let view = looking(yaw + yaw_offset, pitch + pitch_offset);
        let rotation = view * So3::exp(&Vector3::new(0.0, 0.0, roll));
        Se3::new(rotation, position + Vector3::new(x, y, z))
    }
}

/// The rotation of a level camera: x right, y down, z forward.
fn looking(yaw: f64, pitch: f64) -> So3 {
    let forward = Vector3::new(yaw.sin() * pitch.cos(), yaw.cos() * pitch.cos(), pitch.sin());
    let right = Vector3::new(yaw.cos(), -yaw.sin(), 0.0);
    So3::from_matrix(&Matrix3::from_columns(&[right, forward.cross(&right), forward]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_camera_has_its_axes_where_they_belong() {
        let rotation = looking(0.0, 0.0);
        assert!((rotation.rotate(&Vector3::z()) - Vector3::y()).norm() < 1e-12);
        assert!((rotation.rotate(&Vector3::x()) - Vector3::x()).norm() < 1e-12);
        assert!((rotation.rotate(&Vector3::y()) + Vector3::z()).norm() < 1e-12);
        let right = looking(0.3, 0.1).rotate(&Vector3::z());
        assert!(right.x > 0.0 && right.z > 0.0);
    }

    #[test]
    fn a_hand_moves_smoothly_and_not_too_fast() {
        let hand = Hand::new(4, 1.0);
        let at = |i: u32| hand.held(Vector3::zeros(), 0.0, 0.0, f64::from(i) / 30.0);
        for i in 0..300 {
            let step = at(i).inverse() * at(i + 1);
            let angle = step.rotation.log().norm();
            assert!(step.translation.norm() < 0.03 && angle < 0.03, "{i}: {angle} rad");
        }
    }
}
