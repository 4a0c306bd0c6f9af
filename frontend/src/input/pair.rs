//! One frame from its two files, with all the checks that concern a single frame.
//!
//! Knows neither lists nor layouts: those who do name the files and the time.

use std::io::Read;
use std::path::Path;

use super::decode;
use super::error::FrameError;
use crate::image::{Image, RgbdFrame};

/// No image that is accepted takes more bytes than this, and no file that is longer is read.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// How a depth image's numbers become meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DepthScale {
    /// Units a meter.
    pub(super) units_per_m: f32,
    /// A value that stands for "none measured" beside 0.
    pub(super) none: Option<u16>,
}

/// Reads frames of one size.
#[derive(Debug)]
pub(super) struct PairReader {
    scale: DepthScale,
    /// That of the first frame that was read.
    size: Option<(usize, usize)>,
}

impl PairReader {
    pub(super) fn new(scale: DepthScale) -> Self {
        Self { scale, size: None }
    }

    /// Reads one frame, of this time and with a depth image of a time that is that much later.
    pub(super) fn read(
        &mut self,
        timestamp_s: f64,
        depth_delay_s: f64,
        color_path: &Path,
        depth_path: &Path,
    ) -> Result<RgbdFrame, FrameError> {
        let color = decode::color(&bytes(color_path)?)
            .map_err(|source| FrameError::Decode { path: color_path.to_owned(), source })?;
        check_size(color_path, color.size(), self.size.unwrap_or(color.size()))?;
        let depth = depth_values(depth_path)?;
        check_size(depth_path, depth.size(), color.size())?;
        self.size = Some(color.size());
        let DepthScale { units_per_m, none } = self.scale;
        let depth_m = depth
            .map(|value| if Some(value) == none { 0.0 } else { f32::from(value) / units_per_m });
        Ok(RgbdFrame { timestamp_s, depth_delay_s, color, depth_m, given_pose: None })
    }
}

/// The numbers of a depth image.
pub(super) fn depth_values(path: &Path) -> Result<Image<u16>, FrameError> {
    decode::depth(&bytes(path)?)
        .map_err(|source| FrameError::Decode { path: path.to_owned(), source })
}

/// A file's bytes.
fn bytes(path: &Path) -> Result<Vec<u8>, FrameError> {
    let read = || {
        let mut bytes = Vec::new();
        std::fs::File::open(path)?.take(MAX_FILE_BYTES).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    read().map_err(|source| FrameError::Read { path: path.to_owned(), source })
}

fn check_size(
    path: &Path,
    found: (usize, usize),
    expected: (usize, usize),
) -> Result<(), FrameError> {
    if found == expected {
        return Ok(());
    }
    Err(FrameError::Size { path: path.to_owned(), found, expected })
}
