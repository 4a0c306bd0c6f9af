//! The scenes: what is static, what moves and how, where the camera is, and how it is exposed.
//!
//! Everything is a function of time, so that frames can be drawn in any order.

use std::f64::consts::TAU;
use std::fmt;
use std::str::FromStr;

use covis_solvers::geometry::Se3;
use nalgebra::Vector3;

use super::figure::{self, Clothes, Track};
use super::material::{Kind, Material};
use super::motion::Hand;
use super::solid::Solid;
use super::{random, room};

/// How long the camera takes for a round.
const ROUND_S: f64 = 6.0;
/// Half the axes of its way, m.
const WAY_M: [f64; 2] = [1.5, 0.9];
/// How far ahead of it people are, rad.
const AHEAD: f64 = 1.6;
/// Where it looks, from the room's middle outward, rad: along its way, and a little outward.
const FOLLOWING_YAW: f64 = 2.0;

/// A scene by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SceneName {
    /// A room, seen by a camera that is held in a hand.
    Static,
    /// Two people who walk to and fro in front of the camera.
    Walking,
    /// Someone who sits and gestures.
    Sitting,
    /// A carton that is pushed for a while, then stays.
    Pushed,
    /// The gain and the offset of the colors change.
    Exposure,
    /// The camera turns once around the room.
    Loop,
    /// The camera is covered for a second in the middle: black and without depth.
    Covered,
    /// The camera follows two people who walk around the room, twice.
    Rounds,
}

impl SceneName {
    /// All scenes.
    pub const ALL: [Self; 8] = [
        Self::Static,
        Self::Walking,
        Self::Sitting,
        Self::Pushed,
        Self::Exposure,
        Self::Loop,
        Self::Covered,
        Self::Rounds,
    ];

    /// The name that a user types.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Walking => "walking",
            Self::Sitting => "sitting",
            Self::Pushed => "pushed",
            Self::Exposure => "exposure",
            Self::Loop => "loop",
            Self::Covered => "covered",
            Self::Rounds => "rounds",
        }
    }
}

impl fmt::Display for SceneName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// A name that no scene has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no scene `{name}`; the scenes are {}", SceneName::ALL.map(SceneName::as_str).join(", "))]
pub struct UnknownScene {
    /// What was asked for.
    pub name: String,
}

impl FromStr for SceneName {
    type Err = UnknownScene;

    fn from_str(name: &str) -> Result<Self, UnknownScene> {
        let found = Self::ALL.into_iter().find(|scene| scene.as_str() == name);
        found.ok_or_else(|| UnknownScene { name: name.to_owned() })
    }
}

/// Someone who walks.
#[derive(Clone, Copy, Debug)]
struct Walker {
    track: Track,
    speed_m_s: f64,
    start_m: f64,
    clothes: Clothes,
}

/// A scene with its random choices made.
#[derive(Clone, Debug)]
pub(super) struct Scene {
    name: SceneName,
    seed: u64,
    /// From the first frame to the last.
    duration_s: f64,
    standing: Vec<Solid>,
    walkers: Vec<Walker>,
    hand: Hand,
}

/// How a sensor turns light into gray levels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Exposure {
    pub(super) gain: f32,
    /// Gray levels.
    pub(super) offset: f32,
}

impl Scene {
    pub(super) fn new(name: SceneName, seed: u64, duration_s: f64) -> Self {
        // Scenes of one seed share the room, not what happens in it.
        let own = random::number(seed, name as u64);
        let mut scene = Self {
            name,
            seed: own,
            duration_s,
            standing: room::furnished(seed),
            walkers: Vec::new(),
            hand: Hand::new(own, hand_strength(name)),
        };
        match name {
            SceneName::Walking => scene.walkers = [0, 1].map(|index| scene.walker(index)).to_vec(),
            SceneName::Sitting => scene.standing.extend(chair()),
            SceneName::Static
            | SceneName::Pushed
            | SceneName::Exposure
            | SceneName::Loop
            | SceneName::Covered
            | SceneName::Rounds => {}
        }
        scene
    }

    fn walker(&self, index: u8) -> Walker {
        let number =
            |i| random::uniform(random::number(self.seed, 100 + 10 * u64::from(index) + i));
        let side = if index == 0 { 1.0 } else { -1.0 };
        let track = Track {
            center: [0.2 * side, -0.1 + 0.7 * f64::from(index)],
            turn_rad: 0.25 * (number(0) - 0.5) + if index == 0 { 0.0 } else { TAU / 2.0 },
            half_line_m: 0.7 + 0.3 * number(1),
            radius_m: 0.22,
        };
        let speed_m_s = 0.4 + 0.8 * number(2);
        let clothes = Clothes::new((self.seed as u32 >> 8) + u32::from(index));
        Walker { track, speed_m_s, start_m: 5.0 * number(3), clothes }
    }

    /// All solids at a time, always in the same order; the first is the room.
    pub(super) fn solids(&self, time_s: f64) -> Vec<Solid> {
        let mut solids = self.standing.clone();
        for walker in &self.walkers {
            let distance = walker.start_m + walker.speed_m_s * time_s;
            figure::walking(&walker.track.at(distance), distance, &walker.clothes, &mut solids);
        }
        if self.name == SceneName::Sitting {
            let seat = super::solid::upright(Vector3::new(0.35, 0.65, 0.0), -TAU / 4.0 - 0.4);
            figure::sitting(&seat, time_s, &Clothes::new(self.seed as u32 >> 8), &mut solids);
        }
        if self.name == SceneName::Pushed {
            solids.extend(self.carton(time_s));
        }
        if self.name == SceneName::Rounds {
            for index in 0..2 {
                self.followed(index, time_s, &mut solids);
            }
        }
        solids
    }

    /// Someone who walks ahead of the camera, now nearer to it and now farther away.
    fn followed(&self, index: u8, time_s: f64, solids: &mut Vec<Solid>) {
        let number =
            |i| random::uniform(random::number(self.seed, 200 + 10 * u64::from(index) + i));
        let sway = |rate_hz: f64, i| (TAU * (rate_hz * time_s + number(i))).sin();
        let side = if index == 0 { -1.0 } else { 1.0 };
        let angle = around(time_s) + AHEAD + 0.12 * side + 0.1 * sway(0.31, 0);
        let scale = 1.0 + 0.14 * side + 0.05 * sway(0.23, 1);
        let position = on_the_way(angle, scale);
        let direction = on_the_way(angle + 1e-3, scale) - position;
        let figure = super::solid::upright(position, direction.y.atan2(direction.x));
        let clothes = Clothes::new((self.seed as u32 >> 8) + u32::from(index));
        figure::walking(&figure, WAY_M[0] * angle, &clothes, solids);
    }

    /// A carton with a bag on it: rests, is pushed across the view, rests.
    fn carton(&self, time_s: f64) -> [Solid; 2] {
        let push_s = (0.35 * self.duration_s).min(3.0);
        let share = ((time_s - 0.25 * self.duration_s) / push_s.max(1e-9)).clamp(0.0, 1.0);
        // Without jerks at both ends.
        let moved_m = 0.4 * push_s * share * share * (3.0 - 2.0 * share);
        let x = -0.6 + moved_m;
        let seed = self.seed as u32;
        let carton =
            Material { kind: Kind::Poster, dark: [0.2, 0.1, 0.03], light: [0.95, 0.8, 0.6], seed };
        let bag = Material { kind: Kind::Cloth, dark: [0.3, 0.05, 0.1], light: [0.9; 3], seed };
        [
            Solid::upright_box([x, 0.55, 0.35], [0.55, 0.5, 0.7], 0.3 + 0.3 * moved_m, carton),
            Solid::ball([x, 0.55, 0.86], 0.17, bag),
        ]
    }

    /// Where the camera is: world from camera.
    pub(super) fn world_from_camera(&self, time_s: f64) -> Se3 {
        if self.name == SceneName::Loop {
            let yaw = TAU * time_s / self.duration_s;
            let position = Vector3::new(0.7 * yaw.sin(), 0.55 * yaw.cos() - 0.1, 1.25);
            return self.hand.held(position, yaw, -0.12, time_s);
        }
        if self.name == SceneName::Rounds {
            let angle = around(time_s);
            let position = on_the_way(angle, 1.0) + Vector3::new(0.0, 0.0, 1.35);
            return self.hand.held(position, angle + FOLLOWING_YAW, -0.12, time_s);
        }
        self.hand.held(Vector3::new(0.0, -1.45, 1.3), 0.0, -0.15, time_s)
    }

    pub(super) fn exposure(&self, time_s: f64) -> Exposure {
        if self.name != SceneName::Exposure {
            return Exposure { gain: 1.0, offset: 0.0 };
        }
        let wave = |period_s: f64| (TAU * time_s / period_s).sin() as f32;
        Exposure { gain: 1.0 + 0.3 * wave(3.1), offset: 10.0 * wave(2.3) }
    }

    /// Whether something covers the camera.
    pub(super) fn is_covered(&self, time_s: f64) -> bool {
        self.name == SceneName::Covered && (time_s - 0.5 * self.duration_s).abs() < 0.5
    }
}

/// How far around the room the camera has come, rad.
fn around(time_s: f64) -> f64 {
    TAU * time_s / ROUND_S
}

/// A point on the floor on the way around the room, clockwise from the desk; `scale` 1 is the camera's way.
fn on_the_way(angle: f64, scale: f64) -> Vector3<f64> {
    Vector3::new(scale * WAY_M[0] * angle.sin(), scale * WAY_M[1] * angle.cos() - 0.1, 0.0)
}

/// How strongly the hand sways that holds the camera.
fn hand_strength(name: SceneName) -> f64 {
    if name == SceneName::Loop {
        0.35
    } else if name == SceneName::Rounds {
        0.9
    } else {
        1.0
    }
}

/// What the sitting figure sits on.
fn chair() -> [Solid; 3] {
    let cloth =
        Material { kind: Kind::Cloth, dark: [0.05, 0.1, 0.1], light: [0.5, 0.7, 0.6], seed: 5 };
    let metal = Material { kind: Kind::Plain, dark: [0.1; 3], light: [0.6; 3], seed: 6 };
    let turn = -0.4;
    [
        Solid::upright_box([0.35, 0.65, 0.39], [0.46, 0.46, 0.06], turn, cloth),
        Solid::upright_box([0.43, 0.87, 0.75], [0.42, 0.06, 0.5], turn, cloth),
        Solid::upright_box([0.35, 0.65, 0.18], [0.08, 0.08, 0.36], turn, metal),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_and_the_error_of_others_lists_the_names() {
        for scene in SceneName::ALL {
            assert_eq!(scene.to_string().parse(), Ok(scene));
        }
        let error = "beach".parse::<SceneName>().unwrap_err().to_string();
        assert!(error.starts_with("there is no scene `beach`; the scenes are static, walking"));
    }

    #[test]
    fn walkers_keep_their_distance_from_the_camera_and_cross_its_view() {
        for seed in 0..20 {
            let scene = Scene::new(SceneName::Walking, seed, 10.0);
            for walker in &scene.walkers {
                assert!((0.4..=1.2).contains(&walker.speed_m_s));
            }
            for i in 0..300 {
                let time_s = f64::from(i) / 30.0;
                let camera = scene.world_from_camera(time_s).translation;
                for walker in &scene.walkers {
                    let distance = walker.start_m + walker.speed_m_s * time_s;
                    let position = walker.track.at(distance).translation;
                    assert!((position - camera).xy().norm() > 0.7, "seed {seed}, {time_s} s");
                    assert!(position.y < 1.2, "inside the desk: {position}");
                }
            }
        }
    }

    #[test]
    fn people_who_are_followed_stay_in_the_room_and_ahead_of_the_camera() {
        for seed in 0..20 {
            let scene = Scene::new(SceneName::Rounds, seed, 12.0);
            let standing = scene.standing.len();
            for i in 0..360 {
                let time_s = f64::from(i) / 30.0;
                let camera = scene.world_from_camera(time_s).translation;
                let solids = scene.solids(time_s);
                assert!(solids.len() > standing);
                for solid in &solids[standing..] {
                    let position = solid.world_from_solid.translation;
                    let [x, y, _] = room::HALF_ROOM_M;
                    assert!(
                        position.x.abs() < x && position.y.abs() < y,
                        "{seed}, {time_s} s: {position}"
                    );
                    let distance = (position - camera).xy().norm();
                    assert!((0.35..3.2).contains(&distance), "{seed}, {time_s} s: {distance} m");
                }
            }
            let [first, second] = [2.0, 2.0 + ROUND_S].map(around);
            assert!((second - first - TAU).abs() < 1e-12);
        }
    }

    #[test]
    fn a_pushed_carton_rests_before_and_after() {
        let scene = Scene::new(SceneName::Pushed, 1, 8.0);
        let x = |time_s| scene.carton(time_s)[0].world_from_solid.translation.x;
        assert_eq!(x(0.0), x(2.0));
        assert!(x(4.0) > x(2.0) + 0.3);
        assert_eq!(x(5.0), x(8.0));
    }
}
