//! The messages that are read: those of ROS 2 from CDR here, those of Foxglove by [`super::foxglove`]: images, compressed images, cameras, and the header that
//! they begin with. Fields and their order are those of `std_msgs` and `sensor_msgs`.
//!
//! Data are borrowed from the message. What pixels mean is for `images`, what a camera means for
//! `camera_info`.

use super::cdr::Cdr;
use super::error::MessageError;
use super::{foxglove, poses};

/// What a topic's messages are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Image,
    CompressedImage,
    CameraInfo,
    /// Points, in rows where they are organized.
    PointCloud,
    /// One of those that have a pose.
    Pose,
    /// Transforms that do not change with time.
    StaticTransforms,
    /// Something else, or something in another encoding.
    Other,
}

/// How the messages of a topic are encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// ROS 2.
    Cdr,
    /// Foxglove.
    Protobuf,
}

impl Encoding {
    /// By its name in the recording; what has neither's has no messages that are read.
    pub(super) fn of(name: &str) -> Self {
        if name == "protobuf" { Self::Protobuf } else { Self::Cdr }
    }
}

impl Kind {
    /// By the names of the topic, the type and the encoding.
    pub(super) fn of(topic: &str, type_name: &str, encoding: &str) -> Self {
        match type_name {
            _ if encoding == "protobuf" => foxglove::kind(type_name),
            _ if encoding != "cdr" => Self::Other,
            "sensor_msgs/msg/Image" => Self::Image,
            "sensor_msgs/msg/CompressedImage" => Self::CompressedImage,
            "sensor_msgs/msg/CameraInfo" => Self::CameraInfo,
            "sensor_msgs/msg/PointCloud2" => Self::PointCloud,
            // The same type has those that change.
            "tf2_msgs/msg/TFMessage" if topic.rsplit('/').next() == Some("tf_static") => {
                Self::StaticTransforms
            }
            _ if poses::has_pose(type_name) => Self::Pose,
            _ => Self::Other,
        }
    }
}

/// `std_msgs/msg/Header`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Header<'a> {
    /// Seconds; `None` where the driver left it 0.
    pub(super) timestamp_s: Option<f64>,
    pub(super) frame_id: &'a str,
}

impl<'a> Header<'a> {
    pub(super) fn read(cdr: &mut Cdr<'a>) -> Result<Self, MessageError> {
        let timestamp_s = stamp(cdr)?;
        Ok(Self { timestamp_s, frame_id: cdr.text("header.frame_id")? })
    }
}

fn stamp(cdr: &mut Cdr<'_>) -> Result<Option<f64>, MessageError> {
    let (seconds, nanoseconds) = (cdr.i32("header.stamp.sec")?, cdr.u32("header.stamp.nanosec")?);
    let timestamp_s = f64::from(seconds) + f64::from(nanoseconds) * 1e-9;
    Ok((timestamp_s != 0.0).then_some(timestamp_s))
}

/// The time in the header of a message of which the beginning is known, seconds.
pub(super) fn timestamp_s(encoding: Encoding, head: &[u8]) -> Option<f64> {
    match encoding {
        Encoding::Cdr => stamp(&mut Cdr::new(head).ok()?).ok().flatten(),
        Encoding::Protobuf => foxglove::timestamp_s(head),
    }
}

/// What the beginning of an image says.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Sample {
    pub(super) frame_id: String,
    /// `encoding` of an image, `format` of a compressed one.
    pub(super) encoding: String,
    /// Columns and rows; not known of a compressed image.
    pub(super) size: Option<(usize, usize)>,
}

impl Sample {
    /// From the first bytes of a message; what they do not say is left empty.
    pub(super) fn of(encoding: Encoding, kind: Kind, head: &[u8]) -> Self {
        if encoding == Encoding::Protobuf {
            return foxglove::sample(kind, head);
        }
        let read = || -> Result<Self, MessageError> {
            let mut cdr = Cdr::new(head)?;
            let frame_id = Header::read(&mut cdr)?.frame_id.to_owned();
            Ok(match kind {
                Kind::Image => {
                    let (height, width) = (cdr.u32("height")? as usize, cdr.u32("width")? as usize);
                    let encoding = cdr.text("encoding")?.to_owned();
                    Self { frame_id, encoding, size: Some((width, height)) }
                }
                Kind::CompressedImage => {
                    Self { frame_id, encoding: cdr.text("format")?.to_owned(), size: None }
                }
                Kind::CameraInfo | Kind::PointCloud => {
                    let (height, width) = (cdr.u32("height")? as usize, cdr.u32("width")? as usize);
                    Self { frame_id, encoding: String::new(), size: Some((width, height)) }
                }
                Kind::Pose => Self { frame_id, ..Self::default() },
                Kind::StaticTransforms | Kind::Other => Self::default(),
            })
        };
        read().unwrap_or_default()
    }
}

/// `sensor_msgs/msg/Image`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RawImage<'a> {
    pub(super) height: u32,
    pub(super) width: u32,
    pub(super) encoding: &'a str,
    pub(super) is_big: bool,
    /// Bytes a row.
    pub(super) step: u32,
    pub(super) data: &'a [u8],
}

impl<'a> RawImage<'a> {
    pub(super) fn read(encoding: Encoding, message: &'a [u8]) -> Result<Self, MessageError> {
        if encoding == Encoding::Protobuf {
            return foxglove::raw_image(message);
        }
        let mut cdr = Cdr::new(message)?;
        Header::read(&mut cdr)?;
        Ok(Self {
            height: cdr.u32("height")?,
            width: cdr.u32("width")?,
            encoding: cdr.text("encoding")?,
            is_big: cdr.u8("is_bigendian")? != 0,
            step: cdr.u32("step")?,
            data: cdr.bytes("data")?,
        })
    }
}

/// `sensor_msgs/msg/CompressedImage`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CompressedImage<'a> {
    pub(super) format: &'a str,
    pub(super) data: &'a [u8],
}

impl<'a> CompressedImage<'a> {
    pub(super) fn read(encoding: Encoding, message: &'a [u8]) -> Result<Self, MessageError> {
        if encoding == Encoding::Protobuf {
            return foxglove::compressed_image(message);
        }
        let mut cdr = Cdr::new(message)?;
        Header::read(&mut cdr)?;
        Ok(Self { format: cdr.text("format")?, data: cdr.bytes("data")? })
    }
}

/// `sensor_msgs/msg/CameraInfo`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CameraInfo<'a> {
    pub(super) model: &'a str,
    /// Coefficients of the distortion; 0 behind the last.
    pub(super) d: [f64; 14],
    /// The matrix of the raw image, by rows.
    pub(super) k: [f64; 9],
    /// The matrix of the rectified image, by rows of 4.
    pub(super) p: [f64; 12],
    /// Whether each pixel is one of the sensor's, from its corner on.
    pub(super) is_whole: bool,
}

impl<'a> CameraInfo<'a> {
    pub(super) fn read(encoding: Encoding, message: &'a [u8]) -> Result<Self, MessageError> {
        if encoding == Encoding::Protobuf {
            return foxglove::camera_calibration(message);
        }
        let mut cdr = Cdr::new(message)?;
        Header::read(&mut cdr)?;
        for field in ["height", "width"] {
            cdr.u32(field)?;
        }
        let model = cdr.text("distortion_model")?;
        let (d, _) = cdr.numbers("d")?;
        let k = cdr.array("k")?;
        cdr.array::<9>("r")?;
        let p = cdr.array("p")?;
        let binning = [cdr.u32("binning_x")?, cdr.u32("binning_y")?];
        let offset = [cdr.u32("roi.x_offset")?, cdr.u32("roi.y_offset")?];
        let is_whole = binning.iter().all(|&b| b < 2) && offset == [0, 0];
        Ok(Self { model, d, k, p, is_whole })
    }
}
