//! Images of Record3D: numbers row by row, compressed with Apple's LZFSE.
//!
//! At most as many bytes are decompressed as the image has, whatever the file claims.

use std::fmt;
use std::io::Read;
use std::path::Path;

use lzfse_rust::LzfseRingDecoder;

use super::error::CaptureError;
use crate::image::Image;

/// The sensor measures up to 5 m; what is farther than this is no depth, m.
const MOST_M: f32 = 1e3;

/// A decoder, with buffers that are used again.
#[derive(Default)]
pub(super) struct Lzfse(LzfseRingDecoder);

impl fmt::Debug for Lzfse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Lzfse")
    }
}

impl Lzfse {
    /// Depth, m, 0 where none was measured.
    pub(super) fn depth(
        &mut self,
        bytes: &[u8],
        size: (usize, usize),
        path: &Path,
    ) -> Result<Image<f32>, CaptureError> {
        let bytes = self.decompress(bytes, 4 * size.0 * size.1, path)?;
        let (numbers, _) = bytes.as_chunks();
        let meters = |&bytes: &[u8; 4]| {
            let value = f32::from_le_bytes(bytes);
            if value > 0.0 && value <= MOST_M { value } else { 0.0 }
        };
        image(numbers.iter().map(meters).collect(), size, path)
    }

    /// Confidence: 0 where the sensor is not sure of its depth.
    pub(super) fn confidence(
        &mut self,
        bytes: &[u8],
        size: (usize, usize),
        path: &Path,
    ) -> Result<Image<u8>, CaptureError> {
        let pixels = self.decompress(bytes, size.0 * size.1, path)?;
        image(pixels, size, path)
    }

    fn decompress(
        &mut self,
        bytes: &[u8],
        expected: usize,
        path: &Path,
    ) -> Result<Vec<u8>, CaptureError> {
        let mut found = Vec::new();
        let read = self.0.reader_bytes(bytes).take(expected as u64 + 1).read_to_end(&mut found);
        let problem = match read {
            Ok(length) if length == expected => return Ok(found),
            Ok(length) if length < expected => format!("{length} bytes"),
            Ok(_) => "more bytes".to_owned(),
            Err(error) => {
                // What a damaged image left in the decoder is not the next one's.
                self.0 = LzfseRingDecoder::default();
                error.to_string()
            }
        };
        Err(CaptureError::Lzfse { path: path.to_owned(), expected, problem })
    }
}

fn image<T: Copy>(
    pixels: Vec<T>,
    (width, height): (usize, usize),
    path: &Path,
) -> Result<Image<T>, CaptureError> {
    let expected = pixels.len();
    let problem = || format!("{width}x{height} pixels");
    Image::from_pixels(width, height, pixels).ok_or_else(|| CaptureError::Lzfse {
        path: path.to_owned(),
        expected,
        problem: problem(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_and_confidence_are_read_and_what_is_no_depth_is_none() {
        let pack = |bytes: &[u8]| {
            let mut packed = Vec::new();
            lzfse_rust::encode_bytes(bytes, &mut packed).unwrap();
            packed
        };
        let mut numbers = vec![1.5f32; 6000];
        numbers[..5].copy_from_slice(&[f32::NAN, -1.0, f32::INFINITY, 0.0, 4.75]);
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        let (path, mut lzfse) = (Path::new("rgbd/0.depth"), Lzfse::default());
        let depth = lzfse.depth(&pack(&bytes), (100, 60), path).unwrap();
        assert_eq!(depth.pixels()[..6], [0.0, 0.0, 0.0, 0.0, 4.75, 1.5]);
        assert_eq!(depth.size(), (100, 60));
        let confidence = lzfse.confidence(&pack(&[2, 1, 0, 2]), (2, 2), path).unwrap();
        assert_eq!(confidence.pixels(), [2, 1, 0, 2]);

        // Of another size, cut, and no LZFSE at all.
        let error =
            |bytes: &[u8], size| Lzfse::default().depth(bytes, size, path).unwrap_err().to_string();
        let few = error(&pack(&bytes), (100, 61));
        assert_eq!(few, "rgbd/0.depth: not 24400 bytes of LZFSE: 24000 bytes");
        assert!(error(&pack(&bytes), (100, 59)).ends_with("more bytes"));
        let packed = pack(&bytes);
        assert!(
            error(&packed[..packed.len() / 2], (100, 60)).starts_with("rgbd/0.depth: not 24000")
        );
        assert!(
            error(b"\x89PNG and no more of it", (1, 1)).starts_with("rgbd/0.depth: not 4 bytes")
        );
        assert!(error(b"", (1, 1)).starts_with("rgbd/0.depth: not 4 bytes"));
    }
}
