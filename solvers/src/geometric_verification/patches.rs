//! What is one patch of an image: matches in it are one piece of evidence.
//!
//! A detector finds a corner on several levels of a pyramid, and neighboring corners have most of their
//! patches in common: such matches are right or wrong together, and count once. Decides nothing.

use nalgebra::{SVector, Vector2, Vector3};

use super::consensus::Weighted;
use super::{Feature, Input};

/// Features closer to each other than this share of the image have most of their patches in common: those
/// of ORB are 31 of 640 pixels wide at the first level.
const GRAIN: f64 = 1.0 / 64.0;

/// The rectangle that features take: its lower corner and its size, each at least 1 px.
pub(super) fn extent(features: &[Feature]) -> (Vector2<f64>, Vector2<f64>) {
    let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(-f64::INFINITY));
    for feature in features {
        (low, high) = (low.inf(&feature.pixel), high.sup(&feature.pixel));
    }
    (low, (high - low).sup(&Vector2::repeat(1.0)))
}

/// Size of a patch in the image of the features, px.
pub(super) fn grain(features: &[Feature]) -> f64 {
    GRAIN * extent(features).1.max()
}

/// Indices, rising, of positions of which no two are within `radius`.
pub(super) fn apart<const N: usize>(positions: &[SVector<f64, N>], radius: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..positions.len()).collect();
    order.sort_by(|&a, &b| positions[a][0].total_cmp(&positions[b][0]).then(a.cmp(&b)));
    let mut kept: Vec<usize> = Vec::new();
    for k in order {
        let is_near = |&other: &usize| positions[k][0] - positions[other][0] < radius;
        let mut near = kept.iter().rev().copied().take_while(is_near);
        if near.all(|other| (positions[k] - positions[other]).norm() >= radius) {
            kept.push(k);
        }
    }
    kept.sort_unstable();
    kept
}

/// Indices, rising, of matches of which no two are of one patch, neither in the query nor as the candidate
/// sees them.
pub(super) fn independent(input: &Input<'_>, matches: &[Weighted]) -> Vec<usize> {
    let grain = grain(input.features);
    let pixels: Vec<Vector2<f64>> = matches.iter().map(|m| m.seen.pixel).collect();
    let first = apart(&pixels, grain);
    let direction = |&k: &usize| {
        matches[k].seen.landmark.point.try_normalize(f64::MIN_POSITIVE).unwrap_or_default()
    };
    let directions: Vec<Vector3<f64>> = first.iter().map(direction).collect();
    let second = apart(&directions, grain / input.camera.mean_focal_px());
    second.into_iter().map(|k| first[k]).collect()
}
