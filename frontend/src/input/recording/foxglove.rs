//! The messages of Foxglove that are read, from protobuf: `foxglove.RawImage`, `CompressedImage` and
//! `CameraCalibration`. They come out as those of ROS 2, whose encodings, formats and matrices they share.
//!
//! Foxglove has neither byte orders nor regions of interest: numbers are little-endian, images whole.

use super::error::MessageError;
use super::messages::{CameraInfo, CompressedImage, Kind, RawImage, Sample};
use super::protobuf::{Value, fields};

/// The kind of a schema.
pub(super) fn kind(schema: &str) -> Kind {
    match schema {
        "foxglove.RawImage" => Kind::Image,
        "foxglove.CompressedImage" => Kind::CompressedImage,
        "foxglove.CameraCalibration" => Kind::CameraInfo,
        _ => Kind::Other,
    }
}

/// The time that all of them begin with, seconds; `head` is the beginning of a message.
pub(super) fn timestamp_s(head: &[u8]) -> Option<f64> {
    let (number, value) = fields(head).next()?.ok()?;
    let (mut seconds, mut nanoseconds) = (0, 0);
    for field in fields(value.bytes()) {
        match field.ok()? {
            (1, Value::Number(value)) => seconds = value.cast_signed(),
            (2, Value::Number(value)) => nanoseconds = value.cast_signed(),
            _ => {}
        }
    }
    let timestamp_s = seconds as f64 + nanoseconds as f64 * 1e-9;
    (number == 1 && timestamp_s != 0.0).then_some(timestamp_s)
}

/// What the beginning of a message says, as far as it goes.
pub(super) fn sample(kind: Kind, head: &[u8]) -> Sample {
    let mut sample = Sample::default();
    let (mut width, mut height) = (0, 0);
    for (number, value) in fields(head).map_while(Result::ok) {
        let text = || value.text("").unwrap_or_default().to_owned();
        match (kind, number) {
            (Kind::Image | Kind::CameraInfo, 2) => width = value.u32(),
            (Kind::Image | Kind::CameraInfo, 3) => height = value.u32(),
            (Kind::Image, 4) | (Kind::CompressedImage, 3) => sample.encoding = text(),
            (Kind::Image, 7) | (Kind::CompressedImage, 4) | (Kind::CameraInfo, 9) => {
                sample.frame_id = text();
            }
            (
                Kind::Image
                | Kind::CompressedImage
                | Kind::CameraInfo
                | Kind::PointCloud
                | Kind::Pose
                | Kind::StaticTransforms
                | Kind::Other,
                _,
            ) => {}
        }
    }
    let size = (width as usize, height as usize);
    Sample { size: (size != (0, 0)).then_some(size), ..sample }
}

/// `foxglove.RawImage`.
pub(super) fn raw_image(message: &[u8]) -> Result<RawImage<'_>, MessageError> {
    let mut image =
        RawImage { height: 0, width: 0, encoding: "", is_big: false, step: 0, data: &[] };
    for field in fields(message) {
        match field? {
            (2, value) => image.width = value.u32(),
            (3, value) => image.height = value.u32(),
            (4, value) => image.encoding = value.text("encoding")?,
            (5, value) => image.step = value.u32(),
            (6, value) => image.data = value.bytes(),
            _ => {}
        }
    }
    Ok(image)
}

/// `foxglove.CompressedImage`.
pub(super) fn compressed_image(message: &[u8]) -> Result<CompressedImage<'_>, MessageError> {
    let mut image = CompressedImage { format: "", data: &[] };
    for field in fields(message) {
        match field? {
            (2, value) => image.data = value.bytes(),
            (3, value) => image.format = value.text("format")?,
            _ => {}
        }
    }
    Ok(image)
}

/// `foxglove.CameraCalibration`.
pub(super) fn camera_calibration(message: &[u8]) -> Result<CameraInfo<'_>, MessageError> {
    let mut info =
        CameraInfo { model: "", d: [0.0; 14], k: [0.0; 9], p: [0.0; 12], is_whole: true };
    // A writer puts numbers in a row or one by one.
    let mut counts = [0_usize; 3];
    for field in fields(message) {
        let (number, value) = field?;
        let (which, name, numbers) = match number {
            4 => {
                info.model = value.text("distortion_model")?;
                continue;
            }
            5 => (0, "D", &mut info.d[..]),
            6 => (1, "K", &mut info.k[..]),
            8 => (2, "P", &mut info.p[..]),
            _ => continue,
        };
        let one;
        let given: &[[u8; 8]] = match value {
            Value::Eight(bytes) => {
                one = [bytes];
                &one
            }
            Value::Bytes(bytes) => bytes.as_chunks().0,
            Value::Number(_) | Value::Four(_) => &[],
        };
        for &bytes in given {
            let most = numbers.len();
            let Some(number) = numbers.get_mut(counts[which]) else {
                return Err(MessageError::TooMany { field: name, found: most + 1, most });
            };
            *number = f64::from_le_bytes(bytes);
            counts[which] += 1;
        }
    }
    Ok(info)
}

#[cfg(test)]
mod tests {
    use super::super::made;
    use super::*;

    #[test]
    fn messages_of_foxglove_are_those_of_ros() {
        let pixels = [1, 2, 3, 4, 5, 6];
        let message = made::foxglove::raw_image(1.5, "camera", "rgb8", (2, 1), &pixels);
        assert_eq!(timestamp_s(&message), Some(1.5));
        let expected = Sample {
            frame_id: "camera".to_owned(),
            encoding: "rgb8".to_owned(),
            size: Some((2, 1)),
        };
        assert_eq!(sample(Kind::Image, &message), expected);
        let image = raw_image(&message).unwrap();
        assert_eq!((image.width, image.height, image.step), (2, 1, 6));
        assert_eq!((image.encoding, image.data), ("rgb8", &pixels[..]));
        // A head that ends within the data says what is before them.
        let head = &message[..message.len() - 12];
        assert_eq!(sample(Kind::Image, head), Sample { frame_id: String::new(), ..expected });
        assert!(matches!(raw_image(head), Err(MessageError::Short { .. })));

        let message = made::foxglove::compressed_image(2.25, "camera", "png", b"\x89PNG");
        assert_eq!(timestamp_s(&message), Some(2.25));
        let image = compressed_image(&message).unwrap();
        assert_eq!((image.format, image.data), ("png", &b"\x89PNG"[..]));

        let message = made::foxglove::camera_calibration(
            "camera",
            (2, 1),
            "plumb_bob",
            [500.0, 501.0, 1.0, 0.5],
            &[0.1, -0.2, 0.0, 0.0, 0.3],
        );
        let info = camera_calibration(&message).unwrap();
        assert_eq!((info.model, info.k[0], info.k[4], info.d[4]), ("plumb_bob", 500.0, 501.0, 0.3));
        assert_eq!(sample(Kind::CameraInfo, &message).size, Some((2, 1)));
    }

    #[test]
    fn too_many_coefficients_are_named() {
        let d = [0.5; 15];
        let message = made::foxglove::camera_calibration("", (2, 1), "", [1.0, 1.0, 0.0, 0.0], &d);
        let error = camera_calibration(&message).unwrap_err().to_string();
        assert!(error.starts_with("D has 15 numbers"), "{error}");
    }
}
