//! Pairs of keyframes of a camera that turns to and fro before a desk: `closures/fr1_rpy`.
//!
//! Common view comes from the true poses and the depths. The truth is that of the nearest time, and the
//! shutter rolls: at 60°/s both are a degree.

use nalgebra::{Vector2, Vector3};

use super::super::*;
use crate::geometry::{CameraModel, PinholeRadialTangential, So3};
use crate::initialization::View;
use crate::testing::data;

fn rows(path: &std::path::Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.map(|l| l.split_whitespace().map(|x| x.parse().unwrap()).collect()).collect()
}

struct Keyframe {
    time: f64,
    truth: Se3,
    features: Vec<Feature>,
    descriptors: Vec<[u64; 4]>,
    /// Of the features with depth: the point, and the feature.
    points: Vec<(PointEstimate, usize)>,
}

fn distance(a: &[u64; 4], b: &[u64; 4]) -> u32 {
    a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum()
}

impl Keyframe {
    /// Share of the points that `other` has in its image.
    fn common_view(&self, other: &Self, camera: &Camera) -> f64 {
        let other_from_this = other.truth.inverse().compose(&self.truth);
        let in_image = self.points.iter().filter(|(point, _)| {
            let p = other_from_this.transform(&point.point);
            let seen = |v: Vector2<f64>| (0.0..640.0).contains(&v.x) && (0.0..480.0).contains(&v.y);
            p.z > 0.1 && camera.project(&p).is_some_and(seen)
        });
        in_image.count() as f64 / self.points.len().max(1) as f64
    }

    /// Each the other's best by descriptor, up to 89 of 256 bits, at 0.85 of the second best.
    fn matches(&self, query: &Self) -> Vec<Proposed> {
        let best = |own: &[u64; 4], others: &mut dyn Iterator<Item = &[u64; 4]>| {
            let (mut at, mut first, mut second) = (0, u32::MAX, u32::MAX);
            for (k, other) in others.enumerate() {
                let d = distance(own, other);
                if d < first {
                    (second, first, at) = (first, d, k);
                } else {
                    second = second.min(d);
                }
            }
            (at, first, second)
        };
        let own = || self.points.iter().map(|&(_, f)| &self.descriptors[f]);
        let mut matches = Vec::new();
        for (feature, descriptor) in query.descriptors.iter().enumerate() {
            let (point, first, second) = best(descriptor, &mut own());
            if first > 89 || f64::from(first) > 0.85 * f64::from(second) {
                continue;
            }
            let back = &self.descriptors[self.points[point].1];
            if best(back, &mut query.descriptors.iter()).0 == feature {
                matches.push(Proposed { point, feature, weight: 1.0 });
            }
        }
        matches
    }
}

/// Camera and keyframes, the latter by number.
fn sequence() -> Option<(Camera, Vec<Keyframe>)> {
    let (folder, lens) = (data("closures/fr1_rpy")?, data("rgbd/tum_fr1_rpy/camera.txt")?);
    let lens = rows(&lens).concat();
    let parameters = nalgebra::SVector::<f64, 9>::from_column_slice(&lens[..9]);
    let camera = Camera::Pinhole(PinholeRadialTangential::from_parameters(&parameters));
    let times = rows(&folder.join("keyframes.txt"));
    let mut keyframes: Vec<Keyframe> = rows(&folder.join("truth.txt"))
        .iter()
        .zip(&times)
        .map(|(r, time)| {
            let rotation = So3::from_quaternion_xyzw(r[4], r[5], r[6], r[7]).unwrap();
            let truth = Se3::new(rotation, Vector3::new(r[1], r[2], r[3]));
            let (features, descriptors, points) = (Vec::new(), Vec::new(), Vec::new());
            Keyframe { time: time[1], truth, features, descriptors, points }
        })
        .collect();
    let bytes = std::fs::read(folder.join("descriptors.bin")).unwrap();
    for (r, data) in rows(&folder.join("observations.txt")).iter().zip(bytes.chunks(32)) {
        let keyframe = &mut keyframes[r[0] as usize];
        let (pixel, sigma_px) = (Vector2::new(r[2], r[3]), r[5]);
        let depth_m = (r[4] > 0.0).then_some((r[4], r[6]));
        let world_from_camera = Se3::identity();
        let view = View { world_from_camera, camera, pixel, sigma_px, depth_m };
        if let Some(point) = depth_m.and_then(|_| PointEstimate::from_views(&[view])) {
            keyframe.points.push((point, keyframe.features.len()));
        }
        keyframe.features.push(Feature { pixel, sigma_px, depth_m });
        let word = |k: usize| u64::from_le_bytes(data[8 * k..8 * k + 8].try_into().unwrap());
        keyframe.descriptors.push(std::array::from_fn(word));
    }
    Some((camera, keyframes))
}

#[test]
fn recorded_pairs_with_a_common_view_are_verified_and_others_are_not() {
    let Some((camera, keyframes)) = sequence() else { return };
    let (mut again, mut accepted, mut apart, mut wrong) = (0, 0, 0, 0);
    let mut errors: Vec<(f64, f64)> = Vec::new();
    for (k, query) in keyframes.iter().enumerate() {
        for (other, candidate) in keyframes[..k].iter().enumerate() {
            let common = query.common_view(candidate, &camera);
            let is_again = common >= 0.3 && candidate.time < query.time - 3.0;
            // Every third pair of each kind: what is between them tells the same.
            if !(is_again || common == 0.0) || (k + other) % 3 != 0 {
                continue;
            }
            let points: Vec<PointEstimate> = candidate.points.iter().map(|&(p, _)| p).collect();
            let matches = candidate.matches(query);
            let input = Input {
                camera: &camera,
                features: &query.features,
                points: &points,
                matches: &matches,
                expected: None,
                seed: (k * 1000 + other) as u64,
            };
            let likeness = |point: usize, feature: usize| {
                let own = &candidate.descriptors[candidate.points[point].1];
                match distance(own, &query.descriptors[feature]) {
                    bits if bits <= 64 => Likeness::Distance(f64::from(bits) / 256.0),
                    _ => Likeness::Different,
                }
            };
            let verdict = verify(&input, &likeness, &Options::default()).unwrap();
            again += usize::from(is_again);
            apart += usize::from(!is_again);
            if let Verdict::Accepted(verified) = verdict {
                let truth = candidate.truth.inverse().compose(&query.truth);
                let error = truth.inverse().compose(&verified.candidate_from_query);
                if is_again {
                    accepted += 1;
                    errors
                        .push((error.translation.norm(), error.rotation.log().norm().to_degrees()));
                } else {
                    wrong += 1;
                }
            }
        }
    }
    let largest = errors.iter().fold((0.0_f64, 0.0_f64), |l, e| (l.0.max(e.0), l.1.max(e.1)));
    let told = format!("{accepted} of {again}, {wrong} of {apart} wrong, up to {largest:?}");
    assert!(again > 100 && apart > 100, "{told}");
    assert_eq!(wrong, 0, "{told}");
    assert!(2 * accepted > again, "{told}");
    // Closures of this sequence by other means are within the same bounds of its truth.
    assert!(largest.0 < 0.3 && largest.1 < 15.0, "{told}");
}
