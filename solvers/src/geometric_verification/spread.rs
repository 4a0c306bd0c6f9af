//! How much of what a pose shows agrees with it.
//!
//! Where a pose is right, landmarks match wherever it has them in the image. A thing that exists twice
//! matches at the wrong pose too, and what is around it does not: there matches are much more frequent near
//! a match than anywhere. How many landmarks a detector finds again does not matter for that, nor what is
//! hidden. Decides nothing.

use nalgebra::{Vector2, Vector3};

use super::consensus::Projected;
use super::patches::{apart, extent, grain};
use super::{Input, Options, guided};
use crate::geometry::{LieGroup, Se3, So3};
use crate::point_matching::Likeness;

/// Landmarks around a match that tell how frequent matches are there: fewer than a piece of furniture has.
const AROUND: usize = 8;
/// Fewer matches do not tell how frequent they are.
const FEWEST: usize = 8;
/// Turns of the camera whose matches are chance alone, rad: further than a gate reaches, and so little
/// that most of the same landmarks are in the image.
const TURN: f64 = 0.15;
const TURNS: [[f64; 2]; 4] = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];

/// A landmark as a pose has it in the image.
struct Predicted {
    /// Pixel over the focal length, and the logarithm of the depth: what belongs together is near in all.
    position: Vector3<f64>,
    is_matched: bool,
}

/// The landmarks that a pose has in the image, one of each patch, those that match first.
fn predicted(input: &Input<'_>, pose: &Se3, pairs: &[(usize, usize)]) -> Vec<Predicted> {
    let (low, size) = extent(input.features);
    let inverse = pose.inverse();
    let (b_from_a, origin) = (inverse.rotation.matrix(), inverse.translation);
    let mut is_matched = vec![false; input.points.len()];
    pairs.iter().for_each(|&(point, _)| is_matched[point] = true);
    let focal = input.camera.mean_focal_px();
    let mut seen: Vec<(Vector2<f64>, Predicted)> = Vec::new();
    for (estimate, is_matched) in input.points.iter().zip(is_matched) {
        let Some(at) = Projected::new(input.camera, estimate, &b_from_a, &origin) else { continue };
        let share = (at.pixel - low).component_div(&size);
        if !share.iter().all(|share| (0.0..=1.0).contains(share)) {
            continue;
        }
        let position = (at.pixel / focal).push(at.depth.ln());
        seen.push((at.pixel, Predicted { position, is_matched }));
    }
    // Of one patch any landmark that matches stands for it.
    let thin = |seen: Vec<(Vector2<f64>, Predicted)>| {
        let pixels: Vec<Vector2<f64>> = seen.iter().map(|(pixel, _)| *pixel).collect();
        let mut is_kept = vec![false; seen.len()];
        apart(&pixels, grain(input.features)).into_iter().for_each(|k| is_kept[k] = true);
        seen.into_iter().zip(is_kept).filter_map(|(seen, is_kept)| is_kept.then_some(seen.1))
    };
    let (matched, others): (Vec<_>, Vec<_>) = seen.into_iter().partition(|(_, p)| p.is_matched);
    thin(matched).chain(thin(others)).collect()
}

/// Share of the landmarks that a pose has in the image among which matches are as frequent as around a
/// match: about 1 where the pose is right, and little more than the share of the part that matches where
/// it is not. 1 where too few match to tell. `pairs` (point, feature) agree with the pose.
pub(super) fn explained(
    input: &Input<'_>,
    pairs: &[(usize, usize)],
    pose: &Se3,
    likeness: &dyn Fn(usize, usize) -> Likeness,
    options: &Options,
) -> f64 {
    let mut all = guided::search(input, pairs, pose, likeness, options);
    all.extend_from_slice(pairs);
    let seen = predicted(input, pose, &all);
    let matched = seen.iter().filter(|p| p.is_matched).count();
    if matched < FEWEST || seen.len() <= AROUND {
        return 1.0;
    }
    let (mut by_chance, mut tried) = (0, 0);
    for [x, y] in TURNS {
        let turn = So3::exp(&Vector3::new(x * TURN, y * TURN, 0.0));
        let turned = pose.compose(&Se3::new(turn, Vector3::zeros()));
        let pairs = guided::search(input, &[], &turned, likeness, options);
        let seen = predicted(input, &turned, &pairs);
        by_chance += seen.iter().filter(|p| p.is_matched).count();
        tried += seen.len();
    }
    let chance = by_chance as f64 / tried.max(1) as f64;
    let (mut distances, mut around) = (Vec::with_capacity(seen.len()), 0);
    for (k, one) in seen.iter().enumerate().filter(|(_, p)| p.is_matched) {
        distances.clear();
        let others = seen.iter().enumerate().filter(|&(other, _)| other != k);
        let distance = |p: &Predicted| (p.position - one.position).norm_squared();
        distances.extend(others.map(|(other, p)| (distance(p), other)));
        distances
            .select_nth_unstable_by(AROUND - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        around += distances[..AROUND].iter().filter(|&&(_, other)| seen[other].is_matched).count();
    }
    let local = around as f64 / (matched * AROUND) as f64 - chance;
    let anywhere = (matched - 1) as f64 / (seen.len() - 1) as f64 - chance;
    if local > 0.0 { (anywhere / local).max(0.0) } else { 1.0 }
}
