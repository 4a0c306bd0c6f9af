//! A walk around a block with a depth camera's noise: after a loop closure the landmarks that are one
//! point are found, and the map is adjusted.
//!
//! The robot walks 300 m along the corridors around a square and 25 m further. It sees and tracks as that
//! of [`made_sequence`](crate::made_sequence), and closes the loop by all that it sees again.

use std::collections::{BTreeMap, BTreeSet};

use covis::wire::v1;
use covis_solvers::geometry::{Camera, LieGroup, Se3};
use covis_solvers::relative_motion::{Match, measure};
use covis_solvers::testing::random::{normal_vector, seeded};
use nalgebra::Vector3;
use rand::RngExt;

use crate::common::{Stream, TestServer, run};
use crate::made_sequence::{
    FLIPPED, MEMORY, Made, SIGMA_PX, Seen, closure, common, looking, matched, pinhole, sigma_depth,
    wire,
};
use crate::sequence::{Order, Sequence, ate, items, pose, without_recognition};

/// Length of a side of the square, m.
const SIDE_M: f64 = 75.0;
/// Distance of keyframes, m.
const STEP_M: f64 = 0.4;
/// Points per meter of the corridor.
const POINTS_PER_M: usize = 40;
/// How far along the corridor the camera sees, m.
const SIGHT_M: f64 = 7.0;

/// A point of the scene.
struct Point {
    position: Vector3<f64>,
    /// Where it is along the way, m.
    along: f64,
    descriptor: [u8; 32],
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
    looking(angle, position.xy())
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

/// The sequence of a seed.
pub(crate) fn walk(seed: u64) -> Made {
    let mut rng = seeded(seed);
    let points = scene(&mut rng);
    let lap = 4.0 * SIDE_M;
    let count = ((lap + 25.0) / STEP_M) as usize;
    let camera = Camera::Pinhole(pinhole());
    let truth: Vec<Se3> = (0..count).map(|k| true_pose(k as f64 * STEP_M)).collect();
    let mut last_seen: BTreeMap<usize, (usize, i64)> = BTreeMap::new();
    let mut point_of = BTreeMap::new();
    let mut seen: Vec<Vec<Seen>> = Vec::new();
    let mut observations = Vec::new();
    let mut descriptors = Vec::new();
    for (k, pose) in truth.iter().enumerate() {
        let along = k as f64 * STEP_M;
        let mut views = Vec::new();
        let mut rows = Vec::new();
        let mut own = Vec::new();
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
            let view = Seen { point: index, pixel, depth_m: in_camera.z + noise };
            rows.push(view.observation(landmark));
            own.push(descriptor);
            views.push(view);
        }
        seen.push(views);
        observations.push(rows);
        descriptors.push(own);
    }
    let motion = |i: usize, j: usize| {
        let matches: Vec<Match> =
            common(&seen[i], &seen[j]).iter().map(|[a, b]| matched(a, b, true)).collect();
        let start = truth[i].inverse().compose(&truth[j]);
        measure(&camera, &matches, &start).unwrap()
    };
    let mut odometry = vec![(0.0, truth[0])];
    for k in 1..count {
        let pose = odometry[k - 1].1.compose(&motion(k - 1, k).a_from_b);
        odometry.push((0.1 * k as f64, pose));
    }
    let once_around = (lap / STEP_M) as usize;
    let again = (once_around + 5..count).step_by(5);
    let again = again.map(|j| (j - once_around, j));
    let closures = again.map(|(i, j)| closure([i, j], &motion(i, j))).collect();
    let matches = Vec::new();
    let sequence =
        Sequence { camera: wire(), odometry, truth, observations, descriptors, closures, matches };
    Made { sequence, point_of }
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
    let walk = walk(5);
    let (point_of, walk) = (walk.point_of, walk.sequence);
    run(async {
        let server = TestServer::lock_step().await;
        let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
        server.create_map_with("block", without_recognition(policy)).await;
        let (stream, _) = Stream::open(&server, "block", "robot", 0).await;
        for (sequence, item) in (1..).zip(items(&walk, &walk.closures, Order::Burst)) {
            stream.send(sequence, item).await;
        }
        for ack in stream.finish().await.unwrap() {
            assert!(ack.violations.is_empty(), "{ack:?}");
        }
        let (poses, landmarks) = read(&server, "block").await;
        let (before, after) = (ate(&walk.poses(), &walk.truth), ate(&poses, &walk.truth));
        let found: Vec<(i64, i64)> = landmarks
            .iter()
            .filter_map(|landmark| Some((landmark.duplicate_of.as_ref()?.id, landmark.id)))
            .collect();
        let is_right = |(a, b): &&(i64, i64)| point_of[a] == point_of[b];
        // Landmarks that are points that had an id before.
        let all = point_of.len() - point_of.values().collect::<BTreeSet<_>>().len();
        let right = found.iter().filter(is_right).count();
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
