//! A sequence as a frontend sends it, with loop closures and false ones among them, and what a map makes
//! of it. Where it comes from is for [`closure_verdicts`](crate::closure_verdicts) and
//! [`made_sequence`](crate::made_sequence) to say; nothing here knows what is right but by `truth`.

use std::collections::BTreeSet;

use covis::client::Client;
use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::testing::random::seeded;
use nalgebra::{Vector3, Vector6};
use rand::RngExt;
use v1::ingest_request::Item;

use crate::common::{Stream, TestServer, vector3};

/// The largest χ² of a true closure, the 99 % quantile in six dimensions.
const HOLDS: f64 = 16.81;

/// A closure of the sequence, or a false one.
#[derive(Clone, Debug)]
pub(crate) struct Closure {
    pub(crate) i: usize,
    pub(crate) j: usize,
    /// The pose of j in the frame of i.
    pub(crate) measured: Se3,
    /// Upper triangle.
    pub(crate) information: Vec<f64>,
    pub(crate) is_true: bool,
}

/// What a frontend made of a sequence.
pub(crate) struct Sequence {
    pub(crate) camera: v1::Camera,
    /// Capture time in seconds, pose of the camera.
    pub(crate) odometry: Vec<(f64, Se3)>,
    pub(crate) truth: Vec<Se3>,
    /// Of each keyframe: landmark, u, v, depth, σ in pixels and meters.
    pub(crate) observations: Vec<Vec<[f64; 6]>>,
    /// Of each keyframe: the descriptors of its observations.
    pub(crate) descriptors: Vec<Vec<Vec<u8>>>,
    pub(crate) closures: Vec<Closure>,
    /// Of each closure: point in i, pixel in j, depth there, σ in pixels.
    pub(crate) matches: Vec<Vec<[f64; 7]>>,
}

/// The upper triangle of the information of a closure that claims 3 cm and 1.5°.
pub(crate) fn stated_information() -> Vec<f64> {
    let (t, r) = (0.03_f64.powi(-2), 1.5_f64.to_radians().powi(-2));
    let row = |k: usize| {
        let mut row = vec![0.0; 6 - k];
        row[0] = if k < 3 { t } else { r };
        row
    };
    (0..6).flat_map(row).collect()
}

pub(crate) fn pose(row: &[f64]) -> Se3 {
    let rotation = So3::from_quaternion_xyzw(row[3], row[4], row[5], row[6]).unwrap();
    Se3::new(rotation, Vector3::new(row[0], row[1], row[2]))
}

impl Sequence {
    fn keyframe(&self, k: usize, known: &mut BTreeSet<i64>) -> Item {
        let (time, pose) = self.odometry[k];
        let mut landmarks = Vec::new();
        let observation = |(seen, descriptor): (&[f64; 6], &Vec<u8>)| {
            let [landmark, u, v, depth, sigma_px, sigma_m] = *seen;
            let id = landmark as i64;
            if known.insert(id) {
                landmarks.push(v1::Landmark { id, ..Default::default() });
            }
            v1::Observation {
                landmark: Some(v1::LandmarkRef { id, ..Default::default() }),
                pixel: Some(v1::Vector2 { x: u, y: v }),
                sigma_px: Some(sigma_px),
                depth_m: (depth > 0.0).then_some(depth),
                sigma_depth_m: (depth > 0.0).then_some(sigma_m),
                descriptor: Some(v1::Descriptor {
                    kind: v1::DescriptorKind::Binary.into(),
                    name: "orb".to_owned(),
                    data: descriptor.clone(),
                }),
                ..Default::default()
            }
        };
        let seen = self.observations[k].iter().zip(&self.descriptors[k]);
        let observations = seen.map(observation).collect();
        let nanos = ((time % 1.0) * 1e9) as i32;
        Item::Keyframe(v1::Keyframe {
            id: k as i64,
            capture_time: Some(prost_types::Timestamp { seconds: time as i64, nanos }),
            sensor: Some(v1::keyframe::Sensor::CameraId(0)),
            world_from_camera: Some(transform(&pose)),
            odom_from_camera: Some(transform(&pose)),
            observations,
            landmarks,
            ..Default::default()
        })
    }

    /// The true closures with `share` of false ones: motions of true ones between keyframes where they
    /// do not hold, in groups that agree with each other if `agree`.
    pub(crate) fn with_false(&self, share: f64, agree: bool, seed: u64) -> Vec<Closure> {
        let mut rng = seeded(seed);
        let mut closures = self.closures.clone();
        let wanted = closures.len() + (share * closures.len() as f64).round() as usize;
        let last = self.truth.len() - 1;
        while closures.len() < wanted {
            let from = self.closures[rng.random_range(0..self.closures.len())].clone();
            let i = rng.random_range(0..last - 16);
            let j = rng.random_range(i + 8..last);
            let truth = self.truth[i].inverse().compose(&self.truth[j]);
            let error = truth.inverse().compose(&from.measured);
            let is_near = error.translation.norm() < 0.3
                && error.rotation.log().norm() < 15.0_f64.to_radians();
            if is_near {
                continue;
            }
            let group = if agree { rng.random_range(2..5) } else { 1 };
            for g in 0..group {
                if closures.len() == wanted || j + g > last {
                    break;
                }
                let step = |k: usize| self.truth[k].inverse().compose(&self.truth[k + g]);
                let measured = step(i).inverse().compose(&from.measured).compose(&step(j));
                closures.push(Closure {
                    i: i + g,
                    j: j + g,
                    measured,
                    is_true: false,
                    ..from.clone()
                });
            }
        }
        closures
    }

    /// The error of a closure against the truth: right perturbation, translation first.
    fn error(&self, closure: &Closure) -> Vector6<f64> {
        let truth = self.truth[closure.i].inverse().compose(&self.truth[closure.j]);
        truth.inverse().compose(&closure.measured).log()
    }

    /// χ² of the error of a closure by its own information.
    fn chi2(&self, closure: &Closure) -> f64 {
        let error = self.error(closure);
        let places = (0..6).flat_map(|r| (r..6).map(move |c| (r, c)));
        let term = |((r, c), w): ((usize, usize), &f64)| {
            let both = if r == c { 1.0 } else { 2.0 };
            both * w * error[r] * error[c]
        };
        places.zip(&closure.information).map(term).sum()
    }

    /// The median errors of the closures: meters, degrees.
    pub(crate) fn median_errors(&self) -> [f64; 2] {
        let errors: Vec<Vector6<f64>> = self.closures.iter().map(|c| self.error(c)).collect();
        [0, 3].map(|first| {
            let norm = |error: &Vector6<f64>| error.fixed_rows::<3>(first).norm();
            let mut norms: Vec<f64> = errors.iter().map(norm).collect();
            norms.sort_by(f64::total_cmp);
            let median = norms[norms.len() / 2];
            if first == 0 { median } else { median.to_degrees() }
        })
    }

    pub(crate) fn poses(&self) -> Vec<Se3> {
        self.odometry.iter().map(|&(_, pose)| pose).collect()
    }

    /// Closures with the information that RefinePose answers for their matches.
    pub(crate) async fn with_refined_information(&self, server: &TestServer) -> Vec<Closure> {
        let mut refined = Vec::new();
        for (closure, matches) in self.closures.iter().zip(&self.matches) {
            let observations =
                matches.iter().map(|&[x, y, z, u, v, _, sigma]| v1::PointObservation {
                    point_in_world: Some(vector3([x, y, z])),
                    pixel: Some(v1::Vector2 { x: u, y: v }),
                    sigma_px: Some(sigma),
                    ..Default::default()
                });
            let request = v1::RefinePoseRequest {
                camera: Some(self.camera.clone()),
                world_from_camera: Some(transform(&closure.measured)),
                observations: observations.collect(),
                include_information: true,
                ..Default::default()
            };
            let answer = server.optimization().refine_pose(request).await.unwrap().into_inner();
            let v1::RigidTransform { translation: Some(t), rotation: Some(q) } =
                answer.world_from_camera.unwrap()
            else {
                panic!()
            };
            refined.push(Closure {
                measured: pose(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w]),
                information: answer.information.unwrap().upper_triangle,
                ..closure.clone()
            });
        }
        refined
    }
}

pub(crate) fn transform(pose: &Se3) -> v1::RigidTransform {
    let q = pose.rotation.quaternion();
    let rotation = Some(v1::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w });
    let translation = Some(vector3(pose.translation.into()));
    v1::RigidTransform { translation, rotation }
}

fn item(id: usize, closure: &Closure) -> Item {
    let keyframe = |id: usize| Some(v1::KeyframeRef { id: id as i64, ..Default::default() });
    Item::RelativePose(v1::RelativePoseConstraint {
        id: id as i64,
        keyframe_i: keyframe(closure.i),
        keyframe_j: keyframe(closure.j),
        keyframe_i_from_keyframe_j: Some(transform(&closure.measured)),
        information: Some(v1::InformationMatrix6 { upper_triangle: closure.information.clone() }),
        kind: v1::ConstraintKind::LoopClosure.into(),
        ..Default::default()
    })
}

/// How the items of a map come.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Order {
    /// Each closure behind its second keyframe, each solved before the next item.
    Streamed,
    /// All closures at the end.
    Burst,
    /// The same, the last first.
    Reversed,
}

/// The map's poses and the closures that it has switched off.
pub(crate) struct State {
    pub(crate) off: BTreeSet<i64>,
    pub(crate) poses: Vec<Se3>,
}

/// The policy of a map whose closures come from a client alone.
pub(crate) fn without_recognition(policy: v1::MapPolicy) -> v1::MapPolicy {
    let enabled = v1::PlaceRecognition { enabled: Some(false) };
    v1::MapPolicy { place_recognition: policy.place_recognition.or(Some(enabled)), ..policy }
}

/// The camera, the keyframes and `closures`, whose places are their ids.
pub(crate) fn items(sequence: &Sequence, closures: &[Closure], order: Order) -> Vec<Item> {
    let mut items = vec![Item::Camera(sequence.camera.clone())];
    let mut known = BTreeSet::new();
    let numbered: Vec<(usize, &Closure)> = closures.iter().enumerate().collect();
    for k in 0..sequence.odometry.len() {
        items.push(sequence.keyframe(k, &mut known));
        let now = numbered.iter().filter(|(_, c)| matches!(order, Order::Streamed) && c.j == k);
        items.extend(now.map(|&(id, c)| item(id, c)));
    }
    match order {
        Order::Streamed => {}
        Order::Burst => items.extend(numbered.iter().map(|&(id, c)| item(id, c))),
        Order::Reversed => items.extend(numbered.iter().rev().map(|&(id, c)| item(id, c))),
    }
    items
}

/// Creates a map and sends it `closures` with the sequence.
pub(crate) async fn build(
    server: &TestServer,
    name: &str,
    (sequence, closures): (&Sequence, &[Closure]),
    order: Order,
    policy: v1::MapPolicy,
) {
    server.create_map_with(name, without_recognition(policy)).await;
    let (stream, _) = Stream::open(server, name, "robot", 0).await;
    for (number, item) in (1..).zip(items(sequence, closures, order)) {
        stream.send(number, item).await;
    }
    for ack in stream.finish().await.unwrap() {
        assert!(ack.violations.is_empty(), "{ack:?}");
    }
}

pub(crate) async fn state(server: &TestServer, name: &str) -> State {
    let request =
        v1::WatchMapRequest { map_id: name.to_owned(), omit_landmarks: true, ..Default::default() };
    let mut watch = server.maps().watch_map(request).await.unwrap().into_inner();
    let (mut off, mut poses) = (BTreeSet::new(), Vec::new());
    loop {
        let delta = watch.message().await.unwrap().unwrap().delta.unwrap();
        for constraint in delta.constraints {
            if let Some(v1::constraint::Constraint::RelativePose(c)) = constraint.constraint
                && c.switched_off.is_some()
            {
                off.insert(c.id);
            }
        }
        for keyframe in delta.keyframes {
            let pose_in_world = keyframe.world_from_camera.unwrap();
            let (t, q) = (pose_in_world.translation.unwrap(), pose_in_world.rotation.unwrap());
            poses.push((keyframe.keyframe.unwrap().id, pose(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w])));
        }
        if delta.last_part {
            break;
        }
    }
    poses.sort_by_key(|(id, _)| *id);
    State { off, poses: poses.into_iter().map(|(_, pose)| pose).collect() }
}

/// Root mean square of the positions' errors after rigid alignment.
pub(crate) fn ate(poses: &[Se3], truth: &[Se3]) -> f64 {
    let points =
        |poses: &[Se3]| -> Vec<Vector3<f64>> { poses.iter().map(|p| p.translation).collect() };
    let (a, b) = (points(poses), points(truth));
    let mean = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let (mean_a, mean_b) = (mean(&a), mean(&b));
    let correlation: nalgebra::Matrix3<f64> =
        a.iter().zip(&b).map(|(a, b)| (b - mean_b) * (a - mean_a).transpose()).sum();
    let svd = correlation.svd(true, true);
    let (u, v) = (svd.u.unwrap(), svd.v_t.unwrap());
    let sign = Vector3::new(1.0, 1.0, (u * v).determinant().signum());
    let rotation = u * nalgebra::Matrix3::from_diagonal(&sign) * v;
    let squares =
        a.iter().zip(&b).map(|(a, b)| (b - mean_b - rotation * (a - mean_a)).norm_squared());
    (squares.sum::<f64>() / a.len() as f64).sqrt()
}

pub(crate) async fn optimize(
    server: &TestServer,
    name: &str,
    problem: v1::MapProblem,
) -> v1::OptimizeMapResult {
    let request = v1::OptimizeMapRequest {
        map_id: name.to_owned(),
        problem: problem.into(),
        ..Default::default()
    };
    let mut stream = server.optimization().optimize_map(request).await.unwrap().into_inner();
    loop {
        let event = stream.message().await.unwrap().unwrap().event.unwrap();
        if let v1::optimize_map_response::Event::Result(result) = event {
            return result;
        }
    }
}

/// What a map makes of closures, whatever the order and the number of calls.
pub(crate) struct Judged {
    /// The true ones that are off and hold within their information.
    pub(crate) off: Vec<usize>,
    /// The true ones that are off and do not.
    pub(crate) off_beyond: Vec<usize>,
    /// How many true ones hold.
    pub(crate) holding: usize,
    /// The largest, m.
    pub(crate) ate: f64,
}

/// Judges `closures` in every order and again on request: the verdicts are the same, and all false
/// closures are off.
#[allow(clippy::print_stdout, reason = "a test shows what it measured")]
pub(crate) async fn judged(
    server: &TestServer,
    name: &str,
    sequence: &Sequence,
    closures: &[Closure],
) -> Judged {
    let mut verdicts = Vec::new();
    let mut largest = 0.0_f64;
    for order in [Order::Burst, Order::Reversed, Order::Streamed] {
        let name = format!("{name}-{order:?}").to_lowercase();
        let policy = v1::MapPolicy {
            // Windows move the estimates; verdicts must not depend on them. Small ones do.
            local_bundle_adjustment: Some(matches!(order, Order::Burst)),
            window_keyframe_count: Some(3),
            max_iteration_count: Some(2),
            closure_adjustment: Some(false),
            ..Default::default()
        };
        build(server, &name, (sequence, closures), order, policy).await;
        verdicts.push(state(server, &name).await.off);
        let calls = if matches!(order, Order::Burst) { 3 } else { 1 };
        for _ in 0..calls {
            let result = optimize(server, &name, v1::MapProblem::PoseGraph).await;
            let found = result.summary.unwrap().closures.unwrap();
            assert_eq!(found.closure_count, closures.len() as i64);
            let now = state(server, &name).await;
            assert_eq!(found.switched_off_count, now.off.len() as i64);
            largest = largest.max(ate(&now.poses, &sequence.truth));
            verdicts.push(now.off);
        }
    }
    assert!(verdicts.iter().all(|off| *off == verdicts[0]), "{name}: {verdicts:?}");
    let is_off = |id: &usize| verdicts[0].contains(&(*id as i64));
    let on: Vec<usize> =
        (0..closures.len()).filter(|id| !closures[*id].is_true && !is_off(id)).collect();
    assert!(on.is_empty(), "{name}: false closures {on:?} count");
    let holds = |id: &usize| sequence.chi2(&closures[*id]) <= HOLDS;
    let true_ones = (0..closures.len()).filter(|id| closures[*id].is_true);
    let holding = true_ones.clone().filter(holds).count();
    let (off, off_beyond) = true_ones.filter(is_off).partition(holds);
    let judged = Judged { off, off_beyond, holding, ate: largest };
    let before = ate(&sequence.poses(), &sequence.truth);
    println!(
        "{name}: {} true closures, {holding} hold, {} of these off, {} others off; {} false, all off; \
         ATE {:.1} mm, by odometry {:.1} mm",
        sequence.closures.len(),
        judged.off.len(),
        judged.off_beyond.len(),
        closures.len() - sequence.closures.len(),
        1e3 * judged.ate,
        1e3 * before
    );
    judged
}

/// Waits until the map is adjusted after its closures.
pub(crate) async fn adjusted(server: &TestServer, name: &str) {
    let url = format!("http://{}", server.running.local_addr());
    let client = Client::connect(&url).await.unwrap();
    client.wait_settled(name).await.unwrap();
}
