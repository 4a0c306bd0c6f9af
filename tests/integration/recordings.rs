//! `covis run` on MCAP files and rosbag2 folders: the same trajectory, to the bit, as from the folder of images
//! that they were made of, and what is said of topics, cuts and bags that cannot be read.
//!
//! Bags are written by the Python package rosbags where `COVIS_TEST_PYTHON` (or `python3`) has it; MCAP files
//! by the crate of the format's authors, everywhere.

use std::path::Path;
use std::process::Command;

use covis::frontend::image::RgbdFrame;
use covis::frontend::input::fuzzing::ros_messages::{
    camera_info, foxglove, image, point_cloud, pose,
};
use covis::frontend::input::{FolderOptions, open_folder};
use covis_solvers::testing::{data, skip};
use fs_err as fs;
use serde_json::json;

use crate::cli_support::{Ran, Workspace, number};

/// What the layout of the TUM benchmark assumes and a recording does not.
const KINECT: &str = "--readout-ms 26.1 --depth-late-ms -15";

/// The first frames of a folder, and its camera.
fn frames(folder: &Path, count: usize) -> (Vec<RgbdFrame>, [f64; 9]) {
    let mut source = open_folder(folder, FolderOptions::default()).unwrap().source;
    let c = *source.camera();
    let camera = [c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3];
    let frames = (0..count).map_while(|_| source.next_frame()).map(Result::unwrap);
    (frames.collect(), camera)
}

fn meters(frame: &RgbdFrame) -> Vec<u8> {
    frame.depth_m.pixels().iter().flat_map(|depth| depth.to_le_bytes()).collect()
}

/// The times of color and depth.
fn times_s(frame: &RgbdFrame) -> [f64; 2] {
    [frame.timestamp_s, frame.timestamp_s + frame.depth_delay_s]
}

/// An MCAP file of these frames, in messages of ROS 2 or of Foxglove.
fn write_mcap(
    path: &Path,
    frames: &[RgbdFrame],
    camera: &[f64; 9],
    compression: bool,
    is_foxglove: bool,
) {
    let compression = compression.then_some(mcap::Compression::Zstd);
    let options = mcap::WriteOptions::new().profile("ros2").compression(compression);
    let mut writer = options.create(fs::File::create(path).unwrap()).unwrap();
    let mut channel = |topic: &str, ros: &str, foxglove: &str| {
        let (name, schema, message) = match is_foxglove {
            true => (format!("foxglove.{foxglove}"), "protobuf", "protobuf"),
            false => (format!("sensor_msgs/msg/{ros}"), "ros2msg", "cdr"),
        };
        let schema = writer.add_schema(&name, schema, b"").unwrap();
        writer.add_channel(schema, topic, message, &Default::default()).unwrap()
    };
    let channels = [
        channel("/cam/color/image_raw", "Image", "RawImage"),
        channel("/cam/depth_registered/image_raw", "Image", "RawImage"),
        channel("/cam/color/camera_info", "CameraInfo", "CameraCalibration"),
        channel("/imu", "Imu", "Log"),
    ];
    let [fx, fy, cx, cy, d @ ..] = *camera;
    for frame in frames {
        let ([color_s, depth_s], size) = (times_s(frame), frame.color.size());
        let color = frame.color.pixels().as_flattened();
        let pinhole = [fx, fy, cx, cy];
        let messages = match is_foxglove {
            true => [
                foxglove::raw_image(color_s, "color", "rgb8", size, color),
                foxglove::raw_image(depth_s, "color", "32FC1", size, &meters(frame)),
                foxglove::camera_calibration("color", size, "plumb_bob", pinhole, &d),
                Vec::new(),
            ],
            false => [
                image(color_s, "color", "rgb8", size, color),
                image(depth_s, "color", "32FC1", size, &meters(frame)),
                camera_info("color", size, "plumb_bob", pinhole, &d),
                vec![0, 1, 0, 0],
            ],
        };
        for (channel_id, message) in channels.into_iter().zip(messages) {
            let log_time = (color_s * 1e9) as u64;
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: 0,
                log_time,
                publish_time: log_time,
            };
            writer.write_to_known_channel(&header, &message).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// An MCAP file of these frames, with depth as points in rows, in this frame. Color is in the frame `color`.
fn write_clouds(path: &Path, frames: &[RgbdFrame], camera: &[f64; 9], frame_id: &str) {
    let mut writer = mcap::Writer::new(fs::File::create(path).unwrap()).unwrap();
    let mut channel = |topic: &str, kind: &str| {
        let schema = writer.add_schema(kind, "ros2msg", b"").unwrap();
        writer.add_channel(schema, topic, "cdr", &Default::default()).unwrap()
    };
    let channels = [
        channel("/cam/color/image_raw", "sensor_msgs/msg/Image"),
        channel("/cam/points", "sensor_msgs/msg/PointCloud2"),
        channel("/cam/color/camera_info", "sensor_msgs/msg/CameraInfo"),
        channel("/lidar/points", "sensor_msgs/msg/PointCloud2"),
    ];
    let [fx, fy, cx, cy, d @ ..] = *camera;
    for frame in frames {
        let ([color_s, depth_s], size) = (times_s(frame), frame.color.size());
        let point = |(index, &z): (usize, &f32)| {
            let [u, v] = [index % size.0, index / size.0].map(|at| at as f32);
            let [x, y] = [(u - cx as f32) / fx as f32 * z, (v - cy as f32) / fy as f32 * z];
            if z > 0.0 { [x, y, z] } else { [f32::NAN; 3] }
        };
        let points: Vec<_> = frame.depth_m.pixels().iter().enumerate().map(point).collect();
        let messages = [
            image(color_s, "color", "rgb8", size, frame.color.pixels().as_flattened()),
            point_cloud(depth_s, frame_id, size, &points),
            camera_info("color", size, "plumb_bob", [fx, fy, cx, cy], &d),
            point_cloud(depth_s, "lidar", (2, 1), &[[1.0; 3]; 2]),
        ];
        for (channel_id, message) in channels.into_iter().zip(messages) {
            let (sequence, log_time, publish_time) = (0, 0, 0);
            let header =
                mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
            writer.write_to_known_channel(&header, &message).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// Runs a source in lock-step; its trajectory, and the JSON object.
fn track(workspace: &Workspace, source: &str, more: &str) -> (String, serde_json::Value) {
    let out = format!("out-{}", source.replace([':', '/', '.'], "-"));
    let arguments =
        format!("--log warn run {source} --out {out} --lock-step --no-mask --json {more}");
    let ran = workspace.run(&arguments, &[]);
    assert_eq!((ran.code, &*ran.stderr), (Some(0), ""), "{arguments}");
    let trajectory = fs::read_to_string(workspace.path(&out).join("trajectory.txt")).unwrap();
    (trajectory, serde_json::from_str(&ran.stdout).unwrap())
}

#[test]
fn an_mcap_file_is_tracked_as_the_folder_that_it_was_made_of() {
    let workspace = Workspace::new();
    let folder = workspace.room(8);
    let (frames, camera) = frames(&folder, 8);
    let (expected, document) = track(&workspace, "tum:seq", "--readout-ms 0 --depth-late-ms 0");
    assert_eq!(number(&document, "frames"), 8.0);
    for (name, compression, is_foxglove) in
        [("plain.mcap", false, false), ("packed.mcap", true, false), ("foxglove.mcap", true, true)]
    {
        write_mcap(&workspace.path(name), &frames, &camera, compression, is_foxglove);
        let (found, document) = track(&workspace, &format!("mcap:{name}"), "");
        assert_eq!((found, number(&document, "frames")), (expected.clone(), 8.0), "{name}");
    }
    // Its path is enough, and so is the folder that has it.
    assert_eq!(track(&workspace, "packed.mcap", "").0, expected);
    fs::create_dir(workspace.path("bag")).unwrap();
    fs::rename(workspace.path("packed.mcap"), workspace.path("bag/bag_0.mcap")).unwrap();
    let ran = workspace.run("--log info run bag --out out --lock-step --no-mask --json", &[]);
    assert!(ran.stderr.contains("no metadata.yaml"), "{}", ran.stderr);
    assert!(
        ran.stderr.contains("color from /cam/color/image_raw: sensor_msgs/msg/Image, 8 messages")
    );
    assert!(
        ran.stderr.contains(
            "not used: /imu: sensor_msgs/msg/Imu, 8 messages; the server takes no inertial measurements"
        ),
        "{}",
        ran.stderr
    );
    assert_eq!(fs::read_to_string(workspace.path("out/trajectory.txt")).unwrap(), expected);
    fs::write(workspace.path("bag/metadata.yaml"), "relative_file_paths:\n  - bag_0.mcap\n")
        .unwrap();
    assert_eq!(track(&workspace, "bag:bag", "").0, expected);
}

#[test]
fn points_in_rows_are_tracked_as_the_depth_images_that_they_are() {
    let workspace = Workspace::new();
    let folder = workspace.room(8);
    let (frames, camera) = frames(&folder, 8);
    write_mcap(&workspace.path("images.mcap"), &frames, &camera, false, false);
    write_clouds(&workspace.path("clouds.mcap"), &frames, &camera, "color");
    let (expected, _) = track(&workspace, "images.mcap", "");
    assert_eq!(track(&workspace, "clouds.mcap", "").0, expected);

    write_clouds(&workspace.path("base.mcap"), &frames[..1], &camera, "base");
    let ran = workspace.run("--log error run base.mcap --out base", &[]);
    ran.expect_failure(&["/cam/points are in frame `base`, color is in frame `color`"]);
    let ran =
        workspace.run("--log error run clouds.mcap --depth-topic /lidar/points --out no", &[]);
    ran.expect_failure(&["`/lidar/points` is not a topic for depth", "height above 1"]);
}

#[test]
fn a_recording_that_was_cut_off_is_read_up_to_there() {
    let workspace = Workspace::new();
    let folder = workspace.room(4);
    let (frames, camera) = frames(&folder, 4);
    let path = workspace.path("cut.mcap");
    write_mcap(&path, &frames, &camera, false, false);
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() * 7 / 8]).unwrap();
    let ran = workspace.run("--log warn run cut.mcap --out out --no-mask --json", &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(ran.stderr.contains("the recording has no end"), "{}", ran.stderr);
    let document: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(number(&document, "frames"), 3.0);
    fs::write(&path, &bytes[..200]).unwrap();
    let ran = workspace.run("--log error run cut.mcap", &[]);
    assert_eq!(ran.code, Some(1));
    assert!(ran.stderr.contains("cut.mcap: no topic for color"), "{}", ran.stderr);
}

#[test]
fn what_a_recording_does_not_have_is_told_with_what_it_has() {
    let workspace = Workspace::new();
    let folder = workspace.room(1);
    let (frames, camera) = frames(&folder, 1);
    write_mcap(&workspace.path("a.mcap"), &frames, &camera, false, false);
    let failed = |arguments: &str, part: &str| {
        let ran = workspace.run(&format!("--log error run {arguments}"), &[]);
        assert_eq!(ran.code, Some(1), "{arguments}: {}", ran.stderr);
        assert!(ran.stderr.contains(part), "`{part}` in `{}`", ran.stderr);
    };
    let named = "a.mcap --depth-topic /imu";
    failed(named, "`/imu` is not a topic for depth");
    failed(
        named,
        "; /cam/depth_registered/image_raw: sensor_msgs/msg/Image, 1 message, 32FC1, 640x480",
    );
    failed("mcap:none.mcap", "none.mcap: cannot be read");
    failed("tum:seq --color-topic /rgb", "topics are named for an MCAP file or a bag");
    fs::create_dir(workspace.path("empty")).unwrap();
    failed("bag:empty", "neither metadata.yaml nor .mcap or .db3 files");
    fs::write(workspace.path("text.mcap"), "no recording").unwrap();
    failed("text.mcap", "text.mcap: neither an MCAP file nor a SQLite database");
}

/// Writes frames for `to_bag.py` and lets it write a bag; `None`, and a line, without rosbags.
fn write_bag(
    workspace: &Workspace,
    frames: &[RgbdFrame],
    camera: &[f64; 9],
    kind: &str,
) -> Option<String> {
    let interpreter = std::env::var_os("COVIS_TEST_PYTHON").unwrap_or_else(|| "python3".into());
    let found = Command::new(&interpreter).args(["-c", "import rosbags"]).output();
    if !found.is_ok_and(|found| found.status.success()) {
        skip(&format!("no {} with rosbags", interpreter.display()));
        return None;
    }
    let folder = workspace.path("frames");
    fs::create_dir_all(&folder).unwrap();
    let mut described = Vec::new();
    for (number, frame) in frames.iter().enumerate() {
        let names = ["color", "depth"].map(|kind| format!("{number}.{kind}"));
        fs::write(folder.join(&names[0]), frame.color.pixels().as_flattened()).unwrap();
        fs::write(folder.join(&names[1]), meters(frame)).unwrap();
        let size = frame.color.size();
        let nanoseconds = times_s(frame).map(|time| {
            time.floor() as i64 * 1_000_000_000 + ((time - time.floor()) * 1e9).round() as i64
        });
        described.push(json!({
            "nanoseconds": nanoseconds, "size": [size.0, size.1], "color": names[0], "depth": names[1],
        }));
    }
    let document = json!({ "camera": camera, "frames": described });
    fs::write(folder.join("frames.json"), document.to_string()).unwrap();
    let script =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/integration/recordings/to_bag.py");
    let bag = format!("bag-{kind}");
    let output = Command::new(&interpreter)
        .arg("-B")
        .arg(script)
        .args([&folder, &workspace.path(&bag)])
        .arg(kind)
        .output();
    let ran = Ran::of(output.unwrap());
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    Some(bag)
}

#[test]
fn bags_of_each_storage_are_tracked_as_the_folder_that_they_were_made_of() {
    let workspace = Workspace::new();
    let folder = workspace.room(6);
    let (frames, camera) = frames(&folder, 6);
    let (expected, _) = track(&workspace, "tum:seq", "--readout-ms 0 --depth-late-ms 0");
    for kind in ["mcap", "mcap-zstd", "sqlite3"] {
        let Some(bag) = write_bag(&workspace, &frames, &camera, kind) else { return };
        assert_eq!(track(&workspace, &format!("bag:{bag}"), "").0, expected, "{kind}");
    }
    // The file of a bag is enough, and a database that was cut is read up to there.
    let database = workspace.path("bag-sqlite3/bag-sqlite3.db3");
    assert_eq!(track(&workspace, "bag-sqlite3/bag-sqlite3.db3", "").0, expected);
    let bytes = fs::read(&database).unwrap();
    fs::write(&database, &bytes[..bytes.len() / 2]).unwrap();
    let ran = workspace.run("--log warn run bag:bag-sqlite3 --out cut --no-mask --json", &[]);
    assert!(ran.stderr.contains("bag-sqlite3.db3"), "{:?} {}", ran.code, ran.stderr);
    fs::write(&database, &bytes[..100]).unwrap();
    let ran = workspace.run("--log error run bag:bag-sqlite3", &[]);
    assert_eq!(ran.code, Some(1), "{}", ran.stderr);
    assert!(ran.stderr.contains("bag-sqlite3.db3"), "{}", ran.stderr);
}

#[test]
fn a_bag_of_a_recorded_sequence_gives_its_trajectory_to_the_bit() {
    let Some(folder) = data("rgbd/tum_fr1_rpy") else { return };
    let workspace = Workspace::new();
    let (frames, camera) = frames(&folder, 20);
    let Some(bag) = write_bag(&workspace, &frames, &camera, "sqlite3") else { return };
    let (found, _) = track(&workspace, &format!("bag:{bag}"), KINECT);
    // The folder goes on behind the frames that the bag has: cut its list.
    let seq = workspace.path("seq");
    fs::create_dir(&seq).unwrap();
    for name in ["rgb", "depth", "depth.txt", "camera.txt"] {
        std::os::unix::fs::symlink(folder.join(name), seq.join(name)).unwrap();
    }
    let list = fs::read_to_string(folder.join("rgb.txt")).unwrap();
    let last = frames.last().unwrap().timestamp_s;
    let is_kept = |line: &&str| {
        let time = line.split(' ').next().and_then(|time| time.parse::<f64>().ok());
        time.is_none_or(|time| time <= last)
    };
    let kept: Vec<&str> = list.lines().filter(is_kept).collect();
    fs::write(seq.join("rgb.txt"), kept.join("\n")).unwrap();
    assert_eq!(found, track(&workspace, "tum:seq", KINECT).0);
}

#[test]
fn the_poses_of_a_topic_are_a_trajectory_to_compare_and_to_convert() {
    let workspace = Workspace::new();
    let options = mcap::WriteOptions::new().profile("ros2");
    let path = workspace.path("walk.mcap");
    let mut writer = options.create(fs::File::create(&path).unwrap()).unwrap();
    let mut channel = |topic: &str, kind: &str| {
        let schema = writer.add_schema(kind, "ros2msg", b"").unwrap();
        writer.add_channel(schema, topic, "cdr", &Default::default()).unwrap()
    };
    let odom = channel("/odom", "nav_msgs/msg/Odometry");
    let truth = channel("/truth", "geometry_msgs/msg/PoseStamped");
    let mut text = String::new();
    for k in 0..20 {
        let (time_s, x) = (10.0 + f64::from(k) * 0.5, f64::from(k) * 0.25);
        let values = [x, 0.125 * x * x, 0.0, 0.0, 0.0, 0.0, 1.0];
        let mut off = values;
        off[1] += 0.01 * f64::from(k % 2);
        text.push_str(&format!("{time_s} {} {} 0 0 0 0 1\n", values[0], values[1]));
        let messages = [
            (odom, pose(time_s, "odom", Some("base"), off)),
            (truth, pose(time_s, "map", None, values)),
            // Some drivers begin with such poses.
            (truth, pose(time_s + 0.1, "map", None, [0.0; 7])),
        ];
        for (channel_id, message) in messages {
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: 0,
                log_time: 0,
                publish_time: 0,
            };
            writer.write_to_known_channel(&header, &message).unwrap();
        }
    }
    writer.finish().unwrap();
    workspace.file("truth.txt", &text);

    let ran = workspace.run("convert walk.mcap:/truth out.txt --json", &[]);
    assert!(ran.stderr.contains("20 messages of /truth are no poses"), "{}", ran.stderr);
    let errors = workspace.json("eval ape truth.txt out.txt --align none --json", &[]);
    assert_eq!((number(&errors, "pairs"), number(&errors, "rmse")), (20.0, 0.0));
    let by_topic = |truth: &str| {
        let arguments = format!("--log error eval ape {truth} walk.mcap:/odom --align none --json");
        number(&workspace.json(&arguments, &[]), "rmse")
    };
    let rmse = by_topic("truth.txt");
    assert!((rmse - 0.01 * 0.5_f64.sqrt()).abs() < 1e-9, "{rmse}");
    assert_eq!(by_topic("walk.mcap:/truth"), rmse);
    let both = workspace.run("eval ape truth.txt walk.mcap", &[]);
    both.expect_failure(&["several topics for a trajectory", "PATH:TOPIC", "/odom", "/truth"]);
    let none = workspace.run("eval ape truth.txt walk.mcap:/none", &[]);
    none.expect_failure(&["`/none` is not a topic for a trajectory", "nav_msgs/msg/Odometry"]);
}
