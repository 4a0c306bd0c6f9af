//! Odometry of a bag: what arrives at the server is the motion of the camera, tracking gains from it where images
//! are far apart or dark, and a bag whose odometry is not named is tracked as if it had none.
//!
//! Bags are made of a rendered walk. Odometry is that of a base that looks elsewhere than the camera.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use covis::client::Client;
use covis::frontend::camera::FrameCamera;
use covis::frontend::image::{Image, RgbdFrame};
use covis::frontend::input::fuzzing::ros_messages::{camera_info, image, pose, transforms};
use covis::frontend::input::recording::{RecordingOptions, TopicNames, open_recording};
use covis::frontend::mapping::run::{Companion, MOST_HELD, RunReport, Target, run as track};
use covis::frontend::pipeline::{Outcome, Pipeline, PipelineOptions};
use covis::frontend::synthetic::{SceneName, Sequence, SequenceOptions};
use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3, So3};
use fs_err as fs;
use nalgebra::Vector3;

use crate::cli_support::Workspace;
use crate::common::{TestServer, run};
use crate::frontend_beside::connected;

/// Frames of the walk.
const FRAMES: usize = 160;
/// Messages of odometry between two frames of the walk.
const PER_FRAME: usize = 2;

fn walk() -> Sequence {
    let (width, height, seed) = (320, 240, 7);
    let options = SequenceOptions { width, height, frames: FRAMES, seed, noise: true };
    Sequence::new(SceneName::Loop, &options)
}

/// The static transforms from the base to the camera, and base_from_camera.
fn mounted() -> (Vec<u8>, Se3) {
    let parts = [
        ("base", "mast", [0.1, -0.2, 0.8, 0.0, 0.0, 0.6, 0.8]),
        ("mast", "optical", [0.05, 0.0, 0.02, -0.5, 0.5, -0.5, 0.5]),
    ];
    let pose = |[x, y, z, i, j, k, w]: [f64; 7]| {
        Se3::new(So3::from_quaternion_xyzw(i, j, k, w).unwrap(), Vector3::new(x, y, z))
    };
    (transforms(&parts), pose(parts[0].2).compose(&pose(parts[1].2)))
}

/// Where odometry has the camera, at each message. Between two of them it is off by up to these shares, of the way
/// and of the turn.
fn odometry(walk: &Sequence, shares: [f64; 2]) -> Vec<(f64, Se3)> {
    let mut odom_from_camera =
        Se3::new(So3::exp(&Vector3::new(0.3, -1.0, 2.0)), Vector3::new(5.0, 6.0, 7.0));
    let mut messages = vec![(walk.timestamp_s(0), odom_from_camera)];
    for index in 1..FRAMES {
        let [before, now] = [index - 1, index].map(|index| walk.world_from_camera(index));
        let mut twist = before.inverse().compose(&now).log() / PER_FRAME as f64;
        for axis in 0..6 {
            // Wheels err alike for a while: an error of one sign.
            twist[axis] *= 1.0 + shares[axis / 3] * if axis % 2 == 0 { 1.0 } else { -1.0 };
        }
        let [from_s, to_s] = [index - 1, index].map(|index| walk.timestamp_s(index));
        for part in 1..=PER_FRAME {
            odom_from_camera = odom_from_camera.compose(&Se3::exp(&twist));
            let share = part as f64 / PER_FRAME as f64;
            let time_s = if part == PER_FRAME { to_s } else { from_s + (to_s - from_s) * share };
            messages.push((time_s, odom_from_camera));
        }
    }
    messages
}

/// A bag of every `step`th frame of the walk, dark ones in `dark`, with odometry of the base where it has shares.
fn write(path: &Path, step: usize, dark: std::ops::Range<usize>, shares: Option<[f64; 2]>) {
    let walk = walk();
    let options = mcap::WriteOptions::new().profile("ros2").compression(None);
    let mut writer = options.create(fs::File::create(path).unwrap()).unwrap();
    let mut put = |topic: &str, type_name: &str, messages: Vec<Vec<u8>>| {
        let schema = writer.add_schema(type_name, "ros2msg", b"").unwrap();
        let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap();
        for message in messages {
            let (sequence, log_time, publish_time) = (0, 0, 0);
            let header =
                mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
            writer.write_to_known_channel(&header, &message).unwrap();
        }
    };
    let (static_transforms, base_from_camera) = mounted();
    let mut images = [Vec::new(), Vec::new()];
    for index in (0..FRAMES).step_by(step) {
        let RgbdFrame { timestamp_s, color, depth_m, .. } = walk.frame(index);
        let size = color.size();
        let black = Image::filled(size.0, size.1, [0; 3]);
        let color = if dark.contains(&index) { black } else { color };
        let bytes: Vec<u8> =
            depth_m.pixels().iter().flat_map(|depth| depth.to_le_bytes()).collect();
        let color = color.pixels().as_flattened();
        images[0].push(image(timestamp_s, "optical", "rgb8", size, color));
        images[1].push(image(timestamp_s, "optical", "32FC1", size, &bytes));
    }
    let [color, depth] = images;
    let c = walk.camera();
    let pinhole = [c.fx, c.fy, c.cx, c.cy];
    let info = camera_info("optical", (320, 240), "plumb_bob", pinhole, &[0.0; 5]);
    let camera_from_base = base_from_camera.inverse();
    let message = |(time_s, odom_from_camera): (f64, Se3)| {
        let Se3 { rotation, translation: t } = odom_from_camera.compose(&camera_from_base);
        let q = rotation.quaternion();
        pose(time_s, "odom", Some("base"), [t.x, t.y, t.z, q.i, q.j, q.k, q.w])
    };
    let poses = |shares| odometry(&walk, shares).into_iter().map(message).collect();
    put("/cam/color/image_raw", "sensor_msgs/msg/Image", color);
    put("/cam/depth_registered/image_raw", "sensor_msgs/msg/Image", depth);
    put("/cam/color/camera_info", "sensor_msgs/msg/CameraInfo", vec![info]);
    if let Some(shares) = shares {
        put("/wheels/odom", "nav_msgs/msg/Odometry", poses(shares));
        put("/tf_static", "tf2_msgs/msg/TFMessage", vec![static_transforms]);
    }
    writer.finish().unwrap();
}

struct Nobody;

impl Companion for Nobody {
    fn mask(&mut self, _timestamp_s: f64) -> Option<Image<u8>> {
        None
    }

    fn tracked(&mut self, _frame: &RgbdFrame, _outcome: &Outcome) {}

    fn skipped(&mut self, error: &covis::frontend::input::FrameError) {
        panic!("{error}");
    }
}

/// Tracks a bag into a map, with its odometry or without.
async fn tracked(client: &Client, map_id: &str, bag: &Path, odometry: Option<&str>) -> RunReport {
    client.create_map(map_id, None).await.unwrap();
    let topics = TopicNames { odometry, ..TopicNames::default() };
    let options = RecordingOptions { topics, ..RecordingOptions::default() };
    let source = open_recording(bag, options, |_, _| true).unwrap().source;
    let camera = FrameCamera::new(*source.camera(), 320, 240).unwrap();
    let (timing, has_odometry) = (source.timing(), source.has_odometry());
    assert_eq!(has_odometry, odometry.is_some());
    let options = PipelineOptions { timing, has_odometry, ..PipelineOptions::default() };
    let pipeline = Pipeline::new(camera, options);
    let (client_id, lock_step, most_held) = ("robot", true, MOST_HELD);
    let target = Target { client, map_id, client_id, lock_step, most_held };
    track(source, pipeline, target, false, Nobody, None).await.unwrap().0
}

/// The frame of the walk at a time.
fn frame_at(timestamp_s: f64) -> usize {
    let first_s = walk().timestamp_s(0);
    ((timestamp_s - first_s) * covis::frontend::synthetic::RATE_HZ).round() as usize
}

/// How many frames were tracked to within 5 cm, and the largest distance of one to where it was, m.
fn errors(report: &RunReport) -> (usize, f64) {
    let walk = walk();
    let first = walk.world_from_camera(0);
    let distance = |&(timestamp_s, found): &(f64, Se3)| {
        let truth = first.inverse().compose(&walk.world_from_camera(frame_at(timestamp_s)));
        (found.translation - truth.translation).norm()
    };
    let distances: Vec<f64> = report.trajectory.iter().map(distance).collect();
    let near = distances.iter().filter(|distance| **distance < 0.05).count();
    (near, distances.into_iter().fold(0.0, f64::max))
}

fn bag(
    step: usize,
    dark: std::ops::Range<usize>,
    shares: [f64; 2],
) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.mcap");
    write(&path, step, dark, Some(shares));
    (folder, path)
}

#[test]
fn odometry_of_another_frame_arrives_as_the_motion_of_the_camera() {
    run(async {
        let server = TestServer::start().await;
        let client = connected(&server).await;
        let (_folder, path) = bag(2, 0..0, [0.0; 2]);
        let report = tracked(&client, "m", &path, Some("/wheels/odom")).await;
        assert!(report.keyframes.len() > 5, "{}", report.keyframes.len());
        let se3 = |pose: &Option<v1::RigidTransform>| {
            let pose = pose.as_ref().unwrap();
            let (q, t) = (pose.rotation.as_ref().unwrap(), pose.translation.as_ref().unwrap());
            let rotation = So3::from_quaternion_xyzw(q.x, q.y, q.z, q.w).unwrap();
            Se3::new(rotation, Vector3::new(t.x, t.y, t.z))
        };
        let walk = walk();
        let listed = client.keyframes("m", None).await.unwrap().keyframes;
        let mut keyframes: Vec<(usize, Se3)> = listed
            .iter()
            .map(|keyframe| {
                let time = keyframe.capture_time.as_ref().unwrap();
                let seconds = time.seconds as f64 + f64::from(time.nanos) * 1e-9;
                (frame_at(seconds), se3(&keyframe.odom_from_camera))
            })
            .collect();
        keyframes.sort_by_key(|(frame, _)| *frame);
        assert_eq!(keyframes.len(), report.keyframes.len());
        for pair in keyframes.windows(2) {
            let [(a, odom_from_a), (b, odom_from_b)] = pair else { unreachable!() };
            let [world_from_a, world_from_b] = [a, b].map(|&index| walk.world_from_camera(index));
            let truth = world_from_a.inverse().compose(&world_from_b);
            let sent = odom_from_a.inverse().compose(odom_from_b);
            let error = truth.inverse().compose(&sent).log().norm();
            assert!(error < 1e-9, "frames {a} and {b}: {error}");
        }
    });
}

#[test]
#[allow(clippy::print_stdout, reason = "decision 0049 has these figures")]
fn odometry_carries_tracking_where_frames_are_far_apart_and_through_the_dark() {
    run(async {
        let server = TestServer::start().await;
        let client = connected(&server).await;
        for (name, step, dark) in
            [("usual", 2, 0..0), ("fast", 4, 0..0), ("faster", 8, 0..0), ("dark", 2, 40..80)]
        {
            let (_folder, path) = bag(step, dark.clone(), [0.02, 0.02]);
            let all = (0..FRAMES).step_by(step).filter(|index| !dark.contains(index)).count();
            let [without, with] = ["without", "with"].map(|which| format!("{name}-{which}"));
            let (near, most_m) = errors(&tracked(&client, &without, &path, None).await);
            let report = tracked(&client, &with, &path, Some("/wheels/odom")).await;
            let (near_with, most_with_m) = errors(&report);
            println!(
                "{name}: of {all} frames {near} are within 5 cm, {most_m:.4} m off at most; with odometry \
                 {near_with}, {most_with_m:.4} m"
            );
            let gains = ["faster", "dark"].contains(&name);
            assert!(near_with >= near + usize::from(gains), "{name}: {near_with}, not {near}");
            assert!(100 * near_with >= 90 * all, "{name}: {near_with} of {all}");
        }
    });
}

#[test]
fn a_bag_is_tracked_without_its_odometry_unless_the_topic_is_named() {
    let workspace = Workspace::new();
    write(&workspace.path("walk.mcap"), 4, 0..0, Some([0.02; 2]));
    write(&workspace.path("images.mcap"), 4, 0..0, None);
    let ran = workspace.run("--log info run walk.mcap --out out --lock-step --json", &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(
        ran.stderr
            .contains("not used: /wheels/odom: nav_msgs/msg/Odometry, 319 messages; --odometry"),
        "{}",
        ran.stderr
    );
    let images = "--log warn run images.mcap --out images --lock-step --json";
    assert_eq!(workspace.run(images, &[]).code, Some(0));
    let with = "--log info run walk.mcap --odometry /wheels/odom --out with --lock-step --json";
    let ran = workspace.run(with, &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(
        ran.stderr.contains("odometry from /wheels/odom: nav_msgs/msg/Odometry"),
        "{}",
        ran.stderr
    );
    let trajectory =
        |out: &str| fs::read_to_string(workspace.path(out).join("trajectory.txt")).unwrap();
    assert_eq!(trajectory("out"), trajectory("images"));
    assert_ne!(trajectory("with"), trajectory("images"));
    workspace.run("--log error run walk.mcap --odometry /odom --out none", &[]).expect_failure(&[
        "`/odom` is not a topic for odometry",
        "/wheels/odom: nav_msgs/msg/Odometry",
    ]);
    workspace
        .run("--log error run synthetic:static --odometry /odom --out none", &[])
        .expect_failure(&["topics are named for an MCAP file or a bag"]);
}
