//! A recording from its files to its frames: pairs, cameras, registration, and frames that cannot be read.

use super::made::{camera_info, compressed_image, image, pose, transforms};
use super::*;
use crate::image::Image;
use crate::input::{FrameError, encode};

fn compressed(seconds: f64, format: &str, data: &[u8]) -> Vec<u8> {
    compressed_image(seconds, "color", format, data)
}

fn info(frame_id: &str, model: &str, fx: f64) -> Vec<u8> {
    camera_info(frame_id, (2, 1), model, [fx, 501.0, 1.0, 0.5], &[0.1, 0.0, 0.0, 0.0, 0.0])
}

/// A topic with its type and its messages, each with the time of recording, s.
type Told<'a> = (&'a str, &'a str, Vec<(u64, Vec<u8>)>);

/// An MCAP file of these topics, by the writer of the format's authors.
fn recording(topics: &[Told<'_>]) -> tempfile::NamedTempFile {
    let file = tempfile::Builder::new().suffix(".mcap").tempfile().unwrap();
    let mut writer = mcap::Writer::new(fs_err::File::create(file.path()).unwrap()).unwrap();
    for (topic, type_name, messages) in topics {
        let schema = writer.add_schema(type_name, "ros2msg", b"").unwrap();
        let channel = writer.add_channel(schema, topic, "cdr", &Default::default()).unwrap();
        for (seconds, data) in messages {
            let log_time = seconds * 1_000_000_000;
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: 0,
                log_time,
                publish_time: log_time,
            };
            writer.write_to_known_channel(&header, data).unwrap();
        }
    }
    writer.finish().unwrap();
    file
}

const IMAGE: &str = "sensor_msgs/msg/Image";
const INFO: &str = "sensor_msgs/msg/CameraInfo";
const COLOR: [u8; 6] = [1, 2, 3, 4, 5, 6];

fn depth() -> Vec<u8> {
    [1500u16, 0].map(u16::to_le_bytes).concat()
}

fn color_topic() -> Told<'static> {
    let images = [1.0, 2.0, 3.0].map(|time| (9, image(time, "color", "bgr8", (2, 1), &COLOR)));
    ("/cam/color/image_raw", IMAGE, images.to_vec())
}

fn depth_topic(frame_id: &str, size: (usize, usize)) -> Told<'static> {
    let data = depth().repeat(size.0 * size.1 / 2);
    let images = [1.01, 2.01, 3.01].map(|time| (9, image(time, frame_id, "16UC1", size, &data)));
    ("/cam/depth/image_raw", IMAGE, images.to_vec())
}

fn info_topic() -> Told<'static> {
    ("/cam/color/camera_info", INFO, vec![(1, info("color", "plumb_bob", 500.0))])
}

fn open(file: &tempfile::NamedTempFile) -> Result<OpenRecording, InputError> {
    open_recording(file.path(), RecordingOptions::default(), |_, _| true)
}

fn told(open: &OpenRecording) -> Vec<String> {
    open.notes.iter().map(ToString::to_string).collect()
}

#[test]
fn images_are_paired_by_the_times_of_their_headers() {
    let imu = ("/imu", "sensor_msgs/msg/Imu", vec![(1, vec![0, 1, 0, 0]), (2, vec![])]);
    let file = recording(&[color_topic(), depth_topic("color", (2, 1)), info_topic(), imu]);
    let mut found = open(&file).unwrap();
    assert!(found.notes.is_empty(), "{:?}", found.notes);
    assert_eq!(found.source.len(), 3);
    let camera = found.source.camera();
    assert_eq!((camera.fx, camera.fy, camera.k1), (500.0, 501.0, 0.1));
    assert_eq!(found.source.timing(), crate::input::SensorTiming::default());
    let frame = found.source.next_frame().unwrap().unwrap();
    assert_eq!(frame.timestamp_s, 1.0);
    assert!((frame.depth_delay_s - 0.01).abs() < 1e-9);
    assert_eq!(frame.color.pixels(), [[3, 2, 1], [6, 5, 4]]);
    assert_eq!(frame.depth_m.pixels(), [1.5, 0.0]);
    assert_eq!(found.used.iter().map(|(_, topic)| topic.count).collect::<Vec<_>>(), [3, 3, 1]);
    assert_eq!(found.unused[0].to_string(), "/imu: sensor_msgs/msg/Imu, 2 messages");
    let options = RecordingOptions { camera: Some("9,9,1,2"), ..RecordingOptions::default() };
    let given = open_recording(file.path(), options, |_, _| true).unwrap();
    assert_eq!((given.source.camera().fx, given.used.len()), (9.0, 2));
}

#[test]
fn a_header_without_a_time_has_that_of_the_recorder_and_compressed_images_are_read() {
    let png = encode::rgb(&Image::filled(2, 1, [7, 8, 9])).unwrap();
    let values = Image::from_pixels(2, 1, vec![2000u16, 0]).unwrap();
    let packed = [&[0; 12][..], &encode::gray16(&values).unwrap()].concat();
    let kind = "sensor_msgs/msg/CompressedImage";
    let color =
        ("/c/compressed", kind, vec![(5, compressed(0.0, "rgb8; png compressed bgr8", &png))]);
    let format = "16UC1; compressedDepth png";
    let depth = ("/d/compressedDepth", kind, vec![(5, compressed(0.0, format, &packed))]);
    let file = recording(&[color, depth, info_topic()]);
    let frame = open(&file).unwrap().source.next_frame().unwrap().unwrap();
    assert_eq!((frame.timestamp_s, frame.depth_delay_s), (5.0, 0.0));
    assert_eq!(frame.color.at(1, 0), [7, 8, 9]);
    assert_eq!(frame.depth_m.pixels(), [2.0, 0.0]);
}

#[test]
fn a_frame_that_cannot_be_read_is_named_and_the_next_one_follows() {
    let mut color = color_topic();
    color.2[1].1.truncate(50);
    color.2[2].1 = image(3.0, "color", "bgr8", (1, 2), &COLOR);
    color.2.push((9, image(4.0, "color", "bgr8", (2, 1), &COLOR)));
    color.2.push((9, image(4.0, "color", "bgr8", (2, 1), &COLOR)));
    let mut depth = depth_topic("color", (2, 1));
    depth.2.push((9, image(4.0, "color", "16UC1", (2, 1), &self::depth())));
    let file = recording(&[color, depth, info_topic()]);
    let mut found = open(&file).unwrap();
    assert!(
        told(&found)[0].contains("1 images have the timestamp of another"),
        "{:?}",
        told(&found)
    );
    assert!(found.source.next_frame().unwrap().is_ok());
    let error = found.source.next_frame().unwrap().unwrap_err();
    assert!(matches!(&error, FrameError::Message { topic, .. } if topic == "/cam/color/image_raw"));
    assert!(error.to_string().contains("at 2.000000 s: the message ends within"), "{error}");
    let error = found.source.next_frame().unwrap().unwrap_err().to_string();
    assert!(error.contains("1x2 pixels, not 2x1"), "{error}");
    assert_eq!(found.source.next_frame().unwrap().unwrap().timestamp_s, 4.0);
    assert!(found.source.next_frame().is_none());
}

#[test]
fn depth_that_is_not_registered_is_told() {
    let file = recording(&[color_topic(), depth_topic("depth", (2, 1)), info_topic()]);
    let found = told(&open(&file).unwrap());
    assert!(found[0].contains("frame `color` and depth in `depth`"), "{found:?}");
    // The same camera in another frame: registered.
    let same = ("/cam/depth/camera_info", INFO, vec![(1, info("depth", "plumb_bob", 500.0))]);
    let file = recording(&[color_topic(), depth_topic("depth", (2, 1)), info_topic(), same]);
    assert!(open(&file).unwrap().notes.is_empty());
    let file = recording(&[color_topic(), depth_topic("depth", (4, 1)), info_topic()]);
    let error = open(&file).err().unwrap().to_string();
    assert!(error.contains("4x1 pixels") && error.contains("registered"), "{error}");
}

#[test]
fn what_a_recording_lacks_is_named() {
    let error = |topics: &[Told<'_>]| open(&recording(topics)).err().unwrap().to_string();
    let found = error(&[color_topic(), info_topic()]);
    assert!(found.contains("no topic for depth") && found.contains("bgr8, 2x1"), "{found}");
    let found = error(&[color_topic(), depth_topic("color", (2, 1))]);
    assert!(found.contains("no topic for the camera") && found.contains("--camera"), "{found}");
    let fisheye = ("/cam/color/camera_info", INFO, vec![(1, info("color", "equidistant", 500.0))]);
    let found = error(&[color_topic(), depth_topic("color", (2, 1)), fisheye]);
    assert!(found.contains("`equidistant`") && found.contains("/cam/color/camera_info"), "{found}");
    let mut late = depth_topic("color", (2, 1));
    for (_, message) in &mut late.2 {
        message[4] += 100;
    }
    let found = error(&[color_topic(), late, info_topic()]);
    assert!(found.contains("no image of /cam/color/image_raw has one of"), "{found}");
    assert!(error(&[]).contains("there are no topics"));
}

/// Odometry at these times, of a body that moves along x by a meter a second.
fn odometry_topic(times_s: &[f64]) -> Told<'static> {
    let message = |&s: &f64| (9, pose(s, "odom", Some("base"), [s, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]));
    ("/odom", "nav_msgs/msg/Odometry", times_s.iter().map(message).collect())
}

/// A static transform: the frame `child` is half a meter to the left of `base`.
fn static_topic(child: &str) -> Told<'static> {
    let message = transforms(&[("base", child, [0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0])]);
    ("/tf_static", "tf2_msgs/msg/TFMessage", vec![(9, message)])
}

fn with_odometry(odometry: Told<'_>, static_transforms: Told<'_>) -> Result<OpenRecording, String> {
    let images = [color_topic(), depth_topic("color", (2, 1)), info_topic()];
    let file = recording(&[&images[..], &[odometry, static_transforms]].concat());
    let topics = TopicNames { odometry: Some("/odom"), ..TopicNames::default() };
    let options = RecordingOptions { topics, ..RecordingOptions::default() };
    open_recording(file.path(), options, |_, _| true).map_err(|error| error.to_string())
}

#[test]
fn frames_have_the_camera_where_odometry_has_its_body() {
    let mut odometry = odometry_topic(&[0.5, 1.5, 2.5]);
    odometry.2.push((9, vec![0, 1, 0, 0]));
    let mut found = with_odometry(odometry, static_topic("color")).unwrap();
    assert!(told(&found)[0].contains("/odom: 1 messages are no poses"), "{:?}", told(&found));
    assert!(found.source.has_odometry());
    let poses = (0..3).map(|_| found.source.next_frame().unwrap().unwrap().given_pose.unwrap());
    let expected = [[1.0, 0.5, 0.0], [2.0, 0.5, 0.0], [3.0, 0.5, 0.0]];
    for (pose, expected) in poses.zip(expected) {
        assert!((pose.translation - nalgebra::Vector3::from(expected)).norm() < 1e-12, "{pose:?}");
    }
    let mut found = with_odometry(odometry_topic(&[0.9, 1.1, 1.3]), static_topic("color")).unwrap();
    assert!(told(&found)[0].contains("/odom has no pose at the time of 2 images"));
    let given = (0..3).map(|_| found.source.next_frame().unwrap().unwrap().given_pose.is_some());
    assert_eq!(given.collect::<Vec<_>>(), [true, false, false]);
}

#[test]
fn odometry_that_is_of_no_use_is_refused_by_what_it_lacks() {
    let error = |times_s: &[f64], child: &str| {
        with_odometry(odometry_topic(times_s), static_topic(child)).err().unwrap()
    };
    let found = error(&[1.0, 2.0], "lidar");
    assert!(found.contains("frame `base`, color is in frame `color`"), "{found}");
    assert!(found.contains("frames of these transforms: base, lidar"), "{found}");
    let found = error(&[1.0], "color");
    assert!(found.contains("/odom has fewer than two poses"), "{found}");
    let found = error(&[101.0, 102.0], "color");
    assert!(found.contains("/odom has no pose at the time of any image"), "{found}");
}

#[test]
fn whoever_opens_a_recording_sees_how_far_the_pass_is_and_may_end_it() {
    let file = recording(&[color_topic(), depth_topic("color", (2, 1)), info_topic()]);
    let (sender, heard) = std::sync::mpsc::channel();
    let watch = move |done, all| sender.send((done, all)).is_ok();
    open_recording(file.path(), RecordingOptions::default(), watch).unwrap();
    let heard: Vec<(u64, u64)> = heard.iter().collect();
    let length = fs_err::metadata(file.path()).unwrap().len();
    assert!(heard.len() > 1 && heard.iter().all(|&(done, all)| done <= all && all == length));
    assert!(heard.is_sorted() && heard[heard.len() - 1].0 > length / 3, "{heard:?}");

    let mut parts = 0;
    let watch = move |_, _| {
        parts += 1;
        assert!(parts <= 2, "it was ended");
        parts < 2
    };
    let ended = open_recording(file.path(), RecordingOptions::default(), watch).err().unwrap();
    assert!(matches!(ended, InputError::Recording(RecordingError::Ended { .. })), "{ended}");
}
