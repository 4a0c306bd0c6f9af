//! Depth from organized point clouds, `sensor_msgs/msg/PointCloud2`: points in rows are pixels, and in the frame
//! of the color camera a point's z is its depth.
//!
//! Where nothing was measured, z is no number. Points without rows say nothing of pixels, and `topics` refuses
//! them. Memory is taken only for points that the message has.

use super::cdr::Cdr;
use super::error::MessageError;
use super::images;
use super::messages::{Header, RawImage};
use crate::image::Image;

/// `sensor_msgs/msg/PointField.FLOAT32`.
const FLOAT32: u8 = 7;

/// `sensor_msgs/msg/PointCloud2`, of which z is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PointCloud<'a> {
    height: u32,
    width: u32,
    is_big: bool,
    /// Bytes a point.
    point_step: u32,
    /// Bytes a row.
    row_step: u32,
    /// Where in a point its z begins.
    z_offset: u32,
    data: &'a [u8],
}

impl<'a> PointCloud<'a> {
    /// Reads a message. A cloud whose points have no x, y and z as 32-bit floats is refused.
    pub(super) fn read(message: &'a [u8]) -> Result<Self, MessageError> {
        let mut cdr = Cdr::new(message)?;
        Header::read(&mut cdr)?;
        let (height, width) = (cdr.u32("height")?, cdr.u32("width")?);
        let mut offsets = [("x", None), ("y", None), ("z", None)];
        for _ in 0..cdr.u32("fields")? {
            let name = cdr.text("fields.name")?;
            let (offset, datatype) = (cdr.u32("fields.offset")?, cdr.u8("fields.datatype")?);
            cdr.u32("fields.count")?;
            let wanted = offsets.iter_mut().find(|(wanted, _)| *wanted == name);
            if let Some((_, found)) = wanted.filter(|_| datatype == FLOAT32) {
                *found = Some(offset);
            }
        }
        let is_big = cdr.u8("is_bigendian")? != 0;
        let (point_step, row_step) = (cdr.u32("point_step")?, cdr.u32("row_step")?);
        let data = cdr.bytes("data")?;
        let mut z_offset = 0;
        for (field, offset) in offsets {
            let is_within =
                |offset: &u32| offset.checked_add(4).is_some_and(|end| end <= point_step);
            let missing = MessageError::NoField { field, point_step };
            z_offset = offset.filter(is_within).ok_or(missing)?;
        }
        Ok(Self { height, width, is_big, point_step, row_step, z_offset, data })
    }
}

/// A cloud's depth in meters, 0 where none was measured; `units_per_m` as the caller gives them.
pub(super) fn depth(
    cloud: &PointCloud<'_>,
    units_per_m: Option<f32>,
) -> Result<Image<f32>, MessageError> {
    let PointCloud { height, width, is_big, point_step, row_step: step, z_offset, data } = *cloud;
    let bytes = point_step as usize;
    let raw = RawImage { height, width, encoding: "points", is_big, step, data };
    let (width, height, rows) = images::rows(&raw, bytes)?;
    let units_per_m = units_per_m.unwrap_or(1.0);
    let mut pixels = Vec::with_capacity(width * height);
    for row in rows {
        let z = |point: &[u8]| {
            let number = point.get(z_offset as usize..).and_then(<[u8]>::first_chunk::<4>)?;
            Some(if is_big { f32::from_be_bytes(*number) } else { f32::from_le_bytes(*number) })
        };
        pixels.extend(
            row.chunks_exact(bytes).filter_map(z).map(|z| images::measured(z / units_per_m)),
        );
    }
    images::image((width, height), pixels)
}

#[cfg(test)]
mod tests {
    use super::super::made;
    use super::*;

    fn read(message: &[u8]) -> Result<Vec<f32>, MessageError> {
        Ok(depth(&PointCloud::read(message)?, None)?.pixels().to_vec())
    }

    #[test]
    fn depth_is_z_and_zero_where_no_point_was_measured() {
        let none = [f32::NAN; 3];
        let points = [[0.1, 0.2, 1.5], none, [0.3, 0.4, f32::INFINITY], [5.0, 6.0, 0.25]];
        let message = made::point_cloud(1.0, "color", (2, 2), &points);
        assert_eq!(read(&message).unwrap(), [1.5, 0.0, 0.0, 0.25]);
        let cloud = PointCloud::read(&message).unwrap();
        assert_eq!(depth(&cloud, Some(1000.0)).unwrap().pixels()[0], 0.0015);
        // The highest byte first, in rows with bytes behind their points.
        let z = [1.5f32, f32::NAN, 2.5, 0.25].map(f32::to_be_bytes);
        let data = [&z[0][..], &z[1], &[9; 4], &z[2], &z[3], &[9; 4]].concat();
        let (is_big, point_step, row_step, z_offset) = (true, 4, 12, 0);
        let cloud =
            PointCloud { height: 2, width: 2, is_big, point_step, row_step, z_offset, data: &data };
        assert_eq!(depth(&cloud, None).unwrap().pixels(), [1.5, 0.0, 2.5, 0.25]);
    }

    #[test]
    fn clouds_that_do_not_hold_their_points_are_refused() {
        let message = made::point_cloud(1.0, "color", (2, 2), &[[1.0; 3]; 3]);
        assert!(matches!(read(&message), Err(MessageError::Rows { .. })));
        let mut double = made::point_cloud(1.0, "color", (1, 2), &[[1.0; 3]; 2]);
        assert!(read(&double).is_ok());
        // The type of z, behind its name and offset: a double.
        let name = [2, 0, 0, 0, b'z', 0];
        let at = double.windows(name.len()).position(|bytes| bytes == name).unwrap();
        double[at + 12] = 8;
        let error = read(&double).unwrap_err().to_string();
        assert!(error.contains("no field `z` of type FLOAT32"), "{error}");
        assert!(read(&double[..40]).is_err());
    }
}
