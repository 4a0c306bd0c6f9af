//! Which reading of a client's poses and pixels agrees with itself: as they were sent, with the poses
//! inverted, or with the coordinates of the pixels exchanged.
//!
//! Pairs of keyframes that follow each other at 1, 4 and 16 steps are judged by the landmarks that both
//! see. With j_from_i = (R, t) of `odom_from_camera` and rays a and b of a landmark, b must lie in the
//! plane of t and R a, and both depths along the rays must be positive: z = −(b × R a)·(b × t) / |b × R a|²
//! from b × (z R a + t) = 0. Neither needs a measured depth or a map that is right.

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::{Vector2, Vector3};

use super::{LEAST, View, median};
use crate::{EntityId, Observation};

/// Landmarks of a pair that are looked at.
const MOST_MATCHES: usize = 48;
/// With fewer a pair says nothing.
const LEAST_MATCHES: usize = 15;
/// How far a ray may be from its plane, rad; without so much parallax a depth has no sign.
const TOLERANCE: f64 = 0.01;
/// Parallax from which a depth is compared, rad.
const PARALLAX: f64 = 0.02;
/// By how much of the matches one reading must be better than another to win a pair.
const BETTER: f64 = 0.4;
/// Share of the matches that agree where a reading fits.
const FITS: f64 = 0.5;
/// Pairs that a reading other than what was sent must win, and by how many times as many.
const LEAST_WINS: usize = 3;
const MORE_WINS: usize = 4;
/// Pairs after which what was sent is believed, and depths after which their unit is known.
const ENOUGH_PAIRS: usize = 16;
const ENOUGH_RATIOS: usize = 400;

/// How the coordinates of pixels are read.
#[derive(Clone, Copy)]
pub(super) enum Pixels {
    AsSent,
    Swapped,
}

impl Pixels {
    /// The pixel of an observation.
    pub(super) fn of(self, observation: &Observation) -> Vector2<f64> {
        let pixel = observation.pixel;
        match self {
            Self::AsSent => pixel,
            Self::Swapped => Vector2::new(pixel.y, pixel.x),
        }
    }
}

/// What the pairs of a client's keyframes say.
#[derive(Default)]
pub(super) struct Motions {
    pairs: usize,
    /// Pairs in which what was sent fits.
    fitting: usize,
    /// Pairs in which it is better than inverted poses.
    sent: usize,
    inverted: usize,
    swapped: usize,
    /// Measured depths over those by parallax and odometry, where what was sent fits.
    depth_ratios: Vec<f64>,
}

impl Motions {
    /// Of views at the poses of the odometry.
    pub(super) fn of(views: &[View<'_>]) -> Self {
        let mut motions = Self::default();
        for (j, newer) in views.iter().enumerate() {
            for step in [1, 4, 16].into_iter().filter(|step| j % step == 0) {
                if let Some(older) = j.checked_sub(step).and_then(|i| views.get(i)) {
                    motions.add(older, newer);
                }
            }
            if motions.sent >= ENOUGH_PAIRS && motions.depth_ratios.len() >= ENOUGH_RATIOS {
                break;
            }
        }
        motions
    }

    /// Adds what a pair says.
    fn add(&mut self, a: &View<'_>, b: &View<'_>) {
        let matches = matches(a, b);
        let (pose_a, pose_b) = (a.world_from_camera, b.world_from_camera);
        let rays = rays(a, b, &matches, Pixels::AsSent);
        if rays.len() < LEAST_MATCHES {
            return;
        }
        self.pairs += 1;
        let b_from_a = pose_b.inverse().compose(&pose_a);
        let sent = agreement(&b_from_a, &rays);
        let inverted = agreement(&pose_b.compose(&pose_a.inverse()), &rays);
        let swapped = match sent < FITS {
            true => agreement(&b_from_a, &self::rays(a, b, &matches, Pixels::Swapped)),
            false => 0.0,
        };
        self.fitting += usize::from(sent > FITS);
        self.sent += usize::from(sent > inverted + BETTER);
        self.inverted += usize::from(inverted > sent.max(swapped) + BETTER);
        self.swapped += usize::from(swapped > sent.max(inverted) + BETTER);
        if sent > FITS {
            let ratios = rays.iter().filter_map(|rays| rays.depth_ratio(&b_from_a));
            self.depth_ratios.extend(ratios);
        }
    }

    fn is_won(&self, wins: usize, others: usize) -> bool {
        wins >= LEAST_WINS && wins >= MORE_WINS * self.sent && wins > others
    }

    /// Whether the pixels agree with the inverse of the poses.
    pub(super) fn are_inverted(&self) -> bool {
        self.is_won(self.inverted, self.swapped)
    }

    /// Whether the poses agree with pixels whose coordinates are exchanged.
    pub(super) fn are_swapped(&self) -> bool {
        self.is_won(self.swapped, self.inverted)
    }

    /// How many times as long measured depths are as those by parallax, where poses and pixels agree.
    pub(super) fn depth_ratio(&self) -> Option<f64> {
        let fits = 2 * self.fitting > self.pairs && self.depth_ratios.len() >= LEAST;
        fits.then(|| median(self.depth_ratios.clone())).flatten()
    }
}

/// Observations of landmarks that both see.
fn matches<'a>(a: &View<'a>, b: &View<'a>) -> Vec<(&'a Observation, &'a Observation)> {
    let (seen, others) = (a.observations, b.observations);
    // Most landmarks of neighbors are common: some are looked for until enough are found.
    let step = seen.len().div_ceil(4 * MOST_MATCHES).max(1);
    let mut last: Option<EntityId> = None;
    let common = seen.iter().step_by(step).filter_map(|observation| {
        // A second feature on the same landmark says the same.
        let is_new = last.replace(observation.landmark) != Some(observation.landmark);
        Some((observation, others.of(observation.landmark).filter(|_| is_new)?))
    });
    common.take(MOST_MATCHES).collect()
}

/// The rays of a landmark in two keyframes.
struct Rays {
    a: Vector3<f64>,
    b: Vector3<f64>,
    /// The depth that was measured in the first one.
    depth: Option<f64>,
}

fn rays(
    a: &View<'_>,
    b: &View<'_>,
    matches: &[(&Observation, &Observation)],
    pixels: Pixels,
) -> Vec<Rays> {
    let ray = |view: &View<'_>, observation: &Observation| {
        let ray = view.camera.camera.unproject(&pixels.of(observation))?;
        ray.try_normalize(f64::MIN_POSITIVE).filter(|ray| ray.iter().all(|x| x.is_finite()))
    };
    let both = matches.iter().filter_map(|(in_a, in_b)| {
        let depth = in_a.depth.map(|depth| depth.depth_m);
        Some(Rays { a: ray(a, in_a)?, b: ray(b, in_b)?, depth })
    });
    both.collect()
}

/// The share of rays that agree with a motion.
fn agreement(b_from_a: &Se3, rays: &[Rays]) -> f64 {
    let agreeing = rays.iter().filter(|rays| rays.agree(b_from_a)).count();
    agreeing as f64 / rays.len().max(1) as f64
}

impl Rays {
    /// Depth along the ray in a, and the sine of the parallax.
    fn depth_along(&self, b_from_a: &Se3) -> (f64, f64) {
        let turned = b_from_a.rotation.act(&self.a);
        let across = self.b.cross(&turned);
        let z = -across.dot(&self.b.cross(&b_from_a.translation)) / across.norm_squared();
        (z, across.norm())
    }

    fn agree(&self, b_from_a: &Se3) -> bool {
        let turned = b_from_a.rotation.act(&self.a);
        let (z, parallax) = self.depth_along(b_from_a);
        if parallax < TOLERANCE {
            return self.b.dot(&turned) > 0.0;
        }
        let t = b_from_a.translation;
        let normal = t.cross(&turned);
        // Where the camera moves along the ray every plane through it is right.
        let off = self.b.dot(&normal).abs() / normal.norm();
        let in_front = z > 0.0 && (turned * z + t).dot(&self.b) > 0.0;
        in_front && (off < TOLERANCE || off.is_nan())
    }

    /// The measured depth over that by parallax.
    fn depth_ratio(&self, b_from_a: &Se3) -> Option<f64> {
        let (z, parallax) = self.depth_along(b_from_a);
        let along_axis = z * self.a.z;
        let is_known = parallax > PARALLAX && along_axis > 0.0 && self.agree(b_from_a);
        let ratio = self.depth? / along_axis;
        (is_known && ratio.is_finite()).then_some(ratio)
    }
}
