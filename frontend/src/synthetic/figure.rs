//! People of capsules and ellipsoids: walking along a path, or sitting and gesturing.
//!
//! A figure's axes are x forward, y left, z up, with the origin on the floor. Limbs swing about y;
//! an angle is from straight down, positive forward, rad. Where a figure goes is chosen by `scene`:
//! nothing here looks for obstacles.

use std::f64::consts::{PI, TAU};

use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::Vector3;

use super::material::{Kind, Material};
use super::solid::{Shape, Solid, upright};

const THIGH_M: f64 = 0.44;
const SHIN_M: f64 = 0.43;
const UPPER_ARM_M: f64 = 0.30;
const FOREARM_M: f64 = 0.25;
/// The hip joint's height over the floor, standing.
const STANDING_HIP_M: f64 = 0.93;
/// And sitting.
const SITTING_HIP_M: f64 = 0.50;
/// Two steps, m.
const STRIDE_M: f64 = 1.25;

/// What a figure wears.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clothes {
    shirt: Material,
    trousers: Material,
    shoes: Material,
}

impl Clothes {
    /// Some clothes for each seed.
    pub(super) fn new(seed: u32) -> Self {
        const SHIRTS: [([f32; 3], [f32; 3]); 4] = [
            ([0.15, 0.05, 0.05], [0.95, 0.45, 0.35]),
            ([0.05, 0.1, 0.3], [0.55, 0.75, 0.95]),
            ([0.1, 0.25, 0.1], [0.85, 0.9, 0.5]),
            ([0.2, 0.2, 0.2], [0.95, 0.95, 0.9]),
        ];
        let (dark, light) = SHIRTS[seed as usize % SHIRTS.len()];
        let (jeans, faded) = ([0.04, 0.06, 0.15], [0.4, 0.5, 0.7]);
        Self {
            shirt: Material { kind: Kind::Cloth, dark, light, seed },
            trousers: Material { kind: Kind::Cloth, dark: jeans, light: faded, seed: seed + 100 },
            shoes: Material { kind: Kind::Plain, dark: [0.02; 3], light: [0.3; 3], seed },
        }
    }
}

/// The angles of a figure's joints; pairs are left, right.
struct Joints {
    hip_height_m: f64,
    hips: [f64; 2],
    knees: [f64; 2],
    shoulders: [f64; 2],
    elbows: [f64; 2],
    /// Of the arms, away from the body.
    spread: [f64; 2],
    /// Of the head, to the left.
    head_turn: f64,
}

/// Adds a figure that walks and has come `distance_m` along its path.
pub(super) fn walking(
    world_from_figure: &Se3,
    distance_m: f64,
    clothes: &Clothes,
    out: &mut Vec<Solid>,
) {
    let phase = TAU * distance_m / STRIDE_M;
    let leg = |phase: f64| (0.42 * phase.sin(), 0.35 * (1.0 + (phase + 1.3).sin()));
    let ((left_hip, left_knee), (right_hip, right_knee)) = (leg(phase), leg(phase + PI));
    let joints = Joints {
        hip_height_m: STANDING_HIP_M - 0.025 * (2.0 * phase).cos(),
        hips: [left_hip, right_hip],
        knees: [left_knee, right_knee],
        // Arms swing against the legs.
        shoulders: [0.9 * right_hip, 0.9 * left_hip],
        elbows: [0.35 + 0.2 * phase.sin(), 0.35 - 0.2 * phase.sin()],
        spread: [0.12; 2],
        head_turn: 0.15 * (0.5 * phase).sin(),
    };
    add(world_from_figure, &joints, clothes, out);
}

/// Adds a figure that sits still but for its arms and its head.
pub(super) fn sitting(
    world_from_figure: &Se3,
    time_s: f64,
    clothes: &Clothes,
    out: &mut Vec<Solid>,
) {
    let wave = |rate_hz: f64, phase: f64| (TAU * rate_hz * time_s + phase).sin();
    let joints = Joints {
        hip_height_m: SITTING_HIP_M,
        hips: [0.5 * PI - 0.05; 2],
        knees: [0.5 * PI; 2],
        shoulders: [0.6 + 0.35 * wave(0.45, 0.0), 0.7 + 0.3 * wave(0.6, 1.0)],
        elbows: [1.1 + 0.5 * wave(0.8, 0.5), 1.0 + 0.6 * wave(0.7, 2.0)],
        spread: [0.25 + 0.15 * wave(0.4, 0.7), 0.25 + 0.15 * wave(0.35, 1.9)],
        head_turn: 0.6 * wave(0.3, 0.2),
    };
    add(world_from_figure, &joints, clothes, out);
}

/// Limbs as capsules in the figure's axes, then all of it at its pose.
fn add(world_from_figure: &Se3, joints: &Joints, clothes: &Clothes, out: &mut Vec<Solid>) {
    let first = out.len();
    let Clothes { shirt, trousers, shoes } = *clothes;
    let hip = joints.hip_height_m;
    let ellipsoid = |center: [f64; 3], radii: [f64; 3], turn: f64, material| Solid {
        shape: Shape::Ellipsoid(radii.into()),
        world_from_solid: upright(center.into(), turn),
        material,
    };
    let limb = |from: Vector3<f64>, direction: Vector3<f64>, length: f64, radius, material| {
        let to = from + direction * length;
        (to, Solid::capsule(from, to, radius, Vector3::y(), material))
    };
    out.push(ellipsoid([0.0, 0.0, hip + 0.02], [0.13, 0.17, 0.14], 0.0, trousers));
    out.push(ellipsoid([0.0, 0.0, hip + 0.32], [0.13, 0.2, 0.31], 0.0, shirt));
    out.push(ellipsoid(
        [0.01, 0.0, hip + 0.76],
        [0.1, 0.085, 0.13],
        joints.head_turn,
        Material::SKIN,
    ));
    let neck = Vector3::new(0.0, 0.0, hip + 0.58);
    out.push(limb(neck, Vector3::z(), 0.1, 0.055, Material::SKIN).1);
    for (index, side) in [1.0, -1.0].into_iter().enumerate() {
        // Legs: the knee bends backward.
        let (thigh_angle, shin_angle) =
            (joints.hips[index], joints.hips[index] - joints.knees[index]);
        let start = Vector3::new(0.0, side * 0.09, hip);
        let (knee, thigh) = limb(start, swung(thigh_angle, 0.0), THIGH_M, 0.08, trousers);
        let (ankle, shin) = limb(knee, swung(shin_angle, 0.0), SHIN_M, 0.055, trousers);
        let mut foot = ellipsoid([0.0; 3], [0.13, 0.05, 0.045], 0.0, shoes);
        let toes = Vector3::new(0.07, 0.0, -0.02);
        let turned = So3::exp(&Vector3::new(0.0, -0.5 * shin_angle, 0.0));
        foot.world_from_solid = Se3::new(turned, ankle + toes);
        // Arms: the elbow bends forward.
        let spread = side * joints.spread[index];
        let shoulder = Vector3::new(0.0, side * 0.21, hip + 0.52);
        let upper = swung(joints.shoulders[index], spread);
        let lower = swung(joints.shoulders[index] + joints.elbows[index], spread);
        let (elbow, upper_arm) = limb(shoulder, upper, UPPER_ARM_M, 0.055, shirt);
        let (wrist, forearm) = limb(elbow, lower, FOREARM_M, 0.04, shirt);
        let (_, hand) = limb(wrist, lower, 0.09, 0.04, Material::SKIN);
        out.extend([thigh, shin, foot, upper_arm, forearm, hand]);
    }
    for solid in &mut out[first..] {
        solid.world_from_solid = *world_from_figure * solid.world_from_solid;
    }
}

/// The direction of a limb.
fn swung(angle: f64, spread: f64) -> Vector3<f64> {
    Vector3::new(angle.sin(), angle.cos() * spread.sin(), -angle.cos() * spread.cos())
}

/// A path to and fro at constant speed: two straight lines and the half circles between them, in
/// the plane of the floor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Track {
    /// Its middle, in the world, m.
    pub(super) center: [f64; 2],
    /// Direction of the lines, rad from the world's x.
    pub(super) turn_rad: f64,
    /// Half the length of a line, m.
    pub(super) half_line_m: f64,
    /// Of the half circles, m.
    pub(super) radius_m: f64,
}

impl Track {
    /// World from figure, `distance_m` from the middle of the first line.
    pub(super) fn at(&self, distance_m: f64) -> Se3 {
        let (line, arc) = (2.0 * self.half_line_m, PI * self.radius_m);
        let along = (distance_m + self.half_line_m).rem_euclid(2.0 * (line + arc));
        // The second half is the first one, turned by half a circle about the middle.
        let (half_turn, along) =
            if along < line + arc { (0.0, along) } else { (PI, along - line - arc) };
        let (x, y, heading) = if along < line {
            (along - self.half_line_m, -self.radius_m, 0.0)
        } else {
            let angle = (along - line) / self.radius_m;
            let (sine, cosine) = angle.sin_cos();
            (self.half_line_m + self.radius_m * sine, -self.radius_m * cosine, angle)
        };
        let [cx, cy] = self.center;
        let pose = upright(Vector3::new(cx, cy, 0.0), self.turn_rad + half_turn);
        pose * upright(Vector3::new(x, y, 0.0), heading)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_is_walked_at_constant_speed_and_closes() {
        let track = Track { center: [0.3, 1.0], turn_rad: 0.4, half_line_m: 0.8, radius_m: 0.3 };
        let perimeter = 4.0 * 0.8 + TAU * 0.3;
        let step = 1e-3;
        for i in 0..6000 {
            let (a, b) = (track.at(step * f64::from(i)), track.at(step * f64::from(i + 1)));
            let moved = b.translation - a.translation;
            assert!((moved.norm() - step).abs() < 1e-6, "{i}: {}", moved.norm());
            let forward = a.rotation.rotate(&Vector3::x());
            assert!(forward.dot(&moved) / step > 0.999, "{i}: not forward");
        }
        let (first, again) = (track.at(0.1), track.at(0.1 + perimeter));
        assert!((first.translation - again.translation).norm() < 1e-12);
    }

    #[test]
    fn a_figure_stands_on_the_floor_and_is_as_tall_as_people() {
        for distance in [0.0, 0.2, 0.5, 0.9] {
            let mut solids = Vec::new();
            walking(&Se3::identity(), distance, &Clothes::new(1), &mut solids);
            let heights = solids.iter().map(|solid| solid.world_from_solid.translation.z);
            let (low, high) = heights.fold((9.0_f64, 0.0_f64), |(a, b), z| (a.min(z), b.max(z)));
            assert!((0.0..0.2).contains(&low), "{low}");
            assert!((1.6..1.8).contains(&high), "{high}");
        }
    }
}
