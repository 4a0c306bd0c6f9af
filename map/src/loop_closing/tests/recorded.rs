//! A camera that turns to and fro before a desk: `closures/fr1_rpy`.

use covis_solvers::geometry::{CameraModel, So3};
use covis_solvers::testing::data;

use super::*;

/// Standard deviation of the truth, m and rad: its clock is not the camera's, and the shutter rolls.
const TRUTH: f64 = 0.035;

struct Recorded {
    camera: Camera,
    odometry: Vec<Se3>,
    truth: Vec<Se3>,
    seen: Vec<Vec<Sight>>,
}

fn rows(path: &std::path::Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.map(|l| l.split_whitespace().map(|x| x.parse().unwrap()).collect()).collect()
}

fn pose(t: &[f64]) -> Se3 {
    let rotation = So3::from_quaternion_xyzw(t[3], t[4], t[5], t[6]).unwrap();
    Se3::new(rotation, Vector3::new(t[0], t[1], t[2]))
}

fn recorded() -> Option<Recorded> {
    let (folder, lens) = (data("closures/fr1_rpy")?, data("rgbd/tum_fr1_rpy/camera.txt")?);
    let lens = rows(&lens).concat();
    let parameters = nalgebra::SVector::<f64, 9>::from_column_slice(&lens[..9]);
    let camera = Camera::Pinhole(PinholeRadialTangential::from_parameters(&parameters));
    let odometry = rows(&folder.join("keyframes.txt")).iter().map(|r| pose(&r[2..])).collect();
    let truth: Vec<Se3> = rows(&folder.join("truth.txt")).iter().map(|r| pose(&r[1..])).collect();
    let mut seen = vec![Vec::new(); truth.len()];
    let bytes = std::fs::read(folder.join("descriptors.bin")).unwrap();
    for (r, data) in rows(&folder.join("observations.txt")).iter().zip(bytes.chunks(32)) {
        let depth_m = (r[4] > 0.0).then_some((r[4], r[6]));
        let feature = Feature { pixel: Vector2::new(r[2], r[3]), sigma_px: r[5], depth_m };
        let sight = Sight { landmark: r[1] as i64, feature, descriptor: orb(data.to_vec()) };
        seen[r[0] as usize].push(sight);
    }
    Some(Recorded { camera, odometry, truth, seen })
}

impl Recorded {
    fn mapped(&self, range: std::ops::Range<usize>) -> Mapped {
        let mut made = Mapped::new(self.camera);
        for k in range {
            let mut seen = self.seen[k].clone();
            let mut last = i64::MIN;
            seen.sort_by_key(|s| s.landmark);
            seen.retain(|s| std::mem::replace(&mut last, s.landmark) != s.landmark);
            made.add(k as i64, &self.odometry[k], &self.truth[k], &seen);
        }
        made
    }

    /// Share of what `a` sees that is in the image of `b`.
    fn common(&self, a: usize, b: usize) -> f64 {
        let from = self.truth[b].inverse().compose(&self.truth[a]);
        let (mut inside, mut all) = (0_u32, 0_u32);
        for s in &self.seen[a] {
            let Some((z, _)) = s.feature.depth_m else { continue };
            let Some(ray) = self.camera.unproject(&s.feature.pixel) else { continue };
            let p = from.transform(&(ray * (z / ray.z)));
            all += 1;
            let is_in =
                |v: Vector2<f64>| (0.0..640.0).contains(&v.x) && (0.0..480.0).contains(&v.y);
            inside += u32::from(p.z > 0.1 && self.camera.project(&p).is_some_and(is_in));
        }
        f64::from(inside) / f64::from(all.max(1_u32))
    }
}

#[test]
fn a_camera_before_a_recorded_desk_is_told_where_it_is() {
    let Some(desk) = recorded() else { return };
    for with_depth in [false, true] {
        let mut tally = Tally::default();
        // What is mapped, and which of the keyframes ask.
        for (mapped, asked) in [(0..45, 45..89), (60..80, 0..60)] {
            let made = desk.mapped(mapped.clone());
            for k in asked.step_by(2) {
                let is_known = mapped.clone().any(|m| desk.common(k, m) > 0.3);
                let found = made.ask(desk.camera, &desk.seen[k], with_depth);
                let answer = found.located.as_ref().map(|located| {
                    let truth = made.truth[&located.keyframe].inverse().compose(&desk.truth[k]);
                    Answer::new(located, &truth, TRUTH)
                });
                tally.add(is_known, &found, answer);
            }
        }
        let told = format!("depth {with_depth}: {}", tally.text());
        println!("{told}");
        assert!(tally.wrong.is_empty(), "{told}");
        assert!(4 * tally.answered >= 3 * tally.known && tally.answered_elsewhere == 0, "{told}");
    }
}
