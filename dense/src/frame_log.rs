//! A log of the integrated frames, so that they can be integrated again at corrected poses.
//!
//! The frames are compressed, one page of a file each. Depth is rounded to steps of 0.2 mm, so that the
//! live integration must use the frame as [`FrameLog::append`] rounds it. Independent of poses.

use std::io;

use super::pages::{Page, PageFile};
use crate::image::Image;

/// Depth steps per meter: those of the TUM RGB-D benchmark, and five per millimeter of other formats.
const STEPS_PER_M: f32 = 5000.0;
/// The fastest level that still halves a frame.
const COMPRESSION_LEVEL: i32 = 1;

/// The images of a frame that are integrated.
#[derive(Clone, Debug, PartialEq)]
pub struct LoggedFrame {
    /// Distance along the optical axis in meters, 0 where none was measured.
    pub depth_m: Image<f32>,
    /// Red, green, blue.
    pub color: Image<[u8; 3]>,
    /// 255 where something moves.
    pub moving: Option<Image<u8>>,
}

/// Frames in a file.
#[derive(Debug)]
pub struct FrameLog {
    pages: PageFile,
    entries: Vec<Entry>,
    buffer: Vec<u8>,
}

/// The page of a frame, and its size in pixels.
#[derive(Debug)]
struct Entry {
    page: Page,
    size: (usize, usize),
    has_mask: bool,
}

impl FrameLog {
    /// An empty one, in the system's temporary folder.
    ///
    /// # Errors
    /// No file can be made there.
    pub fn new() -> io::Result<Self> {
        Ok(Self { pages: PageFile::new(None)?, entries: Vec::new(), buffer: Vec::new() })
    }

    /// Appends a frame, and rounds its depth as the log stores it.
    ///
    /// # Errors
    /// The file cannot be written, or the images differ in size; the log is unchanged.
    pub fn append(&mut self, frame: &mut LoggedFrame) -> io::Result<()> {
        let size = frame.depth_m.size();
        let mask_size = frame.moving.as_ref().map_or(size, Image::size);
        if frame.color.size() != size || mask_size != size {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "images differ in size"));
        }
        self.buffer.clear();
        put_depth(&mut frame.depth_m, &mut self.buffer);
        put_color(&frame.color, &mut self.buffer);
        if let Some(moving) = &frame.moving {
            self.buffer.extend_from_slice(moving.pixels());
        }
        let packed = zstd::bulk::compress(&self.buffer, COMPRESSION_LEVEL)?;
        let page = self.pages.put(&packed).map_err(io::Error::other)?;
        self.entries.push(Entry { page, size, has_mask: frame.moving.is_some() });
        Ok(())
    }

    /// Removes the last frame, if there is one.
    pub fn forget_last(&mut self) {
        if let Some(last) = self.entries.pop() {
            self.pages.free(&last.page);
        }
    }

    /// The frame at an index below the number of frames.
    ///
    /// # Errors
    /// The file cannot be read, or there is no such frame.
    pub fn read(&mut self, index: usize) -> io::Result<LoggedFrame> {
        let damaged = || io::Error::new(io::ErrorKind::InvalidData, format!("frame {index}"));
        let Entry { page, size, has_mask } = self.entries.get(index).ok_or_else(damaged)?;
        let packed = self.pages.read(page).map_err(io::Error::other)?;
        let pixels = size.0 * size.1;
        let buffer = zstd::bulk::decompress(&packed, 6 * pixels)?;
        let (depth, rest) = buffer.split_at_checked(2 * pixels).ok_or_else(damaged)?;
        let (color, moving) = rest.split_at_checked(3 * pixels).ok_or_else(damaged)?;
        let moving = has_mask.then(|| Image::from_pixels(size.0, size.1, moving.to_vec()));
        Ok(LoggedFrame {
            depth_m: Image::from_pixels(size.0, size.1, take_depth(depth)).ok_or_else(damaged)?,
            color: Image::from_pixels(size.0, size.1, take_color(color)).ok_or_else(damaged)?,
            moving: moving.map(|mask| mask.ok_or_else(damaged)).transpose()?,
        })
    }
}

/// Depth in steps, as differences to the previous pixel: all low bytes, then all high ones.
fn put_depth(depth_m: &mut Image<f32>, out: &mut Vec<u8>) {
    let start = out.len();
    let count = depth_m.pixels().len();
    out.resize(start + 2 * count, 0);
    let (low, high) = out[start..].split_at_mut(count);
    let mut before = 0_u16;
    for ((depth, low), high) in depth_m.pixels_mut().iter_mut().zip(low).zip(high) {
        let steps = (*depth * STEPS_PER_M).round();
        // NaN, negative and too large values become 0.
        let steps = if steps > 0.0 && steps <= f32::from(u16::MAX) { steps as u16 } else { 0 };
        *depth = meters(steps);
        [*low, *high] = steps.wrapping_sub(before).to_le_bytes();
        before = steps;
    }
}

fn take_depth(bytes: &[u8]) -> Vec<f32> {
    let (low, high) = bytes.split_at(bytes.len() / 2);
    let mut steps = 0_u16;
    let next = |(&low, &high): (&u8, &u8)| {
        steps = steps.wrapping_add(u16::from_le_bytes([low, high]));
        meters(steps)
    };
    low.iter().zip(high).map(next).collect()
}

/// Computed by a division, as in the decoders of depth images.
fn meters(steps: u16) -> f32 {
    f32::from(steps) / STEPS_PER_M
}

/// Channel by channel, as differences to the previous pixel.
fn put_color(color: &Image<[u8; 3]>, out: &mut Vec<u8>) {
    for channel in 0..3 {
        let mut before = 0_u8;
        out.extend(color.pixels().iter().map(|pixel| {
            let difference = pixel[channel].wrapping_sub(before);
            before = pixel[channel];
            difference
        }));
    }
}

fn take_color(bytes: &[u8]) -> Vec<[u8; 3]> {
    let mut pixels = vec![[0; 3]; bytes.len() / 3];
    for (channel, plane) in bytes.chunks_exact((bytes.len() / 3).max(1)).take(3).enumerate() {
        let mut value = 0_u8;
        for (pixel, &difference) in pixels.iter_mut().zip(plane) {
            value = value.wrapping_add(difference);
            pixel[channel] = value;
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(seed: u8, moving: bool) -> LoggedFrame {
        let count = 7 * 5;
        let pixel = |i: usize| (i as u8).wrapping_mul(37).wrapping_add(seed);
        let depth = (0..count).map(|i| f32::from(u16::from(pixel(i)) * 211) / STEPS_PER_M);
        let color = (0..count).map(|i| [pixel(i), pixel(i + 1), pixel(2 * i)]);
        let mask = (0..count).map(|i| if pixel(i) > 127 { 255 } else { 0 });
        LoggedFrame {
            depth_m: Image::from_pixels(7, 5, depth.collect()).unwrap(),
            color: Image::from_pixels(7, 5, color.collect()).unwrap(),
            moving: moving.then(|| Image::from_pixels(7, 5, mask.collect()).unwrap()),
        }
    }

    #[test]
    fn frames_come_back_to_the_bit_in_any_order() {
        let mut log = FrameLog::new().unwrap();
        let frames: Vec<_> = (0..9).map(|i| frame(i * 29, i % 2 == 0)).collect();
        for frame in &frames {
            let mut given = frame.clone();
            log.append(&mut given).unwrap();
            assert_eq!(given, *frame, "steps of the log are not rounded");
        }
        for index in [8, 0, 3, 3, 7] {
            assert_eq!(log.read(index).unwrap(), frames[index]);
        }
        assert_eq!(log.entries.len(), 9);
        assert!(log.read(9).is_err());
    }

    #[test]
    fn depth_that_is_none_becomes_0_for_the_live_frame_too() {
        let mut log = FrameLog::new().unwrap();
        let mut given = frame(0, false);
        let odd = [f32::NAN, -1.0, f32::INFINITY, 13.2, 1.000_04, 1.000_16];
        given.depth_m.pixels_mut()[..6].copy_from_slice(&odd);
        log.append(&mut given).unwrap();
        assert_eq!(given.depth_m.pixels()[..6], [0.0, 0.0, 0.0, 0.0, 1.0, 1.0002]);
        assert_eq!(log.read(0).unwrap(), given);
    }

    #[test]
    fn images_of_unequal_size_are_refused() {
        let mut log = FrameLog::new().unwrap();
        let mut odd = frame(0, true);
        odd.moving = Some(Image::filled(5, 7, 0));
        assert!(log.append(&mut odd).is_err());
        assert!(log.entries.is_empty() && log.pages.bytes() == 0);
    }
}
