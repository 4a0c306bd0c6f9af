//! Points from the bearings of placed keyframes, some of which are of other points.
//!
//! Hypotheses are two rays that nearly meet, a measured depth, and where the point is now; the one that
//! most bearings agree with is refined by [`crate::initialization::triangulate`] over those. A bearing agrees
//! where its whitened reprojection error is within the gate and the point lies in front of its camera.
//! No pose moves.

use nalgebra::Vector3;

use super::Estimate;
use super::bearings::{Bearing, Bearings};
use crate::geometric_verification::Numbers;
use crate::geometry::Se3;
use crate::initialization::{TriangulationOptions, View, triangulate};
use crate::interrupt::Interrupt;
use crate::parallel;

/// Pairs of rays that are tried for a point.
const PAIRS: usize = 24;

/// When a point is one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Acceptance {
    /// Largest whitened reprojection error of a bearing.
    pub(super) gate: f64,
    /// Least angle between two rays, rad; points with depth need none.
    pub(super) min_parallax_rad: f64,
    pub(super) seed: u64,
}

/// Places every landmark anew, as far as it can be, and says which bearings agree. Changes nothing where
/// `interrupt` is due before all are placed.
pub(super) fn triangulate_all(
    bearings: &Bearings,
    estimate: &mut Estimate,
    acceptance: &Acceptance,
    interrupt: &Interrupt,
) {
    let one = |landmark| match interrupt.is_due() {
        true => None,
        false => place(bearings, estimate, landmark, acceptance),
    };
    let placed = parallel::map(0..bearings.of_landmark.len(), one);
    if interrupt.is_due() {
        return;
    }
    estimate.used.fill(false);
    for (landmark, placed) in placed.into_iter().enumerate() {
        let placed = placed.map(|(point, agreeing)| {
            agreeing.iter().for_each(|&s| estimate.used[s as usize] = true);
            point
        });
        estimate.points[landmark] = placed;
    }
}

/// A ray in the world.
struct Ray {
    index: u32,
    center: Vector3<f64>,
    direction: Vector3<f64>,
}

fn place(
    bearings: &Bearings,
    estimate: &Estimate,
    landmark: usize,
    acceptance: &Acceptance,
) -> Option<(Vector3<f64>, Vec<u32>)> {
    let rays: Vec<Ray> = bearings.of_landmark[landmark]
        .iter()
        .filter_map(|&index| {
            let bearing = bearings.get(index);
            let pose = estimate.poses[bearing.pose].as_ref()?;
            let direction = pose.rotation.rotate(&bearing.ray);
            Some(Ray { index, center: pose.translation, direction })
        })
        .collect();
    let mut best: Option<(f64, Vector3<f64>)> = None;
    let mut consider = |point: Vector3<f64>| {
        let support = support(bearings, estimate, &rays, &point, acceptance.gate);
        if best.is_none_or(|(most, _)| support > most) && support > 0.0 {
            best = Some((support, point));
        }
    };
    let now = estimate.points[landmark];
    now.into_iter().for_each(&mut consider);
    for ray in &rays {
        let bearing = bearings.get(ray.index);
        if let (Some((point, ..)), Some(pose)) =
            (bearing.point_in_camera(), &estimate.poses[bearing.pose])
        {
            consider(pose.transform(&point));
        }
    }
    for (i, j) in pairs(rays.len(), acceptance.seed ^ landmark as u64) {
        meeting(&rays[i], &rays[j]).into_iter().for_each(&mut consider);
    }
    let (_, point) = best?;
    let agreeing = agreeing(bearings, estimate, &rays, &point, acceptance.gate);
    let views: Vec<View> =
        agreeing.iter().map(|&index| view(bearings.get(index), estimate)).collect::<Option<_>>()?;
    let has_depth = views.iter().any(|view| view.depth_m.is_some());
    let options = TriangulationOptions {
        min_parallax_rad: acceptance.min_parallax_rad,
        // Each bearing is within the gate already; more would be searched for at great cost.
        max_whitened_rms: 2.0 * acceptance.gate,
        max_whitened_error: 2.0 * acceptance.gate,
    };
    if (views.len() < 2 || parallax(&rays, &agreeing) < acceptance.min_parallax_rad) && !has_depth {
        return None;
    }
    let refined = triangulate(&views, &options).map_or(point, |found| found.point_in_world);
    let of = |point| support(bearings, estimate, &rays, point, acceptance.gate);
    let point = if of(&refined) >= of(&point) { refined } else { point };
    let agreeing = self::agreeing(bearings, estimate, &rays, &point, acceptance.gate);
    let has_depth = agreeing.iter().any(|&index| bearings.get(index).seen.depth_m.is_some());
    let is_enough = agreeing.len() >= 2 || (has_depth && !agreeing.is_empty());
    is_enough.then_some((point, agreeing))
}

/// Pairs of different indices below `count`: all of them where they are few.
fn pairs(count: usize, seed: u64) -> Vec<(usize, usize)> {
    if count * count.saturating_sub(1) / 2 <= PAIRS {
        return (0..count).flat_map(|i| (0..i).map(move |j| (i, j))).collect();
    }
    let mut numbers = Numbers::new(seed);
    let mut draw = |below: usize| ((numbers.share() * below as f64) as usize).min(below - 1);
    (0..PAIRS)
        .map(|_| {
            let i = draw(count);
            (i, (i + 1 + draw(count - 1)) % count)
        })
        .collect()
}

/// The point nearest to two rays, where it lies in front of both.
fn meeting(p: &Ray, q: &Ray) -> Option<Vector3<f64>> {
    let between = q.center - p.center;
    let cosine = p.direction.dot(&q.direction);
    let squared_sine = 1.0 - cosine * cosine;
    let (along_p, along_q) = (between.dot(&p.direction), between.dot(&q.direction));
    let s = (along_p - cosine * along_q) / squared_sine;
    let t = (cosine * along_p - along_q) / squared_sine;
    let point = (p.center + p.direction * s + q.center + q.direction * t) * 0.5;
    (s > 0.0 && t > 0.0 && point.iter().all(|v| v.is_finite())).then_some(point)
}

/// Whitened error of a bearing in the image; infinite behind the camera.
pub(super) fn squared_error(
    bearing: &Bearing,
    pose: &Se3,
    estimate: &Estimate,
    point: &Vector3<f64>,
) -> f64 {
    if pose.inverse_transform(point).z <= 0.0 {
        return f64::INFINITY;
    }
    bearing.seen.squared_error(pose, &estimate.cameras[bearing.camera], point)
}

fn of_ray(bearings: &Bearings, estimate: &Estimate, ray: &Ray, point: &Vector3<f64>) -> f64 {
    let bearing = bearings.get(ray.index);
    estimate.poses[bearing.pose]
        .as_ref()
        .map_or(f64::INFINITY, |pose| squared_error(bearing, pose, estimate, point))
}

fn support(
    bearings: &Bearings,
    estimate: &Estimate,
    rays: &[Ray],
    point: &Vector3<f64>,
    gate: f64,
) -> f64 {
    let gain = |ray| (1.0 - of_ray(bearings, estimate, ray, point) / (gate * gate)).max(0.0);
    rays.iter().map(gain).sum()
}

fn agreeing(
    bearings: &Bearings,
    estimate: &Estimate,
    rays: &[Ray],
    point: &Vector3<f64>,
    gate: f64,
) -> Vec<u32> {
    let agrees = |ray: &&Ray| of_ray(bearings, estimate, ray, point) <= gate * gate;
    rays.iter().filter(agrees).map(|ray| ray.index).collect()
}

fn view(bearing: &Bearing, estimate: &Estimate) -> Option<View> {
    Some(View {
        world_from_camera: estimate.poses[bearing.pose]?,
        camera: estimate.cameras[bearing.camera],
        pixel: bearing.seen.pixel,
        sigma_px: bearing.seen.sigma_px,
        depth_m: bearing.seen.depth_m,
    })
}

/// Largest angle between two of the agreeing rays: of the one farthest from the first, and the one
/// farthest from that, which is at least half of it.
fn parallax(rays: &[Ray], agreeing: &[u32]) -> f64 {
    let mut own = rays.iter().filter(|ray| agreeing.binary_search(&ray.index).is_ok());
    let angle = |p: &Ray, q: &Ray| {
        p.direction.cross(&q.direction).norm().atan2(p.direction.dot(&q.direction))
    };
    let Some(first) = own.clone().next() else { return 0.0 };
    let farthest = |from: &Ray, all: &mut dyn Iterator<Item = &'_ Ray>| -> f64 {
        all.map(|ray| angle(from, ray)).fold(0.0, f64::max)
    };
    let far = own.clone().max_by(|p, q| angle(first, p).total_cmp(&angle(first, q)));
    far.map_or(0.0, |far| farthest(far, &mut own))
}
