//! Images to PNG: color, 8-bit gray for masks, 16-bit gray for depth. Quick rather than small.
//!
//! It writes no files: bytes go to the caller.

use png::{BitDepth, ColorType, Compression, Encoder, EncodingError};

use crate::image::Image;

/// A color image as PNG.
///
/// # Errors
/// An image without pixels, or one that is too large for the format.
pub fn rgb(image: &Image<[u8; 3]>) -> Result<Vec<u8>, EncodingError> {
    encode(image.size(), ColorType::Rgb, BitDepth::Eight, image.pixels().as_flattened())
}

/// An 8-bit gray image as PNG.
///
/// # Errors
/// An image without pixels, or one that is too large for the format.
pub fn gray8(image: &Image<u8>) -> Result<Vec<u8>, EncodingError> {
    encode(image.size(), ColorType::Grayscale, BitDepth::Eight, image.pixels())
}

/// A 16-bit gray image as PNG.
///
/// # Errors
/// An image without pixels, or one that is too large for the format.
pub fn gray16(image: &Image<u16>) -> Result<Vec<u8>, EncodingError> {
    let bytes: Vec<u8> = image.pixels().iter().flat_map(|value| value.to_be_bytes()).collect();
    encode(image.size(), ColorType::Grayscale, BitDepth::Sixteen, &bytes)
}

fn encode(
    (width, height): (usize, usize),
    color: ColorType,
    depth: BitDepth,
    samples: &[u8],
) -> Result<Vec<u8>, EncodingError> {
    let side = |length| u32::try_from(length).ok().ok_or(EncodingError::LimitsExceeded);
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, side(width)?, side(height)?);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(Compression::Fast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(samples)?;
    writer.finish()?;
    Ok(bytes)
}
