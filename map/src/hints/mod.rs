//! Mistakes that the data of a client look like: other units, poses the wrong way round, pixels that are
//! exchanged or of another image, a clock that went back.
//!
//! Everything here is judged by what the client sent (pixels, depths, `odom_from_camera`, times), but for
//! landmarks behind the camera. Only the first keyframes are looked at, so that the work has a bound, and
//! nothing is refused: a hint is for people. Intrinsics are not judged: on recorded data the focal length
//! that best explains depths and pixels is off by as much as a mistake of 5 % would be.

mod motion;

use covis_solvers::geometry::{Camera, LieGroup};

use super::{ClientIndex, Keyframe, Map, Observation, View};
use motion::{Motions, Pixels};

/// Clients that are looked at.
const MOST_CLIENTS: u32 = 32;
/// First keyframes of each that are looked at.
const MOST_KEYFRAMES: usize = 128;
/// Observations of a keyframe that are looked at, spread over all that it has.
const MOST_OBSERVATIONS: usize = 64;
/// With fewer measurements nothing is said.
const LEAST: usize = 50;
/// A unit that is off by less is not a mistake that can be told from noise.
const UNIT_FACTOR: f64 = 3.0;
/// No camera measures depths like these, m.
const FAR_M: f64 = 300.0;
/// Share of pixels outside the image, and of landmarks behind the camera, above which something is wrong.
const MOST_OUTSIDE: f64 = 0.1;
const MOST_BEHIND: f64 = 0.2;
/// The same for pixels that exchanged coordinates bring back into the image, nearly all of them.
const MOST_OUTSIDE_IF_SWAPPED: f64 = 0.02;
const MOST_LEFT_OUTSIDE: f64 = 0.002;

/// What a client may have done wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum HintKind {
    /// Measured depths have another unit of length than `odom_from_camera`.
    DepthUnit,
    /// Measured depths are longer than any camera measures.
    SceneSize,
    /// `camera_from_world` was sent as `world_from_camera`.
    PosesInverted,
    /// Pixels are (row, column).
    PixelsSwapped,
    /// Many pixels are outside the image.
    PixelsOutsideImage,
    /// Many landmarks are behind the cameras that see them.
    LandmarksBehindCamera,
    /// The newest keyframes by arrival were captured before an earlier one.
    ClockWentBack,
}

/// A mistake that the data of a client look like.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hint {
    /// Which mistake.
    pub kind: HintKind,
    /// The client that sent the data.
    pub client: ClientIndex,
    /// A sentence for people, with the figures.
    pub text: String,
}

impl Map {
    /// The mistakes that the data look like, by client, then kind. Takes some milliseconds.
    pub fn hints(&self) -> Vec<Hint> {
        let clients = (0..MOST_CLIENTS).zip(self.clients()).map(|(index, _)| ClientIndex(index));
        let of = |client| {
            let keyframes = self.first_keyframes(client);
            let mut found: Vec<(HintKind, String)> = self.views_hints(&keyframes);
            found.extend(self.clock_hint(client));
            found.sort_unstable_by_key(|&(kind, _)| kind);
            found.into_iter().map(move |(kind, text)| Hint { kind, client, text })
        };
        clients.flat_map(of).collect()
    }

    /// The first keyframes of a client that see something.
    fn first_keyframes(&self, client: ClientIndex) -> Vec<&Keyframe> {
        let first = self.keyframes().range(client.ids()).take(2 * MOST_KEYFRAMES);
        let seeing = first.map(|(_, k)| k).filter(|keyframe| !keyframe.observations.is_empty());
        seeing.take(MOST_KEYFRAMES).collect()
    }

    fn views_hints(&self, keyframes: &[&Keyframe]) -> Vec<(HintKind, String)> {
        let mut found = Vec::new();
        let views: Vec<View<'_>> = keyframes.iter().flat_map(|k| self.views(k)).collect();
        let views = &*views;
        let by_odometry = keyframes.iter().flat_map(|k| self.views_at(k, k.odom_from_camera));
        let motions = Motions::of(&by_odometry.collect::<Vec<_>>());
        let image = ImageShares::of(views);
        if motions.are_inverted() {
            let text = "the pixels agree with the inverse of odom_from_camera and not with itself: \
                        world_from_camera is expected, not camera_from_world";
            found.push((HintKind::PosesInverted, text.to_owned()));
        } else if motions.are_swapped() || image.is_swapped() {
            let text =
                "the pixels agree with (row, column) and not with (column, row), which is expected";
            found.push((HintKind::PixelsSwapped, text.to_owned()));
        } else {
            found.extend(unit_hint(&motions).or_else(|| size_hint(views)));
            // Landmarks that were placed by wrong depths are anywhere.
            if found.is_empty() {
                found.extend(self.behind_hint(views));
            }
        }
        if found.iter().all(|&(kind, _)| kind != HintKind::PixelsSwapped) {
            found.extend(image.hint());
        }
        found
    }

    fn behind_hint(&self, views: &[View<'_>]) -> Option<(HintKind, String)> {
        let (mut count, mut behind) = (0_usize, 0_usize);
        // A fisheye may see what is behind it.
        for view in views.iter().filter(|view| !matches!(view.camera.camera, Camera::Fisheye(_))) {
            let camera_from_world = view.world_from_camera.inverse();
            for observation in some_observations(view) {
                let landmark = self.landmarks().get(&observation.landmark);
                if let Some(point) = landmark.and_then(|landmark| landmark.position) {
                    count += 1;
                    behind += usize::from(camera_from_world.act(&point).z <= 0.0);
                }
            }
        }
        let share = share(behind, count)?;
        (share > MOST_BEHIND).then(|| {
            let text = format!(
                "{:.0} % of the landmarks lie behind the cameras that see them: poses, pixels or \
                 positions are not in the frames that covis expects",
                100.0 * share
            );
            (HintKind::LandmarksBehindCamera, text)
        })
    }

    fn clock_hint(&self, client: ClientIndex) -> Option<(HintKind, String)> {
        let late = self.late_run(client)?;
        let text = format!(
            "the last {} keyframes were captured {:.3} s or more before keyframe {}, which arrived \
             earlier: the clock went back, or that time is wrong; map_from_odom follows the last ones",
            late.count,
            late.gap_ns as f64 * 1e-9,
            late.before.id
        );
        Some((HintKind::ClockWentBack, text))
    }
}

/// Some of the observations of a view, spread over all.
fn some_observations<'a>(view: &View<'a>) -> impl Iterator<Item = &'a Observation> + use<'a> {
    let all = view.observations;
    all.iter().step_by(all.len().div_ceil(MOST_OBSERVATIONS).max(1))
}

/// Measured depths against the lengths that parallax and odometry make of them.
fn unit_hint(motions: &Motions) -> Option<(HintKind, String)> {
    let ratio = motions.depth_ratio()?;
    let is_off = !(1.0 / UNIT_FACTOR..=UNIT_FACTOR).contains(&ratio);
    let millimeters = match ratio {
        300.0..3000.0 => "; depths in millimeters?",
        _ if (0.000_3..0.003).contains(&ratio) => "; poses in millimeters?",
        _ => "",
    };
    is_off.then(|| {
        let text = format!(
            "measured depths are typically {} as long as odom_from_camera makes them by parallax: both \
             must be in meters{millimeters}",
            if ratio >= 1.0 { format!("{ratio:.1} times") } else { format!("{ratio:.4} times") }
        );
        (HintKind::DepthUnit, text)
    })
}

/// Measured depths against what cameras measure.
fn size_hint(views: &[View<'_>]) -> Option<(HintKind, String)> {
    let observations = views.iter().flat_map(some_observations);
    let depths = observations.filter_map(|seen| seen.depth.map(|depth| depth.depth_m)).collect();
    let depth = median(depths)?;
    (depth > FAR_M).then(|| {
        let text = format!(
            "measured depths are typically {depth:.0} m: no camera measures that far; millimeters?"
        );
        (HintKind::SceneSize, text)
    })
}

/// How many pixels are outside their images, as they were sent and with exchanged coordinates.
#[derive(Default)]
struct ImageShares {
    count: usize,
    outside: usize,
    outside_if_swapped: usize,
}

impl ImageShares {
    fn of(views: &[View<'_>]) -> Self {
        let mut shares = Self::default();
        for view in
            views.iter().filter(|view| view.camera.width_px > 0 && view.camera.height_px > 0)
        {
            let (width, height) =
                (f64::from(view.camera.width_px), f64::from(view.camera.height_px));
            let is_outside = |u: f64, v: f64| {
                !(-0.5..=width - 0.5).contains(&u) || !(-0.5..=height - 0.5).contains(&v)
            };
            for observation in some_observations(view) {
                let pixel = Pixels::AsSent.of(observation);
                shares.count += 1;
                shares.outside += usize::from(is_outside(pixel.x, pixel.y));
                shares.outside_if_swapped += usize::from(is_outside(pixel.y, pixel.x));
            }
        }
        shares
    }

    /// Whether the coordinates look exchanged: a part is outside the image, and exchanged none is.
    fn is_swapped(&self) -> bool {
        let outside = share(self.outside, self.count);
        let swapped = share(self.outside_if_swapped, self.count);
        outside.is_some_and(|share| share > MOST_OUTSIDE_IF_SWAPPED)
            && swapped.is_some_and(|share| share < MOST_LEFT_OUTSIDE)
    }

    fn hint(&self) -> Option<(HintKind, String)> {
        let share = share(self.outside, self.count)?;
        (share > MOST_OUTSIDE).then(|| {
            let text = format!(
                "{:.0} % of the pixels lie outside the image: the camera states another size, or \
                 the pixels are of another image",
                100.0 * share
            );
            (HintKind::PixelsOutsideImage, text)
        })
    }
}

/// A share of enough measurements.
fn share(part: usize, count: usize) -> Option<f64> {
    (count >= LEAST).then(|| part as f64 / count as f64)
}

/// The median of enough measurements.
fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (values.len() >= LEAST).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
