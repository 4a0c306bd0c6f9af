//! Pixels of ROS 2 images: color as red, green, blue, and depth in meters.
//!
//! Of depth, 16-bit numbers are millimeters and 32-bit ones meters (REP 118), unless the caller says
//! otherwise; `compressedDepth` is a PNG behind 12 bytes, in which 32-bit depth is quantized by its inverse
//! (`compressed_depth_image_transport`). Memory for pixels is taken only where the message has them.

use super::error::MessageError;
use super::messages::{CompressedImage, RawImage};
use crate::image::Image;
use crate::input::decode::{self, MAX_SIDE};

/// Units a meter of 16-bit depth.
pub(super) const UNITS_PER_M: f32 = 1000.0;
/// Stands for "none measured" in 16-bit depth, as 0 does.
const NONE: u16 = u16::MAX;
/// What `compressedDepth` has before its PNG: a number for the format and two parameters.
const DEPTH_HEADER: usize = 12;

/// Encodings of color: the bytes of a pixel, and where its red, green and blue are.
const COLOR: [(&str, usize, [usize; 3]); 5] = [
    ("rgb8", 3, [0, 1, 2]),
    ("bgr8", 3, [2, 1, 0]),
    ("rgba8", 4, [0, 1, 2]),
    ("bgra8", 4, [2, 1, 0]),
    ("mono8", 1, [0, 0, 0]),
];
/// Their names.
pub(super) const COLOR_NAMES: &str = "rgb8, bgr8, rgba8, bgra8 and mono8";
/// The names of encodings of depth.
pub(super) const DEPTH_NAMES: &str = "16UC1, mono16 and 32FC1";
const COMPRESSED_DEPTH_NAMES: &str = "PNG with 16UC1 or 32FC1";

/// Whether an encoding is of color that can be read.
pub(super) fn is_color(encoding: &str) -> bool {
    COLOR.iter().any(|(name, ..)| *name == encoding)
}

/// Whether an encoding is of depth.
pub(super) fn is_depth(encoding: &str) -> bool {
    ["16UC1", "mono16", "32FC1"].contains(&encoding)
}

/// Whether the format of a compressed image is of depth.
pub(super) fn is_compressed_depth(format: &str) -> bool {
    format.contains("compressedDepth") || is_depth(format.split(';').next().unwrap_or_default())
}

/// The rows of an image of which each pixel has so many bytes.
pub(super) fn rows<'a>(
    image: &RawImage<'a>,
    bytes_per_pixel: usize,
) -> Result<(usize, usize, impl Iterator<Item = &'a [u8]> + use<'a>), MessageError> {
    let RawImage { width, height, step, data, .. } = *image;
    let side = |length: u32| usize::try_from(length).ok().filter(|l| (1..=MAX_SIDE).contains(l));
    let (Some(columns), Some(lines)) = (side(width), side(height)) else {
        return Err(MessageError::Side { width, height });
    };
    // Some drivers leave the step 0 where rows follow each other.
    let row = columns * bytes_per_pixel;
    let stride = if step == 0 { row } else { step as usize };
    let needed = stride.checked_mul(lines - 1).and_then(|before| before.checked_add(row));
    if stride < row || needed.is_none_or(|needed| data.len() < needed) {
        return Err(MessageError::Rows {
            bytes: data.len(),
            step,
            width: columns,
            height: lines,
            encoding: image.encoding.chars().take(40).collect(),
        });
    }
    Ok((columns, lines, data.chunks(stride).take(lines).map(move |line| &line[..row])))
}

/// An image of these pixels, of which there are as many as its rows have.
pub(super) fn image<T: Copy>(
    (width, height): (usize, usize),
    pixels: Vec<T>,
) -> Result<Image<T>, MessageError> {
    let side = |length| u32::try_from(length).unwrap_or(u32::MAX);
    let error = MessageError::Side { width: side(width), height: side(height) };
    Image::from_pixels(width, height, pixels).ok_or(error)
}

/// An image's color.
pub(super) fn color(raw: &RawImage<'_>) -> Result<Image<[u8; 3]>, MessageError> {
    let Some((_, bytes, [r, g, b])) = COLOR.iter().find(|(name, ..)| *name == raw.encoding) else {
        return Err(unknown(raw.encoding, COLOR_NAMES));
    };
    let (width, height, rows) = rows(raw, *bytes)?;
    let mut pixels = Vec::with_capacity(width * height);
    for row in rows {
        pixels.extend(row.chunks_exact(*bytes).map(|pixel| [pixel[*r], pixel[*g], pixel[*b]]));
    }
    image((width, height), pixels)
}

/// The color of a compressed image.
pub(super) fn compressed_color(
    compressed: &CompressedImage<'_>,
) -> Result<Image<[u8; 3]>, MessageError> {
    Ok(decode::color(compressed.data)?)
}

/// An image's depth in meters, 0 where none was measured; `units_per_m` as the caller gives them.
pub(super) fn depth(
    raw: &RawImage<'_>,
    units_per_m: Option<f32>,
) -> Result<Image<f32>, MessageError> {
    if raw.encoding == "32FC1" {
        let (width, height, rows) = rows(raw, 4)?;
        let units_per_m = units_per_m.unwrap_or(1.0);
        let meters = |&bytes: &[u8; 4]| {
            let number =
                if raw.is_big { f32::from_be_bytes(bytes) } else { f32::from_le_bytes(bytes) };
            measured(number / units_per_m)
        };
        let mut pixels = Vec::with_capacity(width * height);
        for row in rows {
            pixels.extend(row.as_chunks().0.iter().map(meters));
        }
        return image((width, height), pixels);
    }
    let units_per_m = units_per_m.unwrap_or(UNITS_PER_M);
    Ok(units(raw)?.map(|value| millimeters(value, units_per_m)))
}

/// The numbers of 16-bit depth.
pub(super) fn units(raw: &RawImage<'_>) -> Result<Image<u16>, MessageError> {
    if !is_depth(raw.encoding) || raw.encoding == "32FC1" {
        return Err(unknown(raw.encoding, DEPTH_NAMES));
    }
    let (width, height, rows) = rows(raw, 2)?;
    let mut pixels = Vec::with_capacity(width * height);
    for row in rows {
        let number = |&bytes: &[u8; 2]| {
            if raw.is_big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) }
        };
        pixels.extend(row.as_chunks().0.iter().map(number));
    }
    image((width, height), pixels)
}

/// The depth of a compressed image in meters, as [`depth`].
pub(super) fn compressed_depth(
    compressed: &CompressedImage<'_>,
    units_per_m: Option<f32>,
) -> Result<Image<f32>, MessageError> {
    let CompressedImage { format, data } = *compressed;
    let encoding = format.split(';').next().unwrap_or_default().trim();
    if !format.contains("compressedDepth") {
        let units_per_m = units_per_m.unwrap_or(UNITS_PER_M);
        return Ok(decode::depth(data)?.map(|value| millimeters(value, units_per_m)));
    }
    let Some((header, png)) = data.split_first_chunk::<DEPTH_HEADER>() else {
        return Err(MessageError::Short { field: "the header of the depth", bytes: data.len() });
    };
    if format.contains("rvl") {
        return Err(unknown(format, COMPRESSED_DEPTH_NAMES));
    }
    let values = decode::depth(png)?;
    match encoding {
        "32FC1" => {
            let units_per_m = units_per_m.unwrap_or(1.0);
            let [_, _, _, _, a @ .., _, _, _, _] = *header;
            let [_, _, _, _, _, _, _, _, b @ ..] = *header;
            let (a, b) = (f32::from_le_bytes(a), f32::from_le_bytes(b));
            let meters = |value: u16| {
                if value == 0 { 0.0 } else { measured(a / (f32::from(value) - b) / units_per_m) }
            };
            Ok(values.map(meters))
        }
        "16UC1" | "mono16" => {
            let units_per_m = units_per_m.unwrap_or(UNITS_PER_M);
            Ok(values.map(|value| millimeters(value, units_per_m)))
        }
        other => Err(unknown(other, COMPRESSED_DEPTH_NAMES)),
    }
}

fn millimeters(value: u16, units_per_m: f32) -> f32 {
    if value == NONE { 0.0 } else { f32::from(value) / units_per_m }
}

/// No number, infinity and less than 0 say that nothing was measured.
pub(super) fn measured(meters: f32) -> f32 {
    if meters.is_finite() && meters > 0.0 { meters } else { 0.0 }
}

fn unknown(found: &str, known: &'static str) -> MessageError {
    MessageError::Encoding { found: found.chars().take(40).collect(), known }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::encode;

    fn raw<'a>(encoding: &'a str, step: u32, data: &'a [u8]) -> RawImage<'a> {
        RawImage { height: 2, width: 2, encoding, is_big: false, step, data }
    }

    #[test]
    fn color_has_its_channels_in_order_and_rows_may_be_padded() {
        let padded: Vec<u8> = (0..14).collect();
        let rgb = color(&raw("rgb8", 8, &padded)).unwrap();
        assert_eq!(rgb.pixels(), [[0, 1, 2], [3, 4, 5], [8, 9, 10], [11, 12, 13]]);
        let bgra = color(&raw("bgra8", 8, &(0..16).collect::<Vec<_>>())).unwrap();
        assert_eq!(bgra.pixels(), [[2, 1, 0], [6, 5, 4], [10, 9, 8], [14, 13, 12]]);
        let mono = color(&raw("mono8", 0, &[7, 8, 9, 1])).unwrap();
        assert_eq!(mono.pixels(), [[7; 3], [8; 3], [9; 3], [1; 3]]);
    }

    #[test]
    fn depth_is_in_meters_and_zero_where_none_was_measured() {
        let numbers = [1500u16, 0, 65535, 250].map(u16::to_le_bytes).concat();
        let found = depth(&raw("16UC1", 4, &numbers), None).unwrap();
        assert_eq!(found.pixels(), [1.5, 0.0, 0.0, 0.25]);
        let found = depth(&raw("16UC1", 4, &numbers), Some(5000.0)).unwrap();
        assert_eq!(found.pixels()[0], 0.3);
        let big = RawImage { is_big: true, ..raw("16UC1", 4, &[5, 220, 0, 0, 255, 255, 0, 250]) };
        assert_eq!(depth(&big, None).unwrap().pixels(), [1.5, 0.0, 0.0, 0.25]);
        let numbers = [1.5f32, f32::NAN, f32::INFINITY, -1.0].map(f32::to_le_bytes).concat();
        let found = depth(&raw("32FC1", 8, &numbers), None).unwrap();
        assert_eq!(found.pixels(), [1.5, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn compressed_depth_is_a_png_behind_its_header() {
        let image = Image::from_pixels(2, 1, vec![1500u16, 0]).unwrap();
        let png = encode::gray16(&image).unwrap();
        let read = |format, data: &[u8]| compressed_depth(&CompressedImage { format, data }, None);
        let with_header = [&[0; 12][..], &png].concat();
        let found = read("16UC1; compressedDepth png", &with_header).unwrap();
        assert_eq!(found.pixels(), [1.5, 0.0]);
        assert_eq!(read("16UC1; png compressed", &png).unwrap().pixels(), [1.5, 0.0]);
        // depth = a / (value - b): 3000 / (1500 - 0.5).
        let header = [[0; 4], 3000f32.to_le_bytes(), 0.5f32.to_le_bytes()].concat();
        let found = read("32FC1; compressedDepth", &[&header[..], &png].concat()).unwrap();
        assert_eq!(found.pixels(), [3000.0 / 1499.5, 0.0]);
        let error = read("16UC1; compressedDepth rvl", &with_header).unwrap_err().to_string();
        assert!(error.contains("rvl"), "{error}");
        assert!(read("16UC1; compressedDepth png", &png[..8]).is_err());
    }

    #[test]
    fn images_that_do_not_hold_their_pixels_are_refused() {
        for (encoding, step, length) in [("rgb8", 6, 11), ("rgb8", 5, 100), ("16UC1", 4, 7)] {
            let data = vec![0; length];
            let image = raw(encoding, step, &data);
            let error =
                if is_color(encoding) { color(&image).err() } else { depth(&image, None).err() };
            assert!(matches!(error, Some(MessageError::Rows { .. })), "{encoding} {step} {length}");
        }
        let huge = RawImage { width: u32::MAX, ..raw("rgb8", u32::MAX, &[]) };
        assert!(matches!(color(&huge), Err(MessageError::Side { .. })));
        let error = color(&raw("bayer_rggb8", 2, &[0; 4])).unwrap_err().to_string();
        assert!(error.contains("`bayer_rggb8`") && error.contains("rgb8, bgr8"), "{error}");
        assert!(depth(&raw("rgb8", 6, &[0; 12]), None).is_err());
    }
}
