//! Drives whose second half degenerates: nothing is seen, views determine no motion, or a motion determines no
//! landmark. Whatever it is, no keyframe ends much farther from the truth than odometry alone does.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::testing::random::{normal_vector, seeded, uniform_vector};
use nalgebra::Vector3;
use v1::ingest_request::Item;

use crate::common::{CENTER, FOCAL, Stream, TestServer, camera, run};
use crate::rpc_odometry::{message, se3};

const KEYFRAMES: usize = 20;
/// From here on it degenerates.
const GOOD: usize = 10;
const SIGMA_PX: f64 = 0.5;
/// How many times farther off than odometry at its worst a keyframe may be, and by how much in addition, m.
const MOST: (f64, f64) = (2.0, 0.01);

/// What becomes of the drive.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Case {
    Healthy,
    OneLandmark,
    Nothing,
    /// Everything is 10,000 times as far away.
    Far,
    /// What it saw before lies behind the camera and is seen as if it were ahead.
    Behind,
    Planar,
    Rotation,
    Stopped,
    /// All keyframes have one capture time.
    OneTime,
}

/// Landmark, pixel, depth and its deviation.
type View = (i64, [f64; 2], f64, f64);

struct Drive {
    truth: Vec<Se3>,
    odometry: Vec<Se3>,
    /// What each keyframe sees.
    views: Vec<Vec<View>>,
}

fn drive(case: Case) -> Drive {
    let mut rng = seeded(7);
    let place = |point: Vector3<f64>| match case == Case::Planar {
        true => Vector3::new(1.5 * point.x, 2.0 * point.y, 20.0),
        false => point,
    };
    let landmarks: Vec<Vector3<f64>> = (0..900)
        .map(|_| uniform_vector::<3>(&mut rng, 1.0))
        .map(|unit| place(Vector3::new(6.0 * unit.x, 2.5 * unit.y, 21.0 + 19.0 * unit.z)))
        .collect();
    let step = |k: usize| {
        let is_bad = k > GOOD;
        if is_bad && case == Case::Rotation {
            (Vector3::zeros(), 0.14)
        } else if is_bad && case == Case::Stopped {
            (Vector3::zeros(), 0.0)
        } else {
            (0.4 * Vector3::z(), 0.017)
        }
    };
    let (mut truth, mut odometry) = (vec![Se3::identity()], vec![Se3::identity()]);
    for k in 1..KEYFRAMES {
        let (way, turn) = step(k);
        let step = Se3::new(So3::exp(&(turn * Vector3::y())), way);
        let noise = normal_vector::<6>(&mut rng, 1.0);
        let sigma = 0.01 * way.norm() + 5e-4;
        let noise = Se3::new(
            So3::exp(&(9e-4 * noise.fixed_rows::<3>(3))),
            sigma * noise.fixed_rows::<3>(0),
        );
        truth.push(truth[k - 1].compose(&step));
        odometry.push(odometry[k - 1].compose(&step.compose(&noise)));
    }
    let mut seen_before = BTreeSet::new();
    let views = truth.iter().enumerate().map(|(k, pose)| {
        let is_bad = k >= GOOD;
        let mut views = Vec::new();
        for (id, landmark) in (0..).zip(&landmarks) {
            let (id, landmark) = match is_bad && case == Case::Far {
                true => (id + 1000, 1e4 * landmark),
                false => (id, *landmark),
            };
            let mut point = pose.inverse_transform(&landmark);
            let is_ahead = point.z > 1.0;
            if is_bad && case == Case::Behind {
                point.z = -point.z;
            }
            let pixel = point.xy() / point.z * FOCAL + nalgebra::Vector2::from(CENTER);
            let pixel = pixel + normal_vector::<2>(&mut rng, SIGMA_PX);
            let sigma = 0.002 + 0.0025 * point.z * point.z;
            let depth = (point.z + sigma * normal_vector::<1>(&mut rng, 1.0).x).max(0.01);
            let fits = (0.0..640.0).contains(&pixel.x) && (0.0..480.0).contains(&pixel.y);
            let is_seen = match is_bad && case == Case::Behind {
                true => !is_ahead && seen_before.contains(&id),
                false => is_ahead,
            };
            if is_seen && fits {
                views.push((id, pixel.into(), depth, sigma));
            }
        }
        views.truncate(match case {
            Case::OneLandmark if is_bad => 1,
            Case::Nothing if is_bad => 0,
            Case::OneLandmark
            | Case::Nothing
            | Case::Healthy
            | Case::Far
            | Case::Behind
            | Case::Planar
            | Case::Rotation
            | Case::Stopped
            | Case::OneTime => 80,
        });
        seen_before.extend(views.iter().map(|view: &View| view.0));
        views
    });
    let views = views.collect();
    Drive { truth, odometry, views }
}

impl Drive {
    /// The keyframes that a client sends that tracks without corrections, in a unit that is `unit` of a meter.
    fn keyframes(&self, case: Case, with_depth: bool, unit: f64) -> Vec<v1::Keyframe> {
        let mut known = BTreeSet::new();
        let keyframe = |k: usize| {
            let start = Se3::new(self.odometry[k].rotation, self.odometry[k].translation / unit);
            let views = &self.views[k];
            let landmarks = views.iter().map(|view| view.0).filter(|&id| known.insert(id));
            let landmarks = landmarks.map(|id| v1::Landmark { id, ..Default::default() }).collect();
            let observations = views.iter().map(|&(id, [x, y], depth, sigma)| v1::Observation {
                landmark: Some(v1::LandmarkRef { id, ..Default::default() }),
                pixel: Some(v1::Vector2 { x, y }),
                sigma_px: Some(SIGMA_PX),
                depth_m: with_depth.then_some(depth / unit),
                sigma_depth_m: with_depth.then_some(sigma / unit),
                ..Default::default()
            });
            let seconds = if case == Case::OneTime { 100 } else { 100 + k as i64 };
            v1::Keyframe {
                id: k as i64,
                capture_time: Some(prost_types::Timestamp { seconds, nanos: 0 }),
                sensor: Some(v1::keyframe::Sensor::CameraId(0)),
                world_from_camera: Some(message(&start)),
                observations: observations.collect(),
                landmarks,
                ..Default::default()
            }
        };
        (0..KEYFRAMES).map(keyframe).collect()
    }

    fn error(&self, k: usize, pose: &Se3) -> f64 {
        (pose.translation - self.truth[k].translation).norm()
    }
}

/// Sends a drive into a map of its own. Returns how far off its farthest keyframe is, and that of the odometry, m.
async fn farthest(server: &TestServer, case: Case, with_depth: bool, unit: f64) -> (f64, f64) {
    let drive = drive(case);
    let map_id = format!("{case:?}-{with_depth}-{}", unit.log10()).to_lowercase();
    server.create_map(&map_id).await;
    let (mut stream, _) = Stream::open(server, &map_id, "robot", 0).await;
    stream.put(1, Item::Camera(camera(0))).await;
    for (k, keyframe) in (2..).zip(drive.keyframes(case, with_depth, unit)) {
        let ack = stream.put(k, Item::Keyframe(keyframe)).await;
        assert!(ack.violations.is_empty(), "{ack:?}");
    }
    for ack in stream.finish().await.unwrap() {
        assert!(ack.solve_failure.is_none(), "{case:?}: {ack:?}");
    }
    let delta = server.watched(&map_id).await;
    let error = |keyframe: &v1::KeyframePose| {
        let pose = se3(keyframe.world_from_camera.as_ref().unwrap());
        drive.error(
            keyframe.keyframe.as_ref().unwrap().id as usize,
            &Se3::new(pose.rotation, pose.translation * unit),
        )
    };
    let map = delta.keyframes.iter().map(error).fold(0.0, f64::max);
    let odometry = (0..KEYFRAMES).map(|k| drive.error(k, &drive.odometry[k])).fold(0.0, f64::max);
    (map, odometry)
}

#[test]
fn whatever_becomes_of_the_views_no_keyframe_ends_farther_off_than_odometry_explains() {
    use Case::{Behind, Far, Healthy, Nothing, OneLandmark, OneTime, Planar, Rotation, Stopped};
    run(async {
        let server = TestServer::lock_step().await;
        let mut off = String::new();
        for case in [Healthy, OneLandmark, Nothing, Far, Behind, Planar, Rotation, Stopped, OneTime]
        {
            for (with_depth, unit) in [(true, 1.0), (false, 1.0), (true, 1e3), (false, 1e-3)] {
                let (map, odometry) = farthest(&server, case, with_depth, unit).await;
                if map > MOST.0 * odometry + MOST.1 {
                    let depth = if with_depth { "depth" } else { "no depth" };
                    writeln!(
                        off,
                        "{case:?}, {depth}, unit {unit} m: {map} m, odometry {odometry} m"
                    )
                    .unwrap();
                }
            }
        }
        assert!(off.is_empty(), "{off}");
    });
}
