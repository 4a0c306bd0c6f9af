//! Decodes PNG and JPEG files; the first bytes decide which of the two a file is, not its name.
//!
//! Hostile bytes give an error and never a panic, and memory for pixels is taken only where the file
//! is long enough to hold that many.

use std::io::Cursor;

use png::{BitDepth, ColorType, Decoder, Transformations};
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::image::Image;

/// The widest and the highest image that is read, px.
pub const MAX_SIDE: usize = 8192;

/// How many pixels a file may claim, whatever its length, and how many a byte of it: a file of 1 MiB
/// then takes less than 64 MiB, up to 9 bytes a pixel with what a progressive JPEG keeps. Deflate
/// can stand for 1032 bytes with one, but no camera's image does.
const MAX_PIXELS: usize = 5 << 20;
const MAX_PIXELS_PER_BYTE: usize = 5;

const PNG_MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";
const JPEG_MAGIC: &[u8] = b"\xff\xd8\xff";

/// Why bytes are not the image that was asked for.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The first bytes are of neither format.
    #[error("neither PNG nor JPEG")]
    Format,
    /// The image has no pixels or too many a side.
    #[error("{width}x{height} pixels, and each side must have 1 to {MAX_SIDE}")]
    Side {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// The file is too short for the size that it claims.
    #[error("{bytes} bytes cannot hold {width}x{height} pixels")]
    Short {
        /// The file's length.
        bytes: usize,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// The PNG is damaged.
    #[error("PNG: {0}")]
    Png(#[from] png::DecodingError),
    /// The palette of the PNG ends within a color.
    #[error("PNG: the palette has {bytes} bytes, not three for each color")]
    Palette {
        /// Its length.
        bytes: usize,
    },
    /// The JPEG is damaged or of a kind that is not read.
    #[error("JPEG: {0:?}")]
    Jpeg(DecodeErrors),
    /// Depth is a gray PNG with 16 bits.
    #[error("not a depth image: {color:?} with {bits} bits, not gray with 16")]
    NotDepth {
        /// What a pixel holds.
        color: ColorType,
        /// Bits a sample.
        bits: u8,
    },
}

impl From<DecodeErrors> for DecodeError {
    fn from(error: DecodeErrors) -> Self {
        Self::Jpeg(error)
    }
}

/// A PNG (gray, color, palette, with or without alpha, which is ignored) or a JPEG as color.
///
/// # Errors
/// [`DecodeError`] where the bytes are no such image.
pub fn color(bytes: &[u8]) -> Result<Image<[u8; 3]>, DecodeError> {
    if bytes.starts_with(PNG_MAGIC) {
        color_png(bytes)
    } else if bytes.starts_with(JPEG_MAGIC) {
        color_jpeg(bytes)
    } else {
        Err(DecodeError::Format)
    }
}

/// A gray PNG with 16 bits, its values as they stand.
///
/// # Errors
/// [`DecodeError`] where the bytes are no such image.
pub fn depth(bytes: &[u8]) -> Result<Image<u16>, DecodeError> {
    Png::decode(bytes, Transformations::IDENTITY)?.gray16()
}

/// A PNG as 8-bit gray, as masks are; of a colored one the strongest channel.
///
/// # Errors
/// [`DecodeError`] where the bytes are no PNG.
pub fn mask(bytes: &[u8]) -> Result<Image<u8>, DecodeError> {
    Ok(color_png(bytes)?.map(|[r, g, b]| r.max(g).max(b)))
}

fn color_png(bytes: &[u8]) -> Result<Image<[u8; 3]>, DecodeError> {
    // Palettes and fewer than 8 bits become 8-bit samples, 16 bits lose their lower half.
    Png::decode(bytes, Transformations::normalize_to_color8())?.color()
}

fn color_jpeg(bytes: &[u8]) -> Result<Image<[u8; 3]>, DecodeError> {
    // Strict: a JPEG that ends early is reported, rather than completed with gray.
    let options = DecoderOptions::new_fast()
        .set_max_width(MAX_SIDE)
        .set_max_height(MAX_SIDE)
        .set_strict_mode(true)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers()?;
    let (width, height) =
        decoder.info().map_or((0, 0), |info| (usize::from(info.width), usize::from(info.height)));
    check_size(width, height, bytes.len())?;
    let samples = decoder.decode()?;
    let (pixels, _) = samples.as_chunks();
    Image::from_pixels(width, height, pixels.to_vec()).ok_or(DecodeError::Side { width, height })
}

/// A PNG's samples, rows without padding.
struct Png {
    width: usize,
    height: usize,
    color: ColorType,
    depth: BitDepth,
    samples: Vec<u8>,
}

impl Png {
    fn decode(bytes: &[u8], transformations: Transformations) -> Result<Self, DecodeError> {
        if !bytes.starts_with(PNG_MAGIC) {
            return Err(DecodeError::Format);
        }
        Self::read(Decoder::new(Cursor::new(bytes)), bytes.len(), transformations)
    }

    /// Reads a file of `length` bytes.
    fn read(
        mut decoder: Decoder<Cursor<&[u8]>>,
        length: usize,
        transformations: Transformations,
    ) -> Result<Self, DecodeError> {
        decoder.set_transformations(transformations);
        decoder.set_ignore_text_chunk(true);
        let header = decoder.read_header_info()?;
        let (width, height) = (header.width as usize, header.height as usize);
        check_size(width, height, length)?;
        let mut reader = decoder.read_info()?;
        // The library (0.18.1) panics on such a palette when it expands the first row.
        let palette = reader.info().palette.as_ref().map_or(0, |palette| palette.len());
        if palette % 3 != 0 {
            return Err(DecodeError::Palette { bytes: palette });
        }
        let size = reader.output_buffer_size().ok_or(DecodeError::Side { width, height })?;
        let mut samples = vec![0; size];
        let frame = reader.next_frame(&mut samples)?;
        // Checksums stand behind the pixels.
        reader.finish()?;
        samples.truncate(frame.buffer_size());
        Ok(Self { width, height, color: frame.color_type, depth: frame.bit_depth, samples })
    }

    /// The 8-bit samples as color.
    fn color(&self) -> Result<Image<[u8; 3]>, DecodeError> {
        let pixels = match self.color.samples() {
            channels @ 1..=2 => self.samples.chunks_exact(channels).map(|p| [p[0]; 3]).collect(),
            channels => self.samples.chunks_exact(channels).map(|p| [p[0], p[1], p[2]]).collect(),
        };
        self.image(pixels)
    }

    /// The samples as they stand, where they are gray with 16 bits.
    fn gray16(&self) -> Result<Image<u16>, DecodeError> {
        if (self.color, self.depth) != (ColorType::Grayscale, BitDepth::Sixteen) {
            return Err(DecodeError::NotDepth { color: self.color, bits: self.depth as u8 });
        }
        let pairs = self.samples.as_chunks().0;
        self.image(pairs.iter().map(|&pair| u16::from_be_bytes(pair)).collect())
    }

    fn image<T: Copy>(&self, pixels: Vec<T>) -> Result<Image<T>, DecodeError> {
        let Self { width, height, .. } = *self;
        Image::from_pixels(width, height, pixels).ok_or(DecodeError::Side { width, height })
    }
}

/// Refuses sizes that are too large, and those that so few bytes cannot hold.
fn check_size(width: usize, height: usize, bytes: usize) -> Result<(), DecodeError> {
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
        return Err(DecodeError::Side { width, height });
    }
    if width * height > MAX_PIXELS.max(bytes.saturating_mul(MAX_PIXELS_PER_BYTE)) {
        return Err(DecodeError::Short { bytes, width, height });
    }
    Ok(())
}

/// A PNG's color and its depth, whatever its checksums say: the fuzzer could not get past them.
#[cfg(any(test, feature = "fuzzing"))]
pub(super) fn unchecked(bytes: &[u8]) -> (Option<Image<[u8; 3]>>, Option<Image<u16>>) {
    let read = |transformations| {
        let mut decoder = Decoder::new(Cursor::new(bytes));
        decoder.ignore_checksums(true);
        Png::read(decoder, bytes.len(), transformations).ok()
    };
    let color = read(Transformations::normalize_to_color8());
    let depth = read(Transformations::IDENTITY);
    (color.and_then(|png| png.color().ok()), depth.and_then(|png| png.gray16().ok()))
}

#[cfg(test)]
mod tests;
