//! The fuzz target of recordings: the messages of ROS 2 and Foxglove.
//!
//! Built for tests and with the feature `fuzzing` only. Each function takes any bytes and panics where a
//! promise is broken.

use super::clouds::{self, PointCloud};
use super::messages::{self, CameraInfo, CompressedImage, Encoding, Kind, RawImage, Sample};
use super::transforms::Transforms;
use super::{camera_info, images, poses};
use crate::camera::FrameCamera;

/// A message of ROS 2 or Foxglove, as each of those that are read.
pub fn ros_message(input: &[u8]) {
    message(Encoding::Cdr, input);
    message(Encoding::Protobuf, input);
    pose(input);
    cloud(input);
    let _added = Transforms::default().add(input);
}

/// As [`ros_message`]: the pose of a message has a finite position.
fn pose(input: &[u8]) {
    for type_name in ["nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"] {
        if let Ok(read) = poses::pose(type_name, input) {
            assert!(read.pose.translation.iter().all(|value| value.is_finite()), "{read:?}");
        }
    }
}

/// As [`ros_message`]: the depth of a point cloud is in meters.
fn cloud(input: &[u8]) {
    let cloud = PointCloud::read(input);
    if let Ok(depth) = cloud.and_then(|cloud| clouds::depth(&cloud, None)) {
        assert!(depth.pixels().len() <= input.len() / 4, "more points than the message has");
        assert!(depth.pixels().iter().all(|&d| d.is_finite() && d >= 0.0), "no depth in meters");
    }
}

fn message(encoding: Encoding, input: &[u8]) {
    let _time = messages::timestamp_s(encoding, input);
    for kind in [
        Kind::Image,
        Kind::CompressedImage,
        Kind::CameraInfo,
        Kind::PointCloud,
        Kind::Pose,
        Kind::StaticTransforms,
        Kind::Other,
    ] {
        let _told = Sample::of(encoding, kind, input);
    }
    if let Ok(image) = RawImage::read(encoding, input) {
        assert!(image.data.len() <= input.len(), "more data than the message has");
        if let Ok(depth) = images::depth(&image, None) {
            let is_depth = |&d: &f32| d.is_finite() && d >= 0.0;
            assert!(depth.pixels().iter().all(is_depth), "no depth in meters");
        }
        let _color = images::color(&image);
    }
    if let Ok(image) = CompressedImage::read(encoding, input) {
        let _color = images::compressed_color(&image);
        let _depth = images::compressed_depth(&image, None);
    }
    if let Ok(info) = CameraInfo::read(encoding, input)
        && let Ok(camera) = camera_info::camera(&info, false)
    {
        assert!(camera.fx > 0.0 && camera.fy > 0.0, "{camera:?}");
        if let Some(camera) = FrameCamera::new(camera, 8, 6) {
            let rays = camera.rays().pixels().as_flattened();
            assert!(rays.iter().all(|ray| ray.is_finite()), "{:?}", camera.model());
        }
    }
}
