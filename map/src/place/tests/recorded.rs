//! A camera that turns to and fro before a desk: `closures/fr1_rpy`.
//!
//! How much two keyframes have in common comes from the true poses and the depth of what was seen.

use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::testing::data;
use nalgebra::Vector3;

use super::*;

/// Camera of the sequence without its lens distortion, which moves no point by more than the border of
/// what counts as common view.
const CAMERA: [f64; 4] = [517.3, 516.5, 318.6, 255.3];
/// Common view from which a place is the same, and below which it is another one.
const SAME: f64 = 0.3;
const OTHER: f64 = 0.1;

fn rows(path: &std::path::Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.map(|l| l.split_whitespace().map(|x| x.parse().unwrap()).collect()).collect()
}

/// Share of the points, in the camera of `a`, that `b` has in its image.
fn common_view(points: &[Vector3<f64>], a: &Se3, b: &Se3) -> f64 {
    let [fx, fy, cx, cy] = CAMERA;
    let b_from_a = b.inverse().compose(a);
    let in_image = points.iter().filter(|point| {
        let p = b_from_a.transform(point);
        let (u, v) = (fx * p.x / p.z + cx, fy * p.y / p.z + cy);
        p.z > 0.1 && (0.0..640.0).contains(&u) && (0.0..480.0).contains(&v)
    });
    in_image.count() as f64 / points.len().max(1) as f64
}

#[test]
fn a_recorded_desk_is_recognized() {
    let Some(folder) = data("closures/fr1_rpy") else { return };
    let [fx, fy, cx, cy] = CAMERA;
    let truth: Vec<Se3> = rows(&folder.join("truth.txt"))
        .iter()
        .map(|r| {
            let rotation = So3::from_quaternion_xyzw(r[4], r[5], r[6], r[7]).unwrap();
            Se3::new(rotation, Vector3::new(r[1], r[2], r[3]))
        })
        .collect();
    let times: Vec<f64> = rows(&folder.join("keyframes.txt")).iter().map(|row| row[1]).collect();
    let mut descriptors = vec![Vec::new(); truth.len()];
    let mut points = vec![Vec::new(); truth.len()];
    let bytes = std::fs::read(folder.join("descriptors.bin")).unwrap();
    for (row, data) in rows(&folder.join("observations.txt")).iter().zip(bytes.chunks(32)) {
        descriptors[row[0] as usize].push(data.to_vec());
        let z = row[4];
        if z > 0.0 {
            let point = Vector3::new((row[2] - cx) / fx * z, (row[3] - cy) / fy * z, z);
            points[row[0] as usize].push(point);
        }
    }

    let mut index = PlaceIndex::default();
    let mut told = Vec::new();
    for k in 0..truth.len() {
        let features = orb(&descriptors[k]);
        let is_old = |other: usize| times[other] < times[k] - 3.0;
        let common = |other: usize| common_view(&points[k], &truth[k], &truth[other]);
        let candidates = index.query(&features, None, 3, |id| !is_old(id.id as usize)).unwrap();
        let best = candidates.first();
        told.push(Best {
            score: best.map_or(0.0, |best| best.score),
            is_again: (0..k).any(|other| is_old(other) && common(other) >= SAME),
            is_right: best.is_some_and(|best| common(best.keyframe.id as usize) >= OTHER),
        });
        index.add(id(0, k as i64), (times[k] * 1e9) as i64, &features).unwrap();
    }
    let again = told.iter().filter(|best| best.is_again).count();
    let recall = recall_at_precision_1(&told);
    assert!(again > 50 && recall >= 0.85, "{recall} of {again}");
}
