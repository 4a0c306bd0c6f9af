//! Foxglove's messages as bytes, in the order of their fields' numbers, as protobuf's own writers have it.
//! For tests and the corpus of the fuzz target.

/// A message that is written field by field.
#[derive(Debug, Default)]
struct Writer(Vec<u8>);

impl Writer {
    /// Begins with a time, s.
    fn new(timestamp_s: f64) -> Self {
        let seconds = timestamp_s.floor();
        let mut time = Self::default();
        time.number(1, seconds as u64);
        time.number(2, ((timestamp_s - seconds) * 1e9).round() as u64);
        let mut writer = Self::default();
        writer.bytes(1, &time.0);
        writer
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push((value & 0x7f) as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    fn number(&mut self, field: u64, value: u64) {
        self.varint(field << 3);
        self.varint(value);
    }

    /// Eight or four bytes.
    fn fixed(&mut self, field: u64, bytes: &[u8]) {
        self.varint(field << 3 | if bytes.len() == 8 { 1 } else { 5 });
        self.0.extend(bytes);
    }

    fn bytes(&mut self, field: u64, bytes: &[u8]) {
        self.varint(field << 3 | 2);
        self.varint(bytes.len() as u64);
        self.0.extend(bytes);
    }

    fn numbers(&mut self, field: u64, numbers: &[f64]) {
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        self.bytes(field, &bytes);
    }
}

/// `foxglove.RawImage`, of this time (s), columns and rows.
#[must_use]
pub fn raw_image(
    timestamp_s: f64,
    frame_id: &str,
    encoding: &str,
    (width, height): (usize, usize),
    data: &[u8],
) -> Vec<u8> {
    let mut writer = Writer::new(timestamp_s);
    // These are `fixed32` of the schema.
    writer.fixed(2, &(width as u32).to_le_bytes());
    writer.fixed(3, &(height as u32).to_le_bytes());
    writer.bytes(4, encoding.as_bytes());
    writer.fixed(5, &((data.len() / height.max(1)) as u32).to_le_bytes());
    writer.bytes(6, data);
    writer.bytes(7, frame_id.as_bytes());
    writer.0
}

/// `foxglove.CompressedImage`, of this time (s).
#[must_use]
pub fn compressed_image(timestamp_s: f64, frame_id: &str, format: &str, data: &[u8]) -> Vec<u8> {
    let mut writer = Writer::new(timestamp_s);
    writer.bytes(2, data);
    writer.bytes(3, format.as_bytes());
    writer.bytes(4, frame_id.as_bytes());
    writer.0
}

/// `foxglove.CameraCalibration` of a camera fx, fy, cx, cy with distortion coefficients D.
#[must_use]
pub fn camera_calibration(
    frame_id: &str,
    (width, height): (usize, usize),
    model: &str,
    [fx, fy, cx, cy]: [f64; 4],
    d: &[f64],
) -> Vec<u8> {
    let mut writer = Writer::new(1.0);
    writer.fixed(2, &(width as u32).to_le_bytes());
    writer.fixed(3, &(height as u32).to_le_bytes());
    writer.bytes(4, model.as_bytes());
    writer.numbers(5, d);
    writer.numbers(6, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
    writer.numbers(8, &[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    writer.bytes(9, frame_id.as_bytes());
    writer.0
}
