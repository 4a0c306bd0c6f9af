//! Formats, round trips, hostile bytes.

use super::*;
use crate::input::encode;

/// A 16 × 8 JPEG of one color, (200, 100, 50) before it was compressed.
const JPEG: &[u8] = include_bytes!("tests/orange.jpg");
/// The same in gray, 128.
const GRAY_JPEG: &[u8] = include_bytes!("tests/gray.jpg");

fn picture() -> Image<[u8; 3]> {
    let pixels = (0..37 * 21).map(|i: u32| [i as u8, (i * 7) as u8, (i / 5) as u8]).collect();
    Image::from_pixels(37, 21, pixels).unwrap()
}

/// A PNG by hand: any color type, palette included.
fn png(color: ColorType, depth: BitDepth, palette: &[u8], samples: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 2);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if !palette.is_empty() {
        encoder.set_palette(palette.to_vec());
    }
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(samples).unwrap();
    writer.finish().unwrap();
    bytes
}

#[test]
fn what_is_encoded_decodes_to_itself() {
    let image = picture();
    assert_eq!(color(&encode::rgb(&image).unwrap()).unwrap(), image);
    let values = image.map(|[a, b, c]| u16::from(a) * 256 + u16::from(b ^ c));
    assert_eq!(depth(&encode::gray16(&values).unwrap()).unwrap(), values);
    let gray = image.map(|[a, b, _]| a ^ b);
    assert_eq!(mask(&encode::gray8(&gray).unwrap()).unwrap(), gray);
}

#[test]
fn every_kind_of_png_becomes_color() {
    use {BitDepth::*, ColorType::*};
    let all = |kind, bits, samples: &[u8]| {
        let image = color(&png(kind, bits, &[], samples)).unwrap();
        image.pixels().to_vec()
    };
    assert_eq!(all(Grayscale, Eight, &[1, 2, 3, 4])[3], [4; 3]);
    assert_eq!(all(GrayscaleAlpha, Eight, &[1, 9, 2, 9, 3, 9, 4, 9])[1], [2; 3]);
    assert_eq!(all(Rgba, Eight, &[7, 8, 9, 0, 7, 8, 9, 0, 7, 8, 9, 0, 1, 2, 3, 0])[3], [1, 2, 3]);
    assert_eq!(all(Grayscale, One, &[0b0100_0000, 0b1000_0000])[1..3], [[255; 3], [255; 3]]);
    assert_eq!(all(Grayscale, Sixteen, &[1, 0, 2, 0, 3, 0, 4, 200])[3], [4; 3]);
    let palette = [10, 20, 30, 40, 50, 60];
    let image = color(&png(Indexed, Eight, &palette, &[1, 0, 0, 1])).unwrap();
    assert_eq!(image.pixels(), [[40, 50, 60], [10, 20, 30], [10, 20, 30], [40, 50, 60]]);
    let image = color(&png(Indexed, Two, &palette, &[0b0100_0000, 0b0001_0000])).unwrap();
    assert_eq!(image.pixels(), [[40, 50, 60], [10, 20, 30], [10, 20, 30], [40, 50, 60]]);
}

#[test]
fn jpeg_is_recognized_by_its_content() {
    let image = color(JPEG).unwrap();
    assert_eq!(image.size(), (16, 8));
    let near = |a: u8, b: u8| a.abs_diff(b) <= 4;
    assert!(image.pixels().iter().all(|p| near(p[0], 200) && near(p[1], 100) && near(p[2], 50)));
    let gray = color(GRAY_JPEG).unwrap();
    assert!(gray.pixels().iter().all(|p| p.iter().all(|&c| near(c, 128))));
    assert!(matches!(depth(JPEG), Err(DecodeError::Format)));
    assert!(matches!(color(b"GIF89a"), Err(DecodeError::Format)));
    assert!(matches!(color(b""), Err(DecodeError::Format)));
}

#[test]
fn depth_is_gray_with_16_bits() {
    let bytes = encode::gray8(&Image::filled(2, 2, 7)).unwrap();
    let error = depth(&bytes).unwrap_err();
    assert!(matches!(error, DecodeError::NotDepth { bits: 8, .. }), "{error}");
    assert_eq!(error.to_string(), "not a depth image: Grayscale with 8 bits, not gray with 16");
}

#[test]
fn a_size_that_the_file_cannot_hold_is_refused_from_the_header() {
    let honest = encode::rgb(&Image::filled(4, 4, [1, 2, 3])).unwrap();
    let claim = |width: u32, height: u32| {
        let mut bytes = honest.clone();
        bytes[16..20].copy_from_slice(&width.to_be_bytes());
        bytes[20..24].copy_from_slice(&height.to_be_bytes());
        let checksum = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
        color(&bytes).unwrap_err()
    };
    assert!(matches!(claim(8192, 8192), DecodeError::Short { width: 8192, .. }));
    assert!(matches!(claim(8193, 1), DecodeError::Side { width: 8193, .. }));
    assert!(matches!(claim(u32::MAX >> 1, u32::MAX >> 1), DecodeError::Side { .. }));
    assert!(matches!(claim(5, 4), DecodeError::Png(_)));
}

/// PNG's checksum, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| (sum >> 1) ^ (0xEDB8_8320 * (sum & 1)))
    })
}

#[test]
fn damaged_bytes_are_errors() {
    let png = encode::rgb(&picture()).unwrap();
    let gray16 = encode::gray16(&picture().map(|p| u16::from(p[0]))).unwrap();
    for cut in 0..png.len() {
        assert!(color(&png[..cut]).is_err(), "{cut} of {} bytes", png.len());
    }
    for at in 8..png.len() {
        let mut bytes = png.clone();
        bytes[at] ^= 0x55;
        // A changed bit may hide in what no reader looks at, but not in pixels.
        assert!(color(&bytes).map_or(true, |image| image == picture()), "byte {at}");
    }
    for at in 0..gray16.len() {
        let mut bytes = gray16.clone();
        bytes[at] ^= 0xff;
        let _ = depth(&bytes);
        let _ = mask(&bytes[..at]);
    }
    for cut in 0..JPEG.len() {
        let mut bytes = JPEG.to_vec();
        bytes[cut] ^= 0xff;
        let _ = color(&bytes);
        let _ = color(&JPEG[..cut]);
    }
    assert!(color(&JPEG[..JPEG.len() / 2]).is_err());
}

#[test]
fn a_palette_that_ends_within_a_color_is_refused() {
    for length in [4, 5, 764] {
        let bytes = png(ColorType::Indexed, BitDepth::Eight, &vec![7; length], &[0; 4]);
        let refused = color(&bytes);
        assert!(
            matches!(refused, Err(DecodeError::Palette { bytes }) if bytes == length),
            "{refused:?}"
        );
    }
}
