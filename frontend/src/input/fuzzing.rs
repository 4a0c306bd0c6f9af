//! Fuzz targets of what recordings hold: images, lists of timed files, camera files, captures,
//! ROS 2 messages.
//!
//! Built for tests and with the feature `fuzzing` only. Each function takes any bytes and panics
//! where a promise is broken.

use std::path::{Component, Path};

pub use super::capture::fuzzing::{archive as capture_archive, capture, seeds as capture_seeds};
pub use super::recording::fuzzing::ros_message;
pub use super::recording::made as ros_messages;
use super::{SensorTiming, camera_file, decode, encode, list};
use crate::camera::FrameCamera;
use crate::image::Image;

/// An image, as color, depth and mask. What was read is written and read as the same.
pub fn image(input: &[u8]) {
    let (color, depth) = decode::unchecked(input);
    for color in [color, decode::color(input).ok()].into_iter().flatten() {
        is_read_again(&color, encode::rgb, decode::color);
    }
    for depth in [depth, decode::depth(input).ok()].into_iter().flatten() {
        is_read_again(&depth, encode::gray16, decode::depth);
    }
    if let Ok(mask) = decode::mask(input) {
        is_read_again(&mask, encode::gray8, decode::mask);
    }
}

fn is_read_again<T: Copy + PartialEq>(
    image: &Image<T>,
    write: impl Fn(&Image<T>) -> Result<Vec<u8>, png::EncodingError>,
    read: impl Fn(&[u8]) -> Result<Image<T>, decode::DecodeError>,
) {
    // Larger ones take their time, and are no others.
    if image.pixels().len() > 1 << 16 {
        return;
    }
    let again = write(image).ok().and_then(|bytes| read(&bytes).ok());
    assert!(again.as_ref() == Some(image), "what is written is read as another image");
}

/// A list of timed files: none of them stands outside of the folder.
pub fn frame_list(input: &[u8]) {
    let (folder, text) = (Path::new("folder"), String::from_utf8_lossy(input));
    let Ok(entries) = list::parse(&text, folder, Path::new("list")) else { return };
    for entry in entries {
        let inside = entry.path.strip_prefix(folder).is_ok_and(|path| {
            path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
        });
        assert!(inside && entry.timestamp_s.is_finite(), "{entry:?}");
    }
}

/// A camera file: what passes has finite parameters and can be asked for rays.
pub fn camera_file(input: &[u8]) {
    let text = String::from_utf8_lossy(input);
    let timing = SensorTiming::parse(&text, "camera.txt".into(), SensorTiming::KINECT);
    if let Ok(SensorTiming { readout_s, depth_late_s }) = timing {
        assert!(SensorTiming::new(readout_s, depth_late_s).is_some(), "{timing:?}");
    }
    let Ok(camera) = camera_file::parse(&text, "camera.txt") else { return };
    assert!(camera.fx > 0.0 && camera.fy > 0.0, "{camera:?}");
    let Some(camera) = FrameCamera::new(camera, 8, 6) else { return };
    let rays = camera.rays().pixels().as_flattened();
    assert!(rays.iter().all(|ray| ray.is_finite()), "{:?}", camera.model());
}
