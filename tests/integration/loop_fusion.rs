//! A walk around a block with a depth camera's noise: after a loop closure the landmarks that are one
//! point are found, and the map is adjusted.
//!
//! The robot walks 300 m along the corridors around a square and 25 m further. It sees points on the
//! walls with the noise of a Kinect (Khoshelham and Elberink, Sensors 2012), tracks its motion from one
//! keyframe to the next, and gives new ids to what it has lost from sight. All is made from a seed.

use std::collections::{BTreeMap, BTreeSet};

use covis::wire::v1;
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3, So3};
use covis_solvers::relative_motion::{Match, PointEstimate, measure};
use covis_solvers::testing::random::{normal_vector, seeded};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use rand::RngExt;
use v1::ingest_request::Item;

use crate::closure_verdicts::{ate, pose, transform};
use crate::common::{Stream, TestServer, run};

/// Length of a side of the square, m.
const SIDE_M: f64 = 75.0;
/// Distance of keyframes, m.
const STEP_M: f64 = 0.4;
/// Points per meter of the corridor.
const POINTS_PER_M: usize = 40;
/// How far along the corridor the camera sees, m.
const SIGHT_M: f64 = 7.0;
/// Keyframes after which a point that was lost from sight gets a new id.
const MEMORY: usize = 10;
const SIGMA_PX: f64 = 0.7;
/// Share of a descriptor's bits that differ from one view to the next.
const FLIPPED: f64 = 0.12;

/// σ of a Kinect's depth, m.
fn sigma_depth(depth_m: f64) -> f64 {
    0.001_425 * depth_m * depth_m + 0.002
}

/// A point of the scene.
struct Point {
    position: Vector3<f64>,
    /// Where it is along the way, m.
    along: f64,
    descriptor: [u8; 32],
}

#[derive(Clone)]
struct Seen {
    point: usize,
    pixel: Vector2<f64>,
    depth_m: f64,
    descriptor: Vec<u8>,
    /// The id that the frontend gives.
    landmark: i64,
}

struct Walk {
    truth: Vec<Se3>,
    odometry: Vec<Se3>,
    seen: Vec<Vec<Seen>>,
    /// i, j, pose of j in i, information.
    closures: Vec<(usize, usize, Se3, Vec<f64>)>,
    /// The point of each landmark.
    point_of: BTreeMap<i64, usize>,
}

fn camera() -> Camera {
    Camera::Pinhole(PinholeRadialTangential::undistorted(525.0, 525.0, 319.5, 239.5))
}

/// Where the way is after `along` meters, and its direction as an angle.
fn place(along: f64) -> (Vector3<f64>, f64) {
    let around = along.rem_euclid(4.0 * SIDE_M);
    let (side, rest) = ((around / SIDE_M).floor(), around % SIDE_M);
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut corner = Vector3::zeros();
    for k in 0..side as usize {
        let angle = quarter * k as f64;
        corner += SIDE_M * Vector3::new(angle.cos(), angle.sin(), 0.0);
    }
    let direction = Vector3::new((quarter * side).cos(), (quarter * side).sin(), 0.0);
    // The robot turns within two meters before each corner and two after it.
    let turned = ((rest - (SIDE_M - 2.0)) / 4.0).max(0.0) - ((2.0 - rest) / 4.0).max(0.0);
    let laps = (along / (4.0 * SIDE_M)).floor();
    let angle = quarter * (side + turned + 4.0 * laps);
    (corner + rest * direction, angle)
}

fn true_pose(along: f64) -> Se3 {
    let (position, angle) = place(along);
    // x right, y down, z forward.
    let forward = Vector3::new(angle.cos(), angle.sin(), 0.0);
    let down = -Vector3::z();
    let axes = Matrix3::from_columns(&[down.cross(&forward), down, forward]);
    let quaternion =
        nalgebra::UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let rotation =
        So3::from_quaternion_xyzw(quaternion.i, quaternion.j, quaternion.k, quaternion.w).unwrap();
    Se3::new(rotation, position)
}

fn scene(rng: &mut impl rand::Rng) -> Vec<Point> {
    let count = (4.0 * SIDE_M) as usize * POINTS_PER_M;
    let mut point = || {
        let along = rng.random::<f64>() * 4.0 * SIDE_M;
        let (position, _) = place(along);
        let side = (along / SIDE_M).floor() * std::f64::consts::FRAC_PI_2;
        let left = Vector3::new(-side.sin(), side.cos(), 0.0);
        let offset = if rng.random::<bool>() { 2.0 } else { -2.0 } + 0.3 * rng.random::<f64>();
        let height = 3.0 * rng.random::<f64>() - 1.2;
        let position = position + offset * left + height * Vector3::z();
        Point { position, along, descriptor: rng.random() }
    };
    (0..count).map(|_| point()).collect()
}

/// The match of what `b` sees with the view of `a`.
fn matches(a: &[Seen], b: &[Seen]) -> Vec<Match> {
    let Camera::Pinhole(model) = camera() else { unreachable!() };
    let by_point: BTreeMap<usize, &Seen> = a.iter().map(|seen| (seen.point, seen)).collect();
    let matched = b.iter().filter_map(|seen| {
        let first = by_point.get(&seen.point)?;
        let (z, sigma_z) = (first.depth_m, sigma_depth(first.depth_m));
        let ray = Vector3::new(
            (first.pixel.x - model.cx) / model.fx,
            (first.pixel.y - model.cy) / model.fy,
            1.0,
        );
        let lateral = SIGMA_PX * z / model.fx;
        let covariance = sigma_z * sigma_z * ray * ray.transpose()
            + lateral * lateral * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0))
            + 1e-12 * Matrix3::identity();
        Some(Match {
            landmark: PointEstimate { point: z * ray, covariance },
            pixel: seen.pixel,
            sigma_px: SIGMA_PX,
            depth_m: Some((seen.depth_m, sigma_depth(seen.depth_m))),
        })
    });
    matched.collect()
}

impl Walk {
    fn new(seed: u64) -> Self {
        let mut rng = seeded(seed);
        let points = scene(&mut rng);
        let lap = 4.0 * SIDE_M;
        let count = ((lap + 25.0) / STEP_M) as usize;
        let camera = camera();
        let truth: Vec<Se3> = (0..count).map(|k| true_pose(k as f64 * STEP_M)).collect();
        let mut last_seen: BTreeMap<usize, (usize, i64)> = BTreeMap::new();
        let mut point_of = BTreeMap::new();
        let mut seen: Vec<Vec<Seen>> = Vec::new();
        for (k, pose) in truth.iter().enumerate() {
            let along = k as f64 * STEP_M;
            let mut views = Vec::new();
            for (index, point) in points.iter().enumerate() {
                let ahead = (point.along - along + 0.5 * lap).rem_euclid(lap) - 0.5 * lap;
                if ahead.abs() > SIGHT_M {
                    continue;
                }
                let in_camera = pose.inverse_transform(&point.position);
                if in_camera.z < 0.6 || in_camera.z > 6.0 {
                    continue;
                }
                let Some(pixel) = camera.project(&in_camera) else { continue };
                let pixel = pixel + normal_vector::<2>(&mut rng, SIGMA_PX);
                if !(0.0..640.0).contains(&pixel.x) || !(0.0..480.0).contains(&pixel.y) {
                    continue;
                }
                let noise = normal_vector::<1>(&mut rng, sigma_depth(in_camera.z)).x;
                let flips: [f64; 256] = std::array::from_fn(|_| rng.random());
                let mut descriptor = point.descriptor.to_vec();
                for (bit, flip) in flips.iter().enumerate() {
                    descriptor[bit / 8] ^= u8::from(*flip < FLIPPED) << (bit % 8);
                }
                let known = last_seen.get(&index).filter(|(last, _)| k - last <= MEMORY);
                let landmark = known.map_or(point_of.len() as i64, |&(_, id)| id);
                point_of.insert(landmark, index);
                last_seen.insert(index, (k, landmark));
                let depth_m = in_camera.z + noise;
                views.push(Seen { point: index, pixel, depth_m, descriptor, landmark });
            }
            seen.push(views);
        }
        let mut odometry = vec![truth[0]];
        for pair in seen.windows(2).enumerate() {
            let (k, views) = pair;
            let start = truth[k].inverse().compose(&truth[k + 1]);
            let motion = measure(&camera, &matches(&views[0], &views[1]), &start).unwrap();
            odometry.push(odometry[k].compose(&motion.a_from_b));
        }
        let once_around = (lap / STEP_M) as usize;
        let again = (once_around + 5..count).step_by(5);
        let closures = again.map(|j| {
            let i = j - once_around;
            let start = truth[i].inverse().compose(&truth[j]);
            let found = measure(&camera, &matches(&seen[i], &seen[j]), &start).unwrap();
            let matrix = found.information.matrix();
            let upper = (0..6).flat_map(|r| (r..6).map(move |c| (r, c)));
            (i, j, found.a_from_b, upper.map(|at| matrix[at]).collect())
        });
        let closures = closures.collect();
        Self { truth, odometry, seen, closures, point_of }
    }

    fn items(&self) -> Vec<Item> {
        let model = v1::camera::Model::PinholeRadialTangential(v1::PinholeRadialTangential {
            fx: 525.0,
            fy: 525.0,
            cx: 319.5,
            cy: 239.5,
            ..Default::default()
        });
        let size =
            v1::Camera { width_px: 640, height_px: 480, model: Some(model), ..Default::default() };
        let mut items = vec![Item::Camera(size)];
        let mut known = BTreeSet::new();
        for (k, (pose, views)) in self.odometry.iter().zip(&self.seen).enumerate() {
            let mut landmarks = Vec::new();
            let observation = |seen: &Seen| {
                let id = seen.landmark;
                if known.insert(id) {
                    landmarks.push(v1::Landmark { id, ..Default::default() });
                }
                v1::Observation {
                    landmark: Some(v1::LandmarkRef { id, ..Default::default() }),
                    pixel: Some(v1::Vector2 { x: seen.pixel.x, y: seen.pixel.y }),
                    sigma_px: Some(SIGMA_PX),
                    depth_m: Some(seen.depth_m),
                    sigma_depth_m: Some(sigma_depth(seen.depth_m)),
                    descriptor: Some(v1::Descriptor {
                        kind: v1::DescriptorKind::Binary.into(),
                        name: "orb".to_owned(),
                        data: seen.descriptor.clone(),
                    }),
                    ..Default::default()
                }
            };
            let observations = views.iter().map(observation).collect();
            let nanos = (k % 10) as i32 * 100_000_000;
            items.push(Item::Keyframe(v1::Keyframe {
                id: k as i64,
                capture_time: Some(prost_types::Timestamp { seconds: k as i64 / 10, nanos }),
                sensor: Some(v1::keyframe::Sensor::CameraId(0)),
                world_from_camera: Some(transform(pose)),
                odom_from_camera: Some(transform(pose)),
                observations,
                landmarks,
                ..Default::default()
            }));
        }
        for (id, (i, j, measured, information)) in self.closures.iter().enumerate() {
            let keyframe =
                |id: usize| Some(v1::KeyframeRef { id: id as i64, ..Default::default() });
            items.push(Item::RelativePose(v1::RelativePoseConstraint {
                id: id as i64,
                keyframe_i: keyframe(*i),
                keyframe_j: keyframe(*j),
                keyframe_i_from_keyframe_j: Some(transform(measured)),
                information: Some(v1::InformationMatrix6 { upper_triangle: information.clone() }),
                kind: v1::ConstraintKind::LoopClosure.into(),
                ..Default::default()
            }));
        }
        items
    }

    /// How many landmarks are points that had an id before.
    fn duplicate_count(&self) -> usize {
        let points: BTreeSet<usize> = self.point_of.values().copied().collect();
        self.point_of.len() - points.len()
    }
}

async fn read(server: &TestServer, name: &str) -> (Vec<Se3>, Vec<v1::Landmark>) {
    let request = v1::WatchMapRequest { map_id: name.to_owned(), ..Default::default() };
    let mut watch = server.maps().watch_map(request).await.unwrap().into_inner();
    let (mut poses, mut landmarks) = (Vec::new(), Vec::new());
    loop {
        let delta = watch.message().await.unwrap().unwrap().delta.unwrap();
        for keyframe in delta.keyframes {
            let pose_in_world = keyframe.world_from_camera.unwrap();
            let (t, q) = (pose_in_world.translation.unwrap(), pose_in_world.rotation.unwrap());
            poses.push((keyframe.keyframe.unwrap().id, pose(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w])));
        }
        landmarks.extend(delta.landmarks);
        if delta.last_part {
            break;
        }
    }
    poses.sort_by_key(|(id, _)| *id);
    (poses.into_iter().map(|(_, pose)| pose).collect(), landmarks)
}

#[test]
fn after_a_loop_of_300_m_duplicates_are_found_and_the_error_is_a_third() {
    let walk = Walk::new(5);
    run(async {
        let server = TestServer::with(|config| config.engine.lock_step = true).await;
        let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
        server.create_map_with("block", policy).await;
        let (stream, _) = Stream::open(&server, "block", "robot", 0).await;
        for (sequence, item) in (1..).zip(walk.items()) {
            stream.send(sequence, item).await;
        }
        for ack in stream.finish().await.unwrap() {
            assert!(ack.violations.is_empty(), "{ack:?}");
        }
        let (poses, landmarks) = read(&server, "block").await;
        let (before, after) = (ate(&walk.odometry, &walk.truth), ate(&poses, &walk.truth));
        let found: Vec<(i64, i64)> = landmarks
            .iter()
            .filter_map(|landmark| Some((landmark.duplicate_of.as_ref()?.id, landmark.id)))
            .collect();
        let is_right = |(a, b): &&(i64, i64)| walk.point_of[a] == walk.point_of[b];
        let (all, right) = (walk.duplicate_count(), found.iter().filter(is_right).count());
        println!(
            "ATE {before:.3} m by odometry, {after:.3} m; {all} duplicates, {} found, {right} right",
            found.len()
        );
        assert!(3.0 * after <= before, "{after} of {before} m");
        assert!(10 * right >= 9 * all, "{right} of {all}");
        assert!(200 * (found.len() - right) <= found.len(), "{} wrong", found.len() - right);

        // Without its closures nothing says that they are.
        let (stream, opened) = Stream::open(&server, "block", "robot", 0).await;
        let revoke = |id: usize| v1::RevokeConstraint {
            constraint: Some(v1::ConstraintRef { id: id as i64, ..Default::default() }),
        };
        for (sequence, id) in (opened.next_sequence..).zip(0..walk.closures.len()) {
            stream.send(sequence, revoke(id).into()).await;
        }
        for ack in stream.finish().await.unwrap() {
            assert!(ack.violations.is_empty(), "{ack:?}");
        }
        let (poses, landmarks) = read(&server, "block").await;
        assert!(landmarks.iter().all(|landmark| landmark.duplicate_of.is_none()));
        let again = ate(&poses, &walk.truth);
        assert!(2.0 * again >= before, "{again} m without closures, {before} m by odometry");
    });
}
