//! Loop closures of a real sequence, with false ones among them: the verdict is a function of the map,
//! whatever the order, the grouping and the number of calls. Needs `closures/fr1_rpy`.

use std::collections::BTreeSet;
use std::path::Path;

use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::testing::random::seeded;
use nalgebra::Vector3;
use rand::RngExt;
use v1::ingest_request::Item;

use crate::cli_support::data;
use crate::common::{Stream, TestServer, run, vector3};

/// The map that is adjusted after its closures; in the others the verdicts alone count.
const ADJUSTED: &str = "adjusted";

/// A closure of the sequence, or a false one.
#[derive(Clone, Debug)]
struct Closure {
    i: usize,
    j: usize,
    measured: Se3,
    /// Upper triangle.
    information: Vec<f64>,
    is_true: bool,
}

/// What a frontend made of the sequence.
struct Sequence {
    odometry: Vec<(f64, Se3)>,
    truth: Vec<Se3>,
    /// Of each keyframe: landmark, u, v, depth, σ in pixels and meters.
    observations: Vec<Vec<[f64; 6]>>,
    /// Of each keyframe: the descriptors of its observations.
    descriptors: Vec<Vec<Vec<u8>>>,
    closures: Vec<Closure>,
    /// Of each closure: point, pixel, depth, σ in pixels.
    matches: Vec<Vec<[f64; 7]>>,
}

fn rows(folder: &Path, name: &str) -> Vec<Vec<f64>> {
    let text = fs_err::read_to_string(folder.join(name)).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.map(|l| l.split_whitespace().map(|x| x.parse().unwrap()).collect()).collect()
}

pub(crate) fn pose(row: &[f64]) -> Se3 {
    let rotation = So3::from_quaternion_xyzw(row[3], row[4], row[5], row[6]).unwrap();
    Se3::new(rotation, Vector3::new(row[0], row[1], row[2]))
}

impl Sequence {
    fn read() -> Option<Self> {
        let folder = data("closures/fr1_rpy")?;
        let odometry: Vec<(f64, Se3)> =
            rows(&folder, "keyframes.txt").iter().map(|r| (r[1], pose(&r[2..]))).collect();
        let mut observations = vec![Vec::new(); odometry.len()];
        let mut descriptors = vec![Vec::new(); odometry.len()];
        let bytes = fs_err::read(folder.join("descriptors.bin")).unwrap();
        for (row, descriptor) in rows(&folder, "observations.txt").iter().zip(bytes.chunks(32)) {
            observations[row[0] as usize].push([row[1], row[2], row[3], row[4], row[5], row[6]]);
            descriptors[row[0] as usize].push(descriptor.to_vec());
        }
        // 3 cm and 1.5°.
        let (t, r) = (0.03_f64.powi(-2), 1.5_f64.to_radians().powi(-2));
        let row = |k: usize| {
            let mut row = vec![0.0; 6 - k];
            row[0] = if k < 3 { t } else { r };
            row
        };
        let information: Vec<f64> = (0..6).flat_map(row).collect();
        let closures: Vec<Closure> = rows(&folder, "closures.txt")
            .iter()
            .map(|row| Closure {
                i: row[1] as usize,
                j: row[2] as usize,
                measured: pose(&row[3..]),
                information: information.clone(),
                is_true: true,
            })
            .collect();
        let mut matches = vec![Vec::new(); closures.len()];
        for row in rows(&folder, "closure_matches.txt") {
            let seen = [row[1], row[2], row[3], row[4], row[5], row[6], row[7]];
            matches[row[0] as usize].push(seen);
        }
        let truth = rows(&folder, "truth.txt").iter().map(|row| pose(&row[1..])).collect();
        Some(Self { odometry, truth, observations, descriptors, closures, matches })
    }

    fn camera() -> v1::Camera {
        let model = v1::camera::Model::PinholeRadialTangential(v1::PinholeRadialTangential {
            fx: 517.3,
            fy: 516.5,
            cx: 318.6,
            cy: 255.3,
            k1: 0.2624,
            k2: -0.9531,
            p1: -0.0054,
            p2: 0.0026,
            k3: 1.1633,
        });
        v1::Camera { width_px: 640, height_px: 480, model: Some(model), ..Default::default() }
    }

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
    fn with_false(&self, share: f64, agree: bool, seed: u64) -> Vec<Closure> {
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

    fn poses(&self) -> Vec<Se3> {
        self.odometry.iter().map(|&(_, pose)| pose).collect()
    }

    /// Closures with the information that RefinePose answers for their matches.
    async fn with_refined_information(&self, server: &TestServer) -> Vec<Closure> {
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
                camera: Some(Self::camera()),
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
enum Order {
    /// Each closure behind its second keyframe, each solved before the next item.
    Streamed,
    /// All closures at the end.
    Burst,
    /// The same, the last first.
    Reversed,
}

/// The map's poses and the closures that it has switched off.
struct State {
    off: BTreeSet<i64>,
    poses: Vec<Se3>,
}

async fn build(
    server: &TestServer,
    name: &str,
    sequence: &Sequence,
    closures: &[Closure],
    order: Order,
) {
    // Windows move the estimates; verdicts must not depend on them.
    let windows = Some(matches!(order, Order::Burst));
    let policy = v1::MapPolicy {
        local_bundle_adjustment: windows,
        closure_adjustment: Some(name == ADJUSTED),
        ..Default::default()
    };
    server.create_map_with(name, policy).await;
    let (stream, _) = Stream::open(server, name, "robot", 0).await;
    let mut items = vec![Item::Camera(Sequence::camera())];
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
    for (sequence, item) in (1..).zip(items) {
        stream.send(sequence, item).await;
    }
    for ack in stream.finish().await.unwrap() {
        assert!(ack.violations.is_empty(), "{ack:?}");
    }
}

async fn state(server: &TestServer, name: &str) -> State {
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

async fn optimize(
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

/// The verdicts on `closures`, the same whatever the order and the number of calls. Returns how many
/// true ones are off.
async fn judged(
    server: &TestServer,
    name: &str,
    sequence: &Sequence,
    closures: &[Closure],
) -> usize {
    let mut verdicts = Vec::new();
    for order in [Order::Burst, Order::Reversed, Order::Streamed] {
        let name = format!("{name}-{order:?}").to_lowercase();
        build(server, &name, sequence, closures, order).await;
        verdicts.push(state(server, &name).await.off);
        for _ in 0..2 {
            let result = optimize(server, &name, v1::MapProblem::PoseGraph).await;
            let found = result.summary.unwrap().closures.unwrap();
            assert_eq!(found.closure_count, closures.len() as i64);
            let now = state(server, &name).await;
            assert_eq!(found.switched_off_count, now.off.len() as i64);
            let error = ate(&now.poses, &sequence.truth);
            assert!(error < 0.0515, "{name}: {error} m");
            verdicts.push(now.off);
        }
    }
    assert!(verdicts.iter().all(|off| *off == verdicts[0]), "{name}: {verdicts:?}");
    let off = |id: &usize| verdicts[0].contains(&(*id as i64));
    let on: Vec<usize> =
        (0..closures.len()).filter(|id| !closures[*id].is_true && !off(id)).collect();
    assert!(on.is_empty(), "{name}: false closures {on:?} count");
    (0..closures.len()).filter(|id| closures[*id].is_true && off(id)).count()
}

/// Waits until the map is adjusted after its closures.
pub(crate) async fn adjusted(server: &TestServer, name: &str) {
    let request = v1::WatchMapRequest { map_id: name.to_owned(), ..Default::default() };
    let mut watch = server.maps().watch_map(request).await.unwrap().into_inner();
    loop {
        let request = v1::GetMapRequest { map_id: name.to_owned(), ..Default::default() };
        let answer = server.maps().get_map(request).await.unwrap().into_inner();
        if !answer.map.unwrap().adjustment_due {
            return;
        }
        watch.message().await.unwrap().unwrap();
    }
}

async fn lock_step() -> TestServer {
    TestServer::with(|config| config.engine.lock_step = true).await
}

#[test]
fn the_same_closures_are_off_in_any_order_and_after_any_number_of_calls() {
    let Some(sequence) = Sequence::read() else { return };
    run(async {
        let server = lock_step().await;
        for (share, agree) in [(0.0, false), (0.1, false), (0.2, true)] {
            let closures = sequence.with_false(share, agree, 7);
            let name = format!("stated-{}-{agree}", (share * 10.0) as i64);
            let off = judged(&server, &name, &sequence, &closures).await;
            // Nine of the 64 do not hold within their stated standard deviations.
            assert!(off <= 3 + 9, "{name}: {off} of 64 true closures are off");
        }
    });
}

#[test]
fn true_closures_that_claim_a_tenth_of_their_error_count() {
    let Some(mut sequence) = Sequence::read() else { return };
    run(async {
        let server = lock_step().await;
        sequence.closures = sequence.with_refined_information(&server).await;
        for (share, agree) in [(0.0, false), (0.2, true)] {
            let closures = sequence.with_false(share, agree, 7);
            let name = format!("refined-{}-{agree}", (share * 10.0) as i64);
            let off = judged(&server, &name, &sequence, &closures).await;
            assert!(off <= 12, "{name}: {off} of 64 true closures are off");
        }
    });
}

#[test]
fn after_closures_the_whole_map_is_adjusted_and_a_request_goes_on_from_there() {
    let Some(sequence) = Sequence::read() else { return };
    run(async {
        let server = TestServer::start().await;
        build(&server, ADJUSTED, &sequence, &sequence.closures, Order::Burst).await;
        adjusted(&server, ADJUSTED).await;
        let before = ate(&sequence.poses(), &sequence.truth);
        let after = ate(&state(&server, ADJUSTED).await.poses, &sequence.truth);
        let result = optimize(&server, ADJUSTED, v1::MapProblem::Full).await;
        let requested = ate(&state(&server, ADJUSTED).await.poses, &sequence.truth);
        println!(
            "ATE {before:.4} m by odometry, {after:.4} m after the closures, {requested:.4} m \
             after OptimizeMap, which ended with {:?}",
            result.summary.map(|summary| (summary.termination(), summary.iteration_count))
        );
        assert!(2.0 * after <= before && 2.0 * requested <= before);
    });
}
