//! ROS 2 messages as bytes, for tests and for the corpus of the fuzz target: CDR, little endian.
//!
//! Built for tests and with the feature `fuzzing` only; it writes no files. `foxglove` has Foxglove's.

pub mod foxglove;

/// A message that is written field by field.
#[derive(Debug)]
struct Writer(Vec<u8>);

impl Writer {
    /// Begins with a header of this time, s.
    fn new(timestamp_s: f64, frame_id: &str) -> Self {
        let mut writer = Self(Vec::new());
        writer.header(timestamp_s, frame_id);
        writer
    }

    fn header(&mut self, timestamp_s: f64, frame_id: &str) {
        let seconds = timestamp_s.floor();
        self.number((seconds as i32).to_le_bytes());
        self.u32(((timestamp_s - seconds) * 1e9).round() as u32);
        self.text(frame_id);
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        self.0.resize(self.0.len().next_multiple_of(N), 0);
        self.0.extend(bytes);
    }

    fn u32(&mut self, number: u32) {
        self.number(number.to_le_bytes());
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.0.extend(bytes);
    }

    fn text(&mut self, text: &str) {
        self.bytes(&[text.as_bytes(), b"\0"].concat());
    }

    fn message(self) -> Vec<u8> {
        [&[0, 1, 0, 0][..], &self.0].concat()
    }
}

/// `sensor_msgs/msg/Image`, of this time (s), columns and rows.
#[must_use]
pub fn image(
    timestamp_s: f64,
    frame_id: &str,
    encoding: &str,
    (width, height): (usize, usize),
    data: &[u8],
) -> Vec<u8> {
    let mut writer = Writer::new(timestamp_s, frame_id);
    writer.u32(height as u32);
    writer.u32(width as u32);
    writer.text(encoding);
    writer.number([0]);
    writer.u32((data.len() / height.max(1)) as u32);
    writer.bytes(data);
    writer.message()
}

/// A pose of this time (s) as x, y, z and the quaternion x, y, z, w; of a message that names its body, with that name.
/// Covariances, which come behind it, are left out.
#[must_use]
pub fn pose(timestamp_s: f64, frame_id: &str, child: Option<&str>, values: [f64; 7]) -> Vec<u8> {
    let mut writer = Writer::new(timestamp_s, frame_id);
    child.into_iter().for_each(|child| writer.text(child));
    values.into_iter().for_each(|value| writer.number(value.to_le_bytes()));
    writer.message()
}

/// `tf2_msgs/msg/TFMessage` of transforms with parent, child, and parent_from_child as [`pose`] has it.
#[must_use]
pub fn transforms(parts: &[(&str, &str, [f64; 7])]) -> Vec<u8> {
    let mut writer = Writer(Vec::new());
    writer.u32(parts.len() as u32);
    for (parent, child, values) in parts {
        writer.header(0.0, parent);
        writer.text(child);
        values.iter().for_each(|value| writer.number(value.to_le_bytes()));
    }
    writer.message()
}

/// `sensor_msgs/msg/PointCloud2` with rows of points, each of 20 bytes: 32-bit floats x, y, z from byte 4 on.
#[must_use]
pub fn point_cloud(
    timestamp_s: f64,
    frame_id: &str,
    (width, height): (usize, usize),
    points: &[[f32; 3]],
) -> Vec<u8> {
    const POINT_BYTES: usize = 20;
    let mut writer = Writer::new(timestamp_s, frame_id);
    writer.u32(height as u32);
    writer.u32(width as u32);
    writer.u32(3);
    for (name, offset) in [("x", 4), ("y", 8), ("z", 12)] {
        writer.text(name);
        writer.u32(offset);
        writer.number([7]);
        writer.u32(1);
    }
    writer.number([0]);
    writer.u32(POINT_BYTES as u32);
    writer.u32((POINT_BYTES * width) as u32);
    let point = |[x, y, z]: &[f32; 3]| [0.0, *x, *y, *z, 0.0].map(f32::to_le_bytes).concat();
    writer.bytes(&points.iter().flat_map(point).collect::<Vec<u8>>());
    writer.number([0]);
    writer.message()
}

/// `sensor_msgs/msg/CompressedImage`, of this time (s).
#[must_use]
pub fn compressed_image(timestamp_s: f64, frame_id: &str, format: &str, data: &[u8]) -> Vec<u8> {
    let mut writer = Writer::new(timestamp_s, frame_id);
    writer.text(format);
    writer.bytes(data);
    writer.message()
}

/// `sensor_msgs/msg/CameraInfo` of a camera fx, fy, cx, cy with distortion coefficients d.
#[must_use]
pub fn camera_info(
    frame_id: &str,
    (width, height): (usize, usize),
    model: &str,
    [fx, fy, cx, cy]: [f64; 4],
    d: &[f64],
) -> Vec<u8> {
    let mut writer = Writer::new(1.0, frame_id);
    writer.u32(height as u32);
    writer.u32(width as u32);
    writer.text(model);
    writer.u32(d.len() as u32);
    let k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    let r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let p = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
    for number in d.iter().chain(&k).chain(&r).chain(&p) {
        writer.number(number.to_le_bytes());
    }
    // Binning and the region of interest, which is the whole.
    for _ in 0..6 {
        writer.u32(0);
    }
    writer.number([0]);
    writer.message()
}

/// The corpus of the fuzz target.
#[must_use]
pub fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let size = (2, 1);
    let depth = image(1.0, "depth", "16UC1", size, &[220, 5, 0, 0]);
    // The same with the highest byte first: the header's second byte, and all numbers.
    let mut big = Vec::from([0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 2, b'd', 0, 0, 0]);
    big.extend([0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 6]);
    big.extend(b"16UC1\0\x01\0\0\0\0\x04\0\0\0\x04\x05\xdc\0\0");
    let png = crate::image::Image::from_pixels(2, 1, vec![1500u16, 0])
        .and_then(|image| crate::input::encode::gray16(&image).ok())
        .unwrap_or_default();
    let packed = [&[0; 12][..], &png].concat();
    let camera = [500.0, 501.0, 1.0, 0.5];
    vec![
        ("color", image(1.0, "color", "bgr8", size, &[1, 2, 3, 4, 5, 6])),
        ("depth", depth.clone()),
        ("depth-in-meters", image(0.0, "", "32FC1", size, &[0, 0, 192, 63, 0, 0, 192, 127])),
        ("depth-big-endian", big),
        ("depth-cut", depth[..depth.len() - 3].to_vec()),
        ("depth-compressed", compressed_image(1.0, "", "16UC1; compressedDepth png", &packed)),
        ("depth-by-its-inverse", compressed_image(1.0, "", "32FC1; compressedDepth png", &packed)),
        ("camera", camera_info("color", size, "plumb_bob", camera, &[0.1, -0.2, 0.0, 0.0, 0.3])),
        ("foxglove-depth", foxglove::raw_image(1.0, "depth", "16UC1", size, &[220, 5, 0, 0])),
        ("foxglove-color", foxglove::compressed_image(1.0, "color", "png", &png)),
        ("foxglove-camera", foxglove::camera_calibration("", size, "plumb_bob", camera, &[0.1])),
        ("odometry", pose(1.0, "odom", Some("base"), [1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8])),
        ("cloud", point_cloud(1.0, "color", (1, 2), &[[0.1, 0.2, 1.5], [f32::NAN; 3]])),
        ("transforms", transforms(&[("base", "camera", [0.5, 0.0, 1.0, 0.0, 0.0, 0.6, 0.8])])),
        ("camera-rational", camera_info("color", size, "rational_polynomial", camera, &[0.1; 8])),
    ]
}
